//! Anchors surveyed from made flights and from a recorded one.
//!
//! The recordings are not part of this repository; see tests/recorded.rs. `cargo test -p
//! nova-solver --test survey -- --nocapture` prints what docs/survey-and-fusion.md shows.

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

mod recordings;

use nalgebra::Vector3;
use nova_solver::multilateration::Height;
use nova_solver::survey::{
    AnchorRanges, Survey, SurveyError, SurveyOptions, TagRange, Track, TrackPoint, advise,
    as_measured, convergence, inverted_uwb, survey,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use recordings::drive::{MAX_GAP_S, drive};

/// A climbing loop at some 3 m/s.
fn place(t_s: f64) -> Vector3<f64> {
    Vector3::new(
        15.0 * (0.2 * t_s).cos(),
        12.0 * (0.2 * t_s).sin(),
        8.0 + 4.0 * (0.13 * t_s).sin(),
    )
}

struct Flight {
    track: Track,
    ranges: Vec<Vec<TagRange>>,
}

/// Ranges to `anchors` whose stamps are `lag_s` late, 3 cm of noise, one in twenty wild.
fn flight(
    anchors: &[Vector3<f64>],
    place: fn(f64) -> Vector3<f64>,
    lag_s: f64,
    slope: f64,
    seed: u64,
) -> Flight {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let points: Vec<_> = (0..500)
        .map(|k| TrackPoint {
            t_s: 0.2 * f64::from(k),
            position_m: place(0.2 * f64::from(k)),
        })
        .collect();
    let ranges = (anchors.iter().enumerate())
        .map(|(i, anchor)| {
            (0..800)
                .map(|k| {
                    let t_s = 2.0 + 0.12 * f64::from(k) + 0.01 * i as f64;
                    let noise: f64 = StandardNormal.sample(&mut rng);
                    let wild = if rng.random_range(0..20) == 0 {
                        4.0
                    } else {
                        0.0
                    };
                    let bias = 0.1 * i as f64 - 0.1;
                    let range = (place(t_s - lag_s) - anchor).norm() * (1.0 + slope) + bias;
                    TagRange {
                        t_s,
                        range_m: range + 0.03 * noise + wild,
                        sigma_m: 0.03,
                    }
                })
                .collect()
        })
        .collect();
    Flight {
        track: Track::new(&points).unwrap(),
        ranges,
    }
}

fn run(flight: &Flight, height: Height) -> Result<Survey, SurveyError> {
    survey(
        &flight.track,
        &parts(flight, height),
        &SurveyOptions::default(),
    )
}

fn parts(flight: &Flight, height: Height) -> Vec<AnchorRanges<'_>> {
    (flight.ranges.iter())
        .map(|ranges| AnchorRanges { ranges, height })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn anchors_lag_and_slope_are_found_whatever_they_are(
        lag_s in -0.6..0.6, slope in -0.008..0.008, seed in 0u64..1000,
        offsets in prop::collection::vec((-8.0..8.0, -8.0..8.0, 0.0..6.0), 4),
    ) {
        let anchors: Vec<_> = offsets.iter().zip([(20.0, 20.0), (-20.0, 18.0), (-22.0, -17.0), (19.0, -20.0)])
            .map(|(o, c)| Vector3::new(c.0 + o.0, c.1 + o.1, o.2)).collect();
        let flight = flight(&anchors, place, lag_s, slope, seed);
        let found = run(&flight, Height::Unknown).unwrap();
        prop_assert!((found.common.lag_s - lag_s).abs() < 5.0 * found.common.lag_sigma_s + 1e-3, "{:?}", found.common);
        prop_assert!(found.common.lag_sigma_s < 0.03, "{:?}", found.common);
        prop_assert!((found.common.slope - slope).abs() < 5.0 * found.common.slope_sigma, "{:?}", found.common);
        for (anchor, surveyed) in anchors.iter().zip(&found.anchors) {
            let error = surveyed.found.position_m - anchor;
            prop_assert!(error.norm() < 0.25, "{error}");
            prop_assert!(error.dot(&(surveyed.found.covariance_m2.try_inverse().unwrap() * error)) < 25.0);
            prop_assert!(surveyed.found.observable());
        }
    }
}

#[test]
fn unmodelled_lag_spoils_the_papers_method_and_not_the_joint_one() {
    let anchors = [
        Vector3::new(20.0, 15.0, 2.0),
        Vector3::new(-18.0, 16.0, 5.0),
        Vector3::new(-3.0, -22.0, 1.0),
    ];
    let flight = flight(&anchors, place, 0.3, 0.0, 11);
    let joint = run(&flight, Height::Unknown).unwrap();
    for ((anchor, surveyed), ranges) in anchors.iter().zip(&joint.anchors).zip(&flight.ranges) {
        let alone = inverted_uwb(&as_measured(&flight.track, ranges, 1.0)).unwrap();
        let (ours, theirs) = (
            (surveyed.found.position_m - anchor).norm(),
            (alone.position_m - anchor).norm(),
        );
        assert!(theirs > 0.3 && ours < 0.5 * theirs, "{ours} {theirs}");
    }
}

#[test]
fn inverted_uwb_finds_the_anchor_of_clean_ranges() {
    let anchors = [Vector3::new(30.0, -10.0, 3.0)];
    let mut flight = flight(&anchors, place, 0.0, 0.0, 5);
    for range in &mut flight.ranges[0] {
        range.range_m = (flight.track.at(range.t_s, 1.0).unwrap().0 - anchors[0]).norm();
    }
    let found = inverted_uwb(&as_measured(&flight.track, &flight.ranges[0], 1.0)).unwrap();
    assert!((found.position_m - anchors[0]).norm() < 1e-6, "{found:?}");
}

#[test]
fn straight_flight_is_said_to_be_blind_and_the_advice_is_to_leave_its_line() {
    let line = |t_s: f64| Vector3::new(0.0, 0.6 * t_s - 30.0, 6.0);
    let anchors = [Vector3::new(12.0, 3.0, 2.0), Vector3::new(-9.0, -8.0, 3.0)];
    let flight = flight(&anchors, line, 0.0, 0.0, 3);
    let found = run(&flight, Height::Unknown).unwrap();
    for (surveyed, anchor) in found.anchors.iter().zip(&anchors) {
        assert!(!surveyed.found.observable());
        let error = surveyed.found.position_m - anchor;
        let nees = error.dot(&(surveyed.found.covariance_m2.try_inverse().unwrap() * error));
        assert!(nees < 16.0, "{nees}: {:?}", surveyed.found);
    }
    let advice = advise(&found, &flight.track, &SurveyOptions::default());
    let (best, worst) = (advice.first().unwrap(), advice.last().unwrap());
    assert!(best.rms_m[1] < 0.5 * best.rms_m[0], "{best:?}");
    let sideways = |leg: &nova_solver::survey::Leg| {
        let d = leg.to_m - leg.from_m;
        d.x.hypot(d.z) / d.norm()
    };
    assert!(sideways(&best.leg) > 0.5, "{best:?}");
    assert!(best.rms_m[1] < worst.rms_m[1]);
}

#[test]
fn advised_leg_keeps_what_it_promises() {
    // The same blind flight, then with the advised leg flown.
    let line = |t_s: f64| Vector3::new(0.0, 0.6 * t_s - 30.0, 6.0);
    let anchors = [Vector3::new(12.0, 3.0, 2.0), Vector3::new(-9.0, -8.0, 3.0)];
    let blind = flight(&anchors, line, 0.0, 0.0, 3);
    let found = run(&blind, Height::Unknown).unwrap();
    let options = SurveyOptions::default();
    let best = advise(&found, &blind.track, &options)[0].clone();
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut points = blind.track.points().to_vec();
    let mut ranges = blind.ranges.clone();
    for k in 0..=100 {
        let t_s = 120.0 + 0.1 * f64::from(k);
        let position_m = best.leg.from_m + (best.leg.to_m - best.leg.from_m) * f64::from(k) / 100.0;
        points.push(TrackPoint { t_s, position_m });
        for (i, anchor) in anchors.iter().enumerate() {
            let noise: f64 = StandardNormal.sample(&mut rng);
            ranges[i].push(TagRange {
                t_s,
                range_m: (position_m - anchor).norm() + 0.1 * i as f64 - 0.1 + 0.03 * noise,
                sigma_m: 0.03,
            });
        }
    }
    let track = Track::new(&points).unwrap();
    let parts: Vec<_> = ranges
        .iter()
        .map(|ranges| AnchorRanges {
            ranges,
            height: Height::Unknown,
        })
        .collect();
    let after = survey(&track, &parts, &options).unwrap();
    let rms = |survey: &Survey| {
        let sum: f64 = (survey.anchors.iter().zip(&anchors))
            .map(|(s, a)| (s.found.position_m - a).norm_squared())
            .sum();
        (sum / anchors.len() as f64).sqrt()
    };
    assert!(
        rms(&after) < 3.0 * best.rms_m[1],
        "{} {:?}",
        rms(&after),
        best.rms_m
    );
    assert!(rms(&after) < 0.3);
}

#[test]
fn estimates_settle_as_ranges_come_in() {
    let anchors = [
        Vector3::new(20.0, 15.0, 2.0),
        Vector3::new(-18.0, 16.0, 5.0),
    ];
    let flight = flight(&anchors, place, 0.1, 0.0, 4);
    let stages = convergence(
        &flight.track,
        &parts(&flight, Height::Unknown),
        &SurveyOptions::default(),
        &[2, 50, 200, 800],
    );
    assert!(stages[0].joint.is_none() && stages[0].inverted_m[0].is_none());
    let sigma = |k: usize| {
        stages[k].joint.as_ref().unwrap().anchors[0]
            .found
            .sigma_m
            .norm()
    };
    assert!(sigma(3) < sigma(2) && sigma(2) < sigma(1));
}

#[test]
fn bad_input_is_named() {
    let anchors = [Vector3::new(20.0, 15.0, 2.0)];
    let mut flight = flight(&anchors, place, 0.0, 0.0, 1);
    let options = SurveyOptions::default();
    assert_eq!(
        survey(&flight.track, &[], &options),
        Err(SurveyError::NoAnchors)
    );
    let bad = SurveyOptions {
        lag_sigma_s: f64::NAN,
        ..options
    };
    assert!(matches!(
        survey(&flight.track, &parts(&flight, Height::Unknown), &bad),
        Err(SurveyError::BadOption {
            name: "lag_sigma_s",
            ..
        })
    ));
    let before: Vec<_> = flight.ranges[0]
        .iter()
        .take(40)
        .map(|r| TagRange {
            t_s: r.t_s - 1e4,
            ..*r
        })
        .collect();
    let off_track = AnchorRanges {
        ranges: &before,
        height: Height::Unknown,
    };
    assert_eq!(
        survey(&flight.track, &[off_track], &options),
        Err(SurveyError::TooFewRanges {
            anchor: 0,
            got: 0,
            given: 40,
            unknowns: 6
        })
    );
    flight.ranges[0][7].range_m = f64::NAN;
    assert!(matches!(
        run(&flight, Height::Unknown),
        Err(SurveyError::BadRange {
            anchor: 0,
            index: 7,
            ..
        })
    ));
}

#[test]
fn recorded_anchors_are_found_within_12_cm_without_being_told_the_lag() {
    for case in ["LOSA", "NLOSA"] {
        let Some(drive) = drive(case) else {
            return;
        };
        let options = SurveyOptions {
            max_gap_s: MAX_GAP_S,
            ..SurveyOptions::default()
        };
        for heights_known in [false, true] {
            let parts: Vec<_> = (drive.ranges.values().zip(drive.anchors.values()))
                .map(|(ranges, place)| AnchorRanges {
                    ranges,
                    height: if heights_known {
                        Height::Known(place.z)
                    } else {
                        Height::Unknown
                    },
                })
                .collect();
            let found = survey(&drive.track, &parts, &options).unwrap();
            println!("{case} {:?}", found.common);
            for ((anchor, truth), surveyed) in drive.anchors.iter().zip(&found.anchors) {
                let f = &surveyed.found;
                let error = f.position_m - truth;
                println!(
                    "| {case} | {anchor} | {} | {} | {:.3} {:.3} {:.3} | {:.3} | {:.3} {:.3} {:.3} | {:.3} |",
                    f.used,
                    f.rejected,
                    error.x,
                    error.y,
                    error.z,
                    error.xy().norm(),
                    f.sigma_m.x,
                    f.sigma_m.y,
                    f.sigma_m.z,
                    f.range_bias_m
                );
                assert!(error.xy().norm() <= 0.12, "{case} {anchor}: {error}");
                let horizontal = f.covariance_m2.fixed_view::<2, 2>(0, 0).into_owned();
                let nees = error
                    .xy()
                    .dot(&(horizontal.try_inverse().unwrap() * error.xy()));
                assert!(nees < 9.21, "{case} {anchor}: {nees}"); // 99 % of chi-square with 2
                if heights_known {
                    assert!(f.sigma_m.xy().norm() < 0.35 && f.observable());
                } else {
                    // Anchors and path lie in one plane, give or take 1 m: the height is open.
                    assert!(!f.observable() && error.z.abs() < 3.0 * f.sigma_m.z);
                }
            }
            let lag = found.common;
            assert!((0.16..0.2).contains(&lag.lag_s), "{lag:?}");
            assert!(lag.lag_sigma_s < 0.01, "{lag:?}");
        }
    }
}
