//! Walls that the vehicle keeps away from, as further barriers (eq. 39 with the distance to a wall).
//!
//! ```text
//! h = |p - q| - clearance        q: the point of the wall nearest to the vehicle, n from q to p
//! n'u + 2 w n'v + w^2 h >= 0     at the sample, and at the end of the step:
//! n'u g(s) + 2 w n'v + w^2 (h + s n'v) >= 0,      g(s) = 1 + 2 w s + w^2 s^2 / 2
//! ```
//!
//! Walls stand still, so that all terms are known; where the end of a wall is nearest `h` also bends
//! away, `|v_t|^2 / d`, which is left out (it helps).

use nalgebra::{Vector2, Vector3};

use super::options::StandoffOptions;
use super::program::{AccelerationBox, HalfSpace};
use super::relative::VehicleState;

/// A wall as tall as anything, from one end to the other, seen from above; metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// One end, x and y.
    pub from_m: [f64; 2],
    /// The other.
    pub to_m: [f64; 2],
}

impl Wall {
    /// From the nearest point of the wall to a place, horizontally.
    pub fn away_m(&self, place_m: &Vector3<f64>) -> Vector2<f64> {
        let from = Vector2::from(self.from_m);
        let along = Vector2::from(self.to_m) - from;
        let offset = place_m.xy() - from;
        let square = along.norm_squared();
        let part = if square > 0.0 {
            (offset.dot(&along) / square).clamp(0.0, 1.0)
        } else {
            0.0
        };
        offset - along * part
    }

    pub(super) fn is_finite(&self) -> bool {
        self.from_m.iter().chain(&self.to_m).all(|c| c.is_finite())
    }
}

/// What a wall leaves of the accelerations in the box; `None` if all, or right on it, where no
/// direction leads away.
pub(super) fn limit(
    o: &StandoffOptions,
    wall: &Wall,
    clearance_m: f64,
    vehicle: &VehicleState,
    limits: &AccelerationBox,
) -> Option<HalfSpace> {
    let away = wall.away_m(&vehicle.position_m);
    let distance = away.norm();
    let n = away.try_normalize(1e-6)?;
    let normal = Vector3::new(-n.x, -n.y, 0.0);
    let (w, s) = (o.barrier_rate, o.step_s);
    let speed = -normal.dot(&vehicle.velocity_m_s);
    let now = 2.0 * w * speed + w * w * (distance - clearance_m);
    let g = 1.0 + 2.0 * w * s + 0.5 * w * w * s * s;
    let most = now.min((now + w * w * s * speed) / g);
    let reach = normal.dot(&limits.farthest(&normal, &Vector3::zeros()));
    (most < reach).then_some(HalfSpace { normal, most })
}
