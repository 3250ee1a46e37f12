//! Lever arm: the antenna does not sit where the inertial unit sits (Groves 2013, eqs. 14.124 and 14.125).

use super::{ActsOn, Effect, FixInstant, ParameterGroup, Shape, unit};
use crate::rotation::skew;
use nalgebra::{Matrix3, Vector3};

/// The antenna of a small vehicle that was not measured, m.
const TOLERANCE_M: f64 = 0.3;

/// Position of the antenna relative to the inertial unit: forward, right, down.
#[derive(Debug)]
pub struct GpsLeverArm;

impl Effect for GpsLeverArm {
    words! {
        name: "gps_lever_arm",
        description: "the GNSS antenna sits away from the inertial unit",
        cause: "the antenna does not sit where the inertial unit sits",
        remedy: "compare the antenna position that is set (ArduPilot GPS1_POS_X/Y/Z, PX4 SENS_GPS0_OFFX/Y/Z; before 4.6 and 1.18 GPS_POS1_X/Y/Z, EKF2_GPS_POS_X/Y/Z) with the values found",
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::M,
            shape: Shape::Vector,
            names: &["lever_x", "lever_y", "lever_z"],
            prior_sigma: 1.0,
        }]
    }

    fn tolerance(&self) -> Option<f64> {
        Some(TOLERANCE_M)
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        what == ActsOn::Fixes
    }

    fn fix(&self, p: &[f64], x: &FixInstant) -> [Vector3<f64>; 2] {
        let arm = Vector3::from_column_slice(p);
        let (s2, speed) = (x.antenna.kernel.smoothing_s2, x.c_nb * x.rate_eb.cross(&arm));
        let [acceleration, jerk] = x.derivatives_of(&arm);
        [x.c_nb * arm + acceleration * s2, speed + jerk * s2]
    }

    fn arm(&self, p: &[f64]) -> Vector3<f64> {
        Vector3::from_column_slice(p)
    }

    fn fix_jacobian(
        &self,
        _p: &[f64],
        x: &FixInstant,
        position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
    ) {
        let along = |k: usize| Vector3::from_fn(|i, _| f64::from(u8::from(i == k)));
        for k in 0..3 {
            [position[k], velocity[k]] = self.fix(along(k).as_slice(), x);
        }
    }

    fn fix_by_attitude(&self, p: &[f64], x: &FixInstant) -> Option<[Matrix3<f64>; 2]> {
        let arm = Vector3::from_column_slice(p);
        Some([-x.c_nb * skew(&arm), -x.c_nb * skew(&x.rate_eb.cross(&arm))])
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{cos, sin};

    use super::*;
    use crate::effects::testing::{check_jacobians, fix_instant};
    use crate::effects::{Antenna, Kernel};
    use crate::rotation::exp;

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&GpsLeverArm);
    }

    /// An antenna on a nose that swings: a receiver that reports the middle of two epochs, against that middle itself.
    #[test]
    fn the_path_of_the_antenna_is_smoothed_and_not_that_of_the_unit() {
        let (arm, apart, swing) = ([1.2, 0.4, -0.3], 0.1, 2.5);
        let yaw = |t: f64| 0.3 * sin(swing * t);
        let rate = |t: f64| 0.3 * swing * cos(swing * t);
        let at = |t: f64| {
            let antenna = Antenna {
                kernel: Kernel { smoothing_s2: 0.5 * apart * apart, skew_s3: 0.0 },
                arm: arm.into(),
                rate_derivatives: [-swing * swing * yaw(t), -swing * swing * rate(t)]
                    .map(|r| Vector3::new(0.0, 0.0, r)),
            };
            let c_nb = crate::rotation::c_nb_from_euler(0.0, 0.0, yaw(t));
            FixInstant { c_nb, rate_eb: Vector3::new(0.0, 0.0, rate(t)), antenna, ..fix_instant() }
        };
        let sharp = |t: f64| GpsLeverArm.fix(&arm, &FixInstant { antenna: Antenna::default(), ..at(t) });
        for t in [0.0, 0.2, 0.7] {
            let ([p0, v0], [p1, v1]) = (sharp(t - apart), sharp(t + apart));
            let [p, v] = GpsLeverArm.fix(&arm, &at(t));
            assert!((p - (p0 + p1) * 0.5).norm() < 1e-4, "{p}");
            assert!((v - (v0 + v1) * 0.5).norm() < 1e-3, "{v}");
        }
    }

    #[test]
    fn attitude_jacobian_matches_finite_differences() {
        let x = fix_instant();
        let p = [0.5, -0.3, 0.2];
        let Some([dp, dv]) = GpsLeverArm.fix_by_attitude(&p, &x) else { panic!("a lever arm turns") };
        for k in 0..3 {
            let mut e = Vector3::zeros();
            e[k] = 1e-6;
            let turned = FixInstant { c_nb: x.c_nb * exp(&e).to_rotation_matrix().into_inner(), ..x };
            let [p0, v0] = GpsLeverArm.fix(&p, &x);
            let [p1, v1] = GpsLeverArm.fix(&p, &turned);
            assert!(((p1 - p0) * 1e6 - dp.column(k)).norm() < 1e-5);
            assert!(((v1 - v0) * 1e6 - dv.column(k)).norm() < 1e-5);
        }
    }
}
