//! When each frame of a round is due.
//!
//! Everything hangs on the poll, so that all who hear it know when the air is taken and
//! by whom, whatever gets lost:
//!
//! ```text
//!          reply      slot   slot      reply + guard        reply      slot
//!  poll ├─────────┼────────┼────────┼─────────────────┼───────────┼──────────┤
//!  t1            resp 0   resp 1   resp 2           final      report 0    report 1 ...
//! ```
//!
//! Times are between the frames' markers (the end of the SFD) at an antenna. `reply` is
//! how long a node needs from one frame to the answer to it; `slot` how long one answer
//! and its reading take. `guard` is for the way there and back, and late time-outs.

use crate::exchange::When;
use crate::frame::{Poll, len};
use crate::phy::PhyProfile;
use crate::time::{DeviceTime, MODULUS, Ticks};

/// Longest way there and back that a response can have: 10 us, 1.5 km one way.
pub const MAX_ROUND_TRIP: Ticks = Ticks::from_us(10);

/// Latest time from a poll to the last slot's response, in microseconds: as many slots
/// as there can be, 30 ms each. A poll that asks for more is not answered: it would keep
/// a responder from all others.
pub const MAX_RESPONSE_US: u32 = 240_000;

/// How much sooner than due a frame can come, beside the clocks' error: stamps and the
/// grid of delayed transmissions.
const EARLY: Ticks = Ticks::from_us(1);

/// Two clocks differ by at most this many parts per million:
/// [`MAX_CLOCK_OFFSET_PPM`](crate::tof::MAX_CLOCK_OFFSET_PPM).
const CLOCKS_PPM: u64 = 100;

/// How long a receiver stays on behind the end of the last frame that could come.
const LISTEN_SLACK_US: u32 = 20;

/// How much sooner than the first symbol that it has to hear a receiver is switched on.
pub(crate) const LISTEN_EARLY_US: u32 = 20;

/// What the last response's time-out, and going over to the final, may take longer than
/// a reply.
const GUARD_US: u32 = 40;

/// What a node knows of its own speed: the PHY's, the bus's and the processor's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timing {
    /// From a frame's marker to the answer's: rest of the frame, interrupt, SPI and the
    /// answer's preamble. In microseconds.
    pub reply_us: u16,
    /// From the marker of one answer to the next: the answer, its reading, the
    /// receiver switched on, the next one's preamble. In microseconds.
    pub slot_us: u16,
    /// Mode of the radio, from which the frames' lengths follow.
    pub profile: PhyProfile,
    /// What the radio adds to the start of a transmission to stamp it.
    pub tx_antenna_delay: Ticks,
}

impl Timing {
    /// From the marker of a frame of `bytes`, without the radio's check sequence, to its
    /// end; in microseconds, rounded up.
    pub const fn tail_us(&self, bytes: usize) -> u32 {
        self.profile.marker_to_end(bytes).to_us() + 1
    }

    /// From a frame's first symbol to its marker, in microseconds, rounded up.
    pub const fn preamble_us(&self) -> u32 {
        self.profile.preamble_to_marker().to_us() + 1
    }

    /// When to start a delayed transmission whose marker is to leave the antenna
    /// `due_us` after `from`, and the stamp it will have: early by the grid of delayed
    /// transmissions, at most.
    pub(crate) fn start(&self, from: DeviceTime, due_us: u32) -> (When, DeviceTime) {
        let antenna = self.tx_antenna_delay;
        let start = from
            .after(Ticks::from_us(due_us))
            .after(Ticks::new(MODULUS - antenna.get()))
            .on_delayed_grid();
        (When::At(start), start.after(antenna))
    }
}

/// The times of one round, as its poll sets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timetable {
    reply_us: u32,
    slot_us: u32,
    slots: u32,
}

impl Timetable {
    /// Of a round with `slots` slots among nodes of this speed.
    pub fn new(timing: &Timing, slots: usize) -> Self {
        Self {
            reply_us: timing.reply_us.into(),
            slot_us: timing.slot_us.into(),
            slots: slots as u32,
        }
    }

    /// Of the round that `poll` opens.
    pub fn of(poll: &Poll) -> Self {
        Self {
            reply_us: poll.reply_us.into(),
            slot_us: poll.slot_us.into(),
            slots: poll.slots.into(),
        }
    }

    /// From the poll's marker to the response's in this slot, in microseconds.
    pub const fn response_us(&self, slot: usize) -> u32 {
        self.reply_us + slot as u32 * self.slot_us
    }

    /// From the poll's marker to the final's, in microseconds.
    pub const fn final_us(&self) -> u32 {
        self.last_response_us() + self.reply_us + GUARD_US
    }

    /// From the poll's marker to the response's in the last slot, in microseconds.
    pub const fn last_response_us(&self) -> u32 {
        self.response_us(self.slots.saturating_sub(1) as usize)
    }

    /// From the poll's marker to that of the report with this index, in microseconds.
    pub const fn report_us(&self, index: usize) -> u32 {
        self.final_us() + self.reply_us + index as u32 * self.slot_us
    }

    /// From the poll's marker to the end of the round with so many reports, in
    /// microseconds.
    pub fn end_us(&self, timing: &Timing, reports: usize) -> u32 {
        match reports.checked_sub(1) {
            None => self.final_us() + timing.tail_us(len::last(0)),
            Some(last) => {
                self.report_us(last) + MAX_ROUND_TRIP.to_us() + timing.tail_us(len::REPORT)
            }
        }
    }

    /// How long the air is taken from the start of the poll's preamble on, with all
    /// slots used, in microseconds.
    pub fn air_us(&self, timing: &Timing) -> u32 {
        timing.preamble_us() + self.end_us(timing, self.slots as usize) + LISTEN_SLACK_US
    }

    /// The slot in which a response `since_poll` after the poll was sent, if that is a
    /// time at which one can come.
    pub fn slot_at(&self, since_poll: Ticks) -> Option<usize> {
        (0..self.slots as usize)
            .find(|&slot| is_due(self.response_us(slot), since_poll, MAX_ROUND_TRIP))
    }

    /// When a receiver that waits for a frame of `bytes`, due `due_us` after `start`, is
    /// switched off.
    pub(crate) fn until(
        &self,
        timing: &Timing,
        start: DeviceTime,
        due_us: u32,
        bytes: usize,
    ) -> DeviceTime {
        start.after(Ticks::from_us(due_us + self.window_us(timing, bytes)))
    }

    /// From the time a frame of `bytes` is due to the time its receiver gives up.
    pub(crate) fn window_us(&self, timing: &Timing, bytes: usize) -> u32 {
        MAX_ROUND_TRIP.to_us() + timing.tail_us(bytes) + LISTEN_SLACK_US
    }
}

/// Whether a frame that is due `due_us` after another, and may be on its way for
/// `flight`, can come `since` after it.
pub(crate) fn is_due(due_us: u32, since: Ticks, flight: Ticks) -> bool {
    let due = Ticks::from_us(due_us).get();
    let tolerance = due * CLOCKS_PPM / 1_000_000 + EARLY.get();
    (due.saturating_sub(tolerance)..=due + tolerance + flight.get()).contains(&since.get())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TIMING: Timing = Timing {
        reply_us: 600,
        slot_us: 400,
        profile: PhyProfile::DEFAULT,
        tx_antenna_delay: Ticks::new(16_456),
    };

    #[test]
    fn a_pair_is_a_round_with_one_slot() {
        let table = Timetable::new(&TIMING, 1);
        assert_eq!(table.response_us(0), 600);
        assert_eq!(table.final_us(), 1_240);
        assert_eq!(table.report_us(0), 1_840);
    }

    #[test]
    fn a_response_is_known_by_its_time_and_nothing_else_is_one() {
        let table = Timetable::new(&TIMING, 3);
        for (since_us, slot) in [
            (598, None),
            (600, Some(0)),
            (610, Some(0)),
            (612, None),
            (800, None),
            (1_000, Some(1)),
            (1_403, Some(2)),
            (1_800, None),
        ] {
            assert_eq!(
                table.slot_at(Ticks::from_us(since_us)),
                slot,
                "{since_us} us"
            );
        }
    }

    proptest! {
        /// Whatever the numbers, the frames of a round follow each other.
        #[test]
        fn frames_are_due_one_after_the_other(
            reply_us in 200..30_000u16, slot_us in 100..30_000u16, slots in 1..=8usize,
        ) {
            let timing = Timing { reply_us, slot_us, ..TIMING };
            let table = Timetable::new(&timing, slots);
            let mut due: std::vec::Vec<u32> = (0..slots).map(|k| table.response_us(k)).collect();
            due.push(table.final_us());
            due.extend((0..slots).map(|k| table.report_us(k)));
            due.push(table.end_us(&timing, slots));
            prop_assert!(due.is_sorted_by(|a, b| a < b), "{:?}", due);
            for slot in 0..slots {
                let since = Ticks::from_us(table.response_us(slot));
                prop_assert_eq!(table.slot_at(since), Some(slot));
            }
        }
    }
}
