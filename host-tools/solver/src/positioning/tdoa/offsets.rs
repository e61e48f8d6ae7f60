//! Place and anchors' offsets together, and how large offsets are.
//!
//! ```text
//! x = [p o_1 .. o_m],  N = sum w J J^T / (s sigma)^2,  J = [u_b - u_a | .. +1 at b, -1 at a ..]
//! C = (N / f + diag(0, 1 / tau^2))^-1
//! tau^2 = (nu_0 tau_0^2 + sum o_i^2 + C_ii) / (nu_0 + m)                    until it settles
//! ```
//!
//! The last line is expectation maximisation for a variance that is itself unknown (Harville, "Maximum
//! likelihood approaches to variance component estimation", JASA 72, 1977): `C_ii` gives back what fitting
//! took out of the offsets, the place's share included. `f` is the variance of the noise as
//! [`learn`] finds it from the residuals, correlation in time included. A variance learnt from few
//! anchors is itself uncertain: for the covariance it is widened by Student's `nu / (nu - 2)`, `nu` being
//! `nu_0` and the offsets that the differences determine (of `m` anchors all but four).

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::{OUTLIER_SIGMAS, RangeDifference, SMALLEST_SCALE, TdoaFix, TdoaOptions, misfit};
use crate::noise::{learn, robust_scale};

/// The expected size of offsets is believed as if it had been found from so many anchors.
const PRIOR_ANCHORS: f64 = 1.0;
/// Rounds of linearisation.
const ROUNDS: u32 = 30;
/// Steps of expectation maximisation in a round; they are cheap.
const EM_STEPS: u32 = 50;
/// A step smaller than this is none, metres.
const SETTLED_M: f64 = 1e-6;

struct Offsets<'a> {
    differences: &'a [RangeDifference],
    /// Anchors at different places, and of each difference the numbers of its two.
    anchors: Vec<Vector3<f64>>,
    ends: Vec<[usize; 2]>,
}

impl<'a> Offsets<'a> {
    fn new(differences: &'a [RangeDifference]) -> Self {
        let mut anchors: Vec<Vector3<f64>> = Vec::new();
        let mut number = |place: Vector3<f64>| {
            (anchors.iter().position(|a| *a == place)).unwrap_or_else(|| {
                anchors.push(place);
                anchors.len() - 1
            })
        };
        let ends = (differences.iter())
            .map(|d| d.anchors_m.map(&mut number))
            .collect();
        Self {
            differences,
            anchors,
            ends,
        }
    }

    /// Misfit, gradient by the place and standard deviation of each difference, with its two ends.
    fn rows<'b>(
        &'b self,
        x: &'b DVector<f64>,
    ) -> impl Iterator<Item = (f64, Vector3<f64>, f64, [usize; 2])> + 'b {
        let p = Vector3::new(x[0], x[1], x[2]);
        (self.differences.iter().zip(&self.ends)).map(move |(d, &[a, b])| {
            let (without, j) = misfit(d, &p);
            (without + x[3 + b] - x[3 + a], j, d.sigma_m, [a, b])
        })
    }

    fn whitened(&self, x: &DVector<f64>) -> Vec<f64> {
        (self.rows(x))
            .map(|(misfit, _, sigma, _)| misfit / sigma)
            .collect()
    }

    /// Information and gradient with these weights (by whitened residual).
    fn normal(
        &self,
        x: &DVector<f64>,
        weight: impl Fn(f64) -> f64,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let n = 3 + self.anchors.len();
        let (mut information, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for (misfit, j, sigma, [a, b]) in self.rows(x) {
            let w = weight(misfit / sigma) / (sigma * sigma);
            // A difference between an anchor and itself says nothing.
            let row = [
                (0, j.x),
                (1, j.y),
                (2, j.z),
                (3 + a, if a == b { 0.0 } else { -1.0 }),
                (3 + b, if a == b { 0.0 } else { 1.0 }),
            ];
            for (i, ji) in row {
                gradient[i] += w * ji * misfit;
                for (k, jk) in row {
                    information[(i, k)] += w * ji * jk;
                }
            }
        }
        (information, gradient)
    }
}

/// The answer from a start with its scale; `None` where the equations are singular.
pub(super) fn with_offsets(
    differences: &[RangeDifference],
    options: &TdoaOptions,
    start: Vector3<f64>,
    mut scale: f64,
) -> Option<TdoaFix> {
    let problem = Offsets::new(differences);
    let m = problem.anchors.len();
    let mut x = DVector::zeros(3 + m);
    x.fixed_rows_mut::<3>(0).copy_from(&start);
    let prior = options.offset_sigma_m.powi(2);
    let mut tau2 = prior;
    let mut noise = scale * scale;
    let mut unknowns = 3;
    for _ in 0..ROUNDS {
        let (information, gradient) =
            problem.normal(&x, |r| options.kernel.rho_and_weight((r / scale).powi(2)).1);
        // Where the minimum of this linearisation lies hangs on tau, and tau on it.
        let mut next = x.clone();
        for _ in 0..EM_STEPS {
            let c = covariance(&information, noise, tau2)?;
            let mut pull = &gradient / noise;
            for i in 3..3 + m {
                pull[i] += x[i] / tau2;
            }
            next = &x - &c * pull;
            let spread: f64 = (3..3 + m).map(|i| next[i].powi(2) + c[(i, i)]).sum();
            let fresh = (PRIOR_ANCHORS * prior + spread) / (PRIOR_ANCHORS + m as f64);
            let settled = (fresh / tau2 - 1.0).abs() < 1e-3;
            tau2 = fresh;
            unknowns = 3 + freedom(&c, tau2).ceil() as usize;
            if settled {
                break;
            }
        }
        let step = (&next - &x).amax();
        if !step.is_finite() {
            return None;
        }
        x = next;
        let whitened = problem.whitened(&x);
        let fresh = robust_scale(&mut whitened.clone(), unknowns).max(SMALLEST_SCALE);
        let settled = (fresh / scale - 1.0).abs() < 1e-3;
        scale = fresh;
        noise = learn(&whitened, scale, options.kernel, unknowns).variance_factor;
        if settled && step < SETTLED_M {
            break;
        }
    }
    // What the kernel gave up of outliers is in the variance that their influence leaves.
    let (information, _) = problem.normal(&x, |_| 1.0);
    let determined = freedom(&covariance(&information, noise, tau2)?, tau2);
    // With two or fewer Student's t has no variance at all.
    let nu = (PRIOR_ANCHORS + determined).max(3.0);
    let c = covariance(&information, noise, tau2 * nu / (nu - 2.0))?;
    let outliers = (problem.whitened(&x).iter())
        .filter(|r| r.abs() > OUTLIER_SIGMAS * scale)
        .count();
    let offsets = x.iter().skip(3).copied();
    Some(TdoaFix {
        position_m: x.fixed_rows::<3>(0).into_owned(),
        covariance_m2: Matrix3::from_fn(|i, k| 0.5 * (c[(i, k)] + c[(k, i)])),
        alternative_m: None,
        offsets_m: problem.anchors.iter().copied().zip(offsets).collect(),
        offset_sigma_m: tau2.sqrt(),
        noise_scale: scale,
        outliers,
    })
}

fn covariance(information: &DMatrix<f64>, noise: f64, tau2: f64) -> Option<DMatrix<f64>> {
    let mut sum = information / noise;
    for i in 3..sum.nrows() {
        sum[(i, i)] += 1.0 / tau2;
    }
    Some(sum.cholesky()?.inverse())
}

/// How many offsets the differences determine, as opposed to what was expected of them.
fn freedom(c: &DMatrix<f64>, tau2: f64) -> f64 {
    let of = |i: usize| (1.0 - c[(i, i)] / tau2).clamp(0.0, 1.0);
    (3..c.nrows()).map(of).sum()
}
