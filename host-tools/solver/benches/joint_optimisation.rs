//! Cost of the paper's joint optimisation, its Bayesian optimisation included, over one flight: an
//! optimisation at each waypoint over all that was measured until there; and of its parts.
//!
//! `cargo bench -p nova-solver --bench joint_optimisation`. Times are per optimisation.

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Vector2, Vector3};
use nova_solver::bayes_opt::{BayesianMinimiser, MinimiserOptions, SearchBox};
use nova_solver::navigation::{InsSample, RangeSample};
use nova_solver::nova::{JointOptimiser, Parameters, Segment, SegmentRecorder};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const TAG: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);
const GUESS: Vector3<f64> = Vector3::new(3.5, -3.5, 4.0);
/// Waypoints of a flight from 20 m away: exploratory descent, a leg across, and an approach that
/// curves as the planner's do.
const PLAN: [[f64; 3]; 9] = [
    [20.0, 0.0, 30.0],
    [20.0, 0.0, 29.0],
    [19.0, -4.9, 29.0],
    [11.0, 2.5, 29.0],
    [6.0, -2.0, 29.0],
    [3.0, 1.0, 29.0],
    [1.5, -0.8, 29.0],
    [1.1, -0.2, 29.0],
    [0.5, -0.2, 29.0],
];
/// Accelerometer noise of the paper's IMU as a random walk of velocity, m/s/sqrt(s).
const VELOCITY_WALK: f64 = 7.7e-3;
const HEIGHT_SIGMA_M: f64 = 0.03;
const RANGE_SIGMA_M: f64 = 0.03;

/// The plan flown at 1 m/s, with 10 readings and ranges a second.
fn flight(parameters: &Parameters) -> Vec<Segment> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let (mut drift, mut drift_velocity) = (Vector2::zeros(), Vector2::zeros());
    let mut tick = 0_u32;
    let mut last = InsSample {
        t_s: 0.0,
        position_m: Vector3::from(PLAN[0]),
    };
    let mut segments = Vec::new();
    for leg in PLAN.windows(2) {
        let (start, goal) = (Vector3::from(leg[0]), Vector3::from(leg[1]));
        let ticks = (10.0 * (goal - start).norm()).ceil();
        let mut recorder = SegmentRecorder::new(start, goal, last, parameters);
        for i in 1..=ticks as u32 {
            tick += 1;
            let truth = start.lerp(&goal, f64::from(i) / ticks);
            drift_velocity += Vector2::new(normal(), normal()) * (VELOCITY_WALK * 0.1_f64.sqrt());
            drift += drift_velocity * 0.1;
            last = InsSample {
                t_s: 0.1 * f64::from(tick),
                position_m: truth + drift.push(HEIGHT_SIGMA_M * normal()),
            };
            recorder.push_ins(last);
            recorder.push_range(RangeSample {
                t_s: last.t_s,
                range_m: (truth - TAG).norm() + RANGE_SIGMA_M * normal(),
            });
        }
        segments.push(recorder.finish());
    }
    segments
}

fn joint(c: &mut Criterion) {
    let parameters = Parameters::default();
    let segments = flight(&parameters);
    let mut group = c.benchmark_group("joint optimisation");

    // The first two legs are exploratory: the optimisations come after.
    group.throughput(Throughput::Elements((segments.len() - 2) as u64));
    group.bench_function("all of a flight", |b| {
        b.iter(|| {
            let mut joint = JointOptimiser::new(&parameters, 0);
            let mut tag_m = GUESS;
            for n in 3..=segments.len() {
                tag_m = joint.optimise(black_box(&segments[..n]), tag_m).tag_m;
            }
            tag_m
        });
    });

    group.throughput(Throughput::Elements(1));
    let mut flown = JointOptimiser::new(&parameters, 0);
    let before = flown.optimise(&segments[..segments.len() - 1], GUESS);
    group.bench_function("at the last waypoint", |b| {
        b.iter_batched_ref(
            || flown.clone(),
            |joint| joint.optimise(black_box(&segments), before.tag_m),
            BatchSize::SmallInput,
        );
    });
    group.bench_function("of a whole flight at once", |b| {
        b.iter(|| JointOptimiser::new(&parameters, 0).optimise(black_box(&segments), GUESS));
    });
    group.finish();
}

/// 25 evaluations of a function that costs nothing: what the optimiser itself costs.
fn bayesian(c: &mut Criterion) {
    let search = SearchBox::unit();
    let mut minimiser = BayesianMinimiser::new(MinimiserOptions::default());
    let bowl = |x: &Vector3<f64>| (x - Vector3::new(0.2, 0.7, 0.4)).norm_squared();
    c.bench_function(
        "Bayesian optimisation, 25 evaluations in 3 dimensions",
        |b| {
            b.iter(|| minimiser.minimise(black_box(&search), &[], bowl));
        },
    );
}

criterion_group!(benches, joint, bayesian);
criterion_main!(benches);
