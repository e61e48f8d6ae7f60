//! What a node tells a host, what a host tells a node, and how the bytes are framed.
//!
//! Records (node to host) and [commands](Command) (host to node) are numbered, protected by a CRC-32 and stuffed with COBS, so that
//! a reader can start anywhere, notice every loss and never mistakes damage
//! for data. docs/wire-format.md specifies the format byte by byte; this crate
//! is what both sides use.
//!
//! ```
//! use nova_wire::{Decoder, Encoder, Event, MAX_FRAME_LEN, Record, Status};
//!
//! let mut buffer = [0; MAX_FRAME_LEN];
//! let bytes = Encoder::new().encode(&Record::Status(Status::default()), &mut buffer).unwrap();
//!
//! let mut decoder = Decoder::new();
//! let records: Vec<_> = bytes.iter().filter_map(|&b| decoder.push(b)).collect();
//! assert!(matches!(records[..], [Event::Record { sequence: 0, .. }]));
//! ```
#![no_std]

#[cfg(test)]
extern crate std;

mod command;
mod decoder;
mod encoder;
mod message;
mod record;
pub mod settings;
mod text;

pub use command::{Answer, Changes, Command, Outcome, Refusal};
pub use decoder::{
    CommandDecoder, CommandEvent, Decoder, Event, FrameDecoder, FrameEvent, Statistics, Trouble,
};
pub use encoder::{EncodeError, Encoder};
pub use message::Message;
pub use record::{
    Boot, Counters, Crash, CrashKind, Filtered, Overheard, OverheardInterval, PROTOCOL_VERSION,
    Quality, Range, RangeFlags, Record, ResetCause, Role, SettingsSource, Status, Treatment,
};
pub use settings::{Change, Setting, SettingValue, Settings, Value};
pub use text::{MAX_TEXT_LEN, Text};

/// Longest payload: version, sequence number and record, without CRC.
pub const MAX_PAYLOAD_LEN: usize = 240;

const CRC_LEN: usize = 4;

/// Longest frame on the wire: payload and CRC, stuffed (one byte more in every
/// 254), and a zero byte before and behind.
pub const MAX_FRAME_LEN: usize = MAX_PAYLOAD_LEN + CRC_LEN + 1 + 2;

/// CRC-32 as in Ethernet and zlib: polynomial 0x04C11DB7, reflected, initial
/// value and final exclusive-or 0xFFFFFFFF; "123456789" gives 0xCBF43926.
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
