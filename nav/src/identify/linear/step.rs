//! The way from one fix to the next: the samples in between as one transition, one column per watched parameter, and
//! the noise that the sensors add.

use super::super::flight::Flight;
use super::index;
use crate::earth;
use crate::effects::Instant;
use crate::filter::calibration::Calibration;
use crate::filter::force_rate::ForceRates;
use crate::filter::watch::{Regressors, Watched};
use crate::mechanization::{self, Increment, Motion, NavState};
use crate::model::Model;
use crate::rotation::{exp, left_jacobian_inverse, log, skew};
use crate::sample::{ImuSample, SampleKind};
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

/// Position, velocity and attitude errors.
pub(super) type Nav = SVector<f64, 9>;
/// Their covariance.
pub(super) type NavCovariance = SMatrix<f64, 9, 9>;
/// Navigation states and both biases: what the transition acts on.
pub(super) const DYNAMIC: usize = 15;
/// A gap between samples longer than this is not integrated as if nothing had happened, s.
const GAP_S: f64 = 0.25;
/// What an unseen vehicle may do in a gap: rate, rad/s, and acceleration, m/s².
const GAP_MOTION: (f64, f64) = (0.5, 5.0);

/// The samples between two fixes.
#[derive(Debug, Clone)]
pub(super) struct Interval {
    /// Length, s.
    pub(super) dt: f64,
    /// ∂(navigation error at the end)/∂(15 states at the start), then by each watched parameter.
    pub(super) columns: Vec<Nav>,
    /// Navigation covariance per unit of variance per hertz of the gyros …
    pub(super) by_gyro: NavCovariance,
    /// … and of the accelerometers.
    pub(super) by_accel: NavCovariance,
    /// What gaps between samples add.
    pub(super) gaps: Option<Box<NavCovariance>>,
    /// The mechanisation's result seen from the trajectory: an error that is known.
    pub(super) offset: Nav,
}

/// `state` as an error about `about`.
pub(super) fn error(about: &NavState, state: &NavState) -> Nav {
    let eps = log(&(about.q_eb.inverse() * state.q_eb));
    let back = left_jacobian_inverse(&eps) * about.c_eb().transpose();
    let (dr, dv) = (back * (state.r_e - about.r_e), back * (state.v_e - about.v_e));
    Nav::from_column_slice(&[dr.x, dr.y, dr.z, dv.x, dv.y, dv.z, eps.x, eps.y, eps.z])
}

/// The action of one step on a navigation error in the axes of the interval's start (Barrau & Bonnabel 2017, without
/// Earth, whose little share is added once per interval).
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

/// The sensors at one instant: motion, and by how much each watched parameter changes what is taken for motion.
#[derive(Debug, Clone, Default)]
pub(super) struct Here {
    pub(super) t_s: f64,
    pub(super) motion: Motion,
    /// Rate of change of the specific force, m/s³.
    pub(super) force_rate: Vector3<f64>,
    temperature_above_25_degc: f64,
    by_force: Matrix3<f64>,
    columns: Vec<[Vector3<f64>; 2]>,
}

/// Goes along the samples of a flight.
pub(super) struct Track<'a> {
    samples: &'a [ImuSample],
    force_rates: &'a ForceRates,
    next: usize,
    kind: SampleKind,
    model: &'a Model,
    watched: &'a Watched,
    calibration: Calibration,
    last: ImuSample,
    start_s: f64,
    from: Here,
    to: Here,
}

impl<'a> Track<'a> {
    pub(super) fn new(
        flight: &'a Flight,
        model: &'a Model,
        samples: &'a [ImuSample],
        calibration: &Calibration,
        watched: &'a Watched,
    ) -> Self {
        let start_s = flight.initial().t_s;
        let still = ImuSample {
            t_s: start_s,
            gyro: Vector3::zeros(),
            accel: Vector3::zeros(),
            temperature_degc: None,
        };
        let first = samples.first().copied().unwrap_or(still);
        let mut track = Self {
            samples,
            force_rates: flight.force_rates(),
            next: 0,
            kind: flight.stream().kind,
            model,
            watched,
            calibration: calibration.clone(),
            last: ImuSample { t_s: start_s, ..first },
            start_s,
            from: Here::default(),
            to: Here::default(),
        };
        track.see(&ImuSample { t_s: start_s, ..first }, 0.0);
        track
    }

    /// Biases and parameters from here on.
    pub(super) fn set_calibration(&mut self, calibration: &Calibration) {
        self.calibration.clone_from(calibration);
        self.see(&self.last.clone(), 0.0);
    }

    /// The sensors at the end of the last interval.
    pub(super) fn here(&self) -> Here {
        Here { force_rate: self.force_rates.at(self.to.t_s), ..self.to.clone() }
    }

    /// Motion and columns at a sample become those of the end of a step.
    fn see(&mut self, sample: &ImuSample, speed: f64) {
        std::mem::swap(&mut self.from, &mut self.to);
        let motion = self.calibration.motion(self.model, sample);
        let here = &mut self.to;
        here.t_s = sample.t_s;
        here.motion = motion;
        here.temperature_above_25_degc = sample.temperature_degc.map_or(0.0, |t| t - 25.0);
        let x = Instant {
            t_s: sample.t_s,
            rate: motion.rate,
            force: motion.force,
            temperature_above_25_degc: here.temperature_above_25_degc,
        };
        here.by_force = Matrix3::zeros();
        for (setting, p) in self.model.effects.iter().zip(&self.calibration.parameters) {
            here.by_force += setting.effect.gyro_by_force(p, &x).unwrap_or_default();
        }
        here.columns.clear();
        self.watched.imu_columns(&x, &mut here.columns);
        let regressors = Regressors {
            force: motion.force,
            rate: motion.rate,
            temperature_above_25_degc: here.temperature_above_25_degc,
            speed,
            elapsed_s: sample.t_s - self.start_s,
        };
        for term in &self.watched.terms {
            let mut column = [Vector3::zeros(); 2];
            column[term.channel / 3 % 2][term.channel % 3] = -(term.regressor)(&regressors);
            here.columns.push(column);
        }
        // An accelerometer error passes through the g-sensitivity that the model knows of.
        for [rate, force] in &mut here.columns {
            *rate -= here.by_force * *force;
        }
    }

    /// The sample at a time between the last one and `next`.
    fn between(&self, t_s: f64, next: &ImuSample) -> ImuSample {
        if self.kind == SampleKind::Point && next.t_s > self.last.t_s {
            let share = (t_s - self.last.t_s) / (next.t_s - self.last.t_s);
            return ImuSample {
                t_s,
                gyro: self.last.gyro.lerp(&next.gyro, share),
                accel: self.last.accel.lerp(&next.accel, share),
                temperature_degc: next.temperature_degc,
            };
        }
        ImuSample { t_s, ..*next }
    }

    /// The samples up to a time as one interval, and where the mechanisation gets to. `None` where the samples end before.
    pub(super) fn interval_to(&mut self, nav: &NavState, t_s: f64) -> (Option<Interval>, NavState) {
        let mut sum = Sum::new(nav, self.to.columns.len());
        loop {
            let Some(next) = self.samples.get(self.next).copied() else { return (None, sum.nav) };
            let arrived = next.t_s > t_s;
            let sample = if arrived { self.between(t_s, &next) } else { next };
            if !arrived {
                self.next += 1;
            }
            let dt = sample.t_s - self.to.t_s;
            if dt > 0.0 {
                self.see(&sample, sum.nav.v_e.norm());
                sum.add(&self.from, &self.to, self.kind, dt);
                self.last = sample;
            }
            if arrived {
                let (interval, nav) = sum.end();
                return (Some(interval), nav);
            }
        }
    }
}

/// An interval under way. Errors are kept in the axes of its start until it ends.
struct Sum {
    interval: Interval,
    nav: NavState,
    start: NavState,
    /// From the present body axes to those of the start.
    turned: Matrix3<f64>,
    attitude: UnitQuaternion<f64>,
}

impl Sum {
    fn new(nav: &NavState, watched: usize) -> Self {
        let mut columns = vec![Nav::zeros(); DYNAMIC + watched];
        (0..9).for_each(|k| columns[k][k] = 1.0);
        Self {
            interval: Interval {
                dt: 0.0,
                columns,
                by_gyro: NavCovariance::zeros(),
                by_accel: NavCovariance::zeros(),
                gaps: None,
                offset: Nav::zeros(),
            },
            nav: *nav,
            start: *nav,
            turned: Matrix3::identity(),
            attitude: UnitQuaternion::identity(),
        }
    }

    fn add(&mut self, from: &Here, to: &Here, kind: SampleKind, dt: f64) {
        let inc = Increment::between(&from.motion, &to.motion, kind, dt);
        let action = Action { dv: self.turned * inc.dv, dp: self.turned * inc.dp, dt };
        let sum = &mut self.interval;
        sum.dt += dt;
        sum.columns.iter_mut().for_each(|c| action.apply(c));
        let turned = self.turned * (Matrix3::identity() + skew(&inc.dtheta) * 0.5);
        let drive = |rate: Vector3<f64>, force: Vector3<f64>| {
            let e = turned * rate * dt;
            let v = turned * force * dt - action.dv.cross(&e) * 0.5;
            let p = self.turned * force * (0.5 * dt * dt) - action.dp.cross(&e) / 3.0;
            Nav::from_column_slice(&[p.x, p.y, p.z, v.x, v.y, v.z, e.x, e.y, e.z])
        };
        let by_force =
            if kind == SampleKind::Point { (from.by_force + to.by_force) * 0.5 } else { to.by_force };
        for k in 0..3 {
            let axis = Vector3::from_fn(|i, _| if i == k { -1.0 } else { 0.0 });
            sum.columns[9 + k] += drive(axis, Vector3::zeros());
            sum.columns[12 + k] += drive(-by_force * axis, axis);
        }
        for (k, end) in to.columns.iter().enumerate() {
            let start = from.columns.get(k).filter(|_| kind == SampleKind::Point).unwrap_or(end);
            let (rate, force) = ((start[0] + end[0]) * 0.5, (start[1] + end[1]) * 0.5);
            if rate != Vector3::zeros() || force != Vector3::zeros() {
                sum.columns[DYNAMIC + k] += drive(rate, force);
            }
        }
        self.add_noise(&action, dt);
        self.nav = mechanization::step(&self.nav, &inc);
        self.attitude *= exp(&inc.dtheta);
        self.turned = self.attitude.to_rotation_matrix().into_inner();
    }

    /// Half of the noise before the step and half after it, so that it also reaches velocity and position.
    fn add_noise(&mut self, action: &Action, dt: f64) {
        let sum = &mut self.interval;
        for (q, at) in [(&mut sum.by_gyro, index::ATTITUDE), (&mut sum.by_accel, index::VELOCITY)] {
            (0..3).for_each(|k| q[(at + k, at + k)] += 0.5 * dt);
            *q = congruence(q, |c| action.apply(c));
            (0..3).for_each(|k| q[(at + k, at + k)] += 0.5 * dt);
        }
        if let Some(q) = &mut sum.gaps {
            **q = congruence(q, |c| action.apply(c));
        }
        if dt > GAP_S {
            let q = sum.gaps.get_or_insert_with(|| Box::new(NavCovariance::zeros()));
            for k in 0..3 {
                q[(index::ATTITUDE + k, index::ATTITUDE + k)] += (GAP_MOTION.0 * dt).powi(2);
                q[(index::VELOCITY + k, index::VELOCITY + k)] += (GAP_MOTION.1 * dt).powi(2);
                q[(index::POSITION + k, index::POSITION + k)] += (0.5 * GAP_MOTION.1 * dt * dt).powi(2);
            }
        }
    }

    /// Earth's share, and everything into the axes of the end.
    fn end(mut self) -> (Interval, NavState) {
        let to_end = self.turned.transpose();
        let c_be = self.start.q_eb.inverse().to_rotation_matrix().into_inner();
        let dt = self.interval.dt;
        let rate = c_be * earth::rotation_rate() * dt;
        let gradient = c_be * earth::gravity_gradient(&self.start.r_e) * c_be.transpose() * dt;
        let finish = |c: &mut Nav| {
            let at = |k: usize| Vector3::new(c[k], c[k + 1], c[k + 2]);
            let (r, v, e) = (at(index::POSITION), at(index::VELOCITY), at(index::ATTITUDE));
            let (r, v) = (r + rate.cross(&r), v + gradient * r - rate.cross(&v));
            let (r, v, e) = (to_end * r, to_end * v, to_end * e);
            *c = Nav::from_column_slice(&[r.x, r.y, r.z, v.x, v.y, v.z, e.x, e.y, e.z]);
        };
        let sum = &mut self.interval;
        sum.columns.iter_mut().for_each(finish);
        sum.by_gyro = congruence(&sum.by_gyro, finish);
        sum.by_accel = congruence(&sum.by_accel, finish);
        if let Some(q) = &mut sum.gaps {
            **q = congruence(q, finish);
        }
        (self.interval, self.nav)
    }
}
