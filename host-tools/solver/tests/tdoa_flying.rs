//! Drones that overhear others' two-way ranging, recorded (MILUV; see docs/recorded-data.md), located from differences of
//! distances. `cargo test -p nova-solver --test tdoa_flying -- --nocapture` prints what docs/survey-and-fusion.md shows.
//!
//! Another protocol than ours: poll, response, and a third message from the responder again. With its own stamps of the
//! three, the responder's clock in the listener's comes from response and third message:
//!
//! ```text
//! |LR| - |LI| = c [(l2 - l1) - (t2 - r1) (l3 - l2) / (t3 - t2)] - |IR|
//! ```
//!
//! The way between the two is that of their places, which are known here.

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

mod recordings;

use nalgebra::Vector3;
use nova_solver::positioning::{METRES_PER_TICK, RangeDifference, TdoaOptions, locate_tdoa};
use recordings::{columns, data};

/// What differences scatter by in this recording: 1.5 times their median deviation of 0.2 m.
const SIGMA_M: f64 = 0.3;
/// What anchors and tags that nobody calibrated are off by.
const OFFSET_M: f64 = 0.15;

struct Heard {
    listener: f64,
    truth_m: Vector3<f64>,
    true_difference_m: f64,
    difference: RangeDifference,
}

impl Heard {
    fn error_m(&self) -> f64 {
        self.difference.difference_m - self.true_difference_m
    }
}

fn heard() -> Option<Vec<Heard>> {
    let file = data("A2_miluv/3drones_passive_tdoa_ifo001.csv")?;
    let stamps = columns(
        &file,
        [
            "rx1_listener_ticks",
            "rx2_listener_ticks",
            "rx3_listener_ticks",
            "rx1_to_ticks",
            "tx2_to_ticks",
            "tx3_to_ticks",
        ],
    );
    let whose = columns(&file, ["listener_id", "tdoa_gt_m"]);
    let places = columns(
        &file,
        [
            "lx_m", "ly_m", "lz_m", "fx_m", "fy_m", "fz_m", "tx_m", "ty_m", "tz_m",
        ],
    );
    // The recording keeps 32 bits of each stamp.
    let between = |from: f64, to: f64| (to - from).rem_euclid(4_294_967_296.0);
    let all = (stamps.iter().zip(&whose).zip(&places))
        .map(
            |((&[l1, l2, l3, r1, t2, t3], &[listener, true_difference_m]), p)| {
                let rate = between(l2, l3) / between(t2, t3);
                let (from_m, to_m) = (
                    Vector3::new(p[3], p[4], p[5]),
                    Vector3::new(p[6], p[7], p[8]),
                );
                let path_m = (to_m - from_m).norm();
                let ticks = between(l1, l2) - between(r1, t2) * rate;
                Heard {
                    listener,
                    truth_m: Vector3::new(p[0], p[1], p[2]),
                    true_difference_m,
                    difference: RangeDifference {
                        anchors_m: [from_m, to_m],
                        difference_m: ticks * METRES_PER_TICK - path_m,
                        sigma_m: SIGMA_M,
                    },
                }
            },
        )
        .collect();
    Some(all)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn recorded_differences_are_those_of_the_places_but_for_gross_ones() {
    let Some(all) = heard() else {
        return;
    };
    let errors: Vec<f64> = all.iter().map(Heard::error_m).collect();
    let middle = median(errors.clone());
    let spread = median(errors.iter().map(|e| (e - middle).abs()).collect());
    let gross = errors.iter().filter(|e| e.abs() > 2.0).count();
    println!(
        "{} differences: median error {middle:.3} m, median deviation {spread:.3} m, {gross} beyond 2 m",
        all.len()
    );
    assert!(all.len() > 300 && (1..20).contains(&gross), "{gross}");
    assert!(middle.abs() < 0.25 && spread < 0.3, "{middle} {spread}");
}

/// A listener's motion is given, as dead reckoning gives it, its place is not: every difference is carried back to where the
/// listener was first, by moving the two that it is between the other way.
#[test]
fn recorded_listeners_are_placed_from_differences_and_their_motion() {
    let Some(all) = heard() else {
        return;
    };
    let options = TdoaOptions {
        offset_sigma_m: OFFSET_M,
        heights_m: Some([-0.5, 3.0]),
        ..TdoaOptions::default()
    };
    let mut listeners: Vec<f64> = all.iter().map(|h| h.listener).collect();
    listeners.sort_by(f64::total_cmp);
    listeners.dedup();
    assert_eq!(listeners.len(), 6);
    let mut total = 0.0;
    for listener in listeners {
        let of: Vec<&Heard> = all.iter().filter(|h| h.listener == listener).collect();
        let start_m = of[0].truth_m;
        let given: Vec<RangeDifference> = (of.iter())
            .map(|h| {
                let moved_m = h.truth_m - start_m;
                RangeDifference {
                    anchors_m: h.difference.anchors_m.map(|place| place - moved_m),
                    ..h.difference
                }
            })
            .collect();
        let fix = locate_tdoa(&given, &options).unwrap();
        let error = fix.position_m - start_m;
        let nees = error.dot(&(fix.covariance_m2.try_inverse().unwrap() * error));
        total += nees;
        println!(
            "listener {listener}: {} differences, {} outliers; error {:.3} m ({:.3} across, {:.3} in height), sigma {:.3} m, NEES {nees:.1}",
            given.len(),
            fix.outliers,
            error.norm(),
            error.xy().norm(),
            error.z,
            fix.covariance_m2.trace().sqrt()
        );
        assert!(error.xy().norm() < 0.25 && error.z.abs() < 0.7, "{error}");
        // What is off by metres is further from the place found than an outlier has to be.
        let limit_m = 3.0 * SIGMA_M * fix.noise_scale;
        for (h, d) in of.iter().zip(&given) {
            let [a, b] = d.anchors_m.map(|anchor| (fix.position_m - anchor).norm());
            if h.error_m().abs() > 2.0 {
                assert!(
                    (b - a - d.difference_m).abs() > limit_m,
                    "{} m",
                    h.error_m()
                );
            }
        }
    }
    // 99.9 % of chi-square with 18 degrees of freedom.
    assert!(total < 42.3, "{total}");
}
