//! The page that `nova fly` writes: a picture of the whole flight which, where JavaScript runs, can
//! be played.

use super::Summary;
use super::drawing::{EllipsePx, Overlay};
use super::picture::{Belief, Picture, Seen};
use crate::chart::{Axis, Chart, Pixels, Point};
use crate::page::{Page, escape};
use crate::settings;
use anyhow::Result;
use nova_flight::Settings;
use serde::Serialize;
use std::fmt::Write as _;
use std::ops::Range;

/// Writes the page to where the summary says.
pub(super) fn write(summary: &Summary<'_>, picture: &Picture) -> Result<()> {
    let mut page = Page::new(
        &format!("Flight to a tag: method {}", summary.method),
        &introduction(summary),
    );
    page.style(include_str!("player.css"));
    page.html(&figures(summary));
    page.html(include_str!("player.html"));

    let (above, above_px) = map(picture, "above", "east (m)", "north (m)", |seen| seen.above)?;
    let (side, side_px) = map(
        picture,
        "side",
        "along the line from start to tag (m)",
        "height over the tag (m)",
        |seen| seen.side,
    )?;
    let (error, error_px) = errors(picture)?;
    page.html("<div class=\"pair\">\n");
    page.figure(&above, "From above.");
    page.figure(&side, "From the side.");
    page.html("</div>\n");
    page.figure(
        &error,
        "Blue: horizontal error of the tag's place relative to the vehicle. Grey: longer half-axis of \
         the 95 % ellipse, which an honest navigator's error seldom exceeds.",
    );
    page.html(&settings_table(summary.settings)?);
    let film = Film::new(picture, above_px, side_px, error_px);
    // JSON may stand in a script element as it is, but for "</".
    let json = serde_json::to_string(&film)?.replace("</", "<\\/");
    page.html(&format!(
        "<script type=\"application/json\" id=\"film\">{json}</script>\n<script>\n{}</script>\n",
        include_str!("player.js")
    ));
    page.write(summary.page)
}

fn introduction(summary: &Summary<'_>) -> String {
    format!(
        "A simulated vehicle finds a UWB tag on the ground from dead reckoning and ranges alone and lands \
         there ({}). The ellipse holds the tag with a probability \
         of 95 % if the navigator's covariance is honest; it is drawn where the vehicle would go from \
         where it truly is.",
        summary.circumstances()
    )
}

/// The flight in five numbers.
fn figures(summary: &Summary<'_>) -> String {
    let result = summary.result;
    let metres = |value: Option<f64>| value.map_or("–".to_owned(), |v| format!("{v:.3} m"));
    let sigma = summary.sigma_m.map(|[x, y, _]| x.hypot(y));
    let mut html = String::from("<dl class=\"figures\">\n");
    for (name, value) in [
        (
            if result.landed {
                "error at touchdown"
            } else {
                "error; not landed"
            },
            metres(Some(result.error_m)),
        ),
        ("sigma it claims", metres(sigma)),
        ("least mean error possible", metres(result.bound_m)),
        ("flight time", format!("{:.1} s", result.time_s)),
        (
            "path over the ideal",
            format!("{:+.1} %", 100.0 * result.overhead),
        ),
    ] {
        // Writing to a string cannot fail.
        let _ = writeln!(html, "<div><dt>{name}</dt><dd>{value}</dd></div>");
    }
    html + "</dl>\n"
}

fn settings_table(settings: &Settings) -> Result<String> {
    let mut html = String::from("<details><summary>All settings</summary>\n<table>\n");
    for (key, value) in &settings::table_of(settings)? {
        let value = escape(&value.to_string());
        let _ = writeln!(html, "<tr><th>{key}</th><td>{value}</td></tr>");
    }
    Ok(html + "</table></details>\n")
}

/// A view of the flight with equal scales.
fn map(
    picture: &Picture,
    name: &str,
    x_label: &str,
    y_label: &str,
    view: fn(&Seen) -> Point,
) -> Result<(String, Pixels)> {
    let vehicle: Vec<Point> = picture.moments.iter().map(|m| view(&m.vehicle)).collect();
    let marks = [&picture.start, &picture.tag, &picture.first_guess].map(view);
    let shown = || vehicle.iter().chain(&marks);
    let drawing = Chart {
        size: (480, 500),
        x: Axis::linear(x_label).over(around(shown().map(|p| p.0))),
        y: Axis::linear(y_label).over(around(shown().map(|p| p.1))),
        equal_scales: true,
        legend: None,
        series: &[],
    }
    .draw()?;
    let pixels = drawing.pixels;
    let mut overlay = Overlay::new(pixels, name);
    let covariance = |belief: &Belief| {
        let [above, side] = belief.covariance?;
        Some(if name == "above" { above } else { side })
    };

    overlay.raw("<g class=\"whole\">\n");
    overlay.line("reckoned", picture.reckoned.iter().map(view));
    overlay.line("path", vehicle.iter().copied());
    for belief in selection(&picture.beliefs) {
        if let Some(covariance) = covariance(belief) {
            let ellipse = overlay.ellipse_95(&covariance);
            overlay.ellipse("ellipse", view(&belief.tag), ellipse);
        }
    }
    for belief in &picture.beliefs {
        overlay.circle("trail", view(&belief.tag), 1.2);
    }
    overlay.raw("</g>\n");
    let legs = picture.orders.iter().filter(|order| order.leg);
    for (number, order) in (1..).zip(legs) {
        let place = view(&order.waypoint);
        overlay.circle("waypoint", place, 4.0);
        overlay.text("number", place, [6.0, -5.0], &format!("{number}"));
    }
    overlay.cross("guess", view(&picture.first_guess), 6.0);
    overlay.circle("tag", view(&picture.tag), 7.0);
    overlay.circle("tag dot", view(&picture.tag), 2.0);
    if let Some(last) = picture.beliefs.last() {
        overlay.cross("estimate whole", view(&last.tag), 5.0);
    }
    overlay.raw(
        "<g class=\"now\"><polyline class=\"path flown\"/><ellipse class=\"ellipse at\"/>\
         <path class=\"estimate at\" d=\"M-5 -5L5 5M-5 5L5 -5\"/>\
         <path class=\"goal\" d=\"M0 -6L6 0L0 6L-6 0Z\"/><circle class=\"vehicle\" r=\"5\"/></g>\n",
    );
    Ok((overlay.onto(drawing), pixels))
}

/// What a picture without time can hold: some beliefs, evenly in time, and the last.
fn selection(beliefs: &[Belief]) -> impl Iterator<Item = &Belief> {
    const MOST: usize = 7;
    let step = beliefs.len().div_ceil(MOST).max(1);
    beliefs.iter().rev().step_by(step)
}

/// The range of some values, with space around them.
fn around(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    });
    let space = 0.08 * (high - low) + 0.5;
    low - space..high + space
}

/// Error and what is claimed of it, over time.
fn errors(picture: &Picture) -> Result<(String, Pixels)> {
    let values = |moment: fn(&super::picture::Moment) -> Option<f64>| -> Vec<Point> {
        (picture.moments.iter())
            .filter_map(|m| Some((m.t_s, moment(m)?)))
            .collect()
    };
    let (error, claimed) = (values(|m| m.error_m), values(|m| m.claimed_m));
    let all = || error.iter().chain(&claimed).map(|p| p.1);
    let drawing = Chart {
        size: (980, 300),
        x: Axis::linear("time (s)").over(0.0..picture.end_s.max(1.0)),
        y: Axis::log("error (m)", decades(all())),
        equal_scales: false,
        legend: None,
        series: &[],
    }
    .draw()?;
    let pixels = drawing.pixels;
    let mut overlay = Overlay::new(pixels, "error");
    let ends = (picture.phases.iter().skip(1).map(|(t_s, _)| *t_s)).chain([picture.end_s]);
    for ((t_s, phase), end_s) in picture.phases.iter().zip(ends) {
        overlay.vertical("phase", *t_s);
        // Where there is room for its name.
        if end_s - t_s > 0.07 * picture.end_s {
            overlay.heading("phase-name", *t_s, phase);
        }
    }
    let held = |points: Vec<Point>| points.into_iter().map(|(t, v)| (t, v.max(LEAST_M)));
    overlay.line("claimed", held(claimed));
    overlay.line("error", held(error));
    overlay
        .raw("<g class=\"now\"><line class=\"cursor\"/><circle class=\"error-at\" r=\"5\"/></g>\n");
    Ok((overlay.onto(drawing), pixels))
}

/// What is smaller is drawn as this: the axis is logarithmic.
const LEAST_M: f64 = 1e-3;

/// Powers of ten around these values.
fn decades(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) = values
        .map(|v| v.clamp(LEAST_M, 1e3))
        .fold((0.1_f64, 1.0_f64), |(low, high), v| {
            (low.min(v), high.max(v))
        });
    10f64.powf(low.log10().floor())..10f64.powf(high.log10().ceil())
}

/// All that moves, in pixels, for `player.js`.
#[derive(Serialize)]
struct Film {
    end_s: f64,
    frames: Vec<Frame>,
    beliefs: Vec<Estimated>,
    orders: Vec<Ordered>,
    phases: Vec<(f64, &'static str)>,
}

#[derive(Serialize)]
struct Frame {
    t: f64,
    above: [f64; 2],
    side: [f64; 2],
    height_m: f64,
    /// Metres, and pixels.
    error: Option<[f64; 2]>,
    claimed_m: Option<f64>,
}

#[derive(Serialize)]
struct Estimated {
    t: f64,
    above: Mark,
    side: Mark,
}

#[derive(Serialize)]
struct Mark {
    at: [f64; 2],
    /// Half-axes and angle.
    ellipse: Option<[f64; 3]>,
}

#[derive(Serialize)]
struct Ordered {
    t: f64,
    above: [f64; 2],
    side: [f64; 2],
    action: &'static str,
}

impl Film {
    fn new(picture: &Picture, above: Pixels, side: Pixels, error: Pixels) -> Self {
        let (above, side) = (Overlay::new(above, "above"), Overlay::new(side, "side"));
        let places = |seen: &Seen| {
            (
                above.at(seen.above).map(tenths),
                side.at(seen.side).map(tenths),
            )
        };
        let frames = (picture.moments.iter())
            .map(|moment| {
                let (above, side) = places(&moment.vehicle);
                let pixel = |error_m: f64| error.y.of(error_m.max(LEAST_M));
                Frame {
                    t: thousandths(moment.t_s),
                    above,
                    side,
                    height_m: thousandths(moment.vehicle.side.1),
                    error: moment.error_m.map(|e| [thousandths(e), tenths(pixel(e))]),
                    claimed_m: moment.claimed_m.map(thousandths),
                }
            })
            .collect();
        let beliefs = (picture.beliefs.iter())
            .map(|belief| {
                let (at_above, at_side) = places(&belief.tag);
                let ellipses = belief
                    .covariance
                    .map(|[a, s]| [above.ellipse_95(&a), side.ellipse_95(&s)].map(numbers));
                Estimated {
                    t: thousandths(belief.t_s),
                    above: Mark {
                        at: at_above,
                        ellipse: ellipses.map(|[ellipse, _]| ellipse),
                    },
                    side: Mark {
                        at: at_side,
                        ellipse: ellipses.map(|[_, ellipse]| ellipse),
                    },
                }
            })
            .collect();
        let orders = (picture.orders.iter())
            .map(|order| {
                let (above, side) = places(&order.waypoint);
                Ordered {
                    t: thousandths(order.t_s),
                    above,
                    side,
                    action: order.action,
                }
            })
            .collect();
        Self {
            end_s: picture.end_s,
            frames,
            beliefs,
            orders,
            phases: picture.phases.clone(),
        }
    }
}

fn numbers(ellipse: EllipsePx) -> [f64; 3] {
    let [long, short] = ellipse.half_axes;
    [tenths(long), tenths(short), tenths(ellipse.angle_deg)]
}

fn tenths(value: f64) -> f64 {
    (10.0 * value).round() / 10.0
}

fn thousandths(value: f64) -> f64 {
    (1e3 * value).round() / 1e3
}
