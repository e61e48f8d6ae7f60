//! The responder's part of an exchange.
//!
//! ```text
//!               poll                              Sent
//!   Listening ─────────────► SendingResponse ───────────► AwaitingFinal ◄─┐ polled again:
//!     ▲  send response          │ SendTooLate                │   │  └─────┘ Superseded
//!     │  at t2 + reply,         │                            │   │ final
//!     │  then listen            │                            │   │
//!     ├─────────────────────────┘                            │   │ send report
//!     ├──────────────────────────────────────────────────────┘   ▼ at t6 + reply, then listen
//!     │                               timeout: NoFinal      SendingReport
//!     │  Sent: Measured                                          │
//!     └──────────────────────────────────────────────────────────┘
//! ```
//!
//! A poll to all nodes is a search for nodes that its sender does not know yet. It
//! is answered only while that sender has not polled this node by its address for
//! a second, and then by lot, so that of many newcomers one answers alone sooner
//! or later.

use crate::exchange::{
    Command, Event, Failure, Identity, Ignored, Measurement, Outcome, Step, Then, Timing, When,
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
    known_to: heapless::Vec<Acquaintance, MAX_ACQUAINTANCES>,
    state: State,
}

/// An initiator that has polled this node by its address.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Acquaintance {
    initiator: Address,
    /// When, last.
    polled: DeviceTime,
}

/// Initiators remembered; the one silent for longest makes room for another.
const MAX_ACQUAINTANCES: usize = 8;

/// An initiator that has not polled this node for so long knows it no more.
const FORGOTTEN_AFTER: Ticks = Ticks::new(TICKS_PER_SECOND);

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
            known_to: heapless::Vec::new(),
            state: State::Listening,
        }
    }

    /// Whether no exchange runs.
    pub fn is_idle(&self) -> bool {
        self.state == State::Listening
    }

    /// Starts to listen for polls, with a radio whose clock may have started
    /// anew; an exchange that still runs is dropped.
    pub fn start(&mut self) -> Command {
        self.known_to.clear();
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
                Step::command(Command::Wait)
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
                    let superseded = Outcome::Failed(Failure::Superseded);
                    if self.should_answer(&poll, at) {
                        let command = self.answer(&poll, at);
                        Step::with(command, superseded)
                    } else {
                        self.end(superseded)
                    }
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
                    Step::command(self.report(with, response_tx, at, &intervals))
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
            ) => {
                self.state = State::Listening;
                let outcome = match result {
                    Ok(two_way) => Outcome::Measured(Measurement {
                        peer: with.peer,
                        exchange: with.exchange,
                        at: response_tx,
                        two_way,
                    }),
                    Err(error) => Outcome::Failed(Failure::Tof(error)),
                };
                Step::with(Command::Wait, outcome)
            }
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
        self.known_to
            .retain(|known| at.since(known.polled) < FORGOTTEN_AFTER);
        if poll.destination == Address::BROADCAST {
            let known = self.known_to.iter().any(|k| k.initiator == poll.source);
            return !known && lot(self.identity.address, poll.sequence, at);
        }
        self.known_to.retain(|known| known.initiator != poll.source);
        if self.known_to.is_full() {
            // In the order of their last polls: the first has been silent for longest.
            self.known_to.remove(0);
        }
        // There is room now.
        let _ = self.known_to.push(Acquaintance {
            initiator: poll.source,
            polled: at,
        });
        true
    }

    fn answer(&mut self, poll: &Frame, at: DeviceTime) -> Command {
        let with = Partner {
            peer: poll.source,
            exchange: poll.exchange,
        };
        let (when, _) = self.timing.answer_to(at);
        self.state = State::SendingResponse { with, poll_rx: at };
        self.send(with, Message::Response, when, self.timing.for_answer())
    }

    fn report(
        &mut self,
        with: Partner,
        response_tx: DeviceTime,
        final_rx: DeviceTime,
        intervals: &Intervals,
    ) -> Command {
        self.state = State::SendingReport {
            with,
            response_tx,
            result: TwoWay::from_intervals(intervals),
        };
        let message = Message::Report {
            round: intervals.responder_round,
            reply: intervals.responder_reply,
        };
        // Not at once: the initiator needs its time to switch its receiver on.
        let (when, _) = self.timing.answer_to(final_rx);
        // And then for polls again.
        let then = Then::Listen {
            after_us: 0,
            timeout_us: None,
        };
        self.send(with, message, when, then)
    }

    fn send(&mut self, with: Partner, message: Message, when: When, then: Then) -> Command {
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
            then,
        }
    }

    fn end(&mut self, outcome: Outcome) -> Step {
        self.state = State::Listening;
        Step::with(Command::Listen { timeout_us: None }, outcome)
    }
}

/// Whether to answer a search: with odds of 1/2, 1/4, 1/8 or 1/16, in turn, as
/// nobody knows how many others wait. The time stamp makes the lots of two nodes,
/// and of two searches, independent of each other.
fn lot(address: Address, sequence: u8, at: DeviceTime) -> bool {
    let stamp = at.ticks() as u32 ^ (at.ticks() >> 32) as u32;
    let mixed = (stamp ^ u32::from(address.0) << 16).wrapping_mul(0x9E37_79B1);
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x85EB_CA6B);
    let odds = 1 + u32::from(sequence % 4);
    mixed >> (32 - odds) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_is_answered_with_the_odds_of_its_number() {
        for (sequence, odds) in [(0, 2), (1, 4), (2, 8), (3, 16), (4, 2)] {
            let answers = (0..16_000u64)
                .filter(|k| {
                    lot(
                        Address(7),
                        sequence,
                        DeviceTime::from_ticks(k * 638_976_123),
                    )
                })
                .count();
            let expected = 16_000 / odds;
            assert!(
                answers.abs_diff(expected) < expected / 8 + 40,
                "{answers} of 16000 at 1/{odds}"
            );
        }
    }

    #[test]
    fn two_nodes_draw_independently() {
        let draw =
            |address, k: u64| lot(Address(address), 0, DeviceTime::from_ticks(k * 638_976_123));
        for (a, b) in [(1, 2), (0x0102, 0x0201), (0xFFFE, 0x7FFF), (16, 17)] {
            let alone = (0..4_000).filter(|&k| draw(a, k) != draw(b, k)).count();
            assert!((1_800..2_200).contains(&alone), "{a} {b}: {alone} of 4000");
        }
    }
}
