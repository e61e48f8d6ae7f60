//! The page of `nova track`: the table, error against outliers, and the first flight.

use super::report;
use crate::chart::{Axis, Chart, Corner, Point, Series};
use crate::page::Page;
use anyhow::Result;
use nova_flight::tracking::{
    Estimator, TrackingMoment, TrackingResult, TrackingRow, TrackingScene,
};
use plotters::prelude::RGBColor;
use std::path::Path;

const BLACK: RGBColor = RGBColor(40, 40, 40);
const BROWN: RGBColor = RGBColor(130, 80, 40);
const GREY: RGBColor = RGBColor(190, 190, 190);
const COLORS: [RGBColor; 5] = [
    RGBColor(200, 60, 30),
    RGBColor(220, 150, 20),
    RGBColor(20, 90, 180),
    RGBColor(40, 140, 70),
    RGBColor(120, 50, 150),
];
const WIDE: (u32, u32) = (900, 420);

pub(super) fn write(
    path: &Path,
    scene: &TrackingScene,
    seed: u64,
    rows: &[TrackingRow],
    shown: &[(String, TrackingResult)],
) -> Result<()> {
    let trials = rows.first().map_or(0, |row| row.trials);
    let mut page = Page::new(
        &format!("Following a target: {}", scene.title),
        &format!(
            "Simulated: {trials} flights under each condition, seed {seed}. Pictures are of the first flight. \
             RMSE is of the place believed at each sighting; distances are true."
        ),
    );
    page.grid(
        &report::COLUMNS,
        &rows.iter().map(report::cells).collect::<Vec<_>>(),
    );
    if scene.sensor.outlier_probability.len() > 1 {
        page.figure(
            &against_outliers(rows)?,
            "Root mean square error against the part of bearings that are outliers.",
        );
    }
    page.figure(
        &above(scene, shown)?,
        "From above. Black: the target. Grey: where single sightings put it.",
    );
    if let Some(standoff) = scene.standoff {
        let bounds = [standoff.least_m, standoff.most_m];
        page.figure(
            &over_time(scene, shown, "true distance (m)", &bounds, |m| {
                (m.target_m - m.vehicle_m).norm()
            })?,
            "True distance between vehicle and target. Black: the bounds.",
        );
    }
    page.figure(
        &over_time(scene, shown, "confidence radius (m)", &[], |m| m.radius_m)?,
        "Confidence radius of the target's place.",
    );
    page.figure(
        &over_time(scene, shown, "error (m)", &[], |m| {
            (m.believed_m - m.target_m).norm()
        })?,
        "Error of the target's place.",
    );
    page.write(path)
}

fn color(index: usize) -> RGBColor {
    COLORS[index % COLORS.len()]
}

fn against_outliers(rows: &[TrackingRow]) -> Result<String> {
    let lines: Vec<(String, Vec<Point>)> = Estimator::ALL
        .iter()
        .map(|estimator| {
            let own = rows.iter().filter(|row| row.estimator == *estimator);
            let points = own
                .map(|row| (row.outlier_probability, row.rmse_m))
                .collect();
            (estimator.to_string(), points)
        })
        .filter(|(_, points): &(String, Vec<Point>)| !points.is_empty())
        .collect();
    draw(
        "part of outliers",
        "RMSE (m)",
        &lines,
        &[],
        Corner::UpperLeft,
    )
}

fn above(scene: &TrackingScene, shown: &[(String, TrackingResult)]) -> Result<String> {
    let flat = |v: &nalgebra::Vector3<f64>| (v.x, v.y);
    let first: &[TrackingMoment] = shown.first().map_or(&[], |(_, result)| &result.moments);
    let target: Vec<Point> = first.iter().map(|m| flat(&m.target_m)).collect();
    let seen: Vec<Point> = first
        .iter()
        .filter_map(|m| m.seen_m.as_ref().map(flat))
        .collect();
    let believed: Vec<Vec<Point>> = shown
        .iter()
        .map(|(_, result)| result.moments.iter().map(|m| flat(&m.believed_m)).collect())
        .collect();
    let walls: Vec<[Point; 2]> = (scene.sensor.walls_m.iter())
        .map(|[x1, y1, x2, y2]| [(*x1, *y1), (*x2, *y2)])
        .collect();
    let mut series = vec![
        Series::dots("", GREY, &seen),
        Series::line("target", BLACK, &target),
    ];
    for (i, wall) in walls.iter().enumerate() {
        let label = if i == 0 { "walls" } else { "" };
        series.push(Series::line(label, BROWN, wall));
    }
    for (i, ((name, _), points)) in shown.iter().zip(&believed).enumerate() {
        series.push(Series::line(name, color(i), points));
    }
    Chart {
        size: (900, 560),
        x: Axis::linear("east (m)"),
        y: Axis::linear("north (m)"),
        equal_scales: true,
        legend: Some(Corner::UpperLeft),
        series: &series,
    }
    .svg()
}

fn over_time(
    scene: &TrackingScene,
    shown: &[(String, TrackingResult)],
    label: &str,
    bounds: &[f64],
    value: impl Fn(&TrackingMoment) -> f64,
) -> Result<String> {
    let lines: Vec<(String, Vec<Point>)> = shown
        .iter()
        .map(|(name, result)| {
            let points = result.moments.iter().map(|m| (m.t_s, value(m))).collect();
            (name.clone(), points)
        })
        .collect();
    let bounds: Vec<Vec<Point>> = bounds
        .iter()
        .map(|bound| vec![(0.0, *bound), (scene.duration_s, *bound)])
        .collect();
    draw("time (s)", label, &lines, &bounds, Corner::UpperRight)
}

fn draw(
    x: &str,
    y: &str,
    lines: &[(String, Vec<Point>)],
    bounds: &[Vec<Point>],
    corner: Corner,
) -> Result<String> {
    let mut series: Vec<Series<'_>> = bounds
        .iter()
        .map(|points| Series::line("", BLACK, points))
        .collect();
    for (i, (name, points)) in lines.iter().enumerate() {
        series.push(Series::line(name, color(i), points));
    }
    Chart {
        size: WIDE,
        x: Axis::linear(x),
        y: Axis::linear(y),
        equal_scales: false,
        legend: Some(corner),
        series: &series,
    }
    .svg()
}
