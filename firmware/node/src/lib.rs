//! A node: a DW1000 and the exchanges it takes part in.
//!
//! [`Node`] owns the radio and one of the state machines of `nova-ranging`,
//! and turns what happens into records of `nova-wire`. It has no executor, and
//! waits for the radio only while that starts: a board calls [`Node::service`]
//! whenever the radio's interrupt line is high or the time has come that the
//! last call named. The same code runs on the DWM1001, in tests and in simulations.
//!
//! ```text
//!   board's loop:  service(now) ──► wake at this time, or on interrupt
//!                     │
//!   node/          Node: deadlines, counters, records; playing.rs: its part in rounds
//!                     │ commands, events
//!   radio/         Radio: DW1000 registers, time stamps, late sends, recovery; setup.rs: its start
//!                     │ SPI: access.rs for what every frame needs, dw1000::ll for the rest
//!   bus.rs         RadioBus: what a board must provide
//!
//!   board's loop:  keeper.on_bytes(from the host)
//!                     │
//!   keeper.rs      Keeper: commands, answers
//!   store.rs       Store: settings in flash, whole or as they were
//!   settings.rs    from settings to the configuration
//!
//!   outbox.rs      Outbox: frames that wait for the line to the host
//! ```
#![no_std]

#[macro_use]
mod access;
mod bus;
mod config;
pub mod cost;
mod diagnostics;
mod judge;
mod keeper;
mod level;
mod node;
mod outbox;
mod peers;
mod phy;
mod radio;
mod settings;
mod setup;
mod sleep;
pub mod store;

pub use bus::{RadioBus, SpiBusWithSpeed, SpiSpeed};
pub use config::{AntennaDelay, ConfigError, NodeConfig, Part, SetAntennaDelay};
pub use keeper::{Keeper, Then};
pub use node::{Node, StartError};
pub use outbox::Outbox;
pub use peers::MAX_PEERS;
pub use radio::RadioError;

pub use nova_ranging::superframe::Sharing;

/// Two-way ranging itself: addresses, device time, failures.
pub use nova_ranging as ranging;
