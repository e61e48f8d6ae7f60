//! Ctrl-C as a wish to end in order.

use anyhow::{Context, Result};
use std::sync::atomic::{AtomicBool, Ordering};

/// Set by Ctrl-C: the stream ends here, and what is said at its end is due.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Lets Ctrl-C end a live stream in order. A second one ends the program at once.
pub(crate) fn catch() -> Result<()> {
    const INTERRUPT_STATUS: i32 = 130;
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPT_STATUS);
        }
    })
    .context("Ctrl-C cannot be caught")
}

/// Whether there was one.
pub(crate) fn caught() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}
