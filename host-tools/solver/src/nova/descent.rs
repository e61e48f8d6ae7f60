//! Horizontal distance to the tag from going down (paper Sec. IV-D).
//!
//! A descent from the height `H` over the tag to `H + dH` (`dH < 0`) measures the distance at both
//! ends, `D1` and `D2`. Height and horizontal distance follow:
//!
//! ```text
//! D1^2 = D_2D^2 + H^2        D2^2 = D_2D^2 + (H + dH)^2                                  (14)
//! H = (D2^2 - D1^2 - dH^2) / (2 dH)        D_2D = sqrt(D1^2 - H^2)                       (15)
//! ```
//!
//! The descent is divided into three parts of equal height; `D1` and `D2` are the mean ranges of the
//! first and the last. Accordingly `dH` is taken between the mean heights of these parts, and `H` is
//! that of the first mean.

use super::segment::{RangePoint, Segment};

/// Mean heights nearer than this tell nothing, metres.
const LEAST_CHANGE_M: f64 = 0.1;

/// What a descent tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Descent {
    /// `D_2D`, metres. Zero where noise puts the tag higher over `H` than `D1` reaches.
    pub(super) distance_m: f64,
    /// Height of the tag in the navigation frame, metres.
    pub(super) tag_height_m: f64,
}

impl Descent {
    /// Of a vertical leg. `None` where a third of it has no ranges, or was not vertical after all.
    pub(super) fn of(leg: &Segment) -> Option<Self> {
        let (from_m, to_m) = (leg.start_m().z, leg.goal_m().z);
        let done = |range: &&RangePoint| (range.reckoned_m.z - from_m) / (to_m - from_m);
        let first = Mean::of(leg.ranges.iter().filter(|r| done(r) <= 1.0 / 3.0))?;
        let last = Mean::of(leg.ranges.iter().filter(|r| done(r) >= 2.0 / 3.0))?;
        Self::between(first, last)
    }

    fn between(first: Mean, last: Mean) -> Option<Self> {
        let change = last.height_m - first.height_m;
        if change.abs() < LEAST_CHANGE_M {
            return None;
        }
        let (d1, d2) = (first.range_m, last.range_m);
        let height = (d2 * d2 - d1 * d1 - change * change) / (2.0 * change);
        Some(Self {
            distance_m: (d1 * d1 - height * height).max(0.0).sqrt(),
            tag_height_m: first.height_m - height,
        })
    }
}

/// Mean of the ranges of one part, and of the heights they were measured at.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mean {
    range_m: f64,
    height_m: f64,
}

impl Mean {
    fn of<'a>(ranges: impl Iterator<Item = &'a RangePoint>) -> Option<Self> {
        let (mut count, mut range_m, mut height_m) = (0.0, 0.0, 0.0);
        for range in ranges {
            count += 1.0;
            range_m += range.range_m;
            height_m += range.reckoned_m.z;
        }
        (count > 0.0).then(|| Self {
            range_m: range_m / count,
            height_m: height_m / count,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigation::{InsSample, RangeSample};
    use crate::nova::{Parameters, SegmentRecorder};
    use nalgebra::Vector3;

    /// A descent 3 m beside a tag at 0.5 m height, at 1 m/s, with a constant range error. Ranges
    /// below `until_m` are lost.
    fn descent(from_m: f64, to_m: f64, error_m: f64, until_m: f64) -> Segment {
        let at = |height_m: f64| Vector3::new(1.0, 2.0, height_m);
        let tag = Vector3::new(4.0, 2.0, 0.5);
        let reading = |i: u32| InsSample {
            t_s: 0.1 * f64::from(i),
            position_m: at(from_m - 0.1 * f64::from(i)),
        };
        let mut recorder =
            SegmentRecorder::new(at(from_m), at(to_m), reading(0), &Parameters::default());
        for i in 1..=(10.0 * (from_m - to_m)) as u32 {
            let reading = reading(i);
            recorder.push_ins(reading);
            if reading.position_m.z >= until_m {
                recorder.push_range(RangeSample {
                    t_s: reading.t_s,
                    range_m: (reading.position_m - tag).norm() + error_m,
                });
            }
        }
        recorder.finish()
    }

    #[test]
    fn distance_and_height_come_out_of_a_descent() {
        for (from_m, to_m) in [(30.0, 15.0), (15.0, 1.0)] {
            let found = Descent::of(&descent(from_m, to_m, 0.0, 0.0)).unwrap();
            // The mean range over a third is a little more than the range at its middle.
            assert!((3.0..3.25).contains(&found.distance_m), "{found:?}");
            assert!((found.tag_height_m - 0.5).abs() < 0.1, "{found:?}");
        }
    }

    #[test]
    fn equation_15_is_exact_for_two_points() {
        let at = |height_m: f64| Mean {
            range_m: 3f64.hypot(height_m - 0.5),
            height_m,
        };
        let found = Descent::between(at(27.5), at(17.5)).unwrap();
        assert!((found.distance_m - 3.0).abs() < 1e-9 && (found.tag_height_m - 0.5).abs() < 1e-9);
    }

    #[test]
    fn a_height_beyond_the_distance_means_right_above() {
        let first = Mean {
            range_m: 27.0,
            height_m: 27.5,
        };
        let last = Mean {
            range_m: 16.9,
            height_m: 17.5,
        };
        // D2 is too short for D1: H becomes 27.07 m, more than D1.
        let found = Descent::between(first, last).unwrap();
        assert_eq!(found.distance_m, 0.0);
        assert!(found.tag_height_m.is_finite());
    }

    #[test]
    fn a_third_without_ranges_or_without_height_tells_nothing() {
        assert_eq!(Descent::of(&descent(30.0, 15.0, 0.0, 21.0)), None);
        assert_eq!(Descent::of(&descent(30.0, 30.0, 0.0, 0.0)), None);
        assert_eq!(Descent::of(&descent(30.0, 29.9, 0.0, 0.0)), None);
    }
}
