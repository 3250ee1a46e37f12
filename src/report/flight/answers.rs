//! The first screen of the report of a flight: where it comes from, the verdict, and what an engineer asks first.

use super::attitude::{Comparison, Row, why_not_compared};
use super::innovations::Channel;
use super::lessons::{self, Lesson, is_g};
use super::log::FlightLog;
use super::words;
use super::yaw::{Worse, Yaws};
use crate::engine::snapshot::{Phase, StateStatus, Status, Summary};
use crate::report::page::{answers as list, escape};
use std::fmt::Write;

/// Name, origin, verdict and warnings.
pub fn head(origin: &super::Origin, s: &Summary, body: &mut String) {
    let vehicle = match s.vehicle_type.as_str() {
        "fixed_wing" => "fixed wing",
        "multirotor" => "multirotor",
        _ => "vehicle type not in the log",
    };
    let date = if origin.date.is_empty() { "date not in the log" } else { &origin.date };
    let imu = if s.imu.message.is_empty() { "no inertial message" } else { &s.imu.message };
    let _ = write!(
        body,
        "<h1>{}</h1><p class=\"quiet\">{} · {vehicle}, {} · {:.0} s · {} at {:.1} Hz, {} samples, {} dropped · {} fixes, {} used, \
         {} rejected · model: {} · gaware {}</p><p class=\"verdict\">{}</p>",
        escape(&origin.log),
        escape(date),
        if s.autopilot == "unknown" { "autopilot not in the log".to_owned() } else { escape(&s.autopilot) },
        s.duration_s,
        escape(imu),
        s.imu.rate_hz,
        s.imu.samples,
        s.imu.dropped,
        s.gnss.fixes,
        s.gnss.used,
        s.gnss.rejected,
        escape(&origin.model),
        env!("CARGO_PKG_VERSION"),
        escape(&words::verdict(s)).replacen("`gaware explain`", "<code>gaware explain</code>", 1)
    );
    if !s.warnings.is_empty() {
        body.push_str("<ul>");
        for warning in &s.warnings {
            let _ = write!(body, "<li>{}</li>", escape(warning));
        }
        body.push_str("</ul>");
    }
}

/// What an engineer asks first, each with a link to the evidence.
pub fn answers(
    s: &Summary,
    log: &FlightLog,
    lessons: &[Lesson],
    compared: Option<&Comparison>,
    fixes: &[Channel],
    body: &mut String,
) {
    let usable = s.implausible.is_empty();
    let g: Vec<&StateStatus> = s.observability.states.iter().filter(|x| is_g(&x.name)).collect();
    let observable = g.iter().filter(|x| x.status == Status::Observable).count();
    let next = if !usable {
        "Run <code>gaware explain</code> on this log: it names the unmodelled error. Then replay with its <code>model.toml</code>."
    } else if observable == g.len() {
        "Run <code>gaware explain</code> on this log: it tests which effects the model lacks."
    } else {
        "Fly what is named in the verdict, then run <code>gaware explain</code> on the log."
    };
    body.push_str(&list(&[
        (
            "Is G large, how sure?",
            if usable {
                format!("{} <a href=\"#g\">All elements</a>.", large(s))
            } else {
                "Not answered: an unmodelled error is absorbed by these states, so the values are not shown."
                    .to_owned()
            },
        ),
        ("What does it do in a turn?", if usable && !g.is_empty() { in_a_turn(s) } else { String::new() }),
        ("What could not be seen?", unseen(&g)),
        (
            "What taught most?",
            lessons.iter().max_by(|a, b| a.gain.total_cmp(&b.gain)).map_or_else(String::new, |l| {
                format!(
                    "{:.0} to {:.0} s: {}. <a href=\"#learning\">All parts</a>.",
                    l.start_s,
                    l.end_s,
                    escape(&l.did)
                )
            }),
        ),
        (
            "Whose attitude is wrong?",
            compared
                .map_or_else(|| why_not_compared(&log.attitudes, &log.snapshots), |c| whose(c, &log.yaws)),
        ),
        ("What changed in flight?", changed(log)),
        ("Does the model fit?", fit(s, fixes)),
        ("What now?", next.to_owned()),
    ]));
}

/// What to do about a log that gives no estimate.
pub fn without_estimate(s: &Summary, body: &mut String) {
    let next = match s.phase {
        Phase::WaitingForImu => {
            "Record inertial samples: <code>gaware run</code> asks the autopilot for them, or set the stream rates of the autopilot (RAW_IMU, SCALED_IMU \
             or HIGHRES_IMU at 50 Hz or more)."
        }
        Phase::WaitingForGnss => {
            "Record a flight with GNSS: at least a minute outdoors with a 3-D fix, and the GNSS messages in the log (GPS_RAW_INT, in PX4's \
             log vehicle_gps_position, in DataFlash GPS)."
        }
        Phase::Aligning => "Record longer: the estimate starts after a second of inertial samples and a fix.",
        Phase::SearchingHeading | Phase::Running => {
            "Record a flight: the heading is found once the vehicle accelerates or turns."
        }
    };
    body.push_str(&list(&[("What now?", next.to_owned())]));
}

/// The largest element in the whole of G, whatever its sigma.
fn large(s: &Summary) -> String {
    let g = &s.estimate.g_sensitivity_deg_per_h_per_g;
    let all = (0..9).map(|k| (k / 3, k % 3)).filter(|(r, c)| g.sigma[*r][*c] > 0.0);
    let sure = all.clone().filter(|(r, c)| g.value[*r][*c].abs() > words::SURE * g.sigma[*r][*c]).count();
    let best = all.max_by(|a, b| {
        let ratio = |(r, c): &(usize, usize)| g.value[*r][*c].abs() / g.sigma[*r][*c];
        ratio(a).total_cmp(&ratio(b))
    });
    match best {
        None => "G is not estimated by this model.".to_owned(),
        // A value within its sigma is no result.
        Some(_) if sure == 0 => "No element of G differs from zero by more than 3 sigma.".to_owned(),
        Some((r, c)) => format!(
            "{sure} of 9 elements differ from zero by more than 3 sigma; the most certain is g{}{} = {:.0} ± {:.0} deg/h/g.",
            r + 1,
            c + 1,
            g.value[r][c],
            g.sigma[r][c]
        ),
    }
}

fn in_a_turn(s: &Summary) -> String {
    let all = words::meanings(&s.estimate.g_sensitivity_deg_per_h_per_g, &s.vehicle_type);
    let Some(turn) = all.first() else { return String::new() };
    let part = |k: usize, name: &str| {
        format!("{name} {:.1} ± {:.1}", turn.error_deg_per_min[k].0, turn.error_deg_per_min[k].1)
    };
    let verdict = if s.turn.text.is_empty() { String::new() } else { format!(" {}.", s.turn.text) };
    format!(
        "Gyro error at {}: {}, {}, {} deg per minute.{verdict}",
        turn.when,
        part(0, "roll"),
        part(1, "pitch"),
        part(2, "yaw")
    )
}

fn unseen(g: &[&StateStatus]) -> String {
    let open: Vec<&str> =
        g.iter().filter(|x| x.status != Status::Observable).map(|x| x.name.as_str()).collect();
    match (g.len(), open.len()) {
        (0, _) => String::new(),
        (_, 0) => "Nothing: every element of G has converged.".to_owned(),
        (_, _) => {
            format!("{} of {} elements of G have not converged: {}.", open.len(), g.len(), open.join(", "))
        }
    }
}

/// Whose yaw is the worse one, where the two differ by more than our own sigma and the motion decides it.
fn whose_yaw(yaws: &Yaws, whole: &Row) -> &'static str {
    if whole.rms_deg[2] <= whole.sigma_deg[2] {
        return " The yaws differ by no more than our own sigma.";
    }
    match yaws.worse() {
        Some(Worse::Autopilot) => {
            " The specific force turned by the autopilot's yaw fits the change of GNSS velocity worse than by ours: the autopilot's yaw is the worse one."
        }
        Some(Worse::Ours) => {
            " The specific force turned by the autopilot's yaw fits the change of GNSS velocity better than by ours: this estimate's yaw is the worse one."
        }
        None => {
            " Whose yaw is the worse one this flight does not decide: it accelerates too little or too seldom."
        }
    }
}

fn whose(c: &Comparison, yaws: &Yaws) -> String {
    let turns = c.rows.iter().find(|r| r.regime.starts_with("in turns")).or_else(|| c.rows.first());
    let (Some(r), Some(whole)) = (turns, c.rows.first()) else { return String::new() };
    format!(
        "The autopilot and this estimate differ by {:.2} / {:.2} / {:.2}° RMS in roll, pitch, yaw, {}; our own sigma is {:.2} / {:.2} / {:.2}°.{} \
         <a href=\"#attitude\">Comparison</a>.",
        r.rms_deg[0],
        r.rms_deg[1],
        r.rms_deg[2],
        r.regime,
        r.sigma_deg[0],
        r.sigma_deg[1],
        r.sigma_deg[2],
        whose_yaw(yaws, whole)
    )
}

/// The states that converged, in the order in which they did.
fn changed(log: &FlightLog) -> String {
    let mut since = lessons::known_since(&log.snapshots);
    since.retain(|(name, _)| is_g(name) || name.starts_with("bg_"));
    since.sort_by(|a, b| a.1.total_cmp(&b.1));
    match (since.first(), since.last()) {
        (Some((first, t0)), Some((last, t1))) => {
            format!(
                "{} states converged, from {first} at {t0:.0} s to {last} at {t1:.0} s. <a href=\"#biases\">Over time</a>.",
                since.len()
            )
        }
        _ => "No element of G and no gyro bias converged.".to_owned(),
    }
}

fn fit(s: &Summary, fixes: &[Channel]) -> String {
    let nis = s.consistency.nis_mean_per_dof;
    let worst = fixes.iter().max_by(|a, b| a.largest.1.abs().total_cmp(&b.largest.1.abs()));
    let outlier = worst.map_or_else(String::new, |c| {
        format!(
            " The largest innovation is {:.0} sigma in {} at {:.0} s (rejected fixes included).",
            c.largest.1.abs(),
            c.name,
            c.largest.0
        )
    });
    let word = if nis > 1.5 {
        "too large, so the model lacks an effect"
    } else if nis < 0.5 {
        "too small, so the model assumes more noise than there is"
    } else {
        "as it should be"
    };
    format!("NIS of the fixes used: {nis:.2} per degree of freedom (1 is right), {word}.{outlier}")
}

/// The last section: what is on this page, and no more.
pub fn how_to_read(body: &mut String) {
    body.push_str(
        "<h2>How to read this</h2><p>Values are given with one sigma. G says what an acceleration does to the gyros: \
         g<sub>31</sub> is what one g forward does to the yaw gyro. A state has converged once its sigma is below the \
         target. An innovation is what a fix says less what was expected of it, over its expected sigma: within ±1 two \
         times out of three when nothing is missing. In the plots: drag to zoom all of them, double click for the whole flight; \
         the CSV link holds the values of the plot.</p>",
    );
}
