//! Who may talk when: several initiators in one air.
//!
//! ```text
//!            heard another initiator, no beacon for a second,
//!            and nobody with a lower address          ┌────────────┐
//!   ┌───────┐────────────────────────────────────────►│ Coordinator│
//!   │ Alone │                                         └─────┬──────┘
//!   └─┬─────┘◄──────────────┐                               │ beacon from a
//!     │ beacon     no beacon for eight superframes          │ lower address
//!     ▼                     │                               ▼
//!   ┌───────────────────────┴─────────────────────────────────┐
//!   │ Member: asks for a slot in a join window, then talks in │
//!   │ its slot of each superframe                             │
//!   └─────────────────────────────────────────────────────────┘
//!
//!   beacon │ slot of A │ slot of B │ ... │ spare │ join window │ beacon │ slot of A
//!          ├──────────────── length ─────────────────────────────────►
//! ```
//!
//! In all states it listens before it talks: whoever hears a poll, of whatever network,
//! knows from it how long the round will take, and stays silent for that time.
//!
//! No radio and no clock in here: times are a board's own, in microseconds, and come from
//! outside. The coordinator is a node like the others with a beacon to send.

mod coordinator;
mod member;
mod random;

pub use random::Random;

use crate::exchange::Identity;
use crate::frame::{Address, Beacon, Frame, MAX_SLOTS, Message, len};
use crate::timetable::{Timetable, Timing};
use coordinator::Coordinator;
use member::{Member, Schedule};

/// How a node shares the air.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sharing {
    /// Not at all: talks when its time has come, and its radio is off in between.
    Free,
    /// Listens before it talks.
    Polite,
    /// Also keeps to a superframe when there are several initiators; one of them, that of
    /// the lowest address, coordinates.
    #[default]
    Elect,
    /// Coordinates from the start.
    Coordinate,
}

/// What a node that wants to talk is to do now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Nothing until then.
    Wait(u64),
    /// Run a round now.
    Talk {
        /// A repeat has to be over by then; none is possible if `None`.
        until_us: Option<u64>,
    },
    /// Send this to all.
    Beacon {
        /// Number of the superframe, wrapping.
        superframe: u8,
        /// What.
        beacon: Beacon,
    },
    /// Ask this node for a slot.
    Join(Address),
}

/// What was left out because the air was taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LeftOut {
    /// Slots in which no round was possible.
    pub slots: u32,
    /// Beacons not sent.
    pub beacons: u32,
}

/// Shares the air with others.
#[derive(Clone, Debug)]
pub struct Superframe {
    identity: Identity,
    sharing: Sharing,
    timing: Timing,
    /// Shortest round of this node: with one responder.
    round_us: u32,
    /// Slot that this node needs.
    need_us: u16,
    /// From one of its rounds to the next.
    period_us: u32,
    /// Somebody else's round ends then.
    busy_until_us: u64,
    state: State,
    random: Random,
    /// How much later than due the next round begins, if there are others.
    jitter_us: u64,
    left_out: LeftOut,
}

#[derive(Clone, Debug)]
// There is one in a node; a box would need an allocator.
#[allow(clippy::large_enum_variant)]
enum State {
    Alone {
        /// Another initiator of this network was heard first; nobody if `None`.
        since_us: Option<u64>,
        /// The lowest address heard.
        lowest: Address,
        /// When the last was heard.
        heard_us: u64,
    },
    Member(Member),
    Coordinator(Coordinator),
}

/// So long a node looks for a coordinator before it becomes one.
const ELECTION_US: u64 = 1_000_000;
/// So long it leaves that to a lower address.
const DEFER_US: u64 = 3_000_000;
/// Superframes without a beacon after which there is no coordinator.
const MISSED_BEACONS: u64 = 8;
/// Between a slot's end and the next one's start, and from one round to the next: clocks,
/// and the processors' delays.
const GAP_US: u16 = 200;
/// Longest that is waited, at random, after the air has become free.
const BACKOFF_US: u32 = 1_000;
/// How long a frame of another protocol, or one destroyed, is taken to keep the air.
const NOISE_US: u64 = 300;
/// Most beacons in a row that are left out because the air is taken.
const MOST_SKIPPED: u8 = 2;

impl Superframe {
    /// Of a node with rounds of at most `slots` slots, one every `period_us`.
    pub fn new(
        identity: Identity,
        sharing: Sharing,
        timing: Timing,
        slots: usize,
        period_us: u32,
    ) -> Self {
        let state = match sharing {
            Sharing::Coordinate => State::Coordinator(Coordinator::new(0, 0)),
            Sharing::Free | Sharing::Polite | Sharing::Elect => State::ALONE,
        };
        Self {
            identity,
            sharing,
            timing,
            round_us: Timetable::new(&timing, 1).air_us(&timing),
            need_us: need_us(&timing, slots),
            period_us,
            busy_until_us: 0,
            state,
            random: Random::new(identity.address),
            jitter_us: 0,
            left_out: LeftOut::default(),
        }
    }

    /// From now on this node's rounds have at most so many slots.
    pub fn set_slots(&mut self, slots: usize) {
        self.need_us = need_us(&self.timing, slots);
    }

    /// Whether the radio is to listen between rounds.
    pub fn listens(&self) -> bool {
        self.sharing != Sharing::Free
    }

    /// What was left out since this was asked last.
    pub fn take_left_out(&mut self) -> LeftOut {
        core::mem::take(&mut self.left_out)
    }

    /// The request for a slot.
    pub fn join(&self) -> Message {
        Message::Join {
            need_us: self.need_us,
            period_us: self.period_us,
        }
    }

    /// Whether it matters that, and when, such a frame was heard. The others of a round follow from its poll.
    pub fn heeds(message: &Message) -> bool {
        matches!(
            message,
            Message::Poll(_) | Message::Beacon(_) | Message::Join { .. }
        )
    }

    /// A frame that is not for this node's own round was heard at `at_us`.
    pub fn on_frame(&mut self, frame: &Frame, at_us: u64) {
        if let Message::Poll(poll) = &frame.message {
            let table = Timetable::of(poll);
            let end_us = table.end_us(&self.timing, poll.slots.into());
            self.busy(at_us + u64::from(end_us));
        }
        if frame.pan != self.identity.pan || frame.source == self.identity.address {
            return;
        }
        match &frame.message {
            Message::Beacon(beacon) => self.on_beacon(frame, beacon, at_us),
            Message::Join { need_us, period_us } => {
                if frame.destination == self.identity.address
                    && let State::Coordinator(coordinator) = &mut self.state
                {
                    coordinator.admit(frame.source, *need_us, *period_us, at_us);
                }
            }
            Message::Poll(_) => match &mut self.state {
                State::Alone {
                    since_us,
                    lowest,
                    heard_us,
                } => {
                    since_us.get_or_insert(at_us);
                    *lowest = (*lowest).min(frame.source);
                    *heard_us = at_us;
                }
                State::Coordinator(coordinator) => coordinator.heard(frame.source, at_us),
                State::Member(_) => {}
            },
            Message::Response | Message::Final(_) | Message::Report { .. } => {}
        }
    }

    /// Something was heard at `now_us` that is no frame of this protocol.
    pub fn on_noise(&mut self, now_us: u64) {
        self.busy(now_us + NOISE_US);
    }

    /// The beacon that was asked for has been sent, at `at_us`.
    pub fn on_beacon_sent(&mut self, at_us: u64) {
        if let State::Coordinator(coordinator) = &mut self.state
            && let Some(schedule) = &mut coordinator.schedule
        {
            schedule.start_us = at_us;
        }
    }

    /// What to do at `now_us`, if this node's next round is due at `due_us`.
    pub fn turn(&mut self, now_us: u64, due_us: u64) -> Turn {
        if self.sharing == Sharing::Free {
            return wait_or_talk(now_us, due_us, None);
        }
        self.elect(now_us);
        let busy_until_us = self.busy_until_us;
        let round_us = u64::from(self.round_us);
        match &mut self.state {
            State::Alone { since_us, .. } => {
                // Two with one period would meet again and again, and a beacon that comes
                // as often would never be heard.
                let jitter_us = if since_us.is_some() {
                    self.jitter_us
                } else {
                    0
                };
                let turn = wait_or_talk(now_us, busy_until_us.max(due_us + jitter_us), None);
                if let Turn::Talk { .. } = turn {
                    let most_us = (self.period_us / 4).min(8 * self.round_us);
                    self.jitter_us = self.random.below(most_us).into();
                }
                turn
            }
            State::Coordinator(coordinator) => {
                if now_us >= coordinator.next_us {
                    let busy = now_us < busy_until_us;
                    if !busy
                        || coordinator.skipped >= MOST_SKIPPED
                        || coordinator.schedule.is_none()
                    {
                        coordinator.skipped = 0;
                        return coordinator.beacon(
                            now_us,
                            self.identity.address,
                            (self.need_us, self.period_us),
                            &self.timing,
                        );
                    }
                    // Members go on with the schedule that they have.
                    coordinator.skipped += 1;
                    self.left_out.beacons = self.left_out.beacons.wrapping_add(1);
                    if let Some(schedule) = &coordinator.schedule {
                        let late = (now_us - coordinator.next_us) / schedule.length_us.max(1);
                        coordinator.next_us += (late + 1) * schedule.length_us;
                    }
                }
                let next_us = coordinator.next_us;
                let Some(schedule) = &mut coordinator.schedule else {
                    return Turn::Wait(next_us);
                };
                let turn =
                    schedule.turn(now_us, due_us, busy_until_us, round_us, &mut self.left_out);
                match turn {
                    Turn::Wait(until_us) => Turn::Wait(until_us.min(next_us)),
                    turn => turn,
                }
            }
            State::Member(member) => {
                let ask = member.ask(now_us, busy_until_us, &mut self.random);
                let Turn::Wait(ask_us) = ask else {
                    return ask;
                };
                if member.schedule.slot.is_none() {
                    return ask;
                }
                let turn = member.schedule.turn(
                    now_us,
                    due_us,
                    busy_until_us,
                    round_us,
                    &mut self.left_out,
                );
                match turn {
                    Turn::Wait(until_us) => Turn::Wait(until_us.min(ask_us)),
                    turn => turn,
                }
            }
        }
    }

    /// Whether a round with so many slots is over by `until_us`.
    pub fn fits(&self, now_us: u64, slots: usize, until_us: u64) -> bool {
        let round_us = Timetable::new(&self.timing, slots).air_us(&self.timing);
        now_us.max(self.busy_until_us) + u64::from(round_us) <= until_us
            && now_us >= self.busy_until_us
    }

    fn busy(&mut self, until_us: u64) {
        if until_us > self.busy_until_us {
            // Those that wait for the same moment must not meet.
            let backoff_us = match self.state {
                State::Alone { .. } => self.random.below(BACKOFF_US),
                State::Member(_) | State::Coordinator(_) => 0,
            };
            // Everybody has still to take the last frame in.
            self.busy_until_us = until_us + u64::from(GAP_US) + u64::from(backoff_us);
        }
    }

    /// Moves on to another state where time alone does that.
    fn elect(&mut self, now_us: u64) {
        match &self.state {
            State::Alone {
                since_us: Some(since_us),
                lowest,
                heard_us,
            } if self.sharing == Sharing::Elect => {
                if now_us > heard_us + DEFER_US {
                    // They have gone.
                    self.state = State::ALONE;
                    return;
                }
                let waits_us = if self.identity.address < *lowest {
                    ELECTION_US
                } else {
                    DEFER_US
                };
                if now_us >= since_us + waits_us {
                    self.state = State::Coordinator(Coordinator::new(now_us, now_us));
                }
            }
            State::Member(member) => {
                let schedule = &member.schedule;
                if now_us > schedule.start_us + (MISSED_BEACONS + 1) * schedule.length_us {
                    self.state = match self.sharing {
                        Sharing::Coordinate => State::Coordinator(Coordinator::new(now_us, now_us)),
                        // There are others, or there were: no need to wait for their polls.
                        _ => State::Alone {
                            since_us: Some(now_us),
                            lowest: Address::BROADCAST,
                            heard_us: now_us,
                        },
                    };
                }
            }
            State::Alone { .. } | State::Coordinator(_) => {}
        }
    }

    fn on_beacon(&mut self, frame: &Frame, beacon: &Beacon, at_us: u64) {
        match &self.state {
            _ if matches!(self.sharing, Sharing::Free | Sharing::Polite) => return,
            // The higher one of two gives way.
            State::Coordinator(_) if frame.source > self.identity.address => return,
            State::Member(member) if frame.source > member.coordinator => return,
            _ => {}
        }
        let length_us = u64::from(beacon.length_us);
        let space_us = beacon_space_us(&self.timing);
        let mut start_us = space_us;
        let mut slot = None;
        for grant in &beacon.grants {
            let end_us = start_us + u64::from(grant.length_us);
            if grant.owner == self.identity.address {
                slot = Some((start_us, end_us));
            }
            start_us = end_us;
        }
        if length_us < start_us + u64::from(beacon.join_us) {
            // Not one of ours: its slots do not fit.
            return;
        }
        let mut member = Member {
            coordinator: frame.source,
            schedule: Schedule {
                start_us: at_us,
                length_us,
                slot,
                used: 0,
            },
            ask_us: None,
            skip: 0,
            backoff: 0,
        };
        let needed_us = u64::from(self.need_us);
        if slot.is_none_or(|(from_us, to_us)| to_us - from_us < needed_us) {
            if let State::Member(before) = &self.state {
                (member.skip, member.backoff) = (before.skip, before.backoff);
            }
            let window_us = at_us + length_us - u64::from(beacon.join_us);
            let place_us = join_place_us(&self.timing);
            let places = u32::from(beacon.join_us) / place_us;
            if places > 0 && member.skip > 0 {
                member.skip -= 1;
            } else if places > 0 {
                let place = self.random.below(places);
                member.ask_us = Some(window_us + u64::from(place * place_us));
            }
        }
        self.state = State::Member(member);
    }
}

impl State {
    const ALONE: Self = Self::Alone {
        since_us: None,
        lowest: Address::BROADCAST,
        heard_us: 0,
    };
}

/// What a node with rounds of so many slots asks for: a round, another for up to two that
/// were missing in it, and the gap.
fn need_us(timing: &Timing, slots: usize) -> u16 {
    let round_us = |slots| Timetable::new(timing, slots).air_us(timing);
    let need_us = round_us(slots) + round_us(slots.min(2)) + u32::from(GAP_US);
    u16::try_from(need_us).unwrap_or(u16::MAX)
}

/// From a beacon's marker to the first slot: the rest of the longest beacon, and time to
/// read it.
fn beacon_space_us(timing: &Timing) -> u64 {
    u64::from(timing.tail_us(len::beacon(MAX_SLOTS)) + timing.preamble_us()) + u64::from(GAP_US)
}

/// A request for a slot, and time to read it.
fn join_place_us(timing: &Timing) -> u32 {
    timing.preamble_us() + timing.tail_us(len::JOIN) + 2 * u32::from(GAP_US)
}

fn wait_or_talk(now_us: u64, at_us: u64, until_us: Option<u64>) -> Turn {
    if now_us < at_us {
        Turn::Wait(at_us)
    } else {
        Turn::Talk { until_us }
    }
}
