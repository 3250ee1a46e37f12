//! `gaware report LOG`: one flight as a page for people.

use super::pipeline::Estimator;
use super::replay::{self, ReplayArgs};
use super::{CommandError, ListenArgs, demo, output};
use crate::engine::snapshot::{Snapshot, Summary};
use crate::engine::{Engine, EngineOptions};
use crate::report::flight::{self, FlightLog};
use gaware_nav::sample::Sample;
use std::path::{Path, PathBuf};

/// Arguments of `report`.
#[derive(Debug, Clone, clap::Args)]
pub struct ReportArgs {
    /// Recorded flight: .tlog, DataFlash .bin, .ulg or a recording of gaware (.mcap).
    pub log: PathBuf,
    /// Write the page here (default: the name of the log with .html instead, in this folder).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Model of the sensors (default: the recording's own, otherwise g-sensitivity and GNSS latency are estimated).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// What flew, for the words of remedies: small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes it.
    #[arg(long, value_name = "NAME|FILE")]
    pub airframe: Option<String>,
    /// Whom to listen to.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Compare with the truth of a simulated flight from this many seconds after the start.
    #[arg(long, value_name = "SECONDS", default_value_t = 150.0)]
    pub truth_from: f64,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The page cannot be written.
    #[error("cannot write the report to {path}: {source}")]
    Write {
        /// File.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
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
    let request = ReplayArgs {
        log: args.log.clone(),
        json: false,
        model: args.model.clone(),
        baseline: None,
        listen: args.listen.clone(),
        truth_from: args.truth_from,
    };
    let make = |model| Logged { engine: Engine::new(model, options), log: FlightLog::default() };
    let (pipeline, document) = replay::replay(&request, make)?;
    let name = args.log.file_name().unwrap_or_default().to_string_lossy();
    let page = flight::html(&name, &pipeline.summary(), &document, &pipeline.engine().log)
        .map_err(ReportError::Draw)?;
    let out = args.out.clone().unwrap_or_else(|| beside(&args.log));
    std::fs::write(&out, page).map_err(|source| ReportError::Write { path: out.clone(), source })?;
    output::text(&format!("report: {}\n", out.display()))
}

/// The log's name with another ending, in the present folder.
fn beside(log: &Path) -> PathBuf {
    let mut name = log.file_stem().unwrap_or_default().to_owned();
    name.push(".html");
    PathBuf::from(name)
}

/// An engine whose flight is written down.
#[derive(Debug)]
struct Logged {
    engine: Engine,
    log: FlightLog,
}

impl Estimator for Logged {
    fn feed(&mut self, sample: &Sample) {
        self.engine.feed(sample);
        self.log.push(sample, &self.engine);
    }

    fn snapshot(&self) -> Snapshot {
        self.engine.snapshot()
    }

    fn summary(&self) -> Summary {
        self.engine.summary()
    }

    fn attitude(&self) -> Option<(f64, [f64; 3])> {
        self.engine.attitude()
    }
}
