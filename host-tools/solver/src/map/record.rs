//! All ranges so far and the grid of knots they hang on.

use super::height::HeightSmoother;
use nalgebra::{Matrix3, Vector3};

/// Gusts never explain more than the rest of a range's roughness: those that last roughen it less than
/// such as change from range to range.
const LEAST_NOISE: f64 = 0.25;

/// A range and where dead reckoning was then; its height is smoothed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observation {
    pub(super) t_s: f64,
    pub(super) ins_m: Vector3<f64>,
    pub(super) range_m: f64,
    /// Noise of the range, with gusts in it, and of the reckoned height, metres.
    pub(super) range_sigma_m: f64,
    pub(super) height_sigma_m: f64,
    /// How much of the range's variance gusts are, over the square of their strength, seconds.
    pub(super) gusts_s: f64,
}

impl Observation {
    /// Variance of the range alone where gusts are this strong, m^2.
    #[inline]
    pub(super) fn range_variance_m2(&self, gusts: f64) -> f64 {
        let rough = self.range_sigma_m * self.range_sigma_m;
        (rough - gusts * gusts * self.gusts_s).max(LEAST_NOISE * rough)
    }

    /// Variance of range minus reckoned distance, m^2. Noise of the height counts in full, as it does
    /// straight above the tag: were it weighed by the vertical part of the line of sight, tags at the
    /// height of the flight would be rewarded with a narrower distribution.
    #[inline]
    pub(super) fn variance_m2(&self, gusts: f64) -> f64 {
        self.range_variance_m2(gusts) + self.height_sigma_m * self.height_sigma_m
    }
}

/// Ranges in order of time, between knots. The last knot is always at the newest range.
#[derive(Debug, Clone)]
pub(super) struct Record {
    knot_interval_s: f64,
    knot_times_s: Vec<f64>,
    observations: Vec<Observation>,
    /// Of interval `k` (between knots `k` and `k + 1`): index of its first observation.
    first: Vec<usize>,
    lowest_m: f64,
    heights: HeightSmoother,
}

/// What a new observation did to the knots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Growth {
    /// The last knot moved on.
    Moved,
    /// The last knot stays where it was, and a new one follows it.
    Added,
}

impl Record {
    pub(super) fn new(knot_interval_s: f64, start_s: f64, capacity: usize) -> Self {
        let mut record = Self {
            knot_interval_s,
            knot_times_s: Vec::with_capacity(capacity),
            observations: Vec::with_capacity(16 * capacity),
            first: Vec::with_capacity(capacity),
            lowest_m: f64::INFINITY,
            heights: HeightSmoother::new(),
        };
        record.knot_times_s.push(start_s);
        record
    }

    /// Takes an observation later than all before, its height as read.
    pub(super) fn push(&mut self, observation: Observation) -> Growth {
        let intervals = self.first.len();
        let growth = match intervals.checked_sub(1) {
            Some(last)
                if observation.t_s - self.knot_times_s[last] <= self.knot_interval_s + 1e-6 =>
            {
                self.knot_times_s[last + 1] = observation.t_s;
                Growth::Moved
            }
            _ => {
                self.knot_times_s.push(observation.t_s);
                self.first.push(self.observations.len());
                Growth::Added
            }
        };
        let sigma_m = observation.height_sigma_m;
        self.heights
            .add(observation.t_s, observation.ins_m.z, sigma_m);
        self.observations.push(observation);
        let heights = self.heights.newest_first();
        for (observation, height_m) in self.observations.iter_mut().rev().zip(heights) {
            observation.ins_m.z = height_m;
        }
        self.lowest_m = (self.observations.last())
            .map_or(self.lowest_m, |newest| self.lowest_m.min(newest.ins_m.z));
        growth
    }

    /// Forgets the first interval.
    pub(super) fn drop_first_interval(&mut self) {
        let Some(&kept_from) = self.first.get(1) else {
            return;
        };
        self.observations.drain(..kept_from);
        self.knot_times_s.remove(0);
        self.first.remove(0);
        for first in &mut self.first {
            *first -= kept_from;
        }
    }

    pub(super) fn knot_times_s(&self) -> &[f64] {
        &self.knot_times_s
    }

    /// Middle of the places of measurement, and the sum of squares of their distances from it.
    pub(super) fn spread(&self) -> (Vector3<f64>, Matrix3<f64>) {
        let places = || self.observations.iter().map(|o| o.ins_m);
        let centre = places().sum::<Vector3<f64>>() / self.observations.len().max(1) as f64;
        let spread = places()
            .map(|place| (place - centre) * (place - centre).transpose())
            .sum();
        (centre, spread)
    }

    /// Width of the path across its long axis over its length, small for a straight one, and the length:
    /// standard deviation along that axis, metres.
    pub(super) fn width_over_length_and_length_m(&self) -> (f64, f64) {
        let mut squares = self.spread().1.symmetric_eigenvalues();
        squares.as_mut_slice().sort_by(f64::total_cmp);
        let longest = squares[2].max(f64::MIN_POSITIVE);
        (
            (squares[1].max(0.0) / longest).sqrt(),
            (longest / self.observations.len().max(1) as f64).sqrt(),
        )
    }

    /// Reckoned height of the lowest range ever.
    pub(super) fn lowest_m(&self) -> f64 {
        self.lowest_m
    }

    pub(super) fn observations(&self) -> &[Observation] {
        &self.observations
    }

    /// Observations after knot `k`, up to and including knot `k + 1`.
    pub(super) fn of_interval(&self, k: usize) -> &[Observation] {
        let end = self
            .first
            .get(k + 1)
            .copied()
            .unwrap_or(self.observations.len());
        self.first
            .get(k)
            .and_then(|&first| self.observations.get(first..end))
            .unwrap_or(&[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(t_s: f64) -> Observation {
        Observation {
            t_s,
            ins_m: Vector3::zeros(),
            range_m: 1.0,
            range_sigma_m: 0.1,
            height_sigma_m: 0.0,
            gusts_s: 0.0,
        }
    }

    proptest! {
        #[test]
        fn belief_in_stronger_gusts_never_leaves_more_noise_nor_none(
            rough_m in 0.01..0.3f64, gusts_s in 0.0..0.2f64, gusts in 0.0..0.5f64, more in 0.0..0.5f64,
        ) {
            let observation = Observation { range_sigma_m: rough_m, gusts_s, ..at(1.0) };
            let [weak, strong] = [gusts, gusts + more].map(|g| observation.range_variance_m2(g));
            prop_assert!(strong <= weak && weak <= rough_m * rough_m);
            prop_assert!(strong >= 0.2 * rough_m * rough_m);
        }
    }

    #[test]
    fn last_knot_is_at_the_newest_range_and_the_others_stand_still() {
        let mut record = Record::new(0.5, 0.0, 8);
        for i in 1..=12 {
            record.push(at(0.1 * f64::from(i)));
        }
        let times: Vec<f64> = record
            .knot_times_s()
            .iter()
            .map(|t| (t * 10.0).round())
            .collect();
        assert_eq!(times, [0.0, 5.0, 10.0, 12.0]);
        assert_eq!(record.of_interval(1).len(), 5);
        assert_eq!(record.of_interval(2).len(), 2);
    }

    #[test]
    fn forgetting_keeps_every_later_range_in_its_interval() {
        let mut record = Record::new(0.5, 0.0, 8);
        for i in 1..=12 {
            record.push(at(0.1 * f64::from(i)));
        }
        let before: Vec<f64> = record.of_interval(1).iter().map(|o| o.t_s).collect();
        record.drop_first_interval();
        let after: Vec<f64> = record.of_interval(0).iter().map(|o| o.t_s).collect();
        assert_eq!(before, after);
        assert_eq!(record.observations().len(), 7);
    }

    #[test]
    fn a_silence_makes_one_long_interval() {
        let mut record = Record::new(0.5, 0.0, 8);
        record.push(at(0.1));
        record.push(at(7.0));
        assert_eq!(record.knot_times_s(), [0.0, 0.1, 7.0]);
    }
}
