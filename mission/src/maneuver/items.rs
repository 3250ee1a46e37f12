//! Maneuvers as mission items at a place.
//!
//! Speeds are changed by `DO_CHANGE_SPEED` of type 0 (airspeed) for fixed wings: type 1 would set ArduPlane's minimum
//! ground-speed parameter for good. Multirotors get type 1, the only one that both autopilots follow there.

use super::{Maneuver, NoSpace, Placement, Side};
use crate::airframe::Airframe;
use crate::item::{Autopilot, LatLon, MissionItem, command};
use gaware_nav::math::sin_cos;
use nalgebra::{Rotation2, Vector2};
use std::f64::consts::TAU;

/// Shortest half of a straight run, in seconds at cruise speed.
const SHORTEST_HALF_S: f64 = 5.0;
/// Longest half of a straight run that is of use, in seconds at cruise speed.
const LONGEST_HALF_S: f64 = 12.0;
/// Least change of height that is worth a climb, m.
const LEAST_CLIMB_M: f64 = 10.0;
/// Change of height in a pull-up, in seconds of climb.
const PULL_UP_S: f64 = 5.0;

/// Rate of a nose that turns in hover, deg/s, and the time in which it settles, s.
const YAW_DEG_PER_S: f64 = 30.0;
const YAW_SETTLES_S: f64 = 2.0;
/// Hover between two changes of height, s.
const HOVER_S: f64 = 3.0;

/// Waypoints in a ring.
const RING: u32 = 10;

/// A list of items under construction.
struct Builder<'a> {
    airframe: &'a Airframe,
    place: &'a Placement,
    items: Vec<MissionItem>,
    /// As of the last speed item, m/s.
    speed: f64,
}

/// Speed change for this airframe: see the module's words on types.
pub(crate) fn speed_item(airframe: &Airframe, speed_m_per_s: f64) -> MissionItem {
    let kind = if airframe.is_fixed_wing() { 0.0 } else { 1.0 };
    MissionItem::action(command::DO_CHANGE_SPEED, [kind, speed_m_per_s as f32, -1.0, 0.0])
}

impl Builder<'_> {
    /// The place `ahead` and `right` of the centre, m.
    fn at(&self, ahead: f64, right: f64) -> LatLon {
        let turned = Rotation2::new(self.place.heading_rad) * Vector2::new(ahead, right);
        self.place.frame.to_place(self.place.center_m + turned)
    }

    fn waypoint(&mut self, ahead: f64, right: f64, height_m: f64) {
        let place = self.at(ahead, right);
        let params = [0.0, 0.0, 0.0, self.airframe.autopilot.free_heading()];
        let item = MissionItem::at(command::NAV_WAYPOINT, params, place, height_m as f32);
        self.items.push(item);
    }

    fn speed(&mut self, speed_m_per_s: f64) {
        self.speed = speed_m_per_s;
        self.items.push(speed_item(self.airframe, speed_m_per_s));
    }

    /// Circles around a point. PX4 refuses `NAV_LOITER_TURNS` and `CONDITION_YAW` in missions: its fixed wings circle for a
    /// time instead, its multirotors fly a ring of waypoints.
    fn circles(&mut self, ahead: f64, right: f64, side: Side, radius_m: f64, turns: f64) {
        let signed = (side.sign() * radius_m) as f32;
        let place = self.at(ahead, right);
        let speed = self.speed;
        let (command, first) = match (self.airframe.autopilot, self.airframe.is_fixed_wing()) {
            (Autopilot::ArduPilot, _) => (command::NAV_LOITER_TURNS, turns),
            (Autopilot::Px4, true) => {
                let round = TAU * radius_m / speed;
                (command::NAV_LOITER_TIME, (turns * round).ceil())
            }
            (Autopilot::Px4, false) => return self.ring(ahead, right, side, radius_m, turns),
        };
        let params = [first as f32, 0.0, signed, 0.0];
        self.items.push(MissionItem::at(command, params, place, self.place.height_m as f32));
    }

    fn ring(&mut self, ahead: f64, right: f64, side: Side, radius_m: f64, turns: f64) {
        let corners = (turns * f64::from(RING)).round() as u32;
        for k in 0..=corners {
            let (s, c) = sin_cos(side.sign() * TAU * f64::from(k) / f64::from(RING));
            self.waypoint(ahead + radius_m * c, right + radius_m * s, self.place.height_m);
        }
    }

    /// What a turn-around at the end of a run takes beyond its last waypoint, m.
    fn turn_space(&self) -> f64 {
        let a = self.airframe;
        if a.is_fixed_wing() {
            // A turn in wind drifts; the flown prediction checks the rest.
            2.0 * a.planned_radius_m(a.speed_cruise_m_per_s + self.place.wind_m_per_s)
        } else {
            a.speed_cruise_m_per_s
        }
    }

    /// Half the length of a straight run, m.
    fn half_run(&self) -> Result<f64, NoSpace> {
        let cruise = self.airframe.speed_cruise_m_per_s;
        let half = self.place.space_m - self.turn_space();
        if half < SHORTEST_HALF_S * cruise {
            let needed_m = SHORTEST_HALF_S * cruise + self.turn_space();
            return Err(NoSpace::Radius { needed_m, space_m: self.place.space_m });
        }
        Ok(half.min(LONGEST_HALF_S * cruise))
    }

    /// Begins steep circles of which `wide` must fit beside each other: as fast as the space allows, for the load of a circle that its smallest
    /// radius bounds grows with the speed. Returns the radius.
    fn steep(&mut self, wide: f64) -> Result<f64, NoSpace> {
        let a = self.airframe;
        let (cruise, wind) = (a.speed_cruise_m_per_s, self.place.wind_m_per_s);
        if a.is_fixed_wing() && a.speed_max_m_per_s > cruise {
            let fast = a.speed_max_m_per_s;
            if let Ok(radius) = self.fits(wide, a.steep_radius_m(fast + wind)) {
                self.speed(fast);
                return Ok(radius);
            }
        }
        self.radius(wide)
    }

    /// Radius of a circle at cruise speed, if `wide` of them fit into the space.
    fn radius(&self, wide: f64) -> Result<f64, NoSpace> {
        let a = self.airframe;
        self.fits(wide, a.planned_radius_m(a.speed_cruise_m_per_s + self.place.wind_m_per_s))
    }

    /// The radius as it will be stored, if `wide` of these circles fit into the space.
    fn fits(&self, wide: f64, radius_m: f64) -> Result<f64, NoSpace> {
        let a = self.airframe;
        let radius = a.stored_radius_m(radius_m);
        // The entry onto the circle overshoots.
        let needed_m = wide * radius * if a.is_fixed_wing() { 1.4 } else { 1.2 };
        if needed_m > self.place.space_m {
            return Err(NoSpace::Radius { needed_m, space_m: self.place.space_m });
        }
        Ok(radius)
    }

    fn heights(&self, change_m: f64) -> Result<[f64; 2], NoSpace> {
        let [floor, ceiling] = self.place.band_m;
        // Climbs and descents overshoot by a few metres.
        let (low, high) = (floor + 3.0, ceiling - 3.0);
        if high - low < LEAST_CLIMB_M {
            return Err(NoSpace::Height { needed_m: LEAST_CLIMB_M + 6.0, there_m: ceiling - floor });
        }
        let bottom = (self.place.height_m - change_m / 2.0).clamp(low, (high - change_m).max(low));
        Ok([bottom, (bottom + change_m).min(high)])
    }

    fn varying_speed(&mut self) -> Result<(), NoSpace> {
        let half = self.half_run()?;
        let (slow, fast) = (self.airframe.planned_slow_m_per_s(), self.airframe.speed_max_m_per_s);
        let height = self.place.height_m;
        self.waypoint(-half, 0.0, height);
        for side in [1.0, -1.0] {
            self.speed(fast);
            self.waypoint(0.0, 0.0, height);
            self.speed(slow);
            self.waypoint(side * half, 0.0, height);
        }
        self.speed(self.airframe.speed_cruise_m_per_s);
        Ok(())
    }

    fn climb(&mut self, up: bool) -> Result<(), NoSpace> {
        let half = self.half_run()?;
        let a = self.airframe;
        let (rate, ground) = if up {
            (a.climb_max_m_per_s, a.speed_cruise_m_per_s + self.place.wind_m_per_s)
        } else {
            (a.descent_max_m_per_s, a.speed_cruise_m_per_s + self.place.wind_m_per_s)
        };
        // Reached before the end of the run even down wind.
        let change = (0.8 * rate * 2.0 * half / ground).max(LEAST_CLIMB_M);
        let [low, high] = self.heights(change)?;
        let (first, last) = if up { (low, high) } else { (high, low) };
        self.waypoint(-half, 0.0, first);
        self.waypoint(half, 0.0, last);
        Ok(())
    }

    fn pull_up(&mut self) -> Result<(), NoSpace> {
        let half = self.half_run()?;
        let change = PULL_UP_S * self.airframe.climb_max_m_per_s.min(self.airframe.descent_max_m_per_s);
        let [low, high] = self.heights(change)?;
        self.waypoint(-half, 0.0, low);
        for (ahead, height) in [(-0.33, high), (0.33, low), (1.0, high), (0.33, low), (-0.33, high)] {
            self.waypoint(ahead * half, 0.0, height);
        }
        self.waypoint(-half, 0.0, self.place.height_m);
        Ok(())
    }

    /// Back to cruise speed after steep circles.
    fn slow_down(&mut self) {
        if self.speed > self.airframe.speed_cruise_m_per_s {
            self.speed(self.airframe.speed_cruise_m_per_s);
        }
    }

    fn spiral(&mut self, side: Side) -> Result<(), NoSpace> {
        let a = self.airframe;
        let radius = self.steep(1.0)?;
        let round_s = TAU * radius / self.speed;
        let [low, high] = self.heights((0.9 * a.climb_max_m_per_s * round_s).max(LEAST_CLIMB_M))?;
        let place = self.at(0.0, 0.0);
        let params = [0.0, (side.sign() * radius) as f32, 0.0, 0.0];
        for height in [low, high, low] {
            self.items.push(MissionItem::at(command::NAV_LOITER_TO_ALT, params, place, height as f32));
        }
        self.slow_down();
        Ok(())
    }

    /// Figures of eight with bank in reserve, slow and fast.
    fn two_speed_circles(&mut self) -> Result<(), NoSpace> {
        let a = self.airframe;
        for speed in [self.airframe.planned_slow_m_per_s(), a.speed_max_m_per_s] {
            let radius = self.fits(2.0, a.planned_radius_m(speed + self.place.wind_m_per_s))?;
            self.speed(speed);
            self.circles(radius, 0.0, Side::Right, radius, 1.0);
            self.circles(-radius, 0.0, Side::Left, radius, 1.0);
        }
        self.speed(a.speed_cruise_m_per_s);
        Ok(())
    }

    /// A multirotor stays over the centre at this height, with its nose there where that is given, deg.
    fn stay(&mut self, height_m: f64, seconds: f64, nose_deg: Option<f64>) {
        let ardupilot = self.airframe.autopilot == Autopilot::ArduPilot;
        if let Some(nose) = nose_deg.filter(|_| ardupilot) {
            let params = [nose as f32, YAW_DEG_PER_S as f32, 0.0, 0.0];
            self.items.push(MissionItem::action(command::CONDITION_YAW, params));
        }
        self.waypoint(0.0, 0.0, height_m);
        if let Some(last) = self.items.last_mut() {
            last.params[0] = seconds.ceil() as f32;
            if let Some(nose) = nose_deg.filter(|_| !ardupilot) {
                // PX4 takes the heading from the waypoint.
                last.params[3] = nose as f32;
            }
        }
    }

    fn yaw_turns(&mut self) {
        let first = self.place.heading_rad.to_degrees();
        for quarter in [0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, 0.0] {
            let nose = (first + 90.0 * quarter).rem_euclid(360.0);
            self.stay(self.place.height_m, 90.0 / YAW_DEG_PER_S + YAW_SETTLES_S, Some(nose));
        }
    }

    fn hover_steps(&mut self) -> Result<(), NoSpace> {
        let change = PULL_UP_S * self.airframe.climb_max_m_per_s.min(self.airframe.descent_max_m_per_s);
        let [low, high] = self.heights(change.max(LEAST_CLIMB_M))?;
        for height in [low, high, low, high, low] {
            self.stay(height, HOVER_S, None);
        }
        self.waypoint(0.0, 0.0, self.place.height_m);
        Ok(())
    }

    fn crab_legs(&mut self) -> Result<(), NoSpace> {
        let half = self.half_run()?;
        let height = self.place.height_m;
        self.speed(self.airframe.speed_max_m_per_s);
        let yaw = self.place.heading_rad.to_degrees().rem_euclid(360.0) as f32;
        for axis_deg in [0.0_f64, 90.0, 45.0, 135.0] {
            let (s, c) = sin_cos(axis_deg.to_radians());
            for end in [1.0, -1.0] {
                if self.airframe.autopilot == Autopilot::ArduPilot {
                    // For every leg anew: ArduCopter's nose goes back to leading the path at each waypoint.
                    self.items.push(MissionItem::action(command::CONDITION_YAW, [yaw, 30.0, 0.0, 0.0]));
                }
                self.waypoint(end * half * c, end * half * s, height);
                if self.airframe.autopilot == Autopilot::Px4
                    && let Some(last) = self.items.last_mut()
                {
                    // PX4 takes the heading from the waypoint.
                    last.params[3] = yaw;
                }
            }
        }
        self.speed(self.airframe.speed_cruise_m_per_s);
        Ok(())
    }
}

/// One circle around the centre, to begin something else from.
pub(crate) fn join(airframe: &Airframe, place: &Placement) -> Result<Vec<MissionItem>, NoSpace> {
    let mut b = Builder { airframe, place, items: Vec::new(), speed: airframe.speed_cruise_m_per_s };
    let radius = b.radius(1.0)?;
    b.circles(0.0, 0.0, Side::Right, radius, 1.0);
    Ok(b.items)
}

pub(super) fn build(
    maneuver: Maneuver,
    airframe: &Airframe,
    place: &Placement,
) -> Result<Vec<MissionItem>, NoSpace> {
    let mut b = Builder { airframe, place, items: Vec::new(), speed: airframe.speed_cruise_m_per_s };
    match maneuver {
        Maneuver::VaryingSpeed => b.varying_speed()?,
        Maneuver::SteadyTurn(side) => {
            let radius = b.steep(1.0)?;
            b.circles(0.0, 0.0, side, radius, 2.0);
            b.slow_down();
        }
        Maneuver::Climb => b.climb(true)?,
        Maneuver::Descent => b.climb(false)?,
        Maneuver::PullUp => b.pull_up()?,
        Maneuver::FigureEight => {
            let radius = b.steep(2.0)?;
            b.circles(radius, 0.0, Side::Right, radius, 1.0);
            b.circles(-radius, 0.0, Side::Left, radius, 1.0);
            b.slow_down();
        }
        Maneuver::Spiral(side) if airframe.is_fixed_wing() => b.spiral(side)?,
        Maneuver::Spiral(_) => return Err(NoSpace::NotFlown("spirals are for fixed wings")),
        Maneuver::PaperSequence => {
            b.varying_speed()?;
            let radius = b.radius(1.0)?;
            b.circles(0.0, 0.0, Side::Right, radius, 1.0);
            b.speed(airframe.planned_slow_m_per_s());
            b.climb(true)?;
            b.speed(airframe.speed_cruise_m_per_s);
        }
        Maneuver::TwoSpeedCircles => b.two_speed_circles()?,
        Maneuver::YawTurns | Maneuver::HoverSteps if airframe.is_fixed_wing() => {
            return Err(NoSpace::NotFlown("a fixed wing does not hover"));
        }
        Maneuver::YawTurns => b.yaw_turns(),
        Maneuver::HoverSteps => b.hover_steps()?,
        Maneuver::CrabLegs if !airframe.is_fixed_wing() => b.crab_legs()?,
        Maneuver::CrabLegs => return Err(NoSpace::NotFlown("crab legs are for multirotors")),
        Maneuver::Sideslip => {
            return Err(NoSpace::NotFlown("autopilots do not fly sideslips: a pilot must"));
        }
    }
    Ok(b.items)
}
