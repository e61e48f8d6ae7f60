//! What a tracking flight is like, read from a file: see host-tools/scenes for the format.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::path::Motion;
use crate::error::FlightError;

/// A scene: who moves how, what is measured how well, and what is asked of the controller.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackingScene {
    /// What it shows.
    pub title: String,
    /// Where it is from.
    #[serde(default)]
    pub source: Option<String>,
    /// Sightings, and commands, a second.
    #[serde(default = "rate_hz")]
    pub rate_hz: f64,
    /// How long it takes.
    pub duration_s: f64,
    /// The target's motion.
    pub target: Motion,
    /// Who follows.
    #[serde(default)]
    pub vehicle: Vehicle,
    /// What is measured.
    #[serde(default)]
    pub sensor: Sensor,
    /// What trackers believe of the target.
    #[serde(default)]
    pub tracker: TrackerSettings,
    /// What is asked of the controller. Without it the vehicle flies on the path that `vehicle` says,
    /// whatever the tracker finds.
    #[serde(default)]
    pub standoff: Option<Standoff>,
}

/// The vehicle that carries the sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Vehicle {
    /// Where it begins, metres from the global origin.
    pub start_m: [f64; 3],
    /// Its velocity where no controller moves it, and at the start.
    pub velocity_m_s: [f64; 3],
    /// The most it can accelerate along each axis.
    pub acceleration: f64,
    /// The most it can move along each axis.
    pub speed: f64,
}

impl Default for Vehicle {
    fn default() -> Self {
        Self {
            start_m: [0.0; 3],
            velocity_m_s: [0.0; 3],
            acceleration: 4.0,
            speed: 4.0,
        }
    }
}

/// Range and bearing and what is wrong with them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sensor {
    /// Noise of ranges.
    pub range_sigma_m: f64,
    /// Noise of azimuth and elevation.
    pub bearing_sigma_deg: f64,
    /// Noise of those bearings that are outliers.
    pub outlier_sigma_deg: f64,
    /// The part of bearings that are outliers: one number for each condition that is compared.
    pub outlier_probability: Vec<f64>,
    /// How far the attitude that is reported is off, each axis; trackers are told.
    pub attitude_sigma_deg: f64,
    /// How far the sensor is mounted askew, each axis: the same over a whole flight.
    pub tilt_sigma_deg: f64,
    /// Parts of sightings that lack their range, and their bearing.
    pub loss: [f64; 2],
    /// Times of worse readings, which the sensor knows and reports.
    pub degraded: Vec<Degraded>,
    /// Times of blocked sight, which it does not know.
    pub blocked: Vec<Interval>,
    /// Walls that block sight, and the way, each from x, y to x, y.
    pub walls_m: Vec<[f64; 4]>,
    /// What blocked sight does to readings.
    pub nlos: Nlos,
}

impl Default for Sensor {
    fn default() -> Self {
        Self {
            range_sigma_m: 0.05,
            bearing_sigma_deg: 3.0,
            outlier_sigma_deg: 25.0,
            outlier_probability: vec![0.0],
            attitude_sigma_deg: 0.0,
            tilt_sigma_deg: 0.0,
            loss: [0.0; 2],
            degraded: Vec::new(),
            blocked: Vec::new(),
            walls_m: Vec::new(),
            nlos: Nlos::default(),
        }
    }
}

/// From when till when.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interval {
    /// Seconds.
    pub from_s: f64,
    /// Seconds.
    pub to_s: f64,
}

impl Interval {
    pub(super) fn holds(&self, t_s: f64) -> bool {
        t_s >= self.from_s && t_s < self.to_s
    }
}

/// Worse readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Degraded {
    /// Seconds.
    pub from_s: f64,
    /// Seconds.
    pub to_s: f64,
    /// All noises are so many times as large.
    pub factor: f64,
}

/// Readings without sight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Nlos {
    /// Mean of the exponential distance that is added.
    pub extra_m: f64,
    /// Noise of the bearing.
    pub bearing_sigma_deg: f64,
    /// Part of readings that do not come at all.
    pub loss: f64,
}

impl Default for Nlos {
    fn default() -> Self {
        Self {
            extra_m: 0.4,
            bearing_sigma_deg: 25.0,
            loss: 0.2,
        }
    }
}

/// What trackers believe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackerSettings {
    /// Spectral density of the target's acceleration, m^2/s^3.
    pub acceleration_density: f64,
    /// Doubt in the target's first place; its error is drawn from it.
    pub position_sigma_m: f64,
    /// Doubt in its first velocity; likewise.
    pub velocity_sigma_m_s: f64,
    /// Width of the bearing's Cauchy kernel, in sigmas.
    pub bearing_kernel: f64,
    /// Width of a Cauchy kernel of ranges; the paper has none.
    pub range_kernel: Option<f64>,
    /// States in the window.
    pub window: usize,
    /// Tilt of the sensor that is reckoned with.
    pub tilt_sigma_deg: f64,
    /// Whether `interacting` has models of motion; without, the target does what the density says.
    pub motions: bool,
    /// Whether `interacting` knows of blocked sight.
    pub blocked: bool,
}

impl Default for TrackerSettings {
    fn default() -> Self {
        Self {
            acceleration_density: 0.5,
            position_sigma_m: 0.3,
            velocity_sigma_m_s: 0.5,
            bearing_kernel: nova_solver::kernel::CAUCHY_95,
            range_kernel: None,
            window: 64,
            tilt_sigma_deg: 0.0,
            motions: true,
            blocked: true,
        }
    }
}

/// What is asked of the controller; names as in the paper's eq. 14, 35, 39.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Standoff {
    /// The distance wanted.
    pub standoff_m: f64,
    /// The least allowed.
    pub least_m: f64,
    /// The greatest allowed.
    pub most_m: f64,
    /// Gains of distance and radial speed.
    pub radial: [f64; 2],
    /// Gains of height and vertical speed.
    pub vertical: [f64; 2],
    /// Gain of the speed across the line of sight.
    pub tangential: f64,
    /// Rate of the barriers, 1/s.
    pub barrier_rate: f64,
    /// The most the target is believed to accelerate, m/s^2.
    pub target_acceleration: f64,
    /// Risk that the confidence radius is too small.
    pub risk: f64,
    /// How far the vehicle stays off the sensor's walls; without it the controller does not know them.
    pub wall_clearance_m: Option<f64>,
}

impl Default for Standoff {
    fn default() -> Self {
        let o = nova_solver::tracking::StandoffOptions::default();
        Self {
            standoff_m: o.standoff_m,
            least_m: o.least_m,
            most_m: o.most_m,
            radial: o.radial,
            vertical: o.vertical,
            tangential: o.tangential,
            barrier_rate: o.barrier_rate,
            target_acceleration: o.target_acceleration,
            risk: o.risk,
            wall_clearance_m: None,
        }
    }
}

fn rate_hz() -> f64 {
    20.0
}

impl TrackingScene {
    /// Whether all values can be meant.
    ///
    /// # Errors
    /// [`FlightError::Setting`] names the first that cannot.
    pub fn validate(&self) -> Result<(), FlightError> {
        let check = |name: &'static str, value: f64, fine: bool, wanted: &'static str| match fine {
            true => Ok(()),
            false => Err(FlightError::Setting {
                name,
                value,
                wanted,
            }),
        };
        let positive = |name, v: f64| check(name, v, v.is_finite() && v > 0.0, "above 0");
        let least_0 = |name, v: f64| check(name, v, v.is_finite() && v >= 0.0, "0 or more");
        let part = |name, v: f64| check(name, v, (0.0..=1.0).contains(&v), "between 0 and 1");
        let rate = (1.0..=1000.0).contains(&self.rate_hz);
        check("rate_hz", self.rate_hz, rate, "between 1 and 1000")?;
        let long = self.duration_s >= 1.0 / self.rate_hz && self.duration_s <= 36_000.0;
        check(
            "duration_s",
            self.duration_s,
            long,
            "between a step and 36000",
        )?;
        self.target.validate()?;
        for value in self
            .vehicle
            .start_m
            .iter()
            .chain(&self.vehicle.velocity_m_s)
        {
            check("vehicle", *value, value.is_finite(), "finite")?;
        }
        positive("vehicle.acceleration", self.vehicle.acceleration)?;
        positive("vehicle.speed", self.vehicle.speed)?;
        let s = &self.sensor;
        positive("sensor.range_sigma_m", s.range_sigma_m)?;
        positive("sensor.bearing_sigma_deg", s.bearing_sigma_deg)?;
        positive("sensor.outlier_sigma_deg", s.outlier_sigma_deg)?;
        least_0("sensor.attitude_sigma_deg", s.attitude_sigma_deg)?;
        least_0("sensor.tilt_sigma_deg", s.tilt_sigma_deg)?;
        let conditions = s.outlier_probability.len();
        let some = (1..=100).contains(&conditions);
        check(
            "sensor.outlier_probability",
            conditions as f64,
            some,
            "1 to 100 numbers",
        )?;
        for value in &s.outlier_probability {
            part("sensor.outlier_probability", *value)?;
        }
        for value in &s.loss {
            part("sensor.loss", *value)?;
        }
        for d in &s.degraded {
            positive("sensor.degraded.factor", d.factor)?;
            check(
                "sensor.degraded.to_s",
                d.to_s,
                d.to_s > d.from_s,
                "after from_s",
            )?;
        }
        for b in &s.blocked {
            check(
                "sensor.blocked.to_s",
                b.to_s,
                b.to_s > b.from_s,
                "after from_s",
            )?;
        }
        for value in s.walls_m.iter().flatten() {
            check("sensor.walls_m", *value, value.is_finite(), "finite")?;
        }
        least_0("sensor.nlos.extra_m", s.nlos.extra_m)?;
        positive("sensor.nlos.bearing_sigma_deg", s.nlos.bearing_sigma_deg)?;
        part("sensor.nlos.loss", s.nlos.loss)?;
        let t = &self.tracker;
        positive("tracker.acceleration_density", t.acceleration_density)?;
        positive("tracker.position_sigma_m", t.position_sigma_m)?;
        positive("tracker.velocity_sigma_m_s", t.velocity_sigma_m_s)?;
        positive("tracker.bearing_kernel", t.bearing_kernel)?;
        if let Some(width) = t.range_kernel {
            positive("tracker.range_kernel", width)?;
        }
        least_0("tracker.tilt_sigma_deg", t.tilt_sigma_deg)?;
        let window = (2..=100_000).contains(&t.window);
        check("tracker.window", t.window as f64, window, "2 to 100000")?;
        if let Some(o) = &self.standoff {
            positive("standoff.least_m", o.least_m)?;
            let wanted = "between least_m and most_m";
            let inside = o.least_m < o.standoff_m && o.standoff_m < o.most_m;
            check("standoff.standoff_m", o.standoff_m, inside, wanted)?;
            let bounded = o.most_m.is_finite();
            check("standoff.most_m", o.most_m, bounded, "finite")?;
            for gain in o.radial.iter().chain(&o.vertical).chain([&o.tangential]) {
                least_0("a gain of standoff", *gain)?;
            }
            positive("standoff.barrier_rate", o.barrier_rate)?;
            least_0("standoff.target_acceleration", o.target_acceleration)?;
            let risk = o.risk > 0.0 && o.risk < 1.0;
            check("standoff.risk", o.risk, risk, "between 0 and 1")?;
            if let Some(clearance) = o.wall_clearance_m {
                least_0("standoff.wall_clearance_m", clearance)?;
            }
            let start = (Vector3::from(self.vehicle.start_m) - self.target.start_m()).norm();
            let inside = start > o.least_m && start < o.most_m;
            check("the distance at the start", start, inside, wanted)?;
        }
        Ok(())
    }
}
