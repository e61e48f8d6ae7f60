//! `nova decode`: what a board has sent, as JSON lines.

use crate::error::bad_input;
use crate::interrupt;
use crate::record_line::{Heard, Line, print};
use crate::sim_node::BAUD;
use crate::source::{Input, Place, Source};
use anyhow::Result;
use nova_wire::Decoder;
use std::io::{BufWriter, Cursor, Write};
use std::path::Path;

/// Prints a captured byte stream from a board as JSON lines.
///
/// Each record is one line: {"sequence": .., "range": {..}}, with "lost" where
/// frames are missing before it. Frames that give no record are lines too:
/// {"trouble": ..}. The last line counts records and lost, corrupt and unknown
/// frames: {"end": {..}}. docs/wire-format.md says what the records hold.
///
/// A capture file that ends inside a frame was cut off: that is an error and
/// nothing is printed, unless --truncated is given. A serial port, a TCP server
/// and standard input are decoded as they come; Ctrl-C ends them with the counts.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova decode capture.bin
  nova decode capture.bin | grep '\"range\"'
  nova decode /dev/ttyACM0
  nova decode - < capture.bin")]
pub(crate) struct Decode {
    /// The captured bytes, or where they come from; `-` for standard input.
    #[arg(value_name = "FILE|PORT|tcp://HOST:PORT|-")]
    source: String,
    /// Bits per second of a serial port.
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
    /// Print what is whole of a capture that was cut off.
    #[arg(long)]
    truncated: bool,
}

impl Decode {
    pub(crate) fn run(self) -> Result<()> {
        let mut stdout = std::io::stdout().lock();
        match Place::named(&self.source, self.baud)? {
            Place::File(path) => {
                let bytes = std::fs::read(&path)
                    .map_err(|error| bad_input!("{}: cannot be read: {error}", path.display()))?;
                self.check(&path, &bytes)?;
                // A file that turns out bad as a whole prints nothing.
                let mut lines = Vec::new();
                self.decode(
                    Source::of(Place::File(path), Cursor::new(bytes)),
                    &mut lines,
                )?;
                Ok(stdout.write_all(&lines)?)
            }
            live => {
                let source = Source::open(live)?;
                interrupt::catch()?;
                self.decode(source, BufWriter::new(stdout))
            }
        }
    }

    /// Refuses a file as a whole before anything of it is printed.
    fn check(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let path = path.display();
        if bytes.is_empty() {
            return Err(bad_input!("{path}: the file is empty"));
        }
        let whole = bytes.iter().rposition(|&b| b == 0).map_or(0, |at| at + 1);
        if whole < bytes.len() && !self.truncated {
            return Err(bad_input!(
                "{path}: byte {whole}: the capture ends inside a frame; \
                 --truncated prints what is whole before it"
            ));
        }
        Ok(())
    }

    fn decode(&self, mut input: Source, mut out: impl Write) -> Result<()> {
        let mut decoder = Decoder::new();
        let mut chunk = [0; 4096];
        let cut_off = loop {
            let count = match input.read(&mut chunk)? {
                Input::End => break decoder.finish(),
                Input::Bytes(count) => count,
                // Nobody asked for a lost port to be tried again.
                Input::Silence | Input::Lost(_) | Input::Back => 0,
            };
            for event in chunk.iter().take(count).filter_map(|&b| decoder.push(b)) {
                print(&mut out, Heard::default(), &Line::from(&event))?;
            }
            // Whoever watches a live stream sees what has come.
            out.flush()?;
            if interrupt::caught() {
                break None;
            }
        };
        if let Some(event) = &cut_off {
            print(&mut out, Heard::default(), &Line::from(event))?;
        }
        let name = input.place();
        let statistics = decoder.statistics();
        print(&mut out, Heard::default(), &Line::End(statistics))?;
        out.flush()?;
        if statistics.records == 0 && statistics.unknown == 0 {
            return Err(bad_input!(
                "{name}: no frame in {} bytes: is this what a board sent, at {} baud?",
                statistics.bytes,
                self.baud
            ));
        }
        if cut_off.is_some() && !self.truncated {
            return Err(bad_input!("{name}: the stream ends inside a frame"));
        }
        Ok(())
    }
}
