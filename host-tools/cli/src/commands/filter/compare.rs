//! The filter beside raw ranges, the median of five and the moving average.

use super::truth::{Truth, interpolate};
use super::{Filtered, Series, name};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;

/// How many ranges the median and the mean are taken over.
const WINDOW: usize = 5;

/// Delays tried, in seconds, and the step.
const DELAYS_S: (f64, f64, f64) = (-0.5, 1.5, 0.01);

/// For the delay, an error counts no more than this: outliers have no time.
const MOST_ERROR_M: f64 = 0.5;

/// A pair whose distance varies less than this (standard deviation) shows no delay.
const LEAST_MOTION_M: f64 = 0.3;

/// What is compared.
pub(super) struct Comparison {
    pub(super) methods: Vec<Method>,
    pub(super) treatments: BTreeMap<&'static str, usize>,
    ranges: usize,
}

/// One way to smooth ranges, and how well it did.
#[derive(Serialize)]
pub(super) struct Method {
    method: &'static str,
    ranges: usize,
    rms_m: f64,
    median_m: f64,
    p95_m: f64,
    worst_m: f64,
    /// Behind the raw ranges; none where the truth is not a motion.
    delay_s: Option<f64>,
}

/// One method's errors over all pairs.
#[derive(Default)]
struct Errors {
    absolute_m: Vec<f64>,
    /// Delay and how many ranges it is from.
    delays: Vec<(f64, f64)>,
}

/// A value at a time.
type Points = Vec<(f64, f64)>;

pub(super) fn compare<'a>(
    pairs: impl Iterator<Item = ((&'a Series, &'a Vec<Filtered>), &'a Truth)>,
) -> Option<Comparison> {
    const METHODS: [&str; 4] = ["raw", "median of 5", "mean of 5", "filter"];
    let mut errors: [Errors; 4] = Default::default();
    let mut treatments = BTreeMap::new();
    for ((series, filtered), truth) in pairs {
        let raw: Vec<f64> = series.ranges.iter().map(|r| r.raw_m).collect();
        let smoothed: [Vec<Option<f64>>; 4] = [
            raw.iter().map(|&r| Some(r)).collect(),
            windowed(&raw, median),
            windowed(&raw, |window| {
                window.iter().sum::<f64>() / window.len() as f64
            }),
            filtered
                .iter()
                .map(|f| f.estimate.map(|e| e.range_m.into()))
                .collect(),
        ];
        let true_m: Vec<Option<f64>> = series
            .ranges
            .iter()
            .map(|range| match truth {
                Truth::Column => range.truth_m,
                Truth::Moving(points) => interpolate(points, range.t_s),
            })
            .collect();
        let offsets: Vec<f64> = raw
            .iter()
            .zip(&true_m)
            .filter_map(|(r, t)| t.map(|t| r - t))
            .collect();
        if offsets.is_empty() {
            continue;
        }
        let offset_m = median(&offsets);
        for filtered in filtered {
            *treatments.entry(name(filtered.treatment)).or_insert(0) += 1;
        }
        let mut raw_delay_s = None;
        for (errors, smoothed) in errors.iter_mut().zip(&smoothed) {
            let of = smoothed.iter().zip(&true_m);
            errors
                .absolute_m
                .extend(of.filter_map(|(s, t)| Some((s.as_ref()? - t.as_ref()? - offset_m).abs())));
            let Truth::Moving(points) = truth else {
                continue;
            };
            let values: Points = series
                .ranges
                .iter()
                .zip(smoothed)
                .filter_map(|(range, s)| Some((range.t_s, s.as_ref()? - offset_m)))
                .collect();
            if let Some(delay_s) = delay(&values, points) {
                let raw_s = *raw_delay_s.get_or_insert(delay_s);
                errors.delays.push((delay_s - raw_s, values.len() as f64));
            }
        }
    }
    let ranges = errors.first()?.absolute_m.len();
    let methods = METHODS
        .into_iter()
        .zip(errors)
        .map(|(method, errors)| errors.summary(method))
        .collect::<Option<_>>()?;
    Some(Comparison {
        methods,
        treatments,
        ranges,
    })
}

impl Errors {
    fn summary(mut self, method: &'static str) -> Option<Method> {
        self.absolute_m.sort_by(f64::total_cmp);
        let count = self.absolute_m.len();
        let at = |share: f64| {
            let place = (share * (count as f64 - 1.0)).round() as usize;
            self.absolute_m.get(place).copied()
        };
        let squares: f64 = self.absolute_m.iter().map(|e| e * e).sum();
        let weights: f64 = self.delays.iter().map(|(_, n)| n).sum();
        let delays: f64 = self.delays.iter().map(|(delay, n)| delay * n).sum();
        Some(Method {
            method,
            ranges: count,
            rms_m: (squares / count as f64).sqrt(),
            median_m: at(0.5)?,
            p95_m: at(0.95)?,
            worst_m: at(1.0)?,
            delay_s: (weights > 0.0).then(|| delays / weights),
        })
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "| {} ranges | rms error | median | 95 % | worst | delay |",
            self.ranges
        )?;
        writeln!(f, "|---|---|---|---|---|---|")?;
        for m in &self.methods {
            let delay = m
                .delay_s
                .map_or_else(|| "-".to_owned(), |s| format!("{:.0} ms", s * 1e3));
            writeln!(
                f,
                "| {} | {:.3} m | {:.3} m | {:.3} m | {:.2} m | {delay} |",
                m.method, m.rms_m, m.median_m, m.p95_m, m.worst_m
            )?;
        }
        let counts = self.treatments.iter().map(|(t, n)| format!("{t} {n}"));
        writeln!(f, "\n{}", counts.collect::<Vec<_>>().join(", "))
    }
}

/// `of` over the last [`WINDOW`] values, fewer at the start.
fn windowed(values: &[f64], of: impl Fn(&[f64]) -> f64) -> Vec<Option<f64>> {
    let mut window = VecDeque::with_capacity(WINDOW);
    values
        .iter()
        .map(|&value| {
            if window.len() == WINDOW {
                window.pop_front();
            }
            window.push_back(value);
            Some(of(window.make_contiguous()))
        })
        .collect()
}

/// Of an even number of values the mean of the middle two; 0 of none.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let high = sorted.get(sorted.len() / 2);
    let low = sorted.get(sorted.len().saturating_sub(1) / 2);
    match (low, high) {
        (Some(low), Some(high)) => (low + high) / 2.0,
        _ => 0.0,
    }
}

/// How much later than the truth the values fit it best.
fn delay(values: &[(f64, f64)], truth: &[(f64, f64)]) -> Option<f64> {
    let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for m in values
        .iter()
        .filter_map(|(t_s, _)| interpolate(truth, *t_s))
    {
        (n, sum, squares) = (n + 1.0, sum + m, squares + m * m);
    }
    let variance = squares / n - (sum / n) * (sum / n);
    // Not a number where there is no truth at all.
    if variance.is_nan() || variance < LEAST_MOTION_M * LEAST_MOTION_M {
        return None;
    }
    let (first, last, step) = DELAYS_S;
    let tries = ((last - first) / step).round() as u32;
    let cost = |delay_s: f64| {
        let costs = values.iter().filter_map(|(t_s, value)| {
            let truth_m = interpolate(truth, t_s - delay_s)?;
            Some((value - truth_m).abs().min(MOST_ERROR_M))
        });
        let (sum, n) = costs.fold((0.0, 0.0), |(sum, n), cost| (sum + cost, n + 1.0));
        sum / n
    };
    (0..=tries)
        .map(|k| first + f64::from(k) * step)
        .map(|delay_s| (delay_s, cost(delay_s)))
        .filter(|(_, cost)| cost.is_finite())
        .min_by(|(_, a), (_, b)| a.total_cmp(b))
        .map(|(delay_s, _)| delay_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_delay_is_found_and_a_still_pair_has_none() {
        let truth: Points = (0..2_000)
            .map(|k| f64::from(k) * 0.02)
            .map(|t| (t, 5.0 + 2.0 * (t * 0.7).sin()))
            .collect();
        let late: Points = (50..150)
            .map(|k| f64::from(k) * 0.2)
            .map(|t| (t, 5.0 + 2.0 * ((t - 0.37) * 0.7).sin()))
            .collect();
        assert!((delay(&late, &truth).unwrap() - 0.37).abs() < 0.011);
        let still: Points = truth.iter().map(|(t, _)| (*t, 5.0)).collect();
        assert_eq!(delay(&late, &still), None);
    }

    #[test]
    fn windows_grow_to_five_and_stay() {
        let values = [1.0, 100.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        let expected = [1.0, 50.5, 3.0, 3.5, 4.0, 5.0, 5.0].map(Some);
        assert_eq!(windowed(&values, median), expected);
        assert_eq!(
            windowed(&values, |w| w.len() as f64).last(),
            Some(&Some(5.0))
        );
    }
}
