//! Cost of one update of the MAP navigator late in a flight of 50 s, of one that looks for other
//! explanations as well, and of a whole flight.
//!
//! `cargo bench -p nova-solver --bench map`. Searches come every two seconds, near the ground every
//! half second, and are told from plain updates by taking memory from the heap.

#[path = "../tests/vehicle/mod.rs"]
mod vehicle;

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nova_solver::map::{MapNavigator, MapOptions};
use nova_solver::navigation::{FirstGuess, Navigator};
use vehicle::{TICK_S, Tick, Vehicle, World};

/// Length of the flight, and from when on updates are looked at.
const FLIGHT_S: f64 = 50.0;
const LATE_S: f64 = 47.0;

/// What a flight in a closed loop measures.
struct Flight {
    world: World,
    ticks: Vec<Tick>,
    /// A late update, and a late one with a search: indices of ticks.
    plain: Option<usize>,
    searching: Option<usize>,
}

impl Flight {
    fn new(world: World) -> Self {
        let mut flight = Self {
            world,
            ticks: Vec::new(),
            plain: None,
            searching: None,
        };
        let mut navigator = flight.flown(0);
        let mut vehicle = Vehicle::new(world, 1);
        for i in 0..(FLIGHT_S / TICK_S) as usize {
            let tick = vehicle.obey(&navigator.command());
            let updates = navigator.updates();
            let taken = allocation_counter::measure(|| feed(&mut navigator, &tick));
            if tick.range.t_s > LATE_S && navigator.updates() > updates {
                let kind = if taken.count_total > 0 {
                    &mut flight.searching
                } else {
                    &mut flight.plain
                };
                kind.get_or_insert(i);
            }
            flight.ticks.push(tick);
            if let Some(estimate) = navigator.estimate().filter(|_| tick.range.t_s > LATE_S) {
                let off_m = (estimate.tag_m - estimate.vehicle_m) - (world.tag_m - tick.vehicle_m);
                assert!(off_m.norm() < 1.0, "the flight went astray: {off_m}");
            }
        }
        flight
    }

    /// The navigator after so many ticks.
    fn flown(&self, ticks: usize) -> MapNavigator {
        let guess = FirstGuess {
            tag_m: self.world.guess_m,
        };
        let mut navigator = MapNavigator::new(guess, MapOptions::default());
        self.ticks
            .iter()
            .take(ticks)
            .for_each(|tick| feed(&mut navigator, tick));
        navigator
    }
}

fn feed(navigator: &mut MapNavigator, tick: &Tick) {
    // A vehicle's measurements are in order, so none is refused.
    let _ = navigator.on_ins(tick.ins);
    let _ = navigator.on_range(tick.range);
}

fn map(c: &mut Criterion) {
    let flight = Flight::new(World::paper());
    let mut group = c.benchmark_group("MAP navigator");
    for (name, index) in [
        ("update", flight.plain),
        ("update with a search", flight.searching),
    ] {
        let Some(index) = index else {
            continue;
        };
        let navigator = flight.flown(index);
        let tick = flight.ticks[index];
        group.bench_function(format!("{name} at {:.1} s", tick.range.t_s), |b| {
            b.iter_batched_ref(
                || navigator.clone(),
                |navigator| feed(navigator, black_box(&tick)),
                BatchSize::SmallInput,
            );
        });
    }
    group.sample_size(10);
    group.bench_function("flight of 50 s", |b| {
        b.iter(|| black_box(&flight).flown(flight.ticks.len()).estimate());
    });
    group.finish();
}

criterion_group!(benches, map);
criterion_main!(benches);
