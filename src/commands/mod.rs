//! The commands, a file each: arguments in, work done, one clear sentence when it fails.

pub mod airframe;
pub mod band;
pub mod baseline;
pub mod cli;
pub mod compare;
pub mod config;
pub mod demo;
pub mod demo_loop;
pub mod effects;
pub mod explain;
pub mod fleet;
pub mod fleet_limits;
pub mod fleet_report;
pub mod foxglove;
pub mod ground;
pub mod known;
pub mod mission;
pub mod mission_args;
pub mod mission_restore;
pub mod mission_result;
pub mod output;
pub mod params;
pub mod params_args;
pub mod params_restore;
pub mod params_result;
pub mod plan;
pub mod preflight;
pub mod print;
pub mod replay;
pub mod report;
pub mod run;
pub mod serve;
pub mod signals;
pub mod sim;
pub mod start;
pub mod study;
mod transfer;
pub mod unit;

use crate::link::address::AddressError;
use crate::logs::LogError;
use crate::outputs::{OutputError, Outputs};
use crate::pipeline::replay::{ModelFileError, ReplayError, parse_model};
use crate::sensors::{ConverterOptions, ImuSource};
use crate::sinks::recorder::RecorderError;
use gaware_nav::model::Model;
use std::path::{Path, PathBuf};

/// Whose samples are taken, in `run` and in `replay`.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ListenArgs {
    /// Take inertial samples from this message (default: the best that arrives).
    #[arg(long, value_name = "MESSAGE")]
    pub source: Option<ImuSource>,
    /// Listen to this system id (default: the autopilot that sends inertial data).
    #[arg(long, value_name = "ID")]
    pub vehicle: Option<u8>,
}

impl ListenArgs {
    /// For the converter.
    pub fn options(&self) -> ConverterOptions {
        ConverterOptions { vehicle: self.vehicle, source: self.source }
    }
}

/// What a command line says of files that exist.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct OverwriteArgs {
    /// Overwrite existing files also where gaware did not write them or they were edited since.
    #[arg(long)]
    pub force: bool,
}

impl OverwriteArgs {
    /// The outputs of a command that reads these files.
    pub fn outputs<P: AsRef<Path>>(self, inputs: impl IntoIterator<Item = P>) -> Outputs {
        Outputs::of(inputs, self.force)
    }
}

/// Why a command failed; the text says what to do.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// An address is none.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// Signing cannot be set up.
    #[error(transparent)]
    Signing(#[from] crate::link::signing::SigningError),
    /// A configuration file.
    #[error(transparent)]
    Config(#[from] config::ConfigError),
    /// A recording cannot be started.
    #[error(transparent)]
    Recorder(#[from] RecorderError),
    /// A file cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// File.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The recordings say too little for an answer.
    #[error("{0}")]
    TooLittleData(String),
    /// Arguments that do not fit together with a configuration file.
    #[error("{0}")]
    Arguments(String),
    /// A file or folder is not written.
    #[error(transparent)]
    File(#[from] OutputError),
    /// A model file is wrong.
    #[error(transparent)]
    Model(#[from] ModelFileError),
    /// A file of effects is wrong.
    #[error("{path}: {source}")]
    Effects {
        /// File.
        path: PathBuf,
        /// What is wrong.
        source: gaware_nav::effects::data::DefinitionError,
    },
    /// A baseline cannot be used.
    #[error("{path} is no baseline: {reason}")]
    Baseline {
        /// File.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The result left the tolerance of the baseline.
    #[error("the result left its baseline in {count} place(s):\n{differences}")]
    Differs {
        /// Number of places.
        count: usize,
        /// One line each.
        differences: String,
    },
    /// The studies are a program of their own.
    #[error("the studies are a program of their own, {}, which {reason}: build it with `cargo build --release -p gaware-lab`", path.display())]
    Lab {
        /// Where it is looked for.
        path: PathBuf,
        /// Why it does not start.
        reason: String,
    },
    /// The simulation.
    #[error(transparent)]
    Sim(#[from] sim::SimError),
    /// The demonstration.
    #[error(transparent)]
    Demo(#[from] demo::DemoError),
    /// A band of heights.
    #[error(transparent)]
    Band(#[from] band::BandError),
    /// A plan.
    #[error(transparent)]
    Plan(#[from] plan::PlanCommandError),
    /// A mission transfer.
    #[error(transparent)]
    Mission(#[from] mission::MissionError),
    /// The comparison of two flights.
    #[error(transparent)]
    Compare(#[from] crate::compare::CompareError),
    /// Parameters of a vehicle.
    #[error(transparent)]
    Params(#[from] params::ParamsError),
    /// The model of one inertial unit.
    #[error(transparent)]
    Unit(#[from] crate::unit::UnitError),
    /// The ground session.
    #[error(transparent)]
    Ground(#[from] ground::GroundError),
    /// The pre-flight check.
    #[error(transparent)]
    Preflight(#[from] preflight::PreflightError),
    /// The fit of an airframe.
    #[error(transparent)]
    Airframe(#[from] airframe::FitError),
    /// The explanation.
    #[error(transparent)]
    Explain(#[from] crate::explain::ExplainError),
    /// Many flights at once.
    #[error(transparent)]
    Fleet(#[from] crate::fleet::FleetError),
    /// Tables of a replay.
    #[error(transparent)]
    Export(#[from] crate::export::ExportError),
    /// The report of a flight.
    #[error(transparent)]
    Report(#[from] report::ReportError),
    /// The web page.
    #[error("cannot serve the web page on {address}: {reason}")]
    Web {
        /// Where.
        address: std::net::SocketAddr,
        /// Why.
        reason: String,
    },
    /// The data for viewers.
    #[error("cannot serve Foxglove on {address}: {reason}")]
    Foxglove {
        /// Where.
        address: std::net::SocketAddr,
        /// Why.
        reason: String,
    },
    /// Not one link of a run could be opened.
    #[error("no link could be opened: {problems}")]
    NoLink {
        /// Address and reason of each.
        problems: String,
    },
    /// A run that received nothing to estimate from.
    #[error("{0}")]
    Silent(String),
    /// The recording of a run is not whole.
    #[error("the recording {path} lacks {lost} of {of} items: was the disk full, or the file changed?")]
    Recording {
        /// File.
        path: PathBuf,
        /// Items that are not in it.
        lost: u64,
        /// Items in all.
        of: u64,
    },
    /// The result cannot be written.
    #[error("cannot write the result: {0}")]
    Output(#[from] std::io::Error),
}

impl From<ReplayError> for CommandError {
    fn from(error: ReplayError) -> Self {
        match error {
            ReplayError::Log(error) => Self::Log(error),
            ReplayError::Model(error) => Self::Model(error),
            ReplayError::Draw(why) => Self::Report(report::ReportError::Draw(why)),
        }
    }
}

impl CommandError {
    /// Whether the reader of stdout has seen enough and left, as `head` does.
    pub fn is_closed_pipe(&self) -> bool {
        matches!(self, Self::Output(error) if error.kind() == std::io::ErrorKind::BrokenPipe)
    }

    /// Exit status: 1 the work failed, 2 wrong usage, 3 the recordings say too little for an answer.
    pub fn status(&self) -> u8 {
        match self {
            Self::TooLittleData(_) => 3,
            error if error.is_usage() => 2,
            _ => 1,
        }
    }

    /// Whether the arguments were at fault rather than the work.
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Address(_) | Self::Band(_) | Self::Arguments(_) => true,
            Self::File(error) => error.is_usage(),
            Self::Export(error) => error.is_usage(),
            Self::Fleet(crate::fleet::FleetError::Pattern { .. } | crate::fleet::FleetError::Rule(_)) => true,
            Self::Sim(error) => error.is_usage(),
            Self::Demo(error) => error.is_usage(),
            Self::Plan(error) => error.is_usage(),
            Self::Mission(error) => error.is_usage(),
            Self::Params(error) => error.is_usage(),
            _ => false,
        }
    }
}

/// A progress bar on stderr; hidden where that is no terminal.
pub fn progress_bar(total: u64, unit: &str) -> indicatif::ProgressBar {
    let bar = indicatif::ProgressBar::new(total);
    let style =
        indicatif::ProgressStyle::with_template(&format!("{{bar:40}} {{pos}}/{{len}} {unit}, {{eta}} left"));
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar
}

/// The name of a file without its folder, in words.
fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Reads a model file.
///
/// # Errors
/// When it cannot be read, or is no model; the line is reported where it is known.
pub fn load_model(path: &Path) -> Result<Model, CommandError> {
    let text = crate::inputs::text(path).map_err(|source| {
        let source = match source.kind() {
            std::io::ErrorKind::InvalidData => std::io::Error::new(
                source.kind(),
                "it is no text; a model is a TOML file (see `gaware explain`)",
            ),
            _ => source,
        };
        CommandError::Read { path: path.to_owned(), source }
    })?;
    Ok(parse_model(&text, path)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_model_is_named() {
        let message = load_model(Path::new("/no/such/model.toml")).unwrap_err().to_string();
        assert!(message.contains("/no/such/model.toml"), "{message}");
    }
}
