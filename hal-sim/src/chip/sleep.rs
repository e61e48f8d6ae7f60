//! SLEEP, DEEPSLEEP and the always-on (AON) memory (User Manual 2.3.2, 2.4.1, 7.2.45).
//!
//! ```text
//!        AON_CTRL SAVE or UPL_CFG,           chip select low for cs_hold (WAKE_SPI)
//!        SLEEP_EN set                        or the sleep counter (WAKE_CNT)       wake_up
//!  Idle ────────────────────────> Asleep ───────────────────────────────> WakeUp ─────────> Init ──> Idle
//!                                                                         crystal starts    SLP2INIT  CPLOCK
//! ```
//!
//! Asleep, the chip drives nothing: SPI reads 0xFF, IRQ is low. It keeps the AON memory and nothing else. Waking, all
//! registers have their reset values and the time base starts anew; then AON_WCFG says what is put back: the registers
//! that SAVE copied (ONW_LDC), the EUI (ONW_LEUI), LDOTUNE (ONW_LLDO), the microcode of the leading edge search
//! (ONW_LLDE).
//!
//! **What SAVE keeps**: the configuration that transmitter and receiver need ([`KEPT`]). Not kept: TX_ANTD, whose low octet
//! ONW_LDC even overwrites with the high octet of LDE_RXANTD (7.2.26); the PMSC's registers (drivers found GPDCE
//! lost); counters, buffers, time stamps. Whether FS_XTALT and EC_CTRL come back we have found nowhere: here they do
//! not, so that a driver that relies on them fails.
//!
//! Not modelled: the WAKEUP pin, ONW_RX, ONW_RADC, ONW_L64P, sleeping after a frame (ATXSLP, ARXSLP), direct access to the
//! AON memory, the duration of SAVE.

use crate::time::{SimDuration, SimTime};

use super::bits::{aon, file, sub};
use super::power::{PowerEvent, PowerState};
use super::{Chip, RegisterFile};

/// Register files that SAVE copies.
const KEPT: [u8; 16] = [
    file::PANADR,
    file::SYS_CFG,
    file::TX_FCTRL,
    file::RX_FWTO,
    file::SYS_MASK,
    file::ACK_RESP_T,
    0x1D, // RX_SNIFF
    file::TX_POWER,
    file::CHAN_CTRL,
    file::USR_SFD,
    0x23, // AGC_CTRL
    file::DRX_CONF,
    file::RF_CONF,
    0x2A, // TX_CAL
    file::FS_CTRL,
    file::LDE_IF,
];

/// Cycles of the low-power oscillator that one unit of SLEEP_TIM stands for (7.2.45.5).
const CYCLES_PER_COUNT: u64 = 4_096;
/// The oscillator's frequency: 7 to 13 kHz from chip to chip.
const LOW_POWER_HZ: u64 = 10_000;

/// What outlives sleep.
#[derive(Debug, Default)]
pub(super) struct Aon {
    /// AON_WCFG, AON_CFG0 and AON_CFG1 as they were uploaded.
    wake: u16,
    config0: u32,
    config1: u16,
    saved: Option<RegisterFile>,
    /// Chip select is low; how often it went so.
    selected: bool,
    selections: u32,
}

impl Chip {
    /// AON_CTRL was written (7.2.45.2).
    pub(super) fn on_aon_ctrl(&mut self, now: SimTime) {
        let ctrl = self.registers.u8(file::AON, sub::AON_CTRL);
        if ctrl & aon::RESTORE != 0 {
            self.restore_saved();
        }
        if ctrl & aon::SAVE != 0 {
            self.aon.saved = Some(self.registers.clone());
        }
        // SAVE uploads the block's own configuration too, and clears itself when it is done, as RESTORE does.
        let upload = ctrl & (aon::SAVE | aon::UPL_CFG) != 0;
        let kept = ctrl & !(aon::SAVE | aon::RESTORE);
        self.registers.set(file::AON, sub::AON_CTRL, &[kept]);
        if upload {
            self.aon.wake = self.registers.u16(file::AON, sub::AON_WCFG);
            self.aon.config0 = self.registers.u32(file::AON, sub::AON_CFG0);
            self.aon.config1 = self.registers.u16(file::AON, sub::AON_CFG1);
            if self.aon.config0 & aon::SLEEP_EN != 0 {
                self.fall_asleep(now);
            }
        }
    }

    fn fall_asleep(&mut self, now: SimTime) {
        self.stats.sleeps += 1;
        self.clear_all();
        self.aon.selected = false;
        let counts =
            self.aon.config0 & aon::WAKE_CNT != 0 && self.aon.config1 & aon::SLEEP_CEN != 0;
        self.power.state = if counts {
            PowerState::Sleep
        } else {
            PowerState::DeepSleep
        };
        if counts {
            let cycles = u64::from(self.aon.config0 >> 16) * CYCLES_PER_COUNT;
            let at = now + SimDuration::from_s_f64(cycles as f64 / LOW_POWER_HZ as f64);
            self.ask_power(at, PowerEvent::Wake);
        }
    }

    /// Chip select went low or high.
    pub(super) fn on_chip_select(&mut self, now: SimTime, low: bool) {
        self.aon.selected = low;
        self.aon.selections += u32::from(low);
        if low && self.is_asleep() && self.aon.config0 & aon::WAKE_SPI != 0 {
            let at = now + self.timing.wake_cs_hold;
            self.ask_power(at, PowerEvent::Held(self.aon.selections));
        }
    }

    pub(super) fn on_held(&mut self, now: SimTime, selection: u32) {
        if self.aon.selected && self.aon.selections == selection {
            self.wake(now);
        }
    }

    pub(super) fn wake(&mut self, now: SimTime) {
        // The vendor's driver: SMXX has to be cleared for the sleep states to work (7.2.45.6).
        if !self.is_asleep() || self.aon.config1 & aon::SMXX != 0 {
            return;
        }
        self.power.state = PowerState::WakeUp;
        let at = now + self.timing.wake_up;
        self.ask_power(at, PowerEvent::Init);
    }

    pub(super) fn is_asleep(&self) -> bool {
        matches!(self.power.state, PowerState::Sleep | PowerState::DeepSleep)
    }

    /// What AON_WCFG asks for, on the way from WAKEUP to INIT.
    pub(super) fn load_on_wake(&mut self) {
        let wants = |bit| self.aon.wake & bit != 0;
        let (config, ldo, microcode) = (
            wants(aon::ONW_LDC),
            wants(aon::ONW_LLDO),
            wants(aon::ONW_LLDE),
        );
        if config {
            self.restore_saved();
        }
        let wcfg = self.aon.wake.to_le_bytes();
        self.registers.set(file::AON, sub::AON_WCFG, &wcfg);
        let config0 = self.aon.config0.to_le_bytes();
        self.registers.set(file::AON, sub::AON_CFG0, &config0);
        let config1 = self.aon.config1.to_le_bytes();
        self.registers.set(file::AON, sub::AON_CFG1, &config1);
        if ldo {
            let tune = self.otp.ldo_tune.to_le_bytes();
            self.registers.set(file::RF_CONF, sub::LDOTUNE, &tune[..5]);
        }
        self.power.lde_loaded = microcode;
    }

    pub(super) fn loads_eui_on_wake(&self) -> bool {
        self.aon.wake & aon::ONW_LEUI != 0
    }

    /// Copies what SAVE kept back.
    fn restore_saved(&mut self) {
        let Some(saved) = self.aon.saved.take() else {
            return;
        };
        let fresh = RegisterFile::new();
        for id in KEPT {
            self.registers.copy_file(&saved, id);
        }
        let lost = [
            (file::FS_CTRL, sub::FS_XTALT, 1),
            (file::RF_CONF, sub::LDOTUNE, 5),
        ];
        for (id, offset, len) in lost {
            let reset = fresh.number(id, offset, len).to_le_bytes();
            self.registers.set(id, offset, &reset[..len]);
        }
        let [_, high] = saved.u16(file::LDE_IF, sub::LDE_RXANTD).to_le_bytes();
        self.registers.set(file::TX_ANTD, 0, &[high]);
        self.aon.saved = Some(saved);
    }
}
