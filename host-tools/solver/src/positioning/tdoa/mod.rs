//! Where a tag is, from differences of its ranges to two anchors each.
//!
//! ```text
//! d_k = |p - b_k| - |p - a_k| + o_b - o_a + noise        o_i ~ N(0, tau^2): what anchor i is off by
//!
//!  differences ─► closed form, nine starts ─► search, o = 0 ─► offsets.rs: p and o together, tau from the data
//!                 (scale found along the way)   │               └► covariance
//!                                               └► another place that fits as well
//! ```
//!
//! Recorded differences of one pair of anchors scatter by some 6 cm, about a value that is off by more than
//! that for as long as the recording lasts: antenna delays, clocks, the anchors' places. Thousands of
//! them average the noise away and leave the rest, which hangs together as offsets of the anchors do (pairs
//! 0-1 and 1-4 say pair 0-4). So these are unknowns, and how large they are is learnt from how they
//! scatter. What all anchors have in common, a frame that lies elsewhere, no difference can show.
//!
//! Robust all along: among recorded differences are errors of a hundred metres.

mod closed_form;
mod offsets;
mod round;

pub use closed_form::closed_form_differences;
pub use round::{RoundFix, locate_round};

use nalgebra::{Matrix3, Vector3};

use crate::error::SolveError;
use crate::kernel::Kernel;
use crate::lm::{LeastSquares, LmOptions, NormalEquations, minimise};
use crate::measurement::{LARGEST_LENGTH_M, MeasurementFault};
use crate::noise::robust_scale;

/// How much further one anchor is than another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeDifference {
    /// The two anchors, metres.
    pub anchors_m: [Vector3<f64>; 2],
    /// Distance to the second less that to the first, metres.
    pub difference_m: f64,
    /// Standard deviation, metres.
    pub sigma_m: f64,
}

/// How to locate from differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TdoaOptions {
    /// Robust kernel.
    pub kernel: Kernel,
    /// Standard deviation that anchors' offsets are expected to have, metres: what uncalibrated antenna
    /// delays and a tape measure leave. Believed as if it had been found from one anchor: where the
    /// differences say otherwise, they win.
    pub offset_sigma_m: f64,
    /// Lowest and highest place that can be, metres. Four anchors, or anchors in a plane, leave two places:
    /// of a tag in a room one of them is often outside.
    pub heights_m: Option<[f64; 2]>,
}

impl Default for TdoaOptions {
    fn default() -> Self {
        Self {
            kernel: Kernel::default(),
            offset_sigma_m: 0.1,
            heights_m: None,
        }
    }
}

/// A tag, located.
#[derive(Debug, Clone, PartialEq)]
pub struct TdoaFix {
    /// Where, metres.
    pub position_m: Vector3<f64>,
    /// Of that in the anchors' frame, noise and offsets together, square metres.
    pub covariance_m2: Matrix3<f64>,
    /// Another place that fits hardly worse, if there is one: the differences cannot tell.
    pub alternative_m: Option<Vector3<f64>>,
    /// Each anchor and what its end of a difference reads too long, metres; only their differences can be
    /// known.
    pub offsets_m: Vec<(Vector3<f64>, f64)>,
    /// Standard deviation of offsets as it was learnt, metres.
    pub offset_sigma_m: f64,
    /// Robust standard deviation of the residuals, in units of the given ones.
    pub noise_scale: f64,
    /// Differences further than three of these from the fit.
    pub outliers: usize,
}

/// Beyond so many standard deviations a difference is counted as an outlier.
const OUTLIER_SIGMAS: f64 = 3.0;
/// Another place counts where it is a hundred times less likely at most: the log of that.
const LIKELY: f64 = 4.6;
/// A second place is another one where it is further than so many standard deviations from the first.
const APART_SIGMAS: f64 = 3.0;

/// The tag's place from differences in order of time.
///
/// # Errors
/// [`SolveError`] for numbers that cannot be meant, for fewer than four differences, and where no
/// place of finite cost was found, none lies within the heights given, or the differences do not determine one.
pub fn locate_tdoa(
    differences: &[RangeDifference],
    options: &TdoaOptions,
) -> Result<TdoaFix, SolveError> {
    let (got, unknowns) = (differences.len(), 3);
    if got <= unknowns {
        return Err(SolveError::TooFewMeasurements { got, unknowns });
    }
    check(differences, options)?;
    let kernel = options.kernel;
    let whitened = |p: &Vector3<f64>| -> Vec<f64> {
        (differences.iter())
            .map(|d| misfit(d, p).0 / d.sigma_m)
            .collect()
    };
    let settle = |start: Vector3<f64>| {
        let mut p = start;
        let mut scale = robust_scale(&mut whitened(&p), 3).max(SMALLEST_SCALE);
        for _ in 0..15 {
            let problem = Problem {
                differences,
                kernel,
                scale,
            };
            p = minimise(&problem, p, &LmOptions::default()).x;
            let next = robust_scale(&mut whitened(&p), 3).max(SMALLEST_SCALE);
            let settled = (next / scale - 1.0).abs() < 0.02;
            scale = next;
            if settled {
                break;
            }
        }
        (p, scale)
    };
    let allowed = |p: &Vector3<f64>| match options.heights_m {
        Some([low, high]) => (low..=high).contains(&p.z),
        None => true,
    };
    let settled: Vec<(Vector3<f64>, f64)> = starts(differences)
        .into_iter()
        .map(settle)
        .filter(|(p, scale)| p.iter().all(|v| v.is_finite()) && scale.is_finite())
        .collect();
    let best = |of: &dyn Fn(&Vector3<f64>) -> bool| {
        (settled.iter().copied())
            .filter(|(p, _)| of(p))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let Some((p, scale)) = best(&allowed) else {
        return Err(match best(&|_| true) {
            Some((p, _)) => SolveError::OutsideHeights { height_m: p.z },
            None => SolveError::Diverged,
        });
    };
    let mut fix =
        offsets::with_offsets(differences, options, p, scale).ok_or(SolveError::Diverged)?;
    // How likely places are compares at one scale, and none is known better than it was promised.
    let scale = scale.max(1.0);
    let cost = |p: &Vector3<f64>| -> f64 {
        let rho = |r: f64| 0.5 * kernel.rho_and_weight((r / scale).powi(2)).0;
        whitened(p).into_iter().map(rho).sum()
    };
    let limit = cost(&p) + LIKELY;
    let apart_m = APART_SIGMAS * fix.covariance_m2.trace().max(0.0).sqrt();
    fix.alternative_m = (settled.iter().map(|(place, _)| *place))
        .filter(|other| allowed(other) && (other - p).norm() > apart_m)
        .map(|other| (cost(&other), other))
        .filter(|(cost, _)| *cost <= limit)
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, other)| other);
    Ok(fix)
}

/// Residuals that happen to vanish are not taken for the best radio in the world.
const SMALLEST_SCALE: f64 = 1e-3;

fn check(differences: &[RangeDifference], options: &TdoaOptions) -> Result<(), SolveError> {
    if !options.kernel.is_valid() {
        return Err(SolveError::BadOption {
            name: "kernel",
            why: "without a positive width",
        });
    }
    if !(options.offset_sigma_m > 0.0 && options.offset_sigma_m <= LARGEST_LENGTH_M) {
        return Err(SolveError::BadOption {
            name: "offset_sigma_m",
            why: "not positive and finite",
        });
    }
    let usable = |length: &f64| length.abs() <= LARGEST_LENGTH_M;
    let ordered = |[low, high]: [f64; 2]| low < high;
    if options.heights_m.is_some_and(|heights| !ordered(heights)) {
        return Err(SolveError::BadOption {
            name: "heights_m",
            why: "not two heights, the lower first",
        });
    }
    for (index, d) in differences.iter().enumerate() {
        let fault = if !d.anchors_m.iter().all(|a| a.iter().all(usable)) {
            MeasurementFault::Position
        } else if !usable(&d.difference_m) {
            MeasurementFault::Range
        } else if !(d.sigma_m > 0.0 && usable(&d.sigma_m)) {
            MeasurementFault::Sigma
        } else {
            continue;
        };
        return Err(SolveError::BadMeasurement { index, fault });
    }
    Ok(())
}

/// `|p - b| - |p - a| - d` and its gradient `u_b - u_a`.
pub(super) fn misfit(d: &RangeDifference, p: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let [a, b] = d.anchors_m.map(|anchor| p - anchor);
    let unit = |v: Vector3<f64>| v.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    (b.norm() - a.norm() - d.difference_m, unit(b) - unit(a))
}

struct Problem<'a> {
    differences: &'a [RangeDifference],
    kernel: Kernel,
    scale: f64,
}

impl LeastSquares<3> for Problem<'_> {
    fn linearise(&self, p: &Vector3<f64>) -> NormalEquations<3> {
        let mut normal = NormalEquations::zeros();
        for d in self.differences {
            let (misfit, j) = misfit(d, p);
            let whiten = 1.0 / (self.scale * d.sigma_m);
            let (r, j) = (misfit * whiten, j * whiten);
            let (rho, weight) = self.kernel.rho_and_weight(r * r);
            normal.cost += 0.5 * rho;
            normal.gradient += j * (weight * r);
            normal.hessian += j * j.transpose() * weight;
        }
        normal
    }
}

/// What the closed form finds, the middle of the anchors, and the corners of a box half as large as theirs.
fn starts(differences: &[RangeDifference]) -> Vec<Vector3<f64>> {
    let anchors = || differences.iter().flat_map(|d| d.anchors_m);
    let far = f64::INFINITY;
    let low = anchors().fold(Vector3::repeat(far), |low, a| low.inf(&a));
    let high = anchors().fold(Vector3::repeat(-far), |high, a| high.sup(&a));
    let (middle, half) = ((low + high) * 0.5, (high - low) * 0.25);
    let mut starts = closed_form_differences(differences);
    starts.push(middle);
    for corner in 0..8 {
        let side = |bit: i32| if corner & bit == 0 { -1.0 } else { 1.0 };
        starts.push(middle + half.component_mul(&Vector3::new(side(1), side(2), side(4))));
    }
    starts
}
