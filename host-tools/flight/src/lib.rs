//! Simulated flights: a vehicle with accelerometer, barometer and UWB radio, wind, and a navigator
//! that sees nothing but what these measure, in closed loop; one flight or thousands.
//!
//! Frames are local ENU in metres, times in seconds.
//!
//! Read from the top: [`Settings`] (what can be set), [`fly`] (one flight), [`run`] and [`Row`] (many).
//! Beneath are the [`Scene`], the closed loop and the parts it is made of: [`Vehicle`],
//! [`Autopilot`], [`Wind`], [`Imu`], [`Barometer`], [`UwbLink`]. [`SCurve`] and [`Positioning`] are
//! for flights whose path is given. [`vertiport`] is an experiment of its own: anchors surveyed from the
//! air, and GNSS, UWB and inertial sensor fused. [`tracking`] is another: a vehicle that follows a moving target.
//! [`camera`] draws pictures of the landing platform.

mod autopilot;
mod barometer;
pub mod camera;
mod closed_loop;
pub mod delivery;
mod error;
mod flight;
mod imu;
mod methods;
mod monte_carlo;
mod outcome;
mod path;
mod positioning;
mod recording;
mod replay;
mod scene;
mod settings;
mod slalom;
mod statistics;
mod streams;
pub mod tracking;
mod uwb;
mod vehicle;
pub mod vertiport;
mod wind;

pub use autopilot::Autopilot;
pub use barometer::Barometer;
pub use error::FlightError;
pub use flight::{Trial, begin, fly, fly_navigator, fly_recorded, fly_shown, fly_with};
pub use imu::Imu;
pub use methods::Method;
pub use monte_carlo::{Condition, run};
pub use outcome::FlightResult;
pub use path::{SCurve, SCurveShape};
pub use positioning::Positioning;
pub use recording::Recording;
pub use replay::replay;
pub use scene::Scene;
pub use settings::{FirstGuessQuality, LambdaWeighs, Pilot, Plan, Preset, Settings};
pub use statistics::Row;
pub use streams::trial_seed;
pub use uwb::{LinkBudget, RangeSource, UwbLink};
pub use vehicle::{Acceleration, Vehicle};
pub use wind::Wind;
