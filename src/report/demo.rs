//! The page of the demonstration: what the plan promised, what the flight reached, and the ground truth.

use super::page::{capitalised, escape, page, table};
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
    let groups = GROUPS.map(|(title, _)| format!("#{}", title.split(':').next().unwrap_or(title)));
    let [a, b, c, d, e] = groups.each_ref().map(String::as_str);
    let rows = series.maneuvers.iter().zip(1..).map(|(m, k)| {
        let [a, b, c, d, e] = GROUPS.map(|(_, names)| {
            let at = |flown| series.worst(names, flown).and_then(|points| near(&points, m.flown_end_s));
            let both = at(false).zip(at(true));
            both.map_or_else(String::new, |(planned, flown)| format!("{} / {}", short(planned), short(flown)))
        });
        let took = [m.planned_end_s - m.planned_start_s, m.flown_end_s - m.flown_start_s];
        [format!("{k}. {}", escape(&m.words)), format!("{:.0} / {:.0}", took[0], took[1]), a, b, c, d, e]
    });
    body.push_str(&table(["Maneuver", "#s", a, b, c, d, e], rows));
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
    let rows = result.states.iter().map(|s| {
        let [truth, estimate, sigma, planned] =
            [s.truth, s.estimate, s.sigma, s.planned_sigma].map(|v| format!("{v:.3}"));
        [
            escape(&s.name),
            truth,
            estimate,
            sigma,
            planned,
            format!("{:.2}", s.normalised_error),
            escape(&s.unit),
            if s.status == Status::Observable { "observable" } else { "" }.to_owned(),
        ]
    });
    let titles = ["State", "#truth", "#estimate", "#sigma", "#predicted sigma", "#error / sigma", "unit", ""];
    body.push_str(&table(titles, rows));
}
