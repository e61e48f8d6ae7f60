//! What is said about many flights: a table, JSON lines, a page.

use super::plan::{Beside, Entry, Plan};
use crate::chart::{Axis, Chart, Corner, Point, Series};
use crate::page::Page;
use anyhow::Result;
use nova_flight::{FlightResult, Method, Row, Settings};
use plotters::style::RGBColor;
use serde::Serialize;
use std::path::Path;

/// A run's rows.
pub(crate) struct Report {
    title: String,
    source: Option<String>,
    seed: u64,
    conditions: Vec<Flown>,
}

/// One condition, flown.
struct Flown {
    entry: Entry,
    row: Row,
    /// Ascending.
    errors_m: Vec<f64>,
}

/// A row in JSON.
#[derive(Serialize)]
pub(crate) struct Line<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) condition: Option<&'a str>,
    pub(crate) method: Method,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) flown_by: Option<Method>,
    pub(crate) seed: u64,
    #[serde(flatten)]
    pub(crate) row: &'a Row,
    #[serde(flatten)]
    pub(crate) beside: &'a Beside,
    pub(crate) settings: &'a Settings,
}

/// Ours and those of others first.
const COLUMNS: [&str; 19] = [
    "condition",
    "method",
    "mean m",
    "<1 m %",
    "paper",
    "reference",
    "bound m",
    "x bound",
    "median m",
    "p95",
    "max",
    "<0.5 m %",
    "<0.25",
    "time s",
    "overhead %",
    "flips %",
    "landed",
    "NEES (95 % band)",
    "solve ms (p99)",
];

impl Report {
    /// Of the flights under each condition.
    pub(crate) fn new(plan: Plan, seed: u64, results: &[Vec<FlightResult>]) -> Self {
        let conditions = (plan.entries.into_iter().zip(results))
            .map(|(entry, results)| {
                let mut errors_m: Vec<f64> = results.iter().map(|r| r.error_m).collect();
                errors_m.sort_by(f64::total_cmp);
                Flown {
                    entry,
                    row: Row::of(results),
                    errors_m,
                }
            })
            .collect();
        Self {
            title: plan.title,
            source: plan.source,
            seed,
            conditions,
        }
    }

    /// One JSON object a condition.
    pub(crate) fn json(&self) -> Result<String> {
        let mut text = String::new();
        for Flown { entry, row, .. } in &self.conditions {
            text += &serde_json::to_string(&Line {
                condition: Some(&entry.name),
                method: entry.method,
                flown_by: entry.flown_by,
                seed: self.seed,
                row,
                beside: &entry.beside,
                settings: &entry.settings,
            })?;
            text.push('\n');
        }
        Ok(text)
    }

    /// A table for a terminal.
    pub(crate) fn text(&self) -> String {
        let mut rows = vec![COLUMNS.map(str::to_owned)];
        rows.extend(self.conditions.iter().map(Flown::cells));
        let mut text = format!("{}: {}\n", self.title, self.headline());
        let column = |index: usize| rows.iter().filter_map(move |row| row.get(index));
        let widths: Vec<usize> = (0..COLUMNS.len())
            .map(|index| match column(index).skip(1).all(String::is_empty) {
                true => 0,
                false => (column(index).map(|cell| cell.chars().count()).max()).unwrap_or(0),
            })
            .collect();
        for row in &rows {
            let mut line = String::new();
            for (index, (cell, &width)) in row.iter().zip(&widths).enumerate() {
                line += &match (index, width) {
                    // Nobody has anything to say there.
                    (_, 0) => String::new(),
                    // Names to the left, figures to the right.
                    (0 | 1, _) => format!("{cell:<width$}  "),
                    _ => format!("{cell:>width$}  "),
                };
            }
            text += line.trim_end();
            text.push('\n');
        }
        text
    }

    /// A page with the table and how the errors are distributed.
    pub(crate) fn write_page(&self, path: &Path) -> Result<()> {
        let mut page = Page::new(&self.title, &self.headline());
        let rows: Vec<_> = self.conditions.iter().map(Flown::cells).collect();
        page.grid(&COLUMNS, &rows);
        for some in self.conditions.chunks(COLORS.len()) {
            page.figure(
                &distribution(some)?,
                "Part of the flights that ended within a distance of the tag.",
            );
        }
        page.write(path)
    }

    fn headline(&self) -> String {
        let trials = self.conditions.first().map_or(0, |c| c.row.trials);
        let source =
            (self.source.as_ref()).map_or_else(String::new, |source| format!("; {source}"));
        format!("{trials} flights a condition, seed {}{source}", self.seed)
    }
}

impl Flown {
    fn cells(&self) -> [String; COLUMNS.len()] {
        let Self { entry, row, .. } = self;
        let metres = |value: f64| match value {
            // Perfect sensors.
            tiny if tiny < 1e-4 => format!("{value:.1e}"),
            _ => format!("{value:.3}"),
        };
        let percent = |part: f64| format!("{:.0}", 100.0 * part);
        let maybe = |value: Option<String>| value.unwrap_or_default();
        let method = match entry.flown_by {
            Some(pilot) => format!("{} on {pilot}'s flight", entry.method),
            None => entry.method.to_string(),
        };
        let nees = row.nees.zip(row.nees_band);
        let solve_ms = row.solve_ms_median.zip(row.solve_ms_p99);
        [
            entry.name.clone(),
            method,
            metres(row.mean_m),
            percent(row.below_1m),
            maybe(entry.beside.paper.clone()),
            entry.beside.reference_cell(),
            maybe(row.bound_m.map(metres)),
            maybe(
                row.bound_m
                    .map(|bound_m| format!("{:.2}", row.mean_m / bound_m)),
            ),
            metres(row.median_m),
            metres(row.p95_m),
            metres(row.max_m),
            percent(row.below_0_5m),
            percent(row.below_0_25m),
            format!("{:.1}", row.time_s),
            format!("{:+.1}", 100.0 * row.overhead),
            percent(row.flips),
            format!("{}/{}", row.landed, row.trials),
            maybe(nees.map(|(nees, [low, high])| format!("{nees:.2} ({low:.2}-{high:.2})"))),
            maybe(solve_ms.map(|(median, p99)| format!("{median:.3} ({p99:.3})"))),
        ]
    }
}

impl Beside {
    fn reference_cell(&self) -> String {
        let bound = (self.reference_bound_m).map(|bound_m| format!(" (bound {bound_m:.3})"));
        self.reference.clone().unwrap_or_default() + &bound.unwrap_or_default()
    }
}

/// As many conditions share a chart.
const COLORS: [RGBColor; 8] = [
    RGBColor(31, 119, 180),
    RGBColor(214, 39, 40),
    RGBColor(44, 160, 44),
    RGBColor(148, 103, 189),
    RGBColor(255, 127, 14),
    RGBColor(23, 150, 170),
    RGBColor(140, 86, 75),
    RGBColor(90, 90, 90),
];

/// Empirical distribution functions of the errors.
fn distribution(conditions: &[Flown]) -> Result<String> {
    let curves: Vec<Vec<Point>> = conditions.iter().map(|c| steps(&c.errors_m)).collect();
    let largest = (curves.iter().flatten()).fold(1.0_f64, |most, point| most.max(point.0));
    let series: Vec<Series<'_>> = (conditions.iter().zip(&curves).zip(COLORS))
        .map(|((condition, points), color)| Series::line(&condition.entry.name, color, points))
        .collect();
    Chart {
        size: (860, 420),
        x: Axis::log(
            "horizontal error at touchdown (m)",
            SMALLEST_M..1.1 * largest,
        ),
        y: Axis::linear("part of the flights").over(0.0..1.02),
        equal_scales: false,
        legend: Some(Corner::LowerRight),
        series: &series,
    }
    .svg()
}

/// What is nearer is drawn here: the axis is logarithmic.
const SMALLEST_M: f64 = 0.01;

fn steps(errors_m: &[f64]) -> Vec<Point> {
    let count = errors_m.len() as f64;
    let mut points = vec![(SMALLEST_M, 0.0)];
    for (below, error_m) in errors_m.iter().enumerate() {
        let x = error_m.max(SMALLEST_M);
        points.push((x, below as f64 / count));
        points.push((x, (below + 1) as f64 / count));
    }
    points
}
