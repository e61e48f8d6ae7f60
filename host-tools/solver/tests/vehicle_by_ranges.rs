//! A recorded vehicle, found from its ranges by anchors that were surveyed from its track; and how well that
//! could be done at all. `cargo test -p nova-solver --test vehicle_by_ranges -- --nocapture` prints what
//! docs/survey-and-fusion.md shows.

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

mod recordings;

use nalgebra::Vector3;
use nova_solver::multilateration::Height;
use nova_solver::positioning::{
    AnchorRange, RangeFilter, RangeFilterOptions, Smoothed, SmootherOptions, Tracked, smooth,
};
use nova_solver::survey::{AnchorRanges, SurveyOptions, survey};
use nova_solver::{RangeMeasurement, SolveError};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use recordings::drive::{Drive, MAX_GAP_S, TAG_UP_M, drive};

/// Root mean square error, root of the mean variance, mean NEES (of 2), in the plane.
#[derive(Default, Clone, Copy)]
struct Sums {
    error2: f64,
    variance: f64,
    nees: f64,
    n: f64,
}

/// Within 10 m of the anchors, 10-20, beyond, all. Along the drive's x, which leads away from them.
fn by_distance<'a>(track: impl IntoIterator<Item = &'a Tracked>, drive: &Drive) -> [Sums; 4] {
    let mut sums = [Sums::default(); 4];
    for at in track {
        let Some((truth, _)) = drive.track.at(at.t_s, MAX_GAP_S) else {
            continue;
        };
        let band = match truth.x.abs() {
            x if x < 10.0 => 0,
            x if x < 20.0 => 1,
            _ => 2,
        };
        let error = (at.position_m - truth).xy();
        let covariance = at.covariance_m2.fixed_view::<2, 2>(0, 0).into_owned();
        for k in [band, 3] {
            let s = &mut sums[k];
            s.error2 += error.norm_squared();
            s.variance += covariance.trace();
            s.nees += error.dot(&(covariance.try_inverse().unwrap() * error));
            s.n += 1.0;
        }
    }
    sums
}

fn say(case: &str, what: &str, sums: &[Sums; 4], errors: bool) -> [f64; 4] {
    let rms = sums.map(|s| (s.error2 / s.n).sqrt());
    let sigma = sums.map(|s| (s.variance / s.n).sqrt());
    let list = |values: [f64; 4]| values.map(|v| format!("{v:.2}")).join(", ");
    if errors {
        let nees = sums[3].nees / sums[3].n;
        println!(
            "| {case}, {what} | {} | {} | {nees:.1} |",
            list(rms),
            list(sigma)
        );
    } else {
        println!("| {case}, {what} | | {} | |", list(sigma));
    }
    if errors { rms } else { sigma }
}

/// Ranges in order of time, corrected by what the survey found, with the anchors where it found them.
fn measurements(drive: &Drive) -> Vec<RangeMeasurement> {
    let parts: Vec<_> = (drive.ranges.iter())
        .map(|(number, ranges)| AnchorRanges {
            ranges,
            height: Height::Known(drive.anchors[number].z),
        })
        .collect();
    let options = SurveyOptions {
        max_gap_s: MAX_GAP_S,
        ..SurveyOptions::default()
    };
    let found = survey(&drive.track, &parts, &options).unwrap();
    let mut all: Vec<_> = (drive.ranges.values().zip(&found.anchors))
        .flat_map(|(ranges, anchor)| {
            let f = &anchor.found;
            ranges.iter().map(|range| RangeMeasurement {
                t_s: range.t_s - found.common.lag_s,
                position_m: f.position_m,
                range_m: (range.range_m - f.range_bias_m) / (1.0 + found.common.slope),
                sigma_m: 0.02,
            })
        })
        .collect();
    all.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    all
}

/// White noise of 6 cm, judged as it comes.
fn filtered(ranges: &[RangeMeasurement], start_m: Vector3<f64>) -> Vec<Tracked> {
    let options = RangeFilterOptions {
        height_m: Some(TAG_UP_M),
        ..RangeFilterOptions::default()
    };
    let mut filter = RangeFilter::new(options, ranges[0].t_s, start_m, 1.0, 0.5);
    (ranges.iter())
        .map(|range| {
            let known = AnchorRange {
                anchor_m: range.position_m,
                range_m: range.range_m,
                sigma_m: 0.06,
            };
            filter.update(range.t_s, &known);
            filter.state()
        })
        .collect()
}

/// What the same ranges without any error would leave in doubt: Fisher's information of this geometry under
/// the model's noise and motion, at the true places (where RTK is not fixed, at the found ones).
fn bound(
    drive: &Drive,
    ranges: &[RangeMeasurement],
    found: &[Smoothed],
    options: &SmootherOptions,
    sigma_m: f64,
) -> Vec<Smoothed> {
    let clean: Vec<_> = (ranges.iter().zip(found))
        .map(|(range, found)| {
            let place =
                (drive.track.at(range.t_s, MAX_GAP_S)).map_or(found.by_all.position_m, |(p, _)| p);
            let place = Vector3::new(place.x, place.y, TAG_UP_M);
            RangeMeasurement {
                range_m: (place - range.position_m).norm(),
                sigma_m,
                ..*range
            }
        })
        .collect();
    let start = found[0].by_all.position_m;
    // RTK's points jump now and then by more than the model's vehicle can: nothing is set aside for that.
    let options = SmootherOptions {
        gate: 1e9,
        ..*options
    };
    smooth(&clean, start, [1.0, 0.5], &options).unwrap()
}

/// Anchors within 2 m of each other, seen from up to 50 m away.
#[test]
fn recorded_vehicle_is_followed_as_well_as_four_anchors_at_one_corner_allow() {
    for case in ["LOSA", "NLOSA"] {
        let Some(drive) = drive(case) else {
            return;
        };
        let ranges = measurements(&drive);
        let options = SmootherOptions {
            height_m: Some(TAG_UP_M),
            ..SmootherOptions::default()
        };
        // The anchors stand nearly on a line, whose two sides only the later motion tells apart: the side
        // is given.
        let start = drive.track.points()[0].position_m;
        let found = smooth(&ranges, start, [1.0, 0.5], &options).unwrap();
        let white = SmootherOptions {
            slow_sigma_m: 0.0,
            common_sigma_m: 0.0,
            ..options
        };
        let of =
            |what, track: &[Tracked], errors| say(case, what, &by_distance(track, &drive), errors);
        let live = |s: &[Smoothed]| s.iter().map(|s| s.so_far).collect::<Vec<_>>();
        let all = |s: &[Smoothed]| s.iter().map(|s| s.by_all).collect::<Vec<_>>();
        let filter = of("filter, white noise", &filtered(&ranges, start), true);
        let so_far = of("live, slow errors", &live(&found), true);
        let by_all = of("smoothed, slow errors", &all(&found), true);
        let best = bound(&drive, &ranges, &found, &options, 0.02);
        let best_white = bound(&drive, &ranges, &found, &white, 0.06);
        let bound_live = of("bound live, slow errors", &live(&best), false);
        let bound_all = of("bound smoothed, slow errors", &all(&best), false);
        let bound_white = of(
            "bound smoothed, white noise of 6 cm",
            &all(&best_white),
            false,
        );
        // Asked is 0.15 m. Even were all noise white, the whole drive could not be known to that.
        assert!(bound_white[3] > 0.15 && bound_all[3] > 0.2 && bound_live[3] > bound_all[3]);
        assert!(by_all[0] < 0.17 && by_all[3] < 0.36, "{by_all:?}");
        assert!(by_all[3] < 0.85 * filter[3] && so_far[3] < 1.1 * filter[3]);
        assert!(by_all[3] < 1.4 * bound_all[3] && so_far[3] < 1.4 * bound_live[3]);
        let nees = by_distance(&all(&found), &drive)[3];
        assert!(nees.nees / nees.n < 4.0, "{}", nees.nees / nees.n);
    }
}

const ANCHORS: [Vector3<f64>; 4] = [
    Vector3::new(0.0, 0.0, 2.0),
    Vector3::new(8.0, 1.0, 1.0),
    Vector3::new(7.0, 9.0, 2.5),
    Vector3::new(-1.0, 8.0, 0.5),
];

/// A drive that obeys the smoother's model: places, and ranges with slow and white errors.
fn made(seed: u64, options: &SmootherOptions) -> (Vec<Vector3<f64>>, Vec<RangeMeasurement>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let dt: f64 = 0.03;
    let (mut p, mut v) = (Vector3::new(3.0, 4.0, 1.0), Vector3::new(0.3, 0.1, 0.0));
    let mut slow = [0.0; 5];
    for (k, e) in slow.iter_mut().enumerate() {
        let sigma = if k == 4 {
            options.common_sigma_m
        } else {
            options.slow_sigma_m
        };
        *e = sigma * normal();
    }
    let keep = (-dt / options.memory_s).exp();
    let (mut places, mut ranges) = (Vec::new(), Vec::new());
    for k in 0..800usize {
        for i in 0..2 {
            // Noise of the density q^2 over dt, by its covariance's square root.
            let (a, b) = (normal(), normal());
            let q = options.acceleration;
            p[i] += v[i] * dt + q * dt.powf(1.5) * (0.5 * a + b / 12f64.sqrt());
            v[i] += q * dt.sqrt() * a;
        }
        for (k, e) in slow.iter_mut().enumerate() {
            let sigma = if k == 4 {
                options.common_sigma_m
            } else {
                options.slow_sigma_m
            };
            *e = *e * keep + sigma * (1.0 - keep * keep).sqrt() * normal();
        }
        let anchor = ANCHORS[k % 4];
        places.push(p);
        ranges.push(RangeMeasurement {
            t_s: dt * k as f64,
            position_m: anchor,
            range_m: (p - anchor).norm() + slow[k % 4] + slow[4] + 0.02 * normal(),
            sigma_m: 0.02,
        });
    }
    (places, ranges)
}

#[test]
fn where_the_model_is_true_sigmas_are_and_the_whole_tells_more_than_the_past() {
    let options = SmootherOptions {
        height_m: Some(1.0),
        gate: 1e6, // its noise is Gaussian: nothing to set aside
        ..SmootherOptions::default()
    };
    let (mut nees, mut nees_live, mut error2, mut error2_live, mut n) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for seed in 0..60 {
        let (places, ranges) = made(2025 + seed, &options);
        let found = smooth(&ranges, Vector3::new(3.0, 4.0, 1.0), [0.3, 0.5], &options).unwrap();
        // Slow errors hang together: a moment a few memories after the one before.
        for k in (200..800).step_by(200) {
            let count = |at: &Tracked, nees: &mut f64, error2: &mut f64| {
                let e = (at.position_m - places[k]).xy();
                let c = at.covariance_m2.fixed_view::<2, 2>(0, 0).into_owned();
                *nees += e.dot(&(c.try_inverse().unwrap() * e));
                *error2 += e.norm_squared();
            };
            count(&found[k].by_all, &mut nees, &mut error2);
            count(&found[k].so_far, &mut nees_live, &mut error2_live);
            n += 1.0;
        }
    }
    let (nees, nees_live) = (nees / n, nees_live / n);
    println!(
        "NEES of 2: {nees:.2} by all, {nees_live:.2} live; RMSE {:.3} and {:.3} m",
        f64::sqrt(error2 / n),
        f64::sqrt(error2_live / n)
    );
    // n chi-squares of two: mean 2, standard deviation 2 / sqrt(n); three of them, and a little for the
    // kernel, which weighs Gaussian tails down.
    let band = 3.0 * 2.0 / f64::sqrt(n) + 0.1;
    assert!((nees - 2.0).abs() < band && (nees_live - 2.0).abs() < band);
    assert!(error2 < error2_live);
}

#[test]
fn smoother_names_what_it_cannot_use() {
    let options = SmootherOptions::default();
    let (_, mut ranges) = made(1, &options);
    let start = Vector3::new(3.0, 4.0, 1.0);
    let bad = SmootherOptions {
        memory_s: 0.0,
        ..options
    };
    assert!(matches!(
        smooth(&ranges, start, [1.0, 1.0], &bad),
        Err(SolveError::BadOption {
            name: "memory_s",
            ..
        })
    ));
    assert!(matches!(
        smooth(&[], start, [1.0, 1.0], &options),
        Err(SolveError::TooFewMeasurements { got: 0, .. })
    ));
    ranges[17].range_m = f64::NAN;
    assert!(matches!(
        smooth(&ranges, start, [1.0, 1.0], &options),
        Err(SolveError::BadMeasurement { index: 17, .. })
    ));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn by_all_is_never_less_sure_than_live_and_order_does_not_matter(
        seed in 0u64..10_000, height in prop::option::of(0.5..1.5), wild in 0usize..40,
    ) {
        let options = SmootherOptions { height_m: height, rounds: 2, ..SmootherOptions::default() };
        let (_, mut ranges) = made(seed, &options);
        ranges.truncate(240);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for _ in 0..wild {
            ranges[rng.random_range(0..240)].range_m += rng.random_range(-20.0..20.0);
        }
        let start = Vector3::new(3.0, 4.0, 1.0);
        let found = smooth(&ranges, start, [0.5, 0.5], &options).unwrap();
        for s in &found {
            let (all, live) = (s.by_all.covariance_m2, s.so_far.covariance_m2);
            prop_assert!((live - all).symmetric_eigenvalues().min() > -1e-9, "{}", live - all);
            prop_assert!(all.symmetric_eigenvalues().min() > -1e-12);
        }
        ranges.reverse();
        prop_assert_eq!(found, smooth(&ranges, start, [0.5, 0.5], &options).unwrap());
    }
}
