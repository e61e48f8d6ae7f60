//! Panics and faults: say why, now and after the restart, and start afresh. A node in the field has nobody to
//! press its button, and nobody who reads its log.

use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use embassy_nrf::pac;
use nova_wire::{Crash, CrashKind, ResetCause, Text};

use crate::crash::{NOTE_WORDS, Note};

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
        if let Some(place) = info.location() {
            leave(Note::new(PANIC, place.line(), place.file()));
        }
        defmt::error!("panic: {}", defmt::Display2Format(info));
    }
    reset()
}

/// Bus errors and undefined instructions. A stack overflow comes here or ends in a lock-up, which resets
/// the chip as well; linked without flip-link, which `cargo xtask` takes, it goes unnoticed.
#[allow(unsafe_code)]
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    // SAFETY: reading a status register has no side effect; nothing else runs any more.
    let cfsr = unsafe { (*SCB::PTR).cfsr.read() };
    leave(Note::new(HARD_FAULT, frame.pc(), ""));
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
    leave(Note::new(GAVE_UP, 0, why));
    defmt::error!("{=str}: restarting", why);
    reset()
}

/// Starts afresh because the host wants it.
pub(crate) fn reboot() -> ! {
    defmt::info!("restarting on command");
    reset()
}

fn reset() -> ! {
    cortex_m::asm::delay(LOG_GRACE_CYCLES);
    SCB::sys_reset()
}

/// A note's kinds.
const PANIC: u32 = 1;
const HARD_FAULT: u32 = 2;
const GAVE_UP: u32 = 3;

/// Not initialised at a start: what the program before has left.
#[allow(unsafe_code)]
#[unsafe(link_section = ".uninit.NOVA_NOTE")]
static mut NOTE: MaybeUninit<[u32; NOTE_WORDS]> = MaybeUninit::uninit();

#[allow(unsafe_code)]
fn leave(note: Note) {
    // SAFETY: written only at the start and by a program that ends; volatile, because nobody reads it in this one.
    unsafe { ptr::write_volatile((&raw mut NOTE).cast(), note.to_words()) }
}

#[allow(unsafe_code)]
fn found() -> Option<Note> {
    // SAFETY: any bits are words, and the hardware has given RAM some; nothing else runs yet.
    Note::from_words(&unsafe { ptr::read_volatile((&raw const NOTE).cast()) })
}

/// Why the board started, and how the program before ended if it crashed. To be called once.
pub(crate) fn take_past() -> (ResetCause, Option<Crash>) {
    let note = found();
    leave(Note::ALIVE);
    let cause = match take_reset_cause() {
        // The hardware has no word for it, but RAM that holds a note has not been without power for long.
        ResetCause::PowerOn if note.is_some() => ResetCause::BrownOut,
        cause => cause,
    };
    let crash = note.and_then(|note| {
        let kind = match note.kind {
            PANIC => CrashKind::Panic,
            HARD_FAULT => CrashKind::HardFault,
            GAVE_UP => CrashKind::GaveUp,
            _ => return None,
        };
        Some(Crash {
            kind,
            at: note.at,
            text: Text::new(note.text()),
        })
    });
    (cause, crash)
}

/// What the hardware knows of why the board started. Clears the record of it, which otherwise adds up over resets
/// (nRF52832 product specification 18.8, RESETREAS).
fn take_reset_cause() -> ResetCause {
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
