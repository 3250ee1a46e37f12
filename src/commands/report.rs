//! `gaware report LOG`: one flight as a page for people.

use super::load_model;
use super::replay::{self, ReplayRequest};
use super::{CommandError, ListenArgs, OverwriteArgs, demo, file_name, output};
use crate::engine::{Engine, EngineOptions};
use crate::figures::day;
use crate::logs;
use crate::outputs::mark;
use crate::report::flight::{self, Logged, Origin};
use std::path::{Path, PathBuf};

/// Arguments of `report`.
#[derive(Debug, Clone, clap::Args)]
pub struct ReportArgs {
    /// Recorded flight: .tlog, DataFlash .bin, .ulg or a recording of gaware (.mcap).
    pub log: PathBuf,
    /// Write the page here (default: the name of the log with .html instead, in this folder).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Model of the sensors (default: the recording's own, otherwise g-sensitivity, GNSS latency and the tolerances of a
    /// consumer unit are estimated).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// What flew, for the words of remedies: small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes it.
    #[arg(long, value_name = "NAME|FILE")]
    pub airframe: Option<String>,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Compare with the truth of a simulated flight from this many seconds after the start.
    #[arg(long, value_name = "SECONDS", default_value_t = 150.0)]
    pub truth_from: f64,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A plot cannot be drawn.
    #[error("a plot of the report cannot be drawn: {0}")]
    Draw(String),
}

/// Runs the log through and writes the page.
///
/// # Errors
/// When log, model or airframe cannot be read, nothing in the log can, or the page cannot be written.
pub fn run(args: &ReportArgs) -> Result<(), CommandError> {
    let options = match &args.airframe {
        Some(name) => EngineOptions::for_airframe(demo::load_airframe(name)?, true),
        None => EngineOptions::default(),
    };
    let outputs = args.overwrite.outputs([Some(&args.log), args.model.as_ref()].into_iter().flatten());
    let out = args.out.clone().unwrap_or_else(|| beside(&args.log));
    outputs.check(&out)?;
    let request = ReplayRequest {
        log: args.log.clone(),
        model: args.model.as_deref().map(load_model).transpose()?,
        listen: args.listen.clone(),
        truth_from_s: args.truth_from,
    };
    let make = |model| Logged::new(Engine::new(model, options));
    let (pipeline, document) = replay::replay(&request, make)?;
    let origin = Origin { log: file_name(&args.log), date: date_of(&args.log), model: model_of(args) };
    let page = flight::html(&origin, &pipeline.summary(), &document, pipeline.engine().log())
        .map_err(ReportError::Draw)?;
    outputs.write(&out, mark::text(page, mark::Style::Angle))?;
    output::text(&format!("report: {}\n", out.display()))
}

/// The day and time at which the log begins, where its entries carry the date (logs of links do, those of autopilots count from
/// their start).
pub(super) fn date_of(log: &Path) -> String {
    /// 2001-09-09 in µs: what is smaller counts from a start.
    const FIRST_DATE_US: u64 = 1_000_000_000_000_000;
    let first = logs::open(log).ok().and_then(|mut reader| reader.next()).and_then(Result::ok);
    let at = first.map(|r| r.t_us).filter(|t| *t > FIRST_DATE_US);
    at.map_or_else(String::new, |t_us| {
        let s = t_us / 1_000_000;
        format!("{} {:02}:{:02} UTC", day(s as f64), s / 3600 % 24, s / 60 % 60)
    })
}

/// Which model was taken, in words.
fn model_of(args: &ReportArgs) -> String {
    match &args.model {
        Some(path) => file_name(path),
        None if logs::mcap::recorded_setup(&args.log).is_some() => "the recording's own".to_owned(),
        None => "standard (g-sensitivity, GNSS latency and the tolerances of a consumer unit estimated)"
            .to_owned(),
    }
}

/// The log's name with another ending, in the present folder.
fn beside(log: &Path) -> PathBuf {
    let mut name = log.file_stem().unwrap_or_default().to_owned();
    name.push(".html");
    PathBuf::from(name)
}
