//! The first screen of the report of a flight: where it comes from, the verdict, and what an engineer asks first.

use super::attitude::{Comparison, why_not_compared};
use super::innovations::Channel;
use super::lessons::{self, Lesson, is_g};
use super::log::FlightLog;
use super::motion::{AUTOPILOT, Fitted, OURS};
use super::words;

use crate::engine::snapshot::{Phase, StateStatus, Status, Summary};
use crate::explain::words::number;
use crate::report::page::{answers as list, escape};
use std::fmt::Write;

/// Two attitudes that differ by no more than so many sigmas of ours are alike.
const OWN_SIGMAS: f64 = 2.0;

/// Name, origin, and what the log can answer.
pub fn head(origin: &super::Origin, s: &Summary, (scope, next): &(String, String), body: &mut String) {
    let vehicle = match (origin.beside.on_board.class, s.vehicle_type.as_str()) {
        (Some(class), _) => class.words(),
        (None, "fixed_wing") => "fixed wing",
        (None, "multirotor") => "multirotor",
        _ => "vehicle type not in the log",
    };
    let unit =
        origin.beside.on_board.unit().map_or_else(String::new, |unit| format!(" · unit {}", escape(&unit)));
    let date = if origin.date.is_empty() { "date not in the log" } else { &origin.date };
    let imu = if s.imu.message.is_empty() { "no inertial message" } else { &s.imu.message };
    let warning = super::scope::warning(&origin.beside)
        .map_or_else(String::new, |text| format!("<p class=\"verdict grade-bad\">{}</p>", escape(&text)));
    let _ = write!(
        body,
        "<h1>{}</h1><p class=\"quiet\">{} · {vehicle}, {}{unit} · {:.0} s · {} at {:.1} Hz, {} samples, {} dropped · {} fixes, {} used, \
         {} rejected · model: {} · gaware {}</p>{warning}<p>{} {}</p>",
        escape(&origin.log),
        escape(date),
        if s.autopilot == "unknown" { "autopilot not in the log".to_owned() } else { escape(&s.autopilot) },
        if s.imu.samples == 0 { origin.beside.health.end_s().max(0.0) } else { s.duration_s },
        escape(imu),
        s.imu.rate_hz,
        s.imu.samples,
        s.imu.dropped,
        s.gnss.fixes,
        s.gnss.used,
        s.gnss.rejected,
        escape(&origin.model),
        env!("CARGO_PKG_VERSION"),
        escape(scope),
        escape(next)
    );
}

/// The result of this estimate in words, and its warnings.
pub fn verdict(s: &Summary, body: &mut String) {
    let mut words = escape(&words::verdict(s));
    for command in ["gaware explain", "gaware ground"] {
        words = words.replace(&format!("`{command}`"), &format!("<code>{command}</code>"));
    }
    let _ = write!(body, "<h2 id=\"estimate\">This estimate</h2><p class=\"verdict\">{words}</p>");
    if !s.warnings.is_empty() {
        body.push_str("<ul>");
        for warning in &s.warnings {
            let _ = write!(body, "<li>{}</li>", escape(warning));
        }
        body.push_str("</ul>");
    }
}

/// What an engineer asks first, each with a link to the evidence.
pub fn answers(s: &Summary, log: &FlightLog, lessons: &[Lesson], fixes: &[Channel], body: &mut String) {
    let usable = s.implausible.is_empty();
    let g: Vec<&StateStatus> = s.observability.states.iter().filter(|x| is_g(&x.name)).collect();
    let observable = g.iter().filter(|x| x.status == Status::Observable).count();
    let next = if !usable {
        "Run <code>gaware explain</code> on this log: it tests which sensor error this is. Where it names one, replay with its <code>model.toml</code>."
    } else if observable == g.len() {
        "Run <code>gaware explain</code> on this log: it tests which effects the model lacks."
    } else {
        "Turn the vehicle to six sides by hand (<code>gaware ground</code>) or fly what is named in the verdict, then run <code>gaware explain</code> on the recording."
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
    let verdict = if s.turn.text.is_empty() { String::new() } else { format!("; {}", s.turn.text) };
    format!(
        "Gyro error at {}: {}, {}, {} deg per minute{verdict}.",
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

/// Whose attitude fits the motion, and how sure that is.
pub fn whose(compared: Option<&Comparison>, fitted: &[Fitted], log: &FlightLog) -> String {
    let apart = compared.and_then(|c| c.rows.first()).map_or_else(String::new, |r| {
        format!(
            " The autopilot and this estimate differ by {:.1} / {:.1} / {:.1}° RMS in roll, pitch, yaw (our sigma {:.1} / {:.1} / {:.1}°). \
             <a href=\"#attitude\">Comparison</a>.",
            r.rms_deg[0], r.rms_deg[1], r.rms_deg[2], r.sigma_deg[0], r.sigma_deg[1], r.sigma_deg[2]
        )
    });
    let of = |name: &str| fitted.iter().find(|f| f.name == name);
    let (autopilot, ours) = match (of(AUTOPILOT), of(OURS)) {
        (Some(autopilot), Some(ours)) => (autopilot, ours),
        // Without ours its own lanes still stand against each other.
        (Some(autopilot), None) if fitted.len() > 1 => {
            return match fitted
                .iter()
                .find(|f| f.t == 0.0 && f.name != AUTOPILOT)
                .filter(|_| autopilot.is_worse())
            {
                Some(best) => format!(
                    "Not the autopilot's: {} fits the motion better ({:.2} against {:.2} m/s²; {:.1} standard errors). <a href=\"#motion\">All attitudes</a>.",
                    escape(&best.name),
                    best.misfit,
                    autopilot.misfit,
                    autopilot.t
                ),
                None => format!(
                    "Not decided: no other attitude of the log fits the motion better than the autopilot's beyond chance ({:.2} m/s²), and the yaw of this estimate is not known \
                     well enough to be compared. <a href=\"#motion\">All attitudes</a>.",
                    autopilot.misfit
                ),
            };
        }
        _ => return format!("{}{apart}", why_not_compared(&log.attitudes, &log.snapshots)),
    };
    let (better, worse, name) = if autopilot.misfit > ours.misfit {
        (ours, autopilot, "The autopilot's")
    } else {
        (autopilot, ours, "This estimate's")
    };
    // What the own estimate does not know better than that is no one's fault.
    let within = |r: &super::attitude::Row| (0..3).all(|k| r.rms_deg[k] <= OWN_SIGMAS * r.sigma_deg[k]);
    let alike = compared.and_then(|c| c.rows.first()).is_some_and(within);
    let Some(t) = worse.worse_than(better).filter(|_| !alike) else {
        if let Some(wrong) = for_a_while(autopilot, ours) {
            return format!(
                "{wrong} Over the whole flight both fit the motion alike ({:.2} and {:.2} m/s² for the autopilot and this estimate).{apart} \
                 <a href=\"#motion\">All attitudes</a>.",
                autopilot.misfit, ours.misfit
            );
        }
        return format!(
            "Both fit the motion alike ({:.2} and {:.2} m/s² for the autopilot and this estimate): this flight does not decide it.{apart} \
             <a href=\"#motion\">All attitudes</a>.",
            autopilot.misfit, ours.misfit
        );
    };
    let yaw = worse.yaw_off_deg.filter(|(off, sigma)| off.abs() > 3.0 * sigma && off.abs() > 2.0);
    let yaw = yaw.map_or_else(String::new, |(off, sigma)| format!(", its yaw off by {off:.0} ± {sigma:.0}°"));
    let other = if name == "The autopilot's" { "this estimate" } else { "the autopilot" };
    format!(
        "<b>{name} {}</b>{yaw}. The specific force turned by it misses the change of GNSS velocity by {:.2} m/s², by {other}'s by {:.2}: beyond chance, {t:.1} \
         standard errors.{apart} <a href=\"#motion\">All attitudes</a>.",
        if yaw.is_empty() { "fits worse" } else { "is wrong" },
        worse.misfit,
        better.misfit
    )
}

/// Whose yaw is wrong for a while only, where that is one of the two.
fn for_a_while(autopilot: &Fitted, ours: &Fitted) -> Option<String> {
    let (name, stretch) = match (&autopilot.stretch, &ours.stretch) {
        (Some(stretch), None) => ("The autopilot's", stretch),
        (None, Some(stretch)) => ("This estimate's", stretch),
        _ => return None,
    };
    Some(format!(
        "<b>{name} is wrong for a while</b>: its yaw is off by {:.0} ± {:.0}° between {:.0} and {:.0} s, where that of {} fits the motion.",
        stretch.off_deg,
        stretch.sigma_deg,
        stretch.from_s,
        stretch.to_s,
        escape(&stretch.against)
    ))
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
    if s.gnss.used == 0 {
        return "Not known: no fix was used.".to_owned();
    }
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
    let rms = format!("{} sigma RMS; 1 is right", number(nis.sqrt()));
    let answer = if nis > 1.5 {
        format!(
            "No: the fixes differ from what is expected of them by more than the model allows ({rms}): it lacks an effect."
        )
    } else if nis < 0.5 && worst.is_some_and(|c| c.largest.1.abs() > FAR_SIGMAS) {
        format!("On the whole ({rms}), but not everywhere.")
    } else if nis < 0.5 {
        format!(
            "Yes, amply: the fixes differ from what is expected of them by less than the model allows ({rms}): they are better than it assumes."
        )
    } else {
        format!("Yes: the fixes differ from what is expected of them as much as they should ({rms}).")
    };
    format!("{answer}{outlier}")
}

/// An innovation beyond this is none of chance, however small the others are.
const FAR_SIGMAS: f64 = 5.0;

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
