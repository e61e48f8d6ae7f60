//! The paper's inertial frame, from geodetic start and goal (Sec. 4.1).

use super::path::PathFault;
use crate::geodesy::{Geodetic, LocalFrame};
use nalgebra::{Rotation3, Vector3};

/// Origin at the goal, x horizontal and pointing from the start to the goal, z up.
#[derive(Debug, Clone)]
pub struct DeliveryFrame {
    goal: LocalFrame,
    enu_from_frame: Rotation3<f64>,
    separation_m: f64,
}

impl DeliveryFrame {
    /// The frame of a delivery between two places.
    ///
    /// # Errors
    /// [`PathFault::TooClose`] where they are at one place on the map, which leaves no direction.
    pub fn between(start: &Geodetic, goal: &Geodetic) -> Result<Self, PathFault> {
        let local = LocalFrame::at(*goal);
        let start_m = local.enu_of(start);
        let separation_m = start_m.xy().norm();
        // NaN fails the comparison.
        if separation_m > 1e-3 {
            // From the start, seen from the goal, the way is back along the vector to it.
            let heading = (-start_m.y).atan2(-start_m.x);
            Ok(Self {
                goal: local,
                enu_from_frame: Rotation3::from_axis_angle(&Vector3::z_axis(), heading),
                separation_m,
            })
        } else {
            Err(PathFault::TooClose { separation_m })
        }
    }

    /// Horizontal distance between start and goal, the paper's d, metres.
    pub fn separation_m(&self) -> f64 {
        self.separation_m
    }

    /// A geodetic place in this frame, metres.
    pub fn place(&self, place: &Geodetic) -> Vector3<f64> {
        self.enu_from_frame.inverse() * self.goal.enu_of(place)
    }

    /// An east-north-up vector along this frame's axes.
    pub fn along_axes(&self, enu: &Vector3<f64>) -> Vector3<f64> {
        self.enu_from_frame.inverse() * enu
    }

    /// A vector of this frame as east-north-up.
    pub fn to_enu(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.enu_from_frame * vector
    }
}
