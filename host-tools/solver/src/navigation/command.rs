//! What a navigator asks of the autopilot.

use nalgebra::Vector3;

/// How to move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Stay where it is: nothing is known yet.
    Hold,
    /// Fly straight to the waypoint at cruise speed and say when it is reached.
    Fly,
    /// Go down over the waypoint until the ground is felt, correcting sideways on the way.
    Land,
}

/// Error of dead reckoning as the navigator estimates it: subtract it from the reckoned position to
/// get the vehicle's place in the navigation frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InsError {
    /// When it had this size, seconds.
    pub t_s: f64,
    /// Reckoned minus true position, metres.
    pub position_m: Vector3<f64>,
    /// How fast that grows, m/s.
    pub velocity_m_s: Vector3<f64>,
}

impl InsError {
    /// No error.
    pub fn none() -> Self {
        Self {
            t_s: 0.0,
            position_m: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
        }
    }

    /// Its size at another time nearby.
    pub fn at(&self, t_s: f64) -> Vector3<f64> {
        self.position_m + self.velocity_m_s * (t_s - self.t_s)
    }
}

/// The present order to the autopilot. It stays in force until another takes its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Grows with every new waypoint, so that news of arrival can be matched.
    pub id: u32,
    /// How to move.
    pub action: Action,
    /// Where to, navigation frame, metres.
    pub waypoint_m: Vector3<f64>,
    /// Estimated error of dead reckoning. An autopilot that flies on dead reckoning steers by
    /// `reckoned - ins_error`.
    pub ins_error: InsError,
}
