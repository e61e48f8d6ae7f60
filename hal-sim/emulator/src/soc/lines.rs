//! Between peripherals and what is around them.

use super::block::Block;
use super::{Cycles, RAM_BYTES, RAM_START};
use crate::error::Refusal;

/// What the chip wants from the board around it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Outward {
    /// The radio's chip select went low (true) or high.
    Select(bool),
    /// The radio's reset line was pulled low (true) or released.
    RadioReset(bool),
    /// Bytes begin to be clocked to and from the radio by this peripheral.
    Transfer {
        /// Its number.
        id: u8,
        mosi: Vec<u8>,
        bits_per_s: u32,
    },
    /// The last bit of a byte left on the serial line.
    Byte(u8),
    /// The processor stands still for so many cycles.
    Stall(Cycles),
    /// The watchdog ran out.
    WatchdogReset,
    /// The supply broke down in the middle of a write to flash.
    PowerLost,
    /// The supply is switched off until a pin wakes the chip.
    SystemOff,
}

/// What a peripheral can reach beyond its own registers.
pub(crate) struct Lines<'a> {
    pub(crate) now: Cycles,
    pub(super) ram: &'a mut [u8],
    pub(super) raised: &'a mut Vec<(u8, u16)>,
    pub(super) outward: &'a mut Vec<Outward>,
}

impl Lines<'_> {
    /// An event happens.
    pub(crate) fn raise(&mut self, block: &mut Block, event: u16) {
        block.mark(event);
        self.raised.push((block.id, event));
    }

    /// Tells the board.
    pub(crate) fn tell(&mut self, what: Outward) {
        self.outward.push(what);
    }

    /// EasyDMA reads; RAM is all that it reaches (product specification, 15.1, "EasyDMA").
    pub(crate) fn dma_read(&self, from: u32, count: u32) -> Result<Vec<u8>, Refusal> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let place = dma_place(from, count)?;
        Ok(self.ram.get(place).unwrap_or_default().to_vec())
    }

    /// EasyDMA writes.
    pub(crate) fn dma_write(&mut self, to: u32, bytes: &[u8]) -> Result<(), Refusal> {
        if bytes.is_empty() {
            return Ok(());
        }
        let place = dma_place(to, bytes.len() as u32)?;
        if let Some(place) = self.ram.get_mut(place) {
            place.copy_from_slice(bytes);
        }
        Ok(())
    }
}

/// Where in RAM that is.
fn dma_place(address: u32, count: u32) -> Result<core::ops::Range<usize>, Refusal> {
    let outside = || {
        Refusal::misuse(format!(
            "EasyDMA of {count} bytes at {address:#010x}, which is not in RAM"
        ))
    };
    let offset = address.checked_sub(RAM_START).ok_or_else(outside)?;
    let end = offset.checked_add(count).ok_or_else(outside)?;
    if end > RAM_BYTES {
        return Err(outside());
    }
    Ok(offset as usize..end as usize)
}

/// One peripheral.
pub(crate) trait Peripheral {
    fn block(&self) -> &Block;
    fn block_mut(&mut self) -> &mut Block;

    /// A task was triggered, by the processor or through PPI.
    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal>;

    /// A register that is computed when read; `None` for those that [`Block`] holds.
    fn read(&mut self, _offset: u16, _lines: &mut Lines<'_>) -> Option<u32> {
        None
    }

    /// The processor has written one of the peripheral's own registers.
    fn written(
        &mut self,
        _offset: u16,
        _value: u32,
        _lines: &mut Lines<'_>,
    ) -> Result<(), Refusal> {
        Ok(())
    }

    /// When it will do something by itself.
    fn due(&self) -> Option<Cycles> {
        None
    }

    /// Does what is due now.
    fn advance(&mut self, _lines: &mut Lines<'_>) -> Result<(), Refusal> {
        Ok(())
    }
}
