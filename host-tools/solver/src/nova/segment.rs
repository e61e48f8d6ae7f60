//! What was measured on one leg of the flight.
//!
//! The filter (Eqs. 10-12) works on dead reckoning every half second with the range measured then,
//! the tag's fit (Eq. 13) on every range.

use nalgebra::Vector3;

use super::parameters::Parameters;
use crate::navigation::{InsSample, RangeSample};

/// Legs shorter than this count as this long in Eq. 13, metres.
const SHORTEST_M: f64 = 0.1;

/// Dead reckoning at a step of the filter, with the range measured there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    pub(super) t_s: f64,
    /// `p_INS(t)`, metres.
    pub(super) reckoned_m: Vector3<f64>,
    /// `D_UWB(t)`: the nearest range in time, none further than the interval between ranges.
    pub(super) range: Option<RangeSample>,
}

/// A range with the place that dead reckoning gave it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RangePoint {
    pub(super) range_m: f64,
    /// `p_INS` then, metres.
    pub(super) reckoned_m: Vector3<f64>,
    /// The last step before it, and how far it lies on the way to the next one, 0 to 1.
    pub(super) step: usize,
    pub(super) part: f64,
}

/// A leg that has been flown, as a [`SegmentRecorder`] makes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    start_m: Vector3<f64>,
    goal_m: Vector3<f64>,
    /// At least one; times grow.
    pub(super) steps: Vec<Step>,
    /// Those between first and last step; times grow.
    pub(super) ranges: Vec<RangePoint>,
}

impl Segment {
    /// Where the leg began by the plan, metres.
    pub fn start_m(&self) -> Vector3<f64> {
        self.start_m
    }

    /// The leg's waypoint, metres.
    pub fn goal_m(&self) -> Vector3<f64> {
        self.goal_m
    }

    /// How long it took, seconds.
    pub fn duration_s(&self) -> f64 {
        match (self.steps.first(), self.steps.last()) {
            (Some(first), Some(last)) => last.t_s - first.t_s,
            _ => 0.0,
        }
    }

    /// How many ranges were measured on it.
    pub fn range_count(&self) -> usize {
        self.ranges.len()
    }

    /// `L_j`, metres. The paper takes the length in 2D, which a descent does not have; in 3D it is
    /// the same for level legs.
    pub(super) fn length_m(&self) -> f64 {
        (self.goal_m - self.start_m).norm().max(SHORTEST_M)
    }

    /// Velocity of the nominal path, from start to goal at constant speed, m/s.
    pub(super) fn nominal_velocity_m_s(&self) -> Vector3<f64> {
        let duration_s = self.duration_s();
        if duration_s > 0.0 {
            (self.goal_m - self.start_m) / duration_s
        } else {
            Vector3::zeros()
        }
    }
}

/// Collects a [`Segment`] while its leg is flown.
#[derive(Debug, Clone)]
pub struct SegmentRecorder {
    start_m: Vector3<f64>,
    goal_m: Vector3<f64>,
    ins_interval_s: f64,
    uwb_interval_s: f64,
    reckoned: Vec<InsSample>,
    ranges: Vec<(RangeSample, Vector3<f64>)>,
}

impl SegmentRecorder {
    /// A leg from `start_m` to `goal_m`, metres, that begins with the reading `first`.
    pub fn new(
        start_m: Vector3<f64>,
        goal_m: Vector3<f64>,
        first: InsSample,
        parameters: &Parameters,
    ) -> Self {
        Self {
            start_m,
            goal_m,
            ins_interval_s: parameters.ins_interval_s,
            uwb_interval_s: parameters.uwb_interval_s,
            reckoned: vec![first],
            ranges: Vec::new(),
        }
    }

    /// A reading of dead reckoning, later than those before.
    pub fn push_ins(&mut self, sample: InsSample) {
        self.reckoned.push(sample);
    }

    /// A range, later than those before; it belongs to the last reading of dead reckoning.
    pub fn push_range(&mut self, sample: RangeSample) {
        if let Some(last) = self.reckoned.last() {
            self.ranges.push((sample, last.position_m));
        }
    }

    /// The last reading of dead reckoning.
    pub fn last_ins(&self) -> Option<InsSample> {
        self.reckoned.last().copied()
    }

    /// The leg has been flown.
    pub fn finish(self) -> Segment {
        let steps: Vec<Step> = self.steps();
        let ranges = self.placed(&steps);
        Segment {
            start_m: self.start_m,
            goal_m: self.goal_m,
            steps,
            ranges,
        }
    }

    /// Readings at the filter's interval, the first and the last among them.
    fn steps(&self) -> Vec<Step> {
        let mut steps: Vec<InsSample> = Vec::new();
        for (i, sample) in self.reckoned.iter().enumerate() {
            let since_s = steps.last().map_or(f64::INFINITY, |s| sample.t_s - s.t_s);
            // Times are sums of intervals: a hair less than the interval is the interval.
            if since_s >= self.ins_interval_s - 1e-6 {
                steps.push(*sample);
            } else if i + 1 == self.reckoned.len() {
                // A velocity over a short rest would be all noise: the step before grows instead.
                if since_s < 0.5 * self.ins_interval_s && steps.len() > 1 {
                    steps.pop();
                }
                steps.push(*sample);
            }
        }
        steps
            .into_iter()
            .map(|sample| Step {
                t_s: sample.t_s,
                reckoned_m: sample.position_m,
                range: self.range_at(sample.t_s),
            })
            .collect()
    }

    fn range_at(&self, t_s: f64) -> Option<RangeSample> {
        let away_s = |range: &RangeSample| (range.t_s - t_s).abs();
        self.ranges
            .iter()
            .map(|(range, _)| *range)
            .min_by(|a, b| away_s(a).total_cmp(&away_s(b)))
            .filter(|range| away_s(range) <= self.uwb_interval_s)
    }

    /// Ranges with their place between the steps.
    fn placed(&self, steps: &[Step]) -> Vec<RangePoint> {
        self.ranges
            .iter()
            .filter_map(|(range, reckoned_m)| {
                let after = steps.partition_point(|step| step.t_s <= range.t_s);
                let step = after.checked_sub(1)?;
                let from = steps.get(step)?;
                let part = match steps.get(after) {
                    Some(to) => (range.t_s - from.t_s) / (to.t_s - from.t_s),
                    // With the last reading, or as long after as that is the last one.
                    None if range.t_s - from.t_s <= self.uwb_interval_s => 0.0,
                    None => return None,
                };
                Some(RangePoint {
                    range_m: range.range_m,
                    reckoned_m: *reckoned_m,
                    step,
                    part,
                })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten readings and ranges a second along x for `seconds`; ranges named in `lost` are missing.
    fn recorded(tenths: u32, lost: &[u32]) -> Segment {
        let sample = |i: u32| InsSample {
            t_s: 0.1 * f64::from(i),
            position_m: Vector3::new(0.1 * f64::from(i), 0.0, 30.0),
        };
        let goal_m = Vector3::new(0.1 * f64::from(tenths), 0.0, 30.0);
        let start_m = Vector3::new(0.0, 0.0, 30.0);
        let mut recorder = SegmentRecorder::new(start_m, goal_m, sample(0), &Parameters::default());
        for i in 1..=tenths {
            recorder.push_ins(sample(i));
            if !lost.contains(&i) {
                recorder.push_range(RangeSample {
                    t_s: 0.1 * f64::from(i),
                    range_m: f64::from(i),
                });
            }
        }
        recorder.finish()
    }

    fn times_s(segment: &Segment) -> Vec<f64> {
        let tenths = segment.steps.iter().map(|step| (10.0 * step.t_s).round());
        tenths.map(|tenths| tenths / 10.0).collect()
    }

    #[test]
    fn steps_are_half_a_second_apart_and_take_in_a_short_rest() {
        assert_eq!(times_s(&recorded(10, &[])), [0.0, 0.5, 1.0]);
        assert_eq!(times_s(&recorded(12, &[])), [0.0, 0.5, 1.2]);
        assert_eq!(times_s(&recorded(13, &[])), [0.0, 0.5, 1.0, 1.3]);
        assert_eq!(times_s(&recorded(2, &[])), [0.0, 0.2]);
        assert_eq!(times_s(&recorded(0, &[])), [0.0]);
    }

    #[test]
    fn a_step_has_the_range_of_its_time_or_of_the_neighbour_or_none() {
        let ranges_m = |lost: &[u32]| -> Vec<Option<f64>> {
            let steps = recorded(15, lost).steps;
            steps.iter().map(|s| s.range.map(|r| r.range_m)).collect()
        };
        assert_eq!(
            ranges_m(&[]),
            [Some(1.0), Some(5.0), Some(10.0), Some(15.0)]
        );
        assert_eq!(ranges_m(&[10])[2], Some(9.0));
        assert_eq!(ranges_m(&[8, 9, 10, 11, 12])[2], None);
    }

    #[test]
    fn every_range_lies_between_two_steps_at_its_time() {
        let segment = recorded(12, &[]);
        assert_eq!(segment.range_count(), 12);
        for point in &segment.ranges {
            let from = segment.steps[point.step].t_s;
            let to = segment.steps.get(point.step + 1).map_or(from, |s| s.t_s);
            let t_s = from + (to - from) * point.part;
            assert!((t_s - point.reckoned_m.x).abs() < 1e-9, "{point:?}");
        }
    }

    #[test]
    fn a_descent_has_its_length_and_a_leg_without_length_still_counts() {
        let recorder = |goal_m| {
            let first = InsSample {
                t_s: 0.0,
                position_m: Vector3::zeros(),
            };
            SegmentRecorder::new(Vector3::zeros(), goal_m, first, &Parameters::default()).finish()
        };
        assert_eq!(recorder(Vector3::new(0.0, 0.0, -15.0)).length_m(), 15.0);
        assert_eq!(recorder(Vector3::zeros()).length_m(), SHORTEST_M);
        assert_eq!(
            recorder(Vector3::x()).nominal_velocity_m_s(),
            Vector3::zeros()
        );
    }
}
