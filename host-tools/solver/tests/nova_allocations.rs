//! What the joint optimisation takes from the heap. A program of its own, because the counting
//! allocator serves all of it.

use nalgebra::Vector3;
use nova_solver::navigation::{InsSample, RangeSample};
use nova_solver::nova::{JointOptimiser, Parameters, Segment, SegmentRecorder};

const TAG: Vector3<f64> = Vector3::new(18.0, 7.0, 0.5);

/// Three legs at 1 m/s with drifting dead reckoning.
fn flight(parameters: &Parameters) -> Vec<Segment> {
    let plan = [
        [0.0, 0.0, 30.0],
        [0.0, 0.0, 29.0],
        [-2.0, 5.0, 29.0],
        [10.0, 1.0, 29.0],
    ];
    let mut t_s = 0.0;
    let reading = |t_s: f64, place: Vector3<f64>| InsSample {
        t_s,
        position_m: place + Vector3::new(0.001, -0.002, 0.0) * (t_s * t_s),
    };
    let mut segments = Vec::new();
    for leg in plan.map(Vector3::from).windows(2) {
        let mut recorder = SegmentRecorder::new(leg[0], leg[1], reading(t_s, leg[0]), parameters);
        let ticks = (10.0 * (leg[1] - leg[0]).norm()).ceil();
        for i in 1..=ticks as u32 {
            t_s += 0.1;
            let place = leg[0].lerp(&leg[1], f64::from(i) / ticks);
            recorder.push_ins(reading(t_s, place));
            let range_m = (place - TAG).norm();
            recorder.push_range(RangeSample { t_s, range_m });
        }
        segments.push(recorder.finish());
    }
    segments
}

#[test]
fn a_joint_optimisation_that_has_seen_the_flight_allocates_nothing() {
    let parameters = Parameters::default();
    let segments = flight(&parameters);
    let mut joint = JointOptimiser::new(&parameters, 0);
    let guess = TAG + Vector3::new(2.0, -3.0, 1.0);
    let first = allocation_counter::measure(|| {
        joint.optimise(&segments, guess);
    });
    assert!(first.count_total > 0);
    let again = allocation_counter::measure(|| {
        let fit = joint.optimise(&segments, guess);
        assert!(fit.alternations > 1, "{fit:?}");
    });
    assert_eq!(again.count_total, 0);
}
