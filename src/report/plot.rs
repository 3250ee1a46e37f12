//! Line plots as inline SVG that take their colours from the page.

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
/// Colour of axes and text in the drawing; replaced by the page's own.
const INK: RGBColor = RGBColor(1, 2, 3);
const INK_IN_SVG: &str = "#010203";

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
    let all = || lines.iter().flat_map(|l| l.points.iter().copied());
    if all().count() == 0 {
        return Ok(String::new());
    }
    let (x0, x1) = all().fold((f64::MAX, f64::MIN), |(a, b), (x, _)| (a.min(x), b.max(x)));
    let top = all().map(|(_, y)| y.abs()).fold(1e-9, f64::max) * 1.08;
    let bottom = if all().any(|(_, y)| y < 0.0) { -top } else { 0.0 };
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (860, 230)).into_drawing_area();
        let text = |size: i32| ("sans-serif", size).into_font().color(&INK);
        let mut chart = ChartBuilder::on(&area)
            .caption(title, text(15))
            .margin(6)
            .x_label_area_size(26)
            .y_label_area_size(54)
            .build_cartesian_2d(x0..x1.max(x0 + 1.0), bottom..top)
            .map_err(|e| e.to_string())?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(INK.mix(0.12))
            .axis_style(INK.mix(0.5))
            .label_style(text(11))
            .x_desc("s")
            .y_desc(unit)
            .draw()
            .map_err(|e| e.to_string())?;
        for line in lines {
            let color = line.color;
            chart
                .draw_series(LineSeries::new(line.points.iter().copied(), color.stroke_width(1)))
                .map_err(|e| e.to_string())?
                .label(line.name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 14, y)], color.stroke_width(2)));
        }
        for (t, name) in marks {
            let upright = [(*t, bottom), (*t, top)];
            chart
                .draw_series(LineSeries::new(upright, INK.mix(0.35).stroke_width(1)))
                .map_err(|e| e.to_string())?;
            let words = Text::new((*name).to_owned(), (*t, top), text(10));
            chart.draw_series(std::iter::once(words)).map_err(|e| e.to_string())?;
        }
        if lines.len() > 1 {
            chart
                .configure_series_labels()
                .label_font(text(11))
                .position(SeriesLabelPosition::UpperRight)
                .draw()
                .map_err(|e| e.to_string())?;
        }
        area.present().map_err(|e| e.to_string())?;
    }
    // The page decides about the colour of ink and about the width.
    Ok(svg.replace(INK_IN_SVG, "currentColor").replacen("<svg ", "<svg class=\"plot\" role=\"img\" ", 1))
}
