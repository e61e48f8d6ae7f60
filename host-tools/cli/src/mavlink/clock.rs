//! The autopilot's time on our clock.
//!
//! An autopilot counts from its start. TIMESYNC asks it for its time: we send ours, it answers with its own beside ours, and
//! half the way there and back is what the answer is late by. The exchange that took least time is the best of the
//! last few; the error is at most half of what it took. Before the first answer, and for autopilots that give none, the
//! least delay seen between a message's own time and its arrival has to do, as for boards.

use crate::board_clock::BoardClock;
use std::collections::VecDeque;

/// Exchanges that are weighed against each other. At one a second 50 ppm of drift make 0.5 ms over them.
const KEPT: usize = 10;
/// Questions whose answer may still come.
const ASKED: usize = 16;
/// An answer that took longer says nothing.
const LONGEST_S: f64 = 1.0;
/// How long an exchange counts without a newer one.
const LIFE_S: f64 = 30.0;

/// One exchange.
#[derive(Clone, Copy, Debug)]
struct Exchange {
    at_s: f64,
    took_s: f64,
    offset_s: f64,
}

/// Relates the autopilot's clock to ours.
#[derive(Clone, Debug, Default)]
pub(crate) struct VehicleClock {
    asked_ns: VecDeque<i64>,
    exchanges: VecDeque<Exchange>,
    from_delays: BoardClock,
}

impl VehicleClock {
    /// We ask at `now_s`; the number to send as `ts1`, nanoseconds.
    pub(crate) fn ask(&mut self, now_s: f64) -> i64 {
        let ns = nanoseconds(now_s);
        if self.asked_ns.len() == ASKED {
            self.asked_ns.pop_front();
        }
        self.asked_ns.push_back(ns);
        ns
    }

    /// An answer: the autopilot's time beside our question, nanoseconds. Whether it was of use: answers to questions of
    /// others, repeated ones and such as took too long are not.
    pub(crate) fn answered(&mut self, tc1_ns: i64, ts1_ns: i64, now_s: f64) -> bool {
        let Some(place) = self.asked_ns.iter().position(|&ns| ns == ts1_ns) else {
            return false;
        };
        self.asked_ns.remove(place);
        let asked_s = ts1_ns as f64 * 1e-9;
        let took_s = now_s - asked_s;
        if !(0.0..=LONGEST_S).contains(&took_s) || tc1_ns < 0 {
            return false;
        }
        if self.exchanges.len() == KEPT {
            self.exchanges.pop_front();
        }
        self.exchanges.push_back(Exchange {
            at_s: now_s,
            took_s,
            offset_s: asked_s + 0.5 * took_s - tc1_ns as f64 * 1e-9,
        });
        true
    }

    /// A message made at the autopilot's time `boot_us` has arrived.
    pub(crate) fn heard(&mut self, boot_us: u64, now_s: f64) {
        self.from_delays.observe(now_s, boot_us);
        while (self.exchanges.front()).is_some_and(|exchange| now_s - exchange.at_s > LIFE_S) {
            self.exchanges.pop_front();
        }
    }

    /// Our time at the autopilot's time `boot_us`.
    pub(crate) fn ours_s(&self, boot_us: u64) -> f64 {
        match self.best() {
            Some(exchange) => exchange.offset_s + boot_us as f64 * 1e-6,
            None => self.from_delays.host_s(boot_us),
        }
    }

    /// How far that may be off, seconds; `None` before the first exchange.
    pub(crate) fn doubt_s(&self) -> Option<f64> {
        self.best().map(|exchange| 0.5 * exchange.took_s)
    }

    fn best(&self) -> Option<&Exchange> {
        (self.exchanges.iter()).min_by(|a, b| a.took_s.total_cmp(&b.took_s))
    }
}

/// Whole nanoseconds.
pub(crate) fn nanoseconds(s: f64) -> i64 {
    // Saturates.
    (s * 1e9) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Our clock when the autopilot's shows zero.
    const OFFSET_S: f64 = 1_000.0;

    fn exchange(clock: &mut VehicleClock, asked_s: f64, there_s: f64, back_s: f64) -> bool {
        let ts1 = clock.ask(asked_s);
        let tc1 = nanoseconds(asked_s + there_s - OFFSET_S);
        clock.answered(tc1, ts1, asked_s + there_s + back_s)
    }

    proptest! {
        #[test]
        fn the_error_is_at_most_half_of_the_fastest_exchange(
            ways in prop::collection::vec((0.0..0.4f64, 0.0..0.4f64), 1..30),
        ) {
            let mut clock = VehicleClock::default();
            for (second, &(there_s, back_s)) in ways.iter().enumerate() {
                prop_assert!(exchange(&mut clock, 2_000.0 + second as f64, there_s, back_s));
            }
            let error_s = (clock.ours_s(5_000_000) - (OFFSET_S + 5.0)).abs();
            let fastest_s = ways.iter().rev().take(KEPT).map(|(a, b)| a + b).fold(1.0, f64::min);
            let doubt_s = clock.doubt_s().unwrap();
            prop_assert!((doubt_s - 0.5 * fastest_s).abs() < 1e-6);
            prop_assert!(error_s <= doubt_s + 1e-6, "{error_s} {doubt_s}");
        }
    }

    #[test]
    fn answers_to_others_repeated_ones_and_slow_ones_are_of_no_use() {
        let mut clock = VehicleClock::default();
        let ts1 = clock.ask(2_000.0);
        assert!(!clock.answered(5, ts1 + 1, 2_000.1));
        assert!(clock.answered(1_000_000_000_000, ts1, 2_000.1));
        assert!(!clock.answered(1_000_000_000_000, ts1, 2_000.1));
        assert!(!exchange(&mut clock, 2_001.0, 0.1, 5.0));
        assert!(!clock.answered(
            i64::MIN,
            clock.asked_ns.front().copied().unwrap_or(0),
            2_002.0
        ));
    }

    #[test]
    fn without_answers_the_shortest_delay_counts() {
        let mut clock = VehicleClock::default();
        for (second, delay_s) in [0.030, 0.004, 0.200].into_iter().enumerate() {
            clock.heard(
                second as u64 * 1_000_000,
                OFFSET_S + second as f64 + delay_s,
            );
        }
        assert!((clock.ours_s(9_000_000) - (OFFSET_S + 9.004)).abs() < 1e-9);
        assert_eq!(clock.doubt_s(), None);
    }

    #[test]
    fn an_old_exchange_is_forgotten() {
        let mut clock = VehicleClock::default();
        assert!(exchange(&mut clock, 2_000.0, 0.01, 0.01));
        clock.heard(1_000_000_000, 2_000.0);
        assert!(clock.doubt_s().is_some());
        clock.heard(1_040_000_000, 2_040.0);
        assert_eq!(clock.doubt_s(), None);
    }
}
