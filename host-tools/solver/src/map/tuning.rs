//! Noise that agrees with the innovations: coordinate ascent on the evidence.
//!
//! Range noise is measured ([`super::roughness`]); what is left is how dead reckoning errs.
//! The logarithm of the evidence (marginal likelihood) of a noise model, by Laplace's approximation,
//! is what a sweep gives along the way:
//!
//! ```text
//! ln p(ranges | noise) = -cost_min - 1/2 ln det H + 1/2 sum_k ln det Q_k^-1 + const
//! ```
//!
//! Each update tries one parameter a little larger or smaller, from the same linearisation, and
//! keeps what raises evidence times prior. The priors are broad log-normals about the data sheet,
//! so what the flight cannot tell stays where it was.

use super::elimination::Factor;
use super::hypothesis::Hypothesis;
use super::noise::NoiseModel;
use super::record::Record;

/// A parameter, the width of its log-normal prior (1 = a factor of e) and the range that makes sense.
struct Parameter {
    of: fn(&mut NoiseModel) -> &mut f64,
    width: f64,
    limits: std::ops::RangeInclusive<f64>,
}

const PARAMETERS: [Parameter; 4] = [
    Parameter {
        of: |n| &mut n.ins.position_random_walk,
        width: 2.5,
        limits: 1e-3..=0.5,
    },
    Parameter {
        of: |n| &mut n.ins.velocity_random_walk,
        width: 0.5,
        limits: 3e-3..=0.02,
    },
    Parameter {
        of: |n| &mut n.ins.acceleration_random_walk,
        width: 1.2,
        limits: 1e-5..=0.015,
    },
    Parameter {
        of: |n| &mut n.ins.height_random_walk,
        width: 0.5,
        limits: 1e-3..=0.1,
    },
];

/// Logarithmic step to begin with, and its limits.
const FIRST_STEP: f64 = 0.7;
const STEPS: std::ops::RangeInclusive<f64> = 0.1..=0.7;

/// Gusts that are tried now and then whatever the slope says: while they are far below what
/// accelerometer and ranges leave unsure, the evidence is flat, and no small step finds them. m/sqrt(s).
const LEAPS: [f64; 4] = [3e-3, 0.03, 0.1, 0.25];
/// One try in this many is a leap.
const LEAP_EVERY: usize = 5;

/// Prior of the outlier probability: one in this many.
const OUTLIER_PRIOR: f64 = 50.0;
/// Largest outlier probability that makes sense.
const MOST_OUTLIERS: f64 = 0.3;

/// Where the ascent stands.
#[derive(Debug, Clone)]
pub(super) struct Tuner {
    data_sheet: NoiseModel,
    noise: NoiseModel,
    tries: usize,
    /// Signed logarithmic step of each parameter.
    steps: [f64; PARAMETERS.len()],
}

impl Tuner {
    pub(super) fn new(data_sheet: NoiseModel) -> Self {
        Self {
            data_sheet,
            noise: data_sheet,
            tries: 0,
            steps: [FIRST_STEP; PARAMETERS.len()],
        }
    }

    /// The same prior, beginning elsewhere.
    pub(super) fn beginning_with(&self, change: fn(&mut NoiseModel)) -> Self {
        let mut tuner = Self::new(self.data_sheet);
        change(&mut tuner.noise);
        tuner
    }

    /// The same with another noise.
    pub(super) fn changed(&self, change: fn(&mut NoiseModel)) -> Self {
        let mut tuner = self.clone();
        change(&mut tuner.noise);
        tuner
    }

    /// The noise to believe in now.
    pub(super) fn noise(&self) -> &NoiseModel {
        &self.noise
    }

    /// Tries one change for an explanation that is at its minimum.
    pub(super) fn improve(
        &mut self,
        explanation: &Hypothesis,
        record: &Record,
        factors: &mut Vec<Factor>,
    ) {
        self.tries = self.tries.wrapping_add(1);
        if self.tries.is_multiple_of(LEAP_EVERY) {
            let mut candidate = self.noise;
            candidate.ins.position_random_walk = LEAPS[self.tries / LEAP_EVERY % LEAPS.len()];
            self.adopt_if_better(candidate, explanation, record, factors);
        } else {
            self.step(explanation, record, factors);
        }
        self.count_outliers(explanation.outliers(), record.observations().len());
    }

    /// One parameter a little larger or smaller.
    fn step(&mut self, explanation: &Hypothesis, record: &Record, factors: &mut Vec<Factor>) {
        let index = self.tries % PARAMETERS.len();
        let parameter = &PARAMETERS[index];
        let mut candidate = self.noise;
        let value = (parameter.of)(&mut candidate);
        *value = (*value * self.steps[index].exp())
            .clamp(*parameter.limits.start(), *parameter.limits.end());
        let size = match self.adopt_if_better(candidate, explanation, record, factors) {
            Some(true) => 1.5 * self.steps[index],
            Some(false) => -0.7 * self.steps[index],
            None => return,
        };
        self.steps[index] = size
            .abs()
            .clamp(*STEPS.start(), *STEPS.end())
            .copysign(size);
    }

    /// Whether evidence times prior rose; `None` where it cannot be computed.
    fn adopt_if_better(
        &mut self,
        candidate: NoiseModel,
        explanation: &Hypothesis,
        record: &Record,
        factors: &mut Vec<Factor>,
    ) -> Option<bool> {
        let then = explanation.sweep(record, &candidate, factors)?;
        let now = explanation.log_evidence() + self.log_prior();
        let better = then.log_evidence + self.log_prior_of(candidate) > now;
        if better {
            self.noise = candidate;
        }
        Some(better)
    }

    /// Expectation-maximisation with a beta prior.
    fn count_outliers(&mut self, outliers: f64, observations: usize) {
        let share = (1.0 + outliers) / (OUTLIER_PRIOR + observations as f64);
        self.noise.outlier_probability = share.min(MOST_OUTLIERS);
    }

    /// Logarithm of the prior of the present noise, up to a constant.
    pub(super) fn log_prior(&self) -> f64 {
        self.log_prior_of(self.noise)
    }

    fn log_prior_of(&self, mut noise: NoiseModel) -> f64 {
        let mut data_sheet = self.data_sheet;
        PARAMETERS
            .iter()
            .map(|parameter| {
                // Zero is kept at zero, and a limit keeps the logarithm finite.
                let least = *parameter.limits.start();
                let ratio = (parameter.of)(&mut noise).max(least)
                    / (parameter.of)(&mut data_sheet).max(least);
                let off = ratio.ln() / parameter.width;
                -0.5 * off * off
            })
            .sum()
    }
}
