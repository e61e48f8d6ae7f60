//! All pairs together.

use super::graph::{Determined, Told, told};
use super::pair::{LEAST_RANGES, RobustMean, robust_mean};
use super::{CalibrationError, CalibrationOptions};
use nalgebra::{DMatrix, DVector};

/// Two nodes at a known distance, and what they measured. A pair may occur again with another
/// placement of the nodes.
#[derive(Debug, Clone, Copy)]
pub struct Pair<'a> {
    /// The two nodes, by number from 0.
    pub nodes: [usize; 2],
    /// True distance of the antennas, in metres.
    pub distance_m: f64,
    /// Standard deviation of that, in metres.
    pub distance_sigma_m: f64,
    /// Measured ranges in time order, in metres; corrected for the bias with receive power where
    /// that is wanted.
    pub ranges_m: &'a [f64],
}

/// What is believed about a node's offset before any range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NodePrior {
    /// Not calibrated: an offset of zero, give or take so many metres (one sigma).
    Uncalibrated(f64),
    /// Calibrated before: the same, and good enough to determine others by.
    Known(f64),
}

impl NodePrior {
    fn sigma_m(self) -> f64 {
        match self {
            Self::Uncalibrated(sigma_m) | Self::Known(sigma_m) => sigma_m,
        }
    }
}

/// One pair, after the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairFit {
    /// The mean of its ranges.
    pub measured: RobustMean,
    /// Mean less distance, in metres: how wrong the pair reads as it is.
    pub error_m: f64,
    /// What is left of that after calibration, in metres.
    pub residual_m: f64,
    /// Standard deviation of the error: mean, distance and what does not average out, in metres.
    pub sigma_m: f64,
    /// Its say in the solution, from 0 to 1. Less than 1 where it contradicts the others.
    pub weight: f64,
}

/// Offsets with their doubt.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// What each node adds to every range it takes part in, in metres.
    pub offsets_m: Vec<f64>,
    /// Covariance of the offsets, in square metres.
    pub covariance_m2: DMatrix<f64>,
    /// What the pairs tell of each node.
    pub determined: Vec<Determined>,
    /// The pairs, in the order given.
    pub pairs: Vec<PairFit>,
    /// Pairs more than unknowns that the pairs determine. With 0 there is no contradiction that
    /// could show.
    pub freedom: usize,
    /// Mean square of the residuals in units of their doubt; near 1 or below where pairs agree. The
    /// covariance is multiplied by it where it is more than 1. `None` without freedom.
    pub reduced_chi_square: Option<f64>,
}

impl Calibration {
    /// Standard deviation of each offset, in metres.
    pub fn sigma_m(&self) -> Vec<f64> {
        let diagonal = self.covariance_m2.diagonal();
        diagonal.iter().map(|v| v.max(0.0).sqrt()).collect()
    }

    /// Standard deviation of the sum of two nodes' offsets, which is what their ranges are wrong by,
    /// in metres; `None` for a node that does not exist.
    pub fn sum_sigma_m(&self, a: usize, b: usize) -> Option<f64> {
        let c = |i: usize, j: usize| self.covariance_m2.get((i, j)).copied();
        let variance_m2 = c(a, a)? + c(b, b)? + c(a, b)? + c(b, a)?;
        Some(variance_m2.max(0.0).sqrt())
    }
}

/// Offsets of the nodes from ranges between them.
///
/// # Errors
/// [`CalibrationError`] names the pair or option that cannot be used.
pub fn calibrate(
    nodes: &[NodePrior],
    pairs: &[Pair<'_>],
    options: &CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    check(nodes, pairs, options)?;
    let equations = (pairs.iter().enumerate())
        .map(|(index, pair)| Equation::new(index, pair, options))
        .collect::<Result<Vec<_>, _>>()?;
    let mut weights = vec![1.0; equations.len()];
    let mut solution = solve(nodes, &equations, &weights)?;
    let links: Vec<[usize; 2]> = equations.iter().map(|equation| equation.nodes).collect();
    let known: Vec<bool> = (nodes.iter())
        .map(|prior| matches!(prior, NodePrior::Known(_)))
        .collect();
    let Told {
        determined,
        unknowns,
    } = told(&known, &links);
    let freedom = links.len().saturating_sub(unknowns);
    if freedom > 0 {
        /// More than enough: Huber's weights settle in a few rounds.
        const ROUNDS: usize = 100;
        for _ in 0..ROUNDS {
            let mut change: f64 = 0.0;
            for (weight, equation) in weights.iter_mut().zip(&equations) {
                let r = equation.residual_m(&solution.offsets_m) / equation.sigma_m;
                let (_, next) = options.kernel.rho_and_weight(r * r);
                change = change.max((next - *weight).abs());
                *weight = next;
            }
            solution = solve(nodes, &equations, &weights)?;
            if change < 1e-9 {
                break;
            }
        }
    }
    let fits: Vec<PairFit> = (equations.iter().zip(&weights))
        .map(|(equation, &weight)| PairFit {
            measured: equation.measured,
            error_m: equation.error_m,
            residual_m: equation.residual_m(&solution.offsets_m),
            sigma_m: equation.sigma_m,
            weight,
        })
        .collect();
    let reduced_chi_square = (freedom > 0).then(|| {
        let chi_square: f64 = (fits.iter())
            .map(|fit| fit.weight * (fit.residual_m / fit.sigma_m).powi(2))
            .sum();
        chi_square / freedom as f64
    });
    let inflation = reduced_chi_square.unwrap_or(1.0).max(1.0);
    Ok(Calibration {
        offsets_m: solution.offsets_m.iter().copied().collect(),
        covariance_m2: solution.covariance_m2 * inflation,
        determined,
        pairs: fits,
        freedom,
        reduced_chi_square,
    })
}

fn check(
    nodes: &[NodePrior],
    pairs: &[Pair<'_>],
    options: &CalibrationOptions,
) -> Result<(), CalibrationError> {
    let positive = |value: f64| value.is_finite() && value > 0.0;
    if pairs.is_empty() {
        return Err(CalibrationError::NoPairs);
    }
    if !nodes.iter().all(|prior| positive(prior.sigma_m())) {
        return Err(CalibrationError::BadOption {
            name: "the prior sigma of a node",
        });
    }
    if !(options.systematic_sigma_m.is_finite() && options.systematic_sigma_m >= 0.0) {
        return Err(CalibrationError::BadOption {
            name: "the systematic sigma",
        });
    }
    if !options.kernel.is_valid() {
        return Err(CalibrationError::BadOption {
            name: "the width of the kernel",
        });
    }
    for (index, pair) in pairs.iter().enumerate() {
        let [a, b] = pair.nodes;
        if a == b || a.max(b) >= nodes.len() {
            return Err(CalibrationError::BadPair {
                pair: index,
                nodes: nodes.len(),
            });
        }
        let what = if !positive(pair.distance_m) {
            "the distance is not positive"
        } else if !(pair.distance_sigma_m.is_finite() && pair.distance_sigma_m >= 0.0) {
            "the sigma of the distance is negative"
        } else if !pair.ranges_m.iter().all(|r| r.is_finite()) {
            "a range is not a finite number"
        } else {
            continue;
        };
        return Err(CalibrationError::BadMeasurement { pair: index, what });
    }
    Ok(())
}

/// `error = offset_a + offset_b`, give or take `sigma`.
struct Equation {
    nodes: [usize; 2],
    measured: RobustMean,
    error_m: f64,
    sigma_m: f64,
}

impl Equation {
    fn new(
        index: usize,
        pair: &Pair<'_>,
        options: &CalibrationOptions,
    ) -> Result<Self, CalibrationError> {
        let measured =
            robust_mean(pair.ranges_m, options.kernel).ok_or(CalibrationError::TooFewRanges {
                pair: index,
                got: pair.ranges_m.len(),
                needed: LEAST_RANGES,
            })?;
        let sigma_m = measured
            .sigma_m
            .hypot(pair.distance_sigma_m)
            .hypot(options.systematic_sigma_m);
        Ok(Self {
            nodes: pair.nodes,
            measured,
            error_m: measured.mean_m - pair.distance_m,
            sigma_m,
        })
    }

    fn residual_m(&self, offsets_m: &DVector<f64>) -> f64 {
        let sum_m: f64 = (self.nodes.iter())
            .filter_map(|&node| offsets_m.get(node))
            .sum();
        self.error_m - sum_m
    }
}

struct Solution {
    offsets_m: DVector<f64>,
    covariance_m2: DMatrix<f64>,
}

/// The normal equations: `(sum w a a^T / sigma^2 + S^-2) o = sum w a error / sigma^2`, where `a` has a
/// one at both nodes of a pair.
fn solve(
    nodes: &[NodePrior],
    equations: &[Equation],
    weights: &[f64],
) -> Result<Solution, CalibrationError> {
    let priors = (nodes.iter()).map(|prior| prior.sigma_m().powi(-2));
    let mut information = DMatrix::from_diagonal(&DVector::from_iterator(nodes.len(), priors));
    let mut right = DVector::zeros(nodes.len());
    for (equation, weight) in equations.iter().zip(weights) {
        let weight = weight * equation.sigma_m.powi(-2);
        for &row in &equation.nodes {
            for &column in &equation.nodes {
                if let Some(entry) = information.get_mut((row, column)) {
                    *entry += weight;
                }
            }
            if let Some(entry) = right.get_mut(row) {
                *entry += weight * equation.error_m;
            }
        }
    }
    let cholesky = information.cholesky().ok_or(CalibrationError::Singular)?;
    Ok(Solution {
        offsets_m: cholesky.solve(&right),
        covariance_m2: cholesky.inverse(),
    })
}
