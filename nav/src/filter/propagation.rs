//! The time step: mechanisation, transition matrix and process noise.

use super::Filter;
use super::covariance::NAV;
use super::layout::index;
use super::nav_map::{dense_rows, moved};
use super::regressor::BEYOND_NOISE;
use crate::earth;
use crate::mechanization::{self, Increment, Motion};
use crate::rotation::{exp, skew};
use crate::sample::{ImuSample, SampleKind};
use nalgebra::Matrix3;

/// A gap between samples longer than this is not integrated as if nothing had happened, s.
const GAP_S: f64 = 0.25;
/// What an unseen vehicle may do in a gap: rate, rad/s, and acceleration, m/s².
const GAP_MOTION: (f64, f64) = (0.5, 5.0);

impl Filter {
    /// Takes the state to the time of this sample. Samples from the past are ignored.
    pub fn propagate(&mut self, sample: &ImuSample) {
        if self.last.is_none() {
            self.start_at(sample);
            return;
        }
        let dt = sample.t_s - self.t_s;
        if dt <= 0.0 {
            return;
        }
        let motion = self.calibration.motion(&self.model, sample);
        let inc = Increment::between(&self.motion, &motion, self.kind, dt);
        std::mem::swap(&mut self.jacobian, &mut self.start_jacobian);
        self.regressor.take(&motion, self.noise_band(dt), dt);
        let seen = self.regressor.motion();
        self.calibration.jacobian(&self.model, &self.layout, sample, &seen, &mut self.jacobian);
        let decay = self.wander_decay(dt);
        self.transition(&inc);
        self.carry_along(sample, &motion, &inc, decay);
        self.propagate_covariance(dt, decay);
        self.nav = mechanization::step(&self.nav, &inc);
        self.wander *= decay;
        self.motion = motion;
        self.last = Some(*sample);
        self.t_s = sample.t_s;
        self.tape_step(dt, decay);
    }

    /// Takes what is linear in the state's error along: the watch, and the carried mean x ← Φ x.
    fn carry_along(&mut self, sample: &ImuSample, motion: &Motion, inc: &Increment, decay: f64) {
        if self.watch.is_none() && self.carried.is_none() {
            return;
        }
        let n = self.layout.len();
        if let Some(watch) = self.watch.as_deref_mut() {
            let phi = dense_rows(&self.phi, n);
            watch.sample(sample, motion, self.nav.v_e.norm(), &self.calibration, &self.model);
            watch.propagate(&phi, inc, self.kind, decay);
        }
        if let Some(x) = &mut self.carried {
            let moved = moved(&self.phi, x);
            x[..NAV].copy_from_slice(&moved);
            if let Some(w) = self.layout.wander() {
                x[w..w + 3].iter_mut().for_each(|v| *v *= decay);
            }
        }
    }

    /// Takes the state to a time between the last sample and the next one.
    pub fn propagate_to(&mut self, t_s: f64, next: &ImuSample) {
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
        self.propagate(&between);
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
            self.propagate(sample);
        } else if dt > 0.0 {
            self.t_s = sample.t_s;
        }
    }

    /// How far noise reaches in one sample of rate, rad/s, and force, m/s².
    fn noise_band(&self, dt: f64) -> (f64, f64) {
        let imu = &self.model.imu;
        let band = |n: f64, extra: f64| BEYOND_NOISE * ((n * n + extra) / dt.max(1e-4)).sqrt();
        (band(imu.gyro_noise, self.extra_noise.0), band(imu.accel_noise, self.extra_noise.1))
    }

    /// Motion and Jacobian of the last sample anew, after the calibration changed.
    pub(super) fn refresh_motion(&mut self) {
        let Some(last) = self.last else { return };
        let motion = self.calibration.motion(&self.model, &last);
        self.regressor.estimate_changed(&self.motion, &motion);
        self.motion = motion;
        let seen = self.regressor.motion();
        let mut jacobian = std::mem::take(&mut self.jacobian);
        self.calibration.jacobian(&self.model, &self.layout, &last, &seen, &mut jacobian);
        self.jacobian = jacobian;
    }

    fn wander_decay(&self, dt: f64) -> f64 {
        let tau = self.model.gnss.position_correlation_s;
        if tau > 0.0 { (-dt / tau).exp() } else { 1.0 }
    }

    /// P ← Φ P Φᵀ + Q, with half of Q before and half after, so that noise also reaches velocity and position.
    fn propagate_covariance(&mut self, dt: f64, decay: f64) {
        self.add_process_noise(dt * 0.5);
        self.p.transform(&self.phi);
        self.add_process_noise(dt * 0.5);
        if dt > GAP_S {
            for k in 0..3 {
                self.p.add_variance(index::ATTITUDE + k, (GAP_MOTION.0 * dt).powi(2));
                self.p.add_variance(index::VELOCITY + k, (GAP_MOTION.1 * dt).powi(2));
                self.p.add_variance(index::POSITION + k, (0.5 * GAP_MOTION.1 * dt * dt).powi(2));
            }
        }
        if let Some(w) = self.layout.wander() {
            self.p.scale3(w, decay);
            for (k, sigma) in self.model.gnss.position_wander_sigma_m.into_iter().enumerate() {
                self.p.add_variance(w + k, sigma * sigma * (1.0 - decay * decay));
            }
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
        for (setting, p) in self.model.effects.iter().zip(&self.calibration.parameters) {
            let walk = setting.effect.bias_walk(p);
            for k in 0..3 {
                self.p.add_variance(index::GYRO_BIAS + k, walk.gyro * walk.gyro * dt);
                self.p.add_variance(index::ACCEL_BIAS + k, walk.accel * walk.accel * dt);
            }
        }
    }

    /// Φ over one interval.
    fn transition(&mut self, inc: &Increment) {
        let dt = inc.dt;
        let c_be = self.nav.q_eb.inverse().to_rotation_matrix().into_inner();
        let gradient = c_be * earth::gravity_gradient(&self.nav.r_e) * c_be.transpose() * dt;
        let rows = |m: Matrix3<f64>| m.transpose().into();
        let phi = &mut self.phi;
        phi.dt = dt;
        phi.to_end = rows(exp(&-inc.dtheta).to_rotation_matrix().into_inner());
        phi.earth = (c_be * earth::rotation_rate() * dt).into();
        phi.gradient = rows(gradient);
        phi.dv = inc.dv.into();
        phi.dp = inc.dp.into();
        phi.half_turn_dt = rows((Matrix3::identity() + skew(&inc.dtheta) * 0.5) * dt);
        let end = &self.jacobian;
        let start = if self.kind == SampleKind::Point { &self.start_jacobian } else { end };
        phi.rate.set_mean(NAV, &start.rate, &end.rate);
        phi.force.set_mean(NAV, &start.force, &end.force);
    }
}
