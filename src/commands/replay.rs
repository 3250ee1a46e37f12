//! `gaware replay LOG…`: the pipeline over recorded flights, with their time series as tables and baselines for CI.

use super::baseline::{self, Outcome};
use super::effects::EffectsArgs;
use super::known::{KnownArgs, with_known};
use super::{CommandError, ListenArgs, OverwriteArgs, load_model, output, print, progress_bar};
use crate::engine::{Engine, EngineOptions};
use crate::export::{self, ExportError, Gather, Gathered};
use crate::outputs::{Outputs, mark};
pub use crate::pipeline::replay::{ReplayRequest, TRUTH_FROM_S};
use crate::pipeline::{Estimator, Pipeline, ReplayDocument};
use gaware_nav::model::Model;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Arguments of `replay`.
#[derive(Debug, Clone, clap::Args)]
pub struct ReplayArgs {
    /// Recorded flights: .tlog, DataFlash .bin, .ulg, a recording of gaware (.mcap), or a folder with imu.csv and gps.csv.
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
    /// Model of the sensors (default: the recording's own, otherwise g-sensitivity, GNSS latency and the tolerances of a
    /// consumer unit are estimated; an autopilot's own log gives delay and antenna place, where they are set, as first values).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Effects that a user defines, for the model.
    #[command(flatten)]
    pub effects: EffectsArgs,
    /// Write time series: to a .csv or .parquet file the states, to an .mcap file or a folder (as Parquet) states, inertial
    /// samples, fixes, the autopilot's attitude and events. Columns and units: docs/export.md.
    #[arg(long, value_name = "FILE|DIR")]
    pub export: Option<PathBuf>,
    /// Compare the result with this earlier one and fail when it left its tolerance; for several logs a folder with a file
    /// LOG.json for each.
    #[arg(long, value_name = "FILE|DIR")]
    pub baseline: Option<PathBuf>,
    /// Write the comparison with the baseline as JUnit XML, for a CI service.
    #[arg(long, value_name = "FILE", requires = "baseline")]
    pub junit: Option<PathBuf>,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// What is known before.
    #[command(flatten)]
    pub known: KnownArgs,
    /// Compare with the truth of a simulated flight from this many seconds after the start.
    #[arg(long, value_name = "SECONDS", default_value_t = TRUTH_FROM_S, value_parser = crate::figures::not_negative)]
    pub truth_from: f64,
}

/// The results of several logs (`gaware.replay/1`).
#[derive(Debug, Serialize, JsonSchema)]
pub struct ReplayResults {
    /// `gaware.replay/1`.
    pub schema: &'static str,
    /// One entry for each log, in the order given.
    pub flights: Vec<FlightResult>,
}

/// The result of one of several logs.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FlightResult {
    /// Name of the log's file.
    pub log: String,
    /// As of one log alone.
    #[schemars(with = "ReplayDocument")]
    pub summary: Map<String, Value>,
}

/// A log with its result.
struct Replayed {
    name: String,
    document: Map<String, Value>,
    text: String,
}

/// Runs the command and prints its result.
///
/// # Errors
/// When a log, the model or a baseline cannot be read, nothing in a log can, the tables cannot be written, or a result left its
/// baseline.
pub fn run(args: &ReplayArgs) -> Result<(), CommandError> {
    let target = args.export.as_deref().map(export::Target::new).transpose()?;
    let outputs = outputs(args);
    if let Some(target) = &target {
        target.check(export::names(), &outputs).map_err(ExportError::from)?;
    }
    args.junit.iter().try_for_each(|path| outputs.check(path))?;
    let names = names(&args.logs, target.is_some() || args.baseline.is_some())?;
    args.effects.load()?;
    let given = args.model.as_deref().map(load_model).transpose()?;
    let mut tables = Gathered::default();
    let mut results = Vec::new();
    for (log, name) in args.logs.iter().zip(names) {
        let request = ReplayRequest {
            log: log.into(),
            model: with_known(
                given.clone(),
                args.known.unit.of_log(log, args.listen.options().vehicle)?.as_ref(),
            ),
            converter: args.listen.options(),
            truth_from_s: args.truth_from,
        };
        let options = EngineOptions {
            place: args.known.place.home,
            limit_deg: args.known.limit,
            ..EngineOptions::default()
        };
        let engine = |model| Engine::new(model, options.clone());
        results.push(if target.is_some() {
            let gathered = std::mem::take(&mut tables);
            let (pipeline, document) =
                replay(&request, |model| Gather::new(engine(model), name.clone(), gathered))?;
            let result = Replayed::new(name, &pipeline, document);
            tables = pipeline.into_engine().into_tables();
            result
        } else {
            let (pipeline, document) = replay(&request, engine)?;
            Replayed::new(name, &pipeline, document)
        });
    }
    if let Some(target) = target {
        for file in target.write(&tables.into_tables(), &outputs)? {
            crate::sinks::log::line(&format!("written: {}", file.display()));
        }
    }
    show(args.json, &results)?;
    match &args.baseline {
        Some(path) => judge(path, args.junit.as_deref(), &results, &outputs),
        None => Ok(()),
    }
}

/// Everything that is read is no place for a result.
fn outputs(args: &ReplayArgs) -> Outputs {
    args.overwrite
        .outputs(args.logs.iter().chain(&args.model).chain(&args.baseline).chain(&args.known.unit.unit))
}

impl Replayed {
    fn new<E: Estimator>(name: String, pipeline: &Pipeline<E>, document: Map<String, Value>) -> Self {
        let text = print::summary(&pipeline.summary(), &document);
        Self { name, document, text }
    }
}

/// The names of the logs' files. Where rows or baselines are distinguished by them, each must be different.
fn names(logs: &[PathBuf], distinct: bool) -> Result<Vec<String>, ExportError> {
    let mut names: Vec<String> = Vec::new();
    for log in logs {
        let name = log.file_name().unwrap_or(log.as_os_str()).to_string_lossy().into_owned();
        if distinct && names.contains(&name) {
            return Err(ExportError::SameName(name));
        }
        names.push(name);
    }
    Ok(names)
}

/// The summary of one log, or one document for all of them.
fn show(json: bool, results: &[Replayed]) -> Result<(), CommandError> {
    match (json, results) {
        (true, [one]) => output::json(&one.document),
        (true, all) => {
            let flights =
                all.iter().map(|r| FlightResult { log: r.name.clone(), summary: r.document.clone() });
            output::json(&ReplayResults { schema: "gaware.replay/1", flights: flights.collect() })
        }
        (false, [one]) => output::text(&one.text),
        (false, all) => output::text(
            &all.iter().map(|r| format!("{}\n{}", r.name, r.text)).collect::<Vec<_>>().join("\n"),
        ),
    }
}

/// Compares every result with its baseline, writes the JUnit file, and fails where one left its tolerance.
fn judge(
    path: &Path,
    junit: Option<&Path>,
    results: &[Replayed],
    outputs: &Outputs,
) -> Result<(), CommandError> {
    let mut outcomes = Vec::new();
    for result in results {
        let file = if path.is_dir() { path.join(format!("{}.json", result.name)) } else { path.to_owned() };
        let differences = baseline::differences(&file, &result.document)?;
        outcomes.push(Outcome { log: result.name.clone(), differences });
    }
    if let Some(path) = junit {
        outputs.write(path, mark::text(baseline::junit(&outcomes), mark::Style::Angle))?;
    }
    baseline::verdict(&outcomes)
}

/// Runs the log through, with a progress bar, and gives the pipeline at its end with the result.
///
/// # Errors
/// When log or model cannot be read, or nothing in the log can.
pub fn replay<E: Estimator>(
    request: &ReplayRequest,
    make: impl FnOnce(Model) -> E,
) -> Result<(Pipeline<E>, Map<String, Value>), CommandError> {
    let bar = progress_bar(0, "bytes");
    let progress = |done, total| {
        bar.set_length(total);
        bar.set_position(done);
    };
    let replayed = crate::pipeline::replay::replay(request, make, &progress)?;
    bar.finish_and_clear();
    Ok(replayed)
}
