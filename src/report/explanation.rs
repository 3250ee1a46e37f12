//! The page of `explain`: the result in words, what was found, before and after, where, and the fine print.

use super::page;
pub use super::page::escape;
use super::plot::{AFTER, BEFORE, Line, lines};
use crate::explain::Explained;
use crate::explain::contract::{Explanation, Verdict};
use crate::explain::words::number;
use gaware_nav::identify::judge::Judged;
use gaware_nav::identify::whereabouts::{CHANNELS, channel};
use std::fmt::Write;

fn headline(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Explained => "Explained",
        Verdict::Ambiguous => "Found, but not yet told apart",
        Verdict::NothingMissing => "Nothing is missing",
        Verdict::Unexplained => "Not explained",
    }
}

/// The whole page.
///
/// # Errors
/// What the drawing library says.
pub fn html(explained: &Explained) -> Result<String, String> {
    let e = &explained.explanation;
    let mut body = String::new();
    let logs = escape(&explained.logs.join(", "));
    let _ = write!(
        body,
        "<h1>{}</h1><p><small>{logs}{}</small></p><p class=\"verdict\">{}</p>",
        headline(e.verdict),
        if explained.validated.is_empty() {
            String::new()
        } else {
            format!(" · judged on {}", escape(&explained.validated.join(", ")))
        },
        escape(&e.summary)
    );
    effects(e, &mut body);
    gaps(e, &mut body);
    if let Some(judged) = &explained.judged {
        plots(judged, &mut body)?;
    }
    places(e, &mut body);
    contributions(e, &mut body);
    terms(e, &mut body);
    let _ = write!(body, "<h2>The new model</h2><pre>{}</pre>", escape(&explained.model.to_toml()));
    body.push_str(
        "<h2>How to read this</h2><p>The simulation of the sensors is run along the flight; an <em>innovation</em> is the \
         difference between what a GNSS fix said and what the simulation expected. Squared and divided by its expected variance it \
         is 1 on average when nothing is missing. An effect is named when the odds that it is there exceed those of chance over \
         the whole catalogue; <em>log odds</em> of 8 are 3000 to 1. Held-out data took no part in choosing or fitting: other \
         flights where given, otherwise every fourth block of five seconds.</p>",
    );
    Ok(page::page(headline(e.verdict), &body))
}

fn effects(e: &Explanation, body: &mut String) {
    if e.effects.is_empty() {
        return;
    }
    body.push_str(
        "<h2>What is missing</h2><table><tr><th>Effect</th><th>Values</th><th class=\"n\">log odds</th><th class=\"n\">log-likelihood gain</th></tr>",
    );
    for entry in &e.effects {
        let values: Vec<String> = entry
            .parameters
            .values()
            .filter_map(|v| v.as_object())
            .flat_map(|o| o.iter().map(|(k, v)| format!("{k} = {}", short(v))))
            .collect();
        let _ = write!(
            body,
            "<tr><td>{}{}</td><td>{}</td><td class=\"n\">{:.0}</td><td class=\"n\">{:.0}</td></tr>",
            escape(&entry.names.join(" or ")),
            entry
                .separate_by
                .as_ref()
                .map_or_else(String::new, |s| format!("<br><small>to tell apart: {}</small>", escape(s))),
            escape(&values.join("; ")),
            entry.evidence.log_odds,
            entry.evidence.log_likelihood_gain
        );
    }
    body.push_str("</table>");
}

fn short(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Number(n) => number(n.as_f64().unwrap_or(0.0)),
        serde_json::Value::Array(a) => format!("[{}]", a.iter().map(short).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

fn gaps(e: &Explanation, body: &mut String) {
    let Some(gap) = &e.gap else { return };
    body.push_str("<h2>Before and after</h2><table><tr><th></th><th class=\"n\">before</th><th class=\"n\">after</th></tr>");
    let mut row = |name: &str, before: f64, after: f64| {
        let _ = write!(
            body,
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            escape(name),
            number(before),
            number(after)
        );
    };
    row("squared normalised innovation, data that chose and fitted", gap.fit.before, gap.fit.after);
    row("squared normalised innovation, held-out data", gap.held_out.before, gap.held_out.after);
    for c in &gap.held_out_channels {
        let unit = if c.channel.starts_with("velocity") { "m/s" } else { "m" };
        row(&format!("{}, held out, {unit} RMS", c.channel.replace('_', " ")), c.rms.before, c.rms.after);
    }
    for (time, drift) in &gap.drift_m {
        row(
            &format!("drift without fixes after {}, m RMS", time.replace('_', " ")),
            drift.before,
            drift.after,
        );
    }
    body.push_str("</table>");
}

fn plots(judged: &Judged, body: &mut String) -> Result<(), String> {
    body.push_str("<h2>Over time</h2><p><small>Innovations over their sigmas, mean of a second; ±1 is what noise does.</small></p>");
    for (c, name) in CHANNELS.iter().enumerate() {
        let series = |k: usize| -> Vec<(f64, f64)> {
            let mut seconds: std::collections::BTreeMap<i64, (f64, f64)> = std::collections::BTreeMap::new();
            for i in &judged.innovations[k] {
                if let Some(v) = channel(i, c) {
                    let cell = seconds.entry(i.elapsed_s as i64).or_default();
                    *cell = (cell.0 + v, cell.1 + 1.0);
                }
            }
            seconds.into_iter().map(|(t, (sum, n))| (t as f64, sum / n)).collect()
        };
        let mut shown = vec![Line { name: "before", color: BEFORE, points: series(0) }];
        if !judged.selection.added.is_empty() {
            shown.push(Line { name: "after", color: AFTER, points: series(1) });
        }
        body.push_str(&lines(&name.replace('_', " "), "sigma", &shown)?);
    }
    Ok(())
}

fn places(e: &Explanation, body: &mut String) {
    if e.places.is_empty() {
        return;
    }
    body.push_str(
        "<h2>Where the given model was worst</h2><table><tr><th>Channel</th><th>Time</th><th>What the vehicle did</th><th class=\"n\">Share</th></tr>",
    );
    for p in &e.places {
        let _ = write!(
            body,
            "<tr><td>{}</td><td>{:.0} to {:.0} s</td><td>{}</td><td class=\"n\">{:.0} %</td></tr>",
            p.channel.replace('_', " "),
            p.t_start_s,
            p.t_end_s,
            escape(&p.regime),
            100.0 * p.share
        );
    }
    body.push_str("</table>");
}

fn contributions(e: &Explanation, body: &mut String) {
    if e.leave_one_out.is_empty() {
        return;
    }
    body.push_str(
        "<h2>What each effect contributes</h2><table><tr><th>Left out</th><th class=\"n\">log odds lost</th><th class=\"n\">held-out log-likelihood lost</th></tr>",
    );
    for l in &e.leave_one_out {
        let _ = write!(
            body,
            "<tr><td>{}</td><td class=\"n\">{:.1}</td><td class=\"n\">{:.1}</td></tr>",
            l.name, l.evidence, l.held_out_log_likelihood
        );
    }
    body.push_str("</table>");
}

fn terms(e: &Explanation, body: &mut String) {
    if e.unexplained_terms.is_empty() {
        return;
    }
    body.push_str("<h2>What no named effect explains</h2><table><tr><th>Channel</th><th>goes with</th><th class=\"n\">by</th></tr>");
    for t in &e.unexplained_terms {
        let _ = write!(
            body,
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{} ± {} {}</td></tr>",
            t.channel,
            escape(t.term),
            number(t.coefficient),
            number(t.sigma),
            escape(&t.unit)
        );
    }
    body.push_str("</table>");
}
