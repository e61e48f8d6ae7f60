//! The air: frames in flight, what reaches whom, and when.
//!
//! A frame reaches every other antenna with the delay and the power of the straight path between the two boards at
//! the moment of its RMARKER. Multipath is reduced to one number, the extra loss of the first path.

mod faults;
mod frame;
mod link;
mod motion;

pub use faults::{Fault, FaultAction};
pub(crate) use frame::{FrameId, FramesInFlight, OutgoingFrame, Signal};
pub use link::{ChannelConfig, LinkEffect, Sensitivity};
pub use motion::{Motion, Position, distance_m};
