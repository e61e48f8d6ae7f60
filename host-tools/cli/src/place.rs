//! Places as files and arguments give them.

use crate::table::{Column, Row, Table};
use anyhow::Result;
use nalgebra::Vector3;
use nova_solver::geodesy::{Geodetic, LocalFrame};
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Three numbers with commas between.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(from = "[f64; 3]", into = "[f64; 3]")]
pub(crate) struct Triple(pub(crate) Vector3<f64>);

impl From<[f64; 3]> for Triple {
    fn from(numbers: [f64; 3]) -> Self {
        Self(numbers.into())
    }
}

impl From<Triple> for [f64; 3] {
    fn from(Triple(numbers): Triple) -> Self {
        numbers.into()
    }
}

impl FromStr for Triple {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = (text.split(','))
            .filter_map(|part| part.trim().parse().ok())
            .filter(|v: &f64| v.is_finite())
            .collect();
        match numbers[..] {
            [a, b, c] if text.split(',').count() == 3 => Ok(Self(Vector3::new(a, b, c))),
            _ => Err("not three numbers with commas between".to_owned()),
        }
    }
}

/// Columns of a place.
pub(crate) enum Place<'a> {
    Local([Column<'a>; 3]),
    Geodetic([Column<'a>; 3]),
}

impl<'a> Place<'a> {
    /// `lat_deg`, `lon_deg`, `alt_m` where a file has them and not `x_m`; else `x_m`, `y_m`, `z_m`.
    pub(crate) fn of(table: &Table) -> Result<Self> {
        if table.find("lat_deg")?.is_some() && table.find("x_m")?.is_none() {
            Ok(Self::Geodetic([
                table.require("lat_deg")?,
                table.require("lon_deg")?,
                table.require("alt_m")?,
            ]))
        } else {
            Ok(Self::Local([
                table.require("x_m")?,
                table.require("y_m")?,
                table.require("z_m")?,
            ]))
        }
    }

    /// The place of a line in ENU metres. A geodetic one is taken in `frame`, whose origin is the first
    /// place where there is none yet.
    pub(crate) fn read(
        &self,
        row: &Row<'_>,
        frame: &mut Option<LocalFrame>,
    ) -> Result<Vector3<f64>> {
        let numbers = |[a, b, c]: [Column<'_>; 3]| -> Result<[f64; 3]> {
            Ok([row.number(a)?, row.number(b)?, row.number(c)?])
        };
        match self {
            Self::Local(columns) => Ok(numbers(*columns)?.into()),
            Self::Geodetic(columns) => {
                let [lat_deg, lon_deg, height_m] = numbers(*columns)?;
                let here = Geodetic::new(lat_deg, lon_deg, height_m)
                    .map_err(|error| row.complain(columns[0], &format!("makes {error}")))?;
                Ok(frame
                    .get_or_insert_with(|| LocalFrame::at(here))
                    .enu_of(&here))
            }
        }
    }
}
