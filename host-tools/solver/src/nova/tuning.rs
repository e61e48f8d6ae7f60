//! Parameters of one segment's filter by Bayesian optimisation (paper Sec. IV-C).
//!
//! No truth is at hand; what is known is what was meant to be flown. So `theta` is chosen to
//! minimise
//!
//! ```text
//! J(theta) = 1/n sum_t |p_UAV(t; theta) - p_nominal(t)|^2
//! ```
//!
//! over the steps of the segment, horizontally, with `p_nominal` on the straight line from the
//! segment's start to its waypoint at constant speed.

use nalgebra::Vector3;

use super::ema::{EmaParameters, EmaStart, Motion, filter};
use crate::bayes_opt::{BayesianMinimiser, MinimiserOptions, SearchBox};

/// Bounds of `delta`, m/s. The paper gives none: from what no two sensors agree to, to beyond the
/// vehicle's speed. In between its effect goes with its logarithm.
const DELTA_M_S: [f64; 2] = [0.01, 2.0];

/// Tunes filters, one segment at a time.
#[derive(Debug, Clone)]
pub(super) struct Tuner {
    minimiser: BayesianMinimiser<3>,
    beta_min: f64,
}

/// The filter's input on one segment, and what its output should be like.
#[derive(Debug, Clone, Copy)]
pub(super) struct Task<'a> {
    pub(super) motions: &'a [Motion],
    /// Start and velocity of the nominal path are where the filter begins.
    pub(super) nominal: EmaStart,
}

impl Tuner {
    pub(super) fn new(evaluations: usize, beta_min: f64, seed: u64) -> Self {
        Self {
            minimiser: BayesianMinimiser::new(MinimiserOptions {
                evaluations,
                seed,
                ..MinimiserOptions::default()
            }),
            beta_min,
        }
    }

    /// `theta` of a segment; `last` is what was best with an earlier estimate of the tag.
    pub(super) fn tune(&mut self, task: &Task<'_>, last: Option<EmaParameters>) -> EmaParameters {
        let beta_min = self.beta_min;
        let start = last.map(|theta| encode(&theta, beta_min));
        let found = self
            .minimiser
            .minimise(&SearchBox::unit(), start.as_slice(), |x| {
                deviation_m2(task, &decode(x, beta_min), beta_min)
            });
        decode(&found.x, beta_min)
    }
}

/// `J(theta)`.
fn deviation_m2(task: &Task<'_>, theta: &EmaParameters, beta_min: f64) -> f64 {
    let (mut sum, mut nominal) = (0.0, task.nominal.position_m);
    filter(
        task.motions,
        theta,
        beta_min,
        task.nominal,
        |motion, place| {
            nominal += task.nominal.velocity_m_s * motion.dt_s;
            sum += (place - nominal).norm_squared();
        },
    );
    sum / task.motions.len().max(1) as f64
}

/// From the unit box: `delta` by its logarithm, weights from `beta_min` to 1.
fn decode(x: &Vector3<f64>, beta_min: f64) -> EmaParameters {
    let [low, high] = DELTA_M_S;
    EmaParameters {
        delta_m_s: low * (high / low).powf(x.x),
        beta_base: beta_min + (1.0 - beta_min) * x.y,
        beta_raw: beta_min + (1.0 - beta_min) * x.z,
    }
}

fn encode(theta: &EmaParameters, beta_min: f64) -> Vector3<f64> {
    let [low, high] = DELTA_M_S;
    let weight = |beta: f64| {
        if beta_min < 1.0 {
            (beta - beta_min) / (1.0 - beta_min)
        } else {
            0.0
        }
    };
    Vector3::new(
        (theta.delta_m_s / low).ln() / (high / low).ln(),
        weight(theta.beta_base),
        weight(theta.beta_raw),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    const BETA_MIN: f64 = 0.15;

    /// A leg along x at 1 m/s. Every other velocity is wrong by 0.6 m/s sideways, and the ranges say
    /// so.
    fn shaken() -> Vec<Motion> {
        (0..20)
            .map(|i| {
                let wrong = if i % 2 == 0 { 0.6 } else { 0.0 };
                Motion {
                    dt_s: 0.5,
                    velocity_m_s: Vector2::new(1.0, wrong),
                    mismatch_m_s: Some(wrong),
                }
            })
            .collect()
    }

    fn task(motions: &[Motion]) -> Task<'_> {
        Task {
            motions,
            nominal: EmaStart {
                position_m: Vector2::zeros(),
                velocity_m_s: Vector2::x(),
            },
        }
    }

    #[test]
    fn the_tuned_filter_keeps_what_the_ranges_confirm_and_drops_the_rest() {
        let motions = shaken();
        let task = task(&motions);
        let theta = Tuner::new(25, BETA_MIN, 0).tune(&task, None);
        let tuned = deviation_m2(&task, &theta, BETA_MIN);
        let untuned = EmaParameters {
            delta_m_s: 2.0,
            beta_base: 1.0,
            beta_raw: 1.0,
        };
        assert!(tuned < 0.1 * deviation_m2(&task, &untuned, BETA_MIN));
        // Good velocities must outweigh bad ones.
        assert!(theta.beta_base > 0.5 && theta.delta_m_s < 0.6, "{theta:?}");
    }

    #[test]
    fn an_earlier_optimum_is_never_lost() {
        let motions = shaken();
        let task = task(&motions);
        let mut tuner = Tuner::new(25, BETA_MIN, 0);
        let first = tuner.tune(&task, None);
        let mut few = Tuner::new(1, BETA_MIN, 0);
        let again = few.tune(&task, Some(first));
        let (a, b) = [first, again]
            .map(|theta| deviation_m2(&task, &theta, BETA_MIN))
            .into();
        assert!((a - b).abs() < 1e-9 * (1.0 + a), "{a} {b}");
    }

    #[test]
    fn bounds_hold_at_the_corners_of_the_box() {
        for (corner, delta, beta) in [(0.0, 0.01, BETA_MIN), (1.0, 2.0, 1.0)] {
            let x = Vector3::repeat(corner);
            let theta = decode(&x, BETA_MIN);
            assert!((theta.delta_m_s - delta).abs() < 1e-12);
            assert!((theta.beta_base - beta).abs() < 1e-12 && theta.beta_raw == theta.beta_base);
            assert!((encode(&theta, BETA_MIN) - x).norm() < 1e-12);
        }
    }

    #[test]
    fn a_segment_without_motion_is_no_trouble() {
        let theta = Tuner::new(25, BETA_MIN, 0).tune(&task(&[]), None);
        assert!(theta.delta_m_s.is_finite() && theta.beta_base.is_finite());
    }
}
