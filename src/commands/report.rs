//! `gaware report LOG`: one flight as a page for people.

use super::{CommandError, ListenArgs, OverwriteArgs, demo, file_name, load_model, output, progress_bar};
use crate::engine::EngineOptions;
use crate::outputs::mark;
use crate::pipeline::replay::ReplayRequest;
use crate::report::flight;
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
    #[arg(long, value_name = "SECONDS", default_value_t = 150.0, value_parser = crate::figures::not_negative)]
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
        log: (&args.log).into(),
        model: args.model.as_deref().map(load_model).transpose()?,
        converter: args.listen.options(),
        truth_from_s: args.truth_from,
    };
    let bar = progress_bar(0, "bytes");
    let progress = |done, total| {
        bar.set_length(total);
        bar.set_position(done);
    };
    let model = args.model.as_deref().map(file_name);
    let page = flight::of_log(&request, options, model, &progress)?.html;
    bar.finish_and_clear();
    outputs.write(&out, mark::text(page, mark::Style::Angle))?;
    output::text(&format!("report: {}\n", out.display()))
}

/// The log's name with another ending, in the present folder.
fn beside(log: &Path) -> PathBuf {
    let mut name = log.file_stem().unwrap_or_default().to_owned();
    name.push(".html");
    PathBuf::from(name)
}
