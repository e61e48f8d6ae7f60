//! The DW1000: configured once, then touched as little as possible.
//!
//! Registers are reached through `dw1000::ll`. Its high-level interface is not
//! used: it sets some twenty registers anew for every frame, accepts frames
//! with a bad check sequence and notices a late transmission only afterwards.

use crate::bus::{Legacy, NoPin, RadioBus, SpiSpeed};
use crate::config::AntennaDelay;
use crate::diagnostics::Reception;
use crate::phy;
use dw1000::ll;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::{DeviceTime, When};

/// A DW1000 and the lines to it.
pub(crate) struct Radio<B, R, D> {
    bus: B,
    reset: R,
    delay: D,
    antenna_delay: AntennaDelay,
}

/// What the radio has done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RadioEvent<'a> {
    /// The frame has been sent.
    Sent { at: DeviceTime },
    /// A frame with a good check sequence has come in; its first bytes.
    Received { bytes: &'a [u8], at: DeviceTime },
    /// A frame came in damaged. The receiver is off now.
    Damaged,
    /// The time for listening is over. The receiver is off now.
    ListenTimeout,
}

/// Why the radio cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RadioError {
    /// An SPI transfer failed.
    Bus,
    /// The reset line could not be driven.
    Reset,
    /// Not a DW1000: its identifier read like this. 0 or 0xFFFF_FFFF mean that
    /// nobody answers on the bus.
    WrongDevice(u32),
    /// The radio's clock PLL does not lock after reset.
    ClockNotLocked,
    /// The radio no longer is as it was set up: it lost its supply or was
    /// reset, or nothing drives the bus.
    SettingsLost,
}

impl core::fmt::Display for RadioError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bus => f.write_str("an SPI transfer failed"),
            Self::Reset => f.write_str("the radio's reset line could not be driven"),
            Self::WrongDevice(id) => {
                write!(
                    f,
                    "no DW1000 on the bus: its identifier reads {id:#010x}, not 0xdeca0130"
                )
            }
            Self::ClockNotLocked => f.write_str("the radio's clock PLL does not lock"),
            Self::SettingsLost => f.write_str("the radio has lost its settings"),
        }
    }
}

impl core::error::Error for RadioError {}

/// Every error of the register layer is one of the bus: chip select is a
/// [`NoPin`] and cannot fail.
macro_rules! ll {
    ($access:expr) => {
        $access.map_err(|_| RadioError::Bus)
    };
}

/// Identifier of the DW1000: tag, model, version and revision (7.2.2).
const DEVICE_ID: u32 = 0xDECA_0130;

/// Bytes of a received frame that are read. No frame of ours is as long, so
/// that a longer one is still told from ours.
const RX_BUFFER_LEN: usize = 32;

/// Space for a received frame, and the SPI header before it.
pub(crate) type RxBuffer = [u8; RX_BUFFER_LEN + 1];

/// An [`RxBuffer`] to start with.
pub(crate) const EMPTY_RX_BUFFER: RxBuffer = [0; RX_BUFFER_LEN + 1];

/// SYS_STATUS is read this often for the time stamp of a received frame. The
/// radio holds RXDFR, and RXFCG with it, back until the leading-edge search is
/// over (7.2.17, RXDFR), so that no further read is needed as a rule.
const STAMP_TRIES: usize = 10;

/// Crystal trim for crystals without a value of their own: the middle of 0 to 31.
const MID_RANGE_TRIM: u8 = 0x10;

/// Length of the frame check sequence that the radio adds and checks.
const FCS_LEN: u8 = 2;

/// Registers that `dw1000::ll` does not have: SPI header for writing.
mod header {
    /// RX_FWTO: receive frame wait timeout, in units of 512/499.2 us (7.2.14).
    pub(super) const WRITE_RX_FWTO: u8 = 0x80 | 0x0C;
    /// TX_BUFFER, written without the rest of its 127 bytes.
    pub(super) const WRITE_TX_BUFFER: u8 = 0x80 | 0x09;
    /// RX_BUFFER, read without the rest of its 127 bytes.
    pub(super) const READ_RX_BUFFER: u8 = 0x11;
    /// AGC_TUNE3, register 0x23:12 (7.2.36.7).
    pub(super) const WRITE_AGC_TUNE3: [u8; 2] = [0x80 | 0x40 | 0x23, 0x12];
    /// FS_XTALT: crystal trim, register 0x2B:0E (7.2.44.5).
    pub(super) const WRITE_FS_XTALT: [u8; 2] = [0x80 | 0x40 | 0x2B, 0x0E];
}

impl<B: RadioBus, R: OutputPin, D: DelayNs> Radio<B, R, D> {
    /// A radio that is not started yet.
    pub(crate) fn new(bus: B, reset: R, delay: D, antenna_delay: AntennaDelay) -> Self {
        Self {
            bus,
            reset,
            delay,
            antenna_delay,
        }
    }

    /// Resets and configures the radio; afterwards it is idle. Takes some 10 ms.
    pub(crate) fn start(&mut self) -> Result<(), RadioError> {
        self.hard_reset()?;
        self.check_identity()?;
        // Without lock detection on, CPLOCK cannot be trusted (7.2.37.1).
        ll!(self.ll().ec_ctrl().write(|w| w.pllldt(1)))?;
        self.load_from_otp()?;
        self.configure()?;
        self.wait_for_clock()?;
        self.keep_transmitter_clock_on()?;
        self.bus.set_speed(SpiSpeed::Fast);
        Ok(())
    }

    /// Sends a frame. `Ok(false)` means that the time for it had passed; the
    /// radio is idle then.
    pub(crate) fn send(&mut self, frame: &[u8], when: When) -> Result<bool, RadioError> {
        self.write_tx_buffer(frame)?;
        let len = frame.len() as u8 + FCS_LEN;
        ll!(self.ll().tx_fctrl().write(|w| {
            w.tflen(len)
                .txbr(phy::RATE_6800_KBPS)
                .tr(1)
                .txprf(phy::PRF_64_MHZ)
                .txpsr(phy::PREAMBLE_128_TXPSR)
                .pe(phy::PREAMBLE_128_PE)
        }))?;
        let When::At(start) = when else {
            ll!(self.ll().sys_ctrl().write(|w| w.txstrt(1)))?;
            return Ok(true);
        };
        ll!(self.ll().dx_time().write(|w| w.value(start.ticks())))?;
        ll!(self.ll().sys_ctrl().write(|w| w.txstrt(1).txdlys(1)))?;
        // A start in the past would come true after a wrap, 17 s from now; one
        // with too little time to power up would go out damaged (7.2.17) or
        // never end (application note APS022, section 5.4).
        let status = ll!(self.ll().sys_status().read())?;
        let late = status.hpdwarn() == 1 || status.txpute() == 1;
        if late {
            self.switch_off()?;
        }
        Ok(!late)
    }

    /// Switches the receiver on.
    pub(crate) fn listen(&mut self, timeout_us: Option<u32>) -> Result<(), RadioError> {
        if let Some(us) = timeout_us {
            // One count is 1.026 us, and what 0 means is not said (7.2.14).
            // Reply times are bounded so that their time-outs fit.
            let counts = (u64::from(us) * 39 / 40).clamp(1, 0xFFFF) as u16;
            let [low, high] = counts.to_le_bytes();
            self.write_raw(&[header::WRITE_RX_FWTO, low, high])?;
        }
        self.write_sys_cfg(timeout_us.is_some())?;
        ll!(self.ll().sys_ctrl().write(|w| w.rxenab(1)))
    }

    /// Switches transmitter and receiver off and forgets what they did.
    pub(crate) fn switch_off(&mut self) -> Result<(), RadioError> {
        ll!(self.ll().sys_ctrl().write(|w| w.trxoff(1)))?;
        self.clear_status()
    }

    /// What has happened since the last call, one event at a time.
    pub(crate) fn poll<'b>(
        &mut self,
        buffer: &'b mut RxBuffer,
    ) -> Result<Option<RadioEvent<'b>>, RadioError> {
        let status = ll!(self.ll().sys_status().read())?;
        // The radio's address filter is off: only a bus that nobody drives
        // reads like this.
        if status.affrej() == 1 {
            return Err(RadioError::SettingsLost);
        }
        if status.txfrs() == 1 {
            let stamp = ll!(self.ll().tx_time().read())?.tx_stamp();
            self.clear_status()?;
            let at = DeviceTime::from_ticks(stamp);
            return Ok(Some(RadioEvent::Sent { at }));
        }
        let good = status.rxfcg() == 1;
        if good && self.is_stamped(status.ldedone() == 1, status.ldeerr() == 1)? {
            return self.take_frame(buffer).map(Some);
        }
        let damaged = good
            || status.rxphe() == 1
            || status.rxfce() == 1
            || status.rxrfsl() == 1
            || status.rxsfdto() == 1;
        if damaged || status.rxrfto() == 1 {
            self.switch_off()?;
            // Without it, time stamps of later frames can be wrong (4.1.6).
            self.reset_receiver()?;
            return Ok(Some(if damaged {
                RadioEvent::Damaged
            } else {
                RadioEvent::ListenTimeout
            }));
        }
        Ok(None)
    }

    /// Whether the radio still is as it was set up. Reads the interrupt mask,
    /// which is neither all zeros, as after a reset, nor all ones.
    pub(crate) fn check_settings(&mut self) -> Result<(), RadioError> {
        let mask = ll!(self.ll().sys_mask().read())?;
        if mask.mrxfcg() == 1 && mask.mtxfrs() == 1 && mask.maffrej() == 0 {
            Ok(())
        } else {
            Err(RadioError::SettingsLost)
        }
    }

    /// The radio's clock now.
    pub(crate) fn now(&mut self) -> Result<DeviceTime, RadioError> {
        let ticks = ll!(self.ll().sys_time().read())?.value();
        Ok(DeviceTime::from_ticks(ticks))
    }

    /// How well the last frame was received. Valid until the next one comes.
    pub(crate) fn reception(&mut self) -> Result<Reception, RadioError> {
        let info = ll!(self.ll().rx_finfo().read())?;
        let quality = ll!(self.ll().rx_fqual().read())?;
        let time = ll!(self.ll().rx_time().read())?;
        let unsaturated = ll!(self.ll().rxpacc_nosat().read())?;
        Ok(Reception {
            first_path_amplitudes: [time.fp_ampl1(), quality.fp_ampl2(), quality.fp_ampl3()],
            response_power: quality.cir_pwr(),
            preamble_count: info.rxpacc(),
            preamble_count_unsaturated: unsaturated.value(),
        })
    }

    /// Whether the leading-edge search has given the frame a time stamp.
    fn is_stamped(&mut self, mut done: bool, mut failed: bool) -> Result<bool, RadioError> {
        for _ in 0..STAMP_TRIES {
            if done || failed {
                break;
            }
            let status = ll!(self.ll().sys_status().read())?;
            (done, failed) = (status.ldedone() == 1, status.ldeerr() == 1);
        }
        Ok(done && !failed)
    }

    fn take_frame<'b>(&mut self, buffer: &'b mut RxBuffer) -> Result<RadioEvent<'b>, RadioError> {
        let info = ll!(self.ll().rx_finfo().read())?;
        let stamp = ll!(self.ll().rx_time().read())?.rx_stamp();
        let len = usize::from(info.rxflen().saturating_sub(FCS_LEN)).min(RX_BUFFER_LEN);
        let transfer = buffer.get_mut(..=len).ok_or(RadioError::Bus)?;
        if let Some(first) = transfer.first_mut() {
            *first = header::READ_RX_BUFFER;
        }
        // A header without data would be one byte, which the nRF52832 must not
        // transfer (its anomaly 58).
        if len > 0 {
            self.bus
                .transfer_in_place(transfer)
                .map_err(|_| RadioError::Bus)?;
        }
        self.clear_status()?;
        let bytes = buffer.get(1..=len).ok_or(RadioError::Bus)?;
        let at = DeviceTime::from_ticks(stamp);
        Ok(RadioEvent::Received { bytes, at })
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

    fn check_identity(&mut self) -> Result<(), RadioError> {
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
    /// code for the leading-edge search into place.
    fn load_from_otp(&mut self) -> Result<(), RadioError> {
        // Reading the memory wants the crystal's clock (7.2.50.1, SYSCLKS),
        // loading the code this very value (2.5.5.10, table 4).
        ll!(self.ll().pmsc_ctrl0().write(|w| w.raw_value(0xF030_0301)))?;
        let ldo_low = self.read_otp(0x004)?;
        if ldo_low & 0xFF != 0 {
            let ldo_high = self.read_otp(0x005)?;
            let tune = u64::from(ldo_low) | u64::from(ldo_high & 0xFF) << 32;
            ll!(self.ll().ldotune().write(|w| w.value(tune)))?;
        }
        // 0 means never trimmed (8.1); after a reset the trim is 0 too, which
        // is the end of its range.
        let trim = match (self.read_otp(0x01E)? & 0x1F) as u8 {
            0 => MID_RANGE_TRIM,
            trim => trim,
        };
        let [register, sub] = header::WRITE_FS_XTALT;
        self.write_raw(&[register, sub, 0x60 | trim])?;
        ll!(self.ll().otp_ctrl().write(|w| w.ldeload(1)))?;
        self.delay.delay_us(150);
        ll!(self.ll().pmsc_ctrl0().write(|w| w.raw_value(0xF030_0200)))
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

    fn configure(&mut self) -> Result<(), RadioError> {
        let AntennaDelay { tx_ticks, rx_ticks } = self.antenna_delay;
        self.write_sys_cfg(false)?;
        let [register, sub] = header::WRITE_AGC_TUNE3;
        let [low, high] = phy::AGC_TUNE3.to_le_bytes();
        self.write_raw(&[register, sub, low, high])?;
        let mut ll = self.ll();
        ll!(ll.chan_ctrl().write(|w| {
            w.tx_chan(phy::CHANNEL)
                .rx_chan(phy::CHANNEL)
                .rxprf(phy::PRF_64_MHZ)
                .tx_pcode(phy::PREAMBLE_CODE)
                .rx_pcode(phy::PREAMBLE_CODE)
        }))?;
        ll!(ll.agc_tune1().write(|w| w.value(phy::AGC_TUNE1)))?;
        ll!(ll.agc_tune2().write(|w| w.value(phy::AGC_TUNE2)))?;
        ll!(ll.drx_tune0b().write(|w| w.value(phy::DRX_TUNE0B)))?;
        ll!(ll.drx_tune1a().write(|w| w.value(phy::DRX_TUNE1A)))?;
        ll!(ll.drx_tune1b().write(|w| w.value(phy::DRX_TUNE1B)))?;
        ll!(ll.drx_tune2().write(|w| w.value(phy::DRX_TUNE2)))?;
        ll!(ll.drx_tune4h().write(|w| w.value(phy::DRX_TUNE4H)))?;
        ll!(ll.drx_sfdtoc().write(|w| w.count(phy::DRX_SFDTOC)))?;
        ll!(ll.rf_rxctrlh().write(|w| w.value(phy::RF_RXCTRLH)))?;
        ll!(ll.rf_txctrl().write(|w| w.value(phy::RF_TXCTRL)))?;
        ll!(ll.tc_pgdelay().write(|w| w.value(phy::TC_PGDELAY)))?;
        ll!(ll.fs_pllcfg().write(|w| w.value(phy::FS_PLLCFG)))?;
        ll!(ll.fs_plltune().write(|w| w.value(phy::FS_PLLTUNE)))?;
        ll!(ll.tx_power().write(|w| w.value(phy::TX_POWER)))?;
        ll!(ll
            .lde_cfg1()
            .write(|w| w.ntm(phy::LDE_NTM).pmult(phy::LDE_PMULT)))?;
        ll!(ll.lde_cfg2().write(|w| w.value(phy::LDE_CFG2)))?;
        ll!(ll.lde_repc().write(|w| w.value(phy::LDE_REPC)))?;
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

    /// SYS_CFG: interrupt line active high, single receive buffer, and whether
    /// RX_FWTO ends a reception. Frames are told apart by the state machines,
    /// not by the radio's filter.
    fn write_sys_cfg(&mut self, timeout: bool) -> Result<(), RadioError> {
        ll!(self
            .ll()
            .sys_cfg()
            .write(|w| w.hirq_pol(1).dis_drxb(1).rxwtoe(timeout.into())))
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

    /// Soft reset of the receiver only (7.2.50.1).
    fn reset_receiver(&mut self) -> Result<(), RadioError> {
        ll!(self.ll().pmsc_ctrl0().modify(|_, w| w.softreset(0b1110)))?;
        ll!(self.ll().pmsc_ctrl0().modify(|_, w| w.softreset(0b1111)))
    }

    /// Clears all events of transmitter and receiver. HPDWARN, TXPUTE and
    /// RXOVRR are read-only and end with their cause (7.2.17).
    fn clear_status(&mut self) -> Result<(), RadioError> {
        ll!(self.ll().sys_status().write(|w| {
            w.aat(1)
                .txfrb(1)
                .txprs(1)
                .txphs(1)
                .txfrs(1)
                .rxprd(1)
                .rxsfdd(1)
                .ldedone(1)
                .rxphd(1)
                .rxphe(1)
                .rxdfr(1)
                .rxfcg(1)
                .rxfce(1)
                .rxrfsl(1)
                .rxrfto(1)
                .ldeerr(1)
                .rxpto(1)
                .rxsfdto(1)
                .txberr(1)
                .affrej(1)
                .rxprej(1)
        }))
    }

    fn write_tx_buffer(&mut self, frame: &[u8]) -> Result<(), RadioError> {
        let mut bytes: heapless::Vec<u8, { nova_ranging::frame::MAX_FRAME_LEN + 1 }> =
            heapless::Vec::new();
        bytes
            .push(header::WRITE_TX_BUFFER)
            .map_err(|_| RadioError::Bus)?;
        bytes
            .extend_from_slice(frame)
            .map_err(|_| RadioError::Bus)?;
        self.write_raw(&bytes)
    }

    fn write_raw(&mut self, bytes: &[u8]) -> Result<(), RadioError> {
        self.bus.write(bytes).map_err(|_| RadioError::Bus)
    }

    fn ll(&mut self) -> ll::DW1000<Legacy<'_, B>, NoPin> {
        ll::DW1000::new(Legacy(&mut self.bus), NoPin)
    }
}
