//! The DW1000: configured once, then touched as little as possible.
//!
//! Registers are reached through `dw1000::ll`, those that every frame needs
//! through `access.rs`. The high-level interface of `dw1000` is not used: it sets
//! some twenty registers anew for every frame, accepts frames with a bad check
//! sequence and notices a late transmission only afterwards.
//!
//! While a frame waits for its answer only what the answer needs crosses the bus.
//! Time-outs, diagnostics and the clearing of events come when it is on its way.

mod receive;
#[cfg(test)]
mod tests;
mod transmit;

use crate::access::{self, ctrl, header, status};
use crate::bus::{Legacy, NoPin, RadioBus};
use crate::config::{AntennaDelay, SetAntennaDelay};
use crate::phy;
use dw1000::ll;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use nova_ranging::frame::MAX_FRAME_LEN;
use nova_ranging::time::MODULUS;
use nova_ranging::{DeviceTime, PhyProfile};

/// A DW1000 and the lines to it.
pub(crate) struct Radio<B, R, D> {
    pub(crate) bus: B,
    pub(crate) reset: R,
    pub(crate) delay: D,
    pub(crate) profile: PhyProfile,
    /// What people have set of them.
    pub(crate) set_antenna_delay: SetAntennaDelay,
    /// What the radio was told.
    pub(crate) antenna_delay: AntennaDelay,
    /// SYS_CFG without the bit for the time-out.
    pub(crate) sys_cfg: u32,
    /// TX_FCTRL without the frame's length.
    pub(crate) tx_fctrl: u32,
    pub(crate) set: Set,
    /// What the factory's memory says of the crystal, and whether it holds LDO tuning.
    pub(crate) crystal_trim: u8,
    pub(crate) ldo_tuned: bool,
    /// A frame was taken out of the radio whose events it still shows.
    taken: bool,
    /// RX_FINFO of the frame taken last.
    taken_info: [u8; 4],
    /// Times that the bus was seen to lose bits.
    bus_errors: u32,
}

/// Registers that change from frame to frame, as they are in the radio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Set {
    /// W4R_TIM.
    listen_after: u32,
    /// RX_FWTO.
    timeout: u16,
    /// Whether SYS_CFG lets it end a reception.
    timeout_on: bool,
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

/// Bytes of a received frame that are read: one more than the longest of ours, so that a
/// longer one is still told from it.
const RX_BUFFER_LEN: usize = MAX_FRAME_LEN + 1;

/// Space for a received frame, and the SPI header before it.
pub(crate) type RxBuffer = [u8; RX_BUFFER_LEN + 1];

/// An [`RxBuffer`] to start with.
pub(crate) const EMPTY_RX_BUFFER: RxBuffer = [0; RX_BUFFER_LEN + 1];

/// SYS_STATUS is read this often for the time stamp of a received frame. The
/// radio holds RXDFR, and RXFCG with it, back until the leading-edge search is
/// over (7.2.17, RXDFR), so that no further read is needed as a rule.
const STAMP_TRIES: usize = 10;

/// Length of the frame check sequence that the radio adds and checks.
const FCS_LEN: u8 = 2;

impl<B: RadioBus, R: OutputPin, D: DelayNs> Radio<B, R, D> {
    /// A radio that is not started yet.
    pub(crate) fn new(
        bus: B,
        reset: R,
        delay: D,
        profile: PhyProfile,
        antenna_delay: SetAntennaDelay,
    ) -> Self {
        Self {
            bus,
            reset,
            delay,
            profile,
            set_antenna_delay: antenna_delay,
            antenna_delay: antenna_delay.or(AntennaDelay::UNCALIBRATED),
            sys_cfg: 0,
            tx_fctrl: 0,
            set: Set::default(),
            crystal_trim: 0,
            ldo_tuned: false,
            taken: false,
            taken_info: [0; 4],
            bus_errors: 0,
        }
    }

    /// Another mode and other antenna delays, from the next start on.
    pub(crate) fn set_up_as(&mut self, profile: PhyProfile, antenna_delay: SetAntennaDelay) {
        self.profile = profile;
        self.set_antenna_delay = antenna_delay;
    }

    /// The antenna delays that the radio was told when it was started last.
    pub(crate) fn antenna_delay(&self) -> AntennaDelay {
        self.antenna_delay
    }

    /// Switches the receiver on until the radio's clock shows `until`, or for ever. How
    /// many microseconds that is; `None` if it is over already: the radio stays off then.
    pub(crate) fn listen(&mut self, until: Option<DeviceTime>) -> Result<Option<u32>, RadioError> {
        let left_us = match until {
            None => None,
            Some(until) => {
                let left = until.since(self.now()?);
                // More than half a turn of the clock ahead is behind.
                if left.get() == 0 || left.get() > MODULUS / 2 {
                    self.switch_off()?;
                    return Ok(None);
                }
                Some(left.to_us())
            }
        };
        self.set_timeout(left_us)?;
        self.clear_taken()?;
        self.write_raw(&[header::WRITE_SYS_CTRL, 0, ctrl::RXENAB_1])?;
        Ok(Some(left_us.unwrap_or(u32::MAX)))
    }

    /// Switches transmitter and receiver off and forgets what they did.
    pub(crate) fn switch_off(&mut self) -> Result<(), RadioError> {
        self.write_raw(&[header::WRITE_SYS_CTRL, ctrl::TRXOFF])?;
        self.clear_status()
    }

    /// What has happened since the last call, one event at a time. A frame received
    /// counts as long as it is not followed by [`Radio::send`], [`Radio::listen`] or
    /// [`Radio::switch_off`].
    pub(crate) fn poll<'b>(
        &mut self,
        buffer: &'b mut RxBuffer,
    ) -> Result<Option<RadioEvent<'b>>, RadioError> {
        let now = self.status()?;
        // The radio's address filter is off: only a bus that nobody drives
        // reads like this.
        if now & status::AFFREJ != 0 {
            return Err(RadioError::SettingsLost);
        }
        if now & status::TXFRS != 0 {
            let at = self.sent_at()?;
            // A reception may have begun meanwhile: its events stay.
            self.write_raw(&[header::WRITE_SYS_STATUS, status::TRANSMITTED as u8])?;
            return Ok(Some(RadioEvent::Sent { at }));
        }
        let good = now & status::RXFCG != 0;
        if good && self.is_stamped(now)? {
            return self.take_frame(buffer).map(Some);
        }
        const BROKEN: u32 = status::RXPHE | status::RXFCE | status::RXRFSL | status::RXSFDTO;
        let damaged = good || now & BROKEN != 0;
        if damaged || now & status::RXRFTO != 0 {
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
        // A wrong antenna delay would make every range wrong, and nothing else show it.
        let AntennaDelay { tx_ticks, rx_ticks } = self.antenna_delay;
        let rx = ll!(self.ll().lde_rxantd().read())?.value();
        let tx = ll!(self.ll().tx_antd().read())?.value();
        let set = mask.mrxfcg() == 1 && mask.mtxfrs() == 1 && mask.maffrej() == 0;
        if set && (tx, rx) == (tx_ticks, rx_ticks) {
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

    /// How often the bus was seen to lose bits since this was asked last.
    pub(crate) fn take_bus_errors(&mut self) -> u32 {
        core::mem::take(&mut self.bus_errors)
    }

    /// The low four bytes of SYS_STATUS.
    fn status(&mut self) -> Result<u32, RadioError> {
        let [_, a, b, c, d] = access::read(&mut self.bus, [header::READ_SYS_STATUS, 0, 0, 0, 0])?;
        Ok(u32::from_le_bytes([a, b, c, d]))
    }

    fn stamp_once(&mut self, register: u8) -> Result<DeviceTime, RadioError> {
        let [_, a, b, c, d, e] = access::read(&mut self.bus, [register, 0, 0, 0, 0, 0])?;
        let ticks = u64::from_le_bytes([a, b, c, d, e, 0, 0, 0]);
        Ok(DeviceTime::from_ticks(ticks))
    }

    /// Sets how long the receiver stays on.
    fn set_timeout(&mut self, us: Option<u32>) -> Result<(), RadioError> {
        if let Some(us) = us {
            // What 0 means is not said (7.2.14). Reply times are bounded so that
            // their time-outs fit.
            let counts = timer_counts(us).clamp(1, 0xFFFF) as u16;
            if counts != self.set.timeout {
                let [low, high] = counts.to_le_bytes();
                self.write_raw(&[header::WRITE_RX_FWTO, low, high])?;
                self.set.timeout = counts;
            }
        }
        if us.is_some() != self.set.timeout_on {
            let timeout = if us.is_some() { phy::RXWTOE } else { 0 };
            let [a, b, c, d] = (self.sys_cfg | timeout).to_le_bytes();
            self.write_raw(&[header::WRITE_SYS_CFG, a, b, c, d])?;
            self.set.timeout_on = us.is_some();
        }
        Ok(())
    }

    /// Forgets the events of a frame that was taken, so that they are not taken for
    /// those of the next.
    fn clear_taken(&mut self) -> Result<(), RadioError> {
        if core::mem::take(&mut self.taken) {
            let [a, b, c, d] = status::RECEIVED.to_le_bytes();
            self.write_raw(&[header::WRITE_SYS_STATUS, a, b, c, d])?;
        }
        Ok(())
    }

    /// Clears all events of transmitter and receiver. HPDWARN, TXPUTE and
    /// RXOVRR are read-only and end with their cause (7.2.17).
    pub(crate) fn clear_status(&mut self) -> Result<(), RadioError> {
        self.taken = false;
        let [a, b, c, d] = (status::TRANSMITTED | status::RECEIVED).to_le_bytes();
        self.write_raw(&[header::WRITE_SYS_STATUS, a, b, c, d])
    }

    pub(crate) fn write_raw(&mut self, bytes: &[u8]) -> Result<(), RadioError> {
        access::write(&mut self.bus, bytes)
    }

    pub(crate) fn ll(&mut self) -> ll::DW1000<Legacy<'_, B>, NoPin> {
        ll::DW1000::new(Legacy(&mut self.bus), NoPin)
    }
}

/// Microseconds in the radio's timers' unit of 512/499.2 MHz = 1.0256 us, rounded down.
fn timer_counts(us: u32) -> u32 {
    (u64::from(us) * 39 / 40) as u32
}
