//! Effects: the named ways in which a real sensor differs from an ideal one.
//!
//! What is linear in its parameters is a row of the `catalogue`: acts on, drivers, parameters with units and prior sigmas, words. Code, one
//! file per effect, is only what is not: delays, lever arms, steps, drifts, sources. Simulator, filter, smoother and explanation all use that one definition through [`Effect`].
//! Contributions are evaluated at the *true* rate and specific force and add up: ω̃ = ω + Σ gyro(ω, f),
//! f̃ = f + Σ accel(f) (the paper, eqs. (1) and (2), generalised); biases are not effects but part of every model.

/// The methods of [`Effect`] that say in words what it is.
macro_rules! words {
    (name: $name:literal, description: $description:literal, $(cause: $cause:literal, remedy: $remedy:literal,)?) => {
        fn name(&self) -> &'static str {
            $name
        }

        fn description(&self) -> &'static str {
            $description
        }

        $(
            fn cause(&self) -> &'static str {
                $cause
            }

            fn remedy(&self) -> &'static str {
                $remedy
            }
        )?
    };
}

/// Those that a row of any table answers from its own fields.
macro_rules! named {
    () => {
        fn name(&self) -> &'static str {
            self.name
        }

        fn description(&self) -> &'static str {
            self.description
        }
    };
}

/// Those that a row of effects with parameters answers so.
macro_rules! of_row {
    () => {
        named!();

        fn cause(&self) -> &'static str {
            self.cause
        }

        fn remedy(&self) -> &'static str {
            self.remedy
        }

        fn groups(&self) -> &'static [ParameterGroup] {
            self.parameters
        }
    };
}

/// Those that a row of faults of a source does: each is there or not.
macro_rules! of_fault {
    () => {
        named!();

        fn groups(&self) -> &'static [ParameterGroup] {
            &[]
        }

        fn acts_on(&self, what: ActsOn) -> bool {
            what == ActsOn::Source
        }
    };
}

mod accel_lever_arm;
mod air;
mod bias_drift;
mod catalogue;
mod clock_drift;
pub mod data;
mod effect;
mod field;
mod gps_bias_step;
mod gps_latency;
mod gps_lever_arm;
mod gps_smoothing;
mod gps_velocity_latency;
mod gyro_accel_delay;
mod gyro_bias_step;
mod imu_truncation;
mod instant;
mod linear;
mod parameters;
mod sequence;
mod source;

use crate::rss;
use nalgebra::Vector3;

pub use accel_lever_arm::AccelLeverArm;
pub use air::{
    AIRSPEED, AIRSPEED_DELAY, AIRSPEED_OFFSET, AIRSPEED_SCALE, AirDriver, AirEffect, AirInstant, BARO_DELAY,
    BARO_DYNAMIC_PRESSURE, BARO_SCALE, BARO_TEMPERATURE, BARO_THRUST, BAROMETER, DRAG, DRAG_QUADRATIC,
    DRAG_ROTOR, DRAG_THRUST, SEA_LEVEL_DENSITY,
};
pub use bias_drift::{AccelBiasDrift, GyroBiasDrift};
pub use catalogue::{
    ACCEL_MISALIGNMENT, ACCEL_NONLINEARITY, ACCEL_SCALE_FACTOR, ACCEL_TEMPERATURE, GYRO_G_SENSITIVITY,
    GYRO_G2_SENSITIVITY, GYRO_MISALIGNMENT, GYRO_SCALE_FACTOR, GYRO_TEMPERATURE, VIBRATION_RECTIFICATION,
};
pub use clock_drift::ClockDrift;
pub use effect::{ActsOn, Effect};
pub use field::{
    COMPASS, CompassEffect, FieldEffect, FieldInstant, MAG_CURRENT, MAG_DECLINATION, MAG_DELAY,
    MAG_HARD_IRON, MAG_ROTATION, MAG_SOFT_IRON,
};
pub use gps_bias_step::GpsBiasStep;
pub use gps_latency::GpsLatency;
pub use gps_lever_arm::GpsLeverArm;
pub use gps_smoothing::GpsSmoothing;
pub use gps_velocity_latency::GpsVelocityLatency;
pub use gyro_accel_delay::GyroAccelDelay;
pub use gyro_bias_step::GyroBiasStep;
pub use imu_truncation::ImuTruncation;
pub use instant::{Antenna, Conditions, FixInstant, Instant, Kernel, LateRate, Older, Surroundings};
pub use linear::{Driver, LinearEffect, Sensor};
pub use parameters::{ParameterGroup, Shape, Unit, unit};
pub use source::MISTAKES;

/// The largest number of parameters of one effect.
pub const MAX_PARAMETERS: usize = 9;

/// Every effect that exists, in the order of the design's table. Adding one adds a line here.
pub static REGISTRY: &[&dyn Effect] = &[
    &GYRO_G_SENSITIVITY,
    &GYRO_G2_SENSITIVITY,
    &GYRO_SCALE_FACTOR,
    &ACCEL_SCALE_FACTOR,
    &GYRO_MISALIGNMENT,
    &ACCEL_MISALIGNMENT,
    &ACCEL_NONLINEARITY,
    &GYRO_TEMPERATURE,
    &ACCEL_TEMPERATURE,
    &GpsLatency,
    &GpsVelocityLatency,
    &GyroAccelDelay,
    &AccelLeverArm,
    &VIBRATION_RECTIFICATION,
    &ClockDrift,
    &GpsLeverArm,
    &ImuTruncation,
    &GyroBiasDrift,
    &AccelBiasDrift,
    &GpsBiasStep,
    &GyroBiasStep,
];

/// What every receiver does; outside the registry, since it is not tested.
pub static RECEIVER: &dyn Effect = &GpsSmoothing;

/// The effect of this name, if there is one: of the design's table, a fault of a source, of another sensor, what every receiver does, or an effect that is
/// data: one that a file defined, or a formula.
pub fn find(name: &str) -> Option<&'static dyn Effect> {
    let sensors = COMPASS.iter().chain(BAROMETER).chain(AIRSPEED).chain(DRAG);
    let built_in =
        REGISTRY.iter().chain(MISTAKES).chain(sensors).copied().chain([RECEIVER]).find(|e| e.name() == name);
    built_in.or_else(|| data::find(name))
}

/// A walk of the accelerometer biases from which on they shake, m/s²/√s: 16 mg in 10 s, where 2 mg/°C and 20 °C in five minutes make 1.3.
const SHAKING_WALK: f64 = 0.05;

/// Spectral densities (square roots) of random walks that an effect adds to the biases.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BiasWalk {
    /// rad/s per √s.
    pub gyro: f64,
    /// m/s² per √s.
    pub accel: f64,
}

impl BiasWalk {
    /// Both at once: walks that know nothing of each other add up in variance.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self { gyro: rss(self.gyro, other.gyro), accel: rss(self.accel, other.accel) }
    }

    /// Whether accelerometers that walk like this shake or clip: no warm-up changes their biases so fast.
    pub fn shakes(&self) -> bool {
        self.accel >= SHAKING_WALK
    }
}

/// The last samples of a source, for faults that show from sample to sample. Gyro, rad/s, and accelerometer, m/s².
#[derive(Debug, Clone, Copy)]
pub struct ReportedSample {
    /// Raw, as the sensors measured it.
    pub raw: [Vector3<f64>; 2],
    /// As it was reported.
    pub reported: [Vector3<f64>; 2],
    /// How many samples have been reported.
    pub count: u64,
}

/// Motion that makes an effect show by itself, in the terms of a flight plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Excitation {
    /// Straight, faster and slower.
    VaryingSpeed,
    /// A steady turn.
    SteadyTurn,
    /// Pull-ups and push-overs with the wings level.
    PullUp,
    /// A circle to the right and one to the left.
    FigureEight,
    /// Wings level, rudder left then right; sideways legs on a multirotor.
    Sideslip,
}

/// What separates an effect from another one that imitates it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Separation {
    /// Name of the other effect.
    pub from: &'static str,
    /// What to fly.
    pub fly: &'static [Excitation],
    /// Why that separates them.
    pub why: &'static str,
}

/// From where a study draws the first parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DrawRange {
    /// Around zero with the prior sigma, like all the others.
    Prior,
    /// Its logarithm evenly between two values, SI.
    LogUniform(f64, f64),
    /// Evenly between two values, SI.
    Uniform(f64, f64),
}

/// What jumps at the instant of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// The gyro biases.
    GyroBias,
    /// The position of the fixes.
    FixPosition,
}

#[cfg(test)]
pub(crate) mod testing;

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn names_are_unique_and_fit_their_shapes() {
        let effects: BTreeSet<_> = REGISTRY.iter().map(|e| e.name()).collect();
        assert_eq!(effects.len(), REGISTRY.len());
        let mut parameters = BTreeSet::new();
        for effect in REGISTRY {
            assert!(effect.len() <= MAX_PARAMETERS, "{}", effect.name());
            for group in effect.groups() {
                assert_eq!(group.names.len(), group.shape.len(), "{}", effect.name());
                assert!(group.names.iter().all(|n| parameters.insert(*n)), "{}", effect.name());
            }
        }
    }

    /// The contract of `model.toml`: users' files and reports carry these names.
    #[test]
    fn the_registry_is_the_designs_table() {
        let table = [
            ("gyro_g_sensitivity", "deg_per_h_per_g:9"),
            ("gyro_g2_sensitivity", "deg_per_h_per_g2:3"),
            ("gyro_scale_factor", "ppm:3"),
            ("accel_scale_factor", "ppm:3"),
            ("gyro_misalignment", "mrad:6"),
            ("accel_misalignment", "mrad:3"),
            ("accel_nonlinearity", "mg_per_g2:3"),
            ("gyro_temperature", "deg_per_h_per_degc:3"),
            ("accel_temperature", "mg_per_degc:3"),
            ("gps_latency", "s:1"),
            ("gps_velocity_latency", "s:1"),
            ("gyro_accel_delay", "s:1"),
            ("accel_lever_arm", "m:3"),
            ("vibration_rectification", "mg_per_g2:3"),
            ("clock_drift", "ppm:1"),
            ("gps_lever_arm", "m:3"),
            ("imu_truncation", ""),
            ("gyro_bias_drift", "deg_per_h_per_rth:1"),
            ("accel_bias_drift", "mg_per_rth:1"),
            ("gps_bias_step", "s:1 m:3"),
            ("gyro_bias_step", "s:1 deg_per_h:3"),
        ];
        let found: Vec<_> = REGISTRY
            .iter()
            .map(|e| {
                let groups = e.groups().iter().map(|g| format!("{}:{}", g.unit.suffix, g.shape.len()));
                (e.name(), groups.collect::<Vec<_>>().join(" "))
            })
            .collect();
        let wanted: Vec<_> = table.iter().map(|(name, keys)| (*name, (*keys).to_owned())).collect();
        assert_eq!(found, wanted);
    }

    #[test]
    fn what_is_no_state_is_set_or_searched_for() {
        for effect in REGISTRY {
            let searched: Vec<_> = effect.groups().iter().filter(|g| !g.is_state()).collect();
            for group in &searched {
                assert_eq!(group.shape, Shape::Scalar, "{}", effect.name());
            }
            assert!(searched.len() <= 1, "{}", effect.name());
            let alone = searched.len() == 1 && effect.len() == 1;
            assert_eq!(alone, !effect.sizes_to_try().is_empty(), "{}", effect.name());
        }
    }
}
