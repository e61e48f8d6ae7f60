//! Range and range rate under white acceleration: a Kalman filter of two states.
//!
//! ```text
//! x = (range, rate)      x' = F x,  P' = F P F^T + Q      F = (1 t; 0 1),  Q = q (t^3/3 t^2/2; t^2/2 t)
//! d = raw - range        S = P00 + sigma^2                K = P (1, 0)^T / S
//! x = x' + K d           P = (1 - K H) P' (1 - K H)^T + K sigma^2 K^T
//! ```
//!
//! The last line is Joseph's form, which stays symmetric and positive in single precision.

use super::{Estimate, FilterSettings};
use micromath::F32Ext;
use nalgebra::{Matrix2, RowVector2, Vector2};

/// State and covariance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kalman {
    x: Vector2<f32>,
    p: Matrix2<f32>,
}

/// How far a raw range is from the expected one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Innovation {
    /// d: raw less expected, in metres.
    pub(super) difference_m: f32,
    /// sigma^2 of the raw range.
    noise_m2: f32,
    /// S: variance of the difference.
    variance_m2: f32,
}

impl Innovation {
    /// The difference against its standard deviation, squared.
    pub(super) fn sigmas_squared(&self) -> f32 {
        self.difference_m * self.difference_m / self.variance_m2
    }
}

impl Kalman {
    /// Starts at a raw range; nothing is known of the rate.
    pub(super) fn at(range_m: f32, settings: &FilterSettings) -> Self {
        let rate_sigma = settings.max_speed_m_per_s / 3.0;
        Self {
            x: Vector2::new(range_m, 0.0),
            p: Matrix2::new(
                settings.sigma_m * settings.sigma_m,
                0.0,
                0.0,
                rate_sigma * rate_sigma,
            ),
        }
    }

    /// Lets `t_s` seconds pass.
    pub(super) fn predict(&mut self, t_s: f32, q: f32) {
        let f = Matrix2::new(1.0, t_s, 0.0, 1.0);
        let (t2, t3) = (t_s * t_s, t_s * t_s * t_s);
        self.x = f * self.x;
        self.p = f * self.p * f.transpose() + Matrix2::new(t3 / 3.0, t2 / 2.0, t2 / 2.0, t_s) * q;
    }

    pub(super) fn innovation(&self, raw_m: f32, sigma_m: f32) -> Innovation {
        let noise_m2 = sigma_m * sigma_m;
        Innovation {
            difference_m: raw_m - self.x.x,
            noise_m2,
            variance_m2: self.p.m11 + noise_m2,
        }
    }

    /// Weighs a raw range in. Beyond `soft_gate` sigmas its noise is taken for
    /// so much larger that its pull grows no more (Huber's function).
    pub(super) fn correct(&mut self, innovation: &Innovation, soft_gate: f32) {
        let mut noise_m2 = innovation.noise_m2;
        let beyond = innovation.sigmas_squared() / (soft_gate * soft_gate);
        if beyond > 1.0 {
            // S grows by the factor, all of it on account of the raw range.
            let factor = F32Ext::sqrt(beyond);
            noise_m2 = innovation.variance_m2 * factor - self.p.m11;
        }
        let gain = self.p.column(0) / (self.p.m11 + noise_m2);
        self.x += gain * innovation.difference_m;
        let rest = Matrix2::identity() - gain * RowVector2::new(1.0, 0.0);
        self.p = rest * self.p * rest.transpose() + gain * gain.transpose() * noise_m2;
    }

    pub(super) fn estimate(&self) -> Estimate {
        Estimate {
            range_m: self.x.x,
            rate_m_per_s: self.x.y,
            variance_m2: self.p.m11,
        }
    }
}
