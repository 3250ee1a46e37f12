//! The flights of each parameter over time: a drawing that needs no script, and the values for the interactive plot.

use super::title;
use crate::figures::day;
use crate::fleet::family::{FleetStudy, FlightValue};
use crate::fleet::log::FleetLog;
use crate::report::plot::{grid, short, span, ticks};
use serde::Serialize;
use std::fmt::Write;

/// Where flights are on the horizontal axis: at their dates, or at their numbers within their units where one of them has no date, or all
/// have the same (a simulator's, or a clock that was never set).
pub struct Axis {
    /// Whether it is time.
    pub(super) dated: bool,
    /// Of each log: s since 1970, or its number.
    at: Vec<f64>,
    first: f64,
    last: f64,
}

impl Axis {
    /// The axis of a fleet.
    pub fn new(logs: &[FleetLog], study: &FleetStudy) -> Self {
        let counted = |log: &FleetLog| log.flight().is_some() && log.unit().is_some();
        let start = |log: &FleetLog| log.flight().and_then(|f| f.start_unix_s);
        let starts: Vec<Option<f64>> = logs.iter().filter(|l| counted(l)).map(start).collect();
        let same = starts.len() > 1 && starts.iter().all(|s| Some(s) == starts.first());
        let dated = starts.iter().all(Option::is_some) && !same;
        let mut flown = vec![0.0; study.family.units.len()];
        let at: Vec<f64> = logs
            .iter()
            .map(|log| {
                if dated {
                    return start(log).unwrap_or(f64::NAN);
                }
                let unit = log.unit().and_then(|u| study.family.units.iter().position(|name| name == u));
                let Some(number) = unit.filter(|_| counted(log)).and_then(|u| flown.get_mut(u)) else {
                    return f64::NAN;
                };
                *number += 1.0;
                *number
            })
            .collect();
        let (first, last) = span(at.iter().copied());
        Self { dated, at, first, last }
    }

    fn of(&self, log: usize) -> f64 {
        self.at.get(log).copied().unwrap_or(f64::NAN)
    }

    /// Positions with their labels, at most five.
    fn labels(&self) -> Vec<(f64, String)> {
        if self.dated {
            let step = (self.last - self.first) / 4.0;
            let count = if step > 0.0 { 5 } else { 1 };
            return (0..count).map(|k| self.first + f64::from(k) * step).map(|t| (t, day(t))).collect();
        }
        ticks([self.first, self.last.max(self.first + 1.0)]).into_iter().map(|n| (n, short(n))).collect()
    }

    /// All flights of a parameter without scripts: points with bars of 1 sigma, those unlike the others of their unit with a ring. Bars end
    /// where the drawing does.
    pub fn still(&self, title: &str, values: &[FlightValue]) -> String {
        let (low, high) = span(values.iter().map(|f| f.value));
        let margin = 0.08 * (high - low).max(f64::MIN_POSITIVE);
        let (low, high) = if high > low { (low - margin, high + margin) } else { (low - 0.5, low + 0.5) };
        let px = |t: f64| {
            75.0 + 770.0 * (t - self.first + 0.5 * self.pad()) / (self.last - self.first + self.pad())
        };
        let py = |v: f64| 12.0 + 176.0 * (high - v.clamp(low, high)) / (high - low);
        let mut out = format!(
            "<svg role=\"img\" viewBox=\"0 0 860 216\" font-family=\"sans-serif\" font-size=\"15\" fill=\"currentColor\"><title>{title}</title>"
        );
        grid(&mut out, [low, high], (70, 850), py);
        for (t, label) in self.labels() {
            let _ = write!(
                out,
                "<text x=\"{:.1}\" y=\"208\" text-anchor=\"middle\">{label}</text>",
                px(t).clamp(112.0, 808.0)
            );
        }
        let (mut bars, mut points, mut rings) = (String::new(), String::new(), String::new());
        for f in values {
            let (x, y) = (px(self.of(f.log)), py(f.value));
            let _ = write!(bars, "M{x:.0} {:.0}V{:.0}", py(f.value - f.sigma), py(f.value + f.sigma));
            let _ = write!(points, "M{x:.0} {y:.0}h0");
            if f.unlike {
                let _ = write!(rings, "M{:.0} {y:.0}a6 6 0 1 0 12 0a6 6 0 1 0 -12 0", x - 6.0);
            }
        }
        let _ = write!(
            out,
            "<g fill=\"none\"><path d=\"{bars}\" stroke=\"#2a82be\" stroke-opacity=\".35\"/><path d=\"{points}\" stroke=\"#2a82be\" stroke-width=\"5\" \
             stroke-linecap=\"round\"/><path d=\"{rings}\" stroke=\"#d6604d\" stroke-width=\"2\"/></g></svg>"
        );
        out
    }

    /// Free space at both ends together.
    fn pad(&self) -> f64 {
        let range = self.last - self.first;
        if range > 0.0 { 0.04 * range } else { 1.0 }
    }
}

/// What the script makes plots of.
#[derive(Serialize)]
struct Data<'a> {
    dated: bool,
    units: &'a [String],
    firmwares: &'a [String],
    /// Of the logs that count: path, index of the firmware (null where it is not known), place on the axis; null for others.
    flights: Vec<Option<(&'a str, Option<usize>, f64)>>,
    parameters: Vec<Parameter<'a>>,
}

#[derive(Serialize)]
struct Parameter<'a> {
    title: String,
    unit: &'a str,
    spread: f64,
    /// Mean of the units in family, spread between them.
    family: Option<[f64; 2]>,
    /// Index of the unit, constant part, its sigma.
    constants: Vec<(usize, f64, f64)>,
    /// Units with findings.
    stands: Vec<usize>,
    /// Log, unit, value, sigma, expected value, whether it is unlike the others (0 or 1).
    values: Vec<(usize, usize, f64, f64, f64, u8)>,
}

/// The values of all flights as JSON that may stand within a page.
///
/// # Errors
/// It cannot be written.
pub fn json(logs: &[FleetLog], study: &FleetStudy, axis: &Axis) -> Result<String, String> {
    let family = &study.family;
    let flights = logs.iter().enumerate().map(|(k, log)| {
        let at = axis.of(k);
        let firmware = log.firmware().filter(|f| !f.is_empty());
        let firmware = firmware.and_then(|f| family.firmwares.iter().position(|name| name == f));
        at.is_finite().then_some((log.path.as_str(), firmware, at))
    });
    let parameters = family.parameters.iter().zip(&study.flights).map(|(p, values)| {
        let index = |unit: &str| family.units.iter().position(|name| name == unit).unwrap_or_default();
        let stands = p.units.iter().filter(|u| u.out_of_family || u.drifts || u.scatters_more);
        Parameter {
            title: title(p),
            unit: &p.unit,
            spread: six(p.turn_on_spread.value),
            family: p.in_family().map(|(mean, between)| [six(mean.value), six(between)]),
            constants: p
                .units
                .iter()
                .map(|u| (index(&u.unit), six(u.constant.value), six(u.constant.sigma)))
                .collect(),
            stands: stands.map(|u| index(&u.unit)).collect(),
            values: values
                .iter()
                .map(|f| (f.log, f.unit, six(f.value), six(f.sigma), six(f.expected), u8::from(f.unlike)))
                .collect(),
        }
    });
    let data = Data {
        dated: axis.dated,
        units: &family.units,
        firmwares: &family.firmwares,
        flights: flights.collect(),
        parameters: parameters.collect(),
    };
    // Names of others may hold the end of a script.
    serde_json::to_string(&data).map(|text| text.replace('<', "\\u003c")).map_err(|e| e.to_string())
}

/// Six significant figures: a plot shows no more.
fn six(v: f64) -> f64 {
    format!("{v:.5e}").parse().unwrap_or(v)
}
