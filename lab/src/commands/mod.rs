//! `gaware study`: arguments in, a table or a document out.

mod blind;
mod closed_loop;
mod endurance;
mod faults;
mod unknown;

use crate::{demo, drift, ground, guidance, honesty, observability, paper, recorded, transfer, withheld};
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
            show(args.json, &study, print_paper)
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
            show(args.json, &study, print_demo)
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
        StudyKind::Endurance(args) => endurance::run(args),
        StudyKind::Faults(args) => faults::run(args),
        StudyKind::Guidance(args) => {
            let study = with_bar(2 * args.runs, "flights", |bar| guidance::run(args.runs, args.seed, bar))?;
            show(args.json, &study, print_guidance)
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
    Ok(output::words(|out| results.iter().try_for_each(|r| print_recorded(out, r)))?)
}

fn print_paper(out: &mut String, study: &paper::Study) -> std::fmt::Result {
    writeln!(
        out,
        "The paper's flight, {} runs, initial attitude error {}°",
        study.runs, study.attitude_error_deg
    )?;
    for f in &study.filters {
        let [roll, pitch, yaw] = f.attitude_rms_deg;
        let [low, high] = f.nees_band_95;
        writeln!(
            out,
            "\n{} states: attitude RMS from 60 s {roll:.4}/{pitch:.4}/{yaw:.4}°, NEES/dof {:.3} (95 % band of one epoch {low:.3} to {high:.3}, {:.0} % of epochs inside)",
            f.states,
            f.nees_per_dof,
            100.0 * f.nees_inside_band
        )?;
        writeln!(
            out,
            "{:8}{:>10}{:>12}{:>10}{:>12}{:>12}{:>12}  unit",
            "", "truth", "mean", "± s.e.", "RMS error", "predicted", "bound"
        )?;
        for p in &f.parameters {
            writeln!(
                out,
                "{:8}{:10.3}{:12.4}{:10.4}{:12.4}{:12.4}{:12.4}  {}",
                p.name,
                p.truth,
                p.mean,
                p.mean_standard_error,
                p.rms_error,
                p.predicted_sigma,
                p.bound,
                p.unit
            )?;
        }
    }
    Ok(())
}

fn print_demo(out: &mut String, study: &demo::DemoStudy) -> std::fmt::Result {
    let [low, high] = study.interval_95;
    writeln!(
        out,
        "{}: {} of {} flights completed; {} of {} observable estimates within 2 sigma: {:.3} (95 % interval {low:.3} to {high:.3}), worst {:.2} sigma; planned within a factor 1.5 of reached: {:.3}",
        study.airframe,
        study.completed,
        study.runs,
        study.within_2_sigma,
        study.observable,
        study.share,
        study.worst_normalised_error,
        study.plan_within_factor_1_5
    )?;
    let [low, high] = study.kept_interval_95;
    writeln!(
        out,
        "the plan takes {:.0} s and promises {} states; all of them became observable in {} of {} flights: {:.3} (95 % interval {low:.3} to {high:.3})",
        study.plan_s,
        study.promised.len(),
        study.promise_kept,
        study.completed,
        study.promise_kept as f64 / study.completed.max(1) as f64
    )?;
    if !study.missed.is_empty() {
        let list: Vec<String> =
            study.missed.iter().map(|m| format!("{} {} times", m.name, m.flights)).collect();
        writeln!(out, "promised but not reached: {}", list.join(", "))?;
    }
    if !study.beyond_airframe.is_empty() {
        writeln!(out, "beyond this airframe by the plan's prediction: {}", study.beyond_airframe.join(", "))?;
    }
    let [low, high] = study.reached_over_planned;
    writeln!(
        out,
        "side force {:.2} g at 45° of bank, drawn per flight; flown in {:.2} of the planned time; reached over planned sigma of promised states {low:.2} to {high:.2}, {:.3} of them within 0.8 to 1.25; promised but not observable: {}",
        study.side_force_g,
        study.flown_over_planned_s,
        study.reached_within_0_8_to_1_25,
        study.promised_not_observable
    )?;
    writeln!(
        out,
        "{:>10}{:>10}{:>9}{:>9}{:>9}{:>16}",
        "", "promised", "mean", "lowest", "highest", "not observable"
    )?;
    for r in &study.ratios {
        let promised = if r.promised { "yes" } else { "no" };
        writeln!(
            out,
            "{:>10}{promised:>10}{:9.2}{:9.2}{:9.2}{:16}",
            r.name, r.mean, r.lowest, r.highest, r.not_observable
        )?;
    }
    writeln!(
        out,
        "{:>10}{:>12}{:>10}{:>12}{:>17}",
        "", "observable", "within", "RMS error/σ", "planned/reached"
    )?;
    for s in &study.states {
        writeln!(
            out,
            "{:>10}{:12}{:10}{:12.2}{:17.2}",
            s.name, s.observable, s.within_2_sigma, s.rms_normalised_error, s.planned_over_reached
        )?;
    }
    Ok(())
}

fn print_guidance(out: &mut String, s: &guidance::GuidanceStudy) -> std::fmt::Result {
    writeln!(
        out,
        "{}: columns x and z of G within {} deg/h/g after {:.0} s guided (95 % interval {:.0} to {:.0}), {:.0} s at random (medians of {} from a standstill): {:.0} %",
        s.airframe,
        s.target_deg_per_h_per_g,
        s.guided_median_s,
        s.guided_interval_95_s[0],
        s.guided_interval_95_s[1],
        s.random_median_s,
        s.runs,
        100.0 * s.ratio_of_medians
    )?;
    let [guided, random] = s.from_first_maneuver_s;
    writeln!(
        out,
        "from the first maneuver on {guided:.0} s and {random:.0} s; guided faster in {:.0} % of the pairs; not finished: {} and {}",
        100.0 * s.guided_faster,
        s.unfinished[0],
        s.unfinished[1]
    )?;
    Ok(())
}

fn print_recorded(out: &mut String, r: &recorded::Accuracy) -> std::fmt::Result {
    writeln!(out, "{}: {} epochs, NIS/dof {:.3}", r.set, r.epochs, r.nis_mean_per_dof)?;
    let rows = [
        ("position N/E/D, m", r.position_rms_m),
        ("velocity N/E/D, m/s", r.velocity_rms_m_per_s),
        ("roll/pitch/yaw, deg", r.attitude_rms_deg),
    ];
    for (((name, ours), own), best) in rows.into_iter().zip(r.own_sigma).zip(r.best_of_others) {
        writeln!(
            out,
            "  RMS {name:20} {}   own sigma {}   best of the others {}",
            triple(ours),
            triple(own),
            triple(best)
        )?;
    }
    writeln!(
        out,
        "  the fixes err on average by {} m, which no filter sees; chance gives {}",
        triple(r.fix_mean_error_m),
        triple(r.fix_mean_sigma_m)
    )?;
    Ok(())
}

fn triple([a, b, c]: [f64; 3]) -> String {
    format!("{a:.3} / {b:.3} / {c:.3}")
}
