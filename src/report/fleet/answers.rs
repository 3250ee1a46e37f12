//! The first screen: the result in a sentence, and what is out of the ordinary, each with a link to its plot.

use super::{counted, distinct, title, units};
use crate::fleet::family::findings::{Finding, Kind};
use crate::fleet::family::{Family, FleetStudy, FlightValue};
use crate::fleet::log::FleetLog;
use crate::report::page::{answers, escape, wide};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// Items of an answer that are shown at once; the others unfold.
const SHOWN: usize = 5;

/// The result in words.
pub fn verdict(study: &FleetStudy) -> String {
    let family = &study.family;
    if family.units.is_empty() {
        return "No log names its inertial unit: give a rule for names, such as <code>--names '{unit}/*'</code>."
            .to_owned();
    }
    let fleet =
        format!("{} of {}", counted(family.flights, "flight"), counted(family.units.len(), "inertial unit"));
    let firmwares = family.firmwares.iter().filter(|f| !f.is_empty()).count();
    let with =
        if firmwares > 0 { format!(" with {}", counted(firmwares, "firmware")) } else { String::new() };
    if family.parameters.is_empty() {
        return format!("{fleet}{with}: they say too little of every parameter.");
    }
    let of = |kind| study.findings.iter().filter(|f| f.kind == kind).count();
    let counts = [
        (of(Kind::OutOfFamily), "value out of family", "values out of family"),
        (of(Kind::Firmware), "shift with a firmware", "shifts with a firmware"),
        (of(Kind::Drift), "drift", "drifts"),
        (of(Kind::Scatter), "larger scatter", "larger scatters"),
        (
            unlike(study).len(),
            "flight unlike the others of its unit",
            "flights unlike the others of their unit",
        ),
        (come_and_go(family).len(), "effect that comes and goes", "effects that come and go"),
    ];
    let found: Vec<String> = counts
        .into_iter()
        .filter(|(n, ..)| *n > 0)
        .map(|(n, one, more)| format!("{n} {}", if n == 1 { one } else { more }))
        .collect();
    if found.is_empty() {
        format!("{fleet}{with}: nothing stands out.")
    } else {
        format!("{fleet}{with}: {}.", found.join(", "))
    }
}

/// What a flight-test department asks first.
pub fn section(logs: &[FleetLog], study: &FleetStudy, body: &mut String) {
    if study.family.parameters.is_empty() {
        return;
    }
    body.push_str(&answers(&[
        ("Units out of family", findings(study, Kind::OutOfFamily)),
        ("Shifts with a firmware", findings(study, Kind::Firmware)),
        ("Drifts", findings(study, Kind::Drift)),
        ("Units that scatter more", findings(study, Kind::Scatter)),
        ("Flights unlike the others", unlike_flights(logs, study)),
        ("Effects that come and go", effects(logs, &study.family)),
    ]));
}

/// The findings of a kind, the strongest first.
fn findings(study: &FleetStudy, kind: Kind) -> String {
    let mut own: Vec<&Finding> = study.findings.iter().filter(|f| f.kind == kind).collect();
    own.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    list(own.into_iter().filter_map(|f| item(study, f)).collect())
}

fn item(study: &FleetStudy, f: &Finding) -> Option<String> {
    let what = escape(&title(study.family.parameters.get(f.parameter)?));
    let index = f.unit.as_ref().and_then(|unit| study.family.units.iter().position(|u| u == unit));
    // A unit out of family shows among the others, a shift as the difference from what each unit has.
    let view = match (f.kind, index) {
        (Kind::OutOfFamily, Some(u)) => format!(" data-mark=\"{u}\""),
        (_, Some(u)) => format!(" data-unit=\"{u}\""),
        (_, None) => " data-relative=\"1\"".to_owned(),
    };
    let unit = f.unit.as_ref().map_or_else(String::new, |u| format!("{}, ", escape(u)));
    let size = match f.kind {
        Kind::Scatter => scatter(study, f.parameter, index),
        _ => Some(escape(&f.size)),
    };
    let size = size.map_or_else(String::new, |size| format!(": {size}"));
    Some(format!("<a href=\"#p{}\"{view}>{unit}{what}</a>{size}", f.parameter))
}

/// How much more a unit scatters, in words.
fn scatter(study: &FleetStudy, parameter: usize, unit: Option<usize>) -> Option<String> {
    let own = study.family.parameters.get(parameter)?.units.iter();
    let index = unit?;
    let unit = own.into_iter().find(|u| Some(&u.unit) == study.family.units.get(index))?;
    let ratio = units::scatter(study.flights.get(parameter)?, index, unit)?;
    Some(format!("{ratio:.1} times what turn-on spread and sigmas make"))
}

/// Flights that are unlike the others of their unit, with the parameters in which they are, the farthest first.
fn unlike(study: &FleetStudy) -> BTreeMap<usize, Vec<(usize, FlightValue)>> {
    let mut out: BTreeMap<usize, Vec<(usize, FlightValue)>> = BTreeMap::new();
    for (k, values) in study.flights.iter().enumerate() {
        for value in values.iter().filter(|f| f.unlike) {
            out.entry(value.log).or_default().push((k, *value));
        }
    }
    out.values_mut().for_each(|own| own.sort_by(|a, b| b.1.z.abs().total_cmp(&a.1.z.abs())));
    out
}

fn unlike_flights(logs: &[FleetLog], study: &FleetStudy) -> String {
    let mut flights: Vec<_> = unlike(study).into_iter().collect();
    let farthest = |own: &[(usize, FlightValue)]| own.first().map_or(0.0, |(_, f)| f.z.abs());
    flights.sort_by(|a, b| farthest(&b.1).total_cmp(&farthest(&a.1)));
    let flight = |(log, own): (usize, Vec<(usize, FlightValue)>)| {
        let (k, first) = own.first()?;
        let what = title(study.family.parameters.get(*k)?);
        let others = match own.len() - 1 {
            0 => String::new(),
            1 => " and one other".to_owned(),
            n => format!(" and {n} others"),
        };
        Some(format!(
            "<a href=\"#p{k}\" data-unit=\"{}\" data-log=\"{log}\">{}</a>: {}{others}, {:.1} standard deviations from the others of {}",
            first.unit,
            escape(&logs.get(log)?.path),
            escape(&what),
            first.z.abs(),
            escape(study.family.units.get(first.unit)?)
        ))
    };
    list(flights.into_iter().filter_map(flight).collect())
}

/// An effect that explain identified in some flights of the units and not in others.
struct ComesAndGoes<'a> {
    effect: &'a str,
    identified: usize,
    /// Units in whose flights it comes and goes, those with the most first.
    units: Vec<(&'a str, usize, usize)>,
    firmwares: BTreeSet<&'a str>,
}

fn come_and_go(family: &Family) -> Vec<ComesAndGoes<'_>> {
    let mut out: Vec<ComesAndGoes<'_>> = Vec::new();
    for effect in distinct(family.recurring.iter().map(|r| r.effect.as_str())) {
        let own: Vec<_> =
            family.recurring.iter().filter(|r| r.effect == effect && r.identified < r.explained).collect();
        let mut units: Vec<(&str, usize, usize)> =
            own.iter().map(|r| (r.unit.as_str(), r.identified, r.explained)).collect();
        units.sort_by(|a, b| (b.1 * a.2).cmp(&(a.1 * b.2)));
        if !units.is_empty() {
            out.push(ComesAndGoes {
                effect,
                identified: units.iter().map(|u| u.1).sum(),
                units,
                firmwares: distinct(own.iter().flat_map(|r| r.firmwares.iter().map(String::as_str))),
            });
        }
    }
    out.sort_by_key(|e| std::cmp::Reverse(e.identified));
    out
}

fn effects(logs: &[FleetLog], family: &Family) -> String {
    if logs.iter().filter_map(FleetLog::flight).all(|f| f.explanation.is_none()) {
        return "not tested: explain was left out (--no-explain)".to_owned();
    }
    if family.recurring.is_empty() {
        return "no effect was identified in any flight".to_owned();
    }
    let known = family.firmwares.iter().filter(|f| !f.is_empty()).count();
    let effect = |e: ComesAndGoes<'_>| {
        let some: Vec<String> =
            e.units.iter().take(3).map(|(unit, n, of)| format!("{} {n} of {of}", escape(unit))).collect();
        let more = e.units.len().saturating_sub(3);
        let more = if more > 0 { format!(", {}", counted(more, "more unit")) } else { String::new() };
        let only = match e.firmwares.iter().next() {
            Some(firmware) if e.firmwares.len() == 1 && known > 1 => {
                format!("; with firmware {} alone", escape(firmware))
            }
            _ => String::new(),
        };
        format!(
            "<a href=\"#effects\">{}</a> in {} of {} ({}{more}){only}",
            escape(e.effect),
            counted(e.identified, "flight"),
            counted(e.units.len(), "unit"),
            some.join(", ")
        )
    };
    list(come_and_go(family).into_iter().map(effect).collect())
}

/// A list whose end unfolds.
fn list(items: Vec<String>) -> String {
    let rows = |items: &[String]| items.iter().map(|i| format!("<li>{i}</li>")).collect::<String>();
    match items.split_at_checked(SHOWN + 1) {
        _ if items.is_empty() => "none".to_owned(),
        Some((_, rest)) if !rest.is_empty() => {
            let (first, rest) = items.split_at_checked(SHOWN).unwrap_or_default();
            format!(
                "<ul class=\"found\">{}</ul><details><summary>{} more</summary><ul class=\"found\">{}</ul></details>",
                rows(first),
                rest.len(),
                rows(rest)
            )
        }
        _ => format!("<ul class=\"found\">{}</ul>", rows(&items)),
    }
}

/// How often each effect was identified in the flights of each unit.
pub fn recurring(family: &Family, body: &mut String) {
    if family.recurring.is_empty() {
        return;
    }
    let effects = distinct(family.recurring.iter().map(|r| r.effect.as_str()));
    let mut cells: BTreeMap<(&str, &str), (usize, usize)> = BTreeMap::new();
    let mut explained: BTreeMap<&str, usize> = BTreeMap::new();
    for r in &family.recurring {
        cells.insert((&r.unit, &r.effect), (r.identified, r.explained));
        explained.insert(&r.unit, r.explained);
    }
    let mut table = "<table class=\"counts\"><tr><th>Unit</th>".to_owned();
    effects.iter().for_each(|e| {
        let _ = write!(table, "<th class=\"n\">{}</th>", escape(e));
    });
    table.push_str("<th class=\"n\">flights explained</th></tr>");
    for (unit, flights) in explained {
        let _ = write!(table, "<tr><th>{}</th>", escape(unit));
        for effect in &effects {
            let n = cells.get(&(unit, *effect)).map_or(0, |(n, _)| *n);
            let share = 0.45 * n as f64 / flights.max(1) as f64;
            let text = if n == 0 { "–".to_owned() } else { n.to_string() };
            let _ = write!(table, "<td class=\"n\" style=\"--share:{share:.2}\">{text}</td>");
        }
        let _ = write!(table, "<td class=\"n\">{flights}</td></tr>");
    }
    table.push_str("</table>");
    body.push_str("<h2 id=\"effects\">Identified effects by unit</h2><p>In how many flights explain identified each effect. An effect that is in all flights of a unit is a property of it; one that comes and goes has another cause.</p>");
    body.push_str(&wide(&table));
}

/// Every log that is left out, with its reason.
pub fn failed(logs: &[FleetLog], body: &mut String) {
    let failed: Vec<String> = logs
        .iter()
        .filter_map(|l| Some(format!("<li>{}: {}</li>", escape(&l.path), escape(l.left_out()?))))
        .collect();
    if !failed.is_empty() {
        let _ = write!(
            body,
            "<h2 id=\"failed\">Logs that are in no figure above</h2><details{}><summary>{}</summary><ul>{}</ul></details>",
            if failed.len() <= SHOWN { " open" } else { "" },
            counted(failed.len(), "log"),
            failed.concat()
        );
    }
}
