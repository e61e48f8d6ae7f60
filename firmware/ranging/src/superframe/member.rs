//! A node with a slot, or in want of one, and the superframe as it knows it.

use super::{GAP_US, LeftOut, Random, Turn};
use crate::frame::Address;

/// How much sooner than due a round may begin, so that it meets its slot.
const EARLY_PART: u64 = 2;

#[derive(Clone, Debug)]
pub(super) struct Member {
    pub(super) coordinator: Address,
    pub(super) schedule: Schedule,
    /// When to ask for a slot.
    pub(super) ask_us: Option<u64>,
    /// Join windows to be left out, and how many at most the next time.
    pub(super) skip: u8,
    pub(super) backoff: u8,
}

/// A superframe as its beacon described it; those that follow are like it until the next
/// beacon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    /// When the beacon was sent.
    pub(super) start_us: u64,
    pub(super) length_us: u64,
    /// Own slot, from the beacon on.
    pub(super) slot: Option<(u64, u64)>,
    /// Superframes since `start_us` whose slot has been used, or given up.
    pub(super) used: u64,
}

impl Schedule {
    /// In the own slot of this superframe or the next.
    pub(super) fn turn(
        &mut self,
        now_us: u64,
        due_us: u64,
        busy_until_us: u64,
        round_us: u64,
        left_out: &mut LeftOut,
    ) -> Turn {
        let Some((slot_us, end_us)) = self.slot else {
            return Turn::Wait(now_us + self.length_us);
        };
        let passed = now_us.saturating_sub(self.start_us) / self.length_us.max(1);
        self.used = self.used.max(passed);
        loop {
            let base_us = self.start_us + self.used * self.length_us;
            let from_us = base_us + slot_us;
            let to_us = (base_us + end_us).saturating_sub(GAP_US.into());
            let early = due_us > from_us + self.length_us / EARLY_PART;
            let at_us = from_us.max(busy_until_us).max(now_us);
            let fits = at_us + round_us <= to_us;
            if !early && fits && at_us <= now_us {
                self.used += 1;
                return Turn::Talk {
                    until_us: Some(to_us),
                };
            }
            if !early && (fits || now_us < from_us) {
                // The air may be free by then.
                return Turn::Wait(if fits { at_us } else { from_us });
            }
            if !early {
                // Too late for a round, whoever is to blame.
                left_out.slots = left_out.slots.wrapping_add(1);
            }
            // As many superframes as there are until then.
            let ahead_us = due_us.saturating_sub(from_us + self.length_us / EARLY_PART);
            self.used += (ahead_us / self.length_us.max(1)).max(1);
        }
    }
}

impl Member {
    /// Asks for a slot when the time drawn for it has come.
    pub(super) fn ask(&mut self, now_us: u64, busy_until_us: u64, random: &mut Random) -> Turn {
        let next_us = now_us + self.schedule.length_us;
        match self.ask_us {
            None => Turn::Wait(next_us),
            Some(ask_us) if now_us < ask_us => Turn::Wait(ask_us),
            Some(_) => {
                self.ask_us = None;
                if now_us < busy_until_us {
                    return Turn::Wait(next_us);
                }
                // Should this one not get through, others stand in the way.
                self.backoff = (2 * self.backoff + 1).min(15);
                self.skip = random.below(u32::from(self.backoff) + 1) as u8;
                Turn::Join(self.coordinator)
            }
        }
    }
}
