//! Rows of tables.

use crate::outcome::FlightResult;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Many flights in one row.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// How many flights.
    pub trials: usize,
    /// How many of them ended on the ground; the others count with their error at the time limit.
    pub landed: usize,
    /// Mean horizontal error at the end, metres.
    pub mean_m: f64,
    /// Its median, metres.
    pub median_m: f64,
    /// Its 95th percentile, metres.
    pub p95_m: f64,
    /// The largest, metres.
    pub max_m: f64,
    /// Part of the flights with an error below 1 m, 0 to 1.
    pub below_1m: f64,
    /// The same below 0.5 m.
    pub below_0_5m: f64,
    /// The same below 0.25 m.
    pub below_0_25m: f64,
    /// Mean duration, seconds.
    pub time_s: f64,
    /// Mean of path length over ideal path length, less 1.
    pub overhead: f64,
    /// Part of the flights that chose the wrong one of two places, 0 to 1.
    pub flips: f64,
    /// Mean of the least mean error possible, metres.
    pub bound_m: Option<f64>,
    /// Mean normalised error squared of those flights that state a covariance: 2 if it is honest.
    pub nees: Option<f64>,
    /// Where that mean lies with 95 % probability if it is.
    pub nees_band: Option<[f64; 2]>,
    /// Median computing time of an estimate, milliseconds.
    pub solve_ms_median: Option<f64>,
    /// Its 99th percentile, milliseconds.
    pub solve_ms_p99: Option<f64>,
}

impl Row {
    /// The row of these flights; of none, zeros.
    pub fn of(results: &[FlightResult]) -> Self {
        let column = |value: fn(&FlightResult) -> f64| results.iter().map(value).collect();
        let errors_m = Sorted::new(column(|r| r.error_m));
        let below = |limit_m: f64| errors_m.part_below(limit_m);
        let nees: Vec<f64> = results.iter().filter_map(|r| r.nees).collect();
        let bounds: Vec<f64> = results.iter().filter_map(|r| r.bound_m).collect();
        let times = results.iter().flat_map(|r| &r.update_ms);
        let update_ms = Sorted::new(times.copied().map(f64::from).collect());
        Self {
            trials: results.len(),
            landed: results.iter().filter(|r| r.landed).count(),
            mean_m: mean(&errors_m.0).unwrap_or(0.0),
            median_m: errors_m.quantile(0.5).unwrap_or(0.0),
            p95_m: errors_m.quantile(0.95).unwrap_or(0.0),
            max_m: errors_m.quantile(1.0).unwrap_or(0.0),
            below_1m: below(1.0),
            below_0_5m: below(0.5),
            below_0_25m: below(0.25),
            time_s: mean(&column(|r| r.time_s)).unwrap_or(0.0),
            overhead: mean(&column(|r| r.overhead)).unwrap_or(0.0),
            flips: mean(&column(|r| f64::from(u8::from(r.flipped)))).unwrap_or(0.0),
            bound_m: mean(&bounds),
            nees_band: nees_band(nees.len()),
            nees: mean(&nees),
            solve_ms_median: update_ms.quantile(0.5),
            solve_ms_p99: update_ms.quantile(0.99),
        }
    }
}

/// `None` of nothing.
pub(crate) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Central 95 % of the mean of `count` independent chi-squared numbers with two degrees of freedom.
fn nees_band(count: usize) -> Option<[f64; 2]> {
    let sum = ChiSquared::new(2.0 * count as f64).ok()?;
    Some([0.025, 0.975].map(|p| sum.inverse_cdf(p) / count as f64))
}

/// Numbers in ascending order.
struct Sorted(Vec<f64>);

impl Sorted {
    fn new(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        Self(values)
    }

    /// Between neighbours by straight lines, as NumPy does by default.
    fn quantile(&self, p: f64) -> Option<f64> {
        let place = p * self.0.len().checked_sub(1)? as f64;
        let below = *self.0.get(place.floor() as usize)?;
        let above = *self.0.get(place.ceil() as usize)?;
        Some(below + (above - below) * place.fract())
    }

    fn part_below(&self, limit: f64) -> f64 {
        let below = self.0.partition_point(|&value| value < limit);
        below as f64 / self.0.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn result(error_m: f64, nees: Option<f64>) -> FlightResult {
        FlightResult {
            error_m,
            landed: error_m < 2.0,
            time_s: 50.0,
            path_length_m: 60.0,
            overhead: 0.2,
            flipped: error_m > 1.0,
            bound_m: Some(0.1),
            nees,
            update_ms: vec![1.0, 3.0],
        }
    }

    #[test]
    fn a_row_says_what_is_in_the_flights() {
        let errors_m = [0.2, 0.4, 0.8, 3.6];
        let row = Row::of(&errors_m.map(|error_m| result(error_m, Some(error_m))));
        assert_eq!((row.trials, row.landed), (4, 3));
        assert!((row.mean_m - 1.25).abs() < 1e-12);
        assert!((row.median_m - 0.6).abs() < 1e-12);
        // numpy.percentile([0.2, 0.4, 0.8, 3.6], 95) = 3.18
        assert!((row.p95_m - 3.18).abs() < 1e-12);
        assert_eq!(row.max_m, 3.6);
        assert_eq!(
            (row.below_1m, row.below_0_5m, row.below_0_25m),
            (0.75, 0.5, 0.25)
        );
        assert_eq!(row.flips, 0.25);
        assert!((row.nees.unwrap() - 1.25).abs() < 1e-12);
        assert_eq!(row.solve_ms_median, Some(2.0));
    }

    #[test]
    fn the_band_of_the_normalised_error_is_the_chi_squared_tables() {
        // Chi-squared with 200 degrees of freedom: 162.728 and 241.058; with 2: 0.050636, 7.377759.
        for (count, low, high) in [(100, 1.62728, 2.41058), (1, 0.050_636, 7.377_759)] {
            let [a, b] = nees_band(count).unwrap();
            assert!((a - low).abs() < 1e-4 && (b - high).abs() < 1e-4, "{a} {b}");
        }
        assert_eq!(nees_band(0), None);
    }

    #[test]
    fn what_no_flight_tells_is_left_out() {
        let row = Row::of(&[result(0.1, None)]);
        assert_eq!((row.nees, row.nees_band), (None, None));
        assert_eq!(Row::of(&[]), Row::default());
    }
}
