//! What the terminal shows while work goes on.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::Duration;

/// A progress bar on standard error with a total of `total` steps; invisible
/// when `quiet` or when nobody looks.
pub(crate) fn progress(total: u64, quiet: bool) -> ProgressBar {
    let bar = ProgressBar::new(total);
    if quiet {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    // The template is constant; should it not parse, the default does.
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos:>4}/{len} {msg}") {
        bar.set_style(style);
    }
    bar
}

/// Something that turns on standard error, with a message, while one waits for what has no known
/// end; invisible when `quiet` or when nobody looks.
pub(crate) fn spinner(quiet: bool) -> ProgressBar {
    const TURN: Duration = Duration::from_millis(100);
    if quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(TURN);
    bar
}
