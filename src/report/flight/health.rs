//! The first block of a report: how the vehicle was, part by part, with modes and arming on a time axis.

use crate::health::HealthLog;
use crate::health::checks::{Check, Grade, verdict};
use crate::report::page::escape;
use std::fmt::Write;

const WIDTH: f64 = 860.0;
/// Place of the axis, from the left.
const LEFT: f64 = 70.0;
/// Narrower modes have no name in the drawing.
const NAMED: f64 = 46.0;
/// More modes than this are drawn without names.
const MOST_MODES: usize = 60;

/// The block; nothing where the log says nothing of the vehicle.
pub fn section(log: &HealthLog, checks: &[Check], body: &mut String) {
    if log.is_empty() {
        return;
    }
    let worst = checks.iter().map(|c| c.grade).max().unwrap_or(Grade::Unknown);
    let _ = write!(
        body,
        "<h2 id=\"health\">Vehicle health</h2><p class=\"verdict grade-{}\">{}</p>",
        class(worst),
        escape(&verdict(log, checks))
    );
    axis(log, checks, body);
    body.push_str("<table class=\"health\"><tr><th>Part</th><th>Grade</th><th class=\"n\">From</th><th>What the log says</th></tr>");
    let mut rows: Vec<&Check> = checks.iter().filter(|c| c.grade != Grade::Unknown).collect();
    rows.sort_by_key(|c| std::cmp::Reverse(c.grade));
    for c in rows {
        let from = c.t_s.map_or_else(String::new, |t| format!("{t:.1} s"));
        let _ = write!(
            body,
            "<tr><td>{}</td><td><span class=\"grade grade-{}\">{}</span></td><td class=\"n\">{from}</td><td>{}</td></tr>",
            c.part,
            class(c.grade),
            c.grade.word(),
            escape(&c.text)
        );
    }
    body.push_str("</table>");
    let absent: Vec<&str> = checks.iter().filter(|c| c.grade == Grade::Unknown).map(|c| c.part).collect();
    if !absent.is_empty() {
        let _ = write!(body, "<p><small>Not in the log: {}.</small></p>", absent.join(", "));
    }
}

fn class(grade: Grade) -> &'static str {
    match grade {
        Grade::Unknown => "unknown",
        Grade::Ok => "ok",
        Grade::Look => "look",
        Grade::Bad => "bad",
    }
}

/// Armed spans, modes and the onset of what is not ok.
fn axis(log: &HealthLog, checks: &[Check], body: &mut String) {
    let modes = log.modes();
    let end = log.end_s();
    if modes.is_empty() || end <= 0.0 {
        return;
    }
    let x = |t: f64| LEFT + (t.clamp(0.0, end) / end) * (WIDTH - LEFT - 10.0);
    let _ = write!(
        body,
        "<div class=\"drawing\"><svg class=\"plot\" viewBox=\"0 0 {WIDTH:.0} 96\" font-size=\"15\" fill=\"currentColor\" role=\"img\" \
         aria-label=\"modes and arming over time\"><text x=\"0\" y=\"18\">mode</text><text x=\"0\" y=\"44\">armed</text><text x=\"0\" y=\"66\">events</text>"
    );
    for (k, (from, name)) in modes.iter().enumerate() {
        let to = modes.get(k + 1).map_or(end, |next| next.0);
        let (a, b) = (x(*from), x(to));
        if b <= a {
            continue;
        }
        let shade = if k % 2 == 0 { "0.30" } else { "0.16" };
        let _ = write!(
            body,
            "<rect x=\"{a:.1}\" y=\"4\" width=\"{:.1}\" height=\"20\" fill=\"var(--accent)\" opacity=\"{shade}\"><title>{} from {from:.1} s</title></rect>",
            b - a,
            escape(name)
        );
        if b - a > NAMED.max(9.0 * name.len() as f64) && modes.len() <= MOST_MODES {
            let _ = write!(body, "<text x=\"{:.1}\" y=\"18\">{}</text>", a + 4.0, escape(name));
        }
    }
    let armed = log.armed();
    if armed.is_none() {
        let _ = write!(body, "<text x=\"{LEFT}\" y=\"44\" opacity=\".7\">not in the log</text>");
    }
    for (from, to) in armed.unwrap_or_default() {
        let (a, b) = (x(from), x(to));
        let _ = write!(
            body,
            "<rect x=\"{a:.1}\" y=\"34\" width=\"{:.1}\" height=\"10\" fill=\"var(--quiet)\"/>",
            (b - a).max(1.0)
        );
    }
    for c in checks.iter().filter(|c| c.grade >= Grade::Look) {
        let Some(t) = c.t_s.filter(|t| *t >= 0.0) else { continue };
        let _ = write!(
            body,
            "<path d=\"M{:.1} 54l5 12h-10z\" fill=\"var(--{})\"><title>{}: {}</title></path>",
            x(t),
            class(c.grade),
            c.part,
            escape(&c.text)
        );
    }
    for k in 0..=5 {
        let t = end * f64::from(k) / 5.0;
        let anchor = if k == 5 { "end" } else { "middle" };
        let _ = write!(body, "<text x=\"{:.1}\" y=\"88\" text-anchor=\"{anchor}\">{t:.0} s</text>", x(t));
    }
    body.push_str("</svg></div>");
}
