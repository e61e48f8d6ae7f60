//! The path, the field, the filters and the mission of a delivery.
#![allow(clippy::unwrap_used, clippy::panic)]

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use nova_solver::delivery::{
    CameraMount, Delayed, DeliveryFrame, DeliveryPath, ErrorStateFilter, ErrorStateOptions,
    EulerEkf, EulerEkfOptions, FieldOptions, Input, LandingFilter, Measurement, Mission,
    MissionOptions, Order, Pose, Sector, Situation, State, Trouble, VectorField, Verdict,
};
use nova_solver::geodesy::Geodetic;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn paper_path() -> DeliveryPath {
    DeliveryPath::new(45.0, 6.0, 100.03).unwrap()
}

fn field() -> VectorField {
    VectorField::new(paper_path(), FieldOptions::default())
}

#[test]
fn the_frame_has_its_origin_at_the_goal_and_its_x_axis_towards_it() {
    let start = Geodetic::new(-19.87, -43.97, 800.0).unwrap();
    let goal = Geodetic::new(-19.8693, -43.9694, 803.0).unwrap();
    let frame = DeliveryFrame::between(&start, &goal).unwrap();
    let there = frame.place(&start);
    assert!(frame.place(&goal).norm() < 1e-6);
    assert!(
        (there.x + frame.separation_m()).abs() < 1e-6 && there.y.abs() < 1e-6,
        "{there}"
    );
    assert!((there.z + 3.0).abs() < 0.01, "{there}");
    let vector = Vector3::new(1.0, 2.0, 3.0);
    assert!((frame.along_axes(&frame.to_enu(&vector)) - vector).norm() < 1e-12);
    assert!(DeliveryFrame::between(&goal, &goal).is_err());
}

#[test]
fn numbers_that_make_no_path_are_refused() {
    for (h, r, d) in [
        (5.0, 6.0, 100.0),
        (45.0, 60.0, 100.0),
        (0.0, 6.0, 100.0),
        (45.0, f64::NAN, 100.0),
    ] {
        assert!(DeliveryPath::new(h, r, d).is_err(), "{h} {r} {d}");
    }
}

#[test]
fn the_path_is_walked_through_its_five_sectors_in_order() {
    let path = paper_path();
    let dt_s = 0.02;
    let mut place = path.start_m();
    let mut sectors = vec![path.sector(&place)];
    let mut last_along_m = 0.0;
    let mut before = field().velocity_m_s(&place, true);
    for _ in 0..20_000 {
        let velocity = field().velocity_m_s(&place, true);
        // Smooth, borders included: no more than centripetal and wanted acceleration together.
        let acceleration = (velocity - before).norm() / dt_s;
        assert!(acceleration < 1.8, "{acceleration} at {place}");
        before = velocity;
        place += velocity * dt_s;
        if place.z <= 0.0 && path.sector(&place) == Sector::Descent {
            break;
        }
        let along_m = path.along_m(&place);
        assert!(along_m > last_along_m, "{along_m} at {place}");
        last_along_m = along_m;
        assert!(path.distance_m(&place) < 0.1, "{}", path.distance_m(&place));
        if sectors.last() != Some(&path.sector(&place)) {
            sectors.push(path.sector(&place));
        }
    }
    use Sector::{Climb, Cruise, Descent, FirstArc, SecondArc};
    assert_eq!(sectors, [Climb, FirstArc, Cruise, SecondArc, Descent]);
    assert!(place.norm() < 0.1, "{place}");
}

proptest! {
    #[test]
    fn speeds_and_directions_are_the_same_on_both_sides_of_each_border(
        side_m in -5.0..5.0f64, off_m in -3.0..3.0f64,
    ) {
        let (h, r, d) = (45.0, 6.0, 100.03);
        const STEP: f64 = 1e-7;
        // A place on each border near the path, and the way across.
        for (on, across) in [
            (Vector3::new(-d + off_m, side_m, h - r), Vector3::z()),
            (Vector3::new(-d + r, side_m, h + off_m), Vector3::x()),
            (Vector3::new(-r, side_m, h + off_m), Vector3::x()),
            (Vector3::new(off_m, side_m, h - r), Vector3::z()),
        ] {
            let [a, b] = [on - across * STEP, on + across * STEP];
            prop_assert_ne!(paper_path().sector(&a), paper_path().sector(&b));
            let v_before = paper_path().lyapunov_m2(&a);
            let v_after = paper_path().lyapunov_m2(&b);
            prop_assert!((v_before - v_after).abs() < 1e-4, "{on}");
            for forwards in [true, false] {
                let jump = field().velocity_m_s(&a, forwards) - field().velocity_m_s(&b, forwards);
                prop_assert!(jump.norm() < 1e-4, "{jump} at {on}");
            }
        }
    }

    #[test]
    fn the_field_has_the_wanted_speed_and_never_leads_away_from_the_path(
        place in [-120.0..20.0f64, -30.0..30.0, 0.0..70.0], forwards in any::<bool>(),
    ) {
        let place = Vector3::from(place);
        let velocity = field().velocity_m_s(&place, forwards);
        let speed = field().speed_m_s(&place, forwards);
        prop_assert!((velocity.norm() - speed).abs() < 1e-9 * speed.max(1.0));
        // dV/dt along the field, within a sector, is not positive (Goncalves et al. 2010).
        let step = velocity * 1e-6;
        if paper_path().sector(&(place + step)) == paper_path().sector(&place) {
            let change = paper_path().lyapunov_m2(&(place + step)) - paper_path().lyapunov_m2(&place);
            prop_assert!(change <= 1e-9, "{change} at {place}");
        }
    }

    #[test]
    fn from_beside_any_sector_the_path_is_reached_and_followed_to_its_end(
        along in 0.0..1.0f64, aside in [-5.0..5.0f64, -5.0..5.0], forwards in any::<bool>(),
    ) {
        // Beside the path, nearer than the radius of the arcs: farther in, borders between sectors that are not neighbours begin.
        let path = paper_path();
        let begin = if forwards { path.start_m() } else { Vector3::zeros() };
        let mut place = begin;
        let dt_s = 0.05;
        for _ in 0..(along * 1500.0) as u32 {
            place += field().velocity_m_s(&place, forwards) * dt_s;
        }
        place += Vector3::new(aside[0], aside[1], 0.0);
        let mut worst_late_m: f64 = 0.0;
        let goal = if forwards { Vector3::zeros() } else { path.start_m() };
        for tick in 0..6000 {
            place += field().velocity_m_s(&place, forwards) * dt_s;
            let down = if forwards { Sector::Descent } else { Sector::Climb };
            if place.z <= 0.0 && path.sector(&place) == down {
                break;
            }
            if tick > 1200 {
                worst_late_m = worst_late_m.max(path.distance_m(&place));
            }
        }
        prop_assert!(worst_late_m < 0.2, "{worst_late_m}");
        // What is left of 5 m depends on how little way there was to the ground.
        if along < 0.5 {
            prop_assert!((place - goal).norm() < 0.3, "{place}");
        }
    }
}

// ---- Filters ----

fn truth(t_s: f64) -> Pose {
    Pose {
        position_m: Vector3::new(
            0.5 * (0.4 * t_s).sin(),
            0.3 * (0.3 * t_s).cos(),
            8.0 - 0.25 * t_s,
        ),
        attitude: UnitQuaternion::from_euler_angles(
            0.05 * (1.1 * t_s).sin(),
            0.04 * (0.9 * t_s).cos(),
            0.2 + 0.01 * t_s,
        ),
    }
}

fn input(t_s: f64, dt_s: f64) -> Input {
    let (a, b) = (truth(t_s), truth(t_s + dt_s));
    Input {
        velocity_m_s: (b.position_m - a.position_m) / dt_s,
        rate_rad_s: (a.attitude.inverse() * b.attitude).scaled_axis() / dt_s,
    }
}

const BIAS: [f64; 3] = [1.2, -0.8, 0.5];

fn gps(t_s: f64) -> Measurement {
    Measurement::Autopilot {
        position_m: truth(t_s).position_m + Vector3::from(BIAS),
        attitude: truth(t_s).attitude,
    }
}

fn marker(t_s: f64) -> Measurement {
    let (position_m, attitude) = CameraMount::looking_down(Vector3::zeros()).marker(&truth(t_s));
    Measurement::Marker {
        position_m,
        attitude,
        sigma_m: [0.02, 0.05],
        sigma_rad: [0.1, 0.1, 0.02],
    }
}

fn first() -> Pose {
    let truth = truth(0.0);
    Pose {
        position_m: truth.position_m + Vector3::from(BIAS),
        ..truth
    }
}

fn ekf() -> EulerEkf {
    EulerEkf::new(&first(), 0.1, EulerEkfOptions::default())
}

fn error_state() -> ErrorStateFilter {
    ErrorStateFilter::new(&first(), ErrorStateOptions::default())
}

/// Flies for 20 s; the marker is seen from 5 s on. Error of place, error of bias, at the end.
fn flown(filter: impl LandingFilter + Clone, late_s: f64, compensated: bool) -> (f64, f64) {
    let dt_s = 0.01;
    let mut delayed = Delayed::new(filter, 0.0, 0.5);
    for tick in 0..2000 {
        let t_s = f64::from(tick) * dt_s;
        delayed.input(t_s, input(t_s, dt_s));
        if tick % 5 == 0 {
            delayed.measurement(t_s, gps(t_s));
        }
        if tick % 7 == 0 && t_s > 5.0 {
            let taken_s = t_s - late_s;
            let told_s = if compensated { taken_s } else { t_s };
            delayed.measurement(told_s, marker(taken_s));
        }
    }
    let pose = delayed.filter().pose();
    let bias = delayed.filter().gps_bias_m() - Vector3::from(BIAS);
    (
        (pose.position_m - truth(19.99).position_m).norm(),
        bias.norm(),
    )
}

#[test]
fn both_filters_learn_the_bias_of_gps_from_the_marker() {
    let (paper_m, paper_bias_m) = flown(ekf(), 0.0, true);
    let (ours_m, ours_bias_m) = flown(error_state(), 0.0, true);
    println!("EKF {paper_m:.4} {paper_bias_m:.4}, error state {ours_m:.4} {ours_bias_m:.4}");
    assert!(paper_m < 0.05 && ours_m < 0.02);
    assert!(ours_bias_m < 0.05 && paper_bias_m < 0.3);
}

#[test]
fn late_measurements_do_no_harm_where_their_time_is_known() {
    let (known_m, _) = flown(error_state(), 0.2, true);
    let (unknown_m, _) = flown(error_state(), 0.2, false);
    println!("late by 0.2 s: {known_m:.4} m, taken for new {unknown_m:.4} m");
    assert!(known_m < 0.02 && unknown_m > 2.0 * known_m);
}

#[test]
fn a_marker_that_is_somewhere_else_is_an_outlier() {
    let mut filter = error_state();
    for k in 0..50 {
        let t_s = 0.01 * f64::from(k);
        filter.predict(&input(t_s, 0.01), 0.01);
        assert_eq!(filter.update(&marker(t_s + 0.01)), Verdict::Used);
    }
    let before = filter.pose();
    let Measurement::Marker {
        position_m,
        attitude,
        sigma_m,
        sigma_rad,
    } = marker(0.5)
    else {
        panic!();
    };
    let elsewhere = Measurement::Marker {
        position_m: position_m + Vector3::new(1.0, 0.0, 0.0),
        attitude,
        sigma_m,
        sigma_rad,
    };
    assert_eq!(filter.update(&elsewhere), Verdict::Outlier);
    assert_eq!(filter.pose(), before);
    let nonsense = Measurement::Uwb {
        position_m: Vector3::repeat(f64::NAN),
        covariance_m2: Matrix3::identity(),
    };
    assert_eq!(filter.update(&nonsense), Verdict::Unusable);
    assert_eq!(filter.pose(), before);
}

proptest! {
    #[test]
    fn a_late_measurement_leaves_what_it_would_have_left_in_time(
        order in prop::collection::vec((0..40u32, 0..30u32), 1..12),
    ) {
        // Each measurement has a time and arrives some ticks later; two of one time would change places.
        let mut order = order;
        order.sort_unstable();
        order.dedup_by_key(|(taken, _)| *taken);
        let dt_s = 0.01;
        let run = |late: bool| {
            let mut filter = Delayed::new(error_state(), 0.0, 1.0);
            for tick in 0..80u32 {
                let t_s = f64::from(tick) * dt_s;
                filter.input(t_s, input(t_s, dt_s));
                for &(taken, delay) in &order {
                    if taken + if late { delay } else { 0 } == tick {
                        // Between two inputs, so that the order is defined.
                        let taken_s = (f64::from(taken) + 0.5) * dt_s;
                        filter.measurement(taken_s, marker(taken_s));
                    }
                }
            }
            filter.filter().pose()
        };
        let (in_time, late) = (run(false), run(true));
        prop_assert!((in_time.position_m - late.position_m).norm() < 1e-9);
        prop_assert!(in_time.attitude.angle_to(&late.attitude) < 1e-9);
    }

    #[test]
    fn covariances_stay_positive_whatever_is_measured(seed in any::<u64>()) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut paper, mut ours) = (ekf(), error_state());
        for tick in 0..300 {
            let t_s = 0.01 * f64::from(tick);
            let shake = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            let measurement = match rng.random_range(0..4) {
                0 => gps(t_s),
                1 => marker(t_s),
                _ => Measurement::Uwb { position_m: truth(t_s).position_m + shake, covariance_m2: Matrix3::identity() * 0.04 },
            };
            let input = Input { velocity_m_s: shake, rate_rad_s: shake };
            for filter in [&mut paper as &mut dyn LandingFilter, &mut ours] {
                filter.predict(&input, 0.01);
                filter.update(&measurement);
                let covariance = filter.position_covariance_m2();
                prop_assert!(covariance.symmetric_eigenvalues().min() > 0.0);
                prop_assert!(filter.pose().position_m.iter().all(|v| v.is_finite()));
            }
        }
    }
}

// ---- Mission ----

fn mission() -> Mission {
    Mission::new(MissionOptions {
        length_m: 185.0,
        retry_height_m: 15.0,
        decision_height_m: 5.0,
        most_sigma_m: 0.3,
        tries: 3,
        lost_s: 1.0,
        local_lost_s: 1.5,
        longest_search_s: 20.0,
        longest_hold_s: 15.0,
        low_battery: 0.3,
        empty_battery: 0.1,
        fence_m: 10.0,
    })
}

fn cruising() -> Situation {
    Situation {
        t_s: 10.0,
        along_m: 80.0,
        height_m: 45.0,
        sigma_m: 1.5,
        off_path_m: 0.2,
        gps_age_s: 0.1,
        local_age_s: f64::INFINITY,
        battery: 0.9,
        on_ground: false,
        released: false,
    }
}

fn landing() -> Situation {
    Situation {
        along_m: 182.0,
        height_m: 3.0,
        sigma_m: 0.05,
        local_age_s: 0.1,
        ..cruising()
    }
}

#[test]
fn a_package_is_released_on_the_ground_and_the_vehicle_returns() {
    let mut mission = mission();
    let on_ground = Situation {
        on_ground: true,
        height_m: 0.0,
        ..landing()
    };
    // On the ground at the start it takes off.
    let start = Situation {
        along_m: 0.0,
        height_m: 0.0,
        on_ground: true,
        ..cruising()
    };
    assert_eq!(mission.step(&start), Order::FollowToGoal);
    assert_eq!(mission.step(&cruising()), Order::FollowToGoal);
    assert_eq!(mission.step(&landing()), Order::FollowToGoal);
    assert_eq!(mission.step(&on_ground), Order::Release);
    let empty = Situation {
        released: true,
        ..on_ground
    };
    assert_eq!(mission.step(&empty), Order::FollowToStart);
    assert_eq!(
        mission.step(&Situation {
            released: true,
            ..cruising()
        }),
        Order::FollowToStart
    );
    assert_eq!(
        mission.step(&Situation {
            released: true,
            ..start
        }),
        Order::Stop
    );
    assert!(mission.troubles().is_empty());
}

#[test]
fn each_trouble_has_its_answer() {
    let gone = f64::INFINITY;
    for (now, order, trouble) in [
        (
            Situation {
                gps_age_s: gone,
                ..cruising()
            },
            Order::Hold,
            Some(Trouble::NoPlace),
        ),
        // GPS lost over the marker: the marker is enough.
        (
            Situation {
                gps_age_s: gone,
                ..landing()
            },
            Order::FollowToGoal,
            None,
        ),
        (
            Situation {
                local_age_s: 2.0,
                ..landing()
            },
            Order::Search,
            Some(Trouble::NotFound),
        ),
        // By the height that it believes it is not there yet; the ground says otherwise.
        (
            Situation {
                local_age_s: gone,
                on_ground: true,
                height_m: 7.0,
                ..landing()
            },
            Order::Climb,
            Some(Trouble::Unsure),
        ),
        (
            Situation {
                sigma_m: 0.8,
                ..landing()
            },
            Order::Climb,
            Some(Trouble::Unsure),
        ),
        (
            Situation {
                sigma_m: f64::NAN,
                ..landing()
            },
            Order::Climb,
            Some(Trouble::Unsure),
        ),
        (
            Situation {
                battery: 0.2,
                ..cruising()
            },
            Order::FollowToStart,
            Some(Trouble::LowBattery),
        ),
        (
            Situation {
                battery: 0.2,
                ..landing()
            },
            Order::FollowToGoal,
            None,
        ),
        (
            Situation {
                battery: 0.05,
                ..cruising()
            },
            Order::HandOver,
            Some(Trouble::EmptyBattery),
        ),
        (
            Situation {
                off_path_m: 12.0,
                ..cruising()
            },
            Order::FollowToStart,
            Some(Trouble::Fence),
        ),
        (
            Situation {
                off_path_m: 25.0,
                ..cruising()
            },
            Order::HandOver,
            Some(Trouble::Fence),
        ),
    ] {
        let mut mission = mission();
        assert_eq!(mission.step(&now), order, "{now:?}");
        assert_eq!(
            mission.troubles().first().map(|(_, what)| *what),
            trouble,
            "{now:?}"
        );
    }
}

#[test]
fn a_hold_ends_with_the_place_or_is_handed_over() {
    let lost = |t_s| Situation {
        t_s,
        gps_age_s: 5.0,
        ..cruising()
    };
    let mut back = mission();
    assert_eq!(back.step(&lost(10.0)), Order::Hold);
    assert_eq!(back.step(&lost(20.0)), Order::Hold);
    assert_eq!(back.step(&cruising()), Order::FollowToGoal);
    let mut gone = mission();
    gone.step(&lost(10.0));
    assert_eq!(gone.step(&lost(25.5)), Order::HandOver);
    assert_eq!(gone.step(&cruising()), Order::HandOver);
}

#[test]
fn a_search_ends_with_what_it_looks_for_or_with_another_try() {
    let blind = |t_s| Situation {
        t_s,
        sigma_m: 1.5,
        local_age_s: f64::INFINITY,
        ..landing()
    };
    let found = Situation {
        t_s: 25.0,
        ..landing()
    };
    let mut lucky = mission();
    assert_eq!(lucky.step(&blind(10.0)), Order::Search);
    assert_eq!(lucky.step(&blind(24.0)), Order::Search);
    assert_eq!(lucky.step(&found), Order::FollowToGoal);
    let mut other = mission();
    assert_eq!(other.step(&blind(10.0)), Order::Search);
    assert_eq!(other.step(&blind(30.5)), Order::Climb);
    let above = Situation {
        height_m: 16.0,
        ..blind(40.0)
    };
    assert_eq!(other.step(&above), Order::FollowToGoal);
    // The second try looks from a third lower: 3.3 m.
    let at = |height_m| Situation {
        height_m,
        ..blind(50.0)
    };
    assert_eq!(other.step(&at(3.4)), Order::FollowToGoal);
    assert_eq!(other.step(&at(3.2)), Order::Search);
}

#[test]
fn the_third_unsure_landing_takes_the_package_back() {
    let mut mission = mission();
    let unsure = Situation {
        sigma_m: 0.5,
        height_m: 1.0,
        ..landing()
    };
    let above = Situation {
        height_m: 16.0,
        ..landing()
    };
    let orders: Vec<Order> = [unsure, landing(), above, unsure, above, unsure]
        .iter()
        .map(|now| mission.step(now))
        .collect();
    use Order::{Climb, FollowToGoal, FollowToStart};
    assert_eq!(
        orders,
        [
            Climb,
            Climb,
            FollowToGoal,
            Climb,
            FollowToGoal,
            FollowToStart
        ]
    );
}

proptest! {
    #[test]
    fn whatever_happens_nothing_is_released_in_the_air_nor_unseen_and_ends_are_final(
        events in prop::collection::vec((0.0..200.0f64, 0.0..50.0f64, 0.0..1.0f64, 0.0..30.0f64, 0..64u32), 1..200),
    ) {
        let mut mission = mission();
        let mut released = false;
        for (k, (along_m, height_m, battery, off_path_m, bits)) in events.into_iter().enumerate() {
            let bit = |n: u32| bits >> n & 1 == 1;
            let before = mission.state();
            let now = Situation {
                t_s: k as f64,
                along_m,
                height_m,
                sigma_m: if bit(0) { 0.1 } else { 1.0 },
                off_path_m,
                gps_age_s: if bit(1) { 0.0 } else { 9.0 },
                local_age_s: if bit(2) { 0.0 } else { 9.0 },
                battery,
                on_ground: bit(3),
                released,
            };
            let order = mission.step(&now);
            if order == Order::Release {
                prop_assert!(before == State::Releasing || (now.on_ground && along_m > 92.5 && bit(0) && bit(2)));
                released = bit(4);
            }
            if matches!(before, State::Finished | State::HandedOver) {
                prop_assert_eq!(mission.state(), before);
            }
            if released {
                prop_assert!(order != Order::FollowToGoal);
            }
        }
    }
}
