//! What a navigator is fed with.

use crate::measurement::LARGEST_LENGTH_M;
use nalgebra::Vector3;

/// A reading of dead reckoning (paper Eq. 1): horizontal position from integrated acceleration,
/// height from the barometer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InsSample {
    /// Time, seconds.
    pub t_s: f64,
    /// Reckoned position, ENU, metres.
    pub position_m: Vector3<f64>,
}

/// A distance to the tag. It is signed: noise makes short ones negative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeSample {
    /// Time, seconds, same clock as [`InsSample::t_s`].
    pub t_s: f64,
    /// Measured distance, metres.
    pub range_m: f64,
}

/// Where the tag was said to be before any measurement: a telephone's GPS, an address.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstGuess {
    /// Said position, navigation frame, metres.
    pub tag_m: Vector3<f64>,
}

/// Why a measurement cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InputFault {
    /// A number is NaN, infinite or beyond [`LARGEST_LENGTH_M`].
    #[error("not a finite number of reasonable size")]
    NotFinite,
    /// Its time is not after that of the last one of its kind.
    #[error("time {t_s} s is not after {last_s} s")]
    TimeNotIncreasing {
        /// Its time.
        t_s: f64,
        /// Time of the last one.
        last_s: f64,
    },
    /// A range without a reading of dead reckoning within the last second before it.
    #[error("no dead reckoning within a second before the range at {t_s} s")]
    NoInsNearby {
        /// Time of the range.
        t_s: f64,
    },
}

impl InsSample {
    /// Checks that all numbers are finite.
    ///
    /// # Errors
    /// [`InputFault::NotFinite`].
    pub fn validate(&self) -> Result<(), InputFault> {
        finite(self.t_s)?;
        self.position_m
            .iter()
            .try_for_each(|&length| finite(length))
    }
}

impl RangeSample {
    /// Checks that all numbers are finite.
    ///
    /// # Errors
    /// [`InputFault::NotFinite`].
    pub fn validate(&self) -> Result<(), InputFault> {
        finite(self.t_s)?;
        finite(self.range_m)
    }
}

fn finite(number: f64) -> Result<(), InputFault> {
    // NaN fails every comparison.
    if number.abs() <= LARGEST_LENGTH_M {
        Ok(())
    } else {
        Err(InputFault::NotFinite)
    }
}
