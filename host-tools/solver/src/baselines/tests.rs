//! Both baselines on a small world of their own: dead reckoning whose velocity is wrong by a
//! constant, ranges with noise.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::navigation::{Action, FirstGuess, InputFault, InsSample, Navigator, Phase, RangeSample};

const TAG: Vector3<f64> = Vector3::new(2.0, -1.0, 0.0);

struct World {
    /// Error of dead reckoning's velocity, m/s.
    drift_m_s: Vector3<f64>,
    sigma_m: f64,
    origin_m: Vector3<f64>,
    rng: ChaCha8Rng,
}

impl World {
    fn new(drift_m_s: Vector3<f64>, sigma_m: f64, seed: u64) -> Self {
        Self {
            drift_m_s,
            sigma_m,
            origin_m: Vector3::zeros(),
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    fn quiet() -> Self {
        Self::new(Vector3::zeros(), 0.0, 0)
    }

    fn start(&self) -> FirstGuess {
        FirstGuess {
            tag_m: TAG + self.origin_m,
        }
    }

    fn show(&mut self, navigator: &mut dyn Navigator, t_s: f64, vehicle_m: Vector3<f64>) {
        let noise: f64 = StandardNormal.sample(&mut self.rng);
        let ins = InsSample {
            t_s,
            position_m: vehicle_m + self.origin_m + self.drift_m_s * t_s,
        };
        let range = RangeSample {
            t_s,
            range_m: (TAG - vehicle_m).norm() + self.sigma_m * noise,
        };
        navigator.on_ins(ins).unwrap();
        navigator.on_range(range).unwrap();
    }

    /// Shows a winding flight of `seconds` and returns the horizontal error at its end.
    fn error_after(&mut self, navigator: &mut dyn Navigator, seconds: u32) -> f64 {
        let mut vehicle_m = winding(0.0);
        for i in 0..=10 * seconds {
            let t_s = 0.1 * f64::from(i);
            vehicle_m = winding(t_s);
            self.show(navigator, t_s, vehicle_m);
        }
        let estimate = navigator.estimate().unwrap();
        let relative_m = estimate.tag_m - estimate.vehicle_m;
        (relative_m - (TAG - vehicle_m)).xy().norm()
    }
}

/// Once around the tag in a minute, going down.
fn winding(t_s: f64) -> Vector3<f64> {
    let angle = 0.1 * t_s;
    Vector3::new(12.0 * angle.cos(), 12.0 * angle.sin(), 20.0 - 0.2 * t_s)
}

fn sa(start: FirstGuess) -> SingleAnchor {
    SingleAnchor::new(start, SingleAnchorOptions::default())
}

fn rp(start: FirstGuess) -> RelativeCkf {
    RelativeCkf::new(start, 0.1, RelativeCkfOptions::default())
}

#[test]
fn perfect_sensors_keep_a_perfect_start() {
    let mut world = World::quiet();
    assert!(world.error_after(&mut sa(world.start()), 60) < 1e-3);
    // The mean distance of a cloud is a little more than the distance of its middle.
    assert!(world.error_after(&mut rp(world.start()), 60) < 0.02);
}

#[test]
fn ranges_hold_the_drift_of_dead_reckoning() {
    let drift = Vector3::new(0.04, -0.03, 0.0);
    let dead_reckoning = (drift * 60.0).norm();
    for seed in 0..5 {
        let mut world = World::new(drift, 0.05, seed);
        let single = world.error_after(&mut sa(world.start()), 60);
        let relative = world.error_after(&mut rp(world.start()), 60);
        assert!(single < 0.25 * dead_reckoning, "SA {single}");
        assert!(relative < 0.1 * dead_reckoning, "RP {relative}");
    }
}

#[test]
fn a_start_that_is_wrong_and_believed_costs_the_filter_more_than_its_noise() {
    for seed in 0..5 {
        let mut world = World::new(Vector3::new(0.04, 0.0, 0.0), 0.05, seed);
        let good = world.error_after(&mut rp(world.start()), 20);
        let wrong = FirstGuess {
            tag_m: TAG + Vector3::new(4.0, 3.0, 5.0),
        };
        let bad = world.error_after(&mut rp(wrong), 20);
        assert!(bad > 5.0 * good && bad > 1.0, "{good} {bad}");
    }
}

#[test]
fn reported_covariance_covers_the_error_of_the_filter() {
    let mut inside = 0;
    for seed in 0..40 {
        let mut rng = ChaCha8Rng::seed_from_u64(1000 + seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let drift = Vector3::new(normal(), normal(), 0.0) * 0.02;
        let mut world = World::new(drift, 0.1, seed);
        let mut navigator = rp(world.start());
        let error = world.error_after(&mut navigator, 60);
        let covariance = navigator
            .estimate()
            .unwrap()
            .relative_covariance_m2
            .unwrap();
        // Twice the root of the trace: 98 % of a round Gaussian.
        inside += u32::from(error * error < 4.0 * (covariance[(0, 0)] + covariance[(1, 1)]));
    }
    assert!(inside >= 36, "{inside} of 40");
}

#[test]
fn ranges_that_contradict_the_motion_are_not_used() {
    let mut world = World::quiet();
    let mut navigator = rp(world.start());
    world.error_after(&mut navigator, 20);
    let before = (navigator.updates(), navigator.estimate().unwrap().tag_m);
    for i in 1..=30 {
        let t_s = 20.0 + 0.1 * f64::from(i);
        navigator
            .on_ins(InsSample {
                t_s,
                position_m: winding(t_s),
            })
            .unwrap();
        // Away from the tag at two metres a second, says the radio.
        let range_m = (TAG - winding(20.0)).norm() + 2.0 * (t_s - 20.0);
        navigator.on_range(RangeSample { t_s, range_m }).unwrap();
    }
    let used = navigator.updates() - before.0;
    assert!(used < 10, "{used} of 30 used");
}

/// Flies where the commands say, by the very position that dead reckoning shows; returns where the
/// vehicle touches down.
fn fly(navigator: &mut dyn Navigator, world: &mut World) -> Option<Vector3<f64>> {
    let mut vehicle_m = Vector3::new(15.0, 8.0, 12.0);
    let mut phases = vec![navigator.phase()];
    for i in 0..1000 {
        let t_s = 0.1 * f64::from(i);
        world.show(navigator, t_s, vehicle_m);
        if navigator.phase() != *phases.last()? {
            phases.push(navigator.phase());
        }
        let command = navigator.command();
        let seen_m = vehicle_m + world.origin_m + world.drift_m_s * t_s;
        let way = command.waypoint_m - seen_m;
        if command.action == Action::Fly && way.norm() < 0.1 {
            navigator.on_arrival(command.id);
        }
        vehicle_m += way * (0.1 / way.norm().max(0.1));
        if vehicle_m.z <= 0.0 || (command.action == Action::Land && way.norm() < 0.01) {
            let order = [Phase::Initial, Phase::MidFlight, Phase::Landing];
            assert_eq!(phases, order);
            return Some(vehicle_m);
        }
    }
    None
}

#[test]
fn they_fly_to_the_tag_and_land_on_it_though_dead_reckoning_drifts() {
    let drift = Vector3::new(0.01, 0.01, 0.0);
    for method in 0..2 {
        let mut world = World::new(drift, 0.02, 3);
        let mut navigator: Box<dyn Navigator> = match method {
            0 => Box::new(sa(world.start())),
            _ => Box::new(rp(world.start())),
        };
        let end_m = fly(navigator.as_mut(), &mut world).unwrap();
        assert!((end_m - TAG).norm() < 0.5, "{method}: {end_m}");
    }
}

#[test]
fn moving_the_world_moves_the_answer_and_nothing_else() {
    let drift = Vector3::new(0.03, 0.01, 0.0);
    let mut here = World::new(drift, 0.05, 4);
    let mut there = World::new(drift, 0.05, 4);
    there.origin_m = Vector3::new(300.0, -200.0, 50.0);
    let pairs: [[Box<dyn Navigator>; 2]; 2] = [
        [Box::new(sa(here.start())), Box::new(sa(there.start()))],
        [Box::new(rp(here.start())), Box::new(rp(there.start()))],
    ];
    for [mut a, mut b] in pairs {
        let one = here.error_after(a.as_mut(), 30);
        let other = there.error_after(b.as_mut(), 30);
        assert!((one - other).abs() < 1e-6, "{one} {other}");
        let moved = b.command().waypoint_m - a.command().waypoint_m;
        assert!((moved - there.origin_m).norm() < 1e-6);
    }
}

#[test]
fn unusable_readings_are_refused_and_change_nothing() {
    let mut world = World::new(Vector3::zeros(), 0.05, 5);
    let navigators: [Box<dyn Navigator>; 2] =
        [Box::new(sa(world.start())), Box::new(rp(world.start()))];
    for mut navigator in navigators {
        world.error_after(navigator.as_mut(), 5);
        let before = (navigator.estimate(), navigator.command());
        let nan = RangeSample {
            t_s: 5.1,
            range_m: f64::NAN,
        };
        assert_eq!(navigator.on_range(nan), Err(InputFault::NotFinite));
        let back = InsSample {
            t_s: 1.0,
            position_m: TAG,
        };
        assert!(matches!(
            navigator.on_ins(back),
            Err(InputFault::TimeNotIncreasing { .. })
        ));
        assert_eq!((navigator.estimate(), navigator.command()), before);
    }
}

#[test]
fn a_vehicle_at_rest_on_the_tag_yields_finite_numbers() {
    let mut world = World::new(Vector3::zeros(), 0.05, 6);
    let navigators: [Box<dyn Navigator>; 2] =
        [Box::new(sa(world.start())), Box::new(rp(world.start()))];
    for mut navigator in navigators {
        for i in 0..300 {
            world.show(navigator.as_mut(), 0.1 * f64::from(i), TAG);
        }
        let estimate = navigator.estimate().unwrap();
        assert!(estimate.tag_m.iter().all(|c| c.is_finite()));
        let covariance = estimate.relative_covariance_m2.unwrap();
        assert!(covariance.cholesky().is_some());
    }
}
