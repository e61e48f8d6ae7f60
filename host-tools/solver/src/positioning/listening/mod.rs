//! What a node that only listens hears of anchors that range among themselves.
//!
//! ```text
//!  frames with time stamps ─► Listening ─► exchange ─► ListenedRound: differences of distances
//!  intervals of finals,       who, which    u - e      │
//!  reports                    round                    ├─► locate_tdoa        at rest: one place from all
//!                                                      └─► ListenerTrack      moving: a place each round
//! ```
//!
//! Nothing is sent, so any number of tags can listen. What does not fit, a lost frame or one that cannot
//! be, is counted by cause.

mod counts;
mod exchange;
mod rounds;
mod track;

pub use counts::ListeningCounts;
pub use exchange::{ExchangeFault, HeardDifference, HeardExchange, METRES_PER_TICK, SideIntervals};
pub use rounds::Listening;
pub use track::{ListenerTrack, ListenerTrackOptions};

use super::RangeDifference;
use nalgebra::Vector3;

/// An anchor: its address, and where it is in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ListenedAnchor {
    /// Short address.
    pub address: u16,
    /// Metres.
    pub position_m: Vector3<f64>,
}

/// Which message of an exchange a frame is; docs/air-protocol.md.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeardMessage {
    /// The initiator asks.
    Poll,
    /// A responder answers.
    Response,
    /// The initiator's half of the measurements.
    Final,
    /// Anything else: reports (their stamps are not needed), beacons, joins.
    Other,
}

/// A frame as a listener stamped it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeardFrame {
    /// Seconds on any clock that does not go back.
    pub t_s: f64,
    /// The listener's stamp, ticks of its clock, 40 bits.
    pub ticks: u64,
    /// How late the stamp is by the level of the signal, metres; 0 where nobody knows.
    pub late_m: f64,
    /// Who sent it.
    pub source: u16,
    /// Whom it is for.
    pub destination: u16,
    /// What it is.
    pub message: HeardMessage,
    /// Number of its round.
    pub round: u8,
}

/// What an overheard final or report says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeardIntervals {
    /// Who measured: the initiator in a final, the responder in a report.
    pub source: u16,
    /// The other one.
    pub peer: u16,
    /// Number of the round.
    pub round: u8,
    /// What was measured.
    pub intervals: SideIntervals,
}

/// A difference of distances from a round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ListenedDifference {
    /// When: that of the response, seconds.
    pub t_s: f64,
    /// The two anchors: initiator, responder.
    pub addresses: [u16; 2],
    /// The difference, its sigma that of everything.
    pub difference: RangeDifference,
    /// Part of the sigma that all differences of the round share: what the stamps of poll and final bring
    /// in, metres.
    pub shared_m: [f64; 2],
}

/// All that one round gave.
#[derive(Debug, Clone, PartialEq)]
pub struct ListenedRound {
    /// Its differences, at least one, at most eight.
    pub differences: Vec<ListenedDifference>,
}

/// How to listen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ListeningOptions {
    /// Standard deviation of a receive stamp, metres.
    pub stamp_sigma_m: f64,
    /// What two anchors measure as their distance may differ from that of their places by this, metres: more,
    /// and their exchange was damaged or blocked, or a place is wrong.
    pub tolerance_m: f64,
}

impl Default for ListeningOptions {
    fn default() -> Self {
        Self {
            stamp_sigma_m: 0.03,
            tolerance_m: 1.0,
        }
    }
}
