//! Files of a simulated flight, as the other options want them: the third of the experiment.

use crate::anchors::{AnchorEntry, AnchorsFile, CommonEntry, NodeName};
use crate::error::bad_input;
use crate::files::write_whole;
use anyhow::{Context, Result};
use nalgebra::{Rotation3, UnitQuaternion};
use nova_flight::vertiport::{self, Air, Log, Route, path};
use nova_solver::multilateration::Height;
use nova_solver::survey::{AnchorRanges, SurveyOptions, Track, survey};
use std::fmt::Write as _;
use std::path::Path;

pub(super) fn write(folder: &Path, seed: u64) -> Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: cannot be made", folder.display()))?;
    let flown = path(Route::Loop);
    let log = Log::new(&flown, &Air::of_flight(2), seed, seed.wrapping_add(1));
    let frame = vertiport::frame();
    let mut imu = String::from("t_s,fx_m_s2,fy_m_s2,fz_m_s2,qw,qx,qy,qz\n");
    // Writing to a string cannot fail.
    for s in &log.imu {
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
            s.enu_from_body,
        ));
        let f = s.force_m_s2;
        let _ = writeln!(
            imu,
            "{:.3},{:.5},{:.5},{:.5},{:.8},{:.8},{:.8},{:.8}",
            s.t_s, f.x, f.y, f.z, q.w, q.i, q.j, q.k
        );
    }
    let mut gnss = String::from("t_s,lat_deg,lon_deg,alt_m,pdop\n");
    for fix in &log.gnss {
        let p = frame.geodetic(&fix.position_m);
        let _ = writeln!(
            gnss,
            "{:.3},{:.9},{:.9},{:.4},{:.2}",
            fix.t_s, p.lat_deg, p.lon_deg, p.height_m, fix.pdop
        );
    }
    let mut ranges = String::from("t_s,peer,range_m,rx_power_dbm,fp_power_dbm\n");
    for r in &log.ranges {
        let [rx, first_path] = r.power_dbm;
        let _ = writeln!(
            ranges,
            "{:.3},{},{:.4},{rx:.2},{first_path:.2}",
            r.t_s,
            r.anchor + 1,
            r.range_m
        );
    }
    let mut truth = String::from("t_s,x_m,y_m,z_m\n");
    for moment in flown.iter().step_by(10) {
        let p = moment.position_m;
        let _ = writeln!(truth, "{:.3},{:.4},{:.4},{:.4}", moment.t_s, p.x, p.y, p.z);
    }
    for (name, content) in [
        ("imu.csv", imu),
        ("gnss.csv", gnss),
        ("ranges.csv", ranges),
        ("truth.csv", truth),
    ] {
        write_whole(&folder.join(name), content)?;
    }
    anchors(&log)?.write(&folder.join("anchors.toml"))
}

/// The anchors as surveyed from this very flight by its best receiver.
fn anchors(log: &Log) -> Result<AnchorsFile> {
    let track = Track::new(&log.tracks[0]).map_err(|error| bad_input!("example: {error}"))?;
    let ranges = log.survey_ranges(0.1);
    let parts: Vec<_> = (ranges.iter())
        .map(|ranges| AnchorRanges {
            ranges,
            height: Height::Unknown,
        })
        .collect();
    let found = survey(&track, &parts, &SurveyOptions::default())
        .map_err(|error| bad_input!("example: {error}"))?;
    Ok(AnchorsFile {
        common: Some(CommonEntry {
            lag_s: found.common.lag_s,
            lag_sigma_s: found.common.lag_sigma_s,
            slope: found.common.slope,
            slope_sigma: found.common.slope_sigma,
        }),
        origin: Some(vertiport::frame().origin().into()),
        anchors: (found.anchors.iter().enumerate())
            .map(|(index, anchor)| {
                AnchorEntry::new(NodeName::Number(index as i64 + 1), &anchor.found)
            })
            .collect(),
    })
}
