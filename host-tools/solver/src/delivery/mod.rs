//! A delivery from take-off to touchdown (Miranda et al., "Autonomous Navigation System for a Delivery Drone", Journal
//! of Control, Automation and Electrical Systems 33, 2022).
//!
//! ```text
//!   start, goal ► DeliveryFrame ► DeliveryPath ► VectorField ──► wanted velocity
//!                                                    ▲
//!   GPS, marker, UWB, velocities ► LandingFilter ────┴── place
//!                                                    │
//!   ages of the sensors, battery, fence ► Mission ───┴──► follow, hold, climb, release, return
//! ```
//!
//! Frame: the paper's inertial frame: its origin is the landing place, x points from the start to it, z up; metres.
//! Body: forward, left, up. Two filters stand behind one trait: [`EulerEkf`] is the paper's, [`ErrorStateFilter`] the one that is
//! better; [`Delayed`] lets either take measurements that come late.

mod circling;
mod delayed;
mod error_state;
mod euler_ekf;
mod field;
mod filter;
mod frame;
mod mission;
mod path;
mod single_tag;
mod spiral;

pub use circling::Circling;
pub use delayed::Delayed;
pub use error_state::{ErrorStateFilter, ErrorStateOptions};
pub use euler_ekf::{EulerEkf, EulerEkfOptions};
pub use field::{FieldOptions, VectorField};
pub use filter::{CameraMount, Input, LandingFilter, Measurement, Pose, Verdict};
pub use frame::DeliveryFrame;
pub use mission::{Mission, MissionOptions, Order, Situation, State, Trouble};
pub use path::{DeliveryPath, PathFault, Sector};
pub use single_tag::{SingleTag, SingleTagOptions};
pub use spiral::Spiral;
