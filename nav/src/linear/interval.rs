//! The samples between two measurements as one interval: transition, one column per watched parameter, and the noise that the
//! sensors add. The only propagation there is: the live filter and the explanation of a whole flight apply the same intervals.
//!
//! Without Earth, whose little share is added once per interval, a step acts on an error in the axes of the
//! interval's start as p ← p + v dt − Δp×e, v ← v − Δv×e (Barrau & Bonnabel 2017). Such steps compose in closed form
//! (Forster, Carlone, Dellaert & Scaramuzza 2017, "On-manifold preintegration"): what the transition and white noise come to
//! is given by two vectors and a few moments of them.

use crate::earth;
use crate::filter::layout::index;
use crate::mechanization::{self, Increment, Motion, NavState};
use crate::rotation::{exp, left_jacobian, left_jacobian_inverse, log, skew};
use crate::sample::SampleKind;
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

/// Position, velocity and attitude errors.
pub(crate) type Nav = SVector<f64, 9>;
/// Their covariance.
pub(crate) type NavCovariance = SMatrix<f64, 9, 9>;
/// Navigation states and both biases: what the transition acts on.
pub(crate) const DYNAMIC: usize = 15;
/// Columns of both biases.
pub(crate) const BIASES: usize = DYNAMIC - 9;
/// A covariance that is the same along all axes, and the same multiple of the unit matrix in any of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Isotropic {
    /// Of the position.
    pub(crate) position: f64,
    /// Of position and velocity.
    pub(crate) both: f64,
    /// Of the velocity.
    pub(crate) velocity: f64,
}

impl Isotropic {
    /// Adds so many times this.
    #[inline(always)]
    fn add_to(&self, q: &mut NavCovariance, times: f64) {
        for k in 0..3 {
            let (p, v) = (index::POSITION + k, index::VELOCITY + k);
            q[(p, p)] += self.position * times;
            q[(p, v)] += self.both * times;
            q[(v, p)] += self.both * times;
            q[(v, v)] += self.velocity * times;
        }
    }
}

/// The sensors at one instant: motion, and by how much each watched parameter changes what is taken for motion.
#[derive(Debug, Clone, Default)]
pub(crate) struct Here {
    pub(crate) t_s: f64,
    /// What the trajectory does.
    pub(crate) motion: Motion,
    /// What attitude errors act on: the motion without what is only noise of the samples.
    pub(crate) lever: Motion,
    /// Of the specific force into the rate, by the g-sensitivity that the model knows of.
    pub(crate) by_force: Matrix3<f64>,
    /// Of the rate into the specific force, likewise.
    pub(crate) by_rate: Matrix3<f64>,
    /// Rate and specific force by each watched parameter.
    pub(crate) columns: Vec<[Vector3<f64>; 2]>,
}

/// The samples between two measurements.
#[derive(Debug, Clone)]
pub(crate) struct Interval {
    /// Length, s.
    pub(crate) dt: f64,
    /// ∂(navigation error at the end)/∂(15 states at the start), column by column.
    pub(crate) transition: [Nav; DYNAMIC],
    /// The same by each watched parameter.
    pub(crate) driven: Vec<Nav>,
    /// Navigation covariance per unit of variance per hertz of the gyros …
    pub(crate) by_gyro: NavCovariance,
    /// … and of the accelerometers.
    pub(crate) by_accel: Isotropic,
    /// Variance per hertz that the rounding of the samples adds to those of gyros and accelerometers.
    pub(crate) rounding: (f64, f64),
    /// What gaps between samples add.
    pub(crate) gaps: Option<Box<NavCovariance>>,
    /// The mechanisation's result seen from the trajectory: an error that is known.
    pub(crate) offset: Nav,
}

impl Interval {
    /// As it is for a vehicle of which the attitude alone is followed: position and velocity stay what they were.
    pub(crate) fn attitude_alone(&mut self) {
        for (k, c) in self.transition.iter_mut().chain(&mut self.driven).enumerate() {
            (0..index::ATTITUDE).for_each(|i| c[i] = if i == k { 1.0 } else { 0.0 });
        }
    }

    /// As it is for a vehicle that keeps its attitude, whatever the gyros say: an error of it at the end is `keeps` times that at the
    /// start, and `by`.
    pub(crate) fn keep_attitude(&mut self, keeps: &Matrix3<f64>, by: &Vector3<f64>) {
        for (k, c) in self.transition.iter_mut().enumerate() {
            let own = k.checked_sub(index::ATTITUDE).filter(|j| *j < 3);
            (0..3).for_each(|i| c[index::ATTITUDE + i] = own.map_or(0.0, |j| keeps[(i, j)]));
        }
        self.driven.iter_mut().for_each(|c| (0..3).for_each(|i| c[index::ATTITUDE + i] = 0.0));
        (0..3).for_each(|i| self.offset[index::ATTITUDE + i] = by[i]);
        self.by_gyro = NavCovariance::zeros();
    }

    /// Process noise of the navigation states where gyros and accelerometers have these variances per hertz.
    #[inline(always)]
    pub(crate) fn noise(&self, gyro: f64, accel: f64) -> NavCovariance {
        let mut q = self.by_gyro * gyro;
        self.by_accel.add_to(&mut q, accel);
        if let Some(gaps) = &self.gaps {
            q += **gaps;
        }
        q
    }

    /// Says where the mechanisation gets to, seen from the trajectory. The errors at the end are those about the trajectory and in its axes:
    /// with the offset o an error ξ about the mechanisation's result is Ad(exp o) ξ about the trajectory (Solà, Deray & Atchuthan 2018,
    /// "A micro Lie theory", eq. 30). Without that a position error would turn with every correction of the attitude, and the fixes
    /// would seem to measure it.
    pub(crate) fn set_offset(&mut self, offset: Nav) {
        let part = |c: &Nav, at: usize| Vector3::new(c[at], c[at + 1], c[at + 2]);
        let turn = part(&offset, index::ATTITUDE);
        let (axes, j) = (exp(&turn).to_rotation_matrix().into_inner(), left_jacobian(&turn));
        let (place, speed) = (j * part(&offset, index::POSITION), j * part(&offset, index::VELOCITY));
        for c in self.transition.iter_mut().chain(&mut self.driven) {
            let at = |k: usize| axes * part(c, k);
            let (p, v, e) = (at(index::POSITION), at(index::VELOCITY), at(index::ATTITUDE));
            *c = nav_of(&(p + place.cross(&e)), &(v + speed.cross(&e)), &e);
        }
        self.offset = offset;
    }
}

/// `state` as an error about `about`.
pub(crate) fn error(about: &NavState, state: &NavState) -> Nav {
    let eps = log(&(about.q_eb.inverse() * state.q_eb));
    let back = left_jacobian_inverse(&eps) * about.c_eb().transpose();
    nav_of(&(back * (state.r_e - about.r_e)), &(back * (state.v_e - about.v_e)), &eps)
}

fn nav_of(p: &Vector3<f64>, v: &Vector3<f64>, e: &Vector3<f64>) -> Nav {
    Nav::from_column_slice(&[p.x, p.y, p.z, v.x, v.y, v.z, e.x, e.y, e.z])
}

/// One step's action on a navigation error in the axes of the interval's start.
struct Action {
    dv: Vector3<f64>,
    dp: Vector3<f64>,
    dt: f64,
}

impl Action {
    fn apply(&self, c: &mut Nav) {
        let (v, e) = ([c[3], c[4], c[5]], [c[6], c[7], c[8]]);
        let cross =
            |a: &Vector3<f64>| [a.y * e[2] - a.z * e[1], a.z * e[0] - a.x * e[2], a.x * e[1] - a.y * e[0]];
        let (p, q) = (cross(&self.dp), cross(&self.dv));
        for k in 0..3 {
            c[k] += v[k] * self.dt - p[k];
            c[3 + k] -= q[k];
        }
    }
}

/// M Q Mᵀ for a map of columns.
fn congruence(q: &NavCovariance, map: impl Fn(&mut Nav)) -> NavCovariance {
    let half = |q: &NavCovariance| {
        let mut out = NavCovariance::zeros();
        for k in 0..9 {
            let mut column = q.column(k).into_owned();
            map(&mut column);
            out.set_column(k, &column);
        }
        out.transpose()
    };
    half(&half(q))
}

/// All actions so far as one, and the moments over time that white noise asks for.
///
/// White noise n of the rate that enters at an instant j reaches the end as e = n, v = −a×n, p = −b×n with the levers
/// a = V − Vⱼ and b = P − Pⱼ − Vⱼ (T − tⱼ); that of the specific force as v = n, p = n (T − tⱼ). Both are isotropic, so
/// their covariances follow from the sums of 1, t, t², V, R = P − V t and their products.
#[derive(Debug, Clone, Default)]
struct Composed {
    t: f64,
    v: Vector3<f64>,
    p: Vector3<f64>,
    weight: f64,
    times: (f64, f64),
    sum_v: Vector3<f64>,
    sum_r: Vector3<f64>,
    vv: Matrix3<f64>,
    rv: Matrix3<f64>,
    rr: Matrix3<f64>,
}

impl Composed {
    /// One step; half of its noise enters before it and half after it.
    fn add(&mut self, action: &Action) {
        self.note(0.5 * action.dt);
        self.p += self.v * action.dt + action.dp;
        self.v += action.dv;
        self.t += action.dt;
        self.note(0.5 * action.dt);
    }

    fn note(&mut self, weight: f64) {
        let r = self.p - self.v * self.t;
        let (wv, wr) = (self.v * weight, r * weight);
        self.weight += weight;
        self.times.0 += weight * self.t;
        self.times.1 += weight * self.t * self.t;
        self.sum_v += wv;
        self.sum_r += wr;
        self.vv += wv * self.v.transpose();
        self.rv += wr * self.v.transpose();
        self.rr += wr * r.transpose();
    }

    /// ∂(position, velocity, attitude)/∂(the same at the start), column by column.
    fn transition(&self) -> [Nav; 9] {
        let (by_v, by_p) = (-skew(&self.v), -skew(&self.p));
        std::array::from_fn(|k| {
            let mut c = Nav::zeros();
            c[k] = 1.0;
            if (3..6).contains(&k) {
                c[k - 3] = self.t;
            }
            if k >= 6 {
                (0..3).for_each(|i| (c[i], c[3 + i]) = (by_p[(i, k - 6)], by_v[(i, k - 6)]));
            }
            c
        })
    }

    /// Covariance per unit of variance per hertz of the gyros, in axes that `turn` leads to.
    fn by_gyro(&self, turn: &Matrix3<f64>) -> NavCovariance {
        let (s, t) = (self.weight, self.t);
        let sum_c = self.sum_r + self.sum_v * t;
        let cv = self.rv + self.vv * t;
        let cc = self.rr + (self.rv + self.rv.transpose()) * t + self.vv * (t * t);
        let (sum_a, sum_b) = (self.v * s - self.sum_v, self.p * s - sum_c);
        let outer = |a: &Vector3<f64>, b: &Vector3<f64>| a * b.transpose();
        let aa = outer(&self.v, &sum_a) - outer(&self.sum_v, &self.v) + self.vv;
        let ba = outer(&self.p, &sum_a) - outer(&sum_c, &self.v) + cv;
        let bb = outer(&self.p, &sum_b) - outer(&sum_c, &self.p) + cc;
        let about = |m: &Matrix3<f64>| {
            let m = turn * m * turn.transpose();
            Matrix3::from_diagonal_element(m.trace()) - m.transpose()
        };
        let mut q = NavCovariance::zeros();
        q.fixed_view_mut::<3, 3>(index::ATTITUDE, index::ATTITUDE).fill_diagonal(s);
        q.fixed_view_mut::<3, 3>(index::VELOCITY, index::VELOCITY).copy_from(&about(&aa));
        q.fixed_view_mut::<3, 3>(index::POSITION, index::POSITION).copy_from(&about(&bb));
        let beside = [
            (index::POSITION, index::VELOCITY, about(&ba)),
            (index::POSITION, index::ATTITUDE, -skew(&(turn * sum_b))),
            (index::VELOCITY, index::ATTITUDE, -skew(&(turn * sum_a))),
        ];
        for (i, j, block) in beside {
            q.fixed_view_mut::<3, 3>(i, j).copy_from(&block);
            q.fixed_view_mut::<3, 3>(j, i).copy_from(&block.transpose());
        }
        q
    }

    /// The same of the accelerometers.
    fn by_accel(&self) -> Isotropic {
        let (s, t) = (self.weight, self.t);
        Isotropic {
            position: s * t * t - 2.0 * t * self.times.0 + self.times.1,
            both: s * t - self.times.0,
            velocity: s,
        }
    }
}

/// What an error of each sensor axis over one step (gyros x, y, z in rad/s, accelerometers x, y, z in m/s²) adds to a column.
type Channels = [[f64; 9]; 6];

/// Errors that enter step by step, added up in the axes of the interval's start so that what the later steps make of them can be
/// put in at the end, for all steps at once: with the actions V, P, T of the whole interval and Vⱼ, Pⱼ, tⱼ of the steps up to j an
/// error (p, v, e) that enters with step j arrives as v − (V − Vⱼ)×e and p + v (T − tⱼ) − (P − Pⱼ − Vⱼ (T − tⱼ))×e.
#[derive(Debug, Clone, Copy)]
struct Column([f64; 9]);

impl Column {
    fn add(&mut self, channel: &[f64; 9], size: f64) {
        if size != 0.0 {
            self.0.iter_mut().zip(channel).for_each(|(c, by)| *c += by * size);
        }
    }

    /// As it arrives.
    fn end(&self, all: &Composed) -> Nav {
        let at = |k: usize| Vector3::new(self.0[k], self.0[k + 1], self.0[k + 2]);
        let (p, v, e) = (at(index::POSITION), at(index::VELOCITY), at(index::ATTITUDE));
        nav_of(&(p + v * all.t - all.p.cross(&e)), &(v - all.v.cross(&e)), &e)
    }
}

/// An interval under way. Errors are kept in the axes of its start until it ends.
#[derive(Debug, Clone)]
pub(crate) struct Sum {
    composed: Composed,
    biases: [Column; BIASES],
    /// By each watched parameter.
    driven: Vec<Column>,
    gaps: Option<Box<NavCovariance>>,
    nav: NavState,
    start: NavState,
    /// From the present body axes to those of the start.
    turned: Matrix3<f64>,
    attitude: UnitQuaternion<f64>,
}

impl Sum {
    pub(crate) fn new(nav: &NavState, watched: usize) -> Self {
        Self {
            composed: Composed::default(),
            biases: [Column([0.0; 9]); BIASES],
            driven: vec![Column([0.0; 9]); watched],
            gaps: None,
            nav: *nav,
            start: *nav,
            turned: Matrix3::identity(),
            attitude: UnitQuaternion::identity(),
        }
    }

    /// Where the mechanisation is.
    pub(crate) fn nav(&self) -> &NavState {
        &self.nav
    }

    /// Position and velocity stay where they were at the start.
    pub(crate) fn stay(&mut self) {
        (self.nav.r_e, self.nav.v_e) = (self.start.r_e, self.start.v_e);
    }

    /// So far, s.
    pub(crate) fn duration_s(&self) -> f64 {
        self.composed.t
    }

    /// What the sensor axes do in a step that has just been composed; `middle` leads from its body axes to those of the start.
    fn channels(&self, action: &Action, middle: &Matrix3<f64>) -> Channels {
        let (t, dt) = (self.composed.t, action.dt);
        let v = self.composed.v - action.dv * 0.5;
        let p = self.composed.p - action.dp / 3.0 - v * t;
        std::array::from_fn(|k| {
            let by = middle.column(k % 3) * dt;
            if k < 3 {
                nav_of(&p.cross(&by), &v.cross(&by), &by).into()
            } else {
                let place = self.turned.column(k % 3) * (0.5 * dt * dt) - by * t;
                nav_of(&place, &by, &Vector3::zeros()).into()
            }
        })
    }

    /// One step.
    pub(crate) fn add(&mut self, from: &Here, to: &Here, kind: SampleKind, dt: f64) {
        let inc = Increment::between(&from.motion, &to.motion, kind, dt);
        let lever = if from.lever == from.motion && to.lever == to.motion {
            inc
        } else {
            Increment::between(&from.lever, &to.lever, kind, dt)
        };
        let action = Action { dv: self.turned * lever.dv, dp: self.turned * lever.dp, dt };
        let middle = self.turned * (Matrix3::identity() + skew(&inc.dtheta) * 0.5);
        self.composed.add(&action);
        let channels = self.channels(&action, &middle);
        let from_end = kind != SampleKind::Point || from.columns.len() != to.columns.len();
        let mean = |a: &Matrix3<f64>, b: &Matrix3<f64>| if from_end { *b } else { (a + b) * 0.5 };
        let (by_force, by_rate) = (mean(&from.by_force, &to.by_force), mean(&from.by_rate, &to.by_rate));
        for (k, bias) in self.biases.iter_mut().enumerate() {
            bias.add(&channels[k], -1.0);
            for i in 0..3 {
                if k < 3 {
                    bias.add(&channels[3 + i], by_rate[(i, k)]);
                } else {
                    bias.add(&channels[i], by_force[(i, k - 3)]);
                }
            }
        }
        for (k, (column, end)) in self.driven.iter_mut().zip(&to.columns).enumerate() {
            let start = from.columns.get(k).filter(|_| !from_end).unwrap_or(end);
            for (channel, by) in channels.iter().enumerate() {
                let (sensor, axis) = (channel / 3, channel % 3);
                column.add(by, 0.5 * (start[sensor][axis] + end[sensor][axis]));
            }
        }
        if let Some(q) = &mut self.gaps {
            **q = congruence(q, |c| action.apply(c));
        }
        self.nav = mechanization::step(&self.nav, &inc);
        self.attitude *= exp(&inc.dtheta);
        self.turned = self.attitude.to_rotation_matrix().into_inner();
    }

    /// What samples that are missing in this step leave open, in the axes of its end.
    pub(crate) fn add_gap(&mut self, missed: &NavCovariance) {
        let turned = self.turned;
        let missed = congruence(missed, |c| {
            let at = |k: usize| turned * Vector3::new(c[k], c[k + 1], c[k + 2]);
            *c = nav_of(&at(index::POSITION), &at(index::VELOCITY), &at(index::ATTITUDE));
        });
        **self.gaps.get_or_insert_with(|| Box::new(NavCovariance::zeros())) += missed;
    }

    /// Earth's share, and everything into the axes of the end. Earth's share of the noise, a hundred-thousandth of it, is
    /// left out.
    pub(crate) fn end(self) -> (Interval, NavState) {
        let to_end = self.turned.transpose();
        let c_be = self.start.q_eb.inverse().to_rotation_matrix().into_inner();
        let dt = self.composed.t;
        let rate = c_be * earth::rotation_rate() * dt;
        let gradient = c_be * earth::gravity_gradient(&self.start.r_e) * c_be.transpose() * dt;
        let finish = |c: &mut Nav| {
            let at = |k: usize| Vector3::new(c[k], c[k + 1], c[k + 2]);
            let (r, v, e) = (at(index::POSITION), at(index::VELOCITY), at(index::ATTITUDE));
            let (r, v) = (r + rate.cross(&r), v + gradient * r - rate.cross(&v));
            *c = nav_of(&(to_end * r), &(to_end * v), &(to_end * e));
        };
        let mut transition = [Nav::zeros(); DYNAMIC];
        transition[..9].copy_from_slice(&self.composed.transition());
        for (column, bias) in transition[9..].iter_mut().zip(&self.biases) {
            *column = bias.end(&self.composed);
        }
        let mut driven: Vec<Nav> = self.driven.iter().map(|c| c.end(&self.composed)).collect();
        transition.iter_mut().chain(&mut driven).for_each(finish);
        let interval = Interval {
            dt,
            transition,
            driven,
            by_gyro: self.composed.by_gyro(&to_end),
            by_accel: self.composed.by_accel(),
            rounding: (0.0, 0.0),
            gaps: self.gaps.map(|q| Box::new(congruence(&q, finish))),
            offset: Nav::zeros(),
        };
        (interval, self.nav)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        [-size..size, -size..size, -size..size].prop_map(Vector3::from)
    }

    proptest! {
        /// Step by step and in closed form: transition and noise are the same.
        #[test]
        fn steps_compose(steps in prop::collection::vec((vector(3.0), vector(0.3), 1e-3..0.1f64), 1..30),
                         axis in vector(3.0)) {
            let mut composed = Composed::default();
            let mut transition = NavCovariance::identity();
            let (mut gyro, mut accel) = (NavCovariance::zeros(), NavCovariance::zeros());
            for (dv, dp, dt) in steps {
                let action = Action { dv, dp, dt };
                composed.add(&action);
                for (q, at) in [(&mut gyro, index::ATTITUDE), (&mut accel, index::VELOCITY)] {
                    (0..3).for_each(|k| q[(at + k, at + k)] += 0.5 * dt);
                    *q = congruence(q, |c| action.apply(c));
                    (0..3).for_each(|k| q[(at + k, at + k)] += 0.5 * dt);
                }
                transition.column_iter_mut().for_each(|mut c| {
                    let mut own = c.clone_owned();
                    action.apply(&mut own);
                    c.copy_from(&own);
                });
            }
            let turn = exp(&axis).to_rotation_matrix().into_inner();
            let turned = |q: &NavCovariance| congruence(q, |c| {
                let at = |k: usize| turn * Vector3::new(c[k], c[k + 1], c[k + 2]);
                *c = nav_of(&at(0), &at(3), &at(6));
            });
            prop_assert!((NavCovariance::from_columns(&composed.transition()) - transition).amax() < 1e-9);
            prop_assert!((composed.by_gyro(&turn) - turned(&gyro)).amax() < 1e-9 * (1.0 + gyro.amax()));
            let mut by_accel = NavCovariance::zeros();
            composed.by_accel().add_to(&mut by_accel, 1.0);
            prop_assert!((by_accel - turned(&accel)).amax() < 1e-9 * (1.0 + accel.amax()));
        }
    }
}
