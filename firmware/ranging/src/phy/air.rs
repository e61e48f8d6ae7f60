//! How long the parts of a frame are on the air.
//!
//! ```text
//!  |<-------- preamble --------->|<- SFD ->|<- PHR ->|<---- data ---->|
//!                                          ▲
//!                             ranging marker: what is time-stamped
//! ```
//!
//! All parts are whole numbers of chips of 1/499.2 MHz, and a chip is 128 ticks, so everything here is exact in the
//! sender's clock. IEEE 802.15.4-2011 tables 99 and 101; user manual, sections 10.2 to 10.4.

use super::{Bitrate, PhyProfile, Prf};
use crate::time::Ticks;

/// Ticks in a chip.
const CHIP: u64 = 128;
/// Bits of the PHY header, its error correction among them.
const PHR_BITS: u32 = 21;
/// The Reed-Solomon code adds [`PARITY_BITS`] to every so many bits of data, or part of them.
const BLOCK_BITS: u32 = 330;
/// See [`BLOCK_BITS`].
const PARITY_BITS: u32 = 48;
/// The frame check sequence that the radio appends, in bytes.
const FCS_BYTES: u32 = 2;

/// The parts of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AirTime {
    /// Preamble.
    pub preamble: Ticks,
    /// Start-of-frame delimiter.
    pub sfd: Ticks,
    /// PHY header.
    pub header: Ticks,
    /// Data with frame check sequence and parity.
    pub data: Ticks,
}

impl AirTime {
    /// From the first preamble symbol to the last bit.
    pub const fn total(&self) -> Ticks {
        Ticks::new(self.preamble.get() + self.sfd.get() + self.header.get() + self.data.get())
    }
}

impl PhyProfile {
    /// The parts of a frame of `bytes` bytes, not counting the frame check sequence, which is added here.
    pub const fn air_time(&self, bytes: usize) -> AirTime {
        let symbol = self.symbol().get();
        // In 32 bits, which the board's processor divides by itself; the radio has frames of 127 bytes.
        let bits = 8 * (bytes as u32 + FCS_BYTES);
        let parity = bits.div_ceil(BLOCK_BITS) * PARITY_BITS;
        let (header_bit, data_bit): (u32, u64) = match self.bitrate {
            Bitrate::Kbps110 => (4096, 4096),
            Bitrate::Kbps850 => (512, 512),
            Bitrate::Kbps6800 => (512, 64),
        };
        AirTime {
            preamble: Ticks::new(self.preamble.symbols() as u64 * symbol),
            sfd: Ticks::new(self.sfd_symbols() as u64 * symbol),
            header: Ticks::new((PHR_BITS * header_bit) as u64 * CHIP),
            data: Ticks::new((bits + parity) as u64 * data_bit * CHIP),
        }
    }

    /// How long a frame of `bytes` bytes, frame check sequence not counted, is on the air.
    pub const fn frame_time(&self, bytes: usize) -> Ticks {
        self.air_time(bytes).total()
    }

    /// From a frame's first preamble symbol to its ranging marker.
    pub const fn preamble_to_marker(&self) -> Ticks {
        let air = self.air_time(0);
        Ticks::new(air.preamble.get() + air.sfd.get())
    }

    /// From the ranging marker of a frame of `bytes` bytes, frame check sequence not counted, to its last bit.
    pub const fn marker_to_end(&self, bytes: usize) -> Ticks {
        let air = self.air_time(bytes);
        Ticks::new(air.header.get() + air.data.get())
    }

    /// One symbol of the preamble: 993.59 ns at 16 MHz, 1017.63 ns at 64 MHz.
    pub const fn symbol(&self) -> Ticks {
        Ticks::new(
            CHIP * match self.prf {
                Prf::Mhz16 => 496,
                Prf::Mhz64 => 508,
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phy::{Channel, Preamble};
    use crate::time::TICKS_PER_SECOND;
    use proptest::prelude::*;

    fn us(ticks: Ticks) -> f64 {
        ticks.get() as f64 / TICKS_PER_SECOND as f64 * 1e6
    }

    /// Computed by hand from the standard's durations in nanoseconds.
    #[test]
    fn a_poll_at_the_default_takes_180_us() {
        let symbol = 1_017.628_205;
        let expected_us =
            (136.0 * symbol + 21.0 * 1_025.641_026 + (112.0 + 48.0) * 128.205_128) / 1e3;
        assert!((us(PhyProfile::DEFAULT.frame_time(12)) - expected_us).abs() < 1e-5);
        assert!((expected_us - 180.449).abs() < 1e-3);
    }

    #[test]
    fn a_long_range_frame_of_22_bytes_takes_4_3_ms() {
        let symbol = 1_017.628_205;
        let expected_us = ((2_048.0 + 64.0) * symbol + (21.0 + 192.0 + 48.0) * 8_205.128_205) / 1e3;
        assert!((us(PhyProfile::LONG_RANGE.frame_time(22)) - expected_us).abs() < 1e-5);
        assert!((4_200.0..4_400.0).contains(&expected_us));
    }

    #[test]
    fn parity_comes_in_blocks_of_330_bits() {
        let bit = 64 * CHIP;
        let data = |bytes| PhyProfile::DEFAULT.air_time(bytes).data.get() / bit;
        // 41 bytes are 328 bits, 42 are 336.
        assert_eq!(data(39), 328 + 48);
        assert_eq!(data(40), 336 + 96);
    }

    proptest! {
        #[test]
        fn the_marker_parts_every_frame_in_two(bytes in 0usize..=125, pick in 0usize..156) {
            let Some(profile) = PhyProfile::all().nth(pick) else { unreachable!() };
            prop_assert_eq!(
                profile.preamble_to_marker().get() + profile.marker_to_end(bytes).get(),
                profile.frame_time(bytes).get()
            );
        }

        #[test]
        fn a_longer_frame_takes_longer(bytes in 0usize..125, pick in 0usize..156) {
            let Some(profile) = PhyProfile::all().nth(pick) else { unreachable!() };
            prop_assert!(profile.frame_time(bytes) < profile.frame_time(bytes + 1));
        }
    }

    #[test]
    fn the_channel_does_not_matter() {
        let other = PhyProfile {
            channel: Channel::Ch2,
            ..PhyProfile::DEFAULT
        };
        assert_eq!(other.frame_time(12), PhyProfile::DEFAULT.frame_time(12));
        assert_eq!(Preamble::ALL.len(), 8);
    }
}
