//! What flights make observable, by each of the three views.
//!
//! The table needs no random numbers: the covariance is the information bound along the true trajectory, the conditions see
//! the true motion, so what it shows is a property of the flight and the sensors (the paper, section 3). Recorded flights go through
//! the engine instead.

use gaware::engine::observability::{ConditionWatch, observability};
use gaware::engine::snapshot::Observability;
use gaware::engine::{Engine, EngineOptions};
use gaware::parallel::{Progress, map_runs};
use gaware_nav::bound::InformationBound;
use gaware_nav::effects::unit;
use gaware_nav::filter::Initial;
use gaware_nav::mechanization::{Motion, NavState};
use gaware_nav::model::{GElements, Model};
use gaware_nav::observability::conditions::PathConditions;
use gaware_nav::observability::segments::{PathSegment, SegmentSample};
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::{FixVelocity, ImuStream, Sample, SampleKind};
use gaware_sitl::scenario::{Airframe, Scenario, scenario};
use gaware_sitl::sensors::SensorConfig;
use gaware_sitl::trajectory::Flown;
use gaware_sitl::trajectory::bench::Bench;
use gaware_sitl::trajectory::fixed_wing::FixedWing;
use gaware_sitl::truth::{Trajectory, Truth};
use serde::Serialize;

/// Shorter stretches get no line of their own, s.
const STRETCH_S: f64 = 5.0;
/// 1-sigma of the start: position m, velocity m/s, tilt and heading rad.
const START_SIGMA: (f64, f64, [f64; 3]) = (2.0, 0.5, [0.05, 0.05, 0.14]);
/// Prior of an element of G on the paper's sensors, three times its value there.
pub(super) const PAPER_G_SIGMA: f64 = 30.0 * unit::DEG_PER_H_PER_G.si;

/// What can go wrong.
#[derive(Debug, thiserror::Error)]
pub enum ObservabilityError {
    /// No such scenario.
    #[error("there is no scenario \"{0}\"; known: {known}", known = known())]
    UnknownScenario(String),
    /// Nothing to do.
    #[error("a study needs at least 2 runs")]
    TooFewRuns,
}

fn known() -> String {
    gaware_sitl::scenario::names().collect::<Vec<_>>().join(", ")
}

/// The knowledge at the end of a stretch of flight: turns, then a segment of constant attitude.
#[derive(Debug, Clone, Serialize)]
pub struct Stretch {
    /// From, s.
    pub from_s: f64,
    /// To, s.
    pub to_s: f64,
    /// Length of the segment of constant attitude that it ended with, s; 0 if with none.
    pub segment_s: f64,
    /// Conditions (a), (b), (c) met so far.
    pub conditions: [bool; 3],
    /// Directions of the whitened Gramian that are not unobservable, so far.
    pub rank: usize,
    /// Unobservable directions in words, so far.
    pub dark: Vec<String>,
}

/// One flight with one size of G.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Flight.
    pub flight: String,
    /// Estimated elements of G: 3 or 9.
    pub g_elements: usize,
    /// Length, s.
    pub duration_s: f64,
    /// Constant states in all.
    pub constants: usize,
    /// The three views at the end.
    pub views: Observability,
    /// Stretches, each up to the end of a segment of constant attitude.
    pub stretches: Vec<Stretch>,
}

/// The table.
#[derive(Debug, Clone, Serialize)]
pub struct Table {
    /// `gaware.observability/1`.
    pub schema: &'static str,
    /// One row per flight and size of G.
    pub rows: Vec<Row>,
}

/// A flight to look at: what flies, its sensors, its priors.
struct Flight {
    name: String,
    trajectory: Box<dyn Trajectory>,
    model: Model,
    sensors: SensorConfig,
    vehicle: VehicleKind,
    g_sigma: Option<f64>,
}

impl Flight {
    fn of(scenario: &Scenario) -> Self {
        Self {
            name: scenario.name.to_owned(),
            trajectory: scenario.trajectory(),
            model: scenario.model.clone(),
            sensors: scenario.sensors.clone(),
            vehicle: vehicle_of(scenario),
            g_sigma: (scenario.name == "paper").then_some(PAPER_G_SIGMA),
        }
    }

    fn with(self, name: &str, flown: Flown) -> Self {
        Self { name: name.to_owned(), trajectory: Box::new(flown), ..self }
    }
}

fn vehicle_of(scenario: &Scenario) -> VehicleKind {
    match scenario.airframe {
        Airframe::FixedWing => VehicleKind::FixedWing,
        Airframe::Multirotor => VehicleKind::Multirotor,
    }
}

pub(super) fn find(name: &str) -> Result<Scenario, ObservabilityError> {
    scenario(name).ok_or_else(|| ObservabilityError::UnknownScenario(name.to_owned()))
}

/// Stationary, straight and level, one steady turn, coordinated turns with speed changes, excitation with sideslip and the
/// paper's flight, each for 3 and 9 elements of G.
///
/// # Errors
/// A scenario is missing in this build.
pub fn table(progress: &dyn Progress) -> Result<Table, ObservabilityError> {
    let [coordinated, slipping, paper] =
        [find("fixed_wing_coordinated")?, find("fixed_wing")?, find("paper")?];
    let flights = |k: usize| match k {
        0 => Flight::of(&slipping).with("standing", Flown::new(Bench::new(60.0))),
        1 => Flight::of(&slipping).with("straight_and_level", Flown::new(FixedWing::straight(22.0, 60.0))),
        2 => {
            let turn = FixedWing::steady_turn(22.0, 45.0_f64.to_radians(), 60.0);
            Flight::of(&slipping).with("steady_turn", Flown::new(turn))
        }
        3 => Flight::of(&coordinated),
        4 => Flight::of(&slipping),
        _ => Flight::of(&paper),
    };
    let rows = map_runs(12, progress, |k| one_row(flights(k / 2), elements(k % 2)));
    Ok(Table { schema: "gaware.observability/1", rows })
}

/// One scenario for 3 and 9 elements of G.
///
/// # Errors
/// There is no such scenario.
pub fn of_scenario(name: &str, progress: &dyn Progress) -> Result<Table, ObservabilityError> {
    let scenario = find(name)?;
    let rows = map_runs(2, progress, |k| one_row(Flight::of(&scenario), elements(k)));
    Ok(Table { schema: "gaware.observability/1", rows })
}

fn elements(k: usize) -> GElements {
    if k == 0 { GElements::Diagonal } else { GElements::Full }
}

fn count(elements: GElements) -> usize {
    match elements {
        GElements::None => 0,
        GElements::Diagonal => 3,
        GElements::Full => 9,
    }
}

/// A recorded flight through the engine, for 3 and 9 elements of G. As in the paper the sensors have no tolerances: the views are about
/// what motion can show, and the conditions know of biases and G alone.
pub fn of_samples(name: &str, samples: &[Sample], progress: &dyn Progress) -> Table {
    let rows = map_runs(2, progress, |k| {
        let mut engine = Engine::new(Model::calibrated().with_g(elements(k), None), EngineOptions::default());
        let mut book = Book::default();
        for sample in samples {
            engine.feed(sample);
            if let Sample::Imu(imu) = sample
                && let Some(segment) = book.ended(imu.t_s, engine.segment())
            {
                book.note(imu.t_s, segment, &engine.snapshot().observability);
            }
        }
        let end = engine.snapshot();
        book.end(end.t_s, &end.observability);
        Row {
            flight: name.to_owned(),
            g_elements: count(elements(k)),
            duration_s: end.elapsed_s,
            constants: end.observability.gramian_states,
            views: end.observability,
            stretches: book.stretches,
        }
    });
    Table { schema: "gaware.observability/1", rows }
}

/// Stretches as they come.
#[derive(Default)]
struct Book {
    from_s: Option<f64>,
    open: Option<(f64, f64)>,
    stretches: Vec<Stretch>,
}

impl Book {
    /// Length of a segment worth a line that was under way until now and is no more.
    fn ended(&mut self, t_s: f64, open: Option<&PathSegment>) -> Option<f64> {
        self.from_s.get_or_insert(t_s);
        let now = open.map(|s| (s.start_s, s.duration_s()));
        let before = std::mem::replace(&mut self.open, now)?;
        let goes_on = now.is_some_and(|(start, _)| start == before.0);
        (!goes_on && before.1 >= STRETCH_S).then_some(before.1)
    }

    fn note(&mut self, to_s: f64, segment_s: f64, views: &Observability) {
        let c = &views.conditions;
        let from_s = self.from_s.replace(to_s).unwrap_or(to_s);
        self.stretches.push(Stretch {
            from_s,
            to_s,
            segment_s,
            conditions: [c.a.met, c.b.met, c.c.met],
            rank: views.gramian_rank,
            dark: views.unobservable_directions.iter().map(|d| d.text.clone()).collect(),
        });
    }

    fn end(&mut self, t_s: f64, views: &Observability) {
        let segment_s = self.open.map_or(0.0, |(_, duration)| duration);
        self.note(t_s, segment_s, views);
    }
}

/// The information bound and the conditions along the true flight.
fn one_row(mut flight: Flight, elements: GElements) -> Row {
    let model = flight.model.clone().with_g(elements, flight.g_sigma);
    let stream = ImuStream { quantisation: flight.sensors.quantisation, ..ImuStream::default() };
    let rounding = model.quantisation_of(&stream).variance();
    let rate = flight.sensors.imu_rate_hz;
    let extra = (rounding.0 / rate, rounding.1 / rate);
    let mut bound = InformationBound::new(&model, &start(&flight.trajectory.truth_at(0.0)));
    bound.set_stream(SampleKind::Point, extra);
    let targets = EngineOptions::default().targets;
    let noise = (model.imu.gyro_noise.powi(2) + extra.0).sqrt();
    let mut watch =
        ConditionWatch::of(targets, PathConditions::new(ConditionWatch::settings(noise, &targets)));
    let mut book = Book::default();
    let steps = (flight.trajectory.duration_s() * rate).round() as u64;
    let fix_every = (rate / flight.sensors.fix_rate_hz).round().max(1.0) as u64;
    let views = |watch: &ConditionWatch, bound: &InformationBound| {
        observability(watch, bound.filter(), &targets, flight.vehicle)
    };
    for k in 0..=steps {
        let truth = flight.trajectory.truth_at(k as f64 / rate);
        advance(&mut bound, &truth);
        if k % fix_every == 0 {
            bound.fix(velocity(&flight.sensors, &truth), None);
        }
        watch.push_motion(&SegmentSample {
            t_s: truth.t_s,
            dt_s: 1.0 / rate,
            rate: truth.rate_eb,
            rate_sigma: 0.0,
            force: truth.force,
        });
        if let Some(segment) = book.ended(truth.t_s, watch.segment()) {
            book.note(truth.t_s, segment, &views(&watch, &bound));
        }
    }
    let last = views(&watch, &bound);
    book.end(steps as f64 / rate, &last);
    Row {
        flight: flight.name.clone(),
        g_elements: count(elements),
        duration_s: steps as f64 / rate,
        constants: last.gramian_states,
        views: last,
        stretches: book.stretches,
    }
}

fn advance(bound: &mut InformationBound, truth: &Truth) {
    bound.advance(truth.t_s, &Motion { rate: truth.rate_ib, force: truth.force }, None);
    bound.set_nav(NavState::from_ned(truth.place, &truth.v_n, &truth.c_nb));
}

fn velocity(sensors: &SensorConfig, truth: &Truth) -> FixVelocity {
    if sensors.vertical_velocity {
        FixVelocity::Full(truth.v_n.into())
    } else {
        FixVelocity::Horizontal([truth.v_n.x, truth.v_n.y])
    }
}

fn start(truth: &Truth) -> Initial {
    Initial {
        t_s: truth.t_s,
        nav: NavState::from_ned(truth.place, &truth.v_n, &truth.c_nb),
        position_sigma_m: [START_SIGMA.0; 3],
        velocity_sigma_m_per_s: [START_SIGMA.1; 3],
        attitude_sigma_rad: START_SIGMA.2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware::engine::snapshot::Status;
    use gaware::parallel::Silent;

    fn row(name: &str, k: usize) -> Row {
        of_scenario(name, &Silent).unwrap().rows.remove(k)
    }

    #[test]
    fn the_papers_flight_makes_all_of_g_observable_step_by_step() {
        let paper = row("paper", 1);
        let c = &paper.views.conditions;
        assert!(c.a.met && c.b.met && c.c.met);
        assert_eq!(paper.views.gramian_rank, paper.constants);
        assert!(
            paper.views.states.iter().all(|s| s.status == Status::Observable),
            "{:?}",
            paper.views.states
        );
        // Rest and the varying acceleration are one attitude, the second one comes with the climb.
        assert_eq!(paper.stretches[0].conditions, [true, false, false]);
        assert!(paper.stretches.windows(2).all(|w| w[0].rank <= w[1].rank));
    }

    #[test]
    fn coordinated_flight_never_tells_column_y() {
        let flight = row("fixed_wing_coordinated", 1);
        for state in flight.views.states.iter().filter(|s| ["g12", "g22", "g32"].contains(&s.name.as_str())) {
            assert!(state.status <= Status::Weak, "{state:?}");
        }
        assert!(flight.views.unobservable_directions.iter().any(|d| d.text.contains("fly a sideslip")));
    }

    #[test]
    fn unknown_names_are_told_with_the_known_ones() {
        let error = of_scenario("nowhere", &Silent).unwrap_err().to_string();
        assert!(error.contains("nowhere") && error.contains("fixed_wing_gusts"), "{error}");
    }
}
