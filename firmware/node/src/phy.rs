//! Register values for the radio's default mode of operation: channel 5,
//! 6.8 Mbit/s, pulse repetition 64 MHz, preamble of 128 symbols, code 9, the
//! standard's SFD; the mode of the module's own firmware.
//!
//! Values from the DW1000 user manual, version 2.18; the section beside each.

/// Channel for both directions (7.2.32).
pub(crate) const CHANNEL: u8 = 5;
/// Preamble code for both directions (10.5, table 61).
pub(crate) const PREAMBLE_CODE: u8 = 9;
/// Pulse repetition frequency 64 MHz in TX_FCTRL and CHAN_CTRL (7.2.10, 7.2.32).
pub(crate) const PRF_64_MHZ: u8 = 0b10;
/// 6.8 Mbit/s in TX_FCTRL (7.2.10).
pub(crate) const RATE_6800_KBPS: u8 = 0b10;
/// A preamble of 128 symbols in TX_FCTRL: fields TXPSR and PE (7.2.10, table 16).
pub(crate) const PREAMBLE_128_TXPSR: u8 = 0b01;
/// See [`PREAMBLE_128_TXPSR`].
pub(crate) const PREAMBLE_128_PE: u8 = 0b01;

/// AGC_TUNE1 for 64 MHz (7.2.36.3).
pub(crate) const AGC_TUNE1: u16 = 0x889B;
/// AGC_TUNE2 (7.2.36.5).
pub(crate) const AGC_TUNE2: u32 = 0x2502_A907;
/// AGC_TUNE3 (7.2.36.7).
pub(crate) const AGC_TUNE3: u16 = 0x0035;
/// DRX_TUNE0b for 6.8 Mbit/s and the standard's SFD (7.2.40.2).
pub(crate) const DRX_TUNE0B: u16 = 0x0001;
/// DRX_TUNE1a for 64 MHz (7.2.40.3).
pub(crate) const DRX_TUNE1A: u16 = 0x008D;
/// DRX_TUNE1b for preambles of 128 to 1024 symbols (7.2.40.4).
pub(crate) const DRX_TUNE1B: u16 = 0x0020;
/// DRX_TUNE2 for acquisition chunks of 8 symbols at 64 MHz (7.2.40.5).
pub(crate) const DRX_TUNE2: u32 = 0x313B_006B;
/// DRX_TUNE4H for preambles of 128 symbols and more (7.2.40.10).
pub(crate) const DRX_TUNE4H: u16 = 0x0028;
/// SFD detection time-out in symbols (7.2.40.7): preamble + 1 + SFD - acquisition
/// chunk, the rule of the vendor's driver.
pub(crate) const DRX_SFDTOC: u16 = 128 + 1 + 8 - 8;
/// RF_RXCTRLH for channel 5 (7.2.41.3).
pub(crate) const RF_RXCTRLH: u8 = 0xD8;
/// RF_TXCTRL for channel 5 (7.2.41.4); before version 2.16 of the manual 0x001E_3FE0.
pub(crate) const RF_TXCTRL: u32 = 0x001E_3FE3;
/// TC_PGDELAY for channel 5 (7.2.43.6); before version 2.18 0xC0. It sets the width
/// of the pulses and with it some centimetres of the antenna delay.
pub(crate) const TC_PGDELAY: u8 = 0xB5;
/// FS_PLLCFG for channel 5 (7.2.44.2).
pub(crate) const FS_PLLCFG: u32 = 0x0800_041D;
/// FS_PLLTUNE for channel 5 (7.2.44.3).
pub(crate) const FS_PLLTUNE: u8 = 0xBE;
/// TX_POWER for channel 5, 64 MHz, smart power on (7.2.31.4, table 19).
pub(crate) const TX_POWER: u32 = 0x2545_6585;
/// Noise threshold multiplier of LDE_CFG1 for line of sight (7.2.47.2).
pub(crate) const LDE_NTM: u8 = 0xD;
/// Peak multiplier of LDE_CFG1 (7.2.47.2).
pub(crate) const LDE_PMULT: u8 = 3;
/// LDE_CFG2 for 64 MHz (7.2.47.6).
pub(crate) const LDE_CFG2: u16 = 0x0607;
/// LDE_REPC for code 9 above 110 kbit/s (7.2.47.7).
pub(crate) const LDE_REPC: u16 = 0x28F4;

/// Constant A of the power formulas for 64 MHz, in dB (4.7.1, 4.7.2).
pub(crate) const POWER_CONSTANT_DB: f32 = 121.74;
/// RXPACC counts SFD symbols too: what to add for an SFD of 8 symbols of the
/// standard when it is not saturated (7.2.18, table 18).
pub(crate) const RXPACC_ADJUSTMENT: i16 = -5;

/// A unit of the carrier integrator as a clock offset in ppm (7.2.40.11): 998.4 MHz / 2 /
/// 1024 / 2^17 over the carrier of channel 5, 6489.6 MHz.
pub(crate) const CARRIER_PPM_PER_UNIT: f32 = 5.731_2e-4;
/// A sample of the channel impulse response: half a period of 499.2 MHz, in ns (4.7.1).
pub(crate) const SAMPLE_NS: f32 = 1.001_6;
