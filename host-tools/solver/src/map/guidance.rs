//! Where to fly, given where the tag is believed to be.
//!
//! ```text
//!   start ●
//!          \        1. glide: down a slope to the gate, bent sideways, because a
//!           \          straight path leaves a ring of places for the tag
//!            `.
//!   gate  - -  ( o )  2. helix: round the tag and down; every side of it is seen,
//!              ( o )     from low down, where the horizontal part of a range is large
//!                v    3. landing: to a point above the tag, then straight down
//!   ground  ─────●───
//! ```
//!
//! The whole is one field of directions about the tag, asked anew after every range, so there are no
//! legs to finish and no decisions to regret.

use nalgebra::{Matrix3, Vector2, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Shape of the flight about the tag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    /// Height of the gate, where glide becomes helix, metres.
    pub(super) gate_m: f64,
    /// Radius of the helix, metres.
    pub(super) radius_m: f64,
    /// +1: the tag is on the left of a flight round it.
    pub(super) side: f64,
}

/// Heading offset of the glide, radians, and the distance within which it fades, metres.
const BEND: f64 = 0.4;
const BEND_FADES_M: f64 = 6.0;
/// Height at which the helix ends and the vehicle goes to a point above the tag, metres.
pub(super) const CENTRE_BELOW_M: f64 = 1.2;
/// That point, from the tag, metres.
const ABOVE_M: Vector3<f64> = Vector3::new(0.0, 0.0, 0.6);
/// Distance from it at which landing begins, metres.
const CENTRED_M: f64 = 0.08;
/// Height below which there is nothing left to do but to land, metres.
const GROUNDED_M: f64 = 0.1;
/// How far ahead of the vehicle the waypoint lies, metres.
pub(super) const AHEAD_M: f64 = 3.0;
/// Steepest and flattest descent of the helix: sine of the angle.
const STEEPEST: f64 = 0.97;
const FLATTEST: f64 = 0.12;
/// Exploration: swing of the heading to either side, radians, and its period, seconds.
const EXPLORE_SWING: f64 = 1.3;
const EXPLORE_PERIOD_S: f64 = 20.0;
/// Sine of the descent while far from the tag, and what is far, metres.
const SINK: f64 = 0.6;
const FAR_M: f64 = 8.0;
/// Horizontal sigma that is good enough to go on down, as a part of the height.
const SURE_SHARE: f64 = 0.25;
/// Path allowed for closing the horizontal distance, as a multiple of it.
const REACH: f64 = 1.3;

/// A flight about the tag as it stands.
#[derive(Debug, Clone, Copy)]
pub(super) struct Approach {
    /// From tag to vehicle, metres.
    pub(super) offset_m: Vector3<f64>,
    /// How well that is known horizontally: largest standard deviation, metres.
    pub(super) sigma_m: f64,
    /// What may still be flown, metres.
    pub(super) path_left_m: f64,
    /// How much deeper it may go even if the tag is not where it seems to be, metres: far from the tag
    /// that is used, because going below a phantom disproves it.
    pub(super) spare_m: f64,
    /// Whether it is on its last way down.
    pub(super) landing: bool,
}

impl Approach {
    /// Whether it is time to land.
    pub(super) fn may_land(&self) -> bool {
        self.landing || (self.offset_m - ABOVE_M).norm() < CENTRED_M || self.offset_m.z < GROUNDED_M
    }

    /// Where to go next, from the tag, metres.
    pub(super) fn waypoint_m(&self, shape: &Shape) -> Vector3<f64> {
        if self.landing {
            Vector3::zeros()
        } else if self.offset_m.z < CENTRE_BELOW_M {
            ABOVE_M
        } else {
            self.offset_m + direction(self, shape) * AHEAD_M
        }
    }
}

/// Largest horizontal standard deviation of a covariance.
pub(super) fn horizontal_sigma_m(covariance: &Matrix3<f64>) -> f64 {
    let (xx, xy, yy) = (covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]);
    let largest = 0.5 * (xx + yy) + (0.5 * (xx - yy)).hypot(xy);
    largest.max(0.0).sqrt()
}

/// Direction to fly, a unit vector.
fn direction(approach: &Approach, shape: &Shape) -> Vector3<f64> {
    let &Approach {
        offset_m,
        sigma_m,
        path_left_m,
        spare_m,
        ..
    } = approach;
    let inward = -offset_m.xy();
    let distance = inward.norm();
    let height = offset_m.z;
    let radius = shape.radius_m;

    // A circle is approached along a direction that turns from inward (far away) to sideways (on
    // the circle) to outward (inside it).
    let circle = FRAC_PI_2 - ((distance - radius) / radius).atan();
    let bend = BEND * (distance / BEND_FADES_M).min(1.0);
    let gliding = height > shape.gate_m;
    let angle = if gliding { circle.max(bend) } else { circle };
    let horizontal = rotated(inward, distance, -shape.side * angle);

    let sine = if gliding {
        // Straight down the slope to the rim of the helix.
        let ahead = (distance - radius).max(0.0) / bend.cos();
        let drop = height - shape.gate_m;
        drop / drop.hypot(ahead).max(1e-9)
    } else {
        // Evenly over what may still be flown, but not before the tag's place is known well enough
        // for this height, and never past it.
        let even = height.max(0.0) / path_left_m.max(1e-3);
        let sure = (SURE_SHARE * height.max(0.0) / sigma_m.max(1e-3)).powi(2);
        let reaches = height.max(0.0) / height.hypot(REACH * distance).max(1e-9);
        even.min(sure).min(reaches)
    };
    let flattest = if spare_m > 0.0 && distance > FAR_M {
        SINK
    } else {
        FLATTEST
    };
    let sine = sine.clamp(flattest, STEEPEST);
    let cosine = (1.0 - sine * sine).sqrt();
    Vector3::new(cosine * horizontal.x, cosine * horizontal.y, -sine)
}

/// Direction to fly while nobody knows where the tag is: toward where it was said to be, winding
/// to both sides and down, so that no plane holds the path.
pub(super) fn exploration(toward_m: Vector3<f64>, since_s: f64, spare_m: f64) -> Vector3<f64> {
    let horizontal = toward_m.xy();
    let angle = EXPLORE_SWING * (TAU * since_s / EXPLORE_PERIOD_S).cos();
    let horizontal = rotated(horizontal, horizontal.norm(), angle);
    let sine = if spare_m > 0.0 { SINK } else { 0.0 };
    let cosine = (1.0 - sine * sine).sqrt();
    Vector3::new(cosine * horizontal.x, cosine * horizontal.y, -sine)
}

fn rotated(inward: Vector2<f64>, distance: f64, angle: f64) -> Vector2<f64> {
    if distance < 1e-9 {
        return Vector2::x();
    }
    let (sine, cosine) = angle.sin_cos();
    let u = inward / distance;
    Vector2::new(cosine * u.x - sine * u.y, sine * u.x + cosine * u.y)
}
