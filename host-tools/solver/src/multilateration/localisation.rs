//! The answer of [`multilaterate`](super::multilaterate).

use nalgebra::{Matrix3, Vector3};

use crate::observability::Observability;

/// How one measurement fared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Measured range minus the range predicted by the solution (bias included), metres.
    pub residual_m: f64,
    /// False where it was set aside as an outlier.
    pub used: bool,
}

/// Another place that explains the measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alternative {
    /// Where, metres.
    pub position_m: Vector3<f64>,
    /// Covariance of that place, given that it is the right one, square metres.
    pub covariance_m2: Matrix3<f64>,
    /// Probability against the reported solution, at most one half.
    pub probability: f64,
}

/// Where the node is, and how sure that is.
#[derive(Debug, Clone, PartialEq)]
pub struct Localisation {
    /// The best position, metres.
    pub position_m: Vector3<f64>,
    /// Covariance in square metres, widened by everything the geometry leaves open.
    pub covariance_m2: Matrix3<f64>,
    /// Covariance of the position given that it is the right one of several; for drawing an ellipse
    /// about each.
    pub local_covariance_m2: Matrix3<f64>,
    /// Square roots of the diagonal of `covariance_m2`, metres.
    pub sigma_m: Vector3<f64>,
    /// Range bias: the known or the estimated one, metres.
    pub range_bias_m: f64,
    /// Its standard deviation, metres; zero where it was given.
    pub range_bias_sigma_m: f64,
    /// Covariance of the position's coordinates with the bias, square metres; zero where it was given.
    pub position_bias_m2: Vector3<f64>,
    /// Root mean square of the used residuals, metres.
    pub residual_rms_m: f64,
    /// Measurements used.
    pub used: usize,
    /// Measurements set aside as outliers.
    pub rejected: usize,
    /// How many independent measurements the used ones are worth, given how their residuals hang
    /// together in time.
    pub effective_measurements: f64,
    /// One entry a measurement, in the order given.
    pub residuals: Vec<Residual>,
    /// The competing place, where the measurements do not exclude it.
    pub alternative: Option<Alternative>,
    /// What the geometry can tell.
    pub observability: Observability,
    /// Largest over smallest variance of the free coordinates, bias eliminated: the condition of
    /// the problem. Infinite where a direction is not measured at all.
    pub condition: f64,
}

impl Localisation {
    /// True where the measurements single out one place.
    pub fn observable(&self) -> bool {
        self.observability.is_unique()
    }
}
