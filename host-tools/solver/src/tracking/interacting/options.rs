//! What interacting models take for likely.

use crate::error::SolveError;

/// Options of an [`InteractingTracker`](super::InteractingTracker). SI units, angles in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InteractingOptions {
    /// White acceleration of a target that walks on, m^2/s^3.
    pub steady_density: f64,
    /// Of one that does anything.
    pub anything_density: f64,
    /// Of one that brakes or turns, beside that.
    pub changing_density: f64,
    /// Time in which one that brakes loses all but a third of its speed.
    pub braking_s: f64,
    /// How fast one turns that turns.
    pub turn_rad_s: f64,
    /// How long one walks on, on average.
    pub steady_s: f64,
    /// How long anything else lasts.
    pub changing_s: f64,
    /// Part of bearings that are outliers, each by itself.
    pub outliers: f64,
    /// Their noise.
    pub outlier_sigma_rad: f64,
    /// Time between two times of blocked sight, on average.
    pub blocked_every_s: f64,
    /// How long each lasts.
    pub blocked_for_s: f64,
    /// Noise of bearings in them.
    pub blocked_sigma_rad: f64,
    /// How much ranges are longer in them.
    pub late_m: f64,
    /// The longest time without a sighting that is bridged.
    pub longest_gap_s: f64,
}

impl Default for InteractingOptions {
    fn default() -> Self {
        Self {
            steady_density: 0.03,
            anything_density: 2.0,
            changing_density: 0.3,
            braking_s: 1.0,
            turn_rad_s: 0.7,
            steady_s: 4.0,
            changing_s: 1.0,
            outliers: 0.1,
            outlier_sigma_rad: 0.5,
            blocked_every_s: 20.0,
            blocked_for_s: 1.0,
            blocked_sigma_rad: 0.6,
            late_m: 0.5,
            longest_gap_s: 5.0,
        }
    }
}

impl InteractingOptions {
    pub(super) fn check(&self) -> Result<(), SolveError> {
        let bad = |name, why| Err(SolveError::BadOption { name, why });
        for (name, value) in [
            ("steady_density", self.steady_density),
            ("anything_density", self.anything_density),
            ("changing_density", self.changing_density),
            ("braking_s", self.braking_s),
            ("turn_rad_s", self.turn_rad_s),
            ("steady_s", self.steady_s),
            ("changing_s", self.changing_s),
            ("outlier_sigma_rad", self.outlier_sigma_rad),
            ("blocked_every_s", self.blocked_every_s),
            ("blocked_for_s", self.blocked_for_s),
            ("blocked_sigma_rad", self.blocked_sigma_rad),
            ("late_m", self.late_m),
            ("longest_gap_s", self.longest_gap_s),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return bad(name, "not a positive finite number");
            }
        }
        if !(self.outliers > 0.0 && self.outliers < 1.0) {
            return bad("outliers", "not between 0 and 1");
        }
        Ok(())
    }
}
