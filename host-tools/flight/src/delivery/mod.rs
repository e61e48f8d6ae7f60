//! Simulated deliveries (Miranda et al. 2022): from take-off to touchdown, and back.
//!
//! ```text
//!   Craft (truth) ──► Sensors ──► LandingFilter ──► Mission, VectorField ──► wanted velocity ──► Craft
//! ```
//!
//! The filter, the mission and the field are those of [`nova_solver::delivery`] and see nothing but what the sensors say; feeling the
//! ground is one of them. [`Scenario`] says what can be set, [`deliver`] flies once, [`deliver_many`] often.
//! All that the filter is told goes through it as an [`Event`], which can be recorded; a [`Lander`] that is told them again says the same.
//!
//! Modelled: velocities reached with a lag and limited acceleration, gusts, tilt by acceleration, a mass that is believed; GPS with a bias of
//! its own each flight; velocities with an offset; a marker seen by a tilted camera within its view and its resolution, late;
//! ranges to anchors with biases, solved by `nova_solver::positioning`. Not modelled: ground effect, lens errors beyond a mount
//! that is turned a little, rotor dynamics.

mod craft;
mod flight;
mod lander;
mod listening;
mod many;
mod recording;
mod scenario;
mod sensors;

pub use flight::{DeliveryResult, Sample, deliver};
pub use lander::Lander;
pub use many::{DeliveryRow, deliver_many};
pub use recording::{
    AutopilotRecord, Begin, Estimate, Event, InputRecord, MarkerRecord, RecordFault, UwbRecord,
};
pub use scenario::{FilterKind, Scenario, ScenarioFault, UwbBy};
