//! A listener's track from its first round on.
//!
//! ```text
//!  rounds ─► waiting: half a second, four anchors ─► locate_tdoa ─► DifferenceFilter, begun where it found
//!               ▲                                                   the tag, fed with what waited
//!               └── a gap of ten seconds, or two with fewer than four anchors ◄──┘
//! ```

use super::super::difference_filter::{DifferenceFilter, DifferenceFilterOptions, RoundJudgement};
use super::super::tdoa::{RangeDifference, TdoaOptions, locate_tdoa};
use super::super::{TdoaFix, Tracked};
use super::ListenedRound;
use nalgebra::{Matrix3, Vector3};

/// How to follow a listener.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ListenerTrackOptions {
    /// How the first place is found.
    pub start: TdoaOptions,
    /// How it goes on.
    pub filter: DifferenceFilterOptions,
    /// The first place is found from rounds of at least so much time, seconds,
    pub start_s: f64,
    /// and from at least so many differences.
    pub start_differences: usize,
    /// Standard deviation of its speed along each axis before anything is known about it, m/s.
    pub speed_sigma: f64,
    /// After so long without a round the track begins anew, seconds.
    pub gap_s: f64,
    /// Fewer than four anchors heard in so long, and the track ends until it can begin anew: three leave a line of places,
    /// along which a filter drifts without noticing; seconds.
    pub hold_s: f64,
}

impl Default for ListenerTrackOptions {
    fn default() -> Self {
        Self {
            start: TdoaOptions::default(),
            filter: DifferenceFilterOptions::default(),
            start_s: 0.5,
            start_differences: 12,
            speed_sigma: 1.5,
            gap_s: 10.0,
            hold_s: 2.0,
        }
    }
}

/// Anchors that a place needs.
const ANCHORS: usize = 4;
/// What waits for the first place is no more than this; older rounds make room.
const MOST_WAITING: usize = 1000;
/// The filter is given what waited once more: its place is that much less certain at first, metres, so that
/// nothing counts twice.
const APART_M: f64 = 1.0;

/// The track of a listener.
#[derive(Debug, Clone)]
pub struct ListenerTrack {
    options: ListenerTrackOptions,
    waiting: Vec<ListenedRound>,
    filter: Option<DifferenceFilter>,
    /// Anchors and when each was heard last.
    heard: Vec<(u16, f64)>,
    alternative_m: Option<Vector3<f64>>,
}

impl ListenerTrack {
    /// A track that has yet to begin.
    pub fn new(options: ListenerTrackOptions) -> Self {
        Self {
            options,
            waiting: Vec::new(),
            filter: None,
            heard: Vec::new(),
            alternative_m: None,
        }
    }

    /// Takes a round. What waits is judged with the round that lets the track begin.
    pub fn on_round(&mut self, round: ListenedRound) -> RoundJudgement {
        let Some(t_s) = round.t_s() else {
            return RoundJudgement {
                refused: round.differences.len(),
                ..RoundJudgement::default()
            };
        };
        self.note(&round, t_s);
        if let Some(filter) = &mut self.filter {
            if t_s - filter.state().t_s <= self.options.gap_s && self.heard.len() >= ANCHORS {
                return filter.update(&round);
            }
            self.restart();
        }
        let waits_s = |of: &ListenedRound| of.t_s().map_or(f64::INFINITY, |then_s| t_s - then_s);
        let gap_s = self.options.gap_s;
        if self
            .waiting
            .last()
            .is_some_and(|last| waits_s(last) > gap_s)
        {
            self.waiting.clear();
        }
        self.waiting.push(round);
        if self.waiting.len() > MOST_WAITING {
            self.waiting.drain(..MOST_WAITING / 4);
        }
        let enough = self
            .waiting
            .first()
            .is_some_and(|first| waits_s(first) >= self.options.start_s);
        if enough {
            self.begin()
        } else {
            RoundJudgement::default()
        }
    }

    /// The state at the time of the last round; `None` before the first place.
    pub fn state(&self) -> Option<Tracked> {
        self.filter.as_ref().map(DifferenceFilter::state)
    }

    /// The filter, once there is one.
    pub fn filter(&self) -> Option<&DifferenceFilter> {
        self.filter.as_ref()
    }

    /// Where it may as well have begun: the differences could not tell.
    pub fn alternative_m(&self) -> Option<Vector3<f64>> {
        self.alternative_m
    }

    /// The listener's clock has started anew: so does the track.
    pub fn restart(&mut self) {
        self.waiting.clear();
        self.filter = None;
        self.alternative_m = None;
    }

    /// Which anchors the round has heard; those that are silent are forgotten.
    fn note(&mut self, round: &ListenedRound, t_s: f64) {
        let hold_s = self.options.hold_s;
        self.heard
            .retain(|(_, then_s)| (0.0..=hold_s).contains(&(t_s - then_s)));
        for address in round.differences.iter().flat_map(|one| one.addresses) {
            match self.heard.iter_mut().find(|(known, _)| *known == address) {
                Some((_, then_s)) => *then_s = t_s,
                None => self.heard.push((address, t_s)),
            }
        }
    }

    /// Begins, if a place can be found.
    fn begin(&mut self) -> RoundJudgement {
        let mut judged = RoundJudgement::default();
        let Some(fix) = first_place(&self.waiting, &self.options) else {
            return judged;
        };
        let waited = std::mem::take(&mut self.waiting);
        let begin_s = waited.first().and_then(ListenedRound::t_s);
        let covariance_m2 = fix.covariance_m2 + Matrix3::identity() * APART_M.powi(2);
        let mut filter = DifferenceFilter::new(
            self.options.filter,
            begin_s.unwrap_or(0.0),
            fix.position_m,
            &covariance_m2,
            self.options.speed_sigma,
        );
        for round in &waited {
            let of = filter.update(round);
            judged.used += of.used;
            judged.set_aside += of.set_aside;
            judged.refused += of.refused;
        }
        self.alternative_m = fix.alternative_m;
        self.filter = Some(filter);
        judged
    }
}

/// The place from all that waits; `None` where it does not determine one.
fn first_place(waiting: &[ListenedRound], options: &ListenerTrackOptions) -> Option<TdoaFix> {
    let differences: Vec<RangeDifference> = (waiting.iter())
        .flat_map(|round| round.differences.iter().map(|one| one.difference))
        .collect();
    let mut anchors: Vec<u16> = (waiting.iter())
        .flat_map(|round| round.differences.iter().flat_map(|one| one.addresses))
        .collect();
    anchors.sort_unstable();
    anchors.dedup();
    if anchors.len() < ANCHORS || differences.len() < options.start_differences {
        return None;
    }
    locate_tdoa(&differences, &options.start).ok()
}

impl ListenedRound {
    /// When it was: the latest of its differences that has a time; `None` without any.
    pub fn t_s(&self) -> Option<f64> {
        (self.differences.iter().map(|one| one.t_s))
            .filter(|t_s| t_s.is_finite())
            .reduce(f64::max)
    }
}
