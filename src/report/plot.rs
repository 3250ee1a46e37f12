//! Plots over time: a figure with its data as CSV, a still drawing that needs no script, and what the page's script makes an
//! interactive plot of (uPlot: zoom, values under the cursor, one time axis for all plots of a page).

use super::page::escape;
use gaware_nav::math::{log10, powf};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// A colour as CSS writes it.
pub type Color = &'static str;

/// One line.
#[derive(Debug, Clone)]
pub struct Line<'a> {
    /// For the legend.
    pub name: &'a str,
    /// Colour.
    pub color: Color,
    /// Points.
    pub points: Vec<(f64, f64)>,
}

/// Colour of what was before.
pub const BEFORE: Color = "#d6604d";
/// Colour of what is after.
pub const AFTER: Color = "#2a82be";
/// Width and height of a small drawing, px: on a phone it keeps its size, and its letters theirs.
pub const SMALL: (f64, f64) = (350.0, 240.0);
/// Colours of the three axes of the body.
pub const X_AXIS: Color = "#2a82be";
/// See [`X_AXIS`].
pub const Y_AXIS: Color = "#9669be";
/// See [`X_AXIS`].
pub const Z_AXIS: Color = "#d07818";

/// Points of a band in a still drawing: a paper shows no more.
const BAND_POINTS: usize = 200;

/// What lies between a lower and an upper bound: a value give or take its sigma.
#[derive(Debug, Clone)]
struct Band {
    color: Color,
    /// Time, lower bound, upper bound.
    points: Vec<(f64, f64, f64)>,
}

/// Which values a plot shows.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Range {
    /// All of them, and zero; to both sides alike where some are negative.
    Zero,
    /// All of them and no more.
    Close,
    /// From the negative of this to this; what is beyond is truncated.
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
    limits: Option<f64>,
    /// The time axis starts here or earlier, s.
    since_s: f64,
    /// Whether the axis is frequency instead of time.
    frequency: bool,
}

/// What the script needs beside the CSV.
#[derive(Serialize)]
struct Description<'a> {
    unit: &'a str,
    /// Unit of the horizontal axis.
    x: &'a str,
    y: [f64; 2],
    since: Option<f64>,
    lines: Vec<(&'a str, Color)>,
    /// Column of the lower bound, the upper one follows.
    bands: Vec<(usize, Color)>,
    marks: &'a [(f64, &'a str)],
    limits: Option<f64>,
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
            limits: None,
            since_s: f64::INFINITY,
            frequency: false,
        }
    }

    /// With another line.
    #[must_use]
    pub fn line(mut self, name: &'a str, color: Color, points: Vec<(f64, f64)>) -> Self {
        self.lines.push(Line { name, color, points });
        self
    }

    /// With another band.
    #[must_use]
    pub fn band(mut self, color: Color, points: Vec<(f64, f64, f64)>) -> Self {
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

    /// With frequency, Hz, in place of time.
    #[must_use]
    pub fn over_frequency(mut self) -> Self {
        self.frequency = true;
        self
    }

    /// Unit of the horizontal axis.
    fn x_unit(&self) -> &'static str {
        if self.frequency { "Hz" } else { "s" }
    }

    /// Shows no more than this to both sides of zero.
    #[must_use]
    pub fn within(mut self, limit: f64) -> Self {
        self.range = Range::Within(limit);
        self
    }

    /// With the band to both sides of zero where values belong.
    #[must_use]
    pub fn expected(mut self, limit: f64) -> Self {
        self.limits = Some(limit);
        self
    }

    /// The figure; empty where there is nothing to show.
    ///
    /// # Errors
    /// The description cannot be written.
    pub fn svg(&self) -> Result<String, String> {
        let Some((y, t)) = self.extent() else { return Ok(String::new()) };
        let describe = Description {
            unit: self.unit,
            x: self.x_unit(),
            y,
            since: Some(self.since_s).filter(|s| s.is_finite()),
            lines: self.lines.iter().map(|l| (l.name, l.color)).collect(),
            bands: self.bands.iter().zip(0..).map(|(b, k)| (self.lines.len() + 2 * k, b.color)).collect(),
            marks: &self.marks,
            limits: self.limits,
        };
        let json = serde_json::to_string(&describe).map_err(|e| e.to_string())?;
        let title = escape(self.title);
        let mut keys = String::new();
        for l in &self.lines {
            let _ = write!(
                keys,
                "<span class=\"key\"><i style=\"background:{}\"></i>{}</span>",
                l.color,
                escape(l.name)
            );
        }
        Ok(format!(
            "<figure class=\"chart\" data-plot=\"{}\"><figcaption><b>{title}</b> <small>{}</small> {keys}<a class=\"csv\" \
             download=\"{}.csv\" href=\"data:text/csv;charset=utf-8,{}\">CSV</a></figcaption><div class=\"area\">{}</div></figure>",
            escape(&json),
            escape(self.unit),
            self.title.replace(|c: char| !c.is_ascii_alphanumeric(), "_"),
            self.csv(),
            self.still(y, t)
        ))
    }

    /// Range of values and of time; nothing where there are no points.
    fn extent(&self) -> Option<([f64; 2], [f64; 2])> {
        let all = || self.lines.iter().flat_map(|l| &l.points);
        let (first, end) = span(all().map(|p| p.0));
        let (low, high) = span(all().map(|p| p.1));
        if !first.is_finite() || !low.is_finite() {
            return None;
        }
        let y = match self.range {
            Range::Within(limit) => [-limit, limit],
            Range::Close => [low, high],
            Range::Zero if low < 0.0 => [-high.max(-low), high.max(-low)],
            Range::Zero => [0.0, high],
        };
        let y = if y[1] > y[0] { y } else { [y[0] - 0.5, y[0] + 0.5] };
        let pad = if self.range == Range::Zero && y[0] >= 0.0 { [0.0, 0.05] } else { [0.05, 0.05] };
        let height = y[1] - y[0];
        Some((
            [y[0] - pad[0] * height, y[1] + pad[1] * height],
            [first.min(self.since_s), end.max(first + 1e-3)],
        ))
    }

    /// Time and a column per line and bound, percent-encoded for the link. Times that several lines share stand once.
    fn csv(&self) -> String {
        let columns = self.lines.len() + 2 * self.bands.len();
        let mut rows: BTreeMap<i64, Vec<Option<f64>>> = BTreeMap::new();
        let mut put = |t: f64, column: usize, value: f64| {
            let row = rows.entry((t * 1e3).round() as i64).or_insert_with(|| vec![None; columns]);
            if let Some(cell) = row.get_mut(column).filter(|_| value.is_finite()) {
                *cell = Some(value);
            }
        };
        for (k, line) in self.lines.iter().enumerate() {
            line.points.iter().for_each(|(t, v)| put(*t, k, *v));
        }
        for (k, band) in self.bands.iter().enumerate() {
            let at = self.lines.len() + 2 * k;
            for (t, low, high) in &band.points {
                put(*t, at, *low);
                put(*t, at + 1, *high);
            }
        }
        let clean = |name: &str| name.replace(|c: char| !(c.is_ascii_alphanumeric() || c == '_'), "_");
        let mut out = if self.frequency { "frequency_hz" } else { "time_s" }.to_owned();
        self.lines.iter().for_each(|l| out.extend([",", &clean(l.name)]));
        (0..self.bands.len()).for_each(|k| {
            let name = self.lines.get(k).map_or_else(|| k.to_string(), |l| clean(l.name));
            let _ = write!(out, ",{name}_low,{name}_high");
        });
        for (t, row) in rows {
            let _ = write!(out, "%0A{}", t as f64 * 1e-3);
            for cell in row {
                out.push(',');
                if let Some(v) = cell {
                    out.push_str(&short(v));
                }
            }
        }
        out
    }

    /// A still drawing: what is there without scripts.
    fn still(&self, y: [f64; 2], t: [f64; 2]) -> String {
        let px = |s: f64| 60.0 + 780.0 * (s - t[0]) / (t[1] - t[0]);
        let py = |v: f64| 12.0 + 176.0 * (y[1] - v.clamp(y[0], y[1])) / (y[1] - y[0]);
        let mut out = "<svg role=\"img\" viewBox=\"0 0 860 216\" font-family=\"sans-serif\" font-size=\"15\" fill=\"currentColor\">".to_owned();
        let _ = write!(out, "<title>{}</title>", escape(self.title));
        for band in &self.bands {
            let every = band.points.len().div_ceil(BAND_POINTS).max(1);
            let points = || band.points.iter().step_by(every).filter(|p| p.1.is_finite() && p.2.is_finite());
            let place = |t: f64, v: f64| format!("{:.1},{:.1} ", px(t), py(v));
            let edge: String =
                points().map(|p| place(p.0, p.2)).chain(points().rev().map(|p| place(p.0, p.1))).collect();
            let _ = write!(
                out,
                "<polygon points=\"{}\" fill=\"{}\" fill-opacity=\".15\"/>",
                edge.trim_end(),
                band.color
            );
        }
        if let Some(limit) = self.limits {
            let (top, bottom) = (py(limit), py(-limit));
            let height = bottom - top;
            let _ = write!(
                out,
                "<path d=\"M60 {top:.1}H840v{height:.1}H60z\" fill=\"#3ca06e\" fill-opacity=\".15\"/>"
            );
        }
        grid(&mut out, y, (60, 840), py);
        for s in ticks(t) {
            let _ = write!(
                out,
                "<text x=\"{:.1}\" y=\"208\" text-anchor=\"middle\">{} {}</text>",
                px(s),
                short(s),
                self.x_unit()
            );
        }
        for (s, _) in self.marks.iter().filter(|(s, _)| (t[0]..=t[1]).contains(s)) {
            let _ = write!(
                out,
                "<path d=\"M{:.1} 12V188\" stroke=\"currentColor\" stroke-opacity=\".4\"/>",
                px(*s)
            );
        }
        for line in &self.lines {
            let every = line.points.len().div_ceil(400).max(1);
            let _ = write!(
                out,
                "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\" points=\"",
                line.color
            );
            for (s, v) in line.points.iter().step_by(every).filter(|(_, v)| v.is_finite()) {
                let _ = write!(out, "{:.1},{:.1} ", px(*s), py(*v));
            }
            out.push_str("\"/>");
        }
        out.push_str("</svg>");
        out
    }
}

/// Smallest and largest of the finite values; infinity and its negative where there is none.
pub fn span(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let values = values.into_iter().filter(|v| v.is_finite());
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

/// Lines across a large drawing from `left` to `right`, px, at round values, with their labels.
pub(super) fn grid(svg: &mut String, range: [f64; 2], (left, right): (u32, u32), py: impl Fn(f64) -> f64) {
    for v in ticks(range) {
        let _ = write!(
            svg,
            "<path d=\"M{left} {:.1}H{right}\" stroke=\"currentColor\" stroke-opacity=\".15\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{}</text>",
            py(v),
            left - 6,
            py(v) + 4.0,
            short(v)
        );
    }
}

/// Six significant figures.
pub(super) fn short(v: f64) -> String {
    let text = format!("{v:.6e}").parse::<f64>().unwrap_or(v);
    let digits = (5.0 - log10(text.abs().max(1e-9)).floor()).clamp(0.0, 9.0) as usize;
    let fixed = format!("{text:.digits$}");
    if fixed.contains('.') { fixed.trim_end_matches('0').trim_end_matches('.').to_owned() } else { fixed }
}

/// Round values within a range, some four to eight of them.
pub(super) fn ticks([low, high]: [f64; 2]) -> Vec<f64> {
    let raw = (high - low) / 5.0;
    let unit = powf(10_f64, log10(raw).floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * unit).find(|s| *s >= raw).unwrap_or(raw);
    let first = (low / step).ceil() as i64;
    (first..first + 12).map(|k| k as f64 * step).take_while(|v| *v <= high).collect()
}

/// A label in a small drawing at this place.
pub fn label(svg: &mut String, (x, y): (f64, f64), anchor: &str, text: &str) {
    let _ = write!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-size=\"12\" fill=\"currentColor\">{}</text>",
        escape(text)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_holds_its_data_once_and_a_drawing_without_scripts() {
        let plot = Plot::new("gyro <bias>", "deg/h")
            .line("x", X_AXIS, vec![(0.0, 1.0), (0.5, -2.5), (1.0, f64::NAN)])
            .band(X_AXIS, vec![(0.0, 0.0, 2.0)])
            .marks(&[(0.5, "turn")]);
        let html = plot.svg().unwrap();
        assert!(html.contains("time_s,x,x_low,x_high%0A0,1,0,2%0A0.5,-2.5,,%0A1,,,\""), "{html}");
        assert!(
            html.contains("<polyline")
                && html.contains("<polygon points=\"60.0,")
                && html.contains("gyro &lt;bias&gt;")
                && !html.contains("NaN")
        );
        assert_eq!(Plot::new("nothing", "m").svg(), Ok(String::new()));
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(ticks([0.0, 10.0]), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(
            [short(0.1), short(1234567.0), short(-0.25), short(0.0)],
            ["0.1", "1234567", "-0.25", "0"]
        );
    }
}
