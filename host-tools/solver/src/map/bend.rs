//! How the sphere about the tag bends a range within a Gaussian.
//!
//! At the distance `d` along `u` the distance has the curvature `C = (I - u u^T) / d`. A straight line
//! through the mean of a Gaussian with covariance `P` leaves out a mean of `tr(C P) / 2` and a variance of
//! `tr((C P)^2) / 2` (second-order filter of Athans, Wishner and Bertolini 1968).

use nalgebra::{Matrix3, Vector3};

/// Distances below this bend no more than at it, metres.
const LEAST_DISTANCE_M: f64 = 0.05;
/// Multiplications that find the direction: which of two alike is of no matter.
const TURNS: usize = 4;

/// A Gaussian as seen across the line of sight: `C P (I - u u^T)`, metres.
pub(super) struct Bend(Matrix3<f64>);

impl Bend {
    /// Of the covariance of the way to the tag, seen along the unit vector `u` at `distance_m`.
    pub(super) fn new(covariance_m2: &Matrix3<f64>, u: &Vector3<f64>, distance_m: f64) -> Self {
        let across = Matrix3::identity() - u * u.transpose();
        Self(across * covariance_m2 * across / distance_m.max(LEAST_DISTANCE_M))
    }

    /// Variance that a straight line leaves out, m^2.
    pub(super) fn variance_m2(&self) -> f64 {
        0.5 * self.0.norm_squared()
    }

    /// By which the mean of the range lies above the range of the mean, metres.
    pub(super) fn lift_m(&self) -> f64 {
        0.5 * self.0.trace()
    }

    /// Along which it bends most, a unit vector.
    pub(super) fn direction(&self) -> Vector3<f64> {
        let mut direction = self.0.column(self.0.diagonal().imax()).into_owned();
        for _ in 0..TURNS {
            direction = (self.0 * direction).try_normalize(0.0).unwrap_or(direction);
        }
        direction
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_that_of_a_sphere() {
        // Across the line of sight, 0.3 m at a distance of 2 m: y^2 / (2 d) with y normal.
        let mut covariance = Matrix3::zeros();
        covariance[(1, 1)] = 0.09;
        let bend = Bend::new(&covariance, &Vector3::x(), 2.0);
        assert!((bend.variance_m2() - 0.5 * (0.09 / 2.0_f64).powi(2)).abs() < 1e-12);
        assert!((bend.lift_m() - 0.5 * 0.09 / 2.0).abs() < 1e-12);
        assert!((bend.direction().y.abs() - 1.0).abs() < 1e-12);
        let along = Bend::new(&covariance, &Vector3::y(), 2.0);
        assert_eq!((along.variance_m2(), along.lift_m()), (0.0, 0.0));
    }
}
