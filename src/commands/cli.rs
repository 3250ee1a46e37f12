//! The command line: which commands there are, how they start, and what exit status their result becomes.

use super::{
    CommandError, OverwriteArgs, airframe, compare, config, demo, effects, explain, fleet, ground, mission,
    output, params, plan, preflight, replay, report, run, serve, signals, sim, start, study, unit,
};
use crate::outputs::mark;
use crate::sinks::log;
use clap::{CommandFactory, Parser, Subcommand};
use std::path::Path;
use std::process::ExitCode;
use tokio_util::sync::CancellationToken;

/// A flight-test companion for ArduPilot and PX4: estimates gyro g-sensitivity in flight.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 110, after_help = EXAMPLES)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

const EXAMPLES: &str = "\
Examples:
  gaware demo
  gaware ground --connect serial:/dev/ttyAMA0:921600 --unit unit.toml
  gaware run --connect serial:/dev/ttyAMA0:921600 --web 127.0.0.1:8080
  gaware replay flight.tlog --json
  gaware report flight.tlog
  gaware sim --scenario fixed_wing --listen tcpin:127.0.0.1:5760
  gaware explain flight.tlog --out result

Exit status: 0 done, 1 the work failed (stderr says why), 2 wrong usage, 3 the recordings say too little for an answer.";

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Everything at once without hardware: a simulated vehicle flies the uploaded excitation mission.
    Demo(demo::DemoArgs),
    /// Estimate during a flight: connect to a vehicle, show, record.
    Run(run::RunArgs),
    /// Measure g-sensitivity by hand on the ground: the vehicle is turned to six sides, with or without GNSS.
    Ground(ground::GroundArgs),
    /// What is known of one inertial unit, from ground sessions and flights.
    Unit(unit::UnitArgs),
    /// Run recorded flights (.tlog, .bin, .ulg, .mcap) through the same pipeline, and export their time series.
    Replay(replay::ReplayArgs),
    /// Write an HTML report for a recorded flight: estimates, observability, comparison with the autopilot.
    Report(report::ReportArgs),
    /// Simulate an autopilot on UDP, TCP or a pseudo-terminal.
    Sim(sim::SimArgs),
    /// Identify unmodelled sensor errors, with magnitude and confidence.
    Explain(explain::ExplainArgs),
    /// Effects outside the catalogue: does a new flight confirm them?
    Effects(effects::EffectsCommand),
    /// Replay and explain over many logs on all processors, and what each inertial unit's flights have in common.
    Fleet(fleet::FleetArgs),
    /// Monte Carlo studies and accuracy on recorded flights.
    Study(study::StudyArgs),
    /// Plan excitation maneuvers and predict the accuracy they reach.
    Plan(plan::PlanArgs),
    /// Fit an airframe file to a recorded flight.
    Airframe(airframe::AirframeArgs),
    /// Verified transfer of missions and geofences.
    Mission(mission::MissionArgs),
    /// Compare the autopilot's own innovations of two flights, before and after a change.
    Compare(compare::CompareArgs),
    /// Show, back up and change parameters of the autopilot, verified.
    Params(params::ParamsArgs),
    /// Check a vehicle against plan and airframe before the flight; it is only asked, never changed.
    Preflight(preflight::PreflightArgs),
    /// Serve the page that analyses logs in the browser.
    Serve(serve::ServeArgs),
    /// The file of `run --config`: check it, show every option.
    Config(config::ConfigArgs),
    /// Print shell completions.
    Completions {
        /// Shell.
        shell: clap_complete::Shell,
    },
    /// Write manual pages, one for each command.
    Manual {
        /// Folder.
        dir: std::path::PathBuf,
        /// Files that exist.
        #[command(flatten)]
        overwrite: OverwriteArgs,
    },
}

/// Reports an error of the command line. The standard library's messages about numbers name no remedy.
pub fn refuse(error: clap::Error) -> ExitCode {
    const REMEDIES: [(&str, &str); 5] = [
        ("invalid digit found in string", "write a whole number, as in 10"),
        ("cannot parse integer from empty string", "write a whole number, as in 10"),
        ("number too large to fit in target type", "write a smaller number"),
        ("invalid float literal", "write a number, as in 12.5"),
        ("cannot parse float from empty string", "write a number, as in 12.5"),
    ];
    let text = error.render().to_string();
    let remedy = REMEDIES.iter().find(|(said, _)| text.contains(said));
    match remedy.filter(|_| error.kind() == clap::error::ErrorKind::ValueValidation) {
        Some((said, remedy)) => log::line(text.replace(said, remedy).trim_end()),
        // Arguments are repeated as they were written: they may hold orders to the terminal.
        None if log::plain(&text) != text => log::line(text.trim_end()),
        // stderr may be closed.
        None => _ = error.print(),
    }
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
}

/// Writes a manual page of the program and of each command.
fn manual(dir: &Path, overwrite: OverwriteArgs) -> Result<(), CommandError> {
    let outputs = overwrite.outputs::<&Path>([]);
    outputs.folder(dir)?;
    let mut program = Cli::command().disable_help_subcommand(true);
    program.build();
    pages(&program, &mut |name, page| Ok(outputs.write(&dir.join(name), page)?))
}

/// Hands out a page for a command and for each of its own, as `clap_mangen::generate_to` writes them.
fn pages(
    command: &clap::Command,
    put: &mut impl FnMut(String, String) -> Result<(), CommandError>,
) -> Result<(), CommandError> {
    let page = clap_mangen::Man::new(command.clone());
    let mut text = Vec::new();
    page.render(&mut text)?;
    put(page.get_filename(), mark::text(String::from_utf8_lossy(&text).into_owned(), mark::Style::Roff))?;
    command.get_subcommands().filter(|c| !c.is_hide_set()).try_for_each(|c| pages(c, put))
}

/// Runs with the options of a configuration file, where one is named; those of the command line win.
fn run_with_config(args: run::RunArgs) -> Result<(), CommandError> {
    let Some(path) = &args.config else { return start::run(args) };
    let config = config::Config::read(path)?;
    let line: Vec<_> = std::env::args_os().skip_while(|word| word != "run").skip(1).collect();
    let args = config.merged(&line).map_err(|e| CommandError::Arguments(e.to_string()))?;
    if args.connect.is_empty() {
        let text = format!(
            "{} names no link: add connect = [\"serial:/dev/ttyAMA0:921600\"]",
            config.path().display()
        );
        return Err(CommandError::Arguments(text));
    }
    start::run(args)
}

/// Runs a command to its end.
pub fn execute(cli: Cli) -> ExitCode {
    match dispatch(cli.command) {
        Ok(status) => {
            log::flush();
            status
        }
        Err(error) if error.is_closed_pipe() => ExitCode::SUCCESS,
        Err(error) => {
            log::line(&format!("gaware: {error}"));
            log::flush();
            ExitCode::from(error.status())
        }
    }
}

fn dispatch(command: Command) -> Result<ExitCode, CommandError> {
    match command {
        Command::Demo(args) => demo::run(&args)?,
        Command::Run(args) => run_with_config(args)?,
        Command::Config(args) => config::run(&args)?,
        Command::Ground(args) => ground::run(args)?,
        Command::Unit(args) => unit::run(&args)?,
        Command::Replay(args) => replay::run(&args)?,
        Command::Report(args) => report::run(&args)?,
        Command::Sim(args) => {
            start::runtime()?.block_on(async {
                let stop = CancellationToken::new();
                signals::cancel_on_signal(&stop);
                sim::run(&args, log::line, stop).await
            })?;
        }
        Command::Plan(args) => plan::run(&args)?,
        Command::Airframe(args) => airframe::run(&args)?,
        Command::Mission(args) => mission::run(&args)?,
        Command::Compare(args) => compare::run(&args)?,
        Command::Params(args) => params::run(&args)?,
        Command::Serve(args) => serve::run(&args)?,
        Command::Preflight(args) => preflight::run(&args)?,
        Command::Explain(args) => explain::run(&args)?,
        Command::Effects(args) => effects::run(&args)?,
        Command::Fleet(args) => fleet::run(&args)?,
        Command::Study(args) => return study::run(&args),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "gaware", &mut script);
            output::text(&String::from_utf8_lossy(&script))?;
        }
        Command::Manual { dir, overwrite } => manual(&dir, overwrite)?,
    }
    Ok(ExitCode::SUCCESS)
}
