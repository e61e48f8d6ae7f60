//! The robust mean of one pair's ranges.

use crate::kernel::Kernel;
use crate::noise::{correlation, robust_scale};

/// Fewer ranges do not tell their own spread.
pub(super) const LEAST_RANGES: usize = 10;

/// Ranges so many standard deviations away count as set aside.
const FAR_SIGMA: f64 = 4.0;

/// The chip's clock has no finer grain that shows; the floor keeps ranges that are all equal from
/// being believed without end.
const LEAST_SCATTER_M: f64 = 1e-4;

/// A mean that gross outliers hardly move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobustMean {
    /// The mean, in metres.
    pub mean_m: f64,
    /// Standard deviation of a single range, in metres, outliers apart.
    pub scatter_m: f64,
    /// Standard deviation of the mean, in metres; counts that neighbours in time resemble each other.
    pub sigma_m: f64,
    /// Ranges that count.
    pub used: usize,
    /// Ranges more than four standard deviations away.
    pub rejected: usize,
}

/// Mean of `ranges_m`, given in time order; `None` where they are too few.
///
/// An M-estimate at the scale of the median absolute deviation about the median (Huber 1981, ch. 6),
/// by iteratively reweighted means; its variance is `tau gamma s^2 / n` with the kernel's factor
/// `gamma` and the ranges' correlation time `tau`.
pub(super) fn robust_mean(ranges_m: &[f64], kernel: Kernel) -> Option<RobustMean> {
    /// The weights change smoothly: each round gains digits.
    const ROUNDS: usize = 30;
    if ranges_m.len() < LEAST_RANGES {
        return None;
    }
    let mut sorted = ranges_m.to_vec();
    let middle = sorted.len() / 2;
    let (_, median_m, _) = sorted.select_nth_unstable_by(middle, f64::total_cmp);
    let mut mean_m = *median_m;
    let mut about: Vec<f64> = ranges_m.iter().map(|r| r - mean_m).collect();
    let scatter_m = robust_scale(&mut about, 1).max(LEAST_SCATTER_M);
    for _ in 0..ROUNDS {
        let (mut sum, mut weights) = (0.0, 0.0);
        for range_m in ranges_m {
            let r = (range_m - mean_m) / scatter_m;
            let (_, weight) = kernel.rho_and_weight(r * r);
            sum += weight * (range_m - mean_m);
            weights += weight;
        }
        let step_m = sum / weights;
        mean_m += step_m;
        if step_m.abs() < 1e-6 * scatter_m {
            break;
        }
    }
    let influences: Vec<f64> = (ranges_m.iter())
        .map(|range_m| {
            let r = (range_m - mean_m) / scatter_m;
            r * kernel.rho_and_weight(r * r).1
        })
        .collect();
    let rejected = (ranges_m.iter())
        .filter(|range_m| (*range_m - mean_m).abs() > FAR_SIGMA * scatter_m)
        .count();
    let used = ranges_m.len() - rejected;
    let independent = (ranges_m.len() as f64 / correlation(&influences, 1)).max(1.0);
    let variance_m2 = kernel.gaussian_variance_factor() * scatter_m * scatter_m / independent;
    Some(RobustMean {
        mean_m,
        scatter_m,
        sigma_m: variance_m2.sqrt(),
        used,
        rejected,
    })
}
