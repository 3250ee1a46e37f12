//! Line plots as inline SVG that take their colours from the page.

use plotters::coord::Shift;
use plotters::prelude::*;

/// One line.
#[derive(Debug, Clone)]
pub struct Line<'a> {
    /// For the legend.
    pub name: &'a str,
    /// Colour.
    pub color: RGBColor,
    /// Points.
    pub points: Vec<(f64, f64)>,
}

/// Colour of what was before.
pub const BEFORE: RGBColor = RGBColor(214, 96, 77);
/// Colour of what is after.
pub const AFTER: RGBColor = RGBColor(42, 130, 190);
/// Colours of the three axes of the body.
pub const X_AXIS: RGBColor = RGBColor(42, 130, 190);
/// See [`X_AXIS`].
pub const Y_AXIS: RGBColor = RGBColor(150, 105, 190);
/// See [`X_AXIS`].
pub const Z_AXIS: RGBColor = RGBColor(225, 130, 35);
/// Colour of axes and text in the drawing; replaced by the page's own.
const INK: RGBColor = RGBColor(1, 2, 3);
const INK_IN_SVG: &str = "#010203";
/// What lies behind; replaced likewise.
const PAPER: RGBColor = RGBColor(4, 5, 6);
const PAPER_IN_SVG: &str = "#040506";

/// What lies between a lower and an upper bound: a value give or take its sigma.
#[derive(Debug, Clone)]
pub struct Band {
    /// Colour; drawn faint.
    pub color: RGBColor,
    /// Time, lower bound, upper bound.
    pub points: Vec<(f64, f64, f64)>,
}

/// Which values a plot shows.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Range {
    /// All of them, and zero; to both sides alike where some are negative.
    Zero,
    /// All of them and no more.
    Close,
    /// From the negative of this to this; what is beyond is cut off.
    Within(f64),
}

/// A plot over time.
#[derive(Debug, Clone)]
pub struct Plot<'a> {
    title: &'a str,
    unit: &'a str,
    lines: Vec<Line<'a>>,
    bands: Vec<Band>,
    marks: Vec<(f64, &'a str)>,
    range: Range,
    /// The time axis starts here or earlier, s.
    since_s: f64,
}

/// A plot of lines over time.
///
/// # Errors
/// What the drawing library says.
pub fn lines(title: &str, unit: &str, lines: &[Line<'_>]) -> Result<String, String> {
    marked_lines(title, unit, lines, &[])
}

/// A plot of lines over time with named instants.
///
/// # Errors
/// What the drawing library says.
pub fn marked_lines(
    title: &str,
    unit: &str,
    lines: &[Line<'_>],
    marks: &[(f64, &str)],
) -> Result<String, String> {
    let mut plot = Plot::new(title, unit);
    plot.lines.extend_from_slice(lines);
    plot.marks.extend_from_slice(marks);
    plot.svg()
}

impl<'a> Plot<'a> {
    /// A plot of nothing yet.
    pub fn new(title: &'a str, unit: &'a str) -> Self {
        Self {
            title,
            unit,
            lines: Vec::new(),
            bands: Vec::new(),
            marks: Vec::new(),
            range: Range::Zero,
            since_s: f64::INFINITY,
        }
    }

    /// With another line.
    #[must_use]
    pub fn line(mut self, name: &'a str, color: RGBColor, points: Vec<(f64, f64)>) -> Self {
        self.lines.push(Line { name, color, points });
        self
    }

    /// With another band.
    #[must_use]
    pub fn band(mut self, color: RGBColor, points: Vec<(f64, f64, f64)>) -> Self {
        self.bands.push(Band { color, points });
        self
    }

    /// With named instants.
    #[must_use]
    pub fn marks(mut self, marks: &[(f64, &'a str)]) -> Self {
        self.marks.extend_from_slice(marks);
        self
    }

    /// Shows the lines as close as they allow, wherever zero is.
    #[must_use]
    pub fn close(mut self) -> Self {
        self.range = Range::Close;
        self
    }

    /// Starts the time axis here, though the lines may start later.
    #[must_use]
    pub fn since(mut self, start_s: f64) -> Self {
        self.since_s = start_s;
        self
    }

    /// Shows no more than this to both sides of zero.
    #[must_use]
    pub fn within(mut self, limit: f64) -> Self {
        self.range = Range::Within(limit);
        self
    }

    fn bounds(&self) -> Option<((f64, f64), (f64, f64))> {
        let all = || self.lines.iter().flat_map(|l| l.points.iter().copied());
        let span = |values: &mut dyn Iterator<Item = f64>| {
            values.fold(None, |span: Option<(f64, f64)>, v| {
                Some(span.map_or((v, v), |(low, high)| (low.min(v), high.max(v))))
            })
        };
        let (x0, x1) = span(&mut all().map(|p| p.0))?;
        let x0 = x0.min(self.since_s);
        let (low, high) = span(&mut all().map(|p| p.1))?;
        let y = match self.range {
            Range::Within(limit) => (-limit, limit),
            Range::Close => {
                let margin = (0.08 * (high - low)).max(0.5);
                (low - margin, high + margin)
            }
            Range::Zero => {
                let top = low.abs().max(high.abs()).max(1e-9) * 1.08;
                (if low < 0.0 { -top } else { 0.0 }, top)
            }
        };
        Some(((x0, x1.max(x0 + 1.0)), y))
    }

    /// The drawing; empty where there is nothing to draw.
    ///
    /// # Errors
    /// What the drawing library says.
    pub fn svg(&self) -> Result<String, String> {
        let Some((across, up)) = self.bounds() else { return Ok(String::new()) };
        let mut svg = String::new();
        {
            let area = SVGBackend::with_string(&mut svg, (860, 230)).into_drawing_area();
            self.draw(&area, across, up).map_err(|e| e.to_string())?;
            area.present().map_err(|e| e.to_string())?;
        }
        // The page decides about the colour of ink and about the width.
        let svg = svg.replace(INK_IN_SVG, "currentColor").replace(PAPER_IN_SVG, "var(--paper)");
        let svg = svg.replacen("<svg ", "<svg class=\"plot\" role=\"img\" ", 1);
        // On a narrow screen it scrolls: nobody could read it that small.
        Ok(format!("<div class=\"wide\">{svg}</div>"))
    }

    fn draw<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        (x0, x1): (f64, f64),
        (bottom, top): (f64, f64),
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let mut chart = ChartBuilder::on(area)
            .caption(self.title, text(15))
            .margin(6)
            .x_label_area_size(34)
            .y_label_area_size(54)
            .build_cartesian_2d(x0..x1, bottom..top)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(INK.mix(0.12))
            .axis_style(INK.mix(0.5))
            .label_style(text(11))
            .x_label_formatter(&tick)
            .y_label_formatter(&tick)
            .x_desc("time, s")
            .y_desc(self.unit)
            .draw()?;
        let inside = |y: f64| y.clamp(bottom, top);
        for band in &self.bands {
            let upper = band.points.iter().map(|(x, _, high)| (*x, inside(*high)));
            let lower = band.points.iter().rev().map(|(x, low, _)| (*x, inside(*low)));
            let outline: Vec<(f64, f64)> = upper.chain(lower).collect();
            chart.draw_series([Polygon::new(outline, band.color.mix(0.18).filled())])?;
        }
        for line in &self.lines {
            let color = line.color;
            let shown = line.points.iter().map(|(x, y)| (*x, inside(*y)));
            chart
                .draw_series(LineSeries::new(shown, color.stroke_width(1)))?
                .label(line.name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 14, y)], color.stroke_width(2)));
        }
        for (t, name) in &self.marks {
            let upright = [(*t, bottom), (*t, top)];
            chart.draw_series(LineSeries::new(upright, INK.mix(0.35).stroke_width(1)))?;
            chart.draw_series([Text::new((*name).to_owned(), (*t, top), text(10))])?;
        }
        if self.lines.len() > 1 {
            chart
                .configure_series_labels()
                .label_font(text(11))
                .position(SeriesLabelPosition::UpperRight)
                .background_style(PAPER.mix(0.7))
                .draw()?;
        }
        Ok(())
    }
}

/// A figure beside an axis: ticks are round.
fn tick(v: &f64) -> String {
    let text = format!("{v:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn text(size: i32) -> TextStyle<'static> {
    ("sans-serif", size).into_font().color(&INK)
}
