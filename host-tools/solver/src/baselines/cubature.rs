//! The cubature Kalman filter (Arasaratnam and Haykin, "Cubature Kalman filters", IEEE Trans.
//! Automatic Control 54, 2009) for scalar measurements.
//!
//! A Gaussian of mean `m` and covariance `P = L L^T` is stood in for by `2 N` equally weighted
//! points `m +- sqrt(N) L e_i`, which have the same mean and covariance. What a function makes of
//! the Gaussian has the mean and covariance of the function's values at the points.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

/// A state of `N` numbers known up to a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CubatureFilter<const N: usize> {
    /// Mean.
    pub(super) mean: SVector<f64, N>,
    /// Covariance, symmetric and positive definite.
    pub(super) covariance: SMatrix<f64, N, N>,
}

/// A measurement before it is made: what to expect, and how that goes with the state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Expectation<const N: usize> {
    /// Mean of the measurement.
    pub(super) mean: f64,
    /// Its variance due to the state alone, without the noise of measuring.
    pub(super) variance: f64,
    /// Covariance of state and measurement.
    pub(super) cross: SVector<f64, N>,
}

impl<const N: usize> CubatureFilter<N> {
    /// The points, `m + sqrt(N) L e_i` and `m - sqrt(N) L e_i` in turn. `None` where rounding has
    /// made the covariance indefinite.
    pub(super) fn points(&self) -> Option<impl Iterator<Item = SVector<f64, N>> + Clone> {
        let root = Cholesky::<f64, Const<N>>::new(self.covariance)?.unpack() * (N as f64).sqrt();
        let mean = self.mean;
        Some((0..2 * N).map(move |i| {
            let column = root.column(i / 2);
            if i % 2 == 0 {
                mean + column
            } else {
                mean - column
            }
        }))
    }

    /// Moves on: `x' = transition(x) + noise` with the given covariance of the noise. Leaves all as
    /// it is and returns false where there are no points.
    pub(super) fn predict(
        &mut self,
        transition: impl Fn(&SVector<f64, N>) -> SVector<f64, N>,
        noise: &SMatrix<f64, N, N>,
    ) -> bool {
        let Some(points) = self.points() else {
            return false;
        };
        let share = 0.5 / N as f64;
        let moved = points.map(|x| transition(&x));
        let mean = moved.clone().sum::<SVector<f64, N>>() * share;
        let mut covariance = *noise;
        for x in moved {
            let d = x - mean;
            covariance += d * d.transpose() * share;
        }
        *self = Self { mean, covariance };
        true
    }

    /// What to expect of a measurement `measure(x)`; `None` where there are no points.
    pub(super) fn expect(
        &self,
        measure: impl Fn(&SVector<f64, N>) -> f64,
    ) -> Option<Expectation<N>> {
        let points = self.points()?;
        let share = 0.5 / N as f64;
        let mean = points.clone().map(|x| measure(&x)).sum::<f64>() * share;
        let mut variance = 0.0;
        let mut cross = SVector::zeros();
        for x in points {
            let d = measure(&x) - mean;
            variance += d * d * share;
            cross += (x - self.mean) * (d * share);
        }
        Some(Expectation {
            mean,
            variance,
            cross,
        })
    }

    /// Learns from a measurement of which `expected` was expected and which has noise of variance
    /// `noise_variance > 0`.
    pub(super) fn update(&mut self, expected: &Expectation<N>, measured: f64, noise_variance: f64) {
        let innovation_variance = expected.variance + noise_variance;
        self.mean += expected.cross * ((measured - expected.mean) / innovation_variance);
        // One product for both triangles, so that it stays symmetric to the last bit.
        let scaled = expected.cross / innovation_variance.sqrt();
        self.covariance -= scaled * scaled.transpose();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn filter() -> CubatureFilter<3> {
        CubatureFilter {
            mean: Vector3::new(1.0, -2.0, 5.0),
            covariance: Matrix3::new(4.0, 1.0, 0.5, 1.0, 2.0, -0.3, 0.5, -0.3, 1.0),
        }
    }

    #[test]
    fn points_have_mean_and_covariance_of_the_gaussian_and_no_skew() {
        let filter = filter();
        let points: Vec<_> = filter.points().unwrap().collect();
        let mean = points.iter().sum::<Vector3<f64>>() / 6.0;
        let covariance = points
            .iter()
            .map(|x| (x - mean) * (x - mean).transpose())
            .sum::<Matrix3<f64>>()
            / 6.0;
        let skew = points
            .iter()
            .map(|x| (x - mean).map(|d| d.powi(3)))
            .sum::<Vector3<f64>>();
        assert!((mean - filter.mean).norm() < 1e-12);
        assert!((covariance - filter.covariance).norm() < 1e-12);
        assert!(skew.norm() < 1e-9);
    }

    #[test]
    fn on_a_linear_problem_it_is_the_kalman_filter() {
        let f = Matrix2::new(1.0, 0.1, 0.0, 0.98);
        let q = Matrix2::new(0.02, 0.001, 0.001, 0.03);
        let h = Vector2::new(1.0, 0.3);
        let r = 0.2;
        let (mut x, mut p) = (Vector2::new(0.5, 1.0), Matrix2::identity() * 3.0);
        let mut cubature = CubatureFilter {
            mean: x,
            covariance: p,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..100 {
            let noise: f64 = StandardNormal.sample(&mut rng);
            let z = 2.0 + noise;
            x = f * x;
            p = f * p * f.transpose() + q;
            let s = h.dot(&(p * h)) + r;
            let gain = p * h / s;
            x += gain * (z - h.dot(&x));
            p -= gain * s * gain.transpose();

            assert!(cubature.predict(|x| f * x, &q));
            let expected = cubature.expect(|x| h.dot(x)).unwrap();
            assert!((expected.variance + r - s).abs() < 1e-9);
            cubature.update(&expected, z, r);
            assert!((cubature.mean - x).norm() < 1e-9);
            assert!((cubature.covariance - p).norm() < 1e-9);
        }
    }

    #[test]
    fn mean_of_a_square_is_exact() {
        // E|x|^2 = |m|^2 + trace P: the rule is exact to the third degree.
        let filter = filter();
        let expected = filter.expect(|x| x.norm_squared()).unwrap();
        let exact = filter.mean.norm_squared() + filter.covariance.trace();
        assert!((expected.mean - exact).abs() < 1e-9);
    }

    #[test]
    fn an_indefinite_covariance_is_said_not_used() {
        let mut broken = filter();
        broken.covariance[(0, 0)] = -1.0;
        let before = broken;
        assert!(!broken.predict(|x| *x, &Matrix3::identity()));
        assert_eq!(broken, before);
        assert!(broken.expect(|x| x.norm()).is_none());
    }

    proptest! {
        #[test]
        fn covariance_stays_symmetric_and_positive_definite(
            places in prop::collection::vec((-30.0..30.0_f64, -30.0..30.0_f64, 0.1..30.0_f64, -5.0..5.0_f64), 1..200),
            sigma in 1e-3..1.0_f64,
        ) {
            let mut filter = CubatureFilter { mean: Vector3::new(3.0, 4.0, 0.0), covariance: Matrix3::identity() * 400.0 };
            for (x, y, z, error) in places {
                prop_assert!(filter.predict(|x| *x, &(Matrix3::identity() * 1e-6)));
                let from = Vector3::new(x, y, z);
                let expected = filter.expect(|x| (x - from).norm()).unwrap();
                filter.update(&expected, from.norm() + error * sigma, sigma * sigma);
                let p = filter.covariance;
                prop_assert!(p == p.transpose());
                prop_assert!(Cholesky::new(p).is_some(), "{}", p);
            }
        }
    }
}
