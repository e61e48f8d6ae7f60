//! What a further evaluation promises.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Expected improvement on `best` of a Gaussian value, for minimisation (Mockus 1978; Jones,
/// Schonlau, Welch 1998, Eq. 15):
///
/// ```text
/// EI = E[max(best - Y, 0)] = (best - mu) Phi(z) + sigma phi(z),   z = (best - mu) / sigma
/// ```
pub fn expected_improvement(mean: f64, sigma: f64, best: f64) -> f64 {
    let gain = best - mean;
    if sigma <= 0.0 {
        return gain.max(0.0);
    }
    let z = gain / sigma;
    let density = (-0.5 * z * z).exp() / (2.0 * PI).sqrt();
    let probability = 0.5 * libm::erfc(-z * FRAC_1_SQRT_2);
    (gain * probability + sigma * density).max(0.0)
}

/// Never less than [`expected_improvement`], and cheap: `EI <= max(best - mu, 0) + sigma phi(0)`,
/// because `EI - max(best - mu, 0)` is even in `z` and falls with `|z|`.
#[inline]
pub(super) fn improvement_bound(mean: f64, sigma: f64, best: f64) -> f64 {
    const DENSITY_AT_ZERO: f64 = 0.398_942_280_401_432_7;
    (best - mean).max(0.0) + sigma * DENSITY_AT_ZERO
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Midpoint rule over `best - y` times the Gaussian density, out to ten sigma below the mean.
    fn by_integration(mean: f64, sigma: f64, best: f64) -> f64 {
        let from = mean - 10.0 * sigma;
        let n = 200_000;
        let h = (best - from).max(0.0) / f64::from(n);
        (0..n)
            .map(|i| {
                let y = from + (f64::from(i) + 0.5) * h;
                let z = (y - mean) / sigma;
                (best - y) * (-0.5 * z * z).exp() / (sigma * (2.0 * PI).sqrt()) * h
            })
            .sum()
    }

    #[test]
    fn closed_form_is_the_integral_it_stands_for() {
        for mean in [-1.5, 0.0, 0.7, 2.0] {
            for sigma in [0.1, 0.6, 3.0] {
                for best in [-1.0, 0.0, 1.0] {
                    let (closed, numeric) = (
                        expected_improvement(mean, sigma, best),
                        by_integration(mean, sigma, best),
                    );
                    assert!((closed - numeric).abs() < 1e-8, "{closed} {numeric}");
                    assert!(improvement_bound(mean, sigma, best) >= closed);
                }
            }
        }
    }

    #[test]
    fn a_certain_value_improves_by_the_difference_or_not_at_all() {
        assert_eq!(expected_improvement(1.0, 0.0, 3.0), 2.0);
        assert_eq!(expected_improvement(3.0, 0.0, 1.0), 0.0);
    }
}
