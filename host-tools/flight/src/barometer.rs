//! A barometer.

use crate::settings::Settings;
use crate::streams::{Stream, generator, normal};
use rand_chacha::ChaCha8Rng;

/// Height with white noise and a random walk that starts at zero.
#[derive(Debug, Clone)]
pub struct Barometer {
    rng: ChaCha8Rng,
    sigma_m: f64,
    drift_step_m: f64,
    drift_m: f64,
}

impl Barometer {
    /// The barometer of the trial with this seed.
    pub fn new(settings: &Settings, seed: u64) -> Self {
        Self {
            rng: generator(seed, Stream::Baro),
            sigma_m: settings.baro_sigma_m,
            drift_step_m: settings.baro_drift / settings.baro_rate_hz.sqrt(),
            drift_m: 0.0,
        }
    }

    /// The next reading at this true height, metres.
    pub fn read(&mut self, true_height_m: f64) -> f64 {
        let reading_m = true_height_m + self.drift_m + self.sigma_m * normal(&mut self.rng);
        self.drift_m += self.drift_step_m * normal(&mut self.rng);
        reading_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Preset;
    use crate::streams::trial_seed;

    #[test]
    fn its_error_is_white_noise_about_a_random_walk() {
        let settings = Settings::preset(Preset::R);
        let n = 3000;
        let after = |readings: usize| -> f64 {
            let squares = (0..n).map(|trial| {
                let mut barometer = Barometer::new(&settings, trial_seed(1, trial));
                let last = (0..=readings).map(|_| barometer.read(30.0)).last();
                (last.unwrap() - 30.0).powi(2)
            });
            squares.sum::<f64>() / n as f64
        };
        // 0.01 m/sqrt(s): after 100 s as much drift as there is white noise.
        for (readings, expected) in [(0, 0.01), (1000, 0.02)] {
            let ratio = after(readings) / expected;
            assert!(
                (ratio - 1.0).abs() < 4.0 * (2.0 / n as f64).sqrt(),
                "{ratio}"
            );
        }
    }
}
