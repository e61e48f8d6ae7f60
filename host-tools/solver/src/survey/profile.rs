//! How high? The doubt about a height that a flat path leaves open.
//!
//! Where tag and anchor are at about the same height, ranges change with the square of what separates
//! them: the linear covariance along the vertical is as good as infinite, and no ellipsoid describes
//! what is left. The place of the anchor in the plane is known all the same. So heights are tried one
//! by one, each with the best place in the plane, and weighed by how well they explain the ranges:
//!
//! ```text
//! w(z) = exp(-1/2 sum rho(r_k / s) s^2 / f),   P = sum w (P(z) + d d^T),   d = a(z) - a
//! ```
//!
//! `f` counts what does not average out, as everywhere; `a` is the answer that is reported.

use nalgebra::Matrix3;

use super::options::SurveyOptions;
use super::solution::alone;
use crate::measurement::RangeMeasurement;
use crate::multilateration::{Height, Localisation};
use crate::noise::robust_scale;
use crate::observability::Observability;

/// Heights tried on each side of the path.
const STEPS: i32 = 16;
/// More ranges than this would not change the weights of heights.
const MOST: usize = 200;

/// Replaces covariance and verdict of `found` where its height is open and its place in the plane is
/// not. `variance_factor` is `f` in units of the given sigmas.
pub(super) fn judge_height(
    found: &mut Localisation,
    measurements: &[RangeMeasurement],
    variance_factor: f64,
    options: &SurveyOptions,
) {
    let used: Vec<RangeMeasurement> = (measurements.iter().zip(&found.residuals))
        .filter(|(_, residual)| residual.used)
        .map(|(m, _)| *m)
        .collect();
    let step = used.len().div_ceil(MOST).max(1);
    let few: Vec<RangeMeasurement> = used.iter().step_by(step).copied().collect();
    let n = few.len() as f64;
    let middle = few.iter().map(|m| m.position_m.z).sum::<f64>() / n;
    let reach = few.iter().map(|m| m.range_m.abs()).sum::<f64>() / n;
    let Ok(in_plane) = alone(&few, Height::Known(found.position_m.z), None, true, options) else {
        return;
    };
    if !in_plane.observable() {
        return; // not the height alone is open
    }
    let mut whitened: Vec<f64> = (found.residuals.iter().zip(measurements))
        .filter(|(residual, _)| residual.used)
        .map(|(residual, m)| residual.residual_m / m.sigma_m)
        .collect();
    let scale = robust_scale(&mut whitened, 4).max(1e-3);

    struct Tried {
        log_weight: f64,
        covariance: Matrix3<f64>,
    }
    let mut tried = Vec::new();
    for k in -STEPS..=STEPS {
        // Finer near the path, where ranges tell less and the answer is likely.
        let along = f64::from(k) / f64::from(STEPS);
        let z = middle + reach * along * along.abs();
        let density = along.abs().max(0.5 / f64::from(STEPS)); // dz/dk
        let start = in_plane.position_m;
        let Ok(at) = alone(&few, Height::Known(z), Some(start), false, options) else {
            continue;
        };
        let misfit: f64 = (few.iter().zip(&at.residuals))
            .map(|(m, residual)| {
                let r = residual.residual_m / (m.sigma_m * scale);
                options.kernel.rho_and_weight(r * r).0
            })
            .sum();
        let bias_off = if options.bias_sigma_m > 0.0 {
            (at.range_bias_m - options.bias_m) / options.bias_sigma_m
        } else {
            0.0
        };
        let all = used.len() as f64 / n;
        let log_weight =
            -0.5 * (misfit * all * scale * scale / variance_factor + bias_off * bias_off);
        let d = at.position_m - found.position_m;
        tried.push(Tried {
            log_weight: log_weight + density.ln(),
            covariance: at.covariance_m2 + d * d.transpose(),
        });
    }
    let best = tried
        .iter()
        .map(|t| t.log_weight)
        .fold(f64::NEG_INFINITY, f64::max);
    let (mut total, mut covariance) = (0.0, Matrix3::zeros());
    for t in &tried {
        let weight = (t.log_weight - best).exp();
        total += weight;
        covariance += t.covariance * weight;
    }
    if !(total > 0.0 && total.is_finite()) {
        return;
    }
    found.covariance_m2 = covariance / total;
    // Of the linear solution; over all heights it means nothing, and none is the cautious choice.
    found.position_bias_m2 = nalgebra::Vector3::zeros();
    found.sigma_m = found.covariance_m2.diagonal().map(|v| v.max(0.0).sqrt());
    if !matches!(found.observability, Observability::Mirror) {
        found.observability = Observability::Weak {
            direction: nalgebra::Vector3::z(),
            sigma_m: found.sigma_m.z,
        };
    }
}
