//! `nova twr`: ranges from recorded time stamps.

use crate::error::bad_input;
use crate::table::{Column, ColumnNames, Row, Table, file_name};
use anyhow::Result;
use nova_ranging::tof::{SPEED_OF_LIGHT_AIR_M_PER_S, SPEED_OF_LIGHT_VACUUM_M_PER_S};
use nova_ranging::{DeviceTime, Stamps, TwoWay};
use serde::Serialize;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::str::FromStr;

/// Ranges from recorded time stamps of double-sided exchanges.
///
/// The file is CSV with the columns t1_ticks to t6_ticks: poll sent (t1,
/// initiator), poll received (t2, responder), response sent (t3, responder),
/// response received (t4, initiator), final sent (t5, initiator), final
/// received (t6, responder); 40-bit readings of the DW1000's clock, 15.650 ps
/// a tick, which may wrap. Other columns are passed over. Each line gives a
/// range and the clock offset of the responder against the initiator, or the
/// reason why not.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova twr stamps.csv                      a CSV table: line, range_m, clock_offset_ppm, error
  nova twr stamps.csv --json               one JSON object a line
  nova twr - --speed-of-light vacuum < stamps.csv
  nova twr log.csv --columns t1_ticks=poll_tx,t2_ticks=poll_rx")]
pub(crate) struct Twr {
    /// The CSV file; `-` for standard input.
    #[arg(value_name = "FILE|-")]
    file: PathBuf,
    /// One JSON object a line instead of a CSV table.
    #[arg(long)]
    json: bool,
    /// Speed of the radio waves in m/s, or `air` (299702547) or `vacuum` (299792458).
    ///
    /// Air is the default: it is what the waves travel through. The vacuum
    /// value reads 0.03 % long, 3 cm at 100 m.
    #[arg(
        long,
        value_name = "SPEED",
        default_value = "air",
        allow_hyphen_values = true
    )]
    speed_of_light: Speed,
    /// What columns are called in the file, where it differs.
    #[arg(long, value_name = "WANTED=GIVEN,...")]
    columns: Option<ColumnNames>,
}

/// A speed in m/s.
#[derive(Clone, Copy, Debug)]
struct Speed(f64);

impl FromStr for Speed {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "air" => Ok(Self(SPEED_OF_LIGHT_AIR_M_PER_S)),
            "vacuum" => Ok(Self(SPEED_OF_LIGHT_VACUUM_M_PER_S)),
            _ => match text.parse::<f64>() {
                Ok(speed) if (1e8..=SPEED_OF_LIGHT_VACUUM_M_PER_S).contains(&speed) => {
                    Ok(Self(speed))
                }
                _ => Err("not 'air', 'vacuum' or a speed from 1e8 to 299792458 m/s".to_owned()),
            },
        }
    }
}

/// One line's result.
#[derive(Serialize)]
struct Line {
    line: usize,
    range_m: Option<f64>,
    clock_offset_ppm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

impl Twr {
    pub(crate) fn run(self) -> Result<()> {
        let names = self.columns.clone().unwrap_or_default();
        let table = Table::open(&self.file, &names, "--columns", &STAMP_COLUMNS)?;
        let columns = STAMP_COLUMNS
            .iter()
            .map(|name| table.require(name))
            .collect::<Result<Vec<_>>>()?;
        let mut lines = Vec::new();
        table.for_each(|row| {
            lines.push(self.line(row, &columns));
            Ok(())
        })?;
        let failed = lines.iter().filter(|line| line.error.is_some()).count();
        if failed == lines.len() {
            let first = lines.first().map_or_else(String::new, |first| {
                let reason = first.error.as_deref().unwrap_or_default();
                format!("; line {}: {reason}", first.line)
            });
            return Err(bad_input!(
                "{}: no line gives a range{first}",
                file_name(&self.file)
            ));
        }
        self.write(&lines)?;
        if failed > 0 {
            eprintln!("{failed} of {} lines gave no range", lines.len());
        }
        Ok(())
    }

    fn line(&self, row: &Row<'_>, columns: &[Column<'_>]) -> Line {
        let result = stamps(row, columns)
            .and_then(|stamps| TwoWay::from_stamps(&stamps).map_err(|error| error.to_string()));
        let (measured, error) = match result {
            Ok(measured) => (Some(measured), None),
            Err(error) => (None, Some(error)),
        };
        Line {
            line: row.line,
            range_m: measured.map(|m| m.range_m(self.speed_of_light.0)),
            clock_offset_ppm: measured.map(|m| m.clock_offset_ppm),
            error,
        }
    }

    fn write(&self, lines: &[Line]) -> Result<()> {
        let mut out = BufWriter::new(std::io::stdout().lock());
        if self.json {
            for line in lines {
                serde_json::to_writer(&mut out, line)?;
                out.write_all(b"\n")?;
            }
        } else {
            writeln!(out, "line,range_m,clock_offset_ppm,error")?;
            for line in lines {
                match (line.range_m, line.clock_offset_ppm) {
                    (Some(range), Some(offset)) => {
                        writeln!(out, "{},{range:.4},{offset:.4},", line.line)?;
                    }
                    _ => {
                        let error = line.error.as_deref().unwrap_or_default();
                        writeln!(out, "{},,,\"{}\"", line.line, error.replace('"', "'"))?;
                    }
                }
            }
        }
        Ok(out.flush()?)
    }
}

const STAMP_COLUMNS: [&str; 6] = [
    "t1_ticks", "t2_ticks", "t3_ticks", "t4_ticks", "t5_ticks", "t6_ticks",
];

fn stamps(row: &Row<'_>, columns: &[Column<'_>]) -> Result<Stamps, String> {
    let mut readings = columns.iter().zip(STAMP_COLUMNS).map(|(&column, name)| {
        let text = row.text(column);
        match text.parse::<u64>() {
            Ok(ticks) => DeviceTime::try_from_ticks(ticks)
                .ok_or_else(|| format!("{name} is {ticks}, more than 40 bits")),
            Err(_) if text.is_empty() => Err(format!("{name} is missing")),
            Err(_) => Err(format!("{name} is '{text}', not a count of ticks")),
        }
    });
    let mut next = || {
        readings
            .next()
            .unwrap_or(Err("a time stamp is missing".to_owned()))
    };
    Ok(Stamps {
        poll_tx: next()?,
        poll_rx: next()?,
        response_tx: next()?,
        response_rx: next()?,
        final_tx: next()?,
        final_rx: next()?,
    })
}
