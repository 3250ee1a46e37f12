//! Every effect of the catalogue in one table: its result, Bayes factor and value or detection limit; then the noise.

use super::{found, values};
use crate::explain::Explained;
use crate::explain::contract::Explanation;
use crate::explain::words::number;
use crate::figures::with_sigma;
use crate::report::page::{escape, table};
use gaware_nav::effects;
use gaware_nav::identify::survey::NotFound;
use serde_json::Value;

/// An effect of this many sigmas would have been detected.
const DETECTED: f64 = 3.0;

/// One row.
struct Row {
    name: String,
    result: &'static str,
    log_bayes: Option<f64>,
    value: String,
}

/// All effects.
pub fn effects(explained: &Explained, body: &mut String) {
    let rows = rows(explained);
    if rows.is_empty() {
        return;
    }
    body.push_str(
        "<h2 id=\"effects\">Every effect</h2><p><small>Log Bayes factor: natural logarithm of the odds that the effect is there, after \
         a correction for the size of the catalogue. An effect that is not significant has its detection limit in the last column \
         (3 sigma, on the best and on the worst of its axes): a smaller one can be there all the same.</small></p>",
    );
    let rows = rows.into_iter().map(|row| {
        let what = effects::find(&row.name).map_or("", |effect| effect.description());
        [
            format!("<b>{}</b><br><small>{what}</small>", escape(&row.name)),
            row.result.to_owned(),
            row.log_bayes.map_or_else(|| "–".to_owned(), |v| format!("{v:.1}")),
            row.value,
        ]
    });
    let titles = ["Effect", "Result", "#Log Bayes factor", "Value ± 1 sigma, or detection limit"];
    body.push_str(&table(titles, rows));
}

fn rows(explained: &Explained) -> Vec<Row> {
    let (e, judged) = (&explained.explanation, explained.judged.as_ref());
    let mut out: Vec<Row> = Vec::new();
    for entry in &e.effects {
        let result = if entry.names.len() > 1 { "added; not separated" } else { "added" };
        let all = found(entry, judged).map(values).unwrap_or_default();
        let strong = |v: &super::Value| {
            if v.significant { format!("<b>{}</b>", escape(&v.text)) } else { escape(&v.text) }
        };
        out.push(Row {
            name: entry.names.join(" or "),
            result,
            log_bayes: Some(entry.evidence.log_odds),
            value: all.iter().map(strong).collect::<Vec<_>>().join("<br>"),
        });
    }
    for n in &e.negligible {
        let step = judged.and_then(|j| j.selection.steps.iter().find(|s| s.group.contains(&n.name)));
        let value = format!(
            "{} deg/s, {} m/s², {} m RMS: below what the simulation itself leaves out",
            number(n.gyro_rad_per_s.to_degrees()),
            number(n.accel_m_per_s2),
            number(n.position_m)
        );
        out.push(Row {
            name: n.name.to_owned(),
            result: "significant, negligible",
            log_bayes: step.map(|s| s.evidence),
            value,
        });
    }
    let removed = |name: &&'static str| Row {
        name: (*name).to_owned(),
        result: "not confirmed by held-out data",
        log_bayes: None,
        value: String::new(),
    };
    out.extend(e.removed.iter().map(removed));
    out.extend(explained.not_found.iter().zip(&e.not_found).map(|(found, told)| Row {
        name: told.name.to_owned(),
        result: if told.likely { "likely, not added" } else { "tested, not significant" },
        log_bayes: Some(told.log_odds),
        value: limit(found),
    }));
    out.extend(e.assumed.iter().map(|a| Row {
        name: a.name.to_owned(),
        result: "in the given model",
        log_bayes: None,
        value: plain(&a.parameters),
    }));
    out
}

/// The smallest effect that would have been detected.
fn limit(found: &NotFound) -> String {
    let setting = &found.setting;
    let sizes = setting.parameters().zip(&setting.sigmas).filter(|(_, sigma)| **sigma > 0.0);
    let sizes: Vec<(f64, &str)> =
        sizes.map(|((_, unit), sigma)| (DETECTED * sigma / unit.si, unit.symbol)).collect();
    let least = sizes.iter().map(|s| s.0).fold(f64::INFINITY, f64::min);
    let most = sizes.iter().map(|s| s.0).fold(0.0, f64::max);
    let reason = found.reason.unwrap_or_default();
    let Some((_, unit)) = sizes.first() else { return reason.to_owned() };
    let range =
        if most > 1.05 * least { format!("{} to {}", number(least), number(most)) } else { number(most) };
    if reason.is_empty() { format!("{range} {unit}") } else { format!("{range} {unit}; {reason}") }
}

/// Values of a parameter document in words: `value_s = 0.1`.
fn plain(parameters: &Value) -> String {
    let scalar = |(key, value): (&String, &Value)| {
        value.as_f64().map(|v| format!("{} = {}", key.replace('_', " "), number(v)))
    };
    parameters
        .as_object()
        .map_or_else(String::new, |map| map.iter().filter_map(scalar).collect::<Vec<_>>().join(", "))
}

/// Noise as claimed and as fitted.
pub fn noise(e: &Explanation, body: &mut String) {
    if e.noise.is_empty() {
        return;
    }
    body.push_str("<h2 id=\"noise\">Noise</h2>");
    let rows = e.noise.iter().map(|n| {
        [
            figure(n.name),
            format!("{} {}", number(n.assumed), n.unit),
            format!("{} {}", with_sigma(n.fitted, n.sigma), n.unit),
            if n.plausible { "yes" } else { "no" }.to_owned(),
        ]
    });
    body.push_str(&table(["Figure", "#Assumed", "#Fitted ± 1 sigma", "Plausible"], rows));
}

/// Name of a noise figure in words.
fn figure(name: &str) -> String {
    match name {
        "gnss_position_wander" => "GNSS position, first-order Gauss-Markov error".to_owned(),
        _ => name.replace('_', " ").replace("gnss", "GNSS"),
    }
}
