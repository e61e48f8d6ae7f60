//! `nova config`: a board's settings.

mod file;
mod values;

use crate::board::{Board, allowed};
use crate::error::bad_input;
use crate::files::write_whole;
use crate::sim_node::BAUD;
use anyhow::Result;
use nova_wire::settings::{Fallback, MAX_SETTINGS, SETTINGS, Setting};
use nova_wire::{Change, Changes, Command, Record, SettingValue, Value};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

/// Reads and changes the settings of a board, at its serial port or tcp://HOST:PORT.
///
/// The board checks what it is told, keeps it in its flash, and works by it at once. A command changes all
/// that it says, or nothing.
#[derive(clap::Args)]
#[command(after_help = help())]
pub(crate) struct Config {
    #[command(subcommand)]
    action: Action,
}

#[derive(clap::Subcommand)]
enum Action {
    /// Print settings: all, or those that are named.
    Get {
        #[command(flatten)]
        port: Port,
        /// Which ones.
        #[arg(value_name = "NAME")]
        names: Vec<String>,
        /// As one JSON object: {"NAME": {"value": .., "set": ..}}
        #[arg(long)]
        json: bool,
    },
    /// Change settings; NAME=default takes one back.
    Set {
        #[command(flatten)]
        port: Port,
        /// What to change.
        #[arg(value_name = "NAME=VALUE", required = true)]
        changes: Vec<String>,
    },
    /// Write the settings as a TOML file that can go to other boards.
    Export {
        #[command(flatten)]
        port: Port,
        /// With what belongs to this board alone as well, its address and antenna delays: to keep it, not for another.
        #[arg(long)]
        all: bool,
        /// Where to; standard output if left out.
        #[arg(long, short, value_name = "FILE")]
        output: Option<PathBuf>,
    },
    /// Change what stands in a TOML file; what does not stand there stays.
    Import {
        #[command(flatten)]
        port: Port,
        /// From `nova config export` or `nova calibrate`, or written by hand.
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Give the board the address in the file, although that is another one.
        #[arg(long)]
        readdress: bool,
    },
    /// Take all settings back to their defaults.
    Reset {
        #[command(flatten)]
        port: Port,
    },
    /// Let the board start anew.
    Reboot {
        #[command(flatten)]
        port: Port,
    },
}

/// The way to the board.
#[derive(clap::Args)]
pub(crate) struct Port {
    /// The board's serial port, or tcp://HOST:PORT where it is served.
    #[arg(value_name = "PORT|tcp://HOST:PORT")]
    port: String,
    /// Bits per second of a serial port.
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
}

impl Port {
    pub(crate) fn open(&self) -> Result<Board> {
        Board::open(&self.port, self.baud)
    }
}

const EXAMPLES: &str = "\
Examples:
  nova config get /dev/ttyACM0
  nova config get /dev/ttyACM0 pan period_us --json
  nova config set /dev/ttyACM0 pan=0x1234 part=initiator peers=0x0A1B,0x0102
  nova config set /dev/ttyACM0 pan=default
  nova config export /dev/ttyACM0 -o node.toml
  nova config import tcp://localhost:7000 node.toml

Settings:
";

/// The list of settings, for people.
fn help() -> String {
    let mut text = EXAMPLES.to_owned();
    for description in &SETTINGS {
        let default = match description.default {
            Fallback::Board(how) => how.to_owned(),
            Fallback::Value(value) => values::shown(description, &value),
        };
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "  {:<24} {}\n{:27}{}; default: {default}",
            description.name,
            description.meaning,
            "",
            allowed(description),
        );
    }
    text
}

impl Config {
    pub(crate) fn run(self) -> Result<()> {
        match self.action {
            Action::Get { port, names, json } => get(&port, &names, json),
            Action::Set { port, changes } => {
                let changes: Vec<Change> = (changes.iter())
                    .map(|text| values::change(text))
                    .collect::<Result<_>>()?;
                set(&mut port.open()?, &changes)
            }
            Action::Export { port, all, output } => {
                let text = file::written(&settings(&mut port.open()?)?, all);
                match output {
                    Some(path) => write_whole(&path, text),
                    None => Ok(std::io::stdout().lock().write_all(text.as_bytes())?),
                }
            }
            Action::Import {
                port,
                file,
                readdress,
            } => {
                let changes = file::read(&file)?;
                let mut board = port.open()?;
                if !readdress {
                    check_address(&mut board, &changes)?;
                }
                set(&mut board, &changes)
            }
            Action::Reset { port } => port.open()?.ask(&Command::Reset).map(|_| ()),
            Action::Reboot { port } => port.open()?.ask(&Command::Reboot).map(|_| ()),
        }
    }
}

/// All settings of the board.
fn settings(board: &mut Board) -> Result<Vec<SettingValue>> {
    let said = board.ask(&Command::Get)?;
    let settings = said.into_iter().filter_map(|record| match record {
        Record::Setting(value) => Some(value),
        _ => None,
    });
    Ok(settings.collect())
}

fn get(port: &Port, names: &[String], json: bool) -> Result<()> {
    let wanted: Vec<Setting> = (names.iter())
        .map(|name| values::named(name).map(|description| description.setting))
        .collect::<Result<_>>()?;
    let mut board = port.open()?;
    let told = settings(&mut board)?;
    let known = told
        .iter()
        .filter_map(|told| Setting::from_number(told.setting).map(|setting| (setting, told)))
        .filter(|(setting, _)| wanted.is_empty() || wanted.contains(setting));
    let mut out = String::new();
    let mut object = serde_json::Map::new();
    for (setting, told) in known {
        let description = setting.description();
        let value = values::json(description, &told.value);
        object.insert(
            description.name.to_owned(),
            serde_json::json!({ "value": value, "set": told.set }),
        );
        let remark = if told.set { "" } else { "  # default" };
        // Writing to a string cannot fail.
        let shown = values::shown(description, &told.value);
        let _ = writeln!(out, "{} = {shown}{remark}", description.name);
    }
    for setting in wanted {
        let name = setting.description().name;
        if !object.contains_key(name) {
            return Err(bad_input!(
                "{}: {name}: the board has no such setting: its firmware is older than this program",
                board.place()
            ));
        }
    }
    if json {
        out = serde_json::Value::Object(object).to_string() + "\n";
    }
    Ok(std::io::stdout().lock().write_all(out.as_bytes())?)
}

fn set(board: &mut Board, changes: &[Change]) -> Result<()> {
    let mut command = Changes::new();
    for change in changes {
        if command.iter().any(|other| other.setting == change.setting) {
            let name = Setting::from_number(change.setting).map(|s| s.description().name);
            return Err(bad_input!("{}: given twice", name.unwrap_or_default()));
        }
        if command.push(*change).is_err() {
            return Err(bad_input!(
                "more than {MAX_SETTINGS} settings in one command"
            ));
        }
    }
    board.ask(&Command::Set(command)).map(|_| ())
}

/// A file that says which board it is for goes to no other by mistake.
fn check_address(board: &mut Board, changes: &[Change]) -> Result<()> {
    let address = Setting::Address.number();
    let Some(Some(Value::Number(meant))) = (changes.iter())
        .find(|change| change.setting == address)
        .map(|change| change.value)
    else {
        return Ok(());
    };
    let there = settings(board)?.into_iter().find(|s| s.setting == address);
    match there.map(|told| told.value) {
        Some(Value::Number(there)) if there != meant => Err(bad_input!(
            "the file is for node 0x{meant:04X}, and at {} is node 0x{there:04X}; \
             --readdress makes it 0x{meant:04X}",
            board.place()
        )),
        _ => Ok(()),
    }
}
