//! The unit of work of a fleet: one log replayed and explained. The result holds no time of day, no duration of the work and no path, so that it
//! is the same wherever and whenever it is made.

use crate::advice::on_board::{OnBoard, key as autopilot_key};
use crate::engine::snapshot::Summary;
use crate::engine::{Engine, EngineOptions};
use crate::explain;
use crate::inputs::Input;
use crate::outputs::mark::hex;
use crate::pipeline::Beside;
use crate::pipeline::replay::{ReplayRequest, replay_watched};
use crate::sensors::ConverterOptions;
use gaware_nav::identify::select::Settings;
use gaware_nav::model::{EffectSetting, Model};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};
use std::io::{self, Read};

/// Bytes that are hashed at once.
const BLOCK: usize = 1 << 16;
/// Version of the entries.
pub const SCHEMA: &str = "gaware.fleet_flight/1";

/// What is done with every log.
#[derive(Debug, Clone, Default)]
pub struct Work {
    /// Model of the replay; `None`: the recording's own or the standard model.
    pub model: Option<Model>,
    /// Whether unmodelled effects are identified as well.
    pub explain: bool,
    /// Source of the samples.
    pub converter: ConverterOptions,
}

/// What came of one log (`gaware.fleet_flight/1`).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FlightEntry {
    /// `gaware.fleet_flight/1`.
    pub schema: String,
    /// SHA-256 of the log's bytes.
    pub sha256: String,
    /// Size of the log, bytes.
    pub bytes: u64,
    /// Why the log could not be analysed.
    pub failed: Option<String>,
    /// The result, where there is one.
    pub flight: Option<Flight>,
}

/// One analysed flight.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Flight {
    /// Inertial unit: serial number of the autopilot, otherwise the calibration of its accelerometers, where the log has either.
    pub board: Option<String>,
    /// Kind of vehicle, where the log has it.
    #[serde(default)]
    pub vehicle: Option<String>,
    /// Autopilot and version, where the log has them.
    pub firmware: Option<String>,
    /// Start of the log, s since 1970, where the log has a date.
    pub start_unix_s: Option<f64>,
    /// Every estimated constant with its prior.
    pub parameters: Vec<FlightParameter>,
    /// As `gaware replay --json` prints it.
    pub summary: Map<String, Value>,
    /// As `gaware explain --json` prints it, where it was asked for.
    pub explanation: Option<Value>,
}

/// One estimated constant of one flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FlightParameter {
    /// `gyro_bias`, `accel_bias` or the name of an effect.
    pub effect: String,
    /// `bg_x`, `g11`, `latency`.
    pub name: String,
    /// Of all figures.
    pub unit: String,
    /// Estimate at the end of the flight.
    pub value: f64,
    /// Its 1-sigma.
    pub sigma: f64,
    /// What the model assumed before the flight.
    pub prior_value: f64,
    /// Its 1-sigma.
    pub prior_sigma: f64,
}

/// A flight whose sigma is above this share of its prior's says too little of the parameter.
const PRIOR_ONLY: f64 = 0.9;

impl FlightParameter {
    /// Whether the flight says anything of it: otherwise value and sigma are what was assumed before.
    pub fn is_informed(&self) -> bool {
        self.sigma < PRIOR_ONLY * self.prior_sigma
    }
}

/// Analyses one log. A log that cannot be read is an entry too: it cannot be read tomorrow either.
pub fn analyse(log: &Input, work: &Work, sha256: &str, bytes: u64) -> FlightEntry {
    let (flight, failed) = match flight(log, work) {
        Ok(flight) => (Some(flight), None),
        // An entry is about content: where the log lies is no part of it.
        Err(why) => (None, Some(why.replace(&log.path().display().to_string(), "the log"))),
    };
    FlightEntry { schema: SCHEMA.to_owned(), sha256: sha256.to_owned(), bytes, failed, flight }
}

/// The same with the hash of one file, as it is now.
///
/// # Errors
/// It cannot be opened or read.
pub fn analyse_file(log: &Input, work: &Work) -> io::Result<FlightEntry> {
    let mut hash = Sha256::new();
    let bytes = add(&mut hash, log.open()?)?;
    Ok(analyse(log, work, &hex(&hash.finalize()), bytes))
}

/// Adds all of a file to a hash; how many bytes these were.
pub(super) fn add(hash: &mut Sha256, mut file: impl Read) -> io::Result<u64> {
    let mut block = vec![0_u8; BLOCK];
    let mut bytes = 0;
    loop {
        let n = file.read(&mut block)?;
        let Some(part) = block.get(..n).filter(|p| !p.is_empty()) else { return Ok(bytes) };
        hash.update(part);
        bytes += n as u64;
    }
}

fn flight(log: &Input, work: &Work) -> Result<Flight, String> {
    let request = ReplayRequest {
        log: log.clone(),
        model: work.model.clone(),
        converter: work.converter,
        // A fleet compares nothing with a simulation's truth.
        truth_from_s: f64::INFINITY,
    };
    let (mut assumed, mut beside) = (Model::default(), Beside::default());
    let engine = |model: Model| {
        assumed = model.clone();
        Engine::new(model, EngineOptions::default())
    };
    let (pipeline, summary) =
        replay_watched(&request, engine, &|_, _| {}, Some(&mut beside)).map_err(|e| e.to_string())?;
    let parameters = parameters(&pipeline.summary(), &assumed);
    let start_unix_s = beside.start_unix_s();
    let on_board = beside.on_board;
    let explanation = if work.explain { Some(explanation(log, work)?) } else { None };
    Ok(Flight {
        firmware: firmware(&on_board),
        board: on_board.unit(),
        vehicle: on_board.class.map(|class| class.key().to_owned()),
        start_unix_s,
        parameters,
        summary,
        explanation,
    })
}

fn explanation(log: &Input, work: &Work) -> Result<Value, String> {
    let request = explain::Request {
        logs: vec![log.clone()],
        validate: Vec::new(),
        model: None,
        converter: work.converter,
        settings: Settings::default(),
        parameters: None,
        whole: false,
        place: None,
    };
    let explained = explain::run(&request, &|_| {}).map_err(|e| e.to_string())?;
    Ok(serde_json::to_value(explained.explanation).unwrap_or_default())
}

fn firmware(on_board: &OnBoard) -> Option<String> {
    let (major, minor) = on_board.version?;
    Some(format!("{} {major}.{minor}", on_board.autopilot.map_or("unknown", autopilot_key)))
}

/// The constants that the model leaves open, in the units of screens.
fn parameters(summary: &Summary, model: &Model) -> Vec<FlightParameter> {
    let estimate = &summary.estimate;
    let g = &estimate.g_sensitivity_deg_per_h_per_g;
    let biases = [
        (
            "gyro_bias",
            "deg/h",
            ["bg_x", "bg_y", "bg_z"],
            estimate.gyro_bias_deg_per_h,
            model.imu.gyro_bias,
            model.imu.gyro_bias_sigma,
            gaware_nav::effects::unit::DEG_PER_H.si,
        ),
        (
            "accel_bias",
            "mg",
            ["ba_x", "ba_y", "ba_z"],
            estimate.accel_bias_mg,
            model.imu.accel_bias,
            model.imu.accel_bias_sigma,
            gaware_nav::effects::unit::MG.si,
        ),
    ];
    let mut out = Vec::new();
    for (effect, unit, names, estimate, prior, sigma, si) in biases {
        for (k, name) in names.iter().enumerate() {
            out.push(FlightParameter {
                effect: effect.to_owned(),
                name: (*name).to_owned(),
                unit: unit.to_owned(),
                value: estimate.value[k],
                sigma: estimate.sigma[k],
                prior_value: prior[k] / si,
                prior_sigma: sigma / si,
            });
        }
    }
    let found = |setting: &EffectSetting, k: usize, name: &str| {
        if setting.effect.name() == "gyro_g_sensitivity" {
            let value = g.value.as_flattened().get(k)?;
            return Some((*value, *g.sigma.as_flattened().get(k)?));
        }
        let own = estimate.effects.iter().find(|p| p.effect == setting.effect.name() && p.name == name)?;
        Some((own.value, own.sigma))
    };
    for setting in &model.effects {
        for (k, (name, unit)) in setting.parameters().enumerate() {
            let (prior, sigma) = (setting.values.get(k), setting.sigmas.get(k).filter(|s| **s > 0.0));
            let (Some(prior), Some(prior_sigma), Some((value, sigma))) =
                (prior, sigma, found(setting, k, name))
            else {
                continue;
            };
            out.push(FlightParameter {
                effect: setting.effect.name().to_owned(),
                name: name.to_owned(),
                unit: unit.symbol.to_owned(),
                value,
                sigma,
                prior_value: prior / unit.si,
                prior_sigma: prior_sigma / unit.si,
            });
        }
    }
    // A flight that was never aligned has no estimates.
    out.retain(|p| p.value.is_finite() && p.sigma.is_finite() && p.sigma > 0.0);
    out
}
