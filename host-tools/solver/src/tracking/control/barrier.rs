//! Bounds on the acceleration along the line of sight that keep the distance within its bounds
//! (eq. 37-42), at the sample and, if asked for, until the next.
//!
//! With `c = -a_max - n'u` the worst rate of change of the radial speed near the target:
//!
//! ```text
//! at the sample      c + |v_t|^2 / d + 2 w v_r + w^2 h >= 0                                (eq. 41)
//! a time s later     g(s) (c - turn) + least |v_t|^2 / d + 2 w v_r + w^2 (h + s v_r) >= 0
//! g(s) = 1 + 2 w s + w^2 s^2 / 2
//! ```
//!
//! The second line follows from the first by integrating `v_r` and `h` over `s` under a constant
//! command: `turn` is what the line of sight may turn by until then, times the greatest command, and
//! `|v_t|^2 / d` is taken at the least it can become (for the far bound, the greatest). Its quotient
//! by `g` has its least value at one end of the step where the rest is positive.

use super::options::StandoffOptions;
use super::relative::Relative;

/// What `n'u` must stay within; the second above the first where both bounds cannot be kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Along {
    /// At least, for the far bound.
    pub(super) least: f64,
    /// At most, for the near bound.
    pub(super) most: f64,
}

/// At the sample alone.
pub(super) fn at_the_sample(o: &StandoffOptions, seen: &Relative, radius_m: f64) -> Along {
    let w = o.barrier_rate;
    let (near, far) = headroom(o, seen, radius_m);
    let bend = seen.tangential.norm_squared() / seen.distance_m;
    Along {
        most: -o.target_acceleration + bend + 2.0 * w * seen.radial + w * w * near,
        least: o.target_acceleration + bend + 2.0 * w * seen.radial - w * w * far,
    }
}

/// From the sample until the next.
pub(super) fn over_the_step(o: &StandoffOptions, seen: &Relative, radius_m: f64) -> Along {
    let (w, s) = (o.barrier_rate, o.step_s);
    let (near, far) = headroom(o, seen, radius_m);
    let greatest = 3.0_f64.sqrt() * o.acceleration;
    let gained = (o.target_acceleration + greatest) * s;
    let across = seen.tangential.norm();
    let nearest = (seen.distance_m - (seen.radial.abs() + gained) * s).max(1e-3);
    let farthest = seen.distance_m + (seen.radial.abs() + gained) * s;
    let turn = ((across + gained) * s / nearest).min(2.0) * greatest;
    let least_bend = (across - gained).max(0.0).powi(2) / farthest;
    let most_bend = (across + gained).powi(2) / nearest;
    let g = 1.0 + 2.0 * w * s + 0.5 * w * w * s * s;
    // The least of a linear function over g, between 0 and s.
    let least = |now: f64, then: f64| {
        let lower = now.min(then);
        if lower >= 0.0 {
            now.min(then / g)
        } else {
            lower
        }
    };
    let approach = least_bend + 2.0 * w * seen.radial + w * w * near;
    let retreat = -2.0 * w * seen.radial + w * w * far;
    let drift = w * w * s * seen.radial;
    Along {
        most: -o.target_acceleration - turn + least(approach, approach + drift),
        least: o.target_acceleration + turn + most_bend - least(retreat, retreat - drift),
    }
}

/// `h` of both bounds (eq. 37, 38).
fn headroom(o: &StandoffOptions, seen: &Relative, radius_m: f64) -> (f64, f64) {
    (
        seen.distance_m - o.least_m - radius_m,
        o.most_m - radius_m - seen.distance_m,
    )
}
