//! A job of the page: which command, on which files. The same functions as those of the command line, and the same files as results.

use crate::abi::{now, show};
use gaware::compare::flight::FilterFlight;
use gaware::compare::{compare, page};
use gaware::engine::{Engine, EngineOptions};
use gaware::explain::{self, Phase, Request, STEPS};
use gaware::inputs::Input;
use gaware::outputs::mark::{self, Style};
use gaware::pipeline::replay::{ReplayRequest, TRUTH_FROM_S, parse_model};
use gaware::report::{explanation, flight};
use gaware::sensors::ConverterOptions;
use gaware_nav::effects::data;
use gaware_nav::identify::select::{Beside, Settings};
use gaware_nav::model::Model;
use serde::{Deserialize, Serialize};
use std::cell::Cell;
use std::error::Error;

/// What is to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Command {
    /// `gaware report`, with the result of `gaware replay --json` beside it.
    Report,
    /// `gaware explain`.
    Explain,
    /// `gaware compare`.
    Compare,
}

/// What a file is to the job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Role {
    Log,
    Validate,
    Model,
    Parameters,
}

/// The job as the page describes it; the contents come in the same order.
#[derive(Debug, Deserialize)]
struct Job {
    command: Command,
    files: Vec<Described>,
}

#[derive(Debug, Deserialize)]
struct Described {
    name: String,
    role: Role,
}

/// A file of the result.
#[derive(Debug, Serialize)]
struct Made {
    name: String,
    text: String,
}

/// What the page shows.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Answer {
    /// The answer in words, and the files.
    Done { words: Vec<String>, files: Vec<Made> },
    /// Why there is none, in a sentence.
    Failed(String),
}

type Failure = Box<dyn Error>;

/// Does a job and describes what came of it.
pub fn run(job: &[u8], contents: Vec<Vec<u8>>) -> Vec<u8> {
    let done = serde_json::from_slice(job).map_err(Failure::from).and_then(|job| dispatch(job, contents));
    let answer = match done {
        Ok((words, files)) => Answer::Done { words, files: files.into_iter().map(sealed).collect() },
        Err(error) => Answer::Failed(error.to_string()),
    };
    serde_json::to_vec(&answer).unwrap_or_default()
}

fn sealed((name, text): (String, String)) -> Made {
    let text = String::from_utf8(mark::sealed(text.into_bytes(), b"")).unwrap_or_default();
    Made { name, text }
}

/// Words and files.
type Done = (Vec<String>, Vec<(String, String)>);

fn dispatch(job: Job, contents: Vec<Vec<u8>>) -> Result<Done, Failure> {
    let mut logs = Vec::new();
    let mut validate = Vec::new();
    let (mut models, mut parameters) = (Vec::new(), None);
    let mut beside = Beside::default();
    for (Described { name, role }, bytes) in job.files.into_iter().zip(contents) {
        let input = Input::in_memory(&name, bytes);
        match role {
            Role::Log => logs.push(input),
            Role::Validate => validate.push(input),
            Role::Model => match input.text()? {
                text if data::is_one(&text) => {
                    let own = data::load(&text).map_err(|error| format!("{}: {error}", input.name()))?;
                    beside = beside.and(&own);
                }
                text => models.push((input, text)),
            },
            Role::Parameters => parameters = Some(input),
        }
    }
    // A model may name effects of a file that comes after it.
    let model = match models.as_slice() {
        [] => None,
        [(input, text)] => Some((input.name(), parse_model(text, input.path())?)),
        [..] => return Err("one model at a time: remove the others".into()),
    };
    match (job.command, logs.as_slice()) {
        (Command::Report, [log]) => report(log, model),
        (Command::Compare, [before, after]) => compared(before, after, model.map(|(_, model)| model)),
        (Command::Explain, [_, ..]) => explained(&Request {
            logs,
            validate,
            model: model.map(|(_, model)| model),
            converter: ConverterOptions::default(),
            settings: Settings { beside, ..Settings::default() },
            parameters,
            whole: false,
            place: None,
        }),
        (Command::Report, _) => Err("a report is of one log: choose one".into()),
        (Command::Compare, _) => {
            Err("two logs are compared: choose the flight before and the one after".into())
        }
        (Command::Explain, []) => Err("choose a log first".into()),
    }
}

fn report(log: &Input, model: Option<(String, Model)>) -> Result<Done, Failure> {
    let (name, model) = model.unzip();
    let request = ReplayRequest {
        log: log.clone(),
        model,
        converter: ConverterOptions::default(),
        truth_from_s: TRUTH_FROM_S,
    };
    let progress = |done, total| show("estimating along the flight", done, total);
    progress(0, 0);
    let report = flight::of_log(&request, EngineOptions::default(), name, &progress)?;
    let stem = stem(log);
    let json = serde_json::to_string_pretty(&report.document)?;
    Ok((
        Vec::new(),
        vec![
            (format!("{stem}.html"), mark::text(report.html, Style::Angle)),
            (format!("{stem}.json"), mark::json(&json)),
        ],
    ))
}

fn explained(request: &Request) -> Result<Done, Failure> {
    let entered = Cell::new(now());
    let progress = |phase: Phase| {
        if let Phase::Read(load) = phase {
            return show(&load.words(), 0, 0);
        }
        let (step, what) = phase.step();
        let at = now();
        let left = phase.time_left(at.saturating_sub(entered.replace(at)));
        show(&format!("step {step} of {STEPS}: {what}{left}"), 0, 0);
    };
    let explained = explain::run(request, &progress)?;
    let explanation = &explained.explanation;
    // All the rest stands in the report, which is shown below.
    let mut words = match explanation.residual {
        Some(_) => vec![explanation::headline(&explained)],
        None => explain::words::sentences(&explanation.summary).map(str::to_owned).collect(),
    };
    words.extend(explain::autopilot::sentence(&explained));
    Ok((words, explain::files(&explained)?))
}

fn compared(before: &Input, after: &Input, model: Option<Model>) -> Result<Done, Failure> {
    let model = model.unwrap_or_else(Model::standard);
    let read = |log: &Input| {
        let words = format!("reading {}", log.name());
        let engine = Engine::new(model.clone(), EngineOptions::default());
        FilterFlight::read(log, ConverterOptions::default(), engine, &|done, total| show(&words, done, total))
    };
    let (a, b) = (read(before)?, read(after)?);
    let compared = compare((&before.name(), &a), (&after.name(), &b))?;
    let html = page::html(&compared, &a, &b)?;
    let json = serde_json::to_string_pretty(&compared)?;
    let files = vec![
        ("comparison.html".to_owned(), mark::text(html, Style::Angle)),
        ("comparison.json".to_owned(), mark::json(&json)),
    ];
    Ok((vec![compared.text], files))
}

/// The log's name without its ending.
fn stem(log: &Input) -> String {
    log.path().file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
