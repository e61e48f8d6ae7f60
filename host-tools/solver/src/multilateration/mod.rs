//! One node that stands still, measured from many known places.
//!
//! The steps of [`multilaterate`]:
//! 1. order the measurements by time (so that the order in which they were given does not matter)
//!    and move the origin to their middle;
//! 2. find starts from the measurements alone (`starts.rs`), fit robustly with the scale of the
//!    noise found along the way (`robust_fit.rs`);
//! 3. set aside what lies beyond `reject_sigmas` and fit again;
//! 4. learn from the residuals how much the fit can be trusted (`noise.rs`), and form the covariance;
//! 5. look for competing places (`ambiguity.rs`) and judge the geometry (`observability.rs`); both
//!    widen the covariance.
//!
//! # Covariance
//! With `I = sum J^T J / sigma^2` over the used measurements, `J = [u^T 1]`, and prior information
//! `Q` on the bias,
//!
//! ```text
//! N = (I / f + Q)^-1,   f = v + sigma_sys^2 sum 1 / sigma_i^2
//! C = N + N [sum g_i J_i^T J_i / (sigma_i^2 f^2)] N
//! ```
//!
//! `v` is the variance of the noise in units of the given sigmas: the kernel's loss of efficiency
//! for [`Noise::Given`], and what `noise.rs` learns from the size, the tails and the time
//! correlation of the residuals for [`Noise::Estimated`].
//!
//! **Systematic errors.** The second part of `f` is for what residuals cannot show: antenna delay
//! left over from calibration, bias that varies with receive power and attitude, error of the
//! vehicle's position. Such an error `e_i` with mean square `sigma_sys^2` moves the estimate along
//! a direction `n` by at most (Cauchy-Schwarz)
//!
//! ```text
//! |n^T I^-1 sum J^T e_i / sigma_i^2| <= sqrt(n^T I^-1 n) sigma_sys sqrt(sum 1 / sigma_i^2)
//! ```
//!
//! which is one standard deviation of that part: honest for the worst pattern, cautious for others.
//! In other words, all measurements together never count for more than one measurement with
//! standard deviation `sigma_sys` from each of their directions, averaged.
//!
//! **Hidden outliers.** A fit bends towards a measurement it rests on, so an outlier there passes
//! for sound: with leverage `h_i = J_i N J_i^T / (sigma_i^2 f)` its residual is only `1 - h_i` of
//! its error, and errors up to `k s / (1 - h_i)` stay below the limit of `k s` (Baarda's external
//! reliability, 1968). With the outlier rate `e = (rejected + 1) / (n + 2)` seen in the same data,
//!
//! ```text
//! g_i = e (k s)^2 [1 / (1 - h_i)^2 - 1]
//! ```
//!
//! is the variance that they add. It fades as `2 p / n`; for a dozen ranges indoors it is what
//! makes the difference.

mod frame;
mod localisation;
mod options;
mod trust;

pub use localisation::{Alternative, Localisation, Residual};
pub use options::{Height, MultilaterationOptions, Noise, RangeBias};

use crate::error::SolveError;
use crate::measurement::RangeMeasurement;
use frame::Frame;

/// Finds the position of a node at rest from ranges taken at known places.
///
/// # Errors
/// [`SolveError`] for a measurement or an option that makes no sense, for fewer measurements than
/// unknowns, and where the allowed heights exclude every solution. A geometry that cannot tell is
/// not an error: see [`Localisation::observability`].
pub fn multilaterate(
    measurements: &[RangeMeasurement],
    options: &MultilaterationOptions,
) -> Result<Localisation, SolveError> {
    options.check()?;
    for (index, measurement) in measurements.iter().enumerate() {
        measurement
            .validate()
            .map_err(|fault| SolveError::BadMeasurement { index, fault })?;
    }
    let frame = Frame::new(measurements, options);
    let (got, unknowns) = (measurements.len(), frame.unknowns.count());
    if got < unknowns {
        return Err(SolveError::TooFewMeasurements { got, unknowns });
    }

    let minima = frame.first_minima();
    let mut others = minima.get(1..).unwrap_or_default().to_vec();
    let mut solution = frame.refine(*minima.first().ok_or(SolveError::Diverged)?)?;
    let mut rivals = frame.rivals(&solution, &others);
    // A rival that turns out better takes over. Each swap lowers the cost, so it ends by itself;
    // the count only bounds the time.
    for _ in 0..3 {
        let Some(better) = frame.better_rival(&solution, &rivals) else {
            break;
        };
        others.push(solution.fit);
        solution = frame.refine(better)?;
        rivals = frame.rivals(&solution, &others);
    }
    frame.conclude(solution, &rivals)
}
