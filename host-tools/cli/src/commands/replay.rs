//! `nova replay`: a recorded delivery or bridge through its filter once more.

use crate::commands::bridge::journal;
use crate::error::bad_input;
use crate::recording::delivery;
use crate::recording::file::{Place, Player, play};
use anyhow::Result;
use std::io::BufWriter;
use std::path::PathBuf;

/// Feeds the measurements of a recorded delivery, or of a bridge, to the same filter or navigators and prints the estimates, a JSON line each.
///
/// The lines are those that were recorded under /estimate, byte for byte; of a recording that is cut or spoilt it says where, after the
/// estimates up to there. docs/delivery.md and docs/mavlink.md say what is in a recording.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova deliver --record flight.mcap
  nova bridge --board /dev/ttyACM0 --mavlink udpin:0.0.0.0:14540 --record flight.mcap
  nova replay flight.mcap > estimates.jsonl")]
pub(crate) struct Replay {
    /// What `nova deliver --record` or `nova bridge --record` wrote.
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
        let mut out = BufWriter::new(std::io::stdout().lock());
        play(&name, &bytes, begin, &mut out)
    }
}

/// What a recording that begins with this message is played to; `None` where it does not begin yet.
fn begin(place: &Place<'_>, data: &[u8]) -> Result<Option<Box<dyn Player>>> {
    Ok(match place.topic {
        journal::BEGIN => Some(Box::new(journal::Again::begin(place, data)?)),
        delivery::BEGIN => Some(Box::new(delivery::Flight::begin(place, data)?)),
        _ => None,
    })
}
