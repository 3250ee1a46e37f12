//! `gaware explain`: which sensor errors the model lacks, how large they are, and the residuals before and after.

use super::effects::EffectsArgs;
use super::known::{PlaceArgs, UnitFileArgs};
use super::unit::today;
use super::{CommandError, ListenArgs, OverwriteArgs, load_model, output};
use crate::explain::contract::Verdict;
use crate::explain::{self, Explained, Phase, Request, STEPS};
use crate::report::explanation::headline;
use crate::unit::known::KnownUnit;
use gaware_nav::identify::select::{Beside, Settings};
use std::cell::Cell;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Arguments of `explain`.
#[derive(Debug, Clone, clap::Args)]
pub struct ExplainArgs {
    /// Flights and ground sessions of one vehicle (.tlog, .bin, .ulg, .mcap, a folder with imu.csv and gps.csv).
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Model to start from (default: no effects but those of the message itself).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Validation log, excluded from fitting (repeatable; default: blocks of the logs are held out).
    #[arg(long, value_name = "LOG")]
    pub validate: Vec<PathBuf>,
    /// Parameter file of the vehicle (from "gaware params backup"), for what the logs do not hold.
    #[arg(long, value_name = "FILE")]
    pub parameters: Option<PathBuf>,
    /// Explain all of every log, however long (default: an hour at most, of the minutes in which the vehicle moves most).
    #[arg(long)]
    pub whole: bool,
    /// Folder for report.html, report.json, model.toml, effects.toml (of effects outside the catalogue) and the parameter file of the autopilot.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Print the explanation as one JSON document.
    #[arg(long)]
    pub json: bool,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Effects that a user defines: they are looked for like those of the catalogue.
    #[command(flatten)]
    pub effects: EffectsArgs,
    /// Source of the samples.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// What is known of the unit.
    #[command(flatten)]
    pub unit: UnitFileArgs,
    /// Where the vehicle is.
    #[command(flatten)]
    pub place: PlaceArgs,
}

/// Explains, writes the report and prints the verdict.
///
/// # Errors
/// When a log or the model cannot be read, or the report cannot be written. A flight that says too little is none.
pub fn run(args: &ExplainArgs) -> Result<(), CommandError> {
    let read = args.logs.iter().chain(&args.validate).chain(&args.model).chain(&args.parameters);
    let read = read.chain(&args.effects.effects);
    let outputs = args.overwrite.outputs(read);
    explain::check(&args.out, &outputs)?;
    let beside = Beside::default().and(&args.effects.load()?);
    let known = known(args)?;
    let request = Request {
        logs: args.logs.iter().map(Into::into).collect(),
        validate: args.validate.iter().map(Into::into).collect(),
        model: args.model.as_deref().map(load_model).transpose()?,
        converter: args.listen.options(),
        settings: Settings { beside, ..Settings::default() },
        parameters: args.parameters.as_ref().map(Into::into),
        whole: args.whole,
        place: args.place.home,
    };
    // Fails before the analysis where the result cannot be written. A folder that this makes is not left behind empty,
    // however the run ends.
    let new: Vec<&Path> =
        args.out.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists()).collect();
    outputs.folder(&args.out)?;
    for folder in new {
        // A file may be there by now; then the folder stays.
        let _ = std::fs::remove_dir(folder);
    }
    super::signals::end_when_asked("no report was written");
    let began = Instant::now();
    let bar = indicatif::ProgressBar::new_spinner();
    bar.enable_steady_tick(Duration::from_millis(200));
    let entered = Cell::new(began);
    let shown = |phase: Phase| {
        if let Phase::Read(load) = phase {
            bar.suspend(|| crate::sinks::log::line(&load.words()));
            return;
        }
        let (step, what) = phase.step();
        let left = phase.time_left(entered.replace(Instant::now()).elapsed());
        if bar.is_hidden() {
            crate::sinks::log::line(&format!("step {step} of {STEPS}: {what}{left}"));
        }
        let elapsed_s = began.elapsed().as_secs_f64();
        bar.set_message(format!("step {step} of {STEPS}: {what} ({elapsed_s:.0} s so far{left})"));
    };
    let told = |words: &str| bar.suspend(|| crate::sinks::log::line(words));
    let explained = explain::run_from(known.as_ref(), &today(), &request, &shown, &told)?;
    bar.finish_and_clear();
    explain::write(&explained, &args.out, &outputs)?;
    crate::sinks::log::line(&format!("explained in {:.1} s{}", began.elapsed().as_secs_f64(), peak_memory()));
    let explanation = &explained.explanation;
    if args.json {
        output::json_pretty(explanation)?;
    } else {
        output::words(|out| print(out, &explained, &args.out.join("report.html")))?;
    }
    if explanation.verdict == Verdict::TooLittleData {
        return Err(CommandError::TooLittleData(explanation.summary.clone()));
    }
    Ok(())
}

/// The file of the unit that the logs are of; one that was made from them says nothing that they do not.
fn known(args: &ExplainArgs) -> Result<Option<KnownUnit>, CommandError> {
    let Some(first) = args.logs.first() else { return Ok(None) };
    let known = args.unit.of_log(first, args.listen.options().vehicle)?;
    let new = |k: &KnownUnit| args.unit.unit.is_some() || !args.logs.iter().any(|log| k.is_from(log));
    Ok(known.filter(new))
}

/// For people: the result in words, a sentence a line, and where all of it stands.
fn print(out: &mut String, explained: &Explained, report: &Path) -> std::fmt::Result {
    let explanation = &explained.explanation;
    writeln!(out, "verdict: {}", serde_json::json!(explanation.verdict).as_str().unwrap_or("unknown"))?;
    if explanation.residual.is_some() {
        writeln!(out, "{}\n", headline(explained))?;
    }
    // Too little data is said on stderr, with a status of its own.
    let said = explanation.verdict != Verdict::TooLittleData;
    for sentence in explain::words::sentences(&explanation.summary).filter(|_| said) {
        writeln!(out, "{sentence}")?;
    }
    if let Some(words) = explain::autopilot::sentence(explained) {
        writeln!(out, "{words}")?;
    }
    writeln!(out, "report: {}", report.display())
}

/// The most memory that the process has had, where the system reports it; on stderr because it differs from run to run.
fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
    let mb = peak.and_then(|kb| kb.trim().parse::<f64>().ok()).map(|kb| kb / 1024.0);
    mb.map_or_else(String::new, |mb| format!(" with at most {mb:.0} MB of memory"))
}
