//! What a flight yet to be flown is expected to tell.
//!
//! A shape of the flight is flown ahead in the mind, from where the vehicle is to the ground, and the
//! covariance that the best explanation has now is carried along it by the recursion of the posterior
//! Cramer-Rao bound ([`crate::bound`]): it grows with the noise of dead reckoning as tuned so far, and
//! shrinks with ranges as noisy and as frequent as they have been. What is left at touchdown is
//! what the shape is worth: not a figure of the geometry alone, but one that knows what is known already.
//!
//! **Short ranges.** A range tells along the line of sight, and where that points is as unsure as the
//! place is. With the covariance `P` and the distance `d` the part that a straight line leaves out has
//! the variance `tr((C P)^2) / 2` with the curvature `C = (I - u u^T) / d` (the second-order
//! filter of Athans, Wishner and Bertolini 1968); it counts as noise.

use super::bend::Bend;
use super::guidance::{self, Approach, Shape};
use crate::bound::{Covariance, Recursion, mean_error_m};
use crate::ins_error::InsNoise;
use nalgebra::{Matrix3, Vector3};

/// Stretch of a flight between two looks, metres.
const STRIDE_M: f64 = 0.5;
/// How long what is left out stays the same, seconds.
const COHERENT_S: f64 = 2.0;
/// A flight longer than given by this much costs twice its error, metres.
const DOUBLES_M: f64 = 5.0;
/// Longest flight looked ahead, strides.
const MOST_STRIDES: usize = 600;

/// What is known now, and what measurements are worth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Forecast {
    /// Noise of dead reckoning.
    pub(super) ins: InsNoise,
    /// Covariance now, in the order of [`Recursion`].
    pub(super) covariance: Covariance,
    /// Standard deviation of a range, metres.
    pub(super) range_sigma_m: f64,
    /// Ranges a second.
    pub(super) range_rate_hz: f64,
    /// No range is shorter than this, metres.
    pub(super) nearest_m: f64,
    /// Speed of the vehicle, m/s.
    pub(super) speed_m_s: f64,
}

impl Forecast {
    /// What a flight of this shape is expected to cost: mean horizontal error at touchdown, metres, and
    /// more the further it goes beyond the path that it was given.
    pub(super) fn cost_m(&self, shape: &Shape, mut approach: Approach) -> f64 {
        let mut recursion = Recursion::from_covariance(self.ins, self.covariance);
        for _ in 0..MOST_STRIDES {
            let covariance = recursion.relative_covariance();
            approach.sigma_m = guidance::horizontal_sigma_m(&covariance);
            approach.landing = approach.may_land();
            let ahead_m = approach.waypoint_m(shape) - approach.offset_m;
            let stride_m = ahead_m.cap_magnitude(STRIDE_M);
            let length_m = stride_m.norm();
            approach.offset_m += stride_m;
            approach.path_left_m -= length_m;
            approach.spare_m += stride_m.z;
            self.fly(
                &mut recursion,
                &covariance,
                approach.offset_m,
                length_m / self.speed_m_s,
            );
            if approach.landing && ahead_m.norm() <= STRIDE_M {
                break;
            }
        }
        let beyond_m = (-approach.path_left_m).max(0.0);
        mean_error_m(&recursion.relative_covariance()) * (1.0 + beyond_m / DOUBLES_M)
    }

    /// Lets a stride of `dt_s` pass and takes the ranges that it brings.
    fn fly(
        &self,
        recursion: &mut Recursion,
        covariance: &Matrix3<f64>,
        offset_m: Vector3<f64>,
        dt_s: f64,
    ) {
        recursion.step(dt_s);
        let range_m = offset_m.norm();
        let ranges = self.range_rate_hz * dt_s;
        if range_m < self.nearest_m || ranges <= 0.0 {
            return;
        }
        let direction = -offset_m / range_m;
        let white = self.range_sigma_m.powi(2) + (direction.z * self.ins.height_sigma_m).powi(2);
        // What a straight line leaves out does not average over a stretch as white noise does.
        let bent =
            Bend::new(covariance, &direction, range_m).variance_m2() * (COHERENT_S / dt_s).max(1.0);
        recursion.observe(direction, (white / ranges + bent).sqrt());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bound::Prior;
    use crate::map::NoiseModel;

    const SHAPE: Shape = Shape {
        gate_m: 5.0,
        radius_m: 0.8,
        side: 1.0,
    };

    fn forecast(range_rate_hz: f64) -> Forecast {
        let prior = Prior {
            tag_sigma_m: [0.8, 0.8, 0.3],
            velocity_sigma_m_s: 0.02,
            acceleration_sigma_m_s2: 1e-3,
            bias_sigma_m: 0.05,
        };
        let ins = NoiseModel::data_sheet().ins;
        Forecast {
            ins,
            covariance: *Recursion::new(ins, &prior).covariance(),
            range_sigma_m: 0.05,
            range_rate_hz,
            nearest_m: 0.5,
            speed_m_s: 1.0,
        }
    }

    fn approach(path_left_m: f64) -> Approach {
        Approach {
            offset_m: Vector3::new(5.0, -3.0, 15.0),
            sigma_m: 0.8,
            path_left_m,
            spare_m: 0.0,
            landing: false,
        }
    }

    #[test]
    fn no_ranges_leave_what_is_known_to_the_noise_of_dead_reckoning() {
        let forecast = forecast(0.0);
        let mut recursion = Recursion::from_covariance(forecast.ins, forecast.covariance);
        recursion.step(20.0);
        let at_least_m = mean_error_m(&recursion.relative_covariance());
        assert!(forecast.cost_m(&SHAPE, approach(40.0)) > at_least_m);
    }

    #[test]
    fn more_ranges_promise_less_error() {
        let cost_m =
            [1.0, 3.0, 10.0, 30.0].map(|rate_hz| forecast(rate_hz).cost_m(&SHAPE, approach(40.0)));
        assert!(cost_m.is_sorted_by(|a, b| a > b), "{cost_m:?}");
        assert!(cost_m[2] < 0.15, "{cost_m:?}");
    }

    #[test]
    fn a_path_that_is_too_short_costs() {
        let forecast = forecast(10.0);
        assert!(
            forecast.cost_m(&SHAPE, approach(5.0)) > 1.5 * forecast.cost_m(&SHAPE, approach(40.0))
        );
    }
}
