//! What following the guidance is worth: the same fixed wing flown as the guidance says, and at random.
//!
//! Each flight stands, takes off and climbs; then a simulated pilot flies one maneuver after the other until the sigmas of
//! columns x and z of G have come below their target. The guided pilot flies what the engine asks for at that moment, the
//! other one draws from the same catalogue, with random strength, length and side. The vehicle is the simulator's, with its own
//! dynamics, in wind and gusts; the sigmas are those of the engine's filter.

use gaware::engine::{Engine, EngineOptions};
use gaware::parallel::{Progress, map_runs};
use gaware_mission::airframe::{Airframe, SMALL_FIXED_WING};
use gaware_mission::kinematics::WingCommand;
use gaware_mission::maneuver::Maneuver;
use gaware_nav::effects::unit;
use gaware_nav::model::Model;
use gaware_nav::sample::Sample;
use gaware_sitl::noise::{Noise, Purpose};
use gaware_sitl::scenario::scenario;
use gaware_sitl::sensors::{Flight, SensorConfig, draw_vehicle};
use gaware_sitl::truth::{Trajectory, Truth};
use gaware_sitl::vehicle::{Stick, Vehicle, VehicleConfig};
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Columns x and z: a coordinated fixed wing excites no others.
const WANTED: [&str; 6] = ["g11", "g21", "g31", "g13", "g23", "g33"];
/// Sigma at which a state counts as known, deg/h/g.
const TARGET_DEG_PER_H_PER_G: f64 = 40.0;
/// At rest before the take-off, s.
const STANDING_S: f64 = 10.0;
/// The climb ends and the maneuvers begin at this height above the start, m.
const SAFE_HEIGHT_M: f64 = 60.0;
/// Below this height a maneuver is broken off for a climb, above the other for a descent, m.
const BAND_M: (f64, f64) = (40.0, 400.0);
/// Climb angle of take-off and recovery, rad.
const CLIMB_RAD: f64 = 0.2;
/// A flight that has not come to its end by then counts as this long, s.
const LONGEST_S: f64 = 1500.0;
/// Limits of the random strength (share of the full deflection) and of the random length (share of the usual time).
const STRENGTH: (f64, f64) = (0.25, 1.0);
const LENGTH: (f64, f64) = (0.5, 1.5);

/// How a flight is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Policy {
    Guided,
    Random,
}

/// One pair of flights of the same drawn vehicle.
#[derive(Debug, Clone, Serialize)]
pub struct Pair {
    /// Seed of vehicle, wind, noise and choice.
    pub seed: u64,
    /// Time from the start of the flight, standstill included, until columns x and z are known, s.
    pub guided_s: f64,
    /// The same with random maneuvers.
    pub random_s: f64,
    /// What the guided pilot flew.
    pub guided_maneuvers: Vec<String>,
}

/// All flights.
#[derive(Debug, Clone, Serialize)]
pub struct GuidanceStudy {
    /// `gaware.study/1`.
    pub schema: &'static str,
    /// What flies.
    pub airframe: String,
    /// Sigma to be reached on columns x and z, deg/h/g.
    pub target_deg_per_h_per_g: f64,
    /// Pairs of flights.
    pub runs: usize,
    /// Median time of the guided flights from a standstill, s.
    pub guided_median_s: f64,
    /// 95 % interval of that median, s.
    pub guided_interval_95_s: [f64; 2],
    /// Median time of the random flights, s.
    pub random_median_s: f64,
    /// Guided over random.
    pub ratio_of_medians: f64,
    /// Medians counted from the first maneuver instead: without standstill, take-off and climb, s.
    pub from_first_maneuver_s: [f64; 2],
    /// Share of pairs in which the guided flight was the faster one.
    pub guided_faster: f64,
    /// Flights that did not get there in time: guided, random.
    pub unfinished: [usize; 2],
    /// Every pair.
    pub pairs: Vec<Pair>,
}

/// Why the study cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum GuidanceError {
    /// No flights.
    #[error("a study needs at least one run")]
    NoRuns,
    /// Something that is built in is missing.
    #[error("this build lacks {0}")]
    Missing(&'static str),
}

/// Flies `runs` pairs with the seeds `seed …`.
///
/// # Errors
/// Without runs.
pub fn run(runs: usize, seed: u64, progress: &dyn Progress) -> Result<GuidanceStudy, GuidanceError> {
    if runs == 0 {
        return Err(GuidanceError::NoRuns);
    }
    let airframe =
        Airframe::from_toml(SMALL_FIXED_WING).map_err(|_| GuidanceError::Missing("the airframe"))?;
    // Coordinated, as the paper's flights are.
    let airframe = airframe.with_side_force(0.0, 0.0);
    let scenario = scenario("fixed_wing_coordinated").ok_or(GuidanceError::Missing("the scenario"))?;
    // Without tolerances: with them a coordinated flight needs more than LONGEST_S for column z, whoever chooses its maneuvers.
    let mut belief = Model::calibrated();
    belief.imu = scenario.model.imu.clone();
    (belief.imu.gyro_bias, belief.imu.accel_bias) = ([0.0; 3], [0.0; 3]);
    let setting = Setting { airframe, belief, sensors: scenario.sensors.clone() };
    let flights = map_runs(2 * runs, progress, |k| {
        let policy = if k % 2 == 0 { Policy::Guided } else { Policy::Random };
        setting.fly(policy, seed.wrapping_add(k as u64 / 2))
    });
    let of = |policy: usize| flights.iter().skip(policy).step_by(2);
    let medians = [0, 1].map(|p| median(of(p).map(|f| f.known_s).collect()));
    let from_first = [0, 1].map(|p| median(of(p).map(|f| f.known_s - f.begun_s).collect()));
    let pairs: Vec<Pair> = of(0)
        .zip(of(1))
        .enumerate()
        .map(|(k, (guided, random))| Pair {
            seed: seed.wrapping_add(k as u64),
            guided_s: guided.known_s,
            random_s: random.known_s,
            guided_maneuvers: guided.flown.clone(),
        })
        .collect();
    Ok(GuidanceStudy {
        schema: "gaware.study/1",
        airframe: setting.airframe.name.clone(),
        target_deg_per_h_per_g: TARGET_DEG_PER_H_PER_G,
        runs,
        guided_median_s: medians[0],
        guided_interval_95_s: median_interval_95(of(0).map(|f| f.known_s).collect()),
        random_median_s: medians[1],
        ratio_of_medians: medians[0] / medians[1],
        from_first_maneuver_s: from_first,
        guided_faster: pairs.iter().filter(|p| p.guided_s < p.random_s).count() as f64 / runs as f64,
        unfinished: [0, 1].map(|p| of(p).filter(|f| f.known_s >= LONGEST_S).count()),
        pairs,
    })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 { 0.0 } else { 0.5 * (values[(n - 1) / 2] + values[n / 2]) }
}

/// 95 % interval of a median: order statistics by the normal approximation of the binomial (Conover 1999, section 3.2).
fn median_interval_95(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let n = values.len() as f64;
    let half = 1.96 * n.sqrt();
    let rank =
        |r: f64| values.get((r.clamp(1.0, n.max(1.0)) as usize).saturating_sub(1)).copied().unwrap_or(0.0);
    [rank(((n - half) / 2.0).floor()), rank(((n + half) / 2.0 + 1.0).ceil())]
}

/// What all flights have in common.
struct Setting {
    airframe: Airframe,
    belief: Model,
    sensors: SensorConfig,
}

/// One flight.
struct Flown {
    begun_s: f64,
    known_s: f64,
    flown: Vec<String>,
}

impl Setting {
    fn fly(&self, policy: Policy, seed: u64) -> Flown {
        let truth = draw_vehicle(&self.belief, seed);
        let vehicle = Shared(Arc::new(Mutex::new(Vehicle::new(self.vehicle(seed)))));
        let flight = Flight::new(Box::new(vehicle.clone()), &truth, self.sensors.clone(), seed);
        let options = match policy {
            Policy::Guided => EngineOptions::for_airframe(self.airframe.clone(), false),
            Policy::Random => EngineOptions::default(),
        };
        let mut engine = Engine::new(self.belief.clone(), options);
        let mut pilot = Pilot::new(self, policy, seed);
        for (sample, truth) in flight {
            engine.feed(&sample);
            let Sample::Imu(imu) = sample else { continue };
            vehicle.with(|v| v.steer(Some(pilot.stick(&truth, &engine))));
            if imu.t_s >= LONGEST_S || pilot.begun_s.is_some() && is_known(&engine) {
                break;
            }
        }
        let known_s = pilot.now_s;
        Flown { begun_s: pilot.begun_s.unwrap_or(known_s), known_s, flown: pilot.flown }
    }

    fn vehicle(&self, seed: u64) -> VehicleConfig {
        let a = &self.airframe;
        VehicleConfig {
            cruise_m_per_s: a.speed_cruise_m_per_s,
            min_m_per_s: a.speed_min_m_per_s,
            max_m_per_s: a.speed_max_m_per_s,
            max_bank_rad: a.bank_max_deg.to_radians(),
            climb_m_per_s: a.climb_max_m_per_s,
            sink_m_per_s: a.descent_max_m_per_s,
            accel_m_per_s2: a.acceleration_m_per_s2,
            wind_n_e_m_per_s: [3.0, -2.0],
            gust_m_per_s: 0.3,
            seed,
            ..VehicleConfig::fixed_wing()
        }
    }
}

/// Whether columns x and z are known.
fn is_known(engine: &Engine) -> bool {
    engine.filter().is_some_and(|filter| {
        WANTED.iter().all(|name| {
            filter.layout().find(name).is_some_and(|state| {
                filter.covariance().sigma(state) <= TARGET_DEG_PER_H_PER_G * unit::DEG_PER_H_PER_G.si
            })
        })
    })
}

/// The vehicle, flown by the pilot and watched by the sensors.
#[derive(Clone)]
struct Shared(Arc<Mutex<Vehicle>>);

impl Shared {
    fn with<T>(&self, job: impl FnOnce(&mut Vehicle) -> T) -> T {
        job(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Trajectory for Shared {
    fn duration_s(&self) -> f64 {
        f64::INFINITY
    }

    fn truth_at(&mut self, t_s: f64) -> Truth {
        self.with(|v| v.truth_at(t_s))
    }
}

/// A maneuver being flown.
struct Under {
    maneuver: Maneuver,
    since_s: f64,
    /// Share of the full deflection, and of the usual time.
    strength: f64,
    length: f64,
}

/// Who holds the stick.
struct Pilot<'a> {
    airframe: &'a Airframe,
    policy: Policy,
    dice: Noise,
    ground_m: Option<f64>,
    now_s: f64,
    begun_s: Option<f64>,
    under: Option<Under>,
    /// Asked for, to be flown after it.
    next: VecDeque<Maneuver>,
    flown: Vec<String>,
}

impl<'a> Pilot<'a> {
    fn new(setting: &'a Setting, policy: Policy, seed: u64) -> Self {
        Self {
            airframe: &setting.airframe,
            policy,
            dice: Noise::new(seed, Purpose::Choice),
            ground_m: None,
            now_s: 0.0,
            begun_s: None,
            under: None,
            next: VecDeque::new(),
            flown: Vec::new(),
        }
    }

    /// What the hands do now.
    fn stick(&mut self, truth: &Truth, engine: &Engine) -> Stick {
        self.now_s = truth.t_s;
        let height = truth.place.height_m - *self.ground_m.get_or_insert(truth.place.height_m);
        let cruise = self.airframe.speed_cruise_m_per_s;
        let level = Stick { bank_rad: 0.0, climb_rad: 0.0, airspeed_m_per_s: cruise };
        if truth.t_s < STANDING_S {
            return Stick { airspeed_m_per_s: 0.0, ..level };
        }
        if self.begun_s.is_none() {
            if height < SAFE_HEIGHT_M {
                let flies = truth.v_n.norm() > self.airframe.speed_min_m_per_s;
                return Stick { climb_rad: if flies { CLIMB_RAD } else { 0.0 }, ..level };
            }
            self.begun_s = Some(truth.t_s);
        }
        let back = match height {
            h if h < BAND_M.0 => Some(CLIMB_RAD),
            h if h > BAND_M.1 => Some(-CLIMB_RAD),
            _ => None,
        };
        if let Some(climb_rad) = back {
            self.under = None;
            return Stick { climb_rad, ..level };
        }
        self.choose(engine).map_or(level, |command| Stick {
            bank_rad: command.bank_rad,
            climb_rad: command.climb_rad,
            airspeed_m_per_s: command.airspeed_m_per_s,
        })
    }

    /// The command of the maneuver under way, or of the next one.
    fn choose(&mut self, engine: &Engine) -> Option<WingCommand> {
        let over = self
            .under
            .as_ref()
            .is_none_or(|u| self.now_s - u.since_s >= u.length * u.maneuver.duration_s(self.airframe));
        if over {
            self.under = match self.policy {
                Policy::Guided => {
                    if self.next.is_empty() {
                        self.next.extend(engine.proposed());
                    }
                    self.next.pop_front().map(|maneuver| (maneuver, 1.0, 1.0))
                }
                Policy::Random => {
                    let all = Maneuver::automatic(self.airframe);
                    let at = (self.dice.uniform() * all.len() as f64) as usize;
                    let mut between = |(low, high): (f64, f64)| low + (high - low) * self.dice.uniform();
                    let (strength, length) = (between(STRENGTH), between(LENGTH));
                    all.get(at).map(|maneuver| (*maneuver, strength, length))
                }
            }
            .map(|(maneuver, strength, length)| Under {
                maneuver,
                since_s: self.now_s,
                strength,
                length,
            });
            if let Some(under) = &self.under {
                self.flown.push(under.maneuver.words(self.airframe).short.to_owned());
            }
        }
        let under = self.under.as_ref()?;
        let within = (self.now_s - under.since_s) / under.length;
        let full = under.maneuver.wing_command(self.airframe, within);
        let cruise = self.airframe.speed_cruise_m_per_s;
        Some(WingCommand {
            airspeed_m_per_s: cruise + under.strength * (full.airspeed_m_per_s - cruise),
            bank_rad: under.strength * full.bank_rad,
            climb_rad: under.strength * full.climb_rad,
            sideslip_rad: 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaware::parallel::Silent;

    #[test]
    fn the_guided_flight_is_the_faster_one() {
        // A guide who does not know the ground asks this one for descents at the floor for ever.
        let study = run(1, 4, &Silent).unwrap();
        assert_eq!(study.unfinished[0], 0, "{study:?}");
        // The random flight may well not get there at all.
        assert!(study.ratio_of_medians < 0.6, "{study:?}");
        assert!(!study.pairs[0].guided_maneuvers.is_empty());
    }

    #[test]
    fn the_interval_of_a_median_is_the_textbooks() {
        // Of 50 values the 18th and the 33rd.
        let values: Vec<f64> = (1..=50).rev().map(f64::from).collect();
        assert_eq!(median_interval_95(values), [18.0, 33.0]);
        assert_eq!(median_interval_95(vec![3.0]), [3.0, 3.0]);
    }

    #[test]
    fn no_runs_are_refused() {
        assert!(run(0, 1, &Silent).is_err());
    }
}
