//! From bytes to records.

use crate::{CRC, CRC_LEN, Command, MAX_FRAME_LEN, Message, PROTOCOL_VERSION, Record};
use core::marker::PhantomData;
use serde::{Deserialize, Serialize};

/// Finds records: the host's side.
pub type Decoder = FrameDecoder<Record>;

/// Finds commands: the node's side.
pub type CommandDecoder = FrameDecoder<Command>;

/// What the end of a frame brought a host.
pub type Event = FrameEvent<Record>;

/// What the end of a frame brought a node.
pub type CommandEvent = FrameEvent<Command>;

/// Finds messages in a stream of bytes that may start anywhere, lack parts and
/// carry garbage between frames.
///
/// It never gets stuck: the next zero byte starts it afresh. Every frame that
/// is whole, and has a zero byte before and behind, is found.
#[derive(Clone, Debug)]
pub struct FrameDecoder<M> {
    frame: [u8; MAX_FRAME_LEN],
    len: usize,
    /// The bytes since the last zero do not fit a frame.
    overlong: bool,
    /// The sequence number that is due, once one has been seen.
    due: Option<u16>,
    /// The sequence number of the last frame, if it was good enough to have one.
    last: Option<u16>,
    statistics: Statistics,
    messages: PhantomData<M>,
}

/// What the end of a frame brought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameEvent<M> {
    /// A record, or a command.
    Record {
        /// The sender's count of frames, wrapping.
        sequence: u16,
        /// Frames missing before this one, by their numbers.
        lost: u16,
        /// What the frame holds.
        record: M,
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
    /// the variants of [`Record`] or [`Command`].
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

impl<M: Message> Default for FrameDecoder<M> {
    fn default() -> Self {
        Self::new()
    }
}

impl<M: Message> FrameDecoder<M> {
    /// A decoder at the start of a stream.
    pub const fn new() -> Self {
        Self {
            frame: [0; MAX_FRAME_LEN],
            len: 0,
            overlong: false,
            due: None,
            last: None,
            statistics: Statistics {
                records: 0,
                lost: 0,
                corrupt: 0,
                unknown: 0,
                bytes: 0,
            },
            messages: PhantomData,
        }
    }

    /// The sequence number of the frame that ended last; `None` if it was
    /// damaged or of another version. An [unknown](Trouble::Unknown) command can
    /// be answered by it.
    pub const fn last_sequence(&self) -> Option<u16> {
        self.last
    }

    /// What the stream has held so far.
    pub const fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Takes the next byte; returns something where a frame ends.
    pub fn push(&mut self, byte: u8) -> Option<FrameEvent<M>> {
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
    pub fn finish(&mut self) -> Option<FrameEvent<M>> {
        self.end_of_frame()
    }

    fn end_of_frame(&mut self) -> Option<FrameEvent<M>> {
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
    fn account(&mut self, opened: Opened<M>) -> FrameEvent<M> {
        self.last = opened.sequence;
        let lost = match opened.sequence {
            None => 0,
            Some(sequence) => {
                let restarts = opened.content.as_ref().is_ok_and(M::restarts_count);
                let lost = match self.due {
                    Some(due) if !restarts => sequence.wrapping_sub(due),
                    _ => 0,
                };
                self.due = Some(sequence.wrapping_add(1));
                lost
            }
        };
        self.statistics.lost += u64::from(lost);
        match opened.content {
            Ok(record) => {
                self.statistics.records += 1;
                FrameEvent::Record {
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
                FrameEvent::Trouble(trouble)
            }
        }
    }
}

/// A frame without its wrapping.
struct Opened<M> {
    /// Known for every good frame of our version.
    sequence: Option<u16>,
    content: Result<M, Trouble>,
}

impl<M> Opened<M> {
    const CORRUPT: Self = Self {
        sequence: None,
        content: Err(Trouble::Corrupt),
    };
}

/// Takes the stuffing off `frame`, checks the CRC and reads the record.
fn open<M: Message>(frame: &mut [u8]) -> Opened<M> {
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
    let content = match postcard::take_from_bytes::<M>(body) {
        Ok((record, [])) => Ok(record),
        _ => match postcard::take_from_bytes::<u32>(body) {
            Ok((variant, _)) if variant >= M::KNOWN => Err(Trouble::Unknown(variant)),
            _ => Err(Trouble::Corrupt),
        },
    };
    Opened {
        sequence: Some(sequence),
        content,
    }
}
