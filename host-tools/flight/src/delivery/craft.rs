//! The multirotor: velocities wanted, velocities reached.

use crate::streams::normal;
use nalgebra::{UnitQuaternion, Vector3};
use nova_solver::delivery::Pose;
use rand_chacha::ChaCha8Rng;

/// Standard gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.806_65;
/// Lag of the velocity controller, seconds.
const LAG_S: f64 = 0.3;
/// What it asks of the rotors at most, m/s^2.
const LIMIT_M_S2: f64 = 4.0;
/// How long gusts last, seconds.
const GUST_S: f64 = 1.0;

/// The vehicle as it is.
#[derive(Debug, Clone)]
pub(super) struct Craft {
    pub(super) position_m: Vector3<f64>,
    pub(super) velocity_m_s: Vector3<f64>,
    acceleration_m_s2: Vector3<f64>,
    gust_m_s2: Vector3<f64>,
    yaw_rad: f64,
    pub(super) mass_kg: f64,
}

impl Craft {
    pub(super) fn on_ground(position_m: Vector3<f64>, mass_kg: f64) -> Self {
        Self {
            position_m,
            velocity_m_s: Vector3::zeros(),
            acceleration_m_s2: Vector3::zeros(),
            gust_m_s2: Vector3::zeros(),
            yaw_rad: 0.0,
            mass_kg,
        }
    }

    /// Moves for `dt_s`: the controller sees a velocity that is off by `offset_m_s` and takes the mass for `believed_kg`.
    pub(super) fn step(
        &mut self,
        wanted_m_s: Vector3<f64>,
        offset_m_s: Vector3<f64>,
        believed_kg: f64,
        gust_sigma_m_s2: f64,
        dt_s: f64,
        rng: &mut ChaCha8Rng,
    ) {
        let keep = (-dt_s / GUST_S).exp();
        let fresh = gust_sigma_m_s2 * (1.0 - keep * keep).sqrt();
        self.gust_m_s2 = self.gust_m_s2.map(|gust| gust * keep + fresh * normal(rng));
        self.yaw_rad += (-0.5 * self.yaw_rad * dt_s) + 0.01 * dt_s.sqrt() * normal(rng);
        let seen = self.velocity_m_s + offset_m_s;
        let asked = ((wanted_m_s - seen) / LAG_S).cap_magnitude(LIMIT_M_S2);
        // Thrust is the believed mass times what is to be overcome.
        let gravity = Vector3::z() * GRAVITY_M_S2;
        let got = (asked + gravity) * (believed_kg / self.mass_kg) - gravity;
        self.acceleration_m_s2 = got + self.gust_m_s2;
        let before = self.velocity_m_s;
        self.velocity_m_s += self.acceleration_m_s2 * dt_s;
        self.position_m += (before + self.velocity_m_s) * (0.5 * dt_s);
        if self.position_m.z < 0.0 {
            // The ground holds it.
            self.position_m.z = 0.0;
            self.velocity_m_s = Vector3::new(0.0, 0.0, self.velocity_m_s.z.max(0.0));
        }
    }

    /// Whether the ground carries it.
    pub(super) fn is_on_ground(&self) -> bool {
        self.position_m.z <= 0.0 && self.velocity_m_s.z <= 0.0
    }

    /// Where it is and how it is turned: it leans into what accelerates it.
    pub(super) fn pose(&self) -> Pose {
        let lean = self.acceleration_m_s2 / GRAVITY_M_S2;
        Pose {
            position_m: self.position_m,
            attitude: UnitQuaternion::from_euler_angles(
                -lean.y.atan(),
                lean.x.atan(),
                self.yaw_rad,
            ),
        }
    }
}
