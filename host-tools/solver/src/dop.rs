//! Dilution of precision: how geometry alone magnifies range noise into position error.
//!
//! With unit vectors `u_i` from the places of measurement to the node, `H = [u_1 ... u_n]^T` and `Q
//! = (H^T H)^-1`:
//!
//! ```text
//! HDOP = sqrt(Q_xx + Q_yy),  VDOP = sqrt(Q_zz),  PDOP = sqrt(trace Q)
//! ```
//!
//! Independent ranges of standard deviation `sigma` give a position error of `sigma PDOP` (root
//! mean square). Unlike GNSS there is no clock to estimate: two-way ranges cancel it. With a common
//! range bias among the unknowns use [`Dop::with_bias`].

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};

/// Dilution of precision of `n` places of measurement for one node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dop {
    /// In the horizontal plane.
    pub hdop: f64,
    /// Vertical.
    pub vdop: f64,
    /// All three axes.
    pub pdop: f64,
}

impl Dop {
    /// Of a node at `node_m` measured once from each of `places_m`. `None` where the places do not
    /// span all three directions.
    pub fn of(places_m: &[Vector3<f64>], node_m: Vector3<f64>) -> Option<Self> {
        let mut information = Matrix3::zeros();
        for place in places_m {
            let u = direction(*place, node_m);
            information += u * u.transpose();
        }
        Self::from_position_covariance(&invert(information)?)
    }

    /// The same where a common range bias is estimated along with the position.
    pub fn with_bias(places_m: &[Vector3<f64>], node_m: Vector3<f64>) -> Option<Self> {
        let mut information = Matrix4::zeros();
        for place in places_m {
            let u = direction(*place, node_m);
            let j = Vector4::new(u.x, u.y, u.z, 1.0);
            information += j * j.transpose();
        }
        let covariance = invert(information)?;
        Self::from_position_covariance(&covariance.fixed_view::<3, 3>(0, 0).into_owned())
    }

    fn from_position_covariance(q: &Matrix3<f64>) -> Option<Self> {
        let root =
            |variance: f64| (variance >= 0.0 && variance.is_finite()).then(|| variance.sqrt());
        Some(Self {
            hdop: root(q[(0, 0)] + q[(1, 1)])?,
            vdop: root(q[(2, 2)])?,
            pdop: root(q.trace())?,
        })
    }
}

fn direction(place_m: Vector3<f64>, node_m: Vector3<f64>) -> Vector3<f64> {
    (node_m - place_m)
        .try_normalize(0.0)
        .unwrap_or_else(Vector3::zeros)
}

/// `None` where the reciprocal condition is below 1e-12: beyond that the digits of the inverse mean
/// nothing.
fn invert<const N: usize>(
    matrix: nalgebra::SMatrix<f64, N, N>,
) -> Option<nalgebra::SMatrix<f64, N, N>> {
    let inverse = nalgebra::Cholesky::<f64, nalgebra::Const<N>>::new(matrix)?.inverse();
    (inverse.trace() * matrix.trace() < 1e12).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_orthogonal_directions_have_unit_axes() {
        let places = [Vector3::x() * 5.0, Vector3::y() * 7.0, Vector3::z() * 9.0];
        let dop = Dop::of(&places, Vector3::zeros()).unwrap();
        assert!((dop.hdop - 2f64.sqrt()).abs() < 1e-12);
        assert!((dop.vdop - 1.0).abs() < 1e-12);
        assert!((dop.pdop - 3f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn every_place_twice_shrinks_it_by_root_two() {
        let once = [
            Vector3::new(5.0, 1.0, 0.0),
            Vector3::new(-1.0, 7.0, 2.0),
            Vector3::new(0.0, 1.0, 9.0),
            Vector3::new(3.0, -4.0, 1.0),
        ];
        let twice: Vec<_> = once.iter().chain(&once).copied().collect();
        for of in [Dop::of, Dop::with_bias] {
            let (one, two) = (
                of(&once, Vector3::zeros()).unwrap(),
                of(&twice, Vector3::zeros()).unwrap(),
            );
            assert!((one.pdop / two.pdop - 2f64.sqrt()).abs() < 1e-9);
        }
    }

    #[test]
    fn coplanar_directions_have_no_dop() {
        let places = [
            Vector3::x(),
            Vector3::y(),
            Vector3::new(1.0, 1.0, 0.0),
            -Vector3::x(),
        ];
        assert_eq!(Dop::of(&places, Vector3::zeros()), None);
    }

    #[test]
    fn estimating_the_bias_never_helps() {
        let places = [
            Vector3::new(5.0, 1.0, 0.0),
            Vector3::new(-1.0, 7.0, 2.0),
            Vector3::new(0.0, 1.0, 9.0),
            Vector3::new(3.0, -4.0, 1.0),
        ];
        let known = Dop::of(&places, Vector3::zeros()).unwrap();
        let estimated = Dop::with_bias(&places, Vector3::zeros()).unwrap();
        assert!(estimated.pdop >= known.pdop);
    }
}
