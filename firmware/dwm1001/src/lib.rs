//! The DWM1001 board around `nova-node`: which pin does what, clocks, the tasks, the watchdog, and
//! what happens on a fault. The binaries `tag` and `anchor` differ only in the role they start with.
//!
//! ```text
//!   DW1000 IRQ ──► radio loop (app) ──records──► Outbox ──► UART task ──► P0.05, 1 Mbaud
//!                  ▲  │  │ └─► LEDs
//!                  │  │  └─► settings in flash
//!                  │  └─► watchdog
//!       commands ──┴── Pipe ◄── UART task ◄── P0.11
//! ```
//!
//! Modules without hardware in them compile, and are tested, on the host too.
#![cfg_attr(target_os = "none", no_std)]

pub mod crash;
pub mod identity;
pub mod progress;
pub mod pulse;

#[cfg(target_os = "none")]
mod app;
#[cfg(target_os = "none")]
mod fault;
#[cfg(target_os = "none")]
mod flash;
#[cfg(target_os = "none")]
mod leds;
#[cfg(target_os = "none")]
mod pins;
#[cfg(target_os = "none")]
mod radio;
#[cfg(target_os = "none")]
mod uart;
#[cfg(target_os = "none")]
mod watchdog;

// Where the log goes: into RAM, from where a debugger reads it.
#[cfg(target_os = "none")]
use defmt_rtt as _;

#[cfg(target_os = "none")]
pub use app::run;
#[cfg(target_os = "none")]
pub use nova_wire::Role;
