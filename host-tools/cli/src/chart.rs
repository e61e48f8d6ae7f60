//! Pictures as SVG text.

use anyhow::Result;
use nalgebra::{Matrix2, SymmetricEigen};
use plotters::coord::ranged1d::ValueFormatter;
use plotters::element::{Circle, Cross, PathElement};
use plotters::prelude::{
    BLACK, Cartesian2d, ChartBuilder, ChartContext, Color, IntoDrawingArea, IntoLogRange,
    LineSeries, RGBColor, Ranged, SVGBackend, WHITE,
};
use serde::Serialize;
use std::ops::Range;

/// A point in data units: x, y.
pub(crate) type Point = (f64, f64);

/// What is drawn.
pub(crate) struct Series<'a> {
    /// For the legend.
    pub(crate) label: &'a str,
    /// How its points look.
    pub(crate) style: Style,
    /// Red, green, blue.
    pub(crate) color: RGBColor,
    /// Its points.
    pub(crate) points: &'a [Point],
}

impl<'a> Series<'a> {
    /// Joined by a line.
    pub(crate) fn line(label: &'a str, color: RGBColor, points: &'a [Point]) -> Self {
        Self::of(Style::Line, label, color, points)
    }

    /// Small dots.
    pub(crate) fn dots(label: &'a str, color: RGBColor, points: &'a [Point]) -> Self {
        Self::of(Style::Dots, label, color, points)
    }

    /// A large cross each.
    pub(crate) fn crosses(label: &'a str, color: RGBColor, points: &'a [Point]) -> Self {
        Self::of(Style::Cross, label, color, points)
    }

    /// A large circle each.
    pub(crate) fn circles(label: &'a str, color: RGBColor, points: &'a [Point]) -> Self {
        Self::of(Style::Circle, label, color, points)
    }

    fn of(style: Style, label: &'a str, color: RGBColor, points: &'a [Point]) -> Self {
        Self {
            label,
            style,
            color,
            points,
        }
    }
}

/// How points look.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Style {
    /// Joined by a line.
    Line,
    /// Small dots.
    Dots,
    /// A large cross each.
    Cross,
    /// A large circle each.
    Circle,
}

/// How values become places along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Scale {
    /// Evenly.
    Linear,
    /// Every factor of ten as long as the next. Values must be above 0.
    Log,
}

/// One axis of a chart.
#[derive(Clone)]
pub(crate) struct Axis<'a> {
    /// Name and unit.
    pub(crate) label: &'a str,
    /// How values are placed.
    pub(crate) scale: Scale,
    /// What it shows; `None` for all there is.
    pub(crate) range: Option<Range<f64>>,
}

impl<'a> Axis<'a> {
    /// A linear axis that shows all there is.
    pub(crate) fn linear(label: &'a str) -> Self {
        Self {
            label,
            scale: Scale::Linear,
            range: None,
        }
    }

    /// A logarithmic axis that shows this.
    pub(crate) fn log(label: &'a str, range: Range<f64>) -> Self {
        Self {
            label,
            scale: Scale::Log,
            range: Some(range),
        }
    }

    /// The same axis, showing this.
    pub(crate) fn over(self, range: Range<f64>) -> Self {
        Self {
            range: Some(range),
            ..self
        }
    }
}

/// A chart with linear axes that show all there is, as an SVG element.
pub(crate) fn linear_chart(
    size: (u32, u32),
    [x, y]: [&str; 2],
    equal_scales: bool,
    series: &[Series<'_>],
) -> Result<String> {
    Chart {
        size,
        x: Axis::linear(x),
        y: Axis::linear(y),
        equal_scales,
        legend: Some(Corner::UpperRight),
        series,
    }
    .svg()
}

/// Where the legend stands.
pub(crate) use plotters::chart::SeriesLabelPosition as Corner;

/// A chart and its axes.
pub(crate) struct Chart<'a> {
    /// Width and height in pixels.
    pub(crate) size: (u32, u32),
    /// The horizontal axis.
    pub(crate) x: Axis<'a>,
    /// The vertical axis.
    pub(crate) y: Axis<'a>,
    /// Whether a metre is as long up as it is across; for linear axes that show all there is.
    pub(crate) equal_scales: bool,
    /// Where the legend stands, if there is one.
    pub(crate) legend: Option<Corner>,
    /// What is drawn, first to last.
    pub(crate) series: &'a [Series<'a>],
}

/// A chart drawn.
pub(crate) struct Drawing {
    /// The SVG element.
    pub(crate) svg: String,
    /// Where values lie in it.
    pub(crate) pixels: Pixels,
}

/// Where values lie in a drawing.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Pixels {
    /// Along the horizontal axis.
    pub(crate) x: PixelAxis,
    /// Along the vertical axis.
    pub(crate) y: PixelAxis,
}

/// Pixel of a value `v`: `zero + per_unit * v` on a linear axis, `zero + per_unit * log10(v)` on a
/// logarithmic one.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct PixelAxis {
    scale: Scale,
    zero: f64,
    per_unit: f64,
    /// First and last pixel of the axis.
    ends: [f64; 2],
}

impl PixelAxis {
    fn new(scale: Scale, range: &Range<f64>, pixels: (i32, i32)) -> Self {
        let (from, to) = (scale.place(range.start), scale.place(range.end));
        let pixels = [pixels.0, pixels.1].map(|p| f64::from(p) / f64::from(FINE));
        let per_unit = (pixels[1] - pixels[0]) / (to - from);
        Self {
            scale,
            zero: pixels[0] - per_unit * from,
            per_unit,
            ends: pixels,
        }
    }

    /// The pixel of a value.
    pub(crate) fn of(&self, value: f64) -> f64 {
        self.zero + self.per_unit * self.scale.place(value)
    }

    /// First and last pixel of the axis.
    pub(crate) fn ends(&self) -> [f64; 2] {
        self.ends
    }
}

impl Scale {
    fn place(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Log => value.log10(),
        }
    }
}

impl Drawing {
    /// Adds SVG elements on top, in pixels of the chart.
    pub(crate) fn overlay(&mut self, elements: &str) {
        let end = self.svg.rfind("</svg>").unwrap_or(self.svg.len());
        let group = format!("<g transform=\"scale({FINE})\">{elements}</g>\n");
        self.svg.insert_str(end, &group);
    }
}

/// The library places everything on whole pixels, which makes steps in gentle slopes: charts are
/// drawn this many times as large and shown smaller.
const FINE: u32 = 4;

const MARGIN_PX: u32 = 12;
const X_AXIS_PX: u32 = 42;
const Y_AXIS_PX: u32 = 60;

/// Font and its size in pixels.
const LABELS: (&str, u32) = ("sans-serif", 14 * FINE);

impl Chart<'_> {
    /// The chart as an SVG element.
    pub(crate) fn svg(&self) -> Result<String> {
        Ok(self.draw()?.svg)
    }

    /// The chart, and where values lie in it.
    pub(crate) fn draw(&self) -> Result<Drawing> {
        let mut svg = String::new();
        let (width, height) = self.size;
        let pixels = {
            let root = SVGBackend::with_string(&mut svg, (width * FINE, height * FINE))
                .into_drawing_area();
            root.fill(&WHITE)?;
            let mut builder = ChartBuilder::on(&root);
            builder
                .margin(MARGIN_PX * FINE)
                .x_label_area_size(X_AXIS_PX * FINE)
                .y_label_area_size(Y_AXIS_PX * FINE);
            let (x, y) = self.ranges();
            let pixels = match (self.x.scale, self.y.scale) {
                (Scale::Linear, Scale::Linear) => {
                    self.fill(builder.build_cartesian_2d(x.clone(), y.clone())?, (&x, &y))?
                }
                (Scale::Linear, Scale::Log) => self.fill(
                    builder.build_cartesian_2d(x.clone(), y.clone().log_scale())?,
                    (&x, &y),
                )?,
                (Scale::Log, Scale::Linear) => self.fill(
                    builder.build_cartesian_2d(x.clone().log_scale(), y.clone())?,
                    (&x, &y),
                )?,
                (Scale::Log, Scale::Log) => self.fill(
                    builder.build_cartesian_2d(x.clone().log_scale(), y.clone().log_scale())?,
                    (&x, &y),
                )?,
            };
            root.present()?;
            pixels
        };
        let large = format!("width=\"{}\" height=\"{}\"", width * FINE, height * FINE);
        let shown = format!("width=\"{width}\" height=\"{height}\"");
        Ok(Drawing {
            svg: svg.replacen(&large, &shown, 1),
            pixels,
        })
    }

    fn fill<'a, 'b: 'a, X, Y>(
        &self,
        mut chart: Axes<'a, 'b, X, Y>,
        (x, y): (&Range<f64>, &Range<f64>),
    ) -> Result<Pixels>
    where
        X: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        chart
            .configure_mesh()
            .x_desc(self.x.label)
            .y_desc(self.y.label)
            .x_label_formatter(&|value| shown(*value))
            .y_label_formatter(&|value| shown(*value))
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(228, 228, 228).stroke_width(FINE))
            .axis_style(BLACK.stroke_width(FINE))
            .label_style(LABELS)
            .axis_desc_style(LABELS)
            .set_all_tick_mark_size(5 * FINE)
            .draw()?;
        let there = |series: &&Series<'_>| !series.points.is_empty();
        for series in self.series.iter().filter(there) {
            draw(&mut chart, series)?;
        }
        if let Some(corner) = self.legend.clone() {
            chart
                .configure_series_labels()
                .position(corner)
                .margin(5 * FINE)
                .legend_area_size(30 * FINE)
                .label_font(LABELS)
                .background_style(WHITE.mix(0.85))
                .border_style(RGBColor(180, 180, 180).stroke_width(FINE))
                .draw()?;
        }
        let (left, bottom) = chart.backend_coord(&(x.start, y.start));
        let (right, top) = chart.backend_coord(&(x.end, y.end));
        Ok(Pixels {
            x: PixelAxis::new(self.x.scale, x, (left, right)),
            y: PixelAxis::new(self.y.scale, y, (bottom, top)),
        })
    }

    /// Both axes with some space around the data.
    fn ranges(&self) -> (Range<f64>, Range<f64>) {
        let points = || self.series.iter().flat_map(|series| series.points);
        let x = (self.x.range.clone()).unwrap_or_else(|| padded(points().map(|p| p.0)));
        let y = (self.y.range.clone()).unwrap_or_else(|| padded(points().map(|p| p.1)));
        if !self.equal_scales {
            return (x, y);
        }
        let width = f64::from(self.size.0 - 2 * MARGIN_PX - Y_AXIS_PX);
        let height = f64::from(self.size.1 - 2 * MARGIN_PX - X_AXIS_PX);
        let per_pixel = ((x.end - x.start) / width).max((y.end - y.start) / height);
        (
            stretched(&x, per_pixel * width),
            stretched(&y, per_pixel * height),
        )
    }
}

fn padded(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    });
    if low > high {
        return 0.0..1.0;
    }
    let pad = ((high - low) * 0.08).max(1e-6);
    low - pad..high + pad
}

fn stretched(range: &Range<f64>, length: f64) -> Range<f64> {
    let middle = (range.start + range.end) / 2.0;
    middle - length / 2.0..middle + length / 2.0
}

/// A number at an axis: without digits that come from rounding.
fn shown(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    // No "-0".
    (rounded + 0.0).to_string()
}

type Axes<'a, 'b, X, Y> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<X, Y>>;

fn draw<X, Y>(chart: &mut Axes<'_, '_, X, Y>, series: &Series<'_>) -> Result<()>
where
    X: Ranged<ValueType = f64>,
    Y: Ranged<ValueType = f64>,
{
    const HALF: i32 = 8 * FINE as i32;
    let color = series.color;
    let thick = color.stroke_width(2 * FINE);
    let points = series.points.iter().copied();
    let drawn = match series.style {
        Style::Line => chart.draw_series(LineSeries::new(points, thick))?,
        Style::Dots => chart.draw_series(points.map(|p| Circle::new(p, FINE, color.filled())))?,
        Style::Cross => chart.draw_series(points.map(|p| Cross::new(p, 6 * FINE, thick)))?,
        Style::Circle => chart.draw_series(points.map(|p| Circle::new(p, 6 * FINE, thick)))?,
    };
    if series.label.is_empty() {
        return Ok(());
    }
    drawn.label(series.label);
    match series.style {
        Style::Line => {
            drawn.legend(move |(x, y)| PathElement::new([(x, y), (x + 2 * HALF, y)], thick))
        }
        Style::Dots => {
            drawn.legend(move |(x, y)| Circle::new((x + HALF, y), 2 * FINE, color.filled()))
        }
        Style::Cross => drawn.legend(move |(x, y)| Cross::new((x + HALF, y), 5 * FINE, thick)),
        Style::Circle => drawn.legend(move |(x, y)| Circle::new((x + HALF, y), 5 * FINE, thick)),
    };
    Ok(())
}

/// 95 % point of chi-square with two degrees of freedom.
const CHI_SQUARE_95: f64 = 5.991;

/// The ellipse that holds the truth with a probability of 95 % if errors are Gaussian with this
/// covariance: its half-axes, longer first, and the direction of the first in radians, from x to y.
pub(crate) fn half_axes_95(covariance: &Matrix2<f64>) -> ([f64; 2], f64) {
    let eigen = SymmetricEigen::new(*covariance);
    let long = eigen.eigenvalues.imax();
    let length = |index: usize| {
        let variance = eigen.eigenvalues.get(index).copied().unwrap_or(0.0);
        (variance.max(0.0) * CHI_SQUARE_95).sqrt()
    };
    let direction = eigen.eigenvectors.column(long);
    let angle = direction.y.atan2(direction.x);
    ([length(long), length(1 - long)], angle)
}

/// The outline of that ellipse.
pub(crate) fn ellipse_95(centre: Point, covariance: &Matrix2<f64>) -> Vec<Point> {
    const CORNERS: u32 = 72;
    let ([long, short], angle) = half_axes_95(covariance);
    let (sine, cosine) = angle.sin_cos();
    (0..=CORNERS)
        .map(|k| {
            let along = std::f64::consts::TAU * f64::from(k) / f64::from(CORNERS);
            let (u, v) = (long * along.cos(), short * along.sin());
            (
                centre.0 + u * cosine - v * sine,
                centre.1 + u * sine + v * cosine,
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ellipse_lies_on_one_contour_of_the_covariance() {
        let covariance = Matrix2::new(4.0, 1.2, 1.2, 0.9);
        let inverse = covariance.try_inverse().unwrap();
        for (x, y) in ellipse_95((3.0, -2.0), &covariance) {
            let d = nalgebra::Vector2::new(x - 3.0, y + 2.0);
            assert!((d.dot(&(inverse * d)) - 5.991).abs() < 1e-9);
        }
    }

    #[test]
    fn a_metre_is_as_long_up_as_across_where_asked() {
        let chart = Chart {
            size: (600, 300),
            x: Axis::linear("x"),
            y: Axis::linear("y"),
            equal_scales: true,
            legend: None,
            series: &[Series {
                label: "path",
                style: Style::Line,
                color: RGBColor(0, 0, 255),
                points: &[(0.0, 0.0), (1.0, 10.0)],
            }],
        };
        let (x, y) = chart.ranges();
        let width = f64::from(600 - 2 * MARGIN_PX - Y_AXIS_PX);
        let height = f64::from(300 - 2 * MARGIN_PX - X_AXIS_PX);
        let scale = (x.end - x.start) / width;
        assert!((scale * height / (y.end - y.start) - 1.0).abs() < 1e-9);
        assert!(chart.svg().unwrap().starts_with("<svg"));
    }
}
