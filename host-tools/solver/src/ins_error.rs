//! How the error of dead reckoning grows: the stochastic model behind the MAP navigator's prior and
//! behind the Cramer-Rao bound.
//!
//! Horizontal position comes from twice integrated acceleration, height from a barometer (paper Eq.
//! 1). The error `[p (3), v (2), a (2)]` (position; horizontal velocity; horizontal acceleration)
//! then is a Markov process: over `dt`
//!
//! ```text
//! p_h' = p_h + v dt + a dt^2/2 + w_p     v' = v + a dt + w_v     a' = a + w_a     p_z' = p_z + w_z
//! ```
//!
//! driven by white noise of three strengths along each horizontal axis: `q_v` (accelerometer noise;
//! units of a velocity random walk), `q_a` (accelerometer random walk), `q_p` (motion the INS does
//! not see, such as gusts), and of one on the vertical axis, `q_z` (barometer drift). With `t = dt`:
//!
//! ```text
//!            | t^5/20  t^4/8  t^3/6 |         | t^3/3  t^2/2  0 |         | t 0 0 |
//! Q = q_a^2  | t^4/8   t^3/3  t^2/2 | + q_v^2 | t^2/2  t      0 | + q_p^2 | 0 0 0 |
//!            | t^3/6   t^2/2  t     |         | 0      0      0 |         | 0 0 0 |
//! ```

use nalgebra::{Matrix3, SMatrix};

/// Index of the error state's parts.
pub const INS_ERROR_STATES: usize = 7;

/// Strength of the noises that drive the error of dead reckoning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InsNoise {
    /// White accelerometer noise `q_v`, m/s^2/sqrt(Hz) = m/s/sqrt(s), each horizontal axis.
    pub velocity_random_walk: f64,
    /// Accelerometer random walk `q_a`, m/s^2/sqrt(s), each horizontal axis.
    pub acceleration_random_walk: f64,
    /// Horizontal motion that dead reckoning does not see, `q_p`, m/sqrt(s), each axis.
    pub position_random_walk: f64,
    /// Barometer drift `q_z`, m/sqrt(s).
    pub height_random_walk: f64,
    /// White noise of one barometer reading, metres.
    pub height_sigma_m: f64,
}

impl InsNoise {
    /// Transition `F` and process noise `Q` over `dt_s`, order `p_x p_y p_z v_x v_y a_x a_y`.
    pub fn step(
        &self,
        dt_s: f64,
    ) -> (
        SMatrix<f64, INS_ERROR_STATES, INS_ERROR_STATES>,
        SMatrix<f64, INS_ERROR_STATES, INS_ERROR_STATES>,
    ) {
        let mut transition = SMatrix::identity();
        let mut noise = SMatrix::zeros();
        let axis_noise = self.axis_noise(dt_s);
        for axis in 0..2 {
            let index = [axis, 3 + axis, 5 + axis];
            transition[(index[0], index[1])] = dt_s;
            transition[(index[0], index[2])] = 0.5 * dt_s * dt_s;
            transition[(index[1], index[2])] = dt_s;
            for (i, &row) in index.iter().enumerate() {
                for (j, &column) in index.iter().enumerate() {
                    noise[(row, column)] = axis_noise[(i, j)];
                }
            }
        }
        noise[(2, 2)] = self.height_random_walk.powi(2) * dt_s;
        (transition, noise)
    }

    /// `Q` of one horizontal axis: position, velocity, acceleration.
    pub fn axis_noise(&self, dt_s: f64) -> Matrix3<f64> {
        let t = dt_s;
        let (t2, t3) = (t * t, t * t * t);
        let (q_a, q_v, q_p) = (
            self.acceleration_random_walk.powi(2),
            self.velocity_random_walk.powi(2),
            self.position_random_walk.powi(2),
        );
        let pp = q_a * t3 * t2 / 20.0 + q_v * t3 / 3.0 + q_p * t;
        let pv = q_a * t2 * t2 / 8.0 + q_v * t2 / 2.0;
        let vv = q_a * t3 / 3.0 + q_v * t;
        let (pa, va, aa) = (q_a * t3 / 6.0, q_a * t2 / 2.0, q_a * t);
        Matrix3::new(pp, pv, pa, pv, vv, va, pa, va, aa)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_short_steps_make_one_long_step() {
        let noise = InsNoise {
            velocity_random_walk: 0.3,
            acceleration_random_walk: 0.2,
            position_random_walk: 0.1,
            height_random_walk: 0.05,
            height_sigma_m: 0.1,
        };
        let (f1, q1) = noise.step(0.7);
        let (f2, q2) = noise.step(1.8);
        let (f, q) = noise.step(2.5);
        assert!((f2 * f1 - f).norm() < 1e-12);
        assert!((f2 * q1 * f2.transpose() + q2 - q).norm() < 1e-12);
    }
}
