//! The evidence: NIS and RMS innovations before and after, innovations over time and their spectra, residuals of the smoothed
//! trajectory by place and by what the vehicle did.

use super::{channel_unit, escape, spoken};
use crate::explain::contract::Explanation;
use crate::explain::words::number;
use crate::explain::{Explained, FlightResiduals};
use crate::report::page::table;
use crate::report::plot::{AFTER, BEFORE, Plot};
use crate::report::{heat, spectrum};
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::identify::judge::Judged;
use gaware_nav::identify::pass::CHANNELS;
use gaware_nav::identify::residual::Motion;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Colour of large residuals on a map.
const LARGE: &str = "#d6604d";
/// What a vehicle does for more than this share of a flight distinguishes nothing.
const USUAL: f64 = 0.6;
/// Rows of the table of regimes at most.
const REGIMES_SHOWN: usize = 12;

/// NIS, RMS innovations and position error without fixes, by both models.
pub fn before_and_after(e: &Explanation, body: &mut String) {
    let Some(residual) = &e.residual else { return };
    body.push_str("<h2 id=\"residuals\">Residuals before and after</h2>");
    let mut rows = Vec::new();
    let mut row = |name: &str, before: f64, after: f64| {
        rows.push([escape(name), number(before), number(after)]);
    };
    row("NIS per degree of freedom, held-out data", residual.held_out.before, residual.held_out.after);
    row("NIS per degree of freedom, fitted data", residual.fit.before, residual.fit.after);
    for c in &residual.held_out_channels {
        let name = format!(
            "RMS innovation {}, held-out data, {}",
            c.channel.replace('_', " "),
            channel_unit(c.channel)
        );
        row(&name, c.rms.before, c.rms.after);
    }
    let mut drifts: Vec<_> = residual.drift_m.iter().collect();
    drifts.sort_by_key(|(time, _)| time.split('_').next().and_then(|t| t.parse::<u32>().ok()));
    for (time, drift) in drifts {
        let name = format!("RMS position error after {} without fixes, m", time.replace('_', " "));
        row(&name, drift.before, drift.after);
    }
    body.push_str(&table(["", "#Given model", "#New model"], rows));
}

/// What is lost without each effect.
pub fn contributions(e: &Explanation, body: &mut String) {
    if e.leave_one_out.is_empty() {
        return;
    }
    body.push_str("<h2>Contribution of each effect</h2>");
    let rows = e.leave_one_out.iter().map(|l| {
        let [evidence, held_out] = [l.evidence, l.held_out_log_likelihood].map(|v| format!("{v:.1}"));
        [l.name.to_owned(), evidence, held_out]
    });
    let titles = ["Left out", "#Loss of log Bayes factor", "#Loss of held-out log-likelihood"];
    body.push_str(&table(titles, rows));
}

/// Means over seconds.
fn by_second(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut seconds: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
    for (t_s, value) in points {
        let cell = seconds.entry(t_s as i64).or_default();
        *cell = (cell.0 + value, cell.1 + 1.0);
    }
    seconds.into_iter().map(|(t, (sum, n))| (t as f64, sum / n)).collect()
}

/// Normalised innovations of a channel by the given model (0) or the new one (1).
fn of(judged: &Judged, model: usize, c: usize) -> Vec<(f64, f64)> {
    judged.innovations[model].iter().filter_map(|i| Some((i.elapsed_s, i.channel(c)?))).collect()
}

/// The given model and, where anything was added, the new one.
fn models(judged: &Judged) -> &'static [(usize, &'static str, &'static str)] {
    let all: &[_] = &[(0, "given model", BEFORE), (1, "new model", AFTER)];
    if judged.selection.added.is_empty() { &all[..1] } else { all }
}

/// Innovations over time.
pub fn innovations(judged: &Judged, body: &mut String) -> Result<(), String> {
    body.push_str(
        "<h2>Innovations</h2><p><small>Normalised innovations of the first log, mean of each second; the band is one sigma of a single \
         innovation. Drag to zoom, double click for all.</small></p>",
    );
    for (c, name) in CHANNELS.iter().enumerate() {
        let title = name.replace('_', " ");
        let mut plot = Plot::new(&title, "sigma").expected(1.0);
        for (k, label, color) in models(judged) {
            plot = plot.line(label, color, by_second(of(judged, *k, c).into_iter()));
        }
        body.push_str(&plot.svg()?);
    }
    Ok(())
}

/// Spectra of the innovations.
pub fn spectra(judged: &Judged, body: &mut String) -> Result<(), String> {
    let mut plots = String::new();
    for (c, name) in CHANNELS.iter().enumerate() {
        let title = format!("spectrum, {}", name.replace('_', " "));
        let mut plot = Plot::new(&title, "dB re white noise").over_frequency();
        for (k, label, color) in models(judged) {
            plot = plot.line(label, color, spectrum::decibels(&of(judged, *k, c)));
        }
        plots.push_str(&plot.svg()?);
    }
    if !plots.is_empty() {
        let _ = write!(
            body,
            "<h2>Spectra of the innovations</h2><p><small>Power spectral density of the normalised innovations (Welch). Under a right \
             model they are white: 0 dB at every frequency. Excess at low frequencies: correlated or slowly varying \
             errors.</small></p>{plots}"
        );
    }
    Ok(())
}

/// Where in the flight residuals are large, and what they correlate with.
pub fn whereabouts(explained: &Explained, body: &mut String) -> Result<(), String> {
    let e = &explained.explanation;
    for (k, residual) in explained.residuals.iter().enumerate() {
        let log = explained.logs.get(k).filter(|_| explained.logs.len() > 1).map_or("", String::as_str);
        maps(residual, log, k == 0, !e.effects.is_empty(), body)?;
    }
    places(e, &explained.logs, body);
    regimes(e, body);
    terms(e, body);
    Ok(())
}

/// What the vehicle did, and where the residuals are large.
fn maps(
    residual: &FlightResiduals,
    log: &str,
    first: bool,
    changed: bool,
    body: &mut String,
) -> Result<(), String> {
    if residual.before.is_empty() {
        return Ok(());
    }
    let _ = write!(
        body,
        "<h2{}>Where in the flight{}</h2><p><small>Residuals of the sensors simulated along the smoothed trajectory. Blank: within \
         noise. The stronger the colour, the larger the mean squared normalised residual.</small></p>",
        if first { " id=\"where\"" } else { "" },
        if log.is_empty() { String::new() } else { format!(" ({})", escape(log)) }
    );
    let series = |of: &dyn Fn(&Motion) -> f64| {
        by_second(residual.before.iter().map(|p| (p.motion.elapsed_s, of(&p.motion))))
    };
    let load = series(&|m| -m.force.z / STANDARD_GRAVITY);
    let speed = series(&|m| m.speed);
    body.push_str(&Plot::new("speed over ground", "m/s").line("speed", AFTER, speed).since(0.0).svg()?);
    body.push_str(&Plot::new("load", "g").line("load", AFTER, load).since(0.0).close().svg()?);
    body.push_str(&heat::map("given model", &residual.before, LARGE));
    if changed {
        body.push_str(&heat::map("new model", &residual.after, LARGE));
    }
    Ok(())
}

fn places(e: &Explanation, logs: &[String], body: &mut String) {
    if e.places.is_empty() {
        return;
    }
    body.push_str("<h2>Largest residuals of the given model</h2>");
    let rows = e.places.iter().map(|p| {
        let log = match logs.get(p.log).filter(|_| logs.len() > 1) {
            Some(log) => format!(" <small>({})</small>", escape(log)),
            None => String::new(),
        };
        [
            p.channel.replace('_', " ") + &log,
            format!("<span class=\"t\">{:.0} to {:.0} s</span>", p.t_start_s, p.t_end_s),
            escape(&p.regime),
            format!("{:.0} %", 100.0 * p.share),
        ]
    });
    body.push_str(&table(["Channel", "Time", "What the vehicle did", "#Share of the excess"], rows));
}

fn regimes(e: &Explanation, body: &mut String) {
    let mut worst: Vec<_> =
        e.regimes.iter().filter(|r| (0.02..USUAL).contains(&r.share) && r.nis.before > 2.0).collect();
    if worst.is_empty() {
        return;
    }
    worst.sort_by(|a, b| (b.nis.before * (1.0 - b.share)).total_cmp(&(a.nis.before * (1.0 - a.share))));
    body.push_str("<h2>Residuals by flight regime</h2><p><small>Mean squared normalised residual; 1 is expected.</small></p>");
    let rows = worst.into_iter().take(REGIMES_SHOWN).map(|r| {
        [
            r.channel.replace('_', " "),
            escape(&r.regime),
            format!("{:.0} %", 100.0 * r.share),
            number(r.nis.before),
            number(r.nis.after),
        ]
    });
    let titles = ["Channel", "Regime", "#Share of the flight", "#Given model", "#New model"];
    body.push_str(&table(titles, rows));
}

fn terms(e: &Explanation, body: &mut String) {
    if e.unexplained_terms.is_empty() {
        return;
    }
    body.push_str("<h2>Residuals that no effect of the catalogue explains</h2>");
    let rows = e.unexplained_terms.iter().map(|t| {
        let coefficient = format!("{} ± {} {}", number(t.coefficient), number(t.sigma), escape(&t.unit));
        [t.channel.replace('_', " "), escape(&spoken(t.term)), coefficient]
    });
    body.push_str(&table(["Channel", "Correlates with", "#Coefficient"], rows));
}
