//! What both parts of an exchange have in common: what can happen to them,
//! what they ask of the radio, and how an exchange can end.
//!
//! A state machine is driven like this:
//!
//! ```text
//!   radio ──Event──► on_event ──► Step { command, outcome }
//!     ▲                              │        │
//!     └────────── carried out ◄──────┘        └──► counted, or a range reported
//! ```

use crate::frame::{Address, Frame, FrameBuffer, FrameError};
use crate::time::{DeviceTime, Ticks};
use crate::tof::{TofError, TwoWay};

/// What the radio tells a state machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// The frame that was to be sent has left the antenna at this time.
    Sent {
        /// The radio's transmit time stamp, antenna delay added.
        at: DeviceTime,
    },
    /// The radio could not send at the time it was told: that time had passed.
    SendTooLate,
    /// A frame with a good check sequence has come in.
    Received {
        /// The frame without its check sequence.
        bytes: &'a [u8],
        /// The radio's receive time stamp, antenna delay taken off.
        at: DeviceTime,
    },
    /// The time for listening is over and nothing that counts has come.
    ListenTimeout,
}

/// What a state machine asks of the radio.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Command {
    /// Switch transmitter and receiver off.
    Idle,
    /// Switch the receiver on.
    Listen {
        /// End with [`Event::ListenTimeout`] after this many microseconds;
        /// listen for ever if `None`.
        timeout_us: Option<u32>,
    },
    /// Go on listening until the time-out that already runs.
    KeepListening,
    /// Nothing: the radio does already what it was told to do next.
    Wait,
    /// Send a frame; end with [`Event::Sent`] or [`Event::SendTooLate`].
    Send {
        /// The frame without its check sequence.
        frame: FrameBuffer,
        /// When.
        when: When,
        /// What the radio does by itself afterwards.
        then: Then,
    },
}

/// When to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum When {
    /// As soon as possible.
    Now,
    /// When the clock shows this reading, which lies on the
    /// [grid of delayed transmissions](crate::time::DELAYED_GRID). The frame's
    /// time stamp will be this plus the antenna delay.
    At(DeviceTime),
}

/// What the radio does by itself when it has sent a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Then {
    /// Nothing.
    Idle,
    /// It listens.
    Listen {
        /// From the end of the frame sent to the receiver switched on, in microseconds.
        after_us: u32,
        /// How long the receiver is on, in microseconds; [`Event::ListenTimeout`] then.
        /// For ever if `None`.
        timeout_us: Option<u32>,
    },
}

/// The answer to an event.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// To be carried out now.
    pub command: Command,
    /// What the event has brought to an end, if anything.
    pub outcome: Option<Outcome>,
}

/// How an exchange, or a frame, ended.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// A range.
    Measured(Measurement),
    /// The exchange failed.
    Failed(Failure),
    /// A frame was passed over; the exchange goes on.
    Ignored(Ignored),
}

/// The result of a complete exchange.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measurement {
    /// The other node.
    pub peer: Address,
    /// The exchange's number.
    pub exchange: u8,
    /// When the response passed this node's antenna, on this node's clock: the
    /// time that the range belongs to.
    ///
    /// With equal reply times the formula weighs the ranges during poll,
    /// response and final as (d1 + 2 d2 + d3) / 4, so that for moving nodes it
    /// gives the range in the middle.
    pub at: DeviceTime,
    /// Time of flight and the responder's clock against the initiator's.
    pub two_way: TwoWay,
}

/// Why an exchange gave no range.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Failure {
    /// The initiator heard no response to its poll: nobody there, or a frame
    /// was lost.
    NoResponse,
    /// The responder heard no final: its response or the final was lost.
    NoFinal,
    /// The initiator heard no report: its final or the report was lost.
    NoReport,
    /// The responder was polled again before the final came: the initiator
    /// has given up.
    Superseded,
    /// A frame was due before the radio could send it: the reply time is too
    /// short for this processor and bus.
    SendTooLate,
    /// The radio sent the final at another time than the one written in it.
    SendTimeMismatch,
    /// The six time stamps contradict each other.
    Tof(TofError),
    /// The radio reported an event that this state cannot have.
    UnexpectedEvent,
}

/// Why a received frame was passed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Ignored {
    /// Not a frame of this protocol.
    NotOurs(FrameError),
    /// From another network, or from nobody: its source is all nodes.
    ForeignNetwork,
    /// For another node.
    ForOthers,
    /// From another node than the one the exchange is with.
    WrongPeer,
    /// From the right node, but of another exchange.
    WrongExchange,
    /// Of the right exchange, but not what is due now; duplicates end here.
    OutOfTurn,
    /// A poll to all nodes that was left to others to answer.
    LeftToOthers,
}

/// Times that both nodes of an exchange agree on, and the local antenna delay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timing {
    /// From a frame received to the answer sent. Long enough for the rest of
    /// the frame, interrupt, SPI and the answer's preamble.
    pub reply: Ticks,
    /// From the end of one's own frame until its answer can begin, in microseconds.
    pub listen_after_us: u32,
    /// How long to listen for an answer from then on, in microseconds.
    pub answer_timeout_us: u32,
    /// What the radio adds to the start of a transmission to stamp it.
    pub tx_antenna_delay: Ticks,
}

impl Timing {
    /// When to start a delayed answer to a frame received at `received`, and
    /// the stamp it will have.
    pub(crate) fn answer_to(&self, received: DeviceTime) -> (When, DeviceTime) {
        let start = received.after(self.reply).on_delayed_grid();
        (When::At(start), start.after(self.tx_antenna_delay))
    }

    /// To listen for the answer to a frame.
    pub(crate) fn for_answer(&self) -> Then {
        Then::Listen {
            after_us: self.listen_after_us,
            timeout_us: Some(self.answer_timeout_us),
        }
    }
}

impl Step {
    pub(crate) fn command(command: Command) -> Self {
        Self {
            command,
            outcome: None,
        }
    }

    pub(crate) fn with(command: Command, outcome: Outcome) -> Self {
        Self {
            command,
            outcome: Some(outcome),
        }
    }

    pub(crate) fn ignore(why: Ignored) -> Self {
        Self::with(Command::KeepListening, Outcome::Ignored(why))
    }
}

/// Who a node is: enough to tell its frames from others'.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Identity {
    /// The network.
    pub pan: crate::frame::PanId,
    /// The node.
    pub address: Address,
}

impl Identity {
    /// Reads a received frame and checks that it is meant for this node.
    pub(crate) fn accept(&self, bytes: &[u8]) -> Result<Frame, Ignored> {
        let frame = Frame::parse(bytes).map_err(Ignored::NotOurs)?;
        // Nobody is called "all nodes"; believing it would make that a peer.
        if frame.pan != self.pan || frame.source == Address::BROADCAST {
            return Err(Ignored::ForeignNetwork);
        }
        if frame.destination != self.address && frame.destination != Address::BROADCAST {
            return Err(Ignored::ForOthers);
        }
        Ok(frame)
    }
}
