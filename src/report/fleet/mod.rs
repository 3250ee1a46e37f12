//! The page of a fleet: what is out of the ordinary, then for each parameter its flights over time and its units side by side.
//!
//! Each parameter is a section with a drawing of all its flights and a table of its units, complete without scripts. The page's script shows one
//! section at a time and makes an interactive plot of the flights, whose values the page holds once, as JSON.

mod answers;
mod flights;
mod units;

use super::page::{escape, page_with, wide};
use crate::figures::{counted, day, two_figures, with_sigma};
use crate::fleet::family::findings::Finding;
use crate::fleet::family::{FleetStudy, ParameterFamily};
use crate::fleet::log::FleetLog;
use crate::report::plot::span;
use flights::Axis;
use gaware_nav::effects;
use std::collections::BTreeSet;
use std::fmt::Write;

const SCRIPT: &str = include_str!("../assets/fleet.js");
const STYLE: &str = include_str!("../assets/fleet.css");

/// The whole page. `name`: of the fleet's folder.
///
/// # Errors
/// The values of the flights cannot be written.
pub fn html(name: &str, logs: &[FleetLog], study: &FleetStudy) -> Result<String, String> {
    let mut body = String::new();
    head(name, logs, study, &mut body);
    answers::section(logs, study, &mut body);
    let axis = Axis::new(logs, study);
    if !study.family.parameters.is_empty() {
        body.push_str("<h2 id=\"parameters\">Parameters</h2><div id=\"controls\"></div>");
    }
    for k in order(study) {
        section(k, study, &axis, &mut body);
    }
    answers::recurring(&study.family, &mut body);
    answers::failed(logs, &mut body);
    how_to_read(&mut body);
    let data = flights::json(logs, study, &axis)?;
    let _ = write!(body, "<script type=\"application/json\" id=\"fleet\">{data}</script>");
    let title = format!("fleet {}", escape(name));
    Ok(page_with(&title, STYLE, &body, SCRIPT))
}

/// A parameter as in the tables of the fleet: `gyro_g_sensitivity g22`.
fn title(p: &ParameterFamily) -> String {
    format!("{} {}", p.effect, p.name)
}

/// Parameters with findings first, the strongest at the top.
fn order(study: &FleetStudy) -> Vec<usize> {
    let strength = |k: usize| {
        let own = study.findings.iter().filter(|f| f.parameter == k);
        let unlike = study.flights.get(k).into_iter().flatten().filter(|f| f.unlike);
        let found = own.map(|f: &Finding| (f.strength).max(1.0)).fold(0.0, f64::max);
        (found, unlike.map(|f| f.z.abs()).fold(0.0, f64::max))
    };
    let mut all: Vec<usize> = (0..study.family.parameters.len()).collect();
    all.sort_by(|a, b| {
        let (a, b) = (strength(*a), strength(*b));
        b.0.total_cmp(&a.0).then(b.1.total_cmp(&a.1))
    });
    all
}

/// Name, extent and the result in one sentence.
fn head(name: &str, logs: &[FleetLog], study: &FleetStudy, body: &mut String) {
    let family = &study.family;
    let starts: Vec<f64> = logs.iter().filter_map(|l| l.flight()?.start_unix_s).collect();
    let (first, last) = span(starts.iter().copied());
    let dates = match starts.len() {
        0 => "dates not in the logs".to_owned(),
        _ if day(first) == day(last) => day(first),
        _ => format!("{} to {}", day(first), day(last)),
    };
    let failed = logs.iter().filter(|l| l.left_out().is_some()).count();
    let failed =
        if failed > 0 { format!(", <a href=\"#failed\">{failed} left out</a>") } else { String::new() };
    let firmwares: Vec<String> =
        family.firmwares.iter().filter(|f| !f.is_empty()).map(|f| escape(f)).collect();
    let firmwares = match firmwares.len() {
        0 => "firmwares not in the logs".to_owned(),
        1..=6 => format!("firmware {}", firmwares.join(", ")),
        n => format!("{n} firmwares"),
    };
    let _ = write!(
        body,
        "<h1>Fleet {}</h1><p class=\"quiet\">{dates} · {}{failed} · {firmwares} · gaware {}</p><p class=\"verdict\">{}</p>",
        escape(name),
        counted(logs.len(), "log"),
        env!("CARGO_PKG_VERSION"),
        answers::verdict(study)
    );
}

/// One parameter.
fn section(k: usize, study: &FleetStudy, axis: &Axis, body: &mut String) {
    let (Some(p), Some(values)) = (study.family.parameters.get(k), study.flights.get(k)) else { return };
    let title = escape(&title(p));
    let what = effects::find(&p.effect).map_or_else(String::new, |e| format!("; {}", e.description()));
    let found = study.findings.iter().any(|f| f.parameter == k) || values.iter().any(|f| f.unlike);
    let _ = write!(
        body,
        "<section class=\"parameter\" id=\"p{k}\" data-title=\"{title}\" data-found=\"{}\"><h3>{title} <small>{}{what}</small></h3><p>{}</p>",
        u8::from(found),
        escape(&p.unit),
        summary(p)
    );
    let _ = write!(
        body,
        "<figure class=\"chart\"><figcaption><small>{}</small> <span class=\"keys\"></span>\
         <a class=\"csv\" href=\"#p{k}\" download=\"{}.csv\">CSV</a></figcaption><div class=\"area\">{}</div></figure>",
        escape(&p.unit),
        p.name.replace(|c: char| !c.is_ascii_alphanumeric(), "_"),
        axis.still(&title, values)
    );
    body.push_str(&wide(&units::table(study, p, values)));
    body.push_str("</section>");
}

/// Spread, mean and shifts in sentences.
fn summary(p: &ParameterFamily) -> String {
    let unit = escape(&p.unit);
    let mut out = format!(
        "{} of {}. Turn-on spread {} {unit}.",
        counted(p.flights, "flight"),
        counted(p.units.len(), "unit"),
        with_sigma(p.turn_on_spread.value, p.turn_on_spread.sigma)
    );
    if let Some((mean, between)) = p.in_family() {
        let digits = two_figures(mean.sigma);
        let _ = write!(
            out,
            " Mean of the units in family {} {unit}, spread between them {between:.digits$} {unit}.",
            with_sigma(mean.value, mean.sigma)
        );
    }
    for s in p.firmware_shifts.iter().filter(|s| s.significant) {
        let _ = write!(
            out,
            " <b>With firmware {} (after {}): {} {unit}.</b>",
            escape(&s.to),
            escape(&s.from),
            with_sigma(s.shift.value, s.shift.sigma)
        );
    }
    let none: Vec<String> =
        p.firmware_shifts.iter().filter(|s| !s.significant).map(|s| escape(&s.to)).collect();
    if !none.is_empty() {
        let _ = write!(out, " No significant shift with firmware {}.", none.join(", "));
    }
    out
}

fn how_to_read(body: &mut String) {
    body.push_str(
        "<h2>How to read this</h2><p>Each parameter is treated as a value of its inertial unit: a constant part, a turn-on part that differs from flight to \
         flight, and the error that each flight reports. A point is what one flight says, without the prior of its own filter; its bar is 1 sigma. The \
         line is what the unit's flights have in common, with drift and shifts where they are significant. The narrow band is 1 sigma of the constant \
         part, the wide one the turn-on spread. The grey band is the mean of the units in family with the spread between them. A finding is significant at 5 % over \
         the whole fleet (Bonferroni). A flight is marked where it is as far as that from what is expected of it, the turn-on spread included. \
         Units and flights that lack a parameter say too little of it.</p>",
    );
}

/// Names without repetition, in order.
fn distinct<'a>(names: impl Iterator<Item = &'a str>) -> BTreeSet<&'a str> {
    names.collect()
}

#[cfg(test)]
mod tests;
