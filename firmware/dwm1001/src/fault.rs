//! Panics and faults: say why, then start afresh. A node in the field has nobody to press its button.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use embassy_nrf::pac;
use nova_wire::ResetCause;

/// CPU cycles from the last log line to the reset, 50 ms at 64 MHz: an attached debugger reads the
/// log from RAM in that time.
const LOG_GRACE_CYCLES: u32 = 3_200_000;

/// Set by the first panic. A panic while logging must not log again: the logger
/// would panic at that, and so on.
static PANICKED: AtomicBool = AtomicBool::new(false);

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    // Interrupts are off, so nothing comes between load and store.
    if !PANICKED.load(Ordering::Relaxed) {
        PANICKED.store(true, Ordering::Relaxed);
        defmt::error!("panic: {}", defmt::Display2Format(info));
    }
    reset()
}

/// Bus errors and undefined instructions. A stack overflow comes here or ends in a lock-up, which resets
/// the chip as well; without flip-link it goes unnoticed.
#[allow(unsafe_code)]
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    // SAFETY: reading a status register has no side effect; nothing else runs any more.
    let cfsr = unsafe { (*SCB::PTR).cfsr.read() };
    defmt::error!(
        "hard fault at {=u32:#010x}, called from {=u32:#010x}, CFSR {=u32:#010x}",
        frame.pc(),
        frame.lr(),
        cfsr
    );
    reset()
}

/// `defmt::panic!` and the like have said why already.
#[defmt::panic_handler]
fn defmt_panic() -> ! {
    reset()
}

/// Gives up: logs why, and starts afresh.
pub(crate) fn restart(why: &str) -> ! {
    defmt::error!("{=str}: restarting", why);
    reset()
}

fn reset() -> ! {
    cortex_m::asm::delay(LOG_GRACE_CYCLES);
    SCB::sys_reset()
}

/// Why the board started. Clears the record of it, which otherwise adds up over resets
/// (nRF52832 product specification 18.8, RESETREAS).
pub(crate) fn take_reset_cause() -> ResetCause {
    let reasons = pac::POWER.resetreas().read();
    pac::POWER.resetreas().write_value(reasons);
    if reasons.dog() {
        ResetCause::Watchdog
    } else if reasons.lockup() {
        ResetCause::Lockup
    } else if reasons.sreq() {
        ResetCause::Software
    } else if reasons.resetpin() {
        ResetCause::Pin
    } else {
        ResetCause::PowerOn
    }
}
