//! A vehicle that flies missions: kinematics of a fixed wing or a multirotor, wind, and a pilot that follows the
//! uploaded items.
//!
//! The states are integrated (Runge-Kutta, 2 ms) and everything else follows from them and their derivatives, so the truth is
//! as consistent as that of the analytic flights. There is no aerodynamics beyond the balance of forces.

mod pilot;
mod rotor;
mod slip;
mod wind;
mod wing;

pub use pilot::{Mode, PilotEvent};

use crate::scenario::Airframe;
use crate::truth::{Motion, Trajectory, Truth};
use gaware_nav::earth::Geodetic;
use mavlink::dialects::ardupilotmega::MISSION_ITEM_INT_DATA;
use nalgebra::Vector3;
use pilot::{Pilot, Sight};
use slip::Slip;
use std::collections::VecDeque;
use wind::Wind;

/// What the vehicle can do and where it stands.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleConfig {
    /// What it is.
    pub airframe: Airframe,
    /// Where it stands at the start: home.
    pub start: Geodetic,
    /// Where its nose points, rad.
    pub heading_rad: f64,
    /// Speed when no one says otherwise, m/s: through the air for a wing, over ground for a multirotor.
    pub cruise_m_per_s: f64,
    /// Slowest flight of a wing, m/s.
    pub min_m_per_s: f64,
    /// Fastest flight, m/s.
    pub max_m_per_s: f64,
    /// Largest bank of a wing, rad.
    pub max_bank_rad: f64,
    /// Fastest climb, m/s.
    pub climb_m_per_s: f64,
    /// Fastest descent, m/s.
    pub sink_m_per_s: f64,
    /// Largest change of speed, m/s².
    pub accel_m_per_s2: f64,
    /// Largest change of the acceleration that a multirotor's pilot asks for, m/s³; 0: not limited.
    pub jerk_m_per_s3: f64,
    /// Mean side force of a wing in a level turn with 45° of bank, g, to the outside; every seed has its own. 0: coordinated.
    pub side_force_g: f64,
    /// Mean side force of a wing that rolls at 90 deg/s at cruise speed, g.
    pub roll_side_force_g: f64,
    /// Radius of a circle whose item gives none, m.
    pub loiter_radius_m: f64,
    /// Mean wind blowing toward north and east, m/s.
    pub wind_n_e_m_per_s: [f64; 2],
    /// Gusts, RMS per axis, m/s.
    pub gust_m_per_s: f64,
    /// Height of the geoid above the ellipsoid, m, for altitudes above sea level.
    pub geoid_height_m: f64,
    /// Sequence number of the first real item: 1 where 0 is home (ArduPilot), else 0.
    pub first_item: usize,
    /// Whether a wing has the power to climb while it circles.
    pub climbs_in_circles: bool,
    /// The item of the mission at which it returns instead.
    pub returns_at: Option<usize>,
    /// Seed of the gusts.
    pub seed: u64,
}

impl VehicleConfig {
    /// A small aircraft, 14 to 30 m/s.
    pub fn fixed_wing() -> Self {
        Self {
            airframe: Airframe::FixedWing,
            start: Geodetic::from_degrees(47.397_7, 8.545_6, 488.0),
            heading_rad: 60f64.to_radians(),
            cruise_m_per_s: 22.0,
            min_m_per_s: 14.0,
            max_m_per_s: 30.0,
            max_bank_rad: 55f64.to_radians(),
            climb_m_per_s: 4.0,
            sink_m_per_s: 4.0,
            accel_m_per_s2: 3.0,
            jerk_m_per_s3: 0.0,
            side_force_g: 0.0,
            roll_side_force_g: 0.0,
            loiter_radius_m: 70.0,
            wind_n_e_m_per_s: [0.0; 2],
            gust_m_per_s: 0.0,
            geoid_height_m: 47.0,
            first_item: 1,
            climbs_in_circles: true,
            returns_at: None,
            seed: 1,
        }
    }

    /// A quadrotor, up to 15 m/s.
    pub fn multirotor() -> Self {
        Self {
            airframe: Airframe::Multirotor,
            cruise_m_per_s: 8.0,
            min_m_per_s: 0.0,
            max_m_per_s: 15.0,
            climb_m_per_s: 3.0,
            sink_m_per_s: 2.0,
            accel_m_per_s2: 4.0,
            loiter_radius_m: 10.0,
            ..Self::fixed_wing()
        }
    }
}

/// A hand on the stick of a wing: what it wants instead of the pilot on board, within the limits of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stick {
    /// Bank, rad, right positive.
    pub bank_rad: f64,
    /// Climb angle, rad.
    pub climb_rad: f64,
    /// Airspeed, m/s; below [`VehicleConfig::min_m_per_s`] it only taxies.
    pub airspeed_m_per_s: f64,
}

impl Stick {
    fn control(&self, config: &VehicleConfig, otherwise: Control) -> Control {
        let bank = config.max_bank_rad;
        Control {
            bank: self.bank_rad.clamp(-bank, bank),
            climb: self.climb_rad,
            speed: self.airspeed_m_per_s.clamp(0.0, config.max_m_per_s),
            ..otherwise
        }
    }
}

/// Length of the state vector; a wing leaves the rest zero.
const STATES: usize = 14;
type State = [f64; STATES];

/// What the pilot wants.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Control {
    /// Wing: bank, rad.
    bank: f64,
    /// Wing: climb angle, rad.
    climb: f64,
    /// Wing: airspeed, m/s.
    speed: f64,
    /// Multirotor: acceleration north, east, down, m/s².
    accel: Vector3<f64>,
    /// Multirotor: heading, rad.
    yaw: f64,
}

/// Integration step, s.
const STEP_S: f64 = 2e-3;
/// The pilot decides once in so many steps (20 ms).
const STEPS_PER_DECISION: u64 = 10;
/// Past that can be asked for, s.
const MEMORY_S: f64 = 3.0;

/// The vehicle.
#[derive(Debug, Clone)]
pub struct Vehicle {
    config: VehicleConfig,
    wind: Wind,
    slip: Slip,
    pilot: Pilot,
    stick: Option<Stick>,
    steps: u64,
    state: State,
    control: Control,
    history: VecDeque<(f64, State, Control)>,
}

impl Vehicle {
    /// A vehicle that stands at its start, disarmed.
    pub fn new(config: VehicleConfig) -> Self {
        let mut state = [0.0; STATES];
        state[0] = config.start.lat_rad;
        state[1] = config.start.lon_rad;
        state[2] = config.start.height_m;
        match config.airframe {
            Airframe::FixedWing => state[wing::COURSE] = config.heading_rad,
            Airframe::Multirotor => state[rotor::YAW] = config.heading_rad,
        }
        let control =
            Control { bank: 0.0, climb: 0.0, speed: 0.0, accel: Vector3::zeros(), yaw: config.heading_rad };
        Self {
            wind: Wind::new(&config),
            slip: Slip::new(&config),
            pilot: Pilot::new(config.clone()),
            stick: None,
            steps: 0,
            state,
            control,
            history: VecDeque::new(),
            config,
        }
    }

    /// What it can do.
    pub fn config(&self) -> &VehicleConfig {
        &self.config
    }

    /// Whether the motors may run.
    pub fn is_armed(&self) -> bool {
        self.pilot.is_armed()
    }

    /// Arms or disarms; refused to disarm in flight.
    pub fn arm(&mut self, on: bool) -> bool {
        self.pilot.arm(on)
    }

    /// Mode.
    pub fn mode(&self) -> Mode {
        self.pilot.mode()
    }

    /// Changes the mode; `Auto` needs a mission.
    pub fn set_mode(&mut self, mode: Mode) -> bool {
        self.pilot.set_mode(mode)
    }

    /// Takes a wing out of the pilot's hands, or gives it back.
    pub fn steer(&mut self, stick: Option<Stick>) {
        self.stick = stick;
    }

    /// Velocity of the air at this truth, gusts included, north, east, down, m/s.
    pub fn air_velocity(&self, truth: &Truth) -> Vector3<f64> {
        self.wind.at(truth.t_s, truth.place.height_m, -truth.v_n.z).0
    }

    /// The sequence number being flown.
    pub fn current(&self) -> usize {
        self.pilot.current()
    }

    /// Goes on at another item; `false` when there is none.
    pub fn set_current(&mut self, seq: usize) -> bool {
        self.pilot.set_current(seq)
    }

    /// Puts the index where it is wanted, whether there is such an item or not.
    pub fn put_current(&mut self, seq: usize) {
        self.pilot.put_current(seq);
    }

    /// The items on board, by sequence number, changed in place.
    pub fn items_mut(&mut self) -> &mut Vec<MISSION_ITEM_INT_DATA> {
        &mut self.pilot.items
    }

    /// The items on board.
    pub fn items(&self) -> &[MISSION_ITEM_INT_DATA] {
        &self.pilot.items
    }

    /// Where it stands at the start.
    pub fn start(&self) -> Geodetic {
        self.config.start
    }

    /// Whether it has flown and stands again.
    pub fn has_landed(&self) -> bool {
        self.pilot.has_landed()
    }

    /// What happened since the last call.
    pub fn take_events(&mut self) -> Vec<PilotEvent> {
        self.pilot.take_events()
    }

    fn now_s(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    /// Derivative of the state.
    fn rates(&self, t: f64, x: &State, control: &Control) -> State {
        match self.config.airframe {
            Airframe::FixedWing => wing::rates(&self.config, &self.wind, &self.slip, t, x, control),
            Airframe::Multirotor => rotor::rates(x, control),
        }
    }

    fn motion(&self, t: f64, x: &State, control: &Control) -> Motion {
        match self.config.airframe {
            Airframe::FixedWing => wing::motion(&self.wind, t, x, control),
            Airframe::Multirotor => rotor::motion(&self.wind, t, x),
        }
    }

    fn integrated(&self, t: f64, x: &State, control: &Control, dt: f64) -> State {
        let moved = |rate: &State, by: f64| -> State { std::array::from_fn(|i| x[i] + rate[i] * by) };
        let k1 = self.rates(t, x, control);
        let k2 = self.rates(t + 0.5 * dt, &moved(&k1, 0.5 * dt), control);
        let k3 = self.rates(t + 0.5 * dt, &moved(&k2, 0.5 * dt), control);
        let k4 = self.rates(t + dt, &moved(&k3, dt), control);
        let mean: State = std::array::from_fn(|i| (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0);
        moved(&mean, dt)
    }

    fn step(&mut self) {
        let t = self.now_s();
        if self.steps.is_multiple_of(STEPS_PER_DECISION) {
            let motion = self.motion(t, &self.state, &self.control);
            let sight = Sight {
                t_s: t,
                place: place(&self.state),
                v_n: motion.v_n,
                airspeed: self.state[wing::SPEED],
                yaw: match self.config.airframe {
                    Airframe::FixedWing => self.state[wing::COURSE],
                    Airframe::Multirotor => self.state[rotor::YAW],
                },
            };
            let control = self.pilot.decide(&sight);
            self.control = match &self.stick {
                Some(stick) => stick.control(&self.config, control),
                None => control,
            };
        }
        self.history.push_back((t, self.state, self.control));
        while self.history.front().is_some_and(|(then, _, _)| *then < t - MEMORY_S) {
            self.history.pop_front();
        }
        self.state = self.integrated(t, &self.state, &self.control, STEP_S);
        self.steps += 1;
    }
}

impl Trajectory for Vehicle {
    fn duration_s(&self) -> f64 {
        f64::INFINITY
    }

    fn truth_at(&mut self, t_s: f64) -> Truth {
        // One step beyond, so that the instant lies inside a step whose control is decided.
        while self.now_s() <= t_s {
            self.step();
        }
        let after = self.history.partition_point(|(t, _, _)| *t <= t_s + 1e-9);
        let (t, x, control) = self.history[after.saturating_sub(1)];
        // Older than the memory: the oldest there is.
        let t_s = t_s.max(t);
        let rest = t_s - t;
        let x = if rest.abs() < 1e-9 { x } else { self.integrated(t, &x, &control, rest) };
        Truth::of(t_s, place(&x), &self.motion(t_s, &x, &control))
    }
}

fn place(x: &State) -> Geodetic {
    Geodetic { lat_rad: x[0], lon_rad: x[1], height_m: x[2] }
}

#[cfg(test)]
mod tests;
