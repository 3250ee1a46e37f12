//! Stationarity: a vehicle that does not move has zero velocity, does not turn but with the Earth, and feels gravity alone.
//!
//! While it lasts, position, velocity and attitude are held (only the Earth turns them; the gyros do not), and mean rate
//! and mean specific force are measurements, C^T ω_ie = rate(x) and −C^T g = force(x). They are linearised once, about the
//! first estimate of the period, and counted once, as means: rows that follow every new estimate would span ever new
//! directions and bring information that nothing measured (first-estimates Jacobian, Huang, Mourikis & Roumeliotis 2010,
//! "Observability-based rules for designing consistent EKF SLAM estimators", section 4). What one linearisation leaves
//! out, and what the rounding of the source takes away, stays the same all the time and is a constant error of the means.

pub(crate) mod detector;

use crate::earth;
use crate::filter::Filter;
use crate::filter::calibration::MotionJacobian;
use crate::filter::covariance::Covariance;
use crate::filter::group::{Prepared, Rows};
use crate::filter::layout::index;
use crate::mechanization::Motion;
use crate::rotation::skew;
use crate::sample::ImuSample;
use nalgebra::{Matrix3, Vector3};
use std::collections::VecDeque;

/// 1-sigma of the velocity of a stationary vehicle, m/s.
const VELOCITY_SIGMA: f64 = 0.02;
/// NIS of zero velocity beyond which the filter knows that the vehicle moves: chance 1e-3.
const STOP_GATE: f64 = 16.3;
/// Means are kept in blocks of this length, s …
const BLOCK_S: f64 = 10.0;
/// … and reach back so many of them: longer means would mask a warming sensor.
const BLOCKS: usize = 18;
/// The estimate follows the means this often, s.
const REFRESH_S: f64 = 1.0;

/// Sums of rate and specific force over one block, as the first estimate compensates them.
#[derive(Debug, Clone, Copy, Default)]
struct Means {
    duration_s: f64,
    rate: Vector3<f64>,
    force: Vector3<f64>,
}

impl Means {
    /// The newest blocks of so long together, s; one at least.
    fn over(blocks: &VecDeque<Self>, longest_s: f64) -> Self {
        let mut sum = Self::default();
        for block in blocks.iter().rev() {
            if sum.duration_s > 0.0 && sum.duration_s + block.duration_s > longest_s {
                break;
            }
            sum.duration_s += block.duration_s;
            sum.rate += block.rate;
            sum.force += block.force;
        }
        sum
    }
}

/// A stationary period: what the filter is linearised about stays where it was at the first estimate.
#[derive(Debug, Clone)]
pub(in crate::filter) struct Hold {
    jacobian: MotionJacobian,
    /// C^T ω_ie and −C^T g there.
    expected: Motion,
    /// Variances of what the rows leave out.
    constant: [Vector3<f64>; 2],
    /// Mean error and covariance without the present means.
    base: (Vec<f64>, Covariance),
    blocks: VecDeque<Means>,
    refreshed_s: f64,
}

impl Filter {
    /// Whether the vehicle is held as stationary.
    pub fn is_stationary(&self) -> bool {
        self.hold.is_some()
    }

    /// Variances of what the rounding of the source may keep from every sample, (rad/s)² and (m/s²)².
    pub fn set_rounding_error(&mut self, variances: [Vector3<f64>; 2]) {
        self.rounding = variances;
    }

    /// Whether the fixes have been inconsistent with a stationary vehicle's position for more than a moment.
    pub(in crate::filter) fn moves_by_its_fixes(&self) -> bool {
        self.hold.is_some() && self.gates.position.lasts()
    }

    /// Begins a stationary period, unless the filter knows better: a steady climb looks like rest to samples and to fixes
    /// without vertical velocity.
    pub(in crate::filter) fn begin_hold(&mut self) {
        self.arrive();
        if self.hold.is_some() || self.pinned || !self.stop() {
            return;
        }
        let Some(last) = self.last else { return };
        let nav = &self.about.nav;
        let to_body = nav.q_eb.inverse();
        let expected =
            Motion { rate: to_body * earth::rotation_rate(), force: to_body * -earth::gravity(&nav.r_e) };
        let mut jacobian = MotionJacobian::default();
        let seen = Motion { rate: expected.rate, force: self.regressor.motion().force };
        self.about.calibration.jacobian(&self.model, &self.layout, &last, &seen, &mut jacobian);
        let constant = self.left_out(&expected, &jacobian);
        self.hold = Some(Box::new(Hold {
            jacobian,
            expected,
            constant,
            base: (self.x.clone(), self.p.clone()),
            blocks: VecDeque::new(),
            refreshed_s: self.t_s,
        }));
    }

    /// Ends it.
    pub(in crate::filter) fn end_hold(&mut self) {
        if self.hold.take().is_none() {
            return;
        }
        // Rest has aided it as well as any fix.
        self.aided_s = self.aided_s.map(|_| self.t_s);
        self.x[index::VELOCITY..index::ATTITUDE].fill(0.0);
        self.recentre();
        self.refresh_motion();
        self.find_estimate();
    }

    /// Zero velocity, once; rejected where it fails the innovation test.
    fn stop(&mut self) -> bool {
        self.recentre();
        let nav = &self.about.nav;
        let z = -(nav.c_eb().transpose() * nav.v_e);
        let mut rows = Rows {
            dof: 3,
            residual: z.into(),
            variance: [VELOCITY_SIGMA * VELOCITY_SIGMA; 3],
            ..Rows::default()
        };
        (0..3).for_each(|j| rows.push(index::VELOCITY + j, |i| if i == j { 1.0 } else { 0.0 }));
        let prepared = Prepared::new(&rows, &self.p).filter(|p| p.group.nis < STOP_GATE);
        let stops = prepared.is_some();
        if let Some(prepared) = prepared {
            self.absorb(prepared);
            self.recentre();
            self.about.nav.v_e = Vector3::zeros();
        }
        self.find_estimate();
        stops
    }

    /// Second-order terms of both measurements as variances per axis: products of attitude error with itself, ½ ε × (ε × f),
    /// and of the error of specific force with that of whatever multiplies it in the gyros.
    fn left_out(&self, expected: &Motion, jacobian: &MotionJacobian) -> [Vector3<f64>; 2] {
        let f = &expected.force;
        let [mut rate, force] = self.products_of_tilt(expected);
        let tilt = skew(f) * self.p.block3(index::ATTITUDE) * skew(f).transpose();
        rate += self.sensitivity_times_force(expected, &tilt.diagonal());
        // The regressor's specific force differs from gravity by what it holds back.
        for (k, (a, b)) in jacobian.rate.iter().zip(&self.rate_rows(f)).enumerate() {
            let variance = self.p.sigma(index::GYRO_BIAS + k).powi(2);
            rate += (a - b).map(|d| d * d * variance);
        }
        let [of_rate, of_gravity] = self.reference_error;
        [rate.add_scalar(of_rate), force.add_scalar(of_gravity)]
    }

    /// One sample of a stationary period.
    pub(in crate::filter) fn hold_step(&mut self, sample: &ImuSample, dt: f64) {
        let Some(mut hold) = self.hold.take() else { return };
        let motion = self.about.calibration.motion(&self.model, sample);
        self.about.motion = motion;
        self.regressor.take(&motion, self.noise_band(dt), dt);
        (self.to.motion, self.to.lever) = (motion, self.regressor.lever(&motion));
        if hold.blocks.back().is_none_or(|b| b.duration_s >= BLOCK_S) {
            self.rest_evidence += self.block_evidence(&hold.blocks);
            hold.blocks.push_back(Means::default());
            if hold.blocks.len() > BLOCKS {
                hold.blocks.pop_front();
            }
        }
        if let Some(block) = hold.blocks.back_mut() {
            block.duration_s += dt;
            block.rate += motion.rate * dt;
            block.force += motion.force * dt;
        }
        self.last = Some(*sample);
        self.t_s = sample.t_s;
        self.exchange_base(&mut hold);
        self.walk_constants(dt);
        self.decay_gauss_markov(dt);
        self.exchange_base(&mut hold);
        let due = self.t_s - hold.refreshed_s >= REFRESH_S;
        self.hold = Some(hold);
        if due {
            self.refresh_hold();
        }
    }

    fn exchange_base(&mut self, hold: &mut Hold) {
        std::mem::swap(&mut self.x, &mut hold.base.0);
        std::mem::swap(&mut self.p, &mut hold.base.1);
    }

    /// Mean error and covariance anew: what the fixes left, with the present means on top.
    fn refresh_hold(&mut self) {
        let Some(mut hold) = self.hold.take() else { return };
        hold.refreshed_s = self.t_s;
        self.x.clone_from(&hold.base.0);
        self.p.clone_from(&hold.base.1);
        for rows in self.mean_rows(&hold) {
            if let Ok(prepared) = self.tested(rows).1 {
                self.absorb(prepared);
            }
        }
        self.hold = Some(hold);
        self.find_estimate();
    }

    /// A longer mean of the rate says less of a bias that walks, s: the minimum of the variance below.
    fn longest_mean_s(&self) -> f64 {
        (3.0 * self.noise_density().0).sqrt() / self.gyro_walk_density()
    }

    /// Variance of a mean of the rate over so long about its value at either end, (rad/s)²: white noise n²/T and q² T/3 of a walk q, rad/s/√s.
    fn mean_rate_variance(&self, duration_s: f64, walk: f64) -> f64 {
        self.noise_density().0 / duration_s + walk.powi(2) * duration_s / 3.0
    }

    /// How much more likely the mean rate of the newest block is with this filter's walk than with the model's own alone, nats, where those before it
    /// are known: the bias of a stationary gyro is the same in both but for its walk. A ratio, so that filters whose periods began at
    /// different times can be compared.
    fn block_evidence(&self, blocks: &VecDeque<Means>) -> f64 {
        let mut before = blocks.clone();
        let Some(new) = before.pop_back() else { return 0.0 };
        let before = Means::over(&before, self.longest_mean_s());
        if before.duration_s <= 0.0 || new.duration_s <= 0.0 {
            return 0.0;
        }
        let off = new.rate / new.duration_s - before.rate / before.duration_s;
        let durations = [new.duration_s, before.duration_s];
        let variance =
            |walk: f64| -> f64 { durations.iter().map(|t| self.mean_rate_variance(*t, walk)).sum() };
        let variances = [self.gyro_walk_density(), self.model_gyro_walk_density()].map(variance);
        (0..3)
            .map(|k| {
                let [with, without] = variances.map(|v| {
                    let s = v + 2.0 * self.rounding[0][k];
                    -0.5 * ((off[k] * off[k] / s).min(super::gate(1)) + s.ln())
                });
                with - without
            })
            .sum()
    }

    fn mean_rows(&self, hold: &Hold) -> [Rows; 2] {
        let totals =
            [Means::over(&hold.blocks, self.longest_mean_s()), Means::over(&hold.blocks, f64::INFINITY)];
        if totals[0].duration_s <= 0.0 {
            return [Rows::default(), Rows::default()];
        }
        let noise = [
            self.mean_rate_variance(totals[0].duration_s, self.gyro_walk_density()),
            self.noise_density().1 / totals[1].duration_s,
        ];
        let rows = |kind: usize, expected: &Vector3<f64>, sum: Vector3<f64>, columns: &[Vector3<f64>]| {
            let mut rows = Rows { dof: 3, ..Rows::default() };
            rows.residual = (expected - sum / totals[kind].duration_s).into();
            for i in 0..3 {
                rows.variance[i] = noise[kind] + hold.constant[kind][i] + self.rounding[kind][i];
            }
            // exp(−ε) v = v + [v×] ε: what is expected moves with the attitude.
            let by_attitude: Matrix3<f64> = -skew(expected);
            (0..3).for_each(|j| rows.push(index::ATTITUDE + j, |i| by_attitude[(i, j)]));
            for (k, column) in columns.iter().enumerate() {
                rows.push(index::GYRO_BIAS + k, |i| column[i]);
            }
            rows
        };
        [
            rows(0, &hold.expected.rate, totals[0].rate, &hold.jacobian.rate),
            rows(1, &hold.expected.force, totals[1].force, &hold.jacobian.force),
        ]
    }

    /// Lets a job correct what fixes say of a stationary vehicle, and puts the means on top again.
    pub(in crate::filter) fn with_base<T>(&mut self, job: impl FnOnce(&mut Self) -> T) -> T {
        if let Some(hold) = self.hold.as_deref_mut() {
            self.x.clone_from(&hold.base.0);
            self.p.clone_from(&hold.base.1);
        }
        let result = job(self);
        if let Some(hold) = self.hold.as_deref_mut() {
            hold.base.0.clone_from(&self.x);
            hold.base.1.clone_from(&self.p);
        }
        self.refresh_hold();
        result
    }
}
