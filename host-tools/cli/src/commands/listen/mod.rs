//! `nova listen`: what boards say, live.

mod model;
mod output;
mod recording;
mod terminal;
mod view;

use crate::arrivals::{Arrival, News, hear};
use crate::error::bad_input;
use crate::interrupt;
use crate::sim_node::BAUD;
use crate::source::{PATIENCE, Place, RETRY, Source};
use anyhow::Result;
use model::{Model, State};
use nova_wire::Decoder;
use output::{Format, Lines, summary};
use recording::Recording;
use std::io::{BufWriter, IsTerminal};
use std::path::PathBuf;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use terminal::Tui;
use view::Screen;

/// Shows live what boards say: peers, ranges, rates, quality, losses.
///
/// On a terminal it is a table; q or Ctrl-C leaves it. Where standard output is no terminal it is
/// plain lines. --json prints one object a record, as `nova decode` does, with the "node" that says
/// it and, where the source is live, the host's time "arrival_s" (seconds since 1970); --csv prints
/// one line a range.
///
/// A serial port or server that is lost is waited for. A file, and standard input, end.
///
/// Columns: the raw range, marked ~ where the board's filter weighed it less, x where it left it out, *
/// where it started with it; the filtered range and its sigma; scatter, the standard deviation of the
/// raw range over 2 s, from the steps between ranges; ranges a second; receive power, and the first
/// path against that; probability of no line of sight; age of the last range. Yellow: likely no line
/// of sight. Below it, for each board, the failed part of its exchanges in the last second and its
/// failures by cause since its start.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova listen /dev/ttyACM0
  nova listen /dev/ttyACM0 /dev/ttyACM1                  two boards in one table
  nova listen /dev/ttyACM0 --record flight.bin
  nova listen tcp://192.168.0.7:7000 --csv > ranges.csv
  nova listen /dev/ttyACM0 --json --duration 10
  nova listen flight.bin
  nova simulate --serve tcp://127.0.0.1:7000 & nova listen tcp://127.0.0.1:7000")]
pub(crate) struct Listen {
    /// Serial ports, servers, recordings, or `-` for standard input.
    #[arg(value_name = "PORT|tcp://HOST:PORT|FILE|-", required = true)]
    sources: Vec<String>,
    /// Also keep the raw stream, byte for byte, in a new file; of one source. A live board is asked for
    /// its settings at the start and whenever it is heard again, so that the recording holds them.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// One JSON object a record.
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// One CSV line a range.
    #[arg(long)]
    csv: bool,
    /// Plain lines though there is a terminal.
    #[arg(long, conflicts_with_all = ["json", "csv"])]
    lines: bool,
    /// Leave after so many seconds.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    duration: Option<f64>,
    /// End when a port or server is lost instead of waiting for it.
    #[arg(long)]
    no_reconnect: bool,
    /// Bits per second of serial ports.
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
}

/// What is shown, one way or the other.
enum Shown {
    Table(Tui),
    Lines(Lines<BufWriter<std::io::StdoutLock<'static>>>),
}

/// A session of listening.
struct Session {
    model: Model,
    decoders: Vec<Decoder>,
    /// Which sources are live.
    live: Vec<bool>,
    screen: Screen,
    recording: Option<Recording>,
    shown: Shown,
}

impl Listen {
    pub(crate) fn run(self) -> Result<()> {
        let until = self.check()?;
        let places = (self.sources.iter())
            .map(|name| Place::named(name, self.baud))
            .collect::<Result<Vec<_>>>()?;
        let mut sources = (places.iter())
            .map(|place| Source::open(place.clone()).map(|source| self.retrying(source)))
            .collect::<Result<Vec<_>>>()?;
        let recording = self.record.as_deref().map(Recording::begin).transpose()?;
        if recording.is_some() {
            // A recording that holds the antenna delays is one that `nova calibrate` can start from.
            sources.iter_mut().for_each(Source::ask_for_settings);
        }
        interrupt::catch()?;
        let mut session = Session {
            model: Model::new(places.iter().map(Place::to_string)),
            decoders: vec![Decoder::new(); places.len()],
            live: places.iter().map(Place::is_live).collect(),
            screen: Screen::default(),
            recording,
            shown: self.begin()?,
        };
        let result = session.follow(sources, until);
        session.end(result)
    }

    /// Checks the options; returns when to leave.
    fn check(&self) -> Result<Option<Instant>> {
        /// A year.
        const LONGEST_S: f64 = 3.2e7;
        if self.record.is_some() && self.sources.len() > 1 {
            return Err(bad_input!(
                "--record keeps the stream of one source, and there are {}",
                self.sources.len()
            ));
        }
        match self.duration {
            None => Ok(None),
            Some(s) if s > 0.0 && s <= LONGEST_S => {
                Ok(Some(Instant::now() + Duration::from_secs_f64(s)))
            }
            Some(_) => Err(bad_input!(
                "--duration must be more than 0 s, and at most a year"
            )),
        }
    }

    fn retrying(&self, source: Source) -> Source {
        if self.no_reconnect {
            source
        } else {
            source.retrying(RETRY)
        }
    }

    fn begin(&self) -> Result<Shown> {
        let stdout = std::io::stdout();
        let format = match (self.json, self.csv) {
            (true, _) => Format::Json,
            (_, true) => Format::Csv,
            _ if self.lines || !stdout.is_terminal() => Format::Text,
            _ => return Ok(Shown::Table(Tui::begin()?)),
        };
        let out = BufWriter::new(stdout.lock());
        let several = self.sources.len() > 1;
        Ok(Shown::Lines(Lines::begin(out, format, several)?))
    }
}

impl Session {
    /// Takes what comes until it ends, the time is over, or the user leaves.
    fn follow(&mut self, sources: Vec<Source>, until: Option<Instant>) -> Result<()> {
        let arrivals = hear(sources);
        while !interrupt::caught() && until.is_none_or(|until| Instant::now() < until) {
            if let Shown::Table(tui) = &mut self.shown {
                self.screen.recording = self.recording.as_ref().map(Recording::so_far);
                if tui.keys(&mut self.screen)? {
                    return Ok(());
                }
                tui.show(&self.model, &mut self.screen)?;
            }
            match arrivals.recv_timeout(PATIENCE) {
                Ok(arrival) => self.take(arrival)?,
                Err(RecvTimeoutError::Timeout) => {}
                // All have ended.
                Err(RecvTimeoutError::Disconnected) => match self.shown {
                    Shown::Lines(_) => return Ok(()),
                    // A table stays to be looked at.
                    Shown::Table(_) => std::thread::sleep(PATIENCE),
                },
            }
        }
        Ok(())
    }

    fn take(&mut self, arrival: Arrival) -> Result<()> {
        let (Some(board), Some(decoder), Some(live)) = (
            self.model.boards.get_mut(arrival.source),
            self.decoders.get_mut(arrival.source),
            self.live.get(arrival.source),
        ) else {
            return Ok(());
        };
        let mut events = Vec::new();
        match arrival.news {
            News::Bytes(bytes) => {
                if let Some(recording) = &mut self.recording {
                    recording.add(&bytes)?;
                }
                events.extend(bytes.iter().filter_map(|&byte| decoder.push(byte)));
            }
            News::End(result) => {
                result?;
                board.state = State::Ended;
                events.extend(decoder.finish());
            }
            News::Lost(why) => {
                self.shown
                    .remark(&format!("{}: lost, trying again: {why}", board.name))?;
                board.state = State::Lost(why);
            }
            News::Back => {
                self.shown.remark(&format!("{}: heard again", board.name))?;
                board.state = State::Open;
            }
        }
        board.wire = *decoder.statistics();
        let arrival_s = live.then(since_1970_s);
        for event in &events {
            board.take(event);
            if let Shown::Lines(lines) = &mut self.shown {
                lines.event(board, event, arrival_s)?;
            }
        }
        match &mut self.shown {
            // Whoever watches sees what has come.
            Shown::Lines(lines) => lines.flush(),
            Shown::Table(_) => Ok(()),
        }
    }

    /// Gives the terminal back, and then says how it went.
    fn end(self, result: Result<()>) -> Result<()> {
        match self.shown {
            Shown::Table(tui) => {
                drop(tui);
                result?;
                for board in &self.model.boards {
                    println!("{}", summary(board));
                }
                if let Some((file, bytes)) = self.recording.as_ref().map(Recording::so_far) {
                    println!("{file}: {bytes} bytes recorded");
                }
            }
            Shown::Lines(mut lines) => {
                result?;
                for board in &self.model.boards {
                    lines.end(board)?;
                }
                lines.flush()?;
            }
        }
        nothing_heard(&self.model)
    }
}

impl Shown {
    /// Says something about a source; a table shows it anyhow.
    fn remark(&mut self, remark: &str) -> Result<()> {
        match self {
            Self::Table(_) => Ok(()),
            Self::Lines(lines) => lines.remark(remark),
        }
    }
}

/// Bytes without a single frame are no board's.
fn nothing_heard(model: &Model) -> Result<()> {
    for board in &model.boards {
        let wire = &board.wire;
        if wire.bytes > 0 && wire.records == 0 && wire.unknown == 0 {
            return Err(bad_input!(
                "{}: no frame in {} bytes: is this what a board sent, at {BAUD} baud?",
                board.name,
                wire.bytes
            ));
        }
    }
    Ok(())
}

fn since_1970_s() -> f64 {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
    since_1970.map_or(0.0, |since| since.as_secs_f64())
}
