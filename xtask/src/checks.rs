//! Everything that must hold, step by step, with a summary at the end.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};

use crate::process::{cargo, run};
use crate::{firmware, toolchain};

/// How a step ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Passed,
    Failed,
}

/// A step that ran.
struct Step {
    name: &'static str,
    outcome: Outcome,
    took: Duration,
}

/// `cargo xtask test`
///
/// # Errors
/// Names the steps that failed. All of them run, whatever the earlier ones did.
pub(crate) fn test() -> Result<()> {
    let mut steps = Vec::new();
    run_tests(&mut steps);
    conclude(&steps)
}

/// `cargo xtask ci`
///
/// # Errors
/// As for `cargo xtask test`.
pub(crate) fn ci() -> Result<()> {
    let mut steps = Vec::new();
    step(&mut steps, "formatting", || {
        run(cargo().args(["fmt", "--all", "--check"]))
    });
    step(&mut steps, "clippy", || {
        let lint = [
            "clippy",
            "--workspace",
            "--all-targets",
            "--",
            "--deny",
            "warnings",
        ];
        run(cargo().args(lint))
    });
    step(&mut steps, "documentation", || {
        let document = [
            "doc",
            "--workspace",
            "--no-deps",
            "--document-private-items",
        ];
        run(cargo()
            .args(document)
            .env("RUSTDOCFLAGS", "--deny warnings"))
    });
    run_tests(&mut steps);
    conclude(&steps)
}

fn run_tests(steps: &mut Vec<Step>) {
    step(steps, "set-up", || {
        println!("{}", toolchain::find_or_install()?);
        Ok(())
    });
    step(steps, "host tests", || {
        run(cargo().args(["test", "--workspace"]))
    });
    step(steps, "firmware and sizes", firmware::check);
    step(steps, "emulated boards", || {
        let test = ["test", "--package", "nova-tests", "--test", "emulated"];
        let folder = firmware::folder(&toolchain::find_or_install()?);
        run(cargo().args(test).env(firmware::FOLDER_VARIABLE, folder))
    });
}

fn step(steps: &mut Vec<Step>, name: &'static str, work: impl FnOnce() -> Result<()>) {
    println!("── {name}");
    let start = Instant::now();
    let outcome = match work() {
        Ok(()) => Outcome::Passed,
        Err(error) => {
            eprintln!("error: {error:#}");
            Outcome::Failed
        }
    };
    steps.push(Step {
        name,
        outcome,
        took: start.elapsed(),
    });
}

fn conclude(steps: &[Step]) -> Result<()> {
    print!("\n{}", summary(steps));
    let failed: Vec<_> = steps
        .iter()
        .filter(|step| step.outcome == Outcome::Failed)
        .collect();
    if !failed.is_empty() {
        let names: Vec<_> = failed.iter().map(|step| step.name).collect();
        bail!("failed: {}", names.join(", "));
    }
    Ok(())
}

fn summary(steps: &[Step]) -> String {
    let mut out = String::new();
    for Step {
        name,
        outcome,
        took,
    } in steps
    {
        let outcome = match outcome {
            Outcome::Passed => "ok",
            Outcome::Failed => "FAILED",
        };
        // Writing to a String cannot fail.
        let _ = writeln!(out, "{name:<20} {outcome:<6} {:>7.1} s", took.as_secs_f64());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_step_does_not_stop_the_later_ones_and_fails_the_whole() {
        let mut steps = Vec::new();
        step(&mut steps, "first", || bail!("broken"));
        step(&mut steps, "second", || Ok(()));
        assert_eq!(steps.len(), 2);
        assert_eq!(steps[1].outcome, Outcome::Passed);
        assert_eq!(conclude(&steps).unwrap_err().to_string(), "failed: first");
        assert!(conclude(&steps[1..]).is_ok());
    }

    #[test]
    fn the_summary_has_a_line_a_step_with_its_seconds() {
        let step = |name, outcome, seconds| Step {
            name,
            outcome,
            took: Duration::from_secs_f64(seconds),
        };
        let steps = [
            step("host tests", Outcome::Passed, 61.25),
            step("clippy", Outcome::Failed, 3.0),
        ];
        assert_eq!(
            summary(&steps),
            "host tests           ok        61.2 s\nclippy               FAILED     3.0 s\n"
        );
    }
}
