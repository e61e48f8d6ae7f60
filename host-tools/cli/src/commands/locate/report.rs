//! What `nova locate` says.

use super::input::Anchors;
use crate::peer::Peer;
use anyhow::Result;
use nalgebra::{Matrix3, Vector3};
use nova_solver::positioning::{ListeningCounts, RoundJudgement, TdoaFix, Tracked};
use nova_solver::survey::Track;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The truth is not bridged over longer gaps, seconds.
const GAP_S: f64 = 1.0;

fn sigma_m(covariance_m2: &Matrix3<f64>) -> [f64; 3] {
    covariance_m2.diagonal().map(|v| v.max(0.0).sqrt()).into()
}

/// A place.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Placed {
    pub(super) t_s: f64,
    pub(super) position_m: [f64; 3],
    pub(super) velocity_m_s: [f64; 3],
    pub(super) sigma_m: [f64; 3],
    pub(super) covariance_m2: [[f64; 3]; 3],
    /// Differences of the round that were taken in, and set aside.
    used: usize,
    set_aside: usize,
    /// Where the track may as well have begun.
    #[serde(skip_serializing_if = "Option::is_none")]
    alternative_m: Option<[f64; 3]>,
}

impl Placed {
    pub(super) fn new(
        state: &Tracked,
        alternative: Option<Vector3<f64>>,
        of: &RoundJudgement,
    ) -> Self {
        Self {
            t_s: state.t_s,
            position_m: state.position_m.into(),
            velocity_m_s: state.velocity.into(),
            sigma_m: sigma_m(&state.covariance_m2),
            covariance_m2: state.covariance_m2.into(),
            used: of.used,
            set_aside: of.set_aside,
            alternative_m: alternative.map(Into::into),
        }
    }

    /// A line of it.
    pub(super) fn line(&self, json: bool) -> String {
        if json {
            #[derive(Serialize)]
            struct Line<'a> {
                place: &'a Placed,
            }
            // Numbers and names alone: nothing in it can fail.
            return serde_json::to_string(&Line { place: self }).unwrap_or_default() + "\n";
        }
        let ([x, y, z], [sx, sy, sz]) = (self.position_m, self.sigma_m);
        format!(
            "{:>9.3} s  {x:>8.3} {y:>8.3} {z:>8.3} m   sigma {sx:.3} {sy:.3} {sz:.3}   {} used, {} set aside\n",
            self.t_s, self.used, self.set_aside
        )
    }
}

/// What became of the differences.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(super) struct Counts {
    pub(super) differences: usize,
    pub(super) used: usize,
    pub(super) set_aside: usize,
    refused: usize,
    #[serde(skip)]
    nis: f64,
    #[serde(skip)]
    judged: usize,
}

impl Counts {
    pub(super) fn add(&mut self, of: &RoundJudgement) {
        self.used += of.used;
        self.set_aside += of.set_aside;
        self.refused += of.refused;
        if of.nis > 0.0 {
            self.nis += of.nis;
            self.judged += of.used;
        }
    }
}

/// One place from everything.
#[derive(Debug, Serialize)]
pub(super) struct Still {
    position_m: [f64; 3],
    sigma_m: [f64; 3],
    covariance_m2: [[f64; 3]; 3],
    alternative_m: Option<[f64; 3]>,
    /// What each anchor's end of a difference reads too long.
    offsets_m: Vec<Offset>,
    offset_sigma_m: f64,
    /// Scatter of the differences in units of their sigmas.
    noise_scale: f64,
}

#[derive(Debug, Serialize)]
struct Offset {
    anchor: Option<Peer>,
    offset_m: f64,
}

impl Still {
    pub(super) fn new(fix: &TdoaFix, anchors: &Anchors) -> Self {
        Self {
            position_m: fix.position_m.into(),
            sigma_m: sigma_m(&fix.covariance_m2),
            covariance_m2: fix.covariance_m2.into(),
            alternative_m: fix.alternative_m.map(Into::into),
            offsets_m: (fix.offsets_m.iter())
                .map(|(place, offset_m)| Offset {
                    anchor: anchors.name_at(place).cloned(),
                    offset_m: *offset_m,
                })
                .collect(),
            offset_sigma_m: fix.offset_sigma_m,
            noise_scale: fix.noise_scale,
        }
    }
}

/// All of it.
#[derive(Serialize)]
pub(super) struct Report {
    places: usize,
    from_s: Option<f64>,
    to_s: Option<f64>,
    /// Of the last place.
    end_m: Option<[f64; 3]>,
    end_sigma_m: Option<[f64; 3]>,
    /// The track may as well have begun there.
    #[serde(skip_serializing_if = "Option::is_none")]
    alternative_m: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    still: Option<Still>,
    counts: Counts,
    /// Mean normalised innovation squared of a difference that was used: near 1 where sigmas are right.
    mean_nis: Option<f64>,
    /// Exchanges and frames that gave no difference, by cause.
    not_used: BTreeMap<&'static str, u64>,
    errors: Option<Errors>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Errors {
    rmse_horizontal_m: f64,
    rmse_vertical_m: f64,
    rmse_m: f64,
    sigma_m: f64,
    max_m: f64,
    /// Mean normalised estimation error squared; 3 where covariances are right.
    mean_nees: f64,
    moments: usize,
}

impl Report {
    pub(super) fn new(
        track: &[Placed],
        still: Option<Still>,
        counts: Counts,
        heard: Option<&ListeningCounts>,
        truth: Option<&Track>,
        notes: Vec<String>,
    ) -> Self {
        let last = track.last();
        let errors = truth.and_then(|truth| match &still {
            Some(still) => Errors::of(
                truth
                    .points()
                    .iter()
                    .map(|point| (still.position_m, still.covariance_m2, point.position_m)),
            ),
            None => Errors::of(track.iter().filter_map(|at| {
                let (true_m, _) = truth.at(at.t_s, GAP_S)?;
                Some((at.position_m, at.covariance_m2, true_m))
            })),
        });
        Self {
            places: track.len(),
            from_s: track.first().map(|at| at.t_s),
            to_s: last.map(|at| at.t_s),
            end_m: last.map(|at| at.position_m),
            end_sigma_m: last.map(|at| at.sigma_m),
            alternative_m: last.and_then(|at| at.alternative_m),
            still,
            mean_nis: (counts.judged > 0).then(|| counts.nis / counts.judged as f64),
            counts,
            not_used: (heard.map(ListeningCounts::rejections).into_iter().flatten())
                .filter(|(_, count)| *count > 0)
                .collect(),
            errors,
            notes,
        }
    }

    pub(super) fn json(&self) -> Result<String> {
        #[derive(Serialize)]
        struct Line<'a> {
            end: &'a Report,
        }
        Ok(serde_json::to_string(&Line { end: self })? + "\n")
    }

    pub(super) fn text(&self) -> String {
        let mut out = String::new();
        let three = |[x, y, z]: [f64; 3]| format!("{x:.3} {y:.3} {z:.3}");
        // Writing to a string cannot fail.
        if let (Some(from_s), Some(to_s), Some(end_m), Some(sigma)) =
            (self.from_s, self.to_s, self.end_m, self.end_sigma_m)
        {
            let _ = writeln!(
                out,
                "track           {} places, {from_s:.1} to {to_s:.1} s",
                self.places
            );
            let _ = writeln!(
                out,
                "end             {} m, sigma {}",
                three(end_m),
                three(sigma)
            );
        }
        let mut doubt = self.alternative_m;
        if let Some(still) = &self.still {
            let _ = writeln!(
                out,
                "place           {} m, sigma {}",
                three(still.position_m),
                three(still.sigma_m)
            );
            let offsets: Vec<String> = (still.offsets_m.iter())
                .map(|of| {
                    let name = of
                        .anchor
                        .as_ref()
                        .map_or_else(|| "?".to_owned(), ToString::to_string);
                    format!("{name} {:+.3}", of.offset_m)
                })
                .collect();
            let _ = writeln!(out, "offsets         {} m", offsets.join(", "));
            let _ = writeln!(
                out,
                "scatter         {:.2} of the sigmas given",
                still.noise_scale
            );
            doubt = still.alternative_m;
        }
        if let Some(place) = doubt {
            let _ = writeln!(
                out,
                "!               may as well be at {}: --heights tells, or one more anchor out of their plane",
                three(place)
            );
        }
        let c = &self.counts;
        let _ = writeln!(
            out,
            "differences     {}: {} used, {} set aside, {} refused",
            c.differences, c.used, c.set_aside, c.refused
        );
        for (name, count) in &self.not_used {
            let _ = writeln!(out, "{name:<15} {count}");
        }
        if let Some(nis) = self.mean_nis {
            let _ = writeln!(out, "NIS             {nis:.2}");
        }
        if let Some(e) = &self.errors {
            let _ = writeln!(
                out,
                "error           RMSE {:.3} m ({:.3} horizontal, {:.3} vertical), largest {:.3}; sigma {:.3}, NEES {:.1} of 3",
                e.rmse_m, e.rmse_horizontal_m, e.rmse_vertical_m, e.max_m, e.sigma_m, e.mean_nees
            );
        }
        for note in &self.notes {
            let _ = writeln!(out, "{note}");
        }
        out
    }
}

impl Errors {
    fn of(moments: impl Iterator<Item = ([f64; 3], [[f64; 3]; 3], Vector3<f64>)>) -> Option<Self> {
        let (mut squares, mut variance, mut nees, mut max_m, mut count) =
            ([0.0; 2], 0.0, 0.0, 0.0f64, 0usize);
        for (position_m, covariance_m2, true_m) in moments {
            let error = Vector3::from(position_m) - true_m;
            let covariance = Matrix3::from(covariance_m2);
            let Some(inverse) = covariance.try_inverse() else {
                continue;
            };
            squares[0] += error.xy().norm_squared();
            squares[1] += error.z * error.z;
            variance += covariance.trace();
            nees += error.dot(&(inverse * error));
            max_m = max_m.max(error.norm());
            count += 1;
        }
        let n = count as f64;
        let root = |sum: f64| (sum / n).sqrt();
        (count > 0).then(|| Self {
            rmse_horizontal_m: root(squares[0]),
            rmse_vertical_m: root(squares[1]),
            rmse_m: root(squares[0] + squares[1]),
            sigma_m: root(variance),
            max_m,
            mean_nees: nees / n,
            moments: count,
        })
    }
}

/// The track as CSV.
pub(super) fn csv(track: &[Placed]) -> String {
    let mut out = String::from("t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m\n");
    for at in track {
        let ([x, y, z], [sx, sy, sz]) = (at.position_m, at.sigma_m);
        let _ = writeln!(
            out,
            "{:.6},{x:.4},{y:.4},{z:.4},{sx:.4},{sy:.4},{sz:.4}",
            at.t_s
        );
    }
    out
}
