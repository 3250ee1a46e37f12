//! How a run ended: what was received, and what the recording lacks.

use crate::commands::CommandError;
use crate::link::status::LinkStatus;
use crate::pipeline::{Estimator, Pipeline};
use crate::sinks::recorder::RecorderStats;
use crate::sinks::words::bytes;
use crate::view::received::lacking;
use serde_json::{Map, Value, json};
use std::path::Path;

/// An error when there is nothing to estimate from: no link, no vehicle or no inertial data.
pub(super) fn received_anything<E: Estimator>(
    pipeline: &Pipeline<E>,
    links: &[LinkStatus],
) -> Result<(), CommandError> {
    never_open(links)?;
    let converter = pipeline.converter();
    if converter.stats().time.imu_samples > 0 {
        return Ok(());
    }
    Err(CommandError::Silent(lacking(links, converter)))
}

/// An error when not one link could ever be opened.
fn never_open(links: &[LinkStatus]) -> Result<(), CommandError> {
    if links.iter().any(|l| l.openings > 0) {
        return Ok(());
    }
    let problems = links.iter().map(|l| format!("{}: {}", l.address, l.problem));
    Err(CommandError::NoLink { problems: problems.collect::<Vec<_>>().join("; ") })
}

/// What the recording lacks, and what was removed for it, stands in the result; one file that is whole says nothing, so that its
/// replay repeats the run byte for byte.
pub(super) fn report_recording(path: &Path, stats: RecorderStats, document: &mut Map<String, Value>) {
    let lost = stats.failed + stats.dropped;
    if lost == 0 && stats.files <= 1 && stats.removed_files == 0 {
        return;
    }
    let recording = json!({
        "path": path, "written": stats.written, "failed": stats.failed, "dropped": stats.dropped,
        "files": stats.files, "removed_files": stats.removed_files, "removed_bytes": stats.removed_bytes,
    });
    document.insert("recording".to_owned(), recording);
    let Some(Value::Array(warnings)) = document.get_mut("warnings") else { return };
    if lost > 0 {
        let of = stats.written + lost;
        warnings.push(Value::String(format!("the recording {} lacks {lost} of {of} items", path.display())));
    }
    if stats.removed_files > 0 {
        let (files, size) = (stats.removed_files, bytes(stats.removed_bytes));
        warnings.push(Value::String(format!(
            "{files} older recordings ({size}) were removed to keep within --record-limit"
        )));
    }
}

/// An error when writing the recording failed, in one sentence.
pub(super) fn incomplete(document: &Map<String, Value>) -> Result<(), CommandError> {
    let Some(recording) = document.get("recording") else { return Ok(()) };
    let number = |name: &str| recording.get(name).and_then(Value::as_u64).unwrap_or(0);
    let lost = number("failed") + number("dropped");
    if lost == 0 {
        return Ok(());
    }
    let path = recording.get("path").and_then(Value::as_str).unwrap_or_default().into();
    Err(CommandError::Recording { path, lost, of: number("written") + lost })
}
