//! Playing scenarios on emulated boards.

use std::ffi::OsString;
use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::firmware;
use crate::process::{cargo, run as run_command};

/// `cargo xtask emulate`
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Who is where and what goes wrong: a file as in tests/scenarios
    #[arg(long, value_name = "FILE")]
    scenario: PathBuf,
    /// How long, in emulated seconds; as the scenario says and with its expectations if absent
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Print what the boards did as JSON
    #[arg(long)]
    json: bool,
    /// Print what the firmware logs
    #[arg(long)]
    log: bool,
    /// Wait there for `nova listen` or `nova config`, and lead it to a board's serial port
    #[arg(long, value_name = "tcp://HOST:PORT")]
    uart: Option<String>,
    /// Wait there for GDB, and let it step through a board
    #[arg(long, value_name = "HOST:PORT", conflicts_with = "uart")]
    gdb: Option<String>,
    /// Whose serial port that is, or which board GDB sees; the first by name if absent
    #[arg(long, value_name = "NAME")]
    board: Option<String>,
    /// Other firmware for a board: an ELF or Intel HEX file for the nRF52832
    #[arg(long, value_name = "NAME=FILE")]
    elf: Vec<String>,
    /// Add a radio that answers the vendor's single-sided ranging example, so many metres along the x axis
    #[arg(long, value_name = "X_M")]
    vendor_responder: Option<f64>,
}

/// Builds the firmware and runs it.
///
/// # Errors
/// When the build fails, a board does what is not modelled, or an expectation of the scenario is not met.
pub(crate) fn run(args: &Args) -> Result<()> {
    let scenario = std::path::absolute(&args.scenario).context("the scenario's path")?;
    let folder = firmware::build_all()?;
    let mut words: Vec<OsString> = vec![scenario.into()];
    let mut option = |name: &str, value: Option<String>| {
        if let Some(value) = value {
            words.extend([OsString::from(name), value.into()]);
        }
    };
    option("--seconds", args.seconds.map(|seconds| seconds.to_string()));
    option("--uart", args.uart.clone());
    option("--gdb", args.gdb.clone());
    option("--board", args.board.clone());
    option(
        "--vendor-responder",
        args.vendor_responder.map(|x_m| x_m.to_string()),
    );
    for elf in &args.elf {
        option("--elf", Some(elf.clone()));
    }
    words.extend(args.json.then(|| "--json".into()));
    words.extend(args.log.then(|| "--log".into()));
    let emulate = [
        "run",
        "--quiet",
        "-p",
        "nova-tests",
        "--bin",
        "emulate",
        "--",
    ];
    run_command(
        cargo()
            .args(emulate)
            .args(words)
            .env(firmware::FOLDER_VARIABLE, folder),
    )
}
