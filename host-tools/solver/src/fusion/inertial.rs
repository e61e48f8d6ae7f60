//! Position, velocity and accelerometer bias carried forward by the inertial sensor: Eq. 23-27.
//!
//! ```text
//! a  = R (f - b) + g                       Eq. 24, 25; g, which the paper leaves out, along with
//! p' = p + v dt + a dt^2 / 2               Eq. 27, which ends after v dt: half a step late
//! v' = v + a dt
//! b' = b
//! ```
//!
//! `R` turns the body into the frame of the state: ENU, or ECEF by one more matrix. The Earth's turning
//! is left out: at 5 m/s it is 0.7 mm/s^2, a hundredth of a low-cost sensor's bias, and lands in `b`.
//!
//! Covariances of more unknowns than these nine are carried along: rows and columns beyond the ninth
//! are not touched by the motion but by what links them.

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::{ImuSample, usable};
use crate::ins::GRAVITY_M_S2;

/// How good the sensor is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuNoise {
    /// White noise of the acceleration as it acts, attitude error included, m/s^2 / sqrt(Hz).
    pub acceleration: f64,
    /// Random walk of the bias, m/s^2 / sqrt(s).
    pub bias_walk: f64,
    /// Standard deviation of the bias to begin with, m/s^2.
    pub bias_sigma: f64,
}

impl Default for ImuNoise {
    fn default() -> Self {
        Self {
            // An attitude wrong by half a degree for seconds is 0.09 m/s^2 of wrong direction.
            acceleration: 0.1,
            bias_walk: 0.002,
            bias_sigma: 0.1,
        }
    }
}

/// The inertial part of a state.
#[derive(Debug, Clone)]
pub struct Imu {
    noise: ImuNoise,
    gravity: Vector3<f64>,
    last: Option<ImuSample>,
    pub(super) t_s: f64,
    pub(super) p: Vector3<f64>,
    pub(super) v: Vector3<f64>,
    pub(super) b: Vector3<f64>,
}

impl Imu {
    /// At a place with a velocity; `up` is the unit vector away from the Earth in the frame of the state.
    pub(super) fn new(
        noise: ImuNoise,
        t_s: f64,
        p: Vector3<f64>,
        v: Vector3<f64>,
        up: Vector3<f64>,
    ) -> Self {
        Self {
            noise,
            gravity: -up * GRAVITY_M_S2,
            last: None,
            t_s,
            p,
            v,
            b: Vector3::zeros(),
        }
    }

    /// Attitude of the last reading: body to ENU.
    pub(super) fn attitude(&self) -> Matrix3<f64> {
        self.last
            .map_or_else(Matrix3::identity, |s| s.enu_from_body)
    }

    /// Takes a reading: the state moves to its time by the reading before it. False where it is not
    /// later than the state, or holds what is no number.
    pub(super) fn read(
        &mut self,
        sample: &ImuSample,
        frame_from_enu: &Matrix3<f64>,
        covariance: &mut DMatrix<f64>,
    ) -> bool {
        let sound = sample.t_s.is_finite()
            && sample.force_m_s2.iter().all(|v| usable(*v))
            && sample.enu_from_body.iter().all(|v| v.is_finite());
        if !sound || sample.t_s < self.t_s {
            return false;
        }
        if self.last.is_none() {
            self.last = Some(*sample);
        }
        self.hold_until(sample.t_s, frame_from_enu, covariance);
        self.last = Some(*sample);
        true
    }

    /// Moves the state to a time by the last reading; without any at constant velocity.
    pub(super) fn hold_until(
        &mut self,
        t_s: f64,
        frame_from_enu: &Matrix3<f64>,
        covariance: &mut DMatrix<f64>,
    ) {
        // A long gap in steps, so that what is unknown grows as it should; a time stamp that is wrong by
        // years in no more than a thousand.
        const STEP_S: f64 = 0.1;
        const MOST_STEPS: f64 = 1000.0;
        let step_s = ((t_s - self.t_s) / MOST_STEPS).max(STEP_S);
        while t_s > self.t_s {
            let dt = (t_s - self.t_s).min(step_s);
            self.t_s = if dt < step_s { t_s } else { self.t_s + dt };
            let (turn, a) = match &self.last {
                Some(sample) => {
                    let turn = frame_from_enu * sample.enu_from_body;
                    (turn, turn * (sample.force_m_s2 - self.b) + self.gravity)
                }
                None => (*frame_from_enu, Vector3::zeros()),
            };
            self.p += (self.v + a * (0.5 * dt)) * dt;
            self.v += a * dt;
            self.spread(dt, &turn, covariance);
        }
    }

    /// `P <- F P F^T + Q` with `F = [I dt 0; 0 I -dt R; 0 0 I]` on the first nine unknowns.
    fn spread(&self, dt: f64, turn: &Matrix3<f64>, covariance: &mut DMatrix<f64>) {
        let n = covariance.nrows();
        let push = turn * -dt;
        for k in 0..n {
            let mut column = covariance.column_mut(k);
            let v = Vector3::new(column[3], column[4], column[5]);
            let b = Vector3::new(column[6], column[7], column[8]);
            let bent = push * b;
            for i in 0..3 {
                column[i] += dt * v[i];
                column[3 + i] += bent[i];
            }
        }
        for i in 0..3 {
            for k in 0..n {
                covariance[(k, i)] += dt * covariance[(k, 3 + i)];
            }
        }
        for k in 0..n {
            let b = Vector3::new(covariance[(k, 6)], covariance[(k, 7)], covariance[(k, 8)]);
            let bent = push * b;
            for i in 0..3 {
                covariance[(k, 3 + i)] += bent[i];
            }
        }
        let q = self.noise.acceleration.powi(2);
        let walk = self.noise.bias_walk.powi(2) * dt;
        for i in 0..3 {
            covariance[(i, i)] += q * dt.powi(3) / 3.0;
            covariance[(i, 3 + i)] += q * dt * dt / 2.0;
            covariance[(3 + i, i)] += q * dt * dt / 2.0;
            covariance[(3 + i, 3 + i)] += q * dt;
            covariance[(6 + i, 6 + i)] += walk;
        }
    }
}
