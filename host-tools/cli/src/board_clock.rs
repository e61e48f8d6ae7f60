//! When, on the host's clock, something happened on a board.

/// Relates a board's clock to the host's.
///
/// A status record says when it was made and arrives some time after that:
/// never less than the shortest way takes, often more. The smallest difference
/// seen between arrival and the board's own time is therefore the best estimate
/// of the offset between the two clocks, late by the shortest delay (a frame on
/// the wire, below 1 ms).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BoardClock {
    offset_s: Option<f64>,
}

impl BoardClock {
    /// A record made at the board's time `board_us` has arrived at host time `arrival_s`.
    pub(crate) fn observe(&mut self, arrival_s: f64, board_us: u64) {
        let offset_s = arrival_s - seconds(board_us);
        self.offset_s = Some(self.offset_s.map_or(offset_s, |o| o.min(offset_s)));
    }

    /// The host's time at the board's time `board_us`.
    pub(crate) fn host_s(&self, board_us: u64) -> f64 {
        self.offset_s.unwrap_or(0.0) + seconds(board_us)
    }
}

fn seconds(us: u64) -> f64 {
    us as f64 * 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_delay_counts() {
        let mut clock = BoardClock::default();
        for (k, delay_s) in [0.010, 0.0007, 0.003, 0.250].iter().enumerate() {
            let board_us = 1_000_000 * k as u64;
            clock.observe(100.0 + k as f64 + delay_s, board_us);
        }
        assert!((clock.host_s(2_000_000) - 102.0007).abs() < 1e-9);
    }
}
