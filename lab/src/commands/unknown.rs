//! `gaware study unknown`: inject an effect outside the catalogue, fly, explain, ask for a formula that does the same.

use super::blind::Families;
use super::{StudyError, with_bar};
use crate::unknown::{self, Campaign, Count};
use gaware::commands::output;
use gaware::parallel;
use gaware_nav::identify::select::Settings;
use std::fmt::Write;

/// Arguments of `study unknown`.
#[derive(Debug, Clone, clap::Args)]
pub struct UnknownArgs {
    /// Flights with an injected effect, per family; 32 are each of them once.
    #[arg(long, default_value_t = 32)]
    pub flights: usize,
    /// Clean flights per family.
    #[arg(long, default_value_t = 12)]
    pub clean: usize,
    /// Inject an effect of the catalogue beside it.
    #[arg(long)]
    pub beside: bool,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// The flights of the tuning, those kept aside, or both.
    #[arg(long, value_enum, default_value_t = Families::Aside)]
    pub family: Families,
    /// So many flights at a time; as many as there are cores when not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub jobs: Option<u16>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the study and prints it.
///
/// # Errors
/// Only those of writing to standard output.
pub fn run(args: &UnknownArgs) -> Result<(), StudyError> {
    let families = args.family.list();
    let campaign = |family| Campaign {
        flights: args.flights,
        clean: args.clean,
        beside: args.beside,
        seed: args.seed,
        family,
        threads: args.jobs.map_or_else(parallel::cores, usize::from),
    };
    let flights = families.len() * (args.flights + args.clean);
    let outcomes = with_bar(flights, "flights", |bar| {
        let run = |family| unknown::run(&campaign(family), &Settings::default(), bar);
        families.into_iter().flat_map(run).collect::<Vec<_>>()
    });
    let summary = unknown::summarise(&outcomes);
    if args.json {
        let document =
            serde_json::json!({"schema": "gaware.study/1", "unknown": summary, "flights": outcomes});
        return Ok(output::json_pretty(&document)?);
    }
    Ok(output::words(|out| {
        let lines: [(&str, Count); 5] = [
            ("an oracle could name alone", summary.oracle),
            ("where it could: the right formula, or one equal to it", summary.right),
            ("where it could: a wrong name of the catalogue alone", summary.wrong_name_alone),
            ("where it could: nothing missing", summary.nothing_missing),
            ("a formula on clean flights", summary.false_formula),
        ];
        for (what, count) in lines {
            writeln!(out, "  {what:56} {:4} of {:4}", count.count, count.of)?;
        }
        writeln!(out, "  {:.1} s for each explanation", summary.seconds)?;
        outcomes.iter().try_for_each(|o| {
            let named = o.groups.iter().map(|g| g.join(" | ")).collect::<Vec<_>>().join(" + ");
            let truth = o.injected.as_deref().unwrap_or("clean");
            let beside = o.beside.map_or_else(String::new, |b| format!(" + {b}"));
            let oracle = if o.oracle.is_some_and(|s| s.alone) { "seen" } else { "-" };
            let right = if o.equal.is_empty() { "" } else { " (right)" };
            writeln!(out, "  {truth}{beside} [{oracle}]: {named}{right}")
        })
    })?)
}
