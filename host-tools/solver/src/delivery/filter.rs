//! What a filter for the landing takes and gives.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// What moves the state (the paper's u, above Eq. 10).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input {
    /// Velocity in the frame of the delivery, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Turning rate along the body's axes, rad/s.
    pub rate_rad_s: Vector3<f64>,
}

/// What corrects it (Sec. 4.2.3).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Measurement {
    /// The autopilot's own pose: place with an unknown offset, and attitude (Eq. 12).
    Autopilot {
        /// Metres.
        position_m: Vector3<f64>,
        /// Body to frame.
        attitude: UnitQuaternion<f64>,
    },
    /// The marker as the camera sees it (Eq. 13, 14).
    Marker {
        /// In the camera's frame, metres.
        position_m: Vector3<f64>,
        /// Marker to camera.
        attitude: UnitQuaternion<f64>,
        /// Across the view and along it, metres.
        sigma_m: [f64; 2],
        /// About the marker's axes: roll and pitch are poor, yaw is good, radians.
        sigma_rad: [f64; 3],
    },
    /// A place from UWB (Eq. 15).
    Uwb {
        /// Metres.
        position_m: Vector3<f64>,
        /// As the positioning says, square metres.
        covariance_m2: Matrix3<f64>,
    },
}

/// How the camera sits on the vehicle, H_c^d (Eq. 13). The marker's own pose H_a^w is the frame's: it lies in the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraMount {
    /// Where on the body, metres.
    pub position_m: Vector3<f64>,
    /// Camera to body.
    pub rotation: Rotation3<f64>,
}

impl CameraMount {
    /// Looks down; the image's top is forward. Camera axes: right, down in the image, along the view.
    pub fn looking_down(position_m: Vector3<f64>) -> Self {
        let axes = Matrix3::from_columns(&[-Vector3::y(), -Vector3::x(), -Vector3::z()]);
        Self {
            position_m,
            rotation: Rotation3::from_matrix_unchecked(axes),
        }
    }

    /// The marker seen from a vehicle at this pose: place, and marker-to-camera rotation (Eq. 13).
    pub fn marker(&self, pose: &Pose) -> (Vector3<f64>, UnitQuaternion<f64>) {
        let body = pose.attitude.inverse();
        let place = self.rotation.inverse() * (body * -pose.position_m - self.position_m);
        let rotation = UnitQuaternion::from_rotation_matrix(&self.rotation).inverse() * body;
        (place, rotation)
    }
}

/// Where the vehicle is and how it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Metres.
    pub position_m: Vector3<f64>,
    /// Body to frame.
    pub attitude: UnitQuaternion<f64>,
}

/// What became of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It was used.
    Used,
    /// It does not fit what is known.
    Outlier,
    /// A number in it is none, or nothing can be computed from it.
    Unusable,
}

/// A filter for the landing.
pub trait LandingFilter {
    /// Moves the state on by `dt_s` under the input (Eq. 5, 6).
    fn predict(&mut self, input: &Input, dt_s: f64);

    /// Corrects it (Eq. 7 to 9).
    fn update(&mut self, measurement: &Measurement) -> Verdict;

    /// The estimate.
    fn pose(&self) -> Pose;

    /// Covariance of its position, square metres.
    fn position_covariance_m2(&self) -> Matrix3<f64>;

    /// The offset of the autopilot's place, metres.
    fn gps_bias_m(&self) -> Vector3<f64>;
}
