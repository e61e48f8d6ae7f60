//! Power and delay between two antennas.

use std::f64::consts::PI;

use crate::phy::{Channel, DataRate};
use crate::time::SimDuration;

/// Properties of the medium that all boards share.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelConfig {
    /// Speed of the signal in m/s; the default is that in air.
    pub speed_m_per_s: f64,
    /// Power lost per decade of distance is ten times this; 2 is free space.
    pub path_loss_exponent: f64,
    /// Gain added to every link (both antennas together), in dB.
    pub antenna_gain_db: f64,
    /// Probability that a receiver does not notice a frame at all, independent of everything else.
    pub loss_probability: f64,
    /// Probability that a frame reaches a receiver with a wrong bit, so that its FCS is wrong.
    pub corrupt_probability: f64,
    /// Probability that a frame reaches a receiver a second time: somebody repeats it as it was.
    pub repeat_probability: f64,
    /// Shortest and longest delay of such a repetition. Shorter than a frame it would destroy its original.
    pub repeat_delay: [SimDuration; 2],
    /// How much stronger a frame must be than another on the same channel to survive the overlap, in dB.
    pub capture_threshold_db: f64,
    /// How much a frame with another preamble code or PRF is weakened as an interferer, in dB. Codes are nearly
    /// orthogonal in the preamble, hardly in the data; this is one middling number for both.
    pub code_isolation_db: f64,
    /// Weakest receivable frame, by data rate.
    pub sensitivity: Sensitivity,
}

impl Default for ChannelConfig {
    fn default() -> Self {
        ChannelConfig {
            speed_m_per_s: 299_702_547.0,
            path_loss_exponent: 2.0,
            antenna_gain_db: 0.0,
            loss_probability: 0.0,
            corrupt_probability: 0.0,
            repeat_probability: 0.0,
            repeat_delay: [SimDuration::from_ms(1), SimDuration::from_ms(10)],
            capture_threshold_db: 6.0,
            code_isolation_db: 10.0,
            sensitivity: Sensitivity::default(),
        }
    }
}

/// Weakest receivable frame in dBm at the antenna. Defaults: DW1000 data sheet, receiver sensitivity at 10 % packet
/// errors, 20-byte frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensitivity {
    /// At 110 kbit/s.
    pub kbps110_dbm: f64,
    /// At 850 kbit/s.
    pub kbps850_dbm: f64,
    /// At 6.8 Mbit/s.
    pub kbps6800_dbm: f64,
}

impl Default for Sensitivity {
    fn default() -> Self {
        Sensitivity {
            kbps110_dbm: -106.0,
            kbps850_dbm: -102.0,
            kbps6800_dbm: -94.0,
        }
    }
}

impl Sensitivity {
    /// The threshold for `rate` in dBm.
    pub fn dbm(&self, rate: DataRate) -> f64 {
        match rate {
            DataRate::Kbps110 => self.kbps110_dbm,
            DataRate::Kbps850 => self.kbps850_dbm,
            DataRate::Kbps6800 => self.kbps6800_dbm,
        }
    }
}

/// What stands between two particular boards.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LinkEffect {
    /// The first path that the receiver sees is late by this much (an obstructed direct path), in picoseconds.
    pub extra_delay_ps: f64,
    /// Loss of the whole signal, in dB.
    pub loss_db: f64,
    /// Further loss of the first path alone, in dB.
    pub first_path_loss_db: f64,
}

impl ChannelConfig {
    /// Path loss over `distance_m` in dB: free space up to one metre (Friis), then by the exponent.
    /// Below 5 cm the far-field formula means nothing and the loss is held.
    pub fn path_loss_db(&self, channel: Channel, distance_m: f64) -> f64 {
        let wavelength_m = self.speed_m_per_s / channel.centre_hz();
        let at_1m_db = 20.0 * (4.0 * PI / wavelength_m).log10();
        at_1m_db + 10.0 * self.path_loss_exponent * distance_m.max(0.05).log10()
    }
}
