//! Maneuvers: what to fly so that sensor errors show themselves. Each has a pilot's words, mission items at a place for the
//! autopilot, and a predicted flight by command profile for ranking (the paper, section 3 and figures 2 and 3).

mod items;
mod profile;
mod words;

use crate::airframe::Airframe;
use crate::fence::LocalFrame;
use crate::item::MissionItem;
use crate::kinematics::{Extent, Kinematics, RotorState, WingCommand, WingState};
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

pub(crate) use items::{join as join_items, speed_item};
pub use words::Words;

/// A direction of turning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Counter-clockwise from above.
    Left,
    /// Clockwise from above.
    Right,
}

impl Side {
    /// +1 for right, −1 for left.
    pub fn sign(self) -> f64 {
        match self {
            Self::Left => -1.0,
            Self::Right => 1.0,
        }
    }
}

/// The maneuvers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Maneuver {
    /// Straight, faster and slower: column x of G, attitude against accelerometer bias.
    VaryingSpeed,
    /// Steady turn: column z of G, gyro scale factors, heading.
    SteadyTurn(Side),
    /// Climb with a pull at its start and a push at its end.
    Climb,
    /// Descent.
    Descent,
    /// Pull-ups and push-overs: f_z away from −1 g with the wings level.
    PullUp,
    /// A circle to the right and one to the left.
    FigureEight,
    /// Fixed wing: a steep circle in the climb and another in the descent, fast: columns x and z of G while the turn keeps the heading known.
    Spiral(Side),
    /// The paper's flight: varying acceleration, steady turn, deceleration, climb.
    PaperSequence,
    /// Multirotor: fast legs forward, sideways and diagonally with the nose held, so that drag and acceleration
    /// excite every axis.
    CrabLegs,
    /// Fixed wing: wings level, rudder left then right: column y of G. Autopilots do not fly it.
    Sideslip,
    /// Gentle circles both ways, slow and then fast: wind apart from the scale of an airspeed, a port in the flow, a compass on all headings.
    TwoSpeedCircles,
    /// Multirotor: a full turn of the nose in hover, right and then left: a compass apart from the motors.
    YawTurns,
    /// Multirotor: straight up and down in hover: throttle apart from the flow.
    HoverSteps,
}

impl Maneuver {
    /// Every maneuver that this airframe can fly, manual ones included.
    pub fn all(airframe: &Airframe) -> Vec<Self> {
        use Maneuver::*;
        let mut all = vec![
            VaryingSpeed,
            SteadyTurn(Side::Right),
            SteadyTurn(Side::Left),
            Climb,
            Descent,
            PullUp,
            FigureEight,
            PaperSequence,
        ];
        if airframe.is_fixed_wing() {
            all.extend([Spiral(Side::Right), Spiral(Side::Left), Sideslip]);
        } else {
            all.push(CrabLegs);
        }
        all
    }

    /// Those that show the sensors beside the inertial unit, flown by the autopilot.
    pub fn for_sensors(airframe: &Airframe) -> Vec<Self> {
        let mut all = Self::automatic(airframe);
        all.push(Self::TwoSpeedCircles);
        if !airframe.is_fixed_wing() {
            all.extend([Self::YawTurns, Self::HoverSteps]);
        }
        all
    }

    /// Those that the autopilot can fly.
    pub fn automatic(airframe: &Airframe) -> Vec<Self> {
        Self::all(airframe).into_iter().filter(|m| !m.is_manual_only()).collect()
    }

    /// Whether the heading of its placement changes nothing.
    pub fn is_symmetric(self) -> bool {
        matches!(self, Self::SteadyTurn(_) | Self::YawTurns | Self::HoverSteps)
    }

    /// The side to which it turns, where it turns to one side only.
    pub fn side(self) -> Option<Side> {
        match self {
            Self::SteadyTurn(side) | Self::Spiral(side) => Some(side),
            _ => None,
        }
    }

    /// Whether it is a climbing and descending circle.
    pub fn is_spiral(self) -> bool {
        matches!(self, Self::Spiral(_))
    }

    /// Whether only a pilot can fly it.
    pub fn is_manual_only(self) -> bool {
        self == Self::Sideslip
    }

    /// The instruction for the pilot.
    pub fn words(self, airframe: &Airframe) -> Words {
        words::of(self, airframe)
    }

    /// How long a pilot flies it, s.
    pub fn duration_s(self, airframe: &Airframe) -> f64 {
        profile::duration_s(self, airframe)
    }

    /// The flight when a pilot flies it from this entry, sampled every [`crate::kinematics::STEP_S`], with the time
    /// counted from its start.
    pub fn kinematics(self, airframe: &Airframe, entry: &Entry, wind_ned: &Vector3<f64>) -> Vec<Kinematics> {
        profile::fly(self, airframe, entry, wind_ned)
    }

    /// What a pilot of a fixed wing commands `t_s` seconds into it.
    pub fn wing_command(self, airframe: &Airframe, t_s: f64) -> WingCommand {
        profile::wing_command(self, airframe, t_s)
    }

    /// The space it takes when a pilot flies it, without wind.
    pub fn extent(self, airframe: &Airframe) -> Extent {
        let entry = Entry::cruising(airframe, Vector3::zeros(), 0.0);
        Extent::of(&self.kinematics(airframe, &entry, &Vector3::zeros()), 0.0)
    }

    /// Mission items that make the autopilot fly it at this place.
    ///
    /// # Errors
    /// It needs more space or height than there is, or a pilot; in words.
    pub fn items(self, airframe: &Airframe, place: &Placement) -> Result<Vec<MissionItem>, NoSpace> {
        items::build(self, airframe, place)
    }
}

/// The vehicle at the entry of a maneuver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Entry {
    /// A fixed wing.
    Wing(WingState),
    /// A multirotor.
    Rotor(RotorState),
}

impl Entry {
    /// Straight and level at cruise speed (multirotor: hovering) with this heading, rad.
    pub fn cruising(airframe: &Airframe, position_ned_m: Vector3<f64>, heading_rad: f64) -> Self {
        if airframe.is_fixed_wing() {
            Self::Wing(WingState::level(position_ned_m, airframe.speed_cruise_m_per_s, heading_rad))
        } else {
            Self::Rotor(RotorState::steady(position_ned_m, Vector3::zeros(), heading_rad))
        }
    }
}

/// Where a maneuver is flown by the autopilot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Local frame; its origin is the origin of all north-east values.
    pub frame: LocalFrame,
    /// Centre, north and east, m.
    pub center_m: Vector2<f64>,
    /// Radius around the centre that no item may leave, m: what the fence leaves after its margin.
    pub space_m: f64,
    /// Direction of straight runs, rad.
    pub heading_rad: f64,
    /// Height above home, m.
    pub height_m: f64,
    /// Lowest and highest height above home that items may have, m.
    pub band_m: [f64; 2],
    /// Wind speed, m/s.
    pub wind_m_per_s: f64,
}

/// Why a maneuver does not fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoSpace {
    /// Sideways.
    #[error("needs {needed_m:.0} m around its centre, {space_m:.0} m are there")]
    Radius {
        /// Radius needed, m.
        needed_m: f64,
        /// Radius there is, m.
        space_m: f64,
    },
    /// Up and down.
    #[error("needs a band of {needed_m:.0} m of height, {there_m:.0} m are there")]
    Height {
        /// Height needed, m.
        needed_m: f64,
        /// Height there is, m.
        there_m: f64,
    },
    /// Not for autopilots, or not for this airframe.
    #[error("{0}")]
    NotFlown(&'static str),
}

#[cfg(test)]
mod tests;
