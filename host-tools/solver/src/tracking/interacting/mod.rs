//! A target that walks on, brakes and turns, and sight that is clear, sometimes wrong, and blocked for a
//! while: interacting models (Blom and Bar-Shalom, "The interacting multiple model algorithm for systems
//! with Markovian switching coefficients", 1988).
//!
//! ```text
//! five motions:  their beliefs are mixed by how likely one turns into another, then each moves on
//!     x
//! three sights:  each motion's belief is updated as each sight would have it
//!     |
//! likelihoods --> probabilities of motions and of sights; sights of one motion become one belief again
//! ```
//!
//! What a kernel cannot know: a bearing after ten that were blocked is most likely blocked too. The
//! smoothing of [`TargetGraph`](super::TargetGraph) does nothing for the newest state (docs/tracking.md),
//! so there is none here. The likelihood of a sight under a motion is Laplace's approximation about the
//! updated place,
//!
//! ```text
//! L = |R|^-1/2 |I + J P|^-1/2 exp(-1/2 |r|^2 - 1/2 |p' - p|^2_P)
//! ```
//!
//! which for readings that are linear over the doubt is that of the innovation.

mod motions;
mod options;
mod sights;

use nalgebra::{Matrix3, Vector3};

use super::factors::{Kernels, quadratic};
use super::graph::step_s;
use super::motion::Belief;
use super::sighting::{Sighting, SightingFault};
use super::tracker::{Counts, Tracker};
use super::update::update;
use crate::error::SolveError;
use crate::kernel::Kernel;

use motions::MOTIONS;
pub use options::InteractingOptions;
use sights::SIGHTS;

/// How often a reading is linearised anew where its update leads.
const ROUNDS: usize = 2;

const NO_KERNELS: Kernels = Kernels {
    range: Kernel::None,
    bearing: Kernel::None,
};

/// A target followed by interacting models. It takes nothing from the heap.
#[derive(Debug, Clone)]
pub struct InteractingTracker {
    options: InteractingOptions,
    beliefs: [Belief; MOTIONS],
    motions: [f64; MOTIONS],
    sights: [f64; SIGHTS],
    last_s: Option<f64>,
    counts: Counts,
}

impl InteractingTracker {
    /// A tracker that knows the prior of the first state; all motions begin as likely as they are in
    /// the long run.
    ///
    /// # Errors
    /// [`SolveError::BadOption`] where an option or the prior cannot be meant.
    pub fn new(prior: Belief, options: InteractingOptions) -> Result<Self, SolveError> {
        options.check()?;
        if !prior.is_sound() {
            return Err(SolveError::BadOption {
                name: "prior",
                why: "not finite, or of negative variance",
            });
        }
        Ok(Self {
            options,
            beliefs: [prior; MOTIONS],
            motions: motions::long_run(&options),
            sights: sights::long_run(&options),
            last_s: None,
            counts: Counts::default(),
        })
    }

    /// How likely sight is blocked at the last sighting.
    pub fn blocked(&self) -> f64 {
        self.sights[sights::BLOCKED]
    }

    /// How likely the target does not just walk on.
    pub fn manoeuvring(&self) -> f64 {
        1.0 - self.motions[motions::STEADY]
    }

    fn take(&mut self, sighting: &Sighting) -> Result<(), SightingFault> {
        sighting.check()?;
        let mut sights = self.sights;
        if let Some(last_s) = self.last_s {
            let dt_s = step_s(sighting.t_s, last_s, self.options.longest_gap_s)?;
            self.move_on(dt_s);
            sights = sights::after(&self.options, &sights, dt_s);
        }
        self.last_s = Some(sighting.t_s);
        self.weigh(sighting, &sights);
        Ok(())
    }

    /// Mixing and prediction.
    fn move_on(&mut self, dt_s: f64) {
        let o = &self.options;
        let mut mixed = self.beliefs;
        let mut likely = [0.0; MOTIONS];
        for (to, (mixed, likely)) in mixed.iter_mut().zip(&mut likely).enumerate() {
            let mut shares = self.motions;
            for (from, share) in shares.iter_mut().enumerate() {
                *share *= motions::turns_into(o, from, to, dt_s);
            }
            *likely = shares.iter().sum();
            *mixed = motions::moved(o, to, &merged(&self.beliefs, &shares), dt_s);
        }
        self.beliefs = mixed;
        self.motions = normalised(likely);
    }

    /// Update, and probabilities by likelihoods.
    fn weigh(&mut self, sighting: &Sighting, sights: &[f64; SIGHTS]) {
        let mut logs = [[f64::NEG_INFINITY; SIGHTS]; MOTIONS];
        let mut branches = self.beliefs.map(|belief| [belief; SIGHTS]);
        for (sight, likely) in sights.iter().enumerate() {
            let seen = sights::as_seen(&self.options, sighting, sight);
            for (motion, before) in self.beliefs.iter().enumerate() {
                let (after, log) = updated(before, &seen);
                branches[motion][sight] = after;
                logs[motion][sight] = log + (likely * self.motions[motion]).ln();
            }
        }
        let most = logs
            .iter()
            .flatten()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        // Numbers that leave the finite tell nothing.
        if !most.is_finite() {
            return;
        }
        let shares = logs.map(|row| row.map(|log| (log - most).exp()));
        for (motion, shares) in shares.iter().enumerate() {
            // A motion that is out of the question keeps its prediction: its shares may all be 0.
            if shares.iter().sum::<f64>() > 0.0 {
                self.beliefs[motion] = merged(&branches[motion], shares);
            }
        }
        self.motions = normalised(shares.map(|row| row.iter().sum()));
        self.sights = normalised(std::array::from_fn(|sight| {
            shares.iter().map(|row| row[sight]).sum()
        }));
    }
}

/// The belief after a sighting, and the logarithm of how likely that was.
fn updated(before: &Belief, seen: &sights::Seen) -> (Belief, f64) {
    let mut found = (*before, 0.0);
    for _ in 0..ROUNDS {
        let at = found.0.position_m;
        let told = quadratic(&seen.sighting, &at, &NO_KERNELS);
        let Some((after, told)) = update(before, &told, &at).map(|(after, pull)| {
            let widened = (Matrix3::identity() + told.information * before.pp).determinant();
            let strain = pull.innovation.dot(&(before.pp * pull.innovation));
            (after, 0.5 * widened.ln() + 0.5 * strain)
        }) else {
            return (*before, f64::NEG_INFINITY);
        };
        found = (after, told);
    }
    let misfit = quadratic(&seen.sighting, &found.0.position_m, &NO_KERNELS).cost;
    (found.0, seen.log_scale - found.1 - misfit)
}

/// One belief of the mean and covariance of several. With shares of nothing it is the first.
fn merged<const N: usize>(beliefs: &[Belief; N], shares: &[f64; N]) -> Belief {
    let shares = normalised(*shares);
    let each = || beliefs.iter().zip(shares);
    let mean = |part: fn(&Belief) -> Vector3<f64>| -> Vector3<f64> {
        each().map(|(belief, share)| part(belief) * share).sum()
    };
    let mut whole = Belief {
        position_m: mean(|b| b.position_m),
        velocity_m_s: mean(|b| b.velocity_m_s),
        pp: Matrix3::zeros(),
        pv: Matrix3::zeros(),
        vv: Matrix3::zeros(),
    };
    for (belief, share) in each() {
        let p = belief.position_m - whole.position_m;
        let v = belief.velocity_m_s - whole.velocity_m_s;
        whole.pp += (belief.pp + p * p.transpose()) * share;
        whole.pv += (belief.pv + p * v.transpose()) * share;
        whole.vv += (belief.vv + v * v.transpose()) * share;
    }
    whole
}

/// With a sum of 1; where there is no sum, the first is certain.
fn normalised<const N: usize>(mut shares: [f64; N]) -> [f64; N] {
    let sum: f64 = shares.iter().sum();
    if sum > 0.0 && sum.is_finite() {
        shares.iter_mut().for_each(|share| *share /= sum);
    } else {
        shares = std::array::from_fn(|i| if i == 0 { 1.0 } else { 0.0 });
    }
    shares
}

impl Tracker for InteractingTracker {
    fn observe(&mut self, sighting: &Sighting) -> Result<(), SightingFault> {
        let outcome = self.take(sighting);
        self.counts.note(&outcome);
        outcome
    }

    fn belief(&self) -> Belief {
        merged(&self.beliefs, &self.motions)
    }

    fn counts(&self) -> Counts {
        self.counts
    }
}
