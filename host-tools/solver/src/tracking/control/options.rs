//! What a standoff controller may do, and how it weighs.

use crate::error::SolveError;

/// How a controller guards the distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Guard {
    /// Not at all: the reference within the vehicle's limits. The paper's "CLF-only".
    None,
    /// Barriers at the bounds themselves, believing the estimate. The paper's "fixed CLF-CBF".
    Fixed,
    /// Barriers tightened by the confidence radius and a dead zone of as much. The paper's
    /// "CA-CLF-CBF".
    Covariance,
    /// As `Covariance`, and the barriers hold between samples too: what they demand is demanded over
    /// the whole time that a command stands.
    Sampled,
}

/// Options of a [`StandoffController`](super::StandoffController). SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandoffOptions {
    /// The distance wanted, `d*`.
    pub standoff_m: f64,
    /// The least allowed.
    pub least_m: f64,
    /// The greatest allowed.
    pub most_m: f64,
    /// Gains of distance and radial speed, `k_r` and `k_vr` of eq. 36.
    pub radial: [f64; 2],
    /// Gains of height and vertical speed, `k_z` and `k_vz`.
    pub vertical: [f64; 2],
    /// Gain of the speed across the line of sight, `k_tau`.
    pub tangential: f64,
    /// Rate of the barriers, `omega` of eq. 39, 1/s.
    pub barrier_rate: f64,
    /// The most the target is believed to accelerate, `a_max` of eq. 5.
    pub target_acceleration: f64,
    /// The most the vehicle may accelerate along each axis, eq. 44.
    pub acceleration: f64,
    /// The most it may move along each axis, eq. 45.
    pub speed: f64,
    /// Risk `alpha` that the confidence radius is too small, eq. 29.
    pub risk: f64,
    /// How long a command stands, seconds.
    pub step_s: f64,
}

impl Default for StandoffOptions {
    fn default() -> Self {
        Self {
            standoff_m: 2.5,
            least_m: 1.5,
            most_m: 4.0,
            radial: [1.0, 1.6],
            vertical: [1.0, 1.6],
            tangential: 0.8,
            barrier_rate: 2.5,
            target_acceleration: 1.5,
            acceleration: 4.0,
            speed: 4.0,
            risk: 0.05,
            step_s: 0.05,
        }
    }
}

impl StandoffOptions {
    pub(super) fn check(&self) -> Result<(), SolveError> {
        let bad = |name, why| Err(SolveError::BadOption { name, why });
        let positive = [
            ("standoff_m", self.standoff_m),
            ("least_m", self.least_m),
            ("most_m", self.most_m),
            ("barrier_rate", self.barrier_rate),
            ("acceleration", self.acceleration),
            ("speed", self.speed),
            ("step_s", self.step_s),
        ];
        for (name, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return bad(name, "not a positive finite number");
            }
        }
        let gains = [self.radial, self.vertical, [self.tangential, 0.0]];
        if gains
            .iter()
            .flatten()
            .any(|g| !(g.is_finite() && *g >= 0.0))
        {
            return bad("a gain", "negative or not finite");
        }
        if !(self.target_acceleration.is_finite() && self.target_acceleration >= 0.0) {
            return bad("target_acceleration", "negative or not finite");
        }
        if !(self.risk > 0.0 && self.risk < 1.0) {
            return bad("risk", "not between 0 and 1");
        }
        if !(self.least_m < self.standoff_m && self.standoff_m < self.most_m) {
            return bad("standoff_m", "not between least_m and most_m");
        }
        Ok(())
    }
}
