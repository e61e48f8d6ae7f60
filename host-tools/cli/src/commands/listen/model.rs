//! What the boards have said, as far as a table shows it.
//!
//! Times are the boards' own, so that a recording read at once gives the same rates as the
//! boards gave live.

use nova_wire::{Boot, Counters, Event, Range, Record, Statistics};
use std::collections::{BTreeMap, VecDeque};

/// Rates, losses and scatter are those of so many seconds.
pub(super) const WINDOW_S: f64 = 2.0;

/// Keeps memory bounded whatever a board sends within the window.
const MOST_RECENT: usize = 4096;

/// All sources, in the order given.
pub(super) struct Model {
    pub(super) boards: Vec<Board>,
}

/// One source and the board behind it.
pub(super) struct Board {
    /// What the user calls it.
    pub(super) name: String,
    pub(super) state: State,
    pub(super) boot: Option<Boot>,
    /// The board's own address, once it has told.
    pub(super) address: Option<u16>,
    pub(super) counters: Option<Counters>,
    /// Exchanges that failed, of all in the last second, from 0 to 1.
    pub(super) loss: Option<f64>,
    /// What its decoder has counted.
    pub(super) wire: Statistics,
    /// The board's clock at its newest record.
    pub(super) now_s: f64,
    pub(super) peers: BTreeMap<u16, Peer>,
}

/// How it stands with a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum State {
    Open,
    /// Attempts to reach it again go on; why.
    Lost(String),
    Ended,
}

/// Another node, as one board hears it.
pub(super) struct Peer {
    pub(super) last: Range,
    pub(super) ranges: u64,
    first_s: f64,
    /// Time and raw range within the window, oldest first.
    recent: VecDeque<(f64, f64)>,
}

impl Model {
    pub(super) fn new(names: impl IntoIterator<Item = String>) -> Self {
        let boards = names.into_iter().map(Board::new).collect();
        Self { boards }
    }

    /// Ranges of all boards together.
    pub(super) fn ranges(&self) -> u64 {
        (self.boards.iter())
            .flat_map(|board| board.peers.values())
            .map(|peer| peer.ranges)
            .sum()
    }
}

impl Board {
    fn new(name: String) -> Self {
        Self {
            name,
            state: State::Open,
            boot: None,
            address: None,
            counters: None,
            loss: None,
            wire: Statistics::default(),
            now_s: 0.0,
            peers: BTreeMap::new(),
        }
    }

    /// Takes what a frame brought.
    pub(super) fn take(&mut self, event: &Event) {
        let Event::Record { record, .. } = event else {
            return;
        };
        match record {
            Record::Boot(boot) => self.start(*boot),
            Record::Range(range) => {
                let t_s = seconds(range.t_us);
                self.now_s = self.now_s.max(t_s);
                self.peers
                    .entry(range.peer)
                    .or_insert_with(|| Peer::new(*range))
                    .take(*range, t_s);
            }
            Record::Status(status) => {
                self.address = Some(status.address);
                self.now_s = self.now_s.max(seconds(status.t_us));
                self.loss = self.counters.and_then(|b| loss(&b, &status.counters));
                self.counters = Some(status.counters);
            }
            Record::About(about) => {
                self.address = Some(about.address);
                self.boot = Some(*about);
            }
            // What somebody else has asked the board, and what is not of this table.
            _ => {}
        }
        for peer in self.peers.values_mut() {
            peer.forget(self.now_s);
        }
    }

    /// The board has started: its clock and its counters are at zero.
    fn start(&mut self, boot: Boot) {
        self.address = Some(boot.address);
        self.boot = Some(boot);
        self.counters = None;
        self.loss = None;
        self.now_s = 0.0;
        for peer in self.peers.values_mut() {
            peer.restart();
        }
    }
}

impl Peer {
    fn new(range: Range) -> Self {
        Self {
            last: range,
            ranges: 0,
            first_s: seconds(range.t_us),
            recent: VecDeque::new(),
        }
    }

    fn take(&mut self, range: Range, t_s: f64) {
        self.last = range;
        self.ranges += 1;
        self.recent.push_back((t_s, range.raw_m.into()));
        if self.recent.len() > MOST_RECENT {
            self.recent.pop_front();
        }
    }

    fn forget(&mut self, now_s: f64) {
        let old = |&(t_s, _): &(f64, f64)| t_s <= now_s - WINDOW_S;
        while self.recent.front().is_some_and(old) {
            self.recent.pop_front();
        }
    }

    fn restart(&mut self) {
        self.recent.clear();
        self.first_s = 0.0;
    }

    /// Ranges a second within the window; the window begins with the first range.
    pub(super) fn rate_hz(&self, now_s: f64) -> Option<f64> {
        let known_s = (now_s - self.first_s).min(WINDOW_S);
        // Of a shorter time a rate is chance.
        (known_s >= 0.1 * WINDOW_S).then(|| self.recent.len() as f64 / known_s)
    }

    /// Seconds since the last range, by the board's clock.
    pub(super) fn age_s(&self, now_s: f64) -> f64 {
        (now_s - seconds(self.last.t_us)).max(0.0)
    }

    /// Standard deviation of the raw range within the window, from the differences between one
    /// range and the next: motion hardly shows in it, an outlier hardly counts.
    pub(super) fn scatter_m(&self) -> Option<f64> {
        /// Standard deviations in a median absolute deviation of Gaussian noise.
        const PER_MEDIAN: f64 = 1.482_6;
        /// Fewer differences say nothing.
        const LEAST: usize = 8;
        let mut steps_m: Vec<f64> = (self.recent.iter())
            .zip(self.recent.iter().skip(1))
            .map(|((_, a), (_, b))| (b - a).abs())
            .filter(|step| step.is_finite())
            .collect();
        if steps_m.len() < LEAST {
            return None;
        }
        let middle = steps_m.len() / 2;
        let (_, median, _) = steps_m.select_nth_unstable_by(middle, f64::total_cmp);
        // A difference of two has twice the variance of one.
        Some(*median * PER_MEDIAN / std::f64::consts::SQRT_2)
    }
}

/// Exchanges that failed between two status records, of all in between.
fn loss(before: &Counters, after: &Counters) -> Option<f64> {
    let ranges = after.ranges.wrapping_sub(before.ranges);
    let failed: u32 = (failures(before).into_iter().zip(failures(after)))
        .map(|(before, after)| after.wrapping_sub(before))
        .fold(0, u32::saturating_add);
    let all = f64::from(ranges) + f64::from(failed);
    (all > 0.0).then(|| f64::from(failed) / all)
}

/// The counters of exchanges that gave no range.
fn failures(c: &Counters) -> [u32; 11] {
    [
        c.no_response,
        c.no_final,
        c.no_report,
        c.superseded,
        c.send_too_late,
        c.send_time_mismatch,
        c.bad_stamps,
        c.unexpected_events,
        c.cut_off,
        c.not_heard,
        c.implausible,
    ]
}

/// All that was counted but ranges, as words: whatever a board counts.
pub(super) fn counted(counters: &Counters) -> Vec<(String, u64)> {
    /// Ranges are in the title; of the others nobody has to hear.
    const NO_TROUBLE: [&str; 3] = ["ranges", "unanswered_searches", "others_frames"];
    let Ok(serde_json::Value::Object(all)) = serde_json::to_value(counters) else {
        return Vec::new();
    };
    (all.into_iter())
        .filter(|(name, _)| !NO_TROUBLE.contains(&name.as_str()))
        .filter_map(|(name, count)| Some((name.replace('_', " "), count.as_u64()?)))
        .filter(|(_, count)| *count > 0)
        .collect()
}

pub(super) fn seconds(us: u64) -> f64 {
    us as f64 * 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;
    use nova_wire::{ResetCause, Role, SettingsSource, Status};

    fn range(t_us: u64, raw_m: f32) -> Record {
        Record::Range(Range {
            t_us,
            peer: 7,
            raw_m,
            ..Range::default()
        })
    }

    fn status(t_us: u64, counters: Counters) -> Record {
        Record::Status(Status {
            t_us,
            address: 3,
            counters,
        })
    }

    fn board(records: impl IntoIterator<Item = Record>) -> Board {
        let mut board = Board::new("test".into());
        for record in records {
            let event = Event::Record {
                sequence: 0,
                lost: 0,
                record,
            };
            board.take(&event);
        }
        board
    }

    #[test]
    fn the_rate_is_that_of_the_window_and_falls_when_ranges_stop() {
        let ten_a_second = (0..50).map(|k| range(1_000_000 + k * 100_000, 5.0));
        let last = board(ten_a_second.clone());
        let rate_hz = last.peers[&7].rate_hz(last.now_s).unwrap();
        assert!((rate_hz - 10.0).abs() < 0.6, "{rate_hz}");
        assert_eq!(last.peers[&7].ranges, 50);
        let silent = board(ten_a_second.chain([status(9_000_000, Counters::default())]));
        let peer = &silent.peers[&7];
        assert_eq!(peer.rate_hz(silent.now_s), Some(0.0));
        assert!((peer.age_s(silent.now_s) - 3.1).abs() < 1e-9);
    }

    #[test]
    fn scatter_is_that_of_the_noise_though_the_node_moves_and_outliers_come() {
        // 10 m/s at 100 Hz; the noise is +-3 cm in a fixed disorder of variance 6 cm^2.
        let noise_m = [0.03, -0.03, 0.0, 0.02, -0.02, 0.03, -0.03, 0.03, 0.0, -0.03];
        let records = (0_u16..200).map(|k| {
            let outlier_m = if k % 50 == 17 { 40.0 } else { 0.0 };
            let raw_m = 5.0 + 0.001 * f32::from(k) + noise_m[usize::from(k * 7 % 10)] + outlier_m;
            range(u64::from(k) * 10_000, raw_m)
        });
        let scatter_m = board(records).peers[&7].scatter_m().unwrap();
        assert!((0.015..0.045).contains(&scatter_m), "{scatter_m}");
        assert!(
            board([range(0, 1.0), range(1, 2.0)]).peers[&7]
                .scatter_m()
                .is_none()
        );
    }

    #[test]
    fn loss_is_what_failed_since_the_last_status() {
        let before = Counters {
            ranges: 100,
            no_response: 50,
            ..Counters::default()
        };
        let after = Counters {
            ranges: 190,
            no_response: 58,
            no_report: 2,
            foreign_frames: 1_000,
            ..Counters::default()
        };
        let one = board([status(1_000_000, before)]);
        assert_eq!(one.loss, None);
        let two = board([status(1_000_000, before), status(2_000_000, after)]);
        assert_eq!(two.loss, Some(0.1));
        assert_eq!(two.address, Some(3));
    }

    #[test]
    fn a_board_that_starts_again_counts_from_zero() {
        let boot = Record::Boot(Boot {
            address: 3,
            pan: 0xDECA,
            role: Role::Anchor,
            firmware: [0, 1, 0],
            reset_cause: ResetCause::Watchdog,
            settings: SettingsSource::Stored,
        });
        let late = Counters {
            ranges: 4_000_000,
            ..Counters::default()
        };
        let mut records = vec![status(3_600_000_000, late), range(3_600_000_000, 5.0), boot];
        records.extend((0..20).map(|k| range(k * 100_000, 5.0)));
        records.push(status(2_000_000, Counters::default()));
        let board = board(records);
        assert_eq!(board.loss, None);
        let rate_hz = board.peers[&7].rate_hz(board.now_s).unwrap();
        assert!((rate_hz - 10.0).abs() < 0.6, "{rate_hz}");
    }
}
