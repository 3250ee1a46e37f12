//! Effects on what measures air, as data: each parameter multiplies one driver and adds it to the height of a barometer, to a speed of the air, or to the specific force of a
//! multirotor along a body axis.
//!
//! A static port in the flow measures p + c q with the dynamic pressure q = ½ρv² by body axis and direction, and the height falls by δp/(ρg)
//! (ArduPilot, `AP_Baro/AP_Baro_Wind.cpp`: `wind_pressure_correction`; PX4, `EKF/aid_sources/barometer/baro_height_control.cpp`:
//! `compensateBaroForDynamicPressure`). A pitot tube shows √(2 δp/ρ₀), the equivalent airspeed (Groves 2013, section 6.2).
//!
//! The thrust of a multirotor is along body z, so that the specific force along x and y is drag (Leishman 2006, section 2.14.6; Mahony, Kumar & Corke 2012): of the rotors in proportion to
//! the speed and to the mass flow √ρ, of the body ½ρv² per ballistic coefficient (PX4, `EKF/aid_sources/drag/drag_fusion.cpp`: `fuseDrag`; ArduPilot,
//! `AP_NavEKF3/AP_NavEKF3_AirDataFusion.cpp`: `FuseDragForces`).

use super::{Effect, ParameterGroup, Shape, unit};
use crate::earth::STANDARD_GRAVITY;
use nalgebra::Vector3;

/// Density of the air at sea level in the standard atmosphere, kg/m³ (ISO 2533).
pub const SEA_LEVEL_DENSITY: f64 = 1.225;

/// What the effects of a barometer and of an airspeed sensor depend on, at one instant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AirInstant {
    /// Velocity against the air in body axes, m/s.
    pub velocity: Vector3<f64>,
    /// Density of the air, kg/m³.
    pub density: f64,
    /// Height above a place of the flight, m.
    pub height_m: f64,
    /// Its derivative, m/s.
    pub climb: f64,
    /// Share of full throttle; 0 where it is not known.
    pub throttle: f64,
    /// Temperature of the sensor less a constant, K; 0 where it is not known.
    pub temperature: f64,
    /// Equivalent airspeed, m/s, and its derivative, m/s².
    pub airspeed: [f64; 2],
    /// What an airspeed sensor with its offset shows, without noise, m/s; 0 where that is not known.
    pub shown: f64,
    /// The body axis of a specific force, 0 or 1.
    pub axis: usize,
    /// Thrust of a multirotor per weight.
    pub thrust: f64,
}

/// What a parameter multiplies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AirDriver {
    /// Height per dynamic pressure along an axis while the vehicle moves against its positive or negative direction: −v²/2g.
    Port(usize, bool),
    /// The same along an axis, whichever the direction.
    PortBoth(usize),
    /// Height per pressure at full throttle.
    Throttle,
    /// How the height of a while ago differs, per second.
    HeightLag,
    /// Temperature of the sensor.
    Temperature,
    /// Height.
    Height,
    /// Equivalent airspeed.
    Speed,
    /// Airspeed per pressure: of v² = u² + 2 δp/ρ₀ the difference v − u is 2 δp/(ρ₀ (v + u)).
    SpeedByPressure,
    /// How the airspeed of a while ago differs, per second.
    SpeedLag,
    /// Specific force by the speed along its axis and the mass flow through the rotors, √ρ relative to sea level.
    RotorDrag,
    /// What that becomes by the root of the thrust, which the mass flow goes with too, less what it is in hover.
    ThrustDrag,
    /// Specific force along this axis by ½ρv².
    BodyDrag(usize),
}

/// Below this airspeed a pressure says nothing of it, m/s.
const LEAST_SPEED: f64 = 3.0;

impl AirDriver {
    /// Its value.
    pub fn value(self, x: &AirInstant) -> f64 {
        let port = |axis: usize| -x.velocity[axis].powi(2) / (2.0 * STANDARD_GRAVITY);
        match self {
            Self::Port(axis, positive) if (x.velocity[axis] >= 0.0) == positive => port(axis),
            Self::Port(..) => 0.0,
            Self::PortBoth(axis) => port(axis),
            Self::Throttle => -x.throttle / (x.density.max(0.1) * STANDARD_GRAVITY),
            Self::HeightLag => -x.climb,
            Self::Temperature => x.temperature,
            Self::Height => x.height_m,
            Self::Speed => x.airspeed[0],
            Self::SpeedByPressure => {
                let shown = if x.shown > 0.0 { x.shown } else { x.airspeed[0] };
                2.0 / (SEA_LEVEL_DENSITY * (x.airspeed[0] + shown).max(2.0 * LEAST_SPEED))
            }
            Self::SpeedLag => -x.airspeed[1],
            Self::RotorDrag => -x.velocity[x.axis] * (x.density / SEA_LEVEL_DENSITY).sqrt(),
            Self::ThrustDrag => Self::RotorDrag.value(x) * (x.thrust.max(0.0).sqrt() - 1.0),
            Self::BodyDrag(axis) if axis == x.axis => {
                -0.5 * x.density * x.velocity[axis] * x.velocity[axis].abs()
            }
            Self::BodyDrag(_) => 0.0,
        }
    }

    /// Whether its parameter is a delay: what is measured is that of another time, and the value above only its derivative.
    pub fn is_delay(self) -> bool {
        matches!(self, Self::HeightLag | Self::SpeedLag)
    }
}

/// One row.
#[derive(Debug, Clone, Copy)]
pub struct AirEffect {
    /// Its fixed name.
    pub name: &'static str,
    /// One line for people.
    pub description: &'static str,
    /// What usually causes it.
    pub cause: &'static str,
    /// What to do about it.
    pub remedy: &'static str,
    /// Units, names, layout and prior of the parameters.
    pub parameters: &'static [ParameterGroup],
    /// One for each parameter.
    pub drivers: &'static [AirDriver],
}

impl AirEffect {
    /// What it adds: m of height, m/s of airspeed or m/s² of specific force.
    pub fn added(&self, p: &[f64], x: &AirInstant) -> f64 {
        self.drivers.iter().zip(p).map(|(d, p)| p * d.value(x)).sum()
    }
}

impl Effect for AirEffect {
    of_row!();

    fn on_air(&self) -> Option<&AirEffect> {
        Some(self)
    }
}

const fn one(unit: super::Unit, names: &'static [&'static str], prior_sigma: f64) -> ParameterGroup {
    ParameterGroup { unit, shape: Shape::Scalar, names, prior_sigma }
}

use AirDriver::{
    BodyDrag, Height, HeightLag, Port, PortBoth, RotorDrag, Speed, SpeedByPressure, SpeedLag, Temperature,
    Throttle, ThrustDrag,
};

/// A static port or a hull in the flow. The prior is 30 % of the dynamic pressure: PX4 allows ±50 % (`EKF2_PCOEF_*`), ArduPilot ±100 %.
pub static BARO_DYNAMIC_PRESSURE: AirEffect = AirEffect {
    name: "baro_dynamic_pressure",
    description: "the height goes with the square of the speed through the air",
    cause: "a static port or openings of the hull that lie in the flow",
    remedy: "shield the barometer from the flow, or apply the pressure coefficients found",
    parameters: &[
        one(unit::PERCENT, &["bp_forward"], 0.3),
        one(unit::PERCENT, &["bp_back"], 0.3),
        one(unit::PERCENT, &["bp_right"], 0.3),
        one(unit::PERCENT, &["bp_left"], 0.3),
        one(unit::PERCENT, &["bp_vertical"], 0.3),
    ],
    drivers: &[Port(0, true), Port(0, false), Port(1, true), Port(1, false), PortBoth(2)],
};

/// Pressure of the propellers' wash. The prior is 40 Pa at full throttle: 3.4 m.
pub static BARO_THRUST: AirEffect = AirEffect {
    name: "baro_thrust",
    description: "the height goes with the throttle",
    cause: "propeller wash on the hull",
    remedy: "move or shield the barometer, or apply the thrust correction found",
    parameters: &[one(unit::PA, &["b_thrust"], 40.0)],
    drivers: &[Throttle],
};

/// Height that is older than its stamp. The prior is .3 s: barometers are filtered over tenths of a second.
pub static BARO_DELAY: AirEffect = AirEffect {
    name: "baro_delay",
    description: "the height is older than its stamp",
    cause: "filters of the barometer, a hull that equalises slowly",
    remedy: "open the static port, or set the delay of the barometer",
    parameters: &[one(unit::S, &["b_delay"], 0.3)],
    drivers: &[HeightLag],
};

/// Height that goes with the temperature of the sensor. The prior is .5 m/K: an MS5611 has up to 4 hPa over its range without its own correction.
pub static BARO_TEMPERATURE: AirEffect = AirEffect {
    name: "baro_temperature",
    description: "the height goes with the temperature of the barometer",
    cause: "a sensor that warms up, or light on it",
    remedy: "cover the barometer, let it warm up, or calibrate it over temperature",
    parameters: &[one(unit::M_PER_DEGC, &["b_temperature"], 0.5)],
    drivers: &[Temperature],
};

/// Height differences that are too large or too small: air that is warmer or colder than the standard atmosphere. The prior is 8 %: 23 K.
pub static BARO_SCALE: AirEffect = AirEffect {
    name: "baro_scale",
    description: "differences of height are too large or too small",
    cause: "air that is warmer or colder than the standard atmosphere, or a sensor with a wrong scale",
    remedy: "none is needed for small heights; else set the ground temperature",
    parameters: &[one(unit::PERCENT, &["b_scale"], 0.08)],
    drivers: &[Height],
};

/// Every effect on a barometer, the simplest first.
pub static BAROMETER: &[&dyn Effect] =
    &[&BARO_DYNAMIC_PRESSURE, &BARO_THRUST, &BARO_DELAY, &BARO_TEMPERATURE, &BARO_SCALE];

/// Airspeed in proportion. The prior is 15 %: pitot tubes differ by 30 % of the ratio (ArduPilot, `ARSPD_RATIO` 1.5 to 2.8).
pub static AIRSPEED_SCALE: AirEffect = AirEffect {
    name: "airspeed_scale",
    description: "the airspeed is too large or too small in proportion",
    cause: "the ratio of the pitot tube, a tube in the flow around the hull",
    remedy: "apply the ratio or scale found",
    parameters: &[one(unit::PERCENT, &["as_scale"], 0.15)],
    drivers: &[Speed],
};

/// A constant differential pressure. The prior is 20 Pa: 1.1 m/s at 15 m/s.
pub static AIRSPEED_OFFSET: AirEffect = AirEffect {
    name: "airspeed_offset",
    description: "a constant pressure adds to the dynamic one",
    cause: "an offset that was calibrated in wind, or water in the tube",
    remedy: "calibrate the airspeed sensor with the tube covered",
    parameters: &[one(unit::PA, &["as_offset"], 20.0)],
    drivers: &[SpeedByPressure],
};

/// Airspeed that is older than its stamp. The prior is .5 s.
pub static AIRSPEED_DELAY: AirEffect = AirEffect {
    name: "airspeed_delay",
    description: "the airspeed is older than its stamp",
    cause: "filters and long tubes",
    remedy: "shorten the tubes, or set the delay of the airspeed",
    parameters: &[one(unit::S, &["as_delay"], 0.5)],
    drivers: &[SpeedLag],
};

/// Every effect on an airspeed sensor.
pub static AIRSPEED: &[&dyn Effect] = &[&AIRSPEED_SCALE, &AIRSPEED_OFFSET, &AIRSPEED_DELAY];

/// What to do about drag: nothing is wrong, but an estimator can find the wind by it.
const KNOW_DRAG: &str = "none is needed; with these coefficients the autopilot can estimate the wind by drag (ArduPilot does as soon as one is in use, PX4 with EKF2_DRAG_CTRL)";

/// Drag of the body. The prior is a ballistic coefficient of 25 kg/m²: PX4 assumes 100, ArduPilot's simulation has 17.
pub static DRAG_QUADRATIC: AirEffect = AirEffect {
    name: "drag_quadratic",
    description: "drag by the square of the speed through the air, along each axis",
    cause: "the area of the body against the flow",
    remedy: KNOW_DRAG,
    parameters: &[one(unit::M2_PER_KG, &["d_body_x"], 0.04), one(unit::M2_PER_KG, &["d_body_y"], 0.04)],
    drivers: &[BodyDrag(0), BodyDrag(1)],
};

/// Momentum drag of rotors. The prior is .2 1/s: PX4 assumes .15, ArduPilot's simulation has .25.
pub static DRAG_ROTOR: AirEffect = AirEffect {
    name: "drag_rotor",
    description: "momentum drag of the rotors: in proportion to the speed through the air",
    cause: "air across the rotor axes that is carried along",
    remedy: KNOW_DRAG,
    parameters: &[one(unit::PER_S, &["d_rotor"], 0.2)],
    drivers: &[RotorDrag],
};

/// Momentum drag that goes with the thrust. Neither firmware knows of it, so that it is a tolerance of the coefficients and never named; ArduPilot's simulated copter has .25.
pub static DRAG_THRUST: AirEffect = AirEffect {
    name: "drag_thrust",
    description: "momentum drag of the rotors goes with the root of the thrust",
    cause: "rotors that turn faster carry more air along",
    remedy: "none is needed",
    parameters: &[one(unit::PER_S, &["d_thrust"], 0.15)],
    drivers: &[ThrustDrag],
};

/// What is named of the drag of a multirotor.
pub static DRAG: &[&dyn Effect] = &[&DRAG_ROTOR, &DRAG_QUADRATIC];

#[cfg(test)]
mod tests {
    use super::*;

    /// The sign conventions that corrections rely on, as the autopilots' formulas have them.
    #[test]
    fn a_port_that_is_pressed_shows_too_low_a_height() {
        let x = AirInstant {
            velocity: Vector3::new(20.0, -3.0, 0.0),
            density: 1.2,
            throttle: 0.5,
            ..AirInstant::default()
        };
        // p + .1 q: 24 Pa more are 2.04 m less.
        let low = BARO_DYNAMIC_PRESSURE.added(&[0.1, 9.0, 9.0, 0.0, 0.0], &x);
        assert!((low + 0.1 * 0.5 * 1.2 * 400.0 / (1.2 * STANDARD_GRAVITY)).abs() < 1e-9, "{low}");
        assert!(BARO_DYNAMIC_PRESSURE.added(&[0.0, 0.0, 0.0, 0.2, 0.0], &x) < 0.0);
        assert!(BARO_THRUST.added(&[24.0], &x) < 0.0);
        let shown = (2.0 * (0.5 * SEA_LEVEL_DENSITY * 15f64.powi(2) - 35.0) / SEA_LEVEL_DENSITY).sqrt();
        let slow = AIRSPEED_OFFSET.added(&[-35.0], &AirInstant { airspeed: [15.0, 0.0], shown, ..x });
        assert!((slow - (shown - 15.0)).abs() < 1e-9, "35 Pa too little at 15 m/s: {slow}");
        assert!(
            BAROMETER.iter().chain(AIRSPEED).all(|e| e.on_air().is_some_and(|a| a.drivers.len() == e.len()))
        );
    }
}
