//! Starting the radio: reset, the factory's memory, the mode of operation.
//!
//! ```text
//!  hard reset ─► identity ─► factory's memory (OTP) ─► registers of the mode ─► PLL locked ─► fast bus
//!                            crystal trim, LDO tuning
//!                            transmit power, antenna delay
//! ```

use crate::access::header::WRITE_SYS_CFG;
use crate::bus::{RadioBus, SpiSpeed};
use crate::config::AntennaDelay;
use crate::phy::{self, Registers};
use crate::radio::{Radio, RadioError, Set};
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::PhyProfile;
use nova_ranging::phy::Prf;

/// Identifier of the DW1000: tag, model, version and revision (7.2.2).
const DEVICE_ID: u32 = 0xDECA_0130;

/// Crystal trim for crystals without a value of their own: the middle of 0 to 31.
const MID_RANGE_TRIM: u8 = 0x10;

/// Antenna delays in the factory's memory: for 16 MHz in the low half, for 64 MHz in the high one (6.3.1, table 10).
/// Each is the sum of both directions: the vendor's code gives either half of it.
const OTP_ANTENNA_DELAY: u16 = 0x01C;

/// Sums of both antenna delays that a board can have: 200 to 1000 ns. Empty memory, and other uses of it, are outside.
const PLAUSIBLE_TOTAL: core::ops::RangeInclusive<u16> = 12_800..=64_000;

/// CHAN_CTRL (7.2.32).
const WRITE_CHAN_CTRL: u8 = 0x80 | 0x1F;
/// USR_SFD, which begins with SFD_LENGTH (7.2.34).
const WRITE_USR_SFD: u8 = 0x80 | 0x21;
/// AGC_TUNE3, register 0x23:12, which `dw1000::ll` does not have (7.2.36.7).
const WRITE_AGC_TUNE3: [u8; 2] = [0x80 | 0x40 | 0x23, 0x12];
/// FS_XTALT: crystal trim, register 0x2B:0E (7.2.44.5).
const WRITE_FS_XTALT: [u8; 2] = [0x80 | 0x40 | 0x2B, 0x0E];

/// What the factory measured on this board.
struct Factory {
    /// TX_POWER for the channel and pulse repetition frequency; 0 if not measured.
    tx_power: u32,
    antenna_delay: Option<AntennaDelay>,
}

/// A word of the factory's memory, if it was ever written: blank bits read 0, and a bus without a radio all ones.
fn written(word: u32) -> Option<u32> {
    (word != 0 && word != u32::MAX).then_some(word)
}

impl<B: RadioBus, R: OutputPin, D: DelayNs> Radio<B, R, D> {
    /// Resets and configures the radio; afterwards it is idle. Takes some 10 ms.
    pub(crate) fn start(&mut self) -> Result<(), RadioError> {
        self.hard_reset()?;
        self.check_identity()?;
        self.detect_clock_lock()?;
        let factory = self.load_from_otp()?;
        self.configure(&factory)?;
        self.go_fast()
    }

    /// Without lock detection on, CPLOCK cannot be trusted (7.2.37.1).
    pub(crate) fn detect_clock_lock(&mut self) -> Result<(), RadioError> {
        ll!(self.ll().ec_ctrl().write(|w| w.pllldt(1)))
    }

    /// Waits for the clock PLL, from which on the bus can be fast.
    pub(crate) fn go_fast(&mut self) -> Result<(), RadioError> {
        self.wait_for_clock()?;
        self.keep_transmitter_clock_on()?;
        self.bus.set_speed(SpiSpeed::Fast);
        self.check_settings()
    }

    fn hard_reset(&mut self) -> Result<(), RadioError> {
        self.bus.set_speed(SpiSpeed::Slow);
        // Open drain: high lets go of the line, which the radio pulls up
        // itself (data sheet, table 1: RSTn).
        self.reset.set_low().map_err(|_| RadioError::Reset)?;
        self.delay.delay_us(100);
        self.reset.set_high().map_err(|_| RadioError::Reset)?;
        // From WAKEUP to INIT and the crystal running: about 4 ms (2.3.2).
        self.delay.delay_ms(5);
        Ok(())
    }

    pub(crate) fn check_identity(&mut self) -> Result<(), RadioError> {
        let id = ll!(self.ll().dev_id().read())?;
        let read = u32::from(id.ridtag()) << 16
            | u32::from(id.model()) << 8
            | u32::from(id.ver()) << 4
            | u32::from(id.rev());
        if read == DEVICE_ID {
            Ok(())
        } else {
            Err(RadioError::WrongDevice(read))
        }
    }

    /// Takes LDO tuning and crystal trim from the factory's memory, and the
    /// code for the leading-edge search into place; returns what else the factory knows.
    fn load_from_otp(&mut self) -> Result<Factory, RadioError> {
        // Reading the memory wants the crystal's clock (7.2.50.1, SYSCLKS),
        // loading the code this very value (2.5.5.10, table 4).
        ll!(self.ll().pmsc_ctrl0().write(|w| w.raw_value(0xF030_0301)))?;
        let ldo_low = self.read_otp(0x004)?;
        self.ldo_tuned = ldo_low & 0xFF != 0;
        if self.ldo_tuned {
            let ldo_high = self.read_otp(0x005)?;
            let tune = u64::from(ldo_low) | u64::from(ldo_high & 0xFF) << 32;
            ll!(self.ll().ldotune().write(|w| w.value(tune)))?;
        }
        // 0 means never trimmed (8.1); after a reset the trim is 0 too, which
        // is the end of its range.
        self.crystal_trim = match (self.read_otp(0x01E)? & 0x1F) as u8 {
            0 => MID_RANGE_TRIM,
            trim => trim,
        };
        self.trim_crystal()?;
        let PhyProfile { channel, prf, .. } = self.profile;
        let tx_power = self.read_otp(phy::power_address(channel, prf))?;
        let totals = self.read_otp(OTP_ANTENNA_DELAY)?;
        let total = match prf {
            Prf::Mhz16 => totals as u16,
            Prf::Mhz64 => (totals >> 16) as u16,
        };
        ll!(self.ll().otp_ctrl().write(|w| w.ldeload(1)))?;
        self.delay.delay_us(150);
        ll!(self.ll().pmsc_ctrl0().write(|w| w.raw_value(0xF030_0200)))?;
        Ok(Factory {
            tx_power: written(tx_power).unwrap_or(0),
            // An odd tick goes to one of the directions, so that the sum stays.
            antenna_delay: PLAUSIBLE_TOTAL.contains(&total).then_some(AntennaDelay {
                tx_ticks: total / 2,
                rx_ticks: total - total / 2,
            }),
        })
    }

    pub(crate) fn trim_crystal(&mut self) -> Result<(), RadioError> {
        let [register, sub] = WRITE_FS_XTALT;
        self.write_raw(&[register, sub, 0x60 | self.crystal_trim])
    }

    fn read_otp(&mut self, address: u16) -> Result<u32, RadioError> {
        ll!(self.ll().otp_addr().write(|w| w.value(address)))?;
        ll!(self.ll().otp_ctrl().write(|w| w.otprden(1).otpread(1)))?;
        // OTPREAD clears itself; reading takes well below a transfer's time
        // (6.3.3).
        let value = ll!(self.ll().otp_rdat().read())?.value();
        ll!(self.ll().otp_ctrl().write(|w| w))?;
        Ok(value)
    }

    fn configure(&mut self, factory: &Factory) -> Result<(), RadioError> {
        let to = Registers::of(&self.profile, factory.tx_power);
        let unset = factory.antenna_delay;
        self.antenna_delay =
            (self.set_antenna_delay).or(unset.unwrap_or(AntennaDelay::UNCALIBRATED));
        let AntennaDelay { tx_ticks, rx_ticks } = self.antenna_delay;
        self.sys_cfg = to.sys_cfg;
        self.tx_fctrl = to.tx_fctrl;
        // What a reset leaves.
        self.set = Set::default();
        self.write_u32(WRITE_SYS_CFG, to.sys_cfg)?;
        self.write_u32(WRITE_CHAN_CTRL, to.chan_ctrl)?;
        self.write_raw(&[WRITE_USR_SFD, to.sfd_length])?;
        let [register, sub] = WRITE_AGC_TUNE3;
        let [low, high] = phy::AGC_TUNE3.to_le_bytes();
        self.write_raw(&[register, sub, low, high])?;
        let mut ll = self.ll();
        ll!(ll.agc_tune1().write(|w| w.value(to.agc_tune1)))?;
        ll!(ll.agc_tune2().write(|w| w.value(phy::AGC_TUNE2)))?;
        ll!(ll.drx_tune0b().write(|w| w.value(to.drx_tune0b)))?;
        ll!(ll.drx_tune1a().write(|w| w.value(to.drx_tune1a)))?;
        ll!(ll.drx_tune1b().write(|w| w.value(to.drx_tune1b)))?;
        ll!(ll.drx_tune2().write(|w| w.value(to.drx_tune2)))?;
        ll!(ll.drx_tune4h().write(|w| w.value(to.drx_tune4h)))?;
        ll!(ll.drx_sfdtoc().write(|w| w.count(to.drx_sfdtoc)))?;
        ll!(ll.rf_rxctrlh().write(|w| w.value(to.rf_rxctrlh)))?;
        ll!(ll.rf_txctrl().write(|w| w.value(to.rf_txctrl)))?;
        ll!(ll.tc_pgdelay().write(|w| w.value(to.tc_pgdelay)))?;
        ll!(ll.fs_pllcfg().write(|w| w.value(to.fs_pllcfg)))?;
        ll!(ll.fs_plltune().write(|w| w.value(to.fs_plltune)))?;
        ll!(ll.tx_power().write(|w| w.value(to.tx_power)))?;
        ll!(ll
            .lde_cfg1()
            .write(|w| w.ntm(phy::LDE_NTM).pmult(phy::LDE_PMULT)))?;
        ll!(ll.lde_cfg2().write(|w| w.value(to.lde_cfg2)))?;
        ll!(ll.lde_repc().write(|w| w.value(to.lde_repc)))?;
        ll!(ll.lde_rxantd().write(|w| w.value(rx_ticks)))?;
        ll!(ll.tx_antd().write(|w| w.value(tx_ticks)))?;
        // All that `poll` looks for. A failed leading-edge search shows with
        // the frame it belongs to.
        ll!(ll.sys_mask().write(|w| {
            w.mtxfrs(1)
                .mrxfcg(1)
                .mrxphe(1)
                .mrxfce(1)
                .mrxrfsl(1)
                .mrxsfdto(1)
                .mrxrfto(1)
        }))?;
        self.clear_status()
    }

    fn write_u32(&mut self, register: u8, value: u32) -> Result<(), RadioError> {
        let [a, b, c, d] = value.to_le_bytes();
        self.write_raw(&[register, a, b, c, d])
    }

    fn wait_for_clock(&mut self) -> Result<(), RadioError> {
        for _ in 0..10 {
            if ll!(self.ll().sys_status().read())?.cplock() == 1 {
                return Ok(());
            }
            self.delay.delay_ms(1);
        }
        Err(RadioError::ClockNotLocked)
    }

    /// Keeps the transmitter's clock from being switched off between frames.
    /// Otherwise a delayed transmission asked for at the very last moment is at
    /// times neither sent nor flagged (erratum TX-1).
    fn keep_transmitter_clock_on(&mut self) -> Result<(), RadioError> {
        ll!(self.ll().pmsc_ctrl0().modify(|_, w| w.txclks(0b10)))
    }
}
