//! The target's motion: a double integrator whose acceleration is noise (eq. 4).
//!
//! ```text
//! p' = p + dt v                   Q = q [ dt^3/3  dt^2/2 ]  for each axis
//! v' = v                                [ dt^2/2  dt     ]
//! ```
//!
//! `q` is the spectral density of a white acceleration, m^2/s^3 (Bar-Shalom, Li, Kirubarajan,
//! "Estimation with applications to tracking and navigation", 2001, sec. 6.2.2). A target that
//! accelerates with `a` for a time `T` and then otherwise is met by `q` about `a^2 T`.

use nalgebra::{Matrix3, Matrix6, Vector3};

/// What is believed of position and velocity: mean, and covariance in blocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belief {
    /// Metres.
    pub position_m: Vector3<f64>,
    /// Metres a second.
    pub velocity_m_s: Vector3<f64>,
    /// Covariance of the position.
    pub pp: Matrix3<f64>,
    /// Covariance of position (rows) and velocity (columns).
    pub pv: Matrix3<f64>,
    /// Covariance of the velocity.
    pub vv: Matrix3<f64>,
}

impl Belief {
    /// A belief of equal doubt in all directions.
    pub fn about(
        position_m: Vector3<f64>,
        position_sigma_m: f64,
        velocity_m_s: Vector3<f64>,
        velocity_sigma_m_s: f64,
    ) -> Self {
        Self {
            position_m,
            velocity_m_s,
            pp: Matrix3::identity() * (position_sigma_m * position_sigma_m),
            pv: Matrix3::zeros(),
            vv: Matrix3::identity() * (velocity_sigma_m_s * velocity_sigma_m_s),
        }
    }

    /// Covariance of position and velocity in one, eq. 28.
    pub fn covariance(&self) -> Matrix6<f64> {
        let mut all = Matrix6::zeros();
        all.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.pp);
        all.fixed_view_mut::<3, 3>(0, 3).copy_from(&self.pv);
        all.fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&self.pv.transpose());
        all.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.vv);
        all
    }

    /// What is believed `dt_s` later.
    #[inline]
    pub fn after(&self, dt_s: f64, acceleration_density: f64) -> Self {
        let q = acceleration_density;
        let across = (self.pv + self.pv.transpose()) * dt_s;
        let diagonal = |value: f64| Matrix3::from_diagonal_element(value);
        Self {
            position_m: self.position_m + self.velocity_m_s * dt_s,
            velocity_m_s: self.velocity_m_s,
            pp: self.pp + across + self.vv * (dt_s * dt_s) + diagonal(q * dt_s * dt_s * dt_s / 3.0),
            pv: self.pv + self.vv * dt_s + diagonal(0.5 * q * dt_s * dt_s),
            vv: self.vv + diagonal(q * dt_s),
        }
    }

    /// What is believed after a motion that takes a velocity `v` to a change of place `place v` and to a new
    /// velocity `velocity v`, with white acceleration over `dt_s`.
    pub fn moved(
        &self,
        place: &Matrix3<f64>,
        velocity: &Matrix3<f64>,
        dt_s: f64,
        acceleration_density: f64,
    ) -> Self {
        let q = acceleration_density;
        let across = self.pv * place.transpose();
        let diagonal = |value: f64| Matrix3::from_diagonal_element(value);
        Self {
            position_m: self.position_m + place * self.velocity_m_s,
            velocity_m_s: velocity * self.velocity_m_s,
            pp: self.pp
                + across
                + across.transpose()
                + place * self.vv * place.transpose()
                + diagonal(q * dt_s * dt_s * dt_s / 3.0),
            pv: (self.pv + place * self.vv) * velocity.transpose()
                + diagonal(0.5 * q * dt_s * dt_s),
            vv: velocity * self.vv * velocity.transpose() + diagonal(q * dt_s),
        }
    }

    /// Whether all numbers are finite and no variance is negative.
    pub fn is_sound(&self) -> bool {
        let finite = |m: &Matrix3<f64>| m.iter().all(|c| c.is_finite());
        let variances = |m: &Matrix3<f64>| m.diagonal().iter().all(|v| *v >= 0.0);
        self.position_m.iter().all(|c| c.is_finite())
            && self.velocity_m_s.iter().all(|c| c.is_finite())
            && finite(&self.pp)
            && finite(&self.pv)
            && finite(&self.vv)
            && variances(&self.pp)
            && variances(&self.vv)
    }
}
