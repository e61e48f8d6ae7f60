//! A spiral, for a platform that is not where GPS leads to.
//!
//! Archimedes' `r = b theta` with `theta = sqrt(1 + 2 v t / b)`: turns lie `pitch = 2 pi b` apart, so a camera that sees as wide misses
//! nothing, and the speed along it is `v` from the second turn on.

use nalgebra::{Vector2, Vector3};
use std::f64::consts::TAU;

/// How fast a vehicle beside the spiral comes back to it, 1/s.
const RETURN_PER_S: f64 = 0.5;

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spiral {
    /// Distance of two turns, metres.
    pub pitch_m: f64,
    /// Speed, m/s.
    pub speed_m_s: f64,
}

impl Default for Spiral {
    fn default() -> Self {
        Self {
            pitch_m: 2.0,
            speed_m_s: 1.0,
        }
    }
}

impl Spiral {
    /// The wanted velocity `after_s` seconds after it began about `centre_m`, m/s; the height stays.
    pub fn velocity_m_s(
        &self,
        after_s: f64,
        centre_m: &Vector3<f64>,
        place_m: &Vector3<f64>,
    ) -> Vector3<f64> {
        let b = self.pitch_m / TAU;
        let theta = (1.0 + 2.0 * self.speed_m_s * after_s.max(0.0) / b).sqrt();
        let (sin, cos) = theta.sin_cos();
        let outwards = Vector2::new(cos, sin).push(0.0);
        let onwards = Vector2::new(-sin, cos).push(0.0);
        let here_m = centre_m + outwards * (b * theta);
        let back = ((here_m - place_m) * RETURN_PER_S).cap_magnitude(self.speed_m_s);
        (outwards / theta + onwards) * self.speed_m_s + back
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Half a minute covers three metres.
        #[test]
        fn nothing_within_three_metres_is_farther_aside_than_a_pitch(angle in 0.0..TAU, away_m in 0.0..3.2f64) {
            let spiral = Spiral::default();
            let centre_m = Vector3::new(1.0, -2.0, 3.0);
            let hidden_m = centre_m + Vector3::new(angle.cos(), angle.sin(), 0.0) * away_m;
            let (mut place_m, mut nearest_m) = (centre_m, f64::INFINITY);
            for tick in 0..3000 {
                let velocity = spiral.velocity_m_s(0.01 * f64::from(tick), &centre_m, &place_m);
                prop_assert!(velocity.norm() < 2.5 * spiral.speed_m_s);
                place_m += velocity * 0.01;
                nearest_m = nearest_m.min((place_m - hidden_m).norm());
            }
            prop_assert!((place_m.z - 3.0).abs() < 1e-9);
            prop_assert!(nearest_m < 0.5 * spiral.pitch_m + 0.1, "{nearest_m}");
        }
    }
}
