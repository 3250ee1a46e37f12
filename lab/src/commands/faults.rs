//! `gaware study faults`: what each fault does to the estimate, and what the pilot is shown of it.

use super::{StudyError, show, with_bar};
use crate::faults::long::{self, Long, LongSettings};
use crate::faults::{self, Consistency, FaultResult, Faults, Settings};
use gaware::sinks::recorder::RecordLimit;
use gaware::sinks::words::bytes;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `study faults`.
#[derive(Debug, Clone, clap::Args)]
pub struct FaultsArgs {
    /// Vehicles of each kind (fixed wing, multirotor) per fault.
    #[arg(long, default_value_t = 6)]
    pub seeds: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Only faults whose name contains this (repeatable), for example `loss` or `gnss-jump`.
    #[arg(long, value_name = "NAME")]
    pub fault: Vec<String>,
    /// Instead of the campaign: one companion that is never switched off, flight after flight with faults, for so many hours of
    /// virtual time, recorded to --record within --record-limit.
    #[arg(long, value_name = "HOURS", requires = "record", conflicts_with_all = ["seeds", "fault"], value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub hours: Option<u32>,
    /// Folder for the recordings of --hours.
    #[arg(long, value_name = "FOLDER", requires = "hours")]
    pub record: Option<PathBuf>,
    /// Space for them.
    #[arg(long, value_name = "SIZE", default_value = "500MB", requires = "hours")]
    pub record_limit: RecordLimit,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the campaign and prints it.
///
/// # Errors
/// What the study says, and every fault that is not reported, not recovered from, or makes the sigmas too small.
pub fn run(args: &FaultsArgs) -> Result<(), StudyError> {
    if let (Some(hours), Some(folder)) = (args.hours, &args.record) {
        return long_run(args, hours, folder);
    }
    let settings = Settings { seeds: args.seeds, seed: args.seed, faults: args.fault.clone() };
    let flights = faults::flights(&settings)?;
    let study = with_bar(flights, "flights", |bar| faults::run(&settings, bar))?;
    show(args.json, &study, print)?;
    let failures = study.failures();
    verdict(failures)
}

fn verdict(failures: Vec<String>) -> Result<(), StudyError> {
    if failures.is_empty() { Ok(()) } else { Err(StudyError::Campaign { failures }) }
}

fn long_run(args: &FaultsArgs, hours: u32, folder: &Path) -> Result<(), StudyError> {
    let settings = LongSettings {
        hours,
        seed: args.seed,
        folder,
        limit: args.record_limit,
        resident_bytes: &resident_bytes,
    };
    let study = with_bar(hours as usize + 1, "hours", |bar| long::run(&settings, bar))?;
    show(args.json, &study, print_long)?;
    verdict(study.failures)
}

/// Resident memory of this process, bytes, as Linux reports it.
fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kb| kb * 1024)
}

fn print_long(out: &mut String, study: &Long) -> std::fmt::Result {
    writeln!(out, "hour  NEES/dof  worst  running     memory  files  removed  faults")?;
    for h in &study.hours {
        writeln!(
            out,
            "{:4}{:10.2}{:7.2}{:8.0}%{:>11}{:7}{:9}  {}; largest errors: {}",
            h.hour,
            h.nees_mean_per_dof,
            h.nees_worst_per_dof,
            100.0 * h.running,
            h.resident_bytes.map_or("-".to_owned(), bytes),
            h.recorder.files,
            h.recorder.removed_files,
            h.faults.join("; "),
            h.largest.iter().map(|(name, n)| format!("{name} {n:+.1} sigma")).collect::<Vec<_>>().join(", ")
        )?;
    }
    if let Some(growth) = study.memory_growth {
        writeln!(out, "memory after the first hour: {:+.1} %", 100.0 * growth)?;
    }
    let (r, stats) = (&study.recordings, study.recorder);
    writeln!(
        out,
        "recordings: {} files, {} of {}; {} open, {} replay; {} removed ({}); {} items, {} lost",
        r.files,
        bytes(r.bytes),
        bytes(study.limit_bytes),
        r.opened,
        r.replayed,
        stats.removed_files,
        bytes(stats.removed_bytes),
        stats.written,
        stats.dropped + stats.failed
    )?;
    study.failures.iter().try_for_each(|failure| writeln!(out, "FAILED: {failure}"))
}

fn print(out: &mut String, study: &Faults) -> std::fmt::Result {
    writeln!(
        out,
        "{:20}{:>9}{:>8}{:>8}{:>7}{:>7}{:>7}  NEES/dof mean (worst; constants) before | during | 40 s after | at the end",
        "fault", "right s", "frames", "samples", "gaps s", "fixes", "starts"
    )?;
    for fault in &study.faults {
        row(out, fault)?;
    }
    Ok(())
}

fn row(out: &mut String, f: &FaultResult) -> std::fmt::Result {
    let recovered =
        f.recovered_after_s.map_or("never".to_owned(), |[median, worst]| format!("{median:.0}/{worst:.0}"));
    write!(
        out,
        "{:20}{recovered:>9}{:8.0}{:8.0}{:7.1}{:7.1}{:7.1}  ",
        f.fault, f.lost.frames, f.lost.samples, f.lost.gaps_s, f.lost.fixes, f.lost.restarts
    )?;
    let one = |c: &Consistency| format!("{:.2} ({:.2}; {:.2})", c.mean, c.worst, c.constants_mean);
    let during = f.during.as_ref().map_or("-".to_owned(), one);
    writeln!(out, "{} | {during} | {} | {}", one(&f.before), one(&f.after), one(&f.end))?;
    writeln!(out, "    {}, {} flights", f.happens, f.flights)?;
    for s in &f.shown {
        writeln!(out, "    {:3} after {:.0} s: {}", s.flights, s.after_s, s.text)?;
    }
    for failure in &f.failures {
        writeln!(out, "    FAILED: {failure}")?;
    }
    Ok(())
}
