//! `gaware study`: arguments in, a table or a document out.

mod blind;
mod closed_loop;
mod endurance;
mod faults;
mod planned;
mod print;
mod unknown;

use crate::{
    agreement, demo, drift, ground, guidance, honesty, observability, paper, recorded, transfer, withheld,
};
use gaware::commands::{CommandError, output};
use gaware::demo::{Prepared, Settings};
use gaware::parallel::Progress;
use gaware::sinks::log;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `study`.
#[derive(Debug, Clone, clap::Args)]
pub struct StudyArgs {
    /// Which study.
    #[command(subcommand)]
    pub study: StudyKind,
}

/// The studies.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum StudyKind {
    /// The paper's flight, many times: 15, 18 and 24 states against truth, predicted sigma and information bound.
    Paper(PaperArgs),
    /// Flights with an independent truth (CSV): position, velocity and attitude errors beside those of other filters.
    Recorded(RecordedArgs),
    /// The demonstration over many simulated vehicles: consistency of the sigmas, and the plan against the flight.
    Demo(DemoStudyArgs),
    /// Which states each view calls observable, for 3 and 9 elements of G: a table of flights, or one scenario.
    Observability(ObservabilityArgs),
    /// Of the states called observable, how many lie within 2 sigma of the truth.
    Sigmas(SigmasArgs),
    /// What following the guidance is worth against random maneuvers, by time.
    Guidance(GuidanceArgs),
    /// Mission uploads over bad and cut links: verified, the previous mission back, or said to be unknown.
    Transfer(TransferArgs),
    /// Inject an effect, fly, explain, compare with the ground truth: the confusion matrix.
    Blind(blind::BlindArgs),
    /// Inject an effect outside the catalogue, fly, explain: is a formula named that does the same?
    Unknown(unknown::UnknownArgs),
    /// Inject an error that the autopilot can correct, fly, explain, apply its parameters, fly again, compare its own innovations.
    Loop(closed_loop::LoopArgs),
    /// Hours: stationary, smooth cruise, steady turns, landings, outages, dropouts and jumps; errors against sigmas.
    Endurance(endurance::EnduranceArgs),
    /// Gyro biases that drift as those of a board that warms up: errors of the live filter against its sigmas.
    Drift(DriftArgs),
    /// Ground sessions by hand over many units: sources of samples, GNSS open, covered and none, hands that make mistakes.
    Ground(GroundStudyArgs),
    /// Logs of anybody: fixes are withheld for some seconds, and what the live filter predicts is compared with the first one after.
    Withheld(WithheldArgs),
    /// The live filter and the flight linearised as a whole with the same model and noise, on recordings: values and sigmas of every constant.
    Agreement(AgreementArgs),
    /// Plan for sensors beside the inertial unit, fly it with each of their errors, and compare what was promised with what a report says.
    Planned(planned::PlannedArgs),
    /// Faults of link, clocks and sensors in flight: what the pilot is shown, time to recover, losses, errors against sigmas.
    Faults(faults::FaultsArgs),
}

/// Arguments of `study drift`.
#[derive(Debug, Clone, clap::Args)]
pub struct DriftArgs {
    /// Vehicles per drift, of each kind.
    #[arg(long, default_value_t = 6)]
    pub seeds: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `study withheld`.
#[derive(Debug, Clone, clap::Args)]
pub struct WithheldArgs {
    /// Logs of any format.
    #[arg(required = true)]
    pub logs: Vec<PathBuf>,
    /// Fixes are withheld for so long, s.
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    pub gap: f64,
    /// And so often, s.
    #[arg(long, default_value_t = 25.0, value_name = "SECONDS")]
    pub every: f64,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `study agreement`.
#[derive(Debug, Clone, clap::Args)]
pub struct AgreementArgs {
    /// Logs of any format.
    #[arg(required = true)]
    pub logs: Vec<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `study ground`.
#[derive(Debug, Clone, clap::Args)]
pub struct GroundStudyArgs {
    /// Units per row.
    #[arg(long, default_value_t = 20)]
    pub runs: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// After each session a flight of five minutes for what is left, by a plan that begins with the unit's file.
    #[arg(long)]
    pub then_flight: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `study observability`.
#[derive(Debug, Clone, clap::Args)]
pub struct ObservabilityArgs {
    /// One scenario (default: standing, straight, turn, coordinated, sideslip, paper).
    pub scenario: Option<String>,
}

/// Arguments of `study sigmas`.
#[derive(Debug, Clone, clap::Args)]
pub struct SigmasArgs {
    /// Flights per scenario.
    #[arg(long, default_value_t = 40)]
    pub runs: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Estimate without the tolerances that the sensors have: shows what a model that lacks them is worth.
    #[arg(long)]
    pub ignore_tolerances: bool,
    /// Scenarios.
    #[arg(default_values_t = ["fixed_wing", "fixed_wing_coordinated", "multirotor", "paper"].map(str::to_owned))]
    pub scenarios: Vec<String>,
}

/// Arguments of `study guidance`.
#[derive(Debug, Clone, clap::Args)]
pub struct GuidanceArgs {
    /// Pairs of flights.
    #[arg(long, default_value_t = 50)]
    pub runs: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `study demo`.
#[derive(Debug, Clone, clap::Args)]
pub struct DemoStudyArgs {
    /// Flights.
    #[arg(long, default_value_t = 50)]
    pub runs: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// What flies: small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes it.
    #[arg(long, value_name = "NAME|FILE", default_value = "small_fixed_wing")]
    pub airframe: String,
    /// Time for the maneuvers, s (default: until every observable parameter converges, at most the airframe's maneuvers_max_s).
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub budget: Option<f64>,
    /// Mean side force of a fixed wing in a turn with 45° of bank, g; each flight draws its own (default: the airframe's).
    #[arg(long, value_name = "G")]
    pub side_force: Option<f64>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `study transfer`.
#[derive(Debug, Clone, clap::Args)]
pub struct TransferArgs {
    /// Uploads per autopilot and kind of link.
    #[arg(long, default_value_t = 200)]
    pub runs: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `study paper`.
#[derive(Debug, Clone, clap::Args)]
pub struct PaperArgs {
    /// Flights per filter.
    #[arg(long, default_value_t = 100)]
    pub runs: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// 1-sigma of each initial attitude error, deg.
    #[arg(long, default_value_t = 5.0, value_name = "DEG")]
    pub attitude_error: f64,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `study recorded`.
#[derive(Debug, Clone, clap::Args)]
pub struct RecordedArgs {
    /// Sets to run: qdr, sim_thor.
    #[arg(default_values_t = ["qdr".to_owned(), "sim_thor".to_owned()])]
    pub sets: Vec<String>,
    /// Folder that holds the recorded flights.
    #[arg(long, env = "GAWARE_FLIGHTS", default_value = "../shared/data", value_name = "DIR")]
    pub flights: PathBuf,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Why a study failed; the text says what to do.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// What the daemon's commands say too.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// The demonstration.
    #[error(transparent)]
    Demo(#[from] gaware::commands::demo::DemoError),
    /// Files that are written.
    #[error(transparent)]
    File(#[from] gaware::outputs::OutputError),
    /// A mission transfer said what was not so.
    #[error("{count} uploads ended with a wrong statement about what is on the vehicle")]
    Transfers {
        /// Uploads.
        count: usize,
    },
    /// The paper's study.
    #[error(transparent)]
    Paper(#[from] paper::PaperError),
    /// The endurance study.
    #[error(transparent)]
    Endurance(#[from] crate::endurance::EnduranceError),
    /// The fault campaign.
    #[error(transparent)]
    Faults(#[from] crate::faults::FaultsError),
    /// A fault that the program does not live up to.
    #[error("{} failed: {}", if failures.len() == 1 { "one check" } else { "several checks" }, failures.join("; "))]
    Campaign {
        /// What must not be, each with its fault.
        failures: Vec<String>,
    },
    /// A recorded CSV set.
    #[error(transparent)]
    Csv(#[from] recorded::CsvError),
    /// The study of observability.
    #[error(transparent)]
    Observability(#[from] observability::ObservabilityError),
    /// The study of the guidance.
    #[error(transparent)]
    Guidance(#[from] guidance::GuidanceError),
}

impl StudyError {
    /// Whether the arguments were at fault rather than the work.
    fn is_usage(&self) -> bool {
        use crate::endurance::EnduranceError;
        use crate::faults::FaultsError;
        match self {
            Self::Command(error) => error.is_usage(),
            Self::Demo(error) => error.is_usage(),
            Self::File(error) => error.is_usage(),
            Self::Paper(paper::PaperError::TooFewRuns)
            | Self::Faults(FaultsError::NoFault { .. } | FaultsError::NoSeeds)
            | Self::Csv(recorded::CsvError::UnknownSet(_)) => true,
            Self::Endurance(error) => !matches!(error, EnduranceError::NoScenario(_)),
            _ => false,
        }
    }
}

/// Runs a study to its end.
pub fn execute(args: &StudyArgs) -> ExitCode {
    let status = match run(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(StudyError::Command(error)) if error.is_closed_pipe() => ExitCode::SUCCESS,
        Err(error) => {
            log::line(&format!("gaware: {error}"));
            ExitCode::from(if error.is_usage() { 2 } else { 1 })
        }
    };
    log::flush();
    status
}

/// A bar on the terminal that counts runs.
struct Bar(indicatif::ProgressBar);

impl Progress for Bar {
    fn tick(&self) {
        self.0.inc(1);
    }
}

/// Runs a study and prints it.
///
/// # Errors
/// What the study says.
pub fn run(args: &StudyArgs) -> Result<(), StudyError> {
    match &args.study {
        StudyKind::Paper(args) => {
            let settings =
                paper::Settings { runs: args.runs, seed: args.seed, attitude_error_deg: args.attitude_error };
            let study = with_bar(3 * args.runs, "flights", |bar| paper::run(&settings, bar))?;
            show(args.json, &study, print::paper)
        }
        StudyKind::Demo(args) => {
            let mut airframe = gaware::commands::demo::load_airframe(&args.airframe)?;
            if let Some(side_force_g) = args.side_force {
                let roll_g = airframe.roll_side_force_g;
                airframe = airframe.with_side_force(side_force_g, roll_g);
                airframe.validate().map_err(gaware::commands::demo::DemoError::from)?;
            }
            let settings = Settings::new(airframe, gaware::commands::demo::check_budget(args.budget)?);
            let prepared = Prepared::new(settings).map_err(gaware::commands::demo::DemoError::from)?;
            let study = with_bar(args.runs, "flights", |bar| demo::run(&prepared, args.runs, args.seed, bar));
            show(args.json, &study, print::demo)
        }
        StudyKind::Transfer(args) => transfers(args),
        StudyKind::Observability(args) => {
            Ok(output::json_pretty(&with_bar(12, "flights", |bar| match &args.scenario {
                Some(name) => observability::of_scenario(name, bar),
                None => observability::table(bar),
            })?)?)
        }
        StudyKind::Sigmas(args) => {
            let settings = honesty::HonestySettings {
                runs: args.runs,
                seed: args.seed,
                scenarios: args.scenarios.clone(),
                ignore_tolerances: args.ignore_tolerances,
            };
            let flights = args.runs * args.scenarios.len();
            Ok(output::json_pretty(&with_bar(flights, "flights", |bar| {
                honesty::honest_sigmas(&settings, bar)
            })?)?)
        }
        StudyKind::Blind(args) => blind::run(args),
        StudyKind::Unknown(args) => unknown::run(args),
        StudyKind::Loop(args) => closed_loop::run(args),
        StudyKind::Drift(args) => {
            let settings = drift::Settings { seeds: args.seeds, seed: args.seed };
            let study = with_bar(drift::flights(&settings), "flights", |bar| drift::run(&settings, bar));
            show(args.json, &study, |out, study| write!(out, "{study}"))
        }
        StudyKind::Ground(args) if args.then_flight => {
            let study =
                with_bar(args.runs, "flights", |bar| ground::then_flight::run(args.runs, args.seed, bar));
            show(args.json, &study, |out, study| write!(out, "{study}"))
        }
        StudyKind::Ground(args) => {
            let settings = ground::Settings { runs: args.runs, seed: args.seed };
            let study = with_bar(ground::sessions(&settings), "sessions", |bar| ground::run(&settings, bar));
            show(args.json, &study, |out, study| write!(out, "{study}"))
        }
        StudyKind::Withheld(args) => {
            let settings =
                withheld::Settings { logs: args.logs.clone(), gap_s: args.gap, every_s: args.every };
            let study = with_bar(settings.logs.len(), "logs", |bar| withheld::run(&settings, bar));
            show(args.json, &study, |out, study| write!(out, "{study}"))
        }
        StudyKind::Agreement(args) => {
            let study = with_bar(agreement::comparisons(&args.logs), "comparisons", |bar| {
                agreement::run(&args.logs, bar)
            });
            show(args.json, &study, |out, study| write!(out, "{study}"))
        }
        StudyKind::Endurance(args) => endurance::run(args),
        StudyKind::Faults(args) => faults::run(args),
        StudyKind::Planned(args) => planned::run(args),
        StudyKind::Guidance(args) => {
            let study = with_bar(2 * args.runs, "flights", |bar| guidance::run(args.runs, args.seed, bar))?;
            show(args.json, &study, print::guidance)
        }
        StudyKind::Recorded(args) => recorded_sets(args),
    }
}

/// Shows how far it is while it works.
fn with_bar<T>(total: usize, unit: &'static str, job: impl FnOnce(&Bar) -> T) -> T {
    let bar = gaware::commands::progress_bar(total as u64, unit);
    let result = job(&Bar(bar.clone()));
    bar.finish_and_clear();
    result
}

/// A document for machines, or words.
fn show<T: Serialize>(
    json: bool,
    study: &T,
    print: impl Fn(&mut String, &T) -> std::fmt::Result,
) -> Result<(), StudyError> {
    if json {
        return Ok(output::json_pretty(study)?);
    }
    Ok(output::words(|out| print(out, study))?)
}

fn transfers(args: &TransferArgs) -> Result<(), StudyError> {
    let study = with_bar(12 * args.runs, "uploads", |bar| transfer::run(args.runs, args.seed, bar));
    show(args.json, &study, |out, study| write!(out, "{study}"))?;
    match study.wrong() {
        0 => Ok(()),
        count => Err(StudyError::Transfers { count }),
    }
}

fn recorded_sets(args: &RecordedArgs) -> Result<(), StudyError> {
    let mut results = Vec::new();
    for name in &args.sets {
        let setup = recorded::setup(name)?;
        let flight = recorded::CsvFlight::read(&args.flights.join(setup.folder), setup.fixes)?;
        results.push(recorded::run(&flight, &setup));
    }
    if args.json {
        return Ok(output::json_pretty(
            &serde_json::json!({"schema": "gaware.study/1", "recorded": results}),
        )?);
    }
    Ok(output::words(|out| results.iter().try_for_each(|r| print::recorded(out, r)))?)
}
