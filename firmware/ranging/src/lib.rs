//! Two-way ranging as pure values: no radio, no executor, no clock of its own.
//!
//! One initiator and up to eight responders exchange frames in a round; each notes when
//! the frames pass its antenna on its own 63.8976 GHz clock; six time stamps give the
//! time of flight between the initiator and one responder:
//!
//! ```text
//!  initiator    t1 ──poll──┐        ┌─► t4 ... t5 ──final──┐        ┌─► report
//!                          ▼        │                      ▼        │
//!  responder k            t2 ... t3 ┘ response             t6 ──────┘
//! ```
//!
//! | module | what |
//! |---|---|
//! | [`time`] | 40-bit device time, wrap-safe intervals, the 512-tick grid of delayed transmissions |
//! | [`tof`] | time of flight and clock offset from the six stamps |
//! | [`frame`] | the bytes in the air |
//! | [`phy`] | modes of the radio, air times, how soon a frame can be answered |
//! | [`timetable`] | when each frame of a round is due |
//! | [`exchange`] | events, commands and outcomes common to all parts |
//! | [`initiator`], [`responder`] | the two state machines of a round |
//! | [`superframe`] | who may talk when: several initiators in one air |
//! | [`nlos`] | whether the line of sight was blocked |
//! | [`filter`] | gates and a Kalman filter for the ranges to each peer |
//!
//! Start reading at [`tof`], then [`timetable`] and [`initiator`]. docs/air-protocol.md
//! shows the whole.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod exchange;
pub mod filter;
pub mod frame;
pub mod initiator;
pub mod nlos;
pub mod phy;
pub mod responder;
pub mod superframe;
pub mod time;
pub mod timetable;
pub mod tof;

pub use exchange::{Command, Event, Failure, Ignored, Measurement, Outcome, Step, Then, When};
pub use filter::{FilterBank, FilterSettings, RangeFilter};
pub use frame::{Address, Frame, FrameBuffer, FrameError, MAX_RESPONDERS, Message, PanId};
pub use initiator::Initiator;
pub use nlos::NlosRule;
pub use phy::PhyProfile;
pub use responder::Responder;
pub use time::{DeviceTime, Ticks};
pub use timetable::{Timetable, Timing};
pub use tof::{Intervals, Stamps, TofError, TwoWay};
