//! Cost of following a moving target: an update alone, in a window and with everything kept, and a whole step
//! (update, covariance of the newest state, command with a quadratic program in it).
//!
//! `cargo bench -p nova-solver --bench track`. An update's cost depends on what it moves, so that a table of
//! medians and 99 % points over the sightings of a log comes first; criterion's figures are of all
//! sightings together, beside the extended Kalman filter. GTSAM and OSQP: benches/peers.

#![allow(missing_docs, clippy::unwrap_used)] // criterion's macros

#[path = "../tests/target/mod.rs"]
#[allow(dead_code)] // what only tests need
mod target;

use criterion::{Criterion, criterion_group, criterion_main};
use nova_solver::tracking::control::Decision;
use nova_solver::tracking::{
    GraphOptions, Guard, InteractingOptions, InteractingTracker, Sighting, StandoffController,
    StandoffOptions, TargetEkf, TargetGraph, Tracker, VehicleState,
};
use std::hint::black_box;
use std::time::{Duration, Instant};
use target::{prior, sightings, truth_m};

const SIGHTINGS: usize = 1000;
/// Times of as many logs go into the table.
const LOGS: u64 = 20;

fn graph(window: Option<usize>) -> TargetGraph {
    let options = GraphOptions {
        window,
        acceleration_density: 0.5,
        ..GraphOptions::robust()
    };
    TargetGraph::new(prior(), options).unwrap()
}

/// A controller that the near barrier stops, at this sighting.
fn barred(sighting: &Sighting) -> StandoffController {
    let distance = (truth_m(sighting.t_s) - sighting.pose.position_m).norm();
    let options = StandoffOptions {
        least_m: distance - 0.8,
        standoff_m: distance - 0.5,
        most_m: distance + 9.0,
        ..StandoffOptions::default()
    };
    StandoffController::new(Guard::Sampled, options).unwrap()
}

/// Times of updates in the later half of each log, and of whole steps; of those only such that solved a
/// quadratic program.
fn table(window: Option<usize>) -> [Vec<Duration>; 2] {
    let (mut updates, mut steps) = (Vec::new(), Vec::new());
    for seed in 0..LOGS {
        let mut graph = graph(window);
        for (i, sighting) in sightings(SIGHTINGS, 0.1, seed).iter().enumerate() {
            let mut controller = barred(sighting);
            let vehicle = VehicleState {
                position_m: sighting.pose.position_m,
                velocity_m_s: nalgebra::Vector3::x(),
            };
            let begin = Instant::now();
            graph.observe(black_box(sighting)).unwrap();
            let belief = black_box(graph.belief());
            let updated = begin.elapsed();
            let command = black_box(controller.command(&vehicle, &belief));
            let took = begin.elapsed();
            if i >= SIGHTINGS / 2 {
                updates.push(updated);
                if matches!(command.decision, Decision::Guarded | Decision::FarGivenUp) {
                    steps.push(took);
                }
            }
        }
    }
    updates.sort();
    steps.sort();
    [updates, steps]
}

fn track(c: &mut Criterion) {
    println!("single sightings, 500 to 1000 of {LOGS} logs with one bearing in ten wrong:");
    for (name, window) in [("window of 64", Some(64)), ("all kept", None)] {
        let words = ["update, covariance", "and a quadratic program"];
        for (what, times) in words.into_iter().zip(table(window)) {
            let at = |part: f64| {
                let place = (part * (times.len() - 1) as f64) as usize;
                1e6 * times[place].as_secs_f64()
            };
            println!(
                "{name:>14}, {what:<23} median {:6.1} us, p99 {:6.1} us, of {}",
                at(0.5),
                at(0.99),
                times.len()
            );
        }
    }

    let log = sightings(SIGHTINGS, 0.1, 1);
    let mut group = c.benchmark_group("1000 sightings of a moving target");
    group.sample_size(20);
    let mut follow = |name: &str, fresh: &dyn Fn() -> Box<dyn Tracker>| {
        group.bench_function(name, |b| {
            b.iter(|| {
                let mut tracker = fresh();
                for sighting in black_box(&log) {
                    tracker.observe(sighting).unwrap();
                }
                tracker.belief()
            });
        });
    };
    follow("extended Kalman filter", &|| {
        Box::new(TargetEkf::new(prior(), 0.5).unwrap())
    });
    follow("graph, window of 64", &|| Box::new(graph(Some(64))));
    follow("graph, all kept", &|| Box::new(graph(None)));
    follow("interacting models", &|| {
        let options = InteractingOptions::default();
        Box::new(InteractingTracker::new(prior(), options).unwrap())
    });
    group.finish();
}

criterion_group!(benches, track);
criterion_main!(benches);
