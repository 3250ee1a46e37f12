//! The page of one flight: what is known now, what made it known, and how the autopilot's own attitude compares.

mod air;
mod answers;
mod attitude;
mod compass;
mod health;
mod innovations;
mod knowledge;
mod lessons;
mod log;
mod motion;
mod scope;
mod track;
mod words;

pub use log::{FlightLog, Logged};

use super::page::{self, escape, page, table};
use super::plot::{Color, Plot, X_AXIS, Y_AXIS, Z_AXIS};
use crate::advice::start;
use crate::aids::{self, Aids};
use crate::engine::snapshot::{Phase, Snapshot, Summary};
use crate::engine::{Engine, EngineOptions};
use crate::health::checks::checks;
use crate::logs;
use crate::pipeline::replay::{self, ReplayError, ReplayRequest};
use crate::pipeline::{self, Beside, truth_comparison};
use serde_json::{Map, Value};
use std::fmt::Write;

/// Lines of a plot have at most about so many points.
const POINTS: usize = 900;
const AXES: [(&str, Color); 3] = [("x", X_AXIS), ("y", Y_AXIS), ("z", Z_AXIS)];

/// Where a report comes from.
#[derive(Debug, Clone, Default)]
pub struct Origin {
    /// The log's name.
    pub log: String,
    /// When it was recorded, where the log has a date (UTC).
    pub date: String,
    /// The model's file, or which one was taken.
    pub model: String,
    /// What the log says beside its samples.
    pub beside: Beside,
    /// Its compasses, barometers and airspeed sensors, where it holds any.
    pub aids: Aids,
}

pub use air::section as air_section;
pub use compass::{answer as compass_answer, section as compass_section};
pub use health::section as health_section;

/// The report of a log, with the result as `replay --json` prints it.
#[derive(Debug, Clone)]
pub struct LogReport {
    /// The page.
    pub html: String,
    /// The result.
    pub document: Map<String, Value>,
}

/// Runs a log through and describes it. `model`: the name of the file of the model, where the user gave one.
///
/// # Errors
/// Log or model cannot be read, nothing in the log can, or a plot cannot be described.
pub fn of_log(
    request: &ReplayRequest,
    options: EngineOptions,
    model: Option<String>,
    progress: &dyn Fn(u64, u64),
) -> Result<LogReport, ReplayError> {
    let make = |model| Logged::new(Engine::new(model, options));
    let mut beside = Beside::default();
    let (pipeline, mut document) = replay::replay_watched(request, make, progress, Some(&mut beside))?;
    let taken = || match logs::mcap::recorded_setup(&request.log) {
        Some(_) => "the recording's own".to_owned(),
        None => "standard (g-sensitivity, GNSS latency and the tolerances of a consumer unit estimated)"
            .to_owned(),
    };
    let counts = pipeline.converter().stats().time;
    let judged = judged_sensors(request, counts.fields + counts.air, &beside)?;
    let origin = Origin {
        log: request.log.name(),
        date: beside.date(),
        model: model.unwrap_or_else(taken),
        beside,
        aids: judged,
    };
    let html =
        html(&origin, &pipeline.summary(), &document, pipeline.engine().log()).map_err(ReplayError::Draw)?;
    let Aids { compasses, air } = origin.aids;
    let found = [("compasses", compasses.map(serde_json::to_value)), ("air", air.map(serde_json::to_value))];
    document.extend(found.into_iter().filter_map(|(name, v)| Some((name.to_owned(), v?.ok()?))));
    Ok(LogReport { html, document })
}

/// So much of a flight is enough to judge a sensor by, s.
const JUDGED_S: f64 = 900.0;

/// The sensors beside the inertial unit of a log that holds `count` samples of them, by the part of it with the most motion.
fn judged_sensors(request: &ReplayRequest, count: u64, beside: &Beside) -> Result<Aids, ReplayError> {
    if count == 0 {
        return Ok(Aids::default());
    }
    let part = pipeline::most_motion(&request.log, request.converter, JUDGED_S)?;
    Ok(aids::of_samples(&part.samples, beside.start_unix_s(), &beside.on_board))
}

/// The autopilot's attitude less ours over time: s since the first sample, roll, pitch, yaw in deg. Empty where the log has too little of it.
pub fn attitude_differences(log: &FlightLog) -> Vec<(f64, [f64; 3])> {
    attitude::compare(&log.attitudes, &log.snapshots).map(|found| found.differences).unwrap_or_default()
}

/// The whole page. `document`: the result as `replay --json` prints it.
///
/// # Errors
/// A plot cannot be described.
pub fn html(
    origin: &Origin,
    summary: &Summary,
    document: &Map<String, Value>,
    log: &FlightLog,
) -> Result<String, String> {
    let lessons = lessons::lessons(&log.snapshots);
    let compared = attitude::compare(&log.attitudes, &log.snapshots);
    let fixes = innovations::of(&log.snapshots);
    let mut body = String::new();
    let fitted = log.motion.fitted();
    answers::head(
        origin,
        summary,
        &scope::words(summary, &origin.beside, &fitted, attitude::has_settled(&log.snapshots)),
        &mut body,
    );
    let whose = answers::whose(compared.as_ref(), &fitted, log);
    let compasses = origin.aids.compasses.as_ref().map(|found| escape(&compass::answer(found)));
    let air = origin.aids.air.as_ref().map(|found| escape(&air::answer(found)));
    body.push_str(&page::answers(&[
        ("Whose attitude is right?", whose),
        ("Which compass is wrong?", compasses.unwrap_or_default()),
        ("Barometer, airspeed, wind?", air.unwrap_or_default()),
    ]));
    let judged = checks(&origin.beside.health, summary.autopilot == "px4", &origin.beside.on_board);
    health::section(&origin.beside.health, &judged, &mut body);
    answers::verdict(summary, &mut body);
    first_values(document, &mut body);
    let estimated = words::has_estimated(summary);
    if estimated {
        answers::answers(summary, log, &lessons, &fixes, &mut body);
        knowledge::g_sensitivity(summary, &mut body);
        knowledge::bias_table(summary, &mut body);
    } else {
        answers::without_estimate(summary, &mut body);
    }
    flight(log, &lessons, &mut body)?;
    if estimated {
        knowledge::learning(summary, log, &lessons, &mut body)?;
        knowledge::biases(log, &mut body)?;
    }
    if let Some(found) = &origin.aids.compasses {
        compass::section(found, &mut body);
    }
    if let Some(found) = &origin.aids.air {
        air::section(found, &mut body);
    }
    motion_table(&fitted, &mut body);
    attitudes(compared.as_ref(), document, &mut body)?;
    innovations::section(&log.snapshots, &fixes, &mut body)?;
    // A page without values or plots has nothing to explain.
    if log.snapshots.iter().any(|s| s.phase == Phase::Running) {
        answers::how_to_read(&mut body);
    }
    Ok(page(&escape(&origin.log), &body))
}

/// What the autopilot's own parameters gave the estimate to start from.
fn first_values(document: &Map<String, Value>, body: &mut String) {
    for text in start::texts(document) {
        body.push_str(&format!("<p><small>First value: {}.</small></p>", escape(text)));
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
    if !lessons.is_empty() && track.contains("<svg") {
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

/// All attitudes of the log against the motion.
fn motion_table(fitted: &[motion::Fitted], body: &mut String) {
    if fitted.is_empty() {
        return;
    }
    body.push_str(
        "<h2 id=\"motion\">All attitudes against the motion</h2><p>The specific force turned by each attitude, against the change of GNSS velocity over a \
         second. Each has its own constant accelerometer bias. t: difference from the best one over its standard error; above 3 it is beyond chance.</p>",
    );
    let rows = fitted.iter().map(|f| {
        let yaw = f
            .yaw_off_deg
            .map_or_else(|| "not shown by this flight".to_owned(), |(v, s)| format!("{v:.1} ± {s:.1}"));
        let yaw = yaw
            + &f.stretch.as_ref().map_or_else(String::new, |s| {
                format!("; {:.0} ± {:.0} from {:.0} to {:.0} s", s.off_deg, s.sigma_deg, s.from_s, s.to_s)
            });
        let says = match (f.is_worse(), f.t == 0.0) {
            _ if f.name == logs::TRUTH => "the vehicle itself",
            (true, _) => "worse beyond chance",
            (_, true) => "best",
            _ => "as good as the best",
        };
        [escape(&f.name), format!("{:.2}", f.misfit), yaw, format!("{:.1}", f.t), says.to_owned()]
    });
    body.push_str(&table(["attitude", "#misfit, m/s²", "#yaw off by, deg", "#t", ""], rows));
}

fn attitudes(
    compared: Option<&attitude::Comparison>,
    document: &Map<String, Value>,
    body: &mut String,
) -> Result<(), String> {
    if let Some(found) = compared {
        let _ = write!(
            body,
            "<h2 id=\"attitude\">The autopilot's own attitude</h2><p>Autopilot less this estimate, after a shift of {:.0} ms. Its yaw leans on a \
             compass, ours on the fixes.</p>",
            1e3 * found.shift_s
        );
        let three = |v: [f64; 3]| v.map(|v| format!("{v:.2}")).join(" / ");
        let rows = found.rows.iter().map(|row| {
            let [mean, rms, sigma] = [row.mean_deg, row.rms_deg, row.sigma_deg].map(three);
            [row.regime.to_string(), row.count.to_string(), mean, rms, sigma]
        });
        let titles = ["while", "#instants", "#mean roll, pitch, yaw, deg", "#RMS, deg", "#our sigma, deg"];
        body.push_str(&table(titles, rows));
        let every = found.differences.len().div_ceil(POINTS).max(1);
        let mut plot = Plot::new("autopilot less this estimate", "deg");
        for (k, (name, (_, color))) in ["roll", "pitch", "yaw"].into_iter().zip(AXES).enumerate() {
            let points = found.differences.iter().step_by(every).map(|(t, d)| (*t, d[k])).collect();
            plot = plot.line(name, color, points);
        }
        body.push_str(&plot.svg()?);
    }
    if let Some(truth) = document.get("truth_comparison") {
        let number_of = |name: &str| truth.get(name).and_then(Value::as_f64);
        let rms = truth_comparison::figures(truth, "attitude_rms_deg");
        if let (Some([roll, pitch, yaw]), Some(from_s), Some(shift_s)) =
            (rms, number_of("from_s"), number_of("time_shift_s"))
        {
            let _ = write!(
                body,
                "<p>Against the truth that the simulated vehicle sends, from {from_s:.0} s on: RMS roll {roll:.3}°, pitch \
                 {pitch:.3}°, yaw {yaw:.3}°, after a shift of {:.0} ms{}.</p>",
                1e3 * shift_s,
                truth_comparison::shares(truth).map_or_else(String::new, |shares| format!("; {shares}"))
            );
        }
    }
    Ok(())
}
