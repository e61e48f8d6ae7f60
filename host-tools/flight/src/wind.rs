//! Gusts.

use crate::settings::Settings;
use crate::streams::{Stream, generator, normal};
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;

/// Zero-mean Gaussian velocity, held for a while, then drawn anew.
#[derive(Debug, Clone)]
pub struct Wind {
    rng: ChaCha8Rng,
    sigma_m_s: Vector3<f64>,
    hold_s: f64,
    drawn: u64,
    velocity_m_s: Vector3<f64>,
}

impl Wind {
    /// The wind of the trial with this seed.
    pub fn new(settings: &Settings, seed: u64) -> Self {
        Self {
            rng: generator(seed, Stream::Wind),
            sigma_m_s: Vector3::new(settings.wind_xy, settings.wind_xy, settings.wind_z),
            hold_s: settings.wind_hold_s,
            drawn: 0,
            velocity_m_s: Vector3::zeros(),
        }
    }

    /// Its velocity at `t_s`, m/s. Times must not go back.
    pub fn velocity_m_s(&mut self, t_s: f64) -> Vector3<f64> {
        // Times are sums of ticks: half a nanosecond absorbs their rounding.
        let wanted = ((t_s + 5e-10) / self.hold_s) as u64 + 1;
        while self.drawn < wanted {
            self.velocity_m_s = self.sigma_m_s.map(|sigma| sigma * normal(&mut self.rng));
            self.drawn += 1;
        }
        self.velocity_m_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gusty(wind_hold_s: f64) -> Settings {
        Settings {
            wind_xy: 0.35,
            wind_z: 0.15,
            wind_hold_s,
            ..Settings::default()
        }
    }

    #[test]
    fn it_is_held_as_long_as_was_set() {
        for (hold_s, ticks) in [(0.1, 10), (0.5, 50)] {
            let mut wind = Wind::new(&gusty(hold_s), 1);
            let velocities: Vec<_> = (0..1000)
                .map(|tick| wind.velocity_m_s(f64::from(tick) / 100.0))
                .collect();
            for hold in velocities.chunks(ticks) {
                assert!(hold.iter().all(|velocity| velocity == &hold[0]));
            }
            assert!(velocities.chunks(ticks).is_sorted_by(|a, b| a[0] != b[0]));
        }
    }

    #[test]
    fn it_has_zero_mean_and_the_spread_that_was_set() {
        let mut wind = Wind::new(&gusty(0.1), 2);
        let n = 20_000;
        let (mut sum, mut squares) = (Vector3::zeros(), Vector3::zeros());
        for i in 0..n {
            let velocity = wind.velocity_m_s(0.1 * f64::from(i));
            sum += velocity;
            squares += velocity.component_mul(&velocity);
        }
        for (axis, sigma) in [(0, 0.35), (1, 0.35), (2, 0.15)] {
            let n = f64::from(n);
            assert!((sum[axis] / n).abs() < 4.0 * sigma / n.sqrt());
            assert!((squares[axis] / n / (sigma * sigma) - 1.0).abs() < 4.0 * (2.0 / n).sqrt());
        }
    }
}
