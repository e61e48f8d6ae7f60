//! Antenna delays from ranges at known distances.
//!
//! A range between two nodes whose delays are not what their firmware takes them for is wrong by a
//! constant, and each node brings its part of that:
//!
//! ```text
//! range_ij = distance_ij + offset_i + offset_j + bias(power) + noise
//! ```
//!
//! Two-way ranging sees a node's delays of sending and receiving as their sum only: a sum that is
//! `e` ticks larger than the firmware takes it for gives `offset = c e / (2 f)`, 2.345 mm a tick
//! ([`offset_per_tick_m`]). From the ranges between all nodes the offsets follow jointly:
//!
//! ```text
//!                  r_k - d_k - o_i - o_j                 o_i
//! minimise  sum ( ----------------------- )^2  +  sum ( ----- )^2          robust in k
//!            k            sigma_k                  i      s_i
//! ```
//!
//! `r_k` is the robust mean of one pair's ranges (`pair`), taken less their bias where a table of
//! it is at hand ([`RangeBias`]); `sigma_k` holds their noise, the
//! distance's error, and what does not average out. `s_i` is how far a node may be off before it is
//! calibrated. It hardly counts where the ranges tell, and says how little they tell where not:
//! the pairs see sums, and sums along pairs give single offsets only around a ring of an odd
//! number of pairs, or beside a node that is known ([`Determined`]). Two nodes share what they are
//! off in halves, each as doubtful as before; their sum is as sharp as its distance.
//!
//! APS014, the vendor's method, searches the same minimum for three nodes among random candidates.
//! It is linear: one solution of the normal equations finds it, for any number of nodes, with its
//! covariance.

mod bias;
mod graph;
mod network;
mod pair;

pub use bias::RangeBias;
pub use graph::Determined;
pub use network::{Calibration, NodePrior, Pair, PairFit, calibrate};
pub use pair::RobustMean;

use crate::kernel::{HUBER_95, Kernel};

/// What can be chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationOptions {
    /// Standard deviation of what does not average out of a pair's mean, in metres: reflections,
    /// bias with receive power that was not corrected.
    pub systematic_sigma_m: f64,
    /// For ranges about their mean, and for means about the solution. The first bears many outliers;
    /// the second needs more pairs than nodes.
    pub kernel: Kernel,
}

impl Default for CalibrationOptions {
    fn default() -> Self {
        Self {
            systematic_sigma_m: 0.02,
            kernel: Kernel::Huber { k: HUBER_95 },
        }
    }
}

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// There is no pair to learn from.
    #[error("there are no ranges at a known distance")]
    NoPairs,
    /// A pair names a node that does not exist, or one node twice.
    #[error("pair {pair} is not one of two different nodes of {nodes}")]
    BadPair {
        /// Its place in the slice that was given, from 0.
        pair: usize,
        /// How many nodes there are.
        nodes: usize,
    },
    /// A number that cannot be meant.
    #[error("pair {pair}: {what}")]
    BadMeasurement {
        /// Its place in the slice that was given, from 0.
        pair: usize,
        /// What is wrong with it.
        what: &'static str,
    },
    /// A pair has too few ranges for a mean whose doubt is known.
    #[error("pair {pair} has {got} ranges; {needed} are needed")]
    TooFewRanges {
        /// Its place in the slice that was given, from 0.
        pair: usize,
        /// How many it has.
        got: usize,
        /// How many it needs.
        needed: usize,
    },
    /// A node's prior, or an option, is not a positive finite number.
    #[error("{name} is not a number of metres that can be meant")]
    BadOption {
        /// What it is called.
        name: &'static str,
    },
    /// The equations cannot be solved; priors of very different size may do that.
    #[error("the equations are singular")]
    Singular,
}

/// Metres of range that one tick of error in the sum of a node's antenna delays makes: the signal
/// goes there and back in what is counted, hence the 2. Speed in m/s, clock in Hz.
pub fn offset_per_tick_m(speed_m_per_s: f64, clock_hz: f64) -> f64 {
    speed_m_per_s / (2.0 * clock_hz)
}
