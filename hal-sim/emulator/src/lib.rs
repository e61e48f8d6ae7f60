//! An emulated DWM1001: an nRF52832 that runs the very firmware images that go onto boards, with hal-sim's DW1000 on
//! its pins, and several such boards in one air.
//!
//! ```text
//!  Emulation ── World of hal-sim: chips, air, faults
//!     └── Board ── processor core (rsemu_executor), memory map (bus)
//!           └── Soc ── peripherals, flash, PPI
//! ```
//! docs/emulator.md says what is modelled and what is not, and how to run it.

mod board;
mod bus;
mod emulation;
mod error;
pub mod gdb;
mod image;
mod log;
mod peer;
mod reply;
mod soc;
mod stack;
pub mod wiring;

pub use board::{Board, BoardConfig, BoardStats, ChipMemory, Halt};
pub use emulation::Emulation;
pub use error::{Access, EmulatorError, Refusal, Seconds, Trouble};
pub use image::{Image, StackRegion};
pub use log::LogLine;
pub use peer::{Peer, PeerRadio};
pub use reply::Replies;
pub use soc::{CPU_HZ, ChipIdentity, Cycles, FLASH_BYTES, RAM_BYTES, RAM_START, ResetReason};
pub use stack::StackUse;
