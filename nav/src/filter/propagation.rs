//! The time step: mechanisation, transition matrix and process noise.

use super::Filter;
use super::covariance::NAV;
use super::layout::index;
use super::nav_map::moved;
use super::regressor::BEYOND_NOISE;
use super::unseen::{BetweenSamples, GAP_S, MOTION as GAP_MOTION};
use crate::earth;
use crate::mechanization::{self, Increment, Motion};
use crate::rotation::{exp, skew};
use crate::sample::{ImuSample, SampleKind};
use nalgebra::{Matrix3, Vector3};

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
        let decay = self.wander_decay(dt);
        if self.hold.is_some() {
            self.hold_step(sample, dt, decay);
            return;
        }
        self.look_around();
        let motion = self.motion_of(sample);
        let inc = Increment::between(&self.motion, &motion, self.kind, dt);
        std::mem::swap(&mut self.jacobian, &mut self.start_jacobian);
        let band = self.noise_band(dt);
        self.regressor.take(&motion, band, dt);
        self.judged = self.regressor.motion();
        self.course.take((sample.t_s, dt), &motion.rate, &self.regressor, band.0);
        self.calibration.jacobian(&self.model, &self.layout, sample, &self.judged, &mut self.jacobian);
        let lever = self.regressor.lever(&motion);
        let coasts = self.coasts(sample.t_s);
        // Noise is no excitation for attitude errors either: they act on the motion that constants are judged by.
        self.transition(&inc, &Increment::between(&self.lever, &lever, self.kind, dt), coasts);
        self.lever = lever;
        self.carry_along(decay);
        self.propagate_covariance(dt, decay, gap);
        let place = self.nav;
        self.nav = mechanization::step(&self.nav, &inc);
        if coasts {
            (self.nav.r_e, self.nav.v_e) = (place.r_e, place.v_e);
        }
        self.wander *= decay;
        self.motion = motion;
        self.last = Some(*sample);
        self.t_s = sample.t_s;
    }

    /// The motion behind the next sample.
    fn motion_of(&self, sample: &ImuSample) -> Motion {
        match &self.last {
            Some(last) => {
                let errors =
                    Motion { rate: last.gyro - self.motion.rate, force: last.accel - self.motion.force };
                self.calibration.motion_from(&self.model, sample, &errors)
            }
            None => self.calibration.motion(&self.model, sample),
        }
    }

    /// What the samples up to the end of a step show.
    fn look_around(&mut self) {
        if self.needs_surroundings {
            self.calibration.around = self.recent.around();
        }
    }

    /// Takes the carried mean along: x ← Φ x.
    fn carry_along(&mut self, decay: f64) {
        let Some(x) = &mut self.carried else { return };
        let moved = moved(&self.phi, x);
        x[..NAV].copy_from_slice(&moved);
        if let Some(w) = self.layout.gauss_markov() {
            x[w..w + 3].iter_mut().for_each(|v| *v *= decay);
        }
    }

    /// Whether samples are missing between the last one and this.
    pub(super) fn is_gap_before(&self, sample: &ImuSample) -> bool {
        self.last.is_some() && sample.t_s - self.sampled_s > GAP_S
    }

    /// Whether position and velocity are left alone because no fix has come for long; begins that where it is time.
    fn coasts(&mut self, t_s: f64) -> bool {
        if self.coasting_since_s.is_none() && self.aided_s.is_some_and(|aided| t_s - aided > COAST_AFTER_S) {
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
        let between = match (self.last, self.kind) {
            (Some(last), SampleKind::Point) if next.t_s > last.t_s => {
                let share = (t_s - last.t_s) / (next.t_s - last.t_s);
                ImuSample {
                    t_s,
                    gyro: last.gyro.lerp(&next.gyro, share),
                    accel: last.accel.lerp(&next.accel, share),
                    temperature_degc: next.temperature_degc,
                }
            }
            _ => ImuSample { t_s, ..*next },
        };
        // A gap belongs to the interval between the samples, however many fixes fall into it.
        let gap = self.gap_until(next);
        self.step(&between, &gap);
    }

    /// The first sample: nothing to integrate yet, but the filter's own time counts from here.
    fn start_at(&mut self, sample: &ImuSample) {
        self.last = Some(*sample);
        self.motion = self.calibration.motion(&self.model, sample);
        self.regressor.start(&self.motion);
        self.refresh_motion();
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

    /// Motion of the last sample anew, after the calibration changed, and its Jacobian where the motion that it is found at has.
    pub(super) fn refresh_motion(&mut self) {
        let Some(last) = self.last else { return };
        let motion = self.calibration.motion(&self.model, &last);
        self.regressor.estimate_changed(&self.motion, &motion);
        self.motion = motion;
        self.lever = self.regressor.lever(&motion);
        let seen = self.regressor.motion();
        if seen != self.judged {
            self.judged = seen;
            let mut jacobian = std::mem::take(&mut self.jacobian);
            self.calibration.jacobian(&self.model, &self.layout, &last, &seen, &mut jacobian);
            self.jacobian = jacobian;
        }
    }

    pub(super) fn wander_decay(&self, dt: f64) -> f64 {
        let tau = self.model.gnss.position_correlation_s;
        if tau > 0.0 { (-dt / tau).exp() } else { 1.0 }
    }

    /// P ← Φ P Φᵀ + Q, with half of Q before and half after, so that noise also reaches velocity and position.
    fn propagate_covariance(&mut self, dt: f64, decay: f64, gap: &Gap) {
        self.add_process_noise(dt * 0.5);
        self.p.transform(&self.phi);
        self.add_process_noise(dt * 0.5);
        self.walk_constants(dt);
        if gap.to_s - gap.from_s > GAP_S {
            self.add_unseen_motion(self.t_s - gap.from_s, dt);
        }
        if let Some([rate, force]) = &gap.between {
            for k in 0..3 {
                self.p.add_variance(index::ATTITUDE + k, rate[k] * dt);
                self.p.add_variance(index::VELOCITY + k, force[k] * dt);
            }
        }
        self.decay_wander(decay);
    }

    /// What a vehicle may have done in a gap, from `into_s` after its start for `dt` on. Unseen motion lasts: its variances
    /// grow with the square (and for the position the fourth power) of the time since the last sample.
    fn add_unseen_motion(&mut self, into_s: f64, dt: f64) {
        let (t1, t2) = (into_s.max(0.0), into_s.max(0.0) + dt);
        let square = t2 * t2 - t1 * t1;
        for k in 0..3 {
            self.p.add_variance(index::ATTITUDE + k, GAP_MOTION.0.powi(2) * square);
            self.p.add_variance(index::VELOCITY + k, GAP_MOTION.1.powi(2) * square);
            let fourth = square * (t2 * t2 + t1 * t1);
            self.p.add_variance(index::POSITION + k, (0.5 * GAP_MOTION.1).powi(2) * fourth);
        }
    }

    pub(super) fn decay_wander(&mut self, decay: f64) {
        let Some(w) = self.layout.gauss_markov() else { return };
        self.p.scale3(w, decay);
        for (k, sigma) in self.model.gnss.position_wander_sigma_m.into_iter().enumerate() {
            self.p.add_variance(w + k, sigma * sigma * (1.0 - decay * decay));
        }
    }

    fn add_process_noise(&mut self, dt: f64) {
        let imu = &self.model.imu;
        let gyro = (imu.gyro_noise * imu.gyro_noise + self.extra_noise.0) * dt;
        let accel = (imu.accel_noise * imu.accel_noise + self.extra_noise.1) * dt;
        for k in 0..3 {
            self.p.add_variance(index::ATTITUDE + k, gyro);
            self.p.add_variance(index::VELOCITY + k, accel);
        }
        if let Some(since) = self.coasting_since_s {
            // A vehicle that is not observed goes on: variance of the distance, 50 m/s times the time.
            let t = self.t_s - since + COAST_AFTER_S;
            let growth = COAST_SPEED * COAST_SPEED * (2.0 * t * dt);
            (0..3).for_each(|k| self.p.add_variance(index::POSITION + k, growth));
        }
    }

    /// The random walks of biases that effects ask for, and of all constants where tolerances say that none is one for ever.
    pub(super) fn walk_constants(&mut self, dt: f64) {
        if self.gyro_walk > 0.0 {
            let variance = self.gyro_walk * self.gyro_walk * dt;
            (0..3).for_each(|k| self.p.add_variance(index::GYRO_BIAS + k, variance));
        }
        if self.biases_walk {
            for (setting, p) in self.model.effects.iter().zip(self.calibration.parameters()) {
                let walk = setting.effect.bias_walk(p);
                for k in 0..3 {
                    self.p.add_variance(index::GYRO_BIAS + k, walk.gyro * walk.gyro * dt);
                    self.p.add_variance(index::ACCEL_BIAS + k, walk.accel * walk.accel * dt);
                }
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

    /// Φ over one interval: axes turn as they did, attitude errors act on `lever`. A filter that coasts follows the attitude
    /// alone.
    fn transition(&mut self, inc: &Increment, lever: &Increment, coasts: bool) {
        let dt = inc.dt;
        let c_be = self.nav.q_eb.inverse().to_rotation_matrix().into_inner();
        let gradient = c_be * earth::gravity_gradient(&self.nav.r_e) * c_be.transpose() * dt;
        let rows = |m: Matrix3<f64>| m.transpose().into();
        let turn = if self.course.is_straight() { Vector3::zeros() } else { inc.dtheta };
        let phi = &mut self.phi;
        phi.dt = dt;
        phi.earth = (c_be * earth::rotation_rate() * dt).into();
        phi.to_end = rows(exp(&-turn).to_rotation_matrix().into_inner());
        phi.gradient = rows(gradient);
        phi.dv = lever.dv.into();
        phi.dp = lever.dp.into();
        phi.half_turn_dt = rows((Matrix3::identity() + skew(&turn) * 0.5) * dt);
        let end = &self.jacobian;
        let start = if self.kind == SampleKind::Point { &self.start_jacobian } else { end };
        phi.rate.set_mean(NAV, &start.rate, &end.rate);
        if coasts {
            phi.without_acceleration();
        } else {
            phi.force.set_mean(NAV, &start.force, &end.force);
        }
    }
}
