//! Pictures of the landing platform, for judging who finds markers in them.
//!
//! ```text
//!   NestedMarker (what lies there) ─► Camera::render (perspective) ─► blur, motion ─► light, as electrons ─► bytes
//! ```
//!
//! Modelled: a pinhole camera, area sampling, a defocused lens, motion while the shutter is open, photons that are counted and
//! a sensor that adds noise to them, ground with texture. Not modelled: lens distortion, a rolling shutter, shadows, glare.

mod light;
mod marker;
mod render;

pub use light::Light;
pub use marker::NestedMarker;
pub use render::{Camera, Picture};
