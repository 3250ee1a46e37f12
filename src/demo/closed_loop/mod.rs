//! The whole loop in simulation: a sensor error that the autopilot can correct, a flight, its explanation, the parameters that follow from
//! it, their verified change, the same mission again, and the comparison of the autopilot's own test ratios.
//!
//! Nothing here knows the injected error but [`inject`], which makes the vehicle, and the check at the end.

pub mod inject;
mod wire;

use super::flight::{Ending, Flight};
use super::{Prepared, flight};
use crate::advice::on_board::OnBoard;
use crate::advice::table::Rule;
use crate::advice::{Advice, Proposal, advise, mapping};
use crate::compare::flight::FilterFlight;
use crate::compare::{CompareError, Comparison, compare};
use crate::engine::{Engine, EngineOptions};
use crate::explain::{self, Explained};
use crate::link::frame::Frame;
use crate::logs::Record;
use crate::mission_link::{param_transfer, wire::at_once};
use crate::pipeline::samples_of;
use crate::report::flight::Logged;
use crate::sensors::ConverterOptions;
use gaware_mission::item::Autopilot as Firmware;
use gaware_mission::params::apply::{ApplyOutcome, Wanted};
use gaware_nav::identify::select::Settings as Search;
use gaware_nav::math::hypot;
use gaware_nav::model::Model;
use gaware_sitl::autopilot::params::ParameterTable;
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig, Flavour};
use gaware_sitl::sensors::SensorConfig;
pub use inject::Correctable;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use schemars::JsonSchema;
use serde::Serialize;
use wire::StandingWire;

/// Seed of the second flight's noise and gusts less that of the first.
const SECOND_FLIGHT: u64 = 1 << 32;
/// The status of the autopilot's filter is recorded at the rate of its fixes, µs between two.
const STATUS_INTERVAL_US: f32 = 200_000.0;
const EKF_STATUS_REPORT: f32 = 193.0;
const ESTIMATOR_STATUS: f32 = 230.0;
/// Low-pass of ArduPilot's logged samples, Hz (`INS_ACCEL_FILTER`).
const LOW_PASS_HZ: f64 = 20.0;
/// Slowly varying error of the compass, rad.
const COMPASS_SIGMA_RAD: f64 = 0.01;
/// Rate of PX4's filter, Hz (`EKF2_PREDICT_US`).
const PX4_LOOP_HZ: f64 = 100.0;
/// Commands to the vehicle are sent as by a ground station.
const STATION: crate::link::frame::Sender = crate::link::frame::Sender { system_id: 255, component_id: 190 };

/// Why a loop did not come to its end.
#[derive(Debug, thiserror::Error)]
pub enum LoopError {
    /// A flight.
    #[error("the {which} flight did not come to its end: {why}")]
    Flight {
        /// First or second.
        which: &'static str,
        /// How it ended.
        why: String,
    },
    /// The parameters.
    #[error("the parameters of the simulated vehicle could not be read: {0}")]
    Read(#[from] gaware_mission::params::list::ListError),
    /// Nothing to change.
    #[error("the explanation of the first flight proposes no parameter: {0}")]
    NoProposal(String),
    /// The change.
    #[error("the parameters were not changed: {0}")]
    NotApplied(String),
    /// The comparison.
    #[error(transparent)]
    Compare(#[from] CompareError),
}

/// A parameter that was changed.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Corrected {
    /// Its name.
    pub parameter: &'static str,
    /// Value before.
    pub before: Option<f64>,
    /// Value that was written and read back.
    pub after: f64,
    /// 1-sigma of it.
    pub sigma: f64,
    /// Unit of all of these.
    pub unit: &'static str,
    /// Value that corrects what was injected.
    pub ideal: f64,
    /// Error over sigma; the sigma with the rounding to the parameter's step.
    pub error_sigmas: f64,
}

/// The result (`gaware.loop/1`).
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct LoopResult {
    /// `gaware.loop/1`.
    pub schema: &'static str,
    /// Airframe.
    pub airframe: String,
    /// `ardupilot` or `px4`.
    pub autopilot: &'static str,
    /// Seed.
    pub seed: u64,
    /// What was injected.
    pub effect: &'static str,
    /// Its values, SI, in the order of its parameters.
    pub injected: Vec<f64>,
    /// Effects that the explanation names.
    pub explained: Vec<Vec<&'static str>>,
    /// Parameters that were changed.
    pub corrected: Vec<Corrected>,
    /// Whether a parameter of the injected effect is among them.
    pub right_parameter: bool,
    /// The autopilot's own test ratios of both flights.
    pub comparison: Comparison,
}

/// All that a loop leaves.
#[derive(Debug)]
pub struct Loop {
    /// The result.
    pub result: LoopResult,
    /// Both flights as the comparison reads them.
    pub flights: [FilterFlight; 2],
    /// Both flights as the companion recorded them.
    pub records: [Vec<Record>; 2],
    /// The explanation of the first one.
    pub explained: Explained,
}

/// One flight, with the vehicle after it.
struct Flown {
    flight: FilterFlight,
    records: Vec<Record>,
    autopilot: Autopilot,
    now_s: f64,
}

/// Runs the loop; `progress` gets what is being done.
///
/// # Errors
/// A flight that does not end, an explanation without a proposal, a change that was not verified.
pub fn run(
    prepared: &Prepared,
    effect: Correctable,
    seed: u64,
    progress: &dyn Fn(&str),
) -> Result<Loop, LoopError> {
    let firmware = prepared.settings.airframe.autopilot;
    let truth = inject::vehicle(effect, firmware, seed);
    progress("first flight");
    let mut first = fly(prepared, &truth, seed, None, "first")?;
    let mut on_board = read_parameters(&mut first)?;
    progress("explaining it");
    let samples = samples_of(&first.records, ConverterOptions::default());
    on_board.samples_are(&samples);
    let mut explained = explain::samples(&[samples], &[], &Model::default(), &Search::default(), &|_| ());
    let advice = advise(&explain::autopilot::findings(&explained), &on_board);
    explained.explanation.autopilot = Some(advice.clone());
    explained.on_board = on_board.clone();
    explained.logs = vec!["before.tlog".to_owned()];
    progress("changing parameters");
    let table = apply(&mut first, &advice, &explained)?;
    progress("second flight");
    let second = fly(prepared, &truth, seed.wrapping_add(SECOND_FLIGHT), Some(table), "second")?;
    let comparison = compare(("first flight", &first.flight), ("second flight", &second.flight))?;
    let stamps_late_s = first.autopilot.mean_stamp_delay_s();
    let corrected = corrected(&advice, &truth, stamps_late_s, firmware, &on_board);
    let own = advice.proposals.iter().any(|p| p.effect == effect.name() && p.proposed.is_some());
    let injected = truth.effects.iter().find(|s| s.effect.name() == effect.name());
    let result = LoopResult {
        schema: "gaware.loop/1",
        airframe: prepared.settings.airframe.name.clone(),
        autopilot: crate::advice::on_board::key(firmware),
        seed,
        effect: effect.name(),
        injected: injected.map(|s| s.values.clone()).unwrap_or_default(),
        explained: explained.explanation.effects.iter().map(|e| e.names.clone()).collect(),
        corrected,
        right_parameter: own,
        comparison,
    };
    let flights = [first.flight, second.flight];
    Ok(Loop { result, flights, records: [first.records, second.records], explained })
}

fn fly(
    prepared: &Prepared,
    truth: &Model,
    seed: u64,
    parameters: Option<ParameterTable>,
    which: &'static str,
) -> Result<Flown, LoopError> {
    let settings = &prepared.settings;
    let usual = settings.autopilot(seed);
    let config = match usual.flavour {
        // The filter takes the samples before the low-pass, the messages after it.
        Flavour::ArduPilot => AutopilotConfig { filter_hz: Some(LOW_PASS_HZ), ..usual },
        Flavour::Px4 => AutopilotConfig { loop_rate_hz: PX4_LOOP_HZ, ..usual },
    };
    let status = match config.flavour {
        Flavour::ArduPilot => EKF_STATUS_REPORT,
        Flavour::Px4 => ESTIMATOR_STATUS,
    };
    let config = AutopilotConfig { navigates: true, ..config };
    let sensors = SensorConfig {
        vertical_velocity: true,
        attitude_sigma_rad: [0.0, 0.0, COMPASS_SIGMA_RAD],
        ..Prepared::sensors()
    };
    let mut autopilot = Autopilot::flying(config, settings.vehicle(seed), truth, sensors);
    if let Some(table) = parameters {
        autopilot = autopilot.with_parameters(table);
    }
    command(&mut autopilot, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [status, STATUS_INTERVAL_US]);
    let engine = Logged::new(Engine::new(Model::standard(), EngineOptions::default()));
    let mut flight = Flight::with(prepared.clone(), truth.clone(), autopilot, engine).recorded();
    let ending = flight.run().clone();
    let now_s = flight.now_s();
    let why = match ending {
        Ending::Landed => None,
        Ending::Holding => Some("it holds in the air, and parameters are changed on the ground".to_owned()),
        Ending::NotUploaded(why) => Some(why),
        Ending::OutOfTime | Ending::Stopped => Some("it took too long".to_owned()),
    };
    if let Some(why) = why {
        return Err(LoopError::Flight { which, why });
    }
    let (records, pipeline, autopilot) = flight.into_parts();
    let flight = FilterFlight::of(pipeline.engine().log(), pipeline.autopilot());
    Ok(Flown { flight, records, autopilot, now_s })
}

fn command(autopilot: &mut Autopilot, command: MavCmd, [param1, param2]: [f32; 2]) {
    let message = COMMAND_LONG_DATA {
        command,
        param1,
        param2,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    };
    autopilot.receive(Frame::encode(STATION, 0, &MavMessage::COMMAND_LONG(message)).raw());
}

/// Asks for version and parameters after the landing, as `gaware params backup` does; the answers are part of the recording.
fn read_parameters(flown: &mut Flown) -> Result<OnBoard, LoopError> {
    const AUTOPILOT_VERSION: f32 = 148.0;
    command(&mut flown.autopilot, MavCmd::MAV_CMD_REQUEST_MESSAGE, [AUTOPILOT_VERSION, 0.0]);
    let mut wire = StandingWire::new(&mut flown.autopilot, flown.now_s, &mut flown.records);
    at_once(param_transfer::list(&mut wire, |_, _| ()))?;
    flown.now_s = wire.end_s();
    Ok(OnBoard::of_records(&flown.records))
}

/// Writes what is proposed, verified; gives what the vehicle keeps.
fn apply(flown: &mut Flown, advice: &Advice, explained: &Explained) -> Result<ParameterTable, LoopError> {
    let wanted = |p: &Proposal| {
        Some(Wanted { name: p.parameter.parse().ok()?, value: p.proposed?, kind: Some(p.kind) })
    };
    let wanted: Vec<Wanted> = advice.proposals.iter().filter_map(wanted).collect();
    if wanted.is_empty() {
        let reasons = advice.not_proposed.iter().map(|n| format!("{}: {}", n.effect, n.reason));
        let reasons: Vec<String> = reasons.collect();
        let summary = explained.explanation.summary.clone();
        let why = if reasons.is_empty() { summary } else { reasons.join("; ") };
        return Err(LoopError::NoProposal(why));
    }
    let mut wire = StandingWire::new(&mut flown.autopilot, flown.now_s, &mut flown.records);
    match at_once(param_transfer::apply(&mut wire, wanted, 0.0, |_| Ok(()), |_| ())) {
        ApplyOutcome::Verified { .. } => Ok(flown.autopilot.parameters().clone()),
        other => Err(LoopError::NotApplied(other.to_string())),
    }
}

/// What was written beside what would have been right.
fn corrected(
    advice: &Advice,
    truth: &Model,
    stamps_late_s: f64,
    firmware: Firmware,
    on_board: &OnBoard,
) -> Vec<Corrected> {
    // The delay counts from the stamps of the inertial samples.
    let truth = flight::relative_to_stamps(truth.clone(), stamps_late_s);
    let one = |p: &Proposal| {
        let mapping = mapping(p.effect, firmware, on_board)?;
        let k = mapping.parameters.iter().position(|name| *name == p.parameter)?;
        let there = truth.effects.iter().find(|s| s.effect.name() == p.effect);
        let value = there.and_then(|s| s.values.get(k)).copied().unwrap_or(0.0);
        let old = p.on_board.unwrap_or(0.0);
        let ideal = match mapping.rule {
            Rule::Delay => 1e3 * value,
            Rule::Antenna { unit } => value + unit.get(k).and_then(|u| on_board.get(u)).unwrap_or(0.0),
            Rule::Factor => old / (1.0 + value),
            Rule::Offset { .. } | Rule::Temperature { .. } => old,
        };
        let after = p.proposed?;
        let sigma = hypot(p.sigma, p.step / 12_f64.sqrt());
        Some(Corrected {
            parameter: p.parameter,
            before: p.on_board,
            after,
            sigma: p.sigma,
            unit: p.unit,
            ideal,
            error_sigmas: (after - ideal) / sigma,
        })
    };
    advice.proposals.iter().filter_map(one).collect()
}

#[cfg(test)]
mod tests;
