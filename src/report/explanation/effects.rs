//! The effects of the first screen: one as a list of answers, several as one table with a row each, so that size, consequence and
//! remedy of all of them are seen together; cause and evidence of several follow further down.

use super::{Found, Value, bayes, found, values};
use crate::explain::Explained;
use crate::explain::contract::EffectEntry;
use crate::report::page::{answers, capitalised, escape};
use gaware_nav::effects;
use std::fmt::Write;

/// Parameters shown with an effect at most; the table of every effect has all of them.
const SHOWN: usize = 3;

/// What an effect is, in words.
pub(super) fn description(entry: &EffectEntry) -> &'static str {
    entry.names.first().and_then(|name| effects::find(name)).map_or("", |effect| effect.description())
}

/// Size, consequence and remedy of each effect.
pub fn first_screen(explained: &Explained, body: &mut String) {
    let judged = explained.judged.as_ref();
    match &explained.explanation.effects[..] {
        [] => {}
        [one] => {
            let _ = write!(body, "<h2>{}</h2>", name(one));
            let found = found(one, judged);
            let mut rows = vec![
                ("Size (1 sigma)", size(found, "; ")),
                ("Consequence", consequence(one)),
                ("Remedy", sentence(one.remedy)),
            ];
            rows.extend(detail(one));
            body.push_str(&answers(&rows));
        }
        several => {
            body.push_str(
                "<table class=\"effects\"><tr><th>Effect</th><th>Size (1 sigma)</th><th>Consequence</th><th>Remedy</th></tr>",
            );
            for (k, entry) in several.iter().enumerate() {
                let _ = write!(
                    body,
                    "<tr><td><a href=\"#effect-{0}\">{0}</a>. {1}</td><td data-label=\"Size (1 sigma)\">{2}</td>\
                     <td data-label=\"Consequence\">{3}</td><td data-label=\"Remedy\">{4}</td></tr>",
                    k + 1,
                    name(entry),
                    size(found(entry, judged), "<br>"),
                    consequence(entry),
                    sentence(entry.remedy)
                );
            }
            body.push_str("</table>");
        }
    }
}

/// Cause and evidence of each effect, where the first screen holds several.
pub fn details(explained: &Explained, body: &mut String) {
    let all = &explained.explanation.effects;
    if all.len() < 2 {
        return;
    }
    body.push_str("<h2 id=\"detail\">Cause and evidence of each effect</h2>");
    for (k, entry) in all.iter().enumerate() {
        let _ = write!(body, "<h3 id=\"effect-{0}\">{0}. {1}</h3>", k + 1, name(entry));
        body.push_str(&answers(&detail(entry)));
    }
}

fn name(entry: &EffectEntry) -> String {
    format!(
        "{} <small>{}</small>",
        escape(&capitalised(description(entry))),
        escape(&entry.names.join(" or "))
    )
}

fn sentence(text: &str) -> String {
    format!("{}.", capitalised(text))
}

/// The most significant values with the instant of an event, and where the rest is.
fn size(found: Option<Found<'_>>, between: &str) -> String {
    let sizes = found.map(values).unwrap_or_default();
    if sizes.is_empty() {
        return "present; it has no parameter".to_owned();
    }
    let estimated: Vec<&Value> = sizes.iter().filter(|v| v.estimated).collect();
    let shown = estimated.iter().filter(|v| v.significant).count().clamp(1, SHOWN);
    let fixed = sizes.iter().filter(|v| !v.estimated);
    let mut size: Vec<String> =
        estimated.iter().take(shown).copied().chain(fixed).map(|v| escape(&v.text)).collect();
    if estimated.len() > shown {
        size.push("<a href=\"#effects\">all values</a>".to_owned());
    }
    size.join(between).replace(" ± ", "\u{a0}±\u{a0}")
}

fn consequence(entry: &EffectEntry) -> String {
    entry.consequence.as_deref().map(|c| sentence(&escape(c))).unwrap_or_default()
}

fn detail(entry: &EffectEntry) -> Vec<(&'static str, String)> {
    let alternatives = match entry.names.get(1..) {
        Some([_, ..]) => format!("This flight does not separate {}.", escape(&entry.names.join(" from "))),
        _ => String::new(),
    };
    vec![
        ("Evidence", format!("Bayes factor {}.", bayes(entry.evidence.log_odds))),
        ("Usual cause", sentence(entry.cause)),
        ("Alternatives", alternatives),
        ("To separate them, fly", entry.separate_by.as_deref().map(escape).unwrap_or_default()),
    ]
}
