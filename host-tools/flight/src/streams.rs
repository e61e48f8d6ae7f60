//! Chance, one stream for each thing it has a hand in: with one of them switched off the others
//! draw what they drew before.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// What a stream is for.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stream {
    /// Start and first guess.
    Guess = 0,
    /// Wind.
    Wind = 1,
    /// Accelerometer and attitude.
    Imu = 2,
    /// Barometer.
    Baro = 3,
    /// Ranges.
    Uwb = 4,
    /// How the sensor is mounted.
    Tilt = 5,
}

/// The generator of `stream` in the trial with this seed.
pub(crate) fn generator(seed: u64, stream: Stream) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream as u64);
    rng
}

/// Seed of trial number `trial` of a run (SplitMix64, Steele, Lea, Flood 2014): neighbours in either
/// argument have nothing in common.
pub fn trial_seed(base_seed: u64, trial: u64) -> u64 {
    scramble(scramble(base_seed).wrapping_add(trial))
}

/// A number that has nothing in common with this one.
pub(crate) fn scramble(number: u64) -> u64 {
    let mut z = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A standard normal number.
pub(crate) fn normal(rng: &mut impl Rng) -> f64 {
    rng.sample(StandardNormal)
}
