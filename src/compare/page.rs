//! The comparison as an HTML report: the answer, the figures by regime, both flights on common axes.

use super::flight::{FilterFlight, Regime};
use super::statistics::Change;
use super::{Comparison, Kind, Row, Verdict, ratio_with_interval};
use crate::report::page::{self, escape, page};
use crate::report::plot::{AFTER, BEFORE, Plot};
use std::fmt::Write;

/// Lines of a plot have at most about so many points.
const POINTS: usize = 1500;

/// The whole page.
///
/// # Errors
/// A plot cannot be described.
pub fn html(c: &Comparison, before: &FilterFlight, after: &FilterFlight) -> Result<String, String> {
    let headline = match c.verdict {
        Verdict::Smaller => "Innovations smaller",
        Verdict::Unchanged => "Innovations unchanged",
        Verdict::Larger => "Innovations larger: worse",
        Verdict::Mixed => "Some innovations smaller, some larger",
        Verdict::Undecided => "Too short to decide",
    };
    let mut body = String::new();
    let _ = write!(
        body,
        "<h1>{headline}</h1><p>{}</p><p><small>Before: {}. After: {}. Autopilot: {}.</small></p>",
        escape(&c.text),
        escape(&c.before),
        escape(&c.after),
        escape(c.autopilot)
    );
    table(c, &mut body);
    body.push_str("<h2>Both flights</h2>");
    let mut quantities: Vec<_> = c.rows.iter().map(|r| r.quantity).collect();
    quantities.dedup();
    for quantity in quantities {
        let line = |flight: &FilterFlight| {
            let points = flight.series.get(&quantity).map(Vec::as_slice).unwrap_or_default();
            let start_s = points.iter().find(|p| p.regime.is_some()).map_or(0.0, |p| p.t_s);
            let every = points.len().div_ceil(POINTS).max(1);
            let flying = points.iter().filter(|p| p.regime.is_some()).step_by(every);
            flying.map(|p| (p.t_s - start_s, p.value)).collect::<Vec<_>>()
        };
        let plot = Plot::new(quantity.words(), quantity.unit()).line("before", BEFORE, line(before)).line(
            "after",
            AFTER,
            line(after),
        );
        body.push_str(&plot.svg()?);
    }
    body.push_str(
        "<p><small>Time counts from the first instant in flight. RMS of what the autopilot's own filter reports in flight. The interval of \
         a ratio holds with 95 % for all channels together and respects that neighbouring innovations are correlated: effective sample size by Geyer's initial monotone sequence (1992). \
         \"All, same mix\": each regime that both flights have counts with the same weight in both, because two flights are never flown alike. \
         The attitude is the autopilot's less the one that \
         this program estimates; it has no part in the verdict.</small></p>",
    );
    Ok(page(headline, &body))
}

fn table(c: &Comparison, body: &mut String) {
    let rows = c.rows.iter().map(|r| {
        [
            bold(r.quantity.words(), r),
            r.regime.words().to_owned(),
            format!("{:.3} {}", r.before.value, r.unit),
            format!("{:.3} {}", r.after.value, r.unit),
            ratio_with_interval(&r.ratio),
            format!("{:.0}, {:.0}", r.before.effective, r.after.effective),
            result(r).to_owned(),
        ]
    });
    let titles = [
        "Quantity",
        "Regime",
        "#RMS before",
        "#RMS after",
        "#After over before",
        "#Effective samples",
        "Result",
    ];
    body.push_str("<h2>By regime</h2>");
    body.push_str(&page::table(titles, rows));
}

fn bold(text: &str, r: &Row) -> String {
    if r.regime == Regime::All { format!("<b>{text}</b>") } else { text.to_owned() }
}

/// In words. An attitude that differs more from ours is not worse for that.
pub fn result(row: &Row) -> &'static str {
    match row.ratio.change {
        Change::Smaller => "smaller",
        Change::Unchanged => "unchanged",
        Change::Larger if row.quantity.kind() == Kind::Attitude => "larger",
        Change::Larger => "larger: worse",
        Change::Undecided => "undecided",
    }
}
