//! Speed of a survey: six anchors, 1000 ranges each. With SURVEY_CSV set it prints the problem instead,
//! for benches/peers/survey.py.

#![allow(missing_docs, clippy::unwrap_used)] // criterion's macros

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use nova_solver::multilateration::Height;
use nova_solver::survey::{AnchorRanges, SurveyOptions, TagRange, Track, TrackPoint, survey};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::hint::black_box;

fn place(t: f64) -> Vector3<f64> {
    Vector3::new(
        15.0 * (0.2 * t).cos(),
        12.0 * (0.2 * t).sin(),
        8.0 + 4.0 * (0.13 * t).sin(),
    )
}

fn six_anchors(c: &mut Criterion) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let points: Vec<_> = (0..600)
        .map(|k| TrackPoint {
            t_s: 0.2 * f64::from(k),
            position_m: place(0.2 * f64::from(k)),
        })
        .collect();
    let track = Track::new(&points).unwrap();
    let ranges: Vec<Vec<TagRange>> = (0..6)
        .map(|i| {
            let angle = f64::from(i) * 1.05;
            let anchor = Vector3::new(
                20.0 * angle.cos(),
                20.0 * angle.sin(),
                f64::from(i % 3) * 4.0,
            );
            (0..1000)
                .map(|k| {
                    let t_s = 1.0 + 0.1 * f64::from(k) + 0.01 * f64::from(i);
                    let noise: f64 = StandardNormal.sample(&mut rng);
                    let wild = if k % 20 == 7 { 3.0 } else { 0.0 };
                    TagRange {
                        t_s,
                        range_m: (place(t_s - 0.15) - anchor).norm() + 0.1 + 0.05 * noise + wild,
                        sigma_m: 0.05,
                    }
                })
                .collect()
        })
        .collect();
    if std::env::var_os("SURVEY_CSV").is_some() {
        // For the same problem in another solver: anchor, t, range; then the track.
        for (i, anchor) in ranges.iter().enumerate() {
            for r in anchor {
                println!("r,{i},{},{}", r.t_s, r.range_m);
            }
        }
        for p in &points {
            println!(
                "t,{},{},{},{}",
                p.t_s, p.position_m.x, p.position_m.y, p.position_m.z
            );
        }
        return;
    }
    let parts: Vec<_> = ranges
        .iter()
        .map(|ranges| AnchorRanges {
            ranges,
            height: Height::Unknown,
        })
        .collect();
    c.bench_function("six anchors, 1000 ranges each", |b| {
        b.iter(|| {
            survey(
                black_box(&track),
                black_box(&parts),
                &SurveyOptions::default(),
            )
            .unwrap()
        })
    });
}

criterion_group!(benches, six_anchors);
criterion_main!(benches);
