//! The flash of an nRF52832, and what losing power in the middle of an operation leaves behind.
//!
//! Pages of 4096 bytes; an erase sets all bits of a page; a write takes whole words and can only clear bits. Between
//! two erases at most 181 words may be written in each block of 512 bytes (product specification 11, nWRITE_BLOCK),
//! and each page takes 10 000 erases. What the hardware lets pass with damage later is an error here at once.
//!
//! A [`Flash`] is a handle: clones stand for the same flash, so that a test can hold on to it while boards come and go.
//!
//! Not modelled: bits between 0 and 1 that read differently every time, and the loss of charge over the years.

use std::sync::{Arc, Mutex, PoisonError};

use embedded_storage::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use thiserror::Error;

/// Bytes that are erased together.
pub const PAGE_BYTES: usize = 4096;

/// Bytes that are written together.
pub const WORD_BYTES: usize = 4;

/// Bytes over which writes are limited.
const BLOCK_BYTES: usize = 512;

/// Writes of a word that a block takes between two erases.
const WRITES_PER_BLOCK: u32 = 181;

/// Erases that a page takes.
pub const ENDURANCE: u32 = 10_000;

/// The processor stands still for this long while a page is erased, at most.
pub const ERASE_US: u64 = 89_700;

/// The same for a word, at most.
pub const WRITE_US: u64 = 338;

/// Why the flash did not do as told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum FlashError {
    /// Not whole words, or not whole pages.
    #[error("the place or the length is no multiple of a word or page")]
    NotAligned,
    /// Beyond the end.
    #[error("the flash is not that long")]
    OutOfBounds,
    /// A bit that is 0 was to become 1 without an erase.
    #[error("a word was written that had not been erased")]
    NotErased,
    /// More writes between two erases than a block takes.
    #[error("a block was written too often since it was erased")]
    TooManyWrites,
    /// More erases than a page takes.
    #[error("a page is worn out")]
    WornOut,
    /// Power was lost in the middle of this operation, or before it.
    #[error("the power is gone")]
    PowerLost,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NotAligned => NorFlashErrorKind::NotAligned,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            _ => NorFlashErrorKind::Other,
        }
    }
}

/// When power is lost, and what is left of the operation that it is lost in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PowerCut {
    /// After so many operations (page erases and word writes) from now on.
    pub after: u64,
    /// How the operation after those ends.
    pub torn: Torn,
}

/// What is left of an operation that power is lost in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Torn {
    /// It has not begun.
    Untouched,
    /// Some of the bits that were to change have changed, drawn by lot from this seed.
    Some(u64),
    /// It has been done, though nobody lives to know.
    Finished,
}

#[derive(Debug)]
struct State {
    bytes: Vec<u8>,
    /// Writes since the last erase, by block.
    writes: Vec<u32>,
    /// Erases, by page.
    erases: Vec<u32>,
    operations: u64,
    cut: Option<(u64, Torn)>,
    powered: bool,
}

/// Flash memory; see the [module](self).
#[derive(Clone, Debug)]
pub struct Flash(Arc<Mutex<State>>);

impl Flash {
    /// So many pages, erased and new.
    pub fn new(pages: usize) -> Self {
        let len = pages * PAGE_BYTES;
        Self(Arc::new(Mutex::new(State {
            bytes: vec![0xFF; len],
            writes: vec![0; len / BLOCK_BYTES],
            erases: vec![0; pages],
            operations: 0,
            cut: None,
            powered: true,
        })))
    }

    /// Another flash with the same contents, wear and plans.
    pub fn duplicate(&self) -> Self {
        self.with(|state| {
            Self(Arc::new(Mutex::new(State {
                bytes: state.bytes.clone(),
                writes: state.writes.clone(),
                erases: state.erases.clone(),
                ..*state
            })))
        })
    }

    /// Lets power be lost. Everything fails from then on, until [`Flash::restore_power`].
    pub fn cut_power(&self, cut: PowerCut) {
        self.with(|state| state.cut = Some((state.operations.saturating_add(cut.after), cut.torn)));
    }

    /// Power is there, and no loss is planned.
    pub fn restore_power(&self) {
        self.with(|state| {
            state.powered = true;
            state.cut = None;
        });
    }

    /// Whether power is lost.
    pub fn is_without_power(&self) -> bool {
        self.with(|state| !state.powered)
    }

    /// Page erases and word writes so far, those cut short included.
    pub fn operations(&self) -> u64 {
        self.with(|state| state.operations)
    }

    /// How often each page has been erased.
    pub fn erases(&self) -> Vec<u32> {
        self.with(|state| state.erases.clone())
    }

    /// Flips bits, as age, radiation or a bug do; beyond the end nothing happens.
    pub fn damage(&self, offset: usize, bits: u8) {
        self.with(|state| {
            if let Some(byte) = state.bytes.get_mut(offset) {
                *byte ^= bits;
            }
        });
    }

    /// Puts bytes there without any rules, as a programmer does; beyond the end nothing happens.
    pub fn preload(&self, offset: usize, bytes: &[u8]) {
        self.with(|state| {
            let places = state.bytes.iter_mut().skip(offset);
            places.zip(bytes).for_each(|(place, &byte)| *place = byte);
        });
    }

    fn with<R>(&self, act: impl FnOnce(&mut State) -> R) -> R {
        // A panic elsewhere leaves whole operations behind.
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl State {
    /// Begins an operation. `Ok(Some(torn))`: power is lost in it.
    fn begin(&mut self) -> Result<Option<Torn>, FlashError> {
        if !self.powered {
            return Err(FlashError::PowerLost);
        }
        let lost = match self.cut {
            Some((at, torn)) if self.operations >= at => Some(torn),
            _ => None,
        };
        match lost {
            None => {
                self.operations += 1;
                Ok(None)
            }
            Some(Torn::Untouched) => {
                self.powered = false;
                Err(FlashError::PowerLost)
            }
            Some(torn) => {
                self.operations += 1;
                self.powered = false;
                Ok(Some(torn))
            }
        }
    }

    fn erase_page(&mut self, page: usize) -> Result<(), FlashError> {
        let torn = self.begin()?;
        let erases = self.erases.get_mut(page).ok_or(FlashError::OutOfBounds)?;
        *erases += 1;
        if *erases > ENDURANCE {
            return Err(FlashError::WornOut);
        }
        let start = page * PAGE_BYTES;
        let bytes = self.bytes.get_mut(start..start + PAGE_BYTES);
        let bytes = bytes.ok_or(FlashError::OutOfBounds)?;
        if let Some(Torn::Some(seed)) = torn {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            bytes
                .iter_mut()
                .for_each(|byte| *byte |= rng.random::<u8>());
            return Err(FlashError::PowerLost);
        }
        bytes.fill(0xFF);
        let blocks = PAGE_BYTES / BLOCK_BYTES;
        let writes = self.writes.iter_mut().skip(page * blocks).take(blocks);
        writes.for_each(|count| *count = 0);
        torn.map_or(Ok(()), |_| Err(FlashError::PowerLost))
    }

    fn write_word(&mut self, offset: usize, word: &[u8]) -> Result<(), FlashError> {
        let torn = self.begin()?;
        let writes = self.writes.get_mut(offset / BLOCK_BYTES);
        let writes = writes.ok_or(FlashError::OutOfBounds)?;
        *writes += 1;
        if *writes > WRITES_PER_BLOCK {
            return Err(FlashError::TooManyWrites);
        }
        let place = self.bytes.get_mut(offset..offset + WORD_BYTES);
        let place = place.ok_or(FlashError::OutOfBounds)?;
        if place.iter().zip(word).any(|(&old, &new)| old & new != new) {
            return Err(FlashError::NotErased);
        }
        if let Some(Torn::Some(seed)) = torn {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            for (place, &new) in place.iter_mut().zip(word) {
                *place &= new | rng.random::<u8>();
            }
            return Err(FlashError::PowerLost);
        }
        place.copy_from_slice(word);
        torn.map_or(Ok(()), |_| Err(FlashError::PowerLost))
    }
}

impl ErrorType for Flash {
    type Error = FlashError;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        self.with(|state| {
            if !state.powered {
                return Err(FlashError::PowerLost);
            }
            let start = offset as usize;
            let from = state.bytes.get(start..start.saturating_add(bytes.len()));
            bytes.copy_from_slice(from.ok_or(FlashError::OutOfBounds)?);
            Ok(())
        })
    }

    fn capacity(&self) -> usize {
        self.with(|state| state.bytes.len())
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = PAGE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let (from, to) = (from as usize, to as usize);
        if !from.is_multiple_of(PAGE_BYTES) || !to.is_multiple_of(PAGE_BYTES) {
            return Err(FlashError::NotAligned);
        }
        if from > to {
            return Err(FlashError::OutOfBounds);
        }
        self.with(|state| {
            (from / PAGE_BYTES..to / PAGE_BYTES).try_for_each(|page| state.erase_page(page))
        })
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let start = offset as usize;
        if !start.is_multiple_of(WORD_BYTES) || !bytes.len().is_multiple_of(WORD_BYTES) {
            return Err(FlashError::NotAligned);
        }
        self.with(|state| {
            let offsets = (start..).step_by(WORD_BYTES);
            let mut words = offsets.zip(bytes.chunks_exact(WORD_BYTES));
            words.try_for_each(|(at, word)| state.write_word(at, word))
        })
    }
}

/// Within the writes that a block takes, a word may be written again to clear more of its bits.
impl MultiwriteNorFlash for Flash {}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(flash: &mut Flash, offset: u32) -> [u8; 4] {
        let mut word = [0; 4];
        flash.read(offset, &mut word).unwrap();
        word
    }

    #[test]
    fn a_write_only_clears_bits_and_an_erase_sets_those_of_its_page() {
        let mut flash = Flash::new(2);
        flash.write(4096, &[0xF0; 4]).unwrap();
        flash.write(4096, &[0x30; 4]).unwrap();
        assert_eq!(flash.write(4096, &[0xF0; 4]), Err(FlashError::NotErased));
        assert_eq!(read(&mut flash, 4096), [0x30; 4]);
        flash.write(8, &[1; 4]).unwrap();
        flash.erase(4096, 8192).unwrap();
        assert_eq!(read(&mut flash, 4096), [0xFF; 4]);
        assert_eq!(read(&mut flash, 8), [1; 4]);
        assert_eq!(flash.erases(), [0, 1]);
    }

    #[test]
    fn what_is_not_whole_or_too_far_is_refused() {
        let mut flash = Flash::new(2);
        assert_eq!(flash.write(2, &[0; 4]), Err(FlashError::NotAligned));
        assert_eq!(flash.write(0, &[0; 3]), Err(FlashError::NotAligned));
        assert_eq!(flash.erase(0, 100), Err(FlashError::NotAligned));
        assert_eq!(flash.erase(4096, 3 * 4096), Err(FlashError::OutOfBounds));
        assert_eq!(flash.write(8192, &[0; 4]), Err(FlashError::OutOfBounds));
        assert_eq!(flash.read(8190, &mut [0; 4]), Err(FlashError::OutOfBounds));
    }

    #[test]
    fn a_block_takes_181_writes_and_a_page_10_000_erases() {
        let mut flash = Flash::new(1);
        for _ in 0..181 {
            flash.write(512, &[0xFF; 4]).unwrap();
        }
        assert_eq!(flash.write(516, &[0xFF; 4]), Err(FlashError::TooManyWrites));
        flash.write(1024, &[0; 4]).unwrap();
        for _ in 0..10_000 {
            flash.erase(0, 4096).unwrap();
        }
        assert_eq!(flash.erase(0, 4096), Err(FlashError::WornOut));
    }

    #[test]
    fn a_torn_write_leaves_bits_between_old_and_new_and_nothing_works_after() {
        for seed in 0..50 {
            let mut flash = Flash::new(1);
            flash.write(0, &[0xF0; 4]).unwrap();
            let torn = Torn::Some(seed);
            flash.cut_power(PowerCut { after: 1, torn });
            flash.write(4, &[0x0F; 4]).unwrap();
            assert_eq!(flash.write(0, &[0x30; 4]), Err(FlashError::PowerLost));
            assert_eq!(flash.read(0, &mut [0; 4]), Err(FlashError::PowerLost));
            assert!(flash.is_without_power());
            flash.restore_power();
            assert_eq!(read(&mut flash, 4), [0x0F; 4]);
            for byte in read(&mut flash, 0) {
                assert_eq!(byte & 0x3F, 0x30, "bits that were not to change");
            }
        }
    }

    #[test]
    fn a_cut_before_an_operation_leaves_it_undone() {
        let mut flash = Flash::new(1);
        flash.cut_power(PowerCut {
            after: 2,
            torn: Torn::Untouched,
        });
        assert_eq!(flash.write(0, &[0; 16]), Err(FlashError::PowerLost));
        flash.restore_power();
        let mut bytes = [0; 16];
        flash.read(0, &mut bytes).unwrap();
        assert_eq!(
            bytes,
            [
                0, 0, 0, 0, 0, 0, 0, 0, 255, 255, 255, 255, 255, 255, 255, 255
            ]
        );
        assert_eq!(flash.operations(), 2);
    }
}
