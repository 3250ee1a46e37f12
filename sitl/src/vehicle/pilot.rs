//! The pilot: modes, arming, and the uploaded mission item by item, as ArduPilot and PX4 execute it.

mod mission;
mod steer;

use super::{Control, VehicleConfig};
use crate::scenario::Airframe;
use gaware_nav::earth::{Geodetic, STANDARD_GRAVITY};
use gaware_nav::math::{atan2, cos, sin};
use gaware_nav::rotation::wrap_pi;
use mavlink::dialects::ardupilotmega::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame};
use nalgebra::{Vector2, Vector3};
pub(crate) use steer::Sight;
use steer::{
    bank_for, circle_course, circle_velocity, climb_for, down_for, line_course, offset, point_velocity,
    stationary, toward_velocity,
};

/// Flight modes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// A human flies; here: it stands, or holds where it is.
    Manual,
    /// Flies the mission.
    Auto,
    /// Holds its place.
    Loiter,
    /// Goes home; a multirotor lands there.
    Rtl,
    /// Lands where it is.
    Land,
}

/// What happened to the pilot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PilotEvent {
    /// This item is done.
    Reached(usize),
    /// Touched down and disarmed.
    Landed,
}

/// Time between two decisions, s.
const DECISION_S: f64 = super::STEP_S * super::STEPS_PER_DECISION as f64;
/// Height of return without a better one, m above home.
const RETURN_M: [f64; 2] = [80.0, 15.0];
/// A height counts as reached within this, m.
const HEIGHT_SLACK_M: f64 = 2.0;
/// A multirotor has arrived within this, m, and below this speed, m/s.
const ARRIVED_M: f64 = 2.0;
/// On the ground below this, m above home.
const GROUND_M: f64 = 0.3;

/// Progress of the navigation item being flown.
#[derive(Debug, Clone, Copy)]
struct Leg {
    from: Geodetic,
    since_s: f64,
    /// When the point was reached; time at a point counts from here.
    there_s: Option<f64>,
    /// Angle flown around the centre since the circle was reached, rad.
    turned: Option<f64>,
    bearing: f64,
    course: f64,
}

/// The pilot.
#[derive(Debug, Clone)]
pub(crate) struct Pilot {
    config: VehicleConfig,
    pub(crate) items: Vec<MISSION_ITEM_INT_DATA>,
    home: Geodetic,
    mode: Mode,
    armed: bool,
    current: usize,
    /// Where a `DO_JUMP` has jumped already, by sequence number.
    jumps: Vec<(usize, u32)>,
    leg: Option<Leg>,
    hold: Option<Geodetic>,
    speed: f64,
    min_ground_speed: f64,
    yaw: f64,
    yaw_rate: f64,
    wanted_yaw: Option<f64>,
    /// Multirotor: the horizontal acceleration asked for last, m/s².
    accel: Vector2<f64>,
    airborne: bool,
    flaring: bool,
    landed: bool,
    events: Vec<PilotEvent>,
}

impl Pilot {
    pub(crate) fn new(config: VehicleConfig) -> Self {
        Self {
            home: config.start,
            speed: config.cruise_m_per_s,
            yaw: config.heading_rad,
            current: config.first_item,
            config,
            items: Vec::new(),
            mode: Mode::Manual,
            armed: false,
            jumps: Vec::new(),
            leg: None,
            hold: None,
            min_ground_speed: 0.0,
            yaw_rate: 1.0,
            wanted_yaw: None,
            accel: Vector2::zeros(),
            airborne: false,
            flaring: false,
            landed: false,
            events: Vec::new(),
        }
    }

    pub(crate) fn is_armed(&self) -> bool {
        self.armed
    }

    pub(crate) fn arm(&mut self, on: bool) -> bool {
        if !on && self.airborne {
            return false;
        }
        self.armed = on;
        true
    }

    pub(crate) fn mode(&self) -> Mode {
        self.mode
    }

    pub(crate) fn set_mode(&mut self, mode: Mode) -> bool {
        if mode == Mode::Auto && self.items.len() <= self.config.first_item {
            return false;
        }
        // ArduPilot's mission begins again when it is over; PX4's does under conditions that an armed vehicle on the ground does not
        // meet (`MissionBase::checkMissionRestart`).
        if mode == Mode::Auto && self.current >= self.items.len() && self.config.first_item > 0 {
            self.current = self.config.first_item;
        }
        self.mode = mode;
        self.leg = None;
        self.hold = None;
        self.flaring = false;
        true
    }

    pub(crate) fn current(&self) -> usize {
        self.current
    }

    pub(crate) fn set_current(&mut self, seq: usize) -> bool {
        let exists = seq < self.items.len();
        if exists {
            self.put_current(seq);
        }
        exists
    }

    pub(crate) fn put_current(&mut self, seq: usize) {
        self.current = seq;
        self.leg = None;
    }

    pub(crate) fn has_landed(&self) -> bool {
        self.landed
    }

    pub(crate) fn take_events(&mut self) -> Vec<PilotEvent> {
        std::mem::take(&mut self.events)
    }

    fn is_wing(&self) -> bool {
        self.config.airframe == Airframe::FixedWing
    }

    fn height(&self, sight: &Sight) -> f64 {
        sight.place.height_m - self.home.height_m
    }

    /// What to do now.
    pub(crate) fn decide(&mut self, sight: &Sight) -> Control {
        if self.height(sight) > 1.0 {
            self.airborne = true;
        }
        self.turn_nose();
        let mut control = if self.armed { self.in_mode(sight) } else { stationary(self.yaw) };
        self.smooth(&mut control.accel);
        control
    }

    /// Acceleration changes no faster than the pilot's jerk, as position controllers of autopilots have it.
    fn smooth(&mut self, accel: &mut Vector3<f64>) {
        let most = self.config.jerk_m_per_s3 * DECISION_S;
        let change = accel.xy() - self.accel;
        let size = change.norm();
        if most > 0.0 && size > most {
            let next = self.accel + change * (most / size);
            (accel.x, accel.y) = (next.x, next.y);
        }
        self.accel = accel.xy();
    }

    fn in_mode(&mut self, sight: &Sight) -> Control {
        match self.mode {
            Mode::Auto
                if self.airborne && self.config.returns_at.is_some_and(|item| self.current >= item) =>
            {
                self.set_mode(Mode::Rtl);
                self.go_home(sight)
            }
            Mode::Auto => self.fly_mission(sight),
            Mode::Manual if !self.airborne => stationary(self.yaw),
            Mode::Manual | Mode::Loiter => self.hold(sight),
            Mode::Rtl => self.go_home(sight),
            Mode::Land => {
                let here = *self.hold.get_or_insert(sight.place);
                self.land(sight, &here)
            }
        }
    }

    /// The nose follows its wish at its rate.
    fn turn_nose(&mut self) {
        if let Some(wanted) = self.wanted_yaw {
            let most = self.yaw_rate * DECISION_S;
            self.yaw += wrap_pi(wanted - self.yaw).clamp(-most, most);
        }
    }

    /// Airspeed, raised where the wind would take too much of it.
    fn airspeed(&self, sight: &Sight) -> f64 {
        let missing = (self.min_ground_speed - sight.ground_speed()).max(0.0);
        (self.speed + missing).clamp(self.config.min_m_per_s, self.config.max_m_per_s)
    }

    fn wing(&self, sight: &Sight, course: f64, turn_rate: f64, height_m: f64) -> Control {
        Control {
            bank: bank_for(&self.config, sight, course, turn_rate),
            climb: climb_for(&self.config, sight, height_m),
            speed: self.airspeed(sight),
            ..stationary(self.yaw)
        }
    }

    fn rotor(&self, sight: &Sight, velocity: Vector3<f64>, path: Vector3<f64>) -> Control {
        Control { accel: toward_velocity(&self.config, sight, velocity, path), ..stationary(self.yaw) }
    }

    /// Circles (wing) or stands (multirotor) at a place.
    fn hold_at(&self, sight: &Sight, place: &Geodetic, radius: f64) -> Control {
        if self.is_wing() {
            return self.circle(sight, place, radius);
        }
        let velocity = point_velocity(&self.config, sight, place, self.speed);
        self.rotor(sight, velocity, Vector3::zeros())
    }

    fn circle(&self, sight: &Sight, centre: &Geodetic, radius: f64) -> Control {
        let turn = if radius < 0.0 { -1.0 } else { 1.0 };
        let r = radius.abs().max(1.0);
        if !self.is_wing() {
            let [v, pull] = circle_velocity(&self.config, sight, centre, r, turn, self.speed);
            return self.rotor(sight, v, pull);
        }
        let course = circle_course(sight, centre, r, turn);
        let distance = sight.to(centre).norm();
        let on_it = (distance - r).abs() < 0.5 * r;
        let turn_rate = if on_it { turn * sight.ground_speed() / distance.max(0.5 * r) } else { 0.0 };
        let mut control = self.wing(sight, course, turn_rate, centre.height_m);
        if on_it && !self.config.climbs_in_circles {
            control.climb = control.climb.min(0.0);
        }
        control
    }

    fn hold(&mut self, sight: &Sight) -> Control {
        let here = *self.hold.get_or_insert(sight.place);
        self.hold_at(sight, &here, self.config.loiter_radius_m)
    }

    fn go_home(&mut self, sight: &Sight) -> Control {
        let above = RETURN_M[usize::from(!self.is_wing())];
        if self.is_wing() {
            let over_home = Geodetic { height_m: self.home.height_m + above, ..self.home };
            return self.circle(sight, &over_home, self.config.loiter_radius_m);
        }
        let over_home = *self.hold.get_or_insert(Geodetic {
            height_m: sight.place.height_m.max(self.home.height_m + above),
            ..self.home
        });
        if sight.to(&self.home).norm() < ARRIVED_M {
            let home = self.home;
            return self.land(sight, &home);
        }
        // Up first, then over.
        let velocity = if sight.place.height_m < over_home.height_m - HEIGHT_SLACK_M {
            Vector3::new(0.0, 0.0, down_for(&self.config, sight, over_home.height_m))
        } else {
            point_velocity(&self.config, sight, &over_home, self.speed)
        };
        self.rotor(sight, velocity, Vector3::zeros())
    }

    fn land(&mut self, sight: &Sight, at: &Geodetic) -> Control {
        let height = self.height(sight);
        if !self.is_wing() {
            if height < GROUND_M && sight.v_n.norm() < 0.3 {
                self.touch_down();
            }
            let sink = (0.5 * height).clamp(0.0, self.config.sink_m_per_s.min(1.0 + 0.1 * height));
            let mut velocity = point_velocity(&self.config, sight, at, self.speed);
            velocity.z = if height > 0.1 { sink.max(0.15) } else { 0.0 };
            return self.rotor(sight, velocity, Vector3::zeros());
        }
        self.land_wing(sight, at, height)
    }

    fn land_wing(&mut self, sight: &Sight, at: &Geodetic, height: f64) -> Control {
        const GLIDE: f64 = 0.1;
        let leg = self.leg.get_or_insert(Leg::begin(sight));
        let d = offset(&leg.from, at);
        let direction = if d.norm() > 1.0 { atan2(d.y, d.x) } else { leg.course };
        self.flaring |= height < 5.0;
        if height < 0.5 && sight.airspeed < 0.3 {
            self.touch_down();
        }
        if self.flaring {
            let climb = (-0.4 * height.max(0.0) / sight.airspeed.max(8.0)).clamp(-0.1, 0.0);
            let speed = if height < 0.5 { 0.0 } else { self.config.min_m_per_s };
            return Control { climb, speed, ..stationary(self.yaw) };
        }
        let ahead = sight.to(at);
        let distance = (ahead.x * cos(direction) + ahead.y * sin(direction)).max(0.0);
        let slope = Geodetic { height_m: self.home.height_m + GLIDE * distance, ..*at };
        let course = line_course(sight, at, direction);
        let mut control = self.wing(sight, course, 0.0, slope.height_m.min(sight.place.height_m));
        control.speed = (1.2 * self.config.min_m_per_s).min(control.speed);
        control
    }

    fn touch_down(&mut self) {
        if self.airborne {
            self.airborne = false;
            self.flaring = false;
            self.armed = false;
            self.landed = true;
            self.mode = Mode::Manual;
            self.events.push(PilotEvent::Landed);
        }
    }
}

impl Leg {
    fn begin(sight: &Sight) -> Self {
        Self {
            from: sight.place,
            since_s: sight.t_s,
            there_s: None,
            turned: None,
            bearing: 0.0,
            course: if sight.ground_speed() > 3.0 { sight.course() } else { sight.yaw },
        }
    }
}
