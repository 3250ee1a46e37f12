//! The page of one flight: what is known now, what made it known, and how the autopilot's own attitude compares.

mod attitude;
mod knowledge;
mod lessons;
mod log;
mod track;
mod words;

pub use log::FlightLog;

use super::page::{escape, page};
use super::plot::{Plot, X_AXIS, Y_AXIS, Z_AXIS};
use crate::engine::snapshot::{Phase, Snapshot, Summary};
use crate::explain::words::number;
use plotters::style::RGBColor;
use serde_json::{Map, Value};
use std::fmt::Write;

/// Lines of a plot have at most about so many points.
const POINTS: usize = 900;
const AXES: [(&str, RGBColor); 3] = [("x", X_AXIS), ("y", Y_AXIS), ("z", Z_AXIS)];

/// The whole page. `name`: of the log; `document`: the result as `replay --json` prints it.
///
/// # Errors
/// What the drawing library says.
pub fn html(
    name: &str,
    summary: &Summary,
    document: &Map<String, Value>,
    log: &FlightLog,
) -> Result<String, String> {
    let lessons = lessons::lessons(&log.snapshots);
    let mut body = String::new();
    head(name, summary, &mut body);
    flight(log, &lessons, &mut body)?;
    if summary.phase == Phase::Running {
        knowledge::g_sensitivity(summary, &mut body);
        knowledge::learning(summary, log, &lessons, &mut body)?;
        knowledge::biases(summary, log, &mut body)?;
    }
    attitudes(document, log, &mut body)?;
    innovations(log, &mut body)?;
    body.push_str(
        "<h2>How to read this</h2><p>Values are given with one sigma. G says what an acceleration does to the gyros: \
         g<sub>31</sub> is what one g forward does to the yaw gyro. An element counts as known once its sigma is below the \
         target. An innovation is what a fix says less what was expected of it, here over its expected sigma: within ±1 two \
         times out of three when nothing is missing.</p>",
    );
    Ok(page(&escape(name), &body))
}

fn head(name: &str, s: &Summary, body: &mut String) {
    let _ = write!(
        body,
        "<h1>{}</h1><p><small>{:.0} s · {} · {} {} samples at {:.1} Hz, {} dropped · {} fixes, {} used, {} rejected · squared \
         innovation {}</small></p><p class=\"verdict\">{}</p>",
        escape(name),
        s.duration_s,
        escape(&s.autopilot),
        escape(if s.imu.message.is_empty() { "no inertial" } else { &s.imu.message }),
        s.imu.samples,
        s.imu.rate_hz,
        s.imu.dropped,
        s.gnss.fixes,
        s.gnss.used,
        s.gnss.rejected,
        number(s.consistency.nis_mean_per_dof),
        escape(&words::verdict(s))
    );
    if !s.warnings.is_empty() {
        body.push_str("<ul>");
        for warning in &s.warnings {
            let _ = write!(body, "<li>{}</li>", escape(warning));
        }
        body.push_str("</ul>");
    }
}

/// A quantity over time, thinned.
fn series(snapshots: &[Snapshot], of: impl Fn(&Snapshot) -> f64) -> Vec<(f64, f64)> {
    let every = snapshots.len().div_ceil(POINTS).max(1);
    snapshots
        .iter()
        .step_by(every)
        .filter(|s| s.phase == Phase::Running)
        .map(|s| (s.elapsed_s, of(s)))
        .filter(|(_, v)| v.is_finite())
        .collect()
}

fn flight(log: &FlightLog, lessons: &[lessons::Lesson], body: &mut String) -> Result<(), String> {
    let shots = &log.snapshots;
    let track = track::svg(shots, lessons);
    if track.is_empty() {
        return Ok(());
    }
    body.push_str("<h2>The flight</h2>");
    body.push_str(&track);
    if !lessons.is_empty() {
        body.push_str("<p><small>North is up. Thick, with the numbers of the table below: what taught most about G.</small></p>");
    }
    let plot = |title, unit, of: &dyn Fn(&Snapshot) -> f64| {
        Plot::new(title, unit).line(title, X_AXIS, series(shots, of))
    };
    body.push_str(&plot("height", "m", &|s| s.motion.height_m).close().svg()?);
    body.push_str(&plot("speed over ground", "m/s", &lessons::speed).svg()?);
    body.push_str(&plot("bank", "deg", &|s| s.estimate.attitude_deg.value[0]).svg()?);
    body.push_str(&plot("load", "g", &lessons::load).close().svg()?);
    Ok(())
}

fn attitudes(document: &Map<String, Value>, log: &FlightLog, body: &mut String) -> Result<(), String> {
    if let Some(found) = attitude::compare(&log.attitudes, &log.snapshots) {
        let _ = write!(
            body,
            "<h2>The autopilot's own attitude</h2><p>Autopilot less this estimate, after a shift of {:.0} ms. Its yaw leans on a \
             compass, ours on the fixes.</p><table><tr><th>while</th><th class=\"n\">instants</th><th class=\"n\">mean roll, pitch, yaw, \
             deg</th><th class=\"n\">RMS, deg</th><th class=\"n\">our sigma, deg</th></tr>",
            1e3 * found.shift_s
        );
        let three = |v: [f64; 3]| v.map(|v| format!("{v:.2}")).join(" / ");
        for row in &found.rows {
            let _ = write!(
                body,
                "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
                row.regime,
                row.count,
                three(row.mean_deg),
                three(row.rms_deg),
                three(row.sigma_deg)
            );
        }
        body.push_str("</table>");
        if let Some([autopilot, ours]) = found.crab_rms_deg {
            let _ = write!(
                body,
                "<p>From the nose to the course over the ground: {autopilot:.1}° RMS by the autopilot's yaw, {ours:.1}° by this \
                 estimate. Wind and sideslip are in both; the larger one tells whose yaw errs.</p>"
            );
        }
        let every = found.differences.len().div_ceil(POINTS).max(1);
        let mut plot = Plot::new("autopilot less this estimate", "deg");
        for (k, (name, (_, color))) in ["roll", "pitch", "yaw"].into_iter().zip(AXES).enumerate() {
            let points = found.differences.iter().step_by(every).map(|(t, d)| (*t, d[k])).collect();
            plot = plot.line(name, color, points);
        }
        body.push_str(&plot.svg()?);
    }
    if let Some(truth) = document.get("truth_comparison") {
        let get = |name: &str| truth.get(name).map(Value::to_string).unwrap_or_default();
        let _ = write!(
            body,
            "<p>Against the truth that the simulated vehicle sends along, from {} s on: RMS {} deg in roll, pitch, yaw after a shift of {} s.</p>",
            get("from_s"),
            get("attitude_rms_deg"),
            get("time_shift_s")
        );
    }
    Ok(())
}

fn innovations(log: &FlightLog, body: &mut String) -> Result<(), String> {
    let channels = [
        "position north",
        "position east",
        "position down",
        "velocity north",
        "velocity east",
        "velocity down",
    ];
    let mut drawn = String::new();
    for (k, name) in channels.into_iter().enumerate() {
        let points = series(&log.snapshots, |s| s.consistency.last_normalised_innovation[k]);
        if points.iter().any(|(_, v)| *v != 0.0) {
            drawn.push_str(&Plot::new(name, "sigma").line(name, X_AXIS, points).svg()?);
        }
    }
    if !drawn.is_empty() {
        body.push_str("<h2>Innovations</h2>");
        body.push_str(&drawn);
    }
    Ok(())
}
