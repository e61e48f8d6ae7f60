//! Reset, crystal, clock PLL, LDE microcode and OTP.
//!
//! ```text
//!            release RST / power on          start_up               pll_lock
//!  Reset ─────────────────────────> StartUp ──────────> Init ────────────────> Idle
//!    ^                                                    ^  fast SPI: Dead      │ soft reset
//!    └── RST low, from anywhere                           └──────────────────────┘
//! ```
//! `Init` and `Idle` are the chip's INIT and IDLE states (User Manual 2.3.2); only there does SPI answer. Sleep: `sleep.rs`.

use crate::clock::DeviceClock;
use crate::time::{SimDuration, SimTime};

use super::bits::{file, otp_ctrl, pmsc, status, sub};
use super::{Aon, Chip, ChipEvent, RegisterFile};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PowerState {
    Reset,
    StartUp,
    DeepSleep,
    Sleep,
    WakeUp,
    Init,
    Idle,
    /// A fast SPI clock hit the chip before its PLL had locked.
    Dead,
}

#[derive(Debug)]
pub(super) struct Power {
    pub(super) state: PowerState,
    pub(super) lde_loaded: bool,
    epoch: u32,
}

impl Default for Power {
    fn default() -> Self {
        Power {
            state: PowerState::Reset,
            lde_loaded: false,
            epoch: 0,
        }
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum PowerEvent {
    Init,
    PllLocked,
    LdeLoaded,
    /// Chip select went low so often, and has been low for long enough to wake the chip if it still is.
    Held(u32),
    /// The sleep counter has elapsed.
    Wake,
}

/// FS_XTALT's five trim bits at mid-range, where [`ClockConfig::ppm`](crate::clock::ClockConfig) holds (the vendor's
/// driver; 8.1 of the manual calls 0x0F the middle).
const XTAL_TRIM_MIDRANGE: u8 = 0x10;

impl Chip {
    /// Drives RST: low holds the chip in reset, releasing it starts the chip up.
    pub(crate) fn set_reset(&mut self, now: SimTime, low: bool) {
        if low {
            self.clear_all();
            self.aon = Aon::default();
            self.power.state = PowerState::Reset;
        } else if self.power.state == PowerState::Reset {
            self.start_up(now);
        }
    }

    pub(super) fn start_up(&mut self, now: SimTime) {
        self.clear_all();
        self.power.state = PowerState::StartUp;
        let at = now + self.timing.start_up;
        self.ask_power(at, PowerEvent::Init);
    }

    fn soft_reset(&mut self, now: SimTime) {
        self.clear_all();
        self.enter_init(now);
    }

    fn enter_init(&mut self, now: SimTime) {
        let woken = self.power.state == PowerState::WakeUp;
        self.power.state = PowerState::Init;
        if woken {
            self.load_on_wake();
        }
        self.restart_clock(now);
        if self.otp.eui != 0 && (!woken || self.loads_eui_on_wake()) {
            let eui = self.otp.eui.to_le_bytes();
            self.registers.set(file::EUI, 0, &eui);
        }
        self.status.raise(status::SLP2INIT);
        let at = now + self.timing.pll_lock;
        self.ask_power(at, PowerEvent::PllLocked);
    }

    /// Everything back to reset values; what was under way ends.
    pub(super) fn clear_all(&mut self) {
        self.abort_transmission();
        self.receiver_off();
        self.power.epoch += 1;
        self.power.lde_loaded = false;
        self.registers = RegisterFile::new();
        self.status.reset();
        self.buffers = super::ReceiveBuffers::default();
        self.receiver.reset();
        self.transaction = None;
    }

    pub(super) fn ask_power(&mut self, at: SimTime, event: PowerEvent) {
        self.ask(at, ChipEvent::Power(self.power.epoch, event));
    }

    pub(super) fn on_power_event(&mut self, now: SimTime, epoch: u32, event: PowerEvent) {
        if epoch != self.power.epoch {
            return;
        }
        match event {
            PowerEvent::Init
                if matches!(self.power.state, PowerState::StartUp | PowerState::WakeUp) =>
            {
                self.enter_init(now);
            }
            PowerEvent::Held(selections) => self.on_held(now, selections),
            PowerEvent::Wake => self.wake(now),
            PowerEvent::PllLocked if self.power.state == PowerState::Init => {
                self.power.state = PowerState::Idle;
                self.status.raise(status::CPLOCK);
            }
            PowerEvent::LdeLoaded => {
                // The load runs from the crystal clock; taking it away early spoils it.
                self.power.lde_loaded = self.lde_clocks_on();
                let ctrl = self.registers.u16(file::OTP_IF, sub::OTP_CTRL) & !otp_ctrl::LDELOAD;
                self.registers
                    .set(file::OTP_IF, sub::OTP_CTRL, &ctrl.to_le_bytes());
            }
            _ => {}
        }
    }

    /// The time base starts at its configured offset with the trim that the register holds.
    fn restart_clock(&mut self, now: SimTime) {
        self.clock = DeviceClock::new(&self.clock_config, now);
        let trim = self.registers.u8(file::FS_CTRL, sub::FS_XTALT);
        self.clock.shift_rate(now, self.trim_ppm(trim));
    }

    fn trim_ppm(&self, register: u8) -> f64 {
        let steps = f64::from(register & 0x1F) - f64::from(XTAL_TRIM_MIDRANGE);
        -steps * self.quirks.xtal_trim_ppm_per_step
    }

    pub(super) fn on_xtal_trim(&mut self, now: SimTime, before: u8) {
        let after = self.registers.u8(file::FS_CTRL, sub::FS_XTALT);
        let change = self.trim_ppm(after) - self.trim_ppm(before);
        if change != 0.0 {
            self.clock.shift_rate(now, change);
        }
    }

    pub(super) fn on_pmsc_ctrl0(&mut self, now: SimTime) {
        let soft = self.pmsc_ctrl0() >> pmsc::SOFTRESET_SHIFT;
        match soft {
            0 => self.soft_reset(now),
            pmsc::SOFTRESET_RX => {
                self.receiver_off();
                self.end_status(status::RXOVRR);
                self.receiver.held_in_reset = true;
                self.receiver.stale = false;
            }
            pmsc::SOFTRESET_NONE => self.receiver.held_in_reset = false,
            // Resets of the other blocks alone are not modelled.
            _ => {}
        }
    }

    fn pmsc_ctrl0(&self) -> u32 {
        self.registers.u32(file::PMSC, sub::PMSC_CTRL0)
    }

    fn lde_clocks_on(&self) -> bool {
        self.pmsc_ctrl0() & pmsc::LDE_LOAD_CLOCKS == pmsc::LDE_LOAD_CLOCKS
    }

    /// Whether the leading edge algorithm runs on receptions (PMSC_CTRL1 LDERUNE).
    pub(super) fn lde_enabled(&self) -> bool {
        self.registers.u32(file::PMSC, sub::PMSC_CTRL1) & pmsc::LDERUNE != 0
    }

    /// The leading edge algorithm is to run but has no code, so that no reception ever ends (2.5.5.10).
    pub(super) fn lde_hangs(&self) -> bool {
        self.lde_enabled() && !self.power.lde_loaded
    }

    /// Only slow SPI is safe: the chip runs from its crystal instead of the PLL.
    pub(super) fn on_crystal_clock(&self) -> bool {
        self.power.state == PowerState::Init
            || (self.power.state == PowerState::Idle
                && self.pmsc_ctrl0() & pmsc::SYSCLKS == pmsc::SYSCLKS_XTI)
    }

    pub(super) fn kill(&mut self) {
        self.clear_all();
        self.power.state = PowerState::Dead;
        self.stats.killed_by_fast_spi += 1;
    }

    pub(super) fn on_otp_ctrl(&mut self, now: SimTime) {
        let ctrl = self.registers.u16(file::OTP_IF, sub::OTP_CTRL);
        if ctrl & otp_ctrl::OTPRDEN != 0 && ctrl & otp_ctrl::OTPREAD != 0 {
            let address = self.registers.u16(file::OTP_IF, sub::OTP_ADDR) & 0x7FF;
            let word = self.otp.word(address).to_le_bytes();
            self.registers.set(file::OTP_IF, sub::OTP_RDAT, &word);
        }
        let loading = ctrl & otp_ctrl::LDELOAD != 0 && self.lde_clocks_on();
        if loading {
            let at = now + self.timing.lde_load;
            self.ask_power(at, PowerEvent::LdeLoaded);
        }
        // OTPREAD and LDELOAD clear themselves when their work is done (7.2.46.3).
        let unfinished = if loading { otp_ctrl::LDELOAD } else { 0 };
        let kept = ctrl & !(otp_ctrl::OTPREAD | otp_ctrl::LDELOAD) | unfinished;
        self.registers
            .set(file::OTP_IF, sub::OTP_CTRL, &kept.to_le_bytes());
    }

    /// `duration` as the device's own clock measures `ticks`.
    pub(super) fn after_ticks(&self, now: SimTime, ticks: u64) -> SimTime {
        let phase = self.clock.phase_at(now).plus_ticks(i128::from(ticks));
        // A clock reading is rounded; never call back before the moment asked for.
        self.clock.time_of(phase).max(now) + SimDuration::from_fs(1)
    }
}
