//! The whole loop, many times: inject, fly, explain, apply, fly again, compare, for each effect that a parameter corrects and both
//! autopilots.

use super::statistics::{summary, wilson_95};
use gaware::advice::on_board;
use gaware::compare::statistics::Change;
use gaware::demo::Prepared;
use gaware::demo::closed_loop::{self, Correctable, LoopResult};
use gaware::parallel::{Progress, map_runs};
use serde::Serialize;

/// A parameter that is further than this from the right value is a failure, sigma.
const WITHIN_SIGMAS: f64 = 3.0;

/// What became of one loop.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Seed.
    pub seed: u64,
    /// The result, where the loop came to its end.
    pub result: Option<LoopResult>,
    /// Why it did not.
    pub failed: Option<String>,
}

/// All loops of one effect with one autopilot.
#[derive(Debug, Clone, Serialize)]
pub struct Tally {
    /// `ardupilot` or `px4`.
    pub autopilot: &'static str,
    /// What was injected.
    pub effect: Correctable,
    /// Loops.
    pub runs: usize,
    /// Loops that came to their end.
    pub completed: usize,
    /// Loops in which a parameter of the injected effect was changed.
    pub right_parameter: usize,
    /// Loops in which at least one of the autopilot's test ratios is smaller afterwards, beyond chance.
    pub smaller: usize,
    /// 95 % interval of their share of all loops.
    pub smaller_interval_95: [f64; 2],
    /// Loops in which one is larger, beyond chance; 5 % of loops have a difference by chance.
    pub larger: usize,
    /// Parameters that were changed.
    pub parameters: usize,
    /// Of these within 3 sigma of the right value.
    pub within_3_sigma: usize,
    /// Largest error over sigma.
    pub worst_sigmas: f64,
    /// Loops in which the mean velocity test ratio fell.
    pub velocity_fell: usize,
    /// 95 % interval of their share of all loops.
    pub velocity_fell_interval_95: [f64; 2],
    /// Median ratio of the velocity test ratio, after over before.
    pub median_velocity_ratio: f64,
    /// Loop by loop.
    pub loops: Vec<Outcome>,
}

/// All of them.
#[derive(Debug, Clone, Serialize)]
pub struct LoopStudy {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// By autopilot and effect.
    pub tallies: Vec<Tally>,
}

/// Loops with the seeds `seed … seed + runs − 1`, for each of the plans (one per autopilot) and effects.
pub fn run(
    prepared: &[Prepared],
    effects: &[Correctable],
    runs: usize,
    seed: u64,
    progress: &dyn Progress,
) -> LoopStudy {
    let kinds: Vec<(&Prepared, Correctable)> =
        prepared.iter().flat_map(|p| effects.iter().map(move |e| (p, *e))).collect();
    let outcomes = map_runs(kinds.len() * runs, progress, |k| {
        let (kind, seed) = (k / runs.max(1), seed + (k % runs.max(1)) as u64);
        let (result, failed) = match kinds.get(kind) {
            None => (None, None),
            Some((prepared, effect)) => match closed_loop::run(prepared, *effect, seed, &|_| ()) {
                Ok(done) => (Some(done.result), None),
                Err(error) => (None, Some(error.to_string())),
            },
        };
        Outcome { seed, result, failed }
    });
    let tallies = kinds.iter().zip(outcomes.chunks(runs.max(1)));
    LoopStudy {
        schema: "gaware.study/1",
        tallies: tallies.map(|((prepared, effect), loops)| tally(prepared, *effect, loops)).collect(),
    }
}

fn tally(prepared: &Prepared, effect: Correctable, loops: &[Outcome]) -> Tally {
    let done: Vec<&LoopResult> = loops.iter().filter_map(|o| o.result.as_ref()).collect();
    let changed = |change: Change| {
        done.iter().filter(|r| r.comparison.judged.iter().any(|row| row.ratio.change == change)).count()
    };
    let errors: Vec<f64> = done.iter().flat_map(|r| &r.corrected).map(|c| c.error_sigmas.abs()).collect();
    let velocity = |r: &&LoopResult| {
        let rows = &r.comparison.judged;
        rows.iter().find(|row| row.quantity.words().starts_with("velocity")).map(|row| row.ratio.value)
    };
    let smaller = changed(Change::Smaller);
    let velocity_ratios: Vec<f64> = done.iter().filter_map(velocity).collect();
    let velocity_fell = velocity_ratios.iter().filter(|r| **r < 1.0).count();
    Tally {
        autopilot: on_board::key(prepared.settings.airframe.autopilot),
        effect,
        runs: loops.len(),
        completed: done.len(),
        right_parameter: done.iter().filter(|r| r.right_parameter).count(),
        smaller,
        smaller_interval_95: wilson_95(smaller, loops.len()),
        larger: changed(Change::Larger),
        parameters: errors.len(),
        within_3_sigma: errors.iter().filter(|e| **e <= WITHIN_SIGMAS).count(),
        worst_sigmas: errors.iter().copied().fold(0.0, f64::max),
        velocity_fell,
        velocity_fell_interval_95: wilson_95(velocity_fell, loops.len()),
        median_velocity_ratio: summary(velocity_ratios.into_iter()).median,
        loops: loops.to_vec(),
    }
}

/// One table row per tally, then what failed.
impl std::fmt::Display for LoopStudy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{:<10}{:<20}{:>5}{:>10}{:>16}{:>9}{:>8}{:>12}{:>16}{:>8}{:>15}{:>15}",
            "",
            "injected",
            "runs",
            "completed",
            "right parameter",
            "smaller",
            "larger",
            "parameters",
            "within 3 sigma",
            "worst",
            "velocity fell",
            "median ratio"
        )?;
        for t in &self.tallies {
            writeln!(
                f,
                "{:<10}{:<20}{:>5}{:>10}{:>16}{:>9}{:>8}{:>12}{:>16}{:>8.1}{:>15}{:>15.2}",
                t.autopilot,
                t.effect.name(),
                t.runs,
                t.completed,
                t.right_parameter,
                t.smaller,
                t.larger,
                t.parameters,
                t.within_3_sigma,
                t.worst_sigmas,
                t.velocity_fell,
                t.median_velocity_ratio
            )?;
        }
        for t in &self.tallies {
            for outcome in &t.loops {
                if let Some(why) = &outcome.failed {
                    writeln!(f, "{} {} seed {}: {why}", t.autopilot, t.effect.name(), outcome.seed)?;
                }
            }
        }
        Ok(())
    }
}
