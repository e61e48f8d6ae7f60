//! Scripted damage to chosen frames.

use std::ops::Range;

use crate::world::ChipId;

/// What happens to a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultAction {
    /// The receiver hears nothing at all.
    Drop,
    /// One bit of the data arrives flipped, so that the FCS is wrong.
    Corrupt,
}

/// Damage to some frames of one sender.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// The sender.
    pub from: ChipId,
    /// The receiver it applies to; `None` for all of them.
    pub to: Option<ChipId>,
    /// Which of the sender's frames, counted from 0 since the start of the simulation.
    pub frames: Range<u64>,
    /// What happens to them.
    pub action: FaultAction,
}

impl Fault {
    /// Nobody hears the sender's frame number `n`.
    pub fn drop_nth(from: ChipId, n: u64) -> Self {
        Fault {
            from,
            to: None,
            frames: n..n.saturating_add(1),
            action: FaultAction::Drop,
        }
    }

    /// The sender's frame number `n` arrives with a wrong FCS everywhere.
    pub fn corrupt_nth(from: ChipId, n: u64) -> Self {
        Fault {
            action: FaultAction::Corrupt,
            ..Fault::drop_nth(from, n)
        }
    }

    /// Limits the fault to one receiver.
    pub fn at(self, to: ChipId) -> Self {
        Fault {
            to: Some(to),
            ..self
        }
    }

    pub(crate) fn hits(&self, from: ChipId, to: ChipId, frame: u64) -> bool {
        self.from == from && self.to.is_none_or(|t| t == to) && self.frames.contains(&frame)
    }
}
