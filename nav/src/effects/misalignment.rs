//! Misalignment (cross coupling) of the sensitive axes (Groves 2013, eqs. 4.16 and 4.17, off-diagonal part).
//!
//! The accelerometers get an upper triangle only: a common rotation of the whole triad is a rotation of the body
//! axes themselves and no flight could separate it from attitude.

use super::{Effect, Excitation, ImuEffect, Instant, ParameterGroup, Separation, Shape, unit};
use nalgebra::Vector3;

/// 3 mrad: consumer MEMS after factory calibration.
const PRIOR_SIGMA: f64 = 3.0 * unit::MRAD.si;

/// Row and column of the six off-diagonal elements, row by row.
const OFF_DIAGONAL: [(usize, usize); 6] = [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)];
/// Row and column of the upper triangle.
const UPPER: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

fn coupled(cells: &[(usize, usize)], p: &[f64], v: &Vector3<f64>) -> Vector3<f64> {
    let mut out = Vector3::zeros();
    for (&(row, column), &m) in cells.iter().zip(p) {
        out[row] += m * v[column];
    }
    out
}

fn columns(cells: &[(usize, usize)], v: &Vector3<f64>, out: &mut [Vector3<f64>]) {
    for (&(row, column), slot) in cells.iter().zip(out) {
        slot[row] = v[column];
    }
}

/// The gyro axes are not square to each other or to the body.
#[derive(Debug)]
pub struct GyroMisalignment;

impl Effect for GyroMisalignment {
    fn name(&self) -> &'static str {
        "gyro_misalignment"
    }

    fn description(&self) -> &'static str {
        "each gyro also reads a part of the rate about the other axes"
    }

    fn cause(&self) -> &'static str {
        "the gyro axes are not square to each other or to the body: tolerance of the part or a tilted mounting"
    }

    fn remedy(&self) -> &'static str {
        "correct rates by the matrix found, or calibrate on a rate table"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::MRAD,
            shape: Shape::MatrixWithoutDiagonal,
            names: &["mg_xy", "mg_xz", "mg_yx", "mg_yz", "mg_zx", "mg_zy"],
            prior_sigma: PRIOR_SIGMA,
        }]
    }

    fn tolerance(&self) -> Option<f64> {
        Some(PRIOR_SIGMA)
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for GyroMisalignment {
    fn is_linear(&self) -> bool {
        true
    }

    fn gyro(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        coupled(&OFF_DIAGONAL, p, &x.rate)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, gyro: &mut [Vector3<f64>], _accel: &mut [Vector3<f64>]) {
        columns(&OFF_DIAGONAL, &x.rate, gyro);
    }
}

/// The accelerometer axes are not square to each other.
#[derive(Debug)]
pub struct AccelMisalignment;

impl Effect for AccelMisalignment {
    fn name(&self) -> &'static str {
        "accel_misalignment"
    }

    fn description(&self) -> &'static str {
        "the accelerometers also read a part of the specific force along the other axes"
    }

    fn cause(&self) -> &'static str {
        "the accelerometer axes are not square to each other: tolerance of the part"
    }

    fn remedy(&self) -> &'static str {
        "correct specific force by the matrix found"
    }

    fn groups(&self) -> &'static [ParameterGroup] {
        &[ParameterGroup {
            unit: unit::MRAD,
            shape: Shape::UpperTriangle,
            names: &["ma_xy", "ma_xz", "ma_yz"],
            prior_sigma: PRIOR_SIGMA,
        }]
    }

    fn separations(&self) -> &'static [Separation] {
        &[Separation {
            from: "accel_nonlinearity",
            fly: &[Excitation::Sideslip, Excitation::VaryingSpeed],
            why: "one axis after the other feels a force of its own",
        }]
    }

    fn tolerance(&self) -> Option<f64> {
        Some(PRIOR_SIGMA)
    }

    fn on_samples(&self) -> Option<&dyn ImuEffect> {
        Some(self)
    }
}

impl ImuEffect for AccelMisalignment {
    fn is_linear(&self) -> bool {
        true
    }

    fn accel(&self, p: &[f64], x: &Instant) -> Vector3<f64> {
        coupled(&UPPER, p, &x.force)
    }

    fn imu_jacobian(&self, _p: &[f64], x: &Instant, _gyro: &mut [Vector3<f64>], accel: &mut [Vector3<f64>]) {
        columns(&UPPER, &x.force, accel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::{check_jacobians, instant};

    #[test]
    fn couples_row_with_column() {
        let x = instant([0.1, 0.2, 0.3], [1.0, 2.0, 3.0]);
        let added = GyroMisalignment.gyro(&[0.0, 1e-3, 0.0, 0.0, 0.0, 0.0], &x);
        assert!((added - Vector3::new(3e-4, 0.0, 0.0)).norm() < 1e-15);
        let added = AccelMisalignment.accel(&[0.0, 0.0, 1e-3], &x);
        assert!((added - Vector3::new(0.0, 3e-3, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn jacobians_match_finite_differences() {
        check_jacobians(&GyroMisalignment);
        check_jacobians(&AccelMisalignment);
    }
}
