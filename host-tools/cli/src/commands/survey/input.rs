//! What a survey reads: ranges, and where the tag was.

use super::Survey;
use crate::error::bad_input;
use crate::peer::Peer;
use crate::place::{Place, Triple};
use crate::table::{Row, Table, file_name};
use anyhow::Result;
use nalgebra::Vector3;
use nova_solver::geodesy::{Geodetic, LocalFrame};
use nova_solver::survey::{TagRange, Track, TrackPoint};
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

/// `LAT,LON,H`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Origin(Geodetic);

impl FromStr for Origin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Triple(v) = text.parse()?;
        Geodetic::new(v.x, v.y, v.z)
            .map(Self)
            .map_err(|error| error.to_string())
    }
}

/// `[NODE=]M`.
#[derive(Clone, Debug)]
pub(super) struct GivenHeight {
    pub(super) node: Option<Peer>,
    pub(super) height_m: f64,
}

impl FromStr for GivenHeight {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (node, height) = match text.split_once('=') {
            Some((node, height)) => (Some(Peer::from(node.trim())), height),
            None => (None, text),
        };
        let height_m: f64 = (height.trim().parse().ok())
            .filter(|h: &f64| h.abs() < 1e6)
            .ok_or_else(|| format!("'{height}' is not a height in metres"))?;
        Ok(Self { node, height_m })
    }
}

/// `COLUMN=VALUE`.
#[derive(Clone, Debug)]
pub(super) struct Kept {
    column: String,
    value: String,
}

impl FromStr for Kept {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((column, value)) if !column.is_empty() => Ok(Self {
                column: column.trim().to_owned(),
                value: value.trim().to_owned(),
            }),
            _ => Err("not of the form COLUMN=VALUE".to_owned()),
        }
    }
}

/// What was read.
pub(super) struct Input {
    /// Of each anchor.
    pub(super) ranges: BTreeMap<Peer, Vec<TagRange>>,
    /// Of the tag's antenna.
    pub(super) track: Track,
    /// Where the track was geodetic.
    pub(super) frame: Option<LocalFrame>,
    /// What a reader should know about the files.
    pub(super) notes: Vec<String>,
}

const RANGE_COLUMNS: [&str; 10] = [
    "t_s", "peer", "range_m", "sigma_m", "x_m", "y_m", "z_m", "lat_deg", "lon_deg", "alt_m",
];
const TRACK_COLUMNS: [&str; 7] = ["t_s", "x_m", "y_m", "z_m", "lat_deg", "lon_deg", "alt_m"];

/// Points of a track as they come.
struct Points {
    origin: Option<Origin>,
    frame: Option<LocalFrame>,
    offset: Vector3<f64>,
    points: Vec<TrackPoint>,
}

impl Points {
    fn add(&mut self, row: &Row<'_>, t_s: f64, place: &Place<'_>) -> Result<()> {
        if let (None, Some(Origin(origin))) = (&self.frame, self.origin) {
            self.frame = Some(LocalFrame::at(origin));
        }
        let position_m = place.read(row, &mut self.frame)?;
        self.points.push(TrackPoint {
            t_s,
            position_m: position_m + self.offset,
        });
        Ok(())
    }
}

impl Input {
    pub(super) fn read(of: &Survey) -> Result<Self> {
        let mut notes = Vec::new();
        let mut points = Points {
            origin: of.origin,
            frame: None,
            offset: of
                .tag_offset
                .map_or_else(Vector3::zeros, |Triple(offset)| offset),
            points: Vec::new(),
        };
        let names = of.columns.clone().unwrap_or_default();
        let table = Table::open(&of.file, &names, "--columns", &RANGE_COLUMNS)?;
        let (time, peer, range) = (
            table.require("t_s")?,
            table.require("peer")?,
            table.require("range_m")?,
        );
        let sigma = table.find("sigma_m")?;
        let own_place = match &of.track {
            None => Some(Place::of(&table)?),
            Some(_) => None,
        };
        let mut ranges: BTreeMap<Peer, Vec<TagRange>> = BTreeMap::new();
        let mut skipped = 0u64;
        let lines = table.for_each(|row| {
            let mut take = || -> Result<()> {
                row.check_length()?;
                let name = row.text(peer);
                if name.is_empty() {
                    return Err(row.complain(peer, "is empty"));
                }
                let range_m = row.number(range)?;
                if range_m < 0.0 {
                    return Err(row.complain(range, &format!("is negative ({range_m})")));
                }
                let sigma_m = match sigma {
                    None => of.sigma,
                    Some(column) => row.number(column)?,
                };
                if let (Some(column), false) = (sigma, sigma_m > 0.0) {
                    return Err(row.complain(column, &format!("is not positive ({sigma_m})")));
                }
                let t_s = row.number(time)?;
                if let Some(place) = &own_place {
                    points.add(row, t_s, place)?;
                }
                ranges.entry(name.into()).or_default().push(TagRange {
                    t_s,
                    range_m,
                    sigma_m,
                });
                Ok(())
            };
            match take() {
                Err(_) if of.skip_bad => skipped += 1,
                other => other?,
            }
            Ok(())
        })?;
        if skipped > 0 {
            notes.push(format!("{skipped} of {lines} lines of ranges skipped"));
        }
        if ranges.is_empty() {
            let file = file_name(&of.file);
            return Err(bad_input!("{file}: none of {lines} lines can be used"));
        }
        let track_file = match &of.track {
            Some(path) => {
                read_track(of, path, &mut points, &mut notes)?;
                path
            }
            None => &of.file,
        };
        let track = Track::new(&points.points)
            .map_err(|error| bad_input!("{}: the track: {error}", file_name(track_file)))?;
        let (reordered, repeated) = track.disorder();
        if reordered > 0 {
            notes.push(format!(
                "{reordered} points of the track were out of order and sorted"
            ));
        }
        if repeated > 0 && of.track.is_some() {
            notes.push(format!(
                "{repeated} points of the track had a time that was taken already"
            ));
        }
        let late: usize = ranges
            .values()
            .map(|r| {
                r.windows(2)
                    .filter(|w| matches!(w, [a, b] if b.t_s < a.t_s))
                    .count()
            })
            .sum();
        if late > 0 {
            notes.push(format!("{late} ranges were out of order and sorted"));
        }
        for note in &notes {
            eprintln!("{note}");
        }
        Ok(Self {
            ranges,
            track,
            frame: points.frame,
            notes,
        })
    }
}

fn read_track(
    of: &Survey,
    path: &Path,
    points: &mut Points,
    notes: &mut Vec<String>,
) -> Result<()> {
    let names = of.track_columns.clone().unwrap_or_default();
    let table = Table::open(path, &names, "--track-columns", &TRACK_COLUMNS)?;
    let time = table.require("t_s")?;
    let place = Place::of(&table)?;
    let kept = match &of.keep {
        Some(kept) => Some((table.require(&kept.column)?, kept)),
        None => None,
    };
    let (mut skipped, mut left) = (0u64, 0u64);
    let lines = table.for_each(|row| {
        if let Some((column, kept)) = &kept
            && row.text(*column) != kept.value
        {
            left += 1;
            return Ok(());
        }
        let mut take = || -> Result<()> {
            row.check_length()?;
            let t_s = row.number(time)?;
            points.add(row, t_s, &place)
        };
        match take() {
            Err(_) if of.skip_bad => skipped += 1,
            other => other?,
        }
        Ok(())
    })?;
    for (count, what) in [(skipped, "skipped"), (left, "left out by --keep")] {
        if count > 0 {
            notes.push(format!("{count} of {lines} lines of the track {what}"));
        }
    }
    Ok(())
}
