//! Pictures as SVG text.

use anyhow::Result;
use nalgebra::{Matrix2, SymmetricEigen};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
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

/// A chart and its axes.
pub(crate) struct Chart<'a> {
    /// Width and height in pixels.
    pub(crate) size: (u32, u32),
    /// Name and unit of the horizontal axis.
    pub(crate) x_label: &'a str,
    /// Name and unit of the vertical axis.
    pub(crate) y_label: &'a str,
    /// Whether a metre is as long up as it is across.
    pub(crate) equal_scales: bool,
    /// What is drawn, first to last.
    pub(crate) series: &'a [Series<'a>],
}

const MARGIN_PX: u32 = 12;
const X_AXIS_PX: u32 = 42;
const Y_AXIS_PX: u32 = 60;

/// Font and its size in pixels.
const LABELS: (&str, u32) = ("sans-serif", 14);

impl Chart<'_> {
    /// The chart as an SVG element.
    pub(crate) fn svg(&self) -> Result<String> {
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, self.size).into_drawing_area();
            root.fill(&WHITE)?;
            let (x, y) = self.ranges();
            let mut chart = ChartBuilder::on(&root)
                .margin(MARGIN_PX)
                .x_label_area_size(X_AXIS_PX)
                .y_label_area_size(Y_AXIS_PX)
                .build_cartesian_2d(x, y)?;
            chart
                .configure_mesh()
                .x_desc(self.x_label)
                .y_desc(self.y_label)
                .light_line_style(WHITE)
                .bold_line_style(RGBColor(228, 228, 228))
                .label_style(LABELS)
                .axis_desc_style(LABELS)
                .draw()?;
            for series in self.series {
                draw(&mut chart, series)?;
            }
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .label_font(LABELS)
                .background_style(WHITE.mix(0.85))
                .border_style(RGBColor(180, 180, 180))
                .draw()?;
            root.present()?;
        }
        Ok(svg)
    }

    /// Both axes with some space around the data.
    fn ranges(&self) -> (Range<f64>, Range<f64>) {
        let points = || self.series.iter().flat_map(|series| series.points);
        let x = padded(points().map(|p| p.0));
        let y = padded(points().map(|p| p.1));
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

type Axes<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

fn draw(chart: &mut Axes<'_, '_>, series: &Series<'_>) -> Result<()> {
    let color = series.color;
    let points = series.points.iter().copied();
    match series.style {
        Style::Line => {
            chart
                .draw_series(LineSeries::new(points, color.stroke_width(2)))?
                .label(series.label)
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2))
                });
        }
        Style::Dots => {
            chart
                .draw_series(points.map(|p| plotters::element::Circle::new(p, 1, color.filled())))?
                .label(series.label)
                .legend(move |(x, y)| {
                    plotters::element::Circle::new((x + 8, y), 2, color.filled())
                });
        }
        Style::Cross => {
            chart
                .draw_series(
                    points.map(|p| plotters::element::Cross::new(p, 6, color.stroke_width(2))),
                )?
                .label(series.label)
                .legend(move |(x, y)| {
                    plotters::element::Cross::new((x + 8, y), 5, color.stroke_width(2))
                });
        }
        Style::Circle => {
            chart
                .draw_series(
                    points.map(|p| plotters::element::Circle::new(p, 6, color.stroke_width(2))),
                )?
                .label(series.label)
                .legend(move |(x, y)| {
                    plotters::element::Circle::new((x + 8, y), 5, color.stroke_width(2))
                });
        }
    }
    Ok(())
}

/// The outline of the ellipse that holds the truth with a probability of 95 %
/// if errors are Gaussian with this covariance.
pub(crate) fn ellipse_95(centre: Point, covariance: &Matrix2<f64>) -> Vec<Point> {
    /// 95 % point of chi-square with two degrees of freedom.
    const CHI_SQUARE_95: f64 = 5.991;
    const CORNERS: u32 = 72;
    let eigen = SymmetricEigen::new(*covariance);
    let axes = eigen.eigenvectors
        * Matrix2::from_diagonal(
            &eigen
                .eigenvalues
                .map(|v| (v.max(0.0) * CHI_SQUARE_95).sqrt()),
        );
    (0..=CORNERS)
        .map(|k| {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(CORNERS);
            let p = axes * nalgebra::Vector2::new(angle.cos(), angle.sin());
            (centre.0 + p.x, centre.1 + p.y)
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
            x_label: "x",
            y_label: "y",
            equal_scales: true,
            series: &[Series {
                label: "path",
                style: Style::Line,
                color: BLUE,
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
