//! The processor's flash as the board's code sees it: it takes time, and the processor stands still meanwhile.

use embedded_storage::nor_flash::{ErrorType, MultiwriteNorFlash, NorFlash, ReadNorFlash};

use super::core::Port;
use crate::flash::{ERASE_US, Flash, FlashError, PAGE_BYTES, WORD_BYTES, WRITE_US};
use crate::time::SimDuration;

/// The flash that a board's code may write to. Other handles than those of the running board find no power.
#[derive(Clone)]
pub struct BoardFlash(Port);

impl BoardFlash {
    pub(super) fn new(port: Port) -> Self {
        Self(port)
    }

    fn flash(&self) -> Result<Flash, FlashError> {
        self.0
            .with_board(|board, _| board.flash.clone())
            .ok_or(FlashError::PowerLost)
    }

    /// Whether power was lost in the middle of an operation: the board's code is to start anew.
    pub fn is_without_power(&self) -> bool {
        self.flash().is_ok_and(|flash| flash.is_without_power())
    }

    /// Power comes back, for code that plays a board's restart by itself.
    pub fn restore_power(&self) {
        if let Ok(flash) = self.flash() {
            flash.restore_power();
        }
    }
}

impl ErrorType for BoardFlash {
    type Error = FlashError;
}

impl ReadNorFlash for BoardFlash {
    const READ_SIZE: usize = Flash::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        self.flash()?.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.flash().map_or(0, |flash| flash.capacity())
    }
}

impl NorFlash for BoardFlash {
    const WRITE_SIZE: usize = Flash::WRITE_SIZE;
    const ERASE_SIZE: usize = Flash::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let mut flash = self.flash()?;
        let pages = u64::from(to.saturating_sub(from)) / PAGE_BYTES as u64;
        self.0.pass(SimDuration::from_us(pages * ERASE_US));
        flash.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let mut flash = self.flash()?;
        let words = bytes.len().div_ceil(WORD_BYTES) as u64;
        self.0.pass(SimDuration::from_us(words * WRITE_US));
        flash.write(offset, bytes)
    }
}

impl MultiwriteNorFlash for BoardFlash {}
