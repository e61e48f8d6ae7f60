//! The responder's part of a round.
//!
//! ```text
//!               poll                          Sent
//!   Listening ─────────► SendingResponse ───────────► AwaitingFinal ◄─┐ polled again:
//!     ▲  send response      │ SendTooLate,   listen      │   │  └─────┘ Superseded
//!     │  in the slot        │ SendTimeMismatch           │   │ final
//!     ├─────────────────────┘                            │   │ send report
//!     ├──────────────────────────────────────────────────┘   ▼ in the slot
//!     │                  time is over: NoFinal          SendingReport
//!     │                  final for others: NotHeard          │
//!     │  Sent: Measured                                      │
//!     └──────────────────────────────────────────────────────┘
//! ```
//!
//! A poll names who answers in which slot. Slots behind the named ones are for nodes that
//! the poll's sender does not know: a node answers in one of them only while that
//! sender has not named it for a second, and then by lot, so that of many newcomers
//! one answers alone sooner or later.

use crate::exchange::{
    Command, Event, Failure, Identity, Ignored, Measurement, Outcome, Step, Then, When,
};
use crate::frame::{Address, Frame, MAX_RESPONDERS, Message, Poll, len};
use crate::initiator::{checked, listen_after};
use crate::time::{DeviceTime, TICKS_PER_SECOND, Ticks};
use crate::timetable::{MAX_RESPONSE_US, Timetable, Timing, is_due};
use crate::tof::{Intervals, TwoWay};

/// Answers the polls of initiators, one round at a time.
#[derive(Clone, Debug)]
pub struct Responder {
    identity: Identity,
    timing: Timing,
    /// Counts our frames.
    sequence: u8,
    known_to: heapless::Vec<Acquaintance, MAX_ACQUAINTANCES>,
    state: State,
}

/// An initiator that has polled this node by its address.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Acquaintance {
    initiator: Address,
    /// When, last.
    polled: DeviceTime,
    /// In which round: the poll of a round comes once.
    round: u8,
}

/// Initiators remembered; the one silent for longest makes room for another.
const MAX_ACQUAINTANCES: usize = 24;

/// An initiator that has not polled this node for so long knows it no more.
const FORGOTTEN_AFTER: Ticks = Ticks::new(TICKS_PER_SECOND);

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Listening,
    SendingResponse {
        with: Partner,
        /// The stamp that the response must get.
        response_tx: DeviceTime,
    },
    AwaitingFinal {
        with: Partner,
        response_tx: DeviceTime,
    },
    SendingReport {
        with: Partner,
        response_tx: DeviceTime,
        report_tx: DeviceTime,
        result: Result<TwoWay, Failure>,
    },
}

/// The round that this node takes part in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Partner {
    peer: Address,
    round: u8,
    table: Timetable,
    poll_rx: DeviceTime,
}

impl Responder {
    /// A responder that listens for polls once [`Responder::start`] is called.
    pub fn new(identity: Identity, timing: Timing) -> Self {
        Self {
            identity,
            timing,
            sequence: 0,
            known_to: heapless::Vec::new(),
            state: State::Listening,
        }
    }

    /// Changes the node's speed and antenna delay; to be called while no round runs.
    pub fn set_timing(&mut self, timing: Timing) {
        self.timing = timing;
    }

    /// Whether no round runs.
    pub fn is_idle(&self) -> bool {
        self.state == State::Listening
    }

    /// Whether the final has come, and the report is on its way.
    pub fn is_reporting(&self) -> bool {
        matches!(self.state, State::SendingReport { .. })
    }

    /// The initiator of the round that runs.
    pub fn partner(&self) -> Option<Address> {
        match &self.state {
            State::Listening => None,
            State::SendingResponse { with, .. }
            | State::AwaitingFinal { with, .. }
            | State::SendingReport { with, .. } => Some(with.peer),
        }
    }

    /// Starts to listen for polls, with a radio whose clock may have started
    /// anew; a round that still runs is dropped.
    pub fn start(&mut self) -> Command {
        self.known_to.clear();
        self.state = State::Listening;
        Command::Listen { until: None }
    }

    /// Takes the next event from the radio.
    pub fn on_event(&mut self, event: Event<'_>) -> Step {
        match (self.state, event) {
            (State::Listening, Event::Received { bytes, at }) => {
                match self.identity.accept(bytes) {
                    Err(why) => Step::ignore(why),
                    Ok(frame) => match self.answer(&frame, at) {
                        Err(why) => Step::ignore(why),
                        Ok(command) => Step::command(command),
                    },
                }
            }
            (State::SendingResponse { response_tx, .. }, Event::Sent { at })
                if at != response_tx =>
            {
                self.fail(Failure::SendTimeMismatch)
            }
            (State::SendingResponse { with, response_tx }, Event::Sent { .. }) => {
                self.state = State::AwaitingFinal { with, response_tx };
                Step::command(Command::Wait)
            }
            (State::AwaitingFinal { with, response_tx }, Event::Received { bytes, at }) => {
                self.on_frame(with, response_tx, bytes, at)
            }
            (State::AwaitingFinal { .. }, Event::ListenTimeout) => self.fail(Failure::NoFinal),
            (State::SendingReport { report_tx, .. }, Event::Sent { at }) if at != report_tx => self
                .end(
                    Command::Wait,
                    Outcome::Failed {
                        peer: self.peer(),
                        why: Failure::SendTimeMismatch,
                    },
                ),
            (
                State::SendingReport {
                    with,
                    response_tx,
                    result,
                    ..
                },
                Event::Sent { .. },
            ) => {
                let outcome = match result {
                    Ok(two_way) => Outcome::Measured(Measurement {
                        peer: with.peer,
                        round: with.round,
                        slot: 0,
                        at: response_tx,
                        two_way,
                    }),
                    Err(why) => Outcome::Failed {
                        peer: with.peer,
                        why,
                    },
                };
                self.end(Command::Wait, outcome)
            }
            (State::SendingResponse { .. } | State::SendingReport { .. }, Event::SendTooLate) => {
                self.fail(Failure::SendTooLate)
            }
            (State::Listening, Event::Sent { .. } | Event::SendTooLate | Event::ListenTimeout)
            | (State::SendingResponse { .. } | State::SendingReport { .. }, _)
            | (State::AwaitingFinal { .. }, Event::Sent { .. } | Event::SendTooLate) => {
                self.fail(Failure::UnexpectedEvent)
            }
        }
    }

    /// A frame while the final is due.
    fn on_frame(
        &mut self,
        with: Partner,
        response_tx: DeviceTime,
        bytes: &[u8],
        at: DeviceTime,
    ) -> Step {
        let frame = match self.identity.accept(bytes) {
            Err(why) => return Step::ignore(why),
            Ok(frame) if frame.source != with.peer => return Step::ignore(Ignored::WrongPeer),
            Ok(frame) => frame,
        };
        let last = match (&frame.message, frame.round == with.round) {
            (Message::Poll(_), true) => return Step::ignore(Ignored::OutOfTurn),
            (Message::Poll(_), false) => {
                let superseded = Outcome::Failed {
                    peer: with.peer,
                    why: Failure::Superseded,
                };
                return match self.answer(&frame, at) {
                    Ok(command) => Step::with(command, superseded),
                    Err(_) => self.end(Command::Listen { until: None }, superseded),
                };
            }
            (_, false) => return Step::ignore(Ignored::WrongRound),
            (Message::Final(last), true) => last,
            (_, true) => return Step::ignore(Ignored::OutOfTurn),
        };
        // Poll and final have the same way to go.
        if !is_due(with.table.final_us(), at.since(with.poll_rx), Ticks::new(0)) {
            return Step::ignore(Ignored::OutOfTime);
        }
        let own = self.identity.address;
        let Some((index, answered)) =
            (last.answered.iter().enumerate()).find(|(_, answered)| answered.responder == own)
        else {
            return self.fail(Failure::NotHeard);
        };
        let intervals = Intervals {
            initiator_round: answered.round,
            initiator_reply: Ticks::new(last.span.get().wrapping_sub(answered.round.get())),
            responder_round: at.since(response_tx),
            responder_reply: response_tx.since(with.poll_rx),
        };
        let due_us = with.table.report_us(index) - with.table.final_us();
        let (when, report_tx) = self.timing.start(at, due_us);
        self.state = State::SendingReport {
            with,
            response_tx,
            report_tx,
            result: checked(&intervals),
        };
        let message = Message::Report {
            round: intervals.responder_round,
            reply: intervals.responder_reply,
        };
        let then = Then::Listen {
            after_us: 0,
            timeout_us: None,
        };
        Step::command(self.send(&with, message, (when, due_us), then))
    }

    /// The response to a poll, if it is one and for this node.
    fn answer(&mut self, frame: &Frame, at: DeviceTime) -> Result<Command, Ignored> {
        let Message::Poll(poll) = &frame.message else {
            return Err(Ignored::OutOfTurn);
        };
        let slot = self.slot(frame, poll, at)?;
        if poll.reply_us < self.timing.reply_us {
            return Err(Ignored::TooFast);
        }
        let table = Timetable::of(poll);
        if table.last_response_us() > MAX_RESPONSE_US {
            return Err(Ignored::TooSlow);
        }
        let with = Partner {
            peer: frame.source,
            round: frame.round,
            table,
            poll_rx: at,
        };
        let ahead_us = table.response_us(slot);
        let (when, response_tx) = self.timing.start(at, ahead_us);
        self.state = State::SendingResponse { with, response_tx };
        let due_us = table.final_us() - ahead_us;
        let longest = len::last(MAX_RESPONDERS.min(usize::from(poll.slots)));
        // Early by the grid; the final is as late as the poll was.
        let late = Ticks::from_us(1);
        let then = listen_after(&self.timing, len::RESPONSE, due_us, late, longest);
        Ok(self.send(&with, Message::Response, (when, ahead_us), then))
    }

    /// The slot to answer in.
    fn slot(&mut self, frame: &Frame, poll: &Poll, at: DeviceTime) -> Result<usize, Ignored> {
        self.known_to
            .retain(|known| at.since(known.polled) < FORGOTTEN_AFTER);
        let own = self.identity.address;
        if let Some(slot) = poll.named.iter().position(|&named| named == own) {
            let again = |known: &Acquaintance| {
                (known.initiator, known.round) == (frame.source, frame.round)
            };
            if self.known_to.iter().any(again) {
                return Err(Ignored::OutOfTurn);
            }
            self.known_to
                .retain(|known| known.initiator != frame.source);
            if self.known_to.is_full() {
                // In the order of their last polls: the first has been silent for longest.
                self.known_to.remove(0);
            }
            // There is room now.
            let _ = self.known_to.push(Acquaintance {
                initiator: frame.source,
                polled: at,
                round: frame.round,
            });
            return Ok(slot);
        }
        let open = usize::from(poll.slots).saturating_sub(poll.named.len());
        let known = (self.known_to.iter()).any(|known| known.initiator == frame.source);
        if known {
            return Err(Ignored::LeftToOthers);
        }
        let slot = lot(own, frame.round, at, open).ok_or(Ignored::LeftToOthers)?;
        Ok(poll.named.len() + slot)
    }

    fn peer(&self) -> Address {
        self.partner().unwrap_or(Address::BROADCAST)
    }

    fn send(
        &mut self,
        with: &Partner,
        message: Message,
        (when, ahead_us): (When, u32),
        then: Then,
    ) -> Command {
        self.sequence = self.sequence.wrapping_add(1);
        let frame = Frame {
            sequence: self.sequence,
            pan: self.identity.pan,
            destination: with.peer,
            source: self.identity.address,
            round: with.round,
            message,
        };
        Command::Send {
            frame: frame.encode(),
            when,
            ahead_us,
            then,
        }
    }

    fn fail(&mut self, why: Failure) -> Step {
        let peer = self.peer();
        self.end(
            Command::Listen { until: None },
            Outcome::Failed { peer, why },
        )
    }

    fn end(&mut self, command: Command, outcome: Outcome) -> Step {
        self.state = State::Listening;
        Step::with(command, outcome)
    }
}

/// In which of `open` slots to answer a poll, if at all: with odds of 1/2, 1/4, 1/8 or
/// 1/16 for each slot, by the round's number, as nobody knows how many others wait. The
/// time stamp makes the lots of two nodes, and of two rounds, independent of each other.
fn lot(address: Address, round: u8, at: DeviceTime, open: usize) -> Option<usize> {
    let stamp = at.ticks() as u32 ^ (at.ticks() >> 32) as u32;
    let mixed = (stamp ^ u32::from(address.0) << 16).wrapping_mul(0x9E37_79B1);
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x85EB_CA6B);
    // Initiators search now and then, say every 64th round: all digits count.
    let odds = 1 + (round ^ round >> 2 ^ round >> 4 ^ round >> 6) % 4;
    let draw = usize::try_from(mixed >> 16).ok()? * open;
    // In 2^-16 of a slot.
    let (slot, part) = (draw >> 16, draw & 0xFFFF);
    (open > 0 && part >> (16 - odds) == 0).then_some(slot)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draws(address: u16, round: u8, open: usize) -> impl Iterator<Item = Option<usize>> {
        (0..16_000u64).map(move |k| {
            let at = DeviceTime::from_ticks(k * 638_976_123);
            lot(Address(address), round, at, open)
        })
    }

    #[test]
    fn an_open_slot_is_taken_with_the_odds_of_the_rounds_number() {
        for (round, odds) in [
            (0, 2),
            (1, 4),
            (2, 8),
            (3, 16),
            (64, 4),
            (128, 8),
            (192, 16),
        ] {
            let answers = draws(7, round, 1).flatten().count();
            let expected = 16_000 / odds;
            assert!(
                answers.abs_diff(expected) < expected / 8 + 40,
                "{answers} of 16000 at 1/{odds}"
            );
        }
    }

    #[test]
    fn all_open_slots_are_taken_alike_and_none_without_one() {
        for slot in 0..4 {
            let taken = draws(7, 0, 4).flatten().filter(|&s| s == slot).count();
            assert!(taken.abs_diff(2_000) < 250, "slot {slot}: {taken}");
        }
        assert_eq!(draws(7, 0, 0).flatten().count(), 0);
    }

    #[test]
    fn two_nodes_draw_independently() {
        for (a, b) in [(1, 2), (0x0102, 0x0201), (0xFFFE, 0x7FFF), (16, 17)] {
            let alone = draws(a, 0, 1)
                .zip(draws(b, 0, 1))
                .filter(|(a, b)| a != b)
                .count();
            assert!((7_200..8_800).contains(&alone), "{a} {b}: {alone} of 16000");
        }
    }
}
