#![doc = env!("CARGO_PKG_DESCRIPTION")]
//!
//! ```text
//! main ─► checks  (test, ci)  ─► toolchain
//!    ├──► flash ─► firmware ───► toolchain ─► process
//!    ├──► emulate ─► firmware
//!    └──► firmware ─► size
//! ```

mod checks;
mod emulate;
mod firmware;
mod flash;
mod process;
mod size;
mod toolchain;

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

/// Set-up, firmware builds, size budgets, flashing and tests of this workspace.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", arg_required_else_help = true, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  cargo xtask test                      everything that must hold; what CI runs
  cargo xtask firmware                  build both binaries for the board, show their sizes
  cargo xtask firmware --bin tag --json sizes of one, for a script
  cargo xtask emulate --scenario tests/scenarios/a-pair-at-rest.toml
  cargo xtask soak --exchanges 100000   range under injected faults
  cargo flash-tag                       build and flash a tag, then show its log
  cargo xtask flash anchor --dry-run    only show which commands would run

docs/hardware.md tells how to connect a board.";

#[derive(Subcommand)]
enum Command {
    /// Make the compiler able to build for the board; does nothing where it is.
    Setup,
    /// Build the firmware and compare its size with the budgets.
    Firmware(firmware::Args),
    /// Build the firmware, write it to a board through probe-rs and show its log.
    Flash(flash::Args),
    /// Range under faults for as long as wanted; fails if a board hangs or a wrong range passes.
    Soak {
        /// How many exchanges to try.
        #[arg(long, default_value_t = 1_000_000)]
        exchanges: u64,
        /// Everything random follows from this number.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Play a scenario on emulated boards that run the firmware, and say what they did.
    Emulate(emulate::Args),
    /// Run everything that must hold: host tests, both firmware links, size budgets.
    Test,
    /// Run `test` and the lints: formatting, clippy, documentation.
    Ci,
}

fn main() -> ExitCode {
    match run(Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Setup => {
            println!("{}", toolchain::find_or_install()?);
            Ok(())
        }
        Command::Firmware(args) => firmware::run(&args),
        Command::Flash(args) => flash::run(&args),
        Command::Soak { exchanges, seed } => {
            let (exchanges, seed) = (exchanges.to_string(), seed.to_string());
            let soak = [
                "run",
                "--release",
                "-p",
                "nova-tests",
                "--bin",
                "soak",
                "--",
            ];
            process::run(process::cargo().args(soak).args([exchanges, seed]))
        }
        Command::Emulate(args) => emulate::run(&args),
        Command::Test => checks::test(),
        Command::Ci => checks::ci(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn without_arguments_the_help_with_examples_shows() {
        let shown = Cli::try_parse_from(["xtask"]).err().unwrap().to_string();
        assert!(shown.contains("Usage: cargo xtask"), "{shown}");
        assert!(shown.contains("cargo flash-tag"), "{shown}");
    }
}
