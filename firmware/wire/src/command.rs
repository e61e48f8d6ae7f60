//! What a host asks of a node, and how the node answers.
//!
//! As with records, the order of variants and fields is the wire format.

use crate::settings::{Change, MAX_SETTINGS};
use serde::{Deserialize, Serialize};

/// Changes of settings that are made together or not at all.
pub type Changes = heapless::Vec<Change, MAX_SETTINGS>;

/// One message from host to node.
///
/// The node answers each with an [`Answer`], after the records that it asks for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
// There is no heap on the board to put the changes into, and never more than one command at a time.
#[allow(clippy::large_enum_variant)]
pub enum Command {
    /// Say all settings: a [`Setting`](crate::Record::Setting) record each.
    Get,
    /// Make these changes, keep them in flash, and work by them from now on.
    Set(Changes),
    /// Go back to the defaults in all settings.
    Reset,
    /// Say how the node is doing: an [`About`](crate::Record::About) and a
    /// [`Status`](crate::Record::Status) record.
    Status,
    /// Answer, then start anew.
    Reboot,
}

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Answer {
    /// The command's sequence number.
    pub command: u16,
    /// Whether it was carried out.
    pub outcome: Outcome,
}

/// Whether a command was carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It was.
    Done,
    /// Nothing was changed.
    Refused(Refusal),
}

/// Why a command was not carried out. Settings are named by their number, so
/// that a node can refuse what only its host knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// The node does not know the command.
    UnknownCommand,
    /// The node has no such setting.
    UnknownSetting {
        /// The number of the setting.
        setting: u8,
    },
    /// A number where addresses belong, or the other way round.
    WrongKind {
        /// The number of the setting.
        setting: u8,
    },
    /// The value, or an address in it, is outside what is allowed.
    OutOfRange {
        /// The number of the setting.
        setting: u8,
        /// The least that is allowed.
        least: u32,
        /// The most that is allowed.
        most: u32,
    },
    /// The value lies within the allowed range but is none of those that exist.
    NotOffered {
        /// The number of the setting.
        setting: u8,
    },
    /// The values of two settings cannot work together.
    Conflict {
        /// The number of the one.
        setting: u8,
        /// The number of the other.
        with: u8,
    },
    /// The flash did not take the settings; the node works by the old ones.
    NotStored,
}
