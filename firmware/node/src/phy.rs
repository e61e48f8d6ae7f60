//! What a mode of the radio means for its registers, and for what is read from them.
//!
//! Values from the DW1000 user manual, version 2.18; the section beside each.

use nova_ranging::PhyProfile;
use nova_ranging::phy::{Bitrate, Channel, Preamble, Prf, Sfd};

/// AGC_TUNE2 (7.2.36.5).
pub(crate) const AGC_TUNE2: u32 = 0x2502_A907;
/// AGC_TUNE3 (7.2.36.7).
pub(crate) const AGC_TUNE3: u16 = 0x0035;
/// Noise threshold multiplier of LDE_CFG1 for line of sight (7.2.47.2).
pub(crate) const LDE_NTM: u8 = 0xD;
/// Peak multiplier of LDE_CFG1 (7.2.47.2).
pub(crate) const LDE_PMULT: u8 = 3;
/// A sample of the channel impulse response: half a period of 499.2 MHz, in ns (4.7.1).
pub(crate) const SAMPLE_NS: f32 = 1.001_6;

/// SYS_CFG: the interrupt line is active high (7.2.6).
const HIRQ_POL: u32 = 1 << 9;
/// SYS_CFG: single receive buffer.
const DIS_DRXB: u32 = 1 << 12;
/// SYS_CFG: smart transmit power is off.
const DIS_STXP: u32 = 1 << 18;
/// SYS_CFG: the receiver is for 110 kbit/s.
const RXM110K: u32 = 1 << 22;
/// SYS_CFG: RX_FWTO ends a reception.
pub(crate) const RXWTOE: u32 = 1 << 28;

/// The registers that depend on the mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Registers {
    /// Frames are told apart by the state machines, not by the radio's filter.
    pub(crate) sys_cfg: u32,
    /// Above the frame's length: rate, ranging bit, pulse repetition frequency, preamble (7.2.10, table 16).
    pub(crate) tx_fctrl: u32,
    /// Channel, codes and start-of-frame delimiter of both directions (7.2.32).
    pub(crate) chan_ctrl: u32,
    /// SFD_LENGTH for Decawave's own delimiter (7.2.34).
    pub(crate) sfd_length: u8,
    /// 7.2.31.4, table 20.
    pub(crate) tx_power: u32,
    /// 7.2.36.3.
    pub(crate) agc_tune1: u16,
    /// By rate and delimiter (7.2.40.2, table 30).
    pub(crate) drx_tune0b: u16,
    /// 7.2.40.3, table 31.
    pub(crate) drx_tune1a: u16,
    /// 7.2.40.4, table 32.
    pub(crate) drx_tune1b: u16,
    /// By acquisition chunk (7.2.40.5, table 33).
    pub(crate) drx_tune2: u32,
    /// Time-out for the delimiter in symbols (7.2.40.7): preamble + 1 + delimiter - chunk, as the vendor's driver has it.
    pub(crate) drx_sfdtoc: u16,
    /// 7.2.40.10, table 34.
    pub(crate) drx_tune4h: u16,
    /// 7.2.41.3, table 37.
    pub(crate) rf_rxctrlh: u8,
    /// 7.2.41.4, table 38; for channel 5 before version 2.16 of the manual 0x001E_3FE0.
    pub(crate) rf_txctrl: u32,
    /// 7.2.43.6, table 40; for channel 5 before version 2.18 0xC0. It sets the width of the pulses and with it some
    /// centimetres of the antenna delay.
    pub(crate) tc_pgdelay: u8,
    /// 7.2.44.2, table 43.
    pub(crate) fs_pllcfg: u32,
    /// 7.2.44.3, table 44.
    pub(crate) fs_plltune: u8,
    /// 7.2.47.6.
    pub(crate) lde_cfg2: u16,
    /// By preamble code, an eighth at 110 kbit/s (7.2.47.7, table 51).
    pub(crate) lde_repc: u16,
}

impl Registers {
    /// For `profile`.
    ///
    /// `factory_power`: the word of the factory's memory for channel and pulse repetition frequency, which was measured
    /// with this very board; 0 if there is none.
    pub(crate) fn of(profile: &PhyProfile, factory_power: u32) -> Self {
        let &PhyProfile {
            channel,
            bitrate,
            prf,
            preamble,
        } = profile;
        let slow = bitrate == Bitrate::Kbps110;
        let smart = smart_power(bitrate);
        let number = u32::from(channel.number());
        let code = u32::from(profile.preamble_code());
        let prf_bits = match prf {
            Prf::Mhz16 => 0b01,
            Prf::Mhz64 => 0b10,
        };
        let decawave = profile.sfd() == Sfd::Decawave;
        Self {
            sys_cfg: HIRQ_POL
                | DIS_DRXB
                | if smart { 0 } else { DIS_STXP }
                | if slow { RXM110K } else { 0 },
            tx_fctrl: rate_bits(bitrate) << 13
                | 1 << 15
                | prf_bits << 16
                | preamble_bits(preamble) << 18,
            chan_ctrl: number
                | number << 4
                | if decawave {
                    1 << 17 | 1 << 20 | 1 << 21
                } else {
                    0
                }
                | prf_bits << 18
                | code << 22
                | code << 27,
            sfd_length: profile.sfd_symbols() as u8,
            tx_power: match (factory_power, smart) {
                (0, _) => reference_power(channel, prf, smart),
                // The lowest octet is that of frames without boost (table 19); the others only count with it.
                (word, false) => u32::from_le_bytes([word as u8; 4]),
                (word, true) => word,
            },
            agc_tune1: match prf {
                Prf::Mhz16 => 0x8870,
                Prf::Mhz64 => 0x889B,
            },
            drx_tune0b: match (bitrate, decawave) {
                (Bitrate::Kbps110, false) => 0x000A,
                (Bitrate::Kbps110, true) => 0x0016,
                (Bitrate::Kbps850, true) => 0x0006,
                (Bitrate::Kbps6800, true) => 0x0002,
                (_, false) => 0x0001,
            },
            drx_tune1a: match prf {
                Prf::Mhz16 => 0x0087,
                Prf::Mhz64 => 0x008D,
            },
            drx_tune1b: match (bitrate, preamble) {
                (Bitrate::Kbps110, _) => 0x0064,
                (_, Preamble::Symbols64) => 0x0010,
                _ => 0x0020,
            },
            drx_tune2: match (prf, profile.pac_symbols()) {
                (Prf::Mhz16, 8) => 0x311A_002D,
                (Prf::Mhz16, 16) => 0x331A_0052,
                (Prf::Mhz16, 32) => 0x351A_009A,
                (Prf::Mhz16, _) => 0x371A_011D,
                (Prf::Mhz64, 8) => 0x313B_006B,
                (Prf::Mhz64, 16) => 0x333B_00BE,
                (Prf::Mhz64, 32) => 0x353B_015E,
                (Prf::Mhz64, _) => 0x373B_0296,
            },
            drx_sfdtoc: preamble.symbols() + 1 + profile.sfd_symbols() - profile.pac_symbols(),
            drx_tune4h: match preamble {
                Preamble::Symbols64 => 0x0010,
                _ => 0x0028,
            },
            rf_rxctrlh: if channel.is_wide() { 0xBC } else { 0xD8 },
            rf_txctrl: match channel {
                Channel::Ch1 => 0x0000_5C40,
                Channel::Ch2 => 0x0004_5CA0,
                Channel::Ch3 => 0x0008_6CC0,
                Channel::Ch4 => 0x0004_5C80,
                Channel::Ch5 => 0x001E_3FE3,
                Channel::Ch7 => 0x001E_7DE0,
            },
            tc_pgdelay: match channel {
                Channel::Ch1 => 0xC9,
                Channel::Ch2 => 0xC2,
                Channel::Ch3 => 0xC5,
                Channel::Ch4 => 0x95,
                Channel::Ch5 => 0xB5,
                Channel::Ch7 => 0x93,
            },
            fs_pllcfg: match channel {
                Channel::Ch1 => 0x0900_0407,
                Channel::Ch2 | Channel::Ch4 => 0x0840_0508,
                Channel::Ch3 => 0x0840_1009,
                Channel::Ch5 | Channel::Ch7 => 0x0800_041D,
            },
            fs_plltune: match channel {
                Channel::Ch1 => 0x1E,
                Channel::Ch2 | Channel::Ch4 => 0x26,
                Channel::Ch3 => 0x56,
                Channel::Ch5 | Channel::Ch7 => 0xBE,
            },
            lde_cfg2: match prf {
                Prf::Mhz16 => 0x1607,
                Prf::Mhz64 => 0x0607,
            },
            lde_repc: replica(profile.preamble_code()) / if slow { 8 } else { 1 },
        }
    }
}

/// Whether smart power does anything: it boosts short frames, and only at 6.8 Mbit/s (7.2.31.1).
fn smart_power(bitrate: Bitrate) -> bool {
    bitrate == Bitrate::Kbps6800
}

/// TXBR (7.2.10).
fn rate_bits(bitrate: Bitrate) -> u32 {
    match bitrate {
        Bitrate::Kbps110 => 0b00,
        Bitrate::Kbps850 => 0b01,
        Bitrate::Kbps6800 => 0b10,
    }
}

/// TXPSR and, two bits higher, PE (7.2.10, table 16).
fn preamble_bits(preamble: Preamble) -> u32 {
    match preamble {
        Preamble::Symbols64 => 0b00_01,
        Preamble::Symbols128 => 0b01_01,
        Preamble::Symbols256 => 0b10_01,
        Preamble::Symbols512 => 0b11_01,
        Preamble::Symbols1024 => 0b00_10,
        Preamble::Symbols1536 => 0b01_10,
        Preamble::Symbols2048 => 0b10_10,
        Preamble::Symbols4096 => 0b00_11,
    }
}

/// TX_POWER for a board that the factory has not measured (table 20): fills the regulator's mask, and with smart
/// power lets frames shorter than 0.5, 0.25 and 0.125 ms be stronger.
fn reference_power(channel: Channel, prf: Prf, smart: bool) -> u32 {
    match (channel, prf, smart) {
        (Channel::Ch1 | Channel::Ch2, Prf::Mhz16, true) => 0x1535_5575,
        (Channel::Ch1 | Channel::Ch2, Prf::Mhz16, false) => 0x7575_7575,
        (Channel::Ch1 | Channel::Ch2, Prf::Mhz64, true) => 0x0727_4767,
        (Channel::Ch1 | Channel::Ch2, Prf::Mhz64, false) => 0x6767_6767,
        (Channel::Ch3, Prf::Mhz16, true) => 0x0F2F_4F6F,
        (Channel::Ch3, Prf::Mhz16, false) => 0x6F6F_6F6F,
        (Channel::Ch3, Prf::Mhz64, true) => 0x2B4B_6B8B,
        (Channel::Ch3, Prf::Mhz64, false) => 0x8B8B_8B8B,
        (Channel::Ch4, Prf::Mhz16, true) => 0x1F1F_3F5F,
        (Channel::Ch4, Prf::Mhz16, false) => 0x5F5F_5F5F,
        (Channel::Ch4, Prf::Mhz64, true) => 0x3A5A_7A9A,
        (Channel::Ch4, Prf::Mhz64, false) => 0x9A9A_9A9A,
        (Channel::Ch5, Prf::Mhz16, true) => 0x0E08_2848,
        (Channel::Ch5, Prf::Mhz16, false) => 0x4848_4848,
        (Channel::Ch5, Prf::Mhz64, true) => 0x2545_6585,
        (Channel::Ch5, Prf::Mhz64, false) => 0x8585_8585,
        (Channel::Ch7, Prf::Mhz16, true) => 0x3252_7292,
        (Channel::Ch7, Prf::Mhz16, false) => 0x9292_9292,
        (Channel::Ch7, Prf::Mhz64, true) => 0x5171_B1D1,
        (Channel::Ch7, Prf::Mhz64, false) => 0xD1D1_D1D1,
    }
}

/// Where the factory's memory has the transmit power for a channel and pulse repetition frequency (6.3.1, table 10).
pub(crate) fn power_address(channel: Channel, prf: Prf) -> u16 {
    let index = match channel {
        Channel::Ch1 => 0,
        Channel::Ch2 => 1,
        Channel::Ch3 => 2,
        Channel::Ch4 => 3,
        Channel::Ch5 => 4,
        Channel::Ch7 => 5,
    };
    0x010 + 2 * index + u16::from(prf == Prf::Mhz64)
}

/// LDE_REPC of the codes that [`PhyProfile::preamble_code`] chooses (7.2.47.7, table 51).
fn replica(code: u8) -> u16 {
    match code {
        1 => 0x5998,
        3 => 0x51EA,
        5 => 0x451E,
        7 => 0x8000,
        17 => 0x3332,
        // 9.
        _ => 0x28F4,
    }
}

/// Constant A of the power formulas, in dB (4.7.1, 4.7.2).
pub(crate) fn power_constant_db(prf: Prf) -> f32 {
    match prf {
        Prf::Mhz16 => 113.77,
        Prf::Mhz64 => 121.74,
    }
}

/// RXPACC counts SFD symbols too: what to add when it is not saturated (7.2.18, table 18).
pub(crate) fn rxpacc_adjustment(bitrate: Bitrate) -> i16 {
    match bitrate {
        // Decawave's delimiter of 64 and of 16 symbols, the standard's of 8.
        Bitrate::Kbps110 => -82,
        Bitrate::Kbps850 => -18,
        Bitrate::Kbps6800 => -5,
    }
}

/// A unit of the carrier integrator as a clock offset in ppm (7.2.40.11): 998.4 MHz / 2 / 1024 / 2^17 over the
/// carrier; an eighth of that at 110 kbit/s.
pub(crate) fn carrier_ppm_per_unit(profile: &PhyProfile) -> f32 {
    let hz = match profile.bitrate {
        Bitrate::Kbps110 => 998.4e6 / 2.0 / 8_192.0 / 131_072.0,
        Bitrate::Kbps850 | Bitrate::Kbps6800 => 998.4e6 / 2.0 / 1_024.0 / 131_072.0,
    };
    let carrier_mhz = match profile.channel {
        Channel::Ch1 => 3_494.4,
        Channel::Ch2 | Channel::Ch4 => 3_993.6,
        Channel::Ch3 => 4_492.8,
        Channel::Ch5 | Channel::Ch7 => 6_489.6,
    };
    hz / carrier_mhz
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What this firmware wrote before there were profiles, and the vendor's driver writes for this mode.
    #[test]
    fn the_default_profile_gives_the_known_values() {
        let registers = Registers::of(&PhyProfile::DEFAULT, 0);
        let expected = Registers {
            sys_cfg: 0x0000_1200,
            tx_fctrl: 0x0016_C000,
            chan_ctrl: 0x4A48_0055,
            sfd_length: 8,
            tx_power: 0x2545_6585,
            agc_tune1: 0x889B,
            drx_tune0b: 0x0001,
            drx_tune1a: 0x008D,
            drx_tune1b: 0x0020,
            drx_tune2: 0x313B_006B,
            drx_sfdtoc: 129,
            drx_tune4h: 0x0028,
            rf_rxctrlh: 0xD8,
            rf_txctrl: 0x001E_3FE3,
            tc_pgdelay: 0xB5,
            fs_pllcfg: 0x0800_041D,
            fs_plltune: 0xBE,
            lde_cfg2: 0x0607,
            lde_repc: 0x28F4,
        };
        assert_eq!(registers, expected);
    }

    #[test]
    fn at_110_kbps_the_receiver_is_told_and_smart_power_is_off() {
        let registers = Registers::of(&PhyProfile::LONG_RANGE, 0);
        assert_eq!(registers.sys_cfg & RXM110K, RXM110K);
        assert_eq!(registers.sys_cfg & DIS_STXP, DIS_STXP);
        assert_eq!(registers.tx_power, 0x8585_8585);
        assert_eq!(registers.lde_repc, 0x28F4 / 8);
        assert_eq!(registers.drx_sfdtoc, 2_048 + 1 + 64 - 64);
    }

    #[test]
    fn the_factorys_power_goes_before_the_manuals() {
        let fast = Registers::of(&PhyProfile::DEFAULT, 0x1536_5777);
        assert_eq!(fast.tx_power, 0x1536_5777);
        let slow = Registers::of(&PhyProfile::LONG_RANGE, 0x1536_5777);
        assert_eq!(slow.tx_power, 0x7777_7777);
    }

    #[test]
    fn each_channel_has_its_own_word_for_the_power() {
        let mut addresses: heapless::Vec<u16, 12> = heapless::Vec::new();
        for channel in Channel::ALL {
            for prf in Prf::ALL {
                assert!(addresses.push(power_address(channel, prf)).is_ok());
            }
        }
        assert!((0x010..=0x01B).eq(addresses));
    }

    #[test]
    fn a_unit_of_the_carrier_integrator_is_what_was_measured() {
        // Recorded at channel 3 and 110 kbit/s: 1.035e-4 ppm.
        let recorded = PhyProfile {
            channel: Channel::Ch3,
            ..PhyProfile::LONG_RANGE
        };
        assert!((carrier_ppm_per_unit(&recorded) - 1.035e-4).abs() < 1e-7);
        assert!((carrier_ppm_per_unit(&PhyProfile::DEFAULT) - 5.731e-4).abs() < 1e-6);
    }
}
