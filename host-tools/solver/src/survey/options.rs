//! What can be chosen, and why there is no survey.

use super::track::TrackFault;
use crate::error::SolveError;
use crate::kernel::Kernel;
use crate::multilateration::Noise;

/// How to survey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurveyOptions {
    /// Standard deviation, in seconds, of what the lag is expected to be: zero. With 0 the clocks are
    /// taken to agree.
    pub lag_sigma_s: f64,
    /// Standard deviation of the slope about zero, in metres per metre. With 0 there is none.
    pub slope_sigma: f64,
    /// Expected range bias of an anchor, metres.
    pub bias_m: f64,
    /// Standard deviation of that, metres. With 0 it is taken as known.
    pub bias_sigma_m: f64,
    /// Standard deviation of the track's positions, metres; added to that of each range.
    pub track_sigma_m: f64,
    /// Ranges in a gap of the track longer than this are left out, seconds.
    pub max_gap_s: f64,
    /// Robust kernel.
    pub kernel: Kernel,
    /// Use of the given standard deviations.
    pub noise: Noise,
    /// Standard deviation of errors that do not average out, metres; see
    /// [`multilateration`](crate::multilateration).
    pub systematic_sigma_m: f64,
    /// Ranges further from the fit than this, in standard deviations, are set aside.
    pub reject_sigmas: f64,
}

impl Default for SurveyOptions {
    fn default() -> Self {
        Self {
            lag_sigma_s: 0.5,
            // APS011: some 0.3 m between 2 m and 60 m.
            slope_sigma: 0.005,
            bias_m: 0.0,
            bias_sigma_m: 0.3,
            track_sigma_m: 0.02,
            max_gap_s: 1.0,
            kernel: Kernel::default(),
            noise: Noise::Estimated,
            systematic_sigma_m: 0.05,
            reject_sigmas: 3.0,
        }
    }
}

impl SurveyOptions {
    /// Refuses what is NaN or negative.
    pub(super) fn check(&self) -> Result<(), SurveyError> {
        for (name, value) in [
            ("lag_sigma_s", self.lag_sigma_s),
            ("slope_sigma", self.slope_sigma),
            ("bias_sigma_m", self.bias_sigma_m),
            ("track_sigma_m", self.track_sigma_m),
            ("systematic_sigma_m", self.systematic_sigma_m),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(SurveyError::BadOption {
                    name,
                    why: "negative or not finite",
                });
            }
        }
        for (name, value) in [
            ("max_gap_s", self.max_gap_s),
            ("reject_sigmas", self.reject_sigmas),
        ] {
            if value.is_nan() || value <= 0.0 {
                return Err(SurveyError::BadOption {
                    name,
                    why: "not positive",
                });
            }
        }
        if !self.bias_m.is_finite() {
            return Err(SurveyError::BadOption {
                name: "bias_m",
                why: "not finite",
            });
        }
        if !self.kernel.is_valid() {
            return Err(SurveyError::BadOption {
                name: "kernel",
                why: "without a positive width",
            });
        }
        Ok(())
    }
}

/// Why there is no survey.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SurveyError {
    /// Nobody to survey.
    #[error("there are no anchors")]
    NoAnchors,
    /// The track cannot be used.
    #[error("the track: {0}")]
    Track(#[from] TrackFault),
    /// A range holds a number that cannot be meant.
    #[error("anchor {anchor}, range {index}: {why}")]
    BadRange {
        /// The anchor's place in the slice that was given, from 0.
        anchor: usize,
        /// The range's place among the anchor's, from 0.
        index: usize,
        /// What is wrong with it.
        why: &'static str,
    },
    /// Too few of an anchor's ranges were taken while the track was known.
    #[error(
        "anchor {anchor}: {got} of {given} ranges were taken while the track was known; {unknowns} \
         unknowns need more"
    )]
    TooFewRanges {
        /// The anchor's place in the slice that was given, from 0.
        anchor: usize,
        /// Ranges that could be used.
        got: usize,
        /// Ranges that were given.
        given: usize,
        /// Coordinates, bias and what is common.
        unknowns: usize,
    },
    /// The solver of a single anchor refused.
    #[error("anchor {anchor}: {error}")]
    Anchor {
        /// The anchor's place in the slice that was given, from 0.
        anchor: usize,
        /// Why.
        error: SolveError,
    },
    /// An option is NaN or out of its range.
    #[error("option {name} is {why}")]
    BadOption {
        /// Its name.
        name: &'static str,
        /// What is wrong with it.
        why: &'static str,
    },
    /// The equations cannot be solved; with checked input it does not happen.
    #[error("the equations are singular")]
    Singular,
}
