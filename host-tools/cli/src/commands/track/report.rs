//! What `nova track` says.

use nova_flight::tracking::{TrackingRow, TrackingScene};
use std::fmt::Write as _;
use std::path::Path;

/// Names of the columns, for the terminal and the page.
pub(super) const COLUMNS: [&str; 10] = [
    "outliers",
    "estimator",
    "controller",
    "RMSE (m)",
    "NEES",
    "inside",
    "radius (m)",
    "distance (m)",
    "left bounds",
    "infeasible",
];

/// One row of the table.
pub(super) fn cells(row: &TrackingRow) -> [String; 10] {
    let closed = row.controller.is_some();
    let only = |text: String| if closed { text } else { "-".to_owned() };
    let infeasible: u64 = row.infeasible.iter().sum();
    [
        format!("{:.2}", row.outlier_probability),
        row.estimator.to_string(),
        row.controller.map_or("-".to_owned(), |c| c.to_string()),
        format!("{:.3}", row.rmse_m),
        format!("{:.2}", row.nees),
        format!("{:.1} %", 100.0 * row.inside_radius),
        format!("{:.2} to {:.2}", row.radius_m[0], row.radius_m[1]),
        only(format!(
            "{:.2} to {:.2}",
            row.distance_m[0], row.distance_m[1]
        )),
        only(format!("{} of {}", row.left_bounds, row.trials)),
        only(format!(
            "{:.2} %",
            100.0 * infeasible as f64 / row.commands.max(1) as f64
        )),
    ]
}

pub(super) fn text(scene: &TrackingScene, rows: &[TrackingRow], page: Option<&Path>) -> String {
    let mut lines = vec![COLUMNS.map(str::to_owned)];
    lines.extend(rows.iter().map(cells));
    let width = |column: usize| {
        let cells = lines.iter().filter_map(|line| line.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..COLUMNS.len()).map(width).collect();
    let mut said = format!("{}\n", scene.title);
    for line in &lines {
        let cells = line.iter().zip(&widths);
        let padded: Vec<String> = cells
            .map(|(cell, width)| format!("{cell:<width$}"))
            .collect();
        // Writing to a string cannot fail.
        let _ = writeln!(said, "{}", padded.join("  ").trim_end());
    }
    if let Some(standoff) = scene.standoff {
        let _ = writeln!(
            said,
            "bounds {} to {} m; radius: mean to largest, promised to hold the target at {} %",
            standoff.least_m,
            standoff.most_m,
            100.0 * (1.0 - standoff.risk)
        );
    }
    if let Some(least) = rows
        .iter()
        .filter_map(|row| row.least_wall_m)
        .reduce(f64::min)
    {
        let _ = writeln!(said, "nearest to a wall: {least:.2} m");
    }
    if let Some(page) = page {
        let _ = writeln!(said, "page {}", page.display());
    }
    said
}
