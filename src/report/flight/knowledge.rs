//! What the flight made known: the matrix and its meaning, how it became known, biases and other effects.

use super::lessons::{self, Lesson};
use super::{AXES, FlightLog, series, words};
use crate::engine::snapshot::{Estimate3, Snapshot, Status, Summary};
use crate::explain::words::number;
use crate::report::page::{escape, table};
use crate::report::plot::{Color, Plot};
use std::fmt::Write;

/// Plots with bands are scaled to what is left of their uncertainty after this share of the flight.
const SETTLED: f64 = 0.5;

/// The matrix, and what it means in flight. Where a state absorbs an unmodelled error no value is shown for it.
pub fn g_sensitivity(s: &Summary, body: &mut String) {
    let g = &s.estimate.g_sensitivity_deg_per_h_per_g;
    let usable = s.implausible.is_empty();
    body.push_str("<h2 id=\"g\">G-sensitivity</h2>");
    body.push_str(if usable {
        "<p>In deg/h/g. Bold: differs from zero by more than 3 sigma. Grey: not converged yet.</p>"
    } else {
        "<p>In deg/h/g. An unmodelled error is absorbed by these states: only the sigmas are shown, no values.</p>"
    });
    let cell = |row: usize, column: usize| {
        let (value, sigma) = (g.value[row][column], g.sigma[row][column]);
        let state = format!("g{}{}", row + 1, column + 1);
        let status = s.observability.states.iter().find(|st| st.name == state).map(|st| st.status);
        let text = format!("{value:.0} ± {sigma:.0}");
        match status {
            Some(_) if !usable => format!("<small>not usable (± {sigma:.0})</small>"),
            Some(_) if value.abs() > words::SURE * sigma => format!("<b>{text}</b>"),
            Some(Status::Observable) => text,
            Some(_) => format!("<small>{text}</small>"),
            None => "<small>not estimated</small>".to_owned(),
        }
    };
    let rows = ["roll (x)", "pitch (y)", "yaw (z)"].into_iter().enumerate();
    let rows = rows.map(|(k, name)| [name.to_owned(), cell(k, 0), cell(k, 1), cell(k, 2)]);
    body.push_str(&table(["gyro", "#forward (x)", "#sideways (y)", "#downward (z)"], rows));
    if !usable {
        return;
    }
    let rows = words::meanings(g, &s.vehicle_type).into_iter().map(|meaning| {
        let [x, y, z] = meaning.error_deg_per_min.map(|(value, sigma)| format!("{value:.1} ± {sigma:.1}"));
        [meaning.when.to_owned(), x, y, z]
    });
    body.push_str("<p>What that means in flight, as an error of each gyro in deg per minute:</p>");
    body.push_str(&table(["against level flight or hover", "#roll", "#pitch", "#yaw"], rows));
}

/// Biases and the parameters of the other effects as numbers.
pub fn bias_table(s: &Summary, body: &mut String) {
    let usable = |name: &str| !s.implausible.iter().any(|n| n == name);
    body.push_str("<h2 id=\"biases\">Biases and other effects</h2>");
    let mut rows = Vec::new();
    let mut row = |effect: &str, name: &str, value: f64, sigma: f64, unit: &str| {
        let text = if usable(name) {
            format!("{} ± {}", number(value), number(sigma))
        } else {
            format!("not usable (± {})", number(sigma))
        };
        rows.push([escape(effect), escape(name), format!("{text} {}", escape(unit))]);
    };
    for (effect, prefix, e, unit) in [
        ("gyro bias", "bg", &s.estimate.gyro_bias_deg_per_h, "deg/h"),
        ("accelerometer bias", "ba", &s.estimate.accel_bias_mg, "mg"),
    ] {
        for (k, axis) in ["x", "y", "z"].iter().enumerate() {
            row(effect, &format!("{prefix}_{axis}"), e.value[k], e.sigma[k], unit);
        }
    }
    for p in &s.estimate.effects {
        row(&p.effect.replace('_', " "), &p.name, p.value, p.sigma, &p.unit);
    }
    body.push_str(&table(["Effect", "Parameter", "#Value"], rows));
}

/// How G became known: over time, what taught most, what is left.
pub fn learning(s: &Summary, log: &FlightLog, lessons: &[Lesson], body: &mut String) -> Result<(), String> {
    let shots = &log.snapshots;
    let estimated = |state: &str| s.observability.states.iter().any(|st| st.name == state);
    body.push_str("<h2 id=\"learning\">How it became observable</h2>");
    for (column, (axis, _)) in AXES.iter().enumerate() {
        let rows: Vec<usize> = (0..3).filter(|r| estimated(&format!("g{}{}", r + 1, column + 1))).collect();
        let names: Vec<String> = rows.iter().map(|r| format!("g{}{}", r + 1, column + 1)).collect();
        let title = format!("G, column {axis}");
        let lines: Vec<Banded<'_>> = rows
            .iter()
            .zip(&names)
            .map(|(r, name)| {
                let r = *r;
                Banded::of(shots, name, AXES[r].1, move |s| {
                    let g = &s.estimate.g_sensitivity_deg_per_h_per_g;
                    (g.value[r][column], g.sigma[r][column])
                })
            })
            .collect();
        body.push_str(&banded(&title, "deg/h/g", &lines)?);
    }
    let rows = lessons.iter().zip(1..).map(|(lesson, k)| {
        let states: Vec<String> = lesson.states.iter().map(|(n, f)| format!("{n} {f:.1}")).collect();
        [
            format!("<b>{k}</b>"),
            format!("<span class=\"t\">{:.0} to {:.0} s</span>", lesson.start_s, lesson.end_s),
            escape(&lesson.did),
            states.join(", "),
        ]
    });
    body.push_str(&table(["", "Time", "What the vehicle did", "Sigma divided by"], rows));
    conditions(s, body);
    states(s, log, body);
    for direction in &s.observability.unobservable_directions {
        let _ = write!(body, "<p>Not observable in this flight: {}</p>", escape(&direction.text));
    }
    if !s.observability.disagreement.is_empty() {
        let _ = write!(body, "<p><small>{}</small></p>", escape(&s.observability.disagreement));
    }
    Ok(())
}

fn conditions(s: &Summary, body: &mut String) {
    let c = &s.observability.conditions;
    let all = [
        ("a", "two independent changes of specific force: attitude and biases", &c.a),
        ("b", "every element of specific force changes: the diagonal of G", &c.b),
        ("c", "three independent changes: all of G", &c.c),
    ];
    let rows = all.into_iter().map(|(name, what, condition)| {
        let state = if condition.met { "met".to_owned() } else { escape(&condition.missing) };
        [format!("({name}) {what}"), state]
    });
    let title = "Observability condition on segments of constant attitude (sufficient, not necessary)";
    body.push_str(&table([title, ""], rows));
}

fn states(s: &Summary, log: &FlightLog, body: &mut String) {
    let since = lessons::known_since(&log.snapshots);
    let rows = s.observability.states.iter().map(|state| {
        let known = since.iter().find(|(name, _)| *name == state.name);
        [
            escape(&state.name),
            number(state.sigma),
            number(state.target),
            escape(&state.unit),
            format!("{:.1} %", 100.0 * state.sigma_ratio),
            known.map_or_else(|| "–".to_owned(), |(_, t)| format!("{t:.0}")),
        ]
    });
    let titles = ["State", "#sigma", "#target", "unit", "#of the sigma at the start", "#converged since, s"];
    body.push_str(&table(titles, rows));
}

/// Biases over time.
pub fn biases(log: &FlightLog, body: &mut String) -> Result<(), String> {
    let shots = &log.snapshots;
    body.push_str("<h2>Biases over time</h2>");
    let gyro: fn(&Snapshot) -> &Estimate3 = |s| &s.estimate.gyro_bias_deg_per_h;
    let accel: fn(&Snapshot) -> &Estimate3 = |s| &s.estimate.accel_bias_mg;
    for (title, unit, of) in [("gyro bias", "deg/h", gyro), ("accelerometer bias", "mg", accel)] {
        let axes = AXES.iter().enumerate();
        let lines = axes.map(|(k, (name, color))| {
            Banded::of(shots, name, color, move |s| (of(s).value[k], of(s).sigma[k]))
        });
        body.push_str(&banded(title, unit, &lines.collect::<Vec<_>>())?);
    }
    Ok(())
}

/// A value with its sigma over time.
struct Banded<'a> {
    name: &'a str,
    color: Color,
    values: Vec<(f64, f64)>,
    sigmas: Vec<(f64, f64)>,
}

impl<'a> Banded<'a> {
    fn of(shots: &[Snapshot], name: &'a str, color: Color, of: impl Fn(&Snapshot) -> (f64, f64)) -> Self {
        let (values, sigmas) = (series(shots, |s| of(s).0), series(shots, |s| of(s).1));
        Self { name, color, values, sigmas }
    }

    /// The largest value with its sigma once half of the flight is over.
    fn reach(&self) -> f64 {
        let from = self.values.last().map_or(0.0, |(t, _)| SETTLED * t);
        let points = self.values.iter().zip(&self.sigmas).filter(|((t, _), _)| *t >= from);
        points.map(|((_, v), (_, sigma))| v.abs() + sigma).fold(0.0, f64::max)
    }
}

fn banded(title: &str, unit: &str, lines: &[Banded<'_>]) -> Result<String, String> {
    let limit = lines.iter().map(Banded::reach).fold(0.0, f64::max);
    if limit <= 0.0 {
        return Ok(String::new());
    }
    let mut plot = Plot::new(title, unit).within(1.2 * limit);
    for line in lines {
        let band = line.values.iter().zip(&line.sigmas).map(|((t, v), (_, s))| (*t, v - s, v + s)).collect();
        plot = plot.band(line.color, band).line(line.name, line.color, line.values.clone());
    }
    plot.svg()
}
