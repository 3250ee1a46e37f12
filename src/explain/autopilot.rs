//! From an explanation to the parameter advice: which of its effects may be used, what the logs say of the vehicle, and the file.

use super::contract::Verdict;
use super::{ExplainError, Explained, Request, Unfit, one_line};
use crate::advice::on_board::OnBoard;
use crate::advice::{Advice, Finding, file};
use crate::outputs::mark;
use crate::pipeline::Beside;
use gaware_mission::item::Autopilot;
use gaware_mission::params::file::{ParamFile, extension};
use gaware_nav::identify::select::Added;
use gaware_nav::identify::survey;
use std::path::{Path, PathBuf};

/// Name of the file, without extension.
const NAME: &str = "autopilot";

/// What the logs, and the parameter file where one was given, say of the vehicle.
///
/// # Errors
/// A log or the file cannot be read.
pub fn on_board(request: &Request, beside: &[Beside]) -> Result<OnBoard, ExplainError> {
    let mut all: Option<OnBoard> = None;
    for one in beside.iter().map(|b| &b.on_board) {
        match &mut all {
            Some(all) => all.join(one),
            None => all = Some(one.clone()),
        }
    }
    let mut all = all.unwrap_or_default();
    if let Some(file) = &request.parameters {
        let wrong = |reason: String| ExplainError::Parameters { path: file.path().to_owned(), reason };
        let text = file.text().map_err(|e| wrong(e.to_string()))?;
        all.add_file(&ParamFile::read(&text).map_err(|e| wrong(e.to_string()))?);
    }
    Ok(all)
}

/// The effects that the explanation names, and those of the given model that it estimated.
pub fn findings(explained: &Explained) -> Vec<Finding> {
    let Some(judged) = &explained.judged else { return Vec::new() };
    let explanation = &explained.explanation;
    // The same sentence as the verdict: a flight that the model does not explain gives no value to set.
    let unexplained = (explanation.verdict == Verdict::Unexplained)
        .then_some("the verdict is \"unexplained\": something else in the flight is not explained, its values are not to be used")
        .or(explained.unfit.map(Unfit::bars));
    let confirmed = explanation.residual.as_ref().is_some_and(|g| g.held_out.after < g.held_out.before);
    let mut findings = Vec::new();
    for entry in &explanation.effects {
        let Some(name) = entry.parameters.keys().next() else { continue };
        let Some(added) = judged.selection.added.iter().find(|a| a.setting.effect.name() == *name) else {
            continue;
        };
        let barred = if unexplained.is_some() {
            unexplained
        } else if added.is_at_limit() {
            Some("the search ended at its limit: the value is a lower bound")
        } else {
            (!confirmed).then_some("the held-out data do not confirm it")
        };
        findings.push(Finding { names: entry.names.clone(), barred, ..of(added) });
    }
    let estimated = |a: &&Added| a.setting.estimated() > 0 && survey::informed(a).iter().all(|i| *i);
    let elsewhere = |a: &&Added| findings.iter().all(|f| !f.names.contains(&a.setting.effect.name()));
    let assumed: Vec<Finding> = judged
        .survey
        .assumed
        .iter()
        .filter(estimated)
        .filter(elsewhere)
        .map(|a| Finding { barred: unexplained, ..of(a) })
        .collect();
    findings.extend(assumed);
    findings
}

fn of(added: &Added) -> Finding {
    let setting = &added.setting;
    Finding {
        names: vec![setting.effect.name()],
        values: setting.values.clone(),
        sigmas: setting.sigmas.clone(),
        barred: None,
    }
}

/// The files of both autopilots.
pub fn files(folder: &Path) -> [PathBuf; 2] {
    [Autopilot::ArduPilot, Autopilot::Px4].map(|a| folder.join(NAME).with_extension(extension(a)))
}

/// `autopilot.param` or `autopilot.params`, where the autopilot is known.
pub fn file(explained: &Explained) -> Option<(String, String)> {
    let advice = explained.explanation.autopilot.as_ref()?;
    let autopilot = explained.on_board.autopilot?;
    let verdict = explained.explanation.verdict.words();
    let origin = format!("{}; verdict: {verdict}", one_line(&explained.logs.join(", ")));
    let text = file::text(advice, autopilot, &explained.on_board, &origin);
    Some((format!("{NAME}.{}", extension(autopilot)), mark::text(text, mark::Style::Hash)))
}

/// What is on board and needs no change: the remedies of these effects are carried out.
fn already(advice: &Advice, on_board: &OnBoard) -> Option<String> {
    let agreeing = advice.not_proposed.iter().filter(|n| n.agrees).filter_map(|n| n.parameter);
    let set = agreeing.filter_map(|name| {
        on_board.get(name).filter(|v| *v != 0.0).map(|v| format!("{name} = {}", v as f32))
    });
    let set: Vec<String> = set.collect();
    (!set.is_empty()).then(|| format!("Right already, within this flight's sigma: {}.", set.join(", ")))
}

/// What the advice comes to, in a sentence.
pub fn sentence(explained: &Explained) -> Option<String> {
    let advice = explained.explanation.autopilot.as_ref()?;
    let autopilot = explained.on_board.autopilot?;
    if advice.proposals.is_empty() {
        return already(advice, &explained.on_board)
            .map(|right| format!("Parameters of {autopilot}: nothing to set. {right}"));
    }
    let words: Vec<String> = advice.proposals.iter().map(file::short).collect();
    let open = advice.proposals.iter().filter(|p| p.proposed.is_none()).count();
    let lacking = match open {
        0 => String::new(),
        _ => format!(" ({open} need values that the log lacks: give them with --parameters FILE)"),
    };
    Some(format!(
        "Parameters of {autopilot}: {}{lacking}; see {NAME}.{}",
        words.join(", "),
        extension(autopilot)
    ))
}
