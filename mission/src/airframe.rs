//! What an airframe can do: `airframe.toml`, with three examples built in.

mod checks;

use crate::item::Autopilot;
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::{acos, tan};
use serde::{Deserialize, Serialize};

/// A small fixed wing on ArduPlane.
pub const SMALL_FIXED_WING: &str = include_str!("../airframes/small_fixed_wing.toml");
/// A larger fixed wing on PX4.
pub const LARGE_FIXED_WING: &str = include_str!("../airframes/large_fixed_wing.toml");
/// A quadrotor on ArduCopter.
pub const QUADROTOR: &str = include_str!("../airframes/quadrotor.toml");
/// The examples by name.
pub const EXAMPLES: [(&str, &str); 3] = [
    ("small_fixed_wing", SMALL_FIXED_WING),
    ("large_fixed_wing", LARGE_FIXED_WING),
    ("quadrotor", QUADROTOR),
];

const SCHEMA: &str = "gaware.airframe/1";
/// The part of the bank limit that a planned turn uses; the rest is for gusts and for holding the circle.
const PLANNED_BANK: f64 = 0.8;
/// The same for the steep circles of excitation maneuvers.
const STEEP_BANK: f64 = 0.9;

/// Kinds of airframes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Wings carry it; it banks to turn and cannot stop.
    FixedWing,
    /// Rotors carry it; it tilts to accelerate and can stop.
    Multirotor,
}

/// An airframe and its limits. Speeds are airspeeds of a fixed wing, ground speeds of a multirotor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Airframe {
    schema: String,
    /// For people.
    pub name: String,
    /// Wings or rotors.
    pub kind: Kind,
    /// Who flies it.
    pub autopilot: Autopilot,
    /// Slowest planned speed, m/s: with a margin above the stall.
    pub speed_min_m_per_s: f64,
    /// Usual speed, m/s.
    pub speed_cruise_m_per_s: f64,
    /// Fastest planned speed, m/s.
    pub speed_max_m_per_s: f64,
    /// Acceleration along the path at full throttle, m/s².
    pub acceleration_m_per_s2: f64,
    /// Deceleration along the path at idle, m/s².
    pub braking_m_per_s2: f64,
    /// Largest bank (multirotor: tilt), deg.
    pub bank_max_deg: f64,
    /// Largest pitch up or down, deg.
    pub pitch_max_deg: f64,
    /// Largest roll rate, deg/s.
    pub roll_rate_max_deg_per_s: f64,
    /// Largest yaw rate of a multirotor, deg/s.
    #[serde(default = "default_yaw_rate")]
    pub yaw_rate_max_deg_per_s: f64,
    /// Largest load factor.
    pub load_factor_max: f64,
    /// Climb rate, m/s.
    pub climb_max_m_per_s: f64,
    /// Descent rate, m/s.
    pub descent_max_m_per_s: f64,
    /// Smallest radius of a circle to plan, m.
    pub turn_radius_min_m: f64,
    /// Step to which the autopilot rounds radii above 255 m, m; 0: it does not.
    #[serde(default)]
    pub radius_step_above_255_m: f64,
    /// Linear drag of a multirotor: deceleration per airspeed, 1/s.
    #[serde(default)]
    pub drag_per_s: f64,
    /// Largest change of acceleration of a multirotor that follows its mission, m/s³; 0: not limited.
    #[serde(default)]
    pub jerk_max_m_per_s3: f64,
    /// Side force of a steady level turn with 45° of bank, g, to the outside of the turn: what a fixed wing whose rudder does
    /// not coordinate its turns leaves; 0: coordinated.
    #[serde(default)]
    pub side_force_g: f64,
    /// Side force of a fixed wing that rolls at 90 deg/s at cruise speed, g, to the side that goes down; 0: none.
    #[serde(default)]
    pub roll_side_force_g: f64,
    /// Peak of the load factor while a fixed wing rolls into a turn, over that of the steady turn.
    #[serde(default = "default_overshoot")]
    pub load_overshoot: f64,
    /// How far the airspeed of a fixed wing falls below a commanded slow speed, m/s.
    #[serde(default)]
    pub speed_sag_m_per_s: f64,
    /// Time that the energy on board allows for maneuvers, s: without take-off, way home and reserve.
    #[serde(default = "default_maneuvers")]
    pub maneuvers_max_s: f64,
}

/// What the name of an airframe ends with whose values come from a flight.
const FITTED: &str = ", fitted";

fn default_maneuvers() -> f64 {
    900.0
}

fn default_yaw_rate() -> f64 {
    60.0
}

fn default_overshoot() -> f64 {
    1.0
}

/// Why an airframe cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AirframeError {
    /// Not TOML, or a key that is missing or unknown.
    #[error("{message}")]
    Syntax {
        /// What the parser said.
        message: String,
        /// Bytes of the source it is about.
        span: Option<std::ops::Range<usize>>,
    },
    /// Another schema.
    #[error("schema is \"{0}\", this program reads \"gaware.airframe/1\"")]
    Schema(String),
    /// A value no airframe has.
    #[error("{key} = {value} cannot be: {reason}")]
    Value {
        /// Key.
        key: &'static str,
        /// As written.
        value: f64,
        /// Why.
        reason: String,
    },
}

impl Airframe {
    /// Reads `airframe.toml`.
    ///
    /// # Errors
    /// Not TOML, unknown or missing keys, inconsistent limits.
    ///
    /// # Examples
    /// ```
    /// use gaware_mission::airframe::{Airframe, SMALL_FIXED_WING};
    /// assert_eq!(Airframe::from_toml(SMALL_FIXED_WING)?.speed_cruise_m_per_s, 16.0);
    /// # Ok::<(), gaware_mission::airframe::AirframeError>(())
    /// ```
    pub fn from_toml(text: &str) -> Result<Self, AirframeError> {
        let airframe: Self = toml::from_str(text)
            .map_err(|e| AirframeError::Syntax { message: e.message().to_owned(), span: e.span() })?;
        airframe.validate()?;
        Ok(airframe)
    }

    /// As a file that [`Self::from_toml`] reads.
    ///
    /// # Errors
    /// None that an airframe which was read can bring about.
    pub fn to_toml(&self) -> Result<String, AirframeError> {
        toml::to_string(self).map_err(|e| AirframeError::Syntax { message: e.to_string(), span: None })
    }

    /// One of [`EXAMPLES`] by name.
    pub fn example(name: &str) -> Option<Self> {
        let (_, text) = EXAMPLES.iter().find(|(n, _)| *n == name)?;
        Self::from_toml(text).ok()
    }

    /// Checks every number against its range and the limits against each other; for airframes made in code.
    ///
    /// # Errors
    /// As [`Self::from_toml`].
    pub fn validate(&self) -> Result<(), AirframeError> {
        if self.schema != SCHEMA {
            return Err(AirframeError::Schema(self.schema.clone()));
        }
        checks::run(self)
    }

    /// Radius of a level turn, m, speed in m/s, bank in rad: V²/(g tan φ − Y/cos φ) with the side force Y to the outside of the
    /// turn (balance of forces across the path and in height, Stevens, Lewis & Johnson 2016, section 3.6).
    pub fn turn_radius_m(&self, speed_m_per_s: f64, bank_rad: f64) -> f64 {
        let inward = STANDARD_GRAVITY * tan(bank_rad) * self.turn_share();
        speed_m_per_s * speed_m_per_s / inward
    }

    /// What the side force leaves of the turn that a coordinated aircraft would fly at this bank. The side force goes with
    /// the sine of the bank, see [`Self::side_force_g`]; so this holds at any bank.
    pub fn turn_share(&self) -> f64 {
        1.0 - self.side_force_g * std::f64::consts::SQRT_2
    }

    /// Slowest speed to plan, m/s: where the airspeed sags below its command, so much more is commanded.
    pub fn planned_min_m_per_s(&self) -> f64 {
        (self.speed_min_m_per_s + self.speed_sag_m_per_s).min(self.speed_cruise_m_per_s)
    }

    /// The same airframe flown by this autopilot: ArduPilot alone rounds radii over 255 m, to tens of metres (`ac_mission`).
    #[must_use]
    pub fn flown_by(self, autopilot: Autopilot) -> Self {
        let radius_step_above_255_m = if autopilot == Autopilot::ArduPilot { 10.0 } else { 0.0 };
        Self { autopilot, radius_step_above_255_m, ..self }
    }

    /// Slowest speed that is of use in a maneuver, m/s: a multirotor must arrive.
    pub fn planned_slow_m_per_s(&self) -> f64 {
        self.planned_min_m_per_s().max(0.25 * self.speed_cruise_m_per_s)
    }

    /// Largest bank of a planned steep turn, rad: a share of the limit, and no more than keeps the peak of the load while
    /// rolling into it inside the limit.
    pub fn steep_bank_rad(&self) -> f64 {
        let load = (self.load_factor_max / self.load_overshoot).max(1.05);
        (self.bank_max_deg.to_radians() * STEEP_BANK).min(acos(1.0 / load))
    }

    /// The smallest circle over ground that can be held at this speed (airspeed plus wind, m/s) with bank in reserve, m.
    pub fn planned_radius_m(&self, speed_m_per_s: f64) -> f64 {
        let bank = (self.bank_max_deg.to_radians() * PLANNED_BANK).min(self.steep_bank_rad());
        let radius = self.turn_radius_m(speed_m_per_s, bank);
        radius.max(self.turn_radius_min_m)
    }

    /// The circle of an excitation maneuver at this speed (airspeed plus wind, m/s): as steep as a pilot's steep turn, m.
    pub fn steep_radius_m(&self, speed_m_per_s: f64) -> f64 {
        let radius = self.turn_radius_m(speed_m_per_s, self.steep_bank_rad());
        radius.max(self.turn_radius_min_m)
    }

    /// The radius that the autopilot will store for this one, m; never smaller.
    pub fn stored_radius_m(&self, radius_m: f64) -> f64 {
        let step = if radius_m > 255.0 { self.radius_step_above_255_m.max(1.0) } else { 1.0 };
        (radius_m / step).ceil() * step
    }

    /// The same with these side forces, g; see [`Self::side_force_g`] and [`Self::roll_side_force_g`].
    #[must_use]
    pub fn with_side_force(mut self, turn_g: f64, roll_g: f64) -> Self {
        (self.side_force_g, self.roll_side_force_g) = (turn_g, roll_g);
        self
    }

    /// Whether it has wings.
    pub fn is_fixed_wing(&self) -> bool {
        self.kind == Kind::FixedWing
    }

    /// The same with a name that says that its values come from a flight.
    #[must_use]
    pub fn fitted(mut self) -> Self {
        self.name = format!("{}{FITTED}", self.name.trim_end_matches(FITTED));
        self
    }

    /// Whether its values come from a flight.
    pub fn is_fitted(&self) -> bool {
        self.name.ends_with(FITTED)
    }

    /// `MAV_TYPE`: 1 fixed wing, 2 quadrotor.
    pub fn mav_type(&self) -> u8 {
        if self.is_fixed_wing() { 1 } else { 2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_examples_are_valid_and_survive_a_round_trip() {
        for (name, text) in EXAMPLES {
            let airframe = Airframe::from_toml(text).unwrap_or_else(|e| panic!("{name}: {e}"));
            let written = toml::to_string(&airframe).expect("plain data");
            assert_eq!(Airframe::from_toml(&written), Ok(airframe), "{name}");
        }
        assert_eq!(Airframe::example("balloon"), None);
    }

    #[test]
    fn mistakes_are_named() {
        let cases = [
            ("speed_min_m_per_s = 12.0", "speed_min_m_per_s = 0.0", "a fixed wing cannot hover"),
            ("speed_min_m_per_s = 12.0", "speed_min_m_per_s = 17.0", "above speed_cruise"),
            ("speed_max_m_per_s = 24.0", "speed_max_m_per_s = 14.0", "below speed_cruise"),
            ("bank_max_deg = 50.0", "bank_max_deg = 85.0", "between 5 and 75"),
            ("load_factor_max = 2.5", "load_factor_max = 1.2", "50° bank needs 1.56"),
            ("turn_radius_min_m = 45.0", "turn_radius_min_m = 5.0", "a circle has 17 m"),
            ("climb_max_m_per_s = 4.0", "climb_max_m_per_s = nan", "climb_max_m_per_s = NaN"),
            ("gaware.airframe/1", "gaware.airframe/2", "schema is"),
            ("bank_max_deg", "bank_maximum", "bank_maximum"),
            // An acceleration of nothing asked for an allocation of 273 TB.
            ("acceleration_m_per_s2 = 2.5", "acceleration_m_per_s2 = 1e-9", "between 0.1 and 100"),
            ("acceleration_m_per_s2 = 2.5", "acceleration_m_per_s2 = 0.1", "80 s from 16 to 24 m/s"),
            ("speed_max_m_per_s = 24.0", "speed_max_m_per_s = 1e308", "between 1 and 200"),
            ("maneuvers_max_s = 900.0", "maneuvers_max_s = 1e308", "between 10 and 36000"),
            ("turn_radius_min_m = 45.0", "turn_radius_min_m = 1e308", "between 1 and 10000"),
            ("side_force_g = 0.2", "side_force_g = 0.9", "between 0 and 0.4"),
            ("load_overshoot = 1.5", "load_overshoot = 0.5", "between 1 and 4"),
            ("load_factor_max = 2.5", "load_factor_max = inf", "between 1 and 20"),
        ];
        for (from, to, message) in cases {
            let error = Airframe::from_toml(&SMALL_FIXED_WING.replace(from, to)).expect_err(message);
            assert!(error.to_string().contains(message), "{error}");
        }
    }

    #[test]
    fn radii_are_stored_no_smaller() {
        let small = Airframe::example("small_fixed_wing").expect("shipped");
        assert_eq!([99.2, 256.0, 260.0].map(|r| small.stored_radius_m(r)), [100.0, 260.0, 260.0]);
    }
}
