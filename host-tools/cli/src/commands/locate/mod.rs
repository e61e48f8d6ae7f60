//! `nova locate`: where a board is that only listens.

mod board;
mod input;
mod page;
mod report;

use crate::anchors::AnchorsFile;
use crate::error::bad_input;
use crate::files::write_whole;
use crate::interrupt;
use crate::sim_node::BAUD;
use crate::source::{Place, RETRY, Source};
use crate::table::ColumnNames;
use anyhow::Result;
use board::Board;
use input::{Anchors, Heights};
use nova_solver::positioning::{
    DifferenceFilterOptions, ListenedRound, ListenerTrack, ListenerTrackOptions, ListeningCounts,
    RangeDifference, RoundJudgement, TdoaOptions, locate_tdoa,
};
use nova_solver::survey::Track;
use report::{Counts, Placed, Report, Still};
use std::io::{Cursor, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Where a board is that only listens, from differences of distances to anchors.
///
/// SOURCE is what a board with part=listener says: a recording of it (nova listen --record), its serial
/// port, a TCP server or standard input; or a CSV file of differences with the columns t_s, anchor_a,
/// anchor_b, difference_m and optionally sigma_m: at time t_s it was difference_m further to anchor_b than
/// to anchor_a. The anchors range among themselves; at least four have to be heard.
///
/// A place each round comes out, with its standard deviations, and at the end what became of the
/// differences; with --still one place from all of them.
#[derive(clap::Args)]
#[command(
    after_help = "anchors.toml is what nova survey --out writes: [[anchor]] with node and position_m of each.

Examples:
  nova locate listener.bin --anchors anchors.toml
  nova locate /dev/ttyACM0 --anchors anchors.toml --json
  nova locate listener.bin --anchors anchors.toml --still --heights 0,2.5
  nova locate listener.bin --anchors anchors.toml --out track.csv --plot track.html
  nova locate tdoa.csv --columns difference_m=dist_b_minus_dist_a_m --sigma 0.15 --still --anchors anchors.toml
To try it: the first board polls the others, the last one only listens, on a circle of 1 m
  nova simulate --board anchor@0,0,2 --board tag@8,0,2.5 --board tag@8,6,0.5 --board tag@0,6,2.2 \\
    --board listener@4,3,1,1 --capture heard --duration 20
  nova locate heard/0x0005.bin --anchors anchors.toml      with nodes 1 to 4 in it"
)]
pub(crate) struct Locate {
    /// What the listener says, or differences.
    #[arg(value_name = "PORT|tcp://HOST:PORT|FILE|-")]
    source: String,
    /// Where the anchors are.
    #[arg(long, value_name = "FILE")]
    anchors: PathBuf,
    /// It rests: one place from everything, its anchors' offsets found with it.
    #[arg(long)]
    still: bool,
    /// Lowest and highest place that can be, metres: decides between places that fit equally well.
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true)]
    heights: Option<Heights>,
    /// Standard deviation of a receive time stamp, in metres.
    #[arg(long, value_name = "M", default_value_t = 0.03)]
    stamp_sigma: f64,
    /// Standard deviation of a difference in metres, where the CSV file has no sigma_m.
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    sigma: f64,
    /// Standard deviation of what anchors are off by (antenna delays, their places), in metres.
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    offset_sigma: f64,
    /// How restless it is: root of the spectral density of its acceleration, m/s^1.5.
    #[arg(long, value_name = "Q", default_value_t = 0.5)]
    acceleration: f64,
    /// Seconds between two places that are told; 0 tells every one.
    #[arg(long, value_name = "S", default_value_t = 0.5)]
    every: f64,
    /// Leave after so many seconds.
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Compare with this track: CSV with t_s, x_m, y_m, z_m.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Write the track, every place of it.
    #[arg(long, value_name = "FILE", conflicts_with = "still")]
    out: Option<PathBuf>,
    /// Write a page with the track from above, its height, and its sigmas.
    #[arg(long, value_name = "FILE", conflicts_with = "still")]
    plot: Option<PathBuf>,
    /// One JSON object a place, and one at the end.
    #[arg(long)]
    json: bool,
    /// Pass over lines of a CSV file that cannot be used; says how many.
    #[arg(long)]
    skip_bad: bool,
    /// What columns are called in the CSV file, where it differs.
    #[arg(long, value_name = "WANTED=GIVEN,...")]
    columns: Option<ColumnNames>,
    /// Bits per second of a serial port.
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
}

/// Of a listener at rest so many differences are kept, the latest ones.
const MOST_DIFFERENCES: usize = 20_000;
/// Of a track so many places are kept for files, evenly thinned beyond that.
const MOST_PLACES: usize = 200_000;

impl Locate {
    pub(crate) fn run(self) -> Result<()> {
        self.check()?;
        let site = AnchorsFile::read(&self.anchors)?;
        let anchors = Anchors::of(&site, &self.anchors)?;
        let truth = (self.truth.as_deref()).map(input::truth).transpose()?;
        let mut session = Session::new(&self);
        let place = Place::named(&self.source, self.baud)?;
        let mut notes = Vec::new();
        let heard = match &place {
            Place::File(path) => {
                let bytes = std::fs::read(path)
                    .map_err(|error| bad_input!("{place}: cannot be read: {error}"))?;
                // Every frame of a capture ends with a zero byte, which no text has.
                if bytes.contains(&0) {
                    let source = Source::of(place.clone(), Cursor::new(bytes));
                    Some(self.listen(source, &anchors, &mut session, &mut notes)?)
                } else {
                    input::differences(&self, path, &anchors, &mut notes, |round| {
                        session.on_round(round)
                    })?;
                    None
                }
            }
            _ => {
                let source = Source::open(place.clone())?.retrying(RETRY);
                interrupt::catch()?;
                Some(self.listen(source, &anchors, &mut session, &mut notes)?)
            }
        };
        session.end(&place, heard.as_ref(), &anchors, truth.as_ref(), notes)
    }

    fn check(&self) -> Result<()> {
        for (name, value, least, most) in [
            ("--stamp-sigma", self.stamp_sigma, 1e-4, 10.0),
            ("--sigma", self.sigma, 1e-4, 1e3),
            ("--offset-sigma", self.offset_sigma, 1e-4, 1e3),
            ("--acceleration", self.acceleration, 1e-4, 1e3),
            ("--every", self.every, 0.0, 1e6),
            ("--duration", self.duration.unwrap_or(1.0), 1e-3, 3.2e7),
        ] {
            // NaN is in no range.
            if !(least..=most).contains(&value) {
                return Err(bad_input!("{name} must lie between {least} and {most}"));
            }
        }
        Ok(())
    }

    /// Hears the board until it ends, or nobody wants more.
    fn listen(
        &self,
        mut source: Source,
        anchors: &Anchors,
        session: &mut Session<'_>,
        notes: &mut Vec<String>,
    ) -> Result<ListeningCounts> {
        let until = (self.duration).map(|s| Instant::now() + Duration::from_secs_f64(s));
        source.ask_for_settings();
        let mut board = Board::new(anchors, self.stamp_sigma);
        let over = || interrupt::caught() || until.is_some_and(|until| Instant::now() >= until);
        while !over() && board.read(&mut source, session)? {}
        board.end(session);
        board.check(source.place())?;
        notes.extend(board.notes());
        Ok(*board.counts())
    }

    fn tdoa(&self) -> TdoaOptions {
        TdoaOptions {
            offset_sigma_m: self.offset_sigma,
            heights_m: self.heights.map(|Heights(heights)| heights),
            ..TdoaOptions::default()
        }
    }
}

/// Places as they come out.
struct Session<'a> {
    of: &'a Locate,
    track: ListenerTrack,
    /// All differences, where it rests.
    all: Vec<RangeDifference>,
    places: Vec<Placed>,
    counts: Counts,
    told_s: f64,
    /// What writing the places failed with.
    broken: Option<std::io::Error>,
}

impl<'a> Session<'a> {
    fn new(of: &'a Locate) -> Self {
        Self {
            of,
            track: ListenerTrack::new(ListenerTrackOptions {
                start: of.tdoa(),
                filter: DifferenceFilterOptions {
                    acceleration: of.acceleration,
                    offset_sigma_m: of.offset_sigma,
                    ..DifferenceFilterOptions::default()
                },
                ..ListenerTrackOptions::default()
            }),
            all: Vec::new(),
            places: Vec::new(),
            counts: Counts::default(),
            told_s: f64::NEG_INFINITY,
            broken: None,
        }
    }

    /// The board started anew, and its clock with it.
    fn restart(&mut self) {
        self.track.restart();
        self.told_s = f64::NEG_INFINITY;
    }

    fn on_round(&mut self, round: ListenedRound) {
        self.counts.differences += round.differences.len();
        if self.of.still {
            if self.all.len() >= MOST_DIFFERENCES {
                self.all.drain(..MOST_DIFFERENCES / 4);
            }
            self.all
                .extend(round.differences.iter().map(|one| one.difference));
            return;
        }
        let judged = self.track.on_round(round);
        self.counts.add(&judged);
        let Some(state) = self
            .track
            .state()
            .filter(|_| judged != RoundJudgement::default())
        else {
            return;
        };
        let placed = Placed::new(&state, self.track.alternative_m(), &judged);
        if self.places.len() >= MOST_PLACES {
            let mut odd = false;
            self.places.retain(|_| {
                odd = !odd;
                odd
            });
        }
        if placed.t_s - self.told_s >= self.of.every && self.broken.is_none() {
            self.told_s = placed.t_s;
            let line = placed.line(self.of.json);
            let mut out = std::io::stdout().lock();
            self.broken = out
                .write_all(line.as_bytes())
                .and_then(|()| out.flush())
                .err();
        }
        self.places.push(placed);
    }

    /// Says what came of it all.
    fn end(
        mut self,
        place: &Place,
        heard: Option<&ListeningCounts>,
        anchors: &Anchors,
        truth: Option<&Track>,
        notes: Vec<String>,
    ) -> Result<()> {
        if let Some(error) = self.broken.take() {
            return Err(error.into());
        }
        let still = if self.of.still {
            let fix = locate_tdoa(&self.all, &self.of.tdoa())
                .map_err(|error| bad_input!("{place}: {error}; {}", self.had(heard)))?;
            self.counts.used = self.all.len() - fix.outliers;
            self.counts.set_aside = fix.outliers;
            Some(Still::new(&fix, anchors))
        } else {
            if self.places.is_empty() {
                return Err(bad_input!(
                    "{place}: no place can be told; {}",
                    self.had(heard)
                ));
            }
            None
        };
        if let Some(path) = &self.of.out {
            write_whole(path, report::csv(&self.places))?;
        }
        let report = Report::new(&self.places, still, self.counts, heard, truth, notes);
        if let Some(path) = &self.of.plot {
            page::write(path, &self.places, anchors, truth, &report)?;
        }
        let said = if self.of.json {
            report.json()?
        } else {
            report.text()
        };
        Ok(std::io::stdout().write_all(said.as_bytes())?)
    }

    /// What there was, for an error.
    fn had(&self, heard: Option<&ListeningCounts>) -> String {
        let mut said = format!(
            "{} differences were had, and four anchors in at least {} of them over half a second are needed",
            self.counts.differences,
            ListenerTrackOptions::default().start_differences
        );
        for (name, count) in heard.map(ListeningCounts::rejections).into_iter().flatten() {
            if count > 0 {
                said += &format!("; {name} {count}");
            }
        }
        said
    }
}
