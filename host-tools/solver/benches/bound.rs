//! Cost of the posterior Cramer-Rao bound: of one candidate path, as a planner asks for it, and of
//! a whole flight.
//!
//! `cargo bench -p nova-solver --bench bound`

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use nova_solver::bound::{BoundEpoch, BoundModel, Prior, Recursion, relative_covariance};
use nova_solver::ins_error::InsNoise;

const INS: InsNoise = InsNoise {
    velocity_random_walk: 0.005,
    acceleration_random_walk: 5e-4,
    position_random_walk: 0.0,
    height_random_walk: 0.003,
    height_sigma_m: 0.03,
};
const PRIOR: Prior = Prior {
    tag_sigma_m: [5.0; 3],
    velocity_sigma_m_s: 0.02,
    acceleration_sigma_m_s2: 2e-3,
    bias_sigma_m: 0.1,
};

fn spiral(t_s: f64) -> Vector3<f64> {
    Vector3::new(
        9.0 * (0.3 * t_s).cos(),
        9.0 * (0.3 * t_s).sin(),
        30.0 - 0.5 * t_s,
    )
}

fn bound(c: &mut Criterion) {
    let directions: Vec<_> = (0..120)
        .map(|i| -spiral(0.5 * f64::from(i)).normalize())
        .collect();
    let mut group = c.benchmark_group("bound");
    group.bench_function("candidate path of 60 s, 2 ranges a second", |b| {
        b.iter(|| {
            let mut recursion = Recursion::new(INS, black_box(&PRIOR));
            for direction in black_box(&directions) {
                recursion.step(0.5);
                recursion.observe(*direction, 0.05);
            }
            recursion.relative_covariance()
        });
    });

    let epochs: Vec<_> = (1..=600)
        .map(|i| 0.1 * f64::from(i))
        .map(|t_s| BoundEpoch {
            t_s,
            vehicle_m: spiral(t_s),
            range_sigma_m: 0.05,
        })
        .collect();
    for (name, nlos_probability) in [("", 0.0), (", a tenth of the ranges late", 0.1)] {
        let model = BoundModel {
            ins: INS,
            prior: PRIOR,
            nlos_probability,
            nlos_mean_m: 1.0,
        };
        group.bench_function(format!("flight of 60 s, 10 ranges a second{name}"), |b| {
            b.iter(|| relative_covariance(black_box(&epochs), Vector3::zeros(), &model, 0.0..60.0));
        });
    }
    group.finish();
}

criterion_group!(benches, bound);
criterion_main!(benches);
