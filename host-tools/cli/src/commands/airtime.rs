//! `nova airtime`: where the time of a round goes.

use crate::error::bad_input;
use crate::sim_node;
use anyhow::Result;
use nova_hal_sim::{BoardConfig, Motion, SimConfig, SimTime, Simulation};
use nova_node::cost::RECORD_NS;
use nova_node::ranging::frame::len;
use nova_node::ranging::phy::{Bitrate, Channel, Preamble, Prf, Turn};
use nova_node::ranging::{Address, MAX_RESPONDERS, PhyProfile, Ticks, Timetable};
use nova_node::{AntennaDelay, NodeConfig, Part, Sharing};
use nova_wire::{Decoder, Event, Record};
use serde::Serialize;
use std::io::{BufWriter, Write};

/// Where the time of a round goes: air, SPI, processor, guard; how many rounds a second that makes, and how
/// many the air alone would allow.
///
/// A round is a poll, a response from each responder, a final and a report from each. Frames' times follow from the
/// radio's mode, those of the bus from its clock and the firmware's transactions; the processor's are measured
/// (docs/air-time.md). It is the same arithmetic by which the firmware chooses its reply times.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova airtime                             one pair in the default mode
  nova airtime --responders 4
  nova airtime --long-range
  nova airtime --bitrate 850 --preamble 256 --json
  nova airtime --measure                   and what two simulated boards make of it")]
pub(crate) struct Airtime {
    /// Channel: 1, 2, 3, 4, 5 or 7.
    #[arg(
        long,
        default_value_t = 5,
        value_name = "N",
        conflicts_with = "long_range"
    )]
    channel: u8,
    /// Rate of the data in kbit/s: 110, 850 or 6800.
    #[arg(
        long,
        default_value_t = 6_800,
        value_name = "KBPS",
        conflicts_with = "long_range"
    )]
    bitrate: u32,
    /// Pulse repetition frequency in MHz: 16 or 64.
    #[arg(
        long,
        default_value_t = 64,
        value_name = "MHZ",
        conflicts_with = "long_range"
    )]
    prf: u8,
    /// Symbols of the preamble: 64, 128, 256, 512, 1024, 1536, 2048 or 4096.
    #[arg(
        long,
        default_value_t = 128,
        value_name = "SYMBOLS",
        conflicts_with = "long_range"
    )]
    preamble: u16,
    /// The mode for long range: channel 5, 110 kbit/s, 64 MHz, 2048 symbols.
    #[arg(long)]
    long_range: bool,
    /// Responders in the round.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=MAX_RESPONDERS as i64))]
    responders: u8,
    /// Clock of the SPI bus in MHz.
    #[arg(long, default_value_t = 8, value_name = "MHZ", value_parser = clap::value_parser!(u32).range(1..=20))]
    spi_mhz: u32,
    /// Lets simulated boards range without pause for a second, and counts. They have an SPI of 8 MHz.
    #[arg(long, conflicts_with = "spi_mhz")]
    measure: bool,
    /// One JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

/// What is printed.
#[derive(Serialize)]
struct Report {
    profile: String,
    responders: usize,
    spi_hz: u32,
    reply_us: u32,
    slot_us: u32,
    steps: Vec<Step>,
    /// Sums over the steps.
    round: Step,
    rounds_per_s: f64,
    ranges_per_s: f64,
    /// With nothing between the frames.
    limit_rounds_per_s: f64,
    /// Share of the limit.
    reached: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    measured_ranges_per_s: Option<f64>,
}

/// One frame and what goes before it, in microseconds.
#[derive(Clone, Serialize, Default)]
struct Step {
    step: String,
    wake_us: f64,
    bus_us: f64,
    cpu_us: f64,
    /// The radio's own start.
    radio_us: f64,
    guard_us: f64,
    air_us: f64,
    total_us: f64,
}

impl Airtime {
    pub(crate) fn run(self) -> Result<()> {
        let config = self.config()?;
        let mut report = report(&config, self.responders.into());
        if self.measure {
            report.measured_ranges_per_s = Some(measure(&config, self.responders)?);
        }
        let mut out = BufWriter::new(std::io::stdout().lock());
        if self.json {
            serde_json::to_writer_pretty(&mut out, &report)?;
            writeln!(out)?;
        } else {
            write(&report, &mut out)?;
        }
        Ok(out.flush()?)
    }

    /// The initiator that is asked about.
    fn config(&self) -> Result<NodeConfig> {
        let phy = if self.long_range {
            PhyProfile::LONG_RANGE
        } else {
            self.profile().map_err(|error| bad_input!("{error}"))?
        };
        let mut config = initiator(phy, self.responders);
        config.budget.spi_hz = self.spi_mhz * 1_000_000;
        config
            .check()
            .map_err(|error| bad_input!("{phy}: {error}"))?;
        Ok(config)
    }

    fn profile(&self) -> Result<PhyProfile, nova_node::ranging::phy::PhyError> {
        let profile = PhyProfile {
            channel: Channel::try_from(self.channel)?,
            bitrate: Bitrate::try_from(self.bitrate)?,
            prf: Prf::try_from(self.prf)?,
            preamble: Preamble::try_from(self.preamble)?,
        };
        profile.check()?;
        Ok(profile)
    }
}

/// An initiator of rounds with the nodes 1, 2, ... that does not pause.
fn initiator(phy: PhyProfile, responders: u8) -> NodeConfig {
    NodeConfig {
        phy,
        part: Part::Initiator {
            period_us: 1,
            per_round: responders,
            peers: (1..=responders).map(|n| Address(n.into())).collect(),
            sharing: Sharing::Elect,
            sleep: false,
        },
        ..NodeConfig::anchor(Address(100))
    }
}

fn report(config: &NodeConfig, responders: usize) -> Report {
    let steps = steps(config, responders);
    let sum = |of: fn(&Step) -> f64| steps.iter().map(of).sum::<f64>();
    let round = Step {
        step: "round".to_owned(),
        wake_us: sum(|s| s.wake_us),
        bus_us: sum(|s| s.bus_us),
        cpu_us: sum(|s| s.cpu_us),
        radio_us: sum(|s| s.radio_us),
        guard_us: sum(|s| s.guard_us),
        air_us: sum(|s| s.air_us),
        total_us: sum(|s| s.total_us),
    };
    let rounds_per_s = 1e6 / round.total_us;
    Report {
        profile: config.phy.to_string(),
        responders,
        spi_hz: config.budget.spi_hz,
        reply_us: config.reply_us(),
        slot_us: config.slot_us(),
        rounds_per_s,
        ranges_per_s: rounds_per_s * responders as f64,
        limit_rounds_per_s: 1e6 / round.air_us,
        reached: round.air_us / round.total_us,
        steps,
        round,
        measured_ranges_per_s: None,
    }
}

fn steps(config: &NodeConfig, responders: usize) -> Vec<Step> {
    let NodeConfig { phy, budget, .. } = config;
    let timing = config.timing(AntennaDelay::UNCALIBRATED);
    let table = Timetable::new(&timing, responders);
    let (poll, last) = (len::poll(responders), len::last(responders));
    let mut steps = vec![Step {
        step: "poll".to_owned(),
        air_us: us(phy.frame_time(poll)),
        ..Step::default()
    }];
    // When each frame is due after the poll, what it takes at least, and its length.
    let mut frames = vec![(
        "response 1".to_owned(),
        table.response_us(0),
        budget.reply(phy, poll, len::RESPONSE),
        len::RESPONSE,
    )];
    for k in 1..responders {
        let turn = budget.slot(phy, len::RESPONSE);
        frames.push((
            format!("response {}", k + 1),
            table.response_us(k),
            turn,
            len::RESPONSE,
        ));
    }
    let turn = budget.reply(phy, len::RESPONSE, last);
    frames.push(("final".to_owned(), table.final_us(), turn, last));
    let turn = budget.reply(phy, last, len::REPORT);
    frames.push(("report 1".to_owned(), table.report_us(0), turn, len::REPORT));
    for k in 1..responders {
        let turn = budget.slot(phy, len::REPORT);
        frames.push((
            format!("report {}", k + 1),
            table.report_us(k),
            turn,
            len::REPORT,
        ));
    }
    let mut before_us = 0;
    for (name, due_us, turn, bytes) in frames {
        let spare_us = f64::from(due_us - before_us) - us(turn.total());
        steps.push(step(name, &turn, spare_us, us(phy.frame_time(bytes))));
        before_us = due_us;
    }
    steps.push(next_poll(config, poll));
    for step in &mut steps {
        step.total_us =
            step.wake_us + step.bus_us + step.cpu_us + step.radio_us + step.guard_us + step.air_us;
    }
    steps
}

fn step(step: String, turn: &Turn, spare_us: f64, air_us: f64) -> Step {
    Step {
        step,
        wake_us: us(turn.wake),
        bus_us: us(turn.bus),
        cpu_us: us(turn.cpu),
        radio_us: us(turn.start_up),
        guard_us: us(turn.guard) + spare_us,
        air_us,
        total_us: 0.0,
    }
}

/// What the initiator does between the last report and the next poll.
fn next_poll(config: &NodeConfig, poll: usize) -> Step {
    let budget = &config.budget;
    let bus_ns = budget.bus_ns(&budget.take, len::REPORT as u64)
        + budget.bus_ns(&budget.answer, poll as u64);
    let cpu_ns = budget.take.cpu_ns + budget.listen.cpu_ns + RECORD_NS + budget.answer.cpu_ns;
    Step {
        step: "next poll".to_owned(),
        wake_us: f64::from(budget.wake_ns) * 1e-3,
        bus_us: bus_ns as f64 * 1e-3,
        cpu_us: f64::from(cpu_ns) * 1e-3,
        radio_us: f64::from(budget.transmitter_ns) * 1e-3,
        ..Step::default()
    }
}

fn us(ticks: Ticks) -> f64 {
    ticks.to_ns() as f64 * 1e-3
}

fn write(report: &Report, out: &mut impl Write) -> Result<()> {
    writeln!(
        out,
        "{}; SPI {} MHz; {} responder{}\nreply time {} us, slot {} us\n",
        report.profile,
        report.spi_hz / 1_000_000,
        report.responders,
        if report.responders == 1 { "" } else { "s" },
        report.reply_us,
        report.slot_us,
    )?;
    writeln!(
        out,
        "{:<12}{:>8}{:>8}{:>8}{:>8}{:>8}{:>9}{:>10}  us",
        "", "wake", "SPI", "CPU", "radio", "guard", "air", "total"
    )?;
    for step in report.steps.iter().chain([&report.round]) {
        writeln!(
            out,
            "{:<12}{:>8.1}{:>8.1}{:>8.1}{:>8.1}{:>8.1}{:>9.1}{:>10.1}",
            step.step,
            step.wake_us,
            step.bus_us,
            step.cpu_us,
            step.radio_us,
            step.guard_us,
            step.air_us,
            step.total_us
        )?;
    }
    writeln!(
        out,
        "\n{:.0} rounds a second, {:.0} ranges a second\nlimit with nothing between the frames: {:.0} rounds a second; reached: {:.0} %",
        report.rounds_per_s,
        report.ranges_per_s,
        report.limit_rounds_per_s,
        100.0 * report.reached
    )?;
    if let Some(rate) = report.measured_ranges_per_s {
        writeln!(out, "simulated boards: {rate:.0} ranges a second")?;
    }
    Ok(())
}

/// Ranges a second of simulated boards, 2 m apart, that do not pause.
fn measure(config: &NodeConfig, responders: u8) -> Result<f64> {
    /// The radios start.
    const SETTLING_US: u64 = 100_000;
    const SECOND_US: u64 = 1_000_000;
    let mut sim = Simulation::new(SimConfig::default());
    let board = |x: f64| BoardConfig {
        motion: Motion::fixed([x, 0.0, 0.0]),
        ..BoardConfig::default()
    };
    let initiator = sim_node::add(&mut sim, board(0.0), config.clone())?;
    for n in 1..=responders {
        let node = NodeConfig {
            phy: config.phy,
            ..NodeConfig::tag(Address(n.into()))
        };
        sim_node::add(&mut sim, board(2.0 * f64::from(n)), node)?;
    }
    sim.run_until(SimTime::from_us(SETTLING_US + SECOND_US))?;
    let mut decoder = Decoder::new();
    let chunks = sim.uart(initiator);
    let bytes = chunks.iter().flat_map(|chunk| &chunk.bytes);
    let ranges = bytes
        .filter_map(|&byte| match decoder.push(byte) {
            Some(Event::Record {
                record: Record::Range(range),
                ..
            }) => Some(range.t_us),
            _ => None,
        })
        .filter(|&t_us| t_us >= SETTLING_US)
        .count();
    Ok(ranges as f64)
}
