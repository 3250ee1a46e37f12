//! A job of the page: which command, on which files. The same functions as those of the command line, and the same files as results.

use crate::abi::{now, show};
use gaware::compare::flight::FilterFlight;
use gaware::compare::{compare, page};
use gaware::engine::{Engine, EngineOptions};
use gaware::explain::{self, Phase, Request, STEPS};
use gaware::figures::counted;
use gaware::fleet::family;
use gaware::fleet::flight::{self, FlightEntry, Work};
use gaware::fleet::log::{FleetLog, Named};
use gaware::inputs::Input;
use gaware::outputs::mark::{self, Style};
use gaware::pipeline::Beside as OfLog;
use gaware::pipeline::replay::{ReplayRequest, TRUTH_FROM_S, parse_model};
use gaware::report::{explanation, fleet as fleet_page, flight as flight_page};
use gaware::sensors::ConverterOptions;
use gaware::unit::Unit;
use gaware::unit::known::{KnownUnit, with_known};
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
    /// One log of `gaware fleet`: its entry.
    FleetLog,
    /// `gaware fleet report`, of entries.
    Fleet,
}

/// What a file is to the job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    Log,
    Validate,
    /// A model, effects of a user, or what is known of a unit.
    Model,
    Parameters,
    /// What came of a log of a fleet.
    Entry,
}

/// The job as the page describes it; the contents come in the same order.
#[derive(Debug, Deserialize)]
struct Job {
    command: Command,
    /// The day, as `2026-11-25`: what is known of a unit ages.
    today: String,
    files: Vec<Described>,
}

/// A file as the page describes it.
#[derive(Debug, Deserialize)]
pub struct Described {
    /// Its name.
    pub name: String,
    /// What it is to the job.
    pub role: Role,
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

/// Why there is no result.
pub type Failure = Box<dyn Error>;

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

/// The files of a job by what they are to it.
#[derive(Default)]
pub struct Files {
    logs: Vec<Input>,
    validate: Vec<Input>,
    entries: Vec<(String, Input)>,
    model: Option<(Input, String)>,
    unit: Option<(Input, String)>,
    parameters: Option<Input>,
    beside: Beside,
}

impl Files {
    /// Takes the next file.
    ///
    /// # Errors
    /// It cannot be what it is given for.
    pub fn take(&mut self, role: Role, input: Input) -> Result<(), Failure> {
        match role {
            Role::Log => self.logs.push(input),
            Role::Validate => self.validate.push(input),
            Role::Entry => self.entries.push((input.path().display().to_string(), input)),
            Role::Parameters => self.parameters = Some(input),
            Role::Model => match input.text()? {
                text if data::is_one(&text) => {
                    let own = data::load(&text).map_err(|error| format!("{}: {error}", input.name()))?;
                    self.beside = self.beside.and(&own);
                }
                text if Unit::is_one(&text) => only_one(&mut self.unit, (input, text), "file of a unit")?,
                text => only_one(&mut self.model, (input, text), "model")?,
            },
        }
        Ok(())
    }

    /// The model, once all effects that it may name are defined.
    ///
    /// # Errors
    /// The file is none.
    pub fn model(&self) -> Result<Option<Model>, Failure> {
        let parse = |(input, text): &(Input, String)| parse_model(text, input.path());
        Ok(self.model.as_ref().map(parse).transpose()?)
    }

    /// The unit's file, which must be that of the first log's hardware, where there is a log.
    ///
    /// # Errors
    /// It is none, or of other hardware.
    pub fn known(&self) -> Result<Option<KnownUnit>, Failure> {
        let Some((input, text)) = &self.unit else { return Ok(None) };
        let unit = Unit::parse(text).map_err(|why| format!("{} is no unit file: {why}", input.name()))?;
        let of_log = self.logs.first().map(|log| OfLog::read(log.clone(), None)).transpose()?;
        let id = of_log.and_then(|log| log.on_board.board);
        Ok(Some(KnownUnit::of(input.path(), unit, id.as_deref())?))
    }
}

fn only_one<T>(place: &mut Option<T>, new: T, what: &str) -> Result<(), Failure> {
    match place.replace(new) {
        Some(_) => Err(format!("one {what} at a time: remove the others").into()),
        None => Ok(()),
    }
}

fn dispatch(job: Job, contents: Vec<Vec<u8>>) -> Result<Done, Failure> {
    let mut files = Files::default();
    for (Described { name, role }, bytes) in job.files.into_iter().zip(contents) {
        files.take(role, Input::in_memory(&name, bytes))?;
    }
    let (model, known) = (files.model()?, files.known()?);
    let name = files.unit.as_ref().or(files.model.as_ref()).map(|(input, _)| input.name());
    let with_known = |model| with_known(model, known.as_ref(), &job.today);
    match (job.command, files.logs.as_slice()) {
        (Command::Report, [log]) => report(log, name, with_known(model)),
        (Command::Compare, [before, after]) => compared(before, after, model),
        (Command::FleetLog, [log]) => fleet_log(log, with_known(model)),
        (Command::Fleet, _) => fleet(&files.entries),
        (Command::Explain, [_, ..]) => {
            let request = Request {
                logs: files.logs,
                validate: files.validate,
                model,
                converter: ConverterOptions::default(),
                settings: Settings { beside: files.beside, ..Settings::default() },
                parameters: files.parameters,
                whole: false,
                place: None,
            };
            explained(&request, known.as_ref(), &job.today)
        }
        (Command::Report | Command::FleetLog, _) => Err("a report is of one log: choose one".into()),
        (Command::Compare, _) => {
            Err("two logs are compared: choose the flight before and the one after".into())
        }
        (Command::Explain, []) => Err("choose a log first".into()),
    }
}

/// One log of a fleet. One that cannot be analysed is an entry too.
fn fleet_log(log: &Input, model: Option<Model>) -> Result<Done, Failure> {
    let work = Work { model, explain: true, converter: ConverterOptions::default() };
    show("replaying and explaining", 0, 0);
    let entry = flight::analyse_file(log, &work)?;
    Ok((Vec::new(), vec![(log.path().display().to_string(), serde_json::to_string(&entry)?)]))
}

fn fleet(entries: &[(String, Input)]) -> Result<Done, Failure> {
    let log = |(path, entry): &(String, Input)| -> Result<FleetLog, Failure> {
        let result = Ok(serde_json::from_str::<FlightEntry>(&entry.text()?)?);
        Ok(FleetLog { path: path.clone(), named: Named::default(), result })
    };
    let logs = entries.iter().map(log).collect::<Result<Vec<_>, _>>()?;
    let study = family::study(&logs);
    let family = &study.family;
    let mut words = vec![format!(
        "{} of {}.",
        counted(family.flights, "flight"),
        counted(family.units.len(), "inertial unit")
    )];
    words.extend(family.findings.iter().cloned());
    let html = fleet_page::html("of the chosen logs", &logs, &study)?;
    let json = serde_json::to_string_pretty(family)?;
    Ok((
        words,
        vec![
            ("fleet.html".to_owned(), mark::text(html, Style::Angle)),
            ("fleet.json".to_owned(), mark::json(&json)),
        ],
    ))
}

fn report(log: &Input, name: Option<String>, model: Option<Model>) -> Result<Done, Failure> {
    let request = ReplayRequest {
        log: log.clone(),
        model,
        converter: ConverterOptions::default(),
        truth_from_s: TRUTH_FROM_S,
    };
    let progress = |done, total| show("estimating along the flight", done, total);
    progress(0, 0);
    let report = flight_page::of_log(&request, EngineOptions::default(), name, &progress)?;
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

fn explained(request: &Request, known: Option<&KnownUnit>, today: &str) -> Result<Done, Failure> {
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
    let explained = explain::run_from(known, today, request, &progress, &|words| show(words, 0, 0))?;
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
