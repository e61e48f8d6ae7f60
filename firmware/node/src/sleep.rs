//! The radio asleep: DEEPSLEEP, 50 nA instead of 18 mA (user manual, sections 2.4.1 and 7.2.45).
//!
//! ```text
//!  idle ─► what is to be kept and put back: AON_WCFG, AON_CFG0 ─► AON_CTRL SAVE ─► asleep
//!  asleep ─► chip select low for 600 us ─► 4 ms: crystal, saved registers, microcode ─► what is not saved ─► idle
//! ```
//!
//! The radio's clock starts anew: no time stamp is of use across a sleep.

use crate::bus::{RadioBus, SpiSpeed};
use crate::radio::{Radio, RadioError};
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::Operation;

/// AON_WCFG, register 0x2C:00: what waking puts back (7.2.45.1).
const WRITE_AON_WCFG: [u8; 2] = [0x80 | 0x40 | 0x2C, 0x00];
/// AON_CTRL, register 0x2C:02 (7.2.45.2).
const WRITE_AON_CTRL: [u8; 2] = [0x80 | 0x40 | 0x2C, 0x02];
/// AON_CFG0, register 0x2C:06 (7.2.45.5).
const WRITE_AON_CFG0: [u8; 2] = [0x80 | 0x40 | 0x2C, 0x06];
/// AON_CFG1, register 0x2C:0A (7.2.45.6).
const WRITE_AON_CFG1: [u8; 2] = [0x80 | 0x40 | 0x2C, 0x0A];

/// ONW_LDC, PRES_SLEEP and ONW_LLDE: the saved registers, the sleep configuration itself, the code for the leading-edge
/// search.
const ON_WAKE: u16 = 1 << 6 | 1 << 8 | 1 << 11;
/// ONW_LLDO: LDO tuning from the factory's memory, if there is any.
const ON_WAKE_LDO: u16 = 1 << 12;
/// SLEEP_EN and WAKE_SPI; neither the pin, which the module leaves open, nor the counter.
const SLEEP_UNTIL_SELECTED: u8 = 1 << 0 | 1 << 2;
/// Saves the registers and, with SLEEP_EN, goes to sleep.
const SAVE: u8 = 1 << 1;

/// Chip select has to be low for 500 us (2.3.2).
const SELECT_NS: u32 = 600_000;

impl<B: RadioBus, R: OutputPin, D: DelayNs> Radio<B, R, D> {
    /// Sends an idle radio to sleep. It answers nobody then until [`Radio::wake`].
    pub(crate) fn fall_asleep(&mut self) -> Result<(), RadioError> {
        // With events pending it would not sleep.
        self.switch_off()?;
        let on_wake = ON_WAKE | if self.ldo_tuned { ON_WAKE_LDO } else { 0 };
        let [low, high] = on_wake.to_le_bytes();
        let [register, sub] = WRITE_AON_WCFG;
        self.write_raw(&[register, sub, low, high])?;
        // SMXX and the counter's bits have to be 0.
        let [register, sub] = WRITE_AON_CFG1;
        self.write_raw(&[register, sub, 0, 0])?;
        let [register, sub] = WRITE_AON_CFG0;
        self.write_raw(&[register, sub, SLEEP_UNTIL_SELECTED])?;
        let [register, sub] = WRITE_AON_CTRL;
        self.write_raw(&[register, sub, 0])?;
        self.write_raw(&[register, sub, SAVE])
    }

    /// Begins to wake a radio that sleeps; takes 0.6 ms. It can be used some 4 ms later, after [`Radio::resume`].
    pub(crate) fn wake(&mut self) -> Result<(), RadioError> {
        self.bus.set_speed(SpiSpeed::Slow);
        self.bus
            .transaction(&mut [Operation::DelayNs(SELECT_NS)])
            .map_err(|_| RadioError::Bus)
    }

    /// Puts back what the radio has lost in its sleep.
    ///
    /// # Errors
    /// [`RadioError::WrongDevice`] while it does not answer yet; [`RadioError::SettingsLost`] if what it should have kept
    /// is not there.
    pub(crate) fn resume(&mut self) -> Result<(), RadioError> {
        self.check_identity()?;
        self.detect_clock_lock()?;
        self.trim_crystal()?;
        // Lost; its low octet even overwritten by that of another register (7.2.26).
        let tx_ticks = self.antenna_delay.tx_ticks;
        ll!(self.ll().tx_antd().write(|w| w.value(tx_ticks)))?;
        self.go_fast()
    }
}
