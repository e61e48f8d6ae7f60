//! What a bridge counts.

use serde::Serialize;
use std::time::Duration;

/// Messages of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(super) struct Tally {
    /// Sent.
    pub(super) sent: u64,
    /// Could not be sent: nobody there yet, or the way was lost.
    pub(super) failed: u64,
}

impl Tally {
    /// Notes one.
    pub(super) fn note(&mut self, sent: bool) {
        if sent {
            self.sent += 1;
        } else {
            self.failed += 1;
        }
    }
}

/// What was sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(super) struct Sent {
    pub(super) heartbeat: Tally,
    pub(super) timesync: Tally,
    pub(super) requests: Tally,
    pub(super) distance_sensor: Tally,
    pub(super) landing_target: Tally,
    /// Estimates that were too doubtful, or without an attitude where one is needed.
    pub(super) landing_target_withheld: u64,
    pub(super) position_target: Tally,
    /// Ranges that are no numbers, do not fit the message, or of more nodes than can be numbered.
    pub(super) ranges_refused: u64,
}

/// How long things took, in steps of a fifth.
#[derive(Clone, Debug)]
pub(super) struct Latency {
    /// Step k holds what took up to 1.2^k microseconds.
    steps: [u64; STEPS],
    longest_us: f64,
}

const STEPS: usize = 100;
const STEP: f64 = 1.2;

/// Quantiles of a [`Latency`], milliseconds; each at most a fifth too large.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Quantiles {
    pub(super) p50_ms: f64,
    pub(super) p99_ms: f64,
    pub(super) max_ms: f64,
}

impl Default for Latency {
    fn default() -> Self {
        Self {
            steps: [0; STEPS],
            longest_us: 0.0,
        }
    }
}

impl Latency {
    /// Notes one.
    pub(super) fn note(&mut self, took: Duration) {
        let us = took.as_secs_f64() * 1e6;
        let step = (us.max(1.0).ln() / STEP.ln()).ceil() as usize;
        if let Some(count) = self.steps.get_mut(step.min(STEPS - 1)) {
            *count += 1;
        }
        self.longest_us = self.longest_us.max(us);
    }

    /// `None` when nothing was noted.
    pub(super) fn quantiles(&self) -> Option<Quantiles> {
        let all: u64 = self.steps.iter().sum();
        let quantile = |part: f64| {
            let wanted = (part * all as f64).ceil() as u64;
            let mut so_far = 0;
            let step = self.steps.iter().position(|count| {
                so_far += count;
                so_far >= wanted
            });
            let us = STEP.powi(step.unwrap_or(STEPS) as i32).min(self.longest_us);
            us * 1e-3
        };
        (all > 0).then(|| Quantiles {
            p50_ms: quantile(0.5),
            p99_ms: quantile(0.99),
            max_ms: self.longest_us * 1e-3,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_right_to_a_fifth() {
        let mut latency = Latency::default();
        assert_eq!(latency.quantiles(), None);
        for us in 1..=1000 {
            latency.note(Duration::from_micros(us));
        }
        let quantiles = latency.quantiles().unwrap();
        assert!((0.5..=0.6).contains(&quantiles.p50_ms), "{quantiles:?}");
        assert!((0.99..=1.0).contains(&quantiles.p99_ms), "{quantiles:?}");
        assert_eq!(quantiles.max_ms, 1.0);
    }
}
