//! What a linear filter leaves out: products of errors.
//!
//! With C = Ĉ exp(ε), f = f̂ + δf and ω = ω̂ + δω the navigation errors are driven by ½ ε×(ε×f) + ε×δf and by ½ ε×δω besides what
//! is linear, and the gyros' compensation by the product of G's error and δf. In maneuvers the errors become small before that
//! matters. Where nothing excites them, tilt and accelerometer bias stay a degree and tens of mg wrong for as long as the flight
//! is smooth, and their products, constant over minutes, are inconsistent with what linear theory learns from a thousand fixes: a heading
//! that drifts seems to part tilt from bias. So the products are counted as a slow walk of the biases, with the variance that
//! the present covariance gives them (the second-order filter: Bar-Shalom, Li & Kirubarajan 2001, section 10.3.2, with the
//! correlation in time that these terms have).

use super::Filter;
use super::calibration::MotionJacobian;
use super::layout::index;
use crate::mechanization::Motion;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Products of errors stay as they are for about so long, s.
const LASTING_S: f64 = 10.0;
/// They are counted this often, s.
const EVERY_S: f64 = 1.0;
/// Attitude errors count up to this variance, rad²: beyond, nothing is linear, and alignment is not done.
const LARGEST_ATTITUDE: f64 = 4.0;

/// Errors of attitude, specific force and rate.
pub(super) const ERRORS: usize = 9;
pub(super) const FORCE: usize = 3;
const RATE: usize = 6;

type Square = SMatrix<f64, ERRORS, ERRORS>;

impl Filter {
    /// Lets the biases walk by what the filter leaves out, where it is time for that.
    pub(super) fn walk_by_products(&mut self) {
        let since_s = self.t_s - self.products_s;
        if since_s < EVERY_S {
            return;
        }
        self.products_s = self.t_s;
        let p = self.covariance_of_errors();
        let [rate, force] = self.products_of_errors(&p);
        let share = since_s.min(LASTING_S) / LASTING_S;
        for k in 0..3 {
            self.p.add_variance(index::GYRO_BIAS + k, rate[k] * share);
            self.p.add_variance(index::ACCEL_BIAS + k, force[k] * share);
        }
    }

    /// Mean squares of the products of errors, per axis: of the rate, (rad/s)², and of the specific force, (m/s²)².
    fn products_of_errors(&self, p: &Square) -> [Vector3<f64>; 2] {
        let f = self.judged.force;
        let force = Vector3::from_fn(|i, _| mean_square(&(tilted(i, &f) + cross_product(i, FORCE)), p));
        let rate = Vector3::from_fn(|i, _| mean_square(&(cross_product(i, RATE) * 0.5), p));
        let variances = p.diagonal().fixed_rows::<3>(FORCE).into_owned();
        [rate + self.sensitivity_times_force(&self.judged, &variances), force]
    }

    /// Mean squares, per axis, of what ½ ε×(ε×v) adds to vectors that only the attitude turns: rate and specific force.
    pub(super) fn products_of_tilt(&self, motion: &Motion) -> [Vector3<f64>; 2] {
        let p = self.covariance_of_errors();
        [motion.rate, motion.force].map(|v| Vector3::from_fn(|i, _| mean_square(&tilted(i, &v), &p)))
    }

    /// Covariance of [ε δf δω].
    pub(super) fn covariance_of_errors(&self) -> Square {
        let tail = index::GYRO_BIAS;
        let rows: [Vec<(usize, f64)>; ERRORS] = std::array::from_fn(|i| {
            let columns = if i < RATE { &self.jacobian.force } else { &self.jacobian.rate };
            match i {
                0..FORCE => vec![(index::ATTITUDE + i, 1.0)],
                _ => columns
                    .iter()
                    .enumerate()
                    .filter(|(_, c)| c[i % 3] != 0.0)
                    .map(|(k, c)| (tail + k, c[i % 3]))
                    .collect(),
            }
        });
        let mut p = Square::zeros();
        for i in 0..ERRORS {
            for j in 0..=i {
                let sum = rows[i]
                    .iter()
                    .flat_map(|(a, x)| rows[j].iter().map(move |(b, y)| x * y * self.p.at(*a, *b)))
                    .sum();
                (p[(i, j)], p[(j, i)]) = (sum, sum);
            }
        }
        let attitude = p.diagonal().iter().take(FORCE).sum::<f64>();
        let less = (LARGEST_ATTITUDE / attitude.max(LARGEST_ATTITUDE)).sqrt();
        p.view_mut((0, 0), (FORCE, ERRORS)).scale_mut(less);
        p.view_mut((0, 0), (ERRORS, FORCE)).scale_mut(less);
        p
    }

    /// Mean squares of what errors of the specific force with these variances, (m/s²)², make of the errors of whatever multiplies it in
    /// the gyros, (rad/s)².
    pub(super) fn sensitivity_times_force(&self, at: &Motion, variances: &Vector3<f64>) -> Vector3<f64> {
        let Some(last) = self.last else { return Vector3::zeros() };
        let jacobian = |at: &Motion| {
            let mut out = MotionJacobian::default();
            self.about.calibration.jacobian(&self.model, &self.layout, &last, at, &mut out);
            out.rate
        };
        let (here, mut sum) = (jacobian(at), Vector3::zeros());
        for axis in 0..3 {
            let mut moved = *at;
            moved.force[axis] += variances[axis].max(0.0).sqrt();
            for (k, (a, b)) in jacobian(&moved).iter().zip(&here).enumerate() {
                let variance = self.p.sigma(index::GYRO_BIAS + k).powi(2);
                sum += (a - b).map(|d| d * d * variance);
            }
        }
        sum
    }
}

/// Axis `i` of ½ ε×(ε×f) as uᵀ A u.
fn tilted(i: usize, f: &Vector3<f64>) -> Square {
    let mut a = Square::zeros();
    for j in 0..3 {
        a[(i, j)] += 0.25 * f[j];
        a[(j, i)] += 0.25 * f[j];
        a[(j, j)] -= 0.5 * f[i];
    }
    a
}

/// Axis `i` of ε × x as uᵀ A u, with x at `other`.
fn cross_product(i: usize, other: usize) -> Square {
    let mut a = Square::zeros();
    let unit = Matrix3::<f64>::identity();
    for j in 0..3 {
        for k in 0..3 {
            let sign = unit.column(j).cross(&unit.column(k))[i];
            a[(j, other + k)] += 0.5 * sign;
            a[(other + k, j)] += 0.5 * sign;
        }
    }
    a
}

/// E (uᵀ A u)² of a Gaussian u: (tr A P)² + 2 tr (A P)² (Isserlis' theorem).
fn mean_square(a: &Square, p: &Square) -> f64 {
    let ap = a * p;
    ap.trace().powi(2) + 2.0 * (ap * ap).trace()
}
