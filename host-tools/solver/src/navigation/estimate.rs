//! What a navigator believes, and how far it should be believed.

use nalgebra::{Matrix3, Vector3};

/// Part of the flight (paper Fig. 6).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// First measurements, exploratory flight.
    Initial,
    /// Approach with repeated estimation.
    MidFlight,
    /// Descent.
    Final,
    /// Nothing more to decide: going down to the ground.
    Landing,
}

/// Reasons not to lean on an estimate.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Doubts {
    /// Measurements so far leave a direction nearly unmeasured.
    pub weak_geometry: bool,
    /// A second place explains the measurements nearly as well.
    pub ambiguous: bool,
    /// Ranges or dead reckoning were missing for more than two seconds during the last ten.
    pub gap: bool,
    /// Dead reckoning has repeated itself to the last digit for more than two seconds.
    pub frozen_ins: bool,
}

impl Doubts {
    /// Whether there are any.
    pub fn any(&self) -> bool {
        self.weak_geometry || self.ambiguous || self.gap || self.frozen_ins
    }
}

/// Where the tag and the vehicle are, navigation frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Time of the last measurement used, seconds.
    pub t_s: f64,
    /// The tag, metres.
    pub tag_m: Vector3<f64>,
    /// The vehicle at `t_s`, metres.
    pub vehicle_m: Vector3<f64>,
    /// Covariance of `tag_m - vehicle_m`, m^2; `None` from methods that have no notion of it.
    pub relative_covariance_m2: Option<Matrix3<f64>>,
    /// The competing place of the tag, where there is or was one to choose from.
    pub alternative_m: Option<Vector3<f64>>,
    /// Estimated constant part of the range error, metres.
    pub range_bias_m: Option<f64>,
    /// Estimated standard deviation of a range here, metres.
    pub range_sigma_m: Option<f64>,
    /// What speaks against it.
    pub doubts: Doubts,
}

/// Standard deviation along the worst horizontal direction (m), of a covariance of a place (m^2). NaN where that has none, so that
/// no limit is kept.
pub fn horizontal_sigma_m(covariance_m2: &Matrix3<f64>) -> f64 {
    let horizontal = covariance_m2.fixed_view::<2, 2>(0, 0).into_owned();
    horizontal.symmetric_eigenvalues().max().sqrt()
}
