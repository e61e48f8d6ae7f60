//! A vehicle with RTK drives past four anchors (`B2_dwm1001_outdoor`).

use std::collections::BTreeMap;

use nalgebra::Vector3;
use nova_solver::survey::{TagRange, Track, TrackPoint};

use super::{columns, data};

/// The tag stands so high above the point that RTK gives, metres.
pub(crate) const TAG_UP_M: f64 = 1.0;
/// Between RTK's points a tag is not known over longer than this, seconds.
pub(crate) const MAX_GAP_S: f64 = 0.3;

/// A drive, anchors by their numbers.
pub(crate) struct Drive {
    /// The tag's, where RTK calls itself fixed.
    pub(crate) track: Track,
    pub(crate) ranges: BTreeMap<i64, Vec<TagRange>>,
    /// As the authors surveyed them.
    pub(crate) anchors: BTreeMap<i64, Vector3<f64>>,
}

/// `LOSA` or `NLOSA`.
pub(crate) fn drive(case: &str) -> Option<Drive> {
    let base = format!("B2_dwm1001_outdoor/dyn_{case}_case1");
    let track = data(&format!("{base}_rtk_enu.csv"))?;
    // A row of either file each.
    let status = columns(&data(&format!("{base}_gnss.csv"))?, ["t_s", "status"]);
    let fixed = |t_s: f64| (status.iter()).any(|&[t, status]| t == t_s && status == 2.0);
    let points: Vec<_> = columns(&track, ["t_s", "x_m", "y_m", "z_m"])
        .iter()
        .filter(|row| fixed(row[0]))
        .map(|&[t_s, x, y, z]| TrackPoint {
            t_s,
            position_m: Vector3::new(x, y, z + TAG_UP_M),
        })
        .collect();
    let mut ranges: BTreeMap<i64, Vec<TagRange>> = BTreeMap::new();
    let mut anchors = BTreeMap::new();
    let rows = data(&format!("{base}_ranges.csv"))?;
    for [t_s, anchor, range_m, x, y, z] in
        columns(&rows, ["t_s", "anchor", "range_m", "ax_m", "ay_m", "az_m"])
    {
        ranges.entry(anchor as i64).or_default().push(TagRange {
            t_s,
            range_m,
            sigma_m: 0.1,
        });
        anchors.insert(anchor as i64, Vector3::new(x, y, z));
    }
    Some(Drive {
        track: Track::new(&points).unwrap(),
        ranges,
        anchors,
    })
}
