//! Temperature drift of the biases: δω_i = s_i (T − 25 °C) and δf_i = s_i (T − 25 °C) (Groves 2013, sec. 4.4.1).
//!
//! The bias of the model is the one at 25 °C. Where a source brings no temperature the effect adds nothing and cannot
//! be estimated.

use super::{Effect, Excitation, ImuEffect, Instant, ParameterGroup, Separation, Shape, unit};
use nalgebra::Vector3;

/// 0.03 deg/s/°C: data sheets say ±0.005 (ICM-42688-P) to ±20 deg/s from -40 to 85 °C, that is 0.16 (MPU-6000).
const GYRO_PRIOR_SIGMA: f64 = 100.0 * unit::DEG_PER_H_PER_DEGC.si;
/// 0.5 mg/°C: data sheets say ±0.15 (ICM-42688-P) to ±35 mg from 0 to 70 °C, that is 0.5 (MPU-6000, x and y).
const ACCEL_PRIOR_SIGMA: f64 = 0.5 * unit::MG_PER_DEGC.si;

fn drift(p: &[f64], x: &Instant) -> Vector3<f64> {
    Vector3::from_column_slice(p) * x.temperature_above_25_degc
}

fn diagonal(x: &Instant, out: &mut [Vector3<f64>]) {
    for (k, column) in out.iter_mut().enumerate() {
        column[k] = x.temperature_above_25_degc;
    }
}

/// The gyro biases move with temperature.
#[derive(Debug)]
pub struct GyroTemperature;

impl Effect for GyroTemperature {
    fn name(&self) -> &'static str {
        "gyro_temperature"
    }

    fn description(&self) -> &'static str {
        "the gyro biases move with temperature"
    }

    fn cause(&self) -> &'static str {
        "the gyro biases are not compensated for temperature"
    }

    fn remedy(&self) -> &'static str {
        "run the autopilot's temperature calibration, or let it warm up before take-off"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::DEG_PER_H_PER_DEGC,
            shape: Shape::Vector,
            names: &["tg_x", "tg_y", "tg_z"],
            prior_sigma: GYRO_PRIOR_SIGMA,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[
            Separation {
                from: "gyro_bias_drift",
                fly: &[Excitation::FigureEight],
                why: "on a second flight that starts with a warm autopilot: the temperature comes back, a drift does not",
            },
            Separation {
                from: "gyro_bias_step",
                fly: &[Excitation::FigureEight],
                why: "on a second flight that starts with a warm autopilot: the temperature comes back, a step does not",
            },
        ]
    }

    fn needs_temperature(&self) -> bool {
        true
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for GyroTemperature {
    fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        drift(p, x)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, gyro: &mut [Vector3<f64>], _accel: &mut [Vector3<f64>]) {
        diagonal(x, gyro);
    }
}

/// The accelerometer biases move with temperature.
#[derive(Debug)]
pub struct AccelTemperature;

impl Effect for AccelTemperature {
    fn name(&self) -> &'static str {
        "accel_temperature"
    }

    fn description(&self) -> &'static str {
        "the accelerometer biases move with temperature"
    }

    fn cause(&self) -> &'static str {
        "the accelerometer biases are not compensated for temperature"
    }

    fn remedy(&self) -> &'static str {
        "run the autopilot's temperature calibration, or let it warm up before take-off"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::MG_PER_DEGC,
            shape: Shape::Vector,
            names: &["ta_x", "ta_y", "ta_z"],
            prior_sigma: ACCEL_PRIOR_SIGMA,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[Separation {
            from: "accel_bias_drift",
            fly: &[Excitation::FigureEight],
            why: "on a second flight that starts with a warm autopilot: the temperature comes back, a drift does not",
        }]
    }

    fn needs_temperature(&self) -> bool {
        true
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for AccelTemperature {
    fn accel(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        drift(p, x)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, _gyro: &mut [Vector3<f64>], accel: &mut [Vector3<f64>]) {
        diagonal(x, accel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{check_jacobians, instant};

    #[test]
    fn adds_slope_times_degrees_above_25() {
        let x = instant([0.0; 3], [0.0, 0.0, -9.8]);
        let at = |t: f64| Instant { temperature_above_25_degc: t, ..x };
        assert_eq!(GyroTemperature.gyro(&[1e-4, 0.0, 0.0], &at(10.0)), Vector3::new(1e-3, 0.0, 0.0));
        assert_eq!(AccelTemperature.accel(&[0.0, 2e-3, 0.0], &at(-5.0)), Vector3::new(0.0, -1e-2, 0.0));
        assert_eq!(GyroTemperature.gyro(&[1e-4; 3], &at(0.0)), Vector3::zeros());
    }

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&GyroTemperature);
        check_jacobians(&AccelTemperature);
    }
}
