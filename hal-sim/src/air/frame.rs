//! A frame as its sender emits it and as one receiver's antenna gets it.

use std::collections::BTreeMap;

use crate::phy::PhyConfig;
use crate::time::{SimDuration, SimTime};
use crate::world::ChipId;

/// Identifies a frame for the whole run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct FrameId(pub(crate) u64);

/// A frame leaving an antenna.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct OutgoingFrame {
    /// Its shape.
    pub(crate) phy: PhyConfig,
    /// First preamble symbol leaves the antenna.
    pub(crate) start: SimTime,
    /// SFD begins.
    pub(crate) sfd_start: SimTime,
    /// RMARKER: SFD ends, PHR begins.
    pub(crate) rmarker: SimTime,
    /// PHR ends, data begins.
    pub(crate) phr_end: SimTime,
    /// Data ends.
    pub(crate) end: SimTime,
    /// Power at the antenna in dBm, averaged over the preamble.
    pub(crate) power_dbm: f64,
    /// The PHR's ranging bit.
    pub(crate) ranging: bool,
    /// Frame length in bytes, FCS included.
    pub(crate) length: u16,
    /// Whether the PHR is in the proprietary long-frame format (SYS_CFG PHR_MODE).
    pub(crate) long_phr: bool,
    /// Frequency error of the sender's crystal in ppm.
    pub(crate) clock_ppm: f64,
}

impl OutgoingFrame {
    /// Moves the whole frame.
    pub(crate) fn delay(&mut self, by: SimDuration) {
        for moment in [
            &mut self.start,
            &mut self.sfd_start,
            &mut self.rmarker,
            &mut self.phr_end,
            &mut self.end,
        ] {
            *moment += by;
        }
    }
}

/// A frame reaching one antenna: the same moments, later by the flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Signal {
    /// The frame.
    pub(crate) frame: FrameId,
    /// Who sent it.
    pub(crate) from: ChipId,
    /// Moments and shape; `power_dbm` is here the power received.
    pub(crate) wave: OutgoingFrame,
    /// Power of the first path alone, in dBm.
    pub(crate) first_path_dbm: f64,
    /// Time from antenna to antenna.
    pub(crate) flight: SimDuration,
    /// One bit of its data will be flipped.
    pub(crate) corrupt: bool,
}

/// Bytes of the frames on the air.
#[derive(Debug, Default)]
pub(crate) struct FramesInFlight {
    frames: BTreeMap<FrameId, Content>,
}

#[derive(Debug)]
struct Content {
    bytes: Option<Vec<u8>>,
    aborted_at: Option<SimTime>,
    forget_at: SimTime,
}

impl FramesInFlight {
    /// Longest time that a frame's bytes are needed after it ended: 30 km of flight, or repetitions.
    const KEEP: SimDuration = SimDuration::from_ms(100);

    pub(crate) fn add(&mut self, id: FrameId, end: SimTime, now: SimTime) {
        self.frames.retain(|_, content| content.forget_at > now);
        self.frames.insert(
            id,
            Content {
                bytes: None,
                aborted_at: None,
                forget_at: end + Self::KEEP,
            },
        );
    }

    pub(crate) fn seal(&mut self, id: FrameId, bytes: Vec<u8>) {
        if let Some(content) = self.frames.get_mut(&id) {
            content.bytes = Some(bytes);
        }
    }

    pub(crate) fn abort(&mut self, id: FrameId, at: SimTime) {
        if let Some(content) = self.frames.get_mut(&id) {
            content.aborted_at.get_or_insert(at);
        }
    }

    /// The frame's bytes with FCS, once its sender has sent them all.
    pub(crate) fn bytes(&self, id: FrameId) -> Option<&[u8]> {
        self.frames.get(&id)?.bytes.as_deref()
    }

    /// When the signal's last bit passed the receiver, earlier than planned if its sender stopped.
    pub(crate) fn end_of(&self, signal: &Signal) -> SimTime {
        let aborted_at = self.frames.get(&signal.frame).and_then(|c| c.aborted_at);
        aborted_at.map_or(signal.wave.end, |at| {
            (at + signal.flight).min(signal.wave.end)
        })
    }

    /// Whether the sender stopped so early that the signal ended before `t` at the receiver.
    pub(crate) fn cut_before(&self, signal: &Signal, t: SimTime) -> bool {
        self.end_of(signal) < t
    }
}
