//! Whether the line of sight was blocked, judged from how a frame was received.
//!
//! Two signs, both in dB:
//!
//! ```text
//! spread   = receive power - first-path power              power that came by other ways than the first
//! missing  = free-space power at the measured range - receive power     power that something took away
//! ```
//!
//! The range itself is a sign, since power means little without it: -90 dBm is healthy at 30 m and suspicious at 3 m.
//! Free-space power is that of a transmitter at the legal limit and antennas without gain (Friis), so that nothing
//! has to be calibrated; boards that send or receive better show less missing power, never more. Both signs are
//! clamped, below because more than healthy is no evidence, above so that the rule never runs far outside the data
//! that it was fitted to.
//!
//! ```text
//! z = BIAS + SPREAD spread + MISSING missing
//! z = max(z, SPREAD_ALONE (spread - 10 dB))      user manual 4.7: above 10 dB likely no line of sight
//! probability = 1 / (1 + exp(-z))                at equal odds beforehand
//! ```
//!
//! The constants come from `cargo run -p nova-ranging --example nlos_fit`; tests/nlos_recorded.rs holds them against the
//! recording. docs/range-filter.md has the curves and what the rule cannot do.

use crate::phy::{Channel, Prf};
use micromath::F32Ext;

/// Weights of the rule, fitted to half of the places of a recording (channel 1, 110 kbit/s).
mod weight {
    pub(super) const BIAS: f32 = -6.80;
    pub(super) const SPREAD: f32 = 0.186;
    pub(super) const MISSING: f32 = 0.479;
    /// The slope of a fit to `spread` alone; where it is 0 is the manual's.
    pub(super) const SPREAD_ALONE: f32 = 0.61;
    pub(super) const SPREAD_ALONE_ZERO_DB: f32 = 10.0;
}

/// Largest values of the signs that count, in dB.
const MOST_SPREAD_DB: f32 = 15.0;
const MOST_MISSING_DB: f32 = 25.0;

/// Ranges below this are taken for it: nearer, noise and antenna delay make the logarithm meaningless.
const LEAST_RANGE_M: f32 = 0.3;

/// Power of a transmitter at the legal limit: -41.3 dBm/MHz over 500 MHz.
const LIMIT_DBM: f32 = -14.3;

/// From this probability on a range is taken for one without line of sight.
pub const LIKELY: f32 = 0.5;

/// The rule for one channel and pulse repetition frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NlosRule {
    /// Receive power at 1 m in free space, in dBm.
    at_1_m_dbm: f32,
    /// By which the radio's power figures are understood.
    prf: Prf,
}

/// What the rule looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Signs {
    /// Receive power as the radio gives it (user manual 4.7.2).
    pub rx_power_dbm: f32,
    /// Power of the first path as the radio gives it (user manual 4.7.1).
    pub first_path_power_dbm: f32,
    /// The range measured.
    pub range_m: f32,
}

impl NlosRule {
    /// The rule for a mode of the radio.
    pub const fn new(channel: Channel, prf: Prf) -> Self {
        // Friis at 1 m: 20 log10(4 pi f / c).
        let loss_db = match channel {
            Channel::Ch1 => 43.32,
            Channel::Ch2 | Channel::Ch4 => 44.48,
            Channel::Ch3 => 45.50,
            Channel::Ch5 | Channel::Ch7 => 48.70,
        };
        Self {
            at_1_m_dbm: LIMIT_DBM - loss_db,
            prf,
        }
    }

    /// How probable it is that the line of sight was blocked, 0 to 1, if it
    /// was as probable as not beforehand; `None` if a sign is no number.
    pub fn probability(&self, signs: &Signs) -> Option<f32> {
        let (spread_db, missing_db) = self.evidence(signs)?;
        let alone = weight::SPREAD_ALONE * (spread_db - weight::SPREAD_ALONE_ZERO_DB);
        let z = weight::BIAS + weight::SPREAD * spread_db + weight::MISSING * missing_db;
        // By the trait's name: where std is linked in, f32 has its own exp.
        Some(1.0 / (1.0 + F32Ext::exp(-z.max(alone))))
    }

    /// The two signs, clamped: spread and missing power in dB.
    pub fn evidence(&self, signs: &Signs) -> Option<(f32, f32)> {
        let Signs {
            rx_power_dbm,
            first_path_power_dbm,
            range_m,
        } = *signs;
        let finite =
            rx_power_dbm.is_finite() && first_path_power_dbm.is_finite() && range_m.is_finite();
        if !finite {
            return None;
        }
        let level_dbm = self.prf.true_level_dbm(rx_power_dbm);
        let expected_dbm = self.at_1_m_dbm - 20.0 * F32Ext::log10(range_m.max(LEAST_RANGE_M));
        Some((
            (rx_power_dbm - first_path_power_dbm).clamp(0.0, MOST_SPREAD_DB),
            (expected_dbm - level_dbm).clamp(0.0, MOST_MISSING_DB),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RULE: NlosRule = NlosRule::new(Channel::Ch5, Prf::Mhz64);

    fn judged(rx_power_dbm: f32, first_path_power_dbm: f32, range_m: f32) -> Option<f32> {
        RULE.probability(&Signs {
            rx_power_dbm,
            first_path_power_dbm,
            range_m,
        })
    }

    #[test]
    fn a_healthy_reception_is_no_nlos_and_a_spread_or_faint_one_is() {
        assert!(judged(-80.0, -80.5, 5.0).unwrap() < 0.05);
        assert!(judged(-85.0, -97.0, 5.0).unwrap() > LIKELY);
        assert!(judged(-100.0, -103.0, 3.0).unwrap() > LIKELY);
        // The same powers at 60 m are what free space leaves.
        assert!(judged(-99.0, -100.0, 60.0).unwrap() < LIKELY);
    }

    #[test]
    fn powers_that_were_not_read_are_not_judged() {
        assert_eq!(judged(f32::NAN, -80.0, 5.0), None);
        assert_eq!(judged(-80.0, f32::NAN, 5.0), None);
        assert_eq!(judged(-80.0, -80.0, f32::NAN), None);
        assert_eq!(judged(f32::INFINITY, -80.0, 5.0), None);
    }

    proptest! {
        #[test]
        fn any_numbers_give_a_probability_that_more_evidence_never_lowers(
            rx in -130.0f32..0.0, spread in -20.0f32..60.0, more in 0.0f32..20.0,
            range in -10.0f32..5_000.0,
        ) {
            let p = judged(rx, rx - spread, range).unwrap();
            prop_assert!((0.0..=1.0).contains(&p));
            // micromath's exponential is not quite monotonic.
            prop_assert!(judged(rx, rx - spread - more, range).unwrap() >= p - 0.01);
            prop_assert!(judged(rx - more, rx - more - spread, range).unwrap() >= p - 0.01);
        }

        #[test]
        fn bits_of_any_kind_are_taken_without_panic(bits: [u32; 3]) {
            let [a, b, c] = bits.map(f32::from_bits);
            if let Some(p) = judged(a, b, c) {
                prop_assert!((0.0..=1.0).contains(&p), "{p}");
            }
        }
    }
}
