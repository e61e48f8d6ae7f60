//! An accelerometer with the noises of MATLAB's `imuSensor`.

use crate::settings::Settings;
use crate::streams::{Stream, generator, normal};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use nova_solver::ins::{GRAVITY_M_S2, acceleration_over_ground};
use rand_chacha::ChaCha8Rng;

/// Pole of the filter that makes bias instability of white noise, per reading.
const BIAS_POLE: f64 = 0.5;

/// Horizontal acceleration as it is measured: true acceleration, turned by the error of the
/// attitude, plus for reading `k` at intervals of `dt`, along each axis
///
/// ```text
/// constant bias + density/sqrt(dt) n_k + y_k + z_k
/// y_k = y_{k-1}/2 + instability n'_k          z_k = z_{k-1} + rw sqrt(dt) n''_k
/// ```
///
/// with independent standard normal `n`.
#[derive(Debug, Clone)]
pub struct Imu {
    rng: ChaCha8Rng,
    white_m_s2: f64,
    instability_m_s2: f64,
    walk_step_m_s2: f64,
    bias_m_s2: Vector2<f64>,
    attitude_error: Option<UnitQuaternion<f64>>,
    velocity_error_m_s: Vector2<f64>,
    slow_m_s2: Vector2<f64>,
    walk_m_s2: Vector2<f64>,
}

impl Imu {
    /// The accelerometer of the trial with this seed.
    pub fn new(settings: &Settings, seed: u64) -> Self {
        let mut rng = generator(seed, Stream::Imu);
        let velocity_error = pair(&mut rng) * settings.initial_velocity_sigma;
        let bias = pair(&mut rng) * settings.initial_bias_sigma;
        let tilt = Vector3::from_fn(|_, _| settings.attitude_sigma_rad * normal(&mut rng));
        let scale = settings.imu_scale;
        Self {
            white_m_s2: scale
                * settings.imu_noise_density
                * GRAVITY_M_S2
                * settings.imu_rate_hz.sqrt(),
            instability_m_s2: scale * settings.imu_bias_instability * GRAVITY_M_S2,
            walk_step_m_s2: scale * settings.rw * settings.tick_s().sqrt(),
            bias_m_s2: bias,
            attitude_error: (settings.attitude_sigma_rad > 0.0)
                .then(|| UnitQuaternion::from_scaled_axis(tilt)),
            velocity_error_m_s: velocity_error,
            slow_m_s2: Vector2::zeros(),
            walk_m_s2: Vector2::zeros(),
            rng,
        }
    }

    /// Error of the velocity that the INS starts with, m/s.
    pub fn velocity_error_m_s(&self) -> Vector2<f64> {
        self.velocity_error_m_s
    }

    /// The next reading, east and north, m/s^2, of a vehicle that accelerates so.
    pub fn read(&mut self, true_acceleration_m_s2: Vector3<f64>) -> Vector2<f64> {
        let seen = match &self.attitude_error {
            None => true_acceleration_m_s2,
            // The body is level; what turns its reading is the attitude it believes in.
            Some(error) => acceleration_over_ground(
                true_acceleration_m_s2 + Vector3::new(0.0, 0.0, GRAVITY_M_S2),
                error,
            ),
        };
        let white = pair(&mut self.rng) * self.white_m_s2;
        self.slow_m_s2 = self.slow_m_s2 * BIAS_POLE + pair(&mut self.rng) * self.instability_m_s2;
        self.walk_m_s2 += pair(&mut self.rng) * self.walk_step_m_s2;
        seen.xy() + self.bias_m_s2 + white + self.slow_m_s2 + self.walk_m_s2
    }
}

fn pair(rng: &mut ChaCha8Rng) -> Vector2<f64> {
    Vector2::from_fn(|_, _| normal(rng))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::trial_seed;
    use nalgebra::Matrix2;
    use nova_solver::ins::Ins;

    /// Only the noises of the accelerometer that are asked for.
    fn settings(noise_density: f64, bias_instability: f64, rw: f64) -> Settings {
        Settings {
            imu_noise_density: noise_density,
            imu_bias_instability: bias_instability,
            rw,
            ..Settings::default()
        }
    }

    /// Second moments of (position, velocity) of dead reckoning at rest after `t_s`, over both axes
    /// of `n` flights, divided by what the closed form says.
    fn moments_over_closed_form(settings: &Settings, t_s: f64, n: u64) -> Matrix2<f64> {
        let ticks = (t_s * settings.imu_rate_hz) as u32;
        let mut sum = Matrix2::zeros();
        for trial in 0..n {
            let mut imu = Imu::new(settings, trial_seed(1, trial));
            let mut ins = Ins::new(0.0, Vector3::zeros(), imu.velocity_error_m_s());
            for tick in 1..=ticks {
                let reading = imu.read(Vector3::zeros());
                let now_s = f64::from(tick) / settings.imu_rate_hz;
                ins.on_acceleration(now_s, reading).unwrap();
            }
            let (p, v) = (ins.sample().position_m, ins.velocity_m_s());
            for axis in 0..2 {
                let error = nalgebra::Vector2::new(p[axis], v[axis]);
                sum += error * error.transpose();
            }
        }
        let mean = sum / (2 * n) as f64;
        let expected = settings.ins_noise().axis_noise(t_s);
        mean.component_div(&expected.fixed_view::<2, 2>(0, 0))
    }

    /// Four standard errors of a variance from `2 n` draws.
    fn tolerance(n: u64) -> f64 {
        4.0 * (1.0 / n as f64).sqrt()
    }

    #[test]
    fn white_noise_makes_position_variance_grow_as_q2_t3_over_3() {
        let quiet = settings(500e-6, 0.0, 0.0);
        let n = 600;
        let q = 500e-6 * GRAVITY_M_S2;
        let t: f64 = 10.0;
        let closed = quiet.ins_noise().axis_noise(t)[(0, 0)];
        assert!((closed / (q * q * t.powi(3) / 3.0) - 1.0).abs() < 1e-12);
        let ratio = moments_over_closed_form(&quiet, t, n);
        assert!(
            ratio.iter().all(|r| (r - 1.0).abs() < tolerance(n)),
            "{ratio}"
        );
    }

    #[test]
    fn random_walk_makes_position_variance_grow_as_q2_t5_over_20() {
        let walking = settings(0.0, 0.0, 0.01);
        let n = 600;
        let t: f64 = 10.0;
        let closed = walking.ins_noise().axis_noise(t)[(0, 0)];
        assert!((closed / (0.01f64.powi(2) * t.powi(5) / 20.0) - 1.0).abs() < 1e-12);
        let ratio = moments_over_closed_form(&walking, t, n);
        assert!(
            ratio.iter().all(|r| (r - 1.0).abs() < tolerance(n)),
            "{ratio}"
        );
    }

    #[test]
    fn bias_instability_is_white_noise_of_twice_its_size_over_long_times() {
        let unstable = settings(0.0, 3000e-6, 0.0);
        let n = 600;
        let ratio = moments_over_closed_form(&unstable, 10.0, n);
        assert!(
            ratio.iter().all(|r| (r - 1.0).abs() < tolerance(n)),
            "{ratio}"
        );
    }

    #[test]
    fn bias_instability_has_a_pole_at_one_half() {
        let unstable = settings(0.0, 3000e-6, 0.0);
        let mut imu = Imu::new(&unstable, 1);
        let n = 40_000;
        let readings: Vec<f64> = (0..n).map(|_| imu.read(Vector3::zeros()).x).collect();
        let mean_product = |lag: usize| {
            let pairs = readings.iter().zip(&readings[lag..]);
            pairs.map(|(a, b)| a * b).sum::<f64>() / (n - lag) as f64
        };
        let variance = mean_product(0);
        let w = 3000e-6 * GRAVITY_M_S2;
        assert!((variance / (w * w / (1.0 - 0.25)) - 1.0).abs() < 0.04);
        for (lag, expected) in [(1, 0.5), (2, 0.25), (3, 0.125)] {
            assert!(
                (mean_product(lag) / variance - expected).abs() < 0.03,
                "{lag}"
            );
        }
    }

    #[test]
    fn the_scale_multiplies_all_three_noises() {
        let plain = settings(500e-6, 3000e-6, 0.01);
        let doubled = Settings {
            imu_scale: 2.0,
            ..plain.clone()
        };
        let (mut one, mut two) = (Imu::new(&plain, 3), Imu::new(&doubled, 3));
        for _ in 0..100 {
            let (a, b) = (one.read(Vector3::zeros()), two.read(Vector3::zeros()));
            assert!((a * 2.0 - b).norm() < 1e-12);
        }
    }

    #[test]
    fn a_tilt_of_the_attitude_reads_as_acceleration_by_gravity() {
        let tilted = Settings {
            attitude_sigma_rad: 0.01,
            ..settings(0.0, 0.0, 0.0)
        };
        let n = 2000;
        let sum: f64 = (0..n)
            .map(|trial| {
                let mut imu = Imu::new(&tilted, trial_seed(2, trial));
                imu.read(Vector3::zeros()).norm_squared()
            })
            .sum();
        let expected = 2.0 * (0.01 * GRAVITY_M_S2).powi(2);
        assert!((sum / n as f64 / expected - 1.0).abs() < tolerance(n));
    }

    #[test]
    fn errors_at_hand_over_have_the_spread_that_was_set() {
        let careless = Settings {
            initial_velocity_sigma: 0.2,
            initial_bias_sigma: 0.05,
            ..settings(0.0, 0.0, 0.0)
        };
        let n = 2000;
        let (mut velocity, mut bias) = (0.0, 0.0);
        for trial in 0..n {
            let mut imu = Imu::new(&careless, trial_seed(3, trial));
            velocity += imu.velocity_error_m_s().norm_squared() / (2 * n) as f64;
            bias += imu.read(Vector3::zeros()).norm_squared() / (2 * n) as f64;
        }
        assert!((velocity / 0.04 - 1.0).abs() < tolerance(n));
        assert!((bias / 0.0025 - 1.0).abs() < tolerance(n));
    }
}
