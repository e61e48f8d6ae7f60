//! Why there is no answer.

use crate::measurement::MeasurementFault;

/// Why a solver refused its input. A weak geometry is not among these: it gives an answer that says
/// so.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// A measurement holds a number that cannot be meant.
    #[error("measurement {index}: {fault}")]
    BadMeasurement {
        /// Its place in the slice that was given, from 0.
        index: usize,
        /// What is wrong with it.
        fault: MeasurementFault,
    },
    /// There are fewer measurements than unknowns.
    #[error("{got} measurements cannot determine {unknowns} unknowns")]
    TooFewMeasurements {
        /// How many were given.
        got: usize,
        /// Coordinates, and the range bias if it is estimated.
        unknowns: usize,
    },
    /// An option is NaN, out of its range or contradicts another.
    #[error("option {name} is {why}")]
    BadOption {
        /// The option's name.
        name: &'static str,
        /// What is wrong with it.
        why: &'static str,
    },
    /// Every solution that fits the ranges lies outside the heights that were allowed.
    #[error("no solution within the given heights: the ranges put the node at {height_m:.2} m")]
    OutsideHeights {
        /// Height of the best solution.
        height_m: f64,
    },
    /// No point of finite cost was found. With validated input this does not happen; it is here so
    /// that nothing has to panic.
    #[error("the solver found no point of finite cost")]
    Diverged,
}
