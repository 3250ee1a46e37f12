//! Mission items one after the other: navigation items are flown, `DO_` and `CONDITION_` items act at once when their
//! turn comes.

use super::*;
use gaware_nav::math::{atan2, tan};

/// Most items looked at in one decision, so that a loop of jumps cannot hang the pilot.
const MOST_ITEMS: usize = 200;
/// A wing leaves a waypoint this share of its turn radius early.
const EARLY: f64 = 0.5;

impl Pilot {
    pub(super) fn fly_mission(&mut self, sight: &Sight) -> Control {
        for _ in 0..MOST_ITEMS {
            let Some(item) = self.items.get(self.current).cloned() else {
                return self.end_of_mission(sight);
            };
            if !is_navigation(item.command) {
                self.act(&item);
                continue;
            }
            let mut leg = match self.leg {
                Some(leg) => leg,
                None => {
                    self.nose_of_px4(&item);
                    Leg::begin(sight)
                }
            };
            self.leg = Some(leg);
            if self.is_done(sight, &item, &mut leg) {
                self.events.push(PilotEvent::Reached(self.current));
                self.current += 1;
                self.leg = None;
                continue;
            }
            self.leg = Some(leg);
            return self.fly(sight, &item, &leg);
        }
        self.hold(sight)
    }

    /// ArduPlane returns home, the others hold; a vehicle on the ground stays there.
    fn end_of_mission(&mut self, sight: &Sight) -> Control {
        if !self.airborne {
            return stationary(self.yaw);
        }
        let home_first = self.is_wing() && self.config.first_item == 1;
        self.mode = if home_first { Mode::Rtl } else { Mode::Loiter };
        self.leg = None;
        self.hold = None;
        if home_first { self.go_home(sight) } else { self.hold(sight) }
    }

    /// Does what a `DO_` or `CONDITION_` item says, and goes on.
    fn act(&mut self, item: &MISSION_ITEM_INT_DATA) {
        let mut next = self.current + 1;
        match item.command {
            MavCmd::MAV_CMD_DO_CHANGE_SPEED => self.change_speed(item.param1, f64::from(item.param2)),
            MavCmd::MAV_CMD_CONDITION_YAW if !self.is_wing() => {
                let angle = f64::from(item.param1).to_radians();
                let relative = if item.param3 < 0.0 { -angle } else { angle };
                let base = self.wanted_yaw.unwrap_or(self.yaw);
                self.wanted_yaw = Some(wrap_pi(if item.param4 > 0.5 { base + relative } else { angle }));
                let rate = f64::from(item.param2).to_radians();
                self.yaw_rate = if rate > 0.0 { rate.min(1.5) } else { 1.0 };
            }
            MavCmd::MAV_CMD_DO_JUMP => {
                let (to, times) = (item.param1.max(0.0) as usize, item.param2 as i32);
                let seq = self.current;
                if !self.jumps.iter().any(|(s, _)| *s == seq) {
                    self.jumps.push((seq, 0));
                }
                let count = self.jumps.iter_mut().find(|(s, _)| *s == seq).map(|(_, n)| n);
                if let Some(count) = count.filter(|n| times < 0 || (**n as i32) < times) {
                    *count += 1;
                    next = to;
                }
            }
            _ => {}
        }
        self.current = next;
    }

    /// As ArduPlane: an airspeed outside its limits is dropped silently, a ground speed becomes a lasting minimum.
    pub(super) fn change_speed(&mut self, kind: f32, speed: f64) {
        if speed <= 0.0 || !speed.is_finite() {
            return;
        }
        if !self.is_wing() {
            self.speed = speed.min(self.config.max_m_per_s);
        } else if kind == 1.0 {
            self.min_ground_speed = speed;
        } else if (self.config.min_m_per_s..=self.config.max_m_per_s).contains(&speed) {
            self.speed = speed;
        }
    }

    /// PX4 carries the heading of a multirotor in the waypoint itself, ArduPilot in `CONDITION_YAW`.
    fn nose_of_px4(&mut self, item: &MISSION_ITEM_INT_DATA) {
        let px4 = self.config.first_item == 0;
        if px4 && !self.is_wing() && item.command == MavCmd::MAV_CMD_NAV_WAYPOINT {
            let angle = f64::from(item.param4).to_radians();
            self.wanted_yaw = angle.is_finite().then(|| wrap_pi(angle));
        }
    }

    /// The item's place; a zero or missing position means here.
    fn place_of(&self, item: &MISSION_ITEM_INT_DATA, leg: &Leg) -> Geodetic {
        #[allow(deprecated)]
        let above_sea = matches!(item.frame, MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT);
        let base = if above_sea { self.config.geoid_height_m } else { self.home.height_m };
        let height_m = if item.z.is_finite() { base + f64::from(item.z) } else { leg.from.height_m };
        let missing = (item.x == 0 && item.y == 0) || item.x == i32::MAX || item.y == i32::MAX;
        if missing {
            return Geodetic { height_m, ..leg.from };
        }
        Geodetic::from_degrees(f64::from(item.x) * 1e-7, f64::from(item.y) * 1e-7, height_m)
    }

    /// Radius of the item's circle with its direction as sign, m.
    fn radius_of(&self, item: &MISSION_ITEM_INT_DATA) -> f64 {
        let given = match item.command {
            MavCmd::MAV_CMD_NAV_LOITER_TO_ALT => item.param2,
            _ => item.param3,
        };
        if given.is_finite() && given.abs() >= 1.0 { f64::from(given) } else { self.config.loiter_radius_m }
    }

    fn is_done(&mut self, sight: &Sight, item: &MISSION_ITEM_INT_DATA, leg: &mut Leg) -> bool {
        let place = self.place_of(item, leg);
        let height_left = place.height_m - sight.place.height_m;
        let waited = |leg: &Leg, seconds: f32| {
            leg.there_s.is_some_and(|t| sight.t_s - t >= f64::from(seconds.max(0.0)))
        };
        match item.command {
            MavCmd::MAV_CMD_NAV_TAKEOFF => height_left < HEIGHT_SLACK_M && self.airborne,
            MavCmd::MAV_CMD_NAV_WAYPOINT | MavCmd::MAV_CMD_NAV_SPLINE_WAYPOINT => {
                if leg.there_s.is_none() && self.is_at(sight, item, &place, leg) {
                    leg.there_s = Some(sight.t_s);
                }
                waited(leg, if self.is_wing() { 0.0 } else { item.param1 })
            }
            MavCmd::MAV_CMD_NAV_LOITER_TURNS => {
                self.count_turns(sight, &place, self.radius_of(item), leg);
                leg.turned.is_some_and(|a| a >= f64::from(item.param1) * std::f64::consts::TAU)
            }
            MavCmd::MAV_CMD_NAV_LOITER_TIME => {
                self.count_turns(sight, &place, self.radius_of(item), leg);
                if leg.there_s.is_none() && leg.turned.is_some() {
                    leg.there_s = Some(sight.t_s);
                }
                waited(leg, item.param1)
            }
            MavCmd::MAV_CMD_NAV_LOITER_TO_ALT => {
                self.count_turns(sight, &place, self.radius_of(item), leg);
                leg.turned.is_some() && height_left.abs() < HEIGHT_SLACK_M
            }
            MavCmd::MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT => height_left.abs() < HEIGHT_SLACK_M,
            MavCmd::MAV_CMD_NAV_DELAY => sight.t_s - leg.since_s >= f64::from(item.param1.max(0.0)),
            MavCmd::MAV_CMD_NAV_LAND => self.landed && !self.armed,
            _ => false,
        }
    }

    fn is_at(&self, sight: &Sight, item: &MISSION_ITEM_INT_DATA, place: &Geodetic, leg: &Leg) -> bool {
        let d = sight.to(place);
        if !self.is_wing() {
            let near = f64::from(item.param2).max(ARRIVED_M);
            return d.norm() < near && (place.height_m - sight.place.height_m).abs() < near;
        }
        let speed = sight.ground_speed();
        let turn = speed * speed / (STANDARD_GRAVITY * tan(self.config.max_bank_rad));
        let near = f64::from(item.param2).max(EARLY * turn + speed).max(15.0);
        let way = offset(&leg.from, place);
        // Also on a leg that is shorter than the distance at which the next one begins.
        let passed = way.norm() > 1.0 && d.dot(&way) < 0.0;
        d.norm() < near || passed
    }

    /// Counts the angle around the centre from the time the circle is reached.
    fn count_turns(&self, sight: &Sight, centre: &Geodetic, radius: f64, leg: &mut Leg) {
        let d = -sight.to(centre);
        let bearing = atan2(d.y, d.x);
        // A stationary multirotor has no circle to reach.
        let slack = (0.3 * radius.abs()).max(4.0);
        match &mut leg.turned {
            Some(turned) => *turned += wrap_pi(bearing - leg.bearing) * radius.signum(),
            None if (d.norm() - radius.abs()).abs() < slack => leg.turned = Some(0.0),
            None => {}
        }
        leg.bearing = bearing;
    }

    fn fly(&mut self, sight: &Sight, item: &MISSION_ITEM_INT_DATA, leg: &Leg) -> Control {
        let place = self.place_of(item, leg);
        match item.command {
            MavCmd::MAV_CMD_NAV_TAKEOFF => self.take_off(sight, leg, &place),
            MavCmd::MAV_CMD_NAV_WAYPOINT | MavCmd::MAV_CMD_NAV_SPLINE_WAYPOINT => {
                self.waypoint(sight, leg, &place)
            }
            MavCmd::MAV_CMD_NAV_LOITER_TURNS
            | MavCmd::MAV_CMD_NAV_LOITER_TIME
            | MavCmd::MAV_CMD_NAV_LOITER_TO_ALT
            | MavCmd::MAV_CMD_NAV_LOITER_UNLIM => {
                let radius = self.radius_of(item);
                if self.is_wing() && !self.airborne {
                    return self.take_off(sight, leg, &place);
                }
                match item.command {
                    MavCmd::MAV_CMD_NAV_LOITER_TURNS => {
                        // ArduCopter's nose points to the middle, whatever a CONDITION_YAW before it said.
                        self.wanted_yaw = None;
                        self.turn_toward(sight, &place);
                        self.circle(sight, &place, radius)
                    }
                    _ => self.hold_at(sight, &place, radius),
                }
            }
            MavCmd::MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT if self.is_wing() => {
                self.wing(sight, leg.course, 0.0, place.height_m)
            }
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => self.go_home(sight),
            MavCmd::MAV_CMD_NAV_LAND => self.land(sight, &place),
            _ => self.hold_at(sight, &place, self.config.loiter_radius_m),
        }
    }

    fn take_off(&self, sight: &Sight, leg: &Leg, place: &Geodetic) -> Control {
        let top = Geodetic { height_m: place.height_m, ..leg.from };
        if !self.is_wing() {
            let velocity = point_velocity(&self.config, sight, &top, self.speed);
            return self.rotor(sight, velocity, Vector3::zeros());
        }
        // Straight ahead until there is air below the wings.
        let rolling = sight.airspeed < 1.1 * self.config.min_m_per_s;
        let low = self.height(sight) < 10.0;
        let mut control = self.wing(sight, leg.course, 0.0, place.height_m + HEIGHT_SLACK_M);
        if rolling {
            control.climb = 0.0;
        }
        if rolling || low {
            control.bank = 0.0;
        }
        control
    }

    /// The nose of a multirotor turns toward a place, no faster than 1 rad/s.
    fn turn_toward(&mut self, sight: &Sight, place: &Geodetic) {
        let d = sight.to(place);
        if d.norm() > 1.0 {
            let most = 0.02;
            self.yaw += wrap_pi(atan2(d.y, d.x) - self.yaw).clamp(-most, most);
        }
    }

    fn waypoint(&mut self, sight: &Sight, leg: &Leg, place: &Geodetic) -> Control {
        if self.is_wing() {
            if self.height(sight) < 10.0 && !self.flaring && sight.airspeed < self.config.min_m_per_s {
                return self.take_off(sight, leg, place);
            }
            let way = offset(&leg.from, place);
            let course = line_course(sight, place, atan2(way.y, way.x));
            return self.wing(sight, course, 0.0, place.height_m);
        }
        let d = sight.to(place);
        if self.wanted_yaw.is_none() && d.norm() > 3.0 {
            // Nose toward the waypoint unless the mission says otherwise.
            self.turn_toward(sight, place);
        }
        let velocity = point_velocity(&self.config, sight, place, self.speed);
        self.rotor(sight, velocity, Vector3::zeros())
    }
}

/// Whether an item is flown rather than acted upon: `MAV_CMD_NAV_LAST` is 95.
fn is_navigation(command: MavCmd) -> bool {
    (command as u32) < 95
}
