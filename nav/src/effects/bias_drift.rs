//! Bias random walk: ḃ = w, white w, so that the variance of b grows as q² t (Groves 2013, sec. 4.4.3).
//!
//! The parameter is the density q of a process noise, not a state: no sample depends on it, so it is searched for over
//! likelihoods, not estimated.

use super::{ActsOn, BiasWalk, Effect, Excitation, ParameterGroup, Separation, Shape, unit};

/// Densities to try, deg/h/√h: from a good tactical part to a consumer part that warms up.
const GYRO_SIZES: [f64; 4] = [
    10.0 * unit::DEG_PER_H_PER_RTH.si,
    50.0 * unit::DEG_PER_H_PER_RTH.si,
    200.0 * unit::DEG_PER_H_PER_RTH.si,
    1000.0 * unit::DEG_PER_H_PER_RTH.si,
];
/// Densities to try, mg/√h.
const ACCEL_SIZES: [f64; 4] =
    [unit::MG_PER_RTH.si, 5.0 * unit::MG_PER_RTH.si, 20.0 * unit::MG_PER_RTH.si, 100.0 * unit::MG_PER_RTH.si];

/// The gyro biases follow a random walk.
#[derive(Debug)]
pub struct GyroBiasDrift;

impl Effect for GyroBiasDrift {
    words! {
        name: "gyro_bias_drift",
        description: "the gyro biases follow a random walk",
        cause: "the gyro biases change with warm-up, supply or stress on the board",
        remedy: "let the unit warm up, and allow the bias process noise found",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::DEG_PER_H_PER_RTH,
            shape: Shape::Scalar,
            names: &["gyro_walk"],
            prior_sigma: 0.0,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[Separation {
            from: "gyro_bias_step",
            fly: &[Excitation::FigureEight],
            why: "flown again after some minutes: a step happens once",
        }]
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Biases
    }

    fn bias_walk(&self, p: &[f64]) -> BiasWalk {
        BiasWalk { gyro: p[0].abs(), accel: 0.0 }
    }

    fn sizes_to_try(&self) -> &'static [f64] {
        &GYRO_SIZES
    }
}

/// The accelerometer biases follow a random walk.
#[derive(Debug)]
pub struct AccelBiasDrift;

impl Effect for AccelBiasDrift {
    words! {
        name: "accel_bias_drift",
        description: "the accelerometer biases follow a random walk",
        cause: "the accelerometer biases change with warm-up, vibration or stress on the board",
        remedy: "let the unit warm up, and allow the bias process noise found",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::MG_PER_RTH,
            shape: Shape::Scalar,
            names: &["accel_walk"],
            prior_sigma: 0.0,
        }]
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Biases
    }

    fn bias_walk(&self, p: &[f64]) -> BiasWalk {
        BiasWalk { gyro: 0.0, accel: p[0].abs() }
    }

    fn sizes_to_try(&self) -> &'static [f64] {
        &ACCEL_SIZES
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::STANDARD_GRAVITY;
    use crate::effects::testing::check_jacobians;

    #[test]
    fn the_unit_is_what_an_hour_adds() {
        let after_an_hour = |density: f64| density * 3600.0_f64.sqrt();
        let gyro = GyroBiasDrift.bias_walk(&[50.0 * unit::DEG_PER_H_PER_RTH.si]);
        assert!((after_an_hour(gyro.gyro) - (50.0_f64 / 3600.0).to_radians()).abs() < 1e-12);
        assert_eq!(gyro.accel, 0.0);
        let accel = AccelBiasDrift.bias_walk(&[2.0 * unit::MG_PER_RTH.si]);
        assert!((after_an_hour(accel.accel) - 2e-3 * STANDARD_GRAVITY).abs() < 1e-12);
        assert_eq!(accel.gyro, 0.0);
    }

    #[test]
    fn no_sample_depends_on_the_density() {
        check_jacobians(&GyroBiasDrift);
        check_jacobians(&AccelBiasDrift);
        assert!(!GyroBiasDrift.groups()[0].is_state());
    }
}
