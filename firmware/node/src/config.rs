//! What a node is told before it starts.

use crate::peers::MAX_PEERS;
use nova_ranging::exchange::Identity;
use nova_ranging::superframe::Sharing;
use nova_ranging::{Address, PanId, PhyProfile, Ticks, Timing};
use nova_wire::{ResetCause, Role, SettingsSource};

/// A node's configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeConfig {
    /// Network and address.
    pub identity: Identity,
    /// What the node is for; said to the host, no more.
    pub role: Role,
    /// What the node does in rounds.
    pub part: Part,
    /// Antenna delays of this board.
    pub antenna_delay: AntennaDelay,
    /// From a frame received to the answer sent, in microseconds; the same on
    /// all nodes of a network.
    ///
    /// It has to hold, at the default mode: the rest of the frame received
    /// (up to 54 us), interrupt latency, about 100 us of SPI at 8 MHz, the
    /// processor's work, and the answer's preamble (140 us); from
    /// [`NodeConfig::REPLY_US`].
    pub reply_us: u32,
    /// Firmware version, for the host.
    pub firmware: [u8; 3],
    /// Why the board started, for the host.
    pub reset_cause: ResetCause,
    /// Where the settings come from, for the host.
    pub settings: SettingsSource,
}

/// What a node does in rounds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    /// Answers polls.
    Responder,
    /// Says nothing, and tells the host of every frame that it hears.
    Listener,
    /// Polls.
    Initiator {
        /// From the start of one round to the start of the next, in microseconds.
        period_us: u32,
        /// Most peers in one round, 1 to [`MAX_RESPONDERS`](nova_ranging::MAX_RESPONDERS).
        per_round: u8,
        /// Whom to poll, in turn; whoever is there if empty.
        peers: heapless::Vec<Address, MAX_PEERS>,
        /// How to share the air with other initiators.
        sharing: Sharing,
    },
}

/// Time between the radio's clock edge and the antenna, in ticks of 15.650 ps
/// (user manual, section 8.3).
///
/// An error of one tick in the sum of both, on one board, makes ranges wrong
/// by 2.3 mm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AntennaDelay {
    /// Sending.
    pub tx_ticks: u16,
    /// Receiving.
    pub rx_ticks: u16,
}

impl AntennaDelay {
    /// The vendor's figure for an uncalibrated board at 64 MHz, 257.5 ns: good
    /// to about 30 cm.
    pub const UNCALIBRATED: Self = Self {
        tx_ticks: 16_456,
        rx_ticks: 16_456,
    };
}

/// A setting that cannot work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ConfigError {
    /// The reply time, in microseconds, is outside [`NodeConfig::REPLY_US`].
    ReplyTime(u32),
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (least, most) = (NodeConfig::REPLY_US.start(), NodeConfig::REPLY_US.end());
        match self {
            Self::ReplyTime(us) => {
                write!(
                    f,
                    "a reply time of {us} us is not between {least} and {most} us"
                )
            }
        }
    }
}

impl core::error::Error for ConfigError {}

impl NodeConfig {
    /// Reply times that can work: below, the answer's preamble would have to
    /// begin before the frame to be answered is over; above, the radio's own
    /// time-out of 67 ms would not reach to the end of the answer.
    pub const REPLY_US: core::ops::RangeInclusive<u32> = 200..=30_000;

    /// The network that nodes are in unless told otherwise.
    pub const DEFAULT_PAN: PanId = PanId(0xDECA);

    /// A tag: answers whoever polls it.
    pub const fn tag(address: Address) -> Self {
        Self::new(address, Role::Tag, Part::Responder)
    }

    /// An anchor that says nothing, and tells the host of every frame that it hears.
    pub const fn listener(address: Address) -> Self {
        Self::new(address, Role::Anchor, Part::Listener)
    }

    /// An anchor: finds the tags around it and polls up to four of them in
    /// each of 100 rounds a second.
    pub const fn anchor(address: Address) -> Self {
        let part = Part::Initiator {
            period_us: 10_000,
            per_round: 4,
            peers: heapless::Vec::new(),
            sharing: Sharing::Elect,
        };
        Self::new(address, Role::Anchor, part)
    }

    const fn new(address: Address, role: Role, part: Part) -> Self {
        Self {
            identity: Identity {
                pan: Self::DEFAULT_PAN,
                address,
            },
            role,
            part,
            antenna_delay: AntennaDelay::UNCALIBRATED,
            reply_us: 600,
            firmware: [0, 1, 0],
            reset_cause: ResetCause::PowerOn,
            settings: SettingsSource::Defaults,
        }
    }

    /// Checks that the settings can work; [`Node::new`](crate::Node::new) does so too.
    ///
    /// # Errors
    /// The first that cannot.
    pub fn check(&self) -> Result<(), ConfigError> {
        if Self::REPLY_US.contains(&self.reply_us) {
            Ok(())
        } else {
            Err(ConfigError::ReplyTime(self.reply_us))
        }
    }

    pub(crate) fn timing(&self) -> Timing {
        // The node checks its settings before it asks for this.
        let reply_us = u16::try_from(self.reply_us).unwrap_or(u16::MAX);
        Timing {
            reply_us,
            // Taking one answer in and listening for the next costs less than answering.
            slot_us: reply_us,
            profile: PhyProfile::DEFAULT,
            tx_antenna_delay: Ticks::new(self.antenna_delay.tx_ticks.into()),
        }
    }
}
