//! Rotations: exponential map, its Jacobians, Euler angles. Plain geometry, no frames of its own.
//!
//! Names say from and to: `c_eb` turns body vectors into ECEF ones (C_b^e of the paper).

use crate::math::{asin, atan2, cos, sin};
use crate::rss;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// The matrix [v×] with [v×]·w = v × w.
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// Below this angle squared the series of sine and cosine are exact to the last digit after three terms, rad².
const SMALL: f64 = 1e-4;

/// exp([φ×]) as a unit quaternion (Solà 2017, eq. 101).
pub fn exp(phi: &Vector3<f64>) -> UnitQuaternion<f64> {
    let a2 = phi.norm_squared();
    if a2 >= SMALL {
        return UnitQuaternion::from_scaled_axis(*phi);
    }
    let vector = phi * (0.5 - a2 / 48.0 + a2 * a2 / 3840.0);
    let scalar = 1.0 - a2 / 8.0 + a2 * a2 / 384.0;
    UnitQuaternion::new_unchecked(Quaternion::from_parts(scalar, vector))
}

/// Rotation vector of a rotation, |φ| ≤ π (Solà 2017, eq. 105).
pub fn log(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    q.scaled_axis()
}

/// Left Jacobian J(φ) of SO(3): exp(φ + δ) ≈ exp(J δ) exp(φ) (Barfoot 2017, eq. 7.77).
pub fn left_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let a2 = phi.norm_squared();
    let k = skew(phi);
    let (b, c) = if a2 < SMALL {
        (0.5 - a2 / 24.0 + a2 * a2 / 720.0, 1.0 / 6.0 - a2 / 120.0 + a2 * a2 / 5040.0)
    } else {
        let a = a2.sqrt();
        ((1.0 - cos(a)) / a2, (a - sin(a)) / (a2 * a))
    };
    Matrix3::identity() + k * b + k * k * c
}

/// Inverse of [`left_jacobian`] (Barfoot 2017, eq. 7.76b).
pub fn left_jacobian_inverse(phi: &Vector3<f64>) -> Matrix3<f64> {
    let a2 = phi.norm_squared();
    let k = skew(phi);
    let c = if a2 < 1e-6 {
        1.0 / 12.0 + a2 / 720.0
    } else {
        let a = a2.sqrt();
        1.0 / a2 - (1.0 + cos(a)) / (2.0 * a * sin(a))
    };
    Matrix3::identity() - k * 0.5 + k * k * c
}

/// C_b^n from roll, pitch, yaw, rad (Groves 2013, eq. 2.22 transposed).
pub fn c_nb_from_euler(roll: f64, pitch: f64, yaw: f64) -> Matrix3<f64> {
    UnitQuaternion::from_euler_angles(roll, pitch, yaw).to_rotation_matrix().into_inner()
}

/// Nearer to the vertical than this (cosine of pitch) roll and yaw are one angle.
const VERTICAL: f64 = 1e-6;

/// The angle about the vertical from one attitude C_b^n to another, rad, whatever their pitch: that of the rotation about
/// down which comes nearest to C₂ C₁ᵀ.
pub fn yaw_between(from: &Matrix3<f64>, to: &Matrix3<f64>) -> f64 {
    let turn = to * from.transpose();
    atan2(turn[(1, 0)] - turn[(0, 1)], turn[(0, 0)] + turn[(1, 1)])
}

/// Roll, pitch, yaw in rad of C_b^n; yaw in (−π, π] (Groves 2013, eq. 2.23). With the nose straight up or down roll is set
/// to zero and yaw takes the rest.
pub fn euler_from_c_nb(c_nb: &Matrix3<f64>) -> Vector3<f64> {
    if rss(c_nb[(2, 1)], c_nb[(2, 2)]) < VERTICAL {
        let pitch = -asin(c_nb[(2, 0)].clamp(-1.0, 1.0));
        return Vector3::new(0.0, pitch, atan2(-c_nb[(0, 1)], c_nb[(1, 1)]));
    }
    Vector3::new(
        atan2(c_nb[(2, 1)], c_nb[(2, 2)]),
        -asin(c_nb[(2, 0)].clamp(-1.0, 1.0)),
        atan2(c_nb[(1, 0)], c_nb[(0, 0)]),
    )
}

/// An angle brought into (−π, π].
pub fn wrap_pi(angle: f64) -> f64 {
    let a = angle.rem_euclid(std::f64::consts::TAU);
    if a > std::f64::consts::PI { a - std::f64::consts::TAU } else { a }
}

/// An angle in degrees brought into [−180, 180): differences of longitudes and headings.
pub fn wrap_180(angle_deg: f64) -> f64 {
    (angle_deg + 540.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
        [-limit..limit, -limit..limit, -limit..limit].prop_map(Vector3::from)
    }

    #[test]
    fn straight_up_yaw_and_roll_are_one_angle() {
        for pitch in [std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2] {
            let c_nb = c_nb_from_euler(0.7, pitch, 0.4);
            let [roll, again, yaw] = euler_from_c_nb(&c_nb).into();
            assert_eq!(roll, 0.0);
            assert!((c_nb_from_euler(roll, again, yaw) - c_nb).norm() < 1e-6, "{yaw}");
        }
    }

    proptest! {
        #[test]
        fn a_turn_about_the_vertical_is_found_at_any_pitch(
            roll in -3.1..3.1f64, pitch in -1.57..1.57f64, yaw in -3.1..3.1f64, turn in -3.1..3.1f64,
        ) {
            let (from, to) = (c_nb_from_euler(roll, pitch, yaw), c_nb_from_euler(roll, pitch, yaw + turn));
            prop_assert!(wrap_pi(yaw_between(&from, &to) - turn).abs() < 1e-9);
        }

        #[test]
        fn exp_and_log_are_inverse(phi in vector(1.7)) {
            prop_assert!((log(&exp(&phi)) - phi).norm() < 1e-12);
        }

        #[test]
        fn exp_of_a_small_rotation_is_exact(phi in vector(0.01)) {
            let exact = UnitQuaternion::from_scaled_axis(phi);
            prop_assert!((exp(&phi).coords - exact.coords).norm() < 3e-16);
        }

        #[test]
        fn left_jacobian_matches_finite_differences(phi in vector(1.5), delta in vector(1e-6)) {
            let exact = log(&(exp(&(phi + delta)) * exp(&phi).inverse()));
            prop_assert!((exact - left_jacobian(&phi) * delta).norm() < 1e-10);
        }

        #[test]
        fn left_jacobian_inverse_is_the_inverse(phi in vector(1.7)) {
            let product = left_jacobian(&phi) * left_jacobian_inverse(&phi);
            prop_assert!((product - Matrix3::identity()).norm() < 1e-10);
        }

        #[test]
        fn euler_round_trip(roll in -3.1..3.1f64, pitch in -1.5..1.5f64, yaw in -3.1..3.1f64) {
            let back = euler_from_c_nb(&c_nb_from_euler(roll, pitch, yaw));
            prop_assert!((back - Vector3::new(roll, pitch, yaw)).norm() < 1e-9);
        }

        #[test]
        fn wrapping_keeps_the_direction(angle in -50.0..50.0f64) {
            let w = wrap_pi(angle);
            prop_assert!(w > -std::f64::consts::PI - 1e-12 && w <= std::f64::consts::PI);
            prop_assert!((sin(w) - sin(angle)).abs() < 1e-9 && (cos(w) - cos(angle)).abs() < 1e-9);
            let d = wrap_180(angle.to_degrees());
            prop_assert!((-180.0..180.0).contains(&d));
            prop_assert!((sin(d.to_radians()) - sin(angle)).abs() < 1e-9);
            prop_assert!((cos(d.to_radians()) - cos(angle)).abs() < 1e-9);
        }
    }
}
