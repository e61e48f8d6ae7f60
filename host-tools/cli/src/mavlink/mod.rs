//! MAVLink 2 to and from an autopilot: bytes, units, frames and clocks.
//!
//! ```text
//!   link      bytes over UDP, TCP or a serial port
//!     │
//!   stream    frames: checked, numbered; what is lost, repeated or damaged is counted
//!     │
//!   inbound   messages ► readings in SI units, ENU        outbound  estimates ► messages
//!     │                                                      ▲
//!   vehicle   who is there, its clock, its track ────────────┘
//! ```
//!
//! `frames` holds every conversion of units and axes, and nothing else does any. `clock` relates the autopilot's
//! time to ours. Everything but `link` is pure: bytes and times in, values out.

pub(crate) mod clock;
pub(crate) mod frames;
pub(crate) mod inbound;
pub(crate) mod link;
pub(crate) mod outbound;
pub(crate) mod place;
pub(crate) mod stream;
pub(crate) mod vehicle;

pub(crate) use link::Link;
pub(crate) use place::MavPlace;
