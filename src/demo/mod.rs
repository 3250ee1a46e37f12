//! The demonstration: a vehicle whose sensor errors are drawn by seed and not reported, a plan to find them, the verified upload, and
//! the flight, all in one process and one thread, without sockets and without a clock.
//!
//! [`ground`] is the session by hand before it; [`Prepared`] plans, [`flight::Flight`] flies turn by turn in virtual time, [`result`] compares with the ground truth.
//! The simulated pilot who arms and starts the mission belongs to the demonstration: the companion itself never does.

pub mod closed_loop;
pub mod flight;
pub mod ground;
pub mod result;
pub mod series;

use crate::sinks::status::RouteView;
use gaware_mission::airframe::Airframe;
use gaware_mission::fence::{Fence, FencePolygon, LocalFrame};
use gaware_mission::item::{Autopilot as Firmware, Home, LatLon, command};
use gaware_mission::kinematics::{Kinematics, STEP_S};
use gaware_mission::planner::{CLIMB_OUT_SHARE, Plan, PlanError, Request, climb_out, plan};
use gaware_mission::predictor::{BoundPredictor, NamedSigma, Predictor, Targets};
use gaware_mission::safety::Limits;
use gaware_nav::earth::{Geodetic, STANDARD_GRAVITY};
use gaware_nav::math::{asin, atan2, cos, hypot, sin, tan};
use gaware_nav::model::Model;
use gaware_sitl::autopilot::{Autopilot, AutopilotConfig, Flavour};
use gaware_sitl::scenario;
use gaware_sitl::vehicle::VehicleConfig;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

/// Home: latitude and longitude in deg, height above the ellipsoid and of the geoid in m.
const HOME: (f64, f64, f64, f64) = (47.397_7, 8.545_6, 488.0, 47.0);
/// Fixes of the simulated receiver.
const FIX_INTERVAL_S: f64 = 0.2;
/// Fence: half of the side of a square around home, m, for wings and rotors.
const HALF_SIDE_M: [f64; 2] = [900.0, 200.0];
/// Floor and ceiling above home, m, for wings and rotors.
const BAND_M: [[f64; 2]; 2] = [[40.0, 160.0], [15.0, 70.0]];
/// Time on the ground before a take-off, s.
const STANDING_S: f64 = flight::STAND_S + flight::BEFORE_TAKE_OFF_S;
/// Gusts, RMS per axis, m/s.
const GUST_M_PER_S: f64 = 0.3;

/// What is to be shown.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What flies.
    pub airframe: Airframe,
    /// Time from take-off to the hold at the end, s; without it as long as it takes to make known what can be.
    pub budget_s: Option<f64>,
    /// Lowest and highest height above home of planned and of proposed maneuvers, m.
    pub band_m: [f64; 2],
    /// Width of the planner's search.
    pub beam: usize,
    /// Mean wind toward north and east, m/s.
    pub wind_n_e_m_per_s: [f64; 2],
    /// What the companion assumes before the flight.
    pub belief: Model,
    /// What the vehicle's sensor errors are drawn from.
    pub drawn: Model,
}

impl Settings {
    /// Light wind, the model that `run` starts with.
    pub fn new(airframe: Airframe, budget_s: Option<f64>) -> Self {
        let band_m = BAND_M[usize::from(!airframe.is_fixed_wing())];
        let belief = Model::standard();
        Self {
            airframe,
            budget_s,
            band_m,
            beam: 3,
            wind_n_e_m_per_s: [-2.0, 1.5],
            drawn: belief.clone(),
            belief,
        }
    }

    fn home(&self) -> Home {
        let (lat, lon, height, geoid) = HOME;
        Home {
            lat_e7: (lat * 1e7).round() as i32,
            lon_e7: (lon * 1e7).round() as i32,
            alt_m: (height - geoid) as f32,
        }
    }

    /// The take-off is into the wind.
    fn heading_deg(&self) -> f64 {
        let [n, e] = self.wind_n_e_m_per_s;
        if hypot(n, e) < 0.1 { 60.0 } else { atan2(-e, -n).to_degrees().rem_euclid(360.0) }
    }

    /// What there is to plan.
    pub fn request(&self) -> Request {
        let rotor = usize::from(!self.airframe.is_fixed_wing());
        let home = self.home();
        let frame = LocalFrame::new(home.place());
        let half = HALF_SIDE_M[rotor];
        let corners = [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]]
            .map(|[n, e]| frame.to_place(Vector2::new(n * half, e * half)));
        let fence = Fence {
            polygons: vec![FencePolygon { inclusion: true, corners: corners.to_vec() }],
            circles: Vec::new(),
        };
        let [floor_m, ceiling_m] = self.band_m;
        let height = 0.5 * (floor_m + ceiling_m);
        let [n, e] = self.wind_n_e_m_per_s;
        let heading = self.heading_deg();
        Request {
            start: climb_out(&self.airframe, home, heading, height, &Vector3::new(n, e, 0.0)),
            airframe: self.airframe.clone(),
            home,
            take_off: true,
            landing: true,
            start_height_m: height,
            start_heading_deg: heading,
            limits: Limits { fence, floor_m, ceiling_m, wind_ned_m_per_s: [n, e, 0.0] },
            budget_s: self.budget_s.unwrap_or(self.airframe.maneuvers_max_s),
            within_reach_only: self.budget_s.is_none(),
            fix_interval_s: FIX_INTERVAL_S,
            beam: self.beam,
        }
    }

    /// The simulated vehicle with the limits of the airframe.
    fn vehicle(&self, seed: u64) -> VehicleConfig {
        let a = &self.airframe;
        let base = if a.is_fixed_wing() { VehicleConfig::fixed_wing() } else { VehicleConfig::multirotor() };
        let (lat, lon, height, geoid_height_m) = HOME;
        let bank = a.bank_max_deg.to_radians();
        VehicleConfig {
            start: Geodetic::from_degrees(lat, lon, height),
            heading_rad: self.heading_deg().to_radians(),
            cruise_m_per_s: a.speed_cruise_m_per_s,
            min_m_per_s: a.speed_min_m_per_s,
            max_m_per_s: a.speed_max_m_per_s,
            max_bank_rad: bank,
            climb_m_per_s: a.climb_max_m_per_s,
            sink_m_per_s: a.descent_max_m_per_s,
            accel_m_per_s2: a.acceleration_m_per_s2.min(STANDARD_GRAVITY * tan(bank)),
            jerk_m_per_s3: a.jerk_max_m_per_s3,
            side_force_g: a.side_force_g,
            roll_side_force_g: a.roll_side_force_g,
            loiter_radius_m: a.turn_radius_min_m,
            wind_n_e_m_per_s: self.wind_n_e_m_per_s,
            gust_m_per_s: GUST_M_PER_S,
            geoid_height_m,
            seed,
            ..base
        }
    }

    fn autopilot(&self, seed: u64) -> AutopilotConfig {
        AutopilotConfig {
            flavour: match self.airframe.autopilot {
                Firmware::ArduPilot => Flavour::ArduPilot,
                Firmware::Px4 => Flavour::Px4,
            },
            geoid_height_m: HOME.3,
            wait_for_station: false,
            seed,
            ..AutopilotConfig::default()
        }
    }
}

/// The information bound from the priors of a model, for a flight that begins at home.
pub fn predictor(belief: &Model, request: &Request) -> BoundPredictor {
    let start = Kinematics {
        t_s: 0.0,
        position_ned_m: Vector3::zeros(),
        velocity_ned_m_per_s: Vector3::zeros(),
        attitude: UnitQuaternion::from_euler_angles(0.0, 0.0, request.start_heading_deg.to_radians()),
        rate: Vector3::zeros(),
        force: Vector3::new(0.0, 0.0, -STANDARD_GRAVITY),
    };
    let frame = LocalFrame::new(request.home.place());
    let mut predictor = BoundPredictor::from_priors(belief, &start, frame, request.home, Targets::default());
    // The companion watches the stationary vehicle before it flies: that splits bias and G a little.
    let steps = (STANDING_S / STEP_S) as u32;
    let standing: Vec<Kinematics> =
        (0..=steps).map(|k| Kinematics { t_s: f64::from(k) * STEP_S, ..start }).collect();
    predictor.fly(&standing, FIX_INTERVAL_S);
    if request.take_off && request.airframe.is_fixed_wing() {
        predictor.fly(&take_off(request, &start), FIX_INTERVAL_S);
    }
    predictor
}

/// The take-off of a fixed wing: the run, then straight ahead in a steady climb. Its change of speed is the first thing that
/// separates tilt, accelerometer bias and latency.
fn take_off(request: &Request, standing: &Kinematics) -> Vec<Kinematics> {
    let a = &request.airframe;
    let (cruise, acceleration) = (a.speed_cruise_m_per_s, a.acceleration_m_per_s2);
    let run_s = cruise / acceleration;
    let climb = CLIMB_OUT_SHARE * a.climb_max_m_per_s;
    let seconds = run_s + request.start_height_m.max(0.0) / climb;
    let heading = request.start_heading_deg.to_radians();
    let course = Vector3::new(cos(heading), sin(heading), 0.0);
    let sample = |k: u32| {
        let t_s = f64::from(k) * STEP_S;
        let running = t_s < run_s;
        let speed = (acceleration * t_s).min(cruise);
        let up = if running { 0.0 } else { climb };
        let pitch = asin((up / cruise).min(1.0));
        let along = 0.5 * speed * t_s.min(run_s) + cruise * (t_s - run_s).max(0.0);
        let attitude = UnitQuaternion::from_euler_angles(0.0, pitch, heading);
        let accelerates = if running { course * acceleration } else { Vector3::zeros() };
        let gravity = Vector3::new(0.0, 0.0, STANDARD_GRAVITY);
        Kinematics {
            t_s,
            position_ned_m: course * along - Vector3::z() * (up * (t_s - run_s).max(0.0)),
            velocity_ned_m_per_s: course * speed - Vector3::z() * up,
            attitude,
            force: attitude.inverse() * (accelerates - gravity),
            ..*standing
        }
    };
    (0..=(seconds / STEP_S) as u32).map(sample).collect()
}

/// What the plan promises for the end of the flight.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Constant states.
    pub sigmas: Vec<NamedSigma>,
    /// Roll, pitch, yaw, deg.
    pub attitude_sigma_deg: [f64; 3],
}

/// A demonstration with its plan; the plan does not depend on the seed.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// What is to be shown.
    pub settings: Settings,
    /// The plan.
    pub plan: Plan,
    /// What it promises.
    pub prediction: Prediction,
}

impl Prepared {
    /// Plans.
    ///
    /// # Errors
    /// No safe plan for this airframe, budget and wind.
    pub fn new(settings: Settings) -> Result<Self, PlanError> {
        let request = settings.request();
        let plan = plan(&request, predictor(&settings.belief, &request))?;
        let mut flown = predictor(&settings.belief, &request);
        flown.fly(&plan.path, FIX_INTERVAL_S);
        let prediction = Prediction {
            sigmas: flown.all_sigmas(),
            attitude_sigma_deg: flown.attitude_sigma_rad().map(f64::to_degrees),
        };
        Ok(Self { settings, plan, prediction })
    }

    /// The vehicle of a seed with these sensor errors, at home.
    pub fn autopilot(&self, truth: &Model, seed: u64) -> Autopilot {
        let settings = &self.settings;
        Autopilot::flying(settings.autopilot(seed), settings.vehicle(seed), truth, Self::sensors())
    }

    /// Whether the mission itself ends in a landing.
    pub fn lands(&self) -> bool {
        self.plan.mission.items.last().is_some_and(|i| i.command == command::NAV_LAND)
    }

    /// What a map shows: home, the predicted path about once a second, the fence.
    pub fn route(&self) -> RouteView {
        let home = self.settings.home().place();
        let every = (1.0 / STEP_S).round().max(1.0) as usize;
        let at = |k: &Kinematics| self.plan.frame.to_place(k.position_ned_m.xy());
        let pair = |p: LatLon| [p.lat_deg, p.lon_deg];
        let fence = self.settings.request().limits.fence;
        RouteView {
            home: Some(pair(home)),
            path: self.plan.path.iter().step_by(every).map(|k| pair(at(k))).collect(),
            fence: fence.polygons.iter().map(|p| p.corners.iter().map(|c| pair(*c)).collect()).collect(),
        }
    }

    /// The sensors of the simulated vehicle.
    pub(super) fn sensors() -> gaware_sitl::sensors::SensorConfig {
        let sensors = scenario::scenario("mission_fixed_wing").map(|s| s.sensors).unwrap_or_default();
        gaware_sitl::sensors::SensorConfig { fix_rate_hz: 1.0 / FIX_INTERVAL_S, ..sensors }
    }
}
