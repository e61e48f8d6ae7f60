//! The page of a fused track: from above, its height, and what became of the ranges.

use super::report::Report;
use crate::anchors::AnchorsFile;
use crate::chart::{Point, Series, ellipse_95, linear_chart};
use crate::page::Page;
use anyhow::Result;
use nalgebra::Vector3;
use nova_solver::fusion::{Fate, Navigation};
use nova_solver::survey::Track;
use plotters::prelude::RGBColor;
use std::path::Path;

const GREY: RGBColor = RGBColor(170, 170, 170);
const BLUE: RGBColor = RGBColor(20, 90, 180);
const ORANGE: RGBColor = RGBColor(230, 150, 20);
const RED: RGBColor = RGBColor(200, 60, 30);
const SIZE: (u32, u32) = (900, 600);
const WIDE: (u32, u32) = (900, 360);
/// Seconds between ellipses on the map.
const ELLIPSE_S: f64 = 5.0;
/// Innovations beyond so many sigmas are drawn at the edge.
const MOST_SIGMAS: f64 = 20.0;
/// The truth is not drawn over longer gaps, seconds.
const GAP_S: f64 = 1.0;

/// What is shown.
pub(super) struct Shown<'a> {
    pub(super) track: &'a [Navigation],
    /// Ranges in order of time; none in the loose mode.
    pub(super) fates: &'a [(f64, Fate)],
    pub(super) site: &'a AnchorsFile,
    pub(super) truth: Option<&'a Track>,
    pub(super) report: &'a Report,
}

impl Shown<'_> {
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let mut page = Page::new(
            "A track from GNSS, UWB and an inertial sensor",
            "Where the vehicle was, how sure that is, and what became of the ranges.",
        );
        page.table(&[("result", self.report.text())]);
        page.figure(
            &self.map()?,
            "From above, with 95 % ellipses every five seconds and the anchors.",
        );
        page.figure(&self.height()?, "Height, with two sigmas to each side.");
        page.figure(
            &self.sigmas()?,
            "Standard deviations of the position; errors where the truth was given.",
        );
        if !self.fates.is_empty() {
            page.figure(
                &self.innovations()?,
                "How far each range was from what was expected, in sigmas: used as it is, weighed down, set \
                 aside as blocked.",
            );
        }
        page.write(path)
    }

    fn points(&self, of: impl Fn(&Navigation) -> Point) -> Vec<Point> {
        self.track.iter().map(of).collect()
    }

    /// The truth at the track's moments.
    fn true_points(&self, of: impl Fn(&Navigation, &Vector3<f64>) -> Point) -> Vec<Point> {
        let at = |now: &Navigation| {
            let (place, _) = self.truth?.at(now.t_s, GAP_S)?;
            Some(of(now, &place))
        };
        self.track.iter().filter_map(at).collect()
    }

    fn map(&self) -> Result<String> {
        let found = self.points(|n| (n.position_m.x, n.position_m.y));
        let truth = self.true_points(|_, p| (p.x, p.y));
        let anchors: Vec<Point> = (self.site.anchors.iter())
            .map(|anchor| (anchor.position_m[0], anchor.position_m[1]))
            .collect();
        let mut next_s = f64::NEG_INFINITY;
        let mut ellipses: Vec<Vec<Point>> = Vec::new();
        for now in self.track {
            if now.t_s >= next_s {
                next_s = now.t_s + ELLIPSE_S;
                let covariance = now.covariance_m2.fixed_view::<2, 2>(0, 0).into_owned();
                let place = (now.position_m.x, now.position_m.y);
                ellipses.push(ellipse_95(place, &covariance));
            }
        }
        let mut series = vec![
            Series::line("truth", GREY, &truth),
            Series::line("track", BLUE, &found),
            Series::circles("anchors", RED, &anchors),
        ];
        series.extend(
            ellipses
                .iter()
                .map(|ellipse| Series::line("", ORANGE, ellipse)),
        );
        linear_chart(SIZE, ["east (m)", "north (m)"], true, &series)
    }

    fn height(&self) -> Result<String> {
        let two = |n: &Navigation| 2.0 * n.covariance_m2[(2, 2)].max(0.0).sqrt();
        let found = self.points(|n| (n.t_s, n.position_m.z));
        let low = self.points(|n| (n.t_s, n.position_m.z - two(n)));
        let high = self.points(|n| (n.t_s, n.position_m.z + two(n)));
        let truth = self.true_points(|n, p| (n.t_s, p.z));
        let series = [
            Series::line("", ORANGE, &low),
            Series::line("two sigmas", ORANGE, &high),
            Series::line("truth", GREY, &truth),
            Series::line("height", BLUE, &found),
        ];
        linear_chart(WIDE, ["time (s)", "height (m)"], false, &series)
    }

    fn sigmas(&self) -> Result<String> {
        let sigma = |n: &Navigation| n.covariance_m2.diagonal().map(|v| v.max(0.0).sqrt());
        let horizontal = self.points(|n| (n.t_s, sigma(n).xy().norm()));
        let vertical = self.points(|n| (n.t_s, sigma(n).z));
        let errors = [
            self.true_points(|n, p| (n.t_s, (n.position_m - p).xy().norm())),
            self.true_points(|n, p| (n.t_s, (n.position_m.z - p.z).abs())),
        ];
        let series = [
            Series::line("error, horizontal", GREY, &errors[0]),
            Series::line("error, vertical", RED, &errors[1]),
            Series::line("sigma, horizontal", BLUE, &horizontal),
            Series::line("sigma, vertical", ORANGE, &vertical),
        ];
        linear_chart(WIDE, ["time (s)", "metres"], false, &series)
    }

    fn innovations(&self) -> Result<String> {
        let of = |wanted: fn(&Fate) -> Option<f64>| -> Vec<Point> {
            (self.fates.iter())
                .filter_map(|(t_s, fate)| Some((*t_s, wanted(fate)?.sqrt().min(MOST_SIGMAS))))
                .filter(|(_, sigmas)| sigmas.is_finite())
                .collect()
        };
        let used = of(|fate| match fate {
            Fate::Used(nis) => Some(*nis),
            _ => None,
        });
        let weighed = of(|fate| match fate {
            Fate::Weighed(nis) => Some(*nis),
            _ => None,
        });
        let aside = of(|fate| match fate {
            Fate::SetAside(nis) => Some(*nis),
            _ => None,
        });
        let series = [
            Series::dots("used", BLUE, &used),
            Series::dots("weighed down", ORANGE, &weighed),
            Series::dots("set aside", RED, &aside),
        ];
        linear_chart(WIDE, ["time (s)", "innovation (sigmas)"], false, &series)
    }
}
