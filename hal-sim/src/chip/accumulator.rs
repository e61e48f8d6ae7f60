//! The channel impulse response in ACC_MEM (0x25), made up when it is read.
//!
//! Complex samples of two 16-bit numbers, 992 at PRF 16 MHz and 1016 at 64 MHz. The response is the noise and one
//! pulse at the first path, with a second one at the peak when that comes later; phases are arbitrary. Enough for
//! drivers that look for the leading edge, no substitute for measured responses.

use super::diagnostics::Diagnostics;

/// Shape of the latest reception's response.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Accumulator {
    seed: u64,
    std_noise: f64,
    first_path: Pulse,
    peak: Option<Pulse>,
}

#[derive(Debug, Clone, Copy)]
struct Pulse {
    index: f64,
    amplitude: f64,
}

impl Accumulator {
    pub(crate) fn new(diagnostics: &Diagnostics, seed: u64) -> Self {
        let first_index = f64::from(diagnostics.fp_index) / 64.0;
        let late = f64::from(diagnostics.peak_index) > first_index + 2.0;
        Accumulator {
            seed,
            std_noise: f64::from(diagnostics.std_noise),
            first_path: Pulse {
                index: first_index + 1.0,
                amplitude: f64::from(diagnostics.fp_ampl[1]),
            },
            peak: late.then(|| Pulse {
                index: f64::from(diagnostics.peak_index),
                amplitude: f64::from(diagnostics.peak_ampl),
            }),
        }
    }

    /// The byte at `offset` of the memory.
    pub(crate) fn byte(&self, offset: usize) -> u8 {
        let [i, q] = self.sample(offset / 4);
        let part = if offset % 4 < 2 { i } else { q };
        part.to_le_bytes()[offset % 2]
    }

    fn sample(&self, index: usize) -> [i16; 2] {
        let pulse = |p: &Pulse| p.amplitude * (1.0 - (index as f64 - p.index).abs() / 2.5).max(0.0);
        let signal = pulse(&self.first_path) + self.peak.as_ref().map_or(0.0, pulse);
        let phase = (self.seed % 628) as f64 / 100.0;
        // STD_NOISE is that of the magnitude, shared by the two parts.
        let noise =
            |part| self.std_noise * std::f64::consts::FRAC_1_SQRT_2 * self.noise(index, part);
        [
            to_i16(signal * phase.cos() + noise(0)),
            to_i16(signal * phase.sin() + noise(1)),
        ]
    }

    /// About normally distributed, the same whenever the same sample is read.
    fn noise(&self, index: usize, part: u64) -> f64 {
        let mut state = self.seed ^ (index as u64 * 2 + part);
        let uniforms = (0..12).map(|_| {
            state = split_mix(state);
            (state >> 11) as f64 / (1u64 << 53) as f64
        });
        uniforms.sum::<f64>() - 6.0
    }
}

fn to_i16(x: f64) -> i16 {
    x.round().clamp(f64::from(i16::MIN), f64::from(i16::MAX)) as i16
}

/// SplitMix64 (Steele, Lea, Flood 2014).
fn split_mix(state: u64) -> u64 {
    let z = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}
