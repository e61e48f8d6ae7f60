//! Dead reckoning from an accelerometer and a barometer.
//!
//! Paper Eq. 1: horizontal acceleration is integrated twice, height is what the barometer says,
//!
//! ```text
//! p_INS(t) = ( ∫ v_x dt, ∫ v_y dt, h_barometer(t) ),     v_x = ∫ a_x dt,  v_y = ∫ a_y dt.
//! ```
//!
//! A reading of acceleration is taken as the mean since the reading before it, which is what an
//! accelerometer's low-pass makes of it. With `dt` between the two,
//!
//! ```text
//! p' = p + v dt + a dt^2/2          v' = v + a dt
//! ```
//!
//! is then exact. How errors of the readings grow is told in [`crate::ins_error`].

use crate::measurement::LARGEST_LENGTH_M;
use crate::navigation::{InputFault, InsSample};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

/// Standard gravity, m/s^2.
pub const GRAVITY_M_S2: f64 = 9.806_65;

/// Acceleration over ground, ENU, m/s^2, from an accelerometer's specific force along the body's
/// axes (at rest it reads gravity upwards) and the body's attitude.
pub fn acceleration_over_ground(
    specific_force_m_s2: Vector3<f64>,
    body_to_enu: &UnitQuaternion<f64>,
) -> Vector3<f64> {
    body_to_enu * specific_force_m_s2 - Vector3::new(0.0, 0.0, GRAVITY_M_S2)
}

/// Position and velocity by dead reckoning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ins {
    t_s: f64,
    position_m: Vector2<f64>,
    velocity_m_s: Vector2<f64>,
    height_m: f64,
}

impl Ins {
    /// At hand-over: ENU position in metres and horizontal velocity in m/s.
    pub fn new(t_s: f64, position_m: Vector3<f64>, velocity_m_s: Vector2<f64>) -> Self {
        Self {
            t_s,
            position_m: position_m.xy(),
            velocity_m_s,
            height_m: position_m.z,
        }
    }

    /// Takes the mean acceleration (east, north, m/s^2) from the last reading until `t_s`.
    ///
    /// # Errors
    /// [`InputFault::NotFinite`] or [`InputFault::TimeNotIncreasing`]; nothing has changed then.
    pub fn on_acceleration(
        &mut self,
        t_s: f64,
        acceleration_m_s2: Vector2<f64>,
    ) -> Result<(), InputFault> {
        if !(usable(t_s) && acceleration_m_s2.iter().all(|&a| usable(a))) {
            return Err(InputFault::NotFinite);
        }
        let dt_s = t_s - self.t_s;
        if dt_s <= 0.0 {
            return Err(InputFault::TimeNotIncreasing {
                t_s,
                last_s: self.t_s,
            });
        }
        self.position_m += (self.velocity_m_s + acceleration_m_s2 * (0.5 * dt_s)) * dt_s;
        self.velocity_m_s += acceleration_m_s2 * dt_s;
        self.t_s = t_s;
        Ok(())
    }

    /// Takes the barometer's height in metres.
    ///
    /// # Errors
    /// [`InputFault::NotFinite`]; nothing has changed then.
    pub fn on_height(&mut self, height_m: f64) -> Result<(), InputFault> {
        if !usable(height_m) {
            return Err(InputFault::NotFinite);
        }
        self.height_m = height_m;
        Ok(())
    }

    /// Reckoned horizontal velocity, m/s.
    pub fn velocity_m_s(&self) -> Vector2<f64> {
        self.velocity_m_s
    }

    /// What a navigator is told.
    pub fn sample(&self) -> InsSample {
        InsSample {
            t_s: self.t_s,
            position_m: self.position_m.push(self.height_m),
        }
    }
}

/// NaN fails every comparison.
fn usable(number: f64) -> bool {
    number.abs() <= LARGEST_LENGTH_M
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_acceleration_gives_the_parabola_of_the_school_book() {
        let mut ins = Ins::new(5.0, Vector3::new(1.0, 2.0, 30.0), Vector2::new(0.5, -1.0));
        let acceleration = Vector2::new(0.3, 0.1);
        // Uneven steps: the result depends on the end alone.
        for t_s in [5.01, 5.3, 6.0, 8.999, 9.0] {
            ins.on_acceleration(t_s, acceleration).unwrap();
        }
        let t = 4.0;
        let expected = Vector3::new(
            1.0 + 0.5 * t + 0.5 * 0.3 * t * t,
            2.0 - t + 0.5 * 0.1 * t * t,
            30.0,
        );
        assert!((ins.sample().position_m - expected).norm() < 1e-12);
        assert!((ins.velocity_m_s() - Vector2::new(1.7, -0.6)).norm() < 1e-12);
    }

    #[test]
    fn height_is_the_barometers_and_nothing_else() {
        let mut ins = Ins::new(0.0, Vector3::new(0.0, 0.0, 30.0), Vector2::zeros());
        ins.on_height(29.5).unwrap();
        ins.on_acceleration(1.0, Vector2::new(1.0, 0.0)).unwrap();
        assert_eq!(ins.sample().position_m, Vector3::new(0.5, 0.0, 29.5));
    }

    #[test]
    fn a_tilted_body_at_rest_does_not_accelerate() {
        let attitude = UnitQuaternion::from_euler_angles(0.3, -0.2, 1.0);
        let felt = attitude.inverse() * Vector3::new(0.0, 0.0, GRAVITY_M_S2);
        assert!(acceleration_over_ground(felt, &attitude).norm() < 1e-12);
    }

    #[test]
    fn unusable_readings_are_refused_and_change_nothing() {
        let mut ins = Ins::new(1.0, Vector3::zeros(), Vector2::new(1.0, 0.0));
        let before = ins;
        let nothing = Vector2::zeros();
        assert_eq!(
            ins.on_acceleration(1.0, nothing),
            Err(InputFault::TimeNotIncreasing {
                t_s: 1.0,
                last_s: 1.0
            })
        );
        for bad in [f64::NAN, f64::INFINITY] {
            assert_eq!(
                ins.on_acceleration(bad, nothing),
                Err(InputFault::NotFinite)
            );
            assert_eq!(
                ins.on_acceleration(2.0, Vector2::new(0.0, bad)),
                Err(InputFault::NotFinite)
            );
            assert_eq!(ins.on_height(bad), Err(InputFault::NotFinite));
        }
        assert_eq!(ins, before);
    }
}
