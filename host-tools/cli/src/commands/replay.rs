//! `nova replay`: a recorded delivery through its filter once more.

use crate::error::bad_input;
use crate::recording::replay;
use anyhow::Result;
use std::io::BufWriter;
use std::path::PathBuf;

/// Feeds the measurements of a recorded delivery to the same filter and prints its estimates, a JSON line each.
///
/// The lines are those that the flight recorded under /estimate, byte for byte; of a recording that is cut or spoilt it says where.
/// docs/delivery.md says what is in a recording.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova deliver --record flight.mcap
  nova replay flight.mcap > estimates.jsonl")]
pub(crate) struct Replay {
    /// What `nova deliver --record` wrote.
    #[arg(value_name = "FILE.mcap")]
    recording: PathBuf,
    /// JSON lines; they are what is printed in any case.
    #[arg(long)]
    json: bool,
}

impl Replay {
    pub(crate) fn run(self) -> Result<()> {
        let _ = self.json;
        let name = self.recording.display().to_string();
        let bytes = std::fs::read(&self.recording)
            .map_err(|error| bad_input!("{name}: cannot be read: {error}"))?;
        replay(&name, &bytes, &mut BufWriter::new(std::io::stdout().lock()))
    }
}
