//! A belief of position and velocity, improved by something that is told about the position alone.

use nalgebra::{Matrix3, RowVector3, Vector3};

use super::factors::Quadratic;
use super::motion::Belief;

/// What an update was made of, for the way back through the chain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Told {
    /// `N = (J^-1 + P)^-1`: information of the innovation, `J` being what was told and `P` the
    /// covariance of the position before.
    pub(crate) information: Matrix3<f64>,
    /// `(I + J P)^-1 z`: the innovation, weighted.
    pub(crate) innovation: Vector3<f64>,
}

impl Told {
    pub(crate) const NOTHING: Self = Self {
        information: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        innovation: Vector3::new(0.0, 0.0, 0.0),
    };
}

/// Kalman's update in the form that takes information: it needs no inverse of it, so that a range
/// alone, or nothing at all, is no special case. `None` where numbers leave the finite.
///
/// ```text
/// z  = pull - J (p - p0)        M = (I + J P)^-1        N = M J
/// m' = m + S E' M z             S' = S - S E' N E S      E takes the position out of the state
/// ```
#[inline]
pub(crate) fn update(
    before: &Belief,
    quadratic: &Quadratic,
    at: &Vector3<f64>,
) -> Option<(Belief, Told)> {
    let j = &quadratic.information;
    let z = quadratic.pull - j * (before.position_m - at);
    let m = (Matrix3::identity() + j * before.pp).try_inverse()?;
    let n = symmetric(m * j);
    let innovation = m * z;
    let vp = before.pv.transpose();
    let to_velocity = vp * n;
    let after = Belief {
        position_m: before.position_m + before.pp * innovation,
        velocity_m_s: before.velocity_m_s + vp * innovation,
        pp: symmetric(before.pp - before.pp * n * before.pp),
        pv: before.pv - before.pp * n * before.pv,
        vv: symmetric(before.vv - to_velocity * before.pv),
    };
    let told = Told {
        information: n,
        innovation,
    };
    after.is_sound().then_some((after, told))
}

/// Kalman's update by one number: `residual = measured - predicted`, its slope along the position and
/// its variance.
pub(crate) fn scalar_update(
    belief: &Belief,
    residual: f64,
    slope: &RowVector3<f64>,
    variance: f64,
) -> Belief {
    let to_position = belief.pp * slope.transpose();
    let to_velocity = belief.pv.transpose() * slope.transpose();
    let innovation = (slope * to_position).x + variance;
    let gain = residual / innovation;
    Belief {
        position_m: belief.position_m + to_position * gain,
        velocity_m_s: belief.velocity_m_s + to_velocity * gain,
        pp: belief.pp - to_position * to_position.transpose() / innovation,
        pv: belief.pv - to_position * to_velocity.transpose() / innovation,
        vv: belief.vv - to_velocity * to_velocity.transpose() / innovation,
    }
}

fn symmetric(m: Matrix3<f64>) -> Matrix3<f64> {
    (m + m.transpose()) * 0.5
}
