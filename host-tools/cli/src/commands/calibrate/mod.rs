//! `nova calibrate`: antenna delays from ranges at known distances.

mod collect;
mod report;
mod survey;

use crate::error::bad_input;
use crate::node_address::{hex, parse};
use crate::sim_node::BAUD;
use crate::table::{ColumnNames, Table};
use anyhow::Result;
use collect::{Collected, Delays, Enough, Sample, collect};
use nova_solver::calibration::{
    CalibrationError, CalibrationOptions, NodePrior, Pair, RangeBias, calibrate,
};
use report::{MeasuredPair, Report};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;
use survey::{GivenDistance, GivenPosition, Link, Placement};

/// Antenna delays of two, three or more nodes from ranges at known distances.
///
/// Nodes stand still, in sight of each other, at distances that were measured (--distance) or places
/// that were surveyed (--at). The streams of those that report ranges are recordings, or live ports,
/// which are listened to until every pair has --ranges of them. All pairs are solved together.
///
/// Two nodes give only the sum of what they are off: each gets half, with the doubt that leaves. Three
/// that all range with each other give each its own. With more, a wrong distance shows. Several
/// placements go into one calibration through --survey, a TOML file:
///
///   [[placement]]
///   sources = ["one/0x0001.bin", "one/0x0002.bin"]
///   distances = { "1-2" = 5.02, "1-3" = 7.1 }
///   [[placement]]
///   sources = ["two/0x0002.bin"]
///   positions = { "2" = [0, 0, 1.5], "3" = [4, 0, 1.5] }
///
/// --out writes a file for each node, for `nova config import`. It must know the delays that each node
/// works by: from its port, its recording by `nova listen --record`, or --delays. docs/calibration.md goes through it
/// step by step.
// A TOML table's name in the help is no link.
#[allow(rustdoc::broken_intra_doc_links)]
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova calibrate /dev/ttyACM0 --distance 0x0A1B-0x0102=5.000
  nova calibrate a.bin b.bin c.bin --distance 1-2=5 --distance 1-3=5 --distance 2-3=5 --out delays
  nova calibrate *.bin --at 1=0,0,1.5 --at 2=5,0,1.5 --at 3=2,4,1.5 --json
  nova calibrate --survey survey.toml --known 1
  nova calibrate a.bin --distance 1-2=5 --delays 1=16480,16480")]
pub(crate) struct Calibrate {
    /// Streams of nodes that report ranges.
    #[arg(value_name = "FILE|PORT|tcp://HOST:PORT|-")]
    sources: Vec<String>,
    /// How far apart the antennas of two nodes are, metres.
    #[arg(long = "distance", value_name = "NODE-NODE=M")]
    distances: Vec<GivenDistance>,
    /// Where a node's antenna is, metres.
    #[arg(long = "at", value_name = "NODE=X,Y,Z", allow_hyphen_values = true)]
    positions: Vec<GivenPosition>,
    /// Placements with their streams, instead of the above.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["sources", "distances", "positions"])]
    survey: Option<PathBuf>,
    /// A node that was calibrated before: it stays within so many metres (one sigma; 0.01 if left out).
    #[arg(long = "known", value_name = "NODE[=M]")]
    known: Vec<KnownNode>,
    /// Antenna delays that a node worked by when the ranges were taken, if its stream does not tell.
    /// Without --out they count as 16456 each if nobody does.
    #[arg(long = "delays", value_name = "NODE=TX,RX")]
    delays: Vec<GivenDelays>,
    /// Standard deviation of the distances, metres.
    #[arg(
        long,
        value_name = "M",
        default_value_t = 0.005,
        allow_negative_numbers = true
    )]
    distance_sigma: f64,
    /// Standard deviation of what does not average out of a pair's ranges, metres: reflections, receive
    /// power.
    #[arg(
        long,
        value_name = "M",
        default_value_t = 0.02,
        allow_negative_numbers = true
    )]
    systematic_sigma: f64,
    /// How far a node that is not calibrated may be off, metres (one sigma).
    #[arg(
        long,
        value_name = "M",
        default_value_t = 0.3,
        allow_negative_numbers = true
    )]
    prior_sigma: f64,
    /// Take the bias of ranges with receive power off by this table instead of the boards' own: CSV of
    /// rx_power_dbm and bias_m, by which ranges are too long.
    #[arg(long, value_name = "FILE")]
    range_bias: Option<PathBuf>,
    /// What that table calls rx_power_dbm and bias_m, where it differs.
    #[arg(long, value_name = "WANTED=GIVEN,...", requires = "range_bias")]
    range_bias_columns: Option<ColumnNames>,
    /// The part of a node's delays that falls to sending; as it was if left out. Two-way ranging does
    /// not see it; APS014 says 0.44.
    #[arg(long, value_name = "PART", allow_negative_numbers = true)]
    tx_share: Option<f64>,
    /// Live: as many ranges of each pair are enough.
    #[arg(long, value_name = "N", default_value_t = 1_000)]
    ranges: usize,
    /// Live: and no more time than this is spent, seconds.
    #[arg(
        long,
        value_name = "S",
        default_value_t = 60.0,
        allow_negative_numbers = true
    )]
    duration: f64,
    /// Write a TOML file for each node into this folder.
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// One JSON object instead of a table.
    #[arg(long)]
    json: bool,
    /// Bits per second of serial ports.
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
}

/// What firmware takes a board's delays for until it is told otherwise: the vendor's figure at
/// 64 MHz, 257.5 ns each way.
const UNCALIBRATED: Delays = Delays {
    tx_ticks: 16_456,
    rx_ticks: 16_456,
};

/// `NODE` or `NODE=SIGMA`.
#[derive(Clone, Copy, Debug)]
struct KnownNode {
    node: u16,
    sigma_m: f64,
}

impl FromStr for KnownNode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const SIGMA_M: f64 = 0.01;
        let (node, sigma_m) = match text.split_once('=') {
            None => (text, Some(SIGMA_M)),
            Some((node, sigma)) => (node, sigma.trim().parse().ok()),
        };
        match sigma_m.filter(|s: &f64| *s > 0.0 && *s < 100.0) {
            Some(sigma_m) => Ok(Self {
                node: parse(node)?,
                sigma_m,
            }),
            None => Err("not of the form NODE or NODE=SIGMA_M".to_owned()),
        }
    }
}

/// `NODE=TX,RX`.
#[derive(Clone, Copy, Debug)]
struct GivenDelays {
    node: u16,
    delays: Delays,
}

impl FromStr for GivenDelays {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = "not of the form NODE=TX,RX with ticks up to 65535";
        let (node, ticks) = text.split_once('=').ok_or(form)?;
        let (tx, rx) = ticks.split_once(',').ok_or(form)?;
        let ticks = |text: &str| text.trim().parse().map_err(|_| form);
        Ok(Self {
            node: parse(node)?,
            delays: Delays {
                tx_ticks: ticks(tx)?,
                rx_ticks: ticks(rx)?,
            },
        })
    }
}

/// Ranges of a pair, with all that is known about it.
struct Measured {
    pair: MeasuredPair,
    ranges_m: Vec<f64>,
}

impl Calibrate {
    pub(crate) fn run(self) -> Result<()> {
        self.check()?;
        let placements = match &self.survey {
            Some(file) => survey::read(file)?,
            None => vec![Placement::given(
                self.sources.clone(),
                &self.distances,
                &self.positions,
            )?],
        };
        crate::interrupt::catch()?;
        let enough = Enough {
            ranges: self.ranges,
            duration: Duration::from_secs_f64(self.duration),
        };
        let mut collected = Vec::new();
        for placement in &placements {
            let one = collect(placement, self.baud, enough, self.json)?;
            complain_about_silence(&one)?;
            collected.push(one);
        }
        let bias = match &self.range_bias {
            Some(file) => {
                let names = self.range_bias_columns.clone().unwrap_or_default();
                Some(read_bias(file, &names)?)
            }
            None => None,
        };
        let measured = measured(&placements, &collected, bias.as_ref())?;
        let addresses = addresses(&measured);
        let nodes: Vec<(u16, Delays)> = (addresses.iter())
            .map(|&address| Ok((address, self.delays_of(address, &collected)?)))
            .collect::<Result<_>>()?;
        let report = self.solve(&nodes, measured)?;
        let written = match &self.out {
            Some(folder) => report.write_files(folder)?,
            None => Vec::new(),
        };
        let mut out = std::io::stdout().lock();
        if self.json {
            serde_json::to_writer(&mut out, &report)?;
            writeln!(out)?;
        } else {
            report.print(&mut out)?;
            for file in written {
                writeln!(out, "{file}: for `nova config import`")?;
            }
        }
        Ok(out.flush()?)
    }

    fn check(&self) -> Result<()> {
        if self.survey.is_none() && self.sources.is_empty() {
            return Err(bad_input!(
                "no ranges: name recordings or ports, or a --survey"
            ));
        }
        for (name, value, least) in [
            ("--distance-sigma", self.distance_sigma, 0.0),
            ("--systematic-sigma", self.systematic_sigma, 0.0),
            ("--prior-sigma", self.prior_sigma, 1e-6),
            ("--duration", self.duration, 1e-3),
        ] {
            if !(least..=1e6).contains(&value) {
                return Err(bad_input!("{name} must lie between {least} and 1000000"));
            }
        }
        if self
            .tx_share
            .is_some_and(|part| !(0.0..=1.0).contains(&part))
        {
            return Err(bad_input!("--tx-share must lie between 0 and 1"));
        }
        Ok(())
    }

    /// What a node worked by: as the user says, as it says itself, or as it is built.
    ///
    /// # Errors
    /// Nobody says, and files are to be written: delays that start from a guess would set a board wrong
    /// that has others, from its factory or an earlier calibration.
    fn delays_of(&self, address: u16, collected: &[Collected]) -> Result<Delays> {
        let given = self.delays.iter().find(|given| given.node == address);
        let told = collected.iter().find_map(|one| one.delays.get(&address));
        let node = hex(address);
        match (given, told) {
            (Some(given), _) => Ok(given.delays),
            (None, Some(told)) => Ok(*told),
            (None, None) if self.out.is_some() => Err(bad_input!(
                "{node}: its antenna delays when the ranges were taken are not known, so --out cannot \
                 write new ones: say them with --delays {node}=TX,RX (`nova config get` shows them), \
                 or add its port or a recording that holds its settings, as `nova listen --record` makes"
            )),
            (None, None) => {
                eprintln!("{node}: does not tell its antenna delays; taken for 16456 each");
                Ok(UNCALIBRATED)
            }
        }
    }

    fn solve(&self, nodes: &[(u16, Delays)], measured: Vec<Measured>) -> Result<Report> {
        for (option, address) in (self.known.iter().map(|known| ("--known", known.node)))
            .chain(self.delays.iter().map(|given| ("--delays", given.node)))
        {
            if !nodes.iter().any(|(node, _)| *node == address) {
                return Err(bad_input!(
                    "{option} {}: no pair with a known distance holds this node",
                    hex(address)
                ));
            }
        }
        let priors: Vec<NodePrior> = (nodes.iter())
            .map(
                |(address, _)| match self.known.iter().find(|known| known.node == *address) {
                    Some(known) => NodePrior::Known(known.sigma_m),
                    None => NodePrior::Uncalibrated(self.prior_sigma),
                },
            )
            .collect();
        let pairs: Vec<Pair<'_>> = (measured.iter())
            .map(|one| Pair {
                nodes: one.pair.nodes,
                distance_m: one.pair.distance_m,
                distance_sigma_m: self.distance_sigma,
                ranges_m: &one.ranges_m,
            })
            .collect();
        let options = CalibrationOptions {
            systematic_sigma_m: self.systematic_sigma,
            ..CalibrationOptions::default()
        };
        let found =
            calibrate(&priors, &pairs, &options).map_err(|error| explain(&error, &measured))?;
        let pairs: Vec<MeasuredPair> = measured.into_iter().map(|one| one.pair).collect();
        Report::new(nodes, &pairs, &found, self.tx_share)
    }
}

/// A stream that is no board's is not passed over in silence.
fn complain_about_silence(collected: &Collected) -> Result<()> {
    for heard in &collected.heard {
        let name = &heard.name;
        if heard.records == 0 {
            return Err(bad_input!(
                "{name}: no record in {} bytes: is this what a board sent?",
                heard.bytes
            ));
        }
        if !heard.has_address {
            return Err(bad_input!(
                "{name}: it does not say which node it is, which boards do every second: too short"
            ));
        }
    }
    Ok(())
}

/// All pairs that have both ranges and a distance.
fn measured(
    placements: &[Placement],
    collected: &[Collected],
    bias: Option<&RangeBias>,
) -> Result<Vec<Measured>> {
    let mut all: Vec<(usize, Link, f64, Vec<f64>)> = Vec::new();
    for (number, (placement, collected)) in (1..).zip(placements.iter().zip(collected)) {
        for link in placement.links() {
            let ranges_m = corrected(collected.ranges(link), bias);
            match placement.distance_m(link) {
                Some(distance_m) if !ranges_m.is_empty() => {
                    all.push((number, link, distance_m, ranges_m));
                }
                _ => eprintln!("{link}: a known distance, but no range"),
            }
        }
        for link in collected.links() {
            if placement.distance_m(link).is_none() {
                eprintln!("{link}: ranges, but no distance; left out");
            }
        }
    }
    if all.is_empty() {
        return Err(bad_input!(
            "no two nodes have both ranges and a known distance: are the addresses right?"
        ));
    }
    let mut addresses: Vec<u16> = all.iter().flat_map(|(_, link, ..)| link.nodes()).collect();
    addresses.sort_unstable();
    addresses.dedup();
    let places: BTreeMap<u16, usize> = (addresses.into_iter().enumerate())
        .map(|(place, address)| (address, place))
        .collect();
    Ok(all
        .into_iter()
        .map(|(placement, link, distance_m, ranges_m)| Measured {
            pair: MeasuredPair {
                link,
                placement,
                distance_m,
                nodes: link
                    .nodes()
                    .map(|address| places.get(&address).copied().unwrap_or_default()),
            },
            ranges_m,
        })
        .collect())
}

/// The ranges less their bias: by the board's own table, or by this one; those without a receive power then do not count.
fn corrected(ranges: &[Sample], bias: Option<&RangeBias>) -> Vec<f64> {
    let Some(bias) = bias else {
        return ranges.iter().map(|range| range.raw_m).collect();
    };
    (ranges.iter())
        .filter_map(|range| Some(range.raw_m + range.bias_m - bias.at_m(range.rx_power_dbm?)))
        .collect()
}

/// A table of range bias.
fn read_bias(path: &Path, names: &ColumnNames) -> Result<RangeBias> {
    const COLUMNS: [&str; 2] = ["rx_power_dbm", "bias_m"];
    let table = Table::open(path, names, "--range-bias-columns", &COLUMNS)?;
    let [power, bias] = COLUMNS;
    let (power, bias) = (table.require(power)?, table.require(bias)?);
    let mut points = Vec::new();
    table.for_each(|row| {
        row.check_length()?;
        points.push([row.number(power)?, row.number(bias)?]);
        Ok(())
    })?;
    RangeBias::new(points)
        .map_err(|_| bad_input!("{}: a receive power stands there twice", path.display()))
}

/// The nodes of all pairs, in the order of their places.
fn addresses(measured: &[Measured]) -> Vec<u16> {
    let places: BTreeMap<usize, u16> = (measured.iter())
        .flat_map(|one| one.pair.nodes.into_iter().zip(one.pair.link.nodes()))
        .collect();
    places.into_values().collect()
}

fn explain(error: &CalibrationError, measured: &[Measured]) -> anyhow::Error {
    let link = |pair: usize| {
        (measured.get(pair)).map_or_else(|| "a pair".to_owned(), |one| one.pair.link.to_string())
    };
    match error {
        CalibrationError::TooFewRanges { pair, got, needed } => bad_input!(
            "{}: {got} range{}, and {needed} are the least",
            link(*pair),
            if *got == 1 { "" } else { "s" }
        ),
        CalibrationError::BadMeasurement { pair, what } => bad_input!("{}: {what}", link(*pair)),
        other => bad_input!("{other}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_that_nobody_told_are_those_of_the_firmware() {
        let firmware = nova_node::AntennaDelay::UNCALIBRATED;
        let told = (firmware.tx_ticks, firmware.rx_ticks);
        assert_eq!((UNCALIBRATED.tx_ticks, UNCALIBRATED.rx_ticks), told);
    }
}
