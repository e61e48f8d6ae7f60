//! Antenna delays from ranges at known distances.
#![allow(clippy::unwrap_used)]

use nova_solver::Kernel;
use nova_solver::calibration::{
    Calibration, CalibrationError, CalibrationOptions, Determined, NodePrior, Pair, calibrate,
    offset_per_tick_m,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

const PRIOR: NodePrior = NodePrior::Uncalibrated(0.3);

/// Nodes at places, with offsets, and what they measure.
struct Site {
    places_m: Vec<[f64; 3]>,
    offsets_m: Vec<f64>,
    noise_m: f64,
    /// Errors of the distances that are believed.
    survey_sigma_m: f64,
    ranges: usize,
    /// One range in so many is late by up to 10 m; none with 0.
    late_one_in: usize,
}

struct Measured {
    nodes: [usize; 2],
    distance_m: f64,
    ranges_m: Vec<f64>,
}

impl Site {
    fn new(offsets_m: &[f64]) -> Self {
        let place = |k: usize| {
            let angle = k as f64 * 2.4;
            [4.0 * angle.cos(), 5.0 * angle.sin(), 1.0 + 0.3 * k as f64]
        };
        Self {
            places_m: (0..offsets_m.len()).map(place).collect(),
            offsets_m: offsets_m.to_vec(),
            noise_m: 0.03,
            survey_sigma_m: 0.0,
            ranges: 400,
            late_one_in: 0,
        }
    }

    fn measure(&self, links: &[[usize; 2]], seed: u64) -> Vec<Measured> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let noise = Normal::new(0.0, self.noise_m).unwrap();
        let survey = Normal::new(0.0, self.survey_sigma_m).unwrap();
        (links.iter())
            .map(|&[a, b]| {
                let squares = (0..3).map(|k| (self.places_m[a][k] - self.places_m[b][k]).powi(2));
                let truth_m = squares.sum::<f64>().sqrt();
                let ranges_m = (0..self.ranges)
                    .map(|k| {
                        let late = self.late_one_in > 0 && k % self.late_one_in == 0;
                        let late_m = if late {
                            rng.random_range(0.5..10.0)
                        } else {
                            0.0
                        };
                        let offset_m = self.offsets_m[a] + self.offsets_m[b];
                        truth_m + offset_m + noise.sample(&mut rng) + late_m
                    })
                    .collect();
                Measured {
                    nodes: [a, b],
                    distance_m: truth_m + survey.sample(&mut rng),
                    ranges_m,
                }
            })
            .collect()
    }
}

fn all_links(nodes: usize) -> Vec<[usize; 2]> {
    (0..nodes)
        .flat_map(|a| (a + 1..nodes).map(move |b| [a, b]))
        .collect()
}

fn solve(
    nodes: &[NodePrior],
    measured: &[Measured],
    distance_sigma_m: f64,
    options: &CalibrationOptions,
) -> Calibration {
    let pairs: Vec<Pair<'_>> = (measured.iter())
        .map(|m| Pair {
            nodes: m.nodes,
            distance_m: m.distance_m,
            distance_sigma_m,
            ranges_m: &m.ranges_m,
        })
        .collect();
    calibrate(nodes, &pairs, options).unwrap()
}

const SHARP: CalibrationOptions = CalibrationOptions {
    systematic_sigma_m: 0.0,
    kernel: Kernel::Huber { k: 1.345 },
};

#[test]
fn three_nodes_give_each_its_own_offset() {
    let truth = [0.21, -0.08, 0.15];
    let site = Site::new(&truth);
    let found = solve(&[PRIOR; 3], &site.measure(&all_links(3), 1), 0.0, &SHARP);
    assert_eq!(found.determined, [Determined::Each; 3]);
    assert_eq!((found.freedom, found.reduced_chi_square), (0, None));
    for ((offset, truth), sigma) in found.offsets_m.iter().zip(truth).zip(found.sigma_m()) {
        assert!(sigma < 0.003, "{sigma}");
        assert!(
            (offset - truth).abs() < 4.0 * sigma,
            "{offset} {truth} {sigma}"
        );
    }
}

#[test]
fn two_nodes_share_the_sum_in_halves_with_the_doubt_of_before() {
    let site = Site::new(&[0.30, -0.10]);
    let found = solve(&[PRIOR; 2], &site.measure(&[[0, 1]], 2), 0.0, &SHARP);
    assert_eq!(found.determined, [Determined::PairSum; 2]);
    let [a, b] = found.offsets_m[..] else {
        panic!()
    };
    assert!(
        (a - b).abs() < 1e-9 && (a + b - 0.2).abs() < 0.01,
        "{a} {b}"
    );
    // The difference is as unknown as it was: 0.3 m each, sqrt(2) of that together, half for each.
    for sigma in found.sigma_m() {
        assert!((sigma - 0.3 / 2_f64.sqrt()).abs() < 0.002, "{sigma}");
    }
    let sum_sigma_m = found.sum_sigma_m(0, 1).unwrap();
    assert!(sum_sigma_m < 0.003, "{sum_sigma_m}");
    assert!(found.sum_sigma_m(0, 2).is_none());
}

#[test]
fn a_known_node_determines_the_one_beside_it() {
    let site = Site::new(&[0.0, 0.25]);
    let nodes = [NodePrior::Known(0.005), PRIOR];
    let found = solve(&nodes, &site.measure(&[[0, 1]], 3), 0.0, &SHARP);
    assert_eq!(found.determined, [Determined::Each; 2]);
    assert!((found.offsets_m[1] - 0.25).abs() < 0.02);
    assert!(found.sigma_m()[1] < 0.007);
}

#[test]
fn a_star_gives_sums_and_says_so() {
    let site = Site::new(&[0.1, 0.2, -0.1, 0.0]);
    let star = [[0, 1], [0, 2], [0, 3]];
    let found = solve(&[PRIOR; 4], &site.measure(&star, 4), 0.0, &SHARP);
    assert_eq!(found.determined, [Determined::Sums; 4]);
    for [a, b] in star {
        let sum_m = found.offsets_m[a] + found.offsets_m[b];
        let truth_m = site.offsets_m[a] + site.offsets_m[b];
        assert!((sum_m - truth_m).abs() < 0.01, "{sum_m} {truth_m}");
        assert!(found.sum_sigma_m(a, b).unwrap() < 0.003);
        // Two leaves do not measure each other: what they would read is not known.
        assert!(found.sum_sigma_m(1, 2).unwrap() > 0.2);
    }
    assert!(found.sigma_m().iter().all(|s| *s > 0.1));
}

#[test]
fn ranges_that_are_late_hardly_move_the_answer() {
    let truth = [0.21, -0.08, 0.15];
    let site = Site {
        late_one_in: 7,
        ..Site::new(&truth)
    };
    let found = solve(&[PRIOR; 3], &site.measure(&all_links(3), 5), 0.0, &SHARP);
    for (offset, truth) in found.offsets_m.iter().zip(truth) {
        assert!((offset - truth).abs() < 0.01, "{offset} {truth}");
    }
    for pair in &found.pairs {
        // 58 of 400 are late by half a metre or more; a plain mean would be 0.7 m too long.
        assert!((55..=62).contains(&pair.measured.rejected), "{pair:?}");
    }
}

#[test]
fn a_pair_without_line_of_sight_shows_and_hardly_counts_among_six_nodes() {
    let truth = [0.2, -0.1, 0.1, 0.0, 0.05, -0.15];
    let site = Site::new(&truth);
    let mut measured = site.measure(&all_links(6), 6);
    for range_m in &mut measured[4].ranges_m {
        *range_m += 0.8;
    }
    let found = solve(
        &[PRIOR; 6],
        &measured,
        0.005,
        &CalibrationOptions::default(),
    );
    assert_eq!(found.freedom, 15 - 6);
    let worst = (0..15).max_by(|&a, &b| {
        let size = |k: usize| found.pairs[k].residual_m.abs();
        size(a).total_cmp(&size(b))
    });
    assert_eq!(worst, Some(4));
    assert!(found.pairs[4].weight < 0.1, "{:?}", found.pairs[4]);
    assert!(found.reduced_chi_square.unwrap() > 3.0);
    for (offset, truth) in found.offsets_m.iter().zip(truth) {
        assert!((offset - truth).abs() < 0.03, "{offset} {truth}");
    }
}

/// The squared error in units of the covariance, over many sites, is what chi-square says.
#[test]
fn sigma_is_honest() {
    const SITES: u64 = 300;
    let mut total = 0.0;
    for seed in 0..SITES {
        let mut rng = ChaCha8Rng::seed_from_u64(1_000 + seed);
        let prior = Normal::new(0.0, 0.3).unwrap();
        let truth: Vec<f64> = (0..4).map(|_| prior.sample(&mut rng)).collect();
        let site = Site {
            survey_sigma_m: 0.01,
            ranges: 100,
            ..Site::new(&truth)
        };
        // Three nodes in full, the fourth by one pair: no contradiction can show.
        let links = [[0, 1], [0, 2], [1, 2], [2, 3]];
        let found = solve(&[PRIOR; 4], &site.measure(&links, seed), 0.01, &SHARP);
        let error = nalgebra::DVector::from_iterator(
            4,
            found.offsets_m.iter().zip(&truth).map(|(o, t)| o - t),
        );
        let inverse = found.covariance_m2.try_inverse().unwrap();
        total += error.dot(&(inverse * &error));
    }
    // Mean 4, standard deviation of the mean sqrt(8 / 300).
    let mean = total / SITES as f64;
    println!("normalised squared error of 4 unknowns: {mean:.2}");
    assert!(
        (mean - 4.0).abs() < 4.0 * (8.0 / SITES as f64).sqrt(),
        "{mean}"
    );
}

#[test]
fn one_tick_is_2_3_millimetres() {
    let m = offset_per_tick_m(299_702_547.0, 63_897_600_000.0);
    assert!((m - 0.002_345).abs() < 1e-6, "{m}");
}

#[test]
fn what_cannot_be_meant_is_refused() {
    let ranges_m = vec![5.0; 50];
    let pair = Pair {
        nodes: [0, 1],
        distance_m: 5.0,
        distance_sigma_m: 0.01,
        ranges_m: &ranges_m,
    };
    let nodes = [PRIOR; 2];
    let refused = |nodes: &[NodePrior], pairs: &[Pair<'_>]| {
        calibrate(nodes, pairs, &CalibrationOptions::default()).unwrap_err()
    };
    assert_eq!(refused(&nodes, &[]), CalibrationError::NoPairs);
    for bad in [[0, 0], [0, 2]] {
        let error = refused(&nodes, &[pair, Pair { nodes: bad, ..pair }]);
        assert_eq!(error, CalibrationError::BadPair { pair: 1, nodes: 2 });
    }
    for distance_m in [0.0, -1.0, f64::NAN] {
        let error = refused(&nodes, &[Pair { distance_m, ..pair }]);
        assert!(matches!(
            error,
            CalibrationError::BadMeasurement { pair: 0, .. }
        ));
    }
    let few = Pair {
        ranges_m: &ranges_m[..9],
        ..pair
    };
    let error = refused(&nodes, &[few]);
    assert!(matches!(
        error,
        CalibrationError::TooFewRanges { got: 9, .. }
    ));
    let error = refused(&[PRIOR, NodePrior::Known(0.0)], &[pair]);
    assert!(matches!(error, CalibrationError::BadOption { .. }));
}

proptest! {
    /// Whatever is measured, there is an answer without NaN, or an error.
    #[test]
    fn no_input_makes_it_panic_or_lie(
        ranges in prop::collection::vec(prop::collection::vec(-1e6..1e6_f64, 0..30), 1..8),
        nodes in prop::collection::vec((0..5_usize, 0..5_usize), 8),
        distance in -1.0..1e6_f64,
    ) {
        let pairs: Vec<Pair<'_>> = ranges.iter().zip(&nodes)
            .map(|(ranges_m, &(a, b))| Pair {
                nodes: [a, b],
                distance_m: distance,
                distance_sigma_m: 0.01,
                ranges_m,
            })
            .collect();
        if let Ok(found) = calibrate(&[PRIOR; 5], &pairs, &CalibrationOptions::default()) {
            prop_assert!(found.offsets_m.iter().all(|o| o.is_finite()));
            prop_assert!(found.sigma_m().iter().all(|s| s.is_finite() && *s > 0.0));
        }
    }

    /// The numbers that nodes go by do not matter.
    #[test]
    fn order_does_not_matter(seed in 0..1000_u64) {
        let truth = [0.2, -0.1, 0.1, 0.0];
        let measured = Site::new(&truth).measure(&all_links(4), seed);
        let mirrored: Vec<Measured> = measured.iter().rev().map(|m| Measured {
            nodes: [3 - m.nodes[1], 3 - m.nodes[0]],
            distance_m: m.distance_m,
            ranges_m: m.ranges_m.clone(),
        }).collect();
        let options = CalibrationOptions::default();
        let one = solve(&[PRIOR; 4], &measured, 0.005, &options);
        let other = solve(&[PRIOR; 4], &mirrored, 0.005, &options);
        for k in 0..4 {
            prop_assert!((one.offsets_m[k] - other.offsets_m[3 - k]).abs() < 1e-9);
        }
    }
}
