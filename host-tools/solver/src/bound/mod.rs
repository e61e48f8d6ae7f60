//! How well could anybody know, at the end of a flight, where the tag is relative to the vehicle?
//!
//! The posterior Cramer-Rao bound: no estimator fed with the same dead reckoning, ranges and prior
//! has a smaller covariance (Tichavsky, Muravchik, Nehorai, "Posterior Cramer-Rao bounds for
//! discrete-time nonlinear filtering", IEEE Trans. Signal Processing 46, 1998). Along a given true
//! trajectory the model is linear and Gaussian but for the direction of the range, so that the
//! bound equals the covariance of a Kalman filter whose ranges are linearised at the truth; see
//! [`Recursion`].
//!
//! # Measurements
//! Dead reckoning shows `ins = vehicle + p`, with the error `p` of [`crate::ins_error`]. A range is
//!
//! ```text
//! range = |tag - vehicle| + b + noise = |r - ins| + b + noise,     r = tag + p
//! ```
//!
//! so that ranges and dead reckoning tell about tag and error by their sum alone, and `r - ins =
//! tag - vehicle` is what the vehicle must know to land on the tag.
//!
//! **Barometer.** White noise of the barometer is part of `ins`. A reading that is paired with one
//! range enters there and nowhere else, as `u_z` (vertical part of the line of sight) times the
//! reading's error: exactly a range noise of `u_z sigma_b`, independent of all others.
//!
//! **Late ranges.** With probability `q` a range is late by an exponential delay. What a range then
//! tells is less by the factor [`NlosLoss::kept`], of which an estimator that knows probability and
//! mean of the delays loses nothing more.
//!
//! ```
//! use nalgebra::Vector3;
//! use nova_solver::bound::{BoundEpoch, BoundModel, Prior, mean_error_m, relative_covariance};
//! use nova_solver::ins_error::InsNoise;
//!
//! // Ten ranges a second on a spiral down to a tag.
//! let tag_m = Vector3::new(4.0, 2.0, 0.0);
//! let spiral = |t_s: f64| Vector3::new(9.0 * (0.3 * t_s).cos(), 9.0 * (0.3 * t_s).sin(), 30.0 - 0.5 * t_s);
//! let epochs: Vec<_> = (1..=600)
//!     .map(|i| 0.1 * f64::from(i))
//!     .map(|t_s| BoundEpoch { t_s, vehicle_m: spiral(t_s), range_sigma_m: 0.05 })
//!     .collect();
//! let model = BoundModel {
//!     ins: InsNoise {
//!         velocity_random_walk: 0.005,
//!         acceleration_random_walk: 5e-4,
//!         position_random_walk: 0.0,
//!         height_random_walk: 0.003,
//!         height_sigma_m: 0.03,
//!     },
//!     prior: Prior {
//!         tag_sigma_m: [5.0; 3],
//!         velocity_sigma_m_s: 0.0,
//!         acceleration_sigma_m_s2: 0.0,
//!         bias_sigma_m: 0.1,
//!     },
//!     nlos_probability: 0.1,
//!     nlos_mean_m: 1.0,
//! };
//! let bound = relative_covariance(&epochs, tag_m, &model, 0.0..60.0);
//! assert!((0.09..0.11).contains(&mean_error_m(&bound)));
//! ```

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use crate::ins_error::InsNoise;

mod mean_error;
mod nlos;
mod recursion;

pub use mean_error::mean_error_m;
pub use nlos::NlosLoss;
pub use recursion::{BIAS, Covariance, Prior, Recursion, STATES};

/// A range that was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundEpoch {
    /// Time, seconds.
    pub t_s: f64,
    /// True position of the vehicle, metres.
    pub vehicle_m: Vector3<f64>,
    /// Standard deviation of the range without the barometer's part and without lateness, metres.
    pub range_sigma_m: f64,
}

/// All that chance has a hand in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundModel {
    /// Noise of dead reckoning.
    pub ins: InsNoise,
    /// What is known at the start of the flight.
    pub prior: Prior,
    /// Part of the ranges that is late.
    pub nlos_probability: f64,
    /// Their mean lateness, metres.
    pub nlos_mean_m: f64,
}

/// The bound on the covariance of `tag - vehicle` at the end of `flight_s`, m^2.
///
/// `epochs` are the measured ranges in order of time; those outside `flight_s` are left out.
pub fn relative_covariance(
    epochs: &[BoundEpoch],
    tag_m: Vector3<f64>,
    model: &BoundModel,
    flight_s: Range<f64>,
) -> Matrix3<f64> {
    let nlos = NlosLoss::new(model.nlos_probability, model.nlos_mean_m);
    let mut recursion = Recursion::new(model.ins, &model.prior);
    let mut now_s = flight_s.start;
    for epoch in epochs {
        if !(now_s..=flight_s.end).contains(&epoch.t_s) {
            continue;
        }
        recursion.step(epoch.t_s - now_s);
        now_s = epoch.t_s;
        let direction = (tag_m - epoch.vehicle_m)
            .try_normalize(0.0)
            .unwrap_or_else(Vector3::zeros);
        let gaussian_m = epoch
            .range_sigma_m
            .hypot(direction.z * model.ins.height_sigma_m);
        recursion.observe(direction, gaussian_m / nlos.kept(gaussian_m).sqrt());
    }
    recursion.step(flight_s.end - now_s);
    recursion.relative_covariance()
}

#[cfg(test)]
mod tests;
