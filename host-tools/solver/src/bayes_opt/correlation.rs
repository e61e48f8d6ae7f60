//! How alike the function's values at two points are expected to be.

use nalgebra::SVector;

/// Matern correlation with smoothness 5/2 (Rasmussen and Williams, "Gaussian Processes for Machine
/// Learning", 2006, Eq. 4.17), one length scale a dimension:
///
/// ```text
/// k(r) = (1 + sqrt(5) r + 5 r^2 / 3) exp(-sqrt(5) r),   r^2 = sum ((x_i - y_i) / l_i)^2
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Matern52<const D: usize> {
    /// `sqrt(5) / l_i`.
    scale: SVector<f64, D>,
}

impl<const D: usize> Matern52<D> {
    pub(super) fn new(length_scales: &SVector<f64, D>) -> Self {
        Self {
            scale: length_scales.map(|length| 5f64.sqrt() / length),
        }
    }

    #[inline]
    pub(super) fn at(&self, x: &SVector<f64, D>, y: &SVector<f64, D>) -> f64 {
        let squared = (x - y).component_mul(&self.scale).norm_squared();
        let r = squared.sqrt();
        (1.0 + r + squared / 3.0) * (-r).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn value_at_one_length_scale_is_that_of_the_textbook() {
        let kernel = Matern52::new(&Vector2::new(0.5, 2.0));
        let root = 5f64.sqrt();
        let expected = (1.0 + root + 5.0 / 3.0) * (-root).exp();
        let origin = Vector2::zeros();
        assert!((kernel.at(&origin, &Vector2::new(0.5, 0.0)) - expected).abs() < 1e-15);
        assert!((kernel.at(&Vector2::new(0.0, 2.0), &origin) - expected).abs() < 1e-15);
        assert_eq!(kernel.at(&origin, &origin), 1.0);
    }
}
