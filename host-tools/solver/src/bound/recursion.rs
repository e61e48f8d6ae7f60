//! The bound step by step.
//!
//! State, eight numbers: `r` (3, tag plus error of dead reckoning), velocity error `v` (2),
//! acceleration error `a` (2), range bias `b`. Tag and position error enter ranges and the relative
//! position by their sum alone, so nothing is lost by not telling them apart; and as the tag rests,
//! `r` moves like the position error does. Between ranges `P <- F P F^T + Q`; with a range of
//! standard deviation `sigma` along the unit vector `u`, `h = [u 0 0 1]`:
//!
//! ```text
//! k = P h / (h^T P h + sigma^2),    P <- (I - k h^T) P (I - k h^T)^T + k sigma^2 k^T
//! ```
//!
//! (Joseph's form, which stays positive definite under rounding.) This is Tichavsky's recursion
//! `J <- D22 - D21 (J + D11)^-1 D12` in terms of `P = J^-1`. Sums run along columns of eight, which
//! the compiler turns into vector instructions; nothing is allocated.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::ins_error::{INS_ERROR_STATES, InsNoise};

/// Size of the state.
pub const STATES: usize = INS_ERROR_STATES + 1;
/// Index of the range bias; before it come `r_x r_y r_z v_x v_y a_x a_y`.
pub const BIAS: usize = INS_ERROR_STATES;
/// Covariance of the state; metres and seconds.
pub type Covariance = SMatrix<f64, STATES, STATES>;

/// What is known at hand-over, independent Gaussians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Of the tag along each axis, metres. Any error of the vehicle's own position at hand-over
    /// adds to it (in squares).
    pub tag_sigma_m: [f64; 3],
    /// Of the reckoned velocity, each horizontal axis, m/s.
    pub velocity_sigma_m_s: f64,
    /// Of the accelerometer's bias, each horizontal axis, m/s^2.
    pub acceleration_sigma_m_s2: f64,
    /// Of the constant range bias, metres; 0 where it is known.
    pub bias_sigma_m: f64,
}

/// Covariance of what can be known, carried through time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recursion {
    noise: InsNoise,
    covariance: Covariance,
}

impl Recursion {
    /// At hand-over.
    pub fn new(noise: InsNoise, prior: &Prior) -> Self {
        let [x, y, z] = prior.tag_sigma_m;
        let (v, a) = (prior.velocity_sigma_m_s, prior.acceleration_sigma_m_s2);
        let sigmas = SVector::from([x, y, z, v, v, a, a, prior.bias_sigma_m]);
        Self::from_covariance(
            noise,
            Covariance::from_diagonal(&sigmas.component_mul(&sigmas)),
        )
    }

    /// From a covariance known otherwise, such as an estimator's.
    pub fn from_covariance(noise: InsNoise, covariance: Covariance) -> Self {
        Self { noise, covariance }
    }

    /// Lets `dt_s >= 0` seconds pass.
    pub fn step(&mut self, dt_s: f64) {
        let half_dt2 = 0.5 * dt_s * dt_s;
        let p = &mut self.covariance;
        // P F^T, then F (P F^T). F adds velocity and acceleration to position, and acceleration to
        // velocity; all else stays. Position first: it needs the velocity as it was.
        for axis in 0..2 {
            let (r, v, a) = (axis, 3 + axis, 5 + axis);
            for i in 0..STATES {
                p[(i, r)] += dt_s * p[(i, v)] + half_dt2 * p[(i, a)];
                p[(i, v)] += dt_s * p[(i, a)];
            }
        }
        for column in 0..STATES {
            for axis in 0..2 {
                let (r, v, a) = (axis, 3 + axis, 5 + axis);
                p[(r, column)] += dt_s * p[(v, column)] + half_dt2 * p[(a, column)];
                p[(v, column)] += dt_s * p[(a, column)];
            }
        }
        let noise = self.noise.axis_noise(dt_s);
        for axis in 0..2 {
            let index = [axis, 3 + axis, 5 + axis];
            for (i, &row) in index.iter().enumerate() {
                for (j, &column) in index.iter().enumerate() {
                    p[(row, column)] += noise[(i, j)];
                }
            }
        }
        p[(2, 2)] += self.noise.height_random_walk.powi(2) * dt_s;
    }

    /// A range along the unit vector `direction` (from vehicle to tag; its sign does not matter to
    /// the position but does to the bias) with standard deviation `sigma_m > 0`, the barometer's
    /// part and the loss by lateness included.
    pub fn observe(&mut self, direction: Vector3<f64>, sigma_m: f64) {
        let variance = sigma_m * sigma_m;
        let p = &mut self.covariance;
        let seen = measured(p, &direction);
        let innovation = direction.dot(&seen.fixed_rows::<3>(0)) + seen[BIAS] + variance;
        let gain = seen / innovation;
        // A = (I - k h^T) P, column by column; then A - (A h - k sigma^2) k^T.
        for column in 0..STATES {
            for row in 0..STATES {
                p[(row, column)] -= gain[row] * seen[column];
            }
        }
        let left = measured(p, &direction) - gain * variance;
        for column in 0..STATES {
            for row in column..STATES {
                let value = p[(row, column)] - left[row] * gain[column];
                p[(row, column)] = value;
                p[(column, row)] = value;
            }
        }
    }

    /// Covariance of `tag - vehicle`, m^2.
    pub fn relative_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// Covariance of the whole state.
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }
}

/// `P h`.
fn measured(p: &Covariance, direction: &Vector3<f64>) -> SVector<f64, STATES> {
    SVector::from_fn(|row, _| {
        p[(row, 0)] * direction.x
            + p[(row, 1)] * direction.y
            + p[(row, 2)] * direction.z
            + p[(row, BIAS)]
    })
}
