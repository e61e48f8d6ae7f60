//! Simulated vehicles: where they fly and what they believe about it.
//!
//! Frames are local ENU in metres, times in seconds.

mod path;
mod positioning;

pub use path::{SCurve, SCurveShape};
pub use positioning::Positioning;
