//! How strongly each peer is received, beyond a single frame.
//!
//! Ranges are corrected by the receive level, so that a level that is wrong once makes a range wrong once: a frame of
//! another network that ends in one's own preamble, or a bit that the bus loses. A peer's level changes as fast as it
//! moves, which is slow against the rate of ranges:
//!
//! ```text
//!   reading ── within 3 dB of the average ──► average, with a time constant of 50 ms
//!      │
//!      └────── off by more ──► the average stands; it moves there when a third reading in a row says the same
//! ```
//!
//! After a second without a reading the next one begins anew.

use nova_ranging::Address;

/// Peers whose levels are kept; who was heard from least recently makes room.
const PEERS: usize = 20;

/// Time constant of the average: at 5 m/s a vehicle comes 0.25 m nearer in it, 0.2 dB at a distance of 10 m.
const TIME_CONSTANT_US: f32 = 50_000.0;

/// A reading further off than this is none of the average's, in dB. Levels of one place scatter by tenths.
const GATE_DB: f32 = 3.0;

/// So many readings in a row that agree with each other and not with the average are a new level.
const AGREEING: u8 = 3;

/// An average says nothing so long after its last reading.
const FRESH_US: u64 = 1_000_000;

/// The averages of all peers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Levels {
    /// In the order of their last readings.
    peers: heapless::Vec<Level, PEERS>,
}

#[derive(Clone, Copy, Debug)]
struct Level {
    peer: Address,
    level_dbm: f32,
    at_us: u64,
    /// The last reading that did not fit, and how many in a row say the same.
    rival_dbm: f32,
    rivals: u8,
}

impl Levels {
    /// Whether a reading is borne out by those before it.
    pub(crate) fn expects(&self, peer: Address, reading_dbm: f32, now_us: u64) -> bool {
        (self.peers.iter())
            .find(|level| level.peer == peer)
            .is_some_and(|level| level.is_fresh(now_us) && level.is_near(reading_dbm))
    }

    /// Takes a reading at `now_us` in, and gives the level in dBm to go by; no number if there is none.
    pub(crate) fn update(&mut self, peer: Address, reading_dbm: f32, now_us: u64) -> f32 {
        let known = self.peers.iter().position(|level| level.peer == peer);
        let known = known.map(|index| self.peers.remove(index));
        let next = match known.filter(|level| level.is_fresh(now_us)) {
            Some(mut level) => {
                level.take(reading_dbm, now_us);
                level
            }
            None if reading_dbm.is_nan() => return reading_dbm,
            None => Level {
                peer,
                level_dbm: reading_dbm,
                at_us: now_us,
                rival_dbm: reading_dbm,
                rivals: 0,
            },
        };
        if self.peers.is_full() {
            self.peers.remove(0);
        }
        // There is room now.
        let _ = self.peers.push(next);
        next.level_dbm
    }
}

impl Level {
    fn is_fresh(&self, now_us: u64) -> bool {
        now_us.saturating_sub(self.at_us) <= FRESH_US
    }

    fn is_near(&self, reading_dbm: f32) -> bool {
        (reading_dbm - self.level_dbm).abs() <= GATE_DB
    }

    fn take(&mut self, reading_dbm: f32, now_us: u64) {
        if reading_dbm.is_nan() {
            return;
        }
        if self.is_near(reading_dbm) {
            let since_us = now_us.saturating_sub(self.at_us) as f32;
            let weight = since_us / (since_us + TIME_CONSTANT_US);
            self.level_dbm += weight * (reading_dbm - self.level_dbm);
            self.at_us = now_us;
            self.rivals = 0;
            return;
        }
        let agrees = self.rivals > 0 && (reading_dbm - self.rival_dbm).abs() <= GATE_DB;
        self.rivals = if agrees { self.rivals + 1 } else { 1 };
        self.rival_dbm = reading_dbm;
        if self.rivals >= AGREEING {
            (self.level_dbm, self.at_us, self.rivals) = (reading_dbm, now_us, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PEER: Address = Address(7);

    #[test]
    fn one_false_reading_moves_nothing_and_two_do_not_either() {
        let mut levels = Levels::default();
        for at_us in (0..100_000).step_by(10_000) {
            assert_eq!(levels.update(PEER, -80.0, at_us), -80.0);
        }
        assert!(!levels.expects(PEER, -92.0, 110_000));
        assert_eq!(levels.update(PEER, -92.0, 110_000), -80.0);
        assert_eq!(levels.update(PEER, -70.0, 120_000), -80.0);
        assert_eq!(levels.update(PEER, f32::NAN, 130_000), -80.0);
        assert!(levels.expects(PEER, -80.5, 140_000));
    }

    #[test]
    fn a_real_jump_is_followed_at_its_third_reading() {
        let mut levels = Levels::default();
        levels.update(PEER, -80.0, 0);
        let jump = [-92.0, -91.5, -92.5];
        let followed = jump.map(|reading| levels.update(PEER, reading, 10_000));
        assert_eq!(followed, [-80.0, -80.0, -92.5]);
    }

    #[test]
    fn a_second_of_silence_begins_anew_and_without_readings_there_is_no_level() {
        let mut levels = Levels::default();
        assert!(levels.update(PEER, f32::NAN, 0).is_nan());
        levels.update(PEER, -80.0, 0);
        assert!(levels.expects(PEER, -79.0, FRESH_US));
        assert!(!levels.expects(PEER, -79.0, FRESH_US + 1));
        assert_eq!(levels.update(PEER, -60.0, FRESH_US + 1), -60.0);
    }

    #[test]
    fn who_was_silent_for_longest_makes_room() {
        let mut levels = Levels::default();
        for k in 0..=PEERS as u16 {
            levels.update(Address(k), -80.0, k.into());
        }
        assert!(!levels.expects(Address(0), -80.0, 100));
        assert!((1..=PEERS as u16).all(|k| levels.expects(Address(k), -80.0, 100)));
    }

    proptest! {
        /// Whatever comes, a level lies among the readings so far.
        #[test]
        fn a_level_lies_between_the_weakest_and_the_strongest_reading(
            readings in prop::collection::vec((-110.0f32..-50.0, 0..2_000_000u64), 1..60),
        ) {
            let mut levels = Levels::default();
            let (mut now_us, mut least, mut most) = (0, f32::INFINITY, f32::NEG_INFINITY);
            for (reading, later_us) in readings {
                now_us += later_us;
                (least, most) = (least.min(reading), most.max(reading));
                let level = levels.update(PEER, reading, now_us);
                prop_assert!((least - 1e-3..=most + 1e-3).contains(&level), "{level}");
            }
        }

        /// Readings that scatter by less than the gate are averaged down.
        #[test]
        fn an_average_scatters_less_than_its_readings(
            scatter in prop::collection::vec(-1.0f32..1.0, 200), period_us in 1_000..20_000u64,
        ) {
            let mut levels = Levels::default();
            let mut squares = [0.0f32; 2];
            for (k, off) in (0u64..).zip(&scatter) {
                let level = levels.update(PEER, -80.0 + off, k * period_us);
                // Once the first reading has been forgotten.
                if k >= 100 {
                    squares[0] += off * off;
                    squares[1] += (level + 80.0) * (level + 80.0);
                }
            }
            prop_assert!(squares[1] < 0.7 * squares[0], "{squares:?}");
        }
    }
}
