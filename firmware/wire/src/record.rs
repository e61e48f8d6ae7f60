//! The records.
//!
//! The order of variants and fields is the wire format. A record is never
//! changed: what is new comes as a new variant at the end of [`Record`], and
//! readers pass over variants that they do not know.

use crate::{Answer, SettingValue, Text};
use serde::{Deserialize, Serialize};

/// Version of the envelope and of all records in it. A reader refuses others.
pub const PROTOCOL_VERSION: u8 = 2;

/// One message from node to host.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
pub enum Record {
    /// The node has started; its sequence numbers start again.
    Boot(Boot),
    /// One exchange gave a range.
    Range(Range),
    /// How the node is doing; sent about once a second.
    Status(Status),
    /// Listener: a frame was overheard.
    Overheard(Overheard),
    /// Listener: what an overheard final or report says.
    OverheardInterval(OverheardInterval),
    /// What the node is; the answer to [`Command::Status`](crate::Command::Status).
    About(Boot),
    /// What one setting is; the answer to [`Command::Get`](crate::Command::Get).
    Setting(SettingValue),
    /// How a command ended, after everything else that it asked for.
    Answer(Answer),
    /// How the program before this one ended, if it crashed; after [`Record::Boot`].
    Crash(Crash),
}

/// How a node's program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Crash {
    /// In what way.
    pub kind: CrashKind,
    /// A panic's line; a fault's program counter; otherwise 0.
    pub at: u32,
    /// A panic's file; why it gave up.
    pub text: Text,
}

/// In what way a node's program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
pub enum CrashKind {
    /// A panic.
    Panic,
    /// A hard fault, a stack overflow among them.
    HardFault,
    /// It gave up and said why.
    GaveUp,
}

/// A node's start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Boot {
    /// The node's short address.
    pub address: u16,
    /// The network's identifier.
    pub pan: u16,
    /// What the node is for.
    pub role: Role,
    /// Firmware version: major, minor, patch.
    pub firmware: [u8; 3],
    /// Why it started.
    pub reset_cause: ResetCause,
    /// Where its settings come from.
    pub settings: SettingsSource,
}

/// Where a node's settings come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
pub enum SettingsSource {
    /// Nothing is stored: all defaults.
    #[default]
    Defaults,
    /// From flash.
    Stored,
    /// Defaults, because what is stored cannot be read, or cannot work.
    Damaged,
    /// Defaults, because what is stored is of another version.
    OtherVersion,
    /// Defaults, because the flash does not work.
    FlashFailed,
}

/// What a node is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Its position is wanted; answers polls unless configured otherwise.
    #[default]
    Tag,
    /// Its position is known; polls unless configured otherwise.
    Anchor,
}

/// Why a node started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
pub enum ResetCause {
    /// Power came on.
    #[default]
    PowerOn,
    /// The reset pin.
    Pin,
    /// The watchdog: the node had stopped making progress.
    Watchdog,
    /// The firmware itself, after a panic or on command.
    Software,
    /// The processor locked up.
    Lockup,
    /// The supply dipped, too shortly for the RAM to be lost.
    BrownOut,
}

/// One measured range: what was measured, what the node's filter makes of it,
/// and how well the radio heard.
///
/// The raw range is sent whatever the filter thinks of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Range {
    /// The time that the range belongs to, when the exchange's response passed
    /// the node's antenna: in microseconds since the node's start.
    pub t_us: u64,
    /// Short address of the other node.
    pub peer: u16,
    /// Number of the exchange, counted by the initiator, wrapping.
    pub exchange: u8,
    /// The range as measured, less its bias, in metres; negative when noise makes it so.
    pub raw_m: f32,
    /// What strong and weak signals make ranges too long by, in metres, at the power of `quality`
    /// (application note APS011); it has been taken off `raw_m`.
    pub bias_m: f32,
    /// What the node's filter did with the raw range.
    pub treatment: Treatment,
    /// The filter's estimate after this range, if it has one.
    pub filtered: Option<Filtered>,
    /// How much faster the responder's clock runs than the initiator's, in
    /// ppm, from the time stamps.
    pub clock_offset_ppm: f32,
    /// How good the reception was, if the radio was asked.
    pub quality: Option<Quality>,
    /// Remarks.
    pub flags: RangeFlags,
}

/// What a node's filter did with a raw range; docs/range-filter.md.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(rename_all = "snake_case")]
pub enum Treatment {
    /// The node has no filter, or none for this peer.
    #[default]
    NotFiltered,
    /// The estimate starts with it: the first of this peer, or the first after
    /// a silence too long to bridge.
    Started,
    /// Weighed in full.
    Accepted,
    /// Weighed less: improbable, or probably not along the line of sight.
    DownWeighted,
    /// Left out: too far from what was expected.
    RejectedOutlier,
    /// Left out: too far from what was expected and hardly along the line of sight.
    RejectedNlos,
    /// Left out: not a range at all, such as NaN or 2 km.
    RejectedInvalid,
    /// The estimate starts anew with it: several in a row were left out, and agree
    /// with each other.
    Reacquired,
}

/// A node's estimate after a range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Filtered {
    /// Range in metres.
    pub range_m: f32,
    /// How fast it grows, in metres a second.
    pub rate_m_per_s: f32,
    /// Variance of the range, in square metres.
    pub variance_m2: f32,
}

/// How good the reception behind a range was, at the node that reports it: of
/// the response at the initiator, of the final at the responder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Quality {
    /// Receive power in dBm (user manual, section 4.7.2); NaN if nothing was received.
    pub rx_power_dbm: f32,
    /// Power of the first path in dBm (user manual, section 4.7.1); NaN if
    /// nothing was received.
    pub first_path_power_dbm: f32,
    /// Standard deviation of the noise in the channel impulse response, in its
    /// own units (STD_NOISE, user manual, section 7.2.20).
    pub noise: u16,
    /// Preamble symbols accumulated, those of the SFD taken off (RXPACC, user
    /// manual, section 7.2.18).
    pub preamble_count: u16,
    /// From the first path to the strongest one, in nanoseconds (PP_INDEX less
    /// FP_INDEX, user manual, sections 7.2.47.3 and 7.2.23).
    pub peak_delay_ns: f32,
    /// How much faster the responder's clock runs than the initiator's, in
    /// ppm, from the carrier (DRX_CAR_INT, user manual, section 7.2.40.11).
    pub carrier_offset_ppm: f32,
    /// How probable it is that the line of sight was blocked, in percent, if judged.
    pub nlos_percent: Option<u8>,
}

/// Remarks on a range, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(transparent)]
pub struct RangeFlags(pub u8);

impl RangeFlags {
    /// The line of sight was likely blocked.
    pub const NLOS: Self = Self(1);
    /// This node was the initiator of the exchange.
    pub const INITIATOR: Self = Self(2);

    /// Whether all of `other`'s bits are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Both sets of bits.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// How a node is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// When this record was made, in microseconds since the node's start.
    /// Relates the node's clock to the host's.
    pub t_us: u64,
    /// The node's short address.
    pub address: u16,
    /// Everything that happened, counted since the start.
    pub counters: Counters,
}

/// What happened since the node's start, counted by cause. Wraps at 2^32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Exchanges that gave a range.
    pub ranges: u32,
    /// Initiator: no response to a poll.
    pub no_response: u32,
    /// Initiator: slots open to unknown nodes in which nobody answered. Nobody is
    /// missing.
    pub unanswered_searches: u32,
    /// Responder: no final after a response.
    pub no_final: u32,
    /// Initiator: no report after a final.
    pub no_report: u32,
    /// Responder: polled again before the final came.
    pub superseded: u32,
    /// A delayed transmission was late.
    pub send_too_late: u32,
    /// The radio sent at another time than it was told.
    pub send_time_mismatch: u32,
    /// Time stamps that contradict each other.
    pub bad_stamps: u32,
    /// The radio did what the exchange's state does not allow.
    pub unexpected_events: u32,
    /// Exchanges that ran when the radio had to be started again.
    pub cut_off: u32,
    /// Receptions that came to nothing: a bad check sequence, header or
    /// Reed-Solomon code, no frame after a preamble, no time stamp.
    pub damaged_frames: u32,
    /// Frames that are not of this protocol or network.
    pub foreign_frames: u32,
    /// Frames of this network for other nodes or other exchanges.
    pub others_frames: u32,
    /// Times the radio was started again, or that was tried: it failed, did
    /// nothing, or had lost its settings.
    pub radio_resets: u32,
    /// SPI transfers that failed, or lost bits.
    pub bus_errors: u32,
    /// Records thrown away because the line to the host was too slow for them.
    pub records_dropped: u32,
    /// Responder: a final that says that this node's response was not heard.
    pub not_heard: u32,
    /// Ranges less than nothing, or further than any radio reaches.
    pub implausible: u32,
    /// Frames that were due, but not when they came: repeated by somebody. And polls
    /// that want an answer later than 240 ms behind them in any slot.
    pub out_of_time: u32,
    /// Responder: polls that want their answer sooner than this node can give it.
    pub polls_too_fast: u32,
    /// Initiator: slots of the superframe in which no round was possible.
    pub slots_left_out: u32,
    /// Coordinator: beacons not sent because the air was taken.
    pub beacons_left_out: u32,
    /// Times the radio was started again because it had received nothing, or given no range
    /// of a hundred tried, for five seconds.
    pub silences: u32,
    /// Frames from the host that held no command: damaged, or not known.
    pub bad_commands: u32,
    /// Commands that were refused: see the answer.
    pub refused_commands: u32,
    /// Times that stored settings could not be used, see [`SettingsSource`].
    pub settings_discarded: u32,
    /// Writes to flash that failed.
    pub flash_errors: u32,
    /// Initiator that sleeps: times that its radio was not awake in time, so that the round began
    /// more than 1 ms late.
    pub late_wakeups: u32,
}

/// A frame that a listener overheard.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Overheard {
    /// When, in microseconds since the node's start.
    pub t_us: u64,
    /// When its marker passed the antenna, on the radio's clock: 40 bits, ticks of
    /// 15.650 ps.
    pub at_ticks: u64,
    /// Network.
    pub pan: u16,
    /// Who sent it.
    pub source: u16,
    /// Whom it is for; 0xFFFF all.
    pub destination: u16,
    /// Which message, by its number in docs/air-protocol.md.
    pub message: u8,
    /// Number of the round.
    pub round: u8,
    /// Counts its sender's frames.
    pub sequence: u8,
    /// How well it was received.
    pub quality: Option<Quality>,
}

/// One side's intervals of a two-way ranging, as an overheard final or report says them.
/// Follows the [`Overheard`] of its frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OverheardInterval {
    /// Who measured them: the initiator in a final, the responder in a report.
    pub source: u16,
    /// The other node.
    pub peer: u16,
    /// Number of the round.
    pub round: u8,
    /// Its round time, Ra or Rb, in ticks of 15.650 ps.
    pub round_ticks: u64,
    /// Its reply time, Da or Db, in ticks of 15.650 ps.
    pub reply_ticks: u64,
}
