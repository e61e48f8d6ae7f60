//! What a survey says.

use super::input::Input;
use crate::peer::Peer;
use nalgebra::Vector3;
use nova_solver::geodesy::Geodetic;
use nova_solver::survey::{Advice, InvertedUwb, Survey};
use serde::Serialize;
use std::fmt::Write as _;

/// All of it.
#[derive(Serialize)]
pub(super) struct Report {
    anchors: Vec<Anchor>,
    lag_s: f64,
    lag_sigma_s: f64,
    slope: f64,
    slope_sigma: f64,
    /// Legs that would help, the best first.
    advice: Vec<Leg>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Anchor {
    peer: Peer,
    position_m: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    geodetic: Option<Place>,
    covariance_m2: [[f64; 3]; 3],
    sigma_m: [f64; 3],
    range_bias_m: f64,
    range_bias_sigma_m: f64,
    residual_rms_m: f64,
    used: usize,
    rejected: usize,
    off_track: usize,
    observable: bool,
    verdict: &'static str,
    alternative_m: Option<[f64; 3]>,
    /// Along this unit vector it is known worst.
    weakest_direction: [f64; 3],
    weakest_sigma_m: f64,
    /// What the paper's method finds from the same ranges.
    one_by_one_m: Option<[f64; 3]>,
}

#[derive(Serialize)]
struct Place {
    lat_deg: f64,
    lon_deg: f64,
    height_m: f64,
}

impl From<Geodetic> for Place {
    fn from(place: Geodetic) -> Self {
        Self {
            lat_deg: place.lat_deg,
            lon_deg: place.lon_deg,
            height_m: place.height_m,
        }
    }
}

#[derive(Serialize)]
struct Leg {
    from_m: [f64; 3],
    to_m: [f64; 3],
    /// Root mean square error over the anchors, before and expected after it.
    rms_m: [f64; 2],
}

/// Legs that are told.
const LEGS: usize = 3;

impl Report {
    pub(super) fn new(
        peers: &[Peer],
        found: &Survey,
        one_by_one: &[Option<InvertedUwb>],
        advice: &[Advice],
        input: &Input,
    ) -> Self {
        let prospects = advice.first().map_or(&[][..], |best| &best.anchors);
        let anchors = (peers.iter().zip(&found.anchors).zip(one_by_one).enumerate())
            .map(|(index, ((peer, anchor), alone))| {
                let f = &anchor.found;
                let weakest = prospects.get(index);
                Anchor {
                    peer: peer.clone(),
                    position_m: f.position_m.into(),
                    geodetic: (input.frame).map(|frame| frame.geodetic(&f.position_m).into()),
                    covariance_m2: f.covariance_m2.into(),
                    sigma_m: f.sigma_m.into(),
                    range_bias_m: f.range_bias_m,
                    range_bias_sigma_m: f.range_bias_sigma_m,
                    residual_rms_m: f.residual_rms_m,
                    used: f.used,
                    rejected: f.rejected,
                    off_track: anchor.off_track,
                    observable: f.observable(),
                    verdict: f.observability.name(),
                    alternative_m: f.alternative.map(|other| other.position_m.into()),
                    weakest_direction: weakest.map_or([0.0; 3], |w| w.direction.into()),
                    weakest_sigma_m: weakest.map_or(0.0, |w| w.sigma_m),
                    one_by_one_m: alone.map(|alone| alone.position_m.into()),
                }
            })
            .collect();
        Self {
            anchors,
            lag_s: found.common.lag_s,
            lag_sigma_s: found.common.lag_sigma_s,
            slope: found.common.slope,
            slope_sigma: found.common.slope_sigma,
            advice: (advice.iter().take(LEGS))
                .map(|advice| Leg {
                    from_m: advice.leg.from_m.into(),
                    to_m: advice.leg.to_m.into(),
                    rms_m: advice.rms_m,
                })
                .collect(),
            notes: input.notes.clone(),
        }
    }

    pub(super) fn text(&self) -> String {
        let mut out = format!(
            "{:>8}  {:^27}  {:^21}  {:>7} {:>6}  {:>5} {:>8}   {}\n",
            "anchor",
            "position (m)",
            "sigma (m)",
            "bias",
            "rms",
            "used",
            "rejected",
            "one by one (m)"
        );
        for a in &self.anchors {
            let ([x, y, z], [sx, sy, sz]) = (a.position_m, a.sigma_m);
            let alone = a.one_by_one_m.map_or_else(
                || "-".to_owned(),
                |[x, y, z]| format!("{x:.3} {y:.3} {z:.3}"),
            );
            // Writing to a string cannot fail.
            let _ = writeln!(
                out,
                "{:>8}  {x:>8.3} {y:>8.3} {z:>8.3}   {sx:>6.3} {sy:>6.3} {sz:>6.3}  {:>7.3} {:>6.3}  {:>5} {:>8}   {alone}",
                a.peer.to_string(),
                a.range_bias_m,
                a.residual_rms_m,
                a.used,
                a.rejected,
            );
            if !a.observable {
                let _ = writeln!(out, "{:>8}  ! {}", "", a.warning());
            }
            if let Some(place) = &a.geodetic {
                let _ = writeln!(
                    out,
                    "{:>8}  {:.8} {:.8} {:.2}",
                    "", place.lat_deg, place.lon_deg, place.height_m
                );
            }
        }
        let _ = writeln!(
            out,
            "ranges are {:.3} s behind the track (sigma {:.3}), and {:.2} % long (sigma {:.2})",
            self.lag_s,
            self.lag_sigma_s,
            100.0 * self.slope,
            100.0 * self.slope_sigma
        );
        if let Some(leg) = self.advice.first() {
            let point = |p: &[f64; 3]| format!("({:.1}, {:.1}, {:.1})", p[0], p[1], p[2]);
            let _ = writeln!(
                out,
                "a leg from {} to {} would help most: {:.3} m over all anchors, now {:.3}",
                point(&leg.from_m),
                point(&leg.to_m),
                leg.rms_m[1],
                leg.rms_m[0]
            );
        }
        out
    }
}

impl Anchor {
    fn warning(&self) -> String {
        let mirror = self.alternative_m.map_or_else(String::new, |[x, y, z]| {
            format!("; may as well be at ({x:.2}, {y:.2}, {z:.2})")
        });
        format!(
            "{}: sigma {:.2} m {}{mirror}",
            self.verdict,
            self.weakest_sigma_m,
            along(&Vector3::from(self.weakest_direction))
        )
    }
}

fn along(direction: &Vector3<f64>) -> String {
    if direction.z.abs() > 0.9 {
        return "in height".to_owned();
    }
    // A direction and its opposite are one; bearings from north over east.
    let bearing = direction
        .x
        .atan2(direction.y)
        .to_degrees()
        .rem_euclid(180.0);
    format!("along bearing {bearing:.0} deg")
}
