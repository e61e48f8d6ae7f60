//! Resets a board whose radio loop hangs, or whose radio cannot be brought to work.

use embassy_nrf::Peri;
use embassy_nrf::peripherals::WDT;
use embassy_nrf::wdt::{self, HaltConfig, SleepConfig, WatchdogHandle};

/// Longest time between two feeds, in milliseconds: a node that hangs ranges again within two seconds. The radio loop
/// passes four times a second, and a radio that is restarted keeps it from feeding for half a second.
const TIMEOUT_MS: u32 = 1_750;

/// The watchdog's clock, in Hz (nRF52832 product specification, chapter 35).
const TICKS_PER_S: u32 = 32_768;

/// The running watchdog.
pub(crate) struct Watchdog {
    handle: WatchdogHandle,
}

impl Watchdog {
    /// Starts it. It cannot be stopped again, and stands still only while a debugger halts the CPU.
    pub(crate) fn start(peripheral: Peri<'static, WDT>) -> Self {
        let mut config = wdt::Config::default();
        config.timeout_ticks = TIMEOUT_MS * TICKS_PER_S / 1_000;
        config.action_during_sleep = SleepConfig::Run;
        config.action_during_debug_halt = HaltConfig::Pause;
        match wdt::Watchdog::try_new(peripheral, config) {
            Ok((_, [handle])) => Self { handle },
            Err(_) => {
                // Another program's watchdog still runs, with other settings, and cannot be changed.
                // It resets the board when nobody feeds it, and is gone then.
                defmt::warn!("a watchdog with other settings runs: waiting for its reset");
                loop {
                    cortex_m::asm::wfe();
                }
            }
        }
    }

    /// To be called by the radio loop after each pass that got through with a radio that works, and by
    /// nobody else: a feed from a timer or another task would hide a radio that hangs.
    pub(crate) fn feed(&mut self) {
        self.handle.pet();
    }
}
