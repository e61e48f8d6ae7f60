//! Anchors that survey themselves: a tag flies where its position is known (by RTK, say), measures
//! its ranges to anchors that nobody measured in, and the anchors' positions follow.
//!
//! ```text
//!  track  p(t) ──────────────┐
//!                            ├─► inverted   one anchor, ranges as they are: the paper's method
//!  ranges (t_k, d_k), each ──┤
//!  with its anchor           └─► joint      all anchors: common time offset and range slope
//!                                  └─► multilateration   each anchor at that offset: covariance,
//!                                       │                mirror image, what the geometry can tell
//!                                       └─► advice        which leg to fly next
//! ```
//!
//! [`inverted_uwb`] is Eq. 13-22 of Osaka and Tsujii, "Robust Navigation in Multipath Environments
//! Using GNSS/UWB/INS Integration with Anchor Position Estimation Toward eVTOL Operations", Sensors
//! 2025, 25(24), 7419: plain least squares, an anchor at a time. [`survey`] is ours. With the tag at
//! `p(t)` and the anchor at `a_i`,
//!
//! ```text
//! d_k = (1 + s) |p(t_k - lag) - a_i| + b_i + noise                          robust in k
//! ```
//!
//! - `lag`: how far the ranges' time stamps are behind the track's. Two computers, two queues: 0.2 s
//!   are the rule, and at 2 m/s they are 40 cm.
//! - `s`, the slope: the DW1000 reads long where little power arrives (APS011), so ranges stretch
//!   with distance.
//! - `b_i`: antenna delays of anchor and tag together.
//!
//! `lag` and `s` belong to all anchors, so that those with good geometry help the others.

mod advice;
mod convergence;
mod inverted;
mod joint;
mod options;
mod profile;
mod solution;
mod track;

pub use advice::{Advice, Leg, Prospect, advise};
pub use convergence::{Stage, as_measured, convergence};
pub use inverted::{InvertedUwb, inverted_uwb};
pub use options::{SurveyError, SurveyOptions};
pub use solution::{Common, Survey, SurveyedAnchor, survey};
pub use track::{Track, TrackFault, TrackPoint};

use crate::multilateration::Height;

/// One range between the tag that flies and an anchor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TagRange {
    /// When, in seconds on the clock of the ranges.
    pub t_s: f64,
    /// Measured distance, metres.
    pub range_m: f64,
    /// Standard deviation of `range_m`, metres.
    pub sigma_m: f64,
}

/// What there is about one anchor.
#[derive(Debug, Clone, Copy)]
pub struct AnchorRanges<'a> {
    /// Its ranges, in any order.
    pub ranges: &'a [TagRange],
    /// What is known of its height.
    pub height: Height,
}
