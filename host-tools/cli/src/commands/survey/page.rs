//! The page of a survey: a map, how the estimates settle, the figures.

use super::input::Input;
use crate::chart::{Axis, Chart, Corner, Point, Series, ellipse_95, linear_chart};
use crate::page::Page;
use crate::peer::Peer;
use anyhow::Result;
use nova_solver::survey::{AnchorRanges, InvertedUwb, Stage, Survey, SurveyOptions, convergence};
use plotters::prelude::RGBColor;
use std::path::Path;

const GREY: RGBColor = RGBColor(170, 170, 170);
const BLUE: RGBColor = RGBColor(20, 90, 180);
const RED: RGBColor = RGBColor(200, 60, 30);
const SIZE: (u32, u32) = (900, 600);

#[allow(clippy::too_many_arguments)]
pub(super) fn write(
    path: &Path,
    peers: &[Peer],
    anchors: &[AnchorRanges<'_>],
    found: &Survey,
    one_by_one: &[Option<InvertedUwb>],
    input: &Input,
    options: &SurveyOptions,
) -> Result<()> {
    let mut page = Page::new(
        "Anchors surveyed",
        "Where anchors are, from a tag whose track is known: all at once, and by the paper's method, \
         one by one.",
    );
    page.table(&[
        (
            "lag of the ranges",
            format!(
                "{:.3} s, sigma {:.3}",
                found.common.lag_s, found.common.lag_sigma_s
            ),
        ),
        (
            "slope of the ranges",
            format!(
                "{:.2} %, sigma {:.2}",
                100.0 * found.common.slope,
                100.0 * found.common.slope_sigma
            ),
        ),
        ("notes", input.notes.join("\n")),
    ]);
    page.figure(
        &map(found, one_by_one, input)?,
        "Track, anchors and their 95 % ellipses; crosses: one by one.",
    );
    let most = anchors.iter().map(|a| a.ranges.len()).max().unwrap_or(0);
    let stages = convergence(&input.track, anchors, options, &counts(most));
    page.figure(
        &settling(&stages, found)?,
        "How far estimates from the first so many ranges of each anchor are from that of all: the mean \
         over the anchors.",
    );
    let rows: Vec<[String; 5]> = (peers.iter().zip(&found.anchors).zip(one_by_one))
        .map(|((peer, anchor), alone)| {
            let (p, s) = (anchor.found.position_m, anchor.found.sigma_m);
            [
                peer.to_string(),
                format!("{:.3} {:.3} {:.3}", p.x, p.y, p.z),
                format!("{:.3} {:.3} {:.3}", s.x, s.y, s.z),
                format!(
                    "{} of {}",
                    anchor.found.used,
                    anchor.found.used + anchor.found.rejected
                ),
                alone.map_or_else(String::new, |a| {
                    let p = a.position_m;
                    format!("{:.3} {:.3} {:.3}", p.x, p.y, p.z)
                }),
            ]
        })
        .collect();
    page.grid(
        &[
            "anchor",
            "position (m)",
            "sigma (m)",
            "ranges used",
            "one by one (m)",
        ],
        &rows,
    );
    page.write(path)
}

/// 25, 50, 100, ... and all.
fn counts(most: usize) -> Vec<usize> {
    let mut counts: Vec<usize> = (0..)
        .map(|k| 25usize << k)
        .take_while(|&count| count < most)
        .take(20)
        .collect();
    counts.push(most);
    counts
}

fn map(found: &Survey, one_by_one: &[Option<InvertedUwb>], input: &Input) -> Result<String> {
    let track: Vec<Point> = (input.track.points().iter())
        .map(|p| (p.position_m.x, p.position_m.y))
        .collect();
    let places: Vec<Point> = (found.anchors.iter())
        .map(|a| (a.found.position_m.x, a.found.position_m.y))
        .collect();
    let alone: Vec<Point> = (one_by_one.iter().flatten())
        .map(|a| (a.position_m.x, a.position_m.y))
        .collect();
    let ellipses: Vec<Vec<Point>> = (found.anchors.iter().zip(&places))
        .map(|(a, place)| {
            let covariance = a.found.covariance_m2.fixed_view::<2, 2>(0, 0).into_owned();
            ellipse_95(*place, &covariance)
        })
        .collect();
    let mut series = vec![
        Series::line("track", GREY, &track),
        Series::circles("anchors", BLUE, &places),
        Series::crosses("one by one", RED, &alone),
    ];
    for ellipse in &ellipses {
        series.push(Series::line("", BLUE, ellipse));
    }
    linear_chart(SIZE, ["east (m)", "north (m)"], true, &series)
}

fn settling(stages: &[Stage], found: &Survey) -> Result<String> {
    let (mut joint, mut inverted) = (Vec::new(), Vec::new());
    let last = stages.last();
    for stage in stages.iter().take(stages.len().saturating_sub(1)) {
        let count = stage.ranges as f64;
        let n = found.anchors.len() as f64;
        if let Some(survey) = &stage.joint {
            let sum: f64 = (survey.anchors.iter().zip(&found.anchors))
                .map(|(now, end)| (now.found.position_m - end.found.position_m).norm())
                .sum();
            joint.push((count, (sum / n).max(1e-3)));
        }
        let apart: Vec<f64> = (stage.inverted_m.iter())
            .zip(last.map_or(&[][..], |last| &last.inverted_m))
            .filter_map(|(now, end)| Some(((*now)? - (*end)?).norm()))
            .collect();
        if apart.len() == found.anchors.len() {
            inverted.push((count, (apart.iter().sum::<f64>() / n).max(1e-3)));
        }
    }
    let span = |points: &[&[Point]], of: fn(&Point) -> f64| {
        let values = points.iter().flat_map(|p| p.iter()).map(of);
        let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        if low < high {
            0.8 * low..1.25 * high
        } else {
            0.1..10.0
        }
    };
    let both: [&[Point]; 2] = [&joint, &inverted];
    Chart {
        size: SIZE,
        x: Axis::log("ranges an anchor", span(&both, |p| p.0)),
        y: Axis::log("distance from the final estimate (m)", span(&both, |p| p.1)),
        equal_scales: false,
        legend: Some(Corner::UpperRight),
        series: &[
            Series::line("all at once", BLUE, &joint),
            Series::line("one by one", RED, &inverted),
        ],
    }
    .svg()
}
