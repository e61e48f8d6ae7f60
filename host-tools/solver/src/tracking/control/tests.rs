use super::*;
use nalgebra::Matrix3;
use proptest::prelude::*;

fn vector(most: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-most..most).prop_map(Vector3::from)
}

fn unit() -> impl Strategy<Value = Vector3<f64>> {
    vector(1.0).prop_filter_map("too short", |v| v.try_normalize(0.1))
}

fn belief(position_m: Vector3<f64>, velocity_m_s: Vector3<f64>, sigma_m: f64) -> Belief {
    Belief::about(position_m, sigma_m, velocity_m_s, 0.1)
}

/// The nearest point by brute force: for one multiplier of the line of sight the box is a clamp, and
/// the value along it falls with the multiplier.
fn nearest(
    reference: &Vector3<f64>,
    n: &Vector3<f64>,
    side: f64,
    limits: &AccelerationBox,
) -> Vector3<f64> {
    let at = |multiplier: f64| {
        (reference - n * multiplier)
            .zip_zip_map(&limits.low, &limits.high, |u, low, high| u.clamp(low, high))
    };
    let (mut low, mut high) = (-1e3, 1e3);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if n.dot(&at(middle)) > side {
            low = middle;
        } else {
            high = middle;
        }
    }
    at(high)
}

proptest! {
    #[test]
    fn the_command_is_the_nearest_that_keeps_all_limits(
        reference in vector(6.0), sight in unit(), velocity in vector(3.9),
        least in -8.0..8.0_f64, width in 0.1..6.0_f64,
    ) {
        let o = StandoffOptions::default();
        let vehicle = VehicleState { position_m: Vector3::zeros(), velocity_m_s: velocity };
        let limits = limits(&o, &vehicle);
        let along = Along { least, most: least + width };
        let (u, decision) = program::command(&reference, &sight, along, &limits);
        for axis in 0..3 {
            prop_assert!(u[axis] >= limits.low[axis] && u[axis] <= limits.high[axis]);
            prop_assert!((velocity[axis] + o.step_s * u[axis]).abs() <= o.speed + 1e-9);
        }
        let value = sight.dot(&u);
        match decision {
            Decision::Reference | Decision::Guarded => {
                prop_assert!(value >= along.least - 1e-6 && value <= along.most + 1e-6);
                let free = limits_clamped(&reference, &limits);
                let expected = if sight.dot(&free) > along.most {
                    nearest(&reference, &sight, along.most, &limits)
                } else if sight.dot(&free) < along.least {
                    nearest(&reference, &sight, along.least, &limits)
                } else {
                    free
                };
                prop_assert!((u - expected).norm() < 1e-5, "{u} {expected}");
            }
            // Nothing in the box is better.
            Decision::FullBraking => prop_assert!(value >= along.most - 1e-5),
            Decision::FullChase => prop_assert!(value <= along.least + 1e-5),
            other => prop_assert!(false, "{other:?}"),
        }
    }

    /// Where both bounds contradict each other, the near one is kept if anything keeps it.
    #[test]
    fn a_contradiction_is_solved_for_the_near_bound(
        reference in vector(6.0), sight in unit(), most in -3.0..3.0_f64, over in 0.1..5.0_f64,
    ) {
        let o = StandoffOptions::default();
        let still = VehicleState { position_m: Vector3::zeros(), velocity_m_s: Vector3::zeros() };
        let along = Along { least: most + over, most };
        let (u, decision) = program::command(&reference, &sight, along, &limits(&o, &still));
        prop_assert_eq!(decision, Decision::FarGivenUp);
        prop_assert!((sight.dot(&u) - most).abs() < 1e-5);
    }

    /// What is demanded over the whole step holds at any time within it, whatever the target does:
    /// integrated in small steps, with the target's acceleration against us or any other.
    #[test]
    fn demands_over_the_step_hold_within_it(
        sight in unit(), distance in 1.6..3.9_f64, radial in -1.0..1.0_f64, across in vector(0.8),
        wander in vector(1.5), against in any::<bool>(), reference in vector(4.0),
    ) {
        let o = StandoffOptions::default();
        let still = VehicleState { position_m: Vector3::zeros(), velocity_m_s: Vector3::zeros() };
        let tangential = across - sight * sight.dot(&across);
        let target = belief(sight * distance, sight * radial + tangential, 0.0);
        let seen = Relative::new(&still, &target);
        let along = barrier::over_the_step(&o, &seen, 0.0);
        let (u, decision) = program::command(&reference, &sight, along, &limits(&o, &still));
        prop_assume!(matches!(decision, Decision::Reference | Decision::Guarded));
        let (mut p, mut v) = (target.position_m, target.velocity_m_s);
        let (w, ticks) = (o.barrier_rate, 200);
        let tick = o.step_s / f64::from(ticks);
        for sign in [-1.0, 1.0] {
            let near = sign < 0.0;
            for _ in 0..ticks {
                let n = p.normalize();
                let worst = n * sign * o.target_acceleration;
                let a = if against { worst } else { wander.cap_magnitude(o.target_acceleration) };
                let d = p.norm();
                let rate = n.dot(&v);
                let bend = (v - n * rate).norm_squared() / d;
                let grows = n.dot(&(worst - u)) + bend;
                let condition = if near {
                    grows + 2.0 * w * rate + w * w * (d - o.least_m)
                } else {
                    -grows - 2.0 * w * rate + w * w * (o.most_m - d)
                };
                prop_assert!(condition > -1e-6, "{condition} {near}");
                v += (a - u) * tick;
                p += v * tick;
            }
            (p, v) = (target.position_m, target.velocity_m_s);
        }
    }

    /// Integrated in small steps from wherever, commands that keep the walls' barriers never come nearer
    /// than the clearance.
    #[test]
    fn a_vehicle_between_walls_stays_off_them(
        at in 0.4..1.6_f64, velocity in vector(1.0), target in vector(4.0), drift in vector(1.0),
    ) {
        // A corridor of 2 m with its end.
        let walls = [([-50.0, 0.0], [3.0, 0.0]), ([-50.0, 2.0], [3.0, 2.0]), ([3.0, 0.0], [3.0, 2.0])]
            .map(|(from_m, to_m)| Wall { from_m, to_m });
        let o = StandoffOptions::default();
        let mut controller = StandoffController::new(Guard::Sampled, o)
            .unwrap()
            .between(walls.to_vec(), 0.3)
            .unwrap();
        let mut vehicle = VehicleState {
            position_m: Vector3::new(0.0, at, 1.0),
            // Slow enough to stop: h' >= -w h at the start.
            velocity_m_s: Vector3::new(velocity.x, velocity.y * 0.2, velocity.z),
        };
        for step in 0..100 {
            let offset = target + drift * (f64::from(step) * o.step_s);
            let seen = belief(offset, drift, 0.05);
            let command = controller.command(&vehicle, &seen);
            let given_up = controller.decisions().walls_given_up;
            prop_assert_eq!(given_up, 0, "{:?}", vehicle);
            let u = command.acceleration;
            vehicle.position_m += vehicle.velocity_m_s * o.step_s + u * (0.5 * o.step_s * o.step_s);
            vehicle.velocity_m_s += u * o.step_s;
            for wall in &walls {
                let off = wall.away_m(&vehicle.position_m).norm();
                prop_assert!(off > 0.3 - 1e-3, "{off} at {step}");
            }
        }
    }

    #[test]
    fn any_belief_gives_a_command_the_vehicle_can_do(
        at in vector(6.0), velocity in vector(9.0), moves in vector(5.0), sigma in 0.0..3.0_f64,
    ) {
        for guard in [Guard::None, Guard::Fixed, Guard::Covariance, Guard::Sampled] {
            let mut controller =
                StandoffController::new(guard, StandoffOptions::default()).unwrap();
            let vehicle = VehicleState { position_m: Vector3::zeros(), velocity_m_s: moves };
            let command = controller.command(&vehicle, &belief(at, velocity, sigma));
            prop_assert!(command.acceleration.amax() <= 4.0);
            prop_assert!(command.radius_m >= 0.0);
        }
    }
}

fn limits_clamped(u: &Vector3<f64>, limits: &AccelerationBox) -> Vector3<f64> {
    u.zip_zip_map(&limits.low, &limits.high, |u, low, high| u.clamp(low, high))
}

#[test]
fn inside_the_confidence_tube_a_distance_is_not_corrected() {
    let still = VehicleState {
        position_m: Vector3::zeros(),
        velocity_m_s: Vector3::zeros(),
    };
    let near = belief(Vector3::new(2.6, 0.0, 0.05), Vector3::zeros(), 0.05);
    let command = |guard| {
        let options = StandoffOptions {
            target_acceleration: 0.0,
            ..StandoffOptions::default()
        };
        let mut controller = StandoffController::new(guard, options).unwrap();
        controller.command(&still, &near).acceleration
    };
    assert_eq!(command(Guard::Covariance).norm(), 0.0);
    assert!(command(Guard::Fixed).norm() > 0.05);
}

#[test]
fn the_radius_is_of_the_longest_axis() {
    let mut doubtful = belief(Vector3::new(2.5, 0.0, 0.0), Vector3::zeros(), 0.01);
    let turn = nalgebra::Rotation3::from_euler_angles(0.3, 0.5, 0.7);
    let squares = Matrix3::from_diagonal(&Vector3::new(0.01, 0.04, 0.0025));
    doubtful.pp = turn * squares * turn.inverse();
    assert!((longest_sigma_m(&doubtful) - 0.2).abs() < 1e-12);
}

#[test]
fn with_its_back_to_a_wall_a_vehicle_gives_up_the_near_bound_before_the_wall() {
    let o = StandoffOptions::default();
    let wall = Wall {
        from_m: [-0.35, -5.0],
        to_m: [-0.35, 5.0],
    };
    let still = VehicleState {
        position_m: Vector3::zeros(),
        velocity_m_s: Vector3::zeros(),
    };
    let mut controller = StandoffController::new(Guard::Fixed, o)
        .unwrap()
        .between(vec![wall], 0.3)
        .unwrap();
    // It comes towards the vehicle at 1 m/s, inside the bound already.
    let near = belief(Vector3::x() * 1.4, -Vector3::x(), 0.0);
    let command = controller.command(&still, &near);
    assert_eq!(command.decision, Decision::Cornered);
    let most = o.barrier_rate * o.barrier_rate * 0.05;
    assert!(-command.acceleration.x <= most + 1e-6 && -command.acceleration.x > 0.5 * most);
    assert_eq!(controller.decisions().infeasible(), 1);
    let bad = StandoffController::new(Guard::Fixed, o)
        .unwrap()
        .between(vec![wall], f64::NAN);
    assert!(bad.is_err());
}
