//! Effects outside the catalogue at a glance: the residual of a sensor against what drives it, before and after.

use super::escape;
use crate::explain::drivers::{Bin, DriverPlot};
use crate::explain::words::number;
use crate::report::plot::{AFTER, BEFORE, Color, SMALL as SIZE, label, span};
use std::fmt::Write;

/// Left, right, top, bottom.
const MARGIN: [f64; 4] = [70.0, 15.0, 12.0, 40.0];

/// One figure for each.
pub fn section(plots: &[DriverPlot], body: &mut String) {
    if plots.is_empty() {
        return;
    }
    body.push_str(
        "<h2 id=\"drivers\">Residual against driver</h2><p><small>Sensors and fixes simulated along the smoothed trajectory, mean of a fourteenth of the \
         flight each with its standard error: with the given model, and with the effect in it. The line is the effect about its mean.</small></p>",
    );
    plots.iter().for_each(|plot| figure(plot, body));
}

/// From values to the picture.
struct Scale {
    from: f64,
    to: f64,
    at: (f64, f64),
}

impl Scale {
    fn of(values: impl Iterator<Item = f64>, at: (f64, f64)) -> Self {
        let (from, to) = span(values);
        let slack = (0.05 * (to - from)).max(1e-12 * to.abs()).max(f64::MIN_POSITIVE);
        Self { from: from - slack, to: to + slack, at }
    }

    fn place(&self, v: f64) -> f64 {
        self.at.0 + (v - self.from) / (self.to - self.from) * (self.at.1 - self.at.0)
    }
}

fn figure(plot: &DriverPlot, body: &mut String) {
    let [left, right, top, bottom] = MARGIN;
    let all = || plot.bins.iter().flatten();
    let x = Scale::of(all().map(|b| b.driver), (left, SIZE.0 - right));
    let y = Scale::of(
        all().flat_map(|b| [b.residual - b.error, b.residual + b.error]).chain([0.0]),
        (SIZE.1 - bottom, top),
    );
    let mut svg = format!(
        "<svg viewBox=\"0 0 {} {}\" width=\"{}\" role=\"img\" aria-label=\"{} against {}\" style=\"max-width:100%;height:auto\">",
        SIZE.0,
        SIZE.1,
        SIZE.0,
        escape(&plot.channel),
        escape(&plot.driver)
    );
    let zero = y.place(0.0);
    let _ = write!(
        svg,
        "<path d=\"M{left} {top}V{:.1}H{:.1}M{left} {zero:.1}H{:.1}\" fill=\"none\" stroke=\"currentColor\" stroke-opacity=\".4\"/>",
        SIZE.1 - bottom,
        SIZE.0 - right,
        SIZE.0 - right
    );
    for v in [x.from, 0.5 * (x.from + x.to), x.to] {
        label(&mut svg, (x.place(v), SIZE.1 - bottom + 16.0), "middle", &number(v));
    }
    for v in [y.from, 0.0, y.to] {
        label(&mut svg, (left - 6.0, y.place(v) + 4.0), "end", &number(v));
    }
    label(&mut svg, (0.5 * (left + SIZE.0), SIZE.1 - 6.0), "middle", &format!("{} (SI)", plot.driver));
    line(&mut svg, plot, (&x, &y));
    for (bins, color) in plot.bins.iter().zip([BEFORE, AFTER]) {
        bins.iter().for_each(|bin| point(&mut svg, bin, color, (&x, &y)));
    }
    svg.push_str("</svg>");
    let _ = write!(
        body,
        "<figure><figcaption>{}, {}: <span style=\"color:{BEFORE}\">given model</span>, <span style=\"color:{AFTER}\">new model</span> \
         <small>{}</small></figcaption>{svg}</figure>",
        escape(&plot.channel),
        plot.unit,
        escape(plot.effect)
    );
}

/// The effect about its mean.
fn line(svg: &mut String, plot: &DriverPlot, (x, y): (&Scale, &Scale)) {
    let before = &plot.bins[0];
    let n = before.len().max(1) as f64;
    let mean = before.iter().map(|b| b.driver).sum::<f64>() / n;
    let level = before.iter().map(|b| b.residual).sum::<f64>() / n;
    let ends = [before.first(), before.last()].map(|b| b.map_or(mean, |b| b.driver));
    let [from, to] = ends.map(|v| (x.place(v), y.place(level + plot.slope * (v - mean))));
    let _ = write!(
        svg,
        "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"{BEFORE}\" stroke-dasharray=\"5 4\" fill=\"none\"/>",
        from.0, from.1, to.0, to.1
    );
}

fn point(svg: &mut String, bin: &Bin, color: Color, (x, y): (&Scale, &Scale)) {
    let at = x.place(bin.driver);
    let _ = write!(
        svg,
        "<path d=\"M{at:.1} {:.1}V{:.1}\" stroke=\"{color}\"/><circle cx=\"{at:.1}\" cy=\"{:.1}\" r=\"3.5\" fill=\"{color}\"/>",
        y.place(bin.residual - bin.error),
        y.place(bin.residual + bin.error),
        y.place(bin.residual)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_has_both_models_and_names_channel_and_driver() {
        let bin = |k: i32, residual: f64| Bin { driver: f64::from(k), residual, error: 0.5 };
        let plot = DriverPlot {
            effect: "formula:gyro~current",
            channel: "gyro z".to_owned(),
            unit: "deg/h",
            driver: "current".to_owned(),
            slope: 2.0,
            bins: [
                (0..14).map(|k| bin(k, 2.0 * f64::from(k))).collect(),
                (0..14).map(|k| bin(k, 0.0)).collect(),
            ],
        };
        let mut body = String::new();
        section(&[plot], &mut body);
        assert_eq!(body.matches("<circle").count(), 28);
        assert!(
            body.contains("gyro z, deg/h") && body.contains("formula:gyro~current") && !body.contains("NaN")
        );
        assert!(
            SIZE.0 <= 358.0,
            "wider than the text of a page of 390 pixels, it would shrink with its letters"
        );
        let mut empty = String::new();
        section(&[], &mut empty);
        assert!(empty.is_empty());
    }
}
