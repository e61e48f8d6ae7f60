//! Ranges between vehicle and tag.
//!
//! # Link budget
//! Free space takes `20 log10(4 pi d f / c)` dB at the channel's centre frequency `f`. Part of the
//! noise of a range is inversely proportional to the signal's amplitude, hence to distance:
//!
//! ```text
//! sigma^2 = floor^2 + (reference 10^((S_0 - S)/20))^2
//! ```
//!
//! where `S` is the ratio of received power to noise floor in dB and `S_0` that at 30 m with
//! -14 dBm, -114 dBm and no antenna loss, so that `10^(...)` is `d/30 m` there.
//!
//! A range is lost with a probability that falls with the margin `m` of `S` over what is required,
//! 10 % at no margin and 1 % at 1 dB (the two error rates for which the DW1000 data sheet gives
//! sensitivities lie about that far apart):
//!
//! ```text
//! P(lost) = 1/(1 + 9 exp(m ln 11))          ln 11 = ln 99 - ln 9
//! ```
//!
//! The required ratio of the presets, 8 dB, puts the sensitivity at -106 dBm, the data sheet's figure
//! for 110 kbit/s.

use crate::settings::Settings;
use crate::streams::{Stream, generator, normal};
use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::Exp1;
use std::f64::consts::PI;

/// Centre of channel 2 (paper Table III), Hz.
const CENTRE_HZ: f64 = 3_993.6e6;
/// Speed of light in air, m/s.
const SPEED_OF_LIGHT_M_S: f64 = 299_702_547.0;
/// Where `uwb_reference_m` holds, metres.
const REFERENCE_M: f64 = 30.0;
/// Transmit power and noise floor with which it holds, dBm.
const REFERENCE_POWERS_DBM: (f64, f64) = (-14.0, -114.0);
/// Nearer than this there is no far field, and path loss is held, metres.
const NEAREST_M: f64 = 0.05;
/// Depth of the antenna's null, dB: what is reflected around the vehicle fills it.
const NULL_DB: f64 = 20.0;

/// Where ranges come from.
pub trait RangeSource {
    /// A range measured at `t_s` between vehicle and tag, metres; `None` if it was lost. Called with
    /// growing times.
    fn range(&mut self, t_s: f64, vehicle_m: Vector3<f64>, tag_m: Vector3<f64>) -> Option<f64>;
}

/// What the radio makes of a distance, without chance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkBudget {
    floor_m: f64,
    reference_m: f64,
    tx_power_dbm: f64,
    noise_floor_dbm: f64,
    required_snr_db: f64,
    antenna_null: bool,
}

impl LinkBudget {
    /// The link of these settings.
    pub fn new(settings: &Settings) -> Self {
        Self {
            floor_m: settings.uwb_floor_m,
            reference_m: settings.uwb_reference_m,
            tx_power_dbm: settings.tx_power_dbm,
            noise_floor_dbm: settings.uwb_noise_floor_dbm,
            required_snr_db: settings.uwb_required_snr_db,
            antenna_null: settings.antenna_null,
        }
    }

    /// Received power over noise floor, dB.
    pub fn snr_db(&self, tag_to_vehicle_m: Vector3<f64>) -> f64 {
        let received_dbm = self.tx_power_dbm
            - path_loss_db(tag_to_vehicle_m.norm())
            - self.antenna_loss_db(tag_to_vehicle_m);
        received_dbm - self.noise_floor_dbm
    }

    /// Standard deviation of a range that has a direct path, metres.
    pub fn sigma_m(&self, tag_to_vehicle_m: Vector3<f64>) -> f64 {
        let (tx_dbm, noise_dbm) = REFERENCE_POWERS_DBM;
        let reference_db = tx_dbm - path_loss_db(REFERENCE_M) - noise_dbm;
        let weaker_db = reference_db - self.snr_db(tag_to_vehicle_m);
        self.floor_m
            .hypot(self.reference_m * 10f64.powf(weaker_db / 20.0))
    }

    /// Probability that a range is lost.
    pub fn loss_probability(&self, tag_to_vehicle_m: Vector3<f64>) -> f64 {
        let margin_db = self.snr_db(tag_to_vehicle_m) - self.required_snr_db;
        1.0 / (1.0 + 9.0 * (margin_db * 11f64.ln()).exp())
    }

    /// Loss by the antennas at both ends: vertical short dipoles radiate as the cosine of elevation,
    /// down to [`NULL_DB`] each.
    fn antenna_loss_db(&self, tag_to_vehicle_m: Vector3<f64>) -> f64 {
        if !self.antenna_null {
            return 0.0;
        }
        let distance_m = tag_to_vehicle_m.norm().max(NEAREST_M);
        let cosine = tag_to_vehicle_m.xy().norm() / distance_m;
        2.0 * (-20.0 * cosine.log10()).min(NULL_DB)
    }
}

/// Free-space path loss (Friis), dB.
fn path_loss_db(distance_m: f64) -> f64 {
    let wavelength_m = SPEED_OF_LIGHT_M_S / CENTRE_HZ;
    20.0 * (4.0 * PI * distance_m.max(NEAREST_M) / wavelength_m).log10()
}

/// Ranges by formula: noise and losses of the [`LinkBudget`], a constant bias, and late ones where
/// the direct path is blocked.
#[derive(Debug, Clone)]
pub struct UwbLink {
    rng: ChaCha8Rng,
    budget: LinkBudget,
    bias_m: f64,
    nlos_probability: f64,
    nlos_mean_m: f64,
}

impl UwbLink {
    /// The link of the trial with this seed.
    pub fn new(settings: &Settings, seed: u64) -> Self {
        Self {
            rng: generator(seed, Stream::Uwb),
            budget: LinkBudget::new(settings),
            bias_m: settings.uwb_bias_m,
            nlos_probability: settings.nlos_probability,
            nlos_mean_m: settings.nlos_mean_m,
        }
    }
}

impl RangeSource for UwbLink {
    fn range(&mut self, _t_s: f64, vehicle_m: Vector3<f64>, tag_m: Vector3<f64>) -> Option<f64> {
        // All four are drawn for every range, so that each setting leaves the others' draws alone.
        let noise = normal(&mut self.rng);
        let blocked = self.rng.random::<f64>() < self.nlos_probability;
        let lateness: f64 = self.rng.sample(Exp1);
        let fate = self.rng.random::<f64>();

        let apart_m = vehicle_m - tag_m;
        if fate < self.budget.loss_probability(apart_m) {
            return None;
        }
        let late_m = if blocked {
            lateness * self.nlos_mean_m
        } else {
            0.0
        };
        Some(apart_m.norm() + self.bias_m + late_m + noise * self.budget.sigma_m(apart_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Preset;

    fn east(distance_m: f64) -> Vector3<f64> {
        Vector3::new(distance_m, 0.0, 0.0)
    }

    fn errors(settings: &Settings, apart_m: Vector3<f64>, n: u32) -> Vec<f64> {
        let mut link = UwbLink::new(settings, 4);
        (0..n)
            .filter_map(|i| link.range(f64::from(i), apart_m, Vector3::zeros()))
            .map(|range_m| range_m - apart_m.norm())
            .collect()
    }

    fn mean(values: &[f64]) -> f64 {
        values.iter().sum::<f64>() / values.len() as f64
    }

    #[test]
    fn noise_is_a_floor_and_a_part_proportional_to_distance() {
        let budget = LinkBudget::new(&Settings::preset(Preset::R));
        for distance_m in [0.5, 5.0, 30.0, 60.0] {
            let expected = (0.05f64.powi(2) + (0.10f64 * distance_m / 30.0).powi(2)).sqrt();
            let sigma = budget.sigma_m(east(distance_m));
            assert!(
                (sigma / expected - 1.0).abs() < 1e-9,
                "{distance_m} m: {sigma}"
            );
        }
    }

    #[test]
    fn ten_db_more_noise_makes_the_proportional_part_root_ten_larger() {
        let settings = Settings {
            uwb_floor_m: 0.0,
            uwb_noise_floor_dbm: -104.0,
            ..Settings::default()
        };
        let sigma = LinkBudget::new(&settings).sigma_m(east(30.0));
        assert!((sigma / (0.02 * 10f64.sqrt()) - 1.0).abs() < 1e-9);
        let louder = Settings {
            tx_power_dbm: -4.0,
            ..settings
        };
        let sigma = LinkBudget::new(&louder).sigma_m(east(30.0));
        assert!((sigma / 0.02 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn ranges_scatter_as_the_link_budget_says_about_the_bias() {
        let settings = Settings::preset(Preset::R);
        let n = 20_000;
        let errors = errors(&settings, east(30.0), n);
        let sigma = LinkBudget::new(&settings).sigma_m(east(30.0));
        let n = f64::from(n);
        assert_eq!(errors.len() as f64, n);
        assert!((mean(&errors) - 0.1).abs() < 4.0 * sigma / n.sqrt());
        let squares: Vec<_> = errors.iter().map(|e| (e - 0.1).powi(2)).collect();
        assert!((mean(&squares) / sigma.powi(2) - 1.0).abs() < 4.0 * (2.0 / n).sqrt());
    }

    #[test]
    fn one_range_in_ten_is_lost_at_the_sensitivity_and_one_in_a_hundred_one_db_above() {
        // -14 dBm less Friis' loss is -106 dBm, 8 dB over the noise floor, here:
        let at_limit_m = SPEED_OF_LIGHT_M_S / CENTRE_HZ / (4.0 * PI) * 10f64.powf(92.0 / 20.0);
        assert!((230.0..240.0).contains(&at_limit_m));
        let nearer_m = at_limit_m / 10f64.powf(1.0 / 20.0);
        let n = 40_000;
        for (distance_m, expected) in [(at_limit_m, 0.1), (nearer_m, 0.01), (1.0, 0.0)] {
            let settings = Settings::default();
            let lost = 1.0 - errors(&settings, east(distance_m), n).len() as f64 / f64::from(n);
            let spread = (expected * (1.0 - expected) / f64::from(n)).sqrt();
            assert!(
                (lost - expected).abs() <= 4.0 * spread,
                "{distance_m} m: {lost}"
            );
        }
    }

    #[test]
    fn blocked_ranges_are_late_by_the_mean_that_was_set() {
        let settings = Settings {
            nlos_probability: 0.1,
            nlos_mean_m: 1.5,
            uwb_floor_m: 0.0,
            uwb_reference_m: 0.0,
            ..Settings::default()
        };
        let n = 40_000;
        let errors = errors(&settings, east(20.0), n);
        let late: Vec<_> = errors.into_iter().filter(|&error| error > 1e-9).collect();
        let part = late.len() as f64 / f64::from(n);
        assert!((part - 0.1).abs() < 4.0 * (0.09 / f64::from(n)).sqrt());
        // An exponential's standard deviation is its mean.
        assert!((mean(&late) - 1.5).abs() < 4.0 * 1.5 / (late.len() as f64).sqrt());
    }

    #[test]
    fn overhead_the_antennas_nulls_cost_forty_db_and_at_45_degrees_six() {
        let plain = LinkBudget::new(&Settings::default());
        let null = LinkBudget::new(&Settings {
            antenna_null: true,
            ..Settings::default()
        });
        let loss_db = |apart_m| plain.snr_db(apart_m) - null.snr_db(apart_m);
        assert!(loss_db(east(10.0)).abs() < 1e-9);
        assert!((loss_db(Vector3::new(10.0, 0.0, 10.0)) - 20.0 * 2f64.log10()).abs() < 1e-9);
        let overhead = Vector3::new(0.0, 0.0, 10.0);
        assert!((loss_db(overhead) - 2.0 * NULL_DB).abs() < 1e-9);
        assert!(null.sigma_m(overhead) > plain.sigma_m(overhead));
        assert!(null.loss_probability(overhead) > 0.9);
        assert!(null.loss_probability(Vector3::zeros()) >= 0.0);
    }
}
