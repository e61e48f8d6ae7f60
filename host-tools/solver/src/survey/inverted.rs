//! The inverted UWB of the paper, Eq. 13-22: one anchor by plain least squares.
//!
//! ```text
//! h_k(a)  = |p_k - a|                                   Eq. 15
//! r_k(a)  = d_k - h_k(a)                                Eq. 18
//! S(a)    = sum r_k^2  -> min                           Eq. 19
//! J_k     = (p_k - a)^T / |p_k - a|                     Eq. 20
//! step    = -(J^T J + lambda I)^-1 J^T r                Eq. 21, 22
//! ```
//!
//! It starts at the mean of the flight path. `lambda` falls tenfold with each step that helps and
//! grows tenfold with each that does not (Marquardt). The paper gives no covariance; here it is the
//! textbook's, `S / (M - 3) (J^T J)^-1`, which knows nothing of outliers, time offset or mirror images.

use nalgebra::{Matrix3, Vector3};

use crate::error::SolveError;
use crate::measurement::RangeMeasurement;

/// What the paper's method finds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InvertedUwb {
    /// The anchor, metres.
    pub position_m: Vector3<f64>,
    /// `S / (M - 3) (J^T J)^-1`, square metres; `None` where the path is flat at the solution.
    pub covariance_m2: Option<Matrix3<f64>>,
    /// Root mean square residual, metres.
    pub residual_rms_m: f64,
    /// Evaluations of the residuals.
    pub evaluations: u32,
}

const MOST_EVALUATIONS: u32 = 200;

/// Finds one anchor from ranges measured at known places, as the paper does; `sigma_m` plays no part.
///
/// # Errors
/// [`SolveError`] for a measurement that makes no sense and for fewer than three.
pub fn inverted_uwb(measurements: &[RangeMeasurement]) -> Result<InvertedUwb, SolveError> {
    let (got, unknowns) = (measurements.len(), 3);
    if got < unknowns {
        return Err(SolveError::TooFewMeasurements { got, unknowns });
    }
    for (index, measurement) in measurements.iter().enumerate() {
        measurement
            .validate()
            .map_err(|fault| SolveError::BadMeasurement { index, fault })?;
    }
    let mut a = measurements
        .iter()
        .map(|m| m.position_m)
        .sum::<Vector3<f64>>()
        / measurements.len() as f64;
    let mut sums = Sums::at(measurements, &a);
    let mut lambda = 1e-3 * sums.jtj.diagonal().max();
    let mut evaluations = 1;
    while evaluations < MOST_EVALUATIONS && lambda < 1e15 {
        let damped = sums.jtj + Matrix3::identity() * lambda;
        let Some(step) = damped.cholesky().map(|c| -c.solve(&sums.jtr)) else {
            lambda = (lambda * 10.0).max(1e-9);
            continue;
        };
        let next = Sums::at(measurements, &(a + step));
        evaluations += 1;
        if next.square_sum < sums.square_sum {
            a += step;
            let gain = sums.square_sum - next.square_sum;
            sums = next;
            lambda /= 10.0;
            if gain < 1e-12 * sums.square_sum || step.norm() < 1e-9 {
                break;
            }
        } else if step.norm() < 1e-9 {
            break;
        } else {
            lambda = (lambda * 10.0).max(1e-9);
        }
    }
    let n = measurements.len() as f64;
    let variance = sums.square_sum / (n - 3.0).max(1.0);
    Ok(InvertedUwb {
        position_m: a,
        covariance_m2: sums.jtj.cholesky().map(|c| c.inverse() * variance),
        residual_rms_m: (sums.square_sum / n).sqrt(),
        evaluations,
    })
}

struct Sums {
    square_sum: f64,
    jtr: Vector3<f64>,
    jtj: Matrix3<f64>,
}

impl Sums {
    fn at(measurements: &[RangeMeasurement], a: &Vector3<f64>) -> Self {
        let mut sums = Self {
            square_sum: 0.0,
            jtr: Vector3::zeros(),
            jtj: Matrix3::zeros(),
        };
        for m in measurements {
            let away = m.position_m - a;
            let h = away.norm();
            let r = m.range_m - h;
            let j = if h > 0.0 { away / h } else { away };
            sums.square_sum += r * r;
            sums.jtr += j * r;
            sums.jtj += j * j.transpose();
        }
        sums
    }
}
