//! Second-order non-linearity of the accelerometers: δf_i = k_i f_i² (IEEE Std 1293, the K2 term; own axis only).
//!
//! It also stands for vibration rectification: where f = f̄ + v with zero-mean vibration v, the mean of δf is
//! k (f̄² + σ_v²). The square is taken by the sensor itself, before the autopilot filters and decimates. Two things
//! follow for samples that are only seen decimated:
//!
//! - A simulator must evaluate it at the force *with* the vibration, then filter, then decimate. Decimation
//!   without a filter changes nothing of the mean: the square of a sample is as large on average however few are kept.
//! - A filter that evaluates it at the received samples sees f̄² and only that part of σ_v² that the autopilot's
//!   low-pass let through. The rest, k σ_v², looks like an accelerometer bias that moves with the throttle; the size
//!   of k comes from changes of f̄ alone, and a bias walk or a higher bias sigma has to take the remainder.

use super::{Effect, ImuEffect, Instant, ParameterGroup, Shape, unit};
use nalgebra::Vector3;

/// Three coefficients, one per accelerometer.
#[derive(Debug)]
pub struct AccelNonlinearity;

/// 1 mg/g²: 0.5 % of ±16 g full scale (MPU-6000) is 0.3 mg/g², rectification of consumer parts reaches a few.
const PRIOR_SIGMA: f64 = unit::MG_PER_G2.si;

impl Effect for AccelNonlinearity {
    fn name(&self) -> &'static str {
        "accel_nonlinearity"
    }

    fn description(&self) -> &'static str {
        "the accelerometers respond to the square of specific force, vibration included"
    }

    fn cause(&self) -> &'static str {
        "second-order response of the accelerometers, with vibration also a bias"
    }

    fn remedy(&self) -> &'static str {
        "reduce vibration at the unit, or use a part with a larger range"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::MG_PER_G2,
            shape: Shape::Vector,
            names: &["ka_x", "ka_y", "ka_z"],
            prior_sigma: PRIOR_SIGMA,
        }]
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for AccelNonlinearity {
    fn accel(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        Vector3::from_column_slice(p).component_mul(&x.force).component_mul(&x.force)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, _gyro: &mut [Vector3<f64>], accel: &mut [Vector3<f64>]) {
        for (k, column) in accel.iter_mut().enumerate() {
            column[k] = x.force[k] * x.force[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::STANDARD_GRAVITY;
    use crate::effects::testing::{check_jacobians, instant};

    #[test]
    fn one_milli_g_at_one_g() {
        let p = [unit::MG_PER_G2.si, 0.0, 0.0];
        let added = AccelNonlinearity.accel(&p, &instant([0.0; 3], [-STANDARD_GRAVITY, 5.0, 5.0]));
        assert!((added - Vector3::new(1e-3 * STANDARD_GRAVITY, 0.0, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn vibration_of_zero_mean_leaves_a_mean_however_few_samples_are_kept() {
        let (p, amplitude) = ([1e-3; 3], 3.0);
        for keep in [1_u32, 7, 13] {
            let (mut sum, mut n) = (0.0, 0.0);
            for k in (0..13_000_u32).step_by(keep as usize) {
                let v = amplitude * (f64::from(k) * 0.7).sin();
                sum += AccelNonlinearity.accel(&p, &instant([0.0; 3], [v, 0.0, 0.0])).x;
                n += 1.0;
            }
            let expected = 1e-3 * amplitude * amplitude / 2.0;
            assert!((sum / n / expected - 1.0).abs() < 0.02, "every {keep}: {}", sum / n);
        }
    }

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&AccelNonlinearity);
    }
}
