//! The compasses of a vehicle after a flight: which one is wrong, by how much, why, and what the autopilot can correct.
//!
//! The mathematics are `gaware_nav::identify::compass`; here are the world model, words and parameters.

pub mod advice;
#[cfg(test)]
mod tests;
pub mod world;

use crate::advice::on_board::OnBoard;
use crate::explain::contract::BeforeAfter;
use advice::SensorProposal;
use gaware_nav::identify::aids::{Finding, Settled};
use gaware_nav::identify::compass::{CompassFound, Compasses, ENOUGH, Given, Heading};
use gaware_nav::identify::flight::Flight;
use schemars::JsonSchema;
use serde::Serialize;
use world::WorldField;

/// A heading beyond this is wrong, deg: the autopilots' filters give a compass .3 rad (PX4, `EKF2_HEAD_NOISE`) and .5 rad (ArduPilot,
/// `EK3_YAW_M_NSE`) and follow it.
const WRONG_DEG: f64 = 10.0;
/// Our own heading must be known to this to judge one, deg.
const KNOWN_DEG: f64 = 5.0;
/// This many sigmas are beyond chance.
const SIGNIFICANT: f64 = 3.0;
/// A field that is longer or shorter by more than this share is none of the Earth: ArduPilot refuses to arm beyond 35 % of 530 mG
/// (`AP_Arming/AP_Arming.cpp`: `AP_ARMING_COMPASS_MAGFIELD_MIN`).
const WRONG_LENGTH: f64 = 0.35;
/// Compasses whose errors differ by less than this share of them are off alike. The share is a choice: the one log known with such compasses, whose
/// stamps are those of several vehicles, has three of 19.4 to 19.5°.
const ALIKE: f64 = 0.25;
/// An error that is of interest has to be so many sigmas to be seen, and a coefficient to be given.
pub(crate) const BEYOND_CHANCE: f64 = 2.0;
/// T per mG.
const MGAUSS: f64 = 1e-7;

/// Whether a sensor can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// It agrees with the motion.
    Ok,
    /// It does not.
    Wrong,
    /// The flight does not show it well enough.
    NotKnown,
}

/// A value with its 1-sigma.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Value {
    /// Value.
    pub value: f64,
    /// 1-sigma.
    pub sigma: f64,
}

/// A parameter of an effect.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct SensorParameter {
    /// Short name.
    pub name: &'static str,
    /// Unit of value and sigma.
    pub unit: &'static str,
    /// Value.
    pub value: f64,
    /// 1-sigma.
    pub sigma: f64,
}

/// An effect that the flight shows of a sensor.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct SensorEffect {
    /// Its name, and those of effects that would do as well.
    pub names: Vec<&'static str>,
    /// One line.
    pub description: &'static str,
    /// What usually causes it.
    pub cause: &'static str,
    /// What to do about it.
    pub remedy: &'static str,
    /// Its parameters.
    pub parameters: Vec<SensorParameter>,
    /// Logarithm of the odds for it.
    pub evidence: f64,
    /// By how much it makes the held-out blocks more likely, nats.
    pub held_out_gain: f64,
}

impl SensorEffect {
    /// A finding in the units of its parameters.
    pub fn of(f: &Finding) -> Self {
        let values = f.setting.values.iter().zip(&f.setting.sigmas);
        Self {
            names: std::iter::once(f.setting.effect.name()).chain(f.others.iter().copied()).collect(),
            description: f.setting.effect.description(),
            cause: f.setting.effect.cause(),
            remedy: f.setting.effect.remedy(),
            parameters: (f.setting.parameters().zip(values))
                .map(|((name, unit), (value, sigma))| SensorParameter {
                    name,
                    unit: unit.symbol,
                    value: value / unit.si,
                    sigma: sigma / unit.si,
                })
                .collect(),
            evidence: f.evidence,
            held_out_gain: f.held_out_gain,
        }
    }
}

/// One compass.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct CompassEntry {
    /// Its number, from 1.
    pub compass: u8,
    /// Whether it can be relied on.
    pub status: Status,
    /// The same in words.
    pub text: String,
    /// Mean of its heading less ours.
    pub heading_off_deg: Value,
    /// 1-sigma of our own heading.
    pub own_heading_sigma_deg: f64,
    /// RMS of its heading less ours.
    pub heading_rms_deg: BeforeAfter,
    /// Mean length of its field, and that of the world model.
    pub length_mgauss: [f64; 2],
    /// RMS residual.
    pub residual_mgauss: BeforeAfter,
    /// The same on held-out blocks.
    pub held_out_mgauss: BeforeAfter,
    /// How it is turned, where that is not as the autopilot has it.
    pub orientation: Option<String>,
    /// What the flight shows, the clearest first.
    pub effects: Vec<SensorEffect>,
    /// Effects that held-out blocks did not confirm.
    pub removed: Vec<&'static str>,
    /// Effects that were tested and are not significant.
    pub not_found: Vec<&'static str>,
    /// Parameters that correct it.
    pub proposals: Vec<SensorProposal>,
    /// Why others are not proposed.
    pub not_proposed: Vec<String>,
    /// Levelled horizontal field (forward, right), mG: as reported, as corrected.
    #[serde(skip)]
    pub circle: Vec<[[f64; 2]; 2]>,
    /// Horizontal field of the world model, mG.
    #[serde(skip)]
    pub horizontal_mgauss: f64,
}

/// All compasses of a vehicle.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
pub struct CompassReport {
    /// One entry each.
    pub compasses: Vec<CompassEntry>,
    /// The field that they were compared with, what is corrected on board already, and why something is not known.
    pub notes: Vec<String>,
    /// Those of the notes that hold of all compasses and change what is to be done.
    #[serde(skip)]
    pub common: Vec<String>,
}

impl CompassReport {
    /// The compasses that are wrong, in words; empty where there are none.
    pub fn wrong(&self) -> String {
        self.texts(|c| c.status == Status::Wrong).map(|text| format!(" {text}")).collect()
    }

    /// What is said of these compasses, one sentence or two each, and what holds of all.
    pub fn texts(&self, of: impl Fn(&CompassEntry) -> bool) -> impl Iterator<Item = &str> {
        let own = self.compasses.iter().filter(move |c| of(c)).map(|c| c.text.as_str());
        own.chain(self.common.iter().map(String::as_str))
    }

    /// Whether all point off by one angle, which separate sensors do not by themselves.
    fn are_off_alike(&self) -> bool {
        let off = || self.compasses.iter().map(|c| c.heading_off_deg.value);
        let (least, most) = (off().fold(f64::INFINITY, f64::min), off().fold(f64::NEG_INFINITY, f64::max));
        self.compasses.len() > 1
            && self.compasses.iter().all(|c| {
                let Value { value, sigma } = c.heading_off_deg;
                c.orientation.is_none() && points_off(value, sigma)
            })
            && most - least < ALIKE * least.abs().min(most.abs())
    }
}

/// What else than the compasses may be wrong.
const OFF_ALIKE: &str = "All compasses are off alike: the field at this place or the heading of this estimate may be what is wrong, not they.";

/// Judges the compasses of a flight by its settled trajectory.
pub fn of_flight(
    flight: &Flight,
    settled: &Settled,
    start_unix_s: Option<f64>,
    on_board: &OnBoard,
) -> CompassReport {
    let mut report = CompassReport::default();
    let middle = flight.fixes().get(flight.fixes().len() / 2).map(|f| f.position);
    let Some(world) = middle.and_then(|place| WorldField::at(&place, start_unix_s)) else {
        report.notes.push("The world magnetic model does not hold at this place.".to_owned());
        return report;
    };
    let found = Compasses::new(flight, settled).all(&Given { field_n: world.field_n });
    if found.is_empty() {
        report.notes.push(format!("The compasses are not judged: none has samples beside {ENOUGH} fixes."));
        return report;
    }
    report.compasses = found.iter().map(|f| entry(f, &world, on_board)).collect();
    advice::unused(&mut report.compasses, on_board);
    report.notes.push(format!("{}.", world.words()));
    report.notes.extend(advice::corrected_on_board(on_board));
    report.common.extend(advice::declination_off(on_board, &world));
    let turned: Vec<_> = found.iter().filter_map(|f| f.orientation.as_ref()).collect();
    if let [first, .., last] = turned[..]
        && turned.len() == found.len()
        && first.turned == last.turned
    {
        report.common.push(
            "All compasses are turned alike: the orientation of the board may be the wrong one instead of theirs, though a multirotor hardly flies with that.".to_owned(),
        );
    }
    if report.are_off_alike() {
        report.common.push(OFF_ALIKE.to_owned());
    }
    report.notes.extend(report.common.iter().cloned());
    if found.iter().any(|f| f.current_a.is_none()) {
        report.notes.push(
            "The log holds no battery current: whether motors move a compass is not tested.".to_owned(),
        );
    }
    report
}

fn entry(found: &CompassFound, world: &WorldField, on_board: &OnBoard) -> CompassEntry {
    let deg = f64::to_degrees;
    let status = status(found);
    let advice = advice::of(found, on_board, world);
    let both = |v: [f64; 2]| BeforeAfter { before: v[0] / MGAUSS, after: v[1] / MGAUSS };
    CompassEntry {
        compass: found.compass + 1,
        status,
        text: text(found, status),
        heading_off_deg: Value { value: deg(found.heading.mean), sigma: deg(found.heading.sigma) },
        own_heading_sigma_deg: deg(found.heading.own_sigma),
        heading_rms_deg: BeforeAfter { before: deg(found.heading.rms), after: deg(found.corrected.rms) },
        length_mgauss: found.length_t.map(|l| l / MGAUSS),
        residual_mgauss: both(found.residual_t),
        held_out_mgauss: both(found.held_out_t),
        orientation: found.orientation.as_ref().map(|o| o.words()),
        effects: found.effects.iter().map(SensorEffect::of).collect(),
        removed: found.removed.clone(),
        not_found: found.not_found.iter().map(|n| n.0).collect(),
        proposals: advice.0,
        not_proposed: advice.1,
        circle: found
            .circle
            .iter()
            .map(|l| [l.reported, l.corrected].map(|p| p.map(|v| v / MGAUSS)))
            .collect(),
        horizontal_mgauss: world.field_n.xy().norm() / MGAUSS,
    }
}

/// Whether a mean heading error is large and significant, deg.
fn points_off(mean: f64, sigma: f64) -> bool {
    mean.abs() > WRONG_DEG && mean.abs() > SIGNIFICANT * sigma
}

fn status(found: &CompassFound) -> Status {
    let Heading { mean, sigma, own_sigma, rms, .. } = found.heading;
    let [mean, sigma, own, rms] = [mean.abs(), sigma, own_sigma, rms].map(f64::to_degrees);
    let [length, expected] = found.length_t;
    let scatters = rms > WRONG_DEG && rms > SIGNIFICANT * own;
    if found.orientation.is_some()
        || points_off(mean, sigma)
        || scatters
        || (length / expected - 1.0).abs() > WRONG_LENGTH
    {
        Status::Wrong
    } else if own > KNOWN_DEG || rms > WRONG_DEG {
        Status::NotKnown
    } else {
        Status::Ok
    }
}

/// What a pilot has to know of a compass.
fn text(found: &CompassFound, status: Status) -> String {
    let Heading { mean, sigma, own_sigma, rms, most } = found.heading;
    let [mean, sigma, own, rms, most] = [mean, sigma, own_sigma, rms, most].map(f64::to_degrees);
    let [length, expected] = found.length_t.map(|l| l / MGAUSS);
    let mut parts = Vec::new();
    if let Some(turned) = &found.orientation {
        parts.push(turned.words());
    }
    match status {
        Status::Ok => parts.push(format!("is within {:.0}° of the motion's heading", most.max(mean.abs()).ceil())),
        Status::NotKnown => parts.push(format!(
            "is not judged: it is {:.0}° off in the mean, and this flight shows the heading to {own:.0}° only",
            mean.abs()
        )),
        Status::Wrong if found.orientation.is_some() => {}
        Status::Wrong if points_off(mean, sigma) => {
            parts.push(format!("points {:.0}° ± {sigma:.0}° off", mean.abs()));
        }
        Status::Wrong if rms > WRONG_DEG => {
            parts.push(format!("errs by up to {most:.0}° (RMS {rms:.0}°), depending on the heading or the motors"));
        }
        Status::Wrong => {}
    }
    if (length / expected - 1.0).abs() > WRONG_LENGTH {
        parts.push(format!("measures a field of {length:.0} mG where the Earth has {expected:.0}"));
    }
    for effect in &found.effects {
        let setting = &effect.setting;
        // Along an axis that the flight does not show the value says nothing; one of them is what was found.
        let sigmas = |k: usize| setting.values[k].abs() / setting.sigmas[k].max(f64::MIN_POSITIVE);
        let least = (0..3).map(sigmas).fold(0.0, f64::max).min(BEYOND_CHANCE);
        let shown = |k: usize| if sigmas(k) >= least { setting.values[k] } else { 0.0 };
        let size = |unit: f64| nalgebra::Vector3::from_fn(|k, _| shown(k)).norm() / unit;
        match setting.effect.name() {
            "mag_current" => {
                let most = found.current_a.map_or(0.0, |c| c[2]);
                let k = size(MGAUSS);
                parts.push(format!(
                    "motors move it by {k:.1} mG/A ({:.0} mG at the {most:.0} A of this flight)",
                    k * most
                ));
            }
            "mag_hard_iron" => parts.push(format!("an offset of {:.0} mG is in its field", size(MGAUSS))),
            "mag_rotation" => parts
                .push(format!("it is turned by {:.0}° against the inertial unit", size(1f64.to_radians()))),
            "mag_soft_iron" => parts.push("its scale factors are wrong or iron bends the field".to_owned()),
            other => parts.push(format!("{other} is significant")),
        }
    }
    format!("Compass {} {}.", found.compass + 1, parts.join("; "))
}
