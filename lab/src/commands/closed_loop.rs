//! `gaware study loop`: inject, fly, explain, apply, fly again, compare, many times.

use super::{StudyError, show, with_bar};
use crate::closed_loop as study;
use gaware::commands::demo::{DemoError, check_budget, load_airframe};
use gaware::commands::demo_loop::{BUDGET_S, Dialect};
use gaware::demo::closed_loop::Correctable;
use gaware::demo::{Prepared, Settings};
use std::fmt::Write;

/// Arguments of `study loop`.
#[derive(Debug, Clone, clap::Args)]
pub struct LoopArgs {
    /// Loops per effect and autopilot, each with another vehicle.
    #[arg(long, default_value_t = 50)]
    pub seeds: usize,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Only these effects (default: all).
    #[arg(long, value_enum, value_name = "EFFECT")]
    pub effect: Vec<Correctable>,
    /// Only these autopilots (default: both).
    #[arg(long, value_enum, value_name = "NAME")]
    pub autopilot: Vec<Dialect>,
    /// What flies: small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes it.
    #[arg(long, value_name = "NAME|FILE", default_value = "small_fixed_wing")]
    pub airframe: String,
    /// Time for the maneuvers, s.
    #[arg(long, value_name = "SECONDS", default_value_t = BUDGET_S)]
    pub budget: f64,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the study and prints it.
///
/// # Errors
/// No such airframe, no safe plan, output that cannot be written.
pub fn run(args: &LoopArgs) -> Result<(), StudyError> {
    let or_all = |asked: &[Dialect]| if asked.is_empty() { Dialect::ALL.to_vec() } else { asked.to_vec() };
    let effects = if args.effect.is_empty() { Correctable::ALL.to_vec() } else { args.effect.clone() };
    let budget = check_budget(Some(args.budget))?;
    let plans = or_all(&args.autopilot).into_iter().map(|dialect| {
        let mut airframe = load_airframe(&args.airframe)?;
        airframe.autopilot = dialect.firmware();
        Ok(Prepared::new(Settings::new(airframe, budget)).map_err(DemoError::from)?)
    });
    let plans: Vec<Prepared> = plans.collect::<Result<_, StudyError>>()?;
    let loops = plans.len() * effects.len() * args.seeds;
    let study = with_bar(loops, "loops", |bar| study::run(&plans, &effects, args.seeds, args.seed, bar));
    show(args.json, &study, |out, study| write!(out, "{study}"))
}
