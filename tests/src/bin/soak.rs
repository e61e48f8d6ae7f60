//! Ranging under faults, for as long as wanted; see `nova_tests::soak`.

use nova_tests::soak::{Faults, run};
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut numbers = std::env::args().skip(1).map(|word| word.parse::<u64>());
    let (exchanges, seed) = match (numbers.next(), numbers.next()) {
        (Some(Ok(exchanges)), None) => (exchanges, 1),
        (Some(Ok(exchanges)), Some(Ok(seed))) => (exchanges, seed),
        _ => {
            eprintln!("usage: soak EXCHANGES [SEED]");
            return ExitCode::FAILURE;
        }
    };
    let outcome = run(exchanges, seed, &Faults::all(), |report| {
        eprint!(
            "\r{} exchanges, {} flagged, {} silent ",
            report.exchanges,
            report.flagged,
            report.silent.len()
        );
    });
    eprintln!();
    match outcome {
        Ok(report) => {
            print!("{report}");
            if report.passes() {
                ExitCode::SUCCESS
            } else {
                ExitCode::FAILURE
            }
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
