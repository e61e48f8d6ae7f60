//! What can stand in a frame.

use crate::{Command, Record};
use serde::{Serialize, de::DeserializeOwned};

/// A [`Record`] or a [`Command`].
pub trait Message: Serialize + DeserializeOwned + sealed::Sealed {
    /// The number of variants that this crate knows.
    const KNOWN: u32;

    /// Whether the sender's count of frames starts anew here, so that a jump
    /// in it is no loss.
    fn restarts_count(&self) -> bool;
}

impl Message for Record {
    const KNOWN: u32 = 9;

    /// A node that has just started counts from 0.
    fn restarts_count(&self) -> bool {
        matches!(self, Self::Boot(_))
    }
}

impl Message for Command {
    const KNOWN: u32 = 5;

    /// Each program on the host counts from a number of its own, and waits for
    /// the answer to each command: a loss is its to notice.
    fn restarts_count(&self) -> bool {
        true
    }
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for crate::Record {}
    impl Sealed for crate::Command {}
}
