//! The flight after the ground session: what is left to show (latency, antenna) in five minutes, by a plan that begins with the unit's file.

use crate::statistics::summary;
use gaware::demo::flight::{Ending, Flight};
use gaware::demo::ground::GroundSession;
use gaware::demo::result::StateResult;
use gaware::demo::{Prepared, Settings, result};
use gaware::engine::snapshot::Status;
use gaware::parallel::{Progress, map_runs};
use gaware_mission::airframe::Airframe;
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::filter::layout::Layout;
use serde::Serialize;

/// Length of the flight's maneuvers, s.
const FLIGHT_S: f64 = 300.0;
/// The antenna is known below this sigma, m: a third of where it may be.
const ANTENNA_M: f64 = 0.1;
/// Reached over planned sigma that counts as planned.
const AS_PLANNED: [f64; 2] = [0.8, 1.25];

/// One constant over all flights.
#[derive(Debug, Clone, Serialize)]
pub struct StateRow {
    /// Name, and the unit of its sigma.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Share of the flights that end with it observable.
    pub observable: f64,
    /// Median sigma at the end.
    pub sigma: f64,
    /// Mean squared error over sigma.
    pub nees: f64,
    /// Share beyond three sigmas.
    pub beyond_3_sigma: f64,
    /// Reached over planned sigma: smallest, median and largest.
    pub reached_over_planned: [f64; 3],
}

/// Sessions and flights.
#[derive(Debug, Clone, Serialize)]
pub struct ThenFlight {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// Units.
    pub runs: usize,
    /// First seed.
    pub seed: u64,
    /// Flights that came to their end.
    pub completed: usize,
    /// Share of the units of which all of G, latency and antenna are observable at the end.
    pub all_observable: f64,
    /// Mean squared error over sigma of all of them.
    pub nees_per_dof: f64,
    /// Share of reached over planned sigmas between 0.8 and 1.25.
    pub as_planned: f64,
    /// Median length of session and plan, s.
    pub session_s: f64,
    /// Of the plan, s.
    pub plan_s: f64,
    /// Constants.
    pub states: Vec<StateRow>,
}

/// What one unit shows.
#[derive(Debug, Default)]
struct One {
    completed: bool,
    session_s: f64,
    plan_s: f64,
    states: Vec<StateResult>,
}

/// Whether it is one of the constants that session and flight are made for.
fn is_wanted(state: &StateResult) -> bool {
    state.name == "latency" || (state.name.len() == 3 && state.name.starts_with('g'))
}

/// The place of the antenna, a tolerance that no plan promises.
fn antenna(flight: &Flight) -> Option<Vec<StateResult>> {
    let filter = flight.pipeline().engine().filter()?;
    let (layout, truth) = (filter.layout(), flight.truth());
    let (true_layout, true_values) = (Layout::new(truth), Calibration::new(truth));
    let one = |name: &&str| {
        let state = layout.find(name)?;
        let sigma = filter.covariance().sigma(state);
        let planned_sigma =
            flight.prepared().prediction.sigmas.iter().find(|p| p.name == *name).map(|p| p.sigma)?;
        let (estimate, truth) =
            (filter.calibration().get(layout, state), true_values.get(&true_layout, true_layout.find(name)?));
        Some(StateResult {
            name: (*name).to_owned(),
            unit: "m".to_owned(),
            truth,
            estimate,
            sigma,
            normalised_error: (estimate - truth) / sigma,
            planned_sigma,
            sigma_at_plan_end: sigma,
            reached_over_planned: sigma / planned_sigma,
            promised: false,
            status: if sigma < ANTENNA_M { Status::Observable } else { Status::Weak },
        })
    };
    ["lever_x", "lever_y", "lever_z"].iter().map(one).collect()
}

/// Runs sessions and flights of the units `seed … seed + runs − 1`.
pub fn run(runs: usize, seed: u64, progress: &dyn Progress) -> ThenFlight {
    let made = map_runs(runs, progress, |k| one(seed.wrapping_add(k as u64)).unwrap_or_default());
    let completed: Vec<&One> = made.iter().filter(|m| m.completed).collect();
    let all = |m: &&&One| m.states.iter().all(|s| s.status == Status::Observable);
    let states = || completed.iter().flat_map(|m| &m.states);
    let within = |s: &&StateResult| (AS_PLANNED[0]..=AS_PLANNED[1]).contains(&s.reached_over_planned);
    let names = completed.first().into_iter().flat_map(|m| m.states.iter().map(|s| s.name.clone()));
    let share = |n: usize, of: usize| n as f64 / of.max(1) as f64;
    ThenFlight {
        schema: "gaware.study/1",
        runs,
        seed,
        completed: completed.len(),
        all_observable: share(completed.iter().filter(all).count(), runs),
        nees_per_dof: summary(states().map(|s| s.normalised_error.powi(2))).mean,
        as_planned: share(states().filter(within).count(), states().count()),
        session_s: summary(completed.iter().map(|m| m.session_s)).median,
        plan_s: summary(completed.iter().map(|m| m.plan_s)).median,
        states: names.map(|name| row(name, &completed)).collect(),
    }
}

fn one(seed: u64) -> Option<One> {
    let settings = Settings::new(Airframe::example("small_fixed_wing")?, Some(FLIGHT_S));
    let mut session = GroundSession::new(&settings, seed);
    session.go_on(f64::INFINITY);
    let prepared = Prepared::new(settings.knowing(&session.unit()?)).ok()?;
    let plan_s = prepared.plan.duration_s;
    let mut flight = Flight::new(prepared, seed);
    flight.run();
    let shown = result::of(&mut flight, seed);
    let antenna = antenna(&flight)?;
    Some(One {
        completed: matches!(shown.ending, Ending::Holding | Ending::Landed),
        session_s: session.now_s(),
        plan_s,
        states: shown.states.into_iter().filter(is_wanted).chain(antenna).collect(),
    })
}

fn row(name: String, of: &[&One]) -> StateRow {
    let own: Vec<_> = of.iter().flat_map(|m| &m.states).filter(|s| s.name == name).collect();
    let share = |is: &dyn Fn(&StateResult) -> bool| {
        own.iter().filter(|s| is(s)).count() as f64 / own.len().max(1) as f64
    };
    let reached = || own.iter().map(|s| s.reached_over_planned);
    StateRow {
        name,
        unit: own.first().map(|s| s.unit.clone()).unwrap_or_default(),
        observable: share(&|s| s.status == Status::Observable),
        sigma: summary(own.iter().map(|s| s.sigma)).median,
        nees: summary(own.iter().map(|s| s.normalised_error.powi(2))).mean,
        beyond_3_sigma: share(&|s| s.normalised_error.abs() > 3.0),
        reached_over_planned: [
            reached().fold(f64::INFINITY, f64::min),
            summary(reached()).median,
            reached().fold(0.0, f64::max),
        ],
    }
}

impl std::fmt::Display for ThenFlight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{} units from seed {}: a session by hand of {:.0} s, then a flight of {:.0} s; {} flights came to their end",
            self.runs, self.seed, self.session_s, self.plan_s, self.completed
        )?;
        writeln!(
            f,
            "all of G, latency and antenna observable in {:.0} % of the units, NEES/dof {:.2}, reached over planned sigma in {:.0} % between {} and {}",
            100.0 * self.all_observable,
            self.nees_per_dof,
            100.0 * self.as_planned,
            AS_PLANNED[0],
            AS_PLANNED[1]
        )?;
        writeln!(
            f,
            "{:12}{:>11}{:>10} {:10}{:>6}{:>7}   reached over planned",
            "", "observable", "sigma", "", "NEES", ">3σ"
        )?;
        for s in &self.states {
            let [low, median, high] = s.reached_over_planned;
            writeln!(
                f,
                "{:12}{:10.0}%{:10.4} {:10}{:6.2}{:6.1}%   {low:.2} … {median:.2} … {high:.2}",
                s.name,
                100.0 * s.observable,
                s.sigma,
                s.unit,
                s.nees,
                100.0 * s.beyond_3_sigma
            )?;
        }
        Ok(())
    }
}
