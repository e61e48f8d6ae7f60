//! What is known beforehand: at hand-over, and of knots no longer kept.

use super::chain::{Chain, Manner};
use super::elimination::{Array, Factor, GLOBAL, JOINT, KNOT};
use super::hypothesis::Hypothesis;
use super::record::Record;
use super::transition::Transition;
use nalgebra::Vector3;

/// What is known of the first knot and the globals beforehand: a quadratic about a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prior {
    pub(super) at: [f64; JOINT],
    information: [[f64; JOINT]; JOINT],
    gradient: [f64; JOINT],
    /// What marginalised knots contribute to cost and evidence.
    pub(super) spent: Spent,
}

/// Constants of a prior that stands for knots no longer kept.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Spent {
    pub(super) cost: f64,
    pub(super) log_determinant: f64,
    pub(super) log_weights: f64,
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
    pub(super) fn window(&mut self, along: Vector3<f64>, centre: f64, sigma_m: f64) {
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
    pub(super) fn add(&self, x: &[f64; KNOT], globals: &[f64; GLOBAL], array: &mut Array) -> f64 {
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

impl Hypothesis {
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
        let mut chain = Chain::start(self, noise, Manner::GaussNewton { damping: 0.0 });
        chain.interval(self, record, noise, &step, 0, &mut Factor::zeros())?;
        let mut prior = Prior {
            at: [0.0; JOINT],
            information: [[0.0; JOINT]; JOINT],
            gradient: [0.0; JOINT],
            spent: Spent {
                cost: chain.cost + 0.5 * chain.array().corner(),
                log_determinant: chain.log_determinant,
                log_weights: chain.log_weights,
            },
        };
        for (at, value) in prior.at.iter_mut().zip(next.iter().chain(&self.globals)) {
            *at = *value;
        }
        for i in 0..JOINT {
            prior.information[i].copy_from_slice(&chain.array().0[i][..JOINT]);
            prior.gradient[i] = chain.array().0[i][JOINT];
        }
        self.prior = prior;
        self.knots.remove(0);
        Some(())
    }
}
