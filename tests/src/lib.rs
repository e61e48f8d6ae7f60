//! What the tests across crates share: networks of simulated boards that run
//! the firmware's node, what their serial ports said, and scenarios from files.

mod emulated;
mod emulated_scenario;
mod network;
mod scenario;
pub mod soak;
mod vendor_responder;

pub mod fuzz;

pub use emulated::{EmulatedNetwork, FIRMWARE_VARIABLE, Firmware};
pub use network::{BoardLog, Network, NetworkError, anchor_polling, board_at};
pub use scenario::{Action, Board, BoardRole, Expectation, FrameFault, Link, Scenario};
pub use vendor_responder::VendorResponder;
