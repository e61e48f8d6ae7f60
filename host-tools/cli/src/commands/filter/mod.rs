//! `nova filter`: the boards' range filter on recorded ranges.
//!
//! | file | what |
//! |---|---|
//! | `mod.rs` | the command: options, reading, output |
//! | `truth.rs` | what the ranges should have been |
//! | `compare.rs` | the filter beside raw ranges, median and moving average |

mod compare;
mod truth;

use crate::error::bad_input;
use crate::table::{Column, ColumnNames, Row, Table};
use anyhow::Result;
use nova_ranging::filter::{Estimate, FilterSettings, RangeFilter, RawRange, Treatment};
use nova_ranging::nlos::{NlosRule, Signs};
use nova_ranging::phy::{Channel, Prf};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use truth::{Place, Trajectory, Truth};

/// The boards' range filter on recorded ranges; with a truth, compared with simpler ones.
///
/// The file is CSV with the columns t_s (time) and range_m (raw range), rx_power_dbm and
/// first_path_power_dbm where known, and those named by --per, which tell one pair of nodes from
/// another: each pair has a filter of its own, the very code that runs on a board. Each line gives the
/// filter's estimate and what it did with the raw range.
///
/// With a truth the result is a comparison instead: raw ranges, median of the last five, mean of the last five
/// and the filter, each with its error (less the median error of the pair's raw ranges, which is a matter of
/// calibration) and its delay behind the raw ranges. The truth is a column truth_m, or a trajectory (--truth; columns
/// t_s, x_m, y_m, z_m) and the other nodes' places (--anchor, or columns anchor_x_m, anchor_y_m, anchor_z_m).
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova filter ranges.csv --per peer
  nova filter ranges.csv --per tag,anchor --json
  nova filter ranges.csv --per from,to --columns truth_m=surveyed_m
  nova filter flight.csv --per anchor --truth mocap.csv --anchor 1=0,0,2.5 --anchor 2=4.2,0,2.5")]
pub(crate) struct Filter {
    /// The CSV file.
    file: PathBuf,
    /// Columns that together tell one pair of nodes from another.
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',')]
    per: Vec<String>,
    /// One JSON object a line instead of a CSV table, or of a table for people.
    #[arg(long)]
    json: bool,
    /// A trajectory of the moving node: the truth.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// How much later the ranges' clock shows the same moment than the trajectory's, in seconds.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value = "0",
        allow_hyphen_values = true
    )]
    truth_delay: f64,
    /// From the trajectory's point to the antenna, in metres.
    #[arg(
        long,
        value_name = "X,Y,Z",
        default_value = "0,0,0",
        allow_hyphen_values = true
    )]
    antenna: Place,
    /// Where a node is: the text in the last column of --per, and a place in metres. Once for each.
    #[arg(long, value_name = "NODE=X,Y,Z", value_parser = named_place)]
    anchor: Vec<(String, Place)>,
    /// Standard deviation of a raw range, in metres.
    #[arg(long, value_name = "METRES", default_value_t = FilterSettings::DEFAULT.sigma_m)]
    sigma: f32,
    /// Spectral density of the range's acceleration, in m^2/s^3: how restless it is.
    #[arg(long, value_name = "DENSITY", default_value_t = FilterSettings::DEFAULT.agility_m2_per_s3)]
    agility: f32,
    /// Ranges left out in a row that agree with each other and are then believed.
    #[arg(long, value_name = "COUNT", default_value_t = FilterSettings::DEFAULT.reacquire_after)]
    reacquire_after: u8,
    /// Channel of the recording, for the NLOS rule.
    #[arg(long, value_name = "NUMBER", default_value = "5")]
    channel: u8,
    /// What columns are called in the file, where it differs.
    #[arg(long, value_name = "WANTED=GIVEN,...")]
    columns: Option<ColumnNames>,
}

/// All ranges of one pair, in the file's order.
#[derive(Default)]
struct Series {
    ranges: Vec<Recorded>,
    /// Where the other node is, as the file says.
    place: Option<Place>,
}

/// A raw range as recorded.
struct Recorded {
    line: usize,
    t_s: f64,
    raw_m: f64,
    powers_dbm: Option<(f64, f64)>,
    truth_m: Option<f64>,
}

/// What the filter says to it.
struct Filtered {
    treatment: Treatment,
    estimate: Option<Estimate>,
    nlos_probability: Option<f32>,
}

/// A line of output.
#[derive(Serialize)]
struct Line<'a> {
    line: usize,
    t_s: f64,
    pair: &'a str,
    raw_m: f64,
    treatment: &'static str,
    range_m: Option<f32>,
    rate_m_per_s: Option<f32>,
    variance_m2: Option<f32>,
    nlos_probability: Option<f32>,
}

const COLUMNS: [&str; 8] = [
    "t_s",
    "range_m",
    "rx_power_dbm",
    "first_path_power_dbm",
    "truth_m",
    "anchor_x_m",
    "anchor_y_m",
    "anchor_z_m",
];

impl Filter {
    pub(crate) fn run(self) -> Result<()> {
        let settings = FilterSettings {
            sigma_m: self.sigma,
            nlos_sigma_m: FilterSettings::DEFAULT.nlos_sigma_m.max(self.sigma),
            agility_m2_per_s3: self.agility,
            reacquire_after: self.reacquire_after,
            ..FilterSettings::DEFAULT
        };
        settings.check().map_err(|error| bad_input!("{error}"))?;
        let channel = Channel::try_from(self.channel).map_err(|error| bad_input!("{error}"))?;
        let rule = NlosRule::new(channel, Prf::Mhz64);
        let series = self.read()?;
        let first_s = series
            .values()
            .flat_map(|series| &series.ranges)
            .fold(f64::INFINITY, |first, range| first.min(range.t_s));
        let filtered: Vec<Vec<Filtered>> = series
            .values()
            .map(|series| filter(&series.ranges, first_s, settings, &rule))
            .collect();
        let mut out = BufWriter::new(std::io::stdout().lock());
        if self.truth.is_some() || series.values().any(Series::has_truth) {
            let truths = self.truths(&series)?;
            let table = compare::compare(series.values().zip(&filtered).zip(&truths))
                .ok_or_else(|| bad_input!("{}: no range has a truth", self.file.display()))?;
            if self.json {
                for row in &table.methods {
                    serde_json::to_writer(&mut out, row)?;
                    out.write_all(b"\n")?;
                }
                serde_json::to_writer(&mut out, &table.treatments)?;
                out.write_all(b"\n")?;
            } else {
                write!(out, "{table}")?;
            }
        } else {
            self.write_lines(&mut out, &series, &filtered)?;
        }
        Ok(out.flush()?)
    }

    fn read(&self) -> Result<BTreeMap<String, Series>> {
        let names = self.columns.clone().unwrap_or_default();
        let table = Table::open(&self.file, &names, "--columns", &COLUMNS)?;
        let [time, range] = [table.require("t_s")?, table.require("range_m")?];
        let [rx, first_path, truth] = [
            table.find("rx_power_dbm")?,
            table.find("first_path_power_dbm")?,
            table.find("truth_m")?,
        ];
        let place = [
            table.find("anchor_x_m")?,
            table.find("anchor_y_m")?,
            table.find("anchor_z_m")?,
        ];
        let per = self
            .per
            .iter()
            .map(|name| table.require(name))
            .collect::<Result<Vec<_>>>()?;
        let mut series: BTreeMap<String, Series> = BTreeMap::new();
        table.for_each(|row| {
            let pair: Vec<&str> = per.iter().map(|&column| row.text(column)).collect();
            let series = series.entry(pair.join("-")).or_default();
            if series.place.is_none()
                && let [Some(x), Some(y), Some(z)] = place
            {
                series.place = Some(Place([row.number(x)?, row.number(y)?, row.number(z)?]));
            }
            let number = |column: Option<Column<'_>>| optional(row, column);
            series.ranges.push(Recorded {
                line: row.line,
                t_s: row.number(time)?,
                raw_m: row.number(range)?,
                powers_dbm: number(rx)?.zip(number(first_path)?),
                truth_m: number(truth)?,
            });
            Ok(())
        })?;
        Ok(series)
    }

    /// The truth for each pair.
    fn truths(&self, series: &BTreeMap<String, Series>) -> Result<Vec<Truth>> {
        let Some(path) = &self.truth else {
            return Ok(series.values().map(|_| Truth::Column).collect());
        };
        let trajectory = Trajectory::read(path, self.truth_delay, self.antenna)?;
        series
            .iter()
            .map(|(pair, series)| {
                let node = pair.rsplit('-').next().unwrap_or_default();
                let given = self.anchor.iter().find(|(name, _)| name == node);
                let place = given.map(|(_, place)| *place).or(series.place);
                let place = place.ok_or_else(|| {
                    bad_input!("where is node '{node}'? --anchor {node}=X,Y,Z tells")
                })?;
                Ok(Truth::Moving(trajectory.distances(place)))
            })
            .collect()
    }

    fn write_lines(
        &self,
        out: &mut impl Write,
        series: &BTreeMap<String, Series>,
        filtered: &[Vec<Filtered>],
    ) -> Result<()> {
        if !self.json {
            writeln!(
                out,
                "line,t_s,pair,raw_m,treatment,range_m,rate_m_per_s,variance_m2,nlos_probability"
            )?;
        }
        for ((pair, series), filtered) in series.iter().zip(filtered) {
            for (range, filtered) in series.ranges.iter().zip(filtered) {
                let line = Line {
                    line: range.line,
                    t_s: range.t_s,
                    pair,
                    raw_m: range.raw_m,
                    treatment: name(filtered.treatment),
                    range_m: filtered.estimate.map(|e| e.range_m),
                    rate_m_per_s: filtered.estimate.map(|e| e.rate_m_per_s),
                    variance_m2: filtered.estimate.map(|e| e.variance_m2),
                    nlos_probability: filtered.nlos_probability,
                };
                if self.json {
                    serde_json::to_writer(&mut *out, &line)?;
                    out.write_all(b"\n")?;
                } else {
                    write_csv(out, &line)?;
                }
            }
        }
        Ok(())
    }
}

impl Series {
    fn has_truth(&self) -> bool {
        self.ranges.iter().any(|range| range.truth_m.is_some())
    }
}

/// The filter on one pair's ranges.
fn filter(
    ranges: &[Recorded],
    first_s: f64,
    settings: FilterSettings,
    rule: &NlosRule,
) -> Vec<Filtered> {
    let mut filter = RangeFilter::new(settings);
    ranges
        .iter()
        .map(|range| {
            let nlos_probability = range.powers_dbm.and_then(|(rx, first_path)| {
                rule.probability(&Signs {
                    rx_power_dbm: rx as f32,
                    first_path_power_dbm: first_path as f32,
                    range_m: range.raw_m as f32,
                })
            });
            let (treatment, estimate) = filter.update(&RawRange {
                at_us: ((range.t_s - first_s) * 1e6).round() as u64,
                range_m: range.raw_m as f32,
                nlos_probability,
            });
            Filtered {
                treatment,
                estimate,
                nlos_probability,
            }
        })
        .collect()
}

/// A number that may be missing.
fn optional(row: &Row<'_>, column: Option<Column<'_>>) -> Result<Option<f64>> {
    match column {
        Some(column) if !row.text(column).is_empty() => row.number(column).map(Some),
        _ => Ok(None),
    }
}

fn write_csv(out: &mut impl Write, line: &Line<'_>) -> Result<()> {
    let number = |value: Option<f32>| value.map_or_else(String::new, |v| v.to_string());
    let pair = if line.pair.contains([',', '"', '\n']) {
        format!("\"{}\"", line.pair.replace('"', "\"\""))
    } else {
        line.pair.to_owned()
    };
    writeln!(
        out,
        "{},{},{pair},{},{},{},{},{},{}",
        line.line,
        line.t_s,
        line.raw_m,
        line.treatment,
        number(line.range_m),
        number(line.rate_m_per_s),
        number(line.variance_m2),
        number(line.nlos_probability),
    )?;
    Ok(())
}

/// A treatment as `nova decode` calls it.
fn name(treatment: Treatment) -> &'static str {
    match treatment {
        Treatment::Started => "started",
        Treatment::Accepted => "accepted",
        Treatment::DownWeighted => "down_weighted",
        Treatment::RejectedOutlier => "rejected_outlier",
        Treatment::RejectedNlos => "rejected_nlos",
        Treatment::RejectedInvalid => "rejected_invalid",
        Treatment::Reacquired => "reacquired",
    }
}

fn named_place(text: &str) -> Result<(String, Place), String> {
    match text.split_once('=') {
        Some((node, place)) => Ok((node.to_owned(), place.parse()?)),
        None => Err("not of the form NODE=X,Y,Z".to_owned()),
    }
}
