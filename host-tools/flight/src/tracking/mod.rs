//! A vehicle that follows a moving target by its range and bearing: simulated flights for the trackers and
//! controllers of [`nova_solver::tracking`].
//!
//! ```text
//! scene --> target's path ---> sensor --> tracker --> controller --> vehicle
//!                               ^                                      |
//!                               `--------------------------------------'
//! ```
//!
//! Truth goes into sensor and figures alone. A scene without a standoff has no controller: its vehicle
//! flies straight.

mod flight;
mod path;
mod row;
mod scene;
mod sensor;
mod words;

pub use flight::{TrackingMoment, TrackingResult, TrackingTrial, track};
pub use path::{Motion, Moving, Stage};
pub use row::{TrackingRow, track_many};
pub use scene::{
    Degraded, Interval, Nlos, Sensor, Standoff, TrackerSettings, TrackingScene, Vehicle,
};
pub use words::{Controller, Estimator};
