//! What is left of a range's information where some ranges are late.
//!
//! The error of a range is Gaussian, and with probability `q` an exponential delay of mean `mu`
//! comes on top. Its density and the Fisher information about a shift of it are
//!
//! ```text
//! f(x) = (1 - q) phi(x) + q g(x),      phi = N(0, sigma^2),   g = phi * exponential(mu)
//! I    = integral f'(x)^2 / f(x) dx  <=  1 / sigma^2
//! ```
//!
//! The convolution obeys `mu g' = phi - g`, by which it is integrated step by step, together with
//! `I`, without special functions that overflow. Beyond `8 sigma` only the exponential tail is
//! left, whose part is `q g / mu` in closed form.

use std::f64::consts::PI;

/// Steps a sigma.
const STEPS: u32 = 48;
/// Integration runs over this many sigmas to either side.
const REACH: u32 = 8;
/// The table's ends and spacing: `ln(sigma / mu)`. Beyond the ends the factor has all but settled.
const TABLE_FROM: f64 = -7.0;
const TABLE_STEP: f64 = 0.2;
const TABLE_SIZE: usize = 51;

/// The factor by which lateness lowers the information of ranges, as a function of sigma.
#[derive(Debug, Clone, PartialEq)]
pub struct NlosLoss {
    mean_m: f64,
    /// `I sigma^2` at the table's ratios of sigma to mean; `None` where no range is late.
    table: Option<[f64; TABLE_SIZE]>,
}

impl NlosLoss {
    /// A part `probability` (0 to 1) of the ranges is late by `mean_m > 0` on average.
    pub fn new(probability: f64, mean_m: f64) -> Self {
        let table = (probability > 0.0 && mean_m > 0.0).then(|| {
            std::array::from_fn(|i| {
                kept_at((TABLE_FROM + TABLE_STEP * i as f64).exp(), probability)
            })
        });
        Self { mean_m, table }
    }

    /// Part of the information that is left, `I sigma^2`, at most 1.
    pub fn kept(&self, sigma_m: f64) -> f64 {
        let Some(table) = &self.table else {
            return 1.0;
        };
        let place = ((sigma_m / self.mean_m).ln() - TABLE_FROM) / TABLE_STEP;
        let place = place.clamp(0.0, (TABLE_SIZE - 1) as f64);
        let left = (place as usize).min(TABLE_SIZE - 2);
        let part = place - left as f64;
        table[left] * (1.0 - part) + table[left + 1] * part
    }
}

/// `I sigma^2` by integration in units of sigma: `mu = 1 / ratio`.
fn kept_at(ratio: f64, probability: f64) -> f64 {
    let q = probability;
    let step = 1.0 / f64::from(STEPS);
    let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * PI).sqrt();
    // Over one step, with the Gaussian taken for a straight line:
    // g' = g decay + phi_left (lag - decay) + phi_right (1 - lag).
    let scaled = step * ratio;
    let decay = (-scaled).exp();
    let lag = -(-scaled).exp_m1() / scaled;

    let mut g = 0.0;
    let mut phi = density(-f64::from(REACH));
    let mut information = 0.0;
    for i in 1..=2 * REACH * STEPS {
        let x = f64::from(i) * step - f64::from(REACH);
        let next = density(x);
        g = g * decay + phi * (lag - decay) + next * (1.0 - lag);
        phi = next;
        let f = (1.0 - q) * phi + q * g;
        let slope = -(1.0 - q) * x * phi + q * (phi - g) * ratio;
        information += step * slope * slope / f;
    }
    // Half of the last step belongs to the tail, in which the slope is -f / mu.
    information + q * g * ratio * (1.0 - 0.5 * step * ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `I sigma^2` the long way: the density by summing over delays, its slope by differences.
    fn brute_force(sigma: f64, mu: f64, q: f64) -> f64 {
        let phi = |x: f64| (-0.5 * (x / sigma).powi(2)).exp() / (sigma * (2.0 * PI).sqrt());
        const DELAYS: u32 = 4000;
        // The middle of each of 4000 equally likely slices of the exponential.
        let delays: Vec<f64> = (0..DELAYS)
            .map(|i| -mu * (1.0 - (f64::from(i) + 0.5) / f64::from(DELAYS)).ln())
            .collect();
        let density = |x: f64| {
            let late: f64 = delays.iter().map(|d| phi(x - d)).sum();
            (1.0 - q) * phi(x) + q * late / f64::from(DELAYS)
        };
        let step = sigma / 8.0;
        let from = -7.0 * sigma;
        let steps = ((14.0 * sigma + 7.0 * mu) / step) as u32;
        let points: Vec<f64> = (0..=2 * steps)
            .map(|i| density(from + 0.5 * step * f64::from(i)))
            .collect();
        points
            .windows(3)
            .step_by(2)
            .map(|w| (w[2] - w[0]).powi(2) / step / w[1].max(1e-300))
            .sum::<f64>()
            * sigma
            * sigma
    }

    #[test]
    fn kept_part_agrees_with_brute_force() {
        for (sigma, q) in [(0.1, 0.1), (0.3, 0.1), (0.3, 0.5), (1.0, 0.3), (3.0, 0.3)] {
            let kept = NlosLoss::new(q, 1.0).kept(sigma);
            let expected = brute_force(sigma, 1.0, q);
            assert!(
                (kept - expected).abs() < 3e-3,
                "{sigma} {q}: {kept} {expected}"
            );
        }
    }

    #[test]
    fn short_delays_cost_nothing_and_long_ones_their_share() {
        let loss = NlosLoss::new(0.2, 1.0);
        assert!(loss.kept(50.0) > 0.999);
        assert!((loss.kept(1e-4) - 0.8).abs() < 0.01, "{}", loss.kept(1e-4));
        assert_eq!(NlosLoss::new(0.0, 1.0).kept(0.1), 1.0);
    }

    #[test]
    fn more_late_ranges_tell_less() {
        let kept: Vec<f64> = [0.05, 0.1, 0.2, 0.4, 0.8]
            .iter()
            .map(|&q| NlosLoss::new(q, 1.0).kept(0.1))
            .collect();
        assert!(kept.is_sorted_by(|a, b| a > b), "{kept:?}");
    }

    #[test]
    fn lengths_may_be_in_any_unit() {
        let metres = NlosLoss::new(0.1, 2.0).kept(0.3);
        let feet = NlosLoss::new(0.1, 2.0 / 0.3048).kept(0.3 / 0.3048);
        assert!((metres - feet).abs() < 1e-12);
    }
}
