//! The files of an explanation: report, result, the new model, and the effects in it that the catalogue does not hold.

use super::{ExplainError, Explained, autopilot, one_line};
use crate::outputs::{OutputError, Outputs, mark};
use gaware_nav::effects;
use gaware_nav::identify::select;
use std::path::Path;

/// Whether all that [`write()`] writes may be written.
///
/// # Errors
/// One of the files is an input, or somebody else's.
pub fn check(folder: &Path, outputs: &Outputs) -> Result<(), OutputError> {
    let own = [REPORT, RESULT, MODEL, EFFECTS].map(|name| folder.join(name));
    own.iter().chain(&autopilot::files(folder)).try_for_each(|path| outputs.check(path))
}

const REPORT: &str = "report.html";
const RESULT: &str = "report.json";
const MODEL: &str = "model.toml";
const EFFECTS: &str = "effects.toml";

/// Writes `report.html`, `report.json`, `model.toml` and the parameter file of the autopilot.
///
/// # Errors
/// A folder or file that cannot be written, a plot that cannot be drawn.
pub fn write(explained: &Explained, folder: &Path, outputs: &Outputs) -> Result<(), ExplainError> {
    check(folder, outputs)?;
    outputs.folder(folder)?;
    let written = files(explained)?;
    for (name, content) in &written {
        outputs.write(&folder.join(name), content.as_str())?;
    }
    // A file of an earlier explanation in the same folder does not stay.
    let old = autopilot::files(folder).into_iter().chain([folder.join(EFFECTS)]);
    let old = old.filter(|p| written.iter().all(|(n, _)| !p.ends_with(n)));
    Ok(old.into_iter().try_for_each(|path| outputs.remove(&path))?)
}

/// The files that [`write()`] writes, by name, with marks that are still to be sealed.
///
/// # Errors
/// A plot that cannot be drawn.
pub fn files(explained: &Explained) -> Result<Vec<(String, String)>, ExplainError> {
    let json = serde_json::to_string_pretty(&explained.explanation).unwrap_or_default();
    let html = crate::report::explanation::html(explained).map_err(ExplainError::Plot)?;
    let mut files = vec![
        (RESULT.to_owned(), mark::json(&json)),
        (REPORT.to_owned(), mark::text(html, mark::Style::Angle)),
        (MODEL.to_owned(), mark::text(model_file(explained), mark::Style::Hash)),
    ];
    files.extend(
        effects_file(explained).map(|text| (EFFECTS.to_owned(), mark::text(text, mark::Style::Hash))),
    );
    files.extend(autopilot::file(explained));
    Ok(files)
}

/// The new model as a file; it says where it comes from, and what in it belongs to these flights alone.
fn model_file(explained: &Explained) -> String {
    let mut text = format!("# by gaware explain from {}\n", one_line(&explained.logs.join(", ")));
    for setting in explained.model.effects.iter().filter(|s| select::is_jump(s.effect)) {
        text.push_str(&format!(
            "# {} is an event of one flight: take it out before the model is used for another\n",
            setting.effect.name()
        ));
    }
    text + &explained.model.to_toml()
}

/// The effects of the new model that the catalogue does not hold; nothing where there are none.
fn effects_file(explained: &Explained) -> Option<String> {
    let all = explained.model.effects.iter().filter_map(|s| effects::data::definition(s.effect.name()));
    let all: Vec<_> = all.collect();
    let head = format!("# by gaware explain from {}\n", one_line(&explained.logs.join(", ")));
    (!all.is_empty()).then(|| head + &effects::data::written(all))
}
