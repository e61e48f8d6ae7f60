//! `nova fly`: one flight to look at, or many of one kind.

mod drawing;
mod page;
mod picture;

use crate::evaluation::Line;
use crate::screen;
use crate::settings::{self, Change};
use anyhow::Result;
use nova_flight::{
    Condition, FlightResult, Method, Preset, Recording, Row, Settings, Trial, fly_recorded,
    trial_seed,
};
use picture::Picture;
use serde::Serialize;
use std::io::Write as _;
use std::path::PathBuf;

/// Flies to a tag, simulated: one flight and a page that plays it, or many flights and their figures.
///
/// A vehicle with accelerometer, barometer and UWB radio is handed over some way off and finds the tag
/// from what these measure. Methods: `map` (maximum a posteriori over the whole flight), `nova` (the
/// paper's), `v1` to `v7` and `v2p` (its ablation variants, Table IV), `sa`, `rp`, `rp-error` (the
/// baselines of its Fig. 13).
///
/// With --trials N nothing is drawn: N flights give one row of figures, in JSON mean_m, median_m,
/// p95_m, max_m, below_1m, below_0_5m, below_0_25m (parts of 1), time_s, overhead, flips, bound_m,
/// nees, nees_band, solve_ms_median, solve_ms_p99, trials, landed, method, seed and settings.
#[derive(clap::Args)]
#[command(
    after_help = format!("{EXAMPLES}\n`nova fly --help` lists the settings."),
    after_long_help = format!("{EXAMPLES}\n{}", settings::help())
)]
pub(crate) struct Fly {
    /// Who navigates.
    #[arg(long, default_value = "map", value_name = "NAME")]
    method: Method,
    /// Settings to begin with: P like the paper's, R realistic.
    #[arg(long, default_value = "P", value_name = "P|R")]
    preset: Preset,
    /// Who holds the vehicle on its legs: one who knows where it is, or the vehicle itself by what it
    /// reckons.
    #[arg(long, default_value = "self-nav", value_name = "follow|self-nav")]
    pilot: String,
    /// A setting that differs from the preset; may be given several times.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    changes: Vec<Change>,
    /// Everything random follows from this number.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Which flight of those that --trials would make.
    #[arg(long, value_name = "I", default_value_t = 0, conflicts_with = "trials")]
    trial: u64,
    /// The page.
    #[arg(
        long,
        value_name = "FILE",
        default_value = "nova-fly.html",
        conflicts_with = "trials"
    )]
    out: PathBuf,
    /// Make so many flights and give their figures.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    trials: Option<u64>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "Examples:
  nova fly
  nova fly --method nova --pilot follow --seed 7 --out seven.html
  nova fly --preset R --set wind_xy=0.3 --set wind_z=0.1 --set first_guess=very-high
  nova fly --trials 100 --seed 2025 --json";

/// One flight, as printed with `--json`.
#[derive(Serialize)]
struct Summary<'a> {
    method: Method,
    preset: Preset,
    pilot: &'a str,
    seed: u64,
    trial: u64,
    #[serde(flatten)]
    result: &'a FlightResult,
    tag_m: [f64; 3],
    first_guess_m: [f64; 3],
    /// Of the tag relative to the vehicle, at the last estimate.
    sigma_m: Option<[f64; 3]>,
    /// Readings that the navigator refused.
    refused: u64,
    settings: &'a Settings,
    page: &'a PathBuf,
}

impl Summary<'_> {
    /// Under what the flight was made.
    fn circumstances(&self) -> String {
        format!(
            "preset {:?}, pilot {}, seed {}, flight {}",
            self.preset, self.pilot, self.seed, self.trial
        )
    }
}

impl Fly {
    pub(crate) fn run(self) -> Result<()> {
        let pilot = Change::word("pilot", &self.pilot);
        let changes = std::iter::once(pilot).chain(self.changes.iter().cloned());
        let settings = settings::settings(self.preset, changes)?;
        let said = match self.trials {
            Some(trials) => self.many(settings, trials)?,
            None => self.one(settings)?,
        };
        Ok(std::io::stdout().write_all(said.as_bytes())?)
    }

    /// One flight; what is to be said about it.
    fn one(&self, settings: Settings) -> Result<String> {
        let trial = Trial {
            method: self.method,
            settings,
            seed: trial_seed(self.seed, self.trial),
        };
        let (result, recording) = fly_recorded(&trial);
        let summary = Summary {
            method: self.method,
            preset: self.preset,
            pilot: &self.pilot,
            seed: self.seed,
            trial: self.trial,
            result: &result,
            tag_m: recording.scene.tag_m.into(),
            first_guess_m: recording.scene.first_guess.tag_m.into(),
            sigma_m: sigma_m(&recording),
            refused: recording.refused,
            settings: &trial.settings,
            page: &self.out,
        };
        page::write(&summary, &Picture::new(&recording))?;
        if self.json {
            // Computing times differ from run to run and would be the longest part.
            let mut json = serde_json::to_value(&summary)?;
            if let Some(object) = json.as_object_mut() {
                object.remove("update_ms");
            }
            return Ok(serde_json::to_string(&json)? + "\n");
        }
        Ok(text(&summary))
    }

    /// Many flights; what is to be said about them.
    fn many(&self, settings: Settings, trials: u64) -> Result<String> {
        let bar = screen::progress(trials, self.json);
        let condition = Condition {
            method: self.method,
            flown_by: None,
            settings,
        };
        let numbers: Vec<u64> = (0..trials).collect();
        let conditions = std::slice::from_ref(&condition);
        let results = nova_flight::run(conditions, &numbers, self.seed, |_| bar.inc(1));
        bar.finish_and_clear();
        let row = Row::of(&results.concat());
        if self.json {
            let line = Line {
                condition: None,
                method: self.method,
                flown_by: None,
                seed: self.seed,
                row: &row,
                beside: &Default::default(),
                settings: &condition.settings,
            };
            return Ok(serde_json::to_string(&line)? + "\n");
        }
        Ok(text_of_many(&row))
    }
}

fn sigma_m(recording: &Recording) -> Option<[f64; 3]> {
    let (_, estimate) = recording.estimates.last()?;
    let covariance = estimate.relative_covariance_m2?;
    Some(covariance.diagonal().map(|v| v.max(0.0).sqrt()).into())
}

fn text(s: &Summary<'_>) -> String {
    let result = s.result;
    let maybe = |name: &str, text: Option<String>| {
        text.map_or_else(String::new, |text| format!("{name:<16}{text}\n"))
    };
    let horizontal = |sigma_m: [f64; 3]| {
        let [x, y, _] = sigma_m;
        format!(
            "{:.3} m horizontally, as the navigator believes",
            x.hypot(y)
        )
    };
    format!(
        "error           {:.3} m between vehicle and tag{}\n{}{}\
         flight          {:.1} s, {:.1} m, {:+.1} % over the ideal path\n\
         page            {}\n",
        result.error_m,
        if result.landed {
            " at touchdown"
        } else {
            ", not landed at the time limit"
        },
        maybe("sigma", s.sigma_m.map(horizontal)),
        maybe(
            "bound",
            result
                .bound_m
                .map(|b| format!("{b:.3} m: least mean error on this path"))
        ),
        result.time_s,
        result.path_length_m,
        100.0 * result.overhead,
        s.page.display()
    )
}

fn text_of_many(row: &Row) -> String {
    let maybe = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let band = row.nees_band.filter(|_| row.nees.is_some());
    format!(
        "flights         {}, {} landed\n\
         error           mean {:.3} m, median {:.3}, p95 {:.3}, largest {:.3}\n\
         below           1 m {:.0} %, 0.5 m {:.0} %, 0.25 m {:.0} %\n\
         bound           {} m\n\
         time            {:.1} s, overhead {:+.1} %\n\
         flips           {:.0} %\n\
         NEES            {}{}\n\
         an update       {} ms median, {} ms p99\n",
        row.trials,
        row.landed,
        row.mean_m,
        row.median_m,
        row.p95_m,
        row.max_m,
        100.0 * row.below_1m,
        100.0 * row.below_0_5m,
        100.0 * row.below_0_25m,
        maybe(row.bound_m, 3),
        row.time_s,
        100.0 * row.overhead,
        100.0 * row.flips,
        maybe(row.nees, 2),
        band.map_or_else(String::new, |[low, high]| format!(
            ", honest within {low:.2} to {high:.2}"
        )),
        maybe(row.solve_ms_median, 3),
        maybe(row.solve_ms_p99, 3),
    )
}
