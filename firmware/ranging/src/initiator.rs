//! The initiator's part of a round.
//!
//! ```text
//!           start              Sent            response, or the slot's time is over: NoResponse
//!   Idle ──────────► Polling ────────► Collecting ◄──┐ next slot: listen
//!    ▲   send poll     │              │  │  └────────┘
//!    │                 │   nobody     │  │ last slot, somebody has answered:
//!    │                 │   answered   │  ▼ send final at its time
//!    │  SendTooLate    │              │ Closing ──────────┐ SendTooLate, SendTimeMismatch
//!    ├─────────────────┘              ▼  │ Sent           │
//!    ├──────────────────────────── Resting │              │
//!    │   the final's time is over        ▼                │
//!    ├─────────────────────────────── Hearing ◄─┐ report: Measured; its time is over: NoReport
//!    │   all that answered had their turn └─────┘ listen  │
//!    └────────────────────────────────────────────────────┘
//! ```
//!
//! Frames that do not belong to the round, or do not come when they are due, are passed
//! over in every state.

use crate::exchange::{
    Command, Event, Failure, Identity, Ignored, Measurement, Outcome, Step, Then, When,
};
use crate::frame::{Address, Answered, Final, Frame, MAX_RESPONDERS, Message, Poll, len};
use crate::time::{DeviceTime, Ticks};
use crate::timetable::{LISTEN_EARLY_US, MAX_ROUND_TRIP, Timetable, Timing, is_due};
use crate::tof::{Intervals, TwoWay};

/// Measures the ranges to up to [`MAX_RESPONDERS`] responders at a time.
#[derive(Clone, Debug)]
pub struct Initiator {
    identity: Identity,
    timing: Timing,
    /// Counts our frames.
    sequence: u8,
    /// Number of the round that runs, or ran last.
    round: u8,
    table: Timetable,
    /// Slots for answers in this round.
    slots: usize,
    /// Whose the first of them are.
    named: heapless::Vec<Address, MAX_RESPONDERS>,
    /// Who has answered, in the order of the slots.
    heard: heapless::Vec<Heard, MAX_RESPONDERS>,
    state: State,
}

/// A response.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Heard {
    responder: Address,
    slot: usize,
    at: DeviceTime,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Idle,
    Polling,
    Collecting {
        poll_tx: DeviceTime,
        slot: usize,
    },
    Resting,
    Closing {
        poll_tx: DeviceTime,
        /// The stamp that the final must get for what it says to be true.
        final_tx: DeviceTime,
    },
    Hearing {
        poll_tx: DeviceTime,
        final_tx: DeviceTime,
        /// Into `heard`.
        index: usize,
    },
}

impl Initiator {
    /// An idle initiator.
    pub fn new(identity: Identity, timing: Timing) -> Self {
        Self {
            identity,
            timing,
            sequence: 0,
            round: 0,
            table: Timetable::new(&timing, 1),
            slots: 1,
            named: heapless::Vec::new(),
            heard: heapless::Vec::new(),
            state: State::Idle,
        }
    }

    /// Changes the node's speed and antenna delay; to be called while no round runs.
    pub fn set_timing(&mut self, timing: Timing) {
        self.timing = timing;
    }

    /// Whether no round runs.
    pub fn is_idle(&self) -> bool {
        self.state == State::Idle
    }

    /// Starts a round with the nodes in `named`, and `open` slots for nodes that are
    /// not known. What exceeds [`MAX_RESPONDERS`] is left out. A round that still runs is dropped.
    pub fn start(&mut self, named: &[Address], open: usize) -> Command {
        self.named = named.iter().take(MAX_RESPONDERS).copied().collect();
        self.slots = (self.named.len() + open).clamp(1, MAX_RESPONDERS);
        self.heard.clear();
        self.round = self.round.wrapping_add(1);
        self.table = Timetable::new(&self.timing, self.slots);
        self.state = State::Polling;
        let destination = self.everybody();
        let message = Message::Poll(Poll {
            reply_us: self.timing.reply_us,
            slot_us: self.timing.slot_us,
            slots: self.slots as u8,
            named: self.named.clone(),
        });
        let own = len::poll(self.named.len());
        let then = self.listen_after(own, self.table.response_us(0), len::RESPONSE);
        self.send(destination, message, (When::Now, 0), then)
    }

    /// Drops a round that runs: its radio was started anew.
    pub fn stop(&mut self) {
        self.state = State::Idle;
    }

    /// Sends a frame that belongs to no round, and listens on.
    pub fn say(&mut self, destination: Address, number: u8, message: Message) -> Command {
        self.sequence = self.sequence.wrapping_add(1);
        let frame = Frame {
            sequence: self.sequence,
            pan: self.identity.pan,
            destination,
            source: self.identity.address,
            round: number,
            message,
        };
        Command::Send {
            frame: frame.encode(),
            when: When::Now,
            ahead_us: 0,
            then: Then::Listen {
                after_us: 0,
                timeout_us: None,
            },
        }
    }

    /// The slot of the response that was heard last in this round; 0 before the first.
    pub fn slot(&self) -> usize {
        self.heard.last().map_or(0, |heard| heard.slot)
    }

    /// Whose response was heard last in this round.
    pub fn heard_last(&self) -> Option<Address> {
        self.heard.last().map(|heard| heard.responder)
    }

    /// Takes the next event from the radio.
    pub fn on_event(&mut self, event: Event<'_>) -> Step {
        match (self.state, event) {
            (State::Polling, Event::Sent { at }) => {
                self.state = State::Collecting {
                    poll_tx: at,
                    slot: 0,
                };
                Step::command(Command::Wait)
            }
            (State::Closing { final_tx, .. }, Event::Sent { at }) if at != final_tx => {
                self.fail(Failure::SendTimeMismatch)
            }
            (State::Closing { poll_tx, final_tx }, Event::Sent { .. }) => {
                self.state = State::Hearing {
                    poll_tx,
                    final_tx,
                    index: 0,
                };
                Step::command(Command::Wait)
            }
            (State::Polling | State::Closing { .. }, Event::SendTooLate) => {
                self.fail(Failure::SendTooLate)
            }
            (State::Collecting { poll_tx, slot }, Event::Received { bytes, at }) => {
                match self.response(bytes, at.since(poll_tx), slot) {
                    Err(why) => Step::ignore(why),
                    Ok(responder) => {
                        // There is room: at most one a slot.
                        let _ = self.heard.push(Heard {
                            responder,
                            slot,
                            at,
                        });
                        Step::command(self.next_slot(poll_tx, slot))
                    }
                }
            }
            (State::Collecting { poll_tx, slot }, Event::ListenTimeout) => {
                let outcome = match self.named.get(slot) {
                    Some(&peer) => Outcome::Failed {
                        peer,
                        why: Failure::NoResponse,
                    },
                    None => Outcome::Failed {
                        peer: Address::BROADCAST,
                        why: Failure::NobodyNew,
                    },
                };
                let command = self.next_slot(poll_tx, slot);
                Step::with(command, outcome)
            }
            (
                State::Hearing {
                    poll_tx,
                    final_tx,
                    index,
                },
                Event::Received { bytes, at },
            ) => match self.report(bytes, at.since(poll_tx), index) {
                Err(why) => Step::ignore(why),
                Ok((heard, round, reply)) => {
                    let outcome = self.measure(poll_tx, final_tx, &heard, round, reply);
                    let command = self.next_report(poll_tx, final_tx, index);
                    Step::with(command, outcome)
                }
            },
            (
                State::Hearing {
                    poll_tx,
                    final_tx,
                    index,
                },
                Event::ListenTimeout,
            ) => {
                let peer = self.heard.get(index).map(|heard| heard.responder);
                let outcome = Outcome::Failed {
                    peer: peer.unwrap_or(Address::BROADCAST),
                    why: Failure::NoReport,
                };
                let command = self.next_report(poll_tx, final_tx, index);
                Step::with(command, outcome)
            }
            (State::Resting, Event::Received { bytes, .. }) => match self.accept(bytes) {
                Err(why) => Step::ignore(why),
                Ok(_) => Step::ignore(Ignored::OutOfTurn),
            },
            (State::Resting, Event::ListenTimeout) => {
                self.state = State::Idle;
                Step::command(Command::Idle)
            }
            (State::Idle | State::Polling | State::Closing { .. }, _)
            | (
                State::Collecting { .. } | State::Hearing { .. } | State::Resting,
                Event::Sent { .. } | Event::SendTooLate,
            ) => self.fail(Failure::UnexpectedEvent),
        }
    }

    /// All that have a part in the round.
    fn everybody(&self) -> Address {
        match (self.named.first(), self.slots) {
            (Some(&only), 1) => only,
            _ => Address::BROADCAST,
        }
    }

    /// Whose response this is, if it is one and comes in this slot.
    fn response(&self, bytes: &[u8], since: Ticks, slot: usize) -> Result<Address, Ignored> {
        let frame = self.accept(bytes)?;
        let responder = frame.source;
        match self.named.get(slot) {
            Some(&named) if named != responder => return Err(Ignored::WrongPeer),
            // A node that has a slot, or has had one, is not new.
            None if self.named.contains(&responder)
                || self.heard.iter().any(|heard| heard.responder == responder) =>
            {
                return Err(Ignored::WrongPeer);
            }
            _ => {}
        }
        if frame.message != Message::Response {
            return Err(Ignored::OutOfTurn);
        }
        if self.table.slot_at(since) != Some(slot) {
            return Err(Ignored::OutOfTime);
        }
        Ok(responder)
    }

    /// Listens in the slot behind this one, or closes the round.
    fn next_slot(&mut self, poll_tx: DeviceTime, slot: usize) -> Command {
        let next = slot + 1;
        if next < self.slots {
            self.state = State::Collecting {
                poll_tx,
                slot: next,
            };
            return self.listen(poll_tx, self.table.response_us(next), len::RESPONSE);
        }
        if self.heard.is_empty() {
            // Who has answered unheard waits for a final that will not come; a new poll
            // before that time would be wasted.
            self.state = State::Resting;
            return self.listen(poll_tx, self.table.final_us(), len::last(0));
        }
        let ahead_us = self.table.final_us();
        let (when, final_tx) = self.timing.start(poll_tx, ahead_us);
        self.state = State::Closing { poll_tx, final_tx };
        let message = Message::Final(Final {
            span: final_tx.since(poll_tx),
            answered: self
                .heard
                .iter()
                .map(|heard| Answered {
                    responder: heard.responder,
                    round: heard.at.since(poll_tx),
                })
                .collect(),
        });
        let own = len::last(self.heard.len());
        let due_us = self.table.report_us(0) - self.table.final_us();
        let then = self.listen_after(own, due_us, len::REPORT);
        let destination = self.everybody();
        self.send(destination, message, (when, ahead_us), then)
    }

    /// The report due, with Rb and Db.
    fn report(
        &self,
        bytes: &[u8],
        since: Ticks,
        index: usize,
    ) -> Result<(Heard, Ticks, Ticks), Ignored> {
        let frame = self.accept(bytes)?;
        let heard = *self.heard.get(index).ok_or(Ignored::OutOfTurn)?;
        if frame.source != heard.responder {
            return Err(Ignored::WrongPeer);
        }
        let Message::Report { round, reply } = frame.message else {
            return Err(Ignored::OutOfTurn);
        };
        if !is_due(self.table.report_us(index), since, MAX_ROUND_TRIP) {
            return Err(Ignored::OutOfTime);
        }
        Ok((heard, round, reply))
    }

    fn measure(
        &self,
        poll_tx: DeviceTime,
        final_tx: DeviceTime,
        heard: &Heard,
        responder_round: Ticks,
        responder_reply: Ticks,
    ) -> Outcome {
        let intervals = Intervals {
            initiator_round: heard.at.since(poll_tx),
            initiator_reply: final_tx.since(heard.at),
            responder_round,
            responder_reply,
        };
        let peer = heard.responder;
        match checked(&intervals) {
            Err(why) => Outcome::Failed { peer, why },
            Ok(two_way) => Outcome::Measured(Measurement {
                peer,
                round: self.round,
                slot: heard.slot as u8,
                at: heard.at,
                two_way,
            }),
        }
    }

    fn next_report(&mut self, poll_tx: DeviceTime, final_tx: DeviceTime, index: usize) -> Command {
        let next = index + 1;
        if next >= self.heard.len() {
            self.state = State::Idle;
            return Command::Idle;
        }
        self.state = State::Hearing {
            poll_tx,
            final_tx,
            index: next,
        };
        self.listen(poll_tx, self.table.report_us(next), len::REPORT)
    }

    fn accept(&self, bytes: &[u8]) -> Result<Frame, Ignored> {
        let frame = self.identity.accept(bytes)?;
        if frame.round != self.round {
            return Err(Ignored::WrongRound);
        }
        Ok(frame)
    }

    fn send(
        &mut self,
        destination: Address,
        message: Message,
        (when, ahead_us): (When, u32),
        then: Then,
    ) -> Command {
        self.sequence = self.sequence.wrapping_add(1);
        let frame = Frame {
            sequence: self.sequence,
            pan: self.identity.pan,
            destination,
            source: self.identity.address,
            round: self.round,
            message,
        };
        Command::Send {
            frame: frame.encode(),
            when,
            ahead_us,
            then,
        }
    }

    /// Listening for a frame of `bytes`, due `due_us` after the poll.
    fn listen(&self, poll_tx: DeviceTime, due_us: u32, bytes: usize) -> Command {
        Command::Listen {
            until: Some(self.table.until(&self.timing, poll_tx, due_us, bytes)),
        }
    }

    /// The same `due_us` after a frame of `own` bytes that is about to be sent.
    fn listen_after(&self, own: usize, due_us: u32, bytes: usize) -> Then {
        listen_after(&self.timing, own, due_us, MAX_ROUND_TRIP, bytes)
    }

    fn fail(&mut self, why: Failure) -> Step {
        self.state = State::Idle;
        Step::with(
            Command::Idle,
            Outcome::Failed {
                peer: Address::BROADCAST,
                why,
            },
        )
    }
}

/// What the radio does behind a frame of `own` bytes to hear one of `bytes`, due `due_us`
/// behind its marker and up to `late` later.
pub(crate) fn listen_after(
    timing: &Timing,
    own: usize,
    due_us: u32,
    late: Ticks,
    bytes: usize,
) -> Then {
    let after_us =
        due_us.saturating_sub(timing.tail_us(own) + timing.preamble_us() + LISTEN_EARLY_US);
    let end_us = due_us + late.to_us() + timing.tail_us(bytes) + LISTEN_EARLY_US;
    Then::Listen {
        after_us,
        // Times in whole microseconds are rounded up: the own frame ends one sooner.
        timeout_us: Some((end_us + 1).saturating_sub(timing.tail_us(own) + after_us)),
    }
}

/// The two-way formula, and whether its result can be.
pub(crate) fn checked(intervals: &Intervals) -> Result<TwoWay, Failure> {
    let two_way = TwoWay::from_intervals(intervals).map_err(Failure::Tof)?;
    // One way; noise and antenna delays that are not calibrated make ranges negative
    // by metres, nothing by ten.
    let furthest = MAX_ROUND_TRIP.get() as f64 / 2.0;
    let nearest = -(NEAREST.get() as f64);
    if (nearest..=furthest).contains(&two_way.time_of_flight_ticks) {
        Ok(two_way)
    } else {
        Err(Failure::Implausible)
    }
}

/// A time of flight more negative than this, 10 m, is none.
const NEAREST: Ticks = Ticks::new(2_132);
