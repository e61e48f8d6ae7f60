//! The paper's joint optimisation on its own: dead reckoning drifts, ranges do not; both together
//! find the tag and correct the path.
//!
//! `cargo run -p nova-solver --example joint_optimisation`

use nalgebra::Vector3;
use nova_solver::navigation::{InsSample, RangeSample};
use nova_solver::nova::{JointOptimiser, Parameters, Segment, SegmentRecorder};

const TAG: Vector3<f64> = Vector3::new(18.0, 7.0, 0.5);

fn main() {
    let parameters = Parameters::default();
    let mut joint = JointOptimiser::new(&parameters, 0);
    let mut segments = Vec::new();
    // Somebody said where the tag is, and was off by 6 m.
    let mut tag_m = TAG + Vector3::new(3.0, -4.0, 3.0);
    let waypoints_m = [
        Vector3::new(0.0, 0.0, 30.0),
        Vector3::new(0.0, 0.0, 29.0),
        Vector3::new(-1.8, 4.7, 29.0),
        Vector3::new(10.0, 1.0, 29.0),
        Vector3::new(14.0, 8.0, 29.0),
        Vector3::new(17.0, 5.0, 29.0),
    ];

    println!("legs  rounds  tag                      off by  drift  after correction");
    for leg in waypoints_m.windows(2) {
        let begin_s = segments.iter().map(Segment::duration_s).sum();
        segments.push(flown(leg[0], leg[1], begin_s, &parameters));
        let n = segments.len();
        if n < 2 {
            continue; // One vertical leg does not tell where the tag is.
        }

        let fit = joint.optimise(&segments, tag_m);
        tag_m = fit.tag_m;

        let end_s: f64 = segments.iter().map(Segment::duration_s).sum();
        let [x, y, z] = tag_m.into();
        let corrected_m = joint.track_m(n - 1).last().copied().unwrap_or_default();
        println!(
            "{n:4}  {:6}  {x:6.2} {y:6.2} {z:6.2} m  {:7.2} m  {:.2} m  {:.2} m",
            fit.alternations,
            (tag_m - TAG).norm(),
            drift_m(end_s).norm(),
            (corrected_m - leg[1]).xy().norm(),
        );
    }
}

/// Error of dead reckoning: an accelerometer that is off by 0.4 milli-g.
fn drift_m(t_s: f64) -> Vector3<f64> {
    Vector3::new(0.0025, -0.003, 0.0) * (0.5 * t_s * t_s)
}

/// A leg at 1 m/s with ten readings and ranges a second.
fn flown(
    from_m: Vector3<f64>,
    to_m: Vector3<f64>,
    begin_s: f64,
    parameters: &Parameters,
) -> Segment {
    let reading = |t_s: f64, place_m: Vector3<f64>| InsSample {
        t_s,
        position_m: place_m + drift_m(t_s),
    };
    let mut recorder = SegmentRecorder::new(from_m, to_m, reading(begin_s, from_m), parameters);
    let ticks = (10.0 * (to_m - from_m).norm()).ceil();
    for i in 1..=ticks as u32 {
        let t_s = begin_s + 0.1 * f64::from(i);
        let place_m = from_m.lerp(&to_m, f64::from(i) / ticks);
        let noise_m = if i % 2 == 0 { 0.03 } else { -0.03 };
        recorder.push_ins(reading(t_s, place_m));
        recorder.push_range(RangeSample {
            t_s,
            range_m: (place_m - TAG).norm() + noise_m,
        });
    }
    recorder.finish()
}
