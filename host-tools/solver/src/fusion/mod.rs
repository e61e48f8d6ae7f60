//! GNSS, UWB and an inertial sensor together: where a vehicle is among buildings, where GNSS is metres
//! off.
//!
//! ```text
//!  IMU 100 Hz: specific force, attitude from its AHRS ──► predict ─┐
//!  GNSS 1-10 Hz: position, PDOP ──────────────────────► update ────┤► position, velocity, covariance
//!  UWB 10 Hz x n ─┬─ Loose: a position from >= 4 ranges ► update ──┤
//!                 └─ Tight: each range by itself ───────► update ──┘
//! ```
//!
//! [`Loose`] is Eq. 23-30 of Osaka and Tsujii (Sensors 2025, 25(24), 7419) with the parameters of their
//! Table 1. [`Tight`] is ours, and what they leave to future work: single ranges from any number of
//! anchors, the anchors' places and biases among the unknowns with what the survey knew of them, GNSS
//! with an error that hangs together in time, and blocked ranges judged as they come.
//!
//! Both take events in order of time. A measurement that is a little late is compared with where the
//! vehicle was then; see [`Timing`].

mod inertial;
mod loose;
mod tight;

pub use inertial::{Imu, ImuNoise};
pub use loose::{Loose, LooseOptions, uere_m};
pub use tight::{Fate, FusionAnchor, Tight, TightOptions};

use nalgebra::{Matrix3, Vector3};

use crate::measurement::LARGEST_LENGTH_M;
use crate::positioning::Power;

/// One reading of the inertial sensor, with the attitude its AHRS gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Seconds.
    pub t_s: f64,
    /// Specific force in the body frame, m/s^2: at rest, 9.8 up.
    pub force_m_s2: Vector3<f64>,
    /// Turns body vectors into ENU: `R_B^L` of Eq. 25.
    pub enu_from_body: Matrix3<f64>,
}

/// A position from GNSS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GnssFix {
    /// Seconds.
    pub t_s: f64,
    /// Antenna, in the local ENU frame, metres.
    pub position_m: Vector3<f64>,
    /// Position dilution of precision.
    pub pdop: f64,
}

/// A range to an anchor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UwbRange {
    /// Seconds.
    pub t_s: f64,
    /// The anchor's place among those given to the filter, from 0.
    pub anchor: usize,
    /// Metres.
    pub range_m: f64,
    /// Standard deviation in line of sight, metres.
    pub sigma_m: f64,
    /// Receive powers, where known: they tell a blocked path.
    pub power: Option<Power>,
}

/// Where antennas are on the vehicle, body frame, metres from the inertial sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeverArms {
    /// GNSS antenna.
    pub gnss_m: Vector3<f64>,
    /// UWB antenna.
    pub uwb_m: Vector3<f64>,
}

impl Default for LeverArms {
    fn default() -> Self {
        Self {
            gnss_m: Vector3::zeros(),
            uwb_m: Vector3::zeros(),
        }
    }
}

/// When a measurement was, beside the time of the filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Timing {
    /// So many seconds ago (0 or more): used, where the vehicle was then.
    Ago(f64),
    /// In the future of the inertial readings by so many seconds: the last reading is held.
    Ahead(f64),
    /// Too long ago, too far ahead, or no time at all.
    Refused,
}

/// Measurements older than this are refused, seconds.
pub const MAX_AGE_S: f64 = 0.5;
/// The last inertial reading is held so long, seconds.
pub const MAX_HOLD_S: f64 = 0.5;

/// Whether a number can be meant: beyond this, squares and sums would not stay finite.
fn usable(value: f64) -> bool {
    value.abs() <= LARGEST_LENGTH_M
}

/// Judges a measurement's time stamp.
pub fn timing(now_s: f64, t_s: f64) -> Timing {
    let age = now_s - t_s;
    if age.is_nan() || !(-MAX_HOLD_S..=MAX_AGE_S).contains(&age) {
        Timing::Refused
    } else if age >= 0.0 {
        Timing::Ago(age)
    } else {
        Timing::Ahead(-age)
    }
}

/// The estimate at a moment, local ENU frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Navigation {
    /// Seconds.
    pub t_s: f64,
    /// Inertial sensor, metres.
    pub position_m: Vector3<f64>,
    /// m/s.
    pub velocity: Vector3<f64>,
    /// Of the position, square metres.
    pub covariance_m2: Matrix3<f64>,
    /// Accelerometer bias, body frame, m/s^2.
    pub bias_m_s2: Vector3<f64>,
}
