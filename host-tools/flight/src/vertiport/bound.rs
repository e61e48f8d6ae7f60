//! What no unbiased survey of a flight can beat: Fisher's information of its ranges.
//!
//! ```text
//! J_k     = [-u | 1 | -u.v | D]                            range k by a_i, b_i, lag and slope
//! C_kl    = w delta_kl + u_k^T K(t_k - t_l) u_l,           K(dt) = diag(sigma^2) e^(-|dt| / memory)
//! bound   = (J^T C^-1 J + priors)^-1
//! ```
//!
//! `K` is the error of the receiver's track: the same for all anchors at a moment, and for a quarter of a
//! minute. No number of ranges averages that away, which is the point of the whole file. The white noise
//! `w` is that of a second's ranges together. Local: what a mirror image adds is not in it.

use nalgebra::{DMatrix, DVector, Vector3};

use super::anchors_m;
use super::log::{Air, LOST, REACH_M};
use super::path::Moment;

/// Ticks between the moments that are counted: a second, with ten ranges to each anchor.
const TICKS: usize = 100;
const RANGES_A_SECOND: f64 = 10.0;
/// What a survey expects of lag (s) and slope; of biases it knows how they were drawn.
const PRIORS: [f64; 2] = [0.5, 0.005];

struct RangeRow {
    t_s: f64,
    anchor: usize,
    u: Vector3<f64>,
    v: Vector3<f64>,
    distance: f64,
}

/// Mean absolute error along each axis, over the anchors, that the bound leaves (metres): all anchors at
/// once, by a receiver whose errors have this root mean square (horizontal, vertical). `None` where the
/// flight determines nothing.
pub(super) fn survey_bound(path: &[Moment], rms_m: [f64; 2], air: &Air) -> Option<[f64; 3]> {
    let anchors = anchors_m();
    let rows: Vec<RangeRow> = (path.iter().step_by(TICKS))
        .flat_map(|moment| (anchors.iter().enumerate()).map(move |(k, a)| (moment, k, a)))
        .filter_map(|(moment, anchor, place)| {
            let away = moment.position_m - place;
            let distance = away.norm();
            (distance > 0.0 && distance < REACH_M).then_some(RangeRow {
                t_s: moment.t_s,
                anchor,
                u: away / distance,
                v: moment.velocity,
                distance,
            })
        })
        .collect();
    let [horizontal, vertical] = rms_m;
    let sigma2 = Vector3::new(
        horizontal.powi(2) / 2.0,
        horizontal.powi(2) / 2.0,
        vertical.powi(2),
    );
    let white = air.range_sigma_m.powi(2) / (RANGES_A_SECOND * (1.0 - LOST));
    let n = rows.len();
    let noise = DMatrix::from_fn(n, n, |k, l| {
        let (Some(one), Some(other)) = (rows.get(k), rows.get(l)) else {
            return 0.0;
        };
        let together = (-(one.t_s - other.t_s).abs() / air.gnss_memory_s).exp();
        let track = one.u.component_mul(&other.u).dot(&sigma2) * together;
        if k == l { track + white } else { track }
    });
    let unknowns = 4 * anchors.len() + 2;
    let mut j = DMatrix::zeros(n, unknowns);
    for (k, row) in rows.iter().enumerate() {
        let at = 4 * row.anchor;
        for i in 0..3 {
            j[(k, at + i)] = -row.u[i];
        }
        j[(k, at + 3)] = 1.0;
        j[(k, unknowns - 2)] = -row.u.dot(&row.v);
        j[(k, unknowns - 1)] = row.distance;
    }
    let mut information = j.tr_mul(&noise.cholesky()?.solve(&j));
    let mut priors = DVector::zeros(unknowns);
    for k in 0..anchors.len() {
        priors[4 * k + 3] = air.bias_sigma_m.powi(-2);
    }
    for (k, sigma) in PRIORS.iter().enumerate() {
        priors[unknowns - 2 + k] = sigma.powi(-2);
    }
    for (i, prior) in priors.iter().enumerate() {
        information[(i, i)] += prior;
    }
    let covariance = information.cholesky()?.inverse();
    let mean = |axis: usize| {
        let sum: f64 = (0..anchors.len())
            .map(|k| covariance[(4 * k + axis, 4 * k + axis)].max(0.0).sqrt())
            .sum();
        // E|x| of a Gaussian.
        (2.0 / std::f64::consts::PI).sqrt() * sum / anchors.len() as f64
    };
    Some([mean(0), mean(1), mean(2)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vertiport::{Receiver, Route, path};

    #[test]
    fn bound_shrinks_with_noise_and_grows_with_the_track_and_straightness() {
        let air = Air::of_flight(2);
        let of = |route, receiver: usize, air: &Air| {
            let bound = survey_bound(&path(route), Receiver::ALL[receiver].rms_m, air);
            Vector3::from(bound.unwrap_or([f64::NAN; 3])).norm()
        };
        let [around, straight] = [Route::Loop, Route::North].map(|route| of(route, 0, &air));
        let quiet = Air {
            range_sigma_m: 0.01,
            ..air
        };
        assert!(
            around < 0.2 && straight > 5.0 * around,
            "{around} {straight}"
        );
        assert!(of(Route::Loop, 0, &quiet) < around);
        assert!(of(Route::Loop, 1, &air) > of(Route::Loop, 2, &air));
        assert!(of(Route::Loop, 2, &air) > 5.0 * around);
    }
}
