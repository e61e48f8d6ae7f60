//! `nova guide`: the navigator on measurements, live or from files.

pub(crate) mod guided;
pub(crate) mod lines;
pub(crate) mod live;
pub(crate) mod options;
pub(crate) mod pairing;
mod recording;
mod team;

use crate::error::bad_input;
use crate::interrupt;
use crate::peer::Peer;
use crate::sim_node::BAUD;
use crate::source::{self, RETRY, Source};
use crate::table::ColumnNames;
use anyhow::Result;
use live::{Arrival, HostClock};
use nova_solver::navigation::InsSample;
use options::NavigatorOptions;
use pairing::Heard;
use recording::Reading;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::mpsc;
use std::time::Duration;
use team::{Orders, Team};

/// Guides a vehicle to a tag: ranges and dead reckoning in, estimates and waypoints out.
///
/// The MAP navigator runs on what a board hears and what the vehicle reckons, live or from files, one
/// navigator a node. Each time it has news it prints a line: {"t_s", "peer", "phase", "estimate":
/// {"tag_m", "vehicle_m", "covariance_m2", "sigma_m", "alternative_m", "range_bias_m",
/// "range_sigma_m", "doubts"}, "command": {"id", "action", "waypoint_m", "ins_error"}}. Covariance
/// and sigma are of the tag relative to the vehicle. An autopilot flies to waypoint_m by what it
/// reckons less ins_error. The last lines are {"end": {...}}, one a node.
///
/// Files: ranges are CSV (t_s, peer, range_m) or a capture of what a board sent; dead reckoning is
/// CSV (t_s, x_m, y_m, z_m), ENU metres. Both name times on one clock; the board's clock in a capture
/// counts from --board-start. Between two readings up to 1 s apart the vehicle is taken to have flown
/// straight; ranges without such a pair are counted as unpaired.
///
/// Live: --board names a serial port, tcp://HOST:PORT, or `-` for the board's bytes on standard input; a
/// port or server that is lost is waited for. Dead reckoning
/// comes as UDP datagrams, each a JSON object {"t_s": .., "x_m": .., "y_m": .., "z_m": ..} with t_s
/// in seconds since 1970 on this host's clock; without t_s the time of arrival counts. Ctrl-C ends
/// with the summary.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova guide --board ranges.csv --ins ins.csv
  nova guide --board anchor.bin --ins flight.csv --summary     both from `nova demo --capture --csv`
  nova guide --board log.csv --ins log.csv --range-columns peer=anchor,range_m=distance
  nova guide --board /dev/ttyACM0 --ins udp:127.0.0.1:14600 --peer 7")]
pub(crate) struct Guide {
    /// Ranges: a file, a serial port, tcp://HOST:PORT, or `-`.
    #[arg(long, value_name = "FILE|PORT|tcp://HOST:PORT|-")]
    board: PathBuf,
    /// Dead reckoning: a file or a UDP address to listen on.
    #[arg(long, value_name = "FILE|udp:ADDR:PORT")]
    ins: InsSource,
    /// What the file of ranges calls t_s, peer and range_m, where it differs.
    #[arg(long, value_name = "WANTED=GIVEN,...")]
    range_columns: Option<ColumnNames>,
    /// What the file of dead reckoning calls t_s, x_m, y_m and z_m, where it differs.
    #[arg(long, value_name = "WANTED=GIVEN,...")]
    ins_columns: Option<ColumnNames>,
    /// Only this node.
    #[arg(long, value_name = "NODE")]
    peer: Option<String>,
    #[command(flatten)]
    navigator: NavigatorOptions,
    /// Time, on the clock of the dead reckoning, at which the board of a capture was switched on,
    /// seconds.
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    board_start: f64,
    /// Bits per second of the serial port.
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
    /// Pass over lines that cannot be used instead of stopping at the first; says how many.
    #[arg(long)]
    skip_bad: bool,
    /// A table of what was found, at the end, instead of JSON lines.
    #[arg(long)]
    summary: bool,
}

/// Where dead reckoning comes from.
#[derive(Clone)]
enum InsSource {
    File(PathBuf),
    Udp(String),
}

impl FromStr for InsSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.strip_prefix("udp:") {
            None => Ok(Self::File(text.into())),
            Some(address) if address.contains(':') => Ok(Self::Udp(address.to_owned())),
            Some(_) => Err("not of the form udp:ADDRESS:PORT".to_owned()),
        }
    }
}

impl Guide {
    pub(crate) fn run(self) -> Result<()> {
        self.navigator.check()?;
        if !self.board_start.is_finite() {
            return Err(bad_input!("--board-start must be a finite number"));
        }
        let navigator = |place: &InsSample, heard: &Heard| self.navigator.navigator(place, heard);
        let mut team = Team::new(Orders {
            only: self.peer.as_deref().map(Peer::from),
            summary: self.summary,
            arrival_radius_m: self.navigator.arrival_radius,
            navigator: &navigator,
        });
        match (&self.ins, self.board.is_file()) {
            (InsSource::File(file), true) => self.replay(file, &mut team)?,
            (InsSource::Udp(address), false) => self.follow(address, &mut team)?,
            (InsSource::File(_), false) => {
                return Err(bad_input!(
                    "{}: is no file, and a live board needs live dead reckoning: --ins udp:ADDRESS:PORT",
                    self.board.display()
                ));
            }
            (InsSource::Udp(_), true) => {
                return Err(bad_input!(
                    "{}: is a file, and recorded ranges need recorded dead reckoning: --ins FILE",
                    self.board.display()
                ));
            }
        }
        match team.conclude()? {
            0 => Err(bad_input!(
                "{}: no range of the node{} can be used: dead reckoning does not reach them, or time goes back",
                self.board.display(),
                if self.peer.is_some() {
                    " asked for"
                } else {
                    "s"
                }
            )),
            _ => Ok(()),
        }
    }

    /// Goes through files in order of time.
    fn replay(&self, ins_file: &Path, team: &mut Team<'_>) -> Result<()> {
        let (range_columns, ins_columns) = (
            self.range_columns.clone().unwrap_or_default(),
            self.ins_columns.clone().unwrap_or_default(),
        );
        let ranges = Reading {
            file: &self.board,
            columns: &range_columns,
            skip_bad: self.skip_bad,
        };
        let ins = Reading {
            file: ins_file,
            columns: &ins_columns,
            skip_bad: self.skip_bad,
        };
        let mut ins = recording::ins(&ins)?.into_iter().peekable();
        for heard in recording::ranges(&ranges, self.board_start)? {
            while let Some(sample) = ins.next_if(|sample| sample.t_s <= heard.range.t_s) {
                team.ins(sample)?;
            }
            team.range(heard)?;
        }
        ins.try_for_each(|sample| team.ins(sample))
    }

    /// Takes what arrives until the board ends or Ctrl-C.
    fn follow(&self, address: &str, team: &mut Team<'_>) -> Result<()> {
        /// How often Ctrl-C is looked for.
        const PATIENCE: Duration = Duration::from_millis(100);
        let socket = UdpSocket::bind(address)
            .map_err(|error| bad_input!("--ins udp:{address}: cannot be listened on: {error}"))?;
        let board = source::Place::named(&self.board.to_string_lossy(), self.baud)?;
        let stream = Source::open(board)?.retrying(RETRY);
        interrupt::catch()?;
        let clock = HostClock::start();
        let (to_us, arrivals) = mpsc::channel();
        let from_ins = to_us.clone();
        std::thread::spawn(move || live::hear_ins(&socket, clock, &from_ins));
        std::thread::spawn(move || live::hear_board(stream, clock, &to_us));
        while !interrupt::caught() {
            match arrivals.recv_timeout(PATIENCE) {
                Ok(Arrival::Range(heard)) => team.range(heard)?,
                // A datagram may have been overtaken by the next.
                Ok(Arrival::Ins(sample)) if team.is_late(&sample) => {
                    eprintln!("dead reckoning: {} s comes too late", sample.t_s);
                }
                Ok(Arrival::Ins(sample)) => team.ins(sample)?,
                Ok(Arrival::Unusable(why)) => eprintln!("{why}"),
                Ok(Arrival::BoardEnded(end)) => return end,
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(())
    }
}
