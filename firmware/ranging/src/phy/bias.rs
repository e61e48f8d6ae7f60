//! How receive power bends ranges.
//!
//! The leading edge of a strong signal is found early, that of a weak one late: a range reads up to 0.4 m too short or
//! too long, the same for all boards (application note APS011, tables for bandwidths of 500 and 900 MHz).

use super::{PhyProfile, Prf};

/// The strongest level of the tables in dBm.
const STRONGEST_DBM: f32 = -61.0;
/// From one entry to the next, weaker, in dB.
const STEP_DB: f32 = 2.0;

/// What to take off a range in millimetres, from [`STRONGEST_DBM`] down.
type Table = [i16; 18];

const NARROW_16: Table = [
    -198, -187, -179, -163, -143, -127, -109, -84, -59, -31, 0, 36, 65, 84, 97, 106, 110, 112,
];
const NARROW_64: Table = [
    -110, -105, -100, -93, -82, -69, -51, -27, 0, 21, 35, 42, 49, 62, 71, 76, 81, 86,
];
const WIDE_16: Table = [
    -274, -244, -210, -176, -138, -94, -50, 0, 42, 96, 158, 210, 254, 294, 320, 338, 356, 394,
];
const WIDE_64: Table = [
    -294, -266, -234, -198, -150, -100, -58, 0, 48, 90, 126, 152, 174, 196, 232, 244, 264, 284,
];

impl PhyProfile {
    /// How much too long ranges are in metres at a true receive level in dBm: what to take off. Linear between the
    /// entries, constant beyond them; 0 for a level that is no number.
    pub fn range_bias_m(&self, level_dbm: f32) -> f32 {
        let table = match (self.channel.is_wide(), self.prf) {
            (false, Prf::Mhz16) => &NARROW_16,
            (false, Prf::Mhz64) => &NARROW_64,
            (true, Prf::Mhz16) => &WIDE_16,
            (true, Prf::Mhz64) => &WIDE_64,
        };
        let place = (STRONGEST_DBM - level_dbm) / STEP_DB;
        if place.is_nan() {
            return 0.0;
        }
        let place = place.clamp(0.0, (table.len() - 1) as f32);
        let index = place as usize;
        let entry = |i: usize| table.get(i.min(table.len() - 1)).copied().unwrap_or(0);
        let (above, below) = (f32::from(entry(index)), f32::from(entry(index + 1)));
        (above + (below - above) * (place - index as f32)) * 1e-3
    }
}

impl Prf {
    /// The true receive level in dBm for one that the radio estimates: its formula reads low above -88 dBm (user
    /// manual, section 4.7.2, figure 22, as the open drivers approximate it).
    pub fn true_level_dbm(self, estimated_dbm: f32) -> f32 {
        let slope = match self {
            Self::Mhz16 => 2.3334,
            Self::Mhz64 => 1.1667,
        };
        estimated_dbm + (estimated_dbm + 88.0).max(0.0) * slope
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phy::Channel;

    const WIDE: PhyProfile = PhyProfile {
        channel: Channel::Ch7,
        ..PhyProfile::DEFAULT
    };

    #[test]
    fn entries_of_the_table_come_out_as_they_are() {
        for (level, narrow_mm, wide_mm) in [
            (-61.0, -110.0, -294.0),
            (-75.0, -27.0, 0.0),
            (-77.0, 0.0, 48.0),
            (-95.0, 86.0, 284.0),
        ] {
            let narrow = PhyProfile::DEFAULT.range_bias_m(level);
            assert!((narrow - narrow_mm * 1e-3).abs() < 1e-6, "{level}");
            assert!((WIDE.range_bias_m(level) - wide_mm * 1e-3).abs() < 1e-6);
        }
    }

    #[test]
    fn between_entries_it_is_linear_and_beyond_them_constant() {
        let bias = |level| PhyProfile::DEFAULT.range_bias_m(level);
        assert!((bias(-76.0) + 0.013_5).abs() < 1e-6);
        assert_eq!(bias(-20.0), bias(-61.0));
        assert_eq!(bias(-120.0), bias(-95.0));
        assert_eq!(bias(f32::NEG_INFINITY), bias(-95.0));
        assert_eq!(bias(f32::NAN), 0.0);
    }

    #[test]
    fn weaker_signals_never_read_shorter() {
        for profile in PhyProfile::all() {
            let levels = (0..400).map(|i| -55.0 - 0.1 * i as f32);
            let biases: std::vec::Vec<f32> = levels.map(|l| profile.range_bias_m(l)).collect();
            assert!(biases.is_sorted(), "{profile}");
        }
    }
}
