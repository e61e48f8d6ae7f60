//! What the chip reports about a reception besides its time: amplitudes, accumulation counts, clock offset.
//!
//! **Power.** User Manual 4.7.1 and 4.7.2 give, with N the preamble accumulation count and A 113.77 dB (PRF 16 MHz)
//! or 121.74 dB (64 MHz):
//!
//! ```text
//! first path = 10 log10((F1² + F2² + F3²) / N²) - A        receive = 10 log10(C 2^17 / N²) - A    [dBm]
//! ```
//!
//! The registers are filled so that these formulas give back the simulated powers. As on the chip, RXPACC counts on
//! into the SFD; when RXPACC equals RXPACC_NOSAT the reader takes off the number of table 18 (7.2.18) first.
//!
//! **Carrier integrator** (DRX_CAR_INT, 7.2.40.11, 21 bits signed). One unit is a carrier offset of
//! 998.4 MHz / 2 / L / 2^17 with L = 8192 at 110 kbit/s and 1024 otherwise. It is positive when the *sender's* clock is
//! slower than the receiver's:
//!
//! ```text
//! (f_sender - f_receiver) / f_receiver = - value x 998.4e6 / (2 L 2^17) / f_carrier
//! ```
//!
//! Sign and scale were checked against recorded exchanges (IIoT20 data set, channel 3, 110 kbit/s): with the clock
//! offset taken from the six time stamps, the slope is -1.045e-4 ppm a unit at the tag and -1.028e-4 at the anchor
//! (the rule says -1.0347e-4; both see the other side). The data set stores 17 of the 21 bits.
//! **Time tracking** (RX_TTCKI 7.2.21, RX_TTCKO 7.2.22): offset / interval is the same clock offset with the sign of the
//! carrier integrator. The examples in 7.2.22 have the other sign, but drivers that correct single-sided ranging with
//! it, the vendor's among them, need this one; no recording was at hand to check.

use crate::air::Signal;
use crate::phy::{DataRate, Prf, Sfd};

use super::config::LevelReport;

/// Register contents of one reception.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Diagnostics {
    /// RXPACC.
    pub(crate) rxpacc: u16,
    /// RXPACC_NOSAT.
    pub(crate) rxpacc_nosat: u16,
    pub(crate) std_noise: u16,
    pub(crate) fp_ampl: [u16; 3],
    pub(crate) cir_pwr: u16,
    /// First path in the accumulator, 10 integer and 6 fractional bits.
    pub(crate) fp_index: u16,
    pub(crate) peak_index: u16,
    pub(crate) peak_ampl: u16,
    pub(crate) carrier_integrator: i32,
    pub(crate) tracking_interval: u32,
    pub(crate) tracking_offset: i32,
}

/// What the receiver knows about a reception apart from the signal itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reception {
    /// Preamble symbols accumulated.
    pub(crate) symbols: u16,
    /// Frequency error of the receiver's crystal in ppm.
    pub(crate) own_ppm: f64,
    /// Fraction of a system clock cycle (0..1) by which the frame missed the receiver's clock edge.
    pub(crate) clock_fraction: f64,
    pub(crate) report: LevelReport,
}

/// Standard deviation of the accumulator's noise is this times the root of the accumulation count (recordings show
/// 40 to 48 at about 290 symbols).
const NOISE_PER_ROOT_SYMBOL: f64 = 2.6;
/// A strong signal is no longer accumulated when CIR_PWR has come to this, half of what it can hold: of 17 160 recorded
/// receptions with preambles of 1536 symbols the largest is 35 469, and above -80 dBm only some 280 symbols count
/// (IIoT19 data set). That RXPACC_NOSAT counts on is taken from the manual's word for saturation (7.2.18).
const MOST_CIR_POWER: f64 = 32_768.0;
/// Relative amplitudes of the three samples around the first path (a band-limited pulse; shape assumed).
const PULSE: [f64; 3] = [0.88, 1.0, 0.92];
/// The leading edge algorithm places the first path near this accumulator index.
const FIRST_PATH_INDEX: f64 = 745.0;

pub(crate) fn diagnose(signal: &Signal, reception: &Reception) -> Diagnostics {
    let phy = &signal.wave.phy;
    let level = |dbm: f64| reported_dbm(dbm, phy.prf, reception.report);
    let a_symbol = |dbm: f64| 10f64.powf((level(dbm) + phy.prf.power_constant_db()) / 10.0);
    let enough = (MOST_CIR_POWER * f64::from(1 << 17) / a_symbol(signal.wave.power_dbm)).sqrt();
    let symbols = reception.symbols.max(1);
    let accumulated = symbols.min(enough.max(1.0) as u16);
    let counted = symbols + sfd_overshoot(phy.sfd, phy.rate);
    let n = f64::from(accumulated);
    let linear = |dbm: f64| a_symbol(dbm) * n * n;

    let pulse_energy: f64 = PULSE.iter().map(|a| a * a).sum();
    let first_path_unit = (linear(signal.first_path_dbm) / pulse_energy).sqrt();
    let fp_ampl = PULSE.map(|a| to_u16(a * first_path_unit));
    let peak_unit = (linear(signal.wave.power_dbm) / pulse_energy).sqrt();

    // A first path weaker than the rest means the peak comes later (obstructed path).
    let late = signal.wave.power_dbm - signal.first_path_dbm > 3.0;
    let fp_index = FIRST_PATH_INDEX + reception.clock_fraction * 8.0;
    let sender_ppm = signal.wave.clock_ppm - reception.own_ppm;

    Diagnostics {
        rxpacc: if accumulated < symbols {
            accumulated
        } else {
            counted
        },
        rxpacc_nosat: counted,
        std_noise: to_u16(NOISE_PER_ROOT_SYMBOL * n.sqrt()),
        fp_ampl,
        cir_pwr: to_u16(linear(signal.wave.power_dbm) / f64::from(1 << 17)),
        fp_index: (fp_index * 64.0).round() as u16,
        peak_index: fp_index as u16 + if late { 6 } else { 1 },
        peak_ampl: to_u16(peak_unit),
        carrier_integrator: carrier_integrator(sender_ppm, phy.channel.centre_hz(), phy.rate),
        tracking_interval: tracking_interval(phy.prf),
        tracking_offset: (-sender_ppm * 1e-6 * f64::from(tracking_interval(phy.prf))).round()
            as i32,
    }
}

fn to_u16(x: f64) -> u16 {
    x.round().clamp(0.0, f64::from(u16::MAX)) as u16
}

/// The level that the formulas will show for a signal of `dbm`.
fn reported_dbm(dbm: f64, prf: Prf, report: LevelReport) -> f64 {
    const KNEE_DBM: f64 = -88.0;
    match report {
        LevelReport::Linear => dbm,
        LevelReport::Compressed if dbm <= KNEE_DBM => dbm,
        LevelReport::Compressed => {
            let k = match prf {
                Prf::Mhz16 => 2.3334,
                Prf::Mhz64 => 1.1667,
            };
            KNEE_DBM + (dbm - KNEE_DBM) / (1.0 + k)
        }
    }
}

/// Symbols that RXPACC counts beyond the preamble (table 18, with the sign turned).
fn sfd_overshoot(sfd: Sfd, rate: DataRate) -> u16 {
    match (rate, sfd) {
        (DataRate::Kbps110, Sfd::Standard) => 64,
        (DataRate::Kbps110, _) => 82,
        (_, Sfd::Standard) => 5,
        (_, Sfd::Decawave { symbols } | Sfd::User { symbols }) if symbols > 8 => 18,
        (_, _) => 10,
    }
}

/// DRX_CAR_INT for a sender whose clock is `sender_ppm` fast as seen by the receiver, saturated to 21 bits.
pub fn carrier_integrator(sender_ppm: f64, carrier_hz: f64, rate: DataRate) -> i32 {
    let length = match rate {
        DataRate::Kbps110 => 8192.0,
        DataRate::Kbps850 | DataRate::Kbps6800 => 1024.0,
    };
    let hz_per_unit = 998.4e6 / 2.0 / length / f64::from(1 << 17);
    const LIMIT: f64 = (1 << 20) as f64;
    (-sender_ppm * 1e-6 * carrier_hz / hz_per_unit)
        .round()
        .clamp(-LIMIT, LIMIT - 1.0) as i32
}

fn tracking_interval(prf: Prf) -> u32 {
    match prf {
        Prf::Mhz16 => 0x01F0_0000,
        Prf::Mhz64 => 0x01FC_0000,
    }
}
