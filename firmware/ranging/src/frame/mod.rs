//! The bytes in the air: IEEE 802.15.4 data frames with short addresses.
//!
//! docs/air-protocol.md has the tables and the times. In short:
//!
//! | bytes | field | value |
//! |---|---|---|
//! | 0..2 | frame control | 0x8841, little-endian: data, PAN id compressed, short addresses |
//! | 2 | sequence number | counts the sender's frames |
//! | 3..5 | PAN id | little-endian, as all numbers below |
//! | 5..7 | destination | short address, 0xFFFF to all |
//! | 7..9 | source | short address |
//! | 9 | protocol | 0xD6: ranging in rounds, version 2 |
//! | 10 | message | 1 poll, 2 response, 3 final, 4 report, 5 beacon, 6 join |
//! | 11 | round | the same in all frames of one round |
//! | 12.. | body | by message |
//! | last 2 | check | CRC-16/IBM-3740 of all bytes before |
//!
//! The frame check sequence behind it belongs to the radio. It covers the air; the
//! check covers what the radio's does not, the way over SPI on either side.

mod codec;
#[cfg(test)]
mod tests;

use crate::time::Ticks;

/// A 16-bit IEEE 802.15.4 short address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Address(pub u16);

/// A 16-bit IEEE 802.15.4 network identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PanId(pub u16);

impl Address {
    /// All nodes.
    pub const BROADCAST: Self = Self(0xFFFF);
}

/// Most responders in one round.
pub const MAX_RESPONDERS: usize = 8;

/// Most owners of slots in one superframe.
pub const MAX_SLOTS: usize = 24;

const FRAME_CONTROL: u16 = 0x8841;
const PROTOCOL: u8 = 0xD6;
const HEADER_LEN: usize = 12;
const CHECK_LEN: usize = 2;
const INTERVAL_LEN: usize = 5;
const POLL_FIXED_LEN: usize = 5;
const ANSWERED_LEN: usize = 2 + INTERVAL_LEN;
const BEACON_FIXED_LEN: usize = 6;
const GRANT_LEN: usize = 4;

/// A length in bytes, without the radio's frame check sequence.
pub mod len {
    use super::{
        ANSWERED_LEN, BEACON_FIXED_LEN, CHECK_LEN, GRANT_LEN, HEADER_LEN, INTERVAL_LEN,
        POLL_FIXED_LEN,
    };

    /// A poll that names so many responders.
    pub const fn poll(named: usize) -> usize {
        HEADER_LEN + POLL_FIXED_LEN + 2 * named + CHECK_LEN
    }
    /// A response.
    pub const RESPONSE: usize = HEADER_LEN + CHECK_LEN;
    /// A final for so many responders.
    pub const fn last(answered: usize) -> usize {
        HEADER_LEN + INTERVAL_LEN + ANSWERED_LEN * answered + CHECK_LEN
    }
    /// A report.
    pub const REPORT: usize = HEADER_LEN + 2 * INTERVAL_LEN + CHECK_LEN;
    /// A beacon that grants so many slots.
    pub const fn beacon(granted: usize) -> usize {
        HEADER_LEN + BEACON_FIXED_LEN + GRANT_LEN * granted + CHECK_LEN
    }
    /// A request for a slot.
    pub const JOIN: usize = HEADER_LEN + 6 + CHECK_LEN;
}

/// Length in bytes of the longest frame, without the radio's frame check sequence.
pub const MAX_FRAME_LEN: usize = len::beacon(MAX_SLOTS);

/// An encoded frame, without the radio's frame check sequence.
pub type FrameBuffer = heapless::Vec<u8, MAX_FRAME_LEN>;

/// One frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Counts the sender's frames.
    pub sequence: u8,
    /// Network.
    pub pan: PanId,
    /// Whom it is for.
    pub destination: Address,
    /// Whom it is from.
    pub source: Address,
    /// Number of the round, chosen by the initiator, wrapping; of the superframe in a beacon.
    pub round: u8,
    /// What it says.
    pub message: Message,
}

/// What a frame says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// The initiator asks for ranges.
    Poll(Poll),
    /// A responder answers, in its slot.
    Response,
    /// The initiator's half of all measurements of the round.
    Final(Final),
    /// The responder's half of one measurement, in its slot.
    Report {
        /// Rb, from response sent to final received.
        round: Ticks,
        /// Db, from poll received to response sent.
        reply: Ticks,
    },
    /// The coordinator says who talks when in the superframe that now begins.
    Beacon(Beacon),
    /// An initiator asks the coordinator for a slot.
    Join {
        /// Length of the slot that it needs, in microseconds.
        need_us: u16,
        /// From one of its rounds to the next, in microseconds.
        period_us: u32,
    },
}

/// What a poll says: who is to answer, and when.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Poll {
    /// From a frame to the first answer to it, in microseconds.
    pub reply_us: u16,
    /// From one answer to the next, in microseconds.
    pub slot_us: u16,
    /// Number of slots for answers: those behind the named ones are open to nodes that
    /// the initiator does not know.
    pub slots: u8,
    /// Who answers, in this order.
    pub named: heapless::Vec<Address, MAX_RESPONDERS>,
}

/// What a final says.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Final {
    /// t5 - t1, from the poll sent to this frame sent.
    pub span: Ticks,
    /// Whose response was heard; they report in this order.
    pub answered: heapless::Vec<Answered, MAX_RESPONDERS>,
}

/// The initiator's half of one measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Answered {
    /// The responder.
    pub responder: Address,
    /// Ra = t4 - t1, from the poll sent to its response received. Its Da = t5 - t4 is
    /// the final's span less this.
    pub round: Ticks,
}

/// What a beacon says.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Beacon {
    /// From this beacon to the next, in microseconds.
    pub length_us: u32,
    /// Time at the end of the superframe for nodes that have no slot, in microseconds;
    /// often 0.
    pub join_us: u16,
    /// Who owns which slot: one behind the other, from the beacon's end on.
    pub grants: heapless::Vec<Grant, MAX_SLOTS>,
}

/// A slot of the superframe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Grant {
    /// Who may talk in it.
    pub owner: Address,
    /// For how long, in microseconds.
    pub length_us: u16,
}

/// Why bytes from the air are not a frame of ours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameError {
    /// Shorter or longer than its message.
    Length,
    /// Another kind of IEEE 802.15.4 frame: not data, or other addressing.
    FrameControl,
    /// Somebody else's protocol, or another version of ours.
    Protocol,
    /// No message of ours has this number.
    Message,
    /// The check is wrong: a bit was lost between a processor and its radio.
    Check,
    /// A poll that names more responders than it has slots, or has too many slots.
    Slots,
}

impl Message {
    const POLL: u8 = 1;
    const RESPONSE: u8 = 2;
    const FINAL: u8 = 3;
    const REPORT: u8 = 4;
    const BEACON: u8 = 5;
    const JOIN: u8 = 6;

    /// The number that stands for the message in the air.
    pub const fn code(&self) -> u8 {
        match self {
            Self::Poll(_) => Self::POLL,
            Self::Response => Self::RESPONSE,
            Self::Final(_) => Self::FINAL,
            Self::Report { .. } => Self::REPORT,
            Self::Beacon(_) => Self::BEACON,
            Self::Join { .. } => Self::JOIN,
        }
    }
}

impl Frame {
    /// The intervals that a final or a report carries: the other node, round time, reply
    /// time; one for each responder in a final.
    pub fn intervals(&self) -> impl Iterator<Item = (Address, Ticks, Ticks)> + '_ {
        let (span, answered, report) = match &self.message {
            Message::Final(last) => (last.span, last.answered.as_slice(), None),
            Message::Report { round, reply } => (
                *reply,
                [].as_slice(),
                Some((self.destination, *round, *reply)),
            ),
            _ => (Ticks::new(0), [].as_slice(), None),
        };
        answered
            .iter()
            .map(move |answered| {
                let reply = span.get().wrapping_sub(answered.round.get());
                (answered.responder, answered.round, Ticks::new(reply))
            })
            .chain(report)
    }
}
