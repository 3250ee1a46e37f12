//! The units of one parameter side by side: a table with a forest plot (Lewis & Clarke 2001), each unit's constant part on one common scale.

use crate::figures::with_sigma;
use crate::fleet::family::{Estimated, FleetStudy, FlightValue, ParameterFamily, UnitFamily};
use crate::report::page::escape;
use crate::report::plot::{short, span};
use gaware_nav::math::{log10, powf};
use std::fmt::Write;

/// Width and height of the drawing of one unit, px.
const WIDTH: f64 = 180.0;
const HEIGHT: f64 = 22.0;

/// The common scale of a table.
struct Scale {
    low: f64,
    high: f64,
    /// Mean of the units in family, spread between them.
    family: Option<(f64, f64)>,
}

impl Scale {
    fn new(p: &ParameterFamily) -> Self {
        let spread = p.turn_on_spread.value;
        let units = p.units.iter().map(|u| (u.constant.value, u.constant.sigma.max(spread)));
        let family = p.in_family().map(|(mean, between)| (mean.value, between));
        let (low, high) = span(units.chain(family).flat_map(|(v, s)| [v - s, v + s]));
        let (low, high) = if high > low { (low, high) } else { (low - 0.5, low + 0.5) };
        Self { low, high, family }
    }

    fn px(&self, v: f64) -> f64 {
        (2.0 + (WIDTH - 4.0) * (v - self.low) / (self.high - self.low)).clamp(0.0, WIDTH)
    }

    /// A bar about a value, at least as wide as this.
    fn bar(&self, about: f64, half: f64, least: f64) -> (f64, f64) {
        let (from, to) = (self.px(about - half), self.px(about + half));
        let widen = (0.5 * (least - (to - from))).max(0.0);
        (from - widen, to - from + 2.0 * widen)
    }
}

/// A column: heading, whether it holds numbers, what it means.
type Column = (&'static str, bool, &'static str);
const COLUMNS: [Column; 7] = [
    ("Unit", false, "Inertial unit"),
    ("Constant part", true, "What the flights of the unit have in common, with 1 sigma"),
    (
        "From the others",
        true,
        "Distance of the constant part from those of the other units, in their standard deviations",
    ),
    ("Drift per year", true, "With 1 sigma; bold where it is significant"),
    ("Scatter", true, "From flight to flight, as a multiple of what turn-on spread and sigmas make"),
    ("Flights", true, "Flights that say enough of the parameter"),
    ("Next flight", true, "What is expected of it, with 1 sigma that includes the turn-on spread"),
];

/// The table of the units of one parameter.
pub fn table(study: &FleetStudy, p: &ParameterFamily, values: &[FlightValue]) -> String {
    let scale = Scale::new(p);
    let mut out = "<table class=\"units\"><thead><tr>".to_owned();
    for (k, (name, number, meaning)) in COLUMNS.iter().enumerate() {
        let class = if *number { " class=\"n\"" } else { "" };
        let _ = write!(out, "<th{class} title=\"{meaning}\">{name}</th>");
        if k == 0 {
            let _ = write!(
                out,
                "<th class=\"forest\"><span>{}</span><span>{}</span></th>",
                short(rounded(scale.low, scale.high - scale.low)),
                short(rounded(scale.high, scale.high - scale.low))
            );
        }
    }
    out.push_str("</tr></thead><tbody>");
    for u in &p.units {
        row(study, p, u, values, &scale, &mut out);
    }
    out.push_str("</tbody></table>");
    out
}

/// To a hundredth of a range.
fn rounded(value: f64, range: f64) -> f64 {
    let step = powf(10_f64, log10(range).floor() - 2.0);
    if step.is_normal() { (value / step).round() * step } else { value }
}

fn row(
    study: &FleetStudy,
    p: &ParameterFamily,
    u: &UnitFamily,
    values: &[FlightValue],
    scale: &Scale,
    out: &mut String,
) {
    let index = study.family.units.iter().position(|name| *name == u.unit).unwrap_or_default();
    let scatter = scatter(values, index, u);
    let found = u.out_of_family || u.drifts || u.scatters_more;
    let _ = write!(
        out,
        "<tr{}><td data-v=\"{index}\"><a href=\"#parameters\" data-unit=\"{index}\">{}</a></td><td class=\"forest\">{}</td>",
        if found { " class=\"stands\"" } else { "" },
        escape(&u.unit),
        forest(p, u, scale)
    );
    let mut cell = |value: Option<f64>, bold: bool, text: String| {
        let text = if value.is_none() { "–".to_owned() } else { text };
        let (open, close) = if bold { ("<b>", "</b>") } else { ("", "") };
        let value = value.map_or_else(String::new, |v| format!(" data-v=\"{}\"", short(v)));
        let _ = write!(out, "<td class=\"n\"{value}>{open}{text}{close}</td>");
    };
    let both = |e: Estimated| with_sigma(e.value, e.sigma).replace(' ', "\u{a0}");
    cell(Some(u.constant.value), false, both(u.constant));
    cell(u.family_t, u.out_of_family, format!("{:+.1}", u.family_t.unwrap_or_default() + 0.0));
    cell(u.drift_per_year.map(|d| d.value), u.drifts, u.drift_per_year.map_or_else(String::new, both));
    cell(scatter, u.scatters_more, format!("{:.1}", scatter.unwrap_or_default()));
    cell(Some(u.flights as f64), false, u.flights.to_string());
    cell(Some(u.next_flight.value), false, both(u.next_flight));
    out.push_str("</tr>");
}

/// Root of the squares of a unit's flights over their degrees of freedom; 1 is that of the fleet.
pub fn scatter(values: &[FlightValue], unit: usize, u: &UnitFamily) -> Option<f64> {
    let squares: f64 = values.iter().filter(|f| f.unit == unit).map(|f| f.z * f.z).sum();
    let freedom = u.flights.checked_sub(1 + usize::from(u.drifts))?;
    (freedom > 0).then(|| (squares / freedom as f64).sqrt())
}

/// Family as a band with its mean, turn-on spread as a thin line, 1 sigma of the constant part as a thick one.
fn forest(p: &ParameterFamily, u: &UnitFamily, scale: &Scale) -> String {
    let mut out = format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" role=\"presentation\">"
    );
    if let Some((mean, between)) = scale.family {
        let (from, width) = scale.bar(mean, between, 1.0);
        let _ = write!(
            out,
            "<path class=\"g\" d=\"M{from:.1} 0h{width:.1}v{HEIGHT}h-{width:.1}z\"/><path class=\"m\" d=\"M{:.1} 0v{HEIGHT}\"/>",
            scale.px(mean)
        );
    }
    let (from, width) = scale.bar(u.constant.value, p.turn_on_spread.value, 0.0);
    let _ = write!(out, "<path class=\"t\" d=\"M{from:.1} 11h{width:.1}\"/>");
    let (from, width) = scale.bar(u.constant.value, u.constant.sigma, 4.0);
    let _ = write!(out, "<path class=\"s\" d=\"M{from:.1} 11h{width:.1}\"/></svg>");
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_a_scale_have_as_many_places_as_its_range_needs() {
        assert_eq!([rounded(123.456, 20.0), rounded(-0.012_345, 0.04)].map(short), ["123.5", "-0.0123"]);
        assert_eq!(rounded(1.0, 0.0), 1.0);
    }
}
