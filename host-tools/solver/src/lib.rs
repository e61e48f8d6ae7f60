//! Where is a node, given distances to places that were known? Pure maths: slices of measurements
//! in, an estimate with its doubt out; no I/O, no clock, no hidden randomness.
//!
//! ```
//! use nalgebra::Vector3;
//! use nova_solver::{MultilaterationOptions, RangeMeasurement, multilaterate};
//!
//! // A drone climbs and turns while it measures its distance to a tag on the ground.
//! let tag = Vector3::new(12.0, -5.0, 0.4);
//! let mut log = Vec::new();
//! for i in 0..200 {
//!     let t_s = 0.1 * f64::from(i);
//!     let climb_m = 2.0 + 0.3 * t_s;
//!     let position_m = Vector3::new(6.0 * (0.3 * t_s).cos(), 6.0 * (0.4 * t_s).sin(), climb_m);
//!     let range_m = (tag - position_m).norm();
//!     log.push(RangeMeasurement { t_s, position_m, range_m, sigma_m: 0.1 });
//! }
//! log[17].range_m += 300.0; // logs have such rows
//!
//! let found = multilaterate(&log, &MultilaterationOptions::default())?;
//! assert!((found.position_m - tag).norm() < 1e-6);
//! assert!(found.observable() && found.alternative.is_none());
//! assert_eq!((found.used, found.rejected), (199, 1));
//! # Ok::<(), nova_solver::SolveError>(())
//! ```
//!
//! Read from the top: [`measurement`] (what goes in), [`multilateration`] (the solution and what it
//! says about itself), then the tools it is made of: [`kernel`] and [`lm`] are general, [`dop`]
//! describes geometry alone. The equations stand beside the code and, in one piece, in
//! `docs/solver.md`.

pub mod baselines;
pub mod bayes_opt;
pub mod bound;
pub mod calibration;
pub mod delivery;
pub mod dop;
pub mod fusion;
pub mod geodesy;
pub mod ins;
pub mod ins_error;
pub mod kernel;
pub mod lm;
pub mod map;
pub mod measurement;
pub mod multilateration;
pub mod navigation;
pub mod nova;
pub mod positioning;
pub mod survey;
pub mod tracking;

mod ambiguity;
mod error;
mod geometry;
mod noise;
mod observability;
mod range_model;
mod robust_fit;
mod starts;

pub use error::SolveError;
pub use kernel::Kernel;
pub use measurement::RangeMeasurement;
pub use multilateration::{Localisation, MultilaterationOptions, multilaterate};
pub use observability::Observability;
