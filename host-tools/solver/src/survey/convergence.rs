//! How estimates settle as ranges come in: the paper's Fig. 14, for both methods.

use nalgebra::Vector3;

use super::options::SurveyOptions;
use super::solution::{Survey, survey};
use super::track::Track;
use super::{AnchorRanges, TagRange, inverted_uwb};
use crate::measurement::RangeMeasurement;

/// What the first so many ranges of each anchor tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// Ranges an anchor; anchors with fewer use all they have.
    pub ranges: usize,
    /// The joint survey; `None` while there are too few ranges.
    pub joint: Option<Survey>,
    /// The paper's method, one an anchor.
    pub inverted_m: Vec<Option<Vector3<f64>>>,
}

/// Both methods on the first `counts[0]`, `counts[1]`, ... ranges of each anchor in order of time.
pub fn convergence(
    track: &Track,
    anchors: &[AnchorRanges<'_>],
    options: &SurveyOptions,
    counts: &[usize],
) -> Vec<Stage> {
    let ordered: Vec<Vec<TagRange>> = anchors
        .iter()
        .map(|anchor| {
            let known = |range: &&TagRange| track.at(range.t_s, options.max_gap_s).is_some();
            let mut ranges: Vec<_> = anchor.ranges.iter().filter(known).copied().collect();
            ranges.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
            ranges
        })
        .collect();
    let stage = |ranges: usize| {
        let first: Vec<&[TagRange]> = ordered
            .iter()
            .map(|all| all.get(..ranges).unwrap_or(all))
            .collect();
        let parts: Vec<_> = (first.iter().zip(anchors))
            .map(|(ranges, anchor)| AnchorRanges {
                ranges,
                height: anchor.height,
            })
            .collect();
        Stage {
            ranges,
            joint: survey(track, &parts, options).ok(),
            inverted_m: first
                .iter()
                .map(|ranges| {
                    let found =
                        inverted_uwb(&as_measured(track, ranges, options.max_gap_s)).ok()?;
                    Some(found.position_m)
                })
                .collect(),
        }
    };
    counts.iter().map(|&ranges| stage(ranges)).collect()
}

/// Ranges as the paper takes them: at the place where the track has the tag at their own time stamp.
/// Those that the track does not cover are missing.
pub fn as_measured(track: &Track, ranges: &[TagRange], max_gap_s: f64) -> Vec<RangeMeasurement> {
    (ranges.iter())
        .filter_map(|range| {
            let (position_m, _) = track.at(range.t_s, max_gap_s)?;
            Some(RangeMeasurement {
                t_s: range.t_s,
                position_m,
                range_m: range.range_m,
                sigma_m: range.sigma_m,
            })
        })
        .collect()
}
