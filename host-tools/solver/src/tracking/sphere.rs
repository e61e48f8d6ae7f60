//! Directions: differences on the unit sphere.

use nalgebra::{Matrix3x2, Vector3};

/// `Log_h(z)`: the tangent at `h` that leads to `z` along the great circle, as long as the angle
/// between them; eq. 23 without its approximation. Of the two opposite directions of a half-circle it
/// takes one.
pub fn log(h: &Vector3<f64>, z: &Vector3<f64>) -> Vector3<f64> {
    let along = h.dot(z);
    let across = z - h * along;
    let sine = across.norm();
    // The arc tangent is exact near 0 and near half a turn, where the arc cosine loses its digits.
    let angle = sine.atan2(along);
    if sine > 1e-12 {
        across * (angle / sine)
    } else if along >= 0.0 {
        across
    } else {
        tangents(h).column(0) * std::f64::consts::PI
    }
}

/// Two unit vectors across `h` and each other, `B` of eq. 23.
pub fn tangents(h: &Vector3<f64>) -> Matrix3x2<f64> {
    // Away from the axis that is nearest to h, the cross product is never short.
    let axis = match h.map(f64::abs).imin() {
        0 => Vector3::x(),
        1 => Vector3::y(),
        _ => Vector3::z(),
    };
    let first = h.cross(&axis).normalize();
    Matrix3x2::from_columns(&[first, h.cross(&first)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn direction() -> impl Strategy<Value = Vector3<f64>> {
        (-1.0..1.0_f64, -3.2..3.2_f64).prop_map(|(z, turn)| {
            let r = (1.0 - z * z).sqrt();
            Vector3::new(r * turn.cos(), r * turn.sin(), z)
        })
    }

    proptest! {
        #[test]
        fn following_the_tangent_leads_to_the_other_direction(h in direction(), z in direction()) {
            let tangent = log(&h, &z);
            prop_assert!(tangent.dot(&h).abs() < 1e-9);
            let angle = tangent.norm();
            prop_assume!(angle > 1e-9);
            let arrived = h * angle.cos() + tangent * (angle.sin() / angle);
            prop_assert!((arrived - z).norm() < 1e-9);
        }

        #[test]
        fn tangents_are_orthonormal(h in direction()) {
            let b = tangents(&h);
            prop_assert!((b.transpose() * b - nalgebra::Matrix2::identity()).norm() < 1e-12);
            prop_assert!((b.transpose() * h).norm() < 1e-12);
        }
    }

    #[test]
    fn opposite_and_equal_directions_have_their_angles() {
        let h = Vector3::new(0.0, 0.6, 0.8);
        assert!((log(&h, &-h).norm() - std::f64::consts::PI).abs() < 1e-12);
        assert_eq!(log(&h, &h).norm(), 0.0);
    }
}
