//! The judgement: ok, look or bad for each part of the vehicle, with the time of the first event and what it was.
//!
//! Thresholds are those that the autopilots' own documentation and log viewers use; each cites its source.

use super::logger::{LOSSY, Losses};
use super::rows::{Row, rows};
use super::{HealthLog, Series, in_spans};
use crate::advice::on_board::OnBoard;
use crate::logs::Level;
use crate::logs::filter::Channel;
use schemars::JsonSchema;
use serde::Serialize;

/// How a part was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// The log does not say.
    Unknown,
    /// Nothing out of the ordinary.
    Ok,
    /// Something to look at.
    Look,
    /// Something that ends estimates or flights.
    Bad,
}

impl Grade {
    /// On screens.
    pub fn word(self) -> &'static str {
        match self {
            Self::Unknown => "not in the log",
            Self::Ok => "ok",
            Self::Look => "look",
            Self::Bad => "bad",
        }
    }
}

/// The judgement of one part.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Check {
    /// Which part.
    pub part: &'static str,
    /// How it was.
    pub grade: Grade,
    /// When the worst began, s since the first inertial sample.
    pub t_s: Option<f64>,
    /// What it was, in a sentence without a full stop.
    pub text: String,
}

/// One finding of a part.
pub(super) type Finding = (Grade, Option<f64>, String);

/// A test ratio above 1 is a rejected measurement; so long in a row, s, it is worth a look, and so long the filter has lost it. Flight
/// Review's diagnostics warn at 2 s and call 5 s critical.
const REJECTED_S: [f64; 2] = [2.0, 5.0];
/// ArduPilot, "Measuring Vibration": below 30 m/s² is fine, above 60 nearly always a problem.
const VIBRATION_ARDUPILOT: [f64; 2] = [30.0, 60.0];
/// PX4 Flight Review, "Vibration Metrics": above 4.905 m/s² is a warning, above 9.81 critical.
const VIBRATION_PX4: [f64; 2] = [4.905, 9.81];
/// ArduPilot, "Measuring Vibration": more than 100 samples at the end of the range in a flight are serious.
const CLIPPED: f64 = 100.0;
/// Satellites and dilution as GPS_HDOP_GOOD (1.4) and both firmwares' pre-arm checks (6 satellites) have them.
const SATELLITES: [f64; 2] = [8.0, 6.0];
const HDOP: [f64; 2] = [1.4, 2.5];
/// A receiver that is silent for so long, s: ArduPilot declares it lost after 4 s (`AP_GPS`, `GPS_TIMEOUT_MS`); half as long is worth a look.
pub(super) const SILENT_S: [f64; 2] = [2.0, 4.0];
/// A fix that jumps by so much moves a vehicle that holds its position, m.
const JUMP_BAD_M: f64 = 20.0;
/// u-blox, "jammingIndicator": 0 to 255; PX4 Flight Review warns above 80.
const JAMMING: f64 = 80.0;
/// Share of the entries that the logger lost: beyond the second, explain uses no value.
const LOST: [f64; 2] = [0.0, LOSSY];
/// Texts that are shown.
const TEXTS: usize = 6;

/// The judgement of every part.
///
/// Of a log that says that the vehicle was never armed all of it is judged, and nothing is worse than worth a look: no flight ended by it.
pub fn checks(log: &HealthLog, px4: bool, board: &OnBoard) -> Vec<Check> {
    let no_flight = log.is_of_no_flight();
    // Spans that never were say nothing of a vehicle that moved.
    let real = |spans: &Vec<(f64, f64)>| !spans.is_empty() || no_flight;
    let (flown, armed) = (log.flown().filter(real), log.armed().or_else(|| log.flown()).filter(real));
    let in_flight = |t: f64| in_spans(&flown, t);
    let judged = |t: f64| no_flight || in_flight(t);
    let armed = |t: f64| in_spans(&armed, t);
    let j = Judge { log, px4, board, in_flight: &judged, armed: &armed };
    let mut all = vec![
        j.part("autopilot's estimator", j.estimator(), !log.ratios.is_empty()),
        j.part("failsafes", j.failsafes(), !log.modes.is_empty()),
        j.part("GNSS", j.gnss(), !log.receiver.is_empty()),
        j.part("vibration", j.vibration(), !log.vibration.is_empty() || !log.clipped.is_empty()),
        j.part("compass", j.compass(), log.ratios.contains_key(&Channel::HeadingRatio)),
        j.part("battery and supply", j.power(), !log.battery.is_empty()),
        j.part("attitude", log.leans(board, &judged), log.has_leans()),
        j.part("motors", j.motors(), log.has_motors(board)),
        j.part("messages", j.texts(&|text| !is_of_failsafe(text), &in_flight), !log.texts.is_empty()),
        j.part("logger", j.logger(), log.tells_losses()),
        j.part("end of the log", j.end(), log.armed().is_some()),
    ];
    if no_flight {
        all.iter_mut().for_each(|check| check.grade = check.grade.min(Grade::Look));
    }
    all
}

/// The verdict: what is bad first, by time, then what to look at.
pub fn verdict(log: &HealthLog, checks: &[Check]) -> String {
    let mut bad: Vec<&Check> = checks.iter().filter(|c| c.grade == Grade::Bad).collect();
    bad.sort_by(|a, b| a.t_s.unwrap_or(f64::MAX).total_cmp(&b.t_s.unwrap_or(f64::MAX)));
    let look: Vec<&str> = checks.iter().filter(|c| c.grade == Grade::Look).map(|c| c.part).collect();
    let known = checks.iter().filter(|c| c.grade != Grade::Unknown).count();
    let at = |c: &Check| c.t_s.map_or_else(String::new, |t| format!(" from {t:.1} s"));
    if known == 0 {
        return "The log says nothing of the vehicle's health.".to_owned();
    }
    if log.is_of_no_flight() {
        let found = match look[..] {
            [] => format!("Nothing out of the ordinary in {known} checks of a vehicle that does not fly."),
            _ => format!("Look at {}.", look.join(", ")),
        };
        return format!("The vehicle was never armed in this log. {found}");
    }
    let mut text = match bad.first() {
        Some(first) => format!("Bad: {}{}: {}.", first.part, at(first), first.text),
        None if look.is_empty() => format!("Healthy in all {known} checks that this log allows."),
        None => format!("Nothing bad in {known} checks; look at {}.", look.join(", ")),
    };
    let others: Vec<String> = bad.iter().skip(1).map(|c| format!("{}{}", c.part, at(c))).collect();
    if !others.is_empty() {
        text.push_str(&format!(" Also bad: {}.", others.join(", ")));
    }
    if !bad.is_empty() && !look.is_empty() {
        text.push_str(&format!(" Look at {}.", look.join(", ")));
    }
    text
}

/// Which part a fault belongs to.
fn part_of(what: &str) -> &'static str {
    let has = |words: &[&str]| words.iter().any(|word| what.contains(word));
    if has(&["battery", "supply"]) {
        "power"
    } else if has(&["motor", "ESC", "propeller", "thrust"]) {
        "motors"
    } else if has(&["magnet", "compass"]) {
        "compass"
    } else if has(&["EKF", "estimate", "position invalid", "dead reckoning"]) {
        "estimator"
    } else if has(&["GPS", "GNSS"]) {
        "GNSS"
    } else {
        "failsafes"
    }
}

struct Judge<'a> {
    log: &'a HealthLog,
    px4: bool,
    board: &'a OnBoard,
    in_flight: &'a dyn Fn(f64) -> bool,
    armed: &'a dyn Fn(f64) -> bool,
}

impl Judge<'_> {
    /// The worst findings of a part in one sentence.
    fn part(&self, part: &'static str, mut found: Vec<Finding>, known: bool) -> Check {
        if !known && found.is_empty() {
            return Check { part, grade: Grade::Unknown, t_s: None, text: "not in the log".to_owned() };
        }
        found.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.unwrap_or(f64::MAX).total_cmp(&b.1.unwrap_or(f64::MAX))));
        let grade = found.first().map_or(Grade::Ok, |f| f.0);
        let t_s = found.iter().filter(|f| f.0 == grade && grade > Grade::Ok).find_map(|f| f.1);
        let text: Vec<&str> = found.iter().map(|f| f.2.as_str()).collect();
        let text = if text.is_empty() { "nothing out of the ordinary".to_owned() } else { text.join("; ") };
        Check { part, grade, t_s, text }
    }

    /// Values in flight with their times, s.
    fn flown<'b, T: Copy>(&'b self, series: &'b Series<T>) -> impl Iterator<Item = (f64, T)> + 'b {
        series.iter().map(|(t, v)| (self.log.s(*t), *v)).filter(|(t, _)| (self.in_flight)(*t))
    }

    /// Faults that begin at such times.
    fn faults(&self, of: &dyn Fn(&str) -> bool, at: &dyn Fn(f64) -> bool) -> Vec<Finding> {
        let mut found = Vec::new();
        for (what, (grave, series)) in self.log.faults.iter().filter(|(what, _)| of(what)) {
            let begun = series.windows(2).filter(|w| !w[0].1 && w[1].1).map(|w| w[1].0);
            // An error report has no state before.
            let first = series.first().filter(|(_, on)| *on && is_event(what)).map(|(t, _)| *t);
            let starts: Vec<f64> =
                first.into_iter().chain(begun).map(|t| self.log.s(t)).filter(|t| at(*t)).collect();
            if let Some(start) = starts.first() {
                let grade = if *grave { Grade::Bad } else { Grade::Look };
                let times =
                    if starts.len() > 1 { format!(" ({} times)", starts.len()) } else { String::new() };
                found.push((grade, Some(*start), format!("{what} at {start:.1} s{times}")));
            }
        }
        found
    }

    fn estimator(&self) -> Vec<Finding> {
        let mut found = self.faults(&|what| part_of(what) == "estimator", self.in_flight);
        for channel in [Channel::VelocityRatio, Channel::PositionRatio, Channel::HeightRatio] {
            found.extend(self.rejected(channel));
        }
        for (what, series) in &self.log.resets {
            let steps: Vec<f64> = series
                .windows(2)
                .filter(|w| w[1].1 > w[0].1)
                .map(|w| self.log.s(w[1].0))
                .filter(|t| (self.in_flight)(*t))
                .collect();
            // A reset soon after take-off aligns the filter.
            if let Some(first) = steps.first() {
                let grade = if steps.len() > 3 { Grade::Bad } else { Grade::Look };
                found.push((
                    grade,
                    Some(*first),
                    format!("{what} reset {} in flight, first at {first:.1} s", times(steps.len())),
                ));
            }
        }
        let lanes: Vec<(f64, u8)> = self.log.lanes.iter().map(|(t, l)| (self.log.s(*t), *l)).collect();
        let switches: Vec<&(f64, u8)> = lanes.iter().skip(1).filter(|(t, _)| (self.in_flight)(*t)).collect();
        if let Some((t, lane)) = switches.first() {
            let grade = if switches.len() > 3 { Grade::Bad } else { Grade::Look };
            found.push((
                grade,
                Some(*t),
                format!("lane switched {}, first to {lane} at {t:.1} s", times(switches.len())),
            ));
        }
        found
    }

    /// Rows of test ratios above 1.
    fn rejected(&self, channel: Channel) -> Option<Finding> {
        let series = self.log.ratios.get(&channel)?;
        let mut rows = rows(self.flown(series), 1.0);
        rows.retain(|row| row.length_s() >= REJECTED_S[0]);
        let whole: f64 = rows.iter().map(Row::length_s).sum();
        let peak = rows.iter().map(|row| row.peak).fold(0.0, f64::max);
        let count = rows.len();
        let Row { start, end, .. } = rows.into_iter().max_by(|a, b| a.length_s().total_cmp(&b.length_s()))?;
        let others =
            if count > 1 { format!(", {count} times in all for {whole:.1} s") } else { String::new() };
        let lost = end - start >= REJECTED_S[1] && channel != Channel::HeadingRatio;
        let grade = if lost { Grade::Bad } else { Grade::Look };
        let text = format!(
            "{} above 1 for {:.1} s from {start:.1} s{others} (up to {peak:.1}): rejected",
            channel.words(),
            end - start
        );
        Some((grade, Some(start), text))
    }

    fn compass(&self) -> Vec<Finding> {
        let mut found = self.faults(&|what| part_of(what) == "compass", self.in_flight);
        found.extend(self.rejected(Channel::HeadingRatio));
        found
    }

    fn gnss(&self) -> Vec<Finding> {
        let mut found = self.faults(&|what| part_of(what) == "GNSS", self.in_flight);
        let all: Vec<_> = self.flown(&self.log.receiver).collect();
        let lost = all.windows(2).find(|w| w[0].1.fix_type >= 3 && w[1].1.fix_type < 3);
        found.extend(lost.map(|w| (Grade::Bad, Some(w[1].0), format!("3-D fix lost at {:.1} s", w[1].0))));
        found.extend(self.log.silence(self.in_flight).map(|(from, length)| {
            let grade = if length >= SILENT_S[1] { Grade::Bad } else { Grade::Look };
            (grade, Some(from), format!("no word of the receiver for {length:.0} s from {from:.1} s"))
        }));
        if !all.is_empty() && all.iter().all(|(_, r)| r.fix_type < 3) {
            found.push((Grade::Bad, all.first().map(|a| a.0), "no 3-D fix in the whole flight".to_owned()));
        }
        let fixed = || all.iter().filter(|(_, r)| r.fix_type >= 3);
        let least = fixed().filter_map(|(t, r)| Some((*t, r.satellites?))).min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((t, n)) = least {
            let grade = graded_below(n, SATELLITES);
            found.push((grade, Some(t), format!("{n:.0} satellites at least")));
        }
        let most = fixed().filter_map(|(t, r)| Some((*t, r.hdop?))).max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((t, hdop)) = most {
            found.push((graded_above(hdop, HDOP).min(Grade::Look), Some(t), format!("HDOP up to {hdop:.1}")));
        }
        let jumps: Vec<(f64, f64)> = self.flown(&self.log.jumps).collect();
        if let Some((t, _)) = jumps.first() {
            let largest = jumps.iter().map(|j| j.1).fold(0.0, f64::max);
            let grade = if largest > JUMP_BAD_M { Grade::Bad } else { Grade::Look };
            found.push((
                grade,
                Some(*t),
                format!("position jumps {}, up to {largest:.0} m, first at {t:.1} s", times(jumps.len())),
            ));
        }
        let jammed = self.flown(&self.log.jamming).find(|(_, v)| *v > JAMMING);
        found
            .extend(jammed.map(|(t, v)| {
                (Grade::Look, Some(t), format!("jamming indicator {v:.0} of 255 at {t:.1} s"))
            }));
        let interfered = self.flown(&self.log.interference).find(|(_, on)| *on);
        found.extend(
            interfered.map(|(t, _)| {
                (Grade::Bad, Some(t), format!("the receiver reports interference at {t:.1} s"))
            }),
        );
        found
    }

    fn vibration(&self) -> Vec<Finding> {
        let limits = if self.px4 { VIBRATION_PX4 } else { VIBRATION_ARDUPILOT };
        let mut found = Vec::new();
        for (unit, series) in &self.log.vibration {
            let mut levels: Vec<f64> = self.flown(series).map(|(_, v)| v).collect();
            levels.sort_by(f64::total_cmp);
            // One landing is no vibration: the level that a twentieth of the flight exceeds.
            let Some(level) = levels.get(levels.len() * 19 / 20) else { continue };
            let beyond = if *level > limits[1] { limits[1] } else { limits[0] };
            let first = self.flown(series).find(|(_, v)| *v > beyond).map(|(t, _)| t);
            found.push((graded_above(*level, limits), first, format!("IMU{unit} {level:.1} m/s²")));
        }
        for (unit, series) in &self.log.clipped {
            let steps = series.windows(2).filter(|w| w[1].1 > w[0].1);
            let steps: Vec<(f64, f64)> = steps.map(|w| (self.log.s(w[1].0), w[1].1 - w[0].1)).collect();
            let in_flight: Vec<&(f64, f64)> = steps.iter().filter(|(t, _)| (self.in_flight)(*t)).collect();
            let count: f64 = in_flight.iter().map(|s| s.1).sum();
            if let Some((t, _)) = in_flight.first() {
                let grade = if count > CLIPPED { Grade::Bad } else { Grade::Look };
                found.push((grade, Some(*t), format!("IMU{unit} clipped {count:.0} times from {t:.1} s")));
            }
        }
        found
    }

    fn power(&self) -> Vec<Finding> {
        let mut found = self.faults(&|what| part_of(what) == "power", self.in_flight);
        found.extend(self.log.power(self.board, self.in_flight));
        found
    }

    fn motors(&self) -> Vec<Finding> {
        let mut found = self.faults(&|what| part_of(what) == "motors", self.in_flight);
        let armed = self.log.armed().unwrap_or_default();
        let flying = |t: f64| armed.iter().any(|(a, b)| (*a..b - 0.5).contains(&t)) && (self.in_flight)(t);
        let stop = self.log.stopped.windows(2).filter(|w| !w[0].1 && w[1].1).map(|w| self.log.s(w[1].0));
        found.extend(
            stop.into_iter().find(|t| flying(*t)).map(|t| {
                (Grade::Bad, Some(t), format!("all motor outputs fall to zero in flight at {t:.1} s"))
            }),
        );
        found.extend(self.log.motor_limits(self.board, &flying));
        found
    }

    /// What state and texts of the autopilot say of failsafes.
    fn failsafes(&self) -> Vec<Finding> {
        let mut found = self.faults(&|what| part_of(what) == "failsafes", self.armed);
        found.extend(self.texts(&is_of_failsafe, self.armed));
        found
    }

    /// Texts beyond information; those at other times are how it should be.
    fn texts(&self, of: &dyn Fn(&str) -> bool, at: &dyn Fn(f64) -> bool) -> Vec<Finding> {
        let grave = |level| if level == Level::Error { Grade::Bad } else { Grade::Look };
        let mut found: Vec<Finding> = Vec::new();
        let worth = self.log.texts.iter().filter(|(_, (level, text))| *level > Level::Info && of(text));
        for (t, (level, text)) in worth {
            let t = self.log.s(*t);
            let quoted = format!("\"{text}\"");
            if found.iter().any(|f| f.2.starts_with(&quoted)) {
                continue;
            }
            // On the ground a refused arming is how it should be.
            let grade = if at(t) { grave(*level) } else { Grade::Ok };
            found.push((grade, Some(t), format!("{quoted} at {t:.1} s")));
        }
        found.sort_by_key(|f| std::cmp::Reverse(f.0));
        let more = found.len().saturating_sub(TEXTS);
        found.truncate(TEXTS);
        if more > 0 {
            found.push((Grade::Ok, None, format!("{more} more")));
        }
        found
    }

    fn logger(&self) -> Vec<Finding> {
        let graded = |lost: Losses| (graded_above(lost.share, LOST), Some(lost.from_s), lost.words());
        self.log.losses().map(graded).into_iter().collect()
    }

    /// A log that ends armed was cut by a crash, a brownout or a full card.
    fn end(&self) -> Vec<Finding> {
        let end = self.log.end_s();
        let open = self.log.armed.last().is_some_and(|(_, on)| *on);
        let flying = open && self.log.air.last().is_some_and(|(_, on)| *on);
        match (open, flying) {
            (_, true) => vec![(
                Grade::Look,
                Some(end),
                format!("the log ends in flight at {end:.1} s: loss of power, crash, or a cut file"),
            )],
            (true, _) => vec![(Grade::Ok, None, "the log ends armed".to_owned())],
            _ => Vec::new(),
        }
    }
}

/// Reports of errors that stand for themselves.
fn is_event(what: &str) -> bool {
    [
        "failsafe",
        "crash",
        "restarted",
        "switch",
        "refused",
        "check",
        "breach",
        "loss",
        "compass",
        "GPS",
        "error",
        "radio",
    ]
    .iter()
    .any(|word| what.contains(word))
        && what != "failsafe"
}

fn is_of_failsafe(text: &str) -> bool {
    text.to_ascii_lowercase().contains("failsafe")
}

fn times(n: usize) -> String {
    if n == 1 { "once".to_owned() } else { format!("{n} times") }
}

fn graded_above(value: f64, [look, bad]: [f64; 2]) -> Grade {
    if value > bad {
        Grade::Bad
    } else if value > look {
        Grade::Look
    } else {
        Grade::Ok
    }
}

pub(super) fn graded_below(value: f64, limits: [f64; 2]) -> Grade {
    graded_above(-value, limits.map(|l| -l))
}
