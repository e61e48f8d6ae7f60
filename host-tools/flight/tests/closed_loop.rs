//! Claims about a flight in closed loop.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Homing, Legs};
use nalgebra::Vector3;
use nova_flight::{
    FlightResult, Method, Pilot, Preset, RangeSource, Recording, Scene, Settings, UwbLink, begin,
    fly_navigator, replay, trial_seed,
};
use nova_solver::navigation::Navigator;
use proptest::prelude::*;

/// Settings without any error of any sensor.
fn perfect() -> Settings {
    Settings {
        imu_scale: 0.0,
        baro_sigma_m: 0.0,
        baro_drift: 0.0,
        uwb_floor_m: 0.0,
        uwb_reference_m: 0.0,
        ..Settings::preset(Preset::P)
    }
}

fn home(settings: &Settings, seed: u64) -> (FlightResult, Recording) {
    let scene = Scene::new(settings, seed);
    let mut navigator = Homing::new(scene.first_guess);
    let mut ranges = UwbLink::new(settings, seed);
    fly_navigator(&scene, settings, seed, &mut navigator, &mut ranges)
}

fn fly_legs(settings: &Settings, seed: u64, waypoints_m: Vec<Vector3<f64>>) -> Recording {
    let scene = Scene::new(settings, seed);
    let mut ranges = UwbLink::new(settings, seed);
    fly_navigator(
        &scene,
        settings,
        seed,
        &mut Legs::new(waypoints_m),
        &mut ranges,
    )
    .1
}

/// A triangle at three heights.
fn triangle() -> Vec<Vector3<f64>> {
    vec![
        Vector3::new(10.0, 0.0, 25.0),
        Vector3::new(-5.0, 12.0, 20.0),
        Vector3::new(-5.0, -3.0, 10.0),
    ]
}

/// Distance of a point from a straight leg.
fn beside_m(point: Vector3<f64>, from: Vector3<f64>, to: Vector3<f64>) -> f64 {
    let along = to - from;
    let part = ((point - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (point - from - along * part).norm()
}

#[test]
fn perfect_sensors_land_the_vehicle_on_the_tag() {
    for pilot in [Pilot::Follow, Pilot::SelfNav] {
        let settings = Settings { pilot, ..perfect() };
        let (result, recording) = home(&settings, 3);
        assert!(result.landed, "{pilot:?}");
        // The vehicle is still closing the last centimetres of its waypoint's offset on the way down.
        assert!(result.error_m < 1e-3, "{pilot:?}: {}", result.error_m);
        assert_eq!(recording.refused, 0);
    }
}

#[test]
fn follow_flies_the_commanded_legs_whatever_the_sensors_say() {
    let settings = Settings {
        pilot: Pilot::Follow,
        imu_scale: 20.0,
        baro_sigma_m: 1.0,
        ..Settings::default()
    };
    let recording = fly_legs(&settings, 1, triangle());
    let mut corners = vec![recording.scene.start_m];
    corners.extend(triangle());
    corners.push(Vector3::new(-5.0, -3.0, 0.0));
    for &(t_s, position_m) in &recording.truth {
        let off_m = corners
            .windows(2)
            .map(|leg| beside_m(position_m, leg[0], leg[1]))
            .fold(f64::INFINITY, f64::min);
        // Corners are cut from the acceptance radius on and rounded at limited acceleration.
        assert!(off_m < 0.2, "{off_m} m off at {t_s} s");
    }
    assert_eq!(recording.arrivals.len(), 3);
    assert!(recording.landed);
    let drift_m = (recording.ins.last().unwrap().position_m - recording.end_m()).norm();
    assert!(drift_m > 1.0, "dead reckoning is really bad: {drift_m} m");
}

#[test]
fn self_nav_is_where_it_should_be_by_its_own_reckoning_and_drifts_in_truth() {
    let settings = Settings {
        pilot: Pilot::SelfNav,
        ..Settings::default()
    };
    let target = triangle()[2];
    let n = 60;
    let mut sum_squared = 0.0;
    let mut expected = 0.0;
    for trial in 0..n {
        let recording = fly_legs(&settings, trial_seed(5, trial), triangle());
        let reckoned = recording.ins.last().unwrap().position_m;
        assert!((reckoned - target).xy().norm() < 0.1);
        sum_squared += (recording.end_m() - target).xy().norm_squared();
        expected += 2.0 * settings.ins_noise().axis_noise(recording.end_s())[(0, 0)];
    }
    // 2 n squares: their sum scatters by 1/sqrt(n).
    let ratio = sum_squared / expected;
    assert!((ratio - 1.0).abs() < 4.0 / (n as f64).sqrt(), "{ratio}");
}

#[test]
fn unseen_wind_is_missing_in_dead_reckoning_and_seen_wind_is_not() {
    let n = 60;
    let mut ratio = 0.0;
    for trial in 0..n {
        let settings = Settings {
            pilot: Pilot::SelfNav,
            wind_xy: 0.35,
            wind_z: 0.15,
            ..perfect()
        };
        let seed = trial_seed(6, trial);
        let recording = fly_legs(&settings, seed, triangle());
        let last = recording.ins.last().unwrap();
        let error = last.position_m - recording.true_position_m(last.t_s);
        let variance = settings.ins_noise().axis_noise(last.t_s)[(0, 0)];
        ratio += error.xy().norm_squared() / (2.0 * variance * n as f64);
        assert!(error.z.abs() < 1e-9, "the barometer sees height");

        let seen = Settings {
            wind_seen: true,
            ..settings
        };
        let recording = fly_legs(&seen, seed, triangle());
        for sample in &recording.ins {
            let error = sample.position_m - recording.true_position_m(sample.t_s);
            assert!(error.norm() < 1e-9);
        }
    }
    assert!((ratio - 1.0).abs() < 4.0 / (n as f64).sqrt(), "{ratio}");
}

#[test]
fn gusts_do_not_keep_a_vehicle_from_arriving() {
    for pilot in [Pilot::Follow, Pilot::SelfNav] {
        for wind_hold_s in [0.1, 0.5] {
            let settings = Settings {
                pilot,
                wind_xy: 1.0,
                wind_z: 0.5,
                wind_hold_s,
                ..Settings::preset(Preset::R)
            };
            let recording = fly_legs(&settings, 2, triangle());
            assert!(recording.landed, "{pilot:?}");
            assert!(recording.end_s() < 100.0, "{} s", recording.end_s());
        }
    }
}

#[test]
fn touchdown_is_on_the_ground_even_when_the_waypoint_is_below_it() {
    let underground = vec![Vector3::new(0.0, 0.0, -5.0)];
    let recording = fly_legs(&perfect(), 4, underground);
    assert!(recording.landed);
    assert!(recording.arrivals.is_empty());
    assert!(recording.end_m().z.abs() < 1e-12);
    let slant = recording.end_m() - recording.scene.start_m;
    assert!((recording.path_length_m / slant.norm() - 1.0).abs() < 1e-6);
}

#[test]
fn a_flight_that_does_not_land_ends_at_the_time_limit() {
    let settings = Settings {
        time_limit_s: 12.0,
        ..perfect()
    };
    let (result, recording) = home(&settings, 1);
    assert!(!result.landed);
    assert_eq!(result.time_s, 12.0);
    assert_eq!(recording.end_s(), 12.0);
    assert!(recording.ins.iter().all(|sample| sample.t_s < 12.0));
}

#[test]
fn the_same_seed_gives_the_same_flight_and_another_a_different_one() {
    let settings = Settings::preset(Preset::R);
    let (_, once) = home(&settings, 7);
    let (_, again) = home(&settings, 7);
    let (_, other) = home(&settings, 8);
    assert_eq!(once.truth, again.truth);
    assert_eq!(once.ranges, again.ranges);
    assert_ne!(once.truth, other.truth);
}

/// How far two flights were apart at most, the second with its world moved by `shift`.
fn apart_m(
    settings: &Settings,
    seed: u64,
    shift: Vector3<f64>,
    navigator: impl Fn(&Scene) -> Box<dyn Navigator>,
) -> f64 {
    let truth = |tag_m| {
        let scene = Scene::around(tag_m, settings, seed);
        let mut ranges = UwbLink::new(settings, seed);
        let mut navigator = navigator(&scene);
        fly_navigator(&scene, settings, seed, navigator.as_mut(), &mut ranges)
            .1
            .truth
    };
    let (here, there) = (truth(Vector3::zeros()), truth(shift));
    here.iter()
        .zip(&there)
        .map(|((_, a), (_, b))| (b - a - shift).norm())
        .fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10))]

    #[test]
    fn moving_the_world_moves_the_flight_and_changes_nothing_else(
        seed: u64, shift in prop::array::uniform3(-200.0..200.0f64),
    ) {
        let settings = Settings {
            wind_xy: 0.3,
            ..Settings::preset(Preset::R)
        };
        let homing = |scene: &Scene| -> Box<dyn Navigator> { Box::new(Homing::new(scene.first_guess)) };
        // Multilateration stops at small steps, and rounding decides on which.
        prop_assert!(apart_m(&settings, seed, shift.into(), homing) < 1e-3);
    }
}

/// A navigator that does would fly differently each time its tag is somewhere else.
#[test]
fn no_method_makes_use_of_the_tags_being_at_the_origin() {
    let settings = Settings::default();
    let shift = Vector3::new(37.1, -150.3, 63.7);
    for method in Method::ALL {
        let moved_m: Vec<f64> = (0..3)
            .map(|trial| {
                let seed = trial_seed(9, trial);
                apart_m(&settings, seed, shift, |scene| {
                    begin(method, &settings, scene)
                })
            })
            .collect();
        // While two places explain the measurements equally well, rounding may choose between them.
        let same = moved_m.iter().filter(|&&moved_m| moved_m < 1e-3).count();
        assert!(same >= 2, "{method}: {moved_m:?} m");
    }
}

#[test]
fn switching_one_sensors_noise_off_leaves_the_others_draws_alone() {
    let noisy = Settings::preset(Preset::R);
    let quiet = Settings {
        imu_scale: 0.0,
        nlos_probability: 0.0,
        wind_xy: 0.0,
        ..noisy.clone()
    };
    let stormy = Settings {
        nlos_probability: 0.5,
        wind_xy: 0.2,
        ..noisy
    };
    let height_errors = |settings: &Settings| -> Vec<f64> {
        let recording = fly_legs(settings, 3, triangle());
        let ins = recording.ins.iter().take(100);
        ins.map(|sample| sample.position_m.z - recording.true_position_m(sample.t_s).z)
            .collect()
    };
    for (a, b) in height_errors(&quiet).iter().zip(height_errors(&stormy)) {
        assert!((a - b).abs() < 1e-12);
    }
    // The link on one path: the ranges that are not late are as they were.
    let at = Vector3::new(3.0, 4.0, 12.0);
    let ranges = |settings: &Settings| -> Vec<f64> {
        let mut link = UwbLink::new(settings, 9);
        (0..1000)
            .map(|i| link.range(f64::from(i), at, Vector3::zeros()).unwrap())
            .collect()
    };
    let (clear, blocked) = (ranges(&quiet), ranges(&stormy));
    let same = clear.iter().zip(&blocked).filter(|(a, b)| a == b).count();
    assert!((400..600).contains(&same), "{same}");
    assert!(clear.iter().zip(&blocked).all(|(a, b)| a <= b));
}

#[test]
fn lost_ranges_do_not_stop_dead_reckoning_nor_the_flight() {
    let settings = Settings {
        uwb_required_snr_db: 60.0,
        ..Settings::default()
    };
    let recording = fly_legs(&settings, 1, triangle());
    assert!(recording.ranges.is_empty());
    assert!(recording.landed && recording.ins.len() > 300);
}

#[test]
fn a_method_on_its_own_recorded_flight_finds_what_it_found_in_flight() {
    let settings = Settings::default();
    let (_, recording) = home(&settings, 5);
    let mut navigator = Homing::new(recording.scene.first_guess);
    let errors = replay(&recording, &mut navigator);
    assert_eq!(recording.arrivals.len(), 4);
    let (_, last) = recording.estimates.last().unwrap();
    let (t_s, error_m) = *errors.last().unwrap();
    let in_flight_m = recording.relative_error_m(last, t_s).norm();
    assert_eq!(error_m, in_flight_m);
    let first_s = recording.estimates[0].0;
    assert_eq!(errors[0].0, first_s, "the first estimate comes as early");
}

#[test]
fn the_overhead_is_path_length_over_the_ideal_path() {
    let settings = perfect();
    let scene = Scene::new(&settings, 1);
    let over_tag = Vector3::new(0.0, 0.0, settings.altitude_m);
    let mut ranges = UwbLink::new(&settings, 1);
    let mut navigator = Legs::new(vec![over_tag]);
    let (result, recording) = fly_navigator(&scene, &settings, 1, &mut navigator, &mut ranges);
    let around_corner_m = recording.path_length_m;
    // Only the corner is cut.
    assert!((around_corner_m - 50.0).abs() < 0.3, "{around_corner_m}");
    assert_eq!(result.overhead, around_corner_m / 50.0 - 1.0);
    // Speeding up and the corner cost a little.
    assert!((50.0..52.0).contains(&result.time_s), "{}", result.time_s);
}
