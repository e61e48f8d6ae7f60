//! The page of a delivery: the path and how well it was followed (the paper's Fig. 9, 10, 13).

use crate::chart::{Point, Series, linear_chart};
use crate::page::Page;
use anyhow::Result;
use nova_flight::delivery::{DeliveryResult, Sample, Scenario};
use plotters::prelude::RGBColor;
use std::path::Path;

const BLUE: RGBColor = RGBColor(20, 90, 180);
const RED: RGBColor = RGBColor(200, 60, 30);
const GREEN: RGBColor = RGBColor(30, 130, 60);
const SIZE: (u32, u32) = (900, 500);

pub(super) fn write(
    path: &Path,
    scenario: &Scenario,
    samples: &[Sample],
    result: &DeliveryResult,
) -> Result<()> {
    let mut page = Page::new(
        "A delivery",
        "Up, along and down onto the platform, and back; simulated. x points from the start to the platform, whose centre is the origin.",
    );
    let metres = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |m| format!("{m:.3} m"));
    page.table(&[
        (
            "height, radius, distance",
            format!(
                "{} m, {} m, {} m",
                scenario.height_m, scenario.radius_m, scenario.distance_m
            ),
        ),
        ("touchdown, from the centre", metres(result.off_centre_m)),
        (
            "error of the estimate then",
            metres(result.estimate_error_m),
        ),
        (
            "package",
            if result.delivered {
                "delivered"
            } else {
                "not delivered"
            }
            .to_owned(),
        ),
        ("what went wrong", result.troubles.join("\n")),
    ]);
    let side = |of: fn(&Sample) -> [f64; 3]| -> Vec<Point> {
        samples.iter().map(of).map(|[x, _, z]| (x, z)).collect()
    };
    let over_time = |of: &dyn Fn(&Sample) -> f64| -> Vec<Point> {
        samples
            .iter()
            .map(|sample| (sample.t_s, of(sample)))
            .collect()
    };
    let (flown, believed) = (side(|s| s.true_m), side(|s| s.estimate_m));
    page.figure(
        &linear_chart(
            SIZE,
            ["x (m)", "z (m)"],
            true,
            &[
                Series::line("flown", BLUE, &flown),
                Series::line("estimated", RED, &believed),
            ],
        )?,
        "From the side.",
    );
    let lyapunov = over_time(&|s| s.lyapunov_m2);
    page.figure(
        &linear_chart(SIZE, ["time (s)", "V (m²)"], false, &[Series::line("V at the estimate", BLUE, &lyapunov)])?,
        "The Lyapunov function of the vector field: half the squared distance to the path. It jumps when the platform is first measured.",
    );
    let error = over_time(&|s| {
        let [a, b] = [s.true_m, s.estimate_m];
        (a[0] - b[0]).hypot(a[1] - b[1])
    });
    page.figure(
        &linear_chart(
            SIZE,
            ["time (s)", "error (m)"],
            false,
            &[Series::line("horizontal error", BLUE, &error)],
        )?,
        "The estimate against the truth: the bias of GPS, until the platform tells it.",
    );
    let biases =
        [0, 1, 2].map(|axis| over_time(&|s| s.gps_bias_m.get(axis).copied().unwrap_or(0.0)));
    let [x, y, z] = &biases;
    page.figure(
        &linear_chart(
            SIZE,
            ["time (s)", "bias (m)"],
            false,
            &[
                Series::line("x", BLUE, x),
                Series::line("y", RED, y),
                Series::line("z", GREEN, z),
            ],
        )?,
        "The bias of GPS as it is estimated.",
    );
    page.write(path)
}
