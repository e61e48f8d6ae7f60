//! Navigation over a log, and how wrong it is.

use nalgebra::{Matrix3, Vector3};
use nova_solver::MultilaterationOptions;
use nova_solver::fusion::{
    Fate, FusionAnchor, GnssFix, ImuSample, Loose, LooseOptions, Navigation, Tight, TightOptions,
    UwbRange,
};
use nova_solver::positioning::{AnchorRange, Power, RangeFilter, RangeFilterOptions, locate};

use super::log::{Log, Range};
use super::path::{Moment, STEP_S};
use super::{frame, in_area};

/// Who navigates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// GNSS and the inertial sensor.
    GnssIns,
    /// The paper's: with positions of UWB where four anchors are heard.
    Loose {
        /// Blocked ranges taken out by hand, as the authors did after the flight.
        without_blocked: bool,
    },
    /// Ours.
    Tight {
        /// False to take every range as it is.
        judge_ranges: bool,
    },
}

/// How wrong, over the moments in the anchored area (or all): metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Errors {
    /// Root mean square, horizontal and vertical.
    pub rmse_m: [f64; 2],
    /// Largest, horizontal and vertical.
    pub max_m: [f64; 2],
    /// Moments counted.
    pub moments: usize,
}

/// Positions over time with their covariance.
pub type Positions = Vec<(f64, Vector3<f64>, Matrix3<f64>)>;

impl Errors {
    /// Of positions against the path; those in the anchored area alone where asked.
    pub fn of(positions: &Positions, path: &[Moment], area_only: bool) -> Self {
        let mut errors = Self::default();
        for (t_s, position_m, _) in positions {
            let Some(moment) = path.get((t_s / STEP_S).round() as usize) else {
                continue;
            };
            // Where the vehicle really is at that time, between two moments.
            let truth = moment.position_m + moment.velocity * (t_s - moment.t_s);
            if area_only && !in_area(&truth) {
                continue;
            }
            let error = position_m - truth;
            for (k, e) in [error.xy().norm(), error.z.abs()].into_iter().enumerate() {
                errors.rmse_m[k] += e * e;
                errors.max_m[k] = errors.max_m[k].max(e);
            }
            errors.moments += 1;
        }
        let n = errors.moments.max(1) as f64;
        errors.rmse_m = errors.rmse_m.map(|sum| (sum / n).sqrt());
        errors
    }
}

/// A log's events in order of arrival.
enum Event<'a> {
    Imu(&'a ImuSample),
    Gnss(&'a GnssFix),
    Range(&'a Range),
}

fn events(log: &Log) -> Vec<(f64, Event<'_>)> {
    let mut events: Vec<(f64, Event<'_>)> = Vec::new();
    events.extend(log.imu.iter().map(|e| (e.t_s, Event::Imu(e))));
    events.extend(log.gnss.iter().map(|e| (e.t_s, Event::Gnss(e))));
    events.extend(log.ranges.iter().map(|e| (e.t_s, Event::Range(e))));
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    events
}

/// Standard deviation of a range where no survey has seen how far they scatter, metres.
pub(super) const RANGE_SIGMA_M: f64 = 0.1;

/// Flies a method over a log. `lag_s` and `slope` are what the survey found of the ranges' clock and of
/// their growth with distance: zero for the paper's method, which does not know of them. Returns the
/// estimate after every tenth inertial reading and the normalised innovations squared of ranges.
pub fn navigate(
    method: Method,
    log: &Log,
    anchors: &[FusionAnchor],
    [lag_s, slope]: [f64; 2],
) -> (Positions, Vec<f64>) {
    let start = log
        .gnss
        .first()
        .map_or_else(Vector3::zeros, |fix| fix.position_m);
    let t0 = log.imu.first().map_or(0.0, |imu| imu.t_s);
    let options = TightOptions {
        slope,
        judge_ranges: method
            != Method::Tight {
                judge_ranges: false,
            },
        ..TightOptions::default()
    };
    let mut tight = Tight::new(options, anchors, t0, start, 15.0);
    let mut loose = Loose::new(LooseOptions::default(), frame(), t0, start, 15.0);
    let without_blocked = method
        == Method::Loose {
            without_blocked: true,
        };
    let mut uwb = UwbPositions::new(anchors, without_blocked, false);
    let is_tight = matches!(method, Method::Tight { .. });
    let mut positions = Vec::new();
    let mut nis = Vec::new();
    for (k, (_, event)) in events(log).into_iter().enumerate() {
        match event {
            Event::Imu(sample) if is_tight => {
                tight.on_imu(sample);
            }
            Event::Imu(sample) => {
                loose.on_imu(sample);
            }
            Event::Gnss(fix) if is_tight => {
                tight.on_gnss(fix);
            }
            Event::Gnss(fix) => {
                loose.on_gnss(fix);
            }
            Event::Range(range) if is_tight => {
                let [rx_dbm, first_path_dbm] = range.power_dbm;
                let uwb = UwbRange {
                    t_s: range.t_s - lag_s,
                    anchor: range.anchor,
                    range_m: range.range_m,
                    sigma_m: (anchors.get(range.anchor)).map_or(RANGE_SIGMA_M, |a| a.range_sigma_m),
                    power: Some(Power {
                        rx_dbm,
                        first_path_dbm,
                    }),
                };
                match tight.on_range(&uwb) {
                    Fate::Used(v) | Fate::Weighed(v) | Fate::SetAside(v) if v.is_finite() => {
                        nis.push(v)
                    }
                    _ => {}
                }
            }
            Event::Range(range) => {
                if !matches!(method, Method::GnssIns)
                    && let Some((t_s, position_m)) = uwb.on_range(range)
                {
                    loose.on_uwb(t_s, position_m);
                }
            }
        }
        if k % 12 == 0 {
            let now: Navigation = if is_tight {
                tight.navigation()
            } else {
                loose.navigation()
            };
            positions.push((now.t_s, now.position_m, now.covariance_m2));
        }
    }
    (positions, nis)
}

/// Positions of UWB alone, one a round of ranges, by the extended Kalman filter that the paper uses.
pub fn positions_of_uwb(log: &Log, anchors: &[FusionAnchor], judge_ranges: bool) -> Positions {
    let mut uwb = UwbPositions::new(anchors, false, judge_ranges);
    (log.ranges.iter())
        .filter_map(|range| {
            let (t_s, position_m) = uwb.on_range(range)?;
            Some((t_s, position_m, Matrix3::zeros()))
        })
        .collect()
}

/// Positions from rounds of ranges to four anchors or more.
struct UwbPositions<'a> {
    anchors: &'a [FusionAnchor],
    without_blocked: bool,
    judge_ranges: bool,
    filter: Option<RangeFilter>,
    round: Vec<(f64, AnchorRange)>,
}

/// Ranges further apart than this are of different rounds, seconds.
const ROUND_S: f64 = 0.09;
/// After so long without a position the filter starts anew, seconds.
const FORGET_S: f64 = 1.0;

impl<'a> UwbPositions<'a> {
    fn new(anchors: &'a [FusionAnchor], without_blocked: bool, judge_ranges: bool) -> Self {
        Self {
            anchors,
            without_blocked,
            judge_ranges,
            filter: None,
            round: Vec::new(),
        }
    }

    /// The position of a round that this range shows to be complete.
    fn on_range(&mut self, range: &Range) -> Option<(f64, Vector3<f64>)> {
        let complete = (self.round.first()).is_some_and(|(t_s, _)| range.t_s - t_s > ROUND_S);
        let position = if complete { self.position() } else { None };
        if complete {
            self.round.clear();
        }
        if let Some(anchor) = self.anchors.get(range.anchor)
            && !(self.without_blocked && range.blocked)
        {
            let known = AnchorRange {
                anchor_m: anchor.position_m,
                range_m: range.range_m - anchor.bias_m,
                sigma_m: RANGE_SIGMA_M,
            };
            self.round.push((range.t_s, known));
        }
        position
    }

    fn position(&mut self) -> Option<(f64, Vector3<f64>)> {
        if self.round.len() < 4 {
            return None;
        }
        let (last_s, _) = *self.round.last()?;
        if self
            .filter
            .as_ref()
            .is_none_or(|f| last_s - f.state().t_s > FORGET_S)
        {
            let ranges: Vec<AnchorRange> = self.round.iter().map(|(_, range)| *range).collect();
            let found = locate(&ranges, &MultilaterationOptions::default())
                .ok()?
                .found;
            // Whoever sets ranges aside must not start on the wrong side of the anchors' plane: from there
            // it is the right ones that look wrong.
            let sure = found.observable() && found.rejected == 0 && found.used >= 5;
            if self.judge_ranges && !sure {
                return None;
            }
            let options = RangeFilterOptions {
                acceleration: 1.0,
                judge_ranges: self.judge_ranges,
                ..RangeFilterOptions::default()
            };
            self.filter = Some(RangeFilter::new(
                options,
                last_s,
                found.position_m,
                1.0,
                2.0,
            ));
            return None;
        }
        let filter = self.filter.as_mut()?;
        for (t_s, range) in &self.round {
            filter.update(*t_s, range);
        }
        Some((last_s, filter.state().position_m))
    }
}
