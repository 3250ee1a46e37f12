//! Scale-factor errors of gyros and accelerometers: δω_i = s_i ω_i, δf_i = s_i f_i (Groves 2013, eqs. 4.16, 4.17).

use super::{Effect, Excitation, ImuEffect, Instant, ParameterGroup, Separation, Shape, unit};
use nalgebra::Vector3;

/// 3000 ppm: consumer MEMS after factory calibration.
const PRIOR_SIGMA: f64 = 3000.0 * unit::PPM.si;

fn scaled(p: &[f64], v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::from_column_slice(p).component_mul(v)
}

fn diagonal(v: &Vector3<f64>, out: &mut [Vector3<f64>]) {
    for (k, column) in out.iter_mut().enumerate() {
        column[k] = v[k];
    }
}

/// The gyros read too much or too little in proportion to the rate.
#[derive(Debug)]
pub struct GyroScaleFactor;

impl Effect for GyroScaleFactor {
    fn name(&self) -> &'static str {
        "gyro_scale_factor"
    }

    fn description(&self) -> &'static str {
        "the gyros read too much or too little in proportion to the rate"
    }

    fn cause(&self) -> &'static str {
        "factory calibration of the gyros, their temperature, or a driver with the wrong sensitivity"
    }

    fn remedy(&self) -> &'static str {
        "calibrate the gyros on a rate table, or correct rates by the values found"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::PPM,
            shape: Shape::Vector,
            names: &["sg_x", "sg_y", "sg_z"],
            prior_sigma: PRIOR_SIGMA,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[Separation {
            from: "gyro_misalignment",
            fly: &[Excitation::FigureEight, Excitation::Sideslip],
            why: "rotation about one axis at a time",
        }]
    }

    fn tolerance(&self) -> Option<f64> {
        Some(PRIOR_SIGMA)
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for GyroScaleFactor {
    fn is_linear(&self) -> bool {
        true
    }

    fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        scaled(p, &x.rate)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, gyro: &mut [Vector3<f64>], _accel: &mut [Vector3<f64>]) {
        diagonal(&x.rate, gyro);
    }
}

/// The accelerometers read too much or too little in proportion to the specific force.
#[derive(Debug)]
pub struct AccelScaleFactor;

impl Effect for AccelScaleFactor {
    fn name(&self) -> &'static str {
        "accel_scale_factor"
    }

    fn description(&self) -> &'static str {
        "the accelerometers read too much or too little in proportion to the specific force"
    }

    fn cause(&self) -> &'static str {
        "factory calibration of the accelerometers, or an accelerometer calibration in positions that were not level"
    }

    fn remedy(&self) -> &'static str {
        "repeat the six-position accelerometer calibration"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::PPM,
            shape: Shape::Vector,
            names: &["sa_x", "sa_y", "sa_z"],
            prior_sigma: PRIOR_SIGMA,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[
            Separation {
                from: "accel_nonlinearity",
                fly: &[Excitation::SteadyTurn, Excitation::PullUp],
                why: "three loads separate a linear from a quadratic response",
            },
            Separation {
                from: "accel_misalignment",
                fly: &[Excitation::Sideslip, Excitation::VaryingSpeed],
                why: "one axis after the other feels a force of its own",
            },
        ]
    }

    fn tolerance(&self) -> Option<f64> {
        Some(PRIOR_SIGMA)
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for AccelScaleFactor {
    fn is_linear(&self) -> bool {
        true
    }

    fn accel(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        scaled(p, &x.force)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, _gyro: &mut [Vector3<f64>], accel: &mut [Vector3<f64>]) {
        diagonal(&x.force, accel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{check_jacobians, instant};

    #[test]
    fn a_thousand_ppm_is_a_thousandth() {
        let x = instant([0.1, 0.2, 0.3], [1.0, 2.0, 3.0]);
        assert!((GyroScaleFactor.gyro(&[1e-3, 0.0, 0.0], &x) - Vector3::new(1e-4, 0.0, 0.0)).norm() < 1e-15);
        assert!(
            (AccelScaleFactor.accel(&[0.0, 0.0, 1e-3], &x) - Vector3::new(0.0, 0.0, 3e-3)).norm() < 1e-15
        );
    }

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&GyroScaleFactor);
        check_jacobians(&AccelScaleFactor);
    }
}
