//! `nova bridge`: a board's ranges to an autopilot, as MAVLink.

mod core;
mod counts;
pub(super) mod journal;
mod lines;
mod out;
mod pace;
mod summary;
#[cfg(test)]
mod tests;

use crate::commands::guide::live::{Arrival, HostClock, hear_board};
use crate::commands::guide::options::NavigatorOptions;
use crate::error::bad_input;
use crate::interrupt;
use crate::mavlink::link::LinkNews;
use crate::mavlink::outbound::TargetFrame;
use crate::mavlink::stream::{Incoming, Outgoing};
use crate::mavlink::{Link, MavPlace};
use crate::peer::Peer;
use crate::sim_node::BAUD;
use crate::source::{self, RETRY, Source};
use anyhow::Result;
use core::{Given, Orders};
use journal::Journal;
use out::{Out, Told};
use std::io::Write;
use std::path::PathBuf;
use std::sync::mpsc;
use std::time::{Duration, Instant};
use summary::{End, Ended, summarise};

/// Tells an autopilot (PX4, ArduPilot) over MAVLink 2 what a board measures and where to land.
///
/// Out: each range as DISTANCE_SENSOR (of the orientation "custom", so that none is taken for the height above ground); the node's place
/// as LANDING_TARGET with position_valid, once the MAP navigator is sure of it to --max-sigma; HEARTBEAT and TIMESYNC once a second; with
/// --fly the navigator's waypoints as SET_POSITION_TARGET_LOCAL_NED. In: LOCAL_POSITION_NED is the vehicle's track, ATTITUDE turns
/// the landing place into its frame; both are asked for with MAV_CMD_SET_MESSAGE_INTERVAL. docs/mavlink.md has frames, units and set-up.
///
/// The vehicle's mode is never changed: to land on the node switch to the autopilot's precision landing, to fly by --fly to its offboard
/// or guided mode.
///
/// A capture as --board is played at the pace at which it was recorded. Ctrl-C ends with a summary. --record keeps all that was heard and
/// said, for common viewers and for `nova replay`, which gives the same estimates from it.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova bridge --board /dev/ttyACM0 --mavlink udpin:0.0.0.0:14540                PX4 (SITL or a companion computer)
  nova bridge --board /dev/ttyACM0 --mavlink serial:/dev/ttyAMA0:921600         ArduPilot on a telemetry port
  nova bridge --board tcp://127.0.0.1:7000 --mavlink tcp:127.0.0.1:5760 --json  both ends simulated
  nova bridge --board anchor.bin --mavlink udp:127.0.0.1:14550 --peer 7         a capture, to a ground station
  nova bridge --board /dev/ttyACM0 --mavlink udpin:0.0.0.0:14540 --record flight.mcap")]
pub(crate) struct Bridge {
    /// Where the ranges come from: a serial port, tcp://HOST:PORT, a capture, or `-`.
    #[arg(long, value_name = "PORT|tcp://HOST:PORT|FILE|-")]
    board: PathBuf,
    /// The way to the autopilot.
    #[arg(
        long,
        value_name = "udp:HOST:PORT|udpin:ADDR:PORT|tcp:HOST:PORT|serial:PORT[:BAUD]"
    )]
    mavlink: MavPlace,
    /// Only this node. Without it all are told as DISTANCE_SENSOR, and the first heard is the landing place.
    #[arg(long, value_name = "NODE")]
    peer: Option<String>,
    /// The frame of LANDING_TARGET. Without it what the autopilot takes: PX4 local-ned, ArduPilot body-frd.
    #[arg(long, value_enum)]
    frame: Option<TargetFrame>,
    /// No landing place is told while its horizontal sigma is more than this, metres.
    #[arg(long, value_name = "M", default_value_t = 1.0)]
    max_sigma: f64,
    /// Send the navigator's waypoints as position targets.
    #[arg(long)]
    fly: bool,
    /// How often the autopilot is asked to tell its place and attitude, Hz; 0 to ask for nothing.
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    rate: f32,
    /// Our MAVLink system; the autopilot's own as soon as it is heard.
    #[arg(long, default_value_t = 1)]
    system: u8,
    /// Our MAVLink component; 191 is the first onboard computer.
    #[arg(long, default_value_t = 191)]
    component: u8,
    #[command(flatten)]
    navigator: NavigatorOptions,
    /// Bits per second of the board's serial port.
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
    /// A JSON line for each estimate (as `nova guide` has them), and {"end": {...}} at the end.
    #[arg(long)]
    json: bool,
    /// With --json: a line for each reading of the autopilot's sensors too, SI units.
    #[arg(long, requires = "json")]
    readings: bool,
    /// Record all that is heard and said.
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
}

/// What comes from either side.
enum Came {
    Board(Arrival, Instant),
    Autopilot(LinkNews),
}

impl From<Arrival> for Came {
    fn from(arrival: Arrival) -> Self {
        Self::Board(arrival, Instant::now())
    }
}

impl Bridge {
    pub(crate) fn run(self) -> Result<()> {
        self.check()?;
        let orders = self.orders();
        orders.check()?;
        let board = self.open_board()?;
        let clock = HostClock::start();
        let start_s = clock.now_s();
        interrupt::catch()?;
        let (to_us, came) = mpsc::channel();
        let from_autopilot = to_us.clone();
        let deliver = move |news| from_autopilot.send(Came::Autopilot(news)).is_ok();
        let link = Link::open(&self.mavlink, deliver)?;
        let begin = |path: &PathBuf| Journal::begin(path, &orders, start_s);
        let journal = self.record.as_ref().map(begin).transpose()?;
        std::thread::spawn(move || hear_board(board, clock, &to_us));

        let frames = Outgoing::of(self.system, self.component);
        let told = Told {
            news: self.json,
            readings: self.readings,
        };
        let mut out = Out::new(&link, frames, told, journal);
        let mut bridge = core::Bridge::new(orders, start_s);
        let mut incoming = Incoming::new();
        let place = self.mavlink.to_string();
        let end = pump(&came, clock, &mut bridge, &mut incoming, &mut out, &place);
        let noted = out.finish()?;
        let (sent, vehicle, nodes) = bridge.conclude();
        let ended = Ended {
            autopilot: vehicle.identity(),
            clock_doubt_s: vehicle.clock_doubt_s(),
            received: incoming.counts(),
            vehicle: vehicle.counts(),
            sent,
            latency: noted.latency,
            lines_dropped: noted.lines_dropped,
            nodes: &nodes,
        };
        let mut last = std::io::stdout().lock();
        if self.json {
            serde_json::to_writer(&mut last, &End { end: ended })?;
            writeln!(last)?;
        } else {
            summarise(&mut last, &ended)?;
        }
        last.flush()?;
        end.and(noted.recorded)
    }

    fn check(&self) -> Result<()> {
        if self.system == 0 || self.component == 0 {
            return Err(bad_input!(
                "--system and --component must be more than 0, which stands for all"
            ));
        }
        Ok(())
    }

    fn open_board(&self) -> Result<Source> {
        let place = source::Place::named(&self.board.to_string_lossy(), self.baud)?;
        match &place {
            source::Place::File(path) => {
                let bytes = std::fs::read(path)
                    .map_err(|error| bad_input!("{place}: cannot be read: {error}"))?;
                Ok(Source::of(place, pace::Paced::new(bytes)))
            }
            _ => Ok(Source::open(place)?.retrying(RETRY)),
        }
    }

    fn orders(&self) -> Orders {
        Orders {
            only: self.peer.as_deref().map(Peer::from),
            frame: self.frame,
            most_sigma_m: self.max_sigma,
            fly: self.fly,
            rate_hz: self.rate,
            news: self.json || self.record.is_some(),
            readings: self.readings || self.record.is_some(),
            navigator: self.navigator.clone(),
        }
    }
}

/// Carries on until the board ends or Ctrl-C.
fn pump(
    came: &mpsc::Receiver<Came>,
    clock: HostClock,
    bridge: &mut core::Bridge,
    incoming: &mut Incoming,
    out: &mut Out<'_>,
    place: &str,
) -> Result<()> {
    /// How often Ctrl-C is looked for.
    const PATIENCE_S: f64 = 0.1;
    while !interrupt::caught() && !out.has_nobody() {
        let now_s = clock.now_s();
        if now_s >= bridge.due_s() {
            hand(bridge, Given::Time, now_s, None, out);
        }
        let wait_s = (bridge.due_s() - clock.now_s()).clamp(0.0, PATIENCE_S);
        let came = match came.recv_timeout(Duration::from_secs_f64(wait_s)) {
            Ok(came) => came,
            Err(mpsc::RecvTimeoutError::Timeout) => continue,
            Err(mpsc::RecvTimeoutError::Disconnected) => return Ok(()),
        };
        let now_s = clock.now_s();
        match came {
            Came::Board(Arrival::Range(heard), arrived) => {
                hand(bridge, Given::Range(heard), now_s, Some(arrived), out);
            }
            Came::Board(Arrival::Ins(_), _) => {}
            Came::Board(Arrival::Unusable(why), _) => eprintln!("{why}"),
            Came::Board(Arrival::BoardEnded(end), _) => return end,
            Came::Autopilot(LinkNews::Lost(why)) => {
                incoming.begin_anew();
                eprintln!("{place}: lost, trying again: {why}");
            }
            Came::Autopilot(LinkNews::Back) => eprintln!("{place}: reached again"),
            Came::Autopilot(LinkNews::Bytes(bytes)) => incoming.bytes(&bytes, |header, message| {
                hand(bridge, Given::Message(header, &message), now_s, None, out);
            }),
            Came::Autopilot(LinkNews::Datagram(bytes)) => {
                incoming.datagram(&bytes, |header, message| {
                    hand(bridge, Given::Message(header, &message), now_s, None, out);
                });
            }
        }
        if let Some(system) = bridge.system() {
            out.join(system);
        }
    }
    Ok(())
}

/// Gives the bridge something, for the record too.
fn hand(
    bridge: &mut core::Bridge,
    given: Given<'_>,
    now_s: f64,
    arrived: Option<Instant>,
    out: &mut Out<'_>,
) {
    out.given(&given, now_s, arrived);
    bridge.take(given, now_s, out);
}
