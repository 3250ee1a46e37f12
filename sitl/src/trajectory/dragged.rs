//! A multirotor in its drag: the same way through the air, with the attitude that balances gravity, acceleration and the drag of rotors and body, gusts
//! included.
//!
//! Thrust is what is left of the specific force without the drag, and the axis of the rotors points along it; the drag in turn is one in body axes, so that
//! both are found together. Rotors drag by the momentum of the air that flows through them, √(ρT) (Leishman 2006, section 2.14.6), or whatever the thrust is, as the
//! firmwares assume: a vehicle is somewhere between.

use crate::air::WindTrack;
use crate::noise::{Noise, Purpose};
use crate::truth::{Motion, Trajectory, Truth};
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::effects::SEA_LEVEL_DENSITY;
use gaware_nav::identify::air::density;
use gaware_nav::math::{cos, tan};
use gaware_nav::model::Model;
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::f64::consts::{PI, TAU};

/// Sinusoids that gusts along an axis are the sum of.
const LINES: usize = 60;
/// Gusts are no faster, Hz: a vehicle of half a metre feels the mean over itself.
const FASTEST_HZ: f64 = 2.0;
/// 1-sigma by which the rotors' axis is not the unit's z axis, rad.
const CANT: f64 = 0.015;
/// Attitudes before and after, for the rate, s.
const APART_S: f64 = 2e-3;
/// Attitude and drag are found together in at most so many steps, until none turns by more, rad. Each makes the error smaller by the drag over the weight, which is .7 at 15 m/s.
const STEPS: (usize, f64) = (100, 1e-12);

/// Drag per mass.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DragCoefficients {
    /// Of rotors, in hover at sea level, 1/s.
    pub rotors: f64,
    /// Area times coefficient of the body along x and y, m²/kg; along z it is that along x.
    pub body: [f64; 2],
}

impl DragCoefficients {
    /// What a model says of it; nothing where it says nothing.
    pub fn of(model: &Model) -> Option<Self> {
        let value = |name: &str, k: usize| model.get(name).map(|s| s.values[k]);
        let all = [value("drag_rotor", 0), value("drag_quadratic", 0), value("drag_quadratic", 1)];
        let [rotors, x, y] = all.map(Option::unwrap_or_default);
        all.iter().any(Option::is_some).then_some(Self { rotors, body: [x, y] })
    }
}

/// A flight with the attitude of its drag.
pub struct Dragged {
    inner: Box<dyn Trajectory>,
    drag: DragCoefficients,
    wind: WindTrack,
    /// Frequency and phase of gusts to the north and to the east, rad/s and rad.
    gusts: [Vec<(f64, f64)>; 2],
    /// Thrust in body axes.
    thrust: Vector3<f64>,
    /// Share of the rotors' drag that goes with the root of the thrust.
    by_thrust: f64,
}

impl Dragged {
    /// This flight in this wind.
    pub fn new(inner: Box<dyn Trajectory>, drag: DragCoefficients, wind: WindTrack, seed: u64) -> Self {
        let mut draw = Noise::numbered(seed, Purpose::Wind, 9);
        // Frequencies of a Cauchy distribution make an exponential correlation.
        let mut line = || loop {
            let omega = tan(PI * (draw.uniform() - 0.5)) / wind.gusts.1;
            if omega.abs() < TAU * FASTEST_HZ {
                break (omega, TAU * draw.uniform());
            }
        };
        let gusts = std::array::from_fn(|_| (0..LINES).map(|_| line()).collect());
        let thrust = Vector3::new(CANT * draw.normal(), CANT * draw.normal(), -1.0).normalize();
        Self { inner, drag, wind, gusts, thrust, by_thrust: draw.uniform() }
    }

    /// The flight as it is where a model says something of its drag.
    pub fn by_model(
        inner: Box<dyn Trajectory>,
        model: &Model,
        wind: WindTrack,
        seed: u64,
    ) -> Box<dyn Trajectory> {
        match DragCoefficients::of(model) {
            Some(drag) => Box::new(Self::new(inner, drag, wind, seed)),
            None => inner,
        }
    }

    fn air(&self, t_s: f64) -> Vector3<f64> {
        let size = self.wind.gusts.0 * (2.0 / LINES as f64).sqrt();
        let sum = |k: usize| size * self.gusts[k].iter().map(|(w, p)| cos(w * t_s + p)).sum::<f64>();
        self.wind.velocity(t_s) + Vector3::new(sum(0), sum(1), 0.0)
    }

    /// Drag in body axes with this thrust.
    fn force(&self, v: &Vector3<f64>, density: f64, thrust: f64) -> Vector3<f64> {
        let d = &self.drag;
        let by_thrust = 1.0 + self.by_thrust * ((thrust / STANDARD_GRAVITY).sqrt() - 1.0);
        let rotors = d.rotors * by_thrust * (density / SEA_LEVEL_DENSITY).sqrt();
        let body = [d.body[0], d.body[1], d.body[0]];
        Vector3::from_fn(|k, _| {
            let across = if k < 2 { rotors } else { 0.0 };
            -(across + 0.5 * density * body[k] * v[k].abs()) * v[k]
        })
    }

    fn attitude(&self, own: &Truth) -> Matrix3<f64> {
        let density = density(own.place.height_m);
        let (force_n, through) = (own.c_nb * own.force, own.v_n - self.air(own.t_s));
        let nose = own.c_nb.column(0).into_owned();
        // From the axes of the rotors to those of the unit.
        let cant = Rotation3::rotation_between(&self.thrust, &-Vector3::z()).unwrap_or_default();
        let (mut c, mut size) = (own.c_nb, force_n.norm());
        for _ in 0..STEPS.0 {
            let before = c;
            let thrust_n = force_n - c * self.force(&(c.transpose() * through), density, size);
            size = thrust_n.norm();
            let z = -thrust_n / size;
            let y = z.cross(&nose).normalize();
            c = Matrix3::from_columns(&[y.cross(&z), y, z]) * cant.matrix();
            if (c - before).norm() < STEPS.1 {
                break;
            }
        }
        c
    }
}

impl Trajectory for Dragged {
    fn duration_s(&self) -> f64 {
        self.inner.duration_s()
    }

    fn truth_at(&mut self, t_s: f64) -> Truth {
        let mut around = |by: f64| {
            let truth = self.inner.truth_at((t_s + by).max(0.0));
            (truth, self.attitude(&truth))
        };
        let [(first, before), (own, c_nb), (last, after)] = [-APART_S, 0.0, APART_S].map(&mut around);
        // So small an angle is its sine.
        let turned = before.transpose() * after;
        let turned = (turned - turned.transpose()) * 0.5;
        let turned = Vector3::new(turned[(2, 1)], turned[(0, 2)], turned[(1, 0)]);
        let rate_nb = turned / (last.t_s - first.t_s).max(APART_S);
        Truth::of(own.t_s, own.place, &Motion { v_n: own.v_n, a_n: own.a_n, c_nb, rate_nb })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory::Flown;
    use crate::trajectory::multirotor::Multirotor;
    use crate::truth::transport_rate_n;

    /// Without drag a hover is still: its rate is zero, and a number.
    #[test]
    fn a_hover_without_drag_is_still() {
        let none = DragCoefficients::default();
        let mut still = Dragged::new(Box::new(Flown::new(Multirotor::new())), none, WindTrack::default(), 1);
        for t_s in (0..50).map(|k| 0.2 * f64::from(k)) {
            let truth = still.truth_at(t_s);
            assert!(truth.force.norm() > 9.0 && truth.rate_ib.norm() < 2e-4, "{t_s}: {truth:?}");
        }
    }

    /// Forces balance: what the accelerometers feel is thrust and drag, the way stays the same, and the gyros feel how the attitude turns.
    #[test]
    fn thrust_and_drag_are_what_the_accelerometers_feel() {
        let drag = DragCoefficients { rotors: 0.2, body: [0.03, 0.05] };
        let wind = WindTrack { mean_n_e: [4.0, -3.0], swing: (0.5, 90.0), gusts: (0.6, 5.0) };
        let flown = Flown::new(Multirotor::new());
        let mut plain = flown.clone();
        let mut dragged = Dragged::new(Box::new(flown), drag, wind, 3);
        let mut fastest: f64 = 0.0;
        for t_s in (0..2200).map(|k| 8.0 + 0.1 * f64::from(k)) {
            let (truth, same) = (dragged.truth_at(t_s), plain.truth_at(t_s));
            assert_eq!((truth.place, truth.v_n), (same.place, same.v_n));
            let v = truth.c_nb.transpose() * (truth.v_n - dragged.air(t_s));
            fastest = fastest.max(v.xy().norm());
            let density = density(truth.place.height_m);
            let size = (truth.force - dragged.force(&v, density, 0.0)).norm();
            // The thrust for which the rest is along its axis.
            let rest = (0..20).fold(Vector3::z() * size, |r: Vector3<f64>, _| {
                truth.force - dragged.force(&v, density, r.norm())
            });
            assert!((rest.normalize() - dragged.thrust).norm() < 1e-6, "{t_s}: {rest}");
            let next = dragged.truth_at(t_s + 0.01);
            let turned = Rotation3::from_matrix_unchecked(truth.c_nb.transpose() * next.c_nb).scaled_axis();
            let felt = (truth.rate_eb + next.rate_eb) * 0.5
                - truth.c_nb.transpose() * transport_rate_n(&truth.place, &truth.v_n);
            assert!((turned / 0.01 - felt).norm() < 0.01, "{t_s}: {turned} {felt}");
        }
        assert!(fastest > 12.0, "{fastest}");
    }
}
