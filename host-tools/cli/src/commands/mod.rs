//! The subcommands.

mod airtime;
mod bridge;
mod calibrate;
mod config;
mod decode;
mod deliver;
mod demo;
mod evaluate;
mod filter;
mod fly;
mod fuse;
mod guide;
mod listen;
mod locate;
mod replay;
mod simulate;
mod solve;
mod status;
mod survey;
mod track;
mod twr;

use crate::error::BadInput;
use clap::{Parser, Subcommand};
use std::ffi::OsString;
use std::process::ExitCode;

/// Ranges between DWM1001 boards: measured, decoded, and turned into positions.
#[derive(Parser)]
#[command(name = "nova", version, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Demo),
    Solve(solve::Solve),
    Survey(survey::Survey),
    Locate(locate::Locate),
    Fuse(fuse::Fuse),
    Guide(guide::Guide),
    Bridge(bridge::Bridge),
    Fly(fly::Fly),
    Track(track::Track),
    Deliver(deliver::Deliver),
    Replay(replay::Replay),
    Evaluate(evaluate::Evaluate),
    Merge(evaluate::Merge),
    Twr(twr::Twr),
    Decode(decode::Decode),
    Config(config::Config),
    Status(status::Status),
    Listen(listen::Listen),
    Simulate(simulate::Simulate),
    Calibrate(calibrate::Calibrate),
    Filter(filter::Filter),
    Airtime(airtime::Airtime),
}

/// Exit code where the input is at fault; the same that clap uses for arguments.
const BAD_INPUT: u8 = 2;

/// Runs the command with these arguments, the program's name first.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help and version go to standard output and are no error. If even
            // that cannot be written there is nobody to tell.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { BAD_INPUT } else { 0 });
        }
    };
    let result = match arguments.command {
        Command::Demo(command) => command.run(),
        Command::Solve(command) => command.run(),
        Command::Survey(command) => command.run(),
        Command::Locate(command) => command.run(),
        Command::Fuse(command) => command.run(),
        Command::Guide(command) => command.run(),
        Command::Bridge(command) => command.run(),
        Command::Fly(command) => command.run(),
        Command::Track(command) => command.run(),
        Command::Deliver(command) => command.run(),
        Command::Replay(command) => command.run(),
        Command::Evaluate(command) => command.run(),
        Command::Merge(command) => command.run(),
        Command::Twr(command) => command.run(),
        Command::Decode(command) => command.run(),
        Command::Config(command) => command.run(),
        Command::Status(command) => command.run(),
        Command::Listen(command) => command.run(),
        Command::Simulate(command) => command.run(),
        Command::Calibrate(command) => command.run(),
        Command::Filter(command) => command.run(),
        Command::Airtime(command) => command.run(),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            match error.downcast_ref::<BadInput>() {
                Some(_) => ExitCode::from(BAD_INPUT),
                None => ExitCode::FAILURE,
            }
        }
    }
}

/// Whoever reads our output, `head` for instance, has had enough.
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause
            .downcast_ref::<std::io::Error>()
            .is_some_and(|io| io.kind() == std::io::ErrorKind::BrokenPipe)
            || cause
                .downcast_ref::<serde_json::Error>()
                .is_some_and(|json| json.io_error_kind() == Some(std::io::ErrorKind::BrokenPipe))
    })
}
