//! A place from ranges by linear algebra.
//!
//! From each `|p - a_i|^2 = d_i^2` the mean of all is taken off, and what is quadratic in `p` goes:
//!
//! ```text
//! 2 (a_i - a)^T p = (|a_i|^2 - d_i^2) - mean(|a_i|^2 - d_i^2),     a = mean a_i
//! ```
//!
//! Anchors in a plane leave the direction across open; the mean of the ranges then gives the distance
//! from the plane, to either side.

use nalgebra::{DMatrix, DVector, Vector3};

use super::AnchorRange;

/// Smaller singular values than this part of the largest count as none.
const FLAT: f64 = 0.05;

/// One place, two where the anchors lie in a plane, none where they lie on a line (unless the height is
/// known) or are too few. Rough: noise of the ranges is magnified, outliers are not seen.
pub fn closed_form(ranges: &[AnchorRange], height_m: Option<f64>) -> Vec<Vector3<f64>> {
    let axes = if height_m.is_some() { 2 } else { 3 };
    if ranges.len() < axes {
        return Vec::new();
    }
    let n = ranges.len() as f64;
    let centre = ranges.iter().map(|r| r.anchor_m).sum::<Vector3<f64>>() / n;
    let depth = height_m.map(|height| height - centre.z);
    // About the centre of the anchors, squares of what the ranges leave for the free axes.
    let square = |r: &AnchorRange| {
        let a = r.anchor_m - centre;
        match depth {
            Some(z) => a.xy().norm_squared() - r.range_m.powi(2) + (z - a.z).powi(2),
            None => a.norm_squared() - r.range_m.powi(2),
        }
    };
    let mean_square = ranges.iter().map(square).sum::<f64>() / n;
    let rows = DMatrix::from_fn(ranges.len(), axes, |i, k| {
        ranges
            .get(i)
            .map_or(0.0, |r| 2.0 * (r.anchor_m - centre)[k])
    });
    let right =
        DVector::from_iterator(ranges.len(), ranges.iter().map(|r| square(r) - mean_square));
    let svd = rows.svd(true, true);
    let (Some(v), largest) = (&svd.v_t, svd.singular_values.max()) else {
        return Vec::new();
    };
    let solid = svd
        .singular_values
        .iter()
        .filter(|s| **s > FLAT * largest)
        .count();
    // On a line (or, at a known height, above one another) they leave a circle.
    if largest.is_nan() || largest <= 0.0 || solid < 2 {
        return Vec::new();
    }
    let Ok(p) = svd.solve(&right, FLAT * largest) else {
        return Vec::new();
    };
    let place = |p: &DVector<f64>| {
        let z = depth.unwrap_or_else(|| p.get(2).copied().unwrap_or(0.0));
        centre + Vector3::new(p[0], p[1], z)
    };
    if solid == axes {
        return vec![place(&p)];
    }
    // |p|^2 = mean d^2 - mean |a|^2 + 2 mean(a)^T p, and the anchors' mean is the origin here.
    let across2 = -mean_square - p.norm_squared();
    let mut least = 0;
    for (k, s) in svd.singular_values.iter().enumerate() {
        if *s < svd.singular_values[least] {
            least = k;
        }
    }
    let across = v.row(least).transpose() * across2.max(0.0).sqrt();
    vec![place(&(&p + &across)), place(&(&p - &across))]
}
