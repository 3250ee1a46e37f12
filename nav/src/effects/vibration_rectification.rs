//! Vibration rectification: δf_i = k_i σ_i², a bias that goes with the power of the vibration on the axis (IEEE Std 1293, "vibration
//! rectification error"; data sheets give it in mg/g²).
//!
//! Unlike [`AccelNonlinearity`](super::AccelNonlinearity) it does not respond to the steady force: it comes from what the mounting and
//! the sensor's loop make of fast motion. σ² is the variance of the samples above a few hertz, as they were received: where the autopilot
//! filters them first, k is per received power and larger than the data sheet's.

use super::{Effect, Excitation, ImuEffect, Instant, ParameterGroup, Separation, Shape, unit};
use nalgebra::Vector3;

/// 10 mg/g²: data sheets say 0.1 (quartz) to some tens (ADXL355: 0.4 g at 7.5 g RMS is 7).
const PRIOR_SIGMA: f64 = 10.0 * unit::MG_PER_G2.si;

/// Three coefficients, one per accelerometer.
#[derive(Debug)]
pub struct VibrationRectification;

impl Effect for VibrationRectification {
    fn name(&self) -> &'static str {
        "vibration_rectification"
    }

    fn description(&self) -> &'static str {
        "the accelerometer biases move with the power of vibration"
    }

    fn cause(&self) -> &'static str {
        "asymmetric response of the accelerometers or of their mounting to strong vibration"
    }

    fn remedy(&self) -> &'static str {
        "mount the unit on softer dampers and balance propellers"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::MG_PER_G2,
            shape: Shape::Vector,
            names: &["kv_x", "kv_y", "kv_z"],
            prior_sigma: PRIOR_SIGMA,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[
            Separation {
                from: "accel_nonlinearity",
                fly: &[Excitation::VaryingSpeed, Excitation::PullUp],
                why: "throttle changes the vibration, a pull-up the steady force",
            },
            Separation {
                from: "accel_bias_drift",
                fly: &[Excitation::VaryingSpeed],
                why: "the bias comes back with the throttle, a drift does not",
            },
            Separation {
                from: "accel_temperature",
                fly: &[Excitation::VaryingSpeed],
                why: "the bias follows the throttle at once, the temperature slowly",
            },
        ]
    }

    fn needs_vibration(&self) -> bool {
        true
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for VibrationRectification {
    fn needs_surroundings(&self) -> bool {
        true
    }

    fn accel(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        Vector3::from_column_slice(p).component_mul(&x.around.vibration)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, _gyro: &mut [Vector3<f64>], accel: &mut [Vector3<f64>]) {
        accel.iter_mut().enumerate().for_each(|(k, column)| column[k] = x.around.vibration[k]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::STANDARD_GRAVITY;
    use crate::effects::Surroundings;
    use crate::effects::testing::{check_jacobians, instant};

    #[test]
    fn ten_milli_g_at_one_g_of_vibration_whatever_the_steady_force() {
        let p = [10.0 * unit::MG_PER_G2.si, 0.0, 0.0];
        let power = STANDARD_GRAVITY * STANDARD_GRAVITY;
        let around = Surroundings { vibration: Vector3::new(power, power, 0.0), ..Surroundings::default() };
        for force in [0.0, -30.0] {
            let x = Instant { around, ..instant([0.1; 3], [force; 3]) };
            let added = VibrationRectification.accel(&p, &x);
            assert!((added - Vector3::new(0.01 * STANDARD_GRAVITY, 0.0, 0.0)).norm() < 1e-12, "{added}");
        }
        check_jacobians(&VibrationRectification);
    }
}
