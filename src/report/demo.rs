//! The page of the demonstration: what the plan promised, what the flight reached, and the ground truth.

use super::page::{escape, page, wide};
use super::plot::{AFTER, BEFORE, Color, Plot};
use crate::demo::result::DemoResult;
use crate::demo::series::Series;
use crate::engine::snapshot::Status;
use std::fmt::Write;

/// Groups of states that one plot shows by their worst member, with what makes them known.
const GROUPS: [(&str, &[&str]); 5] = [
    ("G, column x: speed changes", &["g11", "g21", "g31"]),
    ("G, column y: sideways force", &["g12", "g22", "g32"]),
    ("G, column z: turns and pull-ups", &["g13", "g23", "g33"]),
    ("Gyro bias", &["bg_x", "bg_y", "bg_z"]),
    ("Accelerometer bias", &["ba_x", "ba_y", "ba_z"]),
];
const TARGET: Color = "#6f9a3d";

/// The whole page.
///
/// # Errors
/// What the drawing library says.
pub fn html(airframe: &str, result: &DemoResult, series: &Series) -> Result<String, String> {
    let mut body = String::new();
    let known = result.states.iter().filter(|s| s.status == Status::Observable).count();
    let _ = write!(
        body,
        "<h1>{}</h1><p class=\"verdict\">{}: {known} of {} parameters converged after {:.0} s.</p>",
        escape(airframe),
        escape(&capitalised(&result.ending.sentence())),
        result.states.len(),
        result.summary.duration_s
    );
    for line in result.promise.lines() {
        let _ = write!(body, "<p>{}.</p>", escape(&capitalised(&line)));
    }
    body.push_str(
        "<h2>Predicted and flown</h2><p>Largest 1-sigma of each group: as the plan predicted it, and as the \
         filter had it in flight. The prediction is laid over the flight maneuver by maneuver; upright lines are the ends \
         of maneuvers.</p>",
    );
    // Words of neighbours would lie upon each other: the table says what each number was.
    let ends: Vec<(f64, String)> =
        series.maneuvers.iter().zip(1..).map(|(m, k)| (m.flown_end_s, format!("end of {k}"))).collect();
    let marks: Vec<(f64, &str)> = ends.iter().map(|(t, name)| (*t, name.as_str())).collect();
    for (title, names) in GROUPS {
        body.push_str(&plot(title, names, series, &marks)?);
    }
    maneuvers(series, &mut body);
    states(result, &mut body);
    Ok(page(airframe, &body))
}

/// With a capital at the start.
fn capitalised(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

fn plot(title: &str, names: &[&str], series: &Series, marks: &[(f64, &str)]) -> Result<String, String> {
    let (Some(planned), Some(flown)) = (series.worst(names, false), series.worst(names, true)) else {
        return Ok(String::new());
    };
    let (unit, target) = series.unit_and_target(names);
    // The target stands as long as anything does: a flight may be broken off.
    let all = || planned.iter().chain(&flown).map(|(t, _)| *t);
    let ends = [all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max)];
    Plot::new(title, &unit)
        .line("predicted", BEFORE, planned)
        .line("flown", AFTER, flown)
        .line("target", TARGET, ends.map(|t| (t, target)).to_vec())
        .marks(marks)
        .svg()
}

/// Per maneuver: when, and the worst of each group at its end.
fn maneuvers(series: &Series, body: &mut String) {
    if series.maneuvers.is_empty() {
        return;
    }
    body.push_str("<h2>Maneuvers</h2><p>Each as the plan has it / as it was flown: seconds, and the largest 1-sigma at the end.</p>");
    let mut table = "<table><tr><th>Maneuver</th><th class=\"n\">s</th>".to_owned();
    for (title, _) in GROUPS {
        let name = title.split(':').next().unwrap_or(title);
        let _ = write!(table, "<th class=\"n\">{name}</th>");
    }
    table.push_str("</tr>");
    for (m, k) in series.maneuvers.iter().zip(1..) {
        let _ = write!(
            table,
            "<tr><td>{k}. {}</td><td class=\"n\">{:.0} / {:.0}</td>",
            escape(&m.words),
            m.planned_end_s - m.planned_start_s,
            m.flown_end_s - m.flown_start_s
        );
        for (_, names) in GROUPS {
            let at = |flown| series.worst(names, flown).and_then(|points| near(&points, m.flown_end_s));
            match (at(false), at(true)) {
                (Some(planned), Some(flown)) => {
                    let [planned, flown] = [planned, flown].map(short);
                    let _ = write!(table, "<td class=\"n\">{planned} / {flown}</td>");
                }
                _ => table.push_str("<td></td>"),
            }
        }
        table.push_str("</tr>");
    }
    body.push_str(&wide(&(table + "</table>")));
}

/// Without decimals from three digits on: the table fits on paper.
fn short(v: f64) -> String {
    if v < 100.0 { format!("{v:.1}") } else { format!("{v:.0}") }
}

fn near(points: &[(f64, f64)], t_s: f64) -> Option<f64> {
    points.iter().min_by(|a, b| (a.0 - t_s).abs().total_cmp(&(b.0 - t_s).abs())).map(|(_, y)| *y)
}

fn states(result: &DemoResult, body: &mut String) {
    body.push_str("<h2>Estimate and injected truth</h2>");
    let mut table =
        "<table><tr><th>State</th><th class=\"n\">truth</th><th class=\"n\">estimate</th>\
         <th class=\"n\">sigma</th><th class=\"n\">predicted sigma</th><th class=\"n\">error / sigma</th><th>unit</th><th></th></tr>".to_owned();
    for s in &result.states {
        let _ = write!(
            table,
            "<tr><td>{}</td><td class=\"n\">{:.3}</td><td class=\"n\">{:.3}</td><td class=\"n\">{:.3}</td>\
             <td class=\"n\">{:.3}</td><td class=\"n\">{:.2}</td><td>{}</td><td>{}</td></tr>",
            escape(&s.name),
            s.truth,
            s.estimate,
            s.sigma,
            s.planned_sigma,
            s.normalised_error,
            escape(&s.unit),
            if s.status == Status::Observable { "observable" } else { "" }
        );
    }
    body.push_str(&wide(&(table + "</table>")));
}
