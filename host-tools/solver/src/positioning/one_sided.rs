//! Ranges that disagree, explained by blocked paths: those can only be longer.
//!
//! ```text
//! r = (|p - a| - d) / sigma;     r > 0, too short:  r^2             r < 0, too long:  Cauchy
//! ```
//!
//! A symmetric kernel, where most anchors are blocked, takes the few that are not for outliers. Here
//! a range that would have to be too short keeps its full say.

use nalgebra::Vector3;

use super::AnchorRange;
use crate::kernel::{CAUCHY_95, Kernel};
use crate::lm::{LeastSquares, LmOptions, NormalEquations, minimise};

struct Problem<'a> {
    ranges: &'a [AnchorRange],
    height_known: bool,
    scale: f64,
}

impl LeastSquares<3> for Problem<'_> {
    fn linearise(&self, p: &Vector3<f64>) -> NormalEquations<3> {
        let mut normal = NormalEquations::zeros();
        for range in self.ranges {
            let away = p - range.anchor_m;
            let distance = away.norm();
            let u = away / distance.max(1e-9);
            let whiten = 1.0 / (range.sigma_m * self.scale);
            let r = (distance - range.range_m) * whiten;
            let kernel = if r > 0.0 {
                Kernel::None
            } else {
                Kernel::Cauchy { c: CAUCHY_95 }
            };
            let (rho, weight) = kernel.rho_and_weight(r * r);
            let j = u * whiten;
            normal.cost += 0.5 * rho;
            normal.gradient += j * (weight * r);
            normal.hessian += j * j.transpose() * weight;
        }
        if self.height_known {
            normal.gradient.z = 0.0;
            normal.hessian.row_mut(2).fill(0.0);
            normal.hessian.column_mut(2).fill(0.0);
            normal.hessian[(2, 2)] = 1.0;
        }
        normal
    }
}

/// The best place from these starts and from below each anchor; `None` where no cost is finite. The
/// height of the starts is kept where it is known.
pub(super) fn explain(
    ranges: &[AnchorRange],
    height_m: Option<f64>,
    starts: &[Vector3<f64>],
) -> Option<Vector3<f64>> {
    let middle = starts.first().map_or(0.0, |start| start.z);
    let beside = ranges
        .iter()
        .map(|r| Vector3::new(r.anchor_m.x, r.anchor_m.y, height_m.unwrap_or(middle)));
    let settle = |start: Vector3<f64>| {
        let mut x = start;
        let mut cost = f64::INFINITY;
        // From wide to narrow: at the width of the noise alone the way down is long and rough.
        for scale in [16.0, 4.0, 1.0] {
            let problem = Problem {
                ranges,
                height_known: height_m.is_some(),
                scale,
            };
            let end = minimise(&problem, x, &LmOptions::default());
            (x, cost) = (end.x, end.normal.cost);
        }
        (x, cost)
    };
    let all = starts.iter().copied().chain(beside).map(settle);
    let best = all
        .filter(|(_, cost)| cost.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(best.0)
}
