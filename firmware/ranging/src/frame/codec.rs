//! From a frame to its bytes and back.

use super::{
    Address, Answered, Beacon, CHECK_LEN, FRAME_CONTROL, Final, Frame, FrameBuffer, FrameError,
    Grant, MAX_RESPONDERS, Message, PROTOCOL, PanId, Poll,
};
use crate::time::{MODULUS, Ticks};

/// Notices any three wrong bits in a frame of any length that the radio has. Polynomials that notice five in a short
/// frame do not: CRC-16/DNP lets pairs of wrong bits 151 bits apart pass.
pub(super) const CHECK: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

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
