//! What `nova fuse` reads.

use crate::anchors::AnchorsFile;
use crate::error::bad_input;
use crate::peer::Peer;
use crate::place::Place;
use crate::table::{ColumnNames, Row, Table, file_name};
use anyhow::Result;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use nova_solver::fusion::{GnssFix, ImuSample, UwbRange};
use nova_solver::geodesy::LocalFrame;
use nova_solver::positioning::Power;
use nova_solver::survey::{Track, TrackPoint};
use std::collections::BTreeMap;
use std::path::Path;

/// One line of one of the files.
pub(super) enum Reading {
    Imu(ImuSample),
    Gnss(GnssFix),
    Range(UwbRange),
}

/// All lines in order of time.
pub(super) struct Events(pub(super) Vec<(f64, Reading)>);

impl Events {
    pub(super) fn first_s(&self) -> f64 {
        self.0.first().map_or(0.0, |(t_s, _)| *t_s)
    }

    /// The first position of GNSS: where the filter starts.
    pub(super) fn first_fix(&self) -> Result<Vector3<f64>> {
        self.0
            .iter()
            .find_map(|(_, reading)| match reading {
                Reading::Gnss(fix) => Some(fix.position_m),
                _ => None,
            })
            .ok_or_else(|| bad_input!("there is no GNSS position to start from"))
    }
}

/// What was read.
pub(super) struct Input {
    pub(super) events: Events,
    pub(super) notes: Vec<String>,
}

/// PDOP where the file has none: open sky.
const PDOP: f64 = 2.0;

impl Input {
    pub(super) fn read(
        [imu, gnss, ranges]: [&Path; 3],
        site: &AnchorsFile,
        sigma_m: f64,
        frame: &mut Option<LocalFrame>,
    ) -> Result<Self> {
        let mut lines = Lines::default();
        read_imu(imu, &mut lines)?;
        read_gnss(gnss, frame, &mut lines)?;
        read_ranges(ranges, site, sigma_m, &mut lines)?;
        let Lines { mut events, notes } = lines;
        // Stable: where times are equal the inertial sensor comes first.
        events.sort_by(|a, b| a.0.total_cmp(&b.0));
        for note in &notes {
            eprintln!("{note}");
        }
        Ok(Self {
            events: Events(events),
            notes,
        })
    }
}

/// Lines of all files as they come.
#[derive(Default)]
struct Lines {
    events: Vec<(f64, Reading)>,
    notes: Vec<String>,
}

impl Lines {
    /// Reads a file; `take` makes a reading of a line, `None` to leave it out.
    fn read(
        &mut self,
        path: &Path,
        table: &Table,
        mut take: impl FnMut(&Row<'_>, f64) -> Result<Option<Reading>>,
    ) -> Result<()> {
        let time = table.require("t_s")?;
        let (mut last, mut late) = (f64::NEG_INFINITY, 0u64);
        table.for_each(|row| {
            row.check_length()?;
            let t_s = row.number(time)?;
            late += u64::from(t_s < last);
            last = last.max(t_s);
            if let Some(reading) = take(row, t_s)? {
                self.events.push((t_s, reading));
            }
            Ok(())
        })?;
        if late > 0 {
            let file = file_name(path);
            self.notes
                .push(format!("{file}: {late} lines out of order, sorted"));
        }
        Ok(())
    }
}

fn open(path: &Path) -> Result<Table> {
    Table::open(path, &ColumnNames::default(), "a header line of", &[])
}

fn read_imu(path: &Path, lines: &mut Lines) -> Result<()> {
    let table = open(path)?;
    let mut columns = Vec::new();
    for name in ["fx_m_s2", "fy_m_s2", "fz_m_s2", "qw", "qx", "qy", "qz"] {
        columns.push(table.require(name)?);
    }
    let [fx, fy, fz, qw, qx, qy, qz] = columns[..] else {
        return Err(bad_input!(
            "{}: line 1: columns are missing",
            file_name(path)
        ));
    };
    lines.read(path, &table, |row, t_s| {
        let q = Quaternion::new(
            row.number(qw)?,
            row.number(qx)?,
            row.number(qy)?,
            row.number(qz)?,
        );
        let norm = q.norm();
        if !(0.9..1.1).contains(&norm) {
            return Err(row.complain(
                qw,
                &format!("begins a quaternion of length {norm:.3} instead of 1"),
            ));
        }
        Ok(Some(Reading::Imu(ImuSample {
            t_s,
            force_m_s2: Vector3::new(row.number(fx)?, row.number(fy)?, row.number(fz)?),
            enu_from_body: *UnitQuaternion::new_normalize(q)
                .to_rotation_matrix()
                .matrix(),
        })))
    })
}

fn read_gnss(path: &Path, frame: &mut Option<LocalFrame>, lines: &mut Lines) -> Result<()> {
    let table = open(path)?;
    let place = Place::of(&table)?;
    let pdop = table.find("pdop")?;
    lines.read(path, &table, |row, t_s| {
        let position_m = place.read(row, frame)?;
        let pdop = match pdop {
            None => PDOP,
            Some(column) => match row.number(column)? {
                value if value > 0.0 => value,
                other => return Err(row.complain(column, &format!("is not positive ({other})"))),
            },
        };
        Ok(Some(Reading::Gnss(GnssFix {
            t_s,
            position_m,
            pdop,
        })))
    })
}

fn read_ranges(path: &Path, site: &AnchorsFile, sigma_m: f64, lines: &mut Lines) -> Result<()> {
    let table = open(path)?;
    let (peer, range) = (table.require("peer")?, table.require("range_m")?);
    let sigma = table.find("sigma_m")?;
    let powers = match (table.find("rx_power_dbm")?, table.find("fp_power_dbm")?) {
        (Some(rx), Some(first_path)) => Some((rx, first_path)),
        _ => None,
    };
    let numbers: BTreeMap<Peer, usize> = (site.anchors.iter().enumerate())
        .map(|(number, anchor)| (anchor.node.peer(), number))
        .collect();
    let mut unknown: BTreeMap<Peer, u64> = BTreeMap::new();
    let mut known = 0u64;
    lines.read(path, &table, |row, t_s| {
        let name = Peer::from(row.text(peer));
        let Some(&anchor) = numbers.get(&name) else {
            *unknown.entry(name).or_default() += 1;
            return Ok(None);
        };
        let range_m = row.number(range)?;
        if range_m < 0.0 {
            return Err(row.complain(range, &format!("is negative ({range_m})")));
        }
        let sigma_m = match sigma {
            None => (site.anchors.get(anchor))
                .and_then(|anchor| anchor.range_sigma_m)
                .unwrap_or(sigma_m),
            Some(column) => match row.number(column)? {
                value if value > 0.0 => value,
                other => return Err(row.complain(column, &format!("is not positive ({other})"))),
            },
        };
        let power = match powers {
            None => None,
            Some((rx, first_path)) => Some(Power {
                rx_dbm: row.number(rx)?,
                first_path_dbm: row.number(first_path)?,
            }),
        };
        known += 1;
        Ok(Some(Reading::Range(UwbRange {
            t_s,
            anchor,
            range_m,
            sigma_m,
            power,
        })))
    })?;
    for (peer, count) in &unknown {
        let note = format!("{count} ranges to {peer}, which is not among the anchors, left out");
        lines.notes.push(note);
    }
    if known == 0 {
        let names: Vec<String> = numbers.keys().map(ToString::to_string).collect();
        return Err(bad_input!(
            "{}: no range is to one of the anchors ({})",
            file_name(path),
            names.join(", ")
        ));
    }
    Ok(())
}

/// A track to compare with.
pub(super) fn truth(path: &Path) -> Result<Track> {
    let table = open(path)?;
    let time = table.require("t_s")?;
    let place = [
        table.require("x_m")?,
        table.require("y_m")?,
        table.require("z_m")?,
    ];
    let mut points = Vec::new();
    table.for_each(|row| {
        row.check_length()?;
        let [x, y, z] = place;
        points.push(TrackPoint {
            t_s: row.number(time)?,
            position_m: Vector3::new(row.number(x)?, row.number(y)?, row.number(z)?),
        });
        Ok(())
    })?;
    Track::new(&points).map_err(|error| bad_input!("{}: {error}", file_name(path)))
}
