//! What all parts in a round have in common: what can happen to them, what they
//! ask of the radio, and how a measurement can end.
//!
//! A state machine is driven like this:
//!
//! ```text
//!   radio ──Event──► on_event ──► Step { command, outcome }
//!     ▲                              │        │
//!     └────────── carried out ◄──────┘        └──► counted, or a range reported
//! ```

use crate::frame::{Address, Frame, FrameBuffer, FrameError};
use crate::time::DeviceTime;
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
        /// End with [`Event::ListenTimeout`] when the radio's clock shows this; at
        /// once if that has passed. Listen for ever if `None`.
        until: Option<DeviceTime>,
    },
    /// Go on listening until the end that was set. The radio has switched its receiver
    /// off with the frame it received.
    KeepListening,
    /// Nothing: the radio does already what it was told to do next.
    Wait,
    /// Send a frame; end with [`Event::Sent`] or [`Event::SendTooLate`].
    Send {
        /// The frame without its check sequence.
        frame: FrameBuffer,
        /// When.
        when: When,
        /// How far ahead of now that is at most, in microseconds. It follows the
        /// poll's times, not this node's own.
        ahead_us: u32,
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

/// How a measurement, or a frame, ended.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// A range.
    Measured(Measurement),
    /// A measurement failed; the round may go on with other responders.
    Failed {
        /// The other node; [`Address::BROADCAST`] for all of the round, or where nobody
        /// knows whom it would have been with.
        peer: Address,
        /// Why.
        why: Failure,
    },
    /// A frame was passed over; the round goes on.
    Ignored(Ignored),
}

/// The result of a complete measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measurement {
    /// The other node.
    pub peer: Address,
    /// The round's number.
    pub round: u8,
    /// The initiator's slot in which the response came; 0 at a responder.
    pub slot: u8,
    /// When the response passed this node's antenna, on this node's clock: the
    /// time that the range belongs to.
    ///
    /// The formula weighs the ranges during poll, response and final as
    /// (Da (d1 + d2) + Db (d2 + d3)) / 2 (Da + Db): for nodes that move evenly that is
    /// d2, whatever the reply times.
    pub at: DeviceTime,
    /// Time of flight and the responder's clock against the initiator's.
    pub two_way: TwoWay,
}

/// Why a measurement gave no range.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Failure {
    /// The initiator heard no response in a node's slot: nobody there, or a frame
    /// was lost.
    NoResponse,
    /// The initiator heard no response in a slot for nodes that it does not know.
    NobodyNew,
    /// The responder heard no final: its response or the final was lost.
    NoFinal,
    /// The initiator heard no report: its final or the report was lost.
    NoReport,
    /// The responder was polled again before the final came: the initiator
    /// has given up.
    Superseded,
    /// The final came, but the initiator has not heard this node's response.
    NotHeard,
    /// A frame was due before the radio could send it: the reply time is too
    /// short for this processor and bus.
    SendTooLate,
    /// The radio sent a frame at another time than it was told, or says so.
    SendTimeMismatch,
    /// The six time stamps contradict each other.
    Tof(TofError),
    /// The range is less than nothing, or further than any radio reaches.
    Implausible,
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
    /// From another node than the one that is due.
    WrongPeer,
    /// From the right node, but of another round.
    WrongRound,
    /// Of the right round, but not what is due now; duplicates end here.
    OutOfTurn,
    /// Of the right round and what is due, but not at the time that it is due.
    OutOfTime,
    /// A poll that is left to others to answer.
    LeftToOthers,
    /// A poll that wants its answer sooner than this node can give it.
    TooFast,
    /// A poll whose responses would last longer than
    /// [`MAX_RESPONSE_US`](crate::timetable::MAX_RESPONSE_US).
    TooSlow,
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
        // Nobody is called "all nodes"; believing it would make that a peer. And nobody
        // hears itself: that is a frame sent back, or another node of this address.
        if frame.pan != self.pan
            || frame.source == Address::BROADCAST
            || frame.source == self.address
        {
            return Err(Ignored::ForeignNetwork);
        }
        if frame.destination != self.address && frame.destination != Address::BROADCAST {
            return Err(Ignored::ForOthers);
        }
        Ok(frame)
    }
}
