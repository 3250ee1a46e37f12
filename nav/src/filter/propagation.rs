//! The time step: mechanisation sample by sample, transition and process noise once per interval.

use super::Filter;
use super::layout::index;
use super::nav_map::Dense;
use super::regressor::BEYOND_NOISE;
use super::unseen::{BetweenSamples, GAP_S, MOTION as GAP_MOTION};
use crate::earth;
use crate::effects::{BiasWalk, Conditions};
use crate::linear::interval::{NavCovariance, Sum};
use crate::math::exp;
use crate::mechanization::Motion;
use crate::sample::{ImuSample, SampleKind};
use nalgebra::Vector3;

/// An interval ends after this long, s, whatever comes: Earth's share of it is of first order.
const LONGEST_S: f64 = 1.0;
/// Without a fix for longer than this position and velocity are not followed any more, s: the error of a consumer unit is
/// kilometres by then, and nothing that is linear about it holds.
pub(super) const COAST_AFTER_S: f64 = 120.0;
/// Constants walk in steps of this length, s: in an hour by a hundredth of what was known of them before, so that a step is nothing.
const WALK_EVERY_S: f64 = 0.1;
/// What is known of the velocity of a vehicle that coasts, per axis, m/s.
const COAST_SPEED: f64 = 50.0;

/// Between which samples a step lies: its ends, s, and what the line between them leaves out.
#[derive(Debug, Clone, Copy)]
struct Gap {
    from_s: f64,
    to_s: f64,
    between: BetweenSamples,
}

impl Filter {
    /// Takes the state to the time of this sample. Samples from the past and impossible ones are ignored.
    pub fn propagate(&mut self, sample: &ImuSample) {
        self.take(sample);
        self.arrive();
    }

    /// The same, but the covariance waits for the next measurement or [`Filter::arrive`].
    pub fn take(&mut self, sample: &ImuSample) {
        if !sample.is_usable() {
            return;
        }
        if self.needs_surroundings {
            self.recent.take(sample);
        }
        let gap = self.gap_until(sample);
        self.step(sample, &gap);
        self.sampled_s = self.sampled_s.max(sample.t_s);
        if let Some(bend) = &mut self.bend {
            bend.take(sample);
        }
    }

    /// From the last sample to this one. A mean says all about its interval.
    fn gap_until(&self, next: &ImuSample) -> Gap {
        let is_point = self.kind == SampleKind::Point;
        let between = self.bend.as_ref().filter(|_| is_point).and_then(|bend| bend.noise_until(next));
        Gap { from_s: self.sampled_s, to_s: next.t_s, between }
    }

    fn step(&mut self, sample: &ImuSample, gap: &Gap) {
        if self.last.is_none() {
            self.start_at(sample);
            return;
        }
        let dt = sample.t_s - self.t_s;
        if dt <= 0.0 {
            return;
        }
        if self.hold.is_some() {
            self.hold_step(sample, dt);
            return;
        }
        self.look_around(sample);
        let coasts = self.coasts(sample.t_s);
        self.about.motion = self.motion_of(sample);
        self.feel(dt);
        std::mem::swap(&mut self.from, &mut self.to);
        self.see(sample);
        let missed = self.missed(dt, gap);
        let sum = self.sum.get_or_insert_with(|| Box::new(Sum::new(&self.about.nav, self.to.columns.len())));
        sum.add(&self.from, &self.to, self.kind, dt);
        if let Some(missed) = missed {
            sum.add_gap(&missed);
        }
        if coasts {
            sum.stay();
        }
        self.about.nav = *sum.nav();
        self.last = Some(*sample);
        self.t_s = sample.t_s;
        if sum.duration_s() >= LONGEST_S {
            self.arrive();
        }
    }

    /// What the regressor makes of the present motion, `dt` after the last one.
    pub(super) fn feel(&mut self, dt: f64) {
        let (motion, band) = (self.about.motion, self.noise_band(dt));
        self.regressor.take(&motion, band, dt);
        if self.regressor.is_quiet() {
            self.regressor.average(&(motion.force + self.gravity_b()), band.1, dt);
        }
    }

    /// What errors of attitude and time act on at the present motion.
    pub(super) fn lever(&self) -> Motion {
        self.regressor.lever(&self.about.motion, || self.gravity_b())
    }

    /// Gravity in the body axes of what is linearised about, m/s².
    fn gravity_b(&self) -> Vector3<f64> {
        self.about.nav.q_eb.inverse() * earth::gravity(&self.about.nav.r_e)
    }

    /// The sensors at a sample become those at the end of a step.
    fn see(&mut self, sample: &ImuSample) {
        self.judged = self.regressor.motion();
        let lever = self.lever();
        let jacobian = &mut self.jacobian;
        self.about.calibration.jacobian(&self.model, &self.layout, sample, &self.judged, jacobian);
        let here = &mut self.to;
        here.t_s = sample.t_s;
        (here.motion, here.lever) = (self.about.motion, lever);
        let columns = jacobian.rate.iter().zip(&jacobian.force).map(|(rate, force)| [*rate, *force]);
        here.columns.clear();
        here.columns.extend(columns.skip(index::EFFECTS - index::GYRO_BIAS));
        for k in 0..3 {
            here.by_rate.set_column(k, &jacobian.force[k]);
            here.by_force.set_column(k, &jacobian.rate[3 + k]);
        }
    }

    /// The end of an interval: mean and covariance of the error come to the present.
    pub fn arrive(&mut self) {
        let Some(sum) = self.sum.take() else { return };
        let (mut interval, _) = sum.end();
        if self.coasting_since_s.is_some() {
            interval.attitude_alone();
        }
        let dt = interval.dt;
        let map = Dense::of(&interval, self.layout.slots().iter().map(|s| s.state));
        // Half of a walk before and half after, so that it also reaches velocity and position.
        self.walk_constants(0.5 * dt);
        self.p.transform(&map);
        let (gyro, accel) = self.noise_density();
        self.p.add_nav(&interval.noise(gyro, accel));
        self.walk_constants(0.5 * dt);
        if let Some(since) = self.coasting_since_s {
            // A vehicle that is not observed goes on: variance of the distance, 50 m/s times the time.
            let t = self.t_s - since + COAST_AFTER_S;
            let growth = COAST_SPEED * COAST_SPEED * (2.0 * t * dt);
            (0..3).for_each(|k| self.p.add_variance(index::POSITION + k, growth));
        }
        let moved = map.moved(&self.x);
        self.x[..moved.len()].copy_from_slice(&moved);
        self.decay_gauss_markov(dt);
        if !self.pinned && self.coasting_since_s.is_none() {
            self.recentre_place();
        }
        self.find_estimate();
    }

    /// The motion behind the next sample.
    fn motion_of(&self, sample: &ImuSample) -> Motion {
        match &self.last {
            Some(last) => {
                let Motion { rate, force } = self.about.motion;
                let errors = Motion { rate: last.gyro - rate, force: last.accel - force };
                self.about.calibration.motion_from(&self.model, sample, &errors)
            }
            None => self.about.calibration.motion(&self.model, sample),
        }
    }

    /// What the samples up to the end of a step show.
    fn look_around(&mut self, sample: &ImuSample) {
        if self.needs_surroundings {
            self.about.calibration.around = self.recent.around();
        }
        if self.needs_conditions {
            let lagged = sample.temperature_degc.map(|t| self.lags.push(sample.t_s, t - 25.0));
            let nav = &self.about.nav;
            self.about.calibration.conditions = Conditions {
                operating: self.operating,
                speed: nav.v_e.norm(),
                height_m: nav.geodetic().height_m - self.began_height_m,
                heading_rad: nav.euler().z,
                elapsed_s: sample.t_s - self.began_s,
                lagged_degc: lagged.unwrap_or_default(),
            };
        }
    }

    /// Whether samples are missing between the last one and this.
    pub(super) fn is_gap_before(&self, sample: &ImuSample) -> bool {
        self.last.is_some() && sample.t_s - self.sampled_s > GAP_S
    }

    /// Whether position and velocity are left alone because no fix has come for long; begins that where it is time.
    fn coasts(&mut self, t_s: f64) -> bool {
        if self.coasting_since_s.is_none() && self.aided_s.is_some_and(|aided| t_s - aided > COAST_AFTER_S) {
            self.arrive();
            self.coasting_since_s = Some(self.t_s);
            for k in 0..3 {
                self.p.reset(index::POSITION + k, COAST_SPEED * COAST_AFTER_S);
                self.p.reset(index::VELOCITY + k, COAST_SPEED);
            }
        }
        self.coasting_since_s.is_some()
    }

    /// Takes the state to a time between the last sample and the next one.
    pub fn propagate_to(&mut self, t_s: f64, next: &ImuSample) {
        if !next.is_usable() || !t_s.is_finite() {
            return;
        }
        let between = self.last.map_or(ImuSample { t_s, ..*next }, |last| last.between(next, self.kind, t_s));
        // A gap belongs to the interval between the samples, however many fixes fall into it.
        let gap = self.gap_until(next);
        self.step(&between, &gap);
    }

    /// The first sample: nothing to integrate yet, but the filter's own time counts from here.
    fn start_at(&mut self, sample: &ImuSample) {
        self.last = Some(*sample);
        self.about.motion = self.about.calibration.motion(&self.model, sample);
        self.regressor.start(&self.about.motion);
        self.see(sample);
        self.find_estimate();
        let dt = sample.t_s - self.t_s;
        if dt > 0.0 && self.kind == SampleKind::IntervalMean {
            // A mean says what happened since the initial state.
            self.last = Some(ImuSample { t_s: self.t_s, ..*sample });
            self.step(sample, &Gap { from_s: self.t_s, to_s: sample.t_s, between: None });
        } else if dt > 0.0 {
            self.t_s = sample.t_s;
        }
    }

    /// How far noise reaches in one sample of rate, rad/s, and force, m/s².
    pub(super) fn noise_band(&self, dt: f64) -> (f64, f64) {
        let imu = &self.model.imu;
        let band = |n: f64, extra: f64, scatter: f64| {
            BEYOND_NOISE * ((n * n + extra) / dt.max(1e-4)).max(scatter).sqrt()
        };
        (
            band(imu.gyro_noise, self.extra_noise.0, self.scatter.0),
            band(imu.accel_noise, self.extra_noise.1, self.scatter.1),
        )
    }

    /// Motion of the last sample anew, after what is linearised about has moved, and the sensors there.
    pub(super) fn refresh_motion(&mut self) {
        let Some(last) = self.last else { return };
        let motion = self.about.calibration.motion(&self.model, &last);
        self.regressor.estimate_changed(&self.about.motion, &motion);
        self.about.motion = motion;
        self.see(&last);
    }

    /// What is missed between samples, in the axes of the end of a step: of a gap, from `gap.from_s` on, and by the line between
    /// samples that are far apart. Unseen motion lasts: its variances grow with the square (and for the position the fourth power) of
    /// the time since the last sample.
    fn missed(&self, dt: f64, gap: &Gap) -> Option<NavCovariance> {
        let is_gap = gap.to_s - gap.from_s > GAP_S;
        if !is_gap && gap.between.is_none() {
            return None;
        }
        let mut q = NavCovariance::zeros();
        let mut add = |at: usize, variance: f64| q[(at, at)] += variance;
        if is_gap {
            let t1 = (self.t_s - gap.from_s).max(0.0);
            let t2 = t1 + dt;
            let square = t2 * t2 - t1 * t1;
            for k in 0..3 {
                add(index::ATTITUDE + k, GAP_MOTION.0.powi(2) * square);
                add(index::VELOCITY + k, GAP_MOTION.1.powi(2) * square);
                add(index::POSITION + k, (0.5 * GAP_MOTION.1).powi(2) * square * (t2 * t2 + t1 * t1));
            }
        }
        if let Some([rate, force]) = &gap.between {
            for k in 0..3 {
                add(index::ATTITUDE + k, rate[k] * dt);
                add(index::VELOCITY + k, force[k] * dt);
            }
        }
        Some(q)
    }

    /// The correlated error of the fixes so much later, s: mean and covariance.
    pub(super) fn decay_gauss_markov(&mut self, dt: f64) {
        let (Some(w), tau) = (self.layout.gauss_markov(), self.model.gnss.position_correlation_s) else {
            return;
        };
        let decay = if tau > 0.0 { exp(-dt / tau) } else { 1.0 };
        self.x[w..w + 3].iter_mut().for_each(|x| *x *= decay);
        self.p.scale3(w, decay);
        for (k, sigma) in self.model.gnss.position_wander_sigma_m.into_iter().enumerate() {
            self.p.add_variance(w + k, sigma * sigma * (1.0 - decay * decay));
        }
    }

    /// The random walks of biases that effects ask for, and of all constants where tolerances say that none is one for ever.
    pub(super) fn walk_constants(&mut self, dt: f64) {
        let mut walk = self.walk;
        if self.biases_walk {
            let effects = self.model.effects.iter().zip(self.about.calibration.parameters());
            walk = effects.map(|(s, p)| s.effect.bias_walk(p)).fold(walk, BiasWalk::and);
        }
        if walk != BiasWalk::default() {
            for k in 0..3 {
                self.p.add_variance(index::GYRO_BIAS + k, walk.gyro * walk.gyro * dt);
                self.p.add_variance(index::ACCEL_BIAS + k, walk.accel * walk.accel * dt);
            }
        }
        let Some([biases, others]) = self.model.constants_walk() else { return };
        self.unwalked_s += dt;
        if self.unwalked_s < WALK_EVERY_S {
            return;
        }
        let dt = std::mem::take(&mut self.unwalked_s);
        for i in index::GYRO_BIAS..index::GYRO_BIAS + self.layout.names().len() {
            let share = if i < index::EFFECTS { biases } else { others };
            let sigma = share * self.initial_sigmas.get(i).copied().unwrap_or(0.0);
            self.p.add_variance(i, sigma * sigma * dt);
        }
    }
}
