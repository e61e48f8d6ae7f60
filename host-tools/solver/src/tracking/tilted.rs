//! A sensor that is mounted a little askew: a tilt that is the same at every sighting and known only by
//! its standard deviation.
//!
//! A tilt `e` (rotation vector) turns the whole picture about the sensor: the target seems to be at
//! `p + e x (p - p_R)`. No number of sightings averages that out, unlike the attitude's noise in
//! [`SensorPose`](super::SensorPose), and a sensor that looks at its target all the time hardly
//! learns it. So it is taken along as doubt (Schmidt's consideration), as large as it would be for a
//! tracker that follows its bearings:
//!
//! ```text
//! P_pp + sigma^2 (|r|^2 I - r r')      r = p - p_R
//! ```
//!
//! The velocity's part, `e x dr/dt`, is left out: for a vehicle that follows `dr/dt` is small.

use nalgebra::{Matrix3, Vector3};

use super::motion::Belief;
use super::sighting::{Sighting, SightingFault};
use super::tracker::{Counts, Tracker};
use crate::error::SolveError;

/// A tracker whose sensor may be tilted.
#[derive(Debug, Clone)]
pub struct Tilted<T> {
    tracker: T,
    variance: f64,
    sensor_m: Option<Vector3<f64>>,
}

impl<T: Tracker> Tilted<T> {
    /// With this standard deviation of the tilt about each axis, radians.
    ///
    /// # Errors
    /// [`SolveError::BadOption`] where it is negative or not finite.
    pub fn new(tracker: T, sigma_rad: f64) -> Result<Self, SolveError> {
        if !(sigma_rad.is_finite() && sigma_rad >= 0.0) {
            return Err(SolveError::BadOption {
                name: "sigma_rad",
                why: "negative or not finite",
            });
        }
        Ok(Self {
            tracker,
            variance: sigma_rad * sigma_rad,
            sensor_m: None,
        })
    }
}

impl<T: Tracker> Tracker for Tilted<T> {
    fn observe(&mut self, sighting: &Sighting) -> Result<(), SightingFault> {
        self.tracker.observe(sighting)?;
        self.sensor_m = Some(sighting.pose.position_m);
        Ok(())
    }

    fn belief(&self) -> Belief {
        let mut belief = self.tracker.belief();
        if let Some(sensor_m) = self.sensor_m {
            let r = belief.position_m - sensor_m;
            belief.pp +=
                (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * self.variance;
        }
        belief
    }

    fn counts(&self) -> Counts {
        self.tracker.counts()
    }
}
