//! `nova demo`: two simulated boards, and a tag found.

mod page;

use crate::board_clock::BoardClock;
use crate::error::bad_input;
use crate::files::write_whole;
use crate::{screen, sim_node};
use anyhow::Result;
use nalgebra::Vector3;
use nova_flight::{Positioning, SCurve, SCurveShape};
use nova_hal_sim::{BoardConfig, ClockConfig, Motion, SimConfig, SimTime, Simulation};
use nova_node::NodeConfig;
use nova_node::ranging::Address;
use nova_solver::{Localisation, MultilaterationOptions, RangeMeasurement, multilaterate};
use nova_wire::{Counters, Decoder, Event, Range, Record, Statistics};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Simulates two boards and finds the tag.
///
/// A tag lies on the ground; an anchor flies an S above it and knows where it
/// is, as with RTK-GNSS. Both run the firmware's node on simulated DW1000s with
/// drifting clocks and noise. What the anchor's serial port sends goes through
/// decoder and solver; neither is told where the tag is.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova demo
  nova demo --seed 7 --out seven.html
  nova demo --csv flight.csv && nova solve flight.csv --systematic-sigma 0.0013
  nova demo --capture anchor.bin && nova decode anchor.bin
  nova demo --range-noise-ps 300 --position-noise 0.1 --json")]
pub(crate) struct Demo {
    /// Everything random follows from this number.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The page with the pictures.
    #[arg(long, value_name = "FILE", default_value = "nova-demo.html")]
    out: PathBuf,
    /// Also write the measurements as a CSV file for `nova solve`.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Also write what the anchor's serial port sent, for `nova decode`.
    #[arg(long, value_name = "FILE")]
    capture: Option<PathBuf>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Standard deviation of each receive time stamp, in picoseconds.
    #[arg(
        long,
        value_name = "PS",
        default_value_t = 100.0,
        allow_negative_numbers = true
    )]
    range_noise_ps: f64,
    /// Standard deviation of the anchor's own position along each axis, in metres.
    #[arg(
        long,
        value_name = "M",
        default_value_t = 0.02,
        allow_negative_numbers = true
    )]
    position_noise: f64,
    /// Speed of the flight in m/s.
    #[arg(
        long,
        value_name = "M_PER_S",
        default_value_t = 2.0,
        allow_negative_numbers = true
    )]
    speed: f64,
}

const TAG: Address = Address(0x0001);
const ANCHOR: Address = Address(0x000A);

/// The anchor waits for this long before it takes off.
const TAKE_OFF_S: f64 = 0.5;

/// Simulated time between two looks at the serial port.
const STEP_S: f64 = 0.1;

/// The flight: an S of two half circles with this radius, 14 m up at its start
/// and 8 m at its end.
const RADIUS_M: f64 = 8.0;
const START_HEIGHT_M: f64 = 14.0;
const CLIMB_M: f64 = -6.0;

/// Errors of the simulated boards that do not average out. Their antenna delays
/// are calibrated, but crystals that both run fast stretch these 515 ns: 1.3 mm
/// rms for two crystals anywhere within 20 ppm.
const SYSTEMATIC_SIGMA_M: f64 = 0.0013;

/// What chance decides.
struct Draw {
    tag_m: Vector3<f64>,
    tag_clock: ClockConfig,
    anchor_clock: ClockConfig,
}

/// What the host has after the flight.
struct Flight {
    bytes: Vec<u8>,
    ranges: Vec<Range>,
    clock: BoardClock,
    counters: Option<Counters>,
    statistics: Statistics,
}

/// The results, as printed with `--json`.
#[derive(Serialize)]
struct Summary {
    seed: u64,
    tag_m: [f64; 3],
    estimate_m: [f64; 3],
    error_m: f64,
    sigma_m: [f64; 3],
    covariance_m2: [[f64; 3]; 3],
    normalised_error_squared: Option<f64>,
    observable: bool,
    residual_rms_m: f64,
    used: usize,
    rejected: usize,
    clock_offset_ppm: f64,
    true_clock_offset_ppm: f64,
    wire: Statistics,
    counters: Option<Counters>,
    page: PathBuf,
}

impl Demo {
    pub(crate) fn run(self) -> Result<()> {
        self.check()?;
        let path = SCurve::new(SCurveShape {
            start_m: Vector3::new(-2.0 * RADIUS_M, 0.0, START_HEIGHT_M),
            radius_m: RADIUS_M,
            climb_m: CLIMB_M,
            speed_m_per_s: self.speed,
        });
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let draw = draw(&mut rng);
        let flight = self.fly(path, &draw)?;

        let positioning = Positioning::new(self.position_noise)?;
        let measurements: Vec<RangeMeasurement> = flight
            .ranges
            .iter()
            .map(|range| {
                let t_s = flight.clock.host_s(range.t_us);
                let true_position_m = path.position_m(t_s - TAKE_OFF_S);
                RangeMeasurement {
                    t_s,
                    position_m: positioning.read(true_position_m, &mut rng),
                    range_m: f64::from(range.raw_m),
                    sigma_m: 0.1,
                }
            })
            .collect();
        let options = MultilaterationOptions {
            systematic_sigma_m: SYSTEMATIC_SIGMA_M,
            ..MultilaterationOptions::default()
        };
        let found = multilaterate(&measurements, &options)?;

        if let Some(file) = &self.capture {
            write_whole(file, &flight.bytes)?;
        }
        if let Some(file) = &self.csv {
            write_csv(file, &measurements)?;
        }
        let summary = self.summary(&draw, &flight, &found);
        page::write(&summary, &measurements, &found)?;
        let said = if self.json {
            serde_json::to_string(&summary)? + "\n"
        } else {
            text(&summary)
        };
        Ok(std::io::stdout().write_all(said.as_bytes())?)
    }

    fn check(&self) -> Result<()> {
        if !(0.0..=10_000.0).contains(&self.range_noise_ps) {
            return Err(bad_input!("--range-noise-ps must lie between 0 and 10000"));
        }
        if !(0.0..=3.0).contains(&self.position_noise) {
            return Err(bad_input!("--position-noise must lie between 0 and 3 m"));
        }
        if !(0.2..=20.0).contains(&self.speed) {
            return Err(bad_input!("--speed must lie between 0.2 and 20 m/s"));
        }
        Ok(())
    }

    /// Lets the boards run while the anchor flies, and listens to its serial port.
    fn fly(&self, path: SCurve, draw: &Draw) -> Result<Flight> {
        let mut sim = Simulation::new(SimConfig {
            seed: self.seed,
            ..SimConfig::default()
        });
        let board = |name: &str, clock, motion| BoardConfig {
            name: name.to_owned(),
            clock,
            motion,
            rx_noise_ps: self.range_noise_ps,
            ..BoardConfig::default()
        };
        let tag = board("tag", draw.tag_clock, Motion::fixed(draw.tag_m.into()));
        sim_node::add(&mut sim, tag, NodeConfig::tag(TAG))?;
        let motion = Motion::path(move |t_s| path.position_m(t_s - TAKE_OFF_S).into());
        let anchor = board("anchor", draw.anchor_clock, motion);
        let anchor = sim_node::add(&mut sim, anchor, NodeConfig::anchor(ANCHOR))?;

        let steps = ((TAKE_OFF_S + path.duration_s()) / STEP_S).ceil() as u64;
        let bar = screen::progress(steps, self.json);
        let mut decoder = Decoder::new();
        let mut flight = Flight {
            bytes: Vec::new(),
            ranges: Vec::new(),
            clock: BoardClock::default(),
            counters: None,
            statistics: Statistics::default(),
        };
        for step in 1..=steps {
            sim.run_until(SimTime::from_s_f64(step as f64 * STEP_S))?;
            for chunk in sim.uart(anchor) {
                let arrival_s = chunk.t.as_s_f64();
                flight.bytes.extend_from_slice(&chunk.bytes);
                for event in chunk.bytes.iter().filter_map(|&b| decoder.push(b)) {
                    flight.take(&event, arrival_s);
                }
            }
            bar.set_position(step);
            if let Some(last) = flight.ranges.last() {
                bar.set_message(format!(
                    "{} ranges, last {:.2} m",
                    flight.ranges.len(),
                    last.raw_m
                ));
            }
        }
        bar.finish_and_clear();
        flight.statistics = *decoder.statistics();
        Ok(flight)
    }

    fn summary(&self, draw: &Draw, flight: &Flight, found: &Localisation) -> Summary {
        let error = found.position_m - draw.tag_m;
        let offsets = flight
            .ranges
            .iter()
            .map(|range| f64::from(range.clock_offset_ppm));
        let count = flight.ranges.len().max(1) as f64;
        Summary {
            seed: self.seed,
            tag_m: draw.tag_m.into(),
            estimate_m: found.position_m.into(),
            error_m: error.norm(),
            sigma_m: found.sigma_m.into(),
            covariance_m2: found.covariance_m2.into(),
            normalised_error_squared: found
                .covariance_m2
                .try_inverse()
                .map(|inverse| error.dot(&(inverse * error))),
            observable: found.observable(),
            residual_rms_m: found.residual_rms_m,
            used: found.used,
            rejected: found.rejected,
            clock_offset_ppm: offsets.sum::<f64>() / count,
            true_clock_offset_ppm: draw.tag_clock.ppm - draw.anchor_clock.ppm,
            wire: flight.statistics,
            counters: flight.counters,
            page: self.out.clone(),
        }
    }
}

impl Flight {
    fn take(&mut self, event: &Event, arrival_s: f64) {
        match event {
            Event::Record {
                record: Record::Range(range),
                ..
            } => self.ranges.push(*range),
            Event::Record {
                record: Record::Status(status),
                ..
            } => {
                self.clock.observe(arrival_s, status.t_us);
                self.counters = Some(status.counters);
            }
            // Counted by the decoder.
            Event::Record { .. } | Event::Trouble(_) => {}
        }
    }
}

fn write_csv(file: &Path, measurements: &[RangeMeasurement]) -> Result<()> {
    let mut text = String::from("t_s,peer,x_m,y_m,z_m,range_m\n");
    for m in measurements {
        let p = m.position_m;
        text += &format!(
            "{:.6},{},{:.4},{:.4},{:.4},{:.4}\n",
            m.t_s, TAG.0, p.x, p.y, p.z, m.range_m
        );
    }
    write_whole(file, text)
}

/// A tag somewhere below the flight, and two crystals within their data sheet.
fn draw(rng: &mut ChaCha8Rng) -> Draw {
    let tag_m = Vector3::new(
        rng.random_range(-2.0 * RADIUS_M..2.0 * RADIUS_M),
        rng.random_range(-RADIUS_M..RADIUS_M),
        0.0,
    );
    let mut clock = || ClockConfig {
        offset_ticks: rng.random_range(0..1 << 40),
        ppm: rng.random_range(-20.0..20.0),
        drift_ppm_per_s: rng.random_range(-0.01..0.01),
    };
    Draw {
        tag_m,
        tag_clock: clock(),
        anchor_clock: clock(),
    }
}

fn text(s: &Summary) -> String {
    let vector = |v: &[f64; 3], digits: usize| {
        let [x, y, z] = v;
        format!("{x:>9.digits$} {y:>9.digits$} {z:>9.digits$}")
    };
    let [c0, c1, c2] = &s.covariance_m2;
    let scaled = |row: &[f64; 3]| vector(&row.map(|v| v * 1e4), 3);
    format!(
        "                     east     north        up\n\
         tag estimated   {} m\n\
         tag in truth    {} m\n\
         error           {:>9.3} m{}\n\
         sigma           {} m\n\
         covariance      {} cm²\n\
         {:16}{}\n\
         {:16}{}\n\
         ranges          {} used, {} set aside, residual rms {:.3} m\n\
         clock offset    {:.3} ppm measured, {:.3} ppm in truth at the start\n\
         wire            {} records, {} lost, {} corrupt\n\
         page            {}\n",
        vector(&s.estimate_m, 3),
        vector(&s.tag_m, 3),
        s.error_m,
        if s.observable {
            ""
        } else {
            "  (the solver says: not observable)"
        },
        vector(&s.sigma_m, 3),
        scaled(c0),
        "",
        scaled(c1),
        "",
        scaled(c2),
        s.used,
        s.rejected,
        s.residual_rms_m,
        s.clock_offset_ppm,
        s.true_clock_offset_ppm,
        s.wire.records,
        s.wire.lost,
        s.wire.corrupt,
        s.page.display()
    )
}
