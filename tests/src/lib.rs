//! What the tests across crates share: networks of simulated boards that run
//! the firmware's node, and what their serial ports said.

mod network;

pub use network::{BoardLog, Network, NetworkError};
