//! What `nova fuse` says.

use nova_solver::fusion::{Fate, Navigation};
use nova_solver::geodesy::LocalFrame;
use nova_solver::survey::Track;
use serde::Serialize;
use std::fmt::Write as _;

/// What became of the measurements.
#[derive(Debug, Default, Serialize)]
pub(super) struct Counts {
    gnss: u64,
    ranges_used: u64,
    ranges_weighed_down: u64,
    ranges_set_aside: u64,
    /// Out of reach of the filter in time, or no numbers.
    pub(super) refused: u64,
    nis_sum: f64,
    nis_count: u64,
}

impl Counts {
    pub(super) fn gnss(&mut self, nis: Option<f64>) {
        self.gnss += u64::from(nis.is_some());
    }

    pub(super) fn range(&mut self, fate: Fate) {
        let nis = match fate {
            Fate::Used(nis) => {
                self.ranges_used += 1;
                nis
            }
            Fate::Weighed(nis) => {
                self.ranges_weighed_down += 1;
                nis
            }
            Fate::SetAside(_) => {
                self.ranges_set_aside += 1;
                return;
            }
            Fate::Together => {
                self.ranges_used += 1;
                return;
            }
            Fate::Refused => return,
        };
        if nis.is_finite() {
            self.nis_sum += nis;
            self.nis_count += 1;
        }
    }
}

/// All of it.
#[derive(Serialize)]
pub(super) struct Report {
    from_s: f64,
    to_s: f64,
    end_m: [f64; 3],
    end_sigma_m: [f64; 3],
    /// Largest standard deviation on the way, horizontal and vertical.
    worst_sigma_m: [f64; 2],
    counts: Counts,
    /// Mean normalised innovation squared of the ranges used: near 1 where sigmas are right, less
    /// where they are cautious.
    mean_nis: Option<f64>,
    /// Against the truth given.
    errors: Option<Errors>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Errors {
    rmse_horizontal_m: f64,
    rmse_vertical_m: f64,
    max_horizontal_m: f64,
    max_vertical_m: f64,
    moments: usize,
}

impl Report {
    pub(super) fn new(
        track: &[Navigation],
        counts: Counts,
        truth: Option<&Track>,
        notes: Vec<String>,
    ) -> Self {
        let sigma = |n: &Navigation| n.covariance_m2.diagonal().map(|v| v.max(0.0).sqrt());
        let (mut end_m, mut end_sigma_m) = ([0.0; 3], [0.0; 3]);
        if let Some(last) = track.last() {
            (end_m, end_sigma_m) = (last.position_m.into(), sigma(last).into());
        }
        let worst = track
            .iter()
            .map(sigma)
            .fold([0.0f64; 2], |[h, v], s| [h.max(s.xy().norm()), v.max(s.z)]);
        let nis_count = counts.nis_count;
        Self {
            from_s: track.first().map_or(0.0, |n| n.t_s),
            to_s: track.last().map_or(0.0, |n| n.t_s),
            end_m,
            end_sigma_m,
            worst_sigma_m: worst,
            mean_nis: (nis_count > 0).then(|| counts.nis_sum / nis_count as f64),
            counts,
            errors: truth.and_then(|truth| Errors::of(track, truth)),
            notes,
        }
    }

    pub(super) fn text(&self) -> String {
        let c = &self.counts;
        let mut out = format!(
            "time            {:.1} to {:.1} s\n\
             end             {:.3} {:.3} {:.3} m, sigma {:.3} {:.3} {:.3}\n\
             worst sigma     {:.3} m horizontal, {:.3} vertical\n\
             GNSS            {} positions\n\
             ranges          {} used, {} weighed down, {} set aside\n\
             refused         {}\n",
            self.from_s,
            self.to_s,
            self.end_m[0],
            self.end_m[1],
            self.end_m[2],
            self.end_sigma_m[0],
            self.end_sigma_m[1],
            self.end_sigma_m[2],
            self.worst_sigma_m[0],
            self.worst_sigma_m[1],
            c.gnss,
            c.ranges_used,
            c.ranges_weighed_down,
            c.ranges_set_aside,
            c.refused,
        );
        // Writing to a string cannot fail.
        if let Some(nis) = self.mean_nis {
            let _ = writeln!(out, "NIS of ranges   {nis:.2}");
        }
        if let Some(e) = &self.errors {
            let _ = writeln!(
                out,
                "error           RMSE {:.3} m horizontal, {:.3} vertical; largest {:.3}, {:.3}",
                e.rmse_horizontal_m, e.rmse_vertical_m, e.max_horizontal_m, e.max_vertical_m
            );
        }
        out
    }
}

impl Errors {
    fn of(track: &[Navigation], truth: &Track) -> Option<Self> {
        /// Longest gap of the truth that is bridged, seconds.
        const GAP_S: f64 = 1.0;
        let (mut squares, mut largest, mut moments) = ([0.0; 2], [0.0f64; 2], 0);
        for now in track {
            let Some((true_m, _)) = truth.at(now.t_s, GAP_S) else {
                continue;
            };
            let error = now.position_m - true_m;
            for (k, e) in [error.xy().norm(), error.z.abs()].into_iter().enumerate() {
                squares[k] += e * e;
                largest[k] = largest[k].max(e);
            }
            moments += 1;
        }
        let rmse = squares.map(|sum: f64| (sum / moments as f64).sqrt());
        (moments > 0).then_some(Self {
            rmse_horizontal_m: rmse[0],
            rmse_vertical_m: rmse[1],
            max_horizontal_m: largest[0],
            max_vertical_m: largest[1],
            moments,
        })
    }
}

/// The track as CSV.
pub(super) fn csv(track: &[Navigation], frame: Option<&LocalFrame>) -> String {
    let mut out = String::from("t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m");
    if frame.is_some() {
        out += ",lat_deg,lon_deg,alt_m";
    }
    out.push('\n');
    for n in track {
        let (p, s) = (
            n.position_m,
            n.covariance_m2.diagonal().map(|v| v.max(0.0).sqrt()),
        );
        let _ = write!(
            out,
            "{:.3},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4}",
            n.t_s, p.x, p.y, p.z, s.x, s.y, s.z
        );
        if let Some(frame) = frame {
            let place = frame.geodetic(&p);
            let _ = write!(
                out,
                ",{:.9},{:.9},{:.4}",
                place.lat_deg, place.lon_deg, place.height_m
            );
        }
        out.push('\n');
    }
    out
}
