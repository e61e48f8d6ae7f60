//! How the vehicle moves.

use nalgebra::Vector3;

/// A vehicle that follows wanted velocities through moving air, with limited acceleration.
///
/// Velocities change evenly within a tick, so that
/// `p' = p + (v + v') dt/2`, and an accelerometer that reads `(v' - v)/dt` tells all of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vehicle {
    /// Where it is, metres.
    pub position_m: Vector3<f64>,
    /// How fast it moves through the air, m/s.
    air_velocity_m_s: Vector3<f64>,
    /// How fast the air carries it, m/s.
    wind_m_s: Vector3<f64>,
    /// How fast the velocity through the air can be changed, m/s^2.
    limit_m_s2: f64,
}

/// What accelerated the vehicle during a tick, m/s^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acceleration {
    /// Its own doing.
    pub own_m_s2: Vector3<f64>,
    /// The wind's.
    pub wind_m_s2: Vector3<f64>,
}

impl Vehicle {
    /// A vehicle that hovers in still air.
    pub fn hovering(position_m: Vector3<f64>, limit_m_s2: f64) -> Self {
        Self {
            position_m,
            air_velocity_m_s: Vector3::zeros(),
            wind_m_s: Vector3::zeros(),
            limit_m_s2,
        }
    }

    /// Moves for `dt_s` while it strives for `wanted_m_s` through the air and the wind becomes
    /// `wind_m_s`.
    pub fn step(
        &mut self,
        wanted_m_s: Vector3<f64>,
        wind_m_s: Vector3<f64>,
        dt_s: f64,
    ) -> Acceleration {
        let change = (wanted_m_s - self.air_velocity_m_s).cap_magnitude(self.limit_m_s2 * dt_s);
        let gust = wind_m_s - self.wind_m_s;
        let before = self.air_velocity_m_s + self.wind_m_s;
        self.position_m += (before + (change + gust) * 0.5) * dt_s;
        self.air_velocity_m_s += change;
        self.wind_m_s = wind_m_s;
        Acceleration {
            own_m_s2: change / dt_s,
            wind_m_s2: gust / dt_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn integrating_what_it_feels_gives_back_its_path(
            steps in prop::collection::vec((prop::array::uniform3(-2.0..2.0f64), prop::array::uniform3(-1.0..1.0f64)), 1..50),
        ) {
            let dt_s = 0.01;
            let mut vehicle = Vehicle::hovering(Vector3::new(1.0, 2.0, 3.0), 5.0);
            let (mut position, mut velocity) = (vehicle.position_m, Vector3::zeros());
            for (wanted, wind) in steps {
                let felt = vehicle.step(wanted.into(), wind.into(), dt_s);
                let acceleration = felt.own_m_s2 + felt.wind_m_s2;
                prop_assert!(felt.own_m_s2.norm() <= 5.0 * (1.0 + 1e-9));
                position += (velocity + acceleration * (0.5 * dt_s)) * dt_s;
                velocity += acceleration * dt_s;
                prop_assert!((position - vehicle.position_m).norm() < 1e-9);
            }
        }
    }
}
