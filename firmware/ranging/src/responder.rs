//! The responder's part of an exchange.
//!
//! ```text
//!               poll                              Sent
//!   Listening ─────────────► SendingResponse ───────────► AwaitingFinal ◄─┐ polled again:
//!     ▲  send response          │ SendTooLate    listen      │   │  └─────┘ Superseded
//!     │  at t2 + reply          │                            │   │ final
//!     ├─────────────────────────┘                            │   │ send report now
//!     ├──────────────────────────────────────────────────────┘   ▼
//!     │                               timeout: NoFinal      SendingReport
//!     │  Sent: Measured                                          │
//!     └──────────────────────────────────────────────────────────┘
//! ```
//!
//! A poll to all nodes is answered only while nobody has polled this node by
//! its address for a second, and then on the toss of a coin: so an initiator
//! that knows nobody finds everybody, one by one.

use crate::exchange::{
    Command, Event, Failure, Identity, Ignored, Measurement, Outcome, Step, Timing, When,
};
use crate::frame::{Address, Frame, Message};
use crate::time::{DeviceTime, TICKS_PER_SECOND, Ticks};
use crate::tof::{Intervals, TwoWay};

/// Answers the polls of initiators, one exchange at a time.
#[derive(Clone, Debug)]
pub struct Responder {
    identity: Identity,
    timing: Timing,
    /// Counts our frames.
    sequence: u8,
    /// When a poll to our own address came last.
    last_addressed: Option<DeviceTime>,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Listening,
    SendingResponse {
        with: Partner,
        poll_rx: DeviceTime,
    },
    AwaitingFinal {
        with: Partner,
        reply: Ticks,
        response_tx: DeviceTime,
    },
    SendingReport {
        with: Partner,
        response_tx: DeviceTime,
        result: Result<TwoWay, crate::tof::TofError>,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Partner {
    peer: Address,
    exchange: u8,
}

impl Responder {
    /// A responder that listens for polls once [`Responder::start`] is called.
    pub fn new(identity: Identity, timing: Timing) -> Self {
        Self {
            identity,
            timing,
            sequence: 0,
            last_addressed: None,
            state: State::Listening,
        }
    }

    /// Starts to listen for polls; an exchange that still runs is dropped.
    pub fn start(&mut self) -> Command {
        self.state = State::Listening;
        Command::Listen { timeout_us: None }
    }

    /// Takes the next event from the radio.
    pub fn on_event(&mut self, event: Event<'_>) -> Step {
        match (self.state, event) {
            (State::Listening, Event::Received { bytes, at }) => {
                match self.identity.accept(bytes) {
                    Err(why) => Step::ignore(why),
                    Ok(frame) if frame.message != Message::Poll => Step::ignore(Ignored::OutOfTurn),
                    Ok(poll) if !self.should_answer(&poll, at) => {
                        Step::ignore(Ignored::LeftToOthers)
                    }
                    Ok(poll) => Step::command(self.answer(&poll, at)),
                }
            }
            (State::SendingResponse { with, poll_rx }, Event::Sent { at }) => {
                self.state = State::AwaitingFinal {
                    with,
                    reply: at.since(poll_rx),
                    response_tx: at,
                };
                Step::command(Command::Listen {
                    timeout_us: Some(self.timing.answer_timeout_us),
                })
            }
            (
                State::AwaitingFinal {
                    with,
                    reply,
                    response_tx,
                },
                Event::Received { bytes, at },
            ) => match self.identity.accept(bytes) {
                Err(why) => Step::ignore(why),
                Ok(frame) if frame.source != with.peer => Step::ignore(Ignored::WrongPeer),
                Ok(Frame {
                    message: Message::Poll,
                    exchange,
                    ..
                }) if exchange == with.exchange => Step::ignore(Ignored::OutOfTurn),
                Ok(
                    poll @ Frame {
                        message: Message::Poll,
                        ..
                    },
                ) => {
                    let command = self.answer(&poll, at);
                    Step::with(command, Outcome::Failed(Failure::Superseded))
                }
                Ok(frame) if frame.exchange != with.exchange => {
                    Step::ignore(Ignored::WrongExchange)
                }
                Ok(Frame {
                    message:
                        Message::Final {
                            round: ra,
                            reply: da,
                        },
                    ..
                }) => {
                    let intervals = Intervals {
                        initiator_round: ra,
                        initiator_reply: da,
                        responder_round: at.since(response_tx),
                        responder_reply: reply,
                    };
                    Step::command(self.report(with, response_tx, &intervals))
                }
                Ok(_) => Step::ignore(Ignored::OutOfTurn),
            },
            (State::AwaitingFinal { .. }, Event::ListenTimeout) => {
                self.end(Outcome::Failed(Failure::NoFinal))
            }
            (
                State::SendingReport {
                    with,
                    response_tx,
                    result,
                },
                Event::Sent { .. },
            ) => self.end(match result {
                Ok(two_way) => Outcome::Measured(Measurement {
                    peer: with.peer,
                    exchange: with.exchange,
                    at: response_tx,
                    two_way,
                }),
                Err(error) => Outcome::Failed(Failure::Tof(error)),
            }),
            (State::SendingResponse { .. } | State::SendingReport { .. }, Event::SendTooLate) => {
                self.end(Outcome::Failed(Failure::SendTooLate))
            }
            (State::Listening, Event::Sent { .. } | Event::SendTooLate | Event::ListenTimeout)
            | (State::SendingResponse { .. } | State::SendingReport { .. }, _)
            | (State::AwaitingFinal { .. }, Event::Sent { .. } | Event::SendTooLate) => {
                self.end(Outcome::Failed(Failure::UnexpectedEvent))
            }
        }
    }

    fn should_answer(&mut self, poll: &Frame, at: DeviceTime) -> bool {
        if poll.destination != Address::BROADCAST {
            self.last_addressed = Some(at);
            return true;
        }
        let known = self
            .last_addressed
            .is_some_and(|last| at.since(last).get() < TICKS_PER_SECOND);
        !known && coin(self.identity.address, poll.sequence)
    }

    fn answer(&mut self, poll: &Frame, at: DeviceTime) -> Command {
        let with = Partner {
            peer: poll.source,
            exchange: poll.exchange,
        };
        let (when, _) = self.timing.answer_to(at);
        self.state = State::SendingResponse { with, poll_rx: at };
        self.send(with, Message::Response, when)
    }

    fn report(&mut self, with: Partner, response_tx: DeviceTime, intervals: &Intervals) -> Command {
        self.state = State::SendingReport {
            with,
            response_tx,
            result: TwoWay::from_intervals(intervals),
        };
        let message = Message::Report {
            round: intervals.responder_round,
            reply: intervals.responder_reply,
        };
        self.send(with, message, When::Now)
    }

    fn send(&mut self, with: Partner, message: Message, when: When) -> Command {
        self.sequence = self.sequence.wrapping_add(1);
        let frame = Frame {
            sequence: self.sequence,
            pan: self.identity.pan,
            destination: with.peer,
            source: self.identity.address,
            exchange: with.exchange,
            message,
        };
        Command::Send {
            frame: frame.encode(),
            when,
        }
    }

    fn end(&mut self, outcome: Outcome) -> Step {
        self.state = State::Listening;
        Step::with(Command::Listen { timeout_us: None }, outcome)
    }
}

/// Heads or tails, different for any two addresses half of the time, so that
/// two nodes that answered the same poll part soon.
fn coin(address: Address, sequence: u8) -> bool {
    let mixed = (u32::from(address.0) << 8 | u32::from(sequence)).wrapping_mul(0x9E37_79B1);
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x85EB_CA6B);
    mixed >> 31 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_two_nodes_soon_toss_differently() {
        for (a, b) in [(1, 2), (0x0102, 0x0201), (0xFFFE, 0x7FFF), (16, 17)] {
            let differ = (0..=255)
                .filter(|&s| coin(Address(a), s) != coin(Address(b), s))
                .count();
            assert!((80..=176).contains(&differ), "{a} {b}: {differ} of 256");
        }
    }
}
