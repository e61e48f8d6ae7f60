//! The recursion against closed forms, against one large matrix, and against a filter that is let
//! loose on random flights.

use nalgebra::{DMatrix, Matrix2, SMatrix, SVector, Vector2, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;

const STILL: InsNoise = InsNoise {
    velocity_random_walk: 0.0,
    acceleration_random_walk: 0.0,
    position_random_walk: 0.0,
    height_random_walk: 0.0,
    height_sigma_m: 0.0,
};
const DRIFTING: InsNoise = InsNoise {
    velocity_random_walk: 0.03,
    acceleration_random_walk: 0.004,
    position_random_walk: 0.02,
    height_random_walk: 0.01,
    height_sigma_m: 0.1,
};
const PRIOR: Prior = Prior {
    tag_sigma_m: [4.0, 5.0, 6.0],
    velocity_sigma_m_s: 0.2,
    acceleration_sigma_m_s2: 0.05,
    bias_sigma_m: 0.15,
};
const TAG: Vector3<f64> = Vector3::new(3.0, -7.0, 0.5);

fn model(ins: InsNoise, prior: Prior) -> BoundModel {
    BoundModel {
        ins,
        prior,
        nlos_probability: 0.0,
        nlos_mean_m: 1.0,
    }
}

/// A winding flight with ranges at uneven times.
fn flight(n: usize, rng: &mut ChaCha8Rng) -> Vec<BoundEpoch> {
    let mut t_s = 0.0;
    let phase: f64 = rng.random_range(0.0..6.0);
    (0..n)
        .map(|_| {
            t_s += rng.random_range(0.05..2.0);
            let vehicle_m = Vector3::new(
                20.0 - t_s,
                9.0 * (0.2 * t_s + phase).sin(),
                30.0 - 0.3 * t_s,
            );
            BoundEpoch {
                t_s,
                vehicle_m,
                range_sigma_m: rng.random_range(0.02..0.3),
            }
        })
        .collect()
}

/// `u` and the standard deviation of the range, the barometer's part included.
fn line_of_sight(epoch: &BoundEpoch, ins: &InsNoise) -> (Vector3<f64>, f64) {
    let u = (TAG - epoch.vehicle_m).normalize();
    let variance = epoch.range_sigma_m.powi(2) + (u.z * ins.height_sigma_m).powi(2);
    (u, variance.sqrt())
}

#[test]
fn ranges_to_a_tag_at_rest_add_their_weights() {
    let mut recursion = Recursion::new(
        STILL,
        &Prior {
            bias_sigma_m: 0.0,
            ..PRIOR
        },
    );
    for _ in 0..40 {
        recursion.step(0.3);
        recursion.observe(Vector3::z(), 0.2);
    }
    let expected = 1.0 / (1.0 / 36.0 + 40.0 / 0.04);
    let covariance = recursion.relative_covariance();
    assert!((covariance[(2, 2)] / expected - 1.0).abs() < 1e-12);
}

#[test]
fn without_ranges_the_doubt_is_that_of_dead_reckoning() {
    let t = 7.0_f64;
    let bound = relative_covariance(&[], TAG, &model(DRIFTING, PRIOR), 2.0..2.0 + t);
    let horizontal = |tag_sigma: f64| {
        tag_sigma.powi(2)
            + (0.2 * t).powi(2)
            + (0.05 * t * t / 2.0).powi(2)
            + 0.03_f64.powi(2) * t.powi(3) / 3.0
            + 0.004_f64.powi(2) * t.powi(5) / 20.0
            + 0.02_f64.powi(2) * t
    };
    let expected = Vector3::new(
        horizontal(4.0),
        horizontal(5.0),
        36.0 + 0.01_f64.powi(2) * t,
    );
    assert!((bound - Matrix3::from_diagonal(&expected)).norm() < 1e-12 * bound.norm());
}

#[test]
fn a_random_walk_seen_again_and_again_settles_at_its_riccati_root() {
    let ins = InsNoise {
        height_random_walk: 0.3,
        ..STILL
    };
    let mut recursion = Recursion::new(
        ins,
        &Prior {
            bias_sigma_m: 0.0,
            ..PRIOR
        },
    );
    let (dt, sigma) = (0.5, 0.4);
    for _ in 0..300 {
        recursion.step(dt);
        recursion.observe(Vector3::z(), sigma);
    }
    // P = (P + q) R / (P + q + R).
    let (q, r) = (0.09 * dt, sigma * sigma);
    let expected = (-q + (q * q + 4.0 * q * r).sqrt()) / 2.0;
    let found = recursion.relative_covariance()[(2, 2)];
    assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
}

#[test]
fn a_range_bias_cancels_between_opposite_sides_only() {
    let sides = [Vector3::x(), -Vector3::x()];
    let (n, sigma) = (500, 0.1);
    let after = |directions: [Vector3<f64>; 2]| {
        let mut recursion = Recursion::new(STILL, &PRIOR);
        for direction in directions {
            for _ in 0..n {
                recursion.observe(direction, sigma);
            }
        }
        recursion.relative_covariance()[(0, 0)]
    };
    let both = after(sides);
    let expected = 1.0 / (1.0 / 16.0 + 2.0 * f64::from(n) / (sigma * sigma));
    assert!((both / expected - 1.0).abs() < 1e-9, "{both} {expected}");
    // From one side: bias and tag share one number; the prior variances 16 and 0.15^2 split it.
    let one = after([Vector3::x(); 2]);
    let bias = 0.15_f64.powi(2);
    let noise = sigma * sigma / (2.0 * f64::from(n));
    let expected = 16.0 * (bias + noise) / (16.0 + bias + noise);
    assert!((one / expected - 1.0).abs() < 1e-9, "{one} {expected}");
}

/// The same bound from one information matrix over the error at all times, tag and bias: unknowns
/// `[e_0 (7) | e_1 | .. | e_n | tag (3) | bias]`, nothing eliminated along the way.
fn batch_bound(epochs: &[BoundEpoch], model: &BoundModel, end_s: f64) -> Matrix3<f64> {
    const TINY: f64 = 1e-6; // stands for the exact position at the start
    let states = epochs.len() + 2;
    let (tag, bias) = (7 * states, 7 * states + 3);
    let mut information = DMatrix::<f64>::zeros(bias + 1, bias + 1);
    let prior = &model.prior;
    let (v, a) = (prior.velocity_sigma_m_s, prior.acceleration_sigma_m_s2);
    for (i, sigma) in [TINY, TINY, TINY, v, v, a, a].into_iter().enumerate() {
        information[(i, i)] += sigma.powi(-2);
    }
    for (i, sigma) in prior.tag_sigma_m.into_iter().enumerate() {
        information[(tag + i, tag + i)] += sigma.powi(-2);
    }
    information[(bias, bias)] += prior.bias_sigma_m.powi(-2);

    let mut last_s = 0.0;
    let times = epochs.iter().map(|e| e.t_s).chain([end_s]);
    for (k, t_s) in times.enumerate() {
        let (f, q) = model.ins.step(t_s - last_s);
        last_s = t_s;
        let weight = q.try_inverse().unwrap();
        let mut jacobian = SMatrix::<f64, 7, 14>::zeros();
        jacobian.fixed_columns_mut::<7>(0).copy_from(&-f);
        jacobian.fixed_columns_mut::<7>(7).fill_with_identity();
        let mut block = information.view_mut((7 * k, 7 * k), (14, 14));
        block += jacobian.transpose() * weight * jacobian;
    }
    for (k, epoch) in epochs.iter().enumerate() {
        let (u, sigma) = line_of_sight(epoch, &model.ins);
        let mut row = DMatrix::<f64>::zeros(1, bias + 1);
        for i in 0..3 {
            row[7 * (k + 1) + i] = u[i];
            row[tag + i] = u[i];
        }
        row[bias] = 1.0;
        information += row.transpose() * &row / (sigma * sigma);
    }
    let covariance = information.try_inverse().unwrap();
    let mut sum = DMatrix::<f64>::zeros(3, bias + 1);
    for i in 0..3 {
        sum[(i, 7 * (states - 1) + i)] = 1.0;
        sum[(i, tag + i)] = 1.0;
    }
    (&sum * covariance * sum.transpose())
        .fixed_view::<3, 3>(0, 0)
        .into_owned()
}

#[test]
fn the_recursion_is_the_information_of_the_whole_flight_at_once() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for n in [1, 4, 25] {
        let epochs = flight(n, &mut rng);
        let end_s = epochs[n - 1].t_s + 0.7;
        let model = model(DRIFTING, PRIOR);
        let bound = relative_covariance(&epochs, TAG, &model, 0.0..end_s);
        let batch = batch_bound(&epochs, &model, end_s);
        assert!(
            (bound - batch).norm() < 1e-5 * bound.norm(),
            "{bound} {batch}"
        );
    }
}

/// An extended Kalman filter on the full state: error of dead reckoning (7), tag (3), bias (1).
/// Knows nothing of the truth.
struct Filter {
    x: SVector<f64, 11>,
    p: SMatrix<f64, 11, 11>,
}

impl Filter {
    fn predict(&mut self, ins: &InsNoise, dt_s: f64) {
        let (f7, q7) = ins.step(dt_s);
        let mut f = SMatrix::<f64, 11, 11>::identity();
        f.fixed_view_mut::<7, 7>(0, 0).copy_from(&f7);
        self.x = f * self.x;
        self.p = f * self.p * f.transpose();
        let mut block = self.p.fixed_view_mut::<7, 7>(0, 0);
        block += q7;
    }

    /// A range, with what dead reckoning showed then.
    fn update(&mut self, ins_m: Vector3<f64>, range_m: f64, sigma_m: f64, ins: &InsNoise) {
        let apart = self.x.fixed_rows::<3>(7) + self.x.fixed_rows::<3>(0) - ins_m;
        let u = apart.normalize();
        let mut h = SVector::<f64, 11>::zeros();
        h.fixed_rows_mut::<3>(0).copy_from(&u);
        h.fixed_rows_mut::<3>(7).copy_from(&u);
        h[10] = 1.0;
        let variance = sigma_m.powi(2) + (u.z * ins.height_sigma_m).powi(2);
        let s = h.dot(&(self.p * h)) + variance;
        let gain = self.p * h / s;
        self.x += gain * (range_m - apart.norm() - self.x[10]);
        self.p -= gain * s * gain.transpose();
    }
}

#[test]
fn a_filter_on_random_flights_comes_down_to_the_bound_and_not_below() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let epochs = flight(60, &mut rng);
    let end_s = epochs[59].t_s;
    // Tight enough for tangents to be good: the bound is about small errors.
    const CALM: InsNoise = InsNoise {
        velocity_random_walk: 0.003,
        acceleration_random_walk: 2e-4,
        position_random_walk: 0.01,
        ..DRIFTING
    };
    let prior = Prior {
        tag_sigma_m: [0.3; 3],
        velocity_sigma_m_s: 0.02,
        acceleration_sigma_m_s2: 5e-4,
        bias_sigma_m: 0.1,
    };
    let model = model(CALM, prior);
    let bound = relative_covariance(&epochs, TAG, &model, 0.0..end_s);
    let whiten = bound.cholesky().unwrap().l().try_inverse().unwrap();
    let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };

    const FLIGHTS: u32 = 2000;
    let mut scatter = Matrix3::zeros();
    for _ in 0..FLIGHTS {
        let sigmas =
            SVector::<f64, 11>::from([0.0, 0.0, 0.0, 0.02, 0.02, 5e-4, 5e-4, 0.8, 0.8, 0.8, 0.1]);
        let mut error = SVector::<f64, 7>::zeros();
        for i in 3..7 {
            error[i] = sigmas[i] * normal();
        }
        let mut filter = Filter {
            x: SVector::zeros(),
            p: SMatrix::from_diagonal(&sigmas.component_mul(&sigmas)),
        };
        for i in 0..3 {
            filter.x[7 + i] = TAG[i] + 0.3 * normal();
        }
        let bias = 0.1 * normal();
        let mut last_s = 0.0;
        for epoch in &epochs {
            let dt_s = epoch.t_s - last_s;
            last_s = epoch.t_s;
            let (f, q) = CALM.step(dt_s);
            error = f * error + q.cholesky().unwrap().l() * SVector::from_fn(|_, _| normal());
            filter.predict(&CALM, dt_s);
            let white = Vector3::z() * (CALM.height_sigma_m * normal());
            let ins_m = epoch.vehicle_m + error.fixed_rows::<3>(0) + white;
            let range_m = (TAG - epoch.vehicle_m).norm() + bias + epoch.range_sigma_m * normal();
            filter.update(ins_m, range_m, epoch.range_sigma_m, &CALM);
        }
        let believed = filter.x.fixed_rows::<3>(7) + filter.x.fixed_rows::<3>(0);
        let miss = whiten * (believed - TAG - error.fixed_rows::<3>(0));
        scatter += miss * miss.transpose() / f64::from(FLIGHTS);
    }
    // Each variance of 2000 draws has a standard deviation of 3.2 %. Curvature costs a little.
    for (i, variance) in scatter.diagonal().iter().enumerate() {
        assert!((0.88..1.2).contains(variance), "axis {i}: {scatter}");
    }
}

#[test]
fn epochs_outside_the_flight_do_not_count() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let epochs = flight(30, &mut rng);
    let middle_s = epochs[10].t_s;
    let model = model(DRIFTING, PRIOR);
    let of_part = relative_covariance(&epochs, TAG, &model, 0.0..middle_s);
    let part = relative_covariance(&epochs[..11], TAG, &model, 0.0..middle_s);
    assert_eq!(of_part, part);
}

#[test]
fn a_vehicle_on_top_of_the_tag_is_not_a_division_by_zero() {
    let epoch = BoundEpoch {
        t_s: 1.0,
        vehicle_m: TAG,
        range_sigma_m: 0.1,
    };
    let bound = relative_covariance(&[epoch], TAG, &model(DRIFTING, PRIOR), 0.0..1.0);
    assert!(bound.iter().all(|v| v.is_finite()));
}

#[test]
fn late_ranges_raise_the_bound_as_if_their_sigma_had_grown() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut epochs = flight(30, &mut rng);
    for epoch in &mut epochs {
        epoch.range_sigma_m = 0.1;
    }
    let ins = InsNoise {
        height_sigma_m: 0.0,
        ..DRIFTING
    };
    let end_s = epochs[29].t_s;
    let late = BoundModel {
        nlos_probability: 0.2,
        ..model(ins, PRIOR)
    };
    let bound = relative_covariance(&epochs, TAG, &late, 0.0..end_s);
    let kept = NlosLoss::new(0.2, 1.0).kept(0.1);
    assert!((0.5..0.8).contains(&kept), "{kept}");
    for epoch in &mut epochs {
        epoch.range_sigma_m = 0.1 / kept.sqrt();
    }
    let widened = relative_covariance(&epochs, TAG, &model(ins, PRIOR), 0.0..end_s);
    assert!((bound - widened).norm() < 1e-12 * bound.norm());
}

proptest! {
    #[test]
    fn covariance_stays_symmetric_and_positive(
        seed in 0_u64..1000,
        tag_sigma in 1.0..1e4_f64,
        sigma in 1e-3..1.0_f64,
    ) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let prior = Prior { tag_sigma_m: [tag_sigma; 3], ..PRIOR };
        let mut recursion = Recursion::new(DRIFTING, &prior);
        for _ in 0..2000 {
            recursion.step(rng.random_range(0.0..0.2));
            let direction = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0_f64));
            recursion.observe(direction.try_normalize(1e-3).unwrap_or(Vector3::z()), sigma);
        }
        let p = recursion.covariance();
        prop_assert!((p - p.transpose()).norm() < 1e-9 * p.norm());
        prop_assert!(p.cholesky().is_some(), "{}", p);
    }

    #[test]
    fn mean_error_is_the_mean_length_of_draws(a in 0.1..3.0_f64, ratio in 0.0..1.0_f64, angle in 0.0..3.1_f64) {
        let (sin, cos) = angle.sin_cos();
        let turn = Matrix2::new(cos, -sin, sin, cos);
        let axes = Vector2::new(a, a * ratio);
        let mut covariance = Matrix3::identity() * 77.0;
        let plane = turn * Matrix2::from_diagonal(&axes.component_mul(&axes)) * turn.transpose();
        covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&plane);
        // Midpoint rule over +-7 sigma.
        let step = 0.05;
        let (mut mean, mut total) = (0.0, 0.0);
        for i in -140..140 {
            for j in -140..140 {
                let z = Vector2::new(f64::from(i) + 0.5, f64::from(j) + 0.5) * step;
                let density = (-0.5 * z.norm_squared()).exp();
                total += density;
                mean += density * axes.component_mul(&z).norm();
            }
        }
        let expected = mean / total;
        prop_assert!((mean_error_m(&covariance) / expected - 1.0).abs() < 1e-3);
    }
}

#[test]
fn mean_error_of_circle_and_line_are_the_known_ones() {
    let circle = Matrix3::identity() * 4.0;
    let line = Matrix3::from_diagonal(&Vector3::new(0.0, 4.0, 9.0));
    let half_normal = (2.0 / std::f64::consts::PI).sqrt() * 2.0;
    assert!((mean_error_m(&circle) - (std::f64::consts::PI / 2.0).sqrt() * 2.0).abs() < 1e-12);
    assert!((mean_error_m(&line) - half_normal).abs() < 1e-12);
    assert_eq!(mean_error_m(&Matrix3::zeros()), 0.0);
}
