//! Errors of position, velocity and attitude as coordinates about an estimate.
//!
//! An error first turns the estimate about the vertical, then displaces it in its own body axes:
//! C = Ĉ exp(ψ u) exp(a), v = v̂ + Ĉ exp(ψ u) J(a) δv, r = r̂ + Ĉ exp(ψ u) J(a) δr, with u the vertical in body axes and a ⟂ u. To
//! first order ε = ψ u + a is the left-invariant error of SE₂(3) (Barrau & Bonnabel 2017, section V). Gravity makes the difference
//! beyond first order: tilt is tied to the accelerometers in *body* axes and knows nothing of the heading, so that in
//! these coordinates a heading that was wrong by a radian, once it is known, leaves everything else that is known as it was. In those
//! of one rotation vector it turns the tilt by half of its error against the accelerometer biases, which is inconsistent with what a
//! thousand fixes have shown of their sum.

use crate::earth;
use crate::math::atan2;
use crate::mechanization::NavState;
use crate::rotation::{exp, left_jacobian, left_jacobian_inverse, log};
use nalgebra::{UnitQuaternion, Vector3};

/// With a tilt that is wrong by more than this, rad, nothing is known in body axes, and one rotation vector is the better coordinate.
pub(crate) const LARGE_TILT: f64 = 0.1;

/// An error of position, m, velocity, m/s, and attitude, rad, in body axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Displacement {
    /// δr.
    pub position: Vector3<f64>,
    /// δv.
    pub velocity: Vector3<f64>,
    /// ε = ψ u + a.
    pub attitude: Vector3<f64>,
}

impl Displacement {
    /// From the first nine entries of an error.
    pub fn of(error: &[f64]) -> Self {
        let part = |at: usize| error.get(at..at + 3).map_or_else(Vector3::zeros, Vector3::from_column_slice);
        Self { position: part(0), velocity: part(3), attitude: part(6) }
    }

    /// Its nine entries: position, velocity, attitude.
    pub fn entries(&self) -> impl Iterator<Item = f64> {
        [self.position, self.velocity, self.attitude].into_iter().flat_map(|v| [v.x, v.y, v.z])
    }
}

impl NavState {
    /// The vertical in body axes: a unit vector down.
    pub fn down_b(&self) -> Vector3<f64> {
        self.q_eb.inverse() * earth::c_en_at(&self.r_e).column(2)
    }

    /// The part of an attitude error that turns about the vertical, and the rest; all of it is the rest where the tilt is
    /// unknown too.
    pub fn heading_and_tilt(&self, attitude: &Vector3<f64>) -> [Vector3<f64>; 2] {
        let down = self.down_b();
        let heading = down * down.dot(attitude);
        let tilt = attitude - heading;
        if tilt.norm_squared() > LARGE_TILT * LARGE_TILT {
            [Vector3::zeros(), *attitude]
        } else {
            [heading, tilt]
        }
    }

    /// The state that is off from this one by `error`.
    #[must_use]
    pub fn displaced(&self, error: &Displacement) -> Self {
        let [heading, tilt] = self.heading_and_tilt(&error.attitude);
        let turned = self.q_eb * exp(&heading);
        let j = turned.to_rotation_matrix().into_inner() * left_jacobian(&tilt);
        let mut q_eb = turned * exp(&tilt);
        q_eb.renormalize();
        Self { r_e: self.r_e + j * error.position, v_e: self.v_e + j * error.velocity, q_eb }
    }

    /// How far `other` is off from this state: the inverse of [`NavState::displaced`].
    pub fn displacement_of(&self, other: &Self) -> Displacement {
        let off = self.q_eb.inverse() * other.q_eb;
        let (heading, tilt) = match twist_and_swing(&off, &self.down_b()) {
            (_, tilt) if tilt.norm_squared() > LARGE_TILT * LARGE_TILT => (Vector3::zeros(), log(&off)),
            parts => parts,
        };
        let back = left_jacobian_inverse(&tilt)
            * (self.q_eb * exp(&heading)).inverse().to_rotation_matrix().into_inner();
        Displacement {
            position: back * (other.r_e - self.r_e),
            velocity: back * (other.v_e - self.v_e),
            attitude: heading + tilt,
        }
    }
}

/// q = exp(ψ u) exp(a) with a ⟂ u, as ψ u and a (swing-twist decomposition).
fn twist_and_swing(q: &UnitQuaternion<f64>, u: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let angle = 2.0 * atan2(q.imag().dot(u), q.w);
    // The shorter way round.
    let angle = angle - std::f64::consts::TAU * (angle / std::f64::consts::TAU).round();
    let twist = u * angle;
    (twist, log(&(exp(&-twist) * q)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;
    use crate::rotation::c_nb_from_euler;
    use proptest::prelude::*;

    fn state(roll: f64, pitch: f64, yaw: f64) -> NavState {
        let v_n = Vector3::new(20.0, -5.0, 1.0);
        NavState::from_ned(Geodetic::from_degrees(47.0, 8.0, 400.0), &v_n, &c_nb_from_euler(roll, pitch, yaw))
    }

    proptest! {
        #[test]
        fn what_is_displaced_is_off_by_the_displacement(
            euler in proptest::array::uniform3(-1.5_f64..1.5),
            error in proptest::array::uniform9(-1.0_f64..1.0),
            heading in -3.0_f64..3.0,
        ) {
            let nav = state(euler[0], euler[1], euler[2]);
            let mut error = Displacement::of(&error);
            let tilt = error.attitude - nav.down_b() * nav.down_b().dot(&error.attitude);
            error.attitude = 0.05 * tilt + nav.down_b() * heading;
            let back = nav.displacement_of(&nav.displaced(&error));
            // A heading beyond half a turn comes back the other way round.
            let whole = std::f64::consts::TAU * nav.down_b();
            let off = back.attitude - error.attitude;
            let off = [off, off - whole, off + whole].into_iter().map(|o| o.norm()).fold(f64::MAX, f64::min);
            prop_assert!(off < 1e-9, "{:?} {:?}", error, back);
            prop_assert!((back.position - error.position).norm() < 1e-6);
            prop_assert!((back.velocity - error.velocity).norm() < 1e-9);
        }
    }

    /// A heading error about the vertical turns the state about the vertical and leaves roll and pitch.
    #[test]
    fn a_heading_error_is_no_tilt() {
        let nav = state(0.3, -0.2, 1.0);
        let attitude = nav.down_b() * 0.7;
        let moved = nav.displaced(&Displacement { attitude, ..Displacement::default() });
        let expected = Vector3::new(0.3, -0.2, 1.7);
        assert!((moved.euler() - expected).norm() < 1e-9, "{}", moved.euler());
    }
}
