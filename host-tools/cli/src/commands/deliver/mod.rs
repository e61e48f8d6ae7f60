//! `nova deliver`: simulated deliveries, from take-off to touchdown and back.

mod page;

use crate::error::bad_input;
use crate::files::read_toml;
use crate::recording::delivery::Recording;
use crate::screen;
use anyhow::Result;
use nova_flight::delivery::{
    DeliveryResult, DeliveryRow, Event, FilterKind, Sample, Scenario, deliver, deliver_many,
};
use nova_flight::trial_seed;
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;

/// Flies simulated deliveries: path, vector field, landing filter and mission of Miranda et al. (2022) in closed loop.
///
/// One delivery says how it went; many (--trials) how well they do it. --failures flies the combinations of sensors of the paper's
/// Fig. 15, --compare both filters: the paper's EKF and the error-state filter. The scenario is a TOML file; what it leaves
/// out is the paper's Sec. 5.1 (h 45 m, r 6 m, d 100.03 m). docs/delivery.md has the results and all settings.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  nova deliver                                             one delivery as in the paper
  nova deliver --out page.html                             with the path, its distance and the Lyapunov value over time
  nova deliver --trials 100 --failures --compare           the table of docs/delivery.md
  nova deliver --record flight.mcap                        all that the filter was told and said, for viewers and nova replay
  nova deliver --scenario windy.toml --trials 20 --json")]
pub(crate) struct Deliver {
    /// What differs from the paper's delivery.
    #[arg(long, value_name = "FILE.toml")]
    scenario: Option<PathBuf>,
    /// How many deliveries.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    trials: u64,
    /// Where chance begins.
    #[arg(long, default_value_t = 2025)]
    seed: u64,
    /// The combinations of sensors of Fig. 15, one row each.
    #[arg(long)]
    failures: bool,
    /// Both filters, one row each.
    #[arg(long)]
    compare: bool,
    /// A JSON line for each row; with one delivery, its result.
    #[arg(long)]
    json: bool,
    /// A page with pictures of the first delivery.
    #[arg(long, value_name = "PAGE.html")]
    out: Option<PathBuf>,
    /// A recording of the first delivery: what its filter was told and said; `nova replay` reads it.
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
}

/// One row.
#[derive(Serialize)]
struct Line<'a> {
    sensors: &'a str,
    filter: FilterKind,
    row: &'a DeliveryRow,
    /// The first delivery, where it is the only one.
    result: Option<&'a DeliveryResult>,
}

/// A combination of sensors: GPS, and large marker, small marker, UWB.
const COMBINATIONS: [(&str, [bool; 3]); 8] = [
    ("all", [true, true, true]),
    ("no UWB", [true, true, false]),
    ("no small marker", [true, false, true]),
    ("no large marker", [false, true, true]),
    ("UWB alone", [false, false, true]),
    ("large marker alone", [true, false, false]),
    ("small marker alone", [false, true, false]),
    ("GPS alone", [false, false, false]),
];

impl Deliver {
    pub(crate) fn run(self) -> Result<()> {
        let scenario = self.scenario()?;
        let rows = self.rows(&scenario);
        let mut out = std::io::stdout().lock();
        let bar = screen::progress(self.trials * rows.len() as u64, self.trials == 1);
        if !self.json && self.trials > 1 {
            writeln!(
                out,
                "{:<20} {:<12} {:>7} {:>11} {:>9} {:>7} {:>7} {:>9}",
                "sensors",
                "filter",
                "landed",
                "on platform",
                "off (m)",
                "spread",
                "most",
                "error (m)"
            )?;
        }
        for (name, scenario) in &rows {
            let (row, results) = deliver_many(scenario, self.trials, self.seed, || bar.inc(1))
                .map_err(|fault| bad_input!("the scenario cannot be flown: {fault}"))?;
            let result = results.first().filter(|_| self.trials == 1);
            if self.json {
                let line = Line {
                    sensors: name,
                    filter: scenario.filter,
                    row: &row,
                    result,
                };
                serde_json::to_writer(&mut out, &line)?;
                writeln!(out)?;
            } else {
                match result {
                    Some(result) => tell(&mut out, name, scenario, result)?,
                    None => tabulate(&mut out, name, scenario, &row)?,
                }
            }
            out.flush()?;
        }
        bar.finish_and_clear();
        if self.out.is_some() || self.record.is_some() {
            self.first(&scenario)?;
        }
        Ok(())
    }

    /// Flies the first delivery once more, for its page and its recording.
    fn first(&self, scenario: &Scenario) -> Result<()> {
        let first = trial_seed(self.seed, 0);
        let mut recording = match &self.record {
            Some(path) => Some((Recording::new(scenario, first)?, path)),
            None => None,
        };
        let mut samples: Vec<Sample> = Vec::new();
        let result = deliver(scenario, first, |event| {
            if let Event::Sample(sample) = event {
                samples.push(*sample);
            }
            if let Some((recording, _)) = &mut recording {
                recording.add(event);
            }
        })
        .map_err(|fault| bad_input!("the scenario cannot be flown: {fault}"))?;
        if let Some(path) = &self.out {
            page::write(path, scenario, &samples, &result)?;
        }
        if let Some((recording, path)) = recording {
            recording.finish(path)?;
        }
        Ok(())
    }

    fn scenario(&self) -> Result<Scenario> {
        let Some(path) = &self.scenario else {
            return Ok(Scenario::default());
        };
        read_toml(path)
    }

    fn rows(&self, scenario: &Scenario) -> Vec<(&'static str, Scenario)> {
        let filters = if self.compare {
            vec![FilterKind::Paper, FilterKind::ErrorState]
        } else {
            vec![scenario.filter]
        };
        let mut rows = Vec::new();
        for filter in filters {
            let scenario = Scenario {
                filter,
                ..scenario.clone()
            };
            if !self.failures {
                rows.push(("as given", scenario));
                continue;
            }
            for (name, [large_marker, small_marker, uwb]) in COMBINATIONS {
                let combined = Scenario {
                    large_marker,
                    small_marker,
                    uwb,
                    // Theirs landed by GPS alone too, beside the platform.
                    land_by_gps: scenario.land_by_gps || !(large_marker || small_marker || uwb),
                    return_trip: false,
                    ..scenario.clone()
                };
                rows.push((name, combined));
            }
        }
        rows
    }
}

fn filter_name(filter: FilterKind) -> &'static str {
    match filter {
        FilterKind::Paper => "paper's EKF",
        FilterKind::ErrorState => "error state",
    }
}

fn metres(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |m| format!("{m:.3}"))
}

fn tabulate(
    out: &mut impl Write,
    name: &str,
    scenario: &Scenario,
    row: &DeliveryRow,
) -> Result<()> {
    writeln!(
        out,
        "{:<20} {:<12} {:>7} {:>11} {:>9} {:>7} {:>7} {:>9}",
        name,
        filter_name(scenario.filter),
        format!("{}/{}", row.landed, row.trials),
        row.on_platform,
        metres(row.off_centre_m),
        metres(row.off_centre_spread_m),
        metres(row.off_centre_most_m),
        metres(row.estimate_error_m),
    )?;
    Ok(())
}

fn tell(
    out: &mut impl Write,
    name: &str,
    scenario: &Scenario,
    result: &DeliveryResult,
) -> Result<()> {
    writeln!(out, "{name}, {}", filter_name(scenario.filter))?;
    match (result.off_centre_m, result.estimate_error_m) {
        (Some(off_m), Some(error_m)) => writeln!(
            out,
            "  touchdown {off_m:.3} m from the centre, {}; the estimate was {error_m:.3} m off",
            if result.on_platform {
                "on the platform"
            } else {
                "beside the platform"
            }
        )?,
        _ => writeln!(out, "  did not land at the goal")?,
    }
    writeln!(
        out,
        "  at most {:.2} m from the path before the platform was measured",
        result.off_path_m
    )?;
    let (delivered, finished) = (result.delivered, result.finished);
    writeln!(
        out,
        "  package {}, mission {} after {:.0} s",
        if delivered {
            "delivered"
        } else {
            "not delivered"
        },
        if finished { "finished" } else { "not finished" },
        result.end_s
    )?;
    for trouble in &result.troubles {
        writeln!(out, "  ! {trouble}")?;
    }
    Ok(())
}
