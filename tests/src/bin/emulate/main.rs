//! `cargo xtask emulate`: a scenario on emulated boards, and what they did.

mod host;
mod report;

use host::Host;
use nova_emulator::gdb::Ended;
use nova_emulator::{Board, Image};
use nova_hal_sim::Motion;
use nova_hal_sim::chip::ChipConfig;
use nova_tests::{EmulatedNetwork, FIRMWARE_VARIABLE, Firmware, Scenario, VendorResponder};
use report::Report;
use std::collections::BTreeMap;
use std::net::TcpListener;
use std::process::ExitCode;
use std::time::Instant;

const USAGE: &str = "usage: emulate SCENARIO [--seconds S] [--json] [--log] [--uart tcp://HOST:PORT | --gdb HOST:PORT] \
     [--board NAME] [--elf NAME=FILE]... [--vendor-responder X_M]";

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

#[derive(Default)]
struct Arguments {
    scenario: String,
    seconds: Option<f64>,
    json: bool,
    log: bool,
    uart: Option<String>,
    gdb: Option<String>,
    board: Option<String>,
    foreign: BTreeMap<String, Image>,
    responder_m: Option<f64>,
}

fn arguments() -> Result<Arguments, String> {
    let mut arguments = Arguments::default();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} wants a value; {USAGE}"));
        match word.as_str() {
            "--seconds" => {
                let text = value()?;
                let seconds: f64 = text.parse().map_err(|_| format!("{text} is no time"))?;
                arguments.seconds = Some(seconds).filter(|s| s.is_finite() && *s > 0.0);
            }
            "--json" => arguments.json = true,
            "--log" => arguments.log = true,
            "--uart" => arguments.uart = Some(value()?),
            "--gdb" => arguments.gdb = Some(value()?),
            "--board" => arguments.board = Some(value()?),
            "--vendor-responder" => {
                let text = value()?;
                let x_m: f64 = text.parse().map_err(|_| format!("{text} is no place"))?;
                arguments.responder_m = Some(x_m);
            }
            "--elf" => {
                let text = value()?;
                let (name, path) = text
                    .split_once('=')
                    .ok_or(format!("{text}: not NAME=FILE"))?;
                let bytes = std::fs::read(path).map_err(|error| format!("{path}: {error}"))?;
                let image = Image::parse(&bytes).map_err(|error| format!("{path}: {error}"))?;
                arguments.foreign.insert(name.to_owned(), image);
            }
            _ if arguments.scenario.is_empty() && !word.starts_with("--") => {
                arguments.scenario = word;
            }
            _ => return Err(format!("{word}? {USAGE}")),
        }
    }
    if arguments.scenario.is_empty() {
        return Err(USAGE.to_owned());
    }
    if arguments.uart.is_some() && arguments.gdb.is_some() {
        return Err("--uart and --gdb do not go together".to_owned());
    }
    Ok(arguments)
}

fn run() -> Result<(), String> {
    let arguments = arguments()?;
    let toml = std::fs::read_to_string(&arguments.scenario)
        .map_err(|error| format!("{}: {error}", arguments.scenario))?;
    let scenario = Scenario::parse(&toml)?;
    let firmware = Firmware::from_environment().ok_or(format!(
        "{FIRMWARE_VARIABLE} does not name the folder of the binaries: `cargo xtask emulate` sets it"
    ))??;
    let mut network = scenario.emulate(&firmware, &arguments.foreign)?;
    if let Some(x_m) = arguments.responder_m {
        let chip = ChipConfig {
            motion: Motion::fixed([x_m, 0.0, 0.0]),
            ..ChipConfig::default()
        };
        let responder = Box::new(VendorResponder::default());
        network.emulation().add_peer(chip, responder);
    }
    let seconds = arguments.seconds.unwrap_or(scenario.duration_s);
    let mut host = match &arguments.uart {
        Some(place) => Some(Host::at(place, arguments.board.as_deref(), &mut network)?),
        None => None,
    };
    let start = Instant::now();
    let mut t_s = 0.0;
    let mut ended = None;
    if let Some(place) = &arguments.gdb {
        ended = Some(debug(
            place,
            arguments.board.as_deref(),
            &mut network,
            seconds,
        )?);
        t_s = network.emulation().now().as_s_f64();
    }
    while t_s < seconds && ended != Some(Ended::Killed) {
        // In steps, so that a host gets its bytes while they are new.
        t_s = (t_s + STEP_S).min(seconds);
        network
            .run_until_s(t_s)
            .map_err(|error| error.to_string())?;
        if let Some(host) = &mut host {
            host.serve(&mut network)?;
        }
    }
    let report = Report {
        emulated_s: t_s.min(seconds),
        wall_s: start.elapsed().as_secs_f64(),
    };
    if arguments.json {
        println!("{:#}", report.to_json(&mut network));
    } else {
        report.print(&mut network, arguments.log);
        for name in arguments.foreign.keys() {
            let said = network.log(name).map(|log| log.bytes.as_slice());
            println!(
                "\n{name} said:\n{}",
                String::from_utf8_lossy(said.unwrap_or_default())
            );
        }
    }
    if arguments.seconds.is_none() && host.is_none() && ended.is_none() {
        scenario.check_emulated(&network)?;
    }
    Ok(())
}

const STEP_S: f64 = 0.01;

/// The board of this name, or the first.
fn choose_board(name: Option<&str>, network: &mut EmulatedNetwork) -> Result<String, String> {
    let boards = network.emulation().boards();
    let names: Vec<&str> = boards.iter().map(Board::name).collect();
    match name {
        Some(name) if names.contains(&name) => Ok(name.to_owned()),
        Some(name) => Err(format!("there is no board called {name}: {names:?}")),
        None => Ok(names.first().ok_or("no boards")?.to_string()),
    }
}

/// Waits at `place` for GDB and lets it step through a board.
fn debug(
    place: &str,
    board: Option<&str>,
    network: &mut EmulatedNetwork,
    seconds: f64,
) -> Result<Ended, String> {
    let at = |error: std::io::Error| format!("{place}: {error}");
    let board = choose_board(board, network)?;
    let listener = TcpListener::bind(place).map_err(at)?;
    let address = listener.local_addr().map_err(at)?;
    eprintln!("{board} stands still: target remote {address}");
    let (gdb, _) = listener.accept().map_err(at)?;
    let ended = network.debug(&board, gdb, seconds);
    ended.map_err(|error| error.to_string())
}
