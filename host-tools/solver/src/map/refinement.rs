//! How an explanation finds its minimum: Levenberg-Marquardt on the tag, shorter steps past it.

use super::chain::{Manner, Sweep};
use super::elimination::{Factor, GLOBAL, KNOT};
use super::hypothesis::Hypothesis;
use super::noise::NoiseModel;
use super::record::Record;
use nalgebra::Matrix3;

/// Slacks of an approach, metres, and the steps taken with each.
const SLACKS_M: [f64; 2] = [3.0, 0.4];
const STEPS_A_SLACK: u32 = 5;
/// Slices of a posterior: places and width, in standard deviations of it.
const SLICES: [f64; 7] = [-2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4];
const SLICE: f64 = 0.8;
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
/// Damping that changes neither covariance nor evidence, 1/m^2.
const NEGLIGIBLE_DAMPING: f64 = 1e-6;

impl Hypothesis {
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
}
