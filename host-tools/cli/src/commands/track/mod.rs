//! `nova track`: a vehicle that follows a moving target, once to look at, or many times.

mod page;
mod report;

use crate::error::bad_input;
use crate::files::read_toml;
use crate::screen;
use anyhow::Result;
use nova_flight::tracking::{
    Controller, Estimator, TrackingResult, TrackingRow, TrackingScene, TrackingTrial, track,
    track_many,
};
use nova_flight::trial_seed;
use serde::Serialize;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Follows a moving target by its range and bearing, simulated: who estimates and who flies, compared.
///
/// A vehicle with an antenna array follows a target that carries a tag and keeps a distance to it, whose
/// bounds it must not leave. Estimators: `ekf`, `plain` (a factor graph), `robust` (the paper's), `graduated`
/// (kernels that begin wide), `interacting` (motions and blocked sight that take turns). Controllers: `clf` (without barriers), `fixed` (barriers at the bounds),
/// `aware` (the paper's, tightened by the covariance), `sampled` (the same between samples too). All are
/// compared unless one is named; where a scene has a controller, estimators fly with `robust` only unless
/// one is named. docs/tracking.md says what they are.
///
/// RMSE is of the place that is believed at each sighting; `inside` the part of sightings at which the
/// true place is within the confidence radius; distances are true and looked at between sightings too.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova track --scenario host-tools/scenes/fig-6.toml --trials 50 --seed 2025
  nova track --scenario host-tools/scenes/fig-7.toml --trials 200 --json
  nova track --scenario host-tools/scenes/corridor.toml --controller aware --out corridor.html")]
pub(crate) struct Track {
    /// The scene; host-tools/scenes has some, which tell their format.
    #[arg(long, value_name = "F.toml")]
    scenario: PathBuf,
    /// Only this estimator.
    #[arg(long, value_name = "NAME")]
    estimator: Option<Estimator>,
    /// Only this controller.
    #[arg(long, value_name = "NAME")]
    controller: Option<Controller>,
    /// Flights under each condition.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    trials: u64,
    /// Everything random follows from this number.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Write a page with the table and pictures of the first flight.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// All figures, as printed with `--json`.
#[derive(Serialize)]
struct Summary<'a> {
    scene: &'a TrackingScene,
    seed: u64,
    rows: &'a [TrackingRow],
    #[serde(skip_serializing_if = "Option::is_none")]
    page: Option<&'a Path>,
}

/// Who estimates, who flies, and the part of outliers.
type Condition = (Estimator, Controller, f64);

impl Track {
    pub(crate) fn run(self) -> Result<()> {
        let scene = read(&self.scenario)?;
        if self.controller.is_some() && scene.standoff.is_none() {
            return Err(bad_input!(
                "{}: --controller has nothing to control: the scene has no [standoff]",
                self.scenario.display()
            ));
        }
        let conditions = self.conditions(&scene);
        let bar = screen::progress(self.trials * conditions.len() as u64, self.json);
        let rows = track_many(&scene, &conditions, self.trials, self.seed, || bar.inc(1))?;
        bar.finish_and_clear();
        if let Some(path) = &self.out {
            let shown = self.shown(&scene, &conditions)?;
            page::write(path, &scene, self.seed, &rows, &shown)?;
        }
        let said = if self.json {
            let summary = Summary {
                scene: &scene,
                seed: self.seed,
                rows: &rows,
                page: self.out.as_deref(),
            };
            serde_json::to_string(&summary)? + "\n"
        } else {
            report::text(&scene, &rows, self.out.as_deref())
        };
        Ok(std::io::stdout().write_all(said.as_bytes())?)
    }

    fn conditions(&self, scene: &TrackingScene) -> Vec<Condition> {
        let closed = scene.standoff.is_some();
        let estimators = match self.estimator {
            Some(one) => vec![one],
            None if closed => vec![Estimator::Robust],
            None => Estimator::ALL.to_vec(),
        };
        let controllers = match self.controller {
            Some(one) => vec![one],
            None if closed => Controller::ALL.to_vec(),
            None => vec![Controller::Aware],
        };
        let mut all = Vec::new();
        for &outliers in &scene.sensor.outlier_probability {
            for &estimator in &estimators {
                for &controller in &controllers {
                    all.push((estimator, controller, outliers));
                }
            }
        }
        all
    }

    /// The first flight with the first part of outliers that is not 0, under each condition.
    fn shown(
        &self,
        scene: &TrackingScene,
        conditions: &[Condition],
    ) -> Result<Vec<(String, TrackingResult)>> {
        let parts = &scene.sensor.outlier_probability;
        let outliers = (parts.iter().copied())
            .find(|p| *p > 0.0)
            .or(parts.first().copied());
        let mut shown = Vec::new();
        for &(estimator, controller, outlier_probability) in conditions {
            if Some(outlier_probability) != outliers {
                continue;
            }
            let result = track(&TrackingTrial {
                scene,
                estimator,
                controller,
                outlier_probability,
                seed: trial_seed(self.seed, 0),
            })?;
            let name = match scene.standoff {
                Some(_) if self.estimator.is_none() => controller.to_string(),
                Some(_) => format!("{estimator}, {controller}"),
                None => estimator.to_string(),
            };
            shown.push((name, result));
        }
        Ok(shown)
    }
}

fn read(path: &Path) -> Result<TrackingScene> {
    let shown = path.display();
    let scene: TrackingScene = read_toml(path)?;
    scene
        .validate()
        .map_err(|error| bad_input!("{shown}: {error}"))?;
    Ok(scene)
}
