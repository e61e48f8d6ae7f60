//! `nova` at an emulated board's serial port, as at a real one's.

use libtest_mimic::Failed;
use nova_tests::{FIRMWARE_VARIABLE, Firmware};
use serde_json::Value;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, ExitCode, Output, Stdio};

/// With this in its environment the test's own program is `nova`.
const BE_NOVA: &str = "NOVA_TESTS_BE_NOVA";

/// What this process is to do instead of testing, if anything.
pub(super) fn instead() -> Option<ExitCode> {
    std::env::var_os(BE_NOVA).map(|_| nova_cli::run(std::env::args_os()))
}

fn nova(arguments: &[&str]) -> Result<String, Failed> {
    let output = Command::new(std::env::current_exe()?)
        .env(BE_NOVA, "1")
        .args(arguments)
        .output()?;
    text(&output)
}

fn text(output: &Output) -> Result<String, Failed> {
    let [out, said] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    if output.status.success() {
        Ok(out.into_owned())
    } else {
        Err(format!("{}: {out}{said}", output.status).into())
    }
}

fn emulate() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_emulate"));
    let scenario = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/a-pair-at-rest.toml");
    command.args(["--scenario", scenario]);
    command
}

/// Ends with the test.
struct Boards(Child);

impl Drop for Boards {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub(super) fn config_and_listen(_: &Firmware) -> Result<(), Failed> {
    let mut boards = emulate()
        .args(["--seconds", "3600", "--uart", "tcp://127.0.0.1:0"])
        .args(["--board", "anchor"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()?;
    let mut said = BufReader::new(boards.stderr.take().ok_or("no standard error")?);
    let _boards = Boards(boards);
    let mut line = String::new();
    said.read_line(&mut line)?;
    let place = line
        .split_whitespace()
        .find(|word| word.starts_with("tcp://"));
    let place = place.ok_or(line.clone())?.trim_end_matches(':');

    let settings = nova(&["config", "get", place, "address", "period_us", "--json"])?;
    let settings: Value = serde_json::from_str(&settings)?;
    assert_eq!(settings["address"]["set"], true, "{settings}");
    nova(&["config", "set", place, "period_us=20000"])?;
    let period = nova(&["config", "get", place, "period_us"])?;
    assert!(period.contains("20000"), "{period}");

    let records = nova(&[
        "listen",
        place,
        "--json",
        "--duration",
        "1",
        "--no-reconnect",
    ])?;
    let ranges = records.lines().filter_map(|line| {
        let record: Value = serde_json::from_str(line).ok()?;
        record["range"]["raw_m"].as_f64()
    });
    let ranges: Vec<f64> = ranges.collect();
    assert!(ranges.len() > 5, "{records}");
    assert!(
        ranges.iter().all(|range_m| (range_m - 7.0).abs() < 0.2),
        "{ranges:?}"
    );
    Ok(())
}

pub(super) fn a_file_of_its_own(_: &Firmware) -> Result<(), Failed> {
    let folder = std::env::var(FIRMWARE_VARIABLE)?;
    // Without settings, as firmware by others: the anchor's binary finds the tag by itself.
    let output = emulate()
        .args(["--seconds", "1", "--json", "--elf"])
        .arg(format!("anchor={folder}/anchor"))
        .output()?;
    let report: Value = serde_json::from_str(&text(&output)?)?;
    let ranges = report["boards"]["anchor"]["ranges"].as_u64();
    assert!(ranges.is_some_and(|ranges| ranges > 50), "{report}");

    let output = emulate().args(["--elf", "anchor=Cargo.toml"]).output()?;
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        !output.status.success() && said.contains("Cargo.toml"),
        "{said}"
    );
    Ok(())
}
