//! What a node is told before it starts.

use crate::cost::DWM1001;
use crate::peers::MAX_PEERS;
use nova_ranging::exchange::Identity;
use nova_ranging::filter::SettingsError;
use nova_ranging::frame::len;
use nova_ranging::phy::{Budget, PhyError};
use nova_ranging::superframe::Sharing;
use nova_ranging::timetable::MAX_RESPONSE_US;
use nova_ranging::{Address, FilterSettings, MAX_RESPONDERS, PanId, PhyProfile, Ticks, Timing};
use nova_wire::{ResetCause, Role, SettingsSource};

/// A node's configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeConfig {
    /// Network and address.
    pub identity: Identity,
    /// What the node is for; said to the host, no more.
    pub role: Role,
    /// What the node does in rounds.
    pub part: Part,
    /// Antenna delays of this board, as far as they were set.
    pub antenna_delay: SetAntennaDelay,
    /// Mode of the radio; the same on all nodes of a network.
    pub phy: PhyProfile,
    /// From a frame received to the answer sent, from marker to marker, in
    /// microseconds. Computed if `None`: the shortest that mode, bus and processor
    /// allow (docs/air-time.md).
    pub reply_us: Option<u32>,
    /// How ranges are filtered.
    pub filter: FilterSettings,
    /// What answering costs on this board.
    pub budget: Budget,
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
        /// Most peers in one round, 1 to [`MAX_RESPONDERS`].
        per_round: u8,
        /// Whom to poll, in turn; whoever is there if empty.
        peers: heapless::Vec<Address, MAX_PEERS>,
        /// How to share the air with other initiators.
        sharing: Sharing,
        /// Whether the radio sleeps between rounds. Only with [`Sharing::Free`]: who sleeps hears nobody.
        sleep: bool,
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

/// Antenna delays as far as they were set. For one that was not the radio is told what the factory wrote
/// into it, or [`AntennaDelay::UNCALIBRATED`] where that is nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SetAntennaDelay {
    /// Sending, in ticks.
    pub tx_ticks: Option<u16>,
    /// Receiving, in ticks.
    pub rx_ticks: Option<u16>,
}

impl SetAntennaDelay {
    /// Both, taken from `other` where they were not set.
    pub fn or(self, other: AntennaDelay) -> AntennaDelay {
        AntennaDelay {
            tx_ticks: self.tx_ticks.unwrap_or(other.tx_ticks),
            rx_ticks: self.rx_ticks.unwrap_or(other.rx_ticks),
        }
    }
}

impl From<AntennaDelay> for SetAntennaDelay {
    fn from(AntennaDelay { tx_ticks, rx_ticks }: AntennaDelay) -> Self {
        Self {
            tx_ticks: Some(tx_ticks),
            rx_ticks: Some(rx_ticks),
        }
    }
}

/// A setting that cannot work.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ConfigError {
    /// The mode of the radio does not exist.
    Phy(PhyError),
    /// The range filter cannot work like this.
    Filter(SettingsError),
    /// The radio is to sleep between rounds and to listen there.
    SleepListens,
    /// A reply time that cannot work: the answer's preamble would have to begin
    /// before the frame to be answered is over, or the radio's own time-out of 67 ms
    /// would not reach to the end of the answer. All in microseconds.
    ReplyTime {
        /// What was asked for.
        us: u32,
        /// What would work at least.
        least: u32,
        /// And at most.
        most: u32,
    },
    /// The node's own address is among its peers.
    OwnPeer(Address),
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Phy(error) => error.fmt(f),
            Self::Filter(error) => error.fmt(f),
            Self::SleepListens => {
                f.write_str("only who shares the air freely, and need not listen, can sleep")
            }
            Self::ReplyTime { us, least, most } => write!(
                f,
                "a reply time of {us} us is not between {least} and {most} us"
            ),
            Self::OwnPeer(address) => {
                write!(
                    f,
                    "the node's own address {:#06x} is among its peers",
                    address.0
                )
            }
        }
    }
}

impl core::error::Error for ConfigError {}

impl NodeConfig {
    /// The longest reply time: the poll carries it in 16 bits, and the radio's own
    /// time-out of 67 ms has to reach to the end of the answer.
    pub const MAX_REPLY_US: u32 = 30_000;

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
            sleep: false,
        };
        Self::new(address, Role::Anchor, part)
    }

    /// A tag that lives on little: it polls the responders around it ten times a second, up to four in a round, and its
    /// radio sleeps in between.
    pub const fn sleeper(address: Address) -> Self {
        let part = Part::Initiator {
            period_us: 100_000,
            per_round: 4,
            peers: heapless::Vec::new(),
            sharing: Sharing::Free,
            sleep: true,
        };
        Self::new(address, Role::Tag, part)
    }

    const fn new(address: Address, role: Role, part: Part) -> Self {
        Self {
            identity: Identity {
                pan: Self::DEFAULT_PAN,
                address,
            },
            role,
            part,
            antenna_delay: SetAntennaDelay {
                tx_ticks: None,
                rx_ticks: None,
            },
            phy: PhyProfile::DEFAULT,
            reply_us: None,
            filter: FilterSettings::DEFAULT,
            budget: DWM1001,
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
        self.phy.check().map_err(ConfigError::Phy)?;
        self.filter.check().map_err(ConfigError::Filter)?;
        let own = self.identity.address;
        if let Part::Initiator { peers, .. } = &self.part
            && peers.contains(&own)
        {
            return Err(ConfigError::OwnPeer(own));
        }
        if let Part::Initiator {
            sleep: true,
            sharing,
            ..
        } = self.part
            && sharing != Sharing::Free
        {
            return Err(ConfigError::SleepListens);
        }
        let us = self.reply_us();
        let least = self.frames_us();
        let most = Self::MAX_REPLY_US;
        if (least..=most).contains(&us) {
            Ok(())
        } else {
            Err(ConfigError::ReplyTime { us, least, most })
        }
    }

    /// From a frame received to the answer sent, in microseconds.
    pub fn reply_us(&self) -> u32 {
        self.reply_us.unwrap_or_else(|| self.shortest_reply_us())
    }

    /// The shortest reply time that mode, bus and processor allow, in microseconds.
    pub fn shortest_reply_us(&self) -> u32 {
        let n = self.responders();
        [
            (len::poll(n), len::RESPONSE),
            (len::RESPONSE, len::last(n)),
            (len::last(n), len::REPORT),
        ]
        .into_iter()
        .map(|(received, sent)| self.budget.reply(&self.phy, received, sent).total())
        .map(|turn| turn.to_us() + 1)
        .max()
        .unwrap_or(0)
    }

    /// From one answer to the next in a round of several, in microseconds.
    pub fn slot_us(&self) -> u32 {
        let slot = |bytes| self.budget.slot(&self.phy, bytes).total().to_us() + 1;
        let shortest = slot(len::RESPONSE).max(slot(len::REPORT));
        // Who is given more time than that for an answer has a slower board.
        shortest + self.reply_us().saturating_sub(self.shortest_reply_us())
    }

    /// Most responders in one round.
    fn responders(&self) -> usize {
        match &self.part {
            Part::Responder | Part::Listener => 1,
            // While it searches there is a slot more than peers that it knows.
            Part::Initiator {
                per_round, peers, ..
            } => match peers.len() {
                0 => (usize::from(*per_round) + 1).clamp(2, MAX_RESPONDERS),
                known => known.min(usize::from(*per_round)).clamp(1, MAX_RESPONDERS),
            },
        }
    }

    /// What of a reply time the frames themselves take, in microseconds.
    fn frames_us(&self) -> u32 {
        let rest = self.phy.marker_to_end(len::last(self.responders()));
        rest.to_us() + self.phy.preamble_to_marker().to_us() + 2
    }

    /// What the state machines are told of all this. `antenna_delay`: what the radio was
    /// told.
    pub fn timing(&self, antenna_delay: AntennaDelay) -> Timing {
        // The node checks its settings before it asks for this.
        let fit = |us: u32| u16::try_from(us).unwrap_or(u16::MAX);
        Timing {
            reply_us: fit(self.reply_us()),
            slot_us: fit(self.slot_us()),
            profile: self.phy,
            tx_antenna_delay: Ticks::new(antenna_delay.tx_ticks.into()),
        }
    }
}

const _: () = assert!(
    NodeConfig::MAX_REPLY_US as usize * MAX_RESPONDERS <= MAX_RESPONSE_US as usize,
    "the slowest initiator is answered"
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mode_of_the_radio_has_a_reply_time_that_works() {
        for phy in PhyProfile::all() {
            for config in [NodeConfig::tag(Address(1)), NodeConfig::anchor(Address(2))] {
                let config = NodeConfig { phy, ..config };
                assert_eq!(config.check(), Ok(()), "{phy}");
                assert!(config.slot_us() <= config.reply_us(), "{phy}");
            }
        }
    }

    #[test]
    fn a_reply_time_that_cannot_work_is_refused_with_what_would() {
        let config = NodeConfig {
            reply_us: Some(100),
            ..NodeConfig::tag(Address(1))
        };
        let Err(ConfigError::ReplyTime { us, least, most }) = config.check() else {
            unreachable!("100 us are less than a preamble")
        };
        assert_eq!((us, most), (100, 30_000));
        assert!((170..220).contains(&least), "{least}");
    }

    #[test]
    fn a_node_that_would_poll_itself_is_refused() {
        let mut config = NodeConfig::anchor(Address(2));
        for (peer, result) in [
            (Address(3), Ok(())),
            (Address(2), Err(ConfigError::OwnPeer(Address(2)))),
        ] {
            if let Part::Initiator { peers, .. } = &mut config.part {
                peers.push(peer).unwrap();
            }
            assert_eq!(config.check(), result);
        }
    }

    #[test]
    fn more_responders_take_longer_finals() {
        let tag = NodeConfig::tag(Address(1));
        let anchor = NodeConfig::anchor(Address(2));
        assert!(anchor.reply_us() > tag.reply_us());
    }
}
