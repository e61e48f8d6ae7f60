//! A place from differences of ranges by linear algebra and one quadratic equation.
//!
//! Miranda et al. (2022), Eq. 2-4: with the base anchor as origin, `d` the tag's distance to it and `r_i` how much
//! further anchor `i` is, `|p - x_i| = d + r_i` squared gives (their Eq. 3 has lost some brackets and squares)
//!
//! ```text
//! (r_i + d)^2 = |x_i|^2 - 2 x_i . p + d^2      =>      2 x_i . p = |x_i|^2 - r_i^2 - 2 r_i d
//! p = A + B d,   |p|^2 = d^2:   (B.B - 1) d^2 + 2 A.B d + A.A = 0
//! ```
//!
//! Spherical intersection (Schau and Robinson 1987): up to two places. Anchors in a plane leave the direction
//! across open; `d` is then an unknown of the linear equations, and the distance from the plane follows
//! from it, to either side. Differences of any pairs come down to `r_i` by least squares, of a pair the
//! median.

use nalgebra::{DMatrix, DVector, Vector3};

use super::RangeDifference;

/// Smaller singular values than this part of the largest count as none.
const FLAT: f64 = 0.02;

/// Up to two places, rough: noise is magnified; of outliers only those are not seen that are fewer than half
/// of their pair's. None where the differences do not hang together, or anchors are fewer than four or on a
/// line.
pub fn closed_form_differences(differences: &[RangeDifference]) -> Vec<Vector3<f64>> {
    let (anchors, pairs) = pairs(differences);
    let further = match further(anchors.len(), &pairs) {
        Some(further) if further.iter().all(|r| r.is_finite()) => further,
        _ => return Vec::new(),
    };
    let Some((base, others)) = anchors.split_first().filter(|(_, o)| o.len() >= 3) else {
        return Vec::new();
    };
    let rows = DMatrix::from_fn(others.len(), 3, |i, k| {
        others.get(i).map_or(0.0, |a| 2.0 * (a - base)[k])
    });
    let known = DVector::from_iterator(
        others.len(),
        (others.iter().zip(&further)).map(|(a, r)| (a - base).norm_squared() - r * r),
    );
    let by_distance = DVector::from_iterator(others.len(), further.iter().map(|r| -2.0 * r));
    let svd = rows.clone().svd(true, true);
    let largest = svd.singular_values.max();
    if !(largest > 0.0 && largest.is_finite()) {
        return Vec::new();
    }
    let solid = (svd.singular_values.iter())
        .filter(|s| **s > FLAT * largest)
        .count();
    let found = match solid {
        3 => in_space(&svd, &known, &by_distance),
        2 => off_plane(&svd, &rows, &known, &by_distance),
        _ => return Vec::new(),
    };
    (found.into_iter())
        .filter(|p| p.iter().all(|v| v.is_finite()))
        .map(|p| base + p)
        .collect()
}

/// Two anchors' numbers, how much further the second is, and how much is known about that (1/m^2).
type Pair = ([usize; 2], f64, f64);
type Svd = nalgebra::SVD<f64, nalgebra::Dyn, nalgebra::Dyn>;

fn in_space(svd: &Svd, known: &DVector<f64>, by_distance: &DVector<f64>) -> Vec<Vector3<f64>> {
    let solve = |right: &DVector<f64>| -> Option<Vector3<f64>> {
        let x = svd.solve(right, 0.0).ok()?;
        Some(Vector3::new(*x.get(0)?, *x.get(1)?, *x.get(2)?))
    };
    let (Some(a), Some(b)) = (solve(known), solve(by_distance)) else {
        return Vec::new();
    };
    let (square, half, constant) = (b.norm_squared() - 1.0, a.dot(&b), a.norm_squared());
    // Noise may leave no root: the nearest to one is where the parabola turns.
    let root = (half * half - square * constant).max(0.0).sqrt();
    let lengths = if square.abs() < 1e-9 {
        vec![-constant / (2.0 * half)]
    } else {
        vec![(-half + root) / square, (-half - root) / square]
    };
    // A negative distance belongs to the other branch of the hyperbolas.
    let mut places: Vec<Vector3<f64>> = (lengths.iter())
        .filter(|d| **d >= 0.0)
        .map(|d| a + b * *d)
        .collect();
    places.dedup();
    places
}

fn off_plane(
    svd: &Svd,
    rows: &DMatrix<f64>,
    known: &DVector<f64>,
    by_distance: &DVector<f64>,
) -> Vec<Vector3<f64>> {
    let Some(v) = &svd.v_t else {
        return Vec::new();
    };
    let mut axes: Vec<(f64, Vector3<f64>)> = (svd.singular_values.iter().zip(v.row_iter()))
        .map(|(s, row)| (*s, Vector3::from_iterator(row.iter().copied())))
        .collect();
    axes.sort_by(|one, other| other.0.total_cmp(&one.0));
    let [(_, x), (_, y), (_, across)] = axes[..] else {
        return Vec::new();
    };
    let unknowns = DMatrix::from_columns(&[rows * x, rows * y, -by_distance]);
    let Ok(q) = unknowns.svd(true, true).solve(known, 1e-9) else {
        return Vec::new();
    };
    let (Some(&qx), Some(&qy), Some(&d)) = (q.get(0), q.get(1), q.get(2)) else {
        return Vec::new();
    };
    let in_plane = x * qx + y * qy;
    let height = (d * d - in_plane.norm_squared()).max(0.0).sqrt();
    vec![in_plane + across * height, in_plane - across * height]
}

/// Anchors at different places; of each pair that was measured the median difference, with the pair's
/// information.
fn pairs(differences: &[RangeDifference]) -> (Vec<Vector3<f64>>, Vec<Pair>) {
    let mut anchors: Vec<Vector3<f64>> = Vec::new();
    let mut measured: Vec<Pair> = Vec::with_capacity(differences.len());
    for d in differences {
        let [a, b] = d.anchors_m.map(|place| {
            (anchors.iter().position(|a| *a == place)).unwrap_or_else(|| {
                anchors.push(place);
                anchors.len() - 1
            })
        });
        let weight = d.sigma_m.powi(-2);
        if a < b {
            measured.push(([a, b], d.difference_m, weight));
        } else if b < a {
            measured.push(([b, a], -d.difference_m, weight));
        }
    }
    measured.sort_by(|one, other| one.0.cmp(&other.0).then(one.1.total_cmp(&other.1)));
    let pairs = (measured.chunk_by(|one, other| one.0 == other.0))
        .filter_map(|of| {
            let (ends, median, _) = *of.get(of.len() / 2)?;
            Some((ends, median, of.iter().map(|(.., weight)| weight).sum()))
        })
        .collect();
    (anchors, pairs)
}

/// How much further each anchor is than the first, by least squares over all pairs; `None` where they do not
/// hang together.
fn further(anchors: usize, pairs: &[Pair]) -> Option<Vec<f64>> {
    let n = anchors.checked_sub(1).filter(|n| *n > 0)?;
    let (mut information, mut right) = (DMatrix::zeros(n, n), DVector::zeros(n));
    for &([a, b], difference, weight) in pairs {
        let ends = [(a, -1.0), (b, 1.0)].map(|(end, sign)| (end.checked_sub(1), sign));
        for (i, si) in ends {
            let Some(i) = i else { continue };
            right[i] += weight * si * difference;
            for (k, sk) in ends {
                if let Some(k) = k {
                    information[(i, k)] += weight * si * sk;
                }
            }
        }
    }
    Some(
        (information.cholesky()?.solve(&right))
            .iter()
            .copied()
            .collect(),
    )
}
