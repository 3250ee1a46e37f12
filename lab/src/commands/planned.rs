//! `gaware study planned`: is what `plan --for` promises what a report of the flight says?

use super::{StudyError, show, with_bar};
use crate::planned::{self, Settings};
use gaware::commands::plan::PlannedSensor;
use std::fmt::Write;

/// Arguments of `study planned`.
#[derive(Debug, Clone, clap::Args)]
pub struct PlannedArgs {
    /// small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes the airframe.
    #[arg(long, value_name = "NAME|FILE", default_value = "small_fixed_wing")]
    pub airframe: String,
    /// Sensors to plan for.
    #[arg(long = "for", value_name = "SENSOR", value_enum, value_delimiter = ',', default_values_t = [PlannedSensor::Airspeed, PlannedSensor::Barometer])]
    pub sensors: Vec<PlannedSensor>,
    /// Flights per effect.
    #[arg(long, default_value_t = 3)]
    pub flights: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the study and prints it.
///
/// # Errors
/// No plan; writing to standard output.
pub fn run(args: &PlannedArgs) -> Result<(), StudyError> {
    let settings = Settings {
        airframe: gaware::commands::demo::load_airframe(&args.airframe)?,
        sensors: args.sensors.clone(),
        flights: args.flights,
        seed: args.seed,
    };
    let study = with_bar(planned::flights(&settings), "flights", |bar| planned::run(&settings, bar))
        .map_err(gaware::commands::CommandError::from)?;
    show(args.json, &study, print)
}

fn print(out: &mut String, study: &planned::PlannedStudy) -> std::fmt::Result {
    writeln!(out, "{}: {}", study.airframe, study.maneuvers.join(", "))?;
    writeln!(
        out,
        "{:15}{:>9}{:>10}{:>10}{:>10}{:>8}{:>8}{:>12}  unit",
        "", "before", "promised", "achieved", "ratio", "flights", "named", "in 2 sigma"
    )?;
    for p in &study.parameters {
        let number = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.3}"));
        writeln!(
            out,
            "{:15}{:9.3}{:10.3}{:>10}{:>10}{:8}{:8}{:>12}  {}",
            p.name,
            p.before,
            p.promised,
            number(p.achieved),
            number(p.achieved.map(|a| a / p.promised)),
            p.flights,
            p.named,
            format!("{} of {}", p.within_2_sigma, p.named),
            p.unit
        )?;
    }
    writeln!(out, "named beside what was injected: {}", study.false_names.join(", "))
}
