//! SVG elements on a chart.

use crate::chart::{Drawing, Pixels, Point, half_axes_95};
use nalgebra::Matrix2;
use std::fmt::Write as _;

/// Elements to be laid over a chart, in its pixels. Writing to a string cannot fail.
pub(super) struct Overlay {
    pixels: Pixels,
    svg: String,
}

/// An ellipse in pixels: half-axes, and the angle as SVG's `rotate` takes it.
#[derive(Clone, Copy)]
pub(super) struct EllipsePx {
    pub(super) half_axes: [f64; 2],
    pub(super) angle_deg: f64,
}

impl Overlay {
    /// Nothing yet, over a chart of this name.
    pub(super) fn new(pixels: Pixels, name: &str) -> Self {
        let ([left, right], [bottom, top]) = (pixels.x.ends(), pixels.y.ends());
        let svg = format!(
            "<clipPath id=\"{name}-area\"><rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" \
             height=\"{:.1}\"/></clipPath>\n<g clip-path=\"url(#{name}-area)\" data-chart=\"{name}\">\n",
            right - left,
            bottom - top
        );
        Self { pixels, svg }
    }

    /// Where a point lies.
    pub(super) fn at(&self, point: Point) -> [f64; 2] {
        [self.pixels.x.of(point.0), self.pixels.y.of(point.1)]
    }

    /// The ellipse of 95 % on a chart with equal scales.
    pub(super) fn ellipse_95(&self, covariance: &Matrix2<f64>) -> EllipsePx {
        let (half_axes, angle) = half_axes_95(covariance);
        let unit = (self.pixels.x.of(1.0) - self.pixels.x.of(0.0)).abs();
        EllipsePx {
            half_axes: half_axes.map(|length| length * unit),
            // SVG's vertical axis points down.
            angle_deg: -angle.to_degrees(),
        }
    }

    /// A line through points.
    pub(super) fn line(&mut self, class: &str, points: impl Iterator<Item = Point>) {
        let points: Vec<String> = points
            .map(|point| {
                let [x, y] = self.at(point);
                format!("{x:.1},{y:.1}")
            })
            .collect();
        let points = points.join(" ");
        let _ = writeln!(
            self.svg,
            "<polyline class=\"{class}\" points=\"{points}\"/>"
        );
    }

    /// A circle of this many pixels.
    pub(super) fn circle(&mut self, class: &str, centre: Point, radius: f64) {
        let [x, y] = self.at(centre);
        let _ = writeln!(
            self.svg,
            "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"/>"
        );
    }

    /// An ellipse.
    pub(super) fn ellipse(&mut self, class: &str, centre: Point, ellipse: EllipsePx) {
        let [x, y] = self.at(centre);
        let [rx, ry] = ellipse.half_axes;
        let _ = writeln!(
            self.svg,
            "<ellipse class=\"{class}\" rx=\"{rx:.1}\" ry=\"{ry:.1}\" \
             transform=\"translate({x:.1} {y:.1}) rotate({:.1})\"/>",
            ellipse.angle_deg
        );
    }

    /// A cross of this many pixels each way.
    pub(super) fn cross(&mut self, class: &str, centre: Point, size: f64) {
        let [x, y] = self.at(centre);
        let (l, r, t, b) = (x - size, x + size, y - size, y + size);
        let _ = writeln!(
            self.svg,
            "<path class=\"{class}\" d=\"M{l:.1} {t:.1}L{r:.1} {b:.1}M{l:.1} {b:.1}L{r:.1} {t:.1}\"/>"
        );
    }

    /// Text with its left end beside a point.
    pub(super) fn text(&mut self, class: &str, beside: Point, offset: [f64; 2], text: &str) {
        let [x, y] = self.at(beside);
        let _ = writeln!(
            self.svg,
            "<text class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\">{text}</text>",
            x + offset[0],
            y + offset[1]
        );
    }

    /// A line from bottom to top.
    pub(super) fn vertical(&mut self, class: &str, x: f64) {
        let ([bottom, top], x) = (self.pixels.y.ends(), self.pixels.x.of(x));
        let _ = writeln!(
            self.svg,
            "<line class=\"{class}\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{bottom:.1}\" y2=\"{top:.1}\"/>"
        );
    }

    /// Text at the top, just right of a value.
    pub(super) fn heading(&mut self, class: &str, x: f64, text: &str) {
        let ([_, top], x) = (self.pixels.y.ends(), self.pixels.x.of(x));
        let _ = writeln!(
            self.svg,
            "<text class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\">{text}</text>",
            x + 4.0,
            top + 14.0
        );
    }

    /// Elements as they are.
    pub(super) fn raw(&mut self, svg: &str) {
        self.svg.push_str(svg);
    }

    /// Lays it over the chart.
    pub(super) fn onto(mut self, mut drawing: Drawing) -> String {
        self.svg.push_str("</g>");
        drawing.overlay(&self.svg);
        drawing.svg
    }
}
