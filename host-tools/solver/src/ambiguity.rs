//! Other places that explain the ranges as well.
//!
//! Ranges from places in a plane are the same for a node and its mirror image in that plane; from
//! places on a line, for a whole ring. Real paths are nearly flat or nearly straight, so the mirror
//! image is a second minimum with a somewhat higher cost, and the question is whether the
//! difference means anything. The log-likelihood ratio of the two is
//!
//! ```text
//! L = 1/2 sum_i [rho(r_i at mirror) - rho(r_i at best)] t^2 / f,   r_i = misfit_i / (t sigma_i)
//! ```
//!
//! `f` is the variance factor of the fit: it holds the correlation of the errors and the systematic
//! error that no amount of data averages out (see [`crate::multilateration`]), so a thousand
//! correlated measurements do not shout down a mirror that differs by centimetres. `t` is the scale
//! of a single residual, systematic part included. `rho` is a wide Huber kernel: squares for all
//! that may be noise, while an outlier of both hypotheses, which tells nothing, counts little. (The
//! logarithm of the Cauchy kernel would saturate and find no hypothesis wrong.) The mirror has
//! probability `1 / (1 + exp L)`, and is reported unless that is below [`EXCLUDED_BELOW`].

use nalgebra::{Matrix3, Vector3};

use crate::geometry::Shape;
use crate::kernel::Kernel;
use crate::range_model::{Sample, State, thin};
use crate::robust_fit::{Fit, Fitter};

/// A competing place less probable than this counts as excluded.
pub(crate) const EXCLUDED_BELOW: f64 = 1e-3;

/// The way to a competitor is found with at most this many measurements.
const SEARCH_SAMPLES: usize = 64;

/// Where to look for competitors of `place`: its mirror images in the principal planes of the path
/// that hold its long axis, and in that axis.
fn mirror_images(shape: &Shape, place: Vector3<f64>) -> [Vector3<f64>; 3] {
    let [_, wide, flat] = shape.axes;
    let from_centre = place - shape.centre;
    let in_flat = place - 2.0 * from_centre.dot(&flat) * flat;
    let in_wide = place - 2.0 * from_centre.dot(&wide) * wide;
    [in_flat, in_wide, in_flat + in_wide - place]
}

/// Two minima are one if they lie within three standard deviations of each other.
pub(crate) fn same_place(a: &Vector3<f64>, b: &Vector3<f64>, covariance: &Matrix3<f64>) -> bool {
    let apart = b - a;
    match apart.try_normalize(1e-9) {
        None => true,
        Some(along) => apart.norm_squared() <= 9.0 * along.dot(&(covariance * along)),
    }
}

/// Minima other than `best` at the same scale over the same samples, the lowest cost first. `extra`
/// are further points to start from.
pub(crate) fn competitors(
    best: &Fit,
    covariance: &Matrix3<f64>,
    shape: &Shape,
    extra: &[Fit],
    samples: &[Sample],
    fitter: &Fitter<'_>,
    prior_factor: f64,
) -> Vec<Fit> {
    let place = best.x.xyz();
    let images =
        mirror_images(shape, place).map(|image| State::new(image.x, image.y, image.z, best.x.w));
    let mut found: Vec<Fit> = Vec::new();
    let few = thin(samples, SEARCH_SAMPLES);
    let mut scratch = Vec::with_capacity(few.len());
    for mut start in images.into_iter().chain(extra.iter().map(|fit| fit.x)) {
        // A known height stays as it is: the axes of the path need not be level.
        if !fitter.unknowns.free[2] {
            start.z = best.x.z;
        }
        let known = |fit: &Fit| same_place(&fit.x.xyz(), &start.xyz(), covariance);
        if known(best) || found.iter().any(known) {
            continue;
        }
        let fit =
            fitter.at_scale_from_afar(samples, &few, start, best.scale, prior_factor, &mut scratch);
        let known = |other: &Fit| same_place(&other.x.xyz(), &fit.x.xyz(), covariance);
        if !(known(best) || found.iter().any(known)) {
            found.push(fit);
        }
    }
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    found
}

/// Huber width for the comparison of hypotheses, in sigma.
const COMPARISON: Kernel = Kernel::Huber { k: 3.0 };

/// `2 t^2 / f L` of the module's text at one place; differences of it compare places.
pub(crate) fn misfit(samples: &[Sample], x: &State, scale: f64) -> f64 {
    samples
        .iter()
        .map(|sample| {
            let r = sample.whitened(x) / scale;
            COMPARISON.rho_and_weight(r * r).0
        })
        .sum()
}

/// Probability of a competitor whose log-likelihood is lower by `log_ratio`.
pub(crate) fn probability(log_ratio: f64) -> f64 {
    1.0 / (1.0 + log_ratio.exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_keep_the_distance_to_a_flat_and_to_a_straight_path() {
        let node = Vector3::new(3.0, 4.0, 5.0);
        let flat: Vec<_> = (0..30)
            .map(|i| Vector3::new(f64::from(i), f64::from(i * i % 7), 2.0))
            .collect();
        let shape = Shape::of(flat.iter().copied()).unwrap();
        let [in_flat, ..] = mirror_images(&shape, node);
        assert!((in_flat - Vector3::new(3.0, 4.0, -1.0)).norm() < 1e-9);

        let straight: Vec<_> = (0..30)
            .map(|i| Vector3::new(f64::from(i), 1.0, 2.0))
            .collect();
        let shape = Shape::of(straight.iter().copied()).unwrap();
        for image in mirror_images(&shape, node) {
            for place in &straight {
                assert!(((image - place).norm() - (node - place).norm()).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn equal_costs_are_even_odds_and_large_differences_exclude() {
        assert_eq!(probability(0.0), 0.5);
        assert!(probability(7.0) < EXCLUDED_BELOW);
        assert!(probability(6.5) > EXCLUDED_BELOW);
        assert_eq!(probability(1e9), 0.0);
    }
}
