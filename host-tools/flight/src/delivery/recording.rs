//! What a landing filter is told and what it says, as records.
//!
//! ```text
//!   Begin ─► a filter      Input, Autopilot, Marker, Uwb ─► that filter ─► Estimate, one after each Input
//! ```
//!
//! Numbers come back from text as they were, and the filter does the same with the same numbers: estimates of a replay are those of the
//! flight, bit for bit.

use super::flight::Sample;
use super::scenario::FilterKind;
use nalgebra::{Quaternion, UnitQuaternion};
use nova_solver::delivery::{Measurement, Pose};
use serde::{Deserialize, Serialize};

/// A recorded quaternion's length is off by no more.
const LENGTH: f64 = 1e-6;

/// How the filter begins.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Begin {
    /// Which filter.
    pub filter: FilterKind,
    /// The autopilot's first place, metres.
    pub position_m: [f64; 3],
    /// The autopilot's first attitude: w, x, y, z, body to frame.
    pub attitude_wxyz: [f64; 4],
    /// First sigma of the GPS bias, metres.
    pub first_bias_sigma_m: f64,
}

/// What moves the state from `t_s` on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputRecord {
    /// Time, seconds.
    pub t_s: f64,
    /// Velocity in the frame of the delivery, m/s.
    pub velocity_m_s: [f64; 3],
    /// Turning rate along the body's axes, rad/s.
    pub rate_rad_s: [f64; 3],
}

/// The autopilot's pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AutopilotRecord {
    /// When it came, seconds.
    pub t_s: f64,
    /// When it was taken, as the filter is told, seconds.
    pub taken_s: f64,
    /// Metres.
    pub position_m: [f64; 3],
    /// w, x, y, z, body to frame.
    pub attitude_wxyz: [f64; 4],
}

/// The marker as the camera sees it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerRecord {
    /// When it came, seconds.
    pub t_s: f64,
    /// When it was taken, as the filter is told, seconds.
    pub taken_s: f64,
    /// In the camera's frame, metres.
    pub position_m: [f64; 3],
    /// w, x, y, z, marker to camera.
    pub attitude_wxyz: [f64; 4],
    /// Across the view and along it, metres.
    pub sigma_m: [f64; 2],
    /// About the marker's axes, radians.
    pub sigma_rad: [f64; 3],
}

/// A place from UWB.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UwbRecord {
    /// When it came, seconds.
    pub t_s: f64,
    /// When it was taken, as the filter is told, seconds.
    pub taken_s: f64,
    /// Metres.
    pub position_m: [f64; 3],
    /// Its covariance row by row, square metres: common viewers know no lists of lists.
    pub covariance_m2: [f64; 9],
}

/// What the filter says.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Estimate {
    /// Time, seconds.
    pub t_s: f64,
    /// Metres.
    pub position_m: [f64; 3],
    /// w, x, y, z, body to frame.
    pub attitude_wxyz: [f64; 4],
    /// Offset of the autopilot's place, metres.
    pub gps_bias_m: [f64; 3],
    /// Standard deviations of the position along x, y, z, metres.
    pub sigma_m: [f64; 3],
}

/// A record, in the order in which they happen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// The first.
    Begin(Begin),
    /// Velocity and turning rate, a hundred a second.
    Input(InputRecord),
    /// GPS.
    Autopilot(AutopilotRecord),
    /// Camera.
    Marker(MarkerRecord),
    /// Anchors.
    Uwb(UwbRecord),
    /// After each input.
    Estimate(Estimate),
    /// Truth beside estimate, ten a second; the filter sees nothing of it.
    Sample(Sample),
}

/// Why a record cannot be replayed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RecordFault {
    /// A turn that is none.
    #[error("at {t_s} s: the attitude's length is {length}, not 1")]
    NoAttitude {
        /// When, seconds.
        t_s: f64,
        /// Of the quaternion.
        length: f64,
    },
    /// Inputs are in order of time.
    #[error("at {t_s} s: an input of before {before_s} s; records have to be in order of time")]
    OutOfOrder {
        /// When, seconds.
        t_s: f64,
        /// The input before it, seconds.
        before_s: f64,
    },
}

impl Begin {
    pub(super) fn new(filter: FilterKind, first: &Pose, first_bias_sigma_m: f64) -> Self {
        Self {
            filter,
            position_m: first.position_m.into(),
            attitude_wxyz: wxyz(&first.attitude),
            first_bias_sigma_m,
        }
    }
}

/// A measurement that came at `t_s`, as a record.
pub(super) fn measured(t_s: f64, taken_s: f64, measurement: &Measurement) -> Event {
    match measurement {
        Measurement::Autopilot {
            position_m,
            attitude,
        } => Event::Autopilot(AutopilotRecord {
            t_s,
            taken_s,
            position_m: (*position_m).into(),
            attitude_wxyz: wxyz(attitude),
        }),
        Measurement::Marker {
            position_m,
            attitude,
            sigma_m,
            sigma_rad,
        } => Event::Marker(MarkerRecord {
            t_s,
            taken_s,
            position_m: (*position_m).into(),
            attitude_wxyz: wxyz(attitude),
            sigma_m: *sigma_m,
            sigma_rad: *sigma_rad,
        }),
        Measurement::Uwb {
            position_m,
            covariance_m2,
        } => Event::Uwb(UwbRecord {
            t_s,
            taken_s,
            position_m: (*position_m).into(),
            covariance_m2: std::array::from_fn(|k| covariance_m2[(k / 3, k % 3)]),
        }),
    }
}

pub(super) fn wxyz(attitude: &UnitQuaternion<f64>) -> [f64; 4] {
    [attitude.w, attitude.i, attitude.j, attitude.k]
}

pub(super) fn attitude(t_s: f64, wxyz: &[f64; 4]) -> Result<UnitQuaternion<f64>, RecordFault> {
    let [w, x, y, z] = *wxyz;
    let quaternion = Quaternion::new(w, x, y, z);
    let length = quaternion.norm();
    if (length - 1.0).abs() <= LENGTH {
        // Normalising again would change its last digits.
        Ok(UnitQuaternion::new_unchecked(quaternion))
    } else {
        Err(RecordFault::NoAttitude { t_s, length })
    }
}
