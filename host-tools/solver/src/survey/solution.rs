//! The steps of a survey.
//!
//! 1. Each anchor alone, roughly, from a few of its ranges and with clocks that agree: a start.
//! 2. All together ([`super::joint`]): lag and slope.
//! 3. With these taken out, each anchor as a node at rest ([`multilaterate`]): its outliers, how much
//!    its residuals hang together, what the geometry cannot tell, its mirror image.
//! 4. What is in doubt about lag and slope widens the covariances: with `A_i`, `C_i` of the joint
//!    equations an anchor moves by `G_i dc`, `G_i = -A_i^-1 C_i`, so `P_i + G_i P_c G_i^T`.
//!
//! `f_i` being the variance of an anchor's noise in units of the given sigmas, correlation in time
//! included,
//!
//! ```text
//! P_c = [sum (B_i - C_i^T A_i^-1 C_i) / f_i + priors]^-1
//! ```

use nalgebra::{Cholesky, Matrix2, Matrix3, Matrix4, Matrix4x2, Vector2, Vector3, Vector4};

use super::joint::{Joint, Part, Point, Sample};
use super::options::{SurveyError, SurveyOptions};
use super::profile::judge_height;
use super::track::Track;
use super::{AnchorRanges, TagRange};
use crate::error::SolveError;
use crate::kernel::Kernel;
use crate::measurement::{LARGEST_LENGTH_M, RangeMeasurement};
use crate::multilateration::{
    Height, Localisation, MultilaterationOptions, Noise, RangeBias, multilaterate,
};

/// What all anchors share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Common {
    /// How far the ranges' time stamps are behind the track's, seconds.
    pub lag_s: f64,
    /// Its standard deviation, seconds.
    pub lag_sigma_s: f64,
    /// Metres that a metre reads too long.
    pub slope: f64,
    /// Its standard deviation.
    pub slope_sigma: f64,
}

/// One anchor, surveyed.
#[derive(Debug, Clone, PartialEq)]
pub struct SurveyedAnchor {
    /// Where it is and how sure that is; covariances include the doubt about lag and slope.
    pub found: Localisation,
    /// Ranges that were left out since the track was not known then.
    pub off_track: usize,
    /// Information of the used ranges about x, y, z, bias, by the given sigmas; and the sum of `1 /
    /// sigma^2` (1/m^2).
    pub(super) information: Matrix4<f64>,
    pub(super) weight: f64,
    /// Variance of noise in units of the given.
    pub(super) noise_factor: f64,
    pub(super) free: [bool; 4],
}

/// All anchors, surveyed.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// One an anchor, in the order given.
    pub anchors: Vec<SurveyedAnchor>,
    /// What they share.
    pub common: Common,
}

/// Enough for a start.
const FEW: usize = 250;

/// Where anchors are, from ranges measured along a track.
///
/// # Errors
/// [`SurveyError`] names the anchor, range or option that cannot be used. Weak geometry is no error:
/// see [`Localisation::observability`].
pub fn survey(
    track: &Track,
    anchors: &[AnchorRanges<'_>],
    options: &SurveyOptions,
) -> Result<Survey, SurveyError> {
    options.check()?;
    if anchors.is_empty() {
        return Err(SurveyError::NoAnchors);
    }
    let mut parts = Vec::with_capacity(anchors.len());
    for (index, anchor) in anchors.iter().enumerate() {
        parts.push(part(track, anchor, index, options)?);
    }
    let few: Vec<Part> = parts.iter().map(thinned).collect();

    let no_common = Vector2::zeros();
    let mut starts = Vec::with_capacity(anchors.len());
    for (index, (part, anchor)) in few.iter().zip(anchors).enumerate() {
        let measurements = at_lag(track, part, &no_common, options);
        let found = alone(&measurements, anchor.height, None, false, options)
            .map_err(|error| explain(error, index, anchor, measurements.len()))?;
        let p = found.position_m;
        starts.push(Vector4::new(p.x, p.y, p.z, found.range_bias_m));
    }

    let weight = |sigma: f64| sigma.powi(-2);
    let joint = Joint {
        track,
        kernel: options.kernel,
        prior_bias: options.bias_m,
        bias_weight: if options.bias_sigma_m > 0.0 {
            weight(options.bias_sigma_m)
        } else {
            0.0
        },
        common_weight: Vector2::new(weight(options.lag_sigma_s), weight(options.slope_sigma)),
    };
    let start = Point {
        anchors: starts,
        common: no_common,
    };
    let (point, _) = (joint.solve(&few, &parts, start)).ok_or(SurveyError::Singular)?;
    conclude(&joint, &parts, anchors, &point, options)
}

/// Checked samples of one anchor in order of time, those outside the track left out.
fn part(
    track: &Track,
    anchor: &AnchorRanges<'_>,
    index: usize,
    options: &SurveyOptions,
) -> Result<Part, SurveyError> {
    let mut samples = Vec::with_capacity(anchor.ranges.len());
    for (k, range) in anchor.ranges.iter().enumerate() {
        if let Some(why) = fault(range) {
            return Err(SurveyError::BadRange {
                anchor: index,
                index: k,
                why,
            });
        }
        if track.at(range.t_s, options.max_gap_s).is_some() {
            samples.push(Sample {
                t_s: range.t_s,
                range: range.range_m,
                inv_sigma: 1.0 / range.sigma_m.hypot(options.track_sigma_m),
            });
        }
    }
    samples.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    let free = [
        true,
        true,
        !matches!(anchor.height, Height::Known(_)),
        options.bias_sigma_m > 0.0,
    ];
    let unknowns = 2 + free.iter().filter(|free| **free).count();
    if samples.len() < unknowns {
        return Err(SurveyError::TooFewRanges {
            anchor: index,
            got: samples.len(),
            given: anchor.ranges.len(),
            unknowns,
        });
    }
    Ok(Part { samples, free })
}

fn fault(range: &TagRange) -> Option<&'static str> {
    let usable = |length: f64| length.abs() <= LARGEST_LENGTH_M;
    if !range.t_s.is_finite() {
        Some("the time is not a finite number")
    } else if !usable(range.range_m) {
        Some("the range is not finite or absurdly large")
    } else if !(range.sigma_m > 0.0 && usable(range.sigma_m)) {
        Some("the standard deviation is not a positive finite number")
    } else {
        None
    }
}

fn thinned(part: &Part) -> Part {
    let step = part.samples.len().div_ceil(FEW).max(1);
    Part {
        samples: part.samples.iter().step_by(step).copied().collect(),
        free: part.free,
    }
}

/// The samples as measurements of a node at rest, lag and slope taken out.
fn at_lag(
    track: &Track,
    part: &Part,
    common: &Vector2<f64>,
    options: &SurveyOptions,
) -> Vec<RangeMeasurement> {
    let stretch = 1.0 + common.y;
    (part.samples.iter())
        .filter_map(|sample| {
            let t_s = sample.t_s - common.x;
            let (position_m, _) = track.at(t_s, options.max_gap_s)?;
            Some(RangeMeasurement {
                t_s,
                position_m,
                // The bias is not stretched; at 0.3 m and 0.5 % that is 1.5 mm.
                range_m: sample.range / stretch,
                sigma_m: 1.0 / sample.inv_sigma,
            })
        })
        .collect()
}

/// One anchor as a node at rest.
pub(super) fn alone(
    measurements: &[RangeMeasurement],
    height: Height,
    start: Option<Vector3<f64>>,
    seek_alternatives: bool,
    options: &SurveyOptions,
) -> Result<Localisation, SolveError> {
    let settings = MultilaterationOptions {
        initial_guess_m: start,
        bias: if options.bias_sigma_m > 0.0 {
            RangeBias::Estimate {
                prior_m: options.bias_m,
                prior_sigma_m: options.bias_sigma_m,
            }
        } else {
            RangeBias::Known(options.bias_m)
        },
        kernel: options.kernel,
        noise: options.noise,
        systematic_sigma_m: options.systematic_sigma_m,
        height,
        reject_sigmas: options.reject_sigmas,
        seek_alternatives,
    };
    multilaterate(measurements, &settings)
}

fn explain(error: SolveError, anchor: usize, ranges: &AnchorRanges<'_>, got: usize) -> SurveyError {
    match error {
        SolveError::TooFewMeasurements { unknowns, .. } => SurveyError::TooFewRanges {
            anchor,
            got,
            given: ranges.ranges.len(),
            unknowns,
        },
        error => SurveyError::Anchor { anchor, error },
    }
}

fn conclude(
    joint: &Joint<'_>,
    parts: &[Part],
    anchors: &[AnchorRanges<'_>],
    point: &Point,
    options: &SurveyOptions,
) -> Result<Survey, SurveyError> {
    let mut surveyed = Vec::with_capacity(parts.len());
    let mut gains: Vec<Matrix4x2<f64>> = Vec::with_capacity(parts.len());
    let mut common_information = Matrix2::zeros();
    for (index, ((part, anchor), start)) in
        parts.iter().zip(anchors).zip(&point.anchors).enumerate()
    {
        let measurements = at_lag(joint.track, part, &point.common, options);
        let found = alone(
            &measurements,
            anchor.height,
            Some(start.xyz()),
            true,
            options,
        )
        .map_err(|error| explain(error, index, anchor, measurements.len()))?;
        let off_track = anchor.ranges.len() - measurements.len();
        let mut entry = judged(
            joint,
            part,
            &measurements,
            found,
            off_track,
            &point.common,
            options,
        );
        let (anchor_information, c, b) = entry.1;
        if matches!(anchor.height, Height::Unknown) && !entry.0.found.observable() {
            let factor = entry.0.variance_factor(options.systematic_sigma_m, 0.0);
            judge_height(&mut entry.0.found, &measurements, factor, options);
        }
        // What does not average out for a place, since it hangs on the direction, does for what is
        // common to all places and directions.
        let factor = entry.0.noise_factor.max(1e-12);
        let floor = 1e-12 * anchor_information.diagonal().max().max(1e-12);
        let with_prior = anchor_information / factor
            + Matrix4::from_diagonal(&Vector4::new(
                floor,
                floor,
                floor,
                joint.bias_weight + floor,
            ));
        let a = Cholesky::new(with_prior).ok_or(SurveyError::Singular)?;
        let gain = -a.solve(&(c / factor));
        common_information += b / factor + (c / factor).transpose() * gain;
        gains.push(gain);
        surveyed.push(entry.0);
    }
    let covariance =
        common_covariance(common_information, &joint.common_weight).ok_or(SurveyError::Singular)?;
    for (anchor, gain) in surveyed.iter_mut().zip(&gains) {
        let moved = gain * covariance * gain.transpose();
        let widened: Matrix3<f64> = moved.fixed_view::<3, 3>(0, 0).into_owned();
        let found = &mut anchor.found;
        found.covariance_m2 += widened;
        found.local_covariance_m2 += widened;
        found.sigma_m = found.covariance_m2.diagonal().map(|v| v.max(0.0).sqrt());
        let linked: Vector3<f64> = moved.fixed_view::<3, 1>(0, 3).into_owned();
        found.position_bias_m2 += linked;
        found.range_bias_sigma_m = found
            .range_bias_sigma_m
            .hypot(moved[(3, 3)].max(0.0).sqrt());
    }
    Ok(Survey {
        anchors: surveyed,
        common: Common {
            lag_s: point.common.x,
            lag_sigma_s: covariance[(0, 0)].max(0.0).sqrt(),
            slope: point.common.y,
            slope_sigma: covariance[(1, 1)].max(0.0).sqrt(),
        },
    })
}

type Blocks = (Matrix4<f64>, Matrix4x2<f64>, Matrix2<f64>);

/// The anchor with what its used ranges tell, by the given sigmas, and the blocks of the equations.
fn judged(
    joint: &Joint<'_>,
    part: &Part,
    measurements: &[RangeMeasurement],
    found: Localisation,
    off_track: usize,
    common: &Vector2<f64>,
    options: &SurveyOptions,
) -> (SurveyedAnchor, Blocks) {
    let sound: Vec<Sample> = (measurements.iter().zip(&found.residuals))
        .filter(|(_, residual)| residual.used)
        .map(|(m, _)| Sample {
            t_s: m.t_s + common.x,
            range: m.range_m * (1.0 + common.y),
            inv_sigma: 1.0 / m.sigma_m,
        })
        .collect();
    let weight = sound.iter().map(|s| s.inv_sigma * s.inv_sigma).sum();
    let p = found.position_m;
    let x = Vector4::new(p.x, p.y, p.z, found.range_bias_m);
    let sound = Part {
        samples: sound,
        free: part.free,
    };
    let mut block = joint.block(&sound, &x, common, 1.0, Kernel::None);
    super::joint::hold(&mut block, part.free);
    let mean_variance = found.used as f64 / weight;
    let noise_factor = match options.noise {
        Noise::Given => options.kernel.gaussian_variance_factor(),
        // Variance of the residuals in units of the given, times how many of them count as one.
        Noise::Estimated => {
            let correlated = found.used as f64 / found.effective_measurements.max(1.0);
            correlated * found.residual_rms_m.powi(2) / mean_variance
        }
    };
    let anchor = SurveyedAnchor {
        found,
        off_track,
        information: block.a,
        weight,
        noise_factor,
        free: part.free,
    };
    (anchor, (block.a, block.c, block.b))
}

impl SurveyedAnchor {
    /// Variance of the estimate in units of what the given sigmas promise, noise and what does not
    /// average out together, once further ranges of total weight `more` (1/m^2) are in.
    pub(super) fn variance_factor(&self, systematic_sigma_m: f64, more: f64) -> f64 {
        (self.noise_factor + systematic_sigma_m.powi(2) * (self.weight + more)).max(1e-12)
    }
}

/// `None` where it is singular. What is given has no variance.
fn common_covariance(information: Matrix2<f64>, weight: &Vector2<f64>) -> Option<Matrix2<f64>> {
    let mut information = (information + information.transpose()) * 0.5;
    for k in 0..2 {
        if weight[k].is_finite() {
            information[(k, k)] += weight[k];
        } else {
            information.row_mut(k).fill(0.0);
            information.column_mut(k).fill(0.0);
            information[(k, k)] = 1.0;
        }
    }
    let mut covariance = Cholesky::new(information)?.inverse();
    for k in (0..2).filter(|&k| !weight[k].is_finite()) {
        covariance.row_mut(k).fill(0.0);
        covariance.column_mut(k).fill(0.0);
    }
    Some(covariance)
}
