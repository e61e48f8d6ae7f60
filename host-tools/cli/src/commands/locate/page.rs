//! The page of a listener's track: from above, its height, its sigmas.

use super::input::Anchors;
use super::report::{Placed, Report};
use crate::chart::{Point, Series, ellipse_95, linear_chart};
use crate::page::Page;
use anyhow::Result;
use nalgebra::Matrix3;
use nova_solver::survey::Track;
use plotters::prelude::RGBColor;
use std::path::Path;

const GREY: RGBColor = RGBColor(170, 170, 170);
const BLUE: RGBColor = RGBColor(20, 90, 180);
const ORANGE: RGBColor = RGBColor(230, 150, 20);
const RED: RGBColor = RGBColor(200, 60, 30);
const SIZE: (u32, u32) = (900, 600);
const WIDE: (u32, u32) = (900, 360);
/// Ellipses on the map, at most.
const ELLIPSES: usize = 12;
/// Points of a line, at most.
const MOST_POINTS: usize = 4000;

pub(super) fn write(
    path: &Path,
    track: &[Placed],
    anchors: &Anchors,
    truth: Option<&Track>,
    report: &Report,
) -> Result<()> {
    let step = track.len().div_ceil(MOST_POINTS).max(1);
    let shown: Vec<&Placed> = track.iter().step_by(step).collect();
    let points =
        |of: &dyn Fn(&Placed) -> Point| -> Vec<Point> { shown.iter().map(|at| of(at)).collect() };
    let true_points = |of: fn([f64; 4]) -> Point| -> Vec<Point> {
        let all = truth.map_or(&[][..], Track::points);
        (all.iter().step_by(all.len().div_ceil(MOST_POINTS).max(1)))
            .map(|p| of([p.t_s, p.position_m.x, p.position_m.y, p.position_m.z]))
            .collect()
    };
    let mut page = Page::new(
        "A listener's track",
        "Where a board was that only listens, from differences of distances to anchors that range among themselves.",
    );
    page.table(&[("result", report.text())]);

    let stands: Vec<Point> = (anchors.listened().iter())
        .map(|anchor| (anchor.position_m.x, anchor.position_m.y))
        .collect();
    let ellipses: Vec<Vec<Point>> = (shown.iter())
        .step_by(shown.len().div_ceil(ELLIPSES).max(1))
        .map(|at| {
            let covariance = Matrix3::from(at.covariance_m2)
                .fixed_view::<2, 2>(0, 0)
                .into_owned();
            ellipse_95((at.position_m[0], at.position_m[1]), &covariance)
        })
        .collect();
    let true_map = true_points(|[_, x, y, _]| (x, y));
    let found = points(&|at| (at.position_m[0], at.position_m[1]));
    let mut series = vec![
        Series::line("truth", GREY, &true_map),
        Series::line("track", BLUE, &found),
        Series::circles("anchors", RED, &stands),
    ];
    series.extend(
        ellipses
            .iter()
            .map(|ellipse| Series::line("", ORANGE, ellipse)),
    );
    page.figure(
        &linear_chart(SIZE, ["east (m)", "north (m)"], true, &series)?,
        "From above, with 95 % ellipses and the anchors.",
    );

    let low = points(&|at| (at.t_s, at.position_m[2] - 2.0 * at.sigma_m[2]));
    let high = points(&|at| (at.t_s, at.position_m[2] + 2.0 * at.sigma_m[2]));
    let height = points(&|at| (at.t_s, at.position_m[2]));
    let true_height = true_points(|[t, _, _, z]| (t, z));
    let series = [
        Series::line("", ORANGE, &low),
        Series::line("two sigmas", ORANGE, &high),
        Series::line("truth", GREY, &true_height),
        Series::line("height", BLUE, &height),
    ];
    page.figure(
        &linear_chart(WIDE, ["time (s)", "height (m)"], false, &series)?,
        "Height, with two sigmas to each side.",
    );

    let horizontal = points(&|at| (at.t_s, at.sigma_m[0].hypot(at.sigma_m[1])));
    let vertical = points(&|at| (at.t_s, at.sigma_m[2]));
    let series = [
        Series::line("horizontal", BLUE, &horizontal),
        Series::line("vertical", ORANGE, &vertical),
    ];
    page.figure(
        &linear_chart(WIDE, ["time (s)", "sigma (m)"], false, &series)?,
        "Standard deviations.",
    );
    page.write(path)
}
