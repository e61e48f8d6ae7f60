//! Measurements from files.

use super::pairing::Heard;
use crate::error::bad_input;
use crate::peer::Peer;
use crate::table::{Column, ColumnNames, Row, Table};
use anyhow::Result;
use nova_solver::navigation::{InsSample, RangeSample};
use nova_wire::{Decoder, Event, Record};
use std::collections::BTreeMap;
use std::path::Path;

/// The columns of a file with ranges.
pub(super) const RANGE_COLUMNS: [&str; 3] = ["t_s", "peer", "range_m"];

/// The columns of a file with dead reckoning.
pub(super) const INS_COLUMNS: [&str; 4] = ["t_s", "x_m", "y_m", "z_m"];

/// How a file is read.
pub(super) struct Reading<'a> {
    pub(super) file: &'a Path,
    pub(super) columns: &'a ColumnNames,
    /// Pass over lines that cannot be used.
    pub(super) skip_bad: bool,
}

/// Ranges from a CSV file or from a capture of what a board sent, whose clock showed zero at
/// `board_start_s`.
pub(super) fn ranges(reading: &Reading<'_>, board_start_s: f64) -> Result<Vec<Heard>> {
    let path = reading.file.display();
    let bytes = std::fs::read(reading.file)
        .map_err(|error| bad_input!("{path}: cannot be read: {error}"))?;
    // Every frame of a capture ends with a zero byte, which no text has.
    let mut ranges = if bytes.contains(&0) {
        captured(&bytes, board_start_s)
    } else {
        reading.listed()?
    };
    if ranges.is_empty() {
        return Err(bad_input!("{path}: there is no range in it"));
    }
    ranges.sort_by(|a, b| a.range.t_s.total_cmp(&b.range.t_s));
    Ok(ranges)
}

/// Dead reckoning from a CSV file.
pub(super) fn ins(reading: &Reading<'_>) -> Result<Vec<InsSample>> {
    let table = Table::open(reading.file, reading.columns, "--ins-columns", &INS_COLUMNS)?;
    let [t, x, y, z] = require(&table, INS_COLUMNS)?;
    let mut samples: Vec<InsSample> = Vec::new();
    reading.each_line(&table, |row| {
        let sample = InsSample {
            t_s: row.number(t)?,
            position_m: [row.number(x)?, row.number(y)?, row.number(z)?].into(),
        };
        sample
            .validate()
            .map_err(|fault| row.complain(t, &format!("cannot be used: {fault}")))?;
        match samples.last() {
            // A file of ranges repeats the place for every node heard at that time.
            Some(last) if *last == sample => {}
            Some(last) if sample.t_s <= last.t_s => return Err(went_back(row, t, last.t_s)),
            _ => samples.push(sample),
        }
        Ok(())
    })?;
    Ok(samples)
}

fn captured(bytes: &[u8], board_start_s: f64) -> Vec<Heard> {
    let mut decoder = Decoder::new();
    let mut ranges = Vec::new();
    for event in bytes.iter().filter_map(|&byte| decoder.push(byte)) {
        let Event::Record { record, .. } = event else {
            continue;
        };
        if let Record::Range(range) = record {
            ranges.push(Heard {
                peer: Peer::Number(range.peer.into()),
                range: RangeSample {
                    t_s: board_start_s + range.t_us as f64 * 1e-6,
                    range_m: range.raw_m.into(),
                },
            });
        }
    }
    ranges
}

impl Reading<'_> {
    fn listed(&self) -> Result<Vec<Heard>> {
        let table = Table::open(self.file, self.columns, "--range-columns", &RANGE_COLUMNS)?;
        let [t, peer, range] = require(&table, RANGE_COLUMNS)?;
        let mut last_s: BTreeMap<Peer, f64> = BTreeMap::new();
        let mut ranges = Vec::new();
        self.each_line(&table, |row| {
            let name = row.text(peer);
            if name.is_empty() {
                return Err(row.complain(peer, "is empty"));
            }
            let heard = Heard {
                peer: name.into(),
                range: RangeSample {
                    t_s: row.number(t)?,
                    range_m: row.number(range)?,
                },
            };
            let RangeSample { t_s, range_m } = heard.range;
            if range_m < 0.0 {
                return Err(row.complain(range, &format!("is negative ({range_m})")));
            }
            (heard.range.validate())
                .map_err(|fault| row.complain(range, &format!("cannot be used: {fault}")))?;
            match last_s.insert(heard.peer.clone(), t_s) {
                Some(before_s) if t_s <= before_s => {
                    last_s.insert(heard.peer, before_s);
                    return Err(went_back(row, t, before_s));
                }
                _ => ranges.push(heard),
            }
            Ok(())
        })?;
        Ok(ranges)
    }

    /// Hands each line to `take`, and passes over bad ones where asked for.
    fn each_line(&self, table: &Table, mut take: impl FnMut(&Row<'_>) -> Result<()>) -> Result<()> {
        let mut skipped: u64 = 0;
        let lines = table.for_each(|row| match row.check_length().and_then(|()| take(row)) {
            Err(_) if self.skip_bad => {
                skipped += 1;
                Ok(())
            }
            result => result,
        })?;
        let path = self.file.display();
        if skipped == lines {
            return Err(bad_input!("{path}: none of {lines} lines can be used"));
        }
        if skipped > 0 {
            eprintln!("{path}: {skipped} of {lines} lines skipped");
        }
        Ok(())
    }
}

fn require<'a, const N: usize>(table: &Table, names: [&'a str; N]) -> Result<[Column<'a>; N]> {
    let columns: Vec<Column<'a>> = (names.iter())
        .map(|&name| table.require(name))
        .collect::<Result<_>>()?;
    columns
        .try_into()
        .map_err(|_| anyhow::anyhow!("as many columns as names"))
}

fn went_back(row: &Row<'_>, column: Column<'_>, before_s: f64) -> anyhow::Error {
    row.complain(column, &format!("is not after the time before, {before_s}"))
}
