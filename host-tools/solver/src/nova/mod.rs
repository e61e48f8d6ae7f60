//! NOVA as the paper has it: "NOVA: Navigation Optimization via UWB-Assisted Iterative Path Planning
//! for UAV Delivery" (Ryoo, Yoo, Paek, Bahk). Names, equations and defaults are the paper's; what it
//! leaves open is decided in the module that needs it, under "Left open by the paper".
//!
//! | paper | here |
//! |---|---|
//! | Table II, parameters | [`Parameters`] |
//! | Table IV, ablation | [`Variant`], [`Switches`] |
//! | Sec. IV, Fig. 6: phases | [`NovaNavigator`] (`navigator.rs`) |
//! | Eq. 4, multilateration over dead reckoning | `multilateration.rs` |
//! | Eq. 8, DOP-based planning | [`Planner`] (`planner.rs`) |
//! | Sec. IV-C, alternation | [`JointOptimiser`] (`joint.rs`) |
//! | Eqs. 10-12, reliability-based moving average | `ema.rs` |
//! | its parameters by Bayesian optimisation | `tuning.rs`, [`crate::bayes_opt`] |
//! | Eq. 13, tag fit | `tag_fit.rs`, by Adam (`adam.rs`) |
//! | Eqs. 14-15, descent; circles | `descent.rs`, `circles.rs` |
//!
//! The method has no notion of covariance. The better navigator is another one; this one is here to
//! be compared with.

mod adam;
mod circles;
mod descent;
mod ema;
mod joint;
mod localiser;
mod multilateration;
mod navigator;
#[cfg(test)]
mod open_loop;
mod options;
mod parameters;
mod planner;
mod segment;
mod tag_fit;
mod tuning;
mod variants;

pub use ema::EmaParameters;
pub use joint::{JointFit, JointOptimiser};
pub use navigator::NovaNavigator;
pub use options::NovaOptions;
pub use parameters::Parameters;
pub use planner::{LambdaWeighs, Planner, Waypoint};
pub use segment::{Segment, SegmentRecorder};
pub use variants::{LocalisationMethod, Stride, Switches, Variant};
