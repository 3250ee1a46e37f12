//! One flight with one fault in its middle, looked at once a second.

use super::registry::{Case, Cause};
use super::spoiler::{Spoil, Spoiler};
use super::station::{Station, TURN_S};
use gaware::engine::snapshot::Phase;
use gaware::sinks::events::cause_of;
use gaware::sinks::status::LinkState;
use gaware_nav::consistency::{error, nees};
use gaware_nav::filter::Filter;
use gaware_nav::filter::calibration::Calibration;
use gaware_nav::filter::layout::index;
use gaware_nav::mechanization::NavState;
use gaware_nav::model::Model;
use gaware_nav::sample::Quantisation;
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig, Flavour};
use gaware_sitl::faults::LinkFaults;
use gaware_sitl::scenario::{Airframe, Scenario};
use gaware_sitl::sensors::{SensorConfig, draw_vehicle};
use gaware_sitl::trajectory::bench::Bench;
use gaware_sitl::trajectory::fixed_wing::FixedWing;
use gaware_sitl::trajectory::multirotor::Multirotor;
use gaware_sitl::trajectory::{Flown, Scripted};
use gaware_sitl::truth::{Trajectory, Truth};
use std::collections::BTreeSet;

/// On the ground before the take-off, s: rates are asked for and the source is chosen.
const GROUND_S: f64 = 25.0;
/// Vehicles are at rest until here, s.
const AT_REST_S: f64 = 5.0;
/// Main loop of the simulated autopilots, Hz: slow, so that a campaign is quick.
const LOOP_HZ: f64 = 100.0;
/// Looks per second.
const LOOK_S: f64 = 1.0;
/// A position counts as right within 3 sigma and this, m, …
const RIGHT_M: f64 = 5.0;
/// … with a sigma below this, m.
const RIGHT_SIGMA_M: f64 = 10.0;

/// What flies: a wing with ArduPilot and `RAW_IMU`, or a multirotor with PX4 and `SCALED_IMU`.
#[derive(Debug, Clone)]
pub(super) struct Kind {
    pub(super) airframe: Airframe,
    pub(super) flavour: Flavour,
    /// The true path.
    pub(super) path: Flown,
}

/// Both kinds of vehicles.
pub(super) fn kinds() -> [Kind; 2] {
    const STEP_S: f64 = 0.02;
    [
        Kind {
            airframe: Airframe::FixedWing,
            flavour: Flavour::ArduPilot,
            path: Flown::with_step(FixedWing::new(true).paused(AT_REST_S, GROUND_S), STEP_S),
        },
        Kind {
            airframe: Airframe::Multirotor,
            flavour: Flavour::Px4,
            path: Flown::with_step(Multirotor::new().paused(AT_REST_S, GROUND_S), STEP_S),
        },
    ]
}

/// What the companion assumes: the noise of these sensors, nothing of their constants.
pub(super) fn assumed(base: &Scenario) -> Model {
    let mut model = Model::standard();
    model.imu = base.model.imu.clone();
    (model.imu.gyro_bias, model.imu.accel_bias) = ([0.0; 3], [0.0; 3]);
    model.gnss = base.model.gnss.clone();
    model
}

/// The simulated autopilot of this vehicle on this path.
pub(super) fn autopilot(
    kind: &Kind,
    path: Flown,
    case: &Case,
    sensors: &SensorConfig,
    vehicle: &Model,
    seed: u64,
) -> Autopilot {
    let config = AutopilotConfig {
        flavour: kind.flavour,
        airframe: kind.airframe,
        loop_rate_hz: LOOP_HZ,
        has_highres_imu: case.highres,
        has_sim_state: false,
        late_stamps: false,
        wait_for_station: false,
        faults: if let Cause::Vehicle(fault) = case.cause { vec![fault] } else { Vec::new() },
        seed,
        ..AutopilotConfig::default()
    };
    // The message rounds.
    let sensors = SensorConfig {
        quantisation: Quantisation::None,
        attitude_sigma_rad: [0.05, 0.05, 0.14],
        ..sensors.clone()
    };
    Autopilot::new(config, Box::new(path), vehicle, sensors)
}

/// One look.
#[derive(Debug, Clone, Default)]
pub(super) struct Look {
    /// s after power-on.
    pub(super) t_s: f64,
    /// Normalised squared error per degree of freedom, of all states and of the sensors' constants; nothing where no filter runs.
    pub(super) nees: Option<[f64; 2]>,
    /// Whether link, phase and position are as they should be.
    pub(super) right: bool,
    /// Sentences on the screens.
    pub(super) sentences: Vec<String>,
}

/// Errors and sigmas of a filter.
#[derive(Debug, Clone)]
pub(super) struct Judged {
    /// As in [`Look::nees`].
    pub(super) nees: [f64; 2],
    pub(super) position_is_right: bool,
    /// The constants whose errors are largest, with error over sigma.
    pub(super) largest: Vec<(&'static str, f64)>,
}

/// Constants that are named.
const LARGEST: usize = 4;

fn largest(filter: &Filter, e: &[f64]) -> Vec<(&'static str, f64)> {
    let names = filter.layout().names().iter().enumerate();
    let mut all: Vec<(&'static str, f64)> = names
        .filter_map(|(i, state)| {
            let at = index::GYRO_BIAS + i;
            Some((state.name, e.get(at)? / filter.covariance().sigma(at)))
        })
        .collect();
    all.sort_by(|(_, a), (_, b)| b.abs().total_cmp(&a.abs()));
    all.truncate(LARGEST);
    all
}

/// Compares a filter with the truth at its own time.
pub(super) fn judge(filter: &Filter, truth: &Truth, sensors: &Calibration) -> Judged {
    let nav = NavState::from_ned(truth.place, &truth.v_n, &truth.c_nb);
    let e = error(filter, &nav, sensors);
    let end = index::GYRO_BIAS + filter.layout().names().len();
    let per_dof = |from: usize| {
        let states: Vec<usize> = (from..end).collect();
        nees(filter, &e, &states).unwrap_or(f64::INFINITY) / states.len() as f64
    };
    let sigma_m = filter.ned_sigmas()[0].norm();
    let off_m = (truth.place.to_ecef() - filter.nav().r_e).norm();
    Judged {
        nees: [per_dof(0), per_dof(index::GYRO_BIAS)],
        largest: largest(filter, &e),
        position_is_right: off_m < RIGHT_M + 3.0 * sigma_m && sigma_m < RIGHT_SIGMA_M,
    }
}

/// What was lost since power-on.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct Lost {
    /// Frames that were sent and not received as they were.
    pub frames: f64,
    /// Inertial samples refused or missing.
    pub samples: f64,
    /// Time without inertial samples, s.
    pub gaps_s: f64,
    /// Fixes received and not used.
    pub fixes: f64,
    /// Fresh starts of the time line.
    pub restarts: f64,
}

impl Lost {
    fn of(station: &Station) -> Self {
        let snapshot = station.pipeline().summary();
        let (sent, received) = station.frames();
        let stats = station.pipeline().converter().stats();
        let time = stats.time;
        Self {
            frames: sent.saturating_sub(received) as f64,
            samples: snapshot.imu.dropped as f64,
            gaps_s: snapshot.imu.gaps.seconds,
            fixes: (snapshot.gnss.rejected + time.fix_misplaced + time.fix_backward) as f64,
            restarts: time.restarts as f64,
        }
    }

    /// What was lost since an earlier count.
    pub(super) fn since(&self, earlier: &Self) -> Self {
        Self {
            frames: (self.frames - earlier.frames).max(0.0),
            samples: (self.samples - earlier.samples).max(0.0),
            gaps_s: (self.gaps_s - earlier.gaps_s).max(0.0),
            fixes: (self.fixes - earlier.fixes).max(0.0),
            restarts: (self.restarts - earlier.restarts).max(0.0),
        }
    }
}

/// What one flight leaves behind.
#[derive(Debug, Clone, Default)]
pub(super) struct Course {
    pub(super) looks: Vec<Look>,
    /// Sentences that were not there before the fault, with the time since its begin, s.
    pub(super) reported: Vec<(f64, String)>,
    pub(super) lost: Lost,
}

/// Flies it.
pub(super) fn fly(case: &Case, kind: &Kind, base: &Scenario, seed: u64) -> Course {
    let model = assumed(base);
    let vehicle = draw_vehicle(&model, seed);
    let sensors = Calibration::new(&vehicle);
    let mut path = kind.path.clone();
    let mut station = Station::new(model, seed, None);
    let (from_s, to_s) = case.span_s;
    let spoil = if let Cause::Messages(spoil) = case.cause { spoil } else { Spoil::None };
    station.connect(
        autopilot(kind, kind.path.clone(), case, &base.sensors, &vehicle, seed),
        Spoiler::new(spoil, from_s..to_s),
    );
    let mut flown = Course::default();
    let mut known = BTreeSet::new();
    let mut before = Lost::default();
    let (mut began, mut ended) = (false, false);
    let turns = (path.duration_s() / TURN_S) as usize;
    for turn in 0..turns {
        let t_s = turn as f64 * TURN_S;
        if !began && t_s >= from_s {
            began = true;
            before = Lost::of(&station);
            begin(&mut station, case, kind, base, seed);
        }
        if !ended && t_s >= to_s {
            ended = true;
            station.set_link_faults(&LinkFaults::default());
            station.part();
        }
        station.turn();
        if turn % (LOOK_S / TURN_S) as usize == 0 {
            let look = look(&mut station, &mut path, &sensors, t_s);
            for text in &look.sentences {
                if known.insert(cause_of(text)) && t_s >= from_s {
                    flown.reported.push((t_s - from_s, text.clone()));
                }
            }
            flown.looks.push(look);
        }
    }
    flown.lost = Lost::of(&station).since(&before);
    flown
}

fn begin(station: &mut Station, case: &Case, kind: &Kind, base: &Scenario, seed: u64) {
    match &case.cause {
        Cause::Link(faults) => station.set_link_faults(faults),
        Cause::SecondAutopilot => {
            // Stationary, and switched on just now.
            let other = draw_vehicle(&assumed(base), seed ^ 0x5EC0);
            let path = Flown::with_step(Bench::new(600.0), 0.1);
            station.join(autopilot(kind, path, case, &base.sensors, &other, seed ^ 0x5EC0));
        }
        Cause::Vehicle(_) | Cause::Messages(_) => {}
    }
}

/// What the screens show now, and how true it is.
fn look(station: &mut Station, path: &mut Flown, sensors: &Calibration, t_s: f64) -> Look {
    let (_, shown) = station.show();
    let judged = judged(station, path, sensors).filter(|_| shown.phase == Phase::Running);
    Look {
        t_s,
        nees: judged.as_ref().map(|j| j.nees),
        right: shown.link == LinkState::Up && judged.is_some_and(|j| j.position_is_right),
        sentences: shown.sentences,
    }
}

/// The running filter against the truth.
pub(super) fn judged(station: &Station, path: &mut Flown, sensors: &Calibration) -> Option<Judged> {
    let filter = station.pipeline().engine().filter()?;
    let sim_s = station.sim_time_of(filter.t_s())?;
    Some(judge(filter, &path.truth_at(sim_s), sensors))
}

/// A look at this time.
pub(super) fn at(looks: &[Look], t_s: f64) -> Option<&Look> {
    looks.iter().find(|l| l.t_s >= t_s)
}
