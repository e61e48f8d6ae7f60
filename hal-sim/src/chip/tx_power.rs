//! From the TX_POWER register to the power at the antenna (User Manual 7.2.31).
//!
//! An octet sets a coarse gain (bits 7-5, 2.5 dB steps; 3 dB in manuals before version 2.18) and a fine gain (bits 4-0,
//! 0.5 dB steps). The manual's table 20 gives, per channel and PRF, the octet that just fills the regulatory mask of
//! -41.3 dBm/MHz over 500 MHz; that octet is taken as [`MASK_POWER_DBM`] and others are relative to it. One power holds
//! for the whole frame (that of the preamble): separate powers of PHR and data are not modelled.

use crate::phy::{Channel, DataRate, PhyConfig, Prf};

/// -41.3 dBm/MHz over 500 MHz.
pub const MASK_POWER_DBM: f64 = -14.3;
/// The amplifier gives no more than this above the mask, whatever the register says (assumed).
const HEADROOM_DB: f64 = 10.0;

/// Transmit power in dBm. `smart` is smart transmit power control, which boosts short frames at 6.8 Mbit/s;
/// `frame_us` is the duration of the whole frame in microseconds.
pub(crate) fn power_dbm(register: u32, smart: bool, phy: &PhyConfig, frame_us: f64) -> f64 {
    let [norm, p500, p250, p125] = register.to_le_bytes();
    let octet = if !smart {
        // Manual control: bits 23-16 set the preamble's power, bits 15-8 that of the PHR.
        p250
    } else if phy.rate != DataRate::Kbps6800 || frame_us >= 500.0 {
        norm
    } else if frame_us >= 250.0 {
        p500
    } else if frame_us >= 125.0 {
        p250
    } else {
        p125
    };
    let Some(gain_db) = gain_db(octet) else {
        return f64::NEG_INFINITY;
    };
    let above_mask_db = gain_db - gain_db_of_mask(phy.channel, phy.prf);
    MASK_POWER_DBM + above_mask_db.min(HEADROOM_DB)
}

/// Gain of an octet in dB; `None` when its coarse part switches the output off.
fn gain_db(octet: u8) -> Option<f64> {
    let coarse = octet >> 5;
    (coarse != 0b111).then(|| f64::from(6 - coarse) * 2.5 + f64::from(octet & 0x1F) * 0.5)
}

/// Gain of the octet that fills the mask (table 20, reference values without smart power).
fn gain_db_of_mask(channel: Channel, prf: Prf) -> f64 {
    let octet = match (channel, prf) {
        (Channel::Ch1 | Channel::Ch2, Prf::Mhz16) => 0x75,
        (Channel::Ch3, Prf::Mhz16) => 0x6F,
        (Channel::Ch4, Prf::Mhz16) => 0x5F,
        (Channel::Ch5, Prf::Mhz16) => 0x48,
        (Channel::Ch7, Prf::Mhz16) => 0x92,
        (Channel::Ch1 | Channel::Ch2, Prf::Mhz64) => 0x67,
        (Channel::Ch3, Prf::Mhz64) => 0x8B,
        (Channel::Ch4, Prf::Mhz64) => 0x9A,
        (Channel::Ch5, Prf::Mhz64) => 0x85,
        (Channel::Ch7, Prf::Mhz64) => 0xD1,
    };
    gain_db(octet).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phy::{PreambleLength, Sfd};

    fn phy(rate: DataRate) -> PhyConfig {
        PhyConfig {
            channel: Channel::Ch5,
            prf: Prf::Mhz64,
            preamble_code: 9,
            preamble: PreambleLength::from_symbols(128).unwrap(),
            sfd: Sfd::Standard,
            rate,
        }
    }

    #[test]
    fn recommended_manual_setting_fills_the_mask() {
        let dbm = power_dbm(0x8585_8585, false, &phy(DataRate::Kbps6800), 100.0);
        assert!((dbm - MASK_POWER_DBM).abs() < 1e-9);
    }

    #[test]
    fn smart_power_boosts_short_fast_frames_by_three_coarse_steps() {
        let boosted = power_dbm(0x2545_6585, true, &phy(DataRate::Kbps6800), 100.0);
        assert!((boosted - MASK_POWER_DBM - 7.5).abs() < 1e-9);
        let slow = power_dbm(0x2545_6585, true, &phy(DataRate::Kbps850), 100.0);
        assert!((slow - MASK_POWER_DBM).abs() < 1e-9);
    }
}
