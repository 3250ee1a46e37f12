//! What an effect that is data adds to.

use super::expression::Expression;
use crate::effects::{Unit, unit};

/// What an effect that is data adds to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Body axes, rad/s.
    Gyro,
    /// Body axes, m/s².
    Accel,
    /// Position of a fix: north, east, down, m.
    Position,
    /// Velocity of a fix: north, east, down, m/s.
    Velocity,
}

impl Target {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Gyro, Self::Accel, Self::Position, Self::Velocity];

    /// In files and in names of formulas.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gyro => "gyro",
            Self::Accel => "accel",
            Self::Position => "position",
            Self::Velocity => "velocity",
        }
    }

    /// The one of this name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|t| t.name() == name)
    }

    /// Whether it is a fix, not a sensor.
    pub fn is_of_fix(self) -> bool {
        matches!(self, Self::Position | Self::Velocity)
    }

    /// Whether its axes turn with the vehicle: a fix driven by `heading` itself. An angle that jumps at ±180° drives nothing.
    pub(super) fn turns_with(self, driver: &Expression) -> bool {
        self.is_of_fix() && driver.text() == "heading"
    }

    /// What it is printed in.
    pub fn unit(self) -> Unit {
        match self {
            Self::Gyro => unit::DEG_PER_H,
            Self::Accel => unit::MG,
            Self::Position => unit::M,
            Self::Velocity => unit::M_PER_S,
        }
    }

    /// Its unit in SI.
    pub fn si_unit(self) -> &'static str {
        match self {
            Self::Gyro => "rad/s",
            Self::Accel => "m/s2",
            Self::Position => "m",
            Self::Velocity => "m/s",
        }
    }

    /// Its axes.
    pub fn axes(self) -> &'static [&'static str; 3] {
        if self.is_of_fix() { &["north", "east", "down"] } else { &["x", "y", "z"] }
    }

    /// The beginning of a sentence.
    pub(super) fn goes_with(self) -> &'static str {
        match self {
            Self::Gyro => "the gyros go with",
            Self::Accel => "the accelerometers go with",
            Self::Position => "the position of fixes goes with",
            Self::Velocity => "the velocity of fixes goes with",
        }
    }

    /// A disturbance of a consumer unit or receiver, in SI.
    pub fn disturbance(self) -> f64 {
        match self {
            Self::Gyro => 3e-3,
            Self::Accel => 0.1,
            Self::Position => 2.0,
            Self::Velocity => 0.3,
        }
    }

    /// Whether this may drive it: a fix has neither the temperature nor the vibration of the inertial unit.
    pub(super) fn can_have(self, driver: &Expression) -> bool {
        !self.is_of_fix() || !(driver.needs_temperature() || driver.needs_vibration())
    }
}
