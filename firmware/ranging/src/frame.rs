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

use crate::time::{MODULUS, Ticks};

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

/// Notices any three wrong bits in a frame of any length that the radio has. Polynomials that notice five in a short
/// frame do not: CRC-16/DNP lets pairs of wrong bits 151 bits apart pass.
const CHECK: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

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
    /// The frame's bytes, without the radio's frame check sequence.
    pub fn encode(&self) -> FrameBuffer {
        let mut out = Writer::default();
        out.u16(FRAME_CONTROL);
        out.bytes(&[self.sequence]);
        out.u16(self.pan.0);
        out.u16(self.destination.0);
        out.u16(self.source.0);
        out.bytes(&[PROTOCOL, self.message.code(), self.round]);
        match &self.message {
            Message::Poll(poll) => {
                out.u16(poll.reply_us);
                out.u16(poll.slot_us);
                out.bytes(&[poll.slots]);
                poll.named.iter().for_each(|named| out.u16(named.0));
            }
            Message::Response => {}
            Message::Final(last) => {
                out.interval(last.span);
                for answered in &last.answered {
                    out.u16(answered.responder.0);
                    out.interval(answered.round);
                }
            }
            Message::Report { round, reply } => {
                out.interval(*round);
                out.interval(*reply);
            }
            Message::Beacon(beacon) => {
                out.bytes(&beacon.length_us.to_le_bytes());
                out.u16(beacon.join_us);
                for grant in &beacon.grants {
                    out.u16(grant.owner.0);
                    out.u16(grant.length_us);
                }
            }
            Message::Join { need_us, period_us } => {
                out.u16(*need_us);
                out.bytes(&period_us.to_le_bytes());
            }
        }
        let check = CHECK.checksum(&out.0);
        out.u16(check);
        out.0
    }

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

    /// Reads a frame from received bytes, without the radio's frame check sequence.
    ///
    /// # Errors
    /// [`FrameError`] names the first thing that is not ours.
    pub fn parse(bytes: &[u8]) -> Result<Self, FrameError> {
        let (content, check) = bytes
            .split_last_chunk::<CHECK_LEN>()
            .ok_or(FrameError::Length)?;
        let mut input = Reader(content);
        let control = input.u16()?;
        let sequence = input.u8()?;
        let pan = PanId(input.u16()?);
        let destination = Address(input.u16()?);
        let source = Address(input.u16()?);
        let (protocol, code, round) = (input.u8()?, input.u8()?, input.u8()?);
        if control != FRAME_CONTROL {
            return Err(FrameError::FrameControl);
        }
        if protocol != PROTOCOL {
            return Err(FrameError::Protocol);
        }
        if CHECK.checksum(content) != u16::from_le_bytes(*check) {
            return Err(FrameError::Check);
        }
        let message = match code {
            Message::POLL => Message::Poll(Poll::parse(&mut input)?),
            Message::RESPONSE => Message::Response,
            Message::FINAL => {
                let span = input.interval()?;
                let answered = input.list(|input| {
                    Ok(Answered {
                        responder: Address(input.u16()?),
                        round: input.interval()?,
                    })
                })?;
                Message::Final(Final { span, answered })
            }
            Message::REPORT => Message::Report {
                round: input.interval()?,
                reply: input.interval()?,
            },
            Message::BEACON => {
                let length_us = u32::from_le_bytes(input.take()?);
                let join_us = input.u16()?;
                let grants = input.list(|input| {
                    Ok(Grant {
                        owner: Address(input.u16()?),
                        length_us: input.u16()?,
                    })
                })?;
                Message::Beacon(Beacon {
                    length_us,
                    join_us,
                    grants,
                })
            }
            Message::JOIN => Message::Join {
                need_us: input.u16()?,
                period_us: u32::from_le_bytes(input.take()?),
            },
            _ => return Err(FrameError::Message),
        };
        if !input.0.is_empty() {
            return Err(FrameError::Length);
        }
        Ok(Self {
            sequence,
            pan,
            destination,
            source,
            round,
            message,
        })
    }
}

impl Poll {
    fn parse(input: &mut Reader<'_>) -> Result<Self, FrameError> {
        let (reply_us, slot_us, slots) = (input.u16()?, input.u16()?, input.u8()?);
        let named: heapless::Vec<Address, MAX_RESPONDERS> =
            input.list(|input| input.u16().map(Address))?;
        let slots_used = usize::from(slots);
        if slots_used == 0 || slots_used > MAX_RESPONDERS || named.len() > slots_used {
            return Err(FrameError::Slots);
        }
        Ok(Self {
            reply_us,
            slot_us,
            slots,
            named,
        })
    }
}

/// Puts numbers into a frame. It has room for the longest by definition.
#[derive(Default)]
struct Writer(FrameBuffer);

impl Writer {
    fn bytes(&mut self, bytes: &[u8]) {
        let _ = self.0.extend_from_slice(bytes);
    }

    fn u16(&mut self, value: u16) {
        self.bytes(&value.to_le_bytes());
    }

    fn interval(&mut self, ticks: Ticks) {
        let [low @ .., _, _, _] = ticks.get().to_le_bytes();
        self.bytes(&low);
    }
}

/// Takes numbers out of a frame.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], FrameError> {
        let (head, rest) = self.0.split_first_chunk::<N>().ok_or(FrameError::Length)?;
        self.0 = rest;
        Ok(*head)
    }

    fn u8(&mut self) -> Result<u8, FrameError> {
        self.take().map(|[byte]| byte)
    }

    fn u16(&mut self) -> Result<u16, FrameError> {
        self.take().map(u16::from_le_bytes)
    }

    fn interval(&mut self) -> Result<Ticks, FrameError> {
        let [a, b, c, d, e] = self.take()?;
        Ok(Ticks::new(
            u64::from_le_bytes([a, b, c, d, e, 0, 0, 0]) % MODULUS,
        ))
    }

    /// As many items as there are up to the end.
    fn list<T, const N: usize>(
        &mut self,
        mut item: impl FnMut(&mut Self) -> Result<T, FrameError>,
    ) -> Result<heapless::Vec<T, N>, FrameError> {
        let mut items = heapless::Vec::new();
        while !self.0.is_empty() {
            let item = item(self)?;
            items.push(item).map_err(|_| FrameError::Length)?;
        }
        Ok(items)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn any_message() -> impl Strategy<Value = Message> {
        let ticks = || (0..MODULUS).prop_map(Ticks::new);
        let named = prop::collection::vec(any::<u16>(), 0..=MAX_RESPONDERS);
        let poll = (any::<u16>(), any::<u16>(), named, 0..=MAX_RESPONDERS).prop_map(
            |(reply_us, slot_us, named, open)| {
                Message::Poll(Poll {
                    reply_us,
                    slot_us,
                    slots: (named.len() + open).clamp(1, MAX_RESPONDERS) as u8,
                    named: named.into_iter().map(Address).collect(),
                })
            },
        );
        let answered = prop::collection::vec((any::<u16>(), ticks()), 0..=MAX_RESPONDERS);
        let last = (ticks(), answered).prop_map(|(span, answered)| {
            Message::Final(Final {
                span,
                answered: answered
                    .into_iter()
                    .map(|(responder, round)| Answered {
                        responder: Address(responder),
                        round,
                    })
                    .collect(),
            })
        });
        let grants = prop::collection::vec((any::<u16>(), any::<u16>()), 0..=MAX_SLOTS);
        let beacon =
            (any::<u32>(), any::<u16>(), grants).prop_map(|(length_us, join_us, grants)| {
                Message::Beacon(Beacon {
                    length_us,
                    join_us,
                    grants: grants
                        .into_iter()
                        .map(|(owner, length_us)| Grant {
                            owner: Address(owner),
                            length_us,
                        })
                        .collect(),
                })
            });
        prop_oneof![
            poll,
            Just(Message::Response),
            last,
            (ticks(), ticks()).prop_map(|(round, reply)| Message::Report { round, reply }),
            beacon,
            (any::<u16>(), any::<u32>())
                .prop_map(|(need_us, period_us)| Message::Join { need_us, period_us }),
        ]
    }

    fn any_frame() -> impl Strategy<Value = Frame> {
        (any::<(u8, u16, u16, u16, u8)>(), any_message()).prop_map(
            |((sequence, pan, destination, source, round), message)| Frame {
                sequence,
                pan: PanId(pan),
                destination: Address(destination),
                source: Address(source),
                round,
                message,
            },
        )
    }

    fn frame(message: Message) -> Frame {
        Frame {
            sequence: 7,
            pan: PanId(0xDECA),
            destination: Address(0x0102),
            source: Address(0x0A0B),
            round: 9,
            message,
        }
    }

    #[test]
    fn a_poll_is_these_bytes() {
        let poll = frame(Message::Poll(Poll {
            reply_us: 0x0258,
            slot_us: 0x0190,
            slots: 2,
            named: [Address(0x0102)].into_iter().collect(),
        }));
        let bytes = poll.encode();
        assert_eq!(
            bytes[..19],
            [
                0x41, 0x88, 7, 0xCA, 0xDE, 0x02, 0x01, 0x0B, 0x0A, 0xD6, 1, 9, 0x58, 0x02, 0x90,
                0x01, 2, 0x02, 0x01
            ]
        );
        assert_eq!(bytes.len(), len::poll(1));
    }

    #[test]
    fn a_cut_or_stretched_frame_is_refused() {
        let ticks = Ticks::new(123_456_789);
        let answered = Answered {
            responder: Address(3),
            round: ticks,
        };
        for message in [
            Message::Response,
            Message::Report {
                round: ticks,
                reply: ticks,
            },
            Message::Final(Final {
                span: ticks,
                answered: [answered; 3].into_iter().collect(),
            }),
        ] {
            let mut bytes = frame(message).encode().to_vec();
            let len = bytes.len();
            bytes.push(0);
            for cut in (0..len).chain([len + 1]) {
                assert!(Frame::parse(&bytes[..cut]).is_err(), "{cut} of {len}");
            }
        }
    }

    #[test]
    fn the_check_is_crc_16_ibm_3740() {
        assert_eq!(CHECK.checksum(b"123456789"), 0x29B1);
    }

    /// All errors of three bits and fewer, in a frame of the longest kind. A check sequence is linear: what single
    /// wrong bits do to it adds up, and errors are missed whose sum is nothing.
    #[test]
    fn no_three_wrong_bits_cancel_each_other() {
        let mut none = [0_u8; MAX_FRAME_LEN - CHECK_LEN];
        let right = CHECK.checksum(&none);
        let mut syndromes: std::vec::Vec<u16> = (0..16).map(|bit| 1 << bit).collect();
        for bit in 0..8 * none.len() {
            none[bit / 8] ^= 1 << (bit % 8);
            syndromes.push(CHECK.checksum(&none) ^ right);
            none[bit / 8] ^= 1 << (bit % 8);
        }
        let mut known = std::vec![false; 1 << 16];
        known[0] = true;
        for (place, &first) in syndromes.iter().enumerate() {
            assert!(
                !known[usize::from(first)],
                "bit {place} alone or with another"
            );
            for &second in &syndromes[..place] {
                assert!(!known[usize::from(first ^ second)], "bit {place} with two");
            }
            known[usize::from(first)] = true;
        }
    }

    #[test]
    fn a_poll_with_more_names_than_slots_is_refused() {
        for (slots, named) in [(0, 0), (1, 2), (9, 0)] {
            let poll = frame(Message::Poll(Poll {
                reply_us: 600,
                slot_us: 400,
                slots,
                named: (0..named).map(Address).collect(),
            }));
            assert_eq!(Frame::parse(&poll.encode()), Err(FrameError::Slots));
        }
    }

    proptest! {
        #[test]
        fn every_frame_survives_the_air(frame in any_frame()) {
            prop_assert_eq!(Frame::parse(&frame.encode()), Ok(frame));
        }

        #[test]
        fn any_bytes_parse_to_themselves_or_an_error(mut bytes: Vec<u8>, ours: bool) {
            if ours && bytes.len() > HEADER_LEN + CHECK_LEN {
                // As far as the check goes it is a frame of ours.
                bytes[..2].copy_from_slice(&FRAME_CONTROL.to_le_bytes());
                bytes[9] = PROTOCOL;
                bytes[10] = 1 + bytes[10] % 6;
                let end = bytes.len() - CHECK_LEN;
                let check = CHECK.checksum(&bytes[..end]).to_le_bytes();
                bytes[end..].copy_from_slice(&check);
            }
            if let Ok(frame) = Frame::parse(&bytes) {
                prop_assert_eq!(&frame.encode()[..], &bytes[..]);
            }
        }

        /// What SPI does to a frame shows, on whichever side it happens.
        #[test]
        fn up_to_three_wrong_bits_are_noticed(frame in any_frame(), at in prop::collection::vec(any::<prop::sample::Index>(), 1..=3)) {
            let good = frame.encode().to_vec();
            let mut bytes = good.clone();
            for index in at {
                let bit = index.index(8 * bytes.len());
                bytes[bit / 8] ^= 1 << (bit % 8);
            }
            prop_assume!(bytes != good);
            prop_assert!(Frame::parse(&bytes).is_err());
        }
    }
}
