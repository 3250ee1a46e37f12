//! Whether a maneuver was flown: what the vehicle did since it was asked for, beside what the maneuver's predicted flight does.
//!
//! A gain alone shows nothing: any motion teaches the filter something. What marks a maneuver are the changes that it makes: of heading to either
//! side, of height up and down, of speed, and of each component of specific force. All that are large in the prediction must have come to half of it.

use gaware_mission::kinematics::Kinematics;
use gaware_nav::math::{atan2, exp, sin_cos};
use nalgebra::Vector3;

/// Marks of a motion.
const MARKS: usize = 8;
/// Smaller marks of a maneuver are none: turn right and left, rad; climb and descent, m; speed, m/s; specific force x, y, z, m/s². Flying straight
/// and level in gusts stays below half of them.
const LEAST: [f64; MARKS] = [0.8, 0.8, 10.0, 10.0, 4.0, 1.2, 1.2, 2.0];
/// Share of each mark that shows the maneuver: pilots fly less exactly than a prediction.
const SHARE: f64 = 0.5;
/// Time constant of the smoothing of specific force, s: vibration is no mark.
const SMOOTHING_S: f64 = 0.5;

/// The vehicle at one instant.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct Instant {
    /// Time, s.
    pub t_s: f64,
    /// Heading, rad.
    pub heading: f64,
    /// Height, m.
    pub height_m: f64,
    /// Speed over ground, m/s.
    pub speed: f64,
    /// Specific force, body axes, m/s².
    pub force: Vector3<f64>,
}

impl From<&Kinematics> for Instant {
    fn from(k: &Kinematics) -> Self {
        Self {
            t_s: k.t_s,
            heading: k.attitude.euler_angles().2,
            height_m: k.height_m(),
            speed: k.velocity_ned_m_per_s.xy().norm(),
            force: k.force,
        }
    }
}

/// Largest rise and fall of a value so far.
#[derive(Debug, Clone, Copy)]
struct Course {
    low: f64,
    high: f64,
    rise: f64,
    fall: f64,
}

impl Course {
    fn at(value: f64) -> Self {
        Self { low: value, high: value, rise: 0.0, fall: 0.0 }
    }

    fn take(&mut self, value: f64) {
        (self.low, self.high) = (self.low.min(value), self.high.max(value));
        self.rise = self.rise.max(value - self.low);
        self.fall = self.fall.max(self.high - value);
    }

    fn range(&self) -> f64 {
        self.high - self.low
    }
}

/// What a vehicle has done since some time.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    last: Instant,
    /// Heading without its jumps, rad.
    turned: f64,
    force: Vector3<f64>,
    heading: Course,
    height: Course,
    speed: Course,
    forces: [Course; 3],
}

impl Motion {
    /// Begins here.
    pub fn from(here: Instant) -> Self {
        let [x, y, z] = here.force.into();
        Self {
            last: here,
            turned: 0.0,
            force: here.force,
            heading: Course::at(0.0),
            height: Course::at(here.height_m),
            speed: Course::at(here.speed),
            forces: [x, y, z].map(Course::at),
        }
    }

    /// Goes on to here.
    pub fn take(&mut self, here: Instant) {
        let dt_s = (here.t_s - self.last.t_s).max(0.0);
        let (sin, cos) = sin_cos(here.heading - self.last.heading);
        self.turned += atan2(sin, cos);
        self.last = here;
        self.force += (here.force - self.force) * (1.0 - exp(-dt_s / SMOOTHING_S));
        self.heading.take(self.turned);
        self.height.take(here.height_m);
        self.speed.take(here.speed);
        self.forces.iter_mut().zip(self.force.iter()).for_each(|(course, f)| course.take(*f));
    }

    /// Of a predicted flight.
    pub fn predicted(flight: &[Kinematics]) -> Option<Self> {
        let (first, rest) = flight.split_first()?;
        let mut motion = Self::from(first.into());
        rest.iter().for_each(|k| motion.take(k.into()));
        Some(motion)
    }

    fn marks(&self) -> [f64; MARKS] {
        let [x, y, z] = self.forces.each_ref().map(Course::range);
        let (heading, height) = (&self.heading, &self.height);
        [heading.rise, heading.fall, height.rise, height.fall, self.speed.range(), x, y, z]
    }

    /// How far it is on the way to the maneuvers with these predicted motions, flown one after the other: 1 where it shows them.
    pub fn share_of(&self, maneuvers: &[Self]) -> f64 {
        let mut wanted = [0.0_f64; MARKS];
        for maneuver in maneuvers {
            wanted.iter_mut().zip(maneuver.marks()).for_each(|(all, one)| *all = all.max(one));
        }
        let marks =
            wanted.into_iter().zip(LEAST).zip(self.marks()).filter(|((wanted, least), _)| wanted >= least);
        let share = marks.map(|((wanted, _), flown)| flown / (SHARE * wanted)).reduce(f64::min);
        share.unwrap_or(0.0).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use gaware_nav::math::sin;

    use super::*;
    use gaware_mission::airframe::Airframe;
    use gaware_mission::maneuver::{Entry, Maneuver};

    fn flight(name: &str, maneuver: Maneuver) -> Motion {
        let airframe = Airframe::example(name).unwrap();
        let entry = Entry::cruising(&airframe, Vector3::new(0.0, 0.0, -80.0), 0.3);
        Motion::predicted(&maneuver.kinematics(&airframe, &entry, &Vector3::zeros())).unwrap()
    }

    /// Straight and level for a minute, in gusts.
    fn cruise() -> Motion {
        let at = |k: u32| {
            let t_s = f64::from(k) * 0.03;
            let wave = |f: f64, a: f64| a * sin(f * t_s);
            Instant {
                t_s,
                heading: wave(0.3, 0.08),
                height_m: 80.0 + wave(0.2, 1.5),
                speed: 16.0 + wave(0.4, 0.8),
                force: Vector3::new(wave(0.5, 0.2), wave(0.9, 0.2), -9.8 + wave(1.1, 0.4)),
            }
        };
        let mut motion = Motion::from(at(0));
        (1..2000).for_each(|k| motion.take(at(k)));
        motion
    }

    #[test]
    fn every_maneuver_shows_itself_and_cruise_shows_none() {
        for name in ["small_fixed_wing", "large_fixed_wing", "quadrotor"] {
            for maneuver in Maneuver::all(&Airframe::example(name).unwrap()) {
                let flown = flight(name, maneuver);
                assert_eq!(flown.share_of(std::slice::from_ref(&flown)), 1.0, "{name} {maneuver:?}");
                let nothing = cruise().share_of(&[flown]);
                assert!(nothing < 0.7, "{name} {maneuver:?}: {nothing}");
            }
        }
    }

    #[test]
    fn a_turn_is_no_sideslip_and_a_turn_to_the_left_none_to_the_right() {
        use gaware_mission::maneuver::Side;
        let of = |m| flight("small_fixed_wing", m);
        let (right, left, slip) = (
            of(Maneuver::SteadyTurn(Side::Right)),
            of(Maneuver::SteadyTurn(Side::Left)),
            of(Maneuver::Sideslip),
        );
        assert!(right.share_of(std::slice::from_ref(&slip)) < 1.0, "full rudder is no coordinated turn");
        assert!(right.share_of(std::slice::from_ref(&left)) < 1.0);
        assert!(right.share_of(&[right.clone(), of(Maneuver::Climb)]) < 1.0, "half of a pair");
    }
}
