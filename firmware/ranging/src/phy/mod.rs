//! How frames are sent: the radio's mode of operation, and what it costs in time.
//!
//! A [`PhyProfile`] is what can be chosen; all nodes of a network use the same. Preamble code, start-of-frame
//! delimiter and acquisition chunk follow from it. [`PhyProfile::check`] refuses combinations that the radio has no
//! settings for.
//!
//! | file | what |
//! |---|---|
//! | `mod.rs` | profiles and which of them the radio can do |
//! | `air.rs` | how long a frame and its parts are on the air |
//! | `bias.rs` | how receive power bends ranges |
//! | `budget.rs` | how soon a frame can be answered |
//!
//! Sections and tables are those of the DW1000 user manual, version 2.18.

mod air;
mod bias;
mod budget;

pub use air::AirTime;
pub use budget::{Budget, Turn, Work};

use core::fmt;

/// The radio's mode of operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PhyProfile {
    /// Centre frequency and bandwidth.
    pub channel: Channel,
    /// Rate of the data.
    pub bitrate: Bitrate,
    /// Pulse repetition frequency.
    pub prf: Prf,
    /// Length of the preamble.
    pub preamble: Preamble,
}

/// UWB channels that the DW1000 has (section 10.5, table 61).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Channel {
    /// 3494.4 MHz, 499.2 MHz wide.
    Ch1,
    /// 3993.6 MHz, 499.2 MHz wide.
    Ch2,
    /// 4492.8 MHz, 499.2 MHz wide.
    Ch3,
    /// 3993.6 MHz, 1331.2 MHz wide, of which the radio uses 900 MHz.
    Ch4,
    /// 6489.6 MHz, 499.2 MHz wide. What the DWM1001's antenna is made for.
    Ch5,
    /// 6489.6 MHz, 1081.6 MHz wide, of which the radio uses 900 MHz.
    Ch7,
}

/// Rate of the data. The PHY header is never faster than 850 kbit/s.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Bitrate {
    /// 110 kbit/s.
    Kbps110,
    /// 850 kbit/s.
    Kbps850,
    /// 6.8 Mbit/s.
    Kbps6800,
}

/// Pulse repetition frequency, averaged over the preamble.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Prf {
    /// 16 MHz: less power.
    Mhz16,
    /// 64 MHz: a finer first path.
    Mhz64,
}

/// Number of symbols in the preamble, some 1 us each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u16)]
#[allow(missing_docs)] // The names say it.
pub enum Preamble {
    Symbols64 = 64,
    Symbols128 = 128,
    Symbols256 = 256,
    Symbols512 = 512,
    Symbols1024 = 1024,
    Symbols1536 = 1536,
    Symbols2048 = 2048,
    Symbols4096 = 4096,
}

/// Start-of-frame delimiter, which ends the preamble.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sfd {
    /// That of IEEE 802.15.4.
    Standard,
    /// Decawave's own, found more surely at the slower rates (7.2.32, table 21).
    Decawave,
}

/// Why the radio cannot do this.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PhyError {
    /// There is no such channel, or the DW1000 does not have it.
    Channel(u8),
    /// There is no such rate; in kbit/s.
    Bitrate(u32),
    /// There is no such pulse repetition frequency; in MHz.
    Prf(u8),
    /// There is no preamble of so many symbols.
    Preamble(u16),
    /// The preamble is too short for the rate: the receiver's settings (DRX_TUNE1b, table 32) begin at `least`, as a
    /// slower rate is chosen for a range at which a shorter preamble is not found.
    PreambleTooShort {
        /// The rate.
        bitrate: Bitrate,
        /// The preamble.
        preamble: Preamble,
        /// The shortest at this rate.
        least: Preamble,
    },
    /// The preamble is too long for the rate: the receiver's settings (DRX_TUNE1b, table 32) end at `most`, as a
    /// longer preamble is found where faster data is lost.
    PreambleTooLong {
        /// The rate.
        bitrate: Bitrate,
        /// The preamble.
        preamble: Preamble,
        /// The longest at this rate.
        most: Preamble,
    },
}

impl PhyProfile {
    /// The mode of the module's own firmware: channel 5, 6.8 Mbit/s, 64 MHz, 128 symbols.
    pub const DEFAULT: Self = Self {
        channel: Channel::Ch5,
        bitrate: Bitrate::Kbps6800,
        prf: Prf::Mhz64,
        preamble: Preamble::Symbols128,
    };

    /// Reaches some four times as far (12 dB, data sheet, table 9) and takes some 20 times as long. On channel 5, as
    /// the module's antenna has no other.
    pub const LONG_RANGE: Self = Self {
        channel: Channel::Ch5,
        bitrate: Bitrate::Kbps110,
        prf: Prf::Mhz64,
        preamble: Preamble::Symbols2048,
    };

    /// Whether the radio can work like this.
    ///
    /// # Errors
    /// [`PhyError`] says what does not go together.
    pub const fn check(&self) -> Result<(), PhyError> {
        let Self {
            bitrate, preamble, ..
        } = *self;
        let (least, most) = bitrate.preambles();
        if preamble.symbols() < least.symbols() {
            return Err(PhyError::PreambleTooShort {
                bitrate,
                preamble,
                least,
            });
        }
        if preamble.symbols() > most.symbols() {
            return Err(PhyError::PreambleTooLong {
                bitrate,
                preamble,
                most,
            });
        }
        Ok(())
    }

    /// Every profile that the radio can do.
    pub fn all() -> impl Iterator<Item = Self> {
        Channel::ALL.into_iter().flat_map(|channel| {
            Bitrate::ALL.into_iter().flat_map(move |bitrate| {
                Prf::ALL.into_iter().flat_map(move |prf| {
                    Preamble::ALL
                        .into_iter()
                        .map(move |preamble| Self {
                            channel,
                            bitrate,
                            prf,
                            preamble,
                        })
                        .filter(|profile| profile.check().is_ok())
                })
            })
        })
    }

    /// The preamble code of both directions: the first that the standard allows for channel and pulse repetition
    /// frequency (section 10.5, table 61).
    pub const fn preamble_code(&self) -> u8 {
        match (self.prf, self.channel) {
            (Prf::Mhz16, Channel::Ch1) => 1,
            (Prf::Mhz16, Channel::Ch2 | Channel::Ch5) => 3,
            (Prf::Mhz16, Channel::Ch3) => 5,
            (Prf::Mhz16, Channel::Ch4 | Channel::Ch7) => 7,
            (Prf::Mhz64, Channel::Ch4 | Channel::Ch7) => 17,
            (Prf::Mhz64, _) => 9,
        }
    }

    /// The start-of-frame delimiter: the one that performs best at the rate (7.2.32, table 21).
    pub const fn sfd(&self) -> Sfd {
        match self.bitrate {
            Bitrate::Kbps110 | Bitrate::Kbps850 => Sfd::Decawave,
            Bitrate::Kbps6800 => Sfd::Standard,
        }
    }

    /// Length of the start-of-frame delimiter in symbols (7.2.32, table 21).
    pub const fn sfd_symbols(&self) -> u16 {
        match self.bitrate {
            Bitrate::Kbps110 => 64,
            Bitrate::Kbps850 => 16,
            Bitrate::Kbps6800 => 8,
        }
    }

    /// Preamble acquisition chunk in symbols: by how many the receiver takes the preamble together to find it
    /// (4.1.1, table 6).
    pub const fn pac_symbols(&self) -> u16 {
        match self.preamble {
            Preamble::Symbols64 | Preamble::Symbols128 => 8,
            Preamble::Symbols256 | Preamble::Symbols512 => 16,
            Preamble::Symbols1024 => 32,
            Preamble::Symbols1536 | Preamble::Symbols2048 | Preamble::Symbols4096 => 64,
        }
    }
}

impl Default for PhyProfile {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Channel {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Ch1,
        Self::Ch2,
        Self::Ch3,
        Self::Ch4,
        Self::Ch5,
        Self::Ch7,
    ];

    /// The channel's number in the standard.
    pub const fn number(self) -> u8 {
        match self {
            Self::Ch1 => 1,
            Self::Ch2 => 2,
            Self::Ch3 => 3,
            Self::Ch4 => 4,
            Self::Ch5 => 5,
            Self::Ch7 => 7,
        }
    }

    /// Whether the channel is one of the wide ones, used with 900 MHz.
    pub const fn is_wide(self) -> bool {
        matches!(self, Self::Ch4 | Self::Ch7)
    }
}

impl Bitrate {
    /// All of them, from the slowest.
    pub const ALL: [Self; 3] = [Self::Kbps110, Self::Kbps850, Self::Kbps6800];

    /// Nominal rate in kbit/s.
    pub const fn kbps(self) -> u32 {
        match self {
            Self::Kbps110 => 110,
            Self::Kbps850 => 850,
            Self::Kbps6800 => 6_800,
        }
    }

    /// The shortest and the longest preamble that the receiver has settings for: table 32. That gives 110 kbit/s only
    /// "above 1024" symbols; 1024 itself is the vendor's own mode at this rate, with the same setting.
    const fn preambles(self) -> (Preamble, Preamble) {
        match self {
            Self::Kbps110 => (Preamble::Symbols1024, Preamble::Symbols4096),
            Self::Kbps850 => (Preamble::Symbols128, Preamble::Symbols1024),
            Self::Kbps6800 => (Preamble::Symbols64, Preamble::Symbols1024),
        }
    }
}

impl Prf {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Mhz16, Self::Mhz64];

    /// Nominal frequency in MHz.
    pub const fn mhz(self) -> u8 {
        match self {
            Self::Mhz16 => 16,
            Self::Mhz64 => 64,
        }
    }
}

impl Preamble {
    /// All of them, from the shortest.
    pub const ALL: [Self; 8] = [
        Self::Symbols64,
        Self::Symbols128,
        Self::Symbols256,
        Self::Symbols512,
        Self::Symbols1024,
        Self::Symbols1536,
        Self::Symbols2048,
        Self::Symbols4096,
    ];

    /// Number of symbols.
    pub const fn symbols(self) -> u16 {
        self as u16
    }
}

impl TryFrom<u8> for Channel {
    type Error = PhyError;

    /// The channel with this number.
    fn try_from(number: u8) -> Result<Self, PhyError> {
        let found = Self::ALL.into_iter().find(|c| c.number() == number);
        found.ok_or(PhyError::Channel(number))
    }
}

impl TryFrom<u32> for Bitrate {
    type Error = PhyError;

    /// The rate of so many kbit/s.
    fn try_from(kbps: u32) -> Result<Self, PhyError> {
        let found = Self::ALL.into_iter().find(|b| b.kbps() == kbps);
        found.ok_or(PhyError::Bitrate(kbps))
    }
}

impl TryFrom<u8> for Prf {
    type Error = PhyError;

    /// The frequency of so many MHz.
    fn try_from(mhz: u8) -> Result<Self, PhyError> {
        let found = Self::ALL.into_iter().find(|p| p.mhz() == mhz);
        found.ok_or(PhyError::Prf(mhz))
    }
}

impl TryFrom<u16> for Preamble {
    type Error = PhyError;

    /// The preamble of so many symbols.
    fn try_from(symbols: u16) -> Result<Self, PhyError> {
        let found = Self::ALL.into_iter().find(|p| p.symbols() == symbols);
        found.ok_or(PhyError::Preamble(symbols))
    }
}

impl fmt::Display for PhyProfile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "channel {}, {} kbit/s, PRF {} MHz, preamble {}",
            self.channel.number(),
            self.bitrate.kbps(),
            self.prf.mhz(),
            self.preamble.symbols()
        )
    }
}

impl fmt::Display for PhyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Channel(number) => write!(
                f,
                "the radio has no channel {number}: it has 1, 2, 3, 4, 5 and 7"
            ),
            Self::Bitrate(kbps) => write!(
                f,
                "the radio has no rate of {kbps} kbit/s: it has 110, 850 and 6800"
            ),
            Self::Prf(mhz) => write!(
                f,
                "the radio has no pulse repetition frequency of {mhz} MHz: it has 16 and 64"
            ),
            Self::Preamble(symbols) => write!(
                f,
                "the radio has no preamble of {symbols} symbols: it has 64, 128, 256, 512, 1024, 1536, 2048 and 4096"
            ),
            Self::PreambleTooShort {
                bitrate,
                preamble,
                least,
            } => write!(
                f,
                "a preamble of {} symbols is too short for {} kbit/s: from {}",
                preamble.symbols(),
                bitrate.kbps(),
                least.symbols()
            ),
            Self::PreambleTooLong {
                bitrate,
                preamble,
                most,
            } => write!(
                f,
                "a preamble of {} symbols is too long for {} kbit/s: up to {}",
                preamble.symbols(),
                bitrate.kbps(),
                most.symbols()
            ),
        }
    }
}

impl core::error::Error for PhyError {}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;
    use std::vec::Vec;

    #[test]
    fn both_named_profiles_are_legal() {
        assert_eq!(PhyProfile::DEFAULT.check(), Ok(()));
        assert_eq!(PhyProfile::LONG_RANGE.check(), Ok(()));
    }

    #[test]
    fn the_radio_has_156_legal_profiles() {
        // 6 channels, 2 frequencies; preambles: 4 at 110 kbit/s, 4 at 850, 5 at 6800.
        let all: Vec<_> = PhyProfile::all().collect();
        assert_eq!(all.len(), 6 * 2 * (4 + 4 + 5));
        let distinct: std::collections::HashSet<_> = all.iter().collect();
        assert_eq!(distinct.len(), all.len());
    }

    #[test]
    fn an_illegal_profile_is_refused_with_the_reason() {
        let short = PhyProfile {
            bitrate: Bitrate::Kbps110,
            ..PhyProfile::DEFAULT
        };
        let Err(error) = short.check() else {
            unreachable!("128 symbols at 110 kbit/s")
        };
        assert_eq!(
            error.to_string(),
            "a preamble of 128 symbols is too short for 110 kbit/s: from 1024"
        );
        let long = PhyProfile {
            preamble: Preamble::Symbols4096,
            ..PhyProfile::DEFAULT
        };
        let Err(error) = long.check() else {
            unreachable!("4096 symbols at 6.8 Mbit/s")
        };
        assert_eq!(
            error.to_string(),
            "a preamble of 4096 symbols is too long for 6800 kbit/s: up to 1024"
        );
    }

    #[test]
    fn numbers_name_what_the_radio_has_and_nothing_else() {
        let channels: Vec<u8> = (0..=u8::MAX)
            .filter(|&n| Channel::try_from(n).is_ok())
            .collect();
        assert_eq!(channels, [1, 2, 3, 4, 5, 7]);
        let preambles: Vec<u16> = (0..=u16::MAX)
            .filter(|&n| Preamble::try_from(n).is_ok())
            .collect();
        assert_eq!(preambles, [64, 128, 256, 512, 1024, 1536, 2048, 4096]);
        assert_eq!(Bitrate::try_from(6_810), Err(PhyError::Bitrate(6_810)));
        assert_eq!(Prf::try_from(64), Ok(Prf::Mhz64));
        assert_eq!(Prf::try_from(4), Err(PhyError::Prf(4)));
    }

    #[test]
    fn preamble_codes_are_among_those_of_the_standard() {
        for profile in PhyProfile::all() {
            let allowed: &[u8] = match (profile.prf.mhz(), profile.channel.number()) {
                (16, 1) => &[1, 2],
                (16, 2 | 5) => &[3, 4],
                (16, 3) => &[5, 6],
                (16, 4 | 7) => &[7, 8],
                (64, 4 | 7) => &[17, 18, 19, 20],
                _ => &[9, 10, 11, 12],
            };
            assert!(allowed.contains(&profile.preamble_code()), "{profile}");
        }
    }
}
