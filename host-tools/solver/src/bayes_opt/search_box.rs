//! Where to search.

use nalgebra::SVector;

/// A box in `R^D` with finite, positive edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchBox<const D: usize> {
    low: SVector<f64, D>,
    edge: SVector<f64, D>,
}

/// The bounds of a box are not finite or enclose nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("dimension {dimension} of the box is empty or not finite")]
pub struct EmptyBox {
    /// Which dimension, from 0.
    pub dimension: usize,
}

impl<const D: usize> SearchBox<D> {
    /// The box between two corners.
    ///
    /// # Errors
    /// [`EmptyBox`] unless `low < high` and both are finite in every dimension.
    pub fn new(low: SVector<f64, D>, high: SVector<f64, D>) -> Result<Self, EmptyBox> {
        let edge = high - low;
        let bad = |&i: &usize| !(low[i].is_finite() && edge[i].is_finite() && edge[i] > 0.0);
        match (0..D).find(bad) {
            Some(dimension) => Err(EmptyBox { dimension }),
            None => Ok(Self { low, edge }),
        }
    }

    /// From 0 to 1 in every dimension.
    pub fn unit() -> Self {
        Self {
            low: SVector::zeros(),
            edge: SVector::repeat(1.0),
        }
    }

    /// From the unit box to this one.
    pub(super) fn scaled(&self, unit: &SVector<f64, D>) -> SVector<f64, D> {
        self.low + unit.component_mul(&self.edge)
    }

    /// From this box to the unit one; what lies outside goes to the nearest face.
    pub(super) fn unscaled(&self, x: &SVector<f64, D>) -> SVector<f64, D> {
        (x - self.low)
            .component_div(&self.edge)
            .map(|c| c.clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn empty_and_endless_boxes_are_refused() {
        let low = Vector2::new(0.0, 0.0);
        for (x, y, dimension) in [
            (1.0, 0.0, 1),
            (-1.0, 1.0, 0),
            (f64::NAN, 1.0, 0),
            (1.0, f64::INFINITY, 1),
        ] {
            let refused = Err(EmptyBox { dimension });
            assert_eq!(SearchBox::new(low, Vector2::new(x, y)), refused);
        }
    }

    #[test]
    fn scaling_there_and_back_changes_nothing() {
        let search = SearchBox::new(Vector2::new(-3.0, 2.0), Vector2::new(5.0, 2.5)).unwrap();
        let x = Vector2::new(1.0, 2.2);
        assert!((search.scaled(&search.unscaled(&x)) - x).norm() < 1e-15);
        assert_eq!(
            search.scaled(&search.unscaled(&Vector2::new(9.0, 0.0))),
            Vector2::new(5.0, 2.0)
        );
    }
}
