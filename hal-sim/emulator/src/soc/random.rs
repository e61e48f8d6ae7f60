//! RNG (product specification, chapter 26). Its numbers follow from the board's seed.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::block::{Block, Layout, ro, rw};
use super::{CPU_HZ, Cycles, Lines, Peripheral};
use crate::error::Refusal;

const START: u16 = 0x000;
const STOP: u16 = 0x004;
const VALRDY: u16 = 0x100;
const CONFIG: u16 = 0x504;
const VALUE: u16 = 0x508;

const LAYOUT: Layout = Layout {
    name: "RNG",
    tasks: &[START, STOP],
    events: &[VALRDY],
    shorts: 1,
    interrupts: true,
    registers: &[rw(CONFIG, 1), ro(VALUE, 0)],
};

/// A number with and without bias correction (26.3: 120 us and 30 us).
const CORRECTED: Cycles = 120 * CPU_HZ / 1_000_000;
const UNCORRECTED: Cycles = 30 * CPU_HZ / 1_000_000;

/// RNG.
pub(super) struct Random {
    block: Block,
    rng: ChaCha8Rng,
    ready: Option<Cycles>,
}

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Random {
            block: Block::new(13, &LAYOUT),
            rng: ChaCha8Rng::seed_from_u64(seed),
            ready: None,
        }
    }

    /// Nature does not begin anew with a reset.
    pub(super) fn reset(&mut self) {
        self.block = Block::new(13, &LAYOUT);
        self.ready = None;
    }

    fn begin(&mut self, now: Cycles) {
        let corrected = self.block.get(CONFIG) == 1;
        self.ready = Some(now + if corrected { CORRECTED } else { UNCORRECTED });
    }
}

impl Peripheral for Random {
    fn block(&self) -> &Block {
        &self.block
    }

    fn block_mut(&mut self) -> &mut Block {
        &mut self.block
    }

    fn task(&mut self, task: u16, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        if task == START {
            self.begin(lines.now);
        } else {
            self.ready = None;
        }
        Ok(())
    }

    fn due(&self) -> Option<Cycles> {
        self.ready
    }

    fn advance(&mut self, lines: &mut Lines<'_>) -> Result<(), Refusal> {
        self.block.set(VALUE, u32::from(self.rng.random::<u8>()));
        self.begin(lines.now);
        if self.block.shorts & 1 == 1 {
            self.ready = None;
        }
        lines.raise(&mut self.block, VALRDY);
        Ok(())
    }
}
