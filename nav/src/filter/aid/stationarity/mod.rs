//! Stationarity: a vehicle that does not move has zero velocity, does not turn but with the Earth, and feels gravity alone.
//!
//! While it lasts, position, velocity and attitude are held (only the Earth turns them; the gyros do not), and mean rate
//! and mean specific force are measurements, C^T ω_ie = rate(x) and −C^T g = force(x). They are linearised once, about the
//! first estimate of the period, and counted once, as means: rows that follow every new estimate would span ever new
//! directions and bring information that nothing measured (first-estimates Jacobian, Huang, Mourikis & Roumeliotis 2010,
//! "Observability-based rules for designing consistent EKF SLAM estimators", section 4). What one linearisation leaves
//! out, and what the rounding of the source takes away, stays the same all the time and is a constant error of the means.

pub(crate) mod detector;
mod support;

use crate::earth;
use crate::filter::Filter;
use crate::filter::calibration::MotionJacobian;
use crate::filter::covariance::Covariance;
use crate::filter::group::{Prepared, Rows};
use crate::filter::layout::index;
use crate::math::ln;
use crate::mechanization::Motion;
use crate::quantisation::ConstantError;
use crate::rotation::skew;
use crate::sample::ImuSample;
use nalgebra::{Matrix3, Vector3};
use std::collections::VecDeque;
pub(in crate::filter) use support::Supports;
use support::{GivesWay, Support};

/// 1-sigma of the velocity of a stationary vehicle, m/s.
const VELOCITY_SIGMA: f64 = 0.02;
/// NIS of zero velocity beyond which the filter knows that the vehicle moves: chance 1e-3.
const STOP_GATE: f64 = 16.3;
/// Means are kept in blocks of this length, s: a side that is held by hand for a quarter of a minute has two at least, which tell a unit that sinks into foam …
const BLOCK_S: f64 = 5.0;
/// … and reach back so many of them: longer means would mask a warming sensor.
const BLOCKS: usize = 36;
/// The estimate follows the means this often, s.
const REFRESH_S: f64 = 1.0;

/// Sums of rate and specific force over one block, as the first estimate compensates them.
#[derive(Debug, Clone, Copy, Default)]
struct Means {
    duration_s: f64,
    rate: Vector3<f64>,
    force: Vector3<f64>,
    /// What rounding does to both: the expected error and its variance, times the time.
    rounding: ConstantError,
}

impl Means {
    /// The newest blocks of so long together, s; one at least.
    fn over<'a>(blocks: impl DoubleEndedIterator<Item = &'a Self>, longest_s: f64) -> Self {
        let mut sum = Self::default();
        for block in blocks.rev() {
            if sum.duration_s > 0.0 && sum.duration_s + block.duration_s > longest_s {
                break;
            }
            sum.duration_s += block.duration_s;
            sum.rate += block.rate;
            sum.force += block.force;
            sum.round(&block.rounding, 1.0);
        }
        sum
    }

    /// Counts what rounding does for so long, s.
    fn round(&mut self, error: &ConstantError, for_s: f64) {
        for k in 0..2 {
            self.rounding.mean[k] += error.mean[k] * for_s;
            self.rounding.variance[k] += error.variance[k] * for_s;
        }
    }

    /// The mean rate, or force, without what rounding is expected to do to it, and the variance of what it may do.
    fn unrounded(&self, kind: usize) -> (Vector3<f64>, Vector3<f64>) {
        let sum = if kind == 0 { self.rate } else { self.force };
        ((sum - self.rounding.mean[kind]) / self.duration_s, self.rounding.variance[kind] / self.duration_s)
    }
}

/// The variance of a constant error of a mean that is known to this variance without it, so that both together say no more than a mean with that error.
///
/// Every period in which a unit stands on the same side has the same rounding error: what says that a mean lies within a count says it once. As independent
/// errors, of four times on one side, they gave a NEES of 1.5 per degree of freedom. Where the mean may lie anywhere it is the error itself.
fn counted_once(error: f64, known: f64) -> f64 {
    /// Share of what is known that is never taken for independent.
    const LEAST: f64 = 1e-6;
    let independent = known - error;
    if independent > LEAST * known { error * known / independent } else { error / LEAST }
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
    /// What it rests on, and how that gives way.
    support: Support,
    gives_way: GivesWay,
    /// Blocks that the base has taken already where the support gives way: what their rows left out is counted.
    taken: usize,
}

/// Half of what the attitude turns on a support that gives way: s of what the mean rate leaves over, and the variance of the rest, rad².
struct Turn {
    of_rate: Vector3<f64>,
    variance: Vector3<f64>,
}

impl Hold {
    /// The newest blocks of so long together, s, that the base has not taken.
    fn means(&self, longest_s: f64) -> Means {
        Means::over(self.blocks.iter().skip(self.taken), longest_s)
    }
}

impl Filter {
    /// Whether the vehicle is held as stationary.
    pub fn is_stationary(&self) -> bool {
        self.hold.is_some()
    }

    /// Variances of what the rounding of the source may keep from every sample, (rad/s)² and (m/s²)², and what it does to their mean at rest.
    pub fn set_rounding_error(&mut self, variances: [Vector3<f64>; 2], at_rest: &ConstantError) {
        (self.rounding, self.rounding_at_rest) = (variances, *at_rest);
    }

    /// How far the vehicle has turned on its support in the stationary period in which it did most, rad; zero on a firm one.
    pub fn turned_on_support(&self) -> f64 {
        let now = self.hold.as_ref().map_or(0.0, |hold| hold.support.turned());
        self.supports.turned().max(now)
    }

    /// States that a support that gives way spoils: biases, scale factors and axes of the gyros were off by 2.3 of their sigmas after sessions on foam
    /// (RMS of 12 units, `gaware study ground`); none where it stood firm.
    pub fn spoilt_by_support(&self) -> Vec<usize> {
        let spoilt = |effect| matches!(effect, "gyro_bias" | "gyro_scale_factor" | "gyro_misalignment");
        let names = self.layout.names().iter().enumerate().filter(|(_, n)| spoilt(n.effect));
        let turned = self.turned_on_support() > 0.0;
        names.filter(|_| turned).map(|(k, _)| index::GYRO_BIAS + k).collect()
    }

    /// The vehicle leaves what it rested on: what that has spoiled is as uncertain as before all measurements, about the value that it has.
    pub fn leave_support(&mut self) {
        let spoilt = self.spoilt_by_support();
        if spoilt.is_empty() {
            return;
        }
        // The period under way counts for the support as well: it ends first.
        self.end_hold();
        self.supports = Supports::default();
        for state in spoilt {
            self.p.reset(state, self.initial_sigmas.get(state).copied().unwrap_or_default());
        }
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
            gives_way: self.supports.judge(&Support::default()),
            support: Support::default(),
            taken: 0,
        }));
    }

    /// Ends it.
    pub(in crate::filter) fn end_hold(&mut self) {
        let Some(hold) = self.hold.take() else { return };
        self.supports.add(&hold.support);
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
        self.feel(dt);
        (self.to.motion, self.to.lever) = (motion, self.lever());
        if hold.blocks.back().is_none_or(|b| b.duration_s >= BLOCK_S) {
            self.judge_support(&mut hold);
            self.rest_evidence += self.block_evidence(&hold);
            hold.blocks.push_back(Means::default());
            if hold.blocks.len() > BLOCKS {
                hold.blocks.pop_front();
                hold.taken = hold.taken.saturating_sub(1);
            }
        }
        if let Some(block) = hold.blocks.back_mut() {
            block.duration_s += dt;
            block.rate += motion.rate * dt;
            block.force += motion.force * dt;
            block.round(&self.rounding_at_rest, dt);
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

    /// Takes the block that is complete for what it says of the support. Where that gives way, the attitude turns in the base, block by block.
    fn judge_support(&mut self, hold: &mut Hold) {
        let Some(block) = hold.blocks.back() else { return };
        let for_s = block.duration_s;
        let walked = self.accel_walk_density().powi(2) * for_s;
        hold.support.take(&(block.force / for_s), for_s, self.noise_density().1 / for_s, walked);
        hold.gives_way = self.supports.judge(&hold.support);
        if !hold.gives_way.is_firm() {
            self.put_means_on(hold);
            hold.base = (self.x.clone(), self.p.clone());
            hold.taken = hold.blocks.len();
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
        self.put_means_on(&hold);
        self.hold = Some(hold);
        self.find_estimate();
    }

    /// The base with the present means on top. On a support that gives way the mean rate is bias and turn together: of its innovation w a share q/V is the
    /// turn (q its variance over the squared time, V that of all that the mean rate does not say), with a variance of q (1 − q/V). The mean specific force is that of
    /// the attitude half way.
    fn put_means_on(&mut self, hold: &Hold) {
        self.x.clone_from(&hold.base.0);
        self.p.clone_from(&hold.base.1);
        let for_s = hold.means(f64::INFINITY).duration_s;
        let [rate, force] = self.mean_rows(hold);
        let of_turn = hold.gives_way.variance(for_s) / (for_s * for_s);
        let half = Turn {
            of_rate: Vector3::from(rate.variance).map(|v| 0.5 * for_s * of_turn / v),
            variance: Vector3::from(rate.variance)
                .map(|v| 0.5 * for_s * for_s * of_turn * (1.0 - of_turn / v)),
        };
        let turns = !hold.gives_way.is_firm() && for_s > 0.0;
        let seen = rate.clone();
        for rows in [rate, force] {
            if let Ok(prepared) = self.tested(rows).1 {
                self.absorb(prepared);
            }
            if turns {
                self.turn_on_support(&seen, &half);
            }
        }
    }

    /// Turns the attitude by a share of what the rows of the mean rate leave over.
    fn turn_on_support(&mut self, rows: &Rows, turn: &Turn) {
        let ph = self.p.times(&rows.h);
        let mut of_rows = Matrix3::zeros();
        for (state, by) in &rows.h {
            of_rows += Vector3::from(*by) * Vector3::from(ph.at(*state)).transpose();
        }
        let left = Vector3::from(rows.clone().less(&self.x).residual);
        let share = Matrix3::from_diagonal(&turn.of_rate);
        let a = index::ATTITUDE;
        let attitude = Matrix3::from_fn(|i, j| ph.at(a + j)[i]);
        let cross = share * attitude;
        let block = self.p.block3(a)
            + cross
            + cross.transpose()
            + share * of_rows * share
            + Matrix3::from_diagonal(&turn.variance);
        for state in (0..self.p.len()).filter(|state| !(a..a + 3).contains(state)) {
            let with = Vector3::from_fn(|i, _| self.p.at(a + i, state));
            self.p.set_cross3(a, state, &(with + share * Vector3::from(ph.at(state))));
        }
        self.p.set_block3(a, &block);
        (0..3).for_each(|i| self.x[a + i] -= turn.of_rate[i] * left[i]);
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
    fn block_evidence(&self, hold: &Hold) -> f64 {
        let mut before = hold.blocks.clone();
        let Some(new) = before.pop_back() else { return 0.0 };
        let before = Means::over(before.iter(), self.longest_mean_s());
        if before.duration_s <= 0.0 || new.duration_s <= 0.0 {
            return 0.0;
        }
        let [(now, of_now), (earlier, of_earlier)] = [new.unrounded(0), before.unrounded(0)];
        let durations = [new.duration_s, before.duration_s];
        let turned = hold.gives_way.variance(new.duration_s) / new.duration_s.powi(2)
            + hold.gives_way.variance(before.duration_s) / before.duration_s.powi(2);
        let (off, left_out) = (now - earlier, (of_now + of_earlier).add_scalar(turned));
        let variance =
            |walk: f64| -> f64 { durations.iter().map(|t| self.mean_rate_variance(*t, walk)).sum() };
        let variances = [self.gyro_walk_density(), self.model_gyro_walk_density()].map(variance);
        (0..3)
            .map(|k| {
                let [with, without] = variances.map(|v| {
                    let s = v + left_out[k];
                    -0.5 * ((off[k] * off[k] / s).min(super::gate(1)) + ln(s))
                });
                with - without
            })
            .sum()
    }

    fn mean_rows(&self, hold: &Hold) -> [Rows; 2] {
        let totals = [hold.means(self.longest_mean_s()), hold.means(f64::INFINITY)];
        if totals[0].duration_s <= 0.0 {
            return [Rows::default(), Rows::default()];
        }
        let noise = [
            self.mean_rate_variance(totals[0].duration_s, self.gyro_walk_density()),
            self.noise_density().1 / totals[1].duration_s,
        ];
        let rows = |kind: usize, expected: &Vector3<f64>, columns: &[Vector3<f64>]| {
            let mut rows = Rows { dof: 3, ..Rows::default() };
            let (mean, rounding) = totals[kind].unrounded(kind);
            rows.residual = (expected - mean).into();
            // exp(−ε) v = v + [v×] ε: what is expected moves with the attitude.
            let by_attitude: Matrix3<f64> = -skew(expected);
            (0..3).for_each(|j| rows.push(index::ATTITUDE + j, |i| by_attitude[(i, j)]));
            for (k, column) in columns.iter().enumerate() {
                rows.push(index::GYRO_BIAS + k, |i| column[i]);
            }
            let known = rows.variances_by(&hold.base.1);
            // A turn of variance q: q/T² of the mean rate; of the attitude half way all but q/12.
            let for_s = totals[kind].duration_s;
            let q = hold.gives_way.variance(for_s);
            let turned = if kind == 0 {
                Vector3::repeat(q / (for_s * for_s))
            } else {
                expected.map(|e| q / 12.0 * (expected.norm_squared() - e * e))
            };
            for i in 0..3 {
                let constant = hold.constant[kind][i];
                let [once, again] =
                    if hold.taken > 0 && kind == 0 { [0.0, constant] } else { [constant, 0.0] };
                rows.variance[i] =
                    noise[kind] + turned[i] + once + counted_once(rounding[i] + again, known[i]);
            }
            rows
        };
        [
            rows(0, &hold.expected.rate, &hold.jacobian.rate),
            rows(1, &hold.expected.force, &hold.jacobian.force),
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

#[cfg(test)]
mod tests {
    use super::counted_once;

    /// Kalman's P R / (P + R) with that variance: no less than the error, however often it is measured, and no more than what was known.
    #[test]
    fn an_error_that_stays_is_counted_once() {
        let (error, mut known) = (0.3, 100.0);
        for _ in 0..5 {
            let r = counted_once(error, known);
            known = known * r / (known + r);
            assert!((known - error).abs() < 1e-5, "{known}");
        }
        assert!((counted_once(error, 1e9) / error - 1.0).abs() < 1e-8);
        assert!(counted_once(error, 0.1) > 1e5 && counted_once(0.0, 0.0) == 0.0);
    }
}
