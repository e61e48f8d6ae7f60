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

use super::elimination::{Array, Factor, GLOBAL, JOINT, KNOT, Last};
use super::likelihood::{Influence, RangeLikelihood};
use super::noise::NoiseModel;
use super::record::{Growth, Record};
use super::transition::{Transition, propagate};
use super::tuning::Tuner;
use crate::bound::{BIAS, Covariance, STATES};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// What is known of the first knot and the globals beforehand: a quadratic about a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prior {
    at: [f64; JOINT],
    information: [[f64; JOINT]; JOINT],
    gradient: [f64; JOINT],
    /// What marginalised knots contribute to cost and evidence.
    spent: Spent,
}

/// Constants of a prior that stands for knots no longer kept.
#[derive(Debug, Clone, Copy, Default)]
struct Spent {
    cost: f64,
    log_determinant: f64,
    log_weights: f64,
}

impl Prior {
    /// Independent Gaussians with these means and standard deviations.
    pub(super) fn independent(mean: [f64; JOINT], sigma: [f64; JOINT]) -> Self {
        let mut information = [[0.0; JOINT]; JOINT];
        for (i, sigma) in sigma.iter().enumerate() {
            information[i][i] = sigma.powi(-2);
        }
        Self {
            at: mean,
            information,
            gradient: [0.0; JOINT],
            spent: Spent::default(),
        }
    }

    /// Looks at the tag through a Gaussian window along a unit vector: about `centre` and as wide as
    /// `sigma_m`.
    fn window(&mut self, along: Vector3<f64>, centre: f64, sigma_m: f64) {
        let information = sigma_m.powi(-2);
        let at = Vector3::new(self.at[KNOT], self.at[KNOT + 1], self.at[KNOT + 2]);
        let off = centre - along.dot(&at);
        for i in 0..3 {
            for j in 0..3 {
                self.information[KNOT + i][KNOT + j] += information * along[i] * along[j];
            }
            self.gradient[KNOT + i] -= information * off * along[i];
        }
        self.spent.cost += 0.5 * information * off * off;
    }

    /// Adds itself to the first array; its cost.
    fn add(&self, x: &[f64; KNOT], globals: &[f64; GLOBAL], array: &mut Array) -> f64 {
        let mut off = [0.0; JOINT];
        for (i, value) in x.iter().chain(globals).enumerate() {
            off[i] = value - self.at[i];
        }
        let mut cost = 0.0;
        for i in 0..JOINT {
            let mut pull = 0.0;
            for (j, off) in off.iter().enumerate() {
                array.0[i][j] += self.information[i][j];
                pull += self.information[i][j] * off;
            }
            cost += off[i] * (0.5 * pull + self.gradient[i]);
            array.0[i][JOINT] += pull + self.gradient[i];
        }
        cost
    }
}

/// What a sweep found at the present state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sweep {
    /// Cost at the state, before the step.
    pub(super) cost: f64,
    /// Step and covariance of the newest knot and the globals.
    pub(super) last: Last,
    /// Logarithm of the evidence by Laplace's approximation at the minimum that the step promises,
    /// up to a constant that does not depend on the noise model.
    pub(super) log_evidence: f64,
    /// How many observations look like outliers.
    pub(super) outliers: f64,
}

/// State of one explanation.
#[derive(Debug)]
pub(super) struct Hypothesis {
    prior: Prior,
    globals: [f64; GLOBAL],
    knots: Vec<[f64; KNOT]>,
    /// The noise under which it explains the measurements best.
    tuner: Tuner,
    /// `-ln` of its evidence, its noise model's prior included: what it is judged by.
    score: f64,
    /// What the last refinement ended with: logarithm of the evidence, and outliers.
    log_evidence: f64,
    outliers: f64,
    /// Covariance of the newest knot and the globals.
    covariance: SMatrix<f64, JOINT, JOINT>,
    /// Information added on the tag's coordinates in a step, 1/m^2.
    damping: f64,
    /// Part of a step that is taken.
    reach: f64,
    /// Standard deviation added to all ranges while a start is still far off, metres.
    slack_m: f64,
    /// The knots before the last step.
    before: Vec<[f64; KNOT]>,
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

/// Slacks of an approach, metres, and the steps taken with each.
const SLACKS_M: [f64; 2] = [3.0, 0.4];
const STEPS_A_SLACK: u32 = 5;
/// Slices of a posterior: places and width, in standard deviations of it.
const SLICES: [f64; 7] = [-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4];
const SLICE: f64 = 0.8;
/// How far back a reflection reaches, seconds.
const REFLECT_S: f64 = 4.0;
/// A step that promises less than this is not worth taking; the cost counts squared sigmas.
const NEGLIGIBLE: f64 = 1e-4;
/// Factors on the damping after a success and after a failure, and where it begins, 1/m^2.
const EASE: f64 = 0.2;
const TIGHTEN: f64 = 5.0;
const LEAST_DAMPING: f64 = 0.01;
/// Factors on the part of a step that is taken, after a success and after a failure, and the least.
const LENGTHEN: f64 = 2.0;
const SHORTEN: f64 = 0.3;
const LEAST_REACH: f64 = 0.01;
/// Ranges shorter than this have their curvature counted in the covariance, metres.
const BENT_WITHIN_M: f64 = 8.0;
/// Distances below this bend no more than at it, metres.
const LEAST_DISTANCE_M: f64 = 0.1;
/// Damping that changes neither covariance nor evidence, 1/m^2.
const NEGLIGIBLE_DAMPING: f64 = 1e-6;

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

    /// Puts the vehicle on the other side of the tag at the newest range, horizontally, and leads
    /// the knots of the last seconds there.
    pub(super) fn reflect_newest(&mut self, record: &Record) {
        let Some(newest) = record.observations().last() else {
            return;
        };
        let (error_m, _) = self.ins_error();
        let sight = self.tag_m() - newest.ins_m + error_m;
        for (knot, t_s) in self.knots.iter_mut().zip(record.knot_times_s()).rev() {
            let share = 1.0 - (newest.t_s - t_s) / REFLECT_S;
            if share <= 0.0 {
                break;
            }
            knot[0] -= 2.0 * share * sight.x;
            knot[1] -= 2.0 * share * sight.y;
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

    /// Linearises and eliminates at the present state.
    pub(super) fn sweep(
        &self,
        record: &Record,
        noise: &NoiseModel,
        factors: &mut Vec<Factor>,
    ) -> Option<Sweep> {
        self.sweep_as(Manner::GaussNewton { damping: 0.0 }, record, noise, factors)
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

    /// The same measurements explained with another noise.
    pub(super) fn with_noise(
        &self,
        change: fn(&mut NoiseModel),
        record: &Record,
        factors: &mut Vec<Factor>,
    ) -> Option<Self> {
        let mut other = self.clone();
        other.tuner = self.tuner.changed(change);
        other.refine(record, 2 * STEPS_A_SLACK, factors)?;
        Some(other)
    }

    /// Lets the noise follow the evidence by one step.
    pub(super) fn tune(&mut self, record: &Record, factors: &mut Vec<Factor>) {
        let mut tuner = self.tuner.clone();
        tuner.improve(self, record, factors);
        self.tuner = tuner;
    }

    /// The same in this manner. `factors` is left ready for [`Hypothesis::step`].
    fn sweep_as(
        &self,
        manner: Manner,
        record: &Record,
        noise: &NoiseModel,
        factors: &mut Vec<Factor>,
    ) -> Option<Sweep> {
        let mut chain = Chain::start(self, manner);
        let mut transition: Option<Transition> = None;
        let times = record.knot_times_s();
        factors.clear();
        for k in 0..times.len().saturating_sub(1) {
            let dt_s = times[k + 1] - times[k];
            let step = match transition {
                Some(step) if step.fits(dt_s) => step,
                _ => Transition::new(&noise.ins, dt_s)?,
            };
            transition = Some(step);
            factors.push(chain.interval(self, record, noise, &step, k)?);
        }
        chain.finish()
    }

    /// Takes the step of the last sweep, or as much of it as was safe of late.
    fn step(&mut self, sweep: &Sweep, factors: &[Factor]) {
        let mut next = [0.0; KNOT];
        let mut globals = [0.0; GLOBAL];
        next.copy_from_slice(&sweep.last.step[..KNOT]);
        globals.copy_from_slice(&sweep.last.step[KNOT..]);
        for (value, step) in self.globals.iter_mut().zip(&globals) {
            *value += self.reach * step;
        }
        let last = self.knots.len() - 1;
        for k in (0..=last).rev() {
            if let (true, Some(factor)) = (k < last, factors.get(k)) {
                next = factor.back_substitute(&next, &globals);
            }
            for (value, step) in self.knots[k].iter_mut().zip(&next) {
                *value += self.reach * step;
            }
        }
    }

    /// At most `iterations` Levenberg-Marquardt steps; the sweep at the place where it stopped.
    ///
    /// The damping acts on the tag alone: it is the ring of places that a short path leaves which
    /// is bent too much for a full step, and dead reckoning follows. Past the tag it is dead
    /// reckoning itself that the ranges bend; there a shorter step helps, and no damping of the tag.
    pub(super) fn refine(
        &mut self,
        record: &Record,
        iterations: u32,
        factors: &mut Vec<Factor>,
    ) -> Option<Sweep> {
        let noise = &self.tuner.noise().clone();
        let mut here = self.sweep_as(self.manner(), record, noise, factors)?;
        for _ in 0..iterations {
            // A step held back by damping promises little, and proves nothing.
            if here.last.promised < NEGLIGIBLE && self.damping < LEAST_DAMPING {
                break;
            }
            self.before.clone_from(&self.knots);
            let globals = self.globals;
            self.step(&here, factors);
            match self.sweep_as(self.manner(), record, noise, factors) {
                Some(there) if there.cost <= here.cost => {
                    self.damping *= EASE;
                    self.reach = (LENGTHEN * self.reach).min(1.0);
                    here = there;
                }
                _ => {
                    std::mem::swap(&mut self.before, &mut self.knots);
                    self.globals = globals;
                    self.damping = (TIGHTEN * self.damping).max(LEAST_DAMPING);
                    self.reach = (SHORTEN * self.reach).max(LEAST_REACH);
                    here = self.sweep_as(self.manner(), record, noise, factors)?;
                }
            }
        }
        if self.damping > NEGLIGIBLE_DAMPING {
            here = self.sweep(record, noise, factors)?;
        }
        self.score = here.last.promised - here.log_evidence - self.tuner.log_prior();
        self.log_evidence = here.log_evidence;
        self.outliers = here.outliers;
        // Where the curvature says that this is no minimum, the flat picture is the better one.
        let curved = (self.is_near(record))
            .then(|| self.sweep_as(Manner::Newton, record, noise, factors))
            .flatten();
        self.covariance = curved.unwrap_or(here).last.covariance;
        Some(here)
    }

    fn manner(&self) -> Manner {
        Manner::GaussNewton {
            damping: self.damping,
        }
    }

    /// Whether the newest range is so short that the sphere about the tag is bent within the sigmas.
    fn is_near(&self, record: &Record) -> bool {
        let newest = record.observations().last();
        newest.is_some_and(|o| o.range_m < BENT_WITHIN_M)
    }

    /// From a start that may be far off: first with ranges that are hardly believed, then as they
    /// are.
    pub(super) fn approach(&mut self, record: &Record, factors: &mut Vec<Factor>) -> Option<Sweep> {
        for slack_m in SLACKS_M {
            self.slack_m = slack_m;
            self.refine(record, STEPS_A_SLACK, factors)?;
        }
        self.slack_m = 0.0;
        self.refine(record, STEPS_A_SLACK, factors)
    }

    /// This explanation in slices across the direction in which its tag is least known, each at its
    /// own minimum: the posterior is a stretch of a ring, and a tangent leaves the ring.
    pub(super) fn slices(&self, record: &Record, factors: &mut Vec<Factor>) -> Vec<Self> {
        let covariance: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(KNOT, KNOT).into_owned();
        let eigen = covariance.symmetric_eigen();
        let widest = eigen.eigenvalues.imax();
        let along = eigen.eigenvectors.column(widest).into_owned();
        let sigma_m = eigen.eigenvalues[widest].max(0.0).sqrt();
        let middle = along.dot(&self.tag_m());
        let slice = |place: f64| {
            let mut slice = self.clone();
            let off_m = place * sigma_m;
            slice.prior.window(along, middle + off_m, SLICE * sigma_m);
            slice.move_tag(self.tag_m() + along * off_m);
            slice.refine(record, STEPS_A_SLACK, factors).map(|_| slice)
        };
        SLICES.into_iter().filter_map(slice).collect()
    }

    /// From a start that is nearly right.
    pub(super) fn approach_gently(
        &mut self,
        record: &Record,
        factors: &mut Vec<Factor>,
    ) -> Option<Sweep> {
        self.refine(record, 2 * STEPS_A_SLACK, factors)
    }

    /// Drops the first knot: what it and its ranges say about the next one and the globals becomes
    /// the prior.
    pub(super) fn marginalise_first(&mut self, record: &Record) -> Option<()> {
        let noise = self.tuner.noise();
        let times = record.knot_times_s();
        let (Some(&t0), Some(&t1), Some(&next)) = (times.first(), times.get(1), self.knots.get(1))
        else {
            return None;
        };
        let step = Transition::new(&noise.ins, t1 - t0)?;
        let mut chain = Chain::start(self, Manner::GaussNewton { damping: 0.0 });
        chain.interval(self, record, noise, &step, 0)?;
        let mut prior = Prior {
            at: [0.0; JOINT],
            information: [[0.0; JOINT]; JOINT],
            gradient: [0.0; JOINT],
            spent: Spent {
                cost: chain.cost + 0.5 * chain.array.corner(),
                log_determinant: chain.log_determinant,
                log_weights: chain.log_weights,
            },
        };
        for (at, value) in prior.at.iter_mut().zip(next.iter().chain(&self.globals)) {
            *at = *value;
        }
        for i in 0..JOINT {
            prior.information[i].copy_from_slice(&chain.array.0[i][..JOINT]);
            prior.gradient[i] = chain.array.0[i][JOINT];
        }
        self.prior = prior;
        self.knots.remove(0);
        Some(())
    }

    /// From the vehicle to the tag, a part `s` of the way from knot `k` to the next.
    fn line_of_sight(&self, ins_m: Vector3<f64>, k: usize, s: f64) -> Vector3<f64> {
        let (a, b) = (&self.knots[k], &self.knots[k + 1]);
        let error = Vector3::new(
            a[0] + s * (b[0] - a[0]),
            a[1] + s * (b[1] - a[1]),
            a[2] + s * (b[2] - a[2]),
        );
        self.tag_m() - ins_m + error
    }
}

/// The observations of an interval and their places in it, 0 to 1.
fn interval_with_places(
    record: &Record,
    k: usize,
) -> impl Iterator<Item = (&super::record::Observation, f64)> {
    let times = record.knot_times_s();
    let (start, length) = (times[k], times[k + 1] - times[k]);
    record
        .of_interval(k)
        .iter()
        .map(move |o| (o, (o.t_s - start) / length))
}

/// How a sweep linearises.
#[derive(Debug, Clone, Copy)]
enum Manner {
    /// Distances are taken for straight; this much information, 1/m^2, is added on each coordinate
    /// of the tag.
    GaussNewton { damping: f64 },
    /// With the curvature of the distances, `(I - u u^T) / distance` times the slope of the cost. It
    /// is what sets the sigma straight above the tag, where `u` has next to no horizontal part; the
    /// matrix need not be positive definite away from a minimum.
    Newton,
}

/// A sweep under way.
struct Chain {
    curved: bool,
    array: Array,
    cost: f64,
    log_determinant: f64,
    log_weights: f64,
    outliers: f64,
}

impl Chain {
    fn start(hypothesis: &Hypothesis, manner: Manner) -> Self {
        let mut array = Array::zeros();
        if let Manner::GaussNewton { damping } = manner {
            for i in 0..3 {
                array.add_diagonal(KNOT + i, damping, 0.0);
            }
        }
        let spent = hypothesis.prior.spent;
        let cost = match hypothesis.knots.first() {
            Some(first) => {
                spent.cost + hypothesis.prior.add(first, &hypothesis.globals, &mut array)
            }
            None => f64::NAN,
        };
        Self {
            curved: matches!(manner, Manner::Newton),
            array,
            cost,
            log_determinant: spent.log_determinant,
            log_weights: spent.log_weights,
            outliers: 0.0,
        }
    }

    /// Adds interval `k` and eliminates its first knot.
    fn interval(
        &mut self,
        hypothesis: &Hypothesis,
        record: &Record,
        noise: &NoiseModel,
        transition: &Transition,
        k: usize,
    ) -> Option<Factor> {
        let mut next = Array::zeros();
        let mut coupling = [[0.0; KNOT]; KNOT];
        let (x, next_x) = (hypothesis.knots.get(k)?, hypothesis.knots.get(k + 1)?);
        self.cost += transition.add(x, next_x, &mut self.array, &mut coupling, &mut next);
        self.log_weights += transition.log_determinant;

        let likelihood = RangeLikelihood {
            outlier_probability: noise.outlier_probability,
        };
        let slack = hypothesis.slack_m * hypothesis.slack_m;
        // Between its knots a random walk is a Brownian bridge.
        let bridge = noise.ins.position_random_walk.powi(2) * transition.dt_s();
        let mut sums = RangeSums::default();
        for (observation, s) in interval_with_places(record, k) {
            let sight = hypothesis.line_of_sight(observation.ins_m, k, s);
            let distance = sight.norm();
            let u = if distance > 0.0 {
                sight / distance
            } else {
                sight
            };
            let r = distance + hypothesis.globals[3] - observation.range_m;
            let unseen = bridge * s * (1.0 - s) * (u.x * u.x + u.y * u.y);
            let influence = likelihood.influence(r, observation.variance_m2() + unseen + slack);
            self.cost += influence.cost;
            self.outliers += 1.0 - influence.sound;
            let curvature = if self.curved {
                influence.slope / distance.max(LEAST_DISTANCE_M)
            } else {
                0.0
            };
            sums.add(u, s, &influence, curvature);
        }
        sums.spread(&mut self.array, &mut coupling, &mut next);

        let (factor, log_determinant) = self.array.eliminate(&coupling, &mut next)?;
        self.log_determinant += log_determinant;
        self.array = next;
        Some(factor)
    }

    fn finish(self) -> Option<Sweep> {
        let last = self.array.solve()?;
        let log_determinant = self.log_determinant + last.log_determinant;
        self.cost.is_finite().then_some(Sweep {
            cost: self.cost,
            last,
            log_evidence: last.promised - self.cost + 0.5 * (self.log_weights - log_determinant),
            outliers: self.outliers,
        })
    }
}

/// Sums over the ranges of an interval. With `j = [u, 1]` all blocks are moments in `s` of `w j
/// j^T`.
#[derive(Default)]
struct RangeSums {
    /// `sum w (1 - s)^2 j j^T`, `sum w s (1 - s) j j^T`, `sum w s^2 j j^T`, upper triangles of
    /// symmetric 4x4.
    moments: [[[f64; 4]; 4]; 3],
    /// `sum slope (1 - s) j`, `sum slope s j`.
    pulls: [[f64; 4]; 2],
}

impl RangeSums {
    /// `curvature` counts across the line of sight.
    #[inline]
    fn add(&mut self, u: Vector3<f64>, s: f64, influence: &Influence, curvature: f64) {
        let j = [u.x, u.y, u.z, 1.0];
        let c = 1.0 - s;
        let along = influence.information - curvature;
        let mut block = [[0.0; 4]; 4];
        for row in 0..4 {
            for column in 0..4 {
                block[row][column] = along * j[row] * j[column];
            }
        }
        // The bias is no direction: its information stays whole.
        for i in 0..3 {
            block[i][i] += curvature;
            block[i][3] += curvature * j[i];
            block[3][i] += curvature * j[i];
        }
        block[3][3] += curvature;
        for (moment, weight) in self.moments.iter_mut().zip([c * c, s * c, s * s]) {
            for (sums, terms) in moment.iter_mut().zip(&block) {
                for (sum, term) in sums.iter_mut().zip(terms) {
                    *sum += weight * term;
                }
            }
        }
        for (pull, weight) in self.pulls.iter_mut().zip([c, s]) {
            for (sum, along) in pull.iter_mut().zip(&j) {
                *sum += influence.slope * weight * along;
            }
        }
    }

    fn spread(&self, here: &mut Array, coupling: &mut [[f64; KNOT]; KNOT], next: &mut Array) {
        let [cc, cs, ss] = &self.moments;
        for i in 0..4 {
            let pull = self.pulls[0][i] + self.pulls[1][i];
            here.0[KNOT + i][JOINT] += pull;
            for j in 0..4 {
                // Globals: (1-s)^2 + 2 s (1-s) + s^2 = 1.
                here.0[KNOT + i][KNOT + j] += cc[i][j] + 2.0 * cs[i][j] + ss[i][j];
            }
        }
        for i in 0..3 {
            here.0[i][JOINT] += self.pulls[0][i];
            next.0[i][JOINT] += self.pulls[1][i];
            for j in 0..3 {
                here.0[i][j] += cc[i][j];
                coupling[i][j] += cs[i][j];
                next.0[i][j] += ss[i][j];
            }
            for j in 0..4 {
                // (1-s) = (1-s)^2 + s (1-s) and s = s^2 + s (1-s).
                let (a, b) = (cc[i][j] + cs[i][j], ss[i][j] + cs[i][j]);
                here.0[i][KNOT + j] += a;
                here.0[KNOT + j][i] += a;
                next.0[i][KNOT + j] += b;
                next.0[KNOT + j][i] += b;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sums over one range of a vehicle at a third of the way, and its slope: of the tag at `tag_m`
    /// and the vehicle at the origin.
    fn sums(tag_m: Vector3<f64>, measured_m: f64, variance_m2: f64) -> RangeSums {
        let distance = tag_m.norm();
        let likelihood = RangeLikelihood {
            outlier_probability: 0.0,
        };
        let influence = likelihood.influence(distance - measured_m, variance_m2);
        let mut sums = RangeSums::default();
        sums.add(
            tag_m / distance,
            1.0 / 3.0,
            &influence,
            influence.slope / distance,
        );
        sums
    }

    proptest! {
        #[test]
        fn curved_information_is_the_derivative_of_the_pull(
            x in -2.0..2.0f64, y in -2.0..2.0f64, z in 0.3..3.0f64, off_m in -0.2..0.2f64,
        ) {
            let tag_m = Vector3::new(x, y, z);
            let measured_m = tag_m.norm() + off_m;
            let h = 1e-6;
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = h;
                let [less, more] = [tag_m - step, tag_m + step].map(|t| sums(t, measured_m, 0.01));
                for row in 0..4 {
                    let slope = (more.pulls[0][row] - less.pulls[0][row]) / (2.0 * h) * (2.0 / 3.0);
                    let told = sums(tag_m, measured_m, 0.01).moments[0][row][axis];
                    prop_assert!((slope - told).abs() < 1e-3 * (1.0 + told.abs()), "{row} {axis}: {slope} {told}");
                }
            }
        }
    }
}
