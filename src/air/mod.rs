//! Barometers, airspeed sensors, drag and the wind of a recording in words: which one is wrong, by how much, why, and what the autopilot can correct.
//!
//! The mathematics are `gaware_nav::identify::air`.

mod advice;
#[cfg(test)]
mod tests;

use crate::advice::on_board::OnBoard;
use crate::compass::{BEYOND_CHANCE, SensorEffect, Status, advice::SensorProposal};
use crate::explain::contract::BeforeAfter;
use crate::logs::VehicleClass;
use gaware_nav::effects::DRAG_QUADRATIC;
use gaware_nav::identify::aids::{Finding, Settled};
use gaware_nav::identify::air::{Air, AirFound, AirQuantity};
use gaware_nav::identify::flight::Flight;
use gaware_nav::math::{atan2, hypot};
use gaware_nav::model::EffectSetting;
use schemars::JsonSchema;
use serde::Serialize;

/// A barometer that errs by more is wrong, m: both autopilots take a barometer for known to 2 to 3 m (`EK3_ALT_M_NSE` 2, `EKF2_BARO_NOISE` 3.5).
const WRONG_M: f64 = 3.0;
/// An airspeed that errs by more of itself is wrong: ArduPilot's ratio of 2 differs by 10 % of the airspeed from one of 2.4.
const WRONG_SHARE: f64 = 0.1;
/// The same at an ordinary 15 m/s, m/s. Moderate turbulence at 50 m leaves as much (MIL-F-8785C).
const WRONG_M_PER_S: f64 = 1.5;
/// What is left of a specific force where drag is known is less, m/s²: .06 to .31 RMS on 13 flights of six real multirotors; .55 and .8 on two others, one of which ended in a
/// failure of its estimator.
const WRONG_DRAG: f64 = 0.5;

/// The wind by an airspeed sensor or by drag, m/s.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct WindEntry {
    /// Mean velocity of the air toward north and east.
    pub north_east_m_per_s: [f64; 2],
    /// 1-sigma, with what the sensor's own errors leave open.
    pub sigma_m_per_s: [f64; 2],
    /// 1-sigma by which it changed over the flight.
    pub changed_m_per_s: f64,
    /// In words.
    pub text: String,
}

/// One barometer or airspeed sensor, or the drag of a multirotor.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct AirEntry {
    /// Which: "Barometer 1"; "Drag" is no sensor, but what the accelerometers feel along body x and y.
    pub sensor: String,
    /// Whether it can be relied on.
    pub status: Status,
    /// The same in words.
    pub text: String,
    /// Unit of the errors: m or m/s, or m/s² of drag.
    pub unit: &'static str,
    /// Largest error by what was found, or largest drag.
    pub largest_error: f64,
    /// Speed through the air at which it was, m/s.
    pub at_m_per_s: f64,
    /// RMS residual: of a height about its mean over two minutes, of an airspeed in the wind that goes with what was found.
    pub residual: BeforeAfter,
    /// The same on held-out blocks, corrected by values of the others: what decides whether an effect is named.
    pub held_out: BeforeAfter,
    /// 1-sigma of an error at high speed that this flight would not have shown.
    pub known_to: f64,
    /// What the flight shows, the clearest first.
    pub effects: Vec<SensorEffect>,
    /// Effects that held-out blocks did not confirm.
    pub removed: Vec<&'static str>,
    /// Effects that were tested and are not significant.
    pub not_found: Vec<&'static str>,
    /// The wind, by an airspeed sensor or by drag.
    pub wind: Option<WindEntry>,
    /// Parameters that correct it.
    pub proposals: Vec<SensorProposal>,
    /// Why others are not proposed.
    pub not_proposed: Vec<String>,
    /// Speed, m/s, and error as reported and as corrected.
    #[serde(skip)]
    pub points: Vec<[f64; 3]>,
}

/// All of a vehicle.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
pub struct AirReport {
    /// One entry each.
    pub sensors: Vec<AirEntry>,
    /// What they were compared with, and why something is not known.
    pub notes: Vec<String>,
}

impl AirReport {
    /// The sensors that are wrong, in words; empty where there are none.
    pub fn wrong(&self) -> String {
        let wrong = self.sensors.iter().filter(|c| c.status == Status::Wrong);
        wrong.map(|c| format!(" {}", c.text)).collect()
    }
}

/// Judges them by a settled trajectory; nothing where the flight has none.
pub fn of_flight(flight: &Flight, settled: &Settled, on_board: &OnBoard) -> Option<AirReport> {
    let is_rotor =
        on_board.class.map_or(on_board.fixed_wing == Some(false), |c| c == VehicleClass::Multirotor);
    let is_wing = on_board.fixed_wing == Some(true);
    let air = Air::new(flight, settled, is_wing);
    let mut found = air.all();
    found.extend(is_rotor.then(|| air.drag()).flatten());
    if found.is_empty() && flight.air().is_empty() {
        return None;
    }
    let mut report =
        AirReport { sensors: found.iter().map(|f| entry(f, on_board)).collect(), notes: Vec::new() };
    report.sensors.sort_by(|a, b| a.sensor.cmp(&b.sensor));
    let has = |kind| found.iter().any(|f| f.kind == kind);
    if has(AirQuantity::Height) && !has(AirQuantity::Airspeed) {
        report.notes.push(
            "The flight has no airspeed: the wind that the pressure of the flow goes with is estimated with it, from no wind ± 5 m/s.".to_owned(),
        );
    }
    if has(AirQuantity::Airspeed) && !is_wing {
        report.notes.push(
            "The log does not say that wings carry the vehicle: sideslip is left open, and the wind follows from turns alone.".to_owned(),
        );
    }
    Some(report)
}

fn entry(found: &AirFound, on_board: &OnBoard) -> AirEntry {
    let mut status = status(found);
    let is_believed = found.kind != AirQuantity::Drag || status == Status::Ok;
    let advice = if is_believed { advice::of(found, on_board) } else { Default::default() };
    let both = |v: [f64; 2]| BeforeAfter { before: v[0], after: v[1] };
    let mut text = text(found, status);
    let is_set = |f: &Finding| f.others.is_empty() && advice.2.contains(&f.setting.effect.name());
    if status == Status::Wrong && !found.effects.is_empty() && found.effects.iter().all(is_set) {
        status = Status::Ok;
        text = format!("{} The parameters on board correct that.", text);
    }
    AirEntry {
        sensor: name(found),
        status,
        text,
        unit: ["m", "m/s", "m/s²"][found.kind as usize],
        largest_error: if shows_an_error(found) { found.largest.0 } else { 0.0 },
        at_m_per_s: found.largest.1,
        residual: both(found.residual),
        held_out: both(found.held_out),
        known_to: found.known_to,
        effects: found.effects.iter().map(SensorEffect::of).collect(),
        removed: found.removed.clone(),
        not_found: found.not_found.iter().map(|n| n.0).collect(),
        wind: found.wind.as_ref().filter(|_| is_believed).map(|w| WindEntry {
            north_east_m_per_s: w.mean,
            sigma_m_per_s: w.sigma,
            changed_m_per_s: w.changed,
            text: wind(w),
        }),
        proposals: advice.0,
        not_proposed: advice.1,
        points: found.points.clone(),
    }
}

fn name(found: &AirFound) -> String {
    match found.kind {
        AirQuantity::Height => format!("Barometer {}", found.sensor + 1),
        AirQuantity::Airspeed => format!("Airspeed sensor {}", found.sensor + 1),
        AirQuantity::Drag => "Drag".to_owned(),
    }
}

/// From where it blows, how well that is known, and its gusts.
fn wind(w: &gaware_nav::identify::air::Wind) -> String {
    let [n, e] = w.mean;
    let from = atan2(-e, -n).to_degrees().rem_euclid(360.0);
    format!(
        "wind {:.1} m/s from {from:.0}°, north {n:.1} ± {:.1}, east {e:.1} ± {:.1} m/s, changing by {:.1} m/s, with gusts of {:.1} m/s",
        hypot(n, e),
        w.sigma[0],
        w.sigma[1],
        w.changed,
        w.gusts.0
    )
}

fn status(found: &AirFound) -> Status {
    if found.kind == AirQuantity::Drag {
        let known = !found.effects.is_empty() && !scatters(found);
        return if known { Status::Ok } else { Status::NotKnown };
    }
    let (error, speed) = found.largest;
    let wrong = if found.kind == AirQuantity::Height { WRONG_M } else { WRONG_SHARE * speed };
    if shows_an_error(found) && error.abs() > wrong {
        Status::Wrong
    } else if BEYOND_CHANCE * found.known_to > of_interest(found.kind) || scatters(found) {
        Status::NotKnown
    } else {
        Status::Ok
    }
}

/// Whether an effect is named, or what is within the tolerances of several adds up to an error that is no chance.
fn shows_an_error(found: &AirFound) -> bool {
    let (error, sigma) = (found.largest.0.abs(), found.largest_sigma);
    !found.effects.is_empty() || (error > BEYOND_CHANCE * sigma && error > 0.5 * of_interest(found.kind))
}

/// What an error has to be to be of interest, m, m/s or m/s².
fn of_interest(kind: AirQuantity) -> f64 {
    [WRONG_M, WRONG_M_PER_S, WRONG_DRAG][kind as usize]
}

/// Whether more is left than a sensor in order leaves, and no effect explains it.
fn scatters(found: &AirFound) -> bool {
    found.unexplained > of_interest(found.kind)
}

/// What a pilot has to know of it.
fn text(found: &AirFound, status: Status) -> String {
    if found.kind == AirQuantity::Drag {
        return drag(found);
    }
    let is_height = found.kind == AirQuantity::Height;
    let (error, speed) = found.largest;
    let mut parts = Vec::new();
    let size = |v: f64| format!("{:.1} {}", v.abs(), if is_height { "m" } else { "m/s" });
    let way = match (is_height, error > 0.0) {
        (true, true) => "too high",
        (true, false) => "too low",
        (false, true) => "too fast",
        (false, false) => "too slow",
    };
    match status {
        Status::Wrong => parts.push(format!("reads up to {} {way} (at {speed:.0} m/s)", size(error))),
        Status::Ok if shows_an_error(found) => {
            parts.push(format!("is in order but for up to {} {way} (at {speed:.0} m/s)", size(error)));
        }
        Status::Ok if is_height => parts.push(format!(
            "follows the GNSS height within {} RMS",
            size(found.residual[1])
        )),
        Status::Ok => parts.push(format!("agrees with motion and wind within {} RMS", size(found.residual[1]))),
        Status::NotKnown if scatters(found) => parts.push(format!(
            "is not judged: {} RMS of its error are left that nothing tested explains",
            size(found.held_out[1])
        )),
        Status::NotKnown if is_height => parts.push(format!(
            "is not judged: an error of {} at high speed would not have shown; fly fast and slow legs at one height",
            size(found.known_to)
        )),
        Status::NotKnown => parts.push(format!(
            "is not judged: wind and scale are not separable on this flight (an error of {} would not have shown); fly circles both ways",
            size(found.known_to)
        )),
    }
    if found.effects.is_empty() && shows_an_error(found) && status != Status::NotKnown {
        let each: Vec<String> = found.shared.iter().map(strongest).collect();
        parts.push(format!("by {}, within what sensors of its kind differ by", each.join(" and ")));
    }
    for effect in &found.effects {
        let names: Vec<&str> =
            std::iter::once(effect.setting.effect.name()).chain(effect.others.iter().copied()).collect();
        parts.push(if names.len() > 1 {
            format!("this flight does not separate {}", names.join(" from "))
        } else {
            words(&effect.setting)
        });
    }
    format!("{} {}.", name(found), parts.join("; "))
}

/// The parameter that is the most sigmas from zero: where the flow never came from the right, a large value for it says nothing.
fn clearest(setting: &EffectSetting) -> usize {
    let sigmas = |k: &usize| (setting.values[*k] / setting.sigmas[*k].max(f64::MIN_POSITIVE)).abs();
    (0..setting.values.len()).max_by(|a, b| sigmas(a).total_cmp(&sigmas(b))).unwrap_or_default()
}

fn words(setting: &EffectSetting) -> String {
    let v = &setting.values;
    match setting.effect.name() {
        "baro_dynamic_pressure" => {
            let names = ["forward", "backward", "right", "left", "vertical"];
            let most = clearest(setting);
            format!(
                "its port feels {:.0} % of the dynamic pressure ({} flow)",
                100.0 * v[most],
                names.get(most).copied().unwrap_or_default()
            )
        }
        "baro_thrust" => {
            format!("the propellers' wash changes its pressure by {:.0} Pa at full throttle", v[0])
        }
        "baro_delay" => format!("it is {:.2} s late", v[0]),
        "baro_temperature" => format!("its height goes with its temperature by {:.2} m/°C", v[0]),
        "baro_scale" => format!("differences of height are {:.0} % too {}", 100.0 * v[0].abs(), large(v[0])),
        "airspeed_scale" => {
            format!("it shows {:.0} % too {}", 100.0 * v[0].abs(), if v[0] > 0.0 { "much" } else { "little" })
        }
        "airspeed_offset" => format!("its pressure is {:.0} Pa off", v[0]),
        "airspeed_delay" => format!("it is {:.1} s late", v[0]),
        other => format!("{other} is significant"),
    }
}

/// The clearest parameter of an effect, with its sigma.
fn strongest(setting: &EffectSetting) -> String {
    let k = clearest(setting);
    setting.parameters().nth(k).map_or_else(String::new, |(_, unit)| {
        let [value, sigma] = [setting.values[k], setting.sigmas[k]].map(|v| v / unit.si);
        format!("{} {value:.1} ± {sigma:.1} {}", setting.effect.name(), unit.symbol)
    })
}

/// What a pilot has to know of drag.
fn drag(found: &AirFound) -> String {
    if scatters(found) && !found.effects.is_empty() {
        return format!(
            "Drag and wind are not judged: {:.1} m/s² RMS of the specific force along body x and y are left that nothing tested explains.",
            found.unexplained
        );
    }
    if found.effects.is_empty() {
        return "Drag and wind are not known: the specific force along body x and y does not go with the speed; fly forward and back at two speeds, with the nose in two directions.".to_owned();
    }
    let list: Vec<String> = found.effects.iter().map(coefficients).collect();
    format!(
        "Drag is up to {:.1} m/s² (at {:.0} m/s): {}.",
        found.largest.0.abs(),
        found.largest.1,
        list.join("; ")
    )
}

/// The coefficients of an effect of drag with their sigmas, in the units of both autopilots.
fn coefficients(effect: &Finding) -> String {
    let setting = &effect.setting;
    let (v, s) = (&setting.values, &setting.sigmas);
    let own = if setting.effect.name() == DRAG_QUADRATIC.name {
        let one = |k: usize| {
            format!(", {:.1} ± {:.1} kg/m² along {}", 1.0 / v[k], s[k] / v[k].powi(2), ["x", "y"][k])
        };
        let known = (0..2).filter(|k| v[*k] > BEYOND_CHANCE * s[*k]);
        format!("drag of the body{}", known.map(one).collect::<String>())
    } else {
        format!("momentum drag of the rotors {:.3} ± {:.3} 1/s", v[0], s[0])
    };
    let others = effect.others.join(", ");
    if others.is_empty() {
        own
    } else {
        format!("{own} (this flight does not separate it from {others}: fly two speeds)")
    }
}

fn large(v: f64) -> &'static str {
    if v > 0.0 { "large" } else { "small" }
}
