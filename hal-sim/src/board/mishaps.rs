//! What goes wrong on a board, at random.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::time::{SimDuration, SimTime};

/// How often what goes wrong. The default is never.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mishaps {
    /// Probability of each bit on the SPI, in either direction, to arrive wrong.
    pub spi_bit_error: f64,
    /// Probability of each interrupt to be served late.
    pub late_interrupt: f64,
    /// By how much at most.
    pub late_by: SimDuration,
    /// Times a second, on average, that the DW1000 loses its supply for a moment and starts anew.
    pub brown_outs_per_s: f64,
    /// Times a second, on average, that the DW1000's receiver goes deaf until the chip is reset.
    pub stuck_receivers_per_s: f64,
}

/// What went wrong, by count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MishapStats {
    /// Bits that arrived wrong.
    pub spi_bits: u64,
    /// Interrupts served late.
    pub late_interrupts: u64,
    /// Times the DW1000 started anew.
    pub brown_outs: u64,
    /// Times its receiver went deaf.
    pub stuck_receivers: u64,
}

/// What befalls the DW1000.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Befalls {
    BrownOut,
    StuckReceiver,
}

/// One board's bad luck.
#[derive(Debug)]
pub(super) struct Luck {
    config: Mishaps,
    rng: ChaCha8Rng,
    /// Until when the DW1000's luck has been decided.
    until: SimTime,
    pub(super) stats: MishapStats,
}

/// Streams of random numbers for mishaps begin here; those of chips begin at 0.
const FIRST_STREAM: u64 = 1 << 32;

impl Luck {
    pub(super) fn new(config: Mishaps, seed: u64, board: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(FIRST_STREAM + board);
        Luck {
            config,
            rng,
            until: SimTime::ZERO,
            stats: MishapStats::default(),
        }
    }

    /// Nothing goes wrong from now on.
    pub(super) fn end(&mut self) {
        self.config = Mishaps::default();
    }

    fn strikes(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.rng.random::<f64>() < probability
    }

    /// Damages bytes on their way over the SPI.
    pub(super) fn damage(&mut self, bytes: &mut [u8]) {
        let p = self.config.spi_bit_error;
        // One draw a transfer: two wrong bits in one are as rare as they sound.
        if self.strikes(p * 8.0 * bytes.len() as f64) {
            let bit = self.rng.random_range(0..8 * bytes.len());
            if let Some(byte) = bytes.get_mut(bit / 8) {
                *byte ^= 1 << (bit % 8);
                self.stats.spi_bits += 1;
            }
        }
    }

    /// How much later than usual an interrupt is served.
    pub(super) fn lateness(&mut self) -> SimDuration {
        if !self.strikes(self.config.late_interrupt) {
            return SimDuration::ZERO;
        }
        self.stats.late_interrupts += 1;
        SimDuration::from_s_f64(self.config.late_by.as_s_f64() * self.rng.random::<f64>())
    }

    /// What has befallen the DW1000 since the last call.
    pub(super) fn befalls(&mut self, now: SimTime) -> Option<Befalls> {
        let Mishaps {
            brown_outs_per_s,
            stuck_receivers_per_s,
            ..
        } = self.config;
        if brown_outs_per_s <= 0.0 && stuck_receivers_per_s <= 0.0 {
            return None;
        }
        let span_s = now.since(self.until).as_s_f64();
        self.until = now;
        if self.strikes(brown_outs_per_s * span_s) {
            self.stats.brown_outs += 1;
            return Some(Befalls::BrownOut);
        }
        if self.strikes(stuck_receivers_per_s * span_s) {
            self.stats.stuck_receivers += 1;
            return Some(Befalls::StuckReceiver);
        }
        None
    }
}
