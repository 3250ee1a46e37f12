//! What the autopilot itself can correct: a row for each parameter, and what is not proposed.

use crate::advice::file::short;
use crate::advice::rule_free;
use crate::explain::contract::Explanation;
use crate::report::page::{escape, table};
use std::fmt::Write;

/// The section; nothing where there is no advice.
pub fn section(e: &Explanation, body: &mut String) {
    let Some(advice) = e.autopilot.as_ref().filter(|a| !a.proposals.is_empty() || !a.not_proposed.is_empty())
    else {
        return;
    };
    body.push_str("<h2 id=\"autopilot\">Parameters of the autopilot</h2>");
    if !advice.proposals.is_empty() {
        let rows = advice.proposals.iter().map(|p| {
            let range = p.range.map_or_else(|| "–".to_owned(), |(low, high)| format!("{low} to {high}"));
            let needs = match p.needs.as_slice() {
                [] => String::new(),
                names => format!("<br><small>needs {}, not in the log</small>", escape(&names.join(", "))),
            };
            let note =
                p.note.as_deref().map_or_else(String::new, |n| format!("<br><small>{}</small>", escape(n)));
            [
                format!("<b>{}</b>", breakable(p.parameter)),
                p.on_board.map_or_else(|| "not in the log".to_owned(), rule_free),
                breakable(&short(p)) + &needs + &note,
                breakable(p.effect),
                range,
                rule_free(p.step),
                if p.reboot { "yes" } else { "no" }.to_owned(),
            ]
        });
        let titles = ["Parameter", "#On board", "Proposed", "Effect", "Range", "Step", "Reboot"];
        body.push_str(&table(titles, rows));
        body.push_str(
            "<p><small>The same as a file for ground stations: autopilot.param (ArduPilot) or autopilot.params (PX4). <code>gaware params \
             apply</code> keeps a backup, writes, reads back and compares.</small></p>",
        );
    }
    if !advice.not_proposed.is_empty() || !advice.notes.is_empty() {
        body.push_str("<ul>");
        for not in &advice.not_proposed {
            let parameter = not.parameter.map_or_else(String::new, |p| format!(" ({p})"));
            let _ = write!(body, "<li>Not proposed: {}{parameter}: {}</li>", not.effect, escape(&not.reason));
        }
        for note in &advice.notes {
            let _ = write!(body, "<li>{}</li>", escape(note));
        }
        body.push_str("</ul>");
    }
}

/// A name that a narrow column or a page of paper may break after an underscore.
fn breakable(name: &str) -> String {
    escape(name).replace('_', "_<wbr>")
}
