//! What multilateration promises, on simulated ranges whose truth and noise are known.

#![allow(clippy::unwrap_used)] // the helpers below are tests as well

use nalgebra::{Matrix3, Vector3};
use nova_solver::multilateration::{Height, Noise, RangeBias};
use nova_solver::{
    Kernel, Localisation, MultilaterationOptions, Observability, RangeMeasurement, SolveError,
    multilaterate,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

type Rng = ChaCha8Rng;

fn gauss(rng: &mut Rng) -> f64 {
    StandardNormal.sample(rng)
}

fn in_box(rng: &mut Rng, half_m: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-half_m..half_m))
}

/// Ranges from `places` to `node` with Gaussian noise.
fn measure(
    places: &[Vector3<f64>],
    node: Vector3<f64>,
    sigma_m: f64,
    rng: &mut Rng,
) -> Vec<RangeMeasurement> {
    places
        .iter()
        .enumerate()
        .map(|(i, place)| RangeMeasurement {
            t_s: 0.1 * i as f64,
            position_m: *place,
            range_m: (node - place).norm() + sigma_m * gauss(rng),
            sigma_m: if sigma_m > 0.0 { sigma_m } else { 0.1 },
        })
        .collect()
}

fn places(n: usize, half_m: f64, rng: &mut Rng) -> Vec<Vector3<f64>> {
    (0..n).map(|_| in_box(rng, half_m)).collect()
}

/// Independent Gaussian errors of known size, and nothing else.
fn textbook() -> MultilaterationOptions {
    MultilaterationOptions {
        noise: Noise::Given,
        systematic_sigma_m: 0.0,
        ..MultilaterationOptions::default()
    }
}

/// Normalised error squared: chi-square with three degrees of freedom where the covariance is
/// right.
fn nees(found: &Localisation, node: Vector3<f64>) -> f64 {
    let error = found.position_m - node;
    error.dot(&(found.covariance_m2.try_inverse().unwrap() * error))
}

/// Mean normalised error squared over many draws of places, node and noise.
fn mean_nees(
    trials: u64,
    n: usize,
    options: &MultilaterationOptions,
    corrupt: impl Fn(&mut [RangeMeasurement], &mut Rng),
) -> f64 {
    let sum: f64 = (0..trials)
        .map(|trial| {
            let mut rng = Rng::seed_from_u64(trial);
            let (places, node) = (places(n, 10.0, &mut rng), in_box(&mut rng, 10.0));
            let mut log = measure(&places, node, 0.05, &mut rng);
            corrupt(&mut log, &mut rng);
            nees(&multilaterate(&log, options).unwrap(), node)
        })
        .sum();
    sum / trials as f64
}

/// Half width of the 95 % band of a mean of `trials` chi-squares with three degrees of freedom.
fn band(trials: u64) -> f64 {
    1.96 * (6.0 / trials as f64).sqrt()
}

// Accuracy.

#[test]
fn noise_free_ranges_give_the_exact_position() {
    for seed in 0..50 {
        let mut rng = Rng::seed_from_u64(seed);
        let (places, node) = (places(40, 15.0, &mut rng), in_box(&mut rng, 20.0));
        let log = measure(&places, node, 0.0, &mut rng);
        for kernel in [Kernel::None, Kernel::Huber { k: 1.345 }, Kernel::default()] {
            for noise in [Noise::Given, Noise::Estimated] {
                let options = MultilaterationOptions {
                    kernel,
                    noise,
                    ..textbook()
                };
                let found = multilaterate(&log, &options).unwrap();
                let error = (found.position_m - node).norm();
                assert!(error < 1e-9, "{error} seed {seed} {kernel:?} {noise:?}");
                assert!(found.observable(), "{:?}", found.observability);
            }
        }
    }
}

#[test]
fn three_ranges_give_the_closed_form_and_its_mirror_image() {
    // From the origin and from one metre along x and y: x = (1 + r0^2 - r1^2) / 2, y likewise, z =
    // +-sqrt(r0^2 - x^2 - y^2).
    let places = [Vector3::zeros(), Vector3::x(), Vector3::y()];
    let node = Vector3::new(2.0, 3.0, 4.0);
    let log = measure(&places, node, 0.0, &mut Rng::seed_from_u64(0));
    let r2 = |i: usize| log[i].range_m * log[i].range_m;
    let (x, y) = ((1.0 + r2(0) - r2(1)) / 2.0, (1.0 + r2(0) - r2(2)) / 2.0);
    let z = (r2(0) - x * x - y * y).sqrt();

    let options = MultilaterationOptions {
        noise: Noise::Given,
        ..textbook()
    };
    let log: Vec<_> = log
        .into_iter()
        .map(|m| RangeMeasurement {
            sigma_m: 0.001,
            ..m
        })
        .collect();
    let found = multilaterate(&log, &options).unwrap();
    let other = found.alternative.unwrap();
    let (up, down) = if found.position_m.z > other.position_m.z {
        (found.position_m, other.position_m)
    } else {
        (other.position_m, found.position_m)
    };
    assert!((up - Vector3::new(x, y, z)).norm() < 1e-8, "{up}");
    assert!((down - Vector3::new(x, y, -z)).norm() < 1e-8, "{down}");
    assert!((other.probability - 0.5).abs() < 1e-6);
    assert_eq!(found.observability, Observability::Mirror);
}

#[test]
fn least_squares_reaches_the_cramer_rao_bound_and_cauchy_95_percent_of_it() {
    let mut rng = Rng::seed_from_u64(1);
    let (places, node) = (places(25, 10.0, &mut rng), Vector3::new(3.0, -14.0, 5.0));
    let sigma_m = 0.05;
    // Bound of independent Gaussian ranges: (sum u u^T / sigma^2)^-1 at the truth.
    let information: Matrix3<f64> = places
        .iter()
        .map(|place| {
            let u = (node - place).normalize();
            u * u.transpose() / (sigma_m * sigma_m)
        })
        .sum();
    let bound = information.try_inverse().unwrap();

    const TRIALS: u32 = 3000;
    for (kernel, reject_sigmas, efficiency) in
        [(Kernel::None, 1e9, 1.0), (Kernel::default(), 1e9, 0.95)]
    {
        let options = MultilaterationOptions {
            kernel,
            reject_sigmas,
            ..textbook()
        };
        let mut spread = Matrix3::zeros();
        let mut reported = Matrix3::zeros();
        for _ in 0..TRIALS {
            let found =
                multilaterate(&measure(&places, node, sigma_m, &mut rng), &options).unwrap();
            let error = found.position_m - node;
            spread += error * error.transpose() / f64::from(TRIALS);
            reported += found.covariance_m2 / f64::from(TRIALS);
        }
        // The error of a variance from 3000 draws is 2.6 %; the trace adds up three.
        let ratio = bound.trace() / spread.trace();
        assert!((ratio - efficiency).abs() < 0.06, "{kernel:?}: {ratio}");
        for i in 0..3 {
            let ratio = reported[(i, i)] / spread[(i, i)];
            assert!((ratio - 1.0).abs() < 0.1, "{kernel:?} axis {i}: {ratio}");
        }
        let correlation = |c: &Matrix3<f64>| c[(0, 1)] / (c[(0, 0)] * c[(1, 1)]).sqrt();
        assert!((correlation(&reported) - correlation(&spread)).abs() < 0.06);
    }
}

// Honesty.

#[test]
fn errors_lie_within_the_given_sigma_at_the_promised_rate() {
    const TRIALS: u64 = 600;
    let mean = mean_nees(TRIALS, 30, &textbook(), |_, _| {});
    assert!(
        (mean - 3.0).abs() < band(TRIALS),
        "{mean} +- {}",
        band(TRIALS)
    );
}

#[test]
fn errors_lie_within_the_estimated_sigma_at_the_promised_rate() {
    // The size of the noise is told wrong by a factor of three and has to come from the residuals.
    const TRIALS: u64 = 600;
    let options = MultilaterationOptions {
        noise: Noise::Estimated,
        ..textbook()
    };
    let mean = mean_nees(TRIALS, 200, &options, |log, _| {
        for m in log.iter_mut() {
            m.sigma_m *= 3.0;
        }
    });
    assert!(mean < 3.0 + band(TRIALS) && mean > 2.4, "{mean}");
}

#[test]
fn errors_that_hang_together_in_time_do_not_shrink_the_sigma() {
    // Autoregressive noise, rho = 0.9: 200 ranges are worth about ten.
    const TRIALS: u64 = 300;
    let smooth = |log: &mut [RangeMeasurement], rng: &mut Rng| {
        // A flight, so that neighbours in time are neighbours in space: otherwise correlated errors
        // average out all the same.
        let node = in_box(rng, 10.0);
        let mut error = 0.05 * gauss(rng);
        for (i, m) in log.iter_mut().enumerate() {
            let phase = 0.03 * i as f64;
            m.position_m = Vector3::new(
                8.0 * phase.cos(),
                8.0 * (1.7 * phase).sin(),
                4.0 * (2.3 * phase).sin(),
            );
            error = 0.9 * error + 0.05 * (1.0 - 0.81f64).sqrt() * gauss(rng);
            m.range_m = (node - m.position_m).norm() + error;
        }
        node
    };
    let mean = |noise| {
        let options = MultilaterationOptions {
            noise,
            ..textbook()
        };
        (0..TRIALS)
            .map(|trial| {
                let mut rng = Rng::seed_from_u64(trial);
                let mut log = measure(
                    &places(200, 10.0, &mut rng),
                    Vector3::zeros(),
                    0.05,
                    &mut rng,
                );
                let node = smooth(&mut log, &mut rng);
                nees(&multilaterate(&log, &options).unwrap(), node)
            })
            .sum::<f64>()
            / TRIALS as f64
    };
    let (believed, learnt) = (mean(Noise::Given), mean(Noise::Estimated));
    assert!(
        believed > 20.0,
        "the noise is not correlated enough to test anything: {believed}"
    );
    // So few independent values cannot tell their own correlation well: the sigma may fall short by
    // a factor of root two.
    assert!(learnt < 6.0 && learnt > 1.0, "{learnt}");
}

#[test]
fn a_common_offset_within_the_systematic_sigma_is_covered() {
    const TRIALS: u64 = 400;
    let options = MultilaterationOptions::default();
    let mean = mean_nees(TRIALS, 100, &options, |log, rng| {
        let offset = options.systematic_sigma_m * gauss(rng);
        for m in log.iter_mut() {
            m.range_m += offset;
        }
    });
    assert!(mean < 3.0 + band(TRIALS), "{mean}");
}

// Outliers.

#[test]
fn twenty_percent_of_wild_ranges_are_set_aside() {
    for seed in 0..40 {
        let mut rng = Rng::seed_from_u64(seed);
        let (places, node) = (places(100, 10.0, &mut rng), in_box(&mut rng, 12.0));
        let mut log = measure(&places, node, 0.05, &mut rng);
        let mut wild = vec![false; log.len()];
        for i in 0..20 {
            wild[i * 5] = true;
            log[i * 5].range_m +=
                rng.random_range(5.0..500.0) * if i % 4 == 0 { -1.0 } else { 1.0 };
        }
        for noise in [Noise::Given, Noise::Estimated] {
            let found = multilaterate(
                &log,
                &MultilaterationOptions {
                    noise,
                    ..textbook()
                },
            )
            .unwrap();
            assert!(
                (found.position_m - node).norm() < 0.1,
                "seed {seed} {noise:?}"
            );
            assert!(
                wild.iter()
                    .zip(&found.residuals)
                    .all(|(wild, r)| !(*wild && r.used)),
                "seed {seed}"
            );
            assert!(
                (20..=24).contains(&found.rejected),
                "seed {seed}: {}",
                found.rejected
            );
            assert!(found.residual_rms_m < 0.08, "{}", found.residual_rms_m);
        }
    }
}

#[test]
fn ranges_after_a_wrap_of_the_device_clock_are_outliers_not_errors() {
    let mut rng = Rng::seed_from_u64(3);
    let node = Vector3::new(1.0, 2.0, 3.0);
    let mut log = measure(&places(50, 10.0, &mut rng), node, 0.05, &mut rng);
    log[3].range_m += 17.2 * 299_792_458.0;
    log[9].range_m -= 17.2 * 299_792_458.0;
    let found = multilaterate(&log, &textbook()).unwrap();
    assert!((found.position_m - node).norm() < 0.1);
    assert!(found.rejected >= 2);
}

// Geometry that cannot tell.

/// A flat S-shaped flight five metres up.
fn flat_path() -> Vec<Vector3<f64>> {
    (0..120)
        .map(|i| {
            let s = 0.1 * f64::from(i);
            Vector3::new(s, 3.0 * s.sin(), 5.0)
        })
        .collect()
}

#[test]
fn flat_path_reports_the_mirror_image_and_a_covariance_that_spans_both() {
    let node = Vector3::new(4.0, -1.0, 0.5);
    for seed in 0..20 {
        let log = measure(&flat_path(), node, 0.05, &mut Rng::seed_from_u64(seed));
        let found = multilaterate(&log, &MultilaterationOptions::default()).unwrap();
        let other = found.alternative.unwrap();
        let image = Vector3::new(node.x, node.y, 10.0 - node.z);
        let (near, far) = if found.position_m.z < 5.0 {
            (found.position_m, other.position_m)
        } else {
            (other.position_m, found.position_m)
        };
        assert!((near - node).norm() < 0.3, "{near}");
        assert!((far - image).norm() < 0.3, "{far}");
        assert_eq!(found.observability, Observability::Mirror);
        assert!(
            (other.probability - 0.5).abs() < 0.05,
            "{}",
            other.probability
        );
        assert!(
            found.sigma_m.z > 4.0 && found.sigma_m.x < 0.5,
            "{}",
            found.sigma_m
        );
        assert!(found.local_covariance_m2[(2, 2)].sqrt() < 0.5);
    }
}

#[test]
fn bounds_on_the_height_choose_between_mirror_images() {
    let node = Vector3::new(4.0, -1.0, 0.5);
    let between = |min_m, max_m| MultilaterationOptions {
        height: Height::Between { min_m, max_m },
        seek_alternatives: false,
        ..MultilaterationOptions::default()
    };
    for seed in 0..10 {
        let log = measure(&flat_path(), node, 0.05, &mut Rng::seed_from_u64(seed));
        let found = multilaterate(&log, &between(-5.0, 5.0)).unwrap();
        assert!((found.position_m - node).norm() < 0.3);
        assert!(found.observable() && found.alternative.is_none());
        let found = multilaterate(&log, &between(5.0, 20.0)).unwrap();
        assert!((found.position_m.z - 9.5).abs() < 0.3);
        let refused = multilaterate(&log, &between(30.0, 40.0));
        assert!(
            matches!(refused, Err(SolveError::OutsideHeights { .. })),
            "{refused:?}"
        );
    }
}

#[test]
fn climbing_path_excludes_the_mirror_image() {
    let node = Vector3::new(4.0, -1.0, 0.5);
    let path: Vec<_> = flat_path()
        .iter()
        .map(|p| p + Vector3::z() * (2.0 * (0.7 * p.x).cos()))
        .collect();
    let log = measure(&path, node, 0.05, &mut Rng::seed_from_u64(5));
    let found = multilaterate(&log, &MultilaterationOptions::default()).unwrap();
    assert!(
        found.observable() && found.alternative.is_none(),
        "{found:?}"
    );
    assert!((found.position_m - node).norm() < 0.3);
}

#[test]
fn straight_path_reports_the_whole_ring() {
    let axis = Vector3::new(1.0, 1.0, 0.2).normalize();
    let start = Vector3::new(-3.0, 2.0, 4.0);
    let node = Vector3::new(4.0, -1.0, 0.5);
    let path: Vec<_> = (0..100)
        .map(|i| start + axis * (0.1 * f64::from(i)))
        .collect();
    for seed in 0..20 {
        let log = measure(&path, node, 0.05, &mut Rng::seed_from_u64(seed));
        let found = multilaterate(&log, &MultilaterationOptions::default()).unwrap();
        let Observability::Ring {
            centre_m,
            axis: found_axis,
            radius_m,
        } = found.observability
        else {
            panic!("{:?}", found.observability)
        };
        let foot = start + axis * (node - start).dot(&axis);
        assert!((centre_m - foot).norm() < 0.3, "{centre_m} {foot}");
        assert!((radius_m - (node - foot).norm()).abs() < 0.3);
        assert!(found_axis.dot(&axis).abs() > 0.999);
        assert!(!found.observable() && found.condition > 1e3);
        // Every point of the ring is within two standard deviations.
        let inverse = found.covariance_m2.try_inverse().unwrap();
        let spoke = node - foot;
        for k in 0..12 {
            let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_6).sin_cos();
            let error = foot + spoke * cos + axis.cross(&spoke) * sin - found.position_m;
            assert!(error.dot(&(inverse * error)) < 4.0 * 1.5, "{k}");
        }
    }
}

#[test]
fn single_place_reports_the_sphere() {
    let here = Vector3::new(1.0, 2.0, 3.0);
    let log = measure(
        &[here; 50],
        Vector3::new(5.0, 5.0, 3.0),
        0.05,
        &mut Rng::seed_from_u64(0),
    );
    let found = multilaterate(&log, &MultilaterationOptions::default()).unwrap();
    let Observability::Sphere { centre_m, radius_m } = found.observability else {
        panic!("{:?}", found.observability)
    };
    assert!((centre_m - here).norm() < 1e-9 && (radius_m - 5.0).abs() < 0.1);
    assert!(found.sigma_m.min() > 2.5, "{}", found.sigma_m);
    assert_eq!(found.condition, f64::INFINITY);
}

#[test]
fn known_height_makes_a_flat_path_enough() {
    let node = Vector3::new(4.0, -1.0, 0.5);
    let log = measure(&flat_path(), node, 0.05, &mut Rng::seed_from_u64(2));
    let options = MultilaterationOptions {
        height: Height::Known(0.5),
        ..MultilaterationOptions::default()
    };
    let found = multilaterate(&log, &options).unwrap();
    assert!(
        found.observable() && found.alternative.is_none(),
        "{:?}",
        found.observability
    );
    assert!((found.position_m - node).norm() < 0.1);
    assert_eq!((found.position_m.z, found.sigma_m.z), (0.5, 0.0));
}

#[test]
fn known_height_leaves_two_sides_of_a_straight_path_and_a_circle_about_a_single_place() {
    let options = MultilaterationOptions {
        height: Height::Known(0.0),
        ..MultilaterationOptions::default()
    };
    let node = Vector3::new(4.0, -3.0, 0.0);
    let path: Vec<_> = (0..100)
        .map(|i| Vector3::new(0.1 * f64::from(i), 0.0, 2.0))
        .collect();
    let log = measure(&path, node, 0.05, &mut Rng::seed_from_u64(2));
    let found = multilaterate(&log, &options).unwrap();
    assert_eq!(found.observability, Observability::Mirror);
    let other = found.alternative.unwrap().position_m;
    assert!(
        (other.y + found.position_m.y).abs() < 0.2 && (found.position_m.y.abs() - 3.0).abs() < 0.3
    );

    let log = measure(
        &[Vector3::new(0.0, 0.0, 3.0); 50],
        Vector3::new(4.0, 0.0, 0.0),
        0.05,
        &mut Rng::seed_from_u64(2),
    );
    let found = multilaterate(&log, &options).unwrap();
    let Observability::Ring { radius_m, .. } = found.observability else {
        panic!("{:?}", found.observability)
    };
    assert!((radius_m - 4.0).abs() < 0.1);
    assert!(found.sigma_m.x.max(found.sigma_m.y) > 2.0 && found.sigma_m.z == 0.0);
}

// Range bias.

#[test]
fn known_bias_is_taken_off_and_unknown_bias_is_found() {
    let mut rng = Rng::seed_from_u64(11);
    let node = Vector3::new(3.0, 4.0, -5.0);
    let mut log = measure(&places(300, 10.0, &mut rng), node, 0.05, &mut rng);
    for m in &mut log {
        m.range_m += 0.7;
    }
    for bias in [
        RangeBias::Known(0.7),
        RangeBias::Estimate {
            prior_m: 0.0,
            prior_sigma_m: 10.0,
        },
    ] {
        let found = multilaterate(&log, &MultilaterationOptions { bias, ..textbook() }).unwrap();
        assert!((found.position_m - node).norm() < 0.05, "{bias:?}");
        assert!(
            (found.range_bias_m - 0.7).abs() < 0.02,
            "{bias:?}: {}",
            found.range_bias_m
        );
        let estimated = matches!(bias, RangeBias::Estimate { .. });
        assert_eq!(found.range_bias_sigma_m > 0.0, estimated);
    }
}

#[test]
fn prior_on_the_bias_is_all_there_is_where_the_ranges_say_nothing_about_it() {
    let mut rng = Rng::seed_from_u64(12);
    // Far away and seen from a small patch: bias and distance cannot be told apart.
    let node = Vector3::new(0.0, 500.0, 0.0);
    let log = measure(&places(100, 1.0, &mut rng), node, 0.05, &mut rng);
    let bias = RangeBias::Estimate {
        prior_m: 0.1,
        prior_sigma_m: 0.2,
    };
    let found = multilaterate(&log, &MultilaterationOptions { bias, ..textbook() }).unwrap();
    assert!(
        (found.range_bias_m - 0.1).abs() < 0.02,
        "{}",
        found.range_bias_m
    );
    assert!(
        (found.range_bias_sigma_m - 0.2).abs() < 0.02,
        "{}",
        found.range_bias_sigma_m
    );
}

// The interface.

#[test]
fn order_of_the_measurements_does_not_matter() {
    let mut rng = Rng::seed_from_u64(21);
    let mut log = measure(
        &places(80, 10.0, &mut rng),
        Vector3::new(1.0, 2.0, 3.0),
        0.05,
        &mut rng,
    );
    log[7].t_s = log[8].t_s;
    let sorted = multilaterate(&log, &MultilaterationOptions::default()).unwrap();
    for _ in 0..5 {
        log.shuffle(&mut rng);
        let shuffled = multilaterate(&log, &MultilaterationOptions::default()).unwrap();
        assert_eq!(shuffled.position_m, sorted.position_m);
        assert_eq!(shuffled.covariance_m2, sorted.covariance_m2);
        for (m, r) in log.iter().zip(&shuffled.residuals) {
            let predicted = (m.position_m - shuffled.position_m).norm();
            assert!((m.range_m - predicted - r.residual_m).abs() < 1e-9);
        }
    }
}

#[test]
fn far_away_origin_costs_no_accuracy() {
    let mut rng = Rng::seed_from_u64(22);
    let log = measure(
        &places(80, 10.0, &mut rng),
        Vector3::new(1.0, 2.0, 3.0),
        0.05,
        &mut rng,
    );
    let offset = Vector3::new(4_213_000.0, -1_024_000.0, 4_664_000.0);
    let moved: Vec<_> = log
        .iter()
        .map(|m| RangeMeasurement {
            position_m: m.position_m + offset,
            ..*m
        })
        .collect();
    let here = multilaterate(&log, &MultilaterationOptions::default()).unwrap();
    let there = multilaterate(&moved, &MultilaterationOptions::default()).unwrap();
    assert!((there.position_m - offset - here.position_m).norm() < 1e-6);
    assert!((there.sigma_m - here.sigma_m).norm() < 1e-6);
}

#[test]
fn warm_start_ends_where_the_search_ends() {
    for seed in 0..20 {
        let mut rng = Rng::seed_from_u64(seed);
        let log = measure(
            &places(80, 10.0, &mut rng),
            in_box(&mut rng, 10.0),
            0.05,
            &mut rng,
        );
        let cold = multilaterate(&log, &MultilaterationOptions::default()).unwrap();
        let guess = cold.position_m + Vector3::new(0.3, -0.2, 0.4);
        let options = MultilaterationOptions {
            initial_guess_m: Some(guess),
            ..MultilaterationOptions::default()
        };
        let warm = multilaterate(&log, &options).unwrap();
        assert!((warm.position_m - cold.position_m).norm() < 0.05 * cold.sigma_m.norm());
    }
}

#[test]
fn guess_on_the_wrong_side_is_corrected_by_the_search_for_alternatives() {
    let node = Vector3::new(4.0, -1.0, 0.5);
    let path: Vec<_> = flat_path()
        .iter()
        .map(|p| p + Vector3::z() * (2.0 * (0.7 * p.x).cos()))
        .collect();
    let log = measure(&path, node, 0.05, &mut Rng::seed_from_u64(5));
    let guess = Vector3::new(4.0, -1.0, 9.5);
    let options = MultilaterationOptions {
        initial_guess_m: Some(guess),
        ..MultilaterationOptions::default()
    };
    let found = multilaterate(&log, &options).unwrap();
    assert!(
        (found.position_m - node).norm() < 0.3,
        "{}",
        found.position_m
    );
}

#[test]
fn input_that_cannot_be_meant_is_a_typed_error() {
    let mut rng = Rng::seed_from_u64(23);
    let log = measure(
        &places(10, 10.0, &mut rng),
        Vector3::zeros(),
        0.05,
        &mut rng,
    );
    let plain = MultilaterationOptions::default();

    let mut bad = log.clone();
    bad[4].range_m = f64::NAN;
    assert!(matches!(
        multilaterate(&bad, &plain),
        Err(SolveError::BadMeasurement { index: 4, .. })
    ));
    assert_eq!(
        multilaterate(&[], &plain),
        Err(SolveError::TooFewMeasurements {
            got: 0,
            unknowns: 3
        })
    );
    assert_eq!(
        multilaterate(&log[..2], &plain),
        Err(SolveError::TooFewMeasurements {
            got: 2,
            unknowns: 3
        })
    );
    let estimate = RangeBias::Estimate {
        prior_m: 0.0,
        prior_sigma_m: 1.0,
    };
    let options = MultilaterationOptions {
        bias: estimate,
        ..plain
    };
    assert_eq!(
        multilaterate(&log[..3], &options),
        Err(SolveError::TooFewMeasurements {
            got: 3,
            unknowns: 4
        })
    );

    let endless = f64::INFINITY;
    for options in [
        MultilaterationOptions {
            initial_guess_m: Some(Vector3::new(0.0, f64::NAN, 0.0)),
            ..plain
        },
        MultilaterationOptions {
            bias: RangeBias::Known(f64::NAN),
            ..plain
        },
        MultilaterationOptions {
            bias: RangeBias::Estimate {
                prior_m: 0.0,
                prior_sigma_m: 0.0,
            },
            ..plain
        },
        MultilaterationOptions {
            kernel: Kernel::Cauchy { c: 0.0 },
            ..plain
        },
        MultilaterationOptions {
            kernel: Kernel::Huber { k: f64::NAN },
            ..plain
        },
        MultilaterationOptions {
            height: Height::Known(endless),
            ..plain
        },
        MultilaterationOptions {
            height: Height::Between {
                min_m: 1.0,
                max_m: 0.0,
            },
            ..plain
        },
        MultilaterationOptions {
            systematic_sigma_m: -0.1,
            ..plain
        },
        MultilaterationOptions {
            reject_sigmas: 0.0,
            ..plain
        },
    ] {
        assert!(
            matches!(
                multilaterate(&log, &options),
                Err(SolveError::BadOption { .. })
            ),
            "{options:?}"
        );
    }
}

fn awkward_coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), Just(1.0), -1e-9..1e-9, -10.0..10.0, -1e6..1e6]
}

fn awkward_range() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), -1.0..20.0, -1e9..1e9]
}

proptest! {
    #[test]
    fn any_finite_input_gives_finite_numbers_and_a_covariance(
        rows in prop::collection::vec((awkward_coordinate(), awkward_coordinate(), awkward_coordinate(), awkward_range(), 1e-3..10.0), 3..30),
        estimate in any::<bool>(),
        given in any::<bool>(),
        height in prop_oneof![Just(Height::Unknown), Just(Height::Known(0.5))],
    ) {
        let log: Vec<_> = rows
            .iter()
            .enumerate()
            .map(|(i, &(x, y, z, range_m, sigma_m))| RangeMeasurement { t_s: i as f64, position_m: Vector3::new(x, y, z), range_m, sigma_m })
            .collect();
        let options = MultilaterationOptions {
            bias: if estimate { RangeBias::Estimate { prior_m: 0.0, prior_sigma_m: 1.0 } } else { RangeBias::Known(0.1) },
            noise: if given { Noise::Given } else { Noise::Estimated },
            height,
            ..MultilaterationOptions::default()
        };
        match multilaterate(&log, &options) {
            Ok(found) => {
                prop_assert!(found.position_m.iter().chain(&found.covariance_m2).all(|v| v.is_finite()), "{found:?}");
                prop_assert!(found.residual_rms_m.is_finite() && found.range_bias_sigma_m.is_finite());
                let smallest = found.covariance_m2.symmetric_eigenvalues().min();
                prop_assert!(smallest >= -1e-9 * found.covariance_m2.norm(), "{found:?}");
                prop_assert_eq!(found.used + found.rejected, log.len());
            }
            Err(SolveError::TooFewMeasurements { .. }) => prop_assert!(log.len() < 4 && estimate),
            Err(other) => prop_assert!(false, "{other:?}"),
        }
    }

    #[test]
    fn turning_and_moving_the_world_turns_and_moves_the_answer(
        seed in any::<u64>(),
        turn in (-3.0..3.0, -3.0..3.0, -3.0..3.0),
        shift in (-100.0..100.0, -100.0..100.0, -100.0..100.0),
    ) {
        let mut rng = Rng::seed_from_u64(seed);
        let log = measure(&places(40, 10.0, &mut rng), in_box(&mut rng, 10.0), 0.05, &mut rng);
        let pose = nalgebra::Isometry3::new(Vector3::new(shift.0, shift.1, shift.2), Vector3::new(turn.0, turn.1, turn.2));
        let turned: Vec<_> = log
            .iter()
            .map(|m| RangeMeasurement { position_m: (pose * nalgebra::Point3::from(m.position_m)).coords, ..*m })
            .collect();
        let plain = multilaterate(&log, &MultilaterationOptions::default()).unwrap();
        let moved = multilaterate(&turned, &MultilaterationOptions::default()).unwrap();
        let expected = (pose * nalgebra::Point3::from(plain.position_m)).coords;
        prop_assert!((moved.position_m - expected).norm() < 1e-3 * plain.sigma_m.norm());
    }
}
