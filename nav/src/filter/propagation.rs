//! The time step: mechanisation, transition matrix and process noise.

use super::Filter;
use super::covariance::NAV;
use super::layout::index;
use crate::earth;
use crate::mechanization::{self, Increment, Motion};
use crate::rotation::{exp, skew};
use crate::sample::{ImuSample, SampleKind};
use nalgebra::{Matrix3, Vector3};

/// A gap between samples longer than this is not integrated as if nothing had happened, s.
const GAP_S: f64 = 0.25;
/// Biases known to this share of the former sigma are known much better.
const MUCH_BETTER: f64 = 0.25;
/// What differs from the last value by more than so many sigmas of the noise is motion …
const BEYOND_NOISE: f64 = 4.0;
/// … and what does not is averaged over this time, s.
const STEADY_S: f64 = 0.5;
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
        self.regressor = self.without_noise(&self.settled.calibration.motion(&self.model, sample), dt);
        self.calibration.jacobian(&self.model, &self.layout, sample, &self.regressor, &mut self.jacobian);
        self.propagate_covariance(&inc);
        self.watch_step(sample, &motion, &inc);
        self.nav = mechanization::step(&self.nav, &inc);
        self.wander *= self.wander_decay(dt);
        self.motion = motion;
        self.last = Some(*sample);
        self.t_s = sample.t_s;
        self.tape_step(dt, self.wander_decay(dt));
    }

    fn watch_step(&mut self, sample: &ImuSample, motion: &Motion, inc: &Increment) {
        let decay = self.wander_decay(inc.dt);
        if let Some(watch) = self.watch.as_deref_mut() {
            watch.sample(sample, motion, self.nav.v_e.norm(), &self.calibration, &self.model);
            watch.propagate(&self.phi, inc, self.kind, decay);
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
        self.regressor = self.settled.calibration.motion(&self.model, sample);
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

    /// The motion as the constants see it. Noise of the accelerometers is not felt by the gyros: taken as excitation it
    /// would make G known to a vehicle that stands (errors in variables, Fuller 1987, section 1.1). So what lies within
    /// the noise of the last value is averaged over [`STEADY_S`], and what exceeds it is taken at once.
    fn without_noise(&self, motion: &Motion, dt: f64) -> Motion {
        let imu = &self.model.imu;
        let band = |n: f64, extra: f64| BEYOND_NOISE * ((n * n + extra) / dt.max(1e-4)).sqrt();
        let share = (dt / STEADY_S).min(1.0);
        let toward = |old: &Vector3<f64>, new: &Vector3<f64>, band: f64| {
            old.zip_map(new, |o, n| if (n - o).abs() < band { o + share * (n - o) } else { n })
        };
        Motion {
            rate: toward(&self.regressor.rate, &motion.rate, band(imu.gyro_noise, self.extra_noise.0)),
            force: toward(&self.regressor.force, &motion.force, band(imu.accel_noise, self.extra_noise.1)),
        }
    }

    /// Takes biases over for the regressors once all three are known much better than those in use. Linearising about
    /// every new estimate would make the motion seem to change with it (first-estimates Jacobian, Huang, Mourikis &
    /// Roumeliotis 2010).
    pub(super) fn settle(&mut self) {
        let worst = |at: usize| (0..3).map(|k| self.p.sigma(at + k)).fold(0.0, f64::max);
        let (gyro, accel) = (worst(index::GYRO_BIAS), worst(index::ACCEL_BIAS));
        if gyro < MUCH_BETTER * self.settled.gyro_sigma {
            self.settled.gyro_sigma = gyro;
            self.settled.calibration.gyro_bias = self.calibration.gyro_bias;
            self.settled.calibration.parameters.clone_from(&self.calibration.parameters);
        }
        if accel < MUCH_BETTER * self.settled.accel_sigma {
            self.settled.accel_sigma = accel;
            self.settled.calibration.accel_bias = self.calibration.accel_bias;
            self.settled.calibration.parameters.clone_from(&self.calibration.parameters);
        }
    }

    /// Motion and Jacobian of the last sample anew, after the calibration changed.
    pub(super) fn refresh_motion(&mut self) {
        let Some(last) = self.last else { return };
        self.motion = self.calibration.motion(&self.model, &last);
        let mut jacobian = std::mem::take(&mut self.jacobian);
        self.calibration.jacobian(&self.model, &self.layout, &last, &self.regressor, &mut jacobian);
        self.jacobian = jacobian;
    }

    fn wander_decay(&self, dt: f64) -> f64 {
        let tau = self.model.gnss.position_correlation_s;
        if tau > 0.0 { (-dt / tau).exp() } else { 1.0 }
    }

    /// P ← Φ P Φᵀ + Q, with half of Q before and half after, so that noise also reaches velocity and position.
    fn propagate_covariance(&mut self, inc: &Increment) {
        self.transition(inc);
        self.add_process_noise(inc.dt * 0.5);
        self.p.propagate(&self.phi);
        self.carry(inc.dt);
        self.add_process_noise(inc.dt * 0.5);
        if inc.dt > GAP_S {
            for k in 0..3 {
                self.p.add_variance(index::ATTITUDE + k, (GAP_MOTION.0 * inc.dt).powi(2));
                self.p.add_variance(index::VELOCITY + k, (GAP_MOTION.1 * inc.dt).powi(2));
                self.p.add_variance(index::POSITION + k, (0.5 * GAP_MOTION.1 * inc.dt * inc.dt).powi(2));
            }
        }
        if let Some(w) = self.layout.wander() {
            let decay = self.wander_decay(inc.dt);
            for (k, sigma) in self.model.gnss.position_wander_sigma_m.into_iter().enumerate() {
                self.p.scale(w + k, decay);
                self.p.add_variance(w + k, sigma * sigma * (1.0 - decay * decay));
            }
        }
    }

    /// Takes the carried error along: x ← Φ x.
    fn carry(&mut self, dt: f64) {
        let decay = self.wander_decay(dt);
        let Some(x) = &mut self.carried else { return };
        let n = x.len();
        let moved: Vec<f64> =
            self.phi.chunks_exact(n).map(|row| row.iter().zip(x.iter()).map(|(a, b)| a * b).sum()).collect();
        x[..NAV].copy_from_slice(&moved);
        if let Some(w) = self.layout.wander() {
            x[w..w + 3].iter_mut().for_each(|v| *v *= decay);
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

    /// The nine rows of Φ over one interval.
    ///
    /// In the axes of the start attitude, with Δv = ∫Cf: ε' = ε + δθ, δv' = δv − Δv×ε − ω_ie×δv + Γ δr + ∫Cδf,
    /// δr' = δr + δv dt + …; then everything turns into the axes of the end attitude. (Barrau & Bonnabel 2017 for the
    /// structure; Earth terms from the paper's eqs. (7) and (15).)
    fn transition(&mut self, inc: &Increment) {
        let end = &self.jacobian;
        let start = if self.kind == SampleKind::Point { &self.start_jacobian } else { end };
        let n = self.layout.len();
        self.phi.clear();
        self.phi.resize(NAV * n, 0.0);
        let dt = inc.dt;
        let to_end = exp(&-inc.dtheta).to_rotation_matrix().into_inner();
        let c_be = self.nav.q_eb.inverse().to_rotation_matrix().into_inner();
        let earth_rate = skew(&(c_be * earth::rotation_rate())) * dt;
        let gradient = c_be * earth::gravity_gradient(&self.nav.r_e) * c_be.transpose() * dt;
        let (dv, dp) = (skew(&inc.dv), skew(&inc.dp));
        let identity = Matrix3::identity();
        let mut put = |row: usize, column: usize, block: Matrix3<f64>| {
            let turned = to_end * block;
            for i in 0..3 {
                for j in 0..3 {
                    self.phi[(row + i) * n + column + j] = turned[(i, j)];
                }
            }
        };
        put(index::POSITION, index::POSITION, identity + earth_rate);
        put(index::POSITION, index::VELOCITY, identity * dt);
        put(index::POSITION, index::ATTITUDE, -dp);
        put(index::VELOCITY, index::POSITION, gradient);
        put(index::VELOCITY, index::VELOCITY, identity - earth_rate);
        put(index::VELOCITY, index::ATTITUDE, -dv);
        put(index::ATTITUDE, index::ATTITUDE, identity);
        let half_turn = identity + skew(&inc.dtheta) * 0.5;
        for k in 0..n - NAV {
            let rate = start.rate[k].lerp(&end.rate[k], 0.5);
            let force = start.force[k].lerp(&end.force[k], 0.5);
            if rate == Vector3::zeros() && force == Vector3::zeros() {
                continue;
            }
            let dtheta = half_turn * rate * dt;
            let dvel = half_turn * force * dt - dv * dtheta * 0.5;
            let dpos = force * (0.5 * dt * dt) - dp * dtheta / 3.0;
            for (row, v) in [(index::POSITION, dpos), (index::VELOCITY, dvel), (index::ATTITUDE, dtheta)] {
                let turned = to_end * v;
                for i in 0..3 {
                    self.phi[(row + i) * n + NAV + k] = turned[i];
                }
            }
        }
    }
}
