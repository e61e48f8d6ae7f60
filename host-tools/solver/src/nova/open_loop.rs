//! A flight along a given plan with simple errors, for tests.

use nalgebra::Vector3;

use super::parameters::Parameters;
use super::segment::{Segment, SegmentRecorder};
use crate::navigation::{InsSample, RangeSample};

pub(super) const TAG: Vector3<f64> = Vector3::new(18.0, 7.0, 0.5);

/// Waypoints of an exploratory descent, a leg across, and an approach.
const PLAN: [[f64; 3]; 7] = [
    [0.0, 0.0, 30.0],
    [0.0, 0.0, 29.0],
    [-1.8, 4.7, 29.0],
    [10.0, 1.0, 29.0],
    [14.0, 8.0, 29.0],
    [17.0, 5.0, 29.0],
    [17.8, 6.5, 29.0],
];

/// Errors of dead reckoning and ranges.
pub(super) struct Drift {
    /// m/s^2: position error grows with half of it times time squared.
    acceleration_m_s2: Vector3<f64>,
    /// Size of an alternating error of the ranges, metres.
    range_m: f64,
}

impl Drift {
    pub(super) fn none() -> Self {
        Self {
            acceleration_m_s2: Vector3::zeros(),
            range_m: 0.0,
        }
    }

    /// Some 2.5 m after the whole flight of 40 s.
    pub(super) fn strong() -> Self {
        Self {
            acceleration_m_s2: Vector3::new(0.002, -0.0025, 0.0),
            range_m: 0.03,
        }
    }
}

/// The plan flown truly, at 1 m/s.
pub(super) fn flown(drift: &Drift) -> Vec<Segment> {
    let parameters = Parameters::default();
    let mut tick = 0_u32;
    let reckon = |tick: u32, truth: Vector3<f64>| {
        let t_s = 0.1 * f64::from(tick);
        InsSample {
            t_s,
            position_m: truth + drift.acceleration_m_s2 * (0.5 * t_s * t_s),
        }
    };
    let mut segments = Vec::new();
    for leg in PLAN.windows(2) {
        let (start, goal) = (Vector3::from(leg[0]), Vector3::from(leg[1]));
        let ticks = (10.0 * (goal - start).norm()).ceil();
        let mut recorder = SegmentRecorder::new(start, goal, reckon(tick, start), &parameters);
        for i in 1..=ticks as u32 {
            tick += 1;
            let truth = start.lerp(&goal, f64::from(i) / ticks);
            recorder.push_ins(reckon(tick, truth));
            let error = if tick.is_multiple_of(2) { 1.0 } else { -1.0 } * drift.range_m;
            recorder.push_range(RangeSample {
                t_s: 0.1 * f64::from(tick),
                range_m: (truth - TAG).norm() + error,
            });
        }
        segments.push(recorder.finish());
    }
    segments
}
