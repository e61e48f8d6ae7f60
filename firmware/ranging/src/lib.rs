//! Two-way ranging as pure values: no radio, no executor, no clock of its own.
//!
//! Two nodes exchange four frames; each notes when the frames pass its antenna
//! on its own 63.8976 GHz clock; the six time stamps give the time of flight:
//!
//! ```text
//!  initiator  t1 ──poll──┐        ┌─► t4 ... t5 ──final──┐        ┌─► report
//!                        ▼        │                      ▼        │
//!  responder            t2 ... t3 ┘ response             t6 ──────┘
//! ```
//!
//! | module | what |
//! |---|---|
//! | [`time`] | 40-bit device time, wrap-safe intervals, the 512-tick grid of delayed transmissions |
//! | [`tof`] | time of flight and clock offset from the six stamps |
//! | [`frame`] | the bytes in the air |
//! | [`phy`] | modes of the radio, air times, how soon a frame can be answered |
//! | [`exchange`] | events, commands and outcomes common to both parts |
//! | [`initiator`], [`responder`] | the two state machines |
//!
//! Start reading at [`tof`], then [`initiator`].
#![no_std]

#[cfg(test)]
extern crate std;

pub mod exchange;
pub mod frame;
pub mod initiator;
pub mod phy;
pub mod responder;
pub mod time;
pub mod tof;

pub use exchange::{
    Command, Event, Failure, Ignored, Measurement, Outcome, Step, Then, Timing, When,
};
pub use frame::{Address, Frame, FrameBuffer, FrameError, Message, PanId};
pub use initiator::Initiator;
pub use phy::PhyProfile;
pub use responder::Responder;
pub use time::{DeviceTime, Ticks};
pub use tof::{Intervals, Stamps, TofError, TwoWay};
