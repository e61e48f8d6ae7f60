//! When a light that was flashed goes dark again.

/// How long a flash lasts, in microseconds: short enough that 20 events a second are told apart.
const PULSE_US: u64 = 25_000;

/// One flash of a light, timed by whoever owns a clock.
#[derive(Debug, Default)]
pub struct Pulse {
    dark_at_us: Option<u64>,
}

impl Pulse {
    /// Dark.
    pub const fn new() -> Self {
        Self { dark_at_us: None }
    }

    /// Flashes at `now_us`; a flash under way is prolonged.
    pub fn trigger(&mut self, now_us: u64) {
        self.dark_at_us = Some(now_us.saturating_add(PULSE_US));
    }

    /// Whether the light shows at `now_us`.
    pub fn is_lit(&mut self, now_us: u64) -> bool {
        if self.dark_at_us.is_some_and(|end_us| end_us <= now_us) {
            self.dark_at_us = None;
        }
        self.dark_at_us.is_some()
    }

    /// When the light must go dark, for the owner to wake by.
    pub fn next_change_us(&self) -> Option<u64> {
        self.dark_at_us
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flash_ends_by_itself_at_the_time_it_announced() {
        let mut pulse = Pulse::new();
        assert!(!pulse.is_lit(0));
        assert_eq!(pulse.next_change_us(), None);
        pulse.trigger(1_000);
        let end_us = pulse.next_change_us().unwrap();
        assert!(pulse.is_lit(end_us - 1));
        assert!(!pulse.is_lit(end_us));
        assert_eq!(pulse.next_change_us(), None);
    }

    #[test]
    fn a_second_event_prolongs_the_flash() {
        let mut pulse = Pulse::new();
        pulse.trigger(0);
        let first_end_us = pulse.next_change_us().unwrap();
        pulse.trigger(first_end_us - 1);
        assert!(pulse.is_lit(first_end_us));
        assert!(!pulse.is_lit(first_end_us - 1 + PULSE_US));
    }
}
