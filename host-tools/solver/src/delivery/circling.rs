//! Circles about the path, which make one tag enough.
//!
//! Straight above a tag its range tells the height and nothing else. On a circle of radius `rho = share * z` about where the tag is
//! believed to be, a place that is off by `e` makes the range swing by `e rho / sqrt(z^2 + rho^2)`: the same part of `e` at any height.
//!
//! The field is that of the path, moved aside by where on the circle the vehicle has to be: `F(p - c(t, z)) + dc/dt`.

use super::field::VectorField;
use nalgebra::{Vector2, Vector3};
use std::f64::consts::TAU;

/// How to circle on the way down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circling {
    /// Radius over height.
    pub share: f64,
    /// Largest radius, metres.
    pub most_radius_m: f64,
    /// Seconds a turn.
    pub period_s: f64,
    /// Height below which circles are flown, metres; they grow over the first fifth of it.
    pub begin_m: f64,
}

impl Default for Circling {
    fn default() -> Self {
        Self {
            share: 0.25,
            most_radius_m: 1.5,
            period_s: 7.0,
            begin_m: 20.0,
        }
    }
}

impl Circling {
    /// The wanted velocity at a time and a place on the way down, m/s.
    pub fn velocity_m_s(
        &self,
        field: &VectorField,
        t_s: f64,
        place_m: &Vector3<f64>,
    ) -> Vector3<f64> {
        let (radius_m, slope) = self.radius_m(place_m.z);
        let rate = TAU / self.period_s;
        let (sin, cos) = (rate * t_s).sin_cos();
        let outwards = Vector2::new(cos, sin).push(0.0);
        let onwards = Vector2::new(-sin, cos).push(0.0);
        let along = field.velocity_m_s(&(place_m - outwards * radius_m), true);
        along + onwards * (rate * radius_m) + outwards * (slope * along.z)
    }

    /// Radius at a height, metres, and how it grows with the height.
    fn radius_m(&self, height_m: f64) -> (f64, f64) {
        let (wide_m, slope) = if self.share * height_m < self.most_radius_m {
            (self.share * height_m.max(0.0), self.share)
        } else {
            (self.most_radius_m, 0.0)
        };
        let fading_m = 0.2 * self.begin_m;
        let grown = (self.begin_m - height_m) / fading_m;
        if grown >= 1.0 {
            (wide_m, if height_m > 0.0 { slope } else { 0.0 })
        } else if grown > 0.0 {
            (wide_m * grown, slope * grown - wide_m / fading_m)
        } else {
            (0.0, 0.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delivery::{DeliveryPath, FieldOptions};
    use proptest::prelude::*;

    proptest! {
        /// A vehicle that flies as it is told goes round the path at the wanted radius, down to the ground.
        #[test]
        fn whoever_follows_it_comes_down_in_circles_about_the_path(x in -2.0..2.0f64, y in -2.0..2.0f64, from_s in 0.0..100.0f64) {
            let path = DeliveryPath::new(45.0, 6.0, 100.0).unwrap();
            let field = VectorField::new(path, FieldOptions { convergence_per_m: 6.0, ..FieldOptions::default() });
            let circling = Circling::default();
            let (mut place_m, mut t_s) = (Vector3::new(x, y, 30.0), from_s);
            let mut lowest_m = 30.0;
            while place_m.z > 0.05 {
                place_m += circling.velocity_m_s(&field, t_s, &place_m) * 0.01;
                t_s += 0.01;
                prop_assert!(t_s - from_s < 200.0, "still at {place_m}");
                // Never up again.
                prop_assert!(place_m.z < lowest_m);
                lowest_m = place_m.z;
                if place_m.z < 12.0 {
                    let wanted_m = (0.25 * place_m.z).min(1.5);
                    prop_assert!((place_m.xy().norm() - wanted_m).abs() < 0.05, "{place_m}");
                }
            }
            prop_assert!(place_m.xy().norm() < 0.05);
        }

        #[test]
        fn the_radius_has_no_steps_and_grows_as_it_says(height_m in -1.0..50.0f64) {
            let circling = Circling::default();
            let [below, here, above] = [-1e-5, 0.0, 1e-5].map(|off| circling.radius_m(height_m + off));
            prop_assert!((above.0 - below.0).abs() < 2e-5);
            // Apart from its corners.
            let corner = [0.0, 6.0, 16.0, 20.0].iter().any(|c: &f64| (height_m - c).abs() < 1e-4);
            prop_assert!(corner || ((above.0 - below.0) / 2e-5 - here.1).abs() < 1e-4);
        }
    }
}
