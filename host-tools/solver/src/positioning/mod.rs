//! Where a tag is, from ranges to anchors whose places are known.
//!
//! ```text
//!  ranges of one moment ─► closed_form ─► multilateration ─► Fix with covariance and DOP
//!                          (linear)       (robust)   │ ranges disagree
//!                                                    └► search everywhere ─► one_sided
//!  ranges one by one ────► RangeFilter    position and velocity over time, any number of anchors
//!  ranges, all of them ──► smooth         the track afterwards, errors that hang together in time among the unknowns
//!  what a listener heard ► Listening ► differences of ranges, round by round
//!  differences of ranges ► locate_tdoa    anchors that send, a tag that only listens: at rest, one place from all
//!                        ├► locate_round        one round alone
//!                        └► ListenerTrack       moving: a place each round (DifferenceFilter)
//! ```
//!
//! Three anchors leave two places, so four are asked for; with the height given, three.

mod closed_form;
mod difference_filter;
mod filter;
mod fix;
mod listening;
mod one_sided;
mod quality;
mod smoother;
mod tdoa;

pub use closed_form::closed_form;
pub use difference_filter::{DifferenceFilter, DifferenceFilterOptions, RoundJudgement};
pub use filter::{Judgement, RangeFilter, RangeFilterOptions, Tracked};
pub use fix::{Fix, FixError, locate};
pub use listening::{
    ExchangeFault, HeardDifference, HeardExchange, HeardFrame, HeardIntervals, HeardMessage,
    ListenedAnchor, ListenedDifference, ListenedRound, ListenerTrack, ListenerTrackOptions,
    Listening, ListeningCounts, ListeningOptions, METRES_PER_TICK, SideIntervals,
};
pub use quality::{Power, sigma_factor};
pub use smoother::{Smoothed, SmootherOptions, smooth};
pub use tdoa::{
    RangeDifference, RoundFix, TdoaFix, TdoaOptions, closed_form_differences, locate_round,
    locate_tdoa,
};

use nalgebra::Vector3;

/// A range to an anchor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnchorRange {
    /// Where the anchor is, metres.
    pub anchor_m: Vector3<f64>,
    /// Measured distance less the anchor's bias, metres.
    pub range_m: f64,
    /// Standard deviation of that, metres.
    pub sigma_m: f64,
}
