//! g-sensitivity of the gyros: δω = G f (the paper, eqs. (2), (5) and (21)).

use super::{Effect, Excitation, ImuEffect, Instant, ParameterGroup, Separation, Shape, unit};
use nalgebra::{Matrix3, Vector3};

/// Nine coefficients, row = gyro axis, column = axis of specific force. A diagonal G (the paper's 18 states) is the
/// same effect with the off-diagonal sigmas zero.
#[derive(Debug)]
pub struct GyroGSensitivity;

/// 0.1 deg/s/g, the figure of the MPU-6000's data sheet.
const PRIOR_SIGMA: f64 = 360.0 * unit::DEG_PER_H_PER_G.si;

fn matrix(p: &[f64]) -> Matrix3<f64> {
    Matrix3::from_row_slice(p)
}

impl Effect for GyroGSensitivity {
    fn name(&self) -> &'static str {
        "gyro_g_sensitivity"
    }

    fn description(&self) -> &'static str {
        "the gyros respond to specific force"
    }

    fn cause(&self) -> &'static str {
        "MEMS gyros respond to linear acceleration: a property of the part, larger where the board is bent or its damping is stiff"
    }

    fn remedy(&self) -> &'static str {
        "estimate it in flight and correct rates by G f, or mount the unit on softer, symmetric damping"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::DEG_PER_H_PER_G,
            shape: Shape::Matrix,
            names: &["g11", "g12", "g13", "g21", "g22", "g23", "g31", "g32", "g33"],
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
                fly: &[Excitation::VaryingSpeed, Excitation::PullUp],
                why: "specific force changes while the rates hardly do",
            },
            Separation {
                from: "gyro_g2_sensitivity",
                fly: &[Excitation::PullUp, Excitation::SteadyTurn],
                why: "three loads separate a linear from a quadratic response",
            },
            Separation {
                from: "gyro_bias_drift",
                fly: &[Excitation::FigureEight],
                why: "flown early and again late: what returns with the load is no drift",
            },
            Separation {
                from: "gyro_bias_step",
                fly: &[Excitation::FigureEight],
                why: "flown early and again late: what returns with the load is no step",
            },
        ]
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for GyroGSensitivity {
    fn is_linear(&self) -> bool {
        true
    }

    fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        matrix(p) * x.force
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, gyro: &mut [Vector3<f64>], _accel: &mut [Vector3<f64>]) {
        for (k, column) in gyro.iter_mut().enumerate() {
            column[k / 3] = x.force[k % 3];
        }
    }

    fn gyro_by_force(&self, p: &[f64], _x: &Instant) -> Option<Matrix3<f64>> {
        Some(matrix(p))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{check_jacobians, instant};

    #[test]
    fn adds_g_times_f() {
        let p = [1e-4, 0.0, 0.0, 0.0, 0.0, 2e-4, 0.0, 0.0, 0.0];
        let added = GyroGSensitivity.gyro(&p, &instant([0.0; 3], [2.0, 0.0, -9.8]));
        assert!((added - Vector3::new(2e-4, -19.6e-4, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&GyroGSensitivity);
    }
}
