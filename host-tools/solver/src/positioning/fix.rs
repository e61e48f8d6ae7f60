//! One place from the ranges of one moment.

use nalgebra::Vector3;

use super::{AnchorRange, closed_form, one_sided};
use crate::dop::Dop;
use crate::error::SolveError;
use crate::measurement::{LARGEST_LENGTH_M, RangeMeasurement};
use crate::multilateration::{Height, Localisation, MultilaterationOptions, multilaterate};

/// A tag, located.
#[derive(Debug, Clone, PartialEq)]
pub struct Fix {
    /// Where, with covariance, residuals and what the geometry can tell.
    pub found: Localisation,
    /// What the geometry of the used anchors makes of a range's error; `None` where they do not span
    /// all directions.
    pub dop: Option<Dop>,
    /// True where the linear start was good enough; false where the whole space was searched.
    pub from_closed_form: bool,
}

/// Why there is no fix.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FixError {
    /// Anchors at so few different places leave more than one answer.
    #[error(
        "ranges to {got} different anchors; {needed} are needed{}",
        if *needed == 4 { ", or 3 and the height" } else { "" }
    )]
    TooFewAnchors {
        /// Different places among those given.
        got: usize,
        /// 4, or 3 where the height is known.
        needed: usize,
    },
    /// The solver refused.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// Finds the tag. Of `options`, the start is replaced.
///
/// The linear start is kept where the fit from there sets nothing aside and leaves residuals of the
/// size of the sigmas. Otherwise blocked ranges may have made a false minimum: the search of
/// [`multilaterate`] over the spheres of the ranges begins anew, and its answer is refined by the
/// knowledge that blocked paths are longer, never shorter. That takes the sigmas for those of line of
/// sight; the covariance is that of the search, which has seen how far the ranges scatter, widened by how
/// far the two answers are apart.
///
/// # Errors
/// [`FixError`]: fewer than four anchors (three with the height known), or what
/// [`multilaterate`] refuses.
pub fn locate(ranges: &[AnchorRange], options: &MultilaterationOptions) -> Result<Fix, FixError> {
    let height = match options.height {
        Height::Known(height) => Some(height),
        Height::Unknown | Height::Between { .. } => None,
    };
    let needed = if height.is_some() { 3 } else { 4 };
    let got = different(ranges);
    if got < needed {
        return Err(FixError::TooFewAnchors { got, needed });
    }
    let measurements: Vec<RangeMeasurement> = ranges
        .iter()
        .enumerate()
        .map(|(index, range)| RangeMeasurement {
            t_s: index as f64,
            position_m: range.anchor_m,
            range_m: range.range_m,
            sigma_m: range.sigma_m,
        })
        .collect();
    let usable = measurements.iter().all(|m| m.validate().is_ok());
    let start = if usable {
        nearest(ranges, height, options)
    } else {
        None // multilaterate says what is wrong
    };
    if let Some(start) = start {
        let near = MultilaterationOptions {
            initial_guess_m: Some(start),
            ..*options
        };
        let found = multilaterate(&measurements, &near)?;
        if agrees(&found, ranges) {
            return Ok(finish(found, ranges, true));
        }
    }
    let anywhere = MultilaterationOptions {
        initial_guess_m: None,
        ..*options
    };
    let mut found = multilaterate(&measurements, &anywhere)?;
    let mut starts = vec![found.position_m];
    starts.extend(found.alternative.map(|other| other.position_m));
    if let Some(place) = one_sided::explain(ranges, height, &starts) {
        move_to(&mut found, ranges, place, options.reject_sigmas);
    }
    Ok(finish(found, ranges, false))
}

/// Replaces the place, and what hangs on it.
fn move_to(found: &mut Localisation, ranges: &[AnchorRange], place: Vector3<f64>, reject: f64) {
    // Two explanations of the same ranges: how far they are apart is doubt.
    let apart = place - found.position_m;
    found.covariance_m2 += apart * apart.transpose();
    found.sigma_m = found.covariance_m2.diagonal().map(|v| v.max(0.0).sqrt());
    found.position_m = place;
    let (mut used, mut squares) = (0usize, 0.0);
    for (residual, range) in found.residuals.iter_mut().zip(ranges) {
        residual.residual_m = range.range_m - found.range_bias_m - (place - range.anchor_m).norm();
        residual.used = residual.residual_m.abs() <= reject * range.sigma_m;
        if residual.used {
            used += 1;
            squares += residual.residual_m.powi(2);
        }
    }
    found.used = used;
    found.rejected = ranges.len() - used;
    found.residual_rms_m = (squares / used.max(1) as f64).sqrt();
}

/// The linear solution that the bounds on the height allow.
fn nearest(
    ranges: &[AnchorRange],
    height: Option<f64>,
    options: &MultilaterationOptions,
) -> Option<Vector3<f64>> {
    let allowed = |z: f64| match options.height {
        Height::Between { min_m, max_m } => (min_m..=max_m).contains(&z),
        Height::Unknown | Height::Known(_) => true,
    };
    closed_form(ranges, height)
        .into_iter()
        .find(|p| allowed(p.z) && p.iter().all(|v| v.abs() <= LARGEST_LENGTH_M))
}

/// No outlier, and residuals as the sigmas say.
fn agrees(found: &Localisation, ranges: &[AnchorRange]) -> bool {
    const SIGMAS: f64 = 3.0;
    let within = |(residual, range): (&crate::multilateration::Residual, &AnchorRange)| {
        residual.used && residual.residual_m.abs() <= SIGMAS * range.sigma_m
    };
    found.residuals.iter().zip(ranges).all(within)
}

fn finish(found: Localisation, ranges: &[AnchorRange], from_closed_form: bool) -> Fix {
    let used: Vec<_> = (ranges.iter().zip(&found.residuals))
        .filter(|(_, residual)| residual.used)
        .map(|(range, _)| range.anchor_m)
        .collect();
    Fix {
        dop: Dop::of(&used, found.position_m),
        found,
        from_closed_form,
    }
}

fn different(ranges: &[AnchorRange]) -> usize {
    const SAME_M: f64 = 0.01;
    let mut places: Vec<Vector3<f64>> = Vec::new();
    for range in ranges {
        if !places.iter().any(|p| (p - range.anchor_m).norm() < SAME_M) {
            places.push(range.anchor_m);
        }
    }
    places.len()
}
