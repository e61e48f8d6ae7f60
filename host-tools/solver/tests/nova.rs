//! The paper's navigator in a closed loop with a vehicle that flies straight from waypoint to
//! waypoint at 1 m/s. The simulator proper is another crate; here only what is claimed of the
//! navigator alone matters.

use nalgebra::Vector3;
use nova_solver::navigation::{
    Action, Command, Estimate, FirstGuess, InputFault, InsSample, Navigator, Phase, RangeSample,
};
use nova_solver::nova::{NovaNavigator, NovaOptions, Variant};
use proptest::prelude::*;

const TICK_S: f64 = 0.1;
const LIMIT_S: f64 = 600.0;

/// What surrounds the navigator.
#[derive(Clone, Copy)]
struct World {
    tag_m: Vector3<f64>,
    start_m: Vector3<f64>,
    guess_m: Vector3<f64>,
    /// Error of dead reckoning grows with half of this times time squared, m/s^2.
    drift_m_s2: Vector3<f64>,
    /// Alternating range error, metres.
    range_error_m: f64,
    ranges: fn(f64) -> bool,
    arrivals: bool,
}

impl World {
    fn exact() -> Self {
        Self {
            tag_m: Vector3::new(3.0, -2.0, 0.5),
            start_m: Vector3::new(20.0, 5.0, 30.0),
            guess_m: Vector3::new(6.0, 2.0, -3.0),
            drift_m_s2: Vector3::zeros(),
            range_error_m: 0.0,
            ranges: |_| true,
            arrivals: true,
        }
    }

    fn noisy() -> Self {
        Self {
            drift_m_s2: Vector3::new(0.001, -0.0008, 0.0),
            range_error_m: 0.03,
            ..Self::exact()
        }
    }

    fn shifted(self, by: Vector3<f64>) -> Self {
        Self {
            tag_m: self.tag_m + by,
            start_m: self.start_m + by,
            guess_m: self.guess_m + by,
            ..self
        }
    }
}

/// What came of a flight.
struct Flight {
    end_m: Vector3<f64>,
    landed: bool,
    phases: Vec<Phase>,
    last: Option<Estimate>,
    updates: u64,
}

impl Flight {
    fn error_m(&self, world: &World) -> f64 {
        (self.end_m - world.tag_m).xy().norm()
    }
}

fn fly(world: &World, options: NovaOptions) -> Result<Flight, InputFault> {
    let guess = FirstGuess {
        tag_m: world.guess_m,
    };
    let mut navigator = NovaNavigator::new(guess, options);
    let mut place_m = world.start_m;
    let mut phases = vec![navigator.phase()];
    let mut last = None;
    for tick in 0..(LIMIT_S / TICK_S) as u32 {
        let t_s = TICK_S * f64::from(tick);
        let drift_m = world.drift_m_s2 * (0.5 * t_s * t_s);
        let position_m = place_m + drift_m;
        navigator.on_ins(InsSample { t_s, position_m })?;
        if (world.ranges)(t_s) {
            let sign = if tick % 2 == 0 { 1.0 } else { -1.0 };
            let range_m = (place_m - world.tag_m).norm() + sign * world.range_error_m;
            navigator.on_range(RangeSample { t_s, range_m })?;
        }
        let Command {
            id,
            action,
            waypoint_m,
            ..
        } = navigator.command();
        if action == Action::Fly && (place_m - waypoint_m).norm() < 1e-9 && world.arrivals {
            navigator.on_arrival(id);
        }
        last = navigator.estimate().or(last);
        if phases.last() != Some(&navigator.phase()) {
            phases.push(navigator.phase());
        }
        let goal_m = match action {
            Action::Hold => place_m,
            Action::Fly => waypoint_m,
            Action::Land => Vector3::new(place_m.x, place_m.y, world.tag_m.z),
        };
        place_m += (goal_m - place_m).cap_magnitude(TICK_S);
        if action == Action::Land && place_m == goal_m {
            break;
        }
    }
    Ok(Flight {
        end_m: place_m,
        landed: navigator.command().action == Action::Land && place_m.z == world.tag_m.z,
        phases,
        last,
        updates: navigator.updates(),
    })
}

fn nova() -> NovaOptions {
    NovaOptions::default()
}

#[test]
fn with_exact_sensors_the_approach_ends_over_the_tag() {
    let world = World::exact();
    for (variant, within_m) in [
        (Variant::V3, 0.01),
        (Variant::V5, 0.01),
        // The alternation stops once the tag moves by less than 0.1 m.
        (Variant::V4, 0.15),
        (Variant::V6, 0.15),
    ] {
        let flight = fly(&world, NovaOptions::variant(variant)).unwrap();
        let error_m = flight.error_m(&world);
        assert!(
            flight.landed && error_m < within_m,
            "{variant:?}: {error_m}"
        );
    }
    // The mean range over a third of a descent is not quite the range at its middle.
    let flight = fly(&world, nova()).unwrap();
    assert!(flight.landed && flight.error_m(&world) < 0.3);
}

#[test]
fn with_drift_and_noise_nova_lands_within_a_metre() {
    let world = World::noisy();
    let flight = fly(&world, nova()).unwrap();
    assert!(flight.landed && flight.error_m(&world) < 1.0);
    let doubts = flight.last.unwrap().doubts;
    assert!(!doubts.weak_geometry && !doubts.gap);
}

#[test]
fn phases_follow_each_other_as_in_figure_6() {
    use Phase::{Final, Initial, Landing, MidFlight};
    let phases = |variant| {
        fly(&World::noisy(), NovaOptions::variant(variant))
            .unwrap()
            .phases
    };
    assert_eq!(phases(Variant::V7), [Initial, MidFlight, Final, Landing]);
    assert_eq!(phases(Variant::V6), [Initial, MidFlight, Landing]);
    assert_eq!(phases(Variant::V1), [Initial, MidFlight, Landing]);
}

#[test]
fn without_localisation_it_lands_on_the_first_guess() {
    let world = World::noisy();
    let flight = fly(&world, NovaOptions::variant(Variant::V1)).unwrap();
    assert!((flight.end_m - world.guess_m).xy().norm() < 1e-6);
    assert_eq!(flight.updates, 0);
}

#[test]
fn multilateration_every_metre_updates_more_often_than_at_half_distances() {
    let updates = |variant| {
        fly(&World::noisy(), NovaOptions::variant(variant))
            .unwrap()
            .updates
    };
    assert!(updates(Variant::V2) > 2 * updates(Variant::V2Prime));
}

#[test]
fn the_exploratory_flight_goes_down_and_across_the_line_of_sight() {
    let world = World::exact();
    let mut navigator = NovaNavigator::new(
        FirstGuess {
            tag_m: world.guess_m,
        },
        nova(),
    );
    assert_eq!(navigator.command().action, Action::Hold);
    let reading = |t_s, position_m| InsSample { t_s, position_m };
    navigator.on_ins(reading(0.0, world.start_m)).unwrap();
    let down_m = navigator.command().waypoint_m;
    assert_eq!(down_m, world.start_m - Vector3::z());
    navigator.on_ins(reading(1.0, down_m)).unwrap();
    navigator.on_arrival(navigator.command().id);
    let across_m = navigator.command().waypoint_m - down_m;
    assert!((across_m.norm() - 5.0).abs() < 1e-12 && across_m.z == 0.0);
    assert!(across_m.dot(&(world.guess_m - down_m)).abs() < 1e-9);
}

#[test]
fn news_of_an_older_arrival_is_ignored() {
    let world = World::exact();
    let guess = FirstGuess {
        tag_m: world.guess_m,
    };
    let mut navigator = NovaNavigator::new(guess, nova());
    let position_m = world.start_m;
    navigator
        .on_ins(InsSample {
            t_s: 0.0,
            position_m,
        })
        .unwrap();
    let first = navigator.command().id;
    navigator.on_arrival(first);
    let second = navigator.command();
    assert!(second.id > first);
    navigator.on_arrival(first);
    assert_eq!(navigator.command(), second);
}

#[test]
fn without_news_of_arrivals_it_still_comes_down() {
    let world = World {
        arrivals: false,
        ..World::exact()
    };
    let flight = fly(&world, nova()).unwrap();
    assert!(flight.landed && flight.error_m(&world) < 1.0);
}

#[test]
fn without_ranges_it_lands_on_the_first_guess() {
    let world = World {
        ranges: |_| false,
        ..World::exact()
    };
    for variant in Variant::ALL {
        let flight = fly(&world, NovaOptions::variant(variant)).unwrap();
        assert!(flight.landed, "{variant:?}");
        assert!(
            (flight.end_m - world.guess_m).xy().norm() < 1e-6,
            "{variant:?}"
        );
    }
}

#[test]
fn ranges_that_are_lost_for_a_while_are_a_gap_and_no_disaster() {
    let world = World {
        ranges: |t_s| !(20.0..26.0).contains(&t_s) && t_s < 48.0,
        ..World::noisy()
    };
    let flight = fly(&world, nova()).unwrap();
    assert!(flight.landed && flight.error_m(&world) < 2.0);
    assert!(flight.last.unwrap().doubts.gap);
}

#[test]
fn a_plan_that_never_comes_near_ends_all_the_same() {
    let world = World::noisy();
    // Information alone leads far away; no candidates leave the vehicle where it is.
    for (lambda, candidates) in [(0.0, 24), (0.7, 0)] {
        let mut options = nova();
        options.parameters.lambda = lambda;
        options.parameters.candidates = candidates;
        let flight = fly(&world, options).unwrap();
        assert!(flight.landed, "lambda {lambda}");
        assert_eq!(flight.phases.last(), Some(&Phase::Landing));
    }
}

#[test]
fn a_guess_that_is_no_number_is_no_guess() {
    for bad in [f64::NAN, f64::INFINITY, 1e300] {
        let world = World {
            guess_m: Vector3::new(bad, 0.0, 0.0),
            ..World::exact()
        };
        for variant in Variant::ALL {
            let flight = fly(&world, NovaOptions::variant(variant)).unwrap();
            assert!(flight.landed && flight.end_m.iter().all(|c| c.is_finite()));
        }
    }
}

#[test]
fn the_same_measurements_give_the_same_flight() {
    let ends = [(); 2].map(|()| fly(&World::noisy(), nova()).unwrap().end_m);
    assert_eq!(ends[0], ends[1]);
}

#[test]
fn moving_the_world_moves_the_flight_and_nothing_else() {
    let by_m = Vector3::new(300.0, -700.0, 40.0);
    for variant in Variant::ALL {
        let options = NovaOptions::variant(variant);
        let here = fly(&World::noisy(), options).unwrap().end_m;
        let there = fly(&World::noisy().shifted(by_m), options).unwrap().end_m;
        assert!(
            (here + by_m - there).norm() < 1e-6,
            "{variant:?}: {here} {there}"
        );
    }
}

/// One call to a navigator.
#[derive(Debug, Clone)]
enum Call {
    Ins(f64, [f64; 3]),
    Range(f64, f64),
    Arrival,
}

fn call() -> impl Strategy<Value = Call> {
    let step_s = prop_oneof![
        8 => Just(0.1), 2 => 0.0..3.0, 1 => Just(-1.0), 1 => Just(f64::NAN), 1 => Just(1e-12), 1 => Just(1e9)
    ];
    let length_m = || prop_oneof![8 => -50.0..50.0, 1 => Just(f64::NAN), 1 => Just(1e12), 1 => Just(-1e12), 1 => Just(0.0)];
    prop_oneof![
        4 => (step_s.clone(), [length_m(), length_m(), length_m()]).prop_map(|(t, p)| Call::Ins(t, p)),
        4 => (step_s, length_m()).prop_map(|(t, r)| Call::Range(t, r)),
        1 => Just(Call::Arrival),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn whatever_comes_in_only_numbers_come_out(
        calls in prop::collection::vec(call(), 0..120),
        variant in prop::sample::select(Variant::ALL.to_vec()),
        guess_m in [-50.0..50.0, -50.0..50.0, -50.0..50.0],
    ) {
        let guess = FirstGuess { tag_m: Vector3::from(guess_m) };
        let mut navigator = NovaNavigator::new(guess, NovaOptions::variant(variant));
        let mut now_s = 0.0;
        for call in calls {
            match call {
                Call::Ins(step_s, position_m) => {
                    let sample = InsSample { t_s: now_s + step_s, position_m: Vector3::from(position_m) };
                    if navigator.on_ins(sample).is_ok() {
                        now_s = sample.t_s;
                    }
                }
                // Ranges share the clock but do not advance it: the next INS reading may be older.
                Call::Range(step_s, range_m) => {
                    let _ = navigator.on_range(RangeSample { t_s: now_s + step_s, range_m });
                }
                Call::Arrival => navigator.on_arrival(navigator.command().id),
            }
            let command = navigator.command();
            prop_assert!(command.waypoint_m.iter().all(|c| c.is_finite()), "{command:?}");
            prop_assert!(command.ins_error.at(now_s).iter().all(|c| c.is_finite()), "{command:?}");
            if let Some(estimate) = navigator.estimate() {
                let places = [Some(estimate.tag_m), Some(estimate.vehicle_m), estimate.alternative_m];
                for place in places.into_iter().flatten() {
                    prop_assert!(place.iter().all(|c| c.is_finite()), "{estimate:?}");
                }
            }
        }
    }
}
