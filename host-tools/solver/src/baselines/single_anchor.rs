//! SA: tracking in the plane from odometry and ranges to one anchor.

use nalgebra::Vector3;

use super::fixed_lag::FixedLag;
use super::homing::Homing;
use crate::navigation::{
    Command, Estimate, FirstGuess, InputFault, InputGate, InsSample, Navigator, Phase, RangeSample,
};

/// Settings of [`SingleAnchor`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingleAnchorOptions {
    /// Standard deviation of the start, each axis, metres.
    pub start_sigma_m: f64,
    /// How far odometry strays, each axis, m/sqrt(s).
    pub odometry_random_walk: f64,
    /// Standard deviation of a range, metres.
    pub range_sigma_m: f64,
    /// Standard deviation of the height above the anchor, metres: reported, not estimated.
    pub height_sigma_m: f64,
    /// Ranges in the window that is optimised.
    pub window: usize,
}

impl Default for SingleAnchorOptions {
    /// A start known to 5 cm, odometry that strays 5 cm in a second, ranges to 10 cm, and a window
    /// of 5 s at ten ranges a second.
    fn default() -> Self {
        Self {
            start_sigma_m: 0.05,
            odometry_random_walk: 0.05,
            range_sigma_m: 0.1,
            height_sigma_m: 0.1,
            window: 50,
        }
    }
}

/// Tracks the vehicle in the plane around an anchor, the tag, whose place relative to the vehicle
/// is known at the start.
///
/// *Stated* (see [`super`]): tracking in two dimensions, odometry fused with ranges to one anchor
/// by optimisation, perfect start. *Chosen*: least squares over a sliding window, whose older part
/// is marginalised; horizontal motion of dead reckoning as odometry, with errors that are
/// independent from step to step; the height above the anchor taken as exact from the start and
/// dead reckoning's barometer, so that a range counts for its horizontal part; no robust kernel.
/// What makes it weak stays in: a straight approach measures only along the line of sight.
#[derive(Debug, Clone)]
pub struct SingleAnchor {
    options: SingleAnchorOptions,
    start: FirstGuess,
    gate: InputGate,
    path: Option<FixedLag>,
    /// Dead reckoning at the newest range.
    at_range: Option<InsSample>,
    homing: Homing,
    updates: u64,
}

impl SingleAnchor {
    /// With the tag where `start` says: its true place, as the method's definition demands.
    pub fn new(start: FirstGuess, options: SingleAnchorOptions) -> Self {
        Self {
            options,
            start,
            gate: InputGate::default(),
            path: None,
            at_range: None,
            homing: Homing::new(),
            updates: 0,
        }
    }

    /// Tag minus vehicle at a reading of dead reckoning, metres.
    fn relative_m(&self, now: InsSample) -> Vector3<f64> {
        match (&self.path, self.at_range) {
            (Some(path), Some(at_range)) => {
                let since = (now.position_m - at_range.position_m).xy();
                let offset = path.offset_m() + since;
                let height = self.start.tag_m.z - now.position_m.z;
                Vector3::new(-offset.x, -offset.y, height)
            }
            _ => self.start.tag_m - now.position_m,
        }
    }

    fn steer(&mut self) {
        if let Some(now) = self.gate.last_ins() {
            self.homing.steer(now.position_m, self.relative_m(now));
        }
    }
}

impl Navigator for SingleAnchor {
    fn on_ins(&mut self, sample: InsSample) -> Result<(), InputFault> {
        self.gate.admit_ins(sample)?;
        if self.path.is_none() {
            let offset_m = (sample.position_m - self.start.tag_m).xy();
            let options = &self.options;
            self.path = Some(FixedLag::new(
                offset_m,
                options.start_sigma_m,
                options.range_sigma_m,
                options.window,
            ));
            self.at_range = Some(sample);
            self.steer();
        }
        Ok(())
    }

    fn on_range(&mut self, sample: RangeSample) -> Result<(), InputFault> {
        self.gate.admit_range(sample)?;
        let (Some(now), Some(before), Some(path)) =
            (self.gate.last_ins(), self.at_range, &mut self.path)
        else {
            return Ok(());
        };
        let step_m = (now.position_m - before.position_m).xy();
        // Two ranges with one reading of dead reckoning: some time has passed all the same.
        let dt_s = (now.t_s - before.t_s).max(1e-3);
        let variance = self.options.odometry_random_walk.powi(2) * dt_s;
        let height_m = now.position_m.z - self.start.tag_m.z;
        if path.push(step_m, variance, height_m, sample.range_m) {
            self.at_range = Some(now);
            self.updates += 1;
        }
        self.steer();
        Ok(())
    }

    fn on_arrival(&mut self, command_id: u32) {
        if let Some(estimate) = self.estimate() {
            self.homing.on_arrival(command_id, estimate.tag_m);
        }
    }

    fn command(&self) -> Command {
        self.homing.command()
    }

    fn estimate(&self) -> Option<Estimate> {
        let now = self.gate.last_ins()?;
        let mut covariance = nalgebra::Matrix3::zeros();
        covariance
            .fixed_view_mut::<2, 2>(0, 0)
            .copy_from(&self.path.as_ref()?.covariance_m2());
        covariance[(2, 2)] = self.options.height_sigma_m.powi(2);
        Some(Estimate {
            t_s: now.t_s,
            tag_m: now.position_m + self.relative_m(now),
            vehicle_m: now.position_m,
            relative_covariance_m2: Some(covariance),
            alternative_m: None,
            range_bias_m: None,
            range_sigma_m: Some(self.options.range_sigma_m),
            doubts: self.gate.doubts(),
        })
    }

    fn phase(&self) -> Phase {
        self.homing.phase()
    }

    fn updates(&self) -> u64 {
        self.updates
    }
}
