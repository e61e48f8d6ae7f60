//! A robust fit whose scale is found along the way.
//!
//! A redescending kernel needs to know how large noise is: too small a scale makes it deaf to
//! everything but a chance few measurements, and far from the minimum every residual is large. So
//! the scale starts at the spread of the residuals seen from the start and shrinks with them
//! (graduated non-convexity in its simplest form), until it settles.

use crate::kernel::Kernel;
use crate::lm::{LeastSquares, LmOptions, minimise};
use crate::multilateration::Noise;
use crate::noise::{PRIOR_FREEDOM, robust_scale};
use crate::range_model::{NearlyNewton, RangeProblem, Sample, State, Unknowns};

/// Rounds of fit and re-scale. Each shrinks the scale by a factor of several while far away; a
/// handful is the rule.
const MAX_ROUNDS: u32 = 15;
/// The scale has settled once it changes by less than this part.
const SCALE_TOLERANCE: f64 = 0.02;

/// What stays the same between the fits of one solution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fitter<'a> {
    pub(crate) unknowns: &'a Unknowns,
    pub(crate) kernel: Kernel,
    pub(crate) noise: Noise,
}

/// A minimum.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    pub(crate) x: State,
    /// `1/2 sum rho` at that scale.
    pub(crate) cost: f64,
    /// Common factor on all sigmas at which the fit was made.
    pub(crate) scale: f64,
}

/// Enough while the scale is still on its way.
const COARSE: LmOptions = LmOptions {
    max_evaluations: 20,
    decrease_tolerance: 1e-2,
    initial_damping: 1e-4,
};
/// Enough to judge a rival. Where it is no good, the way down the flat flank of the kernel may be
/// long, and nobody wants to know its end.
const RIVAL: LmOptions = LmOptions {
    max_evaluations: 20,
    decrease_tolerance: 1e-6,
    initial_damping: 1e-4,
};
/// Given sigmas are used as they are once the residuals are no more than this many times larger.
const NEAR_GIVEN: f64 = 1.5;

impl Fitter<'_> {
    fn problem<'a>(
        &'a self,
        samples: &'a [Sample],
        scale: f64,
        prior_factor: f64,
    ) -> RangeProblem<'a> {
        RangeProblem {
            samples,
            unknowns: self.unknowns,
            kernel: self.kernel,
            scale,
            prior_factor,
        }
    }

    /// Minimum at a fixed scale.
    pub(crate) fn at_scale(
        &self,
        samples: &[Sample],
        start: State,
        scale: f64,
        prior_factor: f64,
    ) -> Fit {
        let problem = NearlyNewton(self.problem(samples, scale, prior_factor));
        let end = minimise(&problem, start, &LmOptions::default());
        Fit {
            x: end.x,
            cost: end.normal.cost,
            scale,
        }
    }

    /// Cost of a place at a fixed scale.
    pub(crate) fn cost(&self, samples: &[Sample], x: &State, scale: f64, prior_factor: f64) -> f64 {
        self.problem(samples, scale, prior_factor).linearise(x).cost
    }

    /// Minimum with the scale annealed down to that of the noise: the given one, or what the
    /// residuals say.
    pub(crate) fn annealed(&self, samples: &[Sample], start: State, scratch: &mut Vec<f64>) -> Fit {
        let (x, scale) = self.settle(samples, start, scratch);
        self.at_scale(samples, x, scale, 1.0)
    }

    /// Minimum at a fixed scale from a start that may be far from it: far at that scale, the pull
    /// of the kernel has faded. The way there is found with `few` of the samples.
    pub(crate) fn at_scale_from_afar(
        &self,
        samples: &[Sample],
        few: &[Sample],
        start: State,
        scale: f64,
        prior_factor: f64,
        scratch: &mut Vec<f64>,
    ) -> Fit {
        let (x, _) = self.settle(few, start, scratch);
        let problem = NearlyNewton(self.problem(samples, scale, prior_factor));
        let end = minimise(&problem, x, &RIVAL);
        Fit {
            x: end.x,
            cost: end.normal.cost,
            scale,
        }
    }

    /// A place near a minimum, and the scale of the residuals there.
    pub(crate) fn settle(
        &self,
        samples: &[Sample],
        start: State,
        scratch: &mut Vec<f64>,
    ) -> (State, f64) {
        let mut x = start;
        let mut scale = self.scale_at(samples, &x, scratch);
        for _ in 0..MAX_ROUNDS {
            x = minimise(&self.problem(samples, scale, 1.0), x, &COARSE).x;
            let next = self.scale_at(samples, &x, scratch);
            let settled = (next / scale - 1.0).abs() < SCALE_TOLERANCE
                || (self.noise == Noise::Given && next == 1.0);
            scale = next;
            if settled {
                break;
            }
        }
        (x, scale)
    }

    /// Scale of the residuals at `x`: where sigmas are given they are a lower bound, to be reached
    /// in the end; where they are estimated they are averaged in, so that few residuals that happen
    /// to agree are not taken for the best radio in the world.
    fn scale_at(&self, samples: &[Sample], x: &State, scratch: &mut Vec<f64>) -> f64 {
        scratch.clear();
        scratch.extend(samples.iter().map(|sample| sample.whitened(x)));
        let unknowns = self.unknowns.count();
        let seen = robust_scale(scratch, unknowns);
        match self.noise {
            Noise::Given if seen < NEAR_GIVEN => 1.0,
            Noise::Given => seen,
            Noise::Estimated => {
                let freedom = samples.len().saturating_sub(unknowns) as f64;
                ((PRIOR_FREEDOM + freedom * seen * seen) / (PRIOR_FREEDOM + freedom)).sqrt()
            }
        }
    }
}
