//! Speed of the tight filter: how long one second of 100 Hz inertial readings, 5 Hz GNSS and 10 Hz x 6
//! ranges takes is the time printed divided by the flight's seconds.

#![allow(missing_docs, clippy::unwrap_used)] // criterion's macros

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, Vector3};
use nova_flight::vertiport::{Air, Log, Method, Route, anchors_m, navigate, path};
use nova_solver::fusion::FusionAnchor;

fn tight(c: &mut Criterion) {
    let flown = path(Route::Loop);
    let log = Log::new(&flown, &Air::of_flight(2), 1, 2);
    let anchors = anchors_m().map(|position_m| FusionAnchor {
        position_m,
        covariance_m2: Matrix3::identity() * 0.01,
        bias_m: 0.0,
        bias_sigma_m: 0.1,
        position_bias_m2: Vector3::zeros(),
        range_sigma_m: 0.06,
    });
    let name = format!("tight over a flight of {:.1} s", flown.last().unwrap().t_s);
    let method = Method::Tight { judge_ranges: true };
    c.bench_function(&name, |b| {
        b.iter(|| navigate(method, &log, &anchors, [0.1, 0.0]))
    });
}

criterion_group!(benches, tight);
criterion_main!(benches);
