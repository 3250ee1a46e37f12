//! `gaware study blind`: inject an effect, fly, explain, compare with the ground truth.

use super::{Bar, StudyError};
use crate::blind::{self, Campaign, Family, Outcome, Share, Summary};
use gaware::commands::{OverwriteArgs, output};
use gaware::outputs::mark;
use gaware::parallel;
use gaware_nav::identify::select::Settings;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `study blind`.
#[derive(Debug, Clone, clap::Args)]
pub struct BlindArgs {
    /// Flights with an injected effect, per family, spread over effects and kinds of flight; 640 are 20 seeds of everything.
    #[arg(long, default_value_t = 64)]
    pub flights: usize,
    /// Clean flights per family.
    #[arg(long, default_value_t = 20)]
    pub clean: usize,
    /// How many effects are injected at once.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=blind::MOST_AT_ONCE as i64))]
    pub effects: u8,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Only these effects.
    #[arg(long, value_name = "EFFECT")]
    pub effect: Vec<String>,
    /// The flights that the method was tuned on, those kept aside (another airframe, other maneuvers, air and vibration), both; or sessions by hand.
    #[arg(long, value_enum, default_value_t = Families::Both)]
    pub family: Families,
    /// So many flights at a time; as many as there are cores when not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub jobs: Option<u16>,
    /// Take the injected effects out of the catalogue: the verdict must say that something is unexplained.
    #[arg(long, conflicts_with = "document")]
    pub unknown: bool,
    /// Effects of barometers and airspeed sensors instead, alone and in pairs, on wings and rotors: so many rounds of 32 flights per family.
    #[arg(long, value_name = "ROUNDS", num_args = 0..=1, default_missing_value = "1", conflicts_with_all = ["document", "unknown", "effect"])]
    pub sensors: Option<usize>,
    /// Drag of multirotors instead, each effect alone and in pairs: so many rounds of 6 flights per family.
    #[arg(long, value_name = "ROUNDS", num_args = 0..=1, default_missing_value = "1", conflicts_with_all = ["document", "unknown", "effect", "sensors"])]
    pub drag: Option<usize>,
    /// Write the catalogue and the confusion matrix to this file.
    #[arg(long, value_name = "FILE")]
    pub document: Option<PathBuf>,
    /// Files that exist.
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Which families of flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Families {
    /// Those on which the method was tuned.
    Tuning,
    /// Those kept aside.
    Aside,
    /// Both.
    Both,
    /// Sessions by hand on the ground, half of them without a receiver.
    Hand,
}

impl Families {
    /// One by one.
    pub fn list(self) -> Vec<Family> {
        match self {
            Self::Tuning => vec![Family::Tuning],
            Self::Aside => vec![Family::Aside],
            Self::Both => vec![Family::Tuning, Family::Aside],
            Self::Hand => vec![Family::Hand],
        }
    }
}

#[derive(Serialize)]
struct Result {
    family: Family,
    summary: Summary,
    confusion: BTreeMap<String, BTreeMap<String, usize>>,
    /// Wall-clock time for each flight, with so many at a time, s.
    seconds_per_flight: f64,
    jobs: usize,
    flights: Vec<Outcome>,
}

/// Runs the study and prints it.
///
/// # Errors
/// Only those of writing to standard output.
pub fn run(args: &BlindArgs) -> std::result::Result<(), StudyError> {
    let outputs = args.overwrite.outputs::<&PathBuf>([]);
    args.document.iter().try_for_each(|path| outputs.check(path))?;
    let families = args.family.list();
    let jobs = args.jobs.map_or_else(parallel::cores, usize::from);
    let beside = [(args.sensors, blind::sensors::SENSORS), (args.drag, blind::sensors::OF_DRAG)];
    if let Some((rounds, flown)) = beside.into_iter().find_map(|(rounds, flown)| Some((rounds?, flown))) {
        return sensors(args, &families, (flown, rounds), jobs);
    }
    let bar =
        gaware::commands::progress_bar((families.len() * (args.flights + args.clean)) as u64, "flights");
    let results: Vec<Result> = families
        .into_iter()
        .map(|family| {
            let campaign = Campaign {
                effects: args.effect.clone(),
                at_once: usize::from(args.effects),
                flights: args.flights,
                clean: args.clean,
                first_seed: args.seed,
                unknown: args.unknown,
                family,
                threads: jobs,
            };
            let begun = Instant::now();
            let flights = blind::run(&campaign, &Settings::default(), &Bar(bar.clone()));
            let (summary, confusion) = (blind::summarise(&flights), blind::confusion(&flights));
            let seconds_per_flight = begun.elapsed().as_secs_f64() / flights.len().max(1) as f64;
            Result { family, summary, confusion, seconds_per_flight, jobs, flights }
        })
        .collect();
    bar.finish_and_clear();
    if let Some(path) = &args.document {
        let all: Vec<Outcome> = results.iter().flat_map(|r| r.flights.iter().cloned()).collect();
        let flown = blind::Flown { flights: args.flights, clean: args.clean, seed: args.seed };
        outputs.write(path, mark::text(blind::document(&all, &flown), mark::Style::Angle))?;
    }
    if args.json {
        return Ok(output::json_pretty(&serde_json::json!({"schema": "gaware.study/1", "blind": results}))?);
    }
    Ok(output::words(|out| results.iter().try_for_each(|r| print(out, r)))?)
}

/// Barometers and airspeed sensors, or drag.
fn sensors(
    args: &BlindArgs,
    families: &[Family],
    (flown, rounds): (&[blind::sensors::Tested], usize),
    jobs: usize,
) -> std::result::Result<(), StudyError> {
    let total = families.len() * blind::sensors::flights(flown, rounds);
    let bar = gaware::commands::progress_bar(total as u64, "flights");
    let fly = |f: &Family| (*f, blind::sensors::run(flown, rounds, args.seed, *f, jobs, &Bar(bar.clone())));
    let all: Vec<(Family, Vec<blind::sensors::SensorFlight>)> = families.iter().map(fly).collect();
    bar.finish_and_clear();
    if args.json {
        let one = |(family, flights): &(Family, Vec<blind::sensors::SensorFlight>)| serde_json::json!({"family": family, "table": blind::sensors::table(flights), "flights": flights});
        let all: Vec<serde_json::Value> = all.iter().map(one).collect();
        return Ok(output::json_pretty(&serde_json::json!({"schema": "gaware.study/1", "sensors": all}))?);
    }
    Ok(output::words(|out| {
        all.iter().try_for_each(|(family, flights)| print_sensors(out, *family, flights))
    })?)
}

fn print_sensors(
    out: &mut String,
    family: Family,
    flights: &[blind::sensors::SensorFlight],
) -> std::fmt::Result {
    let table = blind::sensors::table(flights);
    writeln!(out, "\n{} flights {}", flights.len(), name_of(family))?;
    writeln!(
        out,
        "  {:38} {:>8} {:>6} {:>6} {:>7} {:>10} {:>15}",
        "injected", "times", "alone", "group", "missed", "called ok", "within 2 sigma"
    )?;
    for (name, row) in &table.rows {
        let within = format!("{} of {}", row.within_2_sigma.count, row.within_2_sigma.of);
        writeln!(
            out,
            "  {name:38} {:8} {:6} {:6} {:7} {:10} {within:>15}",
            row.injected, row.alone.count, row.in_group, row.missed, row.missed_and_ok
        )?;
    }
    let lines = [
        ("sensors with a wrong name alone", table.wrong_alone),
        ("sensors in order with something named", table.clean_named),
        ("parameters within 2 sigma", table.within_2_sigma),
        ("parameters within 3 sigma", table.within_3_sigma),
        ("components of the mean wind within 2 sigma", table.wind_within_2_sigma),
    ];
    lines.into_iter().try_for_each(|(what, share)| line(out, what, &share))?;
    for flight in flights.iter().filter(|f| !f.wrong.is_empty()) {
        writeln!(out, "  seed {}: {}", flight.seed, flight.wrong.join(", "))?;
    }
    Ok(())
}

fn name_of(family: Family) -> &'static str {
    match family {
        Family::Tuning => "of the tuning",
        Family::Aside => "kept aside",
        Family::Hand => "by hand",
    }
}

fn line(out: &mut String, what: &str, share: &Share) -> std::fmt::Result {
    let [low, high] = share.interval_95;
    writeln!(
        out,
        "  {what:48} {:4} of {:4} = {:.3} (95 % interval {low:.3} to {high:.3})",
        share.count, share.of, share.share
    )
}

fn print(out: &mut String, result: &Result) -> std::fmt::Result {
    let s = &result.summary;
    writeln!(out, "\nFlights {}", name_of(result.family))?;
    let lines: [(&str, Share); 15] = [
        ("an oracle could name alone", s.oracle),
        ("named alone and right where the oracle could", s.alone_right_where_oracle),
        ("named alone and right", s.alone_right),
        ("truth inside a group where something was named", s.in_group),
        ("nothing named", s.nothing),
        ("a wrong name alone", s.wrong_alone),
        ("more named than injected", s.too_many),
        ("something named on clean flights", s.false_alarms),
        ("held-out data more likely with all that was named", s.held_out_shrinks),
        ("nothing said to be missing where an oracle saw it", s.unnoticed),
        ("explained by something else where an oracle saw it", s.explained_wrongly),
        ("parameters within 2 sigma", s.within_2_sigma),
        ("parameters within 3 sigma", s.within_3_sigma),
        ("all of several found", s.both_found),
        ("all of several found where the oracle could", s.both_found_where_oracle),
    ];
    lines.into_iter().filter(|l| l.1.of > 0).try_for_each(|(what, share)| line(out, what, &share))?;
    writeln!(out, "  {:.1} s for each flight, {} at a time", result.seconds_per_flight, result.jobs)?;
    for (injected, named) in &result.confusion {
        writeln!(out, "  {injected}")?;
        for (name, count) in named {
            writeln!(out, "    {count:4}  {name}")?;
        }
    }
    Ok(())
}
