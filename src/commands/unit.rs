//! `gaware unit add|show|check`: the file of what is known of one inertial unit.

use super::known::PlaceArgs;
use super::{CommandError, ListenArgs, OverwriteArgs, file_name, output};
use crate::advice::on_board::{self, OnBoard};
use crate::engine::{Engine, EngineOptions, WARMED};
use crate::figures;
use crate::fleet::store::sha256;
use crate::pipeline::Beside;
use crate::pipeline::replay::{ReplayRequest, replay_watched};
use crate::unit::{Origin, Unit, UnitError};
use gaware_nav::model::Model;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `unit`.
#[derive(Debug, Clone, clap::Args)]
pub struct UnitArgs {
    /// What to do.
    #[command(subcommand)]
    pub action: UnitAction,
}

/// What can be done with a unit file.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum UnitAction {
    /// Add what recordings show (ground sessions and flights of one unit) to its file, which is made where there is none.
    Add {
        /// The file.
        unit: PathBuf,
        /// Recordings, in the order of their dates.
        #[command(flatten)]
        logs: UnitLogs,
    },
    /// Show what is known.
    Show {
        /// The file.
        unit: PathBuf,
        /// Print it as one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Whether recordings agree with the file; it is not changed. Exit status 1 where one disagrees with it.
    Check {
        /// The file.
        unit: PathBuf,
        /// Recordings.
        #[command(flatten)]
        logs: UnitLogs,
    },
}

/// Recordings of one unit.
#[derive(Debug, Clone, clap::Args)]
pub struct UnitLogs {
    /// Recordings.
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Where the vehicle is.
    #[command(flatten)]
    pub place: PlaceArgs,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// What came of it (`gaware.unit_result/1`).
#[derive(Debug, Serialize)]
pub struct UnitResult {
    /// `gaware.unit_result/1`.
    pub schema: &'static str,
    /// The file.
    pub file: String,
    /// What is known now.
    pub unit: Unit,
    /// Names of the states that were measured.
    pub measured: Vec<String>,
    /// Where recordings disagree with what was known, in words.
    pub inconsistencies: Vec<String>,
}

/// Today, as `2026-11-24`.
pub(crate) fn today() -> String {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    figures::day(since.as_secs_f64())
}

/// Hardware, firmware and sensors as a log names them.
pub(crate) fn origin(beside: &Beside, from: &str) -> Origin {
    let OnBoard { autopilot, version, board, parameters, .. } = &beside.on_board;
    let firmware = autopilot.map(|a| {
        let version = version.map_or_else(String::new, |(major, minor)| format!(" {major}.{minor}"));
        format!("{}{version}", on_board::key(a))
    });
    let is_id = |name: &str| {
        let of_sensor = name.starts_with("INS_GYR")
            || name.starts_with("INS_ACC")
            || name.starts_with("CAL_GYRO")
            || name.starts_with("CAL_ACC");
        of_sensor && name.ends_with("_ID")
    };
    let ids = parameters.iter().filter(|(name, value)| is_id(name) && **value != 0.0);
    let first_s = beside.start_unix_s();
    Origin {
        hardware_id: board.clone(),
        firmware,
        date: first_s.map_or_else(today, figures::day),
        temperature_degc: None,
        from: vec![from.to_owned()],
        sha256: Vec::new(),
        sensor_ids: ids.map(|(name, value)| (name.clone(), *value)).collect(),
    }
}

/// Why what an engine has of a unit is not to be believed; nothing where it is.
pub(crate) fn doubt(engine: &Engine) -> Option<String> {
    let far = engine.summary().implausible;
    let words = "beyond what such a unit has: an axis may be reversed or another one, or its unit a wrong one (gaware explain names it)";
    (!far.is_empty()).then(|| format!("{} is {words}", far.join(", ")))
}

/// What one recording shows of its unit, beside what is known before it, and why that is not to be believed.
fn measure(
    log: &Path,
    logs: &UnitLogs,
    before: Option<&Unit>,
) -> Result<(Unit, Option<String>), CommandError> {
    let mut model = Model::standard();
    let mut beside = Beside::default();
    if let Some(before) = before {
        before.apply(&mut model, &before.origin.date);
    }
    let request = ReplayRequest {
        log: log.into(),
        model: Some(model),
        converter: logs.listen.options(),
        truth_from_s: f64::INFINITY,
    };
    let options = EngineOptions { place: logs.place.home, ..EngineOptions::default() };
    let make = |model| Engine::new(model, options);
    let (pipeline, _) = replay_watched(&request, make, &|_, _| {}, Some(&mut beside))?;
    let name = file_name(log);
    let engine = pipeline.engine();
    let filter = engine.filter().ok_or_else(|| UnitError::Nothing(name.clone()))?;
    let sha256 = sha256(log).map_err(|source| UnitError::Read { path: log.to_owned(), source })?;
    if engine.has_warmed() && before.is_none() {
        crate::sinks::log::line(&format!("{name}: {WARMED}"));
    }
    let origin = Origin { sha256: vec![sha256], ..origin(&beside, &name) };
    Ok((Unit::of_filter(filter, origin), doubt(engine)))
}

/// Recordings one after the other on top of what is known, and where they disagree with it.
fn combine(
    known: Option<Unit>,
    path: &Path,
    logs: &UnitLogs,
) -> Result<(Option<Unit>, Vec<String>), CommandError> {
    let (mut known, mut inconsistencies) = (known, Vec::new());
    let forced = logs.overwrite.force;
    for log in &logs.logs {
        let (alone, doubt) = measure(log, logs, None)?;
        let name = file_name(log);
        if let Some(why) = doubt.filter(|_| !forced) {
            return Err(UnitError::Doubtful { log: name, why }.into());
        }
        let Some(before) = &known else {
            known = Some(alone);
            continue;
        };
        before.check_hardware(path, alone.origin.hardware_id.as_deref())?;
        if alone.origin.sha256.iter().any(|own| before.origin.sha256.contains(own)) {
            return Err(UnitError::Again { path: path.to_owned(), log: name }.into());
        }
        let said = before.contradictions(&alone);
        if let (Some(first), false) = (said.first(), forced) {
            let why = format!(
                "it disagrees with {} in {} ({first})",
                path.display(),
                figures::counted(said.len(), "value")
            );
            return Err(UnitError::Doubtful { log: name, why }.into());
        }
        inconsistencies.extend(said.into_iter().map(|s| format!("{name}: {s}")));
        let both = measure(log, logs, Some(before))?.0.after(before);
        known = Some(both);
    }
    Ok((known, inconsistencies))
}

/// Runs the command.
///
/// # Errors
/// A file or a recording cannot be read, is of other hardware, shows nothing, or disagrees with the file (`check`).
pub fn run(args: &UnitArgs) -> Result<(), CommandError> {
    match &args.action {
        UnitAction::Show { unit, json } => {
            let known = Unit::read(unit)?;
            print(unit, known, Vec::new(), *json)
        }
        UnitAction::Add { unit, logs } => {
            let outputs = logs.overwrite.outputs(&logs.logs);
            let known = if unit.exists() { Some(Unit::read(unit)?) } else { None };
            outputs.check(unit)?;
            let (known, inconsistencies) = combine(known, unit, logs)?;
            let nothing = || UnitError::Nothing(logs.logs.iter().map(|l| file_name(l)).collect());
            let known = known.filter(|k| !k.measured().is_empty()).ok_or_else(nothing)?;
            known.write(unit, &outputs)?;
            print(unit, known, inconsistencies, logs.json)
        }
        UnitAction::Check { unit, logs } => {
            let known = Unit::read(unit)?;
            let mut said = Vec::new();
            for log in &logs.logs {
                let alone = measure(log, logs, None)?.0;
                known.check_hardware(unit, alone.origin.hardware_id.as_deref())?;
                said.extend(
                    known.contradictions(&alone).into_iter().map(|s| format!("{}: {s}", file_name(log))),
                );
            }
            let count = said.len();
            print(unit, known, said, logs.json)?;
            if count > 0 {
                let what = figures::counted(count, "value");
                return Err(UnitError::Contradicted { path: unit.clone(), what }.into());
            }
            if logs.json {
                return Ok(());
            }
            let logs = figures::counted(logs.logs.len(), "recording");
            output::text(&format!("{logs}: no value disagrees with {}\n", unit.display()))
        }
    }
}

fn print(path: &Path, unit: Unit, inconsistencies: Vec<String>, json: bool) -> Result<(), CommandError> {
    if json {
        let measured = unit.measured().into_iter().map(str::to_owned).collect();
        let schema = "gaware.unit_result/1";
        let file = path.display().to_string();
        return output::json(&UnitResult { schema, file, unit, measured, inconsistencies });
    }
    output::text(&text(&unit, &inconsistencies))
}

/// In words and columns.
fn text(unit: &Unit, inconsistencies: &[String]) -> String {
    let mut out = String::new();
    let o = &unit.origin;
    let id = o.hardware_id.as_deref().unwrap_or("of unknown hardware");
    let firmware = o.firmware.as_deref().unwrap_or("unknown firmware");
    // Writing to a string cannot fail.
    let _ = writeln!(out, "unit {id}, {firmware}, {} from {}", o.date, o.from.join(", "));
    let measured = unit.measured();
    for s in &unit.states {
        let note = if measured.contains(&s.name.as_str()) { "" } else { "  (not measured)" };
        let _ = writeln!(
            out,
            "{:>22} {:>8} {:>20} {}{note}",
            s.effect,
            s.name,
            figures::with_sigma(s.value, s.sigma),
            s.unit
        );
    }
    for said in inconsistencies {
        let _ = writeln!(out, "inconsistent: {said}");
    }
    out
}
