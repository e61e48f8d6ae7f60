//! The page that `nova demo` writes.

use super::Summary;
use crate::chart::{Point, Series, ellipse_95, linear_chart};
use crate::page::Page;
use anyhow::Result;
use nalgebra::Matrix2;
use nova_solver::{Localisation, RangeMeasurement};
use plotters::style::RGBColor;

const BLUE: RGBColor = RGBColor(31, 119, 180);
const RED: RGBColor = RGBColor(214, 39, 40);
const GREEN: RGBColor = RGBColor(44, 160, 44);
const GREY: RGBColor = RGBColor(150, 150, 150);

/// Writes the page to where the summary says.
pub(super) fn write(
    summary: &Summary,
    measurements: &[RangeMeasurement],
    found: &Localisation,
) -> Result<()> {
    let mut page = Page::new(
        "A tag found by a flying anchor",
        "Two simulated DWM1001 boards ran the firmware's ranging; the solver saw only the \
         anchor's serial port and the anchor's own position.",
    );
    page.table(&figures(summary));
    page.figure(
        &from_above(summary, measurements)?,
        "From above: where the anchor says it was, the tag, and the estimate.",
    );
    page.figure(
        &close_up(summary)?,
        "The same, close: the ellipse holds the truth in 95 of 100 flights if the estimate's \
         covariance is honest.",
    );
    page.figure(
        &residuals(measurements, found)?,
        "Measured range minus the range from the estimate, over the flight.",
    );
    page.write(&summary.page)
}

fn figures(s: &Summary) -> [(&'static str, String); 9] {
    let metres = |v: &[f64; 3]| {
        let [x, y, z] = v;
        format!("{x:.3}, {y:.3}, {z:.3} m")
    };
    [
        ("Tag, estimated (east, north, up)", metres(&s.estimate_m)),
        ("Tag, in truth", metres(&s.tag_m)),
        ("Error", format!("{:.3} m", s.error_m)),
        ("Sigma", metres(&s.sigma_m)),
        (
            "Observable",
            if s.observable {
                "yes".to_owned()
            } else {
                "no: the ranges cannot tell the place for certain".to_owned()
            },
        ),
        (
            "Ranges used, set aside",
            format!("{}, {}", s.used, s.rejected),
        ),
        ("Residual rms", format!("{:.3} m", s.residual_rms_m)),
        (
            "Clock offset, tag against anchor",
            format!("{:.3} ppm", s.clock_offset_ppm),
        ),
        ("Seed", s.seed.to_string()),
    ]
}

fn horizontal(v: &[f64; 3]) -> Point {
    let [east, north, _] = v;
    (*east, *north)
}

/// The two marks that both maps have.
fn marks<'a>(tag: &'a [Point; 1], estimate: &'a [Point; 1]) -> [Series<'a>; 2] {
    [
        Series::circles("tag", GREEN, tag),
        Series::crosses("estimate", RED, estimate),
    ]
}

fn from_above(s: &Summary, measurements: &[RangeMeasurement]) -> Result<String> {
    let path: Vec<Point> = measurements
        .iter()
        .map(|m| (m.position_m.x, m.position_m.y))
        .collect();
    let (tag, estimate) = ([horizontal(&s.tag_m)], [horizontal(&s.estimate_m)]);
    let [tag, estimate] = marks(&tag, &estimate);
    linear_chart(
        (860, 520),
        ["east (m)", "north (m)"],
        true,
        &[Series::line("anchor", BLUE, &path), tag, estimate],
    )
}

fn close_up(s: &Summary) -> Result<String> {
    let [[xx, xy, _], [_, yy, _], _] = s.covariance_m2;
    let ellipse = ellipse_95(horizontal(&s.estimate_m), &Matrix2::new(xx, xy, xy, yy));
    let (tag, estimate) = ([horizontal(&s.tag_m)], [horizontal(&s.estimate_m)]);
    let [tag, estimate] = marks(&tag, &estimate);
    linear_chart(
        (560, 460),
        ["east (m)", "north (m)"],
        true,
        &[Series::line("95 %", RED, &ellipse), tag, estimate],
    )
}

fn residuals(measurements: &[RangeMeasurement], found: &Localisation) -> Result<String> {
    let of = |wanted: bool| -> Vec<Point> {
        measurements
            .iter()
            .zip(&found.residuals)
            .filter(|(_, residual)| residual.used == wanted)
            .map(|(m, residual)| (m.t_s, residual.residual_m))
            .collect()
    };
    let (used, aside) = (of(true), of(false));
    linear_chart(
        (860, 340),
        ["time (s)", "residual (m)"],
        false,
        &[
            Series::dots("set aside", GREY, &aside),
            Series::dots("used", BLUE, &used),
        ],
    )
}
