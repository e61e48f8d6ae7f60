//! The part in rounds, and what it takes beside its state machine.

use crate::config::{NodeConfig, Part};
use crate::peers::{Peers, Plan};
use nova_ranging::superframe::{Random, Superframe, Turn};
use nova_ranging::{
    Address, Command, Event, Initiator, MAX_RESPONDERS, Message, Responder, Step, Timing,
};

/// A round that begins so much later than due, when the radio has slept, is late.
const LATE_US: u64 = 1_000;

/// The part in rounds, with what it takes beside its state machine.
// There is one in a node, made at its start and never moved.
#[allow(clippy::large_enum_variant)]
pub(super) enum Playing {
    Initiator(Polling),
    Responder(Responder),
    Listener,
}

/// What an initiator has beside its radio.
pub(super) struct Polling {
    pub(super) machine: Initiator,
    pub(super) air: Superframe,
    pub(super) peers: Peers,
    /// Who was named in the round that runs, or ran last, and has given no range yet.
    pub(super) missing: heapless::Vec<Address, MAX_RESPONDERS>,
    /// Who was still missing when a slot was over. They are polled once more in the next, if
    /// there is time.
    pub(super) owed: heapless::Vec<Address, MAX_RESPONDERS>,
    /// Until when a repeat has to be over, if there may be one.
    pub(super) repeat_until_us: Option<u64>,
    /// Whether anybody was missing in the round that runs.
    pub(super) missed: bool,
    /// The frame that is being sent is a beacon.
    pub(super) beacon: bool,
    pub(super) period_us: u64,
    /// Whether the radio sleeps between rounds.
    pub(super) sleeps: bool,
    /// The radio has slept since the last round.
    pub(super) slept: bool,
    /// The round that runs has begun late for that.
    pub(super) late: bool,
    /// When the next round is due.
    pub(super) next_us: u64,
    /// When to look again whether it can begin.
    pub(super) turn_us: u64,
    pub(super) spread: Spread,
}

/// Moves an initiator that shares the air with another off the other's times.
///
/// Without it two that have the same period and meet once meet every time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spread {
    random: Random,
    /// From the earliest to the latest, in microseconds.
    width_us: u32,
}

impl Spread {
    /// Two exchanges wide, from a different start for each address.
    pub(super) fn new(address: Address, reply_us: u32) -> Self {
        Self {
            random: Random::new(address),
            width_us: 8 * reply_us,
        }
    }

    /// A shift to either side, so that the rate stays.
    pub(super) fn next_us(&mut self) -> i64 {
        i64::from(self.random.below(self.width_us)) - i64::from(self.width_us / 2)
    }
}

impl Playing {
    /// The part that `config` says, at its beginning.
    pub(super) fn by(config: &NodeConfig, timing: Timing) -> Self {
        match &config.part {
            Part::Responder => Self::Responder(Responder::new(config.identity, timing)),
            Part::Listener => Self::Listener,
            Part::Initiator {
                period_us,
                per_round,
                peers,
                sharing,
                sleep,
            } => {
                let peers = Peers::new(peers, *per_round);
                Self::Initiator(Polling {
                    machine: Initiator::new(config.identity, timing),
                    air: Superframe::new(
                        config.identity,
                        *sharing,
                        timing,
                        peers.slots(),
                        *period_us,
                    ),
                    peers,
                    missing: heapless::Vec::new(),
                    owed: heapless::Vec::new(),
                    repeat_until_us: None,
                    missed: false,
                    beacon: false,
                    period_us: u64::from(*period_us),
                    sleeps: *sleep,
                    slept: false,
                    late: false,
                    next_us: 0,
                    turn_us: 0,
                    spread: Spread::new(config.identity.address, config.reply_us()),
                })
            }
        }
    }

    pub(super) fn set_timing(&mut self, timing: Timing) {
        match self {
            Self::Initiator(polling) => polling.machine.set_timing(timing),
            Self::Responder(machine) => machine.set_timing(timing),
            Self::Listener => {}
        }
    }

    pub(super) fn on_event(&mut self, event: Event<'_>) -> Step {
        match self {
            Self::Initiator(polling) => polling.machine.on_event(event),
            Self::Responder(machine) => machine.on_event(event),
            // It never comes here.
            Self::Listener => Step {
                command: Command::Listen { until: None },
                outcome: None,
            },
        }
    }

    /// Into the node's receptions: where that of the frame just taken belongs.
    pub(super) fn slot(&self) -> usize {
        match self {
            Self::Initiator(polling) => polling.machine.slot(),
            Self::Responder(_) | Self::Listener => 0,
        }
    }

    /// Whether a range rests on the time stamp of the frame just taken in.
    pub(super) fn measures_by_this(&self) -> bool {
        match self {
            Self::Initiator(_) => true,
            Self::Responder(machine) => machine.is_reporting(),
            Self::Listener => false,
        }
    }

    /// From whom that frame was.
    pub(super) fn partner(&self) -> Option<Address> {
        match self {
            Self::Initiator(polling) => polling.machine.heard_last(),
            Self::Responder(machine) => machine.partner(),
            Self::Listener => None,
        }
    }

    /// Whether the next poll can follow a report at once. Not where others than the one that has just reported are to
    /// hear it: they still read the report.
    pub(super) fn may_hurry(&self) -> bool {
        matches!(self, Self::Initiator(polling)
            if polling.peers.is_one() && polling.repeat_until_us.is_none() && !polling.sleeps)
    }

    pub(super) fn measured(&mut self, peer: Address, now_us: u64) {
        if let Self::Initiator(polling) = self {
            polling.peers.answered(peer, now_us);
            polling.missing.retain(|&missing| missing != peer);
        }
    }

    pub(super) fn failed(&mut self, peer: Address, now_us: u64) {
        if let Self::Initiator(polling) = self {
            polling.peers.failed(peer, now_us);
            if !core::mem::replace(&mut polling.missed, true) {
                let shift_us = polling.spread.next_us();
                polling.next_us = polling.next_us.saturating_add_signed(shift_us);
            }
        }
    }

    pub(super) fn is_idle(&self) -> bool {
        match self {
            Self::Initiator(polling) => polling.machine.is_idle(),
            Self::Responder(machine) => machine.is_idle(),
            Self::Listener => true,
        }
    }
}

impl Polling {
    pub(super) fn owe(&mut self, peer: Option<Address>) {
        if let Some(peer) = peer
            && !self.owed.contains(&peer)
        {
            // There is room: peers are no more than responders.
            let _ = self.owed.push(peer);
        }
    }

    /// What to send now, if anything.
    pub(super) fn next(&mut self, now_us: u64) -> Option<Command> {
        self.turn_us = now_us;
        if let Some(until_us) = self.repeat_until_us.take() {
            // Who has waited for longest goes first.
            core::mem::swap(&mut self.missing, &mut self.owed);
            for &peer in &self.owed {
                if !self.missing.contains(&peer) {
                    let _ = self.missing.push(peer);
                }
            }
            self.owed.clear();
            while !self.missing.is_empty() && !self.air.fits(now_us, self.missing.len(), until_us) {
                let left = self.missing.pop();
                self.owe(left);
            }
            if !self.missing.is_empty() {
                self.repeat_until_us = Some(until_us);
                return Some(self.machine.start(&self.missing, 0));
            }
        }
        match self.air.turn(now_us, self.next_us) {
            Turn::Wait(until_us) => {
                self.turn_us = until_us;
                None
            }
            Turn::Talk { until_us } => {
                self.late = core::mem::take(&mut self.slept) && now_us > self.next_us + LATE_US;
                // Rounds that there was no time for are left out, not made up for.
                self.next_us = (self.next_us + self.period_us).max(now_us);
                self.missed = false;
                self.repeat_until_us = until_us;
                // The slot may be shorter than was asked for, or have begun late.
                let most = until_us.map_or(MAX_RESPONDERS, |until_us| {
                    (1..=MAX_RESPONDERS)
                        .rev()
                        .find(|&slots| self.air.fits(now_us, slots, until_us))
                        .unwrap_or(1)
                });
                let Plan { named, open } = self.peers.next_round(most);
                self.air.set_slots(self.peers.slots());
                while let Some(left) = self.missing.pop() {
                    self.owe(Some(left));
                }
                self.missing = named;
                Some(self.machine.start(&self.missing, open))
            }
            Turn::Beacon { superframe, beacon } => {
                self.beacon = true;
                let message = Message::Beacon(beacon);
                Some(self.machine.say(Address::BROADCAST, superframe, message))
            }
            Turn::Join(coordinator) => {
                let message = self.air.join();
                Some(self.machine.say(coordinator, 0, message))
            }
        }
    }
}
