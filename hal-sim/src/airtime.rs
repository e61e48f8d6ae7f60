//! How long the parts of a frame are on the air.
//!
//! A frame is preamble, start-of-frame delimiter (SFD), PHY header (PHR) and data; the ranging marker (RMARKER) is
//! the end of the SFD. All durations are whole numbers of chips of 1/499.2 MHz, hence of device ticks (128 to the
//! chip), so they are exact in the clock of the transmitter. Sources: IEEE 802.15.4-2011 tables 99 and 101, DW1000
//! User Manual 10.2 to 10.4.

use crate::phy::{DataRate, PhyConfig, Prf};
use crate::time::TICKS_PER_S;

/// Device ticks in a chip (499.2 MHz).
pub const TICKS_PER_CHIP: u64 = 128;

/// Bits of the PHY header with its SECDED bits.
const PHR_BITS: u64 = 21;
/// The Reed-Solomon code adds 48 bits to every 330 bits of data, or part of them.
const RS_BLOCK_BITS: u64 = 330;
const RS_PARITY_BITS: u64 = 48;

/// Durations of a frame's parts in device ticks of the sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Airtime {
    /// Preamble.
    pub preamble_ticks: u64,
    /// Start-of-frame delimiter.
    pub sfd_ticks: u64,
    /// PHY header.
    pub phr_ticks: u64,
    /// Data with the two bytes of FCS and the Reed-Solomon parity.
    pub data_ticks: u64,
}

impl Airtime {
    /// Durations of a frame of `frame_len` bytes, the FCS included.
    pub fn of(phy: &PhyConfig, frame_len: usize) -> Self {
        let symbol = preamble_symbol_ticks(phy.prf);
        let data_bits = 8 * frame_len as u64;
        let parity_bits = data_bits.div_ceil(RS_BLOCK_BITS) * RS_PARITY_BITS;
        Airtime {
            preamble_ticks: u64::from(phy.preamble.symbols()) * symbol,
            sfd_ticks: u64::from(phy.sfd.symbols(phy.rate)) * symbol,
            phr_ticks: PHR_BITS * phr_bit_ticks(phy.rate),
            data_ticks: (data_bits + parity_bits) * data_bit_ticks(phy.rate),
        }
    }

    /// Synchronisation header: preamble and SFD, which end at the RMARKER.
    pub fn shr_ticks(&self) -> u64 {
        self.preamble_ticks + self.sfd_ticks
    }

    /// The whole frame.
    pub fn total_ticks(&self) -> u64 {
        self.shr_ticks() + self.phr_ticks + self.data_ticks
    }

    /// The whole frame in seconds of the sender's clock.
    pub fn total_s(&self) -> f64 {
        self.total_ticks() as f64 / TICKS_PER_S as f64
    }
}

/// A preamble symbol: 31 x 16 chips (993.59 ns) at 16 MHz, 127 x 4 chips (1017.63 ns) at 64 MHz.
pub fn preamble_symbol_ticks(prf: Prf) -> u64 {
    let chips = match prf {
        Prf::Mhz16 => 496,
        Prf::Mhz64 => 508,
    };
    chips * TICKS_PER_CHIP
}

/// A bit of data on the air, parity bits included: 8205.13, 1025.64 or 128.21 ns.
pub fn data_bit_ticks(rate: DataRate) -> u64 {
    let chips = match rate {
        DataRate::Kbps110 => 4096,
        DataRate::Kbps850 => 512,
        DataRate::Kbps6800 => 64,
    };
    chips * TICKS_PER_CHIP
}

/// A bit of the PHR, which is never faster than 850 kbit/s.
pub fn phr_bit_ticks(rate: DataRate) -> u64 {
    match rate {
        DataRate::Kbps110 => data_bit_ticks(DataRate::Kbps110),
        DataRate::Kbps850 | DataRate::Kbps6800 => data_bit_ticks(DataRate::Kbps850),
    }
}
