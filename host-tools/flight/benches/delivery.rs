//! What one control step of a delivery costs: the filter with what it is told in a hundredth of a second, the vector field, the
//! mission.
//!
//! `cargo bench -p nova-flight --bench delivery`. First, over all steps of a flight, the share of one core at 100 Hz with either
//! filter, and of NOVA's navigator where one tag stands in for the anchors; then criterion's figures of whole flights, the two filters beside each other.

#![allow(missing_docs, clippy::unwrap_used)] // criterion's macros

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Vector3;
use nova_flight::delivery::{Event, FilterKind, Lander, Scenario, deliver};
use nova_solver::delivery::{LandingFilter, Mission, SingleTag, SingleTagOptions, Situation};
use nova_solver::navigation::horizontal_sigma_m;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Steps a second.
const RATE_HZ: f64 = 100.0;

/// What the filter of a flight out, by the paper's Sec. 5.1, was told, cut into steps.
struct Told {
    scenario: Scenario,
    lander: Lander,
    steps: Vec<Vec<Event>>,
}

impl Told {
    fn new(filter: FilterKind) -> Self {
        let scenario = Scenario {
            filter,
            return_trip: false,
            ..Scenario::default()
        };
        let (mut lander, mut steps, mut step) = (None, Vec::new(), Vec::new());
        deliver(&scenario, 2025, |event| match event {
            Event::Begin(begin) => lander = Some(begin.lander().unwrap()),
            Event::Estimate(_) | Event::Sample(_) => {}
            Event::Input(_) => {
                step.push(*event);
                steps.push(std::mem::take(&mut step));
            }
            _ => step.push(*event),
        })
        .unwrap();
        Self {
            scenario,
            lander: lander.unwrap(),
            steps,
        }
    }

    /// The whole flight; how long each step took goes to `took`.
    fn fly(&self, mut took: impl FnMut(Duration)) {
        let field = self.scenario.field().unwrap();
        let mut mission = Mission::new(self.scenario.mission_options(field.path()));
        let mut lander = self.lander.clone();
        for (number, step) in self.steps.iter().enumerate() {
            let begin = Instant::now();
            for event in black_box(step) {
                let _ = black_box(lander.take(event));
            }
            let filter = lander.filter();
            let place_m = filter.pose().position_m;
            let order = mission.step(&Situation {
                t_s: number as f64 / RATE_HZ,
                along_m: field.path().along_m(&place_m),
                height_m: place_m.z,
                sigma_m: horizontal_sigma_m(&filter.position_covariance_m2()),
                off_path_m: field.path().distance_m(&place_m),
                gps_age_s: 0.0,
                local_age_s: 0.0,
                battery: 1.0,
                on_ground: number == 0,
                released: false,
            });
            black_box((order, field.velocity_m_s(&place_m, true)));
            took(begin.elapsed());
        }
    }
}

/// NOVA's navigator on a way down in circles, over and above the filter: how long each step took, ranges at 20 Hz among them.
fn by_one_tag() -> Vec<Duration> {
    let at = |tick: u32| {
        let t_s = f64::from(tick) / RATE_HZ;
        let z = 12.0 - 0.7 * t_s;
        let (sin, cos) = (0.9 * t_s).sin_cos();
        Vector3::new(0.25 * z * cos, 0.25 * z * sin, z)
    };
    let mut tag = SingleTag::new(SingleTagOptions::default());
    (1..1600)
        .map(|tick| {
            let (t_s, truth) = (f64::from(tick) / RATE_HZ, at(tick));
            let velocity = (truth - at(tick - 1)) * RATE_HZ;
            // Some roughness, as ranges have it.
            let rough_m = 0.05 * (f64::from(tick) * 12.9898).sin();
            let begin = Instant::now();
            tag.moved(t_s, &velocity, 1.0 / RATE_HZ);
            if tick % 10 == 1 {
                tag.autopilot(t_s, &(truth + Vector3::new(0.9, -0.7, 1.0)));
            }
            if tick % 5 == 0 {
                black_box(tag.range(t_s, truth.norm() + rough_m));
            }
            begin.elapsed()
        })
        .collect()
}

fn share(name: &str, mut times: Vec<Duration>) {
    times.sort();
    let mean = times.iter().sum::<Duration>() / times.len() as u32;
    let at = |part: f64| times.get((part * times.len() as f64) as usize).copied();
    println!(
        "{name}: {} steps; mean {mean:?}, median {:?}, 99 % below {:?}; {:.3} % of one core at 100 Hz",
        times.len(),
        at(0.5).unwrap_or_default(),
        at(0.99).unwrap_or_default(),
        100.0 * mean.as_secs_f64() * RATE_HZ,
    );
}

fn delivery(criterion: &mut Criterion) {
    let filters = [
        ("error-state filter", FilterKind::ErrorState),
        ("paper's EKF", FilterKind::Paper),
    ];
    let told = filters.map(|(name, filter)| (name, Told::new(filter)));
    for (name, told) in &told {
        let mut times = Vec::new();
        told.fly(|took| times.push(took));
        share(name, times);
    }
    share("one tag in place of anchors", by_one_tag());
    let mut group = criterion.benchmark_group("all control steps of a delivery");
    group.sample_size(10);
    for (name, told) in &told {
        group.throughput(Throughput::Elements(told.steps.len() as u64));
        group.bench_function(*name, |bencher| bencher.iter(|| told.fly(|_| ())));
    }
    group.finish();
}

criterion_group!(benches, delivery);
criterion_main!(benches);
