//! How a target's graph is built and solved.

use super::factors::Kernels;
use crate::error::SolveError;
use crate::kernel::{CAUCHY_95, Kernel};

/// Options of [`TargetGraph`](super::TargetGraph).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GraphOptions {
    /// Kernels of the readings.
    pub kernels: Kernels,
    /// Spectral density of the target's acceleration, m^2/s^3; the paper's `Sigma_T`.
    pub acceleration_density: f64,
    /// States that are kept; `None` keeps all.
    pub window: Option<usize>,
    /// A sighting is linearised again once its state has moved by more than this, metres.
    pub tolerance_m: f64,
    /// Gauss-Newton steps a sighting may take at most.
    pub rounds: usize,
    /// Kernels that begin wide at every sighting, if they do.
    pub graduation: Option<Graduation>,
    /// The longest time without a sighting that is bridged, seconds.
    pub longest_gap_s: f64,
}

/// Graduated non-convexity (Yang et al., "Graduated non-convexity for robust spatial perception", 2020):
/// the newest states are solved with kernels too wide to have more than one minimum, then narrower
/// and narrower ones, so that a state does not stay with the outlier it began at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Graduation {
    /// How many of the newest states.
    pub states: usize,
    /// The widest kernel is this many times as wide.
    pub widest: f64,
    /// Each next one is narrower by this factor.
    pub narrowing: f64,
}

impl Default for Graduation {
    fn default() -> Self {
        Self {
            states: 12,
            widest: 8.0,
            narrowing: 2.0,
        }
    }
}

impl GraphOptions {
    /// The paper's robust graph: Cauchy's kernel on bearings, none on ranges; a window of 64 states.
    pub fn robust() -> Self {
        Self {
            kernels: Kernels {
                range: Kernel::None,
                bearing: Kernel::Cauchy { c: CAUCHY_95 },
            },
            acceleration_density: 1.0,
            window: Some(64),
            tolerance_m: 1e-3,
            rounds: 6,
            graduation: None,
            longest_gap_s: 5.0,
        }
    }

    /// The paper's comparison: the same graph without a kernel.
    pub fn plain() -> Self {
        Self {
            kernels: Kernels {
                range: Kernel::None,
                bearing: Kernel::None,
            },
            ..Self::robust()
        }
    }

    /// Whether all of them can be meant.
    pub(crate) fn check(&self) -> Result<(), SolveError> {
        let bad = |name, why| Err(SolveError::BadOption { name, why });
        if !(self.kernels.range.is_valid() && self.kernels.bearing.is_valid()) {
            return bad("kernels", "not of a finite positive width");
        }
        if !(self.acceleration_density.is_finite() && self.acceleration_density >= 0.0) {
            return bad("acceleration_density", "negative or not finite");
        }
        if self.window.is_some_and(|window| window < 2) {
            return bad("window", "shorter than 2 states");
        }
        if !(self.tolerance_m.is_finite() && self.tolerance_m >= 0.0) {
            return bad("tolerance_m", "negative or not finite");
        }
        if self.rounds == 0 {
            return bad("rounds", "0");
        }
        if !(self.longest_gap_s.is_finite() && self.longest_gap_s > 0.0) {
            return bad("longest_gap_s", "not a positive finite number");
        }
        if let Some(graduation) = self.graduation
            && !(graduation.widest.is_finite()
                && graduation.widest >= 1.0
                && graduation.narrowing >= 1.1
                && graduation.states > 0)
        {
            return bad(
                "graduation",
                "without states, not wider, or hardly narrowing",
            );
        }
        Ok(())
    }
}
