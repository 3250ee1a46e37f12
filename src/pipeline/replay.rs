//! One log through the line to its result: what `replay`, `report`, `fleet`, the Python package and the page in the browser have in common.

use super::{Beside, Estimator, Pipeline, Recorded};
use crate::advice::on_board::OnBoard;
use crate::advice::start;
use crate::inputs::Input;
use crate::logs::{Damage, LogError, Record};
use crate::sensors::ConverterOptions;
use gaware_nav::model::{Model, ModelError};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// From when on a replay is compared with the truth of a simulated flight, s.
pub const TRUTH_FROM_S: f64 = 150.0;

/// One log to replay.
#[derive(Debug, Clone, Default)]
pub struct ReplayRequest {
    /// The log.
    pub log: Input,
    /// Model of the sensors, where the user names one.
    pub model: Option<Model>,
    /// Source of the samples.
    pub converter: ConverterOptions,
    /// Compare with the truth from this time after the start, s.
    pub truth_from_s: f64,
}

/// A model file that is none.
#[derive(Debug, thiserror::Error)]
#[error("{path}{place}: {source}", place = line.map(|l| format!(", line {l}")).unwrap_or_default())]
pub struct ModelFileError {
    /// File.
    pub path: PathBuf,
    /// Line, where the parser reports it.
    pub line: Option<usize>,
    /// What is wrong.
    pub source: ModelError,
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The model of the recording is wrong.
    #[error(transparent)]
    Model(#[from] ModelFileError),
    /// A plot of the report cannot be drawn.
    #[error("a plot of the report cannot be drawn: {0}")]
    Draw(String),
}

/// Reads the text of a model; `path` is its name in errors.
///
/// # Errors
/// It is none; the line is reported where it is known.
pub fn parse_model(text: &str, path: &Path) -> Result<Model, ModelFileError> {
    Model::from_toml(text).map_err(|source| {
        let line = match &source {
            ModelError::Syntax { span: Some(span), .. } => {
                text.get(..span.start).map(|before| before.matches('\n').count() + 1)
            }
            _ => None,
        };
        ModelFileError { path: path.to_owned(), line, source }
    })
}

/// Runs the log through and gives the pipeline at its end with the result.
///
/// # Errors
/// When log or model cannot be read, or nothing in the log can.
pub fn replay<E: Estimator>(
    request: &ReplayRequest,
    make: impl FnOnce(Model) -> E,
    progress: &dyn Fn(u64, u64),
) -> Result<(Pipeline<E>, Map<String, Value>), ReplayError> {
    replay_watched(request, make, progress, None)
}

/// The same, and what the log says beside its samples in the same pass.
///
/// # Errors
/// As [`replay`].
pub fn replay_watched<E: Estimator>(
    request: &ReplayRequest,
    make: impl FnOnce(Model) -> E,
    progress: &dyn Fn(u64, u64),
    mut beside: Option<&mut Beside>,
) -> Result<(Pipeline<E>, Map<String, Value>), ReplayError> {
    let recorded = Recorded::open(&request.log, request.converter)?;
    let mut model = match (&request.model, recorded.setup()) {
        (Some(model), _) => model.clone(),
        (None, Some(setup)) => parse_model(&setup.model_toml, request.log.path())?,
        (None, None) => Model::standard(),
    }
    .with_receiver();
    let started = if request.model.is_none() && recorded.autopilot().is_some() {
        start::start(&mut model, &OnBoard::read(&request.log, None)?)
    } else {
        Vec::new()
    };
    let total = recorded.total_bytes();
    if let Some(beside) = &mut beside {
        beside.on_board.is_log_of(recorded.autopilot());
    }
    let mut watch = |record: &Record| {
        if let Some(beside) = &mut beside {
            beside.take(record, request.converter.vehicle);
        }
    };
    let (pipeline, damage) =
        recorded.run_watched(make(model), request.truth_from_s, &|done| progress(done, total), &mut watch)?;
    if let Some(beside) = beside {
        beside.on_board.is_of_kind(pipeline.vehicle_kind());
    }
    let mut document = pipeline.document();
    add_damage(damage, &mut document);
    if !started.is_empty() {
        document.insert("started".to_owned(), json!(started));
    }
    Ok((pipeline, document))
}

/// A damaged log says so in the result; the field is absent for a good one. An entry that the end of the file cuts is no damage.
fn add_damage(damage: Damage, document: &mut Map<String, Value>) {
    if damage.truncated || damage.any() {
        document.insert("log_damage".to_owned(), json!(damage));
    }
    if !damage.any() {
        return;
    }
    tracing::warn!(?damage, "parts of the log could not be read");
    if let Some(Value::Array(warnings)) = document.get_mut("warnings") {
        let end = if damage.truncated { ", and it ends in the middle of an entry" } else { "" };
        warnings.push(json!(format!(
            "the log is damaged: {} bytes and {} entries could not be read{end}",
            damage.skipped_bytes, damage.bad_records
        )));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_typo_in_a_model_is_shown_with_its_line() {
        let text = "schema = \"gaware.model/1\"\n[imu]\ngyro_noize = 1.0\n";
        let message = parse_model(text, Path::new("m.toml")).unwrap_err().to_string();
        assert!(message.contains("m.toml, line 3") && message.contains("gyro_noize"), "{message}");
    }
}
