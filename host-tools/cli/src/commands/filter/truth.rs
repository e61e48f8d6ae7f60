//! What the ranges should have been.

use crate::error::bad_input;
use crate::table::{ColumnNames, Table};
use anyhow::Result;
use std::path::Path;
use std::str::FromStr;

/// Coordinates in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place(pub(super) [f64; 3]);

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text
            .split(',')
            .map(|number| number.trim().parse().map_err(|_| number))
            .collect::<Result<_, _>>()
            .map_err(|number| format!("'{number}' is not a number"))?;
        match numbers[..] {
            [x, y, z] if [x, y, z].iter().all(|c| c.is_finite()) => Ok(Self([x, y, z])),
            _ => Err("not three numbers: X,Y,Z".to_owned()),
        }
    }
}

/// Where a node was, in the time of the ranges.
pub(super) struct Trajectory {
    points: Vec<(f64, [f64; 3])>,
}

/// The truth for one pair of nodes.
pub(super) enum Truth {
    /// Beside each range.
    Column,
    /// True distances over time, rising in time.
    Moving(Vec<(f64, f64)>),
}

impl Trajectory {
    pub(super) fn read(path: &Path, delay_s: f64, antenna: Place) -> Result<Self> {
        let columns = ["t_s", "x_m", "y_m", "z_m"];
        let table = Table::open(path, &ColumnNames::default(), "--truth", &columns)?;
        let columns = columns
            .iter()
            .map(|name| table.require(name))
            .collect::<Result<Vec<_>>>()?;
        let mut points: Vec<(f64, [f64; 3])> = Vec::new();
        table.for_each(|row| {
            let mut numbers = [0.0; 4];
            for (number, &column) in numbers.iter_mut().zip(&columns) {
                *number = row.number(column)?;
            }
            let [t_s, x, y, z] = numbers;
            let t_s = t_s + delay_s;
            if points.last().is_some_and(|(before, _)| t_s < *before) {
                return Err(bad_input!(
                    "{}: line {}: the time runs backwards",
                    path.display(),
                    row.line
                ));
            }
            let [dx, dy, dz] = antenna.0;
            points.push((t_s, [x + dx, y + dy, z + dz]));
            Ok(())
        })?;
        Ok(Self { points })
    }

    /// Distances to a place.
    pub(super) fn distances(&self, place: Place) -> Vec<(f64, f64)> {
        let distance = |point: &[f64; 3]| {
            let squares = point.iter().zip(place.0).map(|(p, q)| (p - q).powi(2));
            squares.sum::<f64>().sqrt()
        };
        let points = self.points.iter();
        points.map(|(t_s, point)| (*t_s, distance(point))).collect()
    }
}

/// Longest time between two points to draw a straight line between.
const LONGEST_BRIDGED_S: f64 = 0.5;

/// The value at a time, between two points that are close enough to each other.
///
/// Where a node stands still, recordings leave points out: any time is bridged while the value stays.
pub(super) fn interpolate(points: &[(f64, f64)], t_s: f64) -> Option<f64> {
    let after = points.partition_point(|(t, _)| *t <= t_s);
    let (t0, v0) = *points.get(after.checked_sub(1)?)?;
    let Some((t1, v1)) = points.get(after).copied() else {
        return (t0 == t_s).then_some(v0);
    };
    if t1 - t0 > LONGEST_BRIDGED_S && (v1 - v0).abs() > 0.01 {
        return None;
    }
    Some(v0 + (v1 - v0) * (t_s - t0) / (t1 - t0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_truth_is_drawn_between_points_and_not_beyond_or_across_gaps() {
        let points = [(0.0, 1.0), (0.2, 2.0), (5.0, 2.0), (9.0, 4.0)];
        assert_eq!(interpolate(&points, -0.1), None);
        assert!((interpolate(&points, 0.1).unwrap() - 1.5).abs() < 1e-12);
        assert_eq!(interpolate(&points, 3.0), Some(2.0));
        assert_eq!(interpolate(&points, 7.0), None);
        assert_eq!(interpolate(&points, 9.0), Some(4.0));
        assert_eq!(interpolate(&points, 9.1), None);
        assert_eq!(interpolate(&[], 0.0), None);
    }

    #[test]
    fn a_place_is_three_finite_numbers() {
        assert!("1, 2,-3.5".parse::<Place>().is_ok());
        for wrong in ["1,2", "1,2,3,4", "1,2,x", "1,2,inf", ""] {
            assert!(wrong.parse::<Place>().is_err(), "{wrong}");
        }
    }
}
