//! Whether the radio makes progress, which is what keeps the watchdog from resetting the board.

/// A radio that was restarted counts as working again when it has not been for this long. Longer than
/// the time from one of the node's attempts to the next (100 ms).
const SETTLED_US: u64 = 500_000;

/// Tells a radio that works from one that is restarted over and over.
///
/// The node restarts a radio in trouble by itself and goes on reporting. If that never helps, the fault
/// may lie on this side of the SPI, and only a fresh start of everything is left.
#[derive(Debug, Default)]
pub struct Progress {
    restarts: u32,
    /// Since when the number of restarts has not changed.
    since_us: u64,
}

impl Progress {
    /// A board that has just started, at `now_us`; its radio has yet to prove itself.
    pub const fn new(now_us: u64) -> Self {
        Self {
            restarts: 0,
            since_us: now_us,
        }
    }

    /// To be told after each pass of the radio loop how often the radio was restarted since the start.
    /// Whether the radio works.
    pub fn check(&mut self, restarts: u32, now_us: u64) -> bool {
        if restarts != self.restarts {
            self.restarts = restarts;
            self.since_us = now_us;
        }
        now_us.saturating_sub(self.since_us) >= SETTLED_US
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_radio_that_never_starts_makes_no_progress_however_long_it_is_tried() {
        let mut progress = Progress::new(0);
        // A pass every 20 ms, as the lights want, a restart every 100 ms, as the node does.
        let passes = (0..10_000_u64).map(|n| n * 20_000);
        assert!(
            passes
                .into_iter()
                .all(|now_us| !progress.check((now_us / 100_000) as u32, now_us))
        );
    }

    #[test]
    fn a_radio_that_works_makes_progress_and_one_restart_only_interrupts_it() {
        let mut progress = Progress::new(0);
        assert!(!progress.check(0, SETTLED_US - 1));
        assert!(progress.check(0, SETTLED_US));
        assert!(progress.check(0, 10 * SETTLED_US));
        assert!(!progress.check(1, 11 * SETTLED_US));
        assert!(!progress.check(1, 12 * SETTLED_US - 1));
        assert!(progress.check(1, 12 * SETTLED_US));
    }
}
