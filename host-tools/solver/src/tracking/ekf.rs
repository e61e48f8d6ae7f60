//! The paper's baseline: an extended Kalman filter of range, azimuth and elevation (eq. 8, 11) that
//! believes all of them.

use nalgebra::{RowVector3, Vector3};
use std::f64::consts::PI;

use super::graph::step_s;
use super::motion::Belief;
use super::sighting::{Sighting, SightingFault};
use super::tracker::{Counts, Tracker};
use super::update::scalar_update;
use crate::error::SolveError;

/// The filter.
#[derive(Debug, Clone)]
pub struct TargetEkf {
    belief: Belief,
    last_s: Option<f64>,
    density: f64,
    longest_gap_s: f64,
    counts: Counts,
}

impl TargetEkf {
    /// A filter that knows the prior of the first state, with this density of the target's
    /// acceleration, m^2/s^3.
    ///
    /// # Errors
    /// [`SolveError::BadOption`] where the prior or the density cannot be meant.
    pub fn new(prior: Belief, acceleration_density: f64) -> Result<Self, SolveError> {
        let bad = |name, why| Err(SolveError::BadOption { name, why });
        if !prior.is_sound() {
            return bad("prior", "not finite, or of negative variance");
        }
        if !(acceleration_density.is_finite() && acceleration_density >= 0.0) {
            return bad("acceleration_density", "negative or not finite");
        }
        Ok(Self {
            belief: prior,
            last_s: None,
            density: acceleration_density,
            longest_gap_s: 5.0,
            counts: Counts::default(),
        })
    }

    fn take(&mut self, sighting: &Sighting) -> Result<(), SightingFault> {
        sighting.check()?;
        let predicted = match self.last_s {
            None => self.belief,
            Some(last_s) => {
                let dt_s = step_s(sighting.t_s, last_s, self.longest_gap_s)?;
                self.belief.after(dt_s, self.density)
            }
        };
        let updated = corrected(&predicted, sighting);
        self.belief = if updated.is_sound() {
            updated
        } else {
            predicted
        };
        self.last_s = Some(sighting.t_s);
        Ok(())
    }
}

/// All readings linearised at the prediction. Their noises are independent, so one after the other is
/// all at once.
fn corrected(predicted: &Belief, sighting: &Sighting) -> Belief {
    let to_sensor = sighting.pose.to_sensor.to_rotation_matrix();
    let offset = predicted.position_m - sighting.pose.position_m;
    let seen = to_sensor * offset;
    let mut belief = *predicted;
    // With what earlier readings moved taken back: each is linearised at the prediction.
    let residual = |belief: &Belief, at_prediction: f64, slope: &RowVector3<f64>| {
        at_prediction - (slope * (belief.position_m - predicted.position_m)).x
    };
    let (distance, flat) = (seen.norm(), seen.x.hypot(seen.y));
    // Straight over or under the sensor an azimuth has no slope.
    if distance < 1e-3 || flat < 1e-3 * distance {
        return belief;
    }
    if let Some(range) = sighting.range {
        let slope = (offset / distance).transpose();
        let r = residual(&belief, range.range_m - distance, &slope);
        belief = scalar_update(&belief, r, &slope, range.sigma_m * range.sigma_m);
    }
    if let Some(bearing) = sighting.bearing {
        let (azimuth, elevation) = bearing.angles();
        let variance = bearing.sigma_rad * bearing.sigma_rad;
        let square = distance * distance;
        let in_global = |slope: Vector3<f64>| slope.transpose() * to_sensor.matrix();

        let slope = in_global(Vector3::new(-seen.y, seen.x, 0.0) / (flat * flat));
        let off = wrapped(azimuth - seen.y.atan2(seen.x));
        let r = residual(&belief, off, &slope);
        belief = scalar_update(&belief, r, &slope, variance);

        let slope = in_global(Vector3::new(
            -seen.x * seen.z / (square * flat),
            -seen.y * seen.z / (square * flat),
            flat / square,
        ));
        let r = residual(&belief, elevation - seen.z.atan2(flat), &slope);
        belief = scalar_update(&belief, r, &slope, variance);
    }
    belief
}

/// An angle between minus and plus half a turn.
fn wrapped(angle: f64) -> f64 {
    angle - 2.0 * PI * (angle / (2.0 * PI)).round()
}

impl Tracker for TargetEkf {
    fn observe(&mut self, sighting: &Sighting) -> Result<(), SightingFault> {
        let outcome = self.take(sighting);
        self.counts.note(&outcome);
        outcome
    }

    fn belief(&self) -> Belief {
        self.belief
    }

    fn counts(&self) -> Counts {
        self.counts
    }
}
