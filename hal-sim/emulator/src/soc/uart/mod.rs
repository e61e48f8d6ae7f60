//! The serial port: UARTE with EasyDMA (product specification, chapter 35) and the older UART, byte by byte
//! (chapter 57). One place, chosen by ENABLE. 8 data bits, a start and a stop bit; parity and flow control cost and
//! do nothing.

mod registers;

use std::collections::VecDeque;

use super::block::Block;
use super::received::Received;
use super::{CPU_HZ, Cycles, Lines, Outward, Peripheral};
use crate::error::Refusal;
use registers::*;

/// Its number.
pub(super) const ID: u8 = 2;

const LEGACY: u32 = 4;
const EASY_DMA: u32 = 8;

const BITS_PER_BYTE: u64 = 10;

/// Bytes that the receiver holds while nobody takes them.
const FIFO_BYTES: usize = 6;

const OVERRUN: u32 = 1;

/// A buffer in RAM that is being filled.
struct Filling {
    to: u32,
    capacity: u32,
    count: u32,
}

/// Bytes that leave.
struct Sending {
    bytes: Vec<u8>,
    next: usize,
    /// The byte under way ends then.
    ends: Cycles,
}

/// UART0 and UARTE0.
pub(crate) struct Uart {
    block: Block,
    sending: Option<Sending>,
    /// The older UART sends from STARTTX to STOPTX, receives from STARTRX to STOPRX.
    may_send: bool,
    may_receive: bool,
    filling: Option<Filling>,
    received: Received,
    /// STOPRX was triggered: RXTO comes then.
    stops: Option<Cycles>,
    /// What the host says: when each byte is complete, in order.
    arriving: VecDeque<(Cycles, u8)>,
}

impl Uart {
    pub(super) fn new() -> Self {
        Uart {
            block: Block::new(ID, &LAYOUT),
            sending: None,
            may_send: false,
            may_receive: false,
            filling: None,
            received: Received::new(FIFO_BYTES, RXDRDY),
            stops: None,
            arriving: VecDeque::new(),
        }
    }

    /// The host does not notice a reset.
    pub(super) fn inherit(&mut self, old: Self) {
        self.arriving = old.arriving;
    }

    /// The host says `bytes` from `now` on, at the rate that is set.
    pub(super) fn hear(&mut self, bytes: &[u8], now: Cycles) {
        let mut at = self.arriving.back().map_or(now, |&(at, _)| at.max(now));
        for &byte in bytes {
            at += self.byte_time();
            self.arriving.push_back((at, byte));
        }
    }

    /// Whether everything that the host has said has arrived.
    pub(crate) fn has_heard_all(&self) -> bool {
        self.arriving.is_empty()
    }

    fn byte_time(&self) -> Cycles {
        // As for SPI: a fraction of 16 MHz (35.9.36).
        let baud = (u64::from(self.block.get(BAUDRATE)) * 16_000_000) >> 32;
        BITS_PER_BYTE * CPU_HZ / baud.max(1_200)
    }

    fn is(&self, mode: u32) -> bool {
        self.block.get(ENABLE) == mode
    }

    fn start_sending(&mut self, bytes: Vec<u8>, lines: &mut Lines<'_>) {
        self.sending = Some(Sending {
            bytes,
            next: 0,
            ends: lines.now + self.byte_time(),
        });
    }

    fn byte_has_left(&mut self, lines: &mut Lines<'_>) {
        let byte_time = self.byte_time();
        let Some(sending) = &mut self.sending else {
            return;
        };
        if let Some(&byte) = sending.bytes.get(sending.next) {
            lines.tell(Outward::Byte(byte));
        }
        sending.next += 1;
        sending.ends = lines.now + byte_time;
        let count = sending.next;
        let finished = count >= sending.bytes.len();
        if finished {
            self.sending = None;
        }
        lines.raise(&mut self.block, TXDRDY);
        if finished && self.is(EASY_DMA) {
            self.block.set(TXD_AMOUNT, count as u32);
            lines.raise(&mut self.block, ENDTX);
        }
    }

    fn start_receiving(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        self.may_receive = true;
        if !self.is(EASY_DMA) {
            return Ok(());
        }
        self.filling = Some(Filling {
            to: self.block.get(RXD_PTR),
            capacity: self.block.get(RXD_MAXCNT),
            count: 0,
        });
        lines.raise(&mut self.block, RXSTARTED);
        self.fill(lines)
    }

    /// Bytes that wait go into the buffer.
    fn fill(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        while let Some(filling) = &mut self.filling {
            if filling.count < filling.capacity {
                let Some(byte) = self.received.take() else {
                    return Ok(());
                };
                lines.dma_write(filling.to.wrapping_add(filling.count), &[byte])?;
                filling.count += 1;
            }
            if filling.count >= filling.capacity {
                self.end_receiving(lines)?;
            }
        }
        Ok(())
    }

    /// The buffer is full, or nothing more is to come into it.
    fn end_receiving(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let Some(filling) = self.filling.take() else {
            return Ok(());
        };
        self.block.set(RXD_AMOUNT, filling.count);
        lines.raise(&mut self.block, ENDRX);
        if self.block.shorts & ENDRX_STOPRX != 0 {
            self.stop_receiving(lines);
        }
        if self.block.shorts & ENDRX_STARTRX != 0 && self.stops.is_none() {
            let capacity = self.block.get(RXD_MAXCNT);
            if capacity == 0 {
                return Err(Refusal::misuse(
                    "ENDRX starts a reception of no bytes, for ever",
                ));
            }
            self.start_receiving(lines)?;
        }
        Ok(())
    }

    fn stop_receiving(&mut self, lines: &mut Lines<'_>) {
        // Up to four bytes may still come in before RXTO (35.5).
        self.stops = Some(lines.now + 4 * self.byte_time());
    }

    /// A byte is complete.
    pub(super) fn receive(&mut self, byte: u8, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        if !self.may_receive || !(self.is(EASY_DMA) || self.is(LEGACY)) {
            return Ok(());
        }
        let Some(is_shown) = self.received.push(byte) else {
            let source = self.block.get(ERRORSRC) | OVERRUN;
            self.block.set(ERRORSRC, source);
            lines.raise(&mut self.block, ERROR);
            return Ok(());
        };
        // With EasyDMA the event comes with every byte.
        if is_shown || self.is(EASY_DMA) {
            lines.raise(&mut self.block, RXDRDY);
        }
        if self.is(EASY_DMA) {
            self.fill(lines)
        } else {
            Ok(())
        }
    }
}

impl Peripheral for Uart {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        match task {
            STARTTX if self.is(EASY_DMA) => {
                let (from, count) = (self.block.get(TXD_PTR), self.block.get(TXD_MAXCNT));
                let bytes = lines.dma_read(from, count)?;
                lines.raise(&mut self.block, TXSTARTED);
                if bytes.is_empty() {
                    self.block.set(TXD_AMOUNT, 0);
                    lines.raise(&mut self.block, ENDTX);
                } else {
                    self.start_sending(bytes, lines);
                }
            }
            STARTTX => self.may_send = true,
            STOPTX => {
                self.may_send = false;
                if let Some(sending) = self.sending.take()
                    && self.is(EASY_DMA)
                {
                    self.block.set(TXD_AMOUNT, sending.next as u32);
                    lines.raise(&mut self.block, ENDTX);
                }
                lines.raise(&mut self.block, TXSTOPPED);
            }
            STARTRX => self.start_receiving(lines)?,
            STOPRX => self.stop_receiving(lines),
            SUSPEND => {
                self.may_send = false;
                self.may_receive = false;
            }
            // The bytes that came in after the buffer was closed go into the next one.
            FLUSHRX => {
                self.start_receiving(lines)?;
                self.end_receiving(lines)?;
            }
            _ => {}
        }
        Ok(())
    }

    fn read(&mut self, offset: u16, lines: &mut Lines<'_>) -> Option<u32> {
        (offset == RXD).then(|| self.received.read(&mut self.block, lines))
    }

    fn written(&mut self, offset: u16, value: u32, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        match offset {
            ENABLE if !matches!(value, 0 | LEGACY | EASY_DMA) => Err(Refusal::misuse(format!(
                "ENABLE {value}: UART is 4, UARTE 8"
            ))),
            ENABLE if value == 0 => {
                (self.sending, self.filling, self.stops) = (None, None, None);
                (self.may_send, self.may_receive) = (false, false);
                self.received.clear();
                Ok(())
            }
            TXD if self.is(LEGACY) && self.may_send => {
                match &mut self.sending {
                    Some(sending) => sending.bytes.push(value as u8),
                    None => self.start_sending(vec![value as u8], lines),
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn due(&self) -> Option<Cycles> {
        let sent = self.sending.as_ref().map(|sending| sending.ends);
        let arrives = self.arriving.front().map(|&(at, _)| at);
        [sent, arrives, self.stops].into_iter().flatten().min()
    }

    fn advance(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        if self.sending.as_ref().is_some_and(|s| s.ends <= lines.now) {
            self.byte_has_left(lines);
            return Ok(());
        }
        if let Some(&(at, byte)) = self.arriving.front()
            && at <= lines.now
        {
            self.arriving.pop_front();
            return self.receive(byte, lines);
        }
        if self.stops.is_some_and(|at| at <= lines.now) {
            self.end_receiving(lines)?;
            self.stops = None;
            self.may_receive = false;
            lines.raise(&mut self.block, RXTO);
        }
        Ok(())
    }
}
