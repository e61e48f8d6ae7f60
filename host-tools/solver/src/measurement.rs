//! What a range measurement is, and when one is fit for use.

use nalgebra::Vector3;

/// Largest magnitude accepted for a coordinate, a range or a standard deviation, in metres.
///
/// It is far beyond a 40-bit device clock that wrapped once (5.2e9 m), so a wild range still passes
/// as an outlier for the robust kernel to deal with, yet squares and sums of it stay finite in
/// `f64`.
pub const LARGEST_LENGTH_M: f64 = 1e12;

/// The distance between a node of unknown position and a place that was known at that moment.
///
/// `range_m` is signed: two boards side by side with 10 cm of noise measure -5 cm now and then, and
/// cutting that at zero would bias every mean. A range that is far below zero is not an error
/// either, but an outlier.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeMeasurement {
    /// Time in seconds on any common clock. Only the order and the spacing matter.
    pub t_s: f64,
    /// Where the measuring node was, local ENU frame, metres.
    pub position_m: Vector3<f64>,
    /// Measured distance in metres.
    pub range_m: f64,
    /// Standard deviation of `range_m` in metres; see [`Noise`](crate::multilateration::Noise) for
    /// how far it is believed.
    pub sigma_m: f64,
}

/// Why a single measurement cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MeasurementFault {
    /// The time is NaN or infinite.
    #[error("the time is not a finite number")]
    Time,
    /// A coordinate is NaN, infinite or beyond [`LARGEST_LENGTH_M`].
    #[error("the position is not finite or absurdly large")]
    Position,
    /// The range is NaN, infinite or beyond [`LARGEST_LENGTH_M`].
    #[error("the range is not finite or absurdly large")]
    Range,
    /// The standard deviation is NaN, infinite, zero or negative.
    #[error("the standard deviation is not a positive finite number")]
    Sigma,
}

impl RangeMeasurement {
    /// Checks that all numbers are finite and that the standard deviation is positive.
    ///
    /// # Errors
    /// The first [`MeasurementFault`] found.
    pub fn validate(&self) -> Result<(), MeasurementFault> {
        // Written so that NaN, for which every comparison is false, fails the test.
        let usable = |length: f64| length.abs() <= LARGEST_LENGTH_M;
        if !self.t_s.is_finite() {
            Err(MeasurementFault::Time)
        } else if !self.position_m.iter().copied().all(usable) {
            Err(MeasurementFault::Position)
        } else if !usable(self.range_m) {
            Err(MeasurementFault::Range)
        } else if !(self.sigma_m > 0.0 && usable(self.sigma_m)) {
            Err(MeasurementFault::Sigma)
        } else {
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measurement() -> RangeMeasurement {
        RangeMeasurement {
            t_s: 1.0,
            position_m: Vector3::new(1.0, 2.0, 3.0),
            range_m: 4.0,
            sigma_m: 0.1,
        }
    }

    #[test]
    fn negative_range_from_noise_is_legal() {
        let m = RangeMeasurement {
            range_m: -0.05,
            ..measurement()
        };
        assert_eq!(m.validate(), Ok(()));
    }

    #[test]
    fn every_field_is_checked_for_nan_and_infinity() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let with = |f: &dyn Fn(&mut RangeMeasurement)| {
                let mut m = measurement();
                f(&mut m);
                m.validate()
            };
            assert_eq!(with(&|m| m.t_s = bad), Err(MeasurementFault::Time));
            assert_eq!(
                with(&|m| m.position_m.y = bad),
                Err(MeasurementFault::Position)
            );
            assert_eq!(with(&|m| m.range_m = bad), Err(MeasurementFault::Range));
            assert_eq!(with(&|m| m.sigma_m = bad), Err(MeasurementFault::Sigma));
        }
    }

    #[test]
    fn sigma_must_be_positive() {
        for bad in [0.0, -0.1] {
            let m = RangeMeasurement {
                sigma_m: bad,
                ..measurement()
            };
            assert_eq!(m.validate(), Err(MeasurementFault::Sigma));
        }
    }
}
