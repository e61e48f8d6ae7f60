//! What every navigator has in common: measurements in, commands and estimates out.
//!
//! A navigator finds a tag at rest from a vehicle that knows its own motion only from dead
//! reckoning, and flies it there. It sees nothing but what the vehicle measures: no clock of its own
//! and no truth. The same value runs in simulation, on a log and live.
//!
//! ```text
//!   InsSample ──┐               ┌── Command   (fly to this waypoint, land there)
//!   RangeSample ┼── Navigator ──┤
//!   arrival ────┘               └── Estimate  (where the tag is, how sure, what is doubtful)
//! ```
//!
//! # Frame
//! The navigation frame is local ENU in metres. It coincides with dead reckoning at hand-over and
//! stays where it was then, while dead reckoning drifts: a navigator that knows by how much says so
//! in [`Command::ins_error`].

mod command;
mod estimate;
mod gate;
mod sample;

pub use command::{Action, Command, InsError};
pub use estimate::{Doubts, Estimate, Phase, horizontal_sigma_m};
pub use gate::InputGate;
pub use sample::{FirstGuess, InputFault, InsSample, RangeSample};

/// Finds a tag and flies to it.
pub trait Navigator {
    /// A reading of the dead reckoning.
    ///
    /// # Errors
    /// [`InputFault`] where the reading cannot be used; the navigator is as it was before.
    fn on_ins(&mut self, sample: InsSample) -> Result<(), InputFault>;

    /// A measured distance between vehicle and tag.
    ///
    /// # Errors
    /// [`InputFault`] where the range cannot be used; the navigator is as it was before.
    fn on_range(&mut self, sample: RangeSample) -> Result<(), InputFault>;

    /// The autopilot has come to the waypoint of the command with this [`Command::id`]. News of an
    /// older command is ignored.
    fn on_arrival(&mut self, command_id: u32);

    /// What the vehicle should do now.
    fn command(&self) -> Command;

    /// What is believed now; `None` before there is anything to believe.
    fn estimate(&self) -> Option<Estimate>;

    /// Part of the flight.
    fn phase(&self) -> Phase;

    /// How often the estimate has been computed anew. A caller that measures computing time looks
    /// for calls during which this number grows.
    fn updates(&self) -> u64;
}
