//! What the caller of [`multilaterate`](super::multilaterate) knows beforehand.

use nalgebra::Vector3;

use crate::error::SolveError;
use crate::kernel::Kernel;
use crate::measurement::LARGEST_LENGTH_M;

/// What is known about an error that all ranges share (antenna delays, mostly).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RangeBias {
    /// This much, in metres, is taken off every range.
    Known(f64),
    /// Estimated along with the position.
    Estimate {
        /// Expected value in metres.
        prior_m: f64,
        /// Standard deviation of that expectation in metres.
        prior_sigma_m: f64,
    },
}

/// What is known about the node's height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Height {
    /// Nothing: solve in three dimensions.
    Unknown,
    /// Exactly this, metres: solve in the horizontal plane.
    Known(f64),
    /// Within these bounds, metres, for instance below the flight. Chooses between mirror images;
    /// the solution itself is not pulled.
    Between {
        /// Lower bound.
        min_m: f64,
        /// Upper bound.
        max_m: f64,
    },
}

/// How far the given standard deviations are believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Noise {
    /// They are right, and the errors (outliers apart) are Gaussian and independent. For simulation
    /// and well-characterised sensors.
    Given,
    /// They tell how measurements compare with each other. Size, tails and time correlation come
    /// from the residuals; with only a handful of measurements the given size still counts.
    Estimated,
}

/// How to solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MultilaterationOptions {
    /// Start here instead of searching, metres. For updates of an earlier solution: a start in the
    /// basin of a wrong minimum stays there unless `seek_alternatives` finds the right one.
    pub initial_guess_m: Option<Vector3<f64>>,
    /// Common range error.
    pub bias: RangeBias,
    /// Robust kernel.
    pub kernel: Kernel,
    /// Use of the given standard deviations.
    pub noise: Noise,
    /// Standard deviation in metres of the errors that do not average out; see the module's text.
    /// Zero only where errors are known to be independent, as in a simulation.
    pub systematic_sigma_m: f64,
    /// Knowledge of the height.
    pub height: Height,
    /// Measurements further than this from the fit, in standard deviations, are set aside.
    pub reject_sigmas: f64,
    /// Look for mirror images. Costs about twice the fit; turn it off only where the answer is
    /// known already.
    pub seek_alternatives: bool,
}

impl Default for MultilaterationOptions {
    fn default() -> Self {
        Self {
            initial_guess_m: None,
            bias: RangeBias::Known(0.0),
            kernel: Kernel::default(),
            noise: Noise::Estimated,
            systematic_sigma_m: 0.05,
            height: Height::Unknown,
            reject_sigmas: 3.0,
            seek_alternatives: true,
        }
    }
}

impl MultilaterationOptions {
    /// Refuses what is NaN, out of range or contradicts itself.
    pub(super) fn check(&self) -> Result<(), SolveError> {
        let usable = |length: f64| length.abs() <= LARGEST_LENGTH_M;
        let refuse = |name, why| Err(SolveError::BadOption { name, why });
        if !self
            .initial_guess_m
            .is_none_or(|guess| guess.iter().copied().all(usable))
        {
            return refuse("initial_guess_m", "not finite");
        }
        match self.bias {
            RangeBias::Known(bias) if !usable(bias) => return refuse("bias", "not finite"),
            RangeBias::Estimate {
                prior_m,
                prior_sigma_m,
            } => {
                if !usable(prior_m) {
                    return refuse("bias", "not finite");
                }
                if !(prior_sigma_m > 0.0 && usable(prior_sigma_m)) {
                    return refuse("bias", "without a positive standard deviation");
                }
            }
            RangeBias::Known(_) => {}
        }
        match self.height {
            Height::Known(height) if !usable(height) => return refuse("height", "not finite"),
            Height::Between { min_m, max_m }
                if min_m.is_nan() || max_m.is_nan() || min_m > max_m =>
            {
                return refuse("height", "an empty interval");
            }
            _ => {}
        }
        if !self.kernel.is_valid() {
            return refuse("kernel", "without a positive width");
        }
        if !(self.systematic_sigma_m >= 0.0 && usable(self.systematic_sigma_m)) {
            return refuse("systematic_sigma_m", "negative or not finite");
        }
        if self.reject_sigmas.is_nan() || self.reject_sigmas <= 0.0 {
            return refuse("reject_sigmas", "not positive");
        }
        Ok(())
    }
}
