//! A vehicle that follows a moving target: what the scenes are to show.
#![allow(clippy::unwrap_used)]

use nova_flight::tracking::{
    Controller, Estimator, TrackingRow, TrackingScene, TrackingTrial, track, track_many,
};
use std::path::PathBuf;

fn scene(name: &str) -> TrackingScene {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../scenes");
    let text = std::fs::read_to_string(folder.join(name)).unwrap();
    let scene: TrackingScene = toml::from_str(&text).unwrap();
    scene.validate().unwrap();
    scene
}

fn rows(
    scene: &TrackingScene,
    conditions: &[(Estimator, Controller, f64)],
    trials: u64,
) -> Vec<TrackingRow> {
    track_many(scene, conditions, trials, 2025, || ()).unwrap()
}

#[test]
fn the_robust_graph_errs_least_with_outliers_and_half_as_much_as_the_filter_at_a_fifth() {
    let scene = scene("fig-6.toml");
    let at = |outliers: f64| {
        let conditions = Estimator::ALL.map(|who| (who, Controller::Aware, outliers));
        let rows = rows(&scene, &conditions, 6);
        [0, 1, 2].map(|who: usize| rows[who].rmse_m)
    };
    for outliers in [0.05, 0.2, 0.4] {
        let [ekf, plain, robust] = at(outliers);
        assert!(robust < 0.9 * ekf.min(plain), "{robust} {ekf} {plain}");
        if outliers == 0.2 {
            assert!(robust < 0.5 * ekf, "{robust} against {ekf}");
        }
    }
    // Without outliers nothing is gained, and hardly anything lost.
    let [ekf, plain, robust] = at(0.0);
    assert!(robust < 1.05 * ekf.min(plain), "{robust} {ekf} {plain}");
}

#[test]
fn the_covariance_aware_controllers_stay_within_bounds_that_the_others_leave() {
    let scene = scene("fig-7.toml");
    let outliers = scene.sensor.outlier_probability[0];
    let conditions = Controller::ALL.map(|who| (Estimator::Robust, who, outliers));
    let rows = rows(&scene, &conditions, 12);
    let [clf, fixed, aware, sampled] = &rows[..] else {
        unreachable!()
    };
    assert!(clf.left_bounds == 12, "{clf:?}");
    assert!(fixed.left_bounds > 0, "{fixed:?}");
    assert_eq!(aware.left_bounds, 0, "{aware:?}");
    assert_eq!(sampled.left_bounds, 0, "{sampled:?}");
    // What the radius promises.
    for row in [aware, sampled] {
        assert!(row.inside_radius >= 0.95, "{}", row.inside_radius);
        for (inside, promised) in row.inside_ellipsoids.iter().zip([0.5, 0.8, 0.95]) {
            assert!(*inside > promised - 0.01, "{row:?}");
        }
    }
}

#[test]
fn the_radius_grows_with_worse_readings_and_only_then() {
    let scene = scene("fig-7.toml");
    let result = track(&TrackingTrial {
        scene: &scene,
        estimator: Estimator::Robust,
        controller: Controller::Aware,
        outlier_probability: 0.1,
        seed: 8001,
    })
    .unwrap();
    let mean = |from_s: f64, to_s: f64| {
        let radii: Vec<f64> = (result.moments.iter())
            .filter(|m| m.t_s >= from_s && m.t_s < to_s)
            .map(|m| m.radius_m)
            .collect();
        radii.iter().sum::<f64>() / radii.len() as f64
    };
    let (before, during, after) = (mean(8.0, 13.0), mean(17.0, 24.0), mean(27.0, 39.0));
    assert!(during > 1.5 * before, "{before} {during}");
    assert!(after < 1.3 * before, "{before} {after}");
}

#[test]
fn a_flight_is_the_same_again_and_another_seed_is_another() {
    let scene = scene("corridor.toml");
    let fly = |seed| {
        let mut result = track(&TrackingTrial {
            scene: &scene,
            estimator: Estimator::Robust,
            controller: Controller::Aware,
            outlier_probability: 0.1,
            seed,
        })
        .unwrap();
        result.step_ms.clear();
        result
    };
    assert_eq!(fly(1), fly(1));
    assert_ne!(fly(1), fly(2));
}

#[test]
fn behind_a_corner_and_with_gaps_the_target_stays_known_to_less_than_half_a_metre() {
    for (name, most_left) in [("corridor.toml", 1), ("gaps.toml", 0)] {
        let scene = scene(name);
        let conditions = [(Estimator::Robust, Controller::Aware, 0.1)];
        let row = &rows(&scene, &conditions, 6)[0];
        // Sight that is blocked unreported can cost a bound: docs/tracking.md.
        assert!(row.left_bounds <= most_left, "{name}: {row:?}");
        assert_eq!(row.refused, 0, "{name}: {row:?}");
        assert!(row.rmse_m < 0.4, "{name}: {row:?}");
    }
}

#[test]
fn models_that_take_turns_know_a_walker_better_and_stay_honest_where_sight_is_blocked() {
    let both = |name: &str| {
        let scene = scene(name);
        let who = [Estimator::Robust, Estimator::Interacting];
        rows(&scene, &who.map(|who| (who, Controller::Aware, 0.1)), 10)
    };
    let walk = both("fig-7.toml");
    assert!(walk[1].rmse_m < 0.93 * walk[0].rmse_m, "{walk:?}");
    let corridor = both("corridor.toml");
    assert!(
        corridor[0].nees > 5.0 && corridor[1].nees < 4.0,
        "{corridor:?}"
    );
    assert!(corridor[1].distance_m[0] > 1.2, "{corridor:?}");
    for row in [&walk[1], &corridor[1]] {
        assert!(row.inside_radius >= 0.95, "{row:?}");
    }
}

#[test]
fn a_controller_that_knows_the_walls_does_not_cut_the_corner() {
    let known = scene("corridor.toml");
    let clearance = known.standoff.unwrap().wall_clearance_m.unwrap();
    let conditions = [(Estimator::Interacting, Controller::Sampled, 0.1)];
    let row = rows(&known, &conditions, 10).remove(0);
    assert!(row.least_wall_m.unwrap() > clearance - 0.01, "{row:?}");
    let mut unknown = known;
    unknown.standoff.as_mut().unwrap().wall_clearance_m = None;
    let row = rows(&unknown, &conditions, 10).remove(0);
    assert!(row.least_wall_m.unwrap() < clearance, "{row:?}");
}

#[test]
fn a_tilt_that_is_reckoned_with_leaves_the_radius_honest() {
    let mut scene = scene("tilt.toml");
    let conditions = [(Estimator::Robust, Controller::Aware, 0.1)];
    let reckoned = rows(&scene, &conditions, 16).remove(0);
    scene.tracker.tilt_sigma_deg = 0.0;
    let ignored = rows(&scene, &conditions, 16).remove(0);
    assert!(ignored.nees > 1.5 * reckoned.nees, "{ignored:?}");
    assert!(reckoned.nees < 3.5, "{reckoned:?}");
    assert!(reckoned.inside_radius >= 0.95, "{reckoned:?}");
}
