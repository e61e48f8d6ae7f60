//! `cargo xtask emulate`: a scenario on emulated boards, and what they did.

mod host;
mod report;

use anyhow::{Context as _, Error, Result, bail};
use clap::Parser;
use host::Host;
use nova_emulator::gdb::Ended;
use nova_emulator::{Board, Image};
use nova_hal_sim::Motion;
use nova_hal_sim::chip::ChipConfig;
use nova_tests::{EmulatedNetwork, FIRMWARE_VARIABLE, Firmware, Scenario, VendorResponder};
use report::Report;
use std::collections::BTreeMap;
use std::io::Write as _;
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Whoever reads our output, `head` for instance, has had enough.
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    let io = error.downcast_ref::<std::io::Error>();
    io.is_some_and(|io| io.kind() == std::io::ErrorKind::BrokenPipe)
}

const EXAMPLES: &str = "\
Examples:
  cargo xtask emulate --scenario tests/scenarios/a-pair-at-rest.toml
  cargo xtask emulate --scenario FILE --seconds 2 --json
  cargo xtask emulate --scenario FILE --seconds 60 --uart tcp://127.0.0.1:7000 --board anchor
  cargo xtask emulate --scenario FILE --gdb 127.0.0.1:3333 --board tag
  cargo xtask emulate --scenario FILE --seconds 6 --elf anchor=their.axf

docs/emulator.md tells what is modelled, and how to run firmware by others.";

/// Play a scenario on emulated boards that run the firmware, and say what they did.
#[derive(Parser)]
#[command(name = "emulate", bin_name = "cargo xtask emulate", after_help = EXAMPLES)]
struct Arguments {
    /// Who is where and what goes wrong: a file as in tests/scenarios
    #[arg(long, value_name = "FILE")]
    scenario: PathBuf,
    /// How long, in emulated seconds; as the scenario says and with its expectations if absent
    #[arg(long, value_name = "S", value_parser = duration)]
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
    #[arg(long, value_name = "NAME=FILE", value_parser = foreign)]
    elf: Vec<(String, Image)>,
    /// Add a radio that answers the vendor's single-sided ranging example, so many metres along the x axis
    #[arg(long, value_name = "X_M")]
    vendor_responder: Option<f64>,
}

fn duration(text: &str) -> Result<f64, String> {
    let seconds = text.parse().map_err(|_| "no number".to_owned())?;
    if f64::is_finite(seconds) && seconds > 0.0 {
        Ok(seconds)
    } else {
        Err("no time above zero".to_owned())
    }
}

fn foreign(text: &str) -> Result<(String, Image), String> {
    let (name, path) = text.split_once('=').ok_or("not NAME=FILE")?;
    let at = |error: String| format!("{path}: {error}");
    let bytes = std::fs::read(path).map_err(|error| at(error.to_string()))?;
    let image = Image::parse(&bytes).map_err(|error| at(error.to_string()))?;
    Ok((name.to_owned(), image))
}

fn run(arguments: &Arguments) -> Result<()> {
    let path = arguments.scenario.display();
    let toml = std::fs::read_to_string(&arguments.scenario).with_context(|| path.to_string())?;
    let scenario = Scenario::parse(&toml)
        .map_err(Error::msg)
        .with_context(|| path.to_string())?;
    let firmware = Firmware::from_environment()
        .with_context(|| {
            format!("{FIRMWARE_VARIABLE} does not name the folder of the binaries: `cargo xtask emulate` sets it")
        })?
        .map_err(Error::msg)?;
    let foreign: BTreeMap<String, Image> = arguments.elf.iter().cloned().collect();
    if let Some(name) = foreign
        .keys()
        .find(|&name| !scenario.board.iter().any(|board| board.name == *name))
    {
        bail!("--elf {name}: {path} has no board of that name");
    }
    let mut network = scenario.emulate(&firmware, &foreign).map_err(Error::msg)?;
    if let Some(x_m) = arguments.vendor_responder {
        let chip = ChipConfig {
            motion: Motion::fixed([x_m, 0.0, 0.0]),
            ..ChipConfig::default()
        };
        let responder = Box::new(VendorResponder::default());
        network.emulation().add_peer(chip, responder);
    }
    let seconds = arguments.seconds.unwrap_or(scenario.duration_s);
    let board = arguments.board.as_deref();
    let mut host = match &arguments.uart {
        Some(place) => Some(Host::at(place, board, &mut network)?),
        None => None,
    };
    let start = Instant::now();
    let mut t_s = 0.0;
    let mut ended = None;
    if let Some(place) = &arguments.gdb {
        ended = Some(debug(place, board, &mut network, seconds)?);
        t_s = network.emulation().now().as_s_f64();
    }
    while t_s < seconds && ended != Some(Ended::Killed) {
        // In steps, so that a host gets its bytes while they are new.
        t_s = (t_s + STEP_S).min(seconds);
        network.run_until_s(t_s)?;
        if let Some(host) = &mut host {
            host.serve(&mut network)?;
        }
    }
    let report = Report {
        emulated_s: t_s.min(seconds),
        wall_s: start.elapsed().as_secs_f64(),
    };
    let mut out = std::io::stdout().lock();
    if arguments.json {
        writeln!(out, "{:#}", report.to_json(&mut network))?;
    } else {
        report.print(&mut network, arguments.log, &mut out)?;
        for name in foreign.keys() {
            let said = network.log(name).map(|log| log.bytes.as_slice());
            let said = String::from_utf8_lossy(said.unwrap_or_default());
            writeln!(out, "\n{name} said:\n{said}")?;
        }
    }
    if arguments.seconds.is_none() && host.is_none() && ended.is_none() {
        scenario.check_emulated(&network).map_err(Error::msg)?;
    }
    Ok(())
}

const STEP_S: f64 = 0.01;

/// The board of this name, or the first.
fn choose_board(name: Option<&str>, network: &mut EmulatedNetwork) -> Result<String> {
    let boards = network.emulation().boards();
    let names: Vec<&str> = boards.iter().map(Board::name).collect();
    match name {
        Some(name) if names.contains(&name) => Ok(name.to_owned()),
        Some(name) => bail!("there is no board called {name}: {names:?}"),
        None => Ok(names.first().context("no boards")?.to_string()),
    }
}

/// Waits at `place` for GDB and lets it step through a board.
fn debug(
    place: &str,
    board: Option<&str>,
    network: &mut EmulatedNetwork,
    seconds: f64,
) -> Result<Ended> {
    let board = choose_board(board, network)?;
    let listener = TcpListener::bind(place).with_context(|| place.to_owned())?;
    let address = listener.local_addr()?;
    eprintln!("{board} stands still: target remote {address}");
    let (gdb, _) = listener.accept().with_context(|| place.to_owned())?;
    Ok(network.debug(&board, gdb, seconds)?)
}
