//! `nova simulate`: boards to try the other commands on.

mod outlet;

use crate::error::bad_input;
use crate::node_address::hex;
use crate::{interrupt, sim_node};
use anyhow::Result;
use nova_hal_sim::{BoardConfig, BoardId, ClockConfig, Motion, SimConfig, SimTime, Simulation};
use nova_node::ranging::Address;
use nova_node::{AntennaDelay, NodeConfig};
use outlet::Outlet;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;
use std::f64::consts::TAU;
use std::io::Write;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::{Duration, Instant};

/// Simulates boards whose serial ports can be listened to.
///
/// The boards run the firmware's node on simulated DW1000s with drifting clocks and noise, in real
/// time. Their serial ports come out as TCP servers, one port a board from the one given on
/// (--serve), as pseudo-terminals (--pty), or as recordings (--capture, as fast as it goes).
/// Addresses count from 1 in the order of the boards.
///
/// It says first where each board is to be found, and the truth about it: place, and by how much its
/// antenna delays differ from those that its firmware takes for granted (--antenna-sigma).
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova simulate --serve tcp://127.0.0.1:7000 & nova listen tcp://127.0.0.1:7000
  nova simulate --pty                                    and nova listen /dev/pts/...
  nova simulate --board anchor@0,0,2 --board tag@5,0,1,2 --serve tcp://127.0.0.1:7000
  nova simulate --board anchor@0,0,2 --board tag@5,0,1 --board listener@2,2,1 --capture heard --duration 10
  nova simulate --antenna-sigma 0.3 --capture recordings --duration 10")]
pub(crate) struct Simulate {
    /// A board: anchor, tag or listener, its place in metres, and the radius of the circle on which it
    /// moves about that at 1 m/s, if it does.
    #[arg(
        long = "board",
        value_name = "ROLE@X,Y,Z[,R]",
        default_values = ["anchor@0,0,2", "tag@6,0,1", "tag@2,7,1,2", "tag@-5,3,1"]
    )]
    boards: Vec<Placed>,
    /// Serve the boards' serial ports here and on the ports that follow.
    #[arg(long, value_name = "tcp://HOST:PORT")]
    serve: Option<TcpBase>,
    /// Let the boards' serial ports be pseudo-terminals.
    #[arg(long)]
    pty: bool,
    /// Keep what the boards send in this folder, a file each.
    #[arg(long, value_name = "FOLDER")]
    capture: Option<PathBuf>,
    /// End after so many seconds of simulated time.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    duration: Option<f64>,
    /// Everything random follows from this number.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Standard deviation of each receive time stamp, in picoseconds.
    #[arg(
        long,
        value_name = "PS",
        default_value_t = 100.0,
        allow_negative_numbers = true
    )]
    range_noise_ps: f64,
    /// Standard deviation of the boards' true antenna delays, sending and receiving each, about what
    /// the firmware takes them for; in nanoseconds.
    #[arg(
        long,
        value_name = "NS",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    antenna_sigma: f64,
    /// One JSON object a board instead of text.
    #[arg(long)]
    json: bool,
}

/// What a board does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum BoardRole {
    Anchor,
    Tag,
    Listener,
}

/// A board as given.
#[derive(Clone, Debug)]
struct Placed {
    role: BoardRole,
    place_m: [f64; 3],
    radius_m: f64,
}

impl FromStr for Placed {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || "not of the form ROLE@X,Y,Z or ROLE@X,Y,Z,RADIUS".to_owned();
        let (role, numbers) = text.split_once('@').ok_or_else(form)?;
        let role = match role {
            "anchor" => BoardRole::Anchor,
            "tag" => BoardRole::Tag,
            "listener" => BoardRole::Listener,
            _ => return Err(format!("'{role}' is neither anchor nor tag nor listener")),
        };
        let numbers: Vec<f64> = (numbers.split(','))
            .map(|number| number.trim().parse().ok())
            .map(|number: Option<f64>| number.filter(|n| n.abs() <= 1e4))
            .collect::<Option<_>>()
            .ok_or_else(form)?;
        let (place_m, radius_m) = match numbers[..] {
            [x, y, z] => ([x, y, z], 0.0),
            [x, y, z, radius] if radius >= 0.0 => ([x, y, z], radius),
            _ => return Err(form()),
        };
        Ok(Self {
            role,
            place_m,
            radius_m,
        })
    }
}

impl Placed {
    fn motion(&self) -> Motion {
        const SPEED_M_PER_S: f64 = 1.0;
        let (place_m, radius_m) = (self.place_m, self.radius_m);
        if radius_m == 0.0 {
            return Motion::fixed(place_m);
        }
        Motion::path(move |t_s| {
            let [x, y, z] = place_m;
            let angle = (t_s * SPEED_M_PER_S / radius_m) % TAU;
            [x + radius_m * angle.cos(), y + radius_m * angle.sin(), z]
        })
    }
}

/// The address of the first board's server.
#[derive(Clone, Debug)]
struct TcpBase {
    host: String,
    port: u16,
}

impl FromStr for TcpBase {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text
            .strip_prefix("tcp://")
            .and_then(|address| address.rsplit_once(':'));
        match parts.map(|(host, port)| (host, port.parse())) {
            Some((host, Ok(port))) if !host.is_empty() => Ok(Self {
                host: host.to_owned(),
                port,
            }),
            _ => Err("not of the form tcp://HOST:PORT".to_owned()),
        }
    }
}

/// What is said about a board before it starts.
#[derive(Serialize)]
struct Truth {
    address: u16,
    role: BoardRole,
    place_m: [f64; 3],
    /// True delays less those that the firmware takes for granted, sending and receiving, in ticks.
    antenna_delay_error_ticks: [f64; 2],
    found_at: Vec<String>,
}

/// A board that runs, and where its serial port comes out.
struct Running {
    id: BoardId,
    outlets: Vec<Outlet>,
}

impl Simulate {
    pub(crate) fn run(self) -> Result<()> {
        self.check()?;
        let mut sim = Simulation::new(SimConfig {
            seed: self.seed,
            ..SimConfig::default()
        });
        let mut running = Vec::new();
        let mut truths = Vec::new();
        for (index, placed) in (0..).zip(&self.boards) {
            let outlets = self.outlets(index)?;
            let (id, truth) = self.add(&mut sim, index, placed, &outlets)?;
            running.push(Running { id, outlets });
            truths.push(truth);
        }
        self.tell(&truths)?;
        interrupt::catch()?;
        self.play(&mut sim, &mut running)
    }

    fn check(&self) -> Result<()> {
        if self.serve.is_none() && !self.pty && self.capture.is_none() {
            return Err(bad_input!(
                "nobody could hear these boards: give --serve, --pty or --capture"
            ));
        }
        if !self.in_real_time() && self.duration.is_none() {
            return Err(bad_input!("--capture alone needs --duration"));
        }
        for (name, value, most) in [
            ("--duration", self.duration.unwrap_or(1.0), 1e7),
            ("--range-noise-ps", self.range_noise_ps, 1e4),
            ("--antenna-sigma", self.antenna_sigma, 10.0),
        ] {
            if !(0.0..=most).contains(&value) {
                return Err(bad_input!("{name} must lie between 0 and {most}"));
            }
        }
        if self.boards.len() > 1_000 {
            return Err(bad_input!("--board: more than 1000 boards"));
        }
        Ok(())
    }

    fn in_real_time(&self) -> bool {
        self.serve.is_some() || self.pty
    }

    fn outlets(&self, index: u16) -> Result<Vec<Outlet>> {
        let mut outlets = Vec::new();
        if let Some(TcpBase { host, port }) = &self.serve {
            // Port 0 is any port, for every board.
            let port = match port {
                0 => Some(0),
                port => port.checked_add(index),
            };
            let port = port.ok_or_else(|| bad_input!("--serve: there are no ports above 65535"))?;
            outlets.push(Outlet::tcp(host, port)?);
        }
        if self.pty {
            outlets.push(Outlet::terminal()?);
        }
        if let Some(folder) = &self.capture {
            outlets.push(Outlet::file(folder, &format!("{}.bin", hex(index + 1)))?);
        }
        Ok(outlets)
    }

    fn add(
        &self,
        sim: &mut Simulation,
        index: u16,
        placed: &Placed,
        outlets: &[Outlet],
    ) -> Result<(BoardId, Truth)> {
        /// Nanoseconds to ticks of the DW1000's clock.
        const TICKS_PER_NS: f64 = 63.8976;
        // A board is the same whatever role it plays, and whoever else is there.
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ (u64::from(index) << 32));
        let mut error_ticks = || {
            self.antenna_sigma
                * TICKS_PER_NS
                * Distribution::<f64>::sample(&StandardNormal, &mut rng)
        };
        // Adding zero takes the sign off it.
        let antenna_delay_error_ticks = [error_ticks() + 0.0, error_ticks() + 0.0];
        let [tx_error_ticks, rx_error_ticks] = antenna_delay_error_ticks;
        let address = Address(index + 1);
        let node = match placed.role {
            BoardRole::Anchor => NodeConfig::anchor(address),
            BoardRole::Tag => NodeConfig::tag(address),
            BoardRole::Listener => NodeConfig::listener(address),
        };
        // What the node takes its antenna for, as nobody has told it better.
        let told = AntennaDelay::UNCALIBRATED;
        let board = BoardConfig {
            name: hex(address.0),
            clock: ClockConfig {
                offset_ticks: rng.random_range(0..1 << 40),
                // Trimmed at the factory.
                ppm: rng.random_range(-3.0..3.0),
                drift_ppm_per_s: rng.random_range(-0.01..0.01),
            },
            motion: placed.motion(),
            tx_antenna_delay_ticks: f64::from(told.tx_ticks) + tx_error_ticks,
            rx_antenna_delay_ticks: f64::from(told.rx_ticks) + rx_error_ticks,
            rx_noise_ps: self.range_noise_ps,
            ..BoardConfig::default()
        };
        let id = sim_node::add(sim, board, node)?;
        let truth = Truth {
            address: address.0,
            role: placed.role,
            place_m: placed.place_m,
            antenna_delay_error_ticks,
            found_at: outlets.iter().map(Outlet::name).collect(),
        };
        Ok((id, truth))
    }

    fn tell(&self, truths: &[Truth]) -> Result<()> {
        let mut out = std::io::stdout().lock();
        for truth in truths {
            if self.json {
                serde_json::to_writer(&mut out, truth)?;
                writeln!(out)?;
                continue;
            }
            let [x, y, z] = truth.place_m;
            let [tx, rx] = truth.antenna_delay_error_ticks;
            let role = match truth.role {
                BoardRole::Anchor => "anchor",
                BoardRole::Tag => "tag",
                BoardRole::Listener => "listener",
            };
            writeln!(
                out,
                "{} {role:6} at ({x}, {y}, {z}) m, antenna delays off by {tx:+.1} and {rx:+.1} ticks: {}",
                hex(truth.address),
                truth.found_at.join(", ")
            )?;
        }
        Ok(out.flush()?)
    }

    /// Lets the boards run, in real time if somebody may listen.
    fn play(&self, sim: &mut Simulation, running: &mut [Running]) -> Result<()> {
        /// From one look at the serial ports to the next.
        const STEP_S: f64 = 0.01;
        let start = Instant::now();
        let mut step: u64 = 0;
        while !interrupt::caught() {
            let t_s = step as f64 * STEP_S;
            if self.duration.is_some_and(|duration_s| t_s > duration_s) {
                break;
            }
            sim.run_until(SimTime::from_s_f64(t_s))?;
            for board in running.iter_mut() {
                for outlet in &mut board.outlets {
                    let commands = outlet.take();
                    if !commands.is_empty() {
                        sim.uart_send(board.id, &commands);
                    }
                }
                let sent: Vec<u8> = (sim.uart(board.id).into_iter())
                    .flat_map(|chunk| chunk.bytes)
                    .collect();
                for outlet in &mut board.outlets {
                    outlet.put(&sent)?;
                }
            }
            step += 1;
            if self.in_real_time() {
                // A machine that is too slow falls behind; it never runs ahead.
                let due = Duration::from_secs_f64(t_s);
                std::thread::sleep(due.saturating_sub(start.elapsed()));
            }
        }
        Ok(())
    }
}
