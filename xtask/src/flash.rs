//! Writing the firmware to a board through probe-rs.

use std::path::Path;
use std::process::Command;

use anyhow::{Result, bail};

use crate::firmware::{self, Binary};
use crate::process::{display, find_on_path, run as run_command};
use crate::toolchain;

/// The DWM1001's chip, as probe-rs names it.
const CHIP: &str = "nRF52832_xxAA";

const NO_PROBE_RS: &str = "probe-rs is not installed: `cargo install --locked probe-rs-tools`, \
    or a prebuilt one from https://probe.rs/docs/getting-started/installation/";

const NO_PROBE: &str = "no debug probe found: connect the board's USB socket and see `probe-rs list`; \
    on Linux a probe without udev rules stays invisible (https://probe.rs/docs/getting-started/probe-setup/)";

/// `cargo xtask flash`
#[derive(clap::Args)]
pub(crate) struct Args {
    /// What the board shall be
    binary: Binary,
    /// Which probe, when several boards are connected: VID:PID:SERIAL as `probe-rs list` shows it
    #[arg(long, value_name = "PROBE")]
    probe: Option<String>,
    /// Write and start the firmware, but do not stay to show its log
    #[arg(long)]
    detach: bool,
    /// Only show the commands that would run
    #[arg(long)]
    dry_run: bool,
}

/// Builds and flashes.
///
/// # Errors
/// One line each: no probe-rs, no probe, no compiler, a build or a transfer that failed. What can be
/// known before the build is told before it.
pub(crate) fn run(args: &Args) -> Result<()> {
    if args.dry_run {
        let (build, elf) = firmware::describe_build(&toolchain::find_or_install()?, args.binary);
        println!("{build}");
        for command in commands(args, &elf) {
            println!("{}", display(&command));
        }
        return Ok(());
    }
    if find_on_path("probe-rs").is_none() {
        bail!(NO_PROBE_RS);
    }
    ensure_probe(&list_probes()?)?;
    let elf = firmware::build(&toolchain::find_or_install()?, args.binary)?;
    commands(args, &elf).iter_mut().try_for_each(run_command)
}

/// Staying: `run` writes, starts and logs. Otherwise `download` writes and `reset` starts.
fn commands(args: &Args, elf: &Path) -> Vec<Command> {
    let probe_rs = |verb: &str| {
        let mut command = Command::new("probe-rs");
        command.args([verb, "--chip", CHIP]);
        if let Some(probe) = &args.probe {
            command.args(["--probe", probe]);
        }
        command
    };
    if args.detach {
        let mut download = probe_rs("download");
        download.arg(elf);
        vec![download, probe_rs("reset")]
    } else {
        let mut run = probe_rs("run");
        run.arg(elf);
        vec![run]
    }
}

fn list_probes() -> Result<String> {
    crate::process::output(Command::new("probe-rs").arg("list"))
}

/// `probe-rs list` ends well with no probe, too: its words have to be read.
fn ensure_probe(list: &str) -> Result<()> {
    if list.to_lowercase().contains("no debug probes were found") {
        bail!(NO_PROBE);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(args: &Args) -> Vec<String> {
        commands(args, Path::new("target/tag"))
            .iter()
            .map(display)
            .collect()
    }

    fn args(probe: Option<&str>, detach: bool) -> Args {
        Args {
            binary: Binary::Tag,
            probe: probe.map(str::to_owned),
            detach,
            dry_run: false,
        }
    }

    #[test]
    fn flashing_runs_the_binary_on_the_modules_chip() {
        assert_eq!(
            shown(&args(None, false)),
            ["probe-rs run --chip nRF52832_xxAA target/tag"]
        );
    }

    #[test]
    fn one_of_several_boards_can_be_chosen_and_left_alone_afterwards() {
        assert_eq!(
            shown(&args(Some("1366:0105:000760"), true)),
            [
                "probe-rs download --chip nRF52832_xxAA --probe 1366:0105:000760 target/tag",
                "probe-rs reset --chip nRF52832_xxAA --probe 1366:0105:000760",
            ]
        );
    }

    #[test]
    fn a_missing_probe_is_told_in_one_line_that_says_what_to_do() {
        let error = ensure_probe("No debug probes were found.")
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("USB") && error.contains("probe-rs list"),
            "{error}"
        );
        let listed =
            "The following debug probes were found:\n[0]: J-Link -- 1366:0105:000760 (J-Link)";
        assert!(ensure_probe(listed).is_ok());
        for text in [NO_PROBE, NO_PROBE_RS] {
            assert!(
                !text.contains('\n') && !text.contains("  "),
                "one line, no gaps: {text}"
            );
        }
    }
}
