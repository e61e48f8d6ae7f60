//! From bytes to records.

use crate::{CRC, CRC_LEN, MAX_FRAME_LEN, PROTOCOL_VERSION, Record};
use serde::{Deserialize, Serialize};

/// Finds records in a stream of bytes that may start anywhere, lack parts and
/// carry garbage between frames.
///
/// It never gets stuck: the next zero byte starts it afresh. Every frame that
/// is whole, and has a zero byte before and behind, is found.
#[derive(Clone, Debug)]
pub struct Decoder {
    frame: [u8; MAX_FRAME_LEN],
    len: usize,
    /// The bytes since the last zero do not fit a frame.
    overlong: bool,
    /// The sequence number that is due, once one has been seen.
    due: Option<u16>,
    statistics: Statistics,
}

/// What the end of a frame brought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// A record.
    Record {
        /// The sender's count of frames, wrapping.
        sequence: u16,
        /// Frames missing before this one, by their numbers.
        lost: u16,
        /// The record.
        record: Record,
    },
    /// A frame that gave no record.
    Trouble(Trouble),
}

/// Why a frame gave no record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Trouble {
    /// Bytes between two zeros that are no frame: damaged, cut or garbage.
    Corrupt,
    /// A good frame of another protocol version.
    Version(u8),
    /// A good frame with a record this reader does not know; its number among
    /// the variants of [`Record`].
    Unknown(u32),
}

/// What a stream has held so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Statistics {
    /// Records found.
    pub records: u64,
    /// Frames that are missing by their numbers.
    pub lost: u64,
    /// Stretches of bytes that are no frame.
    pub corrupt: u64,
    /// Good frames with a record or version that this reader does not know.
    pub unknown: u64,
    /// Bytes taken in.
    pub bytes: u64,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A decoder at the start of a stream.
    pub const fn new() -> Self {
        Self {
            frame: [0; MAX_FRAME_LEN],
            len: 0,
            overlong: false,
            due: None,
            statistics: Statistics {
                records: 0,
                lost: 0,
                corrupt: 0,
                unknown: 0,
                bytes: 0,
            },
        }
    }

    /// What the stream has held so far.
    pub const fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Takes the next byte; returns something where a frame ends.
    pub fn push(&mut self, byte: u8) -> Option<Event> {
        self.statistics.bytes += 1;
        if byte == 0 {
            return self.end_of_frame();
        }
        match self.frame.get_mut(self.len) {
            Some(place) => {
                *place = byte;
                self.len += 1;
            }
            None => self.overlong = true,
        }
        None
    }

    /// Takes the end of the stream: bytes after the last zero are a frame that
    /// was cut off.
    pub fn finish(&mut self) -> Option<Event> {
        self.end_of_frame()
    }

    fn end_of_frame(&mut self) -> Option<Event> {
        let len = core::mem::take(&mut self.len);
        let overlong = core::mem::take(&mut self.overlong);
        if len == 0 {
            // Between the closing zero of one frame and the opening one of the next.
            return None;
        }
        let frame = if overlong {
            &mut []
        } else {
            self.frame.get_mut(..len).unwrap_or_default()
        };
        let opened = open(frame);
        Some(self.account(opened))
    }

    /// Counts a frame and what is missing before it.
    fn account(&mut self, opened: Opened) -> Event {
        let lost = match opened.sequence {
            None => 0,
            Some(sequence) => {
                let lost = match (self.due, &opened.content) {
                    // A node that has just started counts from 0 again.
                    (None, _) | (_, Ok(Record::Boot(_))) => 0,
                    (Some(due), _) => sequence.wrapping_sub(due),
                };
                self.due = Some(sequence.wrapping_add(1));
                lost
            }
        };
        self.statistics.lost += u64::from(lost);
        match opened.content {
            Ok(record) => {
                self.statistics.records += 1;
                Event::Record {
                    sequence: opened.sequence.unwrap_or_default(),
                    lost,
                    record,
                }
            }
            Err(trouble) => {
                match trouble {
                    Trouble::Corrupt => self.statistics.corrupt += 1,
                    Trouble::Version(_) | Trouble::Unknown(_) => self.statistics.unknown += 1,
                }
                Event::Trouble(trouble)
            }
        }
    }
}

/// A frame without its wrapping.
struct Opened {
    /// Known for every good frame of our version.
    sequence: Option<u16>,
    content: Result<Record, Trouble>,
}

impl Opened {
    const CORRUPT: Self = Self {
        sequence: None,
        content: Err(Trouble::Corrupt),
    };
}

/// Takes the stuffing off `frame`, checks the CRC and reads the record.
fn open(frame: &mut [u8]) -> Opened {
    let Ok(len) = cobs::decode_in_place(frame) else {
        return Opened::CORRUPT;
    };
    let Some((payload, crc)) = frame
        .get(..len)
        .and_then(|bytes| bytes.split_last_chunk::<CRC_LEN>())
    else {
        return Opened::CORRUPT;
    };
    if CRC.checksum(payload) != u32::from_le_bytes(*crc) {
        return Opened::CORRUPT;
    }
    // From here on the bytes are what the sender meant.
    let Ok((version, rest)) = postcard::take_from_bytes::<u8>(payload) else {
        return Opened::CORRUPT;
    };
    if version != PROTOCOL_VERSION {
        return Opened {
            sequence: None,
            content: Err(Trouble::Version(version)),
        };
    }
    let Ok((sequence, body)) = postcard::take_from_bytes::<u16>(rest) else {
        return Opened::CORRUPT;
    };
    let content = match postcard::take_from_bytes::<Record>(body) {
        Ok((record, [])) => Ok(record),
        _ => match postcard::take_from_bytes::<u32>(body) {
            Ok((variant, _)) if variant >= Record::KNOWN => Err(Trouble::Unknown(variant)),
            _ => Err(Trouble::Corrupt),
        },
    };
    Opened {
        sequence: Some(sequence),
        content,
    }
}
