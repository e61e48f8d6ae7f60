//! The range equation and its sum of squares.
//!
//! A node at `p` is measured from `a_i` with a common bias `b`:
//!
//! ```text
//! h_i(p, b) = |p - a_i| + b            predicted range
//! r_i       = (h_i - range_i) / (s sigma_i)
//! dh_i/dp   = (p - a_i)^T / |p - a_i|,  dh_i/db = 1
//! F(p, b)   = 1/2 sum_i rho(r_i) + 1/2 q (b - b_prior)^2
//! ```
//!
//! `s` is a common factor on all sigmas and `q` the weight of the prior. Unknowns that are given (a
//! known height, a known bias) keep their start: their row and column are replaced by those of the
//! identity.

use nalgebra::{Matrix4, Vector3, Vector4};

use crate::kernel::Kernel;
use crate::lm::{LeastSquares, NormalEquations};

/// Unknowns: x, y, z in metres, then the range bias in metres.
pub(crate) type State = Vector4<f64>;

/// One measurement in the frame of the computation (origin moved near the data).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) position: Vector3<f64>,
    pub(crate) range: f64,
    pub(crate) inv_sigma: f64,
}

impl Sample {
    /// Predicted minus measured range, metres.
    #[inline]
    pub(crate) fn misfit(&self, x: &State) -> f64 {
        (x.xyz() - self.position).norm() + x.w - self.range
    }

    /// The same in units of this sample's sigma.
    #[inline]
    pub(crate) fn whitened(&self, x: &State) -> f64 {
        self.misfit(x) * self.inv_sigma
    }
}

/// Which unknowns are free, and what is known of the bias beforehand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Unknowns {
    /// x, y, z, bias.
    pub(crate) free: [bool; 4],
    pub(crate) prior_bias: f64,
    /// `1 / sigma^2` of the prior, 0 where the bias is not estimated.
    pub(crate) prior_weight: f64,
}

impl Unknowns {
    /// How many are free.
    pub(crate) fn count(&self) -> usize {
        self.free.iter().filter(|f| **f).count()
    }

    /// Replaces the rows and columns of what is given by those of the identity.
    pub(crate) fn hold_given(&self, information: &mut Matrix4<f64>) {
        for i in (0..4).filter(|&i| !self.free[i]) {
            information.row_mut(i).fill(0.0);
            information.column_mut(i).fill(0.0);
            information[(i, i)] = 1.0;
        }
    }
}

/// The sum of squares over a set of samples.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RangeProblem<'a> {
    pub(crate) samples: &'a [Sample],
    pub(crate) unknowns: &'a Unknowns,
    pub(crate) kernel: Kernel,
    /// `s` above.
    pub(crate) scale: f64,
    /// What one unit of squared whitened residual counts against the prior: the variance inflation
    /// found in [`crate::noise`].
    pub(crate) prior_factor: f64,
}

impl LeastSquares<4> for RangeProblem<'_> {
    fn linearise(&self, x: &State) -> NormalEquations<4> {
        let p = x.xyz();
        let mut sum = NormalEquations::zeros();
        let mut cost = self.kernel.sum();
        let (mut bias_gradient, mut bias_hessian) = (0.0, 0.0);
        let (mut gx, mut gy, mut gz) = (0.0, 0.0, 0.0);
        let (mut xx, mut xy, mut xz, mut yy, mut yz, mut zz) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut xb, mut yb, mut zb) = (0.0, 0.0, 0.0);
        let inv_scale = 1.0 / self.scale;
        for sample in self.samples {
            let d = p - sample.position;
            let distance = d.norm();
            // At the very place of measurement the direction is undefined; zero leaves the step to
            // the other samples.
            let inv_distance = if distance > 0.0 { 1.0 / distance } else { 0.0 };
            let u = d * inv_distance;
            let whiten = sample.inv_sigma * inv_scale;
            let r = (distance + x.w - sample.range) * whiten;
            let w = cost.add(r * r);
            let weighted = w * whiten;
            let pull = weighted * r;
            gx += pull * u.x;
            gy += pull * u.y;
            gz += pull * u.z;
            bias_gradient += pull;
            let weight = weighted * whiten;
            let v = u * weight;
            xx += v.x * u.x;
            xy += v.x * u.y;
            xz += v.x * u.z;
            yy += v.y * u.y;
            yz += v.y * u.z;
            zz += v.z * u.z;
            xb += v.x;
            yb += v.y;
            zb += v.z;
            bias_hessian += weight;
        }
        let prior_weight = self.unknowns.prior_weight * self.prior_factor;
        let prior_misfit = x.w - self.unknowns.prior_bias;
        sum.cost = 0.5 * (cost.total() + prior_weight * prior_misfit * prior_misfit);
        sum.gradient = Vector4::new(gx, gy, gz, bias_gradient + prior_weight * prior_misfit);
        #[rustfmt::skip]
        let hessian = Matrix4::new(
            xx, xy, xz, xb,
            xy, yy, yz, yb,
            xz, yz, zz, zb,
            xb, yb, zb, bias_hessian + prior_weight,
        );
        sum.hessian = hessian;
        self.unknowns.hold_given(&mut sum.hessian);
        for i in (0..4).filter(|&i| !self.unknowns.free[i]) {
            sum.gradient[i] = 0.0;
        }
        sum
    }
}

/// `J / sigma` of one sample; zero for the unknowns that are not free.
pub(crate) fn jacobian(sample: &Sample, x: &State, free: [bool; 4]) -> Vector4<f64> {
    let d = x.xyz() - sample.position;
    let distance = d.norm();
    let u = if distance > 0.0 { d / distance } else { d };
    let full = Vector4::new(u.x, u.y, u.z, 1.0) * sample.inv_sigma;
    full.zip_map(
        &Vector4::from(free),
        |value, free| if free { value } else { 0.0 },
    )
}

/// `sum J^T J / sigma^2` of the samples at `x`: what plain, unscaled Gaussian ranges tell about the
/// free unknowns. The rows and columns of the others are those of the identity.
pub(crate) fn information(samples: &[Sample], x: &State, unknowns: &Unknowns) -> Matrix4<f64> {
    let without_prior = Unknowns {
        prior_weight: 0.0,
        ..*unknowns
    };
    let problem = RangeProblem {
        samples,
        unknowns: &without_prior,
        kernel: Kernel::None,
        scale: 1.0,
        prior_factor: 1.0,
    };
    problem.linearise(x).hessian
}

/// At most `most` samples, evenly spread.
pub(crate) fn thin(samples: &[Sample], most: usize) -> Vec<Sample> {
    let step = samples.len().div_ceil(most).max(1);
    samples.iter().step_by(step).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{CAUCHY_95, HUBER_95};
    use proptest::prelude::*;

    fn coordinate() -> impl Strategy<Value = f64> {
        -20.0..20.0
    }

    proptest! {
        #[test]
        fn gradient_is_the_finite_difference_of_the_cost(
            places in prop::collection::vec((coordinate(), coordinate(), coordinate(), 0.0..40.0, 0.05..0.5), 4..12),
            x in (coordinate(), coordinate(), coordinate(), -1.0..1.0),
            kernel in prop::sample::select(vec![Kernel::None, Kernel::Huber { k: HUBER_95 }, Kernel::Cauchy { c: CAUCHY_95 }]),
        ) {
            let samples: Vec<_> = places
                .iter()
                .map(|&(x, y, z, range, sigma)| Sample { position: Vector3::new(x, y, z), range, inv_sigma: 1.0 / sigma })
                .collect();
            let x = State::new(x.0, x.1, x.2, x.3);
            prop_assume!(samples.iter().all(|s| (s.position - x.xyz()).norm() > 0.1));
            let unknowns = Unknowns { free: [true; 4], prior_bias: 0.2, prior_weight: 3.0 };
            let problem = RangeProblem { samples: &samples, unknowns: &unknowns, kernel, scale: 1.3, prior_factor: 2.0 };
            let gradient = problem.linearise(&x).gradient;
            for i in 0..4 {
                let h = 1e-6;
                let mut step = State::zeros();
                step[i] = h;
                let slope = (problem.linearise(&(x + step)).cost - problem.linearise(&(x - step)).cost) / (2.0 * h);
                prop_assert!((slope - gradient[i]).abs() < 1e-5 * (1.0 + gradient.norm()) + 1e-2 * h * problem.linearise(&x).cost, "{slope} {gradient}");
            }
        }
    }
}
