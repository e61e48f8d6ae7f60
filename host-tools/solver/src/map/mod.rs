//! A navigator that beats the paper's: maximum a posteriori over the whole flight, several
//! explanations side by side, and a flight that makes them tell each other apart.
//!
//! ```text
//!                    ┌► Roughness ── noise of this range
//!   range, INS ──────┼► Record ───── all ranges, knots half a second apart
//!                    └► Hypotheses ─ explanations, best first
//!                           │  Hypothesis: tag, range bias, error of dead reckoning at each knot
//!                           │     sweep: linearise, eliminate along the chain (`elimination`)
//!                           │     Tuner: noise of dead reckoning that agrees with the evidence
//!                           ├► Mixture ─── below 15 m: the posterior as it is, for mean and covariance
//!                           ▼
//!                       guidance ─── exploration, glide, helix, landing
//!                           ▲
//!                       Planner ──── the shape that is expected to tell most (`forecast`)
//! ```
//!
//! Read [`MapNavigator`] first, then `hypothesis.rs` for the equations (`chain.rs` and
//! `refinement.rs` for how they are solved), `hypotheses.rs` for where
//! explanations come from, `mixture.rs` for the last metres, `guidance.rs` for the flight.
//!
//! # Known limit
//! While the tag's place is still ambiguous, dead reckoning's noise is too: a wrong place with noise
//! to match can explain the first twenty seconds as well as the right one does. With an accelerometer
//! that wanders twenty times as much as preset R's, one flight in a hundred or two is led astray;
//! `docs/nova.md` has the figures.

mod bend;
mod chain;
mod elimination;
mod forecast;
mod guidance;
mod height;
mod hypotheses;
mod hypothesis;
mod likelihood;
mod mixture;
mod navigator;
mod noise;
mod options;
mod planner;
mod prior;
mod range_sums;
mod record;
mod refinement;
mod roughness;
mod transition;
mod tuning;

pub use navigator::MapNavigator;
pub use noise::NoiseModel;
pub use options::{MapOptions, Plan};
