//! What the residuals tell about the noise: its size, and how many of the measurements are really
//! independent.

use crate::kernel::Kernel;

/// Median absolute deviation of Gaussian noise times this is its standard deviation.
const MAD_TO_SIGMA: f64 = 1.4826;

/// Robust standard deviation of whitened residuals around zero: `1.4826 median|r| sqrt(n / (n -
/// p))`. The last factor gives back what fitting `p` unknowns took out. Sorts `residuals` in part.
pub(crate) fn robust_scale(residuals: &mut [f64], unknowns: usize) -> f64 {
    let n = residuals.len();
    if n == 0 {
        return 0.0;
    }
    for r in residuals.iter_mut() {
        *r = r.abs();
    }
    let (_, median, _) = residuals.select_nth_unstable_by(n / 2, f64::total_cmp);
    let freedom = n.saturating_sub(unknowns).max(1);
    MAD_TO_SIGMA * *median * (n as f64 / freedom as f64).sqrt()
}

/// Integrated autocorrelation `tau = 1 + 2 sum_k rho_k` of a series in time order: `n` values carry
/// the information of `n / tau` independent ones. The sum ends at the first lag that does not stand
/// out of the noise of its own estimate, `1 / sqrt(n)`.
///
/// In the residuals of a fit with `p` unknowns every autocovariance is too small by about `c = p
/// tau / n` of the variance, because the fit follows the slowest errors; `rho_k (1 - c) + c` gives
/// that back.
pub(crate) fn correlation(series: &[f64], unknowns: usize) -> f64 {
    let n = series.len();
    let power: f64 = series.iter().map(|r| r * r).sum();
    if n < 4 || power <= 0.0 {
        return 1.0;
    }
    let significant = 1.0 / (n as f64).sqrt();
    let (mut sum, mut lags) = (0.0, 0.0);
    for lag in 1..=n / 4 {
        let rho = series
            .iter()
            .zip(&series[lag..])
            .map(|(a, b)| a * b)
            .sum::<f64>()
            / power;
        if rho < significant {
            break;
        }
        sum += rho;
        lags += 1.0;
    }
    let taken = (unknowns as f64 * (1.0 + 2.0 * sum) / n as f64).min(0.5);
    1.0 + 2.0 * (sum * (1.0 - taken) + taken * lags)
}

/// What was learnt from the residuals of a fit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NoiseFit {
    /// Variance of the estimate in units of the nominal `(sum J^T J / sigma^2)^-1`.
    pub(crate) variance_factor: f64,
    /// Measurements divided by their integrated autocorrelation.
    pub(crate) effective: f64,
}

/// The given sigmas are believed as if they had been found from this many residuals. It decides
/// where there are hardly any residuals to learn from, and is forgotten where there are hundreds.
pub(crate) const PRIOR_FREEDOM: f64 = 3.0;

/// Learns from residuals whitened by the given sigmas, in time order, `scale` being their robust
/// standard deviation.
///
/// ```text
/// nu              = max(n / tau - p, 0)
/// v               = s^2 [sum psi^2 / n] / [sum psi' / n]^2 * (nu + p) / nu
/// variance factor = tau (nu0 + nu v) / (nu0 + nu) * (nu0 + nu) / (nu0 + nu - 2)
/// ```
///
/// `v` is Huber's variance of an M-estimator (1981, eq. 7.6.3) at the residuals that really
/// occurred, so that tails wider than a Gaussian's count; `tau` is the correlation of the
/// influences `psi`. It is averaged with the given variance (1 in these units), and the last
/// quotient is the variance of Student's t, because the noise was estimated from no more than `nu0
/// + nu` degrees of freedom.
pub(crate) fn learn(residuals: &[f64], scale: f64, kernel: Kernel, unknowns: usize) -> NoiseFit {
    let n = residuals.len() as f64;
    let p = unknowns as f64;
    let mut slope = 0.0;
    let influences: Vec<f64> = residuals
        .iter()
        .map(|r| {
            let r = r / scale;
            slope += kernel.influence_slope(r * r);
            kernel.rho_and_weight(r * r).1 * r
        })
        .collect();
    let power: f64 = influences.iter().map(|psi| psi * psi).sum();
    // At the robust scale at least half of the residuals sit in the steep part, so the slope is
    // well above this floor.
    let slope = (slope / n).max(0.1);
    let tau = correlation(&influences, unknowns);
    let effective = n / tau;
    let freedom = (effective - p).max(0.0);
    // nu v: what p unknowns took out of the residuals is the power of p independent ones.
    let observed_times_freedom = scale * scale * power / n / (slope * slope) * effective;
    let variance_factor =
        tau * (PRIOR_FREEDOM + observed_times_freedom) / (PRIOR_FREEDOM + freedom - 2.0);
    NoiseFit {
        variance_factor,
        effective,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn white(n: usize, seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut rng)).collect()
    }

    #[test]
    fn robust_scale_is_sigma_and_survives_outliers() {
        let clean = white(4000, 1);
        assert!((robust_scale(&mut clean.clone(), 0) - 1.0).abs() < 0.05);
        let mut dirty = clean;
        for r in dirty.iter_mut().step_by(5) {
            *r = 1e4;
        }
        assert!(robust_scale(&mut dirty, 0) < 1.4);
    }

    #[test]
    fn white_noise_is_nearly_uncorrelated() {
        let mean = (0..50)
            .map(|seed| correlation(&white(500, seed), 0))
            .sum::<f64>()
            / 50.0;
        assert!((1.0..1.1).contains(&mean), "{mean}");
    }

    #[test]
    fn correlation_of_an_autoregressive_series_is_its_closed_form() {
        // x_k = a x_{k-1} + e_k has rho_k = a^k, hence tau = (1 + a) / (1 - a).
        let a = 0.8;
        let mut x = 0.0;
        let series: Vec<f64> = white(20_000, 3)
            .into_iter()
            .map(|e| {
                x = a * x + e;
                x
            })
            .collect();
        let tau = correlation(&series, 0);
        assert!((tau / 9.0 - 1.0).abs() < 0.15, "{tau}");
    }

    #[test]
    fn white_gaussian_residuals_give_the_textbook_variance() {
        let residuals: Vec<f64> = white(5000, 7).iter().map(|r| 3.0 * r).collect();
        let fit = learn(&residuals, 3.0, Kernel::default(), 3);
        let expected = 9.0 * Kernel::default().gaussian_variance_factor();
        assert!(
            (fit.variance_factor / expected - 1.0).abs() < 0.1,
            "{fit:?}"
        );
    }
}
