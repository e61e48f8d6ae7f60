//! Which leg to fly next: by the information that ranges along it would add.
//!
//! A leg adds `sum j^T j / sigma^2` to what is known of each anchor, `j = [u^T 1]` towards the anchor
//! as far as it is known. Where two places compete for an anchor, with probability `q` for the other
//! at distance `d`, ranges along the leg tell them apart by `D^2 = sum (h - h')^2 / (f sigma^2)`, which
//! leaves `q exp(-D^2 / 2)`. The expected mean square error after the leg,
//!
//! ```text
//! trace (I' / f' + Q)^-1 + q' d^2            summed over the anchors
//! ```
//!
//! ranks the legs. `f'` counts what does not average out: the same leg flown twice helps little.

use nalgebra::{Cholesky, Matrix4, Vector3, Vector4};

use super::options::SurveyOptions;
use super::solution::{Survey, SurveyedAnchor};
use super::track::Track;
use crate::geometry::{Shape, descending_eigen};

/// A straight piece of flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// From here, metres.
    pub from_m: Vector3<f64>,
    /// To there, metres.
    pub to_m: Vector3<f64>,
}

/// What is known of one anchor, and what a leg would make of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prospect {
    /// Unit vector along which the anchor is known worst.
    pub direction: Vector3<f64>,
    /// Standard deviation along it now, metres.
    pub sigma_m: f64,
    /// Root of the mean square error of the position now and expected after the leg, metres.
    pub rms_m: [f64; 2],
}

/// A leg and what it would bring.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    /// Where to fly.
    pub leg: Leg,
    /// One an anchor.
    pub anchors: Vec<Prospect>,
    /// Root of the mean square error over all anchors, now and expected after the leg, metres.
    pub rms_m: [f64; 2],
}

/// Ranges an anchor along one leg: 10 s at 10 Hz.
const RANGES: usize = 100;
/// Standard deviation of a range, metres.
const SIGMA_M: f64 = 0.1;

/// Legs about the flight and the anchors, the most helpful first.
pub fn advise(survey: &Survey, track: &Track, options: &SurveyOptions) -> Vec<Advice> {
    let mut advices: Vec<Advice> = legs(survey, track)
        .into_iter()
        .map(|leg| judge(survey, leg, options))
        .collect();
    advices.sort_by(|a, b| a.rms_m[1].total_cmp(&b.rms_m[1]));
    advices
}

/// Straight lines over the middle of the anchors in four directions at three heights, and climbs
/// there and beside each anchor.
fn legs(survey: &Survey, track: &Track) -> Vec<Leg> {
    let places = survey.anchors.iter().map(|anchor| anchor.found.position_m);
    let points = track.points().iter().map(|point| point.position_m);
    let flown = Shape::of(points.clone());
    let (low, high) = points.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
        (low.min(p.z), high.max(p.z))
    });
    let middle = places.clone().sum::<Vector3<f64>>() / survey.anchors.len().max(1) as f64;
    let reach = places
        .map(|place| (place - middle).xy().norm())
        .fold(flown.map_or(0.0, |shape| shape.extents[0]), f64::max)
        .max(5.0);
    let climb = 0.5 * reach;
    let mut legs = Vec::new();
    for height in [0.5 * (low + high), high + 0.5 * climb, high + climb] {
        for eighth in 0..4 {
            let (sine, cosine) = (f64::from(eighth) * std::f64::consts::FRAC_PI_4).sin_cos();
            let half = Vector3::new(cosine, sine, 0.0) * reach;
            let over = Vector3::new(middle.x, middle.y, height);
            legs.push(Leg {
                from_m: over - half,
                to_m: over + half,
            });
        }
    }
    let beside = survey.anchors.iter().map(|anchor| {
        // Halfway out, so that a climb is seen from below and from above but not from overhead.
        (anchor.found.position_m + middle) * 0.5
    });
    for place in beside.chain([middle]) {
        legs.push(Leg {
            from_m: Vector3::new(place.x, place.y, low),
            to_m: Vector3::new(place.x, place.y, high + climb),
        });
    }
    legs
}

fn judge(survey: &Survey, leg: Leg, options: &SurveyOptions) -> Advice {
    let anchors: Vec<Prospect> = survey
        .anchors
        .iter()
        .map(|anchor| {
            let covariance = anchor.found.covariance_m2;
            let (variances, axes) = descending_eigen(covariance);
            Prospect {
                direction: axes[0],
                sigma_m: variances[0].max(0.0).sqrt(),
                rms_m: {
                    // The equations are linear; where a height is open they know less than is known.
                    let now = covariance.trace().max(0.0);
                    let then = mean_square(anchor, &leg, options).min(now);
                    [now.sqrt(), then.sqrt()]
                },
            }
        })
        .collect();
    let over_all = |k: usize| {
        let sum: f64 = anchors.iter().map(|a| a.rms_m[k].powi(2)).sum();
        (sum / anchors.len().max(1) as f64).sqrt()
    };
    Advice {
        leg,
        rms_m: [over_all(0), over_all(1)],
        anchors,
    }
}

/// Expected mean square error of one anchor after the leg, m^2.
fn mean_square(anchor: &SurveyedAnchor, leg: &Leg, options: &SurveyOptions) -> f64 {
    let place = anchor.found.position_m;
    let weight = SIGMA_M.powi(-2);
    let other = anchor.found.alternative;
    let mut information = anchor.information;
    let (mut more, mut apart2) = (0.0, 0.0);
    for k in 0..RANGES {
        let along = k as f64 / (RANGES - 1) as f64;
        let from = leg.from_m + (leg.to_m - leg.from_m) * along;
        let away = place - from;
        let distance = away.norm();
        let u = away / distance.max(1e-9);
        let j = Vector4::new(u.x, u.y, u.z, 1.0).zip_map(&Vector4::from(anchor.free), |v, free| {
            if free { v } else { 0.0 }
        });
        information += j * j.transpose() * weight;
        more += weight;
        if let Some(other) = other {
            apart2 += weight * ((other.position_m - from).norm() - distance).powi(2);
        }
    }
    let factor = anchor.variance_factor(options.systematic_sigma_m, more);
    let mut total: Matrix4<f64> = information / factor;
    let reach2 = 1e4; // an anchor is within 100 m, whatever the ranges leave open
    for i in 0..4 {
        total[(i, i)] += if !anchor.free[i] {
            1.0
        } else if i == 3 {
            options.bias_sigma_m.powi(-2)
        } else {
            1.0 / reach2
        };
    }
    let Some(covariance) = Cholesky::new(total).map(|c| c.inverse()) else {
        return reach2;
    };
    let position: f64 = (0..3)
        .filter(|&i| anchor.free[i])
        .map(|i| covariance[(i, i)])
        .sum();
    let confused = other.map_or(0.0, |other| {
        let left = other.probability * (-0.5 * apart2 / factor).exp();
        left * (other.position_m - place).norm_squared()
    });
    position + confused
}
