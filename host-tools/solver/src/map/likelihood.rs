//! Likelihood of a range: Gaussian, or an outlier that is mostly late.
//!
//! With `r = predicted - measured`, `m = 1 m`:
//!
//! ```text
//! p(r) = (1 - e) N(r; 0, sigma^2) + e h(r),     h(r) = 0.9/m exp(r/m) for r < 0, 0.1/m exp(-r/m) for r >= 0
//! cost = -ln p,    w = (1 - e) N / p            probability that the range is no outlier
//! ```
//!
//! Obstructed paths are longer, never shorter, so late ranges are believed less readily than early
//! ones. The tails keep a constant pull, which leads a start far from the answer home, up to 30 m; from there
//! on `exp(-|r|/m)` goes over into a power of `|r|` with the same slope. No path is that much longer, such a
//! range is no distance at all, and bending the whole flight toward it must not pay.

/// Mean size of an outlier, metres.
const OUTLIER_MEAN_M: f64 = 1.0;
/// Share of outliers that are late.
const LATE: f64 = 0.9;
/// Residuals beyond this are of no obstructed path, metres.
const GROSS_M: f64 = 30.0;

/// `-ln` of the tail's shape at this size of the residual, and its slope.
#[inline]
fn tail(size_m: f64) -> (f64, f64) {
    if size_m <= GROSS_M {
        (size_m / OUTLIER_MEAN_M, 1.0 / OUTLIER_MEAN_M)
    } else {
        let power = GROSS_M / OUTLIER_MEAN_M;
        (power * (1.0 + (size_m / GROSS_M).ln()), power / size_m)
    }
}

/// Cost of one residual and its derivatives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Influence {
    /// `-ln p`.
    pub(super) cost: f64,
    /// Derivative of the cost with respect to the predicted range.
    pub(super) slope: f64,
    /// Weight of the Gauss-Newton term, `w / sigma^2 + (1 - w) |slope| / |r|`: the second part is the
    /// parabola that touches the tail at `r` from above.
    pub(super) information: f64,
    /// `w`.
    pub(super) sound: f64,
}

/// The likelihood of ranges with one share of outliers. Its logarithms are taken once: they were a twentieth of a sweep.
#[derive(Debug, Clone, Copy)]
pub(super) struct RangeLikelihood {
    /// `ln(1 - e)`.
    log_sound: f64,
    /// `ln` of the outlier density at no residual, late and early, 1/m.
    log_late: f64,
    log_early: f64,
}

impl RangeLikelihood {
    /// With the share `e` of outliers.
    pub(super) fn new(outlier_probability: f64) -> Self {
        let log_share = |share: f64| (outlier_probability * share / OUTLIER_MEAN_M).ln();
        Self {
            log_sound: (-outlier_probability).ln_1p(),
            log_late: log_share(LATE),
            log_early: log_share(1.0 - LATE),
        }
    }

    /// Of the residual `r = predicted - measured` at this variance.
    #[inline]
    pub(super) fn influence(&self, r: f64, variance: f64) -> Influence {
        let inverse = 1.0 / variance;
        let log_outlier = if r < 0.0 {
            self.log_late
        } else {
            self.log_early
        };
        let (tail, pull) = tail(r.abs());
        // ln of outlier density over Gaussian density; the Gaussian is taken out of the sum so that
        // nothing underflows.
        let gaussian = 0.5 * r * r * inverse;
        let log_normal = 0.5 * (std::f64::consts::TAU * variance).ln() - self.log_sound;
        let odds = log_outlier - tail + log_normal + gaussian;
        let (log_sum, sound) = if odds > 700.0 {
            (odds, 0.0)
        } else {
            let ratio = odds.exp();
            (ratio.ln_1p(), 1.0 / (1.0 + ratio))
        };
        Influence {
            cost: log_normal + gaussian - log_sum,
            slope: sound * r * inverse + (1.0 - sound) * pull.copysign(r),
            information: sound * inverse
                + (1.0 - sound) * pull / r.abs().max(OUTLIER_MEAN_M * 1e-3),
            sound,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn influence(r: f64, variance: f64) -> Influence {
        RangeLikelihood::new(0.05).influence(r, variance)
    }

    #[test]
    fn slope_is_the_derivative_of_the_cost() {
        for r in [-30.0, -2.0, -0.3, -0.11, 0.07, 0.2, 0.5, 4.0, 50.0, 700.0] {
            let h = 1e-5;
            let cost = |r: f64| influence(r, 0.01).cost;
            let slope = (cost(r + h) - cost(r - h)) / (2.0 * h);
            let told = influence(r, 0.01).slope;
            assert!(
                (slope - told).abs() < 1e-4 * (1.0 + told.abs()),
                "{r}: {slope} {told}"
            );
        }
    }

    #[test]
    fn density_integrates_to_one() {
        let sum: f64 = (-400_000..400_000)
            .map(|i| (-influence(1e-4 * (f64::from(i) + 0.5), 0.01).cost).exp() * 1e-4)
            .sum();
        assert!((sum - 1.0).abs() < 1e-6, "{sum}");
    }

    #[test]
    fn late_range_is_taken_for_an_outlier_sooner_than_an_early_one() {
        let late = influence(-0.35, 0.01).sound;
        let early = influence(0.35, 0.01).sound;
        assert!(late < early && late < 0.5);
    }

    #[test]
    fn bending_a_flight_by_kilometres_toward_an_absurd_range_does_not_pay() {
        let cost = |r: f64| influence(r, 0.01).cost;
        for r in [1e9, -1e9] {
            let gain = cost(r) - cost(r - 1e4_f64.copysign(r));
            assert!((0.0..1e-3).contains(&gain), "{gain}");
        }
    }

    #[test]
    fn absurd_residual_has_a_finite_cost_and_next_to_no_information() {
        let told = influence(-1e12, 1e-4);
        assert!(told.cost.is_finite() && told.information <= 1e-12);
    }
}
