//! How well a frame was received.

use crate::phy;
use micromath::F32Ext;
use nova_ranging::PhyProfile;
use nova_wire::Quality;

/// The radio's measures of one reception, as its registers give them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Reception {
    /// The mode in which it was received.
    pub(crate) profile: PhyProfile,
    /// FP_AMPL1 to FP_AMPL3: the channel impulse response around the first path.
    pub(crate) first_path_amplitudes: [u16; 3],
    /// CIR_PWR: power of the channel impulse response.
    pub(crate) response_power: u16,
    /// RXPACC: preamble symbols accumulated, saturating.
    pub(crate) preamble_count: u16,
    /// RXPACC_NOSAT: the same without saturation.
    pub(crate) preamble_count_unsaturated: u16,
    /// STD_NOISE: standard deviation of the noise in the channel impulse response.
    pub(crate) noise: u16,
    /// FP_INDEX: where the first path is in it, in 64ths of a sample.
    pub(crate) first_path_index: u16,
    /// PP_INDEX: where its strongest sample is.
    pub(crate) peak_index: u16,
    /// DRX_CAR_INT: positive when the sender's clock is slower than ours.
    pub(crate) carrier_integrator: i32,
}

impl Reception {
    /// Receive power in dBm (user manual, section 4.7.2):
    /// `10 log10(C 2^17 / N^2) - A`. NaN if nothing was received.
    ///
    /// The manual's figure reads low above -85 dBm; no correction is made.
    pub(crate) fn rx_power_dbm(&self) -> f32 {
        self.decibel(f32::from(self.response_power) * 131_072.0)
    }

    /// Power of the first path in dBm (user manual, section 4.7.1):
    /// `10 log10((F1^2 + F2^2 + F3^2) / N^2) - A`. NaN if nothing was received.
    pub(crate) fn first_path_power_dbm(&self) -> f32 {
        let squares = self
            .first_path_amplitudes
            .iter()
            .map(|&f| f32::from(f) * f32::from(f))
            .sum();
        self.decibel(squares)
    }

    /// All of it, for the host. `from_responder`: whose frame it was.
    pub(crate) fn quality(&self, from_responder: bool) -> Quality {
        let first_path = f32::from(self.first_path_index) / 64.0;
        // 21 bits signed: f32 holds them exactly.
        let sender_faster_ppm =
            -(self.carrier_integrator as f32) * phy::carrier_ppm_per_unit(&self.profile);
        Quality {
            rx_power_dbm: self.rx_power_dbm(),
            first_path_power_dbm: self.first_path_power_dbm(),
            noise: self.noise,
            preamble_count: self.symbols(),
            peak_delay_ns: (f32::from(self.peak_index) - first_path) * phy::SAMPLE_NS,
            carrier_offset_ppm: if from_responder {
                sender_faster_ppm
            } else {
                -sender_faster_ppm
            },
            nlos_percent: None,
        }
    }

    /// N: the preamble symbols without the SFD's (user manual, section 7.2.18).
    fn symbols(&self) -> u16 {
        let adjustment = if self.preamble_count == self.preamble_count_unsaturated {
            phy::rxpacc_adjustment(self.profile.bitrate)
        } else {
            0
        };
        self.preamble_count.saturating_add_signed(adjustment)
    }

    fn decibel(&self, power: f32) -> f32 {
        let symbols = f32::from(self.symbols());
        if power > 0.0 && symbols > 0.0 {
            // By the trait's name: where std is linked in, f32 has its own log10.
            let ratio_db = 10.0 * F32Ext::log10(power / (symbols * symbols));
            ratio_db - phy::power_constant_db(self.profile.prf)
        } else {
            f32::NAN
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Symbols accumulated, the same without saturation, and N.
    const COUNTS: [(u16, u16, u16); 3] = [
        // As a rule: the SFD's symbols are among them.
        (118, 118, 113),
        (128, 128, 123),
        // Saturated: they are not.
        (1_000, 1_012, 1_000),
    ];

    #[test]
    fn powers_follow_the_manuals_formulas() {
        for (count, unsaturated, n) in COUNTS {
            for (f, c) in [
                ([9_000u16, 9_500, 8_000], 12_000u16),
                ([700, 800, 650], 40),
                ([30_000, 32_000, 29_000], 65_000),
            ] {
                let reception = Reception {
                    first_path_amplitudes: f,
                    response_power: c,
                    preamble_count: count,
                    preamble_count_unsaturated: unsaturated,
                    ..Reception::default()
                };
                let n = f64::from(n);
                let squares: f64 = f.iter().map(|&f| f64::from(f) * f64::from(f)).sum();
                let first = 10.0 * (squares / (n * n)).log10() - 121.74;
                let total = 10.0 * (f64::from(c) * 131_072.0 / (n * n)).log10() - 121.74;
                assert!((f64::from(reception.first_path_power_dbm()) - first).abs() < 0.05);
                assert!((f64::from(reception.rx_power_dbm()) - total).abs() < 0.05);
            }
        }
    }

    #[test]
    fn nothing_received_has_no_power() {
        let nothing = Reception::default();
        assert!(nothing.rx_power_dbm().is_nan());
        assert!(nothing.first_path_power_dbm().is_nan());
    }
}
