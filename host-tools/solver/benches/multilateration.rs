//! Cost of one localisation: with and without the search for a start and for mirror images, and
//! beside the same Cauchy-weighted Gauss-Newton iteration written the obvious way with
//! heap-allocated matrices.
//!
//! `cargo bench -p nova-solver`

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{DMatrix, DVector, Vector3};
use nova_solver::kernel::CAUCHY_95;
use nova_solver::multilateration::Noise;
use nova_solver::{MultilaterationOptions, RangeMeasurement, multilaterate};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const NODE: Vector3<f64> = Vector3::new(7.0, -3.0, 0.5);
const SIGMA_M: f64 = 0.05;

/// A winding flight of `n` ranges, every `wild`th one off by up to 300 m.
fn flight(n: u32, wild: Option<u32>) -> Vec<RangeMeasurement> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..n)
        .map(|i| {
            let s = 12.0 * f64::from(i) / f64::from(n);
            let position_m = Vector3::new(s, 4.0 * s.sin(), 5.0 + 2.0 * (0.7 * s).cos());
            let noise: f64 = StandardNormal.sample(&mut rng);
            let mut range_m = (NODE - position_m).norm() + SIGMA_M * noise;
            if wild.is_some_and(|every| i % every == 0) {
                range_m += rng.random_range(3.0..300.0);
            }
            RangeMeasurement {
                t_s: 0.1 * f64::from(i),
                position_m,
                range_m,
                sigma_m: SIGMA_M,
            }
        })
        .collect()
}

fn guess() -> Vector3<f64> {
    NODE + Vector3::new(0.3, -0.2, 0.2)
}

/// Cauchy-weighted Gauss-Newton on the dynamic Jacobian, through a QR decomposition as textbooks
/// advise.
fn textbook_gauss_newton(log: &[RangeMeasurement], mut place: Vector3<f64>) -> Vector3<f64> {
    for _ in 0..50 {
        let mut jacobian = DMatrix::zeros(log.len(), 3);
        let mut residual = DVector::zeros(log.len());
        for (i, m) in log.iter().enumerate() {
            let d = place - m.position_m;
            let r = (d.norm() - m.range_m) / m.sigma_m;
            let root_weight = (1.0 / (1.0 + (r / CAUCHY_95).powi(2))).sqrt();
            residual[i] = -r * root_weight;
            for k in 0..3 {
                jacobian[(i, k)] = d[k] / d.norm() / m.sigma_m * root_weight;
            }
        }
        let qr = jacobian.qr();
        let projected = qr.q().transpose() * residual;
        let Some(step) = qr.r().solve_upper_triangular(&projected) else {
            break;
        };
        place += Vector3::new(step[0], step[1], step[2]);
        if step.norm() < 1e-7 {
            break;
        }
    }
    place
}

fn multilateration(c: &mut Criterion) {
    let short = flight(200, None);
    let long = flight(1000, Some(20));
    let cold = MultilaterationOptions::default();
    let warm = MultilaterationOptions {
        initial_guess_m: Some(guess()),
        ..cold
    };
    let update = MultilaterationOptions {
        noise: Noise::Given,
        seek_alternatives: false,
        ..warm
    };

    let mut group = c.benchmark_group("multilateration");
    for (name, log, options) in [
        ("200 ranges, cold", &short, &cold),
        ("200 ranges, warm start", &short, &warm),
        (
            "200 ranges, warm start, sigmas given, no alternatives",
            &short,
            &update,
        ),
        ("1000 ranges with 5 % outliers, cold", &long, &cold),
    ] {
        group.bench_function(name, |b| {
            b.iter(|| multilaterate(black_box(log), black_box(options)))
        });
    }
    group.bench_function(
        "200 ranges, warm start, textbook Gauss-Newton, position only",
        |b| {
            b.iter(|| textbook_gauss_newton(black_box(&short), black_box(guess())));
        },
    );
    group.finish();
}

criterion_group!(benches, multilateration);
criterion_main!(benches);
