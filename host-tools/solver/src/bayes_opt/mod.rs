//! Bayesian optimisation: the minimum of a function of a few variables in as few evaluations as
//! possible.
//!
//! 1. Evaluate the function at some points spread over the box ([`sequence`](self), and starts the
//!    caller knows).
//! 2. Describe what has been seen by a Gaussian process ([`GaussianProcess`]).
//! 3. Evaluate next where the process promises the largest [`expected_improvement`]; repeat.
//!
//! The process costs little beside what such an optimiser is usually for, but here the function
//! itself takes a microsecond, so the bookkeeping is made to match: one evaluation adds one row to
//! a Cholesky factor and one row to what is kept about a fixed set of candidates (`candidates.rs`);
//! nothing is factored again except when the length scales change, and nothing is allocated after
//! the first run.
//!
//! ```
//! use nalgebra::Vector2;
//! use nova_solver::bayes_opt::{BayesianMinimiser, MinimiserOptions, SearchBox};
//!
//! let bowl = |x: &Vector2<f64>| (x.x - 0.3).powi(2) + 2.0 * (x.y + 1.0).powi(2);
//! let search = SearchBox::new(Vector2::new(-2.0, -2.0), Vector2::new(2.0, 2.0))?;
//! let mut minimiser = BayesianMinimiser::new(MinimiserOptions::default());
//! let found = minimiser.minimise(&search, &[], bowl);
//! assert!(found.value < 0.01, "{found:?}");
//! # Ok::<(), nova_solver::bayes_opt::EmptyBox>(())
//! ```

mod candidates;
mod correlation;
mod improvement;
mod minimiser;
mod process;
mod search_box;
mod sequence;

pub use improvement::expected_improvement;
pub use minimiser::{BayesianMinimiser, MinimiserOptions, Minimum};
pub use process::{GaussianProcess, Prediction};
pub use search_box::{EmptyBox, SearchBox};
