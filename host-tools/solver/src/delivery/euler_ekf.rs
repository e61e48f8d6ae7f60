//! The paper's filter: position, Euler angles, GPS bias, gyro bias (Sec. 4.2.3, Eq. 5 to 15).
//!
//! As described, with its switch xi: the GPS bias enters only once the marker or UWB has been heard, so that until then the
//! position carries the bias unknowingly. Angles are roll, pitch, yaw: turned by yaw about z, then pitch about y, then roll about x.

use super::filter::{CameraMount, Input, LandingFilter, Measurement, Pose, Verdict};
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

type Vector12 = SVector<f64, 12>;
type Matrix12 = SMatrix<f64, 12, 12>;

/// Noises of the filter; the paper gives none, these are ours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EulerEkfOptions {
    /// Camera on the vehicle.
    pub camera: CameraMount,
    /// Of the velocities, m/s per sqrt(Hz).
    pub velocity_density: f64,
    /// Of the turning rates, rad/s per sqrt(Hz).
    pub rate_density: f64,
    /// Random walk of the GPS bias, m per sqrt(s).
    pub bias_density: f64,
    /// Random walk of the gyro bias, rad/s per sqrt(s).
    pub gyro_bias_density: f64,
    /// Of the autopilot's place, bias apart, metres.
    pub gps_sigma_m: f64,
    /// Of the autopilot's angles, radians.
    pub attitude_sigma_rad: f64,
    /// First sigma of the GPS bias, metres.
    pub first_bias_sigma_m: f64,
}

impl Default for EulerEkfOptions {
    fn default() -> Self {
        Self {
            camera: CameraMount::looking_down(Vector3::zeros()),
            velocity_density: 0.1,
            rate_density: 0.01,
            bias_density: 0.01,
            gyro_bias_density: 1e-4,
            gps_sigma_m: 0.1,
            attitude_sigma_rad: 0.02,
            first_bias_sigma_m: 1.5,
        }
    }
}

/// The 12-state EKF.
#[derive(Debug, Clone)]
pub struct EulerEkf {
    options: EulerEkfOptions,
    /// p, r, b_p, b_omega (Eq. 10).
    state: Vector12,
    covariance: Matrix12,
    /// xi (Eq. 12).
    local_heard: bool,
}

impl EulerEkf {
    /// At a pose that is known to `sigma_m` and `attitude_sigma_rad`.
    pub fn new(pose: &Pose, sigma_m: f64, options: EulerEkfOptions) -> Self {
        let (roll, pitch, yaw) = pose.attitude.euler_angles();
        let mut state = Vector12::zeros();
        state.fixed_rows_mut::<3>(0).copy_from(&pose.position_m);
        state
            .fixed_rows_mut::<3>(3)
            .copy_from(&Vector3::new(roll, pitch, yaw));
        let sigmas = [sigma_m, 0.05, options.first_bias_sigma_m, 0.01];
        let covariance = Matrix12::from_diagonal(&Vector12::from_fn(|row, _| {
            sigmas.get(row / 3).copied().unwrap_or(0.0).powi(2)
        }));
        Self {
            options,
            state,
            covariance,
            local_heard: false,
        }
    }

    fn part(&self, begin: usize) -> Vector3<f64> {
        self.state.fixed_rows::<3>(begin).into_owned()
    }

    fn pose_of(state: &Vector12) -> Pose {
        let [roll, pitch, yaw] = [state[3], state[4], state[5]];
        Pose {
            position_m: state.fixed_rows::<3>(0).into_owned(),
            attitude: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        }
    }

    /// Eq. 7 to 9 with Joseph's form of Eq. 8, which keeps the covariance symmetric and positive.
    fn correct<const M: usize>(
        &mut self,
        innovation: &SVector<f64, M>,
        h: &SMatrix<f64, M, 12>,
        r: &SMatrix<f64, M, M>,
    ) -> Verdict {
        let spread = h * self.covariance * h.transpose() + r;
        let finite = innovation
            .iter()
            .chain(spread.iter())
            .all(|v| v.is_finite());
        let inverse = match spread.try_inverse() {
            Some(inverse) if finite => inverse,
            _ => return Verdict::Unusable,
        };
        let gain = self.covariance * h.transpose() * inverse;
        self.state += gain * innovation;
        for angle in 3..6 {
            self.state[angle] = wrapped(self.state[angle]);
        }
        let rest = Matrix12::identity() - gain * h;
        self.covariance = rest * self.covariance * rest.transpose() + gain * r * gain.transpose();
        Verdict::Used
    }
}

/// An angle in (-pi, pi].
fn wrapped(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle - turn * (angle / turn).round()
}

/// J_r: turning rates of the body to rates of the Euler angles (Eq. 11). At pitch +-90 degrees, where the angles do not exist,
/// the pitch next to it is taken.
fn euler_rates(roll: f64, pitch: f64) -> Matrix3<f64> {
    let (sr, cr) = roll.sin_cos();
    let pitch = pitch.clamp(-1.5, 1.5);
    let (tp, cp) = (pitch.tan(), pitch.cos());
    Matrix3::new(1.0, sr * tp, cr * tp, 0.0, cr, -sr, 0.0, sr / cp, cr / cp)
}

impl LandingFilter for EulerEkf {
    fn predict(&mut self, input: &Input, dt_s: f64) {
        let o = self.options;
        let rate = input.rate_rad_s - self.part(9);
        let step = |angles: &Vector3<f64>, rate: &Vector3<f64>| {
            angles + euler_rates(angles.x, angles.y) * rate * dt_s
        };
        let angles = self.part(3);
        let jacobian = euler_rates(angles.x, angles.y);
        // d f / d r by central differences: two trigonometric columns are not worth their derivation.
        let mut turn = Matrix3::identity();
        for column in 0..3 {
            const SMALL: f64 = 1e-6;
            let mut aside = Vector3::zeros();
            aside[column] = SMALL;
            let slope =
                (step(&(angles + aside), &rate) - step(&(angles - aside), &rate)) / (2.0 * SMALL);
            turn.set_column(column, &slope);
        }
        let mut f = Matrix12::identity();
        f.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
        f.fixed_view_mut::<3, 3>(3, 9)
            .copy_from(&(-jacobian * dt_s));
        // Eq. 11.
        let moved = self.part(0) + input.velocity_m_s * dt_s;
        let turned = step(&angles, &rate).map(wrapped);
        self.state.fixed_rows_mut::<3>(0).copy_from(&moved);
        self.state.fixed_rows_mut::<3>(3).copy_from(&turned);
        // Eq. 6: G Q_u G^T + Q_f.
        self.covariance = f * self.covariance * f.transpose();
        let diagonal = |density: f64| Matrix3::identity() * (density * density * dt_s);
        let rates = jacobian * diagonal(o.rate_density) * jacobian.transpose();
        for (begin, noise) in [
            (0, diagonal(o.velocity_density)),
            (3, rates),
            (6, diagonal(o.bias_density)),
            (9, diagonal(o.gyro_bias_density)),
        ] {
            let mut block = self.covariance.fixed_view_mut::<3, 3>(begin, begin);
            block += noise;
        }
    }

    fn update(&mut self, measurement: &Measurement) -> Verdict {
        match measurement {
            Measurement::Autopilot {
                position_m,
                attitude,
            } => {
                let xi = if self.local_heard { 1.0 } else { 0.0 };
                let mut h = SMatrix::<f64, 6, 12>::zeros();
                h.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
                h.fixed_view_mut::<3, 3>(0, 6)
                    .copy_from(&(Matrix3::identity() * xi));
                let (roll, pitch, yaw) = attitude.euler_angles();
                let place = position_m - self.part(0) - self.part(6) * xi;
                let angles = (Vector3::new(roll, pitch, yaw) - self.part(3)).map(wrapped);
                let innovation = stacked(&place, &angles);
                let (p, a) = (
                    self.options.gps_sigma_m.powi(2),
                    self.options.attitude_sigma_rad.powi(2),
                );
                let r = SVector::<f64, 6>::from([p, p, p, a, a, a]);
                self.correct(&innovation, &h, &SMatrix::from_diagonal(&r))
            }
            Measurement::Marker {
                position_m,
                attitude,
                sigma_m: [across, along],
                sigma_rad,
            } => {
                let camera = self.options.camera;
                // Eq. 14: place and angles of the marker in the camera's frame.
                let expected = |state: &Vector12| {
                    let (place, rotation) = camera.marker(&Self::pose_of(state));
                    let (roll, pitch, yaw) = rotation.euler_angles();
                    (place, Vector3::new(roll, pitch, yaw))
                };
                let (place, angles) = expected(&self.state);
                let (roll, pitch, yaw) = attitude.euler_angles();
                let off = (Vector3::new(roll, pitch, yaw) - angles).map(wrapped);
                let innovation = stacked(&(position_m - place), &off);
                let mut h = SMatrix::<f64, 6, 12>::zeros();
                for column in 0..6 {
                    const SMALL: f64 = 1e-6;
                    let mut aside = Vector12::zeros();
                    aside[column] = SMALL;
                    let (p1, a1) = expected(&(self.state + aside));
                    let (p0, a0) = expected(&(self.state - aside));
                    let slope = stacked(&(p1 - p0), &(a1 - a0).map(wrapped)) / (2.0 * SMALL);
                    h.set_column(column, &slope);
                }
                let [r, p, y] = sigma_rad.map(|sigma| sigma * sigma);
                let (a, l) = (across * across, along * along);
                let r = SVector::<f64, 6>::from([a, a, l, r, p, y]);
                let verdict = self.correct(&innovation, &h, &SMatrix::from_diagonal(&r));
                self.local_heard |= verdict == Verdict::Used;
                verdict
            }
            Measurement::Uwb {
                position_m,
                covariance_m2,
            } => {
                let mut h = SMatrix::<f64, 3, 12>::zeros();
                h.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
                let innovation = position_m - self.part(0);
                let verdict = self.correct(&innovation, &h, covariance_m2);
                self.local_heard |= verdict == Verdict::Used;
                verdict
            }
        }
    }

    fn pose(&self) -> Pose {
        Self::pose_of(&self.state)
    }

    fn position_covariance_m2(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }

    fn gps_bias_m(&self) -> Vector3<f64> {
        self.part(6)
    }
}

fn stacked(a: &Vector3<f64>, b: &Vector3<f64>) -> SVector<f64, 6> {
    SVector::from([a.x, a.y, a.z, b.x, b.y, b.z])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rates_of_the_angles_turn_the_body_as_its_own_rates_do(
            angles in [-3.0..3.0f64, -1.2..1.2, -3.0..3.0],
            rate in [-1.0..1.0f64, -1.0..1.0, -1.0..1.0],
        ) {
            let [roll, pitch, yaw] = angles;
            let rate = Vector3::from(rate);
            let dt_s = 1e-5;
            let turned = Vector3::from(angles) + euler_rates(roll, pitch) * rate * dt_s;
            let wanted = Rotation3::from_euler_angles(roll, pitch, yaw) * Rotation3::new(rate * dt_s);
            let got = Rotation3::from_euler_angles(turned.x, turned.y, turned.z);
            // Not by the angle between them: its arc cosine has no more than 1e-8 near zero.
            prop_assert!((got.matrix() - wanted.matrix()).norm() < 1e-8);
        }
    }
}
