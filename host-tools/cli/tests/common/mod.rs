//! What the tests of the command share.
#![allow(dead_code, clippy::unwrap_used)]

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

/// Runs `nova` with these arguments in an empty folder.
pub(crate) struct Nova {
    pub(crate) folder: TempDir,
}

/// What it said, as text.
pub(crate) struct Said {
    pub(crate) code: i32,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Nova {
    pub(crate) fn new() -> Self {
        Self {
            folder: TempDir::new().unwrap(),
        }
    }

    /// A file in the folder.
    pub(crate) fn file(&self, name: &str, content: impl AsRef<[u8]>) -> &Self {
        std::fs::write(self.folder.path().join(name), content).unwrap();
        self
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Said {
        self.run_with(&[], arguments)
    }

    /// The same with variables of the environment.
    pub(crate) fn run_with(&self, environment: &[(&str, &str)], arguments: &[&str]) -> Said {
        let output = Command::new(env!("CARGO_BIN_EXE_nova"))
            .args(arguments)
            .envs(environment.iter().copied())
            .current_dir(self.folder.path())
            .output()
            .unwrap();
        Said::from(output)
    }

    /// The same with these bytes on standard input.
    pub(crate) fn run_fed(&self, input: &[u8], arguments: &[&str]) -> Said {
        let mut child = Command::new(env!("CARGO_BIN_EXE_nova"))
            .args(arguments)
            .current_dir(self.folder.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // It may refuse the input without reading it.
        let _ = child.stdin.take().unwrap().write_all(input);
        Said::from(child.wait_with_output().unwrap())
    }

    /// The demonstration, with `flight.csv` and `anchor.bin` written.
    pub(crate) fn demonstration(&self) -> Said {
        let files = ["--csv", "flight.csv", "--capture", "anchor.bin"];
        self.run(&[&["demo", "--json"], &files[..]].concat())
    }

    /// Names of all files in the folder.
    pub(crate) fn files(&self) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(self.folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

impl From<Output> for Said {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code().unwrap(),
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

impl Said {
    /// The JSON objects in its output, one a line.
    pub(crate) fn json(&self) -> Vec<serde_json::Value> {
        self.out
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }
}

/// A recorded file, which is not ours to publish: from the folder `NOVA_DATA`,
/// or `../shared/data` beside the repository. Says so when it is not there.
pub(crate) fn recorded(file: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("NOVA_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(file);
    if !path.exists() {
        // Past the capture of the test runner: a skip is to be seen.
        let _ = writeln!(
            std::io::stderr(),
            "skipped: no recording at {}",
            path.display()
        );
        return None;
    }
    Some(path)
}
