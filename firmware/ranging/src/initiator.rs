//! The initiator's part of an exchange.
//!
//! ```text
//!              start                    Sent                        response
//!   Idle ─────────────► SendingPoll ───────────► AwaitingResponse ────────────┐
//!    ▲  send poll now,                             │ timeout: NoResponse      │ send final
//!    │  then listen                                │                          │ at t4 + reply,
//!    ├─────────────────────────────────────────────┘                          ▼ then listen
//!    ├───────────────────────────── SendTooLate, SendTimeMismatch ──── SendingFinal
//!    │                                                                        │ Sent
//!    │  report: Measured; timeout: NoReport                                   ▼
//!    └─────────────────────────────────────────────────────────────── AwaitingReport
//! ```
//!
//! Frames that do not belong to the exchange are passed over in every state.

use crate::exchange::{
    Command, Event, Failure, Identity, Ignored, Measurement, Outcome, Step, Timing, When,
};
use crate::frame::{Address, Frame, Message};
use crate::time::{DeviceTime, Ticks};
use crate::tof::{Intervals, TwoWay};

/// Measures the range to one responder at a time.
#[derive(Clone, Debug)]
pub struct Initiator {
    identity: Identity,
    timing: Timing,
    /// Counts our frames.
    sequence: u8,
    /// Number of the exchange that runs, or ran last.
    exchange: u8,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Idle,
    SendingPoll {
        peer: Address,
    },
    AwaitingResponse {
        /// [`Address::BROADCAST`] until somebody has answered.
        peer: Address,
        poll_tx: DeviceTime,
    },
    SendingFinal {
        half: Half,
        /// The stamp that the final must get for `half.reply` to be true.
        final_tx: DeviceTime,
    },
    AwaitingReport {
        half: Half,
    },
}

/// The initiator's half of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Half {
    peer: Address,
    response_rx: DeviceTime,
    round: Ticks,
    reply: Ticks,
}

impl Initiator {
    /// An idle initiator.
    pub fn new(identity: Identity, timing: Timing) -> Self {
        Self {
            identity,
            timing,
            sequence: 0,
            exchange: 0,
            state: State::Idle,
        }
    }

    /// Whether no exchange runs.
    pub fn is_idle(&self) -> bool {
        self.state == State::Idle
    }

    /// Starts an exchange with `peer`, or with whoever answers first if `peer`
    /// is [`Address::BROADCAST`]. An exchange that still runs is dropped.
    pub fn start(&mut self, peer: Address) -> Command {
        self.exchange = self.exchange.wrapping_add(1);
        self.state = State::SendingPoll { peer };
        self.send(peer, Message::Poll, When::Now)
    }

    /// Drops an exchange that runs: its radio was started anew.
    pub fn stop(&mut self) {
        self.state = State::Idle;
    }

    /// Takes the next event from the radio.
    pub fn on_event(&mut self, event: Event<'_>) -> Step {
        match (self.state, event) {
            (State::SendingPoll { peer }, Event::Sent { at }) => {
                self.state = State::AwaitingResponse { peer, poll_tx: at };
                Step::command(Command::Wait)
            }
            (State::SendingFinal { final_tx, .. }, Event::Sent { at }) if at != final_tx => {
                self.fail(Failure::SendTimeMismatch)
            }
            (State::SendingFinal { half, .. }, Event::Sent { .. }) => {
                self.state = State::AwaitingReport { half };
                Step::command(Command::Wait)
            }
            (State::SendingPoll { .. } | State::SendingFinal { .. }, Event::SendTooLate) => {
                self.fail(Failure::SendTooLate)
            }
            (State::AwaitingResponse { peer, poll_tx }, Event::Received { bytes, at }) => {
                match self.accept(bytes, peer) {
                    Err(why) => Step::ignore(why),
                    Ok(Frame {
                        source,
                        message: Message::Response,
                        ..
                    }) => self.answer(source, poll_tx, at),
                    Ok(_) => Step::ignore(Ignored::OutOfTurn),
                }
            }
            (State::AwaitingReport { half }, Event::Received { bytes, .. }) => {
                match self.accept(bytes, half.peer) {
                    Err(why) => Step::ignore(why),
                    Ok(Frame {
                        message: Message::Report { round, reply },
                        ..
                    }) => self.finish(&half, round, reply),
                    Ok(_) => Step::ignore(Ignored::OutOfTurn),
                }
            }
            (State::AwaitingResponse { .. }, Event::ListenTimeout) => {
                self.fail(Failure::NoResponse)
            }
            (State::AwaitingReport { .. }, Event::ListenTimeout) => self.fail(Failure::NoReport),
            (State::Idle, _)
            | (State::SendingPoll { .. } | State::SendingFinal { .. }, _)
            | (
                State::AwaitingResponse { .. } | State::AwaitingReport { .. },
                Event::Sent { .. } | Event::SendTooLate,
            ) => self.fail(Failure::UnexpectedEvent),
        }
    }

    fn answer(&mut self, peer: Address, poll_tx: DeviceTime, response_rx: DeviceTime) -> Step {
        let (when, final_tx) = self.timing.answer_to(response_rx);
        let half = Half {
            peer,
            response_rx,
            round: response_rx.since(poll_tx),
            reply: final_tx.since(response_rx),
        };
        self.state = State::SendingFinal { half, final_tx };
        let message = Message::Final {
            round: half.round,
            reply: half.reply,
        };
        Step::command(self.send(peer, message, when))
    }

    fn finish(&mut self, half: &Half, responder_round: Ticks, responder_reply: Ticks) -> Step {
        let intervals = Intervals {
            initiator_round: half.round,
            initiator_reply: half.reply,
            responder_round,
            responder_reply,
        };
        match TwoWay::from_intervals(&intervals) {
            Err(error) => self.fail(Failure::Tof(error)),
            Ok(two_way) => {
                self.state = State::Idle;
                Step::with(
                    Command::Idle,
                    Outcome::Measured(Measurement {
                        peer: half.peer,
                        exchange: self.exchange,
                        at: half.response_rx,
                        two_way,
                    }),
                )
            }
        }
    }

    fn accept(&self, bytes: &[u8], peer: Address) -> Result<Frame, Ignored> {
        let frame = self.identity.accept(bytes)?;
        if peer != Address::BROADCAST && frame.source != peer {
            return Err(Ignored::WrongPeer);
        }
        if frame.exchange != self.exchange {
            return Err(Ignored::WrongExchange);
        }
        Ok(frame)
    }

    fn send(&mut self, destination: Address, message: Message, when: When) -> Command {
        self.sequence = self.sequence.wrapping_add(1);
        let frame = Frame {
            sequence: self.sequence,
            pan: self.identity.pan,
            destination,
            source: self.identity.address,
            exchange: self.exchange,
            message,
        };
        Command::Send {
            frame: frame.encode(),
            when,
            then: self.timing.for_answer(),
        }
    }

    fn fail(&mut self, why: Failure) -> Step {
        self.state = State::Idle;
        Step::with(Command::Idle, Outcome::Failed(why))
    }
}
