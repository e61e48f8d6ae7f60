//! The list of settings: the one place that says what there is to set.
//!
//! What a node takes and says, what `nova config` reads, writes and explains,
//! and the table in docs/wire-format.md all come from [`SETTINGS`].

use super::value::{Addresses, MAX_ADDRESSES, Value};

/// What can be set. The numbers are the wire format, and what flash holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Setting {
    /// The node's short address.
    Address = 0,
    /// The network's identifier.
    Pan = 1,
    /// What the node does in exchanges.
    Part = 2,
    /// Whom an initiator polls.
    Peers = 3,
    /// From the start of one round to the start of the next.
    PeriodUs = 4,
    /// Antenna delay, sending.
    TxAntennaDelay = 5,
    /// Antenna delay, receiving.
    RxAntennaDelay = 6,
    /// From a frame received to the answer sent.
    ReplyUs = 7,
    /// Most peers in one round.
    PerRound = 8,
    /// How an initiator shares the air with others.
    Sharing = 9,
    /// The radio's channel.
    PhyChannel = 10,
    /// The radio's rate.
    PhyBitrate = 11,
    /// The radio's pulse repetition frequency.
    PhyPrf = 12,
    /// The length of the radio's preambles.
    PhyPreamble = 13,
    /// What a raw range is off by, along the line of sight.
    FilterSigma = 14,
    /// The same where the line of sight is likely blocked.
    FilterNlosSigma = 15,
    /// How restless ranges are.
    FilterAgility = 16,
    /// How fast peers move at most.
    FilterMaxSpeed = 17,
    /// Whether an initiator's radio sleeps between rounds.
    Sleep = 18,
}

/// How many settings there are.
pub const COUNT: usize = SETTINGS.len();

/// What is to be known about a setting.
#[derive(Clone, Copy, Debug)]
pub struct Description {
    /// Which one it is.
    pub setting: Setting,
    /// Its name to people and in files; dots part groups.
    pub name: &'static str,
    /// What it can be.
    pub kind: Kind,
    /// What it is when nobody has set it.
    pub default: Fallback,
    /// What it is for, in a few words.
    pub meaning: &'static str,
}

/// What a setting can be.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A number.
    Number {
        /// The least that is allowed.
        least: u32,
        /// The most that is allowed.
        most: u32,
        /// What it counts; empty for a mere number.
        unit: &'static str,
    },
    /// A number that people write in hexadecimal: an address or a network.
    Identifier {
        /// The least that is allowed.
        least: u16,
        /// The most that is allowed.
        most: u16,
    },
    /// One of some numbers.
    OneOf {
        /// Which, in rising order.
        numbers: &'static [u32],
        /// What they count; empty for mere numbers.
        unit: &'static str,
    },
    /// One of some words; its value is its place among them.
    Word(&'static [&'static str]),
    /// Up to so many addresses of nodes.
    Addresses {
        /// The most that are allowed.
        most: usize,
    },
}

/// What a setting is when nobody has set it.
#[derive(Clone, Copy, Debug)]
pub enum Fallback {
    /// Always this.
    Value(Value),
    /// Known to the board only; how it comes about.
    Board(&'static str),
}

/// Addresses that nodes can have: IEEE 802.15.4 keeps 0xFFFE and 0xFFFF for
/// itself, and 0 means none.
pub const NODE_ADDRESSES: core::ops::RangeInclusive<u16> = 1..=0xFFFD;

/// All settings, in the order of their numbers.
pub const SETTINGS: [Description; 19] = [
    Description {
        setting: Setting::Address,
        name: "address",
        kind: Kind::Identifier {
            least: *NODE_ADDRESSES.start(),
            most: *NODE_ADDRESSES.end(),
        },
        default: Fallback::Board("from the chip's number"),
        meaning: "the node's short address",
    },
    Description {
        setting: Setting::Pan,
        name: "pan",
        kind: Kind::Identifier {
            least: 0,
            most: 0xFFFE,
        },
        default: Fallback::Value(Value::Number(0xDECA)),
        meaning: "the network; nodes of others are not heard",
    },
    Description {
        setting: Setting::Part,
        name: "part",
        kind: Kind::Word(&["responder", "initiator", "listener"]),
        default: Fallback::Board("a tag: responder, an anchor: initiator"),
        meaning: "what the node does in rounds",
    },
    Description {
        setting: Setting::Peers,
        name: "peers",
        kind: Kind::Addresses {
            most: MAX_ADDRESSES,
        },
        default: Fallback::Value(Value::Addresses(Addresses::NONE)),
        meaning: "whom an initiator polls; whoever is there if empty",
    },
    Description {
        setting: Setting::PeriodUs,
        name: "period_us",
        kind: Kind::Number {
            least: 1_000,
            most: 60_000_000,
            unit: "us",
        },
        default: Fallback::Value(Value::Number(10_000)),
        meaning: "an initiator's time from one round to the next",
    },
    Description {
        setting: Setting::TxAntennaDelay,
        name: "antenna_delay.tx_ticks",
        kind: ANTENNA_DELAY,
        default: Fallback::Board("the factory's; 16456 if it left none"),
        meaning: "from the radio's clock edge to the antenna",
    },
    Description {
        setting: Setting::RxAntennaDelay,
        name: "antenna_delay.rx_ticks",
        kind: ANTENNA_DELAY,
        default: Fallback::Board("the factory's; 16456 if it left none"),
        meaning: "from the antenna to the radio's clock edge",
    },
    Description {
        setting: Setting::ReplyUs,
        name: "reply_us",
        kind: Kind::Number {
            least: 129,
            most: 30_000,
            unit: "us",
        },
        default: Fallback::Board("computed from mode, bus and processor"),
        meaning: "from a frame to its answer",
    },
    Description {
        setting: Setting::PerRound,
        name: "per_round",
        kind: Kind::Number {
            least: 1,
            most: 8,
            unit: "",
        },
        default: Fallback::Value(Value::Number(4)),
        meaning: "the most peers that an initiator polls at once",
    },
    Description {
        setting: Setting::Sharing,
        name: "sharing",
        kind: Kind::Word(&["free", "polite", "elect", "coordinate"]),
        default: Fallback::Value(Value::Number(2)),
        meaning: "how an initiator shares the air with others",
    },
    Description {
        setting: Setting::PhyChannel,
        name: "phy.channel",
        kind: Kind::OneOf {
            numbers: &[1, 2, 3, 4, 5, 7],
            unit: "",
        },
        default: Fallback::Value(Value::Number(5)),
        meaning: "the radio's channel; all of phy is the same on all nodes of a network",
    },
    Description {
        setting: Setting::PhyBitrate,
        name: "phy.bitrate_kbps",
        kind: Kind::OneOf {
            numbers: &[110, 850, 6_800],
            unit: "kbit/s",
        },
        default: Fallback::Value(Value::Number(6_800)),
        meaning: "the radio's rate; the slower the farther",
    },
    Description {
        setting: Setting::PhyPrf,
        name: "phy.prf_mhz",
        kind: Kind::OneOf {
            numbers: &[16, 64],
            unit: "MHz",
        },
        default: Fallback::Value(Value::Number(64)),
        meaning: "the radio's pulse repetition frequency",
    },
    Description {
        setting: Setting::PhyPreamble,
        name: "phy.preamble_symbols",
        kind: Kind::OneOf {
            numbers: &[64, 128, 256, 512, 1_024, 1_536, 2_048, 4_096],
            unit: "symbols",
        },
        default: Fallback::Value(Value::Number(128)),
        meaning: "the radio's preamble; 110 kbit/s takes 1024 or more, 850 128 to 1024, 6800 up to 1024",
    },
    Description {
        setting: Setting::FilterSigma,
        name: "filter.sigma_mm",
        kind: Kind::Number {
            least: 1,
            most: 10_000,
            unit: "mm",
        },
        default: Fallback::Value(Value::Number(50)),
        meaning: "standard deviation of a raw range along the line of sight",
    },
    Description {
        setting: Setting::FilterNlosSigma,
        name: "filter.nlos_sigma_mm",
        kind: Kind::Number {
            least: 1,
            most: 100_000,
            unit: "mm",
        },
        default: Fallback::Value(Value::Number(300)),
        meaning: "the same where it is likely blocked; not below that",
    },
    Description {
        setting: Setting::FilterAgility,
        name: "filter.agility_cm2_per_s3",
        kind: Kind::Number {
            least: 1,
            most: 100_000_000,
            unit: "cm^2/s^3",
        },
        default: Fallback::Value(Value::Number(10_000)),
        meaning: "how restless ranges are: spectral density of their acceleration",
    },
    Description {
        setting: Setting::FilterMaxSpeed,
        name: "filter.max_speed_mm_per_s",
        kind: Kind::Number {
            least: 100,
            most: 1_000_000,
            unit: "mm/s",
        },
        default: Fallback::Value(Value::Number(15_000)),
        meaning: "no peer moves faster",
    },
    Description {
        setting: Setting::Sleep,
        name: "sleep",
        kind: Kind::Word(&["off", "on"]),
        default: Fallback::Value(Value::Number(0)),
        meaning: "whether an initiator's radio sleeps between rounds; only with sharing free",
    },
];

/// The radio's whole range: 0 to 1 us.
const ANTENNA_DELAY: Kind = Kind::Number {
    least: 0,
    most: 0xFFFF,
    unit: "ticks of 15.65 ps",
};

impl Setting {
    /// The setting of this number.
    pub fn from_number(number: u8) -> Option<Self> {
        SETTINGS
            .get(usize::from(number))
            .map(|description| description.setting)
    }

    /// The setting of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        SETTINGS
            .iter()
            .find(|description| description.name == name)
            .map(|description| description.setting)
    }

    /// Its number on the wire.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// All that is to be known about it.
    pub fn description(self) -> &'static Description {
        // Each setting has its place; a test sees to it.
        SETTINGS.get(self as usize).unwrap_or(&SETTINGS[0])
    }
}
