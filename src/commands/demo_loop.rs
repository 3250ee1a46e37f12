//! `gaware demo --loop`: from an injected sensor error to parameters of the autopilot, and the second flight.

use super::demo::{DemoArgs, DemoError};
use super::report::ReportError;
use super::{CommandError, compare, output};
use crate::compare::page;
use crate::demo::Settings;
use crate::demo::closed_loop::{self, Loop, LoopResult};
use crate::explain;
use crate::figures::two_figures;
use crate::logs::{Item, Record, tlog};
use crate::outputs::{Outputs, mark};
use gaware_mission::item::Autopilot as Firmware;
use std::fmt::Write;
use std::path::Path;

/// Time for the maneuvers unless another is asked for, s: enough turns and speed changes for each of the effects.
pub const BUDGET_S: f64 = 300.0;
/// The simulated recordings begin on 2026-01-01, µs.
const EPOCH_US: u64 = 1_767_225_600_000_000;
/// What is written beside the explanation.
const RECORDINGS: [&str; 2] = ["before.tlog", "after.tlog"];
const RESULT: &str = "loop.json";

/// Whose habits the simulated autopilot has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Dialect {
    /// ArduPilot.
    Ardupilot,
    /// PX4.
    Px4,
}

impl Dialect {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Ardupilot, Self::Px4];

    /// The firmware that has them.
    pub fn firmware(self) -> Firmware {
        match self {
            Self::Ardupilot => Firmware::ArduPilot,
            Self::Px4 => Firmware::Px4,
        }
    }
}

/// Runs one loop and prints it.
///
/// # Errors
/// A loop that does not come to its end, files that cannot be written.
pub(super) fn run(args: &DemoArgs, mut settings: Settings, outputs: &Outputs) -> Result<(), CommandError> {
    if let Some(folder) = &args.out {
        explain::check(folder, outputs)?;
        RECORDINGS.iter().chain([&RESULT]).try_for_each(|name| outputs.check(&folder.join(name)))?;
    }
    args.report.iter().try_for_each(|path| outputs.check(path))?;
    settings.budget_s = settings.budget_s.or(Some(BUDGET_S));
    if let Some(dialect) = args.autopilot {
        settings.airframe.autopilot = dialect.firmware();
    }
    let prepared = super::demo::plan(settings)?;
    let done = closed_loop::run(&prepared, args.effect, args.seed, &|what| crate::sinks::log::line(what))
        .map_err(|e| DemoError::Loop(Box::new(e)))?;
    if let Some(folder) = &args.out {
        write(&done, folder, outputs)?;
    }
    if let Some(path) = &args.report {
        let [before, after] = &done.flights;
        let html = page::html(&done.result.comparison, before, after);
        outputs.write(path, mark::text(html.map_err(ReportError::Draw)?, mark::Style::Angle))?;
        crate::sinks::log::line(&format!("report: {}", path.display()));
    }
    if args.json {
        return output::json_pretty(&done.result);
    }
    output::words(|out| print(out, &done.result))
}

/// Both recordings, the explanation with its parameter file, and the comparison.
fn write(done: &Loop, folder: &Path, outputs: &Outputs) -> Result<(), CommandError> {
    explain::write(&done.explained, folder, outputs)?;
    for (name, records) in RECORDINGS.into_iter().zip(&done.records) {
        outputs.write(&folder.join(name), tlog_bytes(records))?;
    }
    let json = serde_json::to_string_pretty(&done.result).unwrap_or_default();
    outputs.write(&folder.join(RESULT), mark::json(&json))?;
    crate::sinks::log::line(&format!("recordings, explanation and result: {}", folder.display()));
    Ok(())
}

fn tlog_bytes(records: &[Record]) -> Vec<u8> {
    let bytes = |record: &Record| match &record.item {
        Item::Frame(frame) => tlog::record_bytes(EPOCH_US + record.t_us, frame),
        _ => Vec::new(),
    };
    records.iter().flat_map(bytes).collect()
}

fn print(out: &mut String, r: &LoopResult) -> std::fmt::Result {
    let injected: Vec<String> = r.injected.iter().map(|v| format!("{v:.4}")).collect();
    writeln!(out, "{}, {}, seed {}", r.airframe, r.autopilot, r.seed)?;
    writeln!(out, "injected:  {} {} (SI)", r.effect, injected.join(", "))?;
    let names: Vec<String> = r.explained.iter().map(|names| names.join(" or ")).collect();
    writeln!(out, "explained: {}", names.join(", "))?;
    for c in &r.corrected {
        let before = c.before.map_or_else(|| "?".to_owned(), |v| format!("{v}"));
        let places = two_figures(c.sigma);
        writeln!(
            out,
            "applied:   {} {before} -> {} ± {:.places$} {}, right: {:.places$}",
            c.parameter, c.after, c.sigma, c.unit, c.ideal
        )?;
    }
    writeln!(out)?;
    compare::print(out, &r.comparison, None)
}
