//! A tag located from differences of ranges: made, and recorded (see docs/recorded-data.md).
//! `cargo test -p nova-solver --test tdoa -- --nocapture` prints what docs/survey-and-fusion.md shows.

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

mod recordings;

use nalgebra::Vector3;
use nova_solver::SolveError;
use nova_solver::positioning::{
    RangeDifference, TdoaFix, TdoaOptions, closed_form_differences, locate_tdoa,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use recordings::{columns, data};

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Eight corners of a room, each a little off.
fn room(rng: &mut ChaCha8Rng) -> Vec<Vector3<f64>> {
    (0..8)
        .map(|corner| {
            let side = |bit: i32| if corner & bit == 0 { -1.0 } else { 1.0 };
            Vector3::new(4.0 * side(1), 3.5 * side(2), 1.5 + 1.4 * side(4))
                + Vector3::from_fn(|_, _| rng.random_range(-0.4..0.4))
        })
        .collect()
}

/// Differences of pairs drawn at random; `wild` of them are off by up to 100 m.
fn differences(
    rng: &mut ChaCha8Rng,
    anchors: &[Vector3<f64>],
    offsets: &[f64],
    tag: Vector3<f64>,
    count: usize,
    wild: f64,
) -> Vec<RangeDifference> {
    (0..count)
        .map(|_| {
            let a = rng.random_range(0..anchors.len());
            let b = (a + rng.random_range(1..anchors.len())) % anchors.len();
            let range = |i: usize| (tag - anchors[i]).norm() + offsets[i];
            let outlier = if rng.random::<f64>() < wild {
                rng.random_range(-100.0..100.0)
            } else {
                0.0
            };
            RangeDifference {
                anchors_m: [anchors[a], anchors[b]],
                difference_m: range(b) - range(a) + 0.07 * normal(rng) + outlier,
                sigma_m: 0.1,
            }
        })
        .collect()
}

fn nees(fix: &TdoaFix, tag: Vector3<f64>) -> f64 {
    let error = fix.position_m - tag;
    error.dot(&(fix.covariance_m2.try_inverse().unwrap() * error))
}

/// Mean NEES, part within the 95 % ellipsoid, root mean square error and sigma (m).
fn consistency(offset_sigma_m: f64, count: usize, trials: u64) -> [f64; 4] {
    let mut sums = [0.0; 4];
    for trial in 0..trials {
        let mut rng = ChaCha8Rng::seed_from_u64(2025 + trial);
        let anchors = room(&mut rng);
        let offsets: Vec<f64> = (0..8).map(|_| offset_sigma_m * normal(&mut rng)).collect();
        let tag = Vector3::new(
            rng.random_range(-3.0..3.0),
            rng.random_range(-3.0..3.0),
            rng.random_range(0.2..2.8),
        );
        let given = differences(&mut rng, &anchors, &offsets, tag, count, 0.05);
        let fix = locate_tdoa(&given, &TdoaOptions::default()).unwrap();
        let nees = nees(&fix, tag);
        sums[0] += nees;
        sums[1] += f64::from(u8::from(nees < 7.81)); // 95 % of chi-square with 3
        sums[2] += (fix.position_m - tag).norm_squared();
        sums[3] += fix.covariance_m2.trace();
    }
    let [nees, within, error2, variance] = sums.map(|sum| sum / trials as f64);
    [nees, within, error2.sqrt(), variance.sqrt()]
}

#[test]
fn sigma_counts_offsets_of_anchors_that_no_number_of_differences_averages_away() {
    for (offset, count) in [(0.0, 1000), (0.1, 1000), (0.25, 1000), (0.25, 60)] {
        let [nees, within, error, sigma] = consistency(offset, count, 200);
        println!(
            "offsets {offset}, {count} differences: NEES {nees:.2} of 3, {within:.3} within 95 %, \
             error {error:.3}, sigma {sigma:.3}"
        );
        // Where there are none, those that were expected leave it cautious. Where they are twice and more
        // what was expected, four that show are few to learn it from: the tails are Student's.
        assert!(nees < 4.5, "{offset} {count}: {nees}");
        assert!(within > 0.80, "{offset} {count}: {within}");
        if offset > 0.0 {
            assert!(
                nees > 1.5 && sigma < 1.5 * error,
                "{offset} {count}: {nees}"
            );
        }
    }
}

#[test]
fn wild_differences_are_counted_and_move_the_place_by_less_than_its_sigma() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let anchors = room(&mut rng);
    let tag = Vector3::new(1.0, -0.5, 1.2);
    let clean = differences(&mut rng, &anchors, &[0.0; 8], tag, 400, 0.0);
    let mut spoilt = clean.clone();
    for k in (0..400).step_by(4) {
        spoilt[k].difference_m += rng.random_range(3.0..100.0);
    }
    let options = TdoaOptions::default();
    let (clean, spoilt) = (
        locate_tdoa(&clean, &options).unwrap(),
        locate_tdoa(&spoilt, &options).unwrap(),
    );
    assert!(spoilt.outliers >= 100 && clean.outliers < 20);
    let moved = (spoilt.position_m - clean.position_m).norm();
    assert!(moved < spoilt.covariance_m2.trace().sqrt(), "{moved}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn which_end_comes_first_does_not_matter(seed in 0u64..10_000, flips in prop::collection::vec(any::<bool>(), 40)) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let anchors = room(&mut rng);
        let given = differences(&mut rng, &anchors, &[0.1; 8], Vector3::new(0.5, 1.0, 1.0), 40, 0.0);
        let turned: Vec<_> = given.iter().zip(&flips).map(|(d, flip)| {
            let [a, b] = d.anchors_m;
            if *flip {
                RangeDifference { anchors_m: [b, a], difference_m: -d.difference_m, ..*d }
            } else {
                *d
            }
        }).collect();
        let options = TdoaOptions::default();
        let (one, other) = (locate_tdoa(&given, &options).unwrap(), locate_tdoa(&turned, &options).unwrap());
        // The correlation in time of what was turned is another, and with it the noise.
        prop_assert!((one.position_m - other.position_m).norm() < 0.5 * one.covariance_m2.trace().sqrt());
        prop_assert!(one.covariance_m2.cholesky().is_some());
    }

    #[test]
    fn the_closed_form_finds_the_place_that_the_iterative_one_finds(
        seed in 0u64..10_000, count in 4usize..9, flat in any::<bool>(), star in any::<bool>(),
    ) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut anchors = room(&mut rng);
        // Four corners of the ceiling and floor in turn, so that any number of them is spread out.
        anchors.sort_by_key(|a| [(a.x * a.y * (a.z - 1.5) > 0.0), a.z > 1.5]);
        anchors.truncate(count);
        if flat {
            anchors.iter_mut().for_each(|a| a.z = 2.5);
        }
        let tag = Vector3::new(rng.random_range(-3.0..3.0), rng.random_range(-3.0..3.0), rng.random_range(0.2..1.8));
        let exact = |a: usize, b: usize| RangeDifference {
            anchors_m: [anchors[a], anchors[b]],
            difference_m: (tag - anchors[b]).norm() - (tag - anchors[a]).norm(),
            sigma_m: 0.1,
        };
        let given: Vec<_> = if star {
            // Of one base anchor, as in the paper; twice, since the iterative one wants four.
            [0, 0].iter().flat_map(|_| (1..count).map(|b| exact(0, b))).collect()
        } else {
            (0..count).flat_map(|a| (0..count).filter(move |b| *b != a).map(move |b| (a, b))).map(|(a, b)| exact(a, b)).collect()
        };
        let places = closed_form_differences(&given);
        let nearest = places.iter().map(|p| (p - tag).norm()).fold(f64::INFINITY, f64::min);
        prop_assert!(places.len() <= 2 && nearest < 1e-6, "{:?}", places);
        let fix = locate_tdoa(&given, &TdoaOptions::default()).unwrap();
        let told = [Some(fix.position_m), fix.alternative_m];
        let off = told.iter().flatten().map(|p| (p - tag).norm()).fold(f64::INFINITY, f64::min);
        prop_assert!(off < 1e-3, "{:?} {}", fix, tag);
        // Anchors in a plane cannot tell the place from its image; heights can.
        if flat {
            let below = TdoaOptions { heights_m: Some([0.0, 2.4]), ..TdoaOptions::default() };
            let fix = locate_tdoa(&given, &below).unwrap();
            prop_assert!((fix.position_m - tag).norm() < 1e-3 && fix.alternative_m.is_none(), "{:?} {}", fix, tag);
        }
    }

    #[test]
    fn any_numbers_give_an_answer_with_a_covariance_or_an_error(
        rows in prop::collection::vec((prop::array::uniform7(-50.0f64..50.0), 0u8..12), 0..12),
    ) {
        let given: Vec<_> = rows.iter().map(|(v, odd)| {
            let first = Vector3::new(v[0], v[1], v[2]);
            let second = Vector3::new(v[3], v[4], v[5]);
            RangeDifference {
                anchors_m: [first, if *odd == 1 { first } else { second }],
                difference_m: match odd { 2 => f64::NAN, 3 => f64::INFINITY, 4 => 1e300, _ => v[6] },
                sigma_m: match odd { 5 => 0.0, 6 => -1.0, _ => 0.1 },
            }
        }).collect();
        if let Ok(fix) = locate_tdoa(&given, &TdoaOptions::default()) {
            prop_assert!(fix.position_m.iter().all(|v| v.is_finite()));
            prop_assert!(fix.covariance_m2.diagonal().iter().all(|v| *v > 0.0 && v.is_finite()));
        }
    }
}

fn recorded_anchors() -> Option<Vec<Vector3<f64>>> {
    let rows = columns(
        &data("D_crazyflie_tdoa_static/anchors.csv")?,
        ["anchor", "x_m", "y_m", "z_m"],
    );
    assert!(rows.iter().zip(0..).all(|(row, k)| row[0] == f64::from(k)));
    Some(
        rows.iter()
            .map(|&[_, x, y, z]| Vector3::new(x, y, z))
            .collect(),
    )
}

/// Recorded at rest at the origin of a second system (lighthouses); given as good as it promises to be.
fn recorded() -> Option<Vec<RangeDifference>> {
    let places = recorded_anchors()?;
    let rows = columns(
        &data("D_crazyflie_tdoa_static/tdoa.csv")?,
        ["anchor_a", "anchor_b", "dist_b_minus_dist_a_m"],
    );
    let difference = |&[a, b, difference_m]: &[f64; 3]| RangeDifference {
        anchors_m: [a, b].map(|number| places[number as usize]),
        difference_m,
        sigma_m: 0.15,
    };
    Some(rows.iter().map(difference).collect())
}

#[test]
fn recorded_differences_place_a_tag_at_rest() {
    let Some(given) = recorded() else {
        return;
    };
    let fix = locate_tdoa(&given, &TdoaOptions::default()).unwrap();
    let sigma = fix.covariance_m2.diagonal().map(f64::sqrt);
    println!(
        "TDoA: error {:.3} {:.3} {:.3}, {:.3}; sigma {:.3} {:.3} {:.3}, {:.3}; NEES {:.1}; offsets \
         {:.3}, noise x {:.2}, {} of {} outliers",
        fix.position_m.x,
        fix.position_m.y,
        fix.position_m.z,
        fix.position_m.norm(),
        sigma.x,
        sigma.y,
        sigma.z,
        sigma.norm(),
        nees(&fix, Vector3::zeros()),
        fix.offset_sigma_m,
        fix.noise_scale,
        fix.outliers,
        given.len(),
    );
    assert!(fix.position_m.norm() < 0.45, "{fix:?}");
    assert!(sigma.norm() > 0.1, "{sigma}");
    assert!(matches!(
        locate_tdoa(&given[..3], &TdoaOptions::default()),
        Err(SolveError::TooFewMeasurements { got: 3, .. })
    ));
}

/// The parts of the recording between these anchors alone.
fn between(given: &[RangeDifference], anchors: &[Vector3<f64>]) -> Vec<RangeDifference> {
    (given.iter())
        .filter(|d| d.anchors_m.iter().all(|a| anchors.contains(a)))
        .copied()
        .collect()
}

/// Of the cube's corners, two tetrahedra without a corner in common. What they find is independent, but
/// for the frame in which the anchors' places are given.
#[test]
fn recorded_halves_of_the_anchors_agree_within_their_sigmas_on_another_origin_than_the_recordings()
{
    let (Some(given), Some(places)) = (recorded(), recorded_anchors()) else {
        return;
    };
    let half = |numbers: [usize; 4]| {
        let anchors = numbers.map(|n| places[n]);
        locate_tdoa(&between(&given, &anchors), &TdoaOptions::default()).unwrap()
    };
    let (one, other) = (half([0, 2, 5, 7]), half([1, 3, 4, 6]));
    let apart = one.position_m - other.position_m;
    let s = (one.covariance_m2 + other.covariance_m2)
        .try_inverse()
        .unwrap();
    println!(
        "halves: {:.3} m apart, NEES {:.2} of 3; from the recording's origin {:.3} and {:.3} m",
        apart.norm(),
        apart.dot(&(s * apart)),
        one.position_m.norm(),
        other.position_m.norm()
    );
    assert!(apart.dot(&(s * apart)) < 7.81); // 95 % of chi-square with 3
    let direction = one
        .position_m
        .normalize()
        .dot(&other.position_m.normalize());
    assert!(direction > 0.95, "{direction}");
}

#[test]
fn recorded_place_holds_within_its_sigma_whichever_two_anchors_are_left_out_and_in_any_second() {
    let (Some(given), Some(places)) = (recorded(), recorded_anchors()) else {
        return;
    };
    let options = TdoaOptions::default();
    let whole = locate_tdoa(&given, &options).unwrap().position_m;
    let mut parts: Vec<Vec<RangeDifference>> = given.chunks_exact(180).map(<[_]>::to_vec).collect();
    for (i, first) in places.iter().enumerate() {
        for second in &places[i + 1..] {
            let others: Vec<_> = (places.iter())
                .filter(|a| *a != first && *a != second)
                .copied()
                .collect();
            parts.push(between(&given, &others));
        }
    }
    assert!(parts.len() >= 39);
    let most = (parts.iter())
        .map(|part| nees(&locate_tdoa(part, &options).unwrap(), whole))
        .fold(0.0, f64::max);
    println!(
        "{} parts of the recording: NEES about the whole at most {most:.2}",
        parts.len()
    );
    assert!(most < 7.81, "{most}");
}
