//! `gaware fleet LOGS… --out DIR`: replay and explain over many logs, each in a process of its own.
//!
//! A process for each log, not a thread: memory that one analysis took goes back to the system, and a log that drives one into the end of the
//! memory or into a defect ends that process alone. It costs some milliseconds for seconds of work.

use super::fleet_limits::{Ended, Limits};
use super::{CommandError, ListenArgs, OverwriteArgs, fleet_report, load_model, output, progress_bar};
use crate::export::Target;
use crate::fleet::FleetError;
use crate::fleet::find::{self, NameRule};
use crate::fleet::flight::{FlightEntry, Work};
use crate::fleet::log::{FleetLog, Named};
use crate::fleet::store::{self, Address, Store};
use crate::fleet::tables;
use crate::outputs::Outputs;
use crate::parallel;
use crate::sinks::log;
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

/// Arguments of `fleet`.
#[derive(Debug, Clone, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct FleetArgs {
    /// What to do instead of analysing logs.
    #[command(subcommand)]
    pub command: Option<FleetCommand>,
    /// Logs, folders with logs (at any depth), or patterns such as 'flights/*/*.bin'.
    #[arg(required = true, value_name = "LOG|DIR|PATTERN")]
    pub logs: Vec<String>,
    /// How.
    #[command(flatten)]
    pub options: FleetOptions,
    /// Logs that are analysed at once (default: one for each processor).
    #[arg(long, value_name = "N")]
    pub jobs: Option<usize>,
    /// What one log may take.
    #[command(flatten)]
    pub limits: Limits,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// What decides on the results, and where they go.
#[derive(Debug, Clone, clap::Args)]
pub struct FleetOptions {
    /// Folder for the tables flights.parquet and effects.parquet, fleet.json and the results of single logs. A run that was
    /// interrupted goes on there.
    #[arg(long, value_name = "DIR", required = true)]
    pub out: Option<PathBuf>,
    /// Model of the sensors for the replay (default: the recording's own, otherwise the standard model).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Replay only; do not identify unmodelled effects.
    #[arg(long)]
    pub no_explain: bool,
    /// Where a path has the inertial unit and the firmware: for example '{unit}/{firmware}_*.bin' (default: the board and
    /// version that the log names).
    #[arg(long, value_name = "RULE")]
    pub names: Option<String>,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
}

/// What there is beside the analysis of logs.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum FleetCommand {
    /// What the flights of each inertial unit have in common: constant part, turn-on spread, drift, units out of family,
    /// shifts that came with a firmware. As a page with plots, and as text or JSON.
    Report(fleet_report::ReportArgs),
    /// Write the model for the next flight of one inertial unit.
    Prior(fleet_report::PriorArgs),
    /// One log, in a process of its own.
    #[command(hide = true)]
    Work(WorkArgs),
}

/// Arguments of the process for one log.
#[derive(Debug, Clone, clap::Args)]
pub struct WorkArgs {
    /// The log.
    pub log: PathBuf,
    /// How.
    #[command(flatten)]
    pub options: FleetOptions,
}

impl FleetOptions {
    fn work(&self) -> Result<Work, CommandError> {
        let model = self.model.as_deref().map(load_model).transpose()?;
        Ok(Work { model, explain: !self.no_explain, converter: self.listen.options() })
    }

    fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new("."))
    }

    /// The same as words of a command line.
    fn words(&self) -> Vec<std::ffi::OsString> {
        let mut words = vec!["--out".into(), self.out().into()];
        if let Some(model) = &self.model {
            words.extend(["--model".into(), model.into()]);
        }
        if self.no_explain {
            words.push("--no-explain".into());
        }
        if let Some(source) = self.listen.source {
            words.extend(["--source".into(), source.to_string().into()]);
        }
        if let Some(vehicle) = self.listen.vehicle {
            words.extend(["--vehicle".into(), vehicle.to_string().into()]);
        }
        words
    }
}

/// The result of a run over a fleet (`gaware.fleet/1`).
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct FleetResult {
    /// `gaware.fleet/1`.
    pub schema: &'static str,
    /// Logs.
    pub logs: usize,
    /// Of these analysed.
    pub analysed: usize,
    /// Of these with results of an earlier run.
    pub resumed: usize,
    /// Logs that could not be analysed, with the reason.
    pub failed: Vec<FailedLog>,
    /// Logs that were analysed and take no part in what the units have in common, with the reason.
    pub left_out: Vec<FailedLog>,
    /// How often explain came to each verdict.
    pub verdicts: BTreeMap<String, usize>,
    /// In how many flights explain identified each effect (best name of its step).
    pub identified: BTreeMap<String, usize>,
    /// Flights of each inertial unit.
    pub units: BTreeMap<String, usize>,
    /// Files written.
    pub files: Vec<PathBuf>,
}

/// A log that could not be analysed.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct FailedLog {
    /// Path.
    pub log: String,
    /// Why.
    pub reason: String,
}

/// Runs the command.
///
/// # Errors
/// When no log is found, the folder cannot be written, or not one log can be analysed.
pub fn run(args: &FleetArgs) -> Result<(), CommandError> {
    match &args.command {
        Some(FleetCommand::Report(args)) => return fleet_report::report(args),
        Some(FleetCommand::Prior(args)) => return fleet_report::prior(args),
        Some(FleetCommand::Work(args)) => return one(args),
        None => {}
    }
    let rule = args.options.names.as_deref().map(NameRule::new).transpose()?;
    let paths = find::logs(&args.logs)?;
    let read = paths.iter().chain(&args.options.model);
    let outputs = args.overwrite.outputs(read);
    check(args.options.out(), &outputs)?;
    args.limits.check()?;
    let store = Store::open(args.options.out(), &args.options.work()?)?;
    let (done, resumed) = analyse_all(&store, &paths, args);
    let logs: Vec<FleetLog> = paths
        .iter()
        .zip(done)
        .map(|(path, result)| FleetLog {
            path: path.display().to_string(),
            named: rule.as_ref().map_or_else(Named::default, |rule| rule.read(path)),
            result: result.map_err(|e| e.to_string()),
        })
        .collect();
    let files = write(args.options.out(), &logs, &outputs)?;
    let result = summary(&logs, resumed, files);
    if args.json {
        output::json(&result)?;
    } else {
        output::words(|out| print(out, &result))?;
    }
    match result.failed.first().filter(|_| result.analysed == 0) {
        Some(f) => {
            let first = format!("{}: {}", f.log, f.reason);
            Err(FleetError::AllFailed { count: result.logs, first }.into())
        }
        None => Ok(()),
    }
}

/// One log, in this process: the result goes into the store.
fn one(args: &WorkArgs) -> Result<(), CommandError> {
    // As many processes run as there are processors.
    parallel::use_at_most(1);
    store::analysed(&args.log, &args.options.work()?, Some(args.options.out()))?;
    Ok(())
}

type Done = Result<FlightEntry, FleetError>;

/// All results in order, and how many were there before.
fn analyse_all(store: &Store, paths: &[PathBuf], args: &FleetArgs) -> (Vec<Done>, usize) {
    let jobs = args.jobs.unwrap_or_else(parallel::cores);
    let addresses = parallel::map_runs_on(jobs, paths.len(), &parallel::Silent, |k| {
        paths.get(k).map(|path| store.address(path))
    });
    let mut done: Vec<Option<Done>> = Vec::new();
    let mut todo: Vec<(usize, &Path, Address)> = Vec::new();
    for (k, (path, address)) in paths.iter().zip(addresses.into_iter().flatten()).enumerate() {
        done.push(match address {
            Err(error) => Some(Err(error)),
            Ok(address) => {
                let there = store.get(&address).map(Ok);
                if there.is_none() {
                    todo.push((k, path, address));
                }
                there
            }
        });
    }
    let resumed = done.iter().flatten().filter(|d| d.is_ok()).count();
    if resumed > 0 {
        log::line(&format!("{resumed} of {} logs were analysed before", paths.len()));
    }
    // The largest first: none is left for the end while other processors have nothing to do.
    todo.sort_by_key(|(k, _, address)| (std::cmp::Reverse(address.content.bytes), *k));
    let meter = Meter::new(&todo);
    let results = parallel::map_runs_on(jobs, todo.len(), &parallel::Silent, |k| {
        let (_, path, address) = todo.get(k)?;
        let result = in_a_process(store, path, address, args);
        meter.finished(path, address.content.bytes, &result);
        Some(result)
    });
    meter.bar.finish_and_clear();
    for ((k, ..), result) in todo.iter().zip(results) {
        if let Some(place) = done.get_mut(*k) {
            *place = result;
        }
    }
    (done.into_iter().flatten().collect(), resumed)
}

/// Analyses one log in a process of its own; its result comes through the store.
fn in_a_process(store: &Store, path: &Path, address: &Address, args: &FleetArgs) -> Done {
    let wrong = |reason: String| FleetError::Worker { log: path.to_owned(), reason };
    let program = std::env::current_exe().map_err(|e| wrong(e.to_string()))?;
    let mut work = Command::new(program);
    work.args(["fleet", "work"]).args(args.options.words()).arg("--").arg(path);
    let ended = args.limits.run(&mut work).map_err(|e| wrong(e.to_string()))?;
    match (store.get(address), ended) {
        (Some(entry), _) => Ok(entry),
        (None, Ended::AtLimit { limit, option }) => {
            Err(FleetError::Limit { log: path.to_owned(), limit, option })
        }
        // Its result lies under the hash of what is in the log now.
        (None, Ended::Alone(output)) if output.status.success() => Err(FleetError::Changed(path.to_owned())),
        (None, Ended::Alone(output)) => {
            let said = String::from_utf8_lossy(&output.stderr);
            let last = said.lines().rev().find(|l| !l.trim().is_empty()).map(|l| format!(": {l}"));
            Err(wrong(format!("{}{}", output.status, last.unwrap_or_default())))
        }
    }
}

/// How far the work is: a bar on a terminal, otherwise a line for each log.
struct Meter {
    bar: indicatif::ProgressBar,
    began: Instant,
    logs: usize,
    bytes: u64,
    logs_done: AtomicUsize,
    bytes_done: AtomicU64,
}

impl Meter {
    fn new(todo: &[(usize, &Path, Address)]) -> Self {
        // A log of no bytes takes time too.
        let bytes = todo.iter().map(|(_, _, a)| a.content.bytes + 1).sum();
        Self {
            bar: progress_bar(bytes, "bytes of logs"),
            began: Instant::now(),
            logs: todo.len(),
            bytes,
            logs_done: AtomicUsize::new(0),
            bytes_done: AtomicU64::new(0),
        }
    }

    fn finished(&self, path: &Path, bytes: u64, result: &Done) {
        let logs = self.logs_done.fetch_add(1, Ordering::Relaxed) + 1;
        let done = self.bytes_done.fetch_add(bytes + 1, Ordering::Relaxed) + bytes + 1;
        self.bar.set_position(done);
        if self.bar.is_hidden() {
            let left_s =
                self.began.elapsed().as_secs_f64() * (self.bytes.saturating_sub(done) as f64 / done as f64);
            let failed = match result {
                Ok(entry) => entry.failed.is_some(),
                Err(_) => true,
            };
            let failed = if failed { " (failed)" } else { "" };
            log::line(&format!(
                "{logs} of {} logs, about {} left: {}{failed}",
                self.logs,
                duration(left_s),
                path.display()
            ));
        }
    }
}

fn duration(s: f64) -> String {
    match s {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// The tables, and which logs they are made of.
///
/// # Errors
/// What the system says.
pub fn write(out: &Path, logs: &[FleetLog], outputs: &Outputs) -> Result<Vec<PathBuf>, CommandError> {
    let mut files = Target::new(out)?.write(&tables::tables(logs), outputs)?;
    files.push(fleet_report::write_fleet(out, logs, outputs)?);
    Ok(files)
}

/// Whether these files may be written, before the work.
fn check(out: &Path, outputs: &Outputs) -> Result<(), CommandError> {
    let tables = tables::tables(&[]);
    Target::new(out)?.check(tables.iter().map(|t| t.name), outputs)?;
    Ok(outputs.check(&fleet_report::list(out))?)
}

fn summary(logs: &[FleetLog], resumed: usize, files: Vec<PathBuf>) -> FleetResult {
    let mut result = FleetResult {
        schema: "gaware.fleet/1",
        logs: logs.len(),
        analysed: 0,
        resumed,
        failed: Vec::new(),
        left_out: Vec::new(),
        verdicts: BTreeMap::new(),
        identified: BTreeMap::new(),
        units: BTreeMap::new(),
        files,
    };
    for log in logs {
        if let Some(reason) = log.failure() {
            result.failed.push(FailedLog { log: log.path.clone(), reason: reason.to_owned() });
        } else if let Some(reason) = log.left_out() {
            result.left_out.push(FailedLog { log: log.path.clone(), reason: reason.to_owned() });
        }
        let Some(flight) = log.flight() else { continue };
        result.analysed += usize::from(log.failure().is_none());
        *result.units.entry(log.unit().unwrap_or("unknown").to_owned()).or_default() += 1;
        let Some(explanation) = &flight.explanation else { continue };
        if let Some(verdict) = explanation.get("verdict").and_then(|v| v.as_str()) {
            *result.verdicts.entry(verdict.to_owned()).or_default() += 1;
        }
        let steps = explanation.get("effects").and_then(|v| v.as_array()).into_iter().flatten();
        for name in steps.filter_map(|s| s.pointer("/names/0")?.as_str()) {
            *result.identified.entry(name.to_owned()).or_default() += 1;
        }
    }
    result
}

fn print(out: &mut String, result: &FleetResult) -> std::fmt::Result {
    writeln!(
        out,
        "{} of {} logs analysed ({} in earlier runs), {} failed",
        result.analysed,
        result.logs,
        result.resumed,
        result.failed.len()
    )?;
    for failed in &result.failed {
        writeln!(out, "  failed: {}: {}", failed.log, failed.reason)?;
    }
    for log in &result.left_out {
        writeln!(out, "  in no unit: {}: {}", log.log, log.reason)?;
    }
    for (title, counts) in
        [("verdicts", &result.verdicts), ("identified effects", &result.identified), ("units", &result.units)]
    {
        if !counts.is_empty() {
            let words: Vec<String> = counts.iter().map(|(name, n)| format!("{name} {n}")).collect();
            writeln!(out, "{title}: {}", words.join(", "))?;
        }
    }
    for file in &result.files {
        writeln!(out, "written: {}", file.display())?;
    }
    Ok(())
}
