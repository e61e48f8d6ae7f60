//! The DW1000's PHY settings as plain values, independent of register encodings.

/// UWB channel (User Manual 10.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Channel {
    /// 3494.4 MHz, 499.2 MHz wide.
    Ch1,
    /// 3993.6 MHz, 499.2 MHz wide.
    Ch2,
    /// 4492.8 MHz, 499.2 MHz wide.
    Ch3,
    /// 3993.6 MHz, 1331.2 MHz wide.
    Ch4,
    /// 6489.6 MHz, 499.2 MHz wide.
    Ch5,
    /// 6489.6 MHz, 1081.6 MHz wide.
    Ch7,
}

impl Channel {
    /// From the number in CHAN_CTRL; `None` for numbers the chip does not have.
    pub fn from_number(number: u8) -> Option<Self> {
        Some(match number {
            1 => Channel::Ch1,
            2 => Channel::Ch2,
            3 => Channel::Ch3,
            4 => Channel::Ch4,
            5 => Channel::Ch5,
            7 => Channel::Ch7,
            _ => return None,
        })
    }

    /// Centre frequency in Hz.
    pub fn centre_hz(self) -> f64 {
        match self {
            Channel::Ch1 => 3_494.4e6,
            Channel::Ch2 | Channel::Ch4 => 3_993.6e6,
            Channel::Ch3 => 4_492.8e6,
            Channel::Ch5 | Channel::Ch7 => 6_489.6e6,
        }
    }
}

/// Mean pulse repetition frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Prf {
    /// Nominally 16 MHz.
    Mhz16,
    /// Nominally 64 MHz.
    Mhz64,
}

impl Prf {
    /// From the two-bit field of TX_FCTRL, CHAN_CTRL and RX_FINFO.
    pub fn from_bits(bits: u8) -> Option<Self> {
        match bits & 0b11 {
            0b01 => Some(Prf::Mhz16),
            0b10 => Some(Prf::Mhz64),
            _ => None,
        }
    }

    /// The two-bit field.
    pub fn bits(self) -> u8 {
        match self {
            Prf::Mhz16 => 0b01,
            Prf::Mhz64 => 0b10,
        }
    }

    /// The constant A of the receive power formulas, in dB (User Manual 4.7.1 and 4.7.2).
    pub fn power_constant_db(self) -> f64 {
        match self {
            Prf::Mhz16 => 113.77,
            Prf::Mhz64 => 121.74,
        }
    }
}

/// Data rate of the payload.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DataRate {
    /// 110 kbit/s.
    Kbps110,
    /// 850 kbit/s.
    Kbps850,
    /// 6.8 Mbit/s.
    Kbps6800,
}

impl DataRate {
    /// From the two-bit field of TX_FCTRL.
    pub fn from_bits(bits: u8) -> Option<Self> {
        match bits & 0b11 {
            0b00 => Some(DataRate::Kbps110),
            0b01 => Some(DataRate::Kbps850),
            0b10 => Some(DataRate::Kbps6800),
            _ => None,
        }
    }

    /// The two-bit field.
    pub fn bits(self) -> u8 {
        match self {
            DataRate::Kbps110 => 0b00,
            DataRate::Kbps850 => 0b01,
            DataRate::Kbps6800 => 0b10,
        }
    }
}

/// Preamble length in symbols: the eight lengths TXPSR and PE select (User Manual 7.2.10, table 16).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct PreambleLength {
    psr: u8,
    extension: u8,
    symbols: u16,
}

impl PreambleLength {
    /// From the two-bit fields TXPSR and PE.
    pub fn from_bits(psr: u8, extension: u8) -> Option<Self> {
        let symbols = match (psr & 0b11, extension & 0b11) {
            (0b01, 0b00) => 64,
            (0b01, 0b01) => 128,
            (0b01, 0b10) => 256,
            (0b01, 0b11) => 512,
            (0b10, 0b00) => 1024,
            (0b10, 0b01) => 1536,
            (0b10, 0b10) => 2048,
            (0b11, 0b00) => 4096,
            _ => return None,
        };
        Some(PreambleLength {
            psr: psr & 0b11,
            extension: extension & 0b11,
            symbols,
        })
    }

    /// From the number of symbols, `None` for lengths the chip does not have.
    pub fn from_symbols(symbols: u16) -> Option<Self> {
        (0..16u8)
            .filter_map(|bits| Self::from_bits(bits >> 2, bits))
            .find(|length| length.symbols == symbols)
    }

    /// Number of symbols.
    pub fn symbols(self) -> u16 {
        self.symbols
    }

    /// The two-bit fields TXPSR and PE.
    pub fn bits(self) -> (u8, u8) {
        (self.psr, self.extension)
    }
}

/// Which start-of-frame delimiter is sent or looked for (CHAN_CTRL DWSFD, TNSSFD/RNSSFD; User Manual table 21).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sfd {
    /// IEEE 802.15.4: 64 symbols at 110 kbit/s, otherwise 8.
    Standard,
    /// Decawave's own sequence: 64 symbols at 110 kbit/s, otherwise 8 (or 16, by SFD_LENGTH).
    Decawave {
        /// Symbols at 850 kbit/s and above.
        symbols: u8,
    },
    /// Programmed in USR_SFD.
    User {
        /// Symbols at 850 kbit/s and above.
        symbols: u8,
    },
}

impl Sfd {
    /// Length in symbols at `rate`.
    pub fn symbols(self, rate: DataRate) -> u16 {
        match (rate, self) {
            (DataRate::Kbps110, _) => 64,
            (_, Sfd::Standard) => 8,
            (_, Sfd::Decawave { symbols } | Sfd::User { symbols }) => u16::from(symbols.max(1)),
        }
    }
}

/// Everything a transmitter decides about the shape of a frame, apart from its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct PhyConfig {
    /// Channel.
    pub channel: Channel,
    /// Pulse repetition frequency.
    pub prf: Prf,
    /// Preamble code, 1 to 24.
    pub preamble_code: u8,
    /// Preamble length.
    pub preamble: PreambleLength,
    /// Start-of-frame delimiter.
    pub sfd: Sfd,
    /// Data rate.
    pub rate: DataRate,
}
