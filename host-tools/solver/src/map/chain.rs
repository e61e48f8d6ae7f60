//! One way along the chain of knots: linearise, add, eliminate, knot after knot.
//!
//! The equations stand in `hypothesis.rs`, the elimination in `elimination.rs`.

use super::elimination::{Array, Factor, KNOT, Last, eliminate};
use super::hypothesis::Hypothesis;
use super::likelihood::RangeLikelihood;
use super::noise::NoiseModel;
use super::range_sums::RangeSums;
use super::record::{Observation, Record};
use super::transition::Transition;
use nalgebra::Vector3;

/// How much of the bridge between two knots counts as noise of each range. Neighbours share most of it;
/// were it counted in full, as if they did not, ranges would seem to lack that noise and gusts be taken
/// for weaker: 0.090 m/sqrt(s) for 0.111, median of 100 flights, and 0.110 with half of it.
const BRIDGE: f64 = 0.5;
/// Distances below this bend no more than at it, metres.
const LEAST_DISTANCE_M: f64 = 0.1;

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

impl Hypothesis {
    /// Linearises and eliminates at the present state.
    pub(super) fn sweep(
        &self,
        record: &Record,
        noise: &NoiseModel,
        factors: &mut Vec<Factor>,
    ) -> Option<Sweep> {
        self.sweep_as(Manner::GaussNewton { damping: 0.0 }, record, noise, factors)
    }

    /// The same in this manner. `factors` is left ready for [`Hypothesis::step`].
    pub(super) fn sweep_as(
        &self,
        manner: Manner,
        record: &Record,
        noise: &NoiseModel,
        factors: &mut Vec<Factor>,
    ) -> Option<Sweep> {
        let mut chain = Chain::start(self, noise, manner);
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
            factors.push(Factor::zeros());
            chain.interval(self, record, noise, &step, k, factors.last_mut()?)?;
        }
        chain.finish()
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
fn interval_with_places(record: &Record, k: usize) -> impl Iterator<Item = (&Observation, f64)> {
    let times = record.knot_times_s();
    let (start, length) = (times[k], times[k + 1] - times[k]);
    record
        .of_interval(k)
        .iter()
        .map(move |o| (o, (o.t_s - start) / length))
}

/// How a sweep linearises.
#[derive(Debug, Clone, Copy)]
pub(super) enum Manner {
    /// Distances are taken for straight; this much information, 1/m^2, is added on each coordinate
    /// of the tag.
    GaussNewton { damping: f64 },
    /// With the curvature of the distances, `(I - u u^T) / distance` times the slope of the cost. It
    /// is what sets the sigma straight above the tag, where `u` has next to no horizontal part; the
    /// matrix need not be positive definite away from a minimum.
    Newton,
}

/// A sweep under way.
pub(super) struct Chain {
    curved: bool,
    likelihood: RangeLikelihood,
    /// Of the present knot, and of the one before; they take turns.
    arrays: [Array; 2],
    /// Whether the second is the present one.
    second: bool,
    pub(super) cost: f64,
    pub(super) log_determinant: f64,
    pub(super) log_weights: f64,
    outliers: f64,
}

impl Chain {
    pub(super) fn start(hypothesis: &Hypothesis, noise: &NoiseModel, manner: Manner) -> Self {
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
            likelihood: RangeLikelihood::new(noise.outlier_probability),
            arrays: [array, Array::zeros()],
            second: false,
            cost,
            log_determinant: spent.log_determinant,
            log_weights: spent.log_weights,
            outliers: 0.0,
        }
    }

    /// What is known of the present knot and the globals.
    pub(super) fn array(&self) -> &Array {
        let [first, second] = &self.arrays;
        if self.second { second } else { first }
    }

    /// Adds interval `k` and eliminates its first knot into `factor`.
    pub(super) fn interval(
        &mut self,
        hypothesis: &Hypothesis,
        record: &Record,
        noise: &NoiseModel,
        transition: &Transition,
        k: usize,
        factor: &mut Factor,
    ) -> Option<()> {
        let [first, second] = &mut self.arrays;
        let (here, next) = if self.second {
            (second, first)
        } else {
            (first, second)
        };
        *next = Array::zeros();
        let mut coupling = [[0.0; KNOT]; KNOT];
        let (x, next_x) = (hypothesis.knots.get(k)?, hypothesis.knots.get(k + 1)?);
        self.cost += transition.add(x, next_x, here, &mut coupling, next);
        self.log_weights += transition.log_determinant;

        let slack = hypothesis.slack_m * hypothesis.slack_m;
        // Between its knots a random walk is a Brownian bridge.
        let gusts = noise.ins.position_random_walk;
        let bridge = BRIDGE * gusts.powi(2) * transition.dt_s();
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
            let influence = self
                .likelihood
                .influence(r, observation.variance_m2(gusts) + unseen + slack);
            self.cost += influence.cost;
            self.outliers += 1.0 - influence.sound;
            let curvature = if self.curved {
                influence.slope / distance.max(LEAST_DISTANCE_M)
            } else {
                0.0
            };
            sums.add(u, s, &influence, curvature);
        }
        sums.spread(here, &mut coupling, next);

        self.log_determinant += eliminate(here, &coupling, next, factor)?;
        self.second = !self.second;
        Some(())
    }

    fn finish(self) -> Option<Sweep> {
        let last = self.array().solve()?;
        let log_determinant = self.log_determinant + last.log_determinant;
        self.cost.is_finite().then_some(Sweep {
            cost: self.cost,
            last,
            log_evidence: last.promised - self.cost + 0.5 * (self.log_weights - log_determinant),
            outliers: self.outliers,
        })
    }
}
