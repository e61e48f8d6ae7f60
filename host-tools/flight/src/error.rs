//! What can be wrong with an order for flights.

/// Why a flight cannot be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FlightError {
    /// A setting has a value that means nothing.
    #[error("{name} is {value}, must be {wanted}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What values mean something.
        wanted: &'static str,
    },
    /// No such method, preset or other word.
    #[error("there is no {kind} `{word}`; there are {known}")]
    UnknownWord {
        /// What it should have named.
        kind: &'static str,
        /// The word.
        word: String,
        /// The words there are.
        known: String,
    },
    /// A part refuses its options.
    #[error(transparent)]
    Solver(#[from] nova_solver::SolveError),
}
