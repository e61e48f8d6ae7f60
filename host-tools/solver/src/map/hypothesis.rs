//! One explanation of all measurements: where the tag is, the range bias, and how dead reckoning has
//! erred since hand-over.
//!
//! Maximum a posteriori over the globals `g = [tag, b]` and the knots `x_k = [p, v, a]`:
//!
//! ```text
//! minimise  1/2 |(x_0, g) - prior|^2 + 1/2 sum_k |x_(k+1) - F x_k|^2 + sum_i cost(r_i)
//! r_i = |tag - (ins_i - e_i)| + b - range_i,       e_i = (1 - s) p_k + s p_(k+1)
//! d r_i / d tag = u,  d r_i / d p_k = (1 - s) u,  d r_i / d p_(k+1) = s u,  d r_i / d b = 1
//! ```
//!
//! with `s` the place of range `i` between its knots and `u` the unit vector from vehicle to tag.
//! Between knots half a second apart the error is as good as linear (0.1 m/s^2 bends it by 3 mm).
//! One [`Hypothesis::sweep`] goes along the chain once: it linearises, eliminates, and leaves the
//! Gauss-Newton step ready.

use super::elimination::{Factor, GLOBAL, JOINT, KNOT};
use super::noise::NoiseModel;
use super::prior::Prior;
use super::record::{Growth, Record};
use super::transition::propagate;
use super::tuning::Tuner;
use crate::bound::{BIAS, Covariance, STATES};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// How far back it reaches that the vehicle is put elsewhere, seconds.
const LEAD_S: f64 = 4.0;

/// State of one explanation.
#[derive(Debug)]
pub(super) struct Hypothesis {
    pub(super) prior: Prior,
    pub(super) globals: [f64; GLOBAL],
    pub(super) knots: Vec<[f64; KNOT]>,
    /// The noise under which it explains the measurements best.
    pub(super) tuner: Tuner,
    /// `-ln` of its evidence, its noise model's prior included: what it is judged by.
    pub(super) score: f64,
    /// What the last refinement ended with: logarithm of the evidence, and outliers.
    pub(super) log_evidence: f64,
    pub(super) outliers: f64,
    /// Covariance of the newest knot and the globals.
    pub(super) covariance: SMatrix<f64, JOINT, JOINT>,
    /// Information added on the tag's coordinates in a step, 1/m^2.
    pub(super) damping: f64,
    /// Part of a step that is taken.
    pub(super) reach: f64,
    /// Standard deviation added to all ranges while a start is still far off, metres.
    pub(super) slack_m: f64,
    /// The knots before the last step.
    pub(super) before: Vec<[f64; KNOT]>,
}

/// By hand, to keep room for growth: a plain clone has none, and its next updates would allocate.
impl Clone for Hypothesis {
    fn clone(&self) -> Self {
        let mut knots = Vec::with_capacity(self.knots.capacity());
        knots.extend_from_slice(&self.knots);
        Self {
            prior: self.prior,
            globals: self.globals,
            knots,
            tuner: self.tuner.clone(),
            score: self.score,
            log_evidence: self.log_evidence,
            outliers: self.outliers,
            covariance: self.covariance,
            damping: self.damping,
            reach: self.reach,
            slack_m: self.slack_m,
            before: Vec::with_capacity(self.knots.capacity()),
        }
    }
}

impl Hypothesis {
    pub(super) fn new(
        prior: Prior,
        tuner: Tuner,
        tag_m: Vector3<f64>,
        knots: usize,
        capacity: usize,
    ) -> Self {
        let mut states = Vec::with_capacity(capacity);
        states.resize(knots, [0.0; KNOT]);
        Self {
            prior,
            globals: [tag_m.x, tag_m.y, tag_m.z, prior.at[JOINT - 1]],
            knots: states,
            tuner,
            score: f64::INFINITY,
            log_evidence: f64::NEG_INFINITY,
            outliers: 0.0,
            covariance: SMatrix::zeros(),
            damping: 0.0,
            reach: 1.0,
            slack_m: 0.0,
            before: Vec::with_capacity(capacity),
        }
    }

    /// What marginalised knots have left it.
    pub(super) fn prior(&self) -> Prior {
        self.prior
    }

    pub(super) fn tag_m(&self) -> Vector3<f64> {
        Vector3::new(self.globals[0], self.globals[1], self.globals[2])
    }

    pub(super) fn bias_m(&self) -> f64 {
        self.globals[3]
    }

    /// Puts the tag elsewhere and keeps the rest.
    pub(super) fn move_tag(&mut self, tag_m: Vector3<f64>) {
        self.globals[..3].copy_from_slice(tag_m.as_slice());
    }

    /// Error of dead reckoning and its growth at the newest range.
    pub(super) fn ins_error(&self) -> (Vector3<f64>, Vector3<f64>) {
        let x = self.newest();
        (
            Vector3::new(x[0], x[1], x[2]),
            Vector3::new(x[3], x[4], 0.0),
        )
    }

    /// Covariance of `tag - vehicle` at the newest range.
    pub(super) fn relative_covariance(&self) -> Matrix3<f64> {
        // tag - (ins - e): the derivative is 1 with respect to both tag and e.
        let c = &self.covariance;
        Matrix3::from_fn(|i, j| {
            c[(i, j)] + c[(i, KNOT + j)] + c[(KNOT + i, j)] + c[(KNOT + i, KNOT + j)]
        })
    }

    /// Covariance at the newest range in the order of [`crate::bound::Recursion`]: tag plus error of
    /// dead reckoning, its velocity and acceleration, range bias.
    pub(super) fn bound_covariance(&self) -> Covariance {
        let mut pick = SMatrix::<f64, STATES, JOINT>::zeros();
        for i in 0..KNOT {
            pick[(i, i)] = 1.0;
        }
        for i in 0..3 {
            pick[(i, KNOT + i)] = 1.0;
        }
        pick[(BIAS, JOINT - 1)] = 1.0;
        pick * self.covariance * pick.transpose()
    }

    /// The state to which that covariance belongs.
    pub(super) fn bound_mean(&self) -> SVector<f64, STATES> {
        let x = self.newest();
        let mut mean = SVector::<f64, STATES>::zeros();
        mean.fixed_rows_mut::<KNOT>(0).copy_from_slice(&x);
        for i in 0..3 {
            mean[i] += self.globals[i];
        }
        mean[BIAS] = self.bias_m();
        mean
    }

    /// How far another explanation is, metres: the larger of the distances between tags and between
    /// vehicles at the newest range.
    pub(super) fn distance_m(&self, other: &Self) -> f64 {
        let tags = (self.tag_m() - other.tag_m()).norm();
        tags.max((self.ins_error().0 - other.ins_error().0).norm())
    }

    /// Puts the vehicle elsewhere at the newest range, horizontally, so that the tag is seen at
    /// `offset_m(as it is seen now)`, and leads the knots of the last seconds there.
    pub(super) fn lead_newest(
        &mut self,
        record: &Record,
        offset_m: impl FnOnce(Vector3<f64>) -> Vector3<f64>,
    ) {
        let Some(newest) = record.observations().last() else {
            return;
        };
        let (error_m, _) = self.ins_error();
        let sight = self.tag_m() - newest.ins_m + error_m;
        let shift = offset_m(sight) - sight;
        for (knot, t_s) in self.knots.iter_mut().zip(record.knot_times_s()).rev() {
            let share = 1.0 - (newest.t_s - t_s) / LEAD_S;
            if share <= 0.0 {
                break;
            }
            knot[0] += share * shift.x;
            knot[1] += share * shift.y;
        }
    }

    fn newest(&self) -> [f64; KNOT] {
        self.knots.last().copied().unwrap_or([0.0; KNOT])
    }

    /// Follows the record after it took an observation; `moved_by_s` is how far the last knot went.
    pub(super) fn follow(&mut self, growth: Growth, moved_by_s: f64) {
        let next = propagate(&self.newest(), moved_by_s);
        if growth == Growth::Moved {
            self.knots.pop();
        }
        self.knots.push(next);
    }

    /// `-ln` of its evidence; less is better.
    pub(super) fn score(&self) -> f64 {
        self.score
    }

    /// Logarithm of its evidence under its noise, without the noise's prior.
    pub(super) fn log_evidence(&self) -> f64 {
        self.log_evidence
    }

    /// How many observations it takes for outliers.
    pub(super) fn outliers(&self) -> f64 {
        self.outliers
    }

    /// Its noise and how that is adapted.
    pub(super) fn tuner(&self) -> &Tuner {
        &self.tuner
    }

    /// The noise it takes the measurements to have.
    pub(super) fn noise(&self) -> &NoiseModel {
        self.tuner.noise()
    }

    /// Lets the noise follow the evidence by one step.
    pub(super) fn tune(&mut self, record: &Record, factors: &mut Vec<Factor>) {
        let mut tuner = self.tuner.clone();
        tuner.improve(self, record, factors);
        self.tuner = tuner;
    }
}
