//! `gaware replay LOG`: the pipeline over a recorded flight.

use super::{CommandError, ListenArgs, baseline, load_model, output, parse_model, print, progress_bar};
use crate::logs::Damage;
use crate::pipeline::{Estimator, Pipeline, Recorded};
use gaware_nav::model::Model;
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// Arguments of `replay`.
#[derive(Debug, Clone, clap::Args)]
pub struct ReplayArgs {
    /// Recorded flight: .tlog, DataFlash .bin, .ulg, a recording of gaware (.mcap), or a folder with imu.csv and gps.csv.
    pub log: PathBuf,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
    /// Model of the sensors (default: the recording's own, otherwise g-sensitivity, GNSS latency and the tolerances of a
    /// consumer unit are estimated).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Compare the result with this earlier one and fail when it left its tolerance.
    #[arg(long, value_name = "FILE")]
    pub baseline: Option<PathBuf>,
    /// Whom to listen to.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Compare with the truth of a simulated flight from this many seconds after the start.
    #[arg(long, value_name = "SECONDS", default_value_t = 150.0)]
    pub truth_from: f64,
}

/// Runs the command and prints its result.
///
/// # Errors
/// When log, model or baseline cannot be read, nothing in the log can, or the result left the baseline.
pub fn run<E: Estimator>(args: &ReplayArgs, make: impl FnOnce(Model) -> E) -> Result<(), CommandError> {
    let (pipeline, document) = replay(args, make)?;
    if args.json {
        output::json(&document)?;
    } else {
        output::text(&print::summary(&pipeline.summary(), &document))?;
    }
    match &args.baseline {
        Some(path) => baseline::check(path, &document),
        None => Ok(()),
    }
}

/// Runs the log through and gives the pipeline at its end with the result.
///
/// # Errors
/// When log or model cannot be read, or nothing in the log can.
pub fn replay<E: Estimator>(
    args: &ReplayArgs,
    make: impl FnOnce(Model) -> E,
) -> Result<(Pipeline<E>, Map<String, Value>), CommandError> {
    let recorded = Recorded::open(&args.log, args.listen.options())?;
    let model = match (&args.model, recorded.setup()) {
        (Some(path), _) => load_model(path)?,
        (None, Some(setup)) => parse_model(&setup.model_toml, &args.log)?,
        (None, None) => Model::standard(),
    };
    let bar = progress_bar(recorded.total_bytes(), "bytes");
    let (pipeline, damage) = recorded.run(make(model), args.truth_from, &|bytes| bar.set_position(bytes))?;
    bar.finish_and_clear();
    let mut document = pipeline.document();
    add_damage(damage, &mut document);
    Ok((pipeline, document))
}

/// A damaged log says so in the result; the field is absent for a good one.
fn add_damage(damage: Damage, document: &mut Map<String, Value>) {
    if !damage.any() {
        return;
    }
    tracing::warn!(?damage, "parts of the log could not be read");
    document.insert("log_damage".to_owned(), json!(damage));
    if let Some(Value::Array(warnings)) = document.get_mut("warnings") {
        let end = if damage.truncated { ", and it ends in the middle of an entry" } else { "" };
        warnings.push(json!(format!(
            "the log is damaged: {} bytes and {} entries could not be read{end}",
            damage.skipped_bytes, damage.bad_records
        )));
    }
}
