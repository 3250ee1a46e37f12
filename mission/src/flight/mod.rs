//! Predicted flights of missions: a point-mass vehicle follows the items as an autopilot would, in wind.
//!
//! Waypoints are flown along the line from the one before; circles around their centre with the direction of their radius.
//! Autopilots differ in how early they turn; what that is worth is in the margins of [`crate::safety`].

mod rotor;
mod wing;

use crate::airframe::Airframe;
use crate::fence::LocalFrame;
use crate::item::{AltitudeReference, Autopilot, MissionItem, command};
use crate::kinematics::{Kinematics, STEP_S, fill_rates};
use crate::maneuver::{Entry, Side};
use gaware_nav::math::atan2;
use nalgebra::{Vector2, Vector3};

/// Longest time for one item, s: wind may keep the vehicle from ever arriving.
const ITEM_LIMIT_S: f64 = 600.0;
/// A circle "until commanded otherwise" is predicted for this many turns, a hover for this long, s.
const LAST_TURNS: f64 = 1.25;
const LAST_HOVER_S: f64 = 10.0;
/// A multirotor has landed below this height, m.
const TOUCHED_M: f64 = 0.5;
/// A height counts as reached within this, m.
const LEVEL_M: f64 = 2.0;

/// Why a flight cannot be predicted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FlightError {
    /// A command without a model.
    #[error("item {item}: {what} is not predicted")]
    NotPredicted {
        /// Item, from 1.
        item: usize,
        /// The command in words.
        what: String,
    },
    /// The vehicle does not arrive.
    #[error("item {item}: not reached within {ITEM_LIMIT_S} s; the wind may be too strong for it")]
    NotReached {
        /// Item, from 1.
        item: usize,
    },
    /// The time is over.
    #[error("item {item}: still under way when the time budget is used up")]
    OutOfTime {
        /// Item, from 1.
        item: usize,
    },
}

/// When a circle is over, counted from the arrival at it.
#[derive(Debug, Clone, Copy)]
enum Until {
    Turns(f64),
    Seconds(f64),
    /// The height is reached, as near as autopilots demand.
    Level(f64),
}

/// What an item asks of the vehicle.
#[derive(Debug, Clone, Copy)]
enum Task {
    Line {
        from: Vector2<f64>,
        to: Vector2<f64>,
        height: Option<f64>,
    },
    Circle {
        center: Vector2<f64>,
        radius: f64,
        side: Side,
        until: Until,
        height: Option<f64>,
    },
    Hover {
        at: Vector2<f64>,
        height: Option<f64>,
    },
    /// A multirotor stays at a waypoint for a time.
    Stay {
        at: Vector2<f64>,
        height: Option<f64>,
        seconds: f64,
    },
    /// Straight down onto this place.
    Touchdown {
        at: Vector2<f64>,
    },
    /// Straight down to the ground from this height at the begin of the line.
    Glide {
        from: Vector2<f64>,
        to: Vector2<f64>,
        height: f64,
    },
}

impl Task {
    /// Height that is wanted at this place, where the task wants one.
    fn height_at(&self, p: Vector2<f64>) -> Option<f64> {
        match self {
            Self::Line { height, .. }
            | Self::Circle { height, .. }
            | Self::Hover { height, .. }
            | Self::Stay { height, .. } => *height,
            Self::Touchdown { .. } => Some(0.0),
            Self::Glide { from, to, height } => {
                let line = to - from;
                let left = (to - p).dot(&line) / line.norm_squared().max(1.0);
                Some(height * left.clamp(0.0, 1.0))
            }
        }
    }
}

/// A vehicle that follows items; between calls it remembers where it is.
#[derive(Debug, Clone)]
pub struct Flyer<'a> {
    airframe: &'a Airframe,
    frame: LocalFrame,
    wind_ned: Vector3<f64>,
    /// Present state.
    pub state: Entry,
    speed: f64,
    yaw: Option<f64>,
    height: f64,
    last_point: Option<Vector2<f64>>,
    budget_s: f64,
}

/// A flight over some items.
#[derive(Debug, Clone, Default)]
pub struct Flight {
    /// Samples, times counted from the start of the flyer.
    pub samples: Vec<Kinematics>,
    /// For each item the time when it was begun, s.
    pub begun_s: Vec<f64>,
}

/// What is kept of a flight while it is predicted.
enum Record<'r> {
    /// Everything.
    Full(&'r mut Vec<Kinematics>),
    /// Time and place: enough for a fence, at a fraction of the work.
    Places(&'r mut Vec<(f64, Vector3<f64>)>),
}

impl<'a> Flyer<'a> {
    /// From a state in the air. `wind_ned` is the velocity of the air, m/s.
    pub fn new(airframe: &'a Airframe, frame: LocalFrame, wind_ned: Vector3<f64>, state: Entry) -> Self {
        let height = match &state {
            Entry::Wing(s) => -s.position_ned_m.z,
            Entry::Rotor(s) => -s.position_ned_m.z,
        };
        Self {
            speed: airframe.speed_cruise_m_per_s,
            airframe,
            frame,
            wind_ned,
            state,
            yaw: None,
            height,
            last_point: None,
            budget_s: f64::INFINITY,
        }
    }

    /// Gives up at this time, s: what takes longer is of no use.
    #[must_use]
    pub fn within(mut self, budget_s: f64) -> Self {
        self.budget_s = budget_s;
        self
    }

    /// Time since the start, s.
    pub fn t_s(&self) -> f64 {
        match &self.state {
            Entry::Wing(s) => s.t_s,
            Entry::Rotor(s) => s.t_s,
        }
    }

    /// Position, m.
    pub fn position_ned_m(&self) -> Vector3<f64> {
        match &self.state {
            Entry::Wing(s) => s.position_ned_m,
            Entry::Rotor(s) => s.position_ned_m,
        }
    }

    fn ground_velocity(&self) -> Vector3<f64> {
        match &self.state {
            Entry::Wing(s) => s.air_velocity() + self.wind_ned,
            Entry::Rotor(s) => s.velocity_ned_m_per_s,
        }
    }

    /// Flies these items and stays where the last one leaves it.
    ///
    /// # Errors
    /// A command without a model; an item that is never reached.
    pub fn fly(&mut self, items: &[MissionItem]) -> Result<Flight, FlightError> {
        let mut flight = Flight::default();
        for (k, item) in items.iter().enumerate() {
            flight.begun_s.push(self.t_s());
            if let Some(task) = self.task(k + 1, item)? {
                self.follow(k + 1, &task, &mut Record::Full(&mut flight.samples))?;
            }
        }
        fill_rates(&mut flight.samples);
        Ok(flight)
    }

    /// As [`Self::fly`], but keeps only times (s) and positions north, east, down (m).
    ///
    /// # Errors
    /// As [`Self::fly`].
    pub fn fly_places(&mut self, items: &[MissionItem]) -> Result<Vec<(f64, Vector3<f64>)>, FlightError> {
        let mut places = Vec::new();
        for (k, item) in items.iter().enumerate() {
            if let Some(task) = self.task(k + 1, item)? {
                self.follow(k + 1, &task, &mut Record::Places(&mut places))?;
            }
        }
        Ok(places)
    }

    fn note(&self, record: &mut Record<'_>) {
        match record {
            Record::Places(places) => places.push((self.t_s(), self.position_ned_m())),
            Record::Full(samples) => samples.push(match &self.state {
                Entry::Wing(s) => s.kinematics(self.airframe, &self.wind_ned),
                Entry::Rotor(s) => s.kinematics(self.airframe, &self.wind_ned),
            }),
        }
    }

    /// What this item asks for; none for one that only changes a setting.
    fn task(&mut self, number: usize, item: &MissionItem) -> Result<Option<Task>, FlightError> {
        let not_predicted =
            || FlightError::NotPredicted { item: number, what: command::describe(item.command) };
        let here = self.position_ned_m().xy();
        let at = item.place().map_or(here, |p| self.frame.to_local(p));
        let height = match item.frame.altitude_reference() {
            AltitudeReference::Home => Some(f64::from(item.z)),
            AltitudeReference::None => None,
            _ => return Err(not_predicted()),
        };
        let radius = |p: f32| {
            let side = if p < 0.0 { Side::Left } else { Side::Right };
            let r = f64::from(p.abs());
            (if r > 0.0 { r } else { self.airframe.turn_radius_min_m }, side)
        };
        let task = match item.command {
            command::DO_CHANGE_SPEED => {
                if item.params[1] > 0.0 {
                    self.speed = f64::from(item.params[1]);
                }
                return Ok(None);
            }
            command::CONDITION_YAW => {
                self.yaw = Some(f64::from(item.params[0]).to_radians());
                return Ok(None);
            }
            command::NAV_WAYPOINT if !self.airframe.is_fixed_wing() && item.params[0] > 0.0 => {
                let nose = f64::from(item.params[3]);
                if self.airframe.autopilot == Autopilot::Px4 && nose.is_finite() {
                    self.yaw = Some(nose.to_radians());
                }
                Task::Stay { at, height, seconds: f64::from(item.params[0]) }
            }
            command::NAV_WAYPOINT => Task::Line { from: self.last_point.unwrap_or(here), to: at, height },
            command::NAV_LOITER_TURNS => {
                let (radius, side) = radius(item.params[2]);
                let until = Until::Turns(f64::from(item.params[0]));
                Task::Circle { center: at, radius, side, until, height }
            }
            command::NAV_LOITER_TIME if self.airframe.is_fixed_wing() => {
                let (radius, side) = radius(item.params[2]);
                let until = Until::Seconds(f64::from(item.params[0]));
                Task::Circle { center: at, radius, side, until, height }
            }
            command::NAV_LOITER_TO_ALT if self.airframe.is_fixed_wing() => {
                let (radius, side) = radius(item.params[1]);
                let until = Until::Level(height.unwrap_or(self.height));
                Task::Circle { center: at, radius, side, until, height }
            }
            command::NAV_LAND if self.airframe.is_fixed_wing() => {
                Task::Glide { from: self.last_point.unwrap_or(here), to: at, height: self.height }
            }
            command::NAV_LAND => Task::Touchdown { at },
            command::NAV_LOITER_UNLIM if self.airframe.is_fixed_wing() => {
                let (radius, side) = radius(item.params[2]);
                Task::Circle { center: at, radius, side, until: Until::Turns(LAST_TURNS), height }
            }
            command::NAV_LOITER_UNLIM => Task::Hover { at, height },
            _ => return Err(not_predicted()),
        };
        // A line after a circle starts where the circle was left.
        self.last_point = matches!(task, Task::Line { .. }).then_some(at);
        Ok(Some(task))
    }

    fn follow(&mut self, number: usize, task: &Task, record: &mut Record<'_>) -> Result<(), FlightError> {
        let began = self.t_s();
        let mut progress = Progress::new(self.position_ned_m().xy());
        loop {
            let (airframe, wind) = (self.airframe, self.wind_ned);
            if let Some(height) = task.height_at(self.position_ned_m().xy()) {
                self.height = height;
            }
            self.note(record);
            let ground = self.ground_velocity();
            if progress.is_done(task, &self.position_ned_m(), ground.xy(), self.airframe, self.t_s() - began)
            {
                return Ok(());
            }
            if self.t_s() > self.budget_s {
                return Err(FlightError::OutOfTime { item: number });
            }
            if self.t_s() - began > ITEM_LIMIT_S {
                return Err(FlightError::NotReached { item: number });
            }
            match &mut self.state {
                Entry::Wing(s) => {
                    let command = wing::steer(s, airframe, &wind, task, self.speed, self.height);
                    s.step(airframe, &wind, &command, STEP_S);
                }
                Entry::Rotor(s) => {
                    let command = rotor::steer(s, airframe, task, self.speed, self.height, self.yaw);
                    s.step(airframe, &wind, &command, STEP_S);
                }
            }
        }
    }
}

/// How far a task has come.
struct Progress {
    swept: f64,
    arrived_s: Option<f64>,
    last_bearing: Option<f64>,
    start: Vector2<f64>,
}

impl Progress {
    fn new(start: Vector2<f64>) -> Self {
        Self { swept: 0.0, arrived_s: None, last_bearing: None, start }
    }

    fn is_done(
        &mut self,
        task: &Task,
        position_ned_m: &Vector3<f64>,
        v: Vector2<f64>,
        airframe: &Airframe,
        elapsed_s: f64,
    ) -> bool {
        let p = position_ned_m.xy();
        match task {
            Task::Line { from, to, .. } => {
                let left = (to - p).norm();
                if !airframe.is_fixed_wing() {
                    return left < 2.0;
                }
                let line = to - if (to - from).norm() > 1.0 { *from } else { self.start };
                let passed = line.norm() > 1.0 && (p - to).dot(&line) >= 0.0;
                // One second ahead: autopilots begin to turn before the point.
                passed && left < 4.0 * airframe.turn_radius_min_m || left < v.norm().max(5.0)
            }
            Task::Circle { center, radius, side, until, .. } => {
                let out = p - center;
                let bearing = atan2(out.y, out.x);
                // Turns count from the arrival at the circle.
                if out.norm() < 1.3 * radius && out.norm() > 0.5 * radius {
                    self.arrived_s.get_or_insert(elapsed_s);
                    if let Some(last) = self.last_bearing {
                        self.swept += side.sign() * gaware_nav::rotation::wrap_pi(bearing - last);
                    }
                    self.last_bearing = Some(bearing);
                } else {
                    self.last_bearing = None;
                }
                match until {
                    Until::Turns(turns) => self.swept >= turns * std::f64::consts::TAU,
                    Until::Seconds(seconds) => self.arrived_s.is_some_and(|t| elapsed_s - t >= *seconds),
                    Until::Level(height) => {
                        self.arrived_s.is_some() && (height + position_ned_m.z).abs() < LEVEL_M
                    }
                }
            }
            Task::Stay { at, height, seconds } => {
                let level = height.is_none_or(|h| (h + position_ned_m.z).abs() < LEVEL_M);
                if level && (at - p).norm() < LEVEL_M {
                    self.arrived_s.get_or_insert(elapsed_s);
                }
                self.arrived_s.is_some_and(|t| elapsed_s - t >= *seconds)
            }
            Task::Glide { from, to, .. } => (to - p).dot(&(to - from)) <= 0.0,
            Task::Touchdown { at } => (p - at).norm() < 3.0 && position_ned_m.z > -TOUCHED_M,
            Task::Hover { at, .. } => (p - at).norm() < 3.0 && elapsed_s > LAST_HOVER_S,
        }
    }
}

#[cfg(test)]
mod tests;
