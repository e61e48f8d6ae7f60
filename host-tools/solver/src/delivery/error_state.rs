//! The better filter: errors of a quaternion instead of Euler angles, and a bias that is doubted from the start.
//!
//! What differs from [`super::EulerEkf`]:
//! - attitude is a quaternion, its error three small angles of the body: no singular pitch, no wrapped differences;
//! - the GPS bias is part of what GPS measures from the first moment on. The paper leaves it out until the marker or UWB is
//!   heard (xi), so that its position is then sure of being where it is not;
//! - the bias wanders, measurements are judged by their innovation (chi-square), and velocities may have an offset;
//! - the marker's turn is compared as a rotation, about the marker's own axes.

use super::filter::{CameraMount, Input, LandingFilter, Measurement, Pose, Verdict};
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

/// Position, attitude, GPS bias, gyro bias, velocity offset.
const N: usize = 15;
type MatrixN = SMatrix<f64, N, N>;

/// Noises of the filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorStateOptions {
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
    /// Random walk of the velocities' offset, m/s per sqrt(s).
    pub velocity_offset_density: f64,
    /// Of the autopilot's place, bias apart, metres.
    pub gps_sigma_m: f64,
    /// Of the autopilot's attitude, radians.
    pub attitude_sigma_rad: f64,
    /// First sigma of the GPS bias, metres.
    pub first_bias_sigma_m: f64,
    /// First sigma of the velocities' offset, m/s.
    pub first_offset_sigma_m_s: f64,
    /// Innovations whose squared length, in sigmas, is beyond this are outliers: of 6 and of 3 numbers.
    pub gates: [f64; 2],
}

impl Default for ErrorStateOptions {
    fn default() -> Self {
        Self {
            camera: CameraMount::looking_down(Vector3::zeros()),
            velocity_density: 0.02,
            rate_density: 0.005,
            bias_density: 0.03,
            gyro_bias_density: 1e-4,
            velocity_offset_density: 0.01,
            gps_sigma_m: 0.1,
            attitude_sigma_rad: 0.02,
            first_bias_sigma_m: 1.5,
            first_offset_sigma_m_s: 0.1,
            // One in 10 000 of good ones (chi-square).
            gates: [27.9, 21.1],
        }
    }
}

/// The error-state filter.
#[derive(Debug, Clone)]
pub struct ErrorStateFilter {
    options: ErrorStateOptions,
    position_m: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    gps_bias_m: Vector3<f64>,
    gyro_bias_rad_s: Vector3<f64>,
    velocity_offset_m_s: Vector3<f64>,
    covariance: MatrixN,
}

impl ErrorStateFilter {
    /// Where the autopilot says it is: known up to its bias.
    pub fn new(pose: &Pose, options: ErrorStateOptions) -> Self {
        let o = &options;
        let (b, g) = (o.first_bias_sigma_m.powi(2), o.gps_sigma_m.powi(2));
        let mut covariance = MatrixN::zeros();
        let mut set = |row, column, variance: f64| {
            let mut block = covariance.fixed_view_mut::<3, 3>(row, column);
            block.copy_from(&(Matrix3::identity() * variance));
        };
        // measured = position + bias: what the one is too much the other is too little.
        set(0, 0, b + g);
        set(0, 6, -b);
        set(6, 0, -b);
        set(6, 6, b);
        set(3, 3, 0.05f64.powi(2));
        set(9, 9, 0.01f64.powi(2));
        set(12, 12, o.first_offset_sigma_m_s.powi(2));
        Self {
            position_m: pose.position_m,
            attitude: pose.attitude,
            gps_bias_m: Vector3::zeros(),
            gyro_bias_rad_s: Vector3::zeros(),
            velocity_offset_m_s: Vector3::zeros(),
            covariance,
            options,
        }
    }

    fn correct<const M: usize>(
        &mut self,
        innovation: &SVector<f64, M>,
        h: &SMatrix<f64, M, N>,
        r: &SMatrix<f64, M, M>,
        gate: f64,
    ) -> Verdict {
        let spread = h * self.covariance * h.transpose() + r;
        let finite = innovation
            .iter()
            .chain(spread.iter())
            .all(|v| v.is_finite());
        let Some(root) = spread.cholesky().filter(|_| finite) else {
            return Verdict::Unusable;
        };
        if innovation.dot(&root.solve(innovation)) > gate {
            return Verdict::Outlier;
        }
        let gain = self.covariance * h.transpose() * root.inverse();
        let error = gain * innovation;
        let part = |begin: usize| error.fixed_rows::<3>(begin).into_owned();
        self.position_m += part(0);
        self.attitude *= UnitQuaternion::from_scaled_axis(part(3));
        self.attitude.renormalize();
        self.gps_bias_m += part(6);
        self.gyro_bias_rad_s += part(9);
        self.velocity_offset_m_s += part(12);
        let rest = MatrixN::identity() - gain * h;
        self.covariance = rest * self.covariance * rest.transpose() + gain * r * gain.transpose();
        Verdict::Used
    }
}

impl LandingFilter for ErrorStateFilter {
    fn predict(&mut self, input: &Input, dt_s: f64) {
        let o = self.options;
        let turn = (input.rate_rad_s - self.gyro_bias_rad_s) * dt_s;
        self.position_m += (input.velocity_m_s - self.velocity_offset_m_s) * dt_s;
        let rotation = UnitQuaternion::from_scaled_axis(turn);
        self.attitude *= rotation;
        let mut f = MatrixN::identity();
        let back = rotation.inverse().to_rotation_matrix();
        f.fixed_view_mut::<3, 3>(3, 3).copy_from(back.matrix());
        f.fixed_view_mut::<3, 3>(3, 9)
            .copy_from(&(Matrix3::identity() * -dt_s));
        f.fixed_view_mut::<3, 3>(0, 12)
            .copy_from(&(Matrix3::identity() * -dt_s));
        self.covariance = f * self.covariance * f.transpose();
        for (block, density) in [
            o.velocity_density,
            o.rate_density,
            o.bias_density,
            o.gyro_bias_density,
            o.velocity_offset_density,
        ]
        .into_iter()
        .enumerate()
        {
            for axis in 3 * block..3 * block + 3 {
                self.covariance[(axis, axis)] += density * density * dt_s;
            }
        }
    }

    fn update(&mut self, measurement: &Measurement) -> Verdict {
        let [six, three] = self.options.gates;
        match measurement {
            Measurement::Autopilot {
                position_m,
                attitude,
            } => {
                let mut h = SMatrix::<f64, 6, N>::zeros();
                h.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
                h.fixed_view_mut::<3, 3>(0, 6).fill_with_identity();
                let place = position_m - self.position_m - self.gps_bias_m;
                let turn = (self.attitude.inverse() * attitude).scaled_axis();
                let (p, a) = (
                    self.options.gps_sigma_m.powi(2),
                    self.options.attitude_sigma_rad.powi(2),
                );
                let r = SVector::<f64, 6>::from([p, p, p, a, a, a]);
                self.correct(
                    &stacked(&place, &turn),
                    &h,
                    &SMatrix::from_diagonal(&r),
                    six,
                )
            }
            Measurement::Marker {
                position_m,
                attitude,
                sigma_m: [across, along],
                sigma_rad,
            } => {
                let camera = self.options.camera;
                let (place, rotation) = camera.marker(&self.pose());
                let to_camera = camera.rotation.inverse();
                let body = self.attitude.inverse().to_rotation_matrix();
                let mut h = SMatrix::<f64, 6, N>::zeros();
                // p_ac = C^T (R^T (0 - p) - t): along the axes of the camera, and turned with the body.
                let by_place = -(to_camera * body).matrix();
                let by_turn = to_camera.matrix() * (body * -self.position_m).cross_matrix();
                h.fixed_view_mut::<3, 3>(0, 0).copy_from(&by_place);
                h.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_turn);
                // R_ac <- C^T exp(-theta) R^T = R_ac exp(-R theta): about the marker's axes, which are the frame's.
                let by_turn = -self.attitude.to_rotation_matrix().into_inner();
                h.fixed_view_mut::<3, 3>(3, 3).copy_from(&by_turn);
                let off = (rotation.inverse() * attitude).scaled_axis();
                let [r, p, y] = sigma_rad.map(|sigma| sigma * sigma);
                let (a, l) = (across * across, along * along);
                let r = SVector::<f64, 6>::from([a, a, l, r, p, y]);
                self.correct(
                    &stacked(&(position_m - place), &off),
                    &h,
                    &SMatrix::from_diagonal(&r),
                    six,
                )
            }
            Measurement::Uwb {
                position_m,
                covariance_m2,
            } => {
                let mut h = SMatrix::<f64, 3, N>::zeros();
                h.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
                let innovation = position_m - self.position_m;
                self.correct(&innovation, &h, covariance_m2, three)
            }
        }
    }

    fn pose(&self) -> Pose {
        Pose {
            position_m: self.position_m,
            attitude: self.attitude,
        }
    }

    fn position_covariance_m2(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }

    fn gps_bias_m(&self) -> Vector3<f64> {
        self.gps_bias_m
    }
}

fn stacked(a: &Vector3<f64>, b: &Vector3<f64>) -> SVector<f64, 6> {
    SVector::from([a.x, a.y, a.z, b.x, b.y, b.z])
}
