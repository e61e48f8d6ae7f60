//! SPI masters: SPIM with EasyDMA (product specification, chapter 31) and the older SPI, byte by byte (chapter 58).
//! One place, chosen by ENABLE.
//!
//! The radio hangs on the pins of [`wiring`]; a master on other pins clocks into the void.

use super::block::{Block, Layout, ro, rw};
use super::received::Received;
use super::{CPU_HZ, Cycles, Lines, Outward, Peripheral};
use crate::error::Refusal;
use crate::wiring;

const START: u16 = 0x010;
const STOP: u16 = 0x014;
const STOPPED: u16 = 0x104;
const READY: u16 = 0x108;
const ENDRX: u16 = 0x110;
const END: u16 = 0x118;
const ENDTX: u16 = 0x120;
const STARTED: u16 = 0x14C;
const ENABLE: u16 = 0x500;
const PSEL_SCK: u16 = 0x508;
const PSEL_MOSI: u16 = 0x50C;
const PSEL_MISO: u16 = 0x510;
const RXD: u16 = 0x518;
const TXD: u16 = 0x51C;
const FREQUENCY: u16 = 0x524;
const RXD_PTR: u16 = 0x534;
const RXD_MAXCNT: u16 = 0x538;
const RXD_AMOUNT: u16 = 0x53C;
const TXD_PTR: u16 = 0x544;
const TXD_MAXCNT: u16 = 0x548;
const TXD_AMOUNT: u16 = 0x54C;
const ORC: u16 = 0x5C0;

const END_START: u32 = 1 << 17;

macro_rules! layout {
    ($name:literal) => {
        Layout {
            name: $name,
            // SUSPEND and RESUME are missing.
            tasks: &[START, STOP],
            events: &[STOPPED, READY, ENDRX, END, ENDTX, STARTED],
            shorts: END_START,
            interrupts: true,
            registers: &[
                rw(ENABLE, 0xF),
                rw(PSEL_SCK, !0).reset(!0),
                rw(PSEL_MOSI, !0).reset(!0),
                rw(PSEL_MISO, !0).reset(!0),
                ro(RXD, 0),
                rw(TXD, 0xFF),
                rw(FREQUENCY, !0).reset(0x0400_0000),
                rw(RXD_PTR, !0),
                rw(RXD_MAXCNT, 0xFF),
                ro(RXD_AMOUNT, 0),
                rw(0x540, 0x3),
                rw(TXD_PTR, !0),
                rw(TXD_MAXCNT, 0xFF),
                ro(TXD_AMOUNT, 0),
                rw(0x550, 0x3),
                rw(0x554, 0x7),
                rw(ORC, 0xFF),
            ],
        }
    };
}

const SPI0: Layout = layout!("SPI0/SPIM0");
const SPI1: Layout = layout!("SPI1/SPIM1");
const SPI2: Layout = layout!("SPI2/SPIM2");

const DISABLED: u32 = 0;
const LEGACY: u32 = 1;
const EASY_DMA: u32 = 7;

/// The numbers of all.
pub(super) const ALL: [u8; 3] = [3, 4, 35];

/// From START to the first bit, and from the last bit to END: EasyDMA and the state machine. Assumed; the product
/// specification names no figure.
const DMA_OVERHEAD: Cycles = CPU_HZ / 2_000_000;

/// A transfer by EasyDMA.
struct Transfer {
    ends: Cycles,
    receive_to: u32,
    receive: usize,
    sent: u32,
}

/// One SPI master.
pub(super) struct Spi {
    block: Block,
    transfer: Option<Transfer>,
    /// What came in; `None` until the radio has answered.
    answer: Option<Vec<u8>>,
    /// The older SPI: the byte being clocked ends then.
    byte_ends: Option<Cycles>,
    /// The byte behind it.
    next: Option<u8>,
    /// Bytes that came in and were not read: RXD and one behind it.
    received: Received,
}

impl Spi {
    pub(super) fn new(id: u8) -> Self {
        let layout = match id {
            3 => &SPI0,
            4 => &SPI1,
            _ => &SPI2,
        };
        Spi {
            block: Block::new(id, layout),
            transfer: None,
            answer: None,
            byte_ends: None,
            next: None,
            received: Received::new(2, READY),
        }
    }

    /// What the radio clocked out.
    pub(super) fn answer(&mut self, miso: Vec<u8>) {
        self.answer = Some(miso);
    }

    /// The product specification's table of frequencies, 31.7.22, is this formula.
    fn bits_per_s(&self) -> Result<u32, Refusal> {
        let register = u64::from(self.block.get(FREQUENCY));
        let bits_per_s = (register * 16_000_000) >> 32;
        match bits_per_s {
            125_000..=8_000_000 => Ok(bits_per_s as u32),
            _ => Err(Refusal::misuse(format!(
                "FREQUENCY {register:#010x} is none of the listed ones"
            ))),
        }
    }

    fn is_wired_to_radio(&self) -> bool {
        let is_on = |offset, pin: u8| self.block.get(offset) == u32::from(pin);
        is_on(PSEL_SCK, wiring::RADIO_CLOCK)
            && is_on(PSEL_MOSI, wiring::RADIO_MOSI)
            && is_on(PSEL_MISO, wiring::RADIO_MISO)
    }

    /// Hands bytes to the radio, or answers for nobody: the line floats low.
    fn clock_out(&mut self, mosi: Vec<u8>, lines: &mut Lines<'_>) -> Result<Cycles, Refusal> {
        let bits_per_s = self.bits_per_s()?;
        let duration = (8 * mosi.len() as u64 * CPU_HZ).div_ceil(bits_per_s.into());
        if self.is_wired_to_radio() {
            self.answer = None;
            lines.tell(Outward::Transfer {
                id: self.block.id,
                mosi,
                bits_per_s,
            });
        } else {
            self.answer = Some(vec![0; mosi.len()]);
        }
        Ok(duration)
    }

    fn start(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        if self.block.get(ENABLE) != EASY_DMA {
            return Err(Refusal::misuse("START of a SPIM that is not enabled"));
        }
        if self.transfer.is_some() {
            return Err(Refusal::misuse("START while a transfer is under way"));
        }
        let (send, receive) = (self.block.get(TXD_MAXCNT), self.block.get(RXD_MAXCNT));
        let mut mosi = lines.dma_read(self.block.get(TXD_PTR), send)?;
        mosi.resize(send.max(receive) as usize, self.block.get(ORC) as u8);
        let duration = if mosi.is_empty() {
            0
        } else {
            self.clock_out(mosi, lines)? + DMA_OVERHEAD
        };
        self.transfer = Some(Transfer {
            ends: lines.now + duration,
            receive_to: self.block.get(RXD_PTR),
            receive: receive as usize,
            sent: send,
        });
        lines.raise(&mut self.block, STARTED);
        Ok(())
    }

    fn finish(&mut self, transfer: &Transfer, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let miso = self.answer.take().unwrap_or_default();
        let received = miso
            .get(..transfer.receive.min(miso.len()))
            .unwrap_or_default();
        lines.dma_write(transfer.receive_to, received)?;
        self.block.set(RXD_AMOUNT, received.len() as u32);
        self.block.set(TXD_AMOUNT, transfer.sent);
        for event in [ENDTX, ENDRX, END] {
            lines.raise(&mut self.block, event);
        }
        if self.block.shorts & END_START != 0 {
            self.start(lines)?;
        }
        Ok(())
    }

    fn send_byte(&mut self, byte: u8, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        let duration = self.clock_out(vec![byte], lines)?;
        self.byte_ends = Some(lines.now + duration);
        Ok(())
    }

    fn byte_has_ended(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        self.byte_ends = None;
        let byte = self.answer.take().unwrap_or_default();
        let byte = byte.first().copied().unwrap_or(0);
        match self.received.push(byte) {
            None => return Err(Refusal::misuse("RXD was not read before the third byte")),
            Some(true) => lines.raise(&mut self.block, READY),
            Some(false) => {}
        }
        match self.next.take() {
            Some(next) => self.send_byte(next, lines),
            None => Ok(()),
        }
    }
}

impl Peripheral for Spi {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        match task {
            START => self.start(lines),
            _ => {
                self.transfer = None;
                lines.raise(&mut self.block, STOPPED);
                Ok(())
            }
        }
    }

    fn read(&mut self, offset: u16, lines: &mut Lines<'_>) -> Option<u32> {
        (offset == RXD).then(|| self.received.read(&mut self.block, lines))
    }

    fn written(&mut self, offset: u16, value: u32, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        match offset {
            ENABLE => match value {
                DISABLED => {
                    (self.transfer, self.byte_ends, self.next) = (None, None, None);
                    self.received.clear();
                    Ok(())
                }
                LEGACY | EASY_DMA => Ok(()),
                _ => Err(Refusal::misuse(format!(
                    "ENABLE {value}: SPI (1) and SPIM (7) are modelled; TWI (5), TWIM (6), SPIS (2), TWIS (9) are not"
                ))),
            },
            TXD if self.block.get(ENABLE) == LEGACY => {
                if self.byte_ends.is_none() {
                    self.send_byte(value as u8, lines)
                } else if self.next.replace(value as u8).is_some() {
                    Err(Refusal::misuse(
                        "TXD holds one byte behind the one that is clocked",
                    ))
                } else {
                    Ok(())
                }
            }
            _ => Ok(()),
        }
    }

    fn due(&self) -> Option<Cycles> {
        self.byte_ends
            .or(self.transfer.as_ref().map(|transfer| transfer.ends))
    }

    fn advance(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        if self.byte_ends.is_some() {
            self.byte_has_ended(lines)
        } else if let Some(transfer) = self.transfer.take() {
            self.finish(&transfer, lines)
        } else {
            Ok(())
        }
    }
}
