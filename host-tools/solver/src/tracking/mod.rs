//! A moving target, followed by its range and bearing from a moving sensor; after Ping et al.,
//! "Uncertainty-aware single-anchor UWB 3-D UAV tracking", whose equations are cited by number.
//!
//! ```text
//! Sighting (range, bearing, sensor's pose) --> Tracker --> Belief (position, velocity, covariance)
//!                                              |- TargetGraph: robust or plain factor graph
//!                                              |- InteractingTracker: motions and sights that take turns
//!                                              `- TargetEkf: the baseline
//! ```
//!
//! Read [`sighting`] (what goes in), [`motion`] (what a belief is), [`factors`] (what a sighting tells) and
//! [`graph`] (how all of them together are solved). Figures are in docs/tracking.md.

pub mod control;
pub mod ekf;
pub mod factors;
pub mod graph;
pub mod interacting;
pub mod motion;
pub mod options;
pub mod sighting;
pub mod sphere;
pub mod tilted;
pub mod tracker;

mod update;

pub use control::{Guard, StandoffController, StandoffOptions, VehicleState};
pub use ekf::TargetEkf;
pub use factors::Kernels;
pub use graph::TargetGraph;
pub use interacting::{InteractingOptions, InteractingTracker};
pub use motion::Belief;
pub use options::{Graduation, GraphOptions};
pub use sighting::{Bearing, Range, SensorPose, Sighting, SightingFault};
pub use tilted::Tilted;
pub use tracker::{Counts, Tracker};
