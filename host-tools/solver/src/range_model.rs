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

use crate::kernel::{Kernel, RhoSum};
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
    /// Fills up a group; adds nothing to any sum.
    const WITHOUT_WEIGHT: Self = Self {
        position: Vector3::new(0.0, 0.0, 0.0),
        range: 0.0,
        inv_sigma: 0.0,
    };

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

/// Steps that go down from anywhere (iteratively reweighted least squares).
impl LeastSquares<4> for RangeProblem<'_> {
    fn linearise(&self, x: &State) -> NormalEquations<4> {
        self.with_curvature(x, 1.0)
    }
}

/// The same problem with second derivatives close to the true ones: for the last few steps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NearlyNewton<'a>(pub(crate) RangeProblem<'a>);

impl LeastSquares<4> for NearlyNewton<'_> {
    fn linearise(&self, x: &State) -> NormalEquations<4> {
        self.0.with_curvature(x, 0.25)
    }
}

impl RangeProblem<'_> {
    /// `least_curvature` as in [`RhoSum::add`].
    fn with_curvature(&self, x: &State, least_curvature: f64) -> NormalEquations<4> {
        let inv_scale = 1.0 / self.scale;
        let mut cost = self.kernel.sum();
        let mut sums = Sums::default();
        let (groups, rest) = self.samples.as_chunks::<LANES>();
        for group in groups {
            sums.add(group, x, inv_scale, least_curvature, &mut cost);
        }
        if !rest.is_empty() {
            let mut group = [Sample::WITHOUT_WEIGHT; LANES];
            group[..rest.len()].copy_from_slice(rest);
            sums.add(&group, x, inv_scale, least_curvature, &mut cost);
        }

        let [gx, gy, gz, gb] = sums.gradient.map(total);
        let [xx, xy, xz, xb, yy, yz, yb, zz, zb, bb] = sums.hessian.map(total);
        let prior_weight = self.unknowns.prior_weight * self.prior_factor;
        let prior_misfit = x.w - self.unknowns.prior_bias;
        #[rustfmt::skip]
        let hessian = Matrix4::new(
            xx, xy, xz, xb,
            xy, yy, yz, yb,
            xz, yz, zz, zb,
            xb, yb, zb, bb + prior_weight,
        );
        let mut normal = NormalEquations {
            cost: 0.5 * (cost.total() + prior_weight * prior_misfit * prior_misfit),
            gradient: Vector4::new(gx, gy, gz, gb + prior_weight * prior_misfit),
            hessian,
        };
        self.unknowns.hold_given(&mut normal.hessian);
        for i in (0..4).filter(|&i| !self.unknowns.free[i]) {
            normal.gradient[i] = 0.0;
        }
        normal
    }
}

/// Samples that are worked on side by side: loops over this many numbers become vector
/// instructions, and so many square roots and divisions hide each other's latency.
const LANES: usize = 8;
/// One number of each.
type Lanes = [f64; LANES];

/// Sums over the samples, a lane each.
#[derive(Default)]
struct Sums {
    /// x, y, z, bias.
    gradient: [Lanes; 4],
    /// Upper triangle by rows: xx, xy, xz, xb, yy, yz, yb, zz, zb, bb.
    hessian: [Lanes; 10],
}

impl Sums {
    #[inline]
    fn add(
        &mut self,
        group: &[Sample; LANES],
        x: &State,
        inv_scale: f64,
        least_curvature: f64,
        cost: &mut RhoSum<LANES>,
    ) {
        let dx = lanes(|k| x.x - group[k].position.x);
        let dy = lanes(|k| x.y - group[k].position.y);
        let dz = lanes(|k| x.z - group[k].position.z);
        let whiten = lanes(|k| group[k].inv_sigma * inv_scale);
        let distance = lanes(|k| (dx[k] * dx[k] + dy[k] * dy[k] + dz[k] * dz[k]).sqrt());
        let r = lanes(|k| (distance[k] + x.w - group[k].range) * whiten[k]);
        let (w, curvature) = cost.add(&product(&r, &r), least_curvature);

        // At the very place of measurement the direction is undefined; zero, which `d` is there,
        // leaves the step to the other samples.
        let inv_distance = lanes(|k| 1.0 / if distance[k] > 0.0 { distance[k] } else { 1.0 });
        let ux = product(&dx, &inv_distance);
        let uy = product(&dy, &inv_distance);
        let uz = product(&dz, &inv_distance);
        let pull = lanes(|k| w[k] * whiten[k] * r[k]);
        let weight = lanes(|k| curvature[k] * whiten[k] * whiten[k]);
        let vx = product(&ux, &weight);
        let vy = product(&uy, &weight);
        let vz = product(&uz, &weight);

        let [gx, gy, gz, gb] = &mut self.gradient;
        add_product(gx, &pull, &ux);
        add_product(gy, &pull, &uy);
        add_product(gz, &pull, &uz);
        add(gb, &pull);
        let [xx, xy, xz, xb, yy, yz, yb, zz, zb, bb] = &mut self.hessian;
        add_product(xx, &vx, &ux);
        add_product(xy, &vx, &uy);
        add_product(xz, &vx, &uz);
        add(xb, &vx);
        add_product(yy, &vy, &uy);
        add_product(yz, &vy, &uz);
        add(yb, &vy);
        add_product(zz, &vz, &uz);
        add(zb, &vz);
        add(bb, &weight);
    }
}

#[inline]
fn lanes(of: impl Fn(usize) -> f64) -> Lanes {
    // A plain loop: `array::from_fn` is not turned into vector instructions.
    let mut lanes = [0.0; LANES];
    for (k, lane) in lanes.iter_mut().enumerate() {
        *lane = of(k);
    }
    lanes
}

#[inline]
fn product(a: &Lanes, b: &Lanes) -> Lanes {
    lanes(|k| a[k] * b[k])
}

#[inline]
fn add(sum: &mut Lanes, a: &Lanes) {
    for k in 0..LANES {
        sum[k] += a[k];
    }
}

#[inline]
fn add_product(sum: &mut Lanes, a: &Lanes, b: &Lanes) {
    for k in 0..LANES {
        sum[k] += a[k] * b[k];
    }
}

fn total(lanes: Lanes) -> f64 {
    lanes.iter().sum()
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
