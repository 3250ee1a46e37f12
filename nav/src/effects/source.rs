//! Faults of a source: finished samples whose axes are swapped or reversed, or whose unit is another one. Discrete: there or
//! not, without parameters. They stand beside the design's table, not in it: no one estimates or plans for them, but an
//! explanation names them, and a model that holds one is simulated and undone like any other.

use super::{ActsOn, Effect, ParameterGroup, sequence};
use crate::earth::STANDARD_GRAVITY;
use crate::sample::ImuSample;
use nalgebra::Vector3;

/// Which sensor of the inertial unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sensor {
    Gyro,
    Accel,
}

/// What the source does to a finished vector. Each is undone by itself, but for the factor.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Act {
    Reverse(usize),
    Swap(usize, usize),
    Scale(f64),
}

/// What gyros read in any flight if their unit is deg/s.
const SLOWEST_TURN: f64 = 1.0;

/// One fault.
#[derive(Debug)]
pub struct SourceMistake {
    name: &'static str,
    description: &'static str,
    sensor: Sensor,
    act: Act,
}

impl Act {
    fn apply(self, v: &Vector3<f64>, back: bool) -> Vector3<f64> {
        let mut out = *v;
        match self {
            Self::Reverse(axis) => out[axis] = -v[axis],
            Self::Swap(a, b) => (out[a], out[b]) = (v[b], v[a]),
            Self::Scale(factor) => out *= if back { factor.recip() } else { factor },
        }
        out
    }
}

impl SourceMistake {
    fn on(&self, sensor: Sensor, v: &Vector3<f64>, back: bool) -> Vector3<f64> {
        if self.sensor == sensor { self.act.apply(v, back) } else { *v }
    }
}

impl Effect for SourceMistake {
    of_fault!();

    fn source(&self, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> [Vector3<f64>; 2] {
        [self.on(Sensor::Gyro, gyro, false), self.on(Sensor::Accel, accel, false)]
    }

    fn undo_source(&self, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> [Vector3<f64>; 2] {
        [self.on(Sensor::Gyro, gyro, true), self.on(Sensor::Accel, accel, true)]
    }

    fn changes_unit(&self) -> bool {
        matches!(self.act, Act::Scale(_))
    }

    /// Another unit shows in what is read: of a gyro at rest it would only make the errors smaller (a simulated vehicle whose gyros drifted at rest, and
    /// never read more than .003, was said to report deg/s).
    fn shows_in(&self, samples: &[ImuSample]) -> bool {
        match (self.act, self.sensor) {
            (Act::Scale(_), Sensor::Gyro) => samples.iter().any(|s| s.gyro.amax() > SLOWEST_TURN),
            (Act::Scale(_), Sensor::Accel) => samples.iter().any(|s| s.accel.norm() < 0.5 * STANDARD_GRAVITY),
            _ => true,
        }
    }
}

macro_rules! mistakes {
    ($($name:literal, $description:literal, $sensor:ident, $act:expr;)*) => {
        /// Every known fault of a source.
        pub static MISTAKES: &[&dyn Effect] = &[$(&SourceMistake {
            name: $name,
            description: $description,
            sensor: Sensor::$sensor,
            act: $act,
        },)*
            &sequence::GYRO_CLIPPED,
            &sequence::ACCEL_CLIPPED,
            &sequence::SAMPLES_REPEATED,
        ];
    };
}

mistakes! {
    "gyro_x_reversed", "the x axis of the gyros has the wrong sign", Gyro, Act::Reverse(0);
    "gyro_y_reversed", "the y axis of the gyros has the wrong sign", Gyro, Act::Reverse(1);
    "gyro_z_reversed", "the z axis of the gyros has the wrong sign", Gyro, Act::Reverse(2);
    "gyro_xy_swapped", "the x and y axes of the gyros are swapped", Gyro, Act::Swap(0, 1);
    "gyro_xz_swapped", "the x and z axes of the gyros are swapped", Gyro, Act::Swap(0, 2);
    "gyro_yz_swapped", "the y and z axes of the gyros are swapped", Gyro, Act::Swap(1, 2);
    "gyro_in_deg_per_s", "the gyros are read as rad/s but report deg/s", Gyro, Act::Scale(180.0 / std::f64::consts::PI);
    "accel_x_reversed", "the x axis of the accelerometers has the wrong sign", Accel, Act::Reverse(0);
    "accel_y_reversed", "the y axis of the accelerometers has the wrong sign", Accel, Act::Reverse(1);
    "accel_z_reversed", "the z axis of the accelerometers has the wrong sign", Accel, Act::Reverse(2);
    "accel_xy_swapped", "the x and y axes of the accelerometers are swapped", Accel, Act::Swap(0, 1);
    "accel_xz_swapped", "the x and z axes of the accelerometers are swapped", Accel, Act::Swap(0, 2);
    "accel_yz_swapped", "the y and z axes of the accelerometers are swapped", Accel, Act::Swap(1, 2);
    "accel_in_g", "the accelerometers are read as m/s² but report g", Accel, Act::Scale(1.0 / STANDARD_GRAVITY);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mistake_can_be_undone_and_touches_one_sensor() {
        let (gyro, accel) = (Vector3::new(0.1, -0.2, 0.3), Vector3::new(1.0, 2.0, -9.0));
        for mistake in MISTAKES.iter().filter(|m| !m.needs_neighbours()) {
            let [g, a] = mistake.source(&gyro, &accel);
            assert!((g == gyro) != (a == accel), "{}", mistake.name());
            let [g, a] = mistake.undo_source(&g, &a);
            assert!((g - gyro).norm() < 1e-12 && (a - accel).norm() < 1e-12, "{}", mistake.name());
        }
    }

    #[test]
    fn a_unit_is_what_its_name_says() {
        let find = |name: &str| MISTAKES.iter().find(|m| m.name() == name).unwrap();
        let [gyro, _] = find("gyro_in_deg_per_s").source(&Vector3::new(1.0, 0.0, 0.0), &Vector3::zeros());
        assert!((gyro.x - 57.29578).abs() < 1e-4);
        let [_, accel] = find("accel_in_g").source(&Vector3::zeros(), &Vector3::new(0.0, 0.0, -9.80665));
        assert!((accel.z + 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_unit_shows_in_what_is_read() {
        let find = |name: &str| MISTAKES.iter().find(|m| m.name() == name).unwrap();
        let sample = |rate: f64, force: f64| ImuSample {
            t_s: 0.0,
            gyro: Vector3::new(0.0, rate, 0.0),
            accel: Vector3::new(0.0, 0.0, -force),
            temperature_degc: None,
        };
        let (rest, turn) = ([sample(0.003, 9.8)], [sample(0.003, 9.8), sample(-20.0, 1.0)]);
        for unit in ["gyro_in_deg_per_s", "accel_in_g"] {
            assert!(!find(unit).shows_in(&rest) && find(unit).shows_in(&turn), "{unit}");
        }
        assert!(find("gyro_x_reversed").shows_in(&rest));
    }
}
