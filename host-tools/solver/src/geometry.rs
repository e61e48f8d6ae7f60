//! The shape of a set of places: centre, principal axes, how many are distinct.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Centre and principal axes of a set of places.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    pub(crate) centre: Vector3<f64>,
    /// Unit vectors, the longest extent first.
    pub(crate) axes: [Vector3<f64>; 3],
    /// Standard deviation of the places along each axis.
    pub(crate) extents: [f64; 3],
}

impl Shape {
    /// `None` for an empty set.
    pub(crate) fn of(places: impl ExactSizeIterator<Item = Vector3<f64>> + Clone) -> Option<Self> {
        let n = places.len() as f64;
        if n == 0.0 {
            return None;
        }
        let centre = places.clone().sum::<Vector3<f64>>() / n;
        let scatter: Matrix3<f64> = places
            .map(|place| {
                let d = place - centre;
                d * d.transpose()
            })
            .sum::<Matrix3<f64>>()
            / n;
        let (variances, axes) = descending_eigen(scatter);
        Some(Self {
            centre,
            axes,
            extents: variances.map(|v| v.max(0.0).sqrt()),
        })
    }
}

/// Eigenvalues of a symmetric matrix in descending order, with unit eigenvectors.
pub(crate) fn descending_eigen(matrix: Matrix3<f64>) -> ([f64; 3], [Vector3<f64>; 3]) {
    let eigen = SymmetricEigen::new(matrix);
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
    (
        order.map(|i| eigen.eigenvalues[i]),
        order.map(|i| eigen.eigenvectors.column(i).into_owned()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_of_a_tilted_strip_are_its_directions() {
        let long = Vector3::new(1.0, 1.0, 0.0).normalize();
        let wide = Vector3::new(0.0, 0.0, 1.0);
        let mut places = Vec::new();
        for i in -5..=5 {
            for j in -1..=1 {
                places.push(
                    Vector3::new(7.0, 8.0, 9.0) + long * f64::from(i) + wide * f64::from(j) * 0.5,
                );
            }
        }
        let shape = Shape::of(places.iter().copied()).unwrap();
        assert!((shape.centre - Vector3::new(7.0, 8.0, 9.0)).norm() < 1e-12);
        assert!((shape.axes[0].dot(&long).abs() - 1.0).abs() < 1e-12);
        assert!((shape.axes[1].dot(&wide).abs() - 1.0).abs() < 1e-12);
        assert!(shape.extents[2] < 1e-7);
        assert!((shape.extents[0] - 10f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn no_places_have_no_shape() {
        assert!(
            Shape::of(
                std::iter::empty::<Vector3<f64>>()
                    .collect::<Vec<_>>()
                    .iter()
                    .copied()
            )
            .is_none()
        );
    }
}
