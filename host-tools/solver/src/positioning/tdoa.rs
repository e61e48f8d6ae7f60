//! Where a tag is, from differences of its ranges to two anchors each.
//!
//! ```text
//! r_k = (|p - b_k| - |p - a_k| - d_k) / (s sigma_k),   J = (u_b - u_a)^T / (s sigma_k)
//! ```
//!
//! Robust, from several starts, the scale `s` found along the way: recorded differences have errors of
//! a hundred metres among them.

use nalgebra::{Matrix3, Vector3};

use crate::error::SolveError;
use crate::kernel::Kernel;
use crate::lm::{LeastSquares, LmOptions, NormalEquations, minimise};
use crate::measurement::{LARGEST_LENGTH_M, MeasurementFault};
use crate::noise::{learn, robust_scale};

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

struct Problem<'a> {
    differences: &'a [RangeDifference],
    kernel: Kernel,
    scale: f64,
}

fn misfit(d: &RangeDifference, p: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let [a, b] = d.anchors_m.map(|anchor| p - anchor);
    let unit = |v: Vector3<f64>| v.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    (b.norm() - a.norm() - d.difference_m, unit(b) - unit(a))
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

/// Place and covariance (m, m^2) from differences in order of time.
///
/// # Errors
/// [`SolveError`] for numbers that cannot be meant, for fewer than four differences, and where no
/// place of finite cost was found or the differences do not determine one.
pub fn locate_tdoa(
    differences: &[RangeDifference],
    kernel: Kernel,
) -> Result<(Vector3<f64>, Matrix3<f64>), SolveError> {
    let (got, unknowns) = (differences.len(), 3);
    if got <= unknowns {
        return Err(SolveError::TooFewMeasurements { got, unknowns });
    }
    if !kernel.is_valid() {
        return Err(SolveError::BadOption {
            name: "kernel",
            why: "without a positive width",
        });
    }
    let usable = |length: &f64| length.abs() <= LARGEST_LENGTH_M;
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
    let whitened = |p: &Vector3<f64>| -> Vec<f64> {
        (differences.iter())
            .map(|d| misfit(d, p).0 / d.sigma_m)
            .collect()
    };
    let settle = |start: Vector3<f64>| {
        let mut p = start;
        let mut scale = robust_scale(&mut whitened(&p), 3).max(1e-3);
        for _ in 0..15 {
            let problem = Problem {
                differences,
                kernel,
                scale,
            };
            p = minimise(&problem, p, &LmOptions::default()).x;
            let next = robust_scale(&mut whitened(&p), 3).max(1e-3);
            let settled = (next / scale - 1.0).abs() < 0.02;
            scale = next;
            if settled {
                break;
            }
        }
        (p, scale)
    };
    let (p, scale) = starts(differences)
        .into_iter()
        .map(settle)
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .ok_or(SolveError::Diverged)?;
    let plain = Problem {
        differences,
        kernel: Kernel::None,
        scale: 1.0,
    };
    // What the kernel gave up of outliers is in the variance that their influence leaves.
    let noise = learn(&whitened(&p), scale, kernel, 3);
    let information = plain.linearise(&p).hessian;
    let covariance = (information.cholesky().ok_or(SolveError::Diverged)?).inverse();
    Ok((p, covariance * noise.variance_factor))
}

/// The middle of the anchors and the corners of a box half as large as theirs.
fn starts(differences: &[RangeDifference]) -> Vec<Vector3<f64>> {
    let anchors = || differences.iter().flat_map(|d| d.anchors_m);
    let far = f64::INFINITY;
    let low = anchors().fold(Vector3::repeat(far), |low, a| low.inf(&a));
    let high = anchors().fold(Vector3::repeat(-far), |high, a| high.sup(&a));
    let (middle, half) = ((low + high) * 0.5, (high - low) * 0.25);
    let mut starts = vec![middle];
    for corner in 0..8 {
        let side = |bit: i32| if corner & bit == 0 { -1.0 } else { 1.0 };
        starts.push(middle + half.component_mul(&Vector3::new(side(1), side(2), side(4))));
    }
    starts
}
