//! Lever arm of the accelerometers: they sit away from the place that position and velocity belong to, where the gyros are.
//!
//! f̃ = f + ω̇ × l + ω × (ω × l) (Groves 2013, eq. 2.66 with a constant arm; IEEE Std 1780, "size effect"). Gyros of a rigid body read
//! the same everywhere, so accelerometers at l with the antenna at a show exactly what accelerometers at 0 with the antenna
//! at a − l do: no motion separates the two, only a tape measure does. So it is tested where the model gives the place of
//! the antenna.

use super::{ActsOn, Effect, Instant, ParameterGroup, Separation, Shape, unit};
use crate::rotation::skew;
use nalgebra::{Matrix3, Vector3};

/// Sensors of two boards in one airframe, m.
const PRIOR_SIGMA_M: f64 = 0.3;

/// Position of the accelerometers relative to the gyros: forward, right, down.
#[derive(Debug)]
pub struct AccelLeverArm;

/// Acceleration of a point by its position: [ω̇]× + [ω]×².
fn by_arm(x: &Instant) -> Matrix3<f64> {
    let w = skew(&x.rate);
    skew(&x.around.rate_derivatives[0]) + w * w
}

impl Effect for AccelLeverArm {
    words! {
        name: "accel_lever_arm",
        description: "the accelerometers sit away from the gyros",
        cause: "accelerometers and gyros on different boards, or a position of the inertial unit that is entered wrongly",
        remedy: "measure the distance from accelerometers to antenna and set it (INS_POS1_X/Y/Z, EKF2_IMU_POS_X/Y/Z)",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::M,
            shape: Shape::Vector,
            names: &["accel_lever_x", "accel_lever_y", "accel_lever_z"],
            prior_sigma: PRIOR_SIGMA_M,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[Separation {
            from: "gps_lever_arm",
            fly: &[],
            why: "no motion separates them: measure the place of the antenna and give it to the model",
        }]
    }

    fn needs_known(&self) -> Option<&'static str> {
        Some("gps_lever_arm")
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Samples
    }

    fn needs_surroundings(&self) -> bool {
        true
    }

    fn accel(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        by_arm(x) * Vector3::from_column_slice(p)
    }

    fn accel_by_rate(&self, p: &[f64], x: &Instant) -> Option<Matrix3<f64>> {
        let (l, w) = (Vector3::from_column_slice(p), &x.rate);
        Some(Matrix3::from_diagonal_element(w.dot(&l)) + w * l.transpose() - l * w.transpose() * 2.0)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, _gyro: &mut [Vector3<f64>], accel: &mut [Vector3<f64>]) {
        let by_arm = by_arm(x);
        accel.iter_mut().enumerate().for_each(|(k, column)| *column = by_arm.column(k).into());
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin};

    use super::*;
    use crate::effects::Surroundings;
    use crate::effects::testing::{check_jacobians, instant};

    /// A point on a swinging arm, against its own path.
    #[test]
    fn the_acceleration_of_a_point_is_that_of_its_path() {
        let arm = [0.5, -0.2, 0.1];
        let angle = |t: f64| 0.4 * sin(3.0 * t);
        let c = |t: f64| crate::rotation::c_nb_from_euler(0.0, 0.0, angle(t));
        let path = |t: f64| c(t) * Vector3::from(arm);
        let (t, h) = (0.3, 1e-4);
        let exact = c(t).transpose() * (path(t + h) - path(t) * 2.0 + path(t - h)) / (h * h);
        let about_z = |v: f64| Vector3::new(0.0, 0.0, v);
        let around = Surroundings {
            rate_derivatives: [about_z(-3.6 * sin(3.0 * t)), Vector3::zeros()],
            ..Surroundings::default()
        };
        let x = Instant { around, ..instant([0.0, 0.0, 1.2 * cos(3.0 * t)], [0.0; 3]) };
        let found = AccelLeverArm.accel(&arm, &x);
        assert!((found - exact).norm() < 1e-5, "{found} {exact}");
    }

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&AccelLeverArm);
    }
}
