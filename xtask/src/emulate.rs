//! Playing scenarios on emulated boards.

use std::env;
use std::ffi::OsString;

use anyhow::{Context, Result};

use crate::firmware;
use crate::process::{cargo, run as run_command};

/// `cargo xtask emulate`: the program of that name in `tests` knows the options.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Args {
    /// `--scenario FILE` and more: `cargo xtask emulate --help` lists them
    #[arg(
        trailing_var_arg = true,
        allow_hyphen_values = true,
        value_name = "OPTIONS"
    )]
    words: Vec<OsString>,
}

/// Builds the firmware and runs it.
///
/// # Errors
/// When the build fails, a board does what is not modelled, or an expectation of the scenario is not met.
pub(crate) fn run(args: &Args) -> Result<()> {
    let mut command = cargo();
    let emulate = [
        "run",
        "--quiet",
        "-p",
        "nova-tests",
        "--bin",
        "emulate",
        "--",
    ];
    // The files are named as seen from where the caller stands.
    let here = env::current_dir().context("where we are")?;
    command.args(emulate).args(&args.words).current_dir(here);
    let asks_for_help = args
        .words
        .iter()
        .any(|word| word == "--help" || word == "-h");
    if !asks_for_help {
        command.env(firmware::FOLDER_VARIABLE, firmware::build_all()?);
    }
    run_command(&mut command)
}
