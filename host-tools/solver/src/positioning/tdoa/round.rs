//! A place from the differences of one round: no history, all of the covariance.
//!
//! ```text
//! R = diag(own^2) + sum s s^T + tau^2 D D^T        D: -1 and +1 at the two anchors of each difference
//! p <- p - (J^T R^-1 J)^-1 J^T R^-1 e              from each place of the closed form and some more, until it settles
//! ```
//!
//! Three differences are met exactly, often by two places; heights decide, and where they do not, how far
//! the two are apart is doubt.

use super::super::listening::ListenedRound;
use super::{LARGEST_LENGTH_M, TdoaOptions, check, misfit, starts};
use crate::error::SolveError;
use crate::positioning::RangeDifference;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// A place from one round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoundFix {
    /// Metres.
    pub position_m: Vector3<f64>,
    /// Noise, what the round shares, and offsets together, square metres.
    pub covariance_m2: Matrix3<f64>,
    /// Another place that fits as well, if there is one: it is in the covariance.
    pub alternative_m: Option<Vector3<f64>>,
    /// Weighted sum of squared residuals: chi-square with as many degrees of freedom as there are differences beyond
    /// three.
    pub misfit: f64,
}

/// Steps of Gauss and Newton.
const STEPS: usize = 20;
/// A step smaller than this is none, metres.
const SETTLED_M: f64 = 1e-6;
/// Places closer than this are one, metres.
const ONE_M: f64 = 1e-3;
/// So much more misfit makes a place a hundred times less likely.
const LIKELY: f64 = 9.2;

/// The place of a listener from one round. Of `options` the kernel is not used: in one round nothing can be told from
/// an outlier but by `misfit`.
///
/// # Errors
/// [`SolveError`] for numbers that cannot be meant, fewer than three differences, where they determine no place, or
/// none within the heights.
pub fn locate_round(round: &ListenedRound, options: &TdoaOptions) -> Result<RoundFix, SolveError> {
    let differences: Vec<RangeDifference> =
        round.differences.iter().map(|one| one.difference).collect();
    let (got, unknowns) = (differences.len(), 3);
    if got < unknowns {
        return Err(SolveError::TooFewMeasurements { got, unknowns });
    }
    check(&differences, options)?;
    let r = noise(round, options.offset_sigma_m);
    let weights = r.cholesky().ok_or(SolveError::Diverged)?;
    let mut found: Vec<(f64, Vector3<f64>, Matrix3<f64>)> = Vec::new();
    let mut outside = None;
    for start in starts(&differences) {
        let Some((misfit, p, covariance)) = settle(&differences, &weights, start) else {
            continue;
        };
        if options
            .heights_m
            .is_some_and(|[low, high]| !(low..=high).contains(&p.z))
        {
            outside = Some(p.z);
        } else if found.iter().all(|(_, other, _)| (other - p).norm() > ONE_M) {
            found.push((misfit, p, covariance));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(misfit, position_m, mut covariance_m2)) = found.first() else {
        return Err(outside.map_or(SolveError::Diverged, |height_m| {
            SolveError::OutsideHeights { height_m }
        }));
    };
    let alternative_m = (found.get(1))
        .filter(|(other, ..)| *other < misfit + LIKELY)
        .map(|(_, place, _)| *place);
    if let Some(other) = alternative_m {
        let apart = other - position_m;
        covariance_m2 += apart * apart.transpose();
    }
    Ok(RoundFix {
        position_m,
        covariance_m2,
        alternative_m,
        misfit,
    })
}

/// Covariance of the differences, square metres.
fn noise(round: &ListenedRound, offset_sigma_m: f64) -> DMatrix<f64> {
    let all = &round.differences;
    let tau2 = offset_sigma_m.powi(2);
    DMatrix::from_fn(all.len(), all.len(), |i, k| {
        let (Some(one), Some(other)) = (all.get(i), all.get(k)) else {
            return 0.0;
        };
        let [[a, b], [c, d]] = [one.addresses, other.addresses];
        let same = |x: u16, y: u16| f64::from(u8::from(x == y));
        let offsets = tau2 * (same(a, c) + same(b, d) - same(a, d) - same(b, c));
        let shared: f64 = one
            .shared_m
            .iter()
            .zip(other.shared_m)
            .map(|(s, t)| s * t)
            .sum();
        if i == k {
            one.difference.sigma_m.powi(2) + offsets
        } else {
            shared + offsets
        }
    })
}

type Weights = nalgebra::Cholesky<f64, nalgebra::Dyn>;

/// Misfit, place and covariance from a start; `None` where the differences do not determine it.
fn settle(
    differences: &[RangeDifference],
    weights: &Weights,
    start: Vector3<f64>,
) -> Option<(f64, Vector3<f64>, Matrix3<f64>)> {
    let n = differences.len();
    let mut p = start;
    let mut covariance = None;
    for _ in 0..STEPS {
        let (mut e, mut j) = (DVector::zeros(n), DMatrix::zeros(n, 3));
        for (i, d) in differences.iter().enumerate() {
            let (misfit_m, gradient) = misfit(d, &p);
            e[i] = misfit_m;
            j.set_row(i, &gradient.transpose());
        }
        let weighted = weights.solve(&j);
        let information: Matrix3<f64> = (j.transpose() * &weighted).fixed_view::<3, 3>(0, 0).into();
        let inverse = information.cholesky()?.inverse();
        let step: Vector3<f64> = inverse * (weighted.transpose() * e).fixed_rows::<3>(0);
        p -= step;
        covariance = Some(inverse);
        if !p.iter().all(|v| v.abs() <= LARGEST_LENGTH_M) {
            return None;
        }
        if step.amax() < SETTLED_M {
            break;
        }
    }
    let e = DVector::from_iterator(n, differences.iter().map(|d| misfit(d, &p).0));
    let squares = e.dot(&weights.solve(&e));
    // What has not come to rest is no place.
    let most = 9.0 * n as f64 + LIKELY;
    covariance
        .filter(|_| squares <= most)
        .map(|of| (squares, p, of))
}
