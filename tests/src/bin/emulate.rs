//! `cargo xtask emulate`: a scenario on emulated boards, and what they did.

use nova_emulator::{Board, BoardStats, CPU_HZ, Image};
use nova_hal_sim::Motion;
use nova_hal_sim::chip::ChipConfig;
use nova_tests::{
    BoardLog, EmulatedNetwork, FIRMWARE_VARIABLE, Firmware, Scenario, VendorResponder,
};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::ExitCode;
use std::time::Instant;

const USAGE: &str = "usage: emulate SCENARIO [--seconds S] [--json] [--log] [--uart tcp://HOST:PORT] [--board NAME] \
     [--elf NAME=FILE]... [--vendor-responder X_M]";

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
    while t_s < seconds {
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
        emulated_s: seconds,
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
    if arguments.seconds.is_none() && host.is_none() {
        scenario.check_emulated(&network)?;
    }
    Ok(())
}

const STEP_S: f64 = 0.01;

/// A host that talks to one board over TCP, as through a serial port.
struct Host {
    listener: TcpListener,
    stream: Option<TcpStream>,
    board: String,
    sent: usize,
}

impl Host {
    fn at(place: &str, board: Option<&str>, network: &mut EmulatedNetwork) -> Result<Self, String> {
        let address = place
            .strip_prefix("tcp://")
            .ok_or(format!("{place}: only tcp://HOST:PORT"))?;
        let at = |error: std::io::Error| format!("{place}: {error}");
        let listener = TcpListener::bind(address).map_err(at)?;
        let boards = network.emulation().boards();
        let names: Vec<&str> = boards.iter().map(Board::name).collect();
        let board = match board {
            Some(name) if names.contains(&name) => name.to_owned(),
            Some(name) => return Err(format!("there is no board called {name}: {names:?}")),
            None => names.first().ok_or("no boards")?.to_string(),
        };
        eprintln!(
            "{board} at tcp://{}: waiting for a host",
            listener.local_addr().map_err(at)?
        );
        let (stream, _) = listener.accept().map_err(at)?;
        listener.set_nonblocking(true).map_err(at)?;
        stream.set_nonblocking(true).map_err(at)?;
        Ok(Self {
            listener,
            stream: Some(stream),
            board,
            sent: 0,
        })
    }

    /// Gives the host what the board has said, and the board what the host says. A host may go and another come.
    fn serve(&mut self, network: &mut EmulatedNetwork) -> Result<(), String> {
        if let Ok((stream, _)) = self.listener.accept() {
            stream
                .set_nonblocking(true)
                .map_err(|error| error.to_string())?;
            self.stream = Some(stream);
        }
        let log = network.log(&self.board).ok_or("no log")?;
        let news = log.bytes.get(self.sent..).unwrap_or_default().to_vec();
        self.sent = log.bytes.len();
        let Some(stream) = &mut self.stream else {
            return Ok(());
        };
        let mut buffer = [0; 256];
        let heard = match stream.read(&mut buffer) {
            Ok(0) => None,
            Ok(count) => Some(count),
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => Some(0),
            Err(_) => None,
        };
        let Some(count) = heard.filter(|_| stream.write_all(&news).is_ok()) else {
            self.stream = None;
            return Ok(());
        };
        if let Some(board) = network.emulation().board_mut(&self.board) {
            board.say(buffer.get(..count).unwrap_or_default());
        }
        Ok(())
    }
}

struct Report {
    emulated_s: f64,
    wall_s: f64,
}

/// Ranges a second from the first to the last.
fn rate_hz(log: &BoardLog) -> f64 {
    match (log.ranges.first(), log.ranges.last()) {
        (Some(first), Some(last)) if last.t_us > first.t_us => {
            (log.ranges.len() - 1) as f64 / ((last.t_us - first.t_us) as f64 * 1e-6)
        }
        _ => 0.0,
    }
}

fn us(cycles: u64, count: u64) -> f64 {
    cycles as f64 / count.max(1) as f64 * 1e6 / CPU_HZ as f64
}

impl Report {
    fn print(&self, network: &mut EmulatedNetwork, log_lines: bool) {
        println!(
            "{} s emulated in {:.2} s: {:.2} times as fast as real",
            self.emulated_s,
            self.wall_s,
            self.emulated_s / self.wall_s
        );
        for name in names(network) {
            let (Some(stats), Some(log)) = (network.stats(&name), network.log(&name)) else {
                continue;
            };
            let BoardStats { replies, .. } = stats;
            let asleep = 1.0 - stats.busy_cycles as f64 / stats.cycles.max(1) as f64;
            println!("\n{name}");
            println!(
                "  ranges        {} ({:.1} a second)",
                log.ranges.len(),
                rate_hz(log)
            );
            println!("  instructions  {}", stats.instructions);
            println!("  asleep        {:.1} %", 100.0 * asleep);
            println!("  interrupts    {:?} (number: times)", stats.interrupts);
            println!(
                "  SPI           {} bytes in {} transfers",
                stats.spi_bytes, stats.transfers
            );
            println!(
                "  answers       {}: latency {:.1} us, SPI {:.1} us, processor {:.1} us, radio {:.1} us",
                replies.count,
                us(replies.latency, replies.count),
                us(replies.spi, replies.count),
                us(replies.processor, replies.count),
                us(replies.radio, replies.count),
            );
            println!(
                "  resets        {:?}",
                stats.resets.iter().map(|(_, why)| why).collect::<Vec<_>>()
            );
            println!("  counters      {:?}", log.counters);
            if let Some(radio) = network.emulation().chip_stats(&name) {
                println!(
                    "  frames        {} sent, {} received, {} late",
                    radio.frames_sent, radio.frames_good, radio.late_commands
                );
            }
            if let Some(board) = network.emulation().board(&name) {
                println!("  stands at     {:#010x}", board.program_counter());
            }
            if let Some(stack) = stack(network, &name) {
                println!(
                    "  stack         {} of {} bytes",
                    stack.high_water, stack.size
                );
            }
            let lines = network.lines(&name).unwrap_or_default();
            println!("  log           {} lines", lines.len());
            for line in lines.iter().filter(|_| log_lines) {
                println!("    {} {:5} {}", line.time, line.level, line.text);
            }
        }
    }

    fn to_json(&self, network: &mut EmulatedNetwork) -> Value {
        let mut boards = serde_json::Map::new();
        for name in names(network) {
            let (Some(stats), Some(log)) = (network.stats(&name), network.log(&name)) else {
                continue;
            };
            let replies = stats.replies;
            let interrupts: serde_json::Map<String, Value> = stats
                .interrupts
                .iter()
                .map(|(number, count)| (number.to_string(), json!(count)))
                .collect();
            let resets: Vec<String> = stats
                .resets
                .iter()
                .map(|(_, why)| format!("{why:?}").to_lowercase())
                .collect();
            let lines = network.lines(&name).unwrap_or_default();
            let mut board = json!({
                "ranges": log.ranges.len(),
                "range_rate_hz": rate_hz(log),
                "instructions": stats.instructions,
                "cycles": stats.cycles,
                "busy_cycles": stats.busy_cycles,
                "interrupts": interrupts,
                "spi_transfers": stats.transfers,
                "spi_bytes": stats.spi_bytes,
                "resets": resets,
                "answers": {
                    "count": replies.count,
                    "latency_us": us(replies.latency, replies.count),
                    "spi_us": us(replies.spi, replies.count),
                    "processor_us": us(replies.processor, replies.count),
                    "radio_us": us(replies.radio, replies.count),
                },
                "counters": serde_json::to_value(log.counters).unwrap_or_default(),
                "log": lines.iter().map(|line| json!({
                    "time": line.time, "level": line.level, "text": line.text,
                })).collect::<Vec<_>>(),
            });
            if let Some(stack) = stack(network, &name) {
                board["stack"] = json!({ "size": stack.size, "high_water": stack.high_water });
            }
            boards.insert(name, board);
        }
        json!({ "emulated_s": self.emulated_s, "wall_s": self.wall_s, "boards": boards })
    }
}

fn names(network: &mut EmulatedNetwork) -> Vec<String> {
    let boards = network.emulation().boards().iter();
    boards.map(|board| board.name().to_owned()).collect()
}

fn stack(network: &mut EmulatedNetwork, name: &str) -> Option<nova_emulator::StackUse> {
    network.emulation().board(name)?.stack_use()
}
