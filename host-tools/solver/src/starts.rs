//! Where to start from, taken from the measurements alone.
//!
//! Each range says that the node is on a sphere (a circle, where the height is known). Points
//! spread over the spheres of a few measurements are ranked by the median of their absolute
//! residuals over all measurements: the median does not see outliers while they are fewer than
//! half, and among the few measurements at least one is sound. The best points are polished by a
//! robust fit.

use nalgebra::Vector3;

use crate::noise::robust_scale;
use crate::range_model::{Sample, State, thin};
use crate::robust_fit::{Fit, Fitter};

/// With 20 % outliers all of them are wild once in 80 000 times.
const REFERENCES: usize = 7;
/// Neighbours are 40 degrees apart; a fit converges from much further.
const DIRECTIONS: usize = 32;
/// How many points are polished.
const POLISHED: usize = 6;
/// The search works on at most this many measurements, spread over the log.
const SEARCH_SAMPLES: usize = 128;

/// Distinct robust minima, the best first. `height` is that of the node where it is known; `bias`
/// what the range bias is expected to be. Empty only for empty input.
pub(crate) fn search(
    samples: &[Sample],
    height: Option<f64>,
    bias: f64,
    fitter: &Fitter<'_>,
) -> Vec<Fit> {
    let thinned = thin(samples, SEARCH_SAMPLES);
    let mut scratch = Vec::with_capacity(thinned.len());
    let mut ranked: Vec<(f64, State)> = points(&thinned, height, bias)
        .map(|x| {
            scratch.clear();
            scratch.extend(thinned.iter().map(|sample| sample.whitened(&x)));
            (robust_scale(&mut scratch, 0), x)
        })
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let fits: Vec<Fit> = ranked
        .iter()
        .take(POLISHED)
        .map(|(_, start)| fitter.annealed(&thinned, *start, &mut scratch))
        .collect();
    // Costs compare only at one scale: that of the fit with the smallest.
    let scale = fits
        .iter()
        .map(|fit| fit.scale)
        .fold(f64::INFINITY, f64::min);
    let mut fits: Vec<Fit> = fits
        .iter()
        .map(|fit| fitter.at_scale(&thinned, fit.x, scale, 1.0))
        .collect();
    fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    fits
}

/// Points on the spheres (or circles) of a few measurements spread over the log.
fn points(samples: &[Sample], height: Option<f64>, bias: f64) -> impl Iterator<Item = State> {
    let step = samples.len().div_ceil(REFERENCES).max(1);
    samples
        .iter()
        .skip(step / 2)
        .step_by(step)
        .flat_map(move |sample| {
            let radius = (sample.range - bias).max(0.0);
            (0..DIRECTIONS).map(move |k| {
                let place = match height {
                    Some(z) => {
                        let drop = z - sample.position.z;
                        let reach = (radius * radius - drop * drop).max(0.0).sqrt();
                        let (sin, cos) =
                            (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
                        Vector3::new(
                            sample.position.x + reach * cos,
                            sample.position.y + reach * sin,
                            z,
                        )
                    }
                    None => sample.position + fibonacci_direction(k) * radius,
                };
                State::new(place.x, place.y, place.z, bias)
            })
        })
}

/// Point `k` of [`DIRECTIONS`] spread evenly over the unit sphere along a golden spiral.
fn fibonacci_direction(k: usize) -> Vector3<f64> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let z = 1.0 - (2.0 * k as f64 + 1.0) / DIRECTIONS as f64;
    let (sin, cos) = (golden_angle * k as f64).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    Vector3::new(radius * cos, radius * sin, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_leave_no_hole_wider_than_30_degrees() {
        let spread: Vec<_> = (0..DIRECTIONS).map(fibonacci_direction).collect();
        for i in 0..50 {
            for j in 0..50 {
                let (a, b) = (f64::from(i) * 0.1257, f64::from(j) / 25.0 - 0.98);
                let r = (1.0 - b * b).max(0.0).sqrt();
                let probe = Vector3::new(r * a.cos(), r * a.sin(), b);
                let nearest = spread.iter().map(|d| d.dot(&probe)).fold(-1.0, f64::max);
                assert!(nearest > 30f64.to_radians().cos(), "{probe} {nearest}");
            }
        }
    }

    #[test]
    fn known_height_puts_all_points_there() {
        let sample = Sample {
            position: Vector3::new(1.0, 2.0, 8.0),
            range: 10.0,
            inv_sigma: 1.0,
        };
        for x in points(&[sample], Some(2.0), 0.0) {
            assert_eq!(x.z, 2.0);
            assert!((sample.misfit(&x)).abs() < 1e-12);
        }
    }
}
