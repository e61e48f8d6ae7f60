//! The bytes in the air: IEEE 802.15.4 data frames with short addresses.
//!
//! | bytes | field | value |
//! |---|---|---|
//! | 0..2 | frame control | 0x8841, little-endian: data, PAN id compressed, short addresses |
//! | 2 | sequence number | counts the sender's frames |
//! | 3..5 | PAN id | little-endian, as all numbers below |
//! | 5..7 | destination | short address, 0xFFFF to all |
//! | 7..9 | source | short address |
//! | 9 | protocol | 0xD5: two-way ranging, version 1 |
//! | 10 | message | 1 poll, 2 response, 3 final, 4 report |
//! | 11 | exchange | the same in all frames of one exchange |
//! | 12..17 | final: Ra, report: Rb | round time, 40 bits, ticks of 15.650 ps |
//! | 17..22 | final: Da, report: Db | reply time, 40 bits, ticks of 15.650 ps |
//!
//! The frame check sequence behind it belongs to the radio.

use crate::time::{MODULUS, Ticks};

/// A 16-bit IEEE 802.15.4 short address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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

const FRAME_CONTROL: u16 = 0x8841;
const PROTOCOL: u8 = 0xD5;
const HEADER_LEN: usize = 12;
const INTERVAL_LEN: usize = 5;

/// Length in bytes of the longest frame, without frame check sequence.
pub const MAX_FRAME_LEN: usize = HEADER_LEN + 2 * INTERVAL_LEN;

/// An encoded frame, without frame check sequence.
pub type FrameBuffer = heapless::Vec<u8, MAX_FRAME_LEN>;

/// One frame of an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frame {
    /// Counts the sender's frames.
    pub sequence: u8,
    /// Network.
    pub pan: PanId,
    /// Whom it is for.
    pub destination: Address,
    /// Whom it is from.
    pub source: Address,
    /// Number of the exchange, chosen by the initiator, wrapping.
    pub exchange: u8,
    /// What it says.
    pub message: Message,
}

/// What a frame says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Message {
    /// The initiator asks for a range.
    Poll,
    /// The responder answers.
    Response,
    /// The initiator's half of the measurement.
    Final {
        /// Ra, from poll sent to response received.
        round: Ticks,
        /// Da, from response received to this frame sent.
        reply: Ticks,
    },
    /// The responder's half of the measurement.
    Report {
        /// Rb, from response sent to final received.
        round: Ticks,
        /// Db, from poll received to response sent.
        reply: Ticks,
    },
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
}

impl Message {
    const POLL: u8 = 1;
    const RESPONSE: u8 = 2;
    const FINAL: u8 = 3;
    const REPORT: u8 = 4;
}

impl Frame {
    /// The frame's bytes, without frame check sequence.
    pub fn encode(&self) -> FrameBuffer {
        let [control_0, control_1] = FRAME_CONTROL.to_le_bytes();
        let [pan_0, pan_1] = self.pan.0.to_le_bytes();
        let [destination_0, destination_1] = self.destination.0.to_le_bytes();
        let [source_0, source_1] = self.source.0.to_le_bytes();
        let (code, intervals) = match self.message {
            Message::Poll => (Message::POLL, None),
            Message::Response => (Message::RESPONSE, None),
            Message::Final { round, reply } => (Message::FINAL, Some((round, reply))),
            Message::Report { round, reply } => (Message::REPORT, Some((round, reply))),
        };
        let mut bytes = FrameBuffer::from_array([
            control_0,
            control_1,
            self.sequence,
            pan_0,
            pan_1,
            destination_0,
            destination_1,
            source_0,
            source_1,
            PROTOCOL,
            code,
            self.exchange,
        ]);
        if let Some((round, reply)) = intervals {
            for interval in [round, reply] {
                for byte in interval.get().to_le_bytes().into_iter().take(INTERVAL_LEN) {
                    // The buffer has room for the longest frame by definition.
                    let _ = bytes.push(byte);
                }
            }
        }
        bytes
    }

    /// Reads a frame from received bytes, without frame check sequence.
    ///
    /// # Errors
    /// [`FrameError`] names the first thing that is not ours.
    pub fn parse(bytes: &[u8]) -> Result<Self, FrameError> {
        let (header, body) = bytes
            .split_first_chunk::<HEADER_LEN>()
            .ok_or(FrameError::Length)?;
        let &[
            control_0,
            control_1,
            sequence,
            pan_0,
            pan_1,
            destination_0,
            destination_1,
            source_0,
            source_1,
            protocol,
            code,
            exchange,
        ] = header;
        if u16::from_le_bytes([control_0, control_1]) != FRAME_CONTROL {
            return Err(FrameError::FrameControl);
        }
        if protocol != PROTOCOL {
            return Err(FrameError::Protocol);
        }
        let message = match code {
            Message::POLL | Message::RESPONSE if !body.is_empty() => {
                return Err(FrameError::Length);
            }
            Message::POLL => Message::Poll,
            Message::RESPONSE => Message::Response,
            Message::FINAL => {
                let (round, reply) = intervals(body)?;
                Message::Final { round, reply }
            }
            Message::REPORT => {
                let (round, reply) = intervals(body)?;
                Message::Report { round, reply }
            }
            _ => return Err(FrameError::Message),
        };
        Ok(Self {
            sequence,
            pan: PanId(u16::from_le_bytes([pan_0, pan_1])),
            destination: Address(u16::from_le_bytes([destination_0, destination_1])),
            source: Address(u16::from_le_bytes([source_0, source_1])),
            exchange,
            message,
        })
    }
}

fn intervals(body: &[u8]) -> Result<(Ticks, Ticks), FrameError> {
    let body: &[u8; 2 * INTERVAL_LEN] = body.try_into().map_err(|_| FrameError::Length)?;
    let &[a, b, c, d, e, rest @ ..] = body;
    let ticks = |b: [u8; INTERVAL_LEN]| {
        let [b0, b1, b2, b3, b4] = b;
        Ticks::new(u64::from_le_bytes([b0, b1, b2, b3, b4, 0, 0, 0]) % MODULUS)
    };
    Ok((ticks([a, b, c, d, e]), ticks(rest)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn any_message() -> impl Strategy<Value = Message> {
        let ticks = || (0..MODULUS).prop_map(Ticks::new);
        prop_oneof![
            Just(Message::Poll),
            Just(Message::Response),
            (ticks(), ticks()).prop_map(|(round, reply)| Message::Final { round, reply }),
            (ticks(), ticks()).prop_map(|(round, reply)| Message::Report { round, reply }),
        ]
    }

    #[test]
    fn a_poll_is_these_twelve_bytes() {
        let poll = Frame {
            sequence: 7,
            pan: PanId(0xDECA),
            destination: Address(0x0102),
            source: Address(0x0A0B),
            exchange: 9,
            message: Message::Poll,
        };
        assert_eq!(
            poll.encode(),
            [
                0x41, 0x88, 7, 0xCA, 0xDE, 0x02, 0x01, 0x0B, 0x0A, 0xD5, 1, 9
            ]
        );
    }

    proptest! {
        #[test]
        fn every_frame_survives_the_air(
            sequence: u8, pan: u16, destination: u16, source: u16, exchange: u8,
            message in any_message(),
        ) {
            let frame = Frame {
                sequence, pan: PanId(pan), destination: Address(destination),
                source: Address(source), exchange, message,
            };
            prop_assert_eq!(Frame::parse(&frame.encode()), Ok(frame));
        }

        #[test]
        fn any_bytes_parse_to_themselves_or_an_error(bytes: Vec<u8>) {
            if let Ok(frame) = Frame::parse(&bytes) {
                prop_assert_eq!(&frame.encode()[..], &bytes[..]);
            }
        }

        #[test]
        fn a_cut_or_stretched_frame_is_refused(message in any_message(), cut in 0..MAX_FRAME_LEN) {
            let frame = Frame {
                sequence: 0, pan: PanId(1), destination: Address(2), source: Address(3),
                exchange: 4, message,
            };
            let mut bytes = frame.encode().to_vec();
            bytes.push(0);
            prop_assert!(Frame::parse(&bytes).is_err());
            bytes.truncate(cut.min(bytes.len() - 2));
            prop_assert!(Frame::parse(&bytes).is_err());
        }
    }
}
