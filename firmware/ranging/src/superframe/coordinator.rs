//! Who says who talks when: members, their slots, the beacon.

use super::member::Schedule;
use super::{Turn, beacon_space_us, join_place_us};
use crate::frame::{Address, Beacon, Grant, MAX_SLOTS};
use crate::timetable::Timing;

/// A member that has not been heard for so long, or eight of its periods, has left.
const LEFT_AFTER_US: u64 = 2_000_000;
/// From one superframe with a join window to the next, where there is no time to spare.
const JOIN_EVERY: u8 = 8;
/// Places for requests in a join window.
const JOIN_PLACES: u32 = 4;

#[derive(Clone, Debug)]
pub(super) struct Coordinator {
    pub(super) superframe: u8,
    members: heapless::Vec<Joined, MAX_SLOTS>,
    pub(super) next_us: u64,
    pub(super) skipped: u8,
    pub(super) schedule: Option<Schedule>,
    /// Until then every superframe has a join window.
    pub(super) growing_until_us: u64,
}

#[derive(Clone, Copy, Debug)]
struct Joined {
    address: Address,
    need_us: u16,
    period_us: u32,
    heard_us: u64,
}

impl Coordinator {
    pub(super) fn new(next_us: u64, now_us: u64) -> Self {
        Self {
            superframe: 0,
            members: heapless::Vec::new(),
            next_us,
            skipped: 0,
            schedule: None,
            growing_until_us: now_us + LEFT_AFTER_US,
        }
    }

    pub(super) fn admit(&mut self, address: Address, need_us: u16, period_us: u32, at_us: u64) {
        self.growing_until_us = at_us + LEFT_AFTER_US;
        let joined = Joined {
            address,
            need_us,
            period_us,
            heard_us: at_us,
        };
        // The own slot is one of them. A full superframe takes no more.
        let full = self.members.len() + 1 >= MAX_SLOTS;
        match self.members.iter_mut().find(|m| m.address == address) {
            Some(member) => *member = joined,
            None if full => {}
            None => {
                let _ = self.members.push(joined);
            }
        }
    }

    pub(super) fn heard(&mut self, address: Address, at_us: u64) {
        if let Some(member) = self.members.iter_mut().find(|m| m.address == address) {
            member.heard_us = at_us;
        }
    }

    pub(super) fn beacon(
        &mut self,
        now_us: u64,
        own: Address,
        (need_us, period_us): (u16, u32),
        timing: &Timing,
    ) -> Turn {
        self.members.retain(|member| {
            let patience_us = LEFT_AFTER_US.max(8 * u64::from(member.period_us));
            now_us <= member.heard_us + patience_us
        });
        let mut grants = heapless::Vec::new();
        // There is room: members are fewer than slots.
        let _ = grants.push(Grant {
            owner: own,
            length_us: need_us,
        });
        for member in &self.members {
            let _ = grants.push(Grant {
                owner: member.address,
                length_us: member.need_us,
            });
        }
        let space_us = beacon_space_us(timing);
        let used_us: u64 = space_us + grants.iter().map(|g| u64::from(g.length_us)).sum::<u64>();
        let wanted_us = self
            .members
            .iter()
            .map(|member| member.period_us)
            .fold(period_us, u32::min);
        let window_us = u64::from(JOIN_PLACES * join_place_us(timing));
        let spare = used_us + window_us <= u64::from(wanted_us);
        let joins =
            spare || now_us < self.growing_until_us || self.superframe.is_multiple_of(JOIN_EVERY);
        let join_us = if joins { window_us } else { 0 };
        let length_us = (used_us + join_us).max(wanted_us.into());
        self.superframe = self.superframe.wrapping_add(1);
        // In step with the last one, unless that is long ago.
        let due_us = if now_us < self.next_us + length_us {
            self.next_us.max(1)
        } else {
            now_us
        };
        self.next_us = due_us + length_us;
        self.schedule = Some(Schedule {
            start_us: now_us,
            length_us,
            slot: Some((space_us, space_us + u64::from(need_us))),
            used: 0,
        });
        Turn::Beacon {
            superframe: self.superframe,
            beacon: Beacon {
                length_us: u32::try_from(length_us).unwrap_or(u32::MAX),
                join_us: u16::try_from(join_us).unwrap_or(u16::MAX),
                grants,
            },
        }
    }
}
