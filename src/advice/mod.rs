//! The parameter advice: what of an explanation the autopilot itself can correct, by which parameter, to which value.
//!
//! Pure: effects with values and sigmas in, proposals out. [`table`] holds the mappings with their sources, [`rule`] the arithmetic,
//! [`on_board`] what the logs say of the vehicle's own parameters, [`start`] which of them are first values of an estimate, [`mod@file`] the parameter file. It changes nothing on any vehicle;
//! `gaware params apply` does that.

pub mod file;
pub mod on_board;
pub mod rule;
pub mod start;
pub mod table;

use gaware_mission::item::Autopilot;
use gaware_mission::params::ParamType;
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::log10;
use on_board::OnBoard;
use rule::{Change, Derived};
use schemars::JsonSchema;
use serde::Serialize;
use table::{Era, Mapping, Rule};

/// A value this many sigmas from what is assumed is significant.
const SIGNIFICANT: f64 = 3.0;
/// What is said of an antenna's place that someone has set.
const MEASURED_PLACE: &str =
    "the vehicle has a place already: where that was measured with a tape it may be better than this one";
/// A board rotation of less than this changes a correction by less than its sigma, deg.
const SMALL_ROTATION_DEG: f64 = 2.0;
/// From this on PX4 takes a bias of an accelerometer into its offset, m/s² (`VehicleIMU.cpp`, `SensorCalibrationSaveAccel`).
const COMMITTED_FROM: f64 = 0.05;

/// An effect that an explanation names, with its values.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Effects that the flight does not separate, the best first.
    pub names: Vec<&'static str>,
    /// Values of the best, SI, in the order of its parameters.
    pub values: Vec<f64>,
    /// Their 1-sigma, SI.
    pub sigmas: Vec<f64>,
    /// Why its values must not be used, where there is a reason.
    pub barred: Option<&'static str>,
}

/// A parameter that is to change.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Proposal {
    /// Its name.
    pub parameter: &'static str,
    /// Its value on board, where the log has it.
    pub on_board: Option<f64>,
    /// The new value; `null` where it depends on values that the log lacks (see `needs`).
    pub proposed: Option<f64>,
    /// 1-sigma of the new value, or of the change where that is not known.
    pub sigma: f64,
    /// How it is to change.
    pub change: Change,
    /// Parameters that the new value depends on and the log lacks.
    pub needs: Vec<&'static str>,
    /// The effect it corrects.
    pub effect: &'static str,
    /// Unit of all these values.
    pub unit: &'static str,
    /// Documented range.
    pub range: Option<(f64, f64)>,
    /// Documented increment, or the resolution that is written.
    pub step: f64,
    /// Whether it counts only after a reboot.
    pub reboot: bool,
    /// Where in the autopilot's sources it is declared and applied.
    pub source: &'static str,
    /// What else is to be said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Its type on the vehicle.
    #[serde(skip)]
    pub kind: ParamType,
}

/// What is not proposed.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct NotProposed {
    /// The effect.
    pub effect: &'static str,
    /// The parameter, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameter: Option<&'static str>,
    /// The value that would correct it, where it can be given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wanted: Option<f64>,
    /// Its 1-sigma.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma: Option<f64>,
    /// Why.
    pub reason: String,
    /// Whether the vehicle has the right value already, within the sigma of this flight.
    #[serde(skip)]
    pub agrees: bool,
}

/// The advice (`report.json`, `autopilot`).
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
pub struct Advice {
    /// `ardupilot` or `px4`; `null` where the log does not say.
    pub autopilot: Option<&'static str>,
    /// Its version, where the log has it.
    pub version: Option<String>,
    /// How many parameters of the vehicle the log holds.
    pub parameters_in_log: usize,
    /// What is to change.
    pub proposals: Vec<Proposal>,
    /// What is not, and why.
    pub not_proposed: Vec<NotProposed>,
    /// What the log lacks or cannot decide.
    pub notes: Vec<String>,
}

/// The advice for what an explanation found.
pub fn advise(findings: &[Finding], on_board: &OnBoard) -> Advice {
    let mut advice = Advice {
        autopilot: on_board.autopilot.map(on_board::key),
        version: on_board.version.map(|(major, minor)| format!("{major}.{minor}")),
        parameters_in_log: on_board.parameters.len(),
        ..Advice::default()
    };
    let Some(autopilot) = on_board.autopilot else {
        advice.notes.push(on_board::NO_AUTOPILOT.to_owned());
        return advice;
    };
    for finding in findings {
        consider(finding, autopilot, on_board, &mut advice);
    }
    advice.notes.extend(on_board.notes());
    if advice.proposals.iter().any(|p| p.parameter.contains("GPS")) {
        advice.notes.extend(on_board.second_receiver());
    }
    if advice.proposals.iter().any(|p| p.effect.starts_with("accel") || p.effect.starts_with("gyro")) {
        advice.notes.extend(on_board.other_units());
    }
    advice
}

fn refuse(advice: &mut Advice, effect: &'static str, reason: impl Into<String>) {
    let reason = reason.into();
    advice.not_proposed.push(NotProposed {
        effect,
        parameter: None,
        wanted: None,
        sigma: None,
        reason,
        agrees: false,
    });
}

fn consider(finding: &Finding, autopilot: Autopilot, on_board: &OnBoard, advice: &mut Advice) {
    let Some((&effect, others)) = finding.names.split_first() else { return };
    if !others.is_empty() {
        let all = finding.names.join(" and ");
        return refuse(advice, effect, format!("this flight does not separate {all}"));
    }
    if let Some(why) = finding.barred {
        return refuse(advice, effect, why);
    }
    let Some(mapping) = mapping(effect, autopilot, on_board) else {
        return refuse(advice, effect, table::why_not(effect));
    };
    if let Some(count) = on_board.complete()
        && let Some(name) = mapping.parameters.iter().find(|p| !on_board.has(p))
    {
        let why = format!("the vehicle has no {name}: it is not among the {count} parameters in the log");
        return refuse(advice, effect, why);
    }
    if matches!(mapping.rule, Rule::Offset { .. }) {
        return refuse(advice, effect, table::why_not(effect));
    }
    if let Some(why) = objection(mapping, on_board) {
        return refuse(advice, effect, why);
    }
    for (k, (value, sigma)) in finding.values.iter().zip(&finding.sigmas).enumerate() {
        match judge(mapping, k, (*value, *sigma), on_board) {
            Ok(proposal) => advice.proposals.push(proposal),
            Err(not) => advice.not_proposed.push(*not),
        }
    }
}

/// The row for an effect: by the names that the vehicle has, else by its version, else the newest.
pub fn mapping(effect: &str, autopilot: Autopilot, on_board: &OnBoard) -> Option<&'static Mapping> {
    // Where the unit is not known, the first one is taken until that is said.
    let place = on_board.place().unwrap_or(0);
    let of_unit = |m: &&Mapping| m.of_unit.is_none_or(|unit| unit == place);
    let rows = || table::rows().filter(|m| m.effect == effect && m.autopilot == autopilot).filter(of_unit);
    let old_filter = on_board.get("AHRS_EKF_TYPE") == Some(1.0);
    let runs = |m: &&Mapping| !(old_filter && m.parameters.iter().any(|p| p.starts_with("EK2_")));
    let present = rows().filter(runs).find(|m| m.parameters.iter().all(|p| on_board.get(p).is_some()));
    let dated = || on_board.version.and_then(|version| rows().find(|m| m.era.holds(version)));
    let newest = || {
        rows().find(|m| {
            m.era != Era::Listed && (!matches!(m.era, Era::Since(..)) || autopilot != Autopilot::Px4)
        })
    };
    present.or_else(dated).or_else(newest)
}

/// Why a whole mapping does not hold on this vehicle.
fn objection(mapping: &Mapping, on_board: &OnBoard) -> Option<String> {
    if let Rule::Temperature { enabled, .. } = mapping.rule
        && on_board.get(enabled) != Some(1.0)
    {
        let state = on_board.get(enabled).map_or_else(|| "not in the log".to_owned(), |v| v.to_string());
        return Some(format!(
            "{enabled} is {state}: the coefficients count only where the autopilot's temperature calibration is on (1)"
        ));
    }
    if mapping.sensor_axes {
        match on_board.place() {
            Ok(place) => on_board.rotation(place, SMALL_ROTATION_DEG),
            Err(why) => Some(why),
        }
    } else {
        None
    }
}

/// A proposal for one parameter, or why there is none.
fn judge(
    mapping: &Mapping,
    k: usize,
    (value, sigma): (f64, f64),
    on_board: &OnBoard,
) -> Result<Proposal, Box<NotProposed>> {
    let name = mapping.parameters.get(k).copied().unwrap_or_default();
    let mut derived = rule::derive(mapping, k, value, sigma, on_board);
    let known = on_board.get(name);
    nearest(mapping, &mut derived);
    let not = |agrees: bool, reason: String| {
        let wanted = derived.value.map(|v| rounded(v, mapping.step));
        let parameter = Some(name);
        Err(Box::new(NotProposed {
            effect: mapping.effect,
            parameter,
            wanted,
            sigma: Some(derived.sigma),
            reason,
            agrees: agrees && known.is_some(),
        }))
    };
    let refused = |reason: String| not(false, reason);
    if !(value.is_finite() && derived.sigma.is_finite() && derived.sigma > 0.0) {
        return refused("its value or sigma is not known".to_owned());
    }
    if let Some(why) = committed(mapping, k, value, on_board) {
        return refused(why);
    }
    if let Some(by) = distance(mapping, &derived, known)
        && by < SIGNIFICANT * derived.sigma
    {
        let reason =
            format!("not significant: {} {}", by_words(by, &derived, mapping), against(known, mapping));
        return not(true, reason);
    }
    if let Some(v) = derived.value {
        let v = rounded(v, mapping.step);
        if mapping.range.is_some_and(|(low, high)| v < low || v > high) {
            return refused(out_of_range(mapping, v));
        }
        if known.is_some_and(|old| (old - v).abs() < 0.5 * mapping.step) {
            return not(true, format!("the vehicle has this value already ({})", rule_free(v)));
        }
    }
    let mut needs = derived.needs.clone();
    let mut proposed = derived.value.map(|v| rounded(v, mapping.step));
    let rotation = on_board.unknown_rotation().filter(|_| mapping.sensor_axes);
    needs.extend(rotation);
    if !needs.is_empty() {
        proposed = None;
    }
    Ok(Proposal {
        parameter: name,
        on_board: known,
        proposed,
        sigma: derived.sigma,
        change: derived.change,
        needs,
        effect: mapping.effect,
        unit: mapping.unit,
        range: mapping.range,
        step: mapping.step,
        reboot: mapping.reboot,
        source: mapping.source,
        note: note(mapping, known, derived.note),
        kind: mapping.kind,
    })
}

/// Why a change would correct twice: the share of a scale factor at 1 g is a constant, which PX4 has taken into its offset when it was
/// disarmed.
fn committed(mapping: &Mapping, k: usize, value: f64, on_board: &OnBoard) -> Option<String> {
    const VERTICAL: usize = 2;
    let at_rest = value * STANDARD_GRAVITY;
    let twice = mapping.rule == Rule::Factor
        && k == VERTICAL
        && at_rest.abs() >= COMMITTED_FROM
        && on_board.commits_offsets();
    let place = mapping.of_unit?;
    twice.then(|| {
        let flown = on_board.get(&format!("CAL_ACC{place}_ZOFF"));
        let back = flown.map_or_else(String::new, |v| format!(" ({} in the log)", rule_free(v)));
        format!(
            "SENS_IMU_AUTOCAL is on: when PX4 was disarmed it added what its filter had learnt to CAL_ACC{place}_ZOFF, at 1 g also this factor \
             ({at_rest:.2} m/s²), and both together correct twice; set CAL_ACC{place}_ZOFF to what flew{back} with it, or switch \
             SENS_IMU_AUTOCAL off and fly again"
        )
    })
}

/// By how much the parameter is to change, in the unit of its sigma; nothing where that cannot be said (a delay of the driver's own).
fn distance(mapping: &Mapping, derived: &Derived, known: Option<f64>) -> Option<f64> {
    match (mapping.rule, derived.value, known) {
        (Rule::Delay, Some(v), Some(old)) if old != 0.0 || !mapping.zero_is_the_drivers() => {
            Some((v - old).abs())
        }
        (Rule::Delay, ..) => None,
        (_, Some(v), Some(old)) => Some((v - old).abs()),
        _ => Some(match derived.change {
            Change::Multiply(factor) => (factor - 1.0).abs(),
            Change::Set(v) | Change::Add(v) | Change::UnitPlus(v) => v.abs(),
        }),
    }
}

fn by_words(by: f64, derived: &Derived, mapping: &Mapping) -> String {
    let unit = if mapping.unit.is_empty() { String::new() } else { format!(" {}", mapping.unit) };
    format!("{} ± {}{unit}", rule_free(by), rule_free(derived.sigma))
}

fn against(known: Option<f64>, mapping: &Mapping) -> String {
    match known {
        Some(old) => {
            format!("from the value on board ({} {})", rule_free(old), mapping.unit).replace(" )", ")")
        }
        None => "from no correction".to_owned(),
    }
}

/// A delay beyond what the autopilot's filter can take: the greatest that it takes is nearer to the truth than any other value, and a whole
/// multiple of it means something else.
fn nearest(mapping: &Mapping, derived: &mut Derived) {
    let Some((_, high)) = mapping.range.filter(|_| mapping.rule == Rule::Delay) else { return };
    if let Some(wanted) = derived.value.filter(|v| (high..=2.0 * high).contains(v)) {
        let unit = mapping.unit;
        let text = format!(
            "the flight says {} ± {} {unit}, and the autopilot's filter keeps no samples older than {high} {unit}: its greatest value is the \
             nearest; the receiver or its link has to become faster",
            rule_free(rounded(wanted, mapping.step)),
            rule_free(rounded(derived.sigma, mapping.step))
        );
        derived.note =
            Some(derived.note.take().map_or_else(|| text.clone(), |note| format!("{text}; {note}")));
        (derived.value, derived.change) = (Some(high), Change::Set(high));
    }
}

fn out_of_range(mapping: &Mapping, value: f64) -> String {
    let (low, high) = mapping.range.unwrap_or_default();
    format!("{} {} is outside the documented range of {low} to {high}", rule_free(value), mapping.unit)
}

fn note(mapping: &Mapping, known: Option<f64>, derived: Option<String>) -> Option<String> {
    if matches!(mapping.rule, Rule::Antenna { .. }) && known.is_some_and(|v| v != 0.0) {
        return Some(MEASURED_PLACE.to_owned());
    }
    if mapping.parameters.contains(&"EKF_VEL_DELAY") {
        let both = "EKF_POS_DELAY is the delay of the positions: give it the same value";
        return Some(derived.map_or_else(|| both.to_owned(), |words| format!("{both}; {words}")));
    }
    if mapping.rule != Rule::Delay || !mapping.zero_is_the_drivers() {
        return derived;
    }
    let assumed = match known {
        Some(0.0) => "on board 0: the filter assumes the driver's default (u-blox 120 or 220 ms by model)",
        Some(_) => return derived,
        None => "the delay that the filter assumes is not in the log (0 is the driver's default)",
    };
    Some(derived.map_or_else(|| assumed.to_owned(), |words| format!("{assumed}; {words}")))
}

/// To the step of a parameter.
pub fn rounded(value: f64, step: f64) -> f64 {
    let digits = (-log10(step)).round().clamp(0.0, 9.0) as usize;
    format!("{:.digits$}", (value / step).round() * step).parse().unwrap_or(value)
}

/// A number without superfluous digits.
pub fn rule_free(value: f64) -> String {
    let text = if value.abs() >= 100.0 { format!("{value:.1}") } else { format!("{value:.6}") };
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests;
