//! g²-sensitivity of the gyros: δω_i = k_i f_i² (IEEE Std 1431, the g² term of the drift model; own axis only).
//!
//! Under vibration the mean of f² is f̄² + σ², so it also stands for the vibration rectification of a gyro.

use super::{Effect, Excitation, ImuEffect, Instant, ParameterGroup, Separation, Shape, unit};
use nalgebra::{Matrix3, Vector3};

/// Three coefficients, one per gyro, each of the specific force along its own axis.
#[derive(Debug)]
pub struct GyroG2Sensitivity;

/// 0.01 deg/s/g²: a tenth of the linear prior at 1 g; data sheets that state it (ADXRS646: 1e-4 deg/s/g²) stay below.
const PRIOR_SIGMA: f64 = 36.0 * unit::DEG_PER_H_PER_G2.si;

impl Effect for GyroG2Sensitivity {
    fn name(&self) -> &'static str {
        "gyro_g2_sensitivity"
    }

    fn description(&self) -> &'static str {
        "the gyros respond to the square of specific force"
    }

    fn cause(&self) -> &'static str {
        "MEMS gyros rectify strong or vibrating acceleration"
    }

    fn remedy(&self) -> &'static str {
        "reduce vibration at the unit; keep the values in the model"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::DEG_PER_H_PER_G2,
            shape: Shape::Vector,
            names: &["g2_x", "g2_y", "g2_z"],
            prior_sigma: PRIOR_SIGMA,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[
            Separation {
                from: "gyro_misalignment",
                fly: &[Excitation::PullUp],
                why: "specific force changes while the rates about roll and yaw do not",
            },
            Separation {
                from: "gyro_scale_factor",
                fly: &[Excitation::PullUp],
                why: "specific force changes while the rates about roll and yaw do not",
            },
        ]
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for GyroG2Sensitivity {
    fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        Vector3::from_column_slice(p).component_mul(&x.force).component_mul(&x.force)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, gyro: &mut [Vector3<f64>], _accel: &mut [Vector3<f64>]) {
        for (k, column) in gyro.iter_mut().enumerate() {
            column[k] = x.force[k] * x.force[k];
        }
    }

    fn gyro_by_force(&self, p: &[f64], x: &Instant) -> Option<Matrix3<f64>> {
        Some(Matrix3::from_diagonal(&(Vector3::from_column_slice(p).component_mul(&x.force) * 2.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{check_jacobians, instant};

    #[test]
    fn does_not_know_the_sign_of_the_force() {
        let p = [1e-5, 2e-5, 3e-5];
        let up = GyroG2Sensitivity.gyro(&p, &instant([0.0; 3], [1.0, -2.0, 10.0]));
        let down = GyroG2Sensitivity.gyro(&p, &instant([0.0; 3], [-1.0, 2.0, -10.0]));
        assert_eq!(up, down);
        assert!((up - Vector3::new(1e-5, 8e-5, 3e-3)).norm() < 1e-15);
    }

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&GyroG2Sensitivity);
    }
}
