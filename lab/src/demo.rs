//! The demonstration over many simulated vehicles: are estimates that are called observable as good as their sigmas say, and did
//! the plan promise what was reached?

use super::statistics::wilson_95;
use gaware::demo::flight::{Ending, Flight};
use gaware::demo::result::DemoResult;
use gaware::demo::{Prepared, result};
use gaware::engine::snapshot::Status;
use gaware::parallel::{Progress, map_runs};
use gaware_mission::planner::{PlannedState, Reach};
use serde::Serialize;

/// One state over all flights that made it observable.
#[derive(Debug, Clone, Serialize)]
pub struct StateShare {
    /// Name.
    pub name: String,
    /// Flights that made it observable.
    pub observable: usize,
    /// Of these within 2 sigma.
    pub within_2_sigma: usize,
    /// RMS of error over sigma.
    pub rms_normalised_error: f64,
    /// Planned sigma over the one at the end of the plan, mean.
    pub planned_over_reached: f64,
}

/// Sigma at the end of the plan over the planned one, of one state over all completed flights.
#[derive(Debug, Clone, Serialize)]
pub struct StateRatio {
    /// Name.
    pub name: String,
    /// Whether the plan promises that it converges.
    pub promised: bool,
    /// Mean.
    pub mean: f64,
    /// Smallest.
    pub lowest: f64,
    /// Largest.
    pub highest: f64,
    /// Completed flights in which it did not become observable.
    pub not_observable: usize,
}

/// All flights.
#[derive(Debug, Clone, Serialize)]
pub struct DemoStudy {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// Airframe.
    pub airframe: String,
    /// Flights.
    pub runs: usize,
    /// Of these flown to their end.
    pub completed: usize,
    /// Estimates of states called observable.
    pub observable: usize,
    /// Of these within 2 sigma.
    pub within_2_sigma: usize,
    /// Their share.
    pub share: f64,
    /// 95 % interval of the share.
    pub interval_95: [f64; 2],
    /// Largest error over sigma.
    pub worst_normalised_error: f64,
    /// Share of observable states whose planned sigma is within a factor 1.5 of the one reached.
    pub plan_within_factor_1_5: f64,
    /// Length of the plan, s.
    pub plan_s: f64,
    /// States that the plan promises to make known.
    pub promised: Vec<String>,
    /// States that the airframe cannot make known, by the plan's prediction.
    pub beyond_airframe: Vec<String>,
    /// Completed flights in which every promised state became observable.
    pub promise_kept: usize,
    /// 95 % interval of their share.
    pub kept_interval_95: [f64; 2],
    /// Which promised states did not, and how often.
    pub missed: Vec<Missed>,
    /// Per state.
    pub states: Vec<StateShare>,
    /// Mean side force of the vehicles in a level turn with 45° of bank, g; every flight draws its own.
    pub side_force_g: f64,
    /// Reached over planned sigma, smallest and largest of all promised states and completed flights.
    pub reached_over_planned: [f64; 2],
    /// Of these values the ones between 0.8 and 1.25, as a share.
    pub reached_within_0_8_to_1_25: f64,
    /// Promised states that did not become observable, counted over all completed flights.
    pub promised_not_observable: usize,
    /// Reached over planned sigma per state.
    pub ratios: Vec<StateRatio>,
    /// Flown over planned time, mean of the completed flights.
    pub flown_over_planned_s: f64,
}

/// A promised state that did not become observable.
#[derive(Debug, Clone, Serialize)]
pub struct Missed {
    /// Name.
    pub name: String,
    /// Completed flights.
    pub flights: usize,
}

/// Flies the plan with the seeds `seed … seed + runs − 1`.
pub fn run(prepared: &Prepared, runs: usize, seed: u64, progress: &dyn Progress) -> DemoStudy {
    let flights = map_runs(runs, progress, |k| {
        let seed = seed + k as u64;
        let mut flight = Flight::new(prepared.clone(), seed);
        flight.run();
        result::of(&mut flight, seed)
    });
    let completed: Vec<&DemoResult> =
        flights.iter().filter(|f| matches!(f.ending, Ending::Holding | Ending::Landed)).collect();
    let promise_kept = completed.iter().filter(|f| f.promise.missed.is_empty()).count();
    let promised: Vec<String> = prepared.plan.promised().map(|s| s.name.clone()).collect();
    let missed = promised.iter().map(|name| Missed {
        name: name.clone(),
        flights: completed.iter().filter(|f| f.promise.missed.contains(name)).count(),
    });
    let ratios = ratios(prepared, &completed);
    let of_promised: Vec<f64> = completed
        .iter()
        .flat_map(|f| &f.states)
        .filter(|s| s.promised)
        .map(|s| s.reached_over_planned)
        .collect();
    let band = of_promised.iter().filter(|r| (0.8..=1.25).contains(*r)).count();
    let flown_s: f64 = completed.iter().map(|f| f.plan_flown_s / prepared.plan.duration_s).sum();
    let beyond = prepared.plan.states.iter().filter(|s| s.reach != Reach::Known);
    let known: Vec<_> =
        flights.iter().flat_map(|f| &f.states).filter(|s| s.status == Status::Observable).collect();
    let within = known.iter().filter(|s| s.normalised_error.abs() <= 2.0).count();
    let kept =
        known.iter().filter(|s| (1.0 / 1.5..=1.5).contains(&(s.planned_sigma / s.sigma_at_plan_end))).count();
    let mut names: Vec<&str> = known.iter().map(|s| s.name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let states = names.into_iter().map(|name| {
        let of_it: Vec<_> = known.iter().filter(|s| s.name == name).collect();
        let n = of_it.len().max(1) as f64;
        StateShare {
            name: name.to_owned(),
            observable: of_it.len(),
            within_2_sigma: of_it.iter().filter(|s| s.normalised_error.abs() <= 2.0).count(),
            rms_normalised_error: (of_it.iter().map(|s| s.normalised_error.powi(2)).sum::<f64>() / n).sqrt(),
            planned_over_reached: of_it.iter().map(|s| s.planned_sigma / s.sigma_at_plan_end).sum::<f64>()
                / n,
        }
    });
    DemoStudy {
        schema: "gaware.study/1",
        airframe: prepared.settings.airframe.name.clone(),
        runs,
        completed: completed.len(),
        observable: known.len(),
        within_2_sigma: within,
        share: within as f64 / known.len().max(1) as f64,
        interval_95: wilson_95(within, known.len()),
        worst_normalised_error: known.iter().map(|s| s.normalised_error.abs()).fold(0.0, f64::max),
        plan_within_factor_1_5: kept as f64 / known.len().max(1) as f64,
        plan_s: prepared.plan.duration_s,
        missed: missed.filter(|m| m.flights > 0).collect(),
        beyond_airframe: beyond.map(|s| s.name.clone()).collect(),
        promise_kept,
        kept_interval_95: wilson_95(promise_kept, completed.len()),
        promised: promised.clone(),
        states: states.collect(),
        side_force_g: prepared.settings.airframe.side_force_g,
        reached_over_planned: range(&of_promised),
        reached_within_0_8_to_1_25: band as f64 / of_promised.len().max(1) as f64,
        promised_not_observable: ratios.iter().filter(|r| r.promised).map(|r| r.not_observable).sum(),
        ratios,
        flown_over_planned_s: flown_s / completed.len().max(1) as f64,
    }
}

fn range(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::INFINITY, 0.0], |[low, high], v| [v.min(low), v.max(high)])
}

fn ratios(prepared: &Prepared, completed: &[&DemoResult]) -> Vec<StateRatio> {
    let of_state = |planned: &PlannedState| {
        let found: Vec<_> =
            completed.iter().flat_map(|f| &f.states).filter(|s| s.name == planned.name).collect();
        let values: Vec<f64> = found.iter().map(|s| s.reached_over_planned).collect();
        let [lowest, highest] = range(&values);
        (!values.is_empty()).then(|| StateRatio {
            name: planned.name.clone(),
            promised: planned.known(),
            mean: values.iter().sum::<f64>() / values.len() as f64,
            lowest,
            highest,
            not_observable: found.iter().filter(|s| s.status != Status::Observable).count(),
        })
    };
    prepared.plan.states.iter().filter_map(of_state).collect()
}
