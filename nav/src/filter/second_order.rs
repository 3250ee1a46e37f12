//! What a linear filter leaves out: products of errors.
//!
//! With C = Ĉ exp(ψ u) exp(a), f = f̂ + δf and ω = ω̂ + δω (see [`Displacement`](crate::displacement::Displacement)) the navigation errors are
//! driven by products of these beside what is linear, and the gyros' compensation by the product of G's error and δf. In maneuvers
//! the errors become small before that matters. Where nothing excites them, tilt and accelerometer bias stay a degree and tens of mg wrong for
//! as long as the flight is smooth, and their products, constant over minutes, are inconsistent with what linear theory learns from a thousand fixes. So the products are
//! counted as a slow walk of the biases, with the variance that the present covariance gives them (the second-order filter: Bar-Shalom, Li &
//! Kirubarajan 2001, section 10.3.2, with the correlation in time that these terms have). In the coordinates of one rotation vector a heading
//! that drifts would multiply tilt and biases each by itself, and hours of cruise ended with accelerometer biases of 0.35 m/s².

use super::Filter;
use super::calibration::MotionJacobian;
use super::layout::index;
use crate::displacement::LARGE_TILT;
use crate::earth;
use crate::mechanization::Motion;
use nalgebra::{SMatrix, Vector3};

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
        let nav = &self.about.nav;
        // With a tilt that is not known an attitude error is one rotation vector (see [`Displacement`]).
        let down = if self.tilt_sigma() > LARGE_TILT { Vector3::zeros() } else { nav.down_b() };
        let terms =
            Products { down, force: self.to.lever.force, earth: nav.q_eb.inverse() * earth::rotation_rate() };
        let [rate, force] = terms.forms().map(|axes| Vector3::from(axes.map(|a| mean_square(&a, p))));
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

/// The products of errors that a linear filter leaves out, with C = Ĉ exp(ψ u) exp(a), f = f̂ + δf and ω = ω̂ + δω to second order.
struct Products {
    /// u.
    down: Vector3<f64>,
    /// f̂.
    force: Vector3<f64>,
    /// The Earth's rate in body axes, rad/s.
    earth: Vector3<f64>,
}

impl Products {
    /// What they add to the rates of change of attitude and velocity errors, as bilinear forms of errors [ε δf δω]: of D f − f̂ with
    /// D = exp(ψ u) exp(a), and of Ḋ = D (δω + ω_e) − ω_e D, both as cross products, with the Earth's rate ω_e. A heading turns what the
    /// vehicle is seen to do, not what its sensors say: beside an acceleration it multiplies only what tilt and accelerometers are wrong
    /// by together, and of the rate the Earth's alone.
    fn of(&self, x: &[Vector3<f64>; 3], y: &[Vector3<f64>; 3]) -> [Vector3<f64>; 2] {
        let parts = |v: &Vector3<f64>| {
            let heading = self.down * self.down.dot(v);
            (heading, v - heading)
        };
        let ((heading, tilt), (other_heading, other_tilt)) = (parts(&x[0]), parts(&y[0]));
        let half =
            |by: &Vector3<f64>, other: &Vector3<f64>, v: &Vector3<f64>| by.cross(&other.cross(v)) * 0.5;
        let turn = |v: &Vector3<f64>| half(&heading, &other_heading, v) + half(&tilt, &other_tilt, v);
        let of_rate = y[2] + y[0].cross(&self.earth);
        let rate = tilt.cross(&(of_rate + parts(&of_rate).0)) * 0.5
            - turn(&self.earth)
            - tilt.cross(&other_heading.cross(&self.earth));
        let force = turn(&self.force) + heading.cross(&other_tilt.cross(&self.force)) + x[0].cross(&y[1]);
        [rate, force]
    }

    /// Each axis of both as uᵀ A u with symmetric A.
    fn forms(&self) -> [[Square; 3]; 2] {
        let mut forms = [[Square::zeros(); 3]; 2];
        let unit = |k: usize| {
            let mut parts = [Vector3::zeros(); 3];
            parts[k / 3][k % 3] = 1.0;
            parts
        };
        for j in 0..ERRORS {
            for k in 0..ERRORS {
                for (form, product) in forms.iter_mut().zip(self.of(&unit(j), &unit(k))) {
                    for (a, value) in form.iter_mut().zip(product.iter()) {
                        a[(j, k)] += 0.5 * value;
                        a[(k, j)] += 0.5 * value;
                    }
                }
            }
        }
        forms
    }
}

/// E (uᵀ A u)² of a Gaussian u: (tr A P)² + 2 tr (A P)² (Isserlis' theorem).
fn mean_square(a: &Square, p: &Square) -> f64 {
    let ap = a * p;
    ap.trace().powi(2) + 2.0 * (ap * ap).trace()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::displacement::Displacement;
    use crate::mechanization::NavState;
    use crate::rotation::{c_nb_from_euler, exp};
    use proptest::prelude::*;

    fn small(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-size..size).prop_map(Vector3::from)
    }

    proptest! {
        /// What the exact equations leave of the errors' rates of change once the linear part is taken off, to third order.
        #[test]
        fn products_are_what_the_linear_equations_leave_out(
            eps in small(0.02), force_error in small(0.2), rate_error in small(0.01), yaw in -3.0..3.0f64, roll in -1.0..1.0f64,
        ) {
            const STEP_S: f64 = 1e-4;
            let place = earth::Geodetic::from_degrees(47.0, 8.0, 400.0);
            let nav = NavState::from_ned(place, &Vector3::zeros(), &c_nb_from_euler(roll, 0.3, yaw));
            let down = nav.down_b();
            // A planet that turns as fast as the errors, so that its share is seen.
            let terms = Products { down, force: Vector3::new(2.0, -1.0, -9.0), earth: Vector3::new(0.1, 0.3, -0.2) };
            let errors = [eps, force_error, rate_error];
            let [rate, force] = terms.of(&errors, &errors);

            let displaced = nav.displaced(&Displacement { attitude: eps, ..Displacement::default() });
            let d = nav.q_eb.inverse() * displaced.q_eb;
            let exact = d * (terms.force + force_error) - terms.force;
            let linear = eps.cross(&terms.force) + force_error;
            prop_assert!((exact - linear - force).norm() < 5e-4, "{} {force}", exact - linear);

            let later = |by_s: f64| {
                let turned = exp(&(terms.earth * -by_s)) * d * exp(&((rate_error + terms.earth) * by_s));
                nav.displacement_of(&NavState { q_eb: nav.q_eb * turned, ..nav }).attitude
            };
            let exact = (later(STEP_S) - later(-STEP_S)) / (2.0 * STEP_S);
            let linear = rate_error + eps.cross(&terms.earth);
            prop_assert!((exact - linear - rate).norm() < 5e-5, "{} {rate}", exact - linear);
        }
    }
}
