//! Paths flown at constant speed.

use nalgebra::Vector3;
use std::f64::consts::PI;

/// An S: two half circles one after the other, turning against each other,
/// flown at constant speed while the height changes evenly.
///
/// ```text
///              ___
///            /     \          north
///           |       |           ▲
///  start ───┘   ·   |   ·   ┌── end
///                   |       |   └──► east
///                    \ ___ /
/// ```
///
/// The turns tell on which side of the path a node lies, the change in height
/// whether it lies below or above: a straight or level path leaves a mirror
/// image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SCurve {
    shape: SCurveShape,
    length_m: f64,
}

/// Measures of an [`SCurve`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SCurveShape {
    /// Where it starts, ENU in metres.
    pub start_m: Vector3<f64>,
    /// Radius of either half circle in metres.
    pub radius_m: f64,
    /// Height at the end minus height at the start, in metres.
    pub climb_m: f64,
    /// Speed along the path in m/s.
    pub speed_m_per_s: f64,
}

impl SCurve {
    /// The path of this shape.
    pub fn new(shape: SCurveShape) -> Self {
        let horizontal_m = 2.0 * PI * shape.radius_m;
        Self {
            shape,
            length_m: horizontal_m.hypot(shape.climb_m),
        }
    }

    /// Length in metres.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// How long the flight takes, in seconds.
    pub fn duration_s(&self) -> f64 {
        self.length_m / self.shape.speed_m_per_s
    }

    /// Where the vehicle is `t_s` after the start; it waits at both ends.
    pub fn position_m(&self, t_s: f64) -> Vector3<f64> {
        let SCurveShape {
            start_m,
            radius_m,
            climb_m,
            ..
        } = self.shape;
        let done = (t_s / self.duration_s()).clamp(0.0, 1.0);
        // Half circles of angle pi each: the first over the top, the second below.
        let angle = 2.0 * PI * done;
        let (east, north) = if angle <= PI {
            (radius_m * (1.0 - angle.cos()), radius_m * angle.sin())
        } else {
            (radius_m * (3.0 + angle.cos()), radius_m * angle.sin())
        };
        start_m + Vector3::new(east, north, climb_m * done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn s(radius_m: f64, climb_m: f64, speed_m_per_s: f64) -> SCurve {
        SCurve::new(SCurveShape {
            start_m: Vector3::new(-1.0, 2.0, 3.0),
            radius_m,
            climb_m,
            speed_m_per_s,
        })
    }

    #[test]
    fn it_ends_four_radii_east_at_the_new_height() {
        let path = s(5.0, 4.0, 2.0);
        let end = path.position_m(path.duration_s());
        assert!((end - Vector3::new(19.0, 2.0, 7.0)).norm() < 1e-9);
    }

    proptest! {
        #[test]
        fn the_speed_is_the_same_everywhere(
            radius in 0.5..50.0f64, climb in -20.0..20.0f64, speed in 0.1..20.0f64, at in 0.0..0.99f64,
        ) {
            let path = s(radius, climb, speed);
            let t = at * path.duration_s();
            let dt = path.duration_s() * 1e-5;
            let travelled = (path.position_m(t + dt) - path.position_m(t)).norm();
            prop_assert!((travelled / dt / speed - 1.0).abs() < 1e-3);
        }
    }
}
