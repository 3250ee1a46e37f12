//! Aids: what corrects the inertial navigation, one file each (as in PX4's EKF2): which rows it gives at its time of
//! validity, its innovation test, and how the filter starts anew from it when the test cannot be right.

pub(super) mod gnss_position;
pub(super) mod gnss_velocity;
pub(super) mod gnss_yaw;
pub mod stationarity;

use super::force_rate;
use super::group::Rows;
use super::layout::index;
use super::regressor::BEYOND_NOISE;
use super::second_order::{ERRORS, FORCE};
use super::{Filter, Point};
use crate::effects::{ActsOn, FixInstant, Older};
use crate::linear::fix::{self, AtFix, Measured};
use crate::mechanization::Motion;
use crate::rotation::skew;
use crate::sample::GnssFix;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// NIS beyond which a group of 1, 2, 3 rows is rejected: chance 6e-7, five sigma of one row.
const GATE: [f64; 4] = [f64::INFINITY, 25.0, 28.7, 31.8];
/// After so long without an accepted group the filter starts anew from the fixes, s.
const LOCKED_OUT_S: f64 = 3.0;
/// … and after at least so many rejections.
const LOCKED_OUT_COUNT: u32 = 4;
/// Attitude uncertainty that is added when position and velocity both started anew, rad.
const LOCKED_OUT_ATTITUDE: f64 = 0.05;
/// What differs by less than so many of its own sigmas has not been seen to differ.
const ERROR_SIGMAS: f64 = 4.0;
/// No fix is assumed to be better than this, m and m/s.
const SIGMA_FLOOR: f64 = 0.01;

/// NIS beyond which a group of so many rows is rejected.
pub fn gate(dof: usize) -> f64 {
    GATE.get(dof).copied().unwrap_or(GATE[3])
}

/// Since when an aid has been rejected.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Rejections {
    since_s: Option<f64>,
    count: u32,
}

impl Rejections {
    pub(super) fn accept(&mut self) {
        *self = Self::default();
    }

    pub(super) fn reject(&mut self, t_s: f64) {
        self.count += 1;
        self.since_s.get_or_insert(t_s);
    }

    /// Whether nothing but rejections have come for so long that the filter must be wrong.
    pub(super) fn locked_out(&self, t_s: f64) -> bool {
        self.for_at_least(t_s, LOCKED_OUT_S)
    }

    pub(super) fn for_at_least(&self, t_s: f64, duration_s: f64) -> bool {
        self.count >= LOCKED_OUT_COUNT && self.since_s.is_some_and(|since| t_s - since >= duration_s)
    }

    /// Whether there are more rejections in a row than outliers come.
    pub(super) fn lasts(&self) -> bool {
        self.count >= 3
    }

    /// Whether this rejection is the one that makes more than an outlier of them.
    pub(super) fn has_begun_to_last(&self) -> bool {
        self.count == 3
    }
}

/// The clocks of all aids.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Gates {
    pub(super) position: Rejections,
    pub(super) velocity: Rejections,
    pub(super) yaw: Rejections,
}

/// A fix about the present state.
pub(super) struct Linearised {
    pub(super) now: FixInstant,
    /// What the parameters of a fix multiply: noise of the estimate is no excitation.
    excited: FixInstant,
    /// Position and velocity.
    pub(super) groups: [Measured; 2],
}

impl Filter {
    /// Values are those of the trajectory that everything is linearised about; what the parameters of a fix multiply is taken from the
    /// estimate: a trajectory that is off by a mean error that is known has another velocity and acceleration than the vehicle.
    pub(super) fn linearise(&self, fix: &GnssFix) -> Linearised {
        let Point { nav, calibration, motion } = &self.about;
        let at = AtFix {
            nav,
            motion,
            shown: self.last.map_or(motion.force, |last| last.accel),
            model: &self.model,
            calibration,
            rates: self.nearby.as_deref(),
            t_s: self.t_s,
            elapsed_s: self.t_s - self.began_s,
        };
        let now = at.instant();
        let own = &self.estimate;
        let motion = Motion {
            rate: self.to.lever.rate + own.motion.rate - motion.rate,
            force: self.to.lever.force + own.motion.force - motion.force,
        };
        let seen = AtFix { nav: &own.nav, motion: &motion, rates: None, ..at }.instant();
        // Of a vehicle that has long done nothing else, a receiver smooths nothing but noise.
        let (a_n, smoothed) = if self.regressor.moving() {
            (seen.a_n, [now.smoothed_a_n - now.a_n, now.skewed_n])
        } else {
            (self.beyond_error(seen.a_n, &motion.force, &now.c_nb), [Vector3::zeros(); 2])
        };
        let [smoothed, skewed_n] = smoothed;
        let excited = FixInstant {
            v_n: seen.v_n,
            a_n,
            smoothed_a_n: a_n + smoothed,
            skewed_n,
            rate_eb: seen.rate_eb,
            force_rate: self.beyond_noise(now.force_rate),
            ..now
        };
        let acceleration = excited.smoothed_a_n - excited.jerk_n() * now.older.lag_s;
        let excited = FixInstant { older: Older { acceleration, ..now.older }, ..excited };
        let groups = at.measured(fix, &now);
        Linearised { now, excited, groups }
    }

    /// The acceleration, north-east-down, of a vehicle that has long done nothing else, without what errors of attitude and calibration
    /// make of none: fix after fix would take the same error for a change of velocity, and learn a latency from it.
    fn beyond_error(&self, a_n: Vector3<f64>, force: &Vector3<f64>, c_nb: &Matrix3<f64>) -> Vector3<f64> {
        // δa = C (δf − f × ε) (Groves 2013, section 14.2.2).
        let mut h = SMatrix::<f64, 3, ERRORS>::zeros();
        h.fixed_columns_mut::<3>(0).copy_from(&(-c_nb * skew(force)));
        h.fixed_columns_mut::<3>(FORCE).copy_from(c_nb);
        let variance = (h * self.covariance_of_errors() * h.transpose()).diagonal();
        a_n.zip_map(&variance, |a, v| if a * a < (ERROR_SIGMAS * ERROR_SIGMAS) * v { 0.0 } else { a })
    }

    /// A rate of change of the specific force without what may be noise of the samples.
    fn beyond_noise(&self, force_rate: Vector3<f64>) -> Vector3<f64> {
        let band = BEYOND_NOISE * force_rate::noise(self.noise_density().1);
        force_rate.map(|r| if r.abs() < band { 0.0 } else { r })
    }

    /// Variances per hertz of gyros, (rad/s)²/Hz, and accelerometers, (m/s²)²/Hz.
    pub(super) fn noise_density(&self) -> (f64, f64) {
        let imu = &self.model.imu;
        let (gyro, accel) = (imu.gyro_noise * imu.gyro_noise, imu.accel_noise * imu.accel_noise);
        (gyro + self.extra_noise.0, accel + self.extra_noise.1)
    }

    /// Rows of position (0) or velocity (1): an error of the time stamp moves all of them together.
    pub(super) fn rows_of(&self, group: usize, fix: &GnssFix, x: &Linearised) -> Rows {
        let m = &x.groups[group];
        let (block, drift) =
            [(index::POSITION, x.excited.v_n), (index::VELOCITY, x.excited.smoothed_a_n)][group];
        let mut rows = Rows { dof: m.rows, ..Rows::default() };
        let residual = m.residual - m.drift * self.fix_ahead_s(fix);
        for i in 0..m.rows {
            rows.residual[i] = residual[i];
            rows.variance[i] = m.sigma[i].max(SIGMA_FLOOR).powi(2);
            rows.shared[i] = drift[i] * self.model.gnss.time_sigma_s;
        }
        (0..3).for_each(|j| rows.push(block + j, |i| m.own[(i, j)]));
        (0..3).for_each(|j| rows.push(index::ATTITUDE + j, |i| m.attitude[(i, j)]));
        let mut slots = self.layout.slots();
        for (e, (setting, p)) in
            self.model.effects.iter().zip(self.about.calibration.parameters()).enumerate()
        {
            let (own, rest) = slots.split_at(slots.iter().take_while(|s| s.effect == e).count());
            slots = rest;
            if own.is_empty() || !setting.effect.acts_on(ActsOn::Fixes) {
                continue;
            }
            let columns = fix::columns(setting, p, &x.excited);
            own.iter().for_each(|s| rows.push(s.state, |i| columns[group][s.parameter][i]));
        }
        rows
    }

    /// Adds to the attitude what a filter that was wrong does not know of its error.
    pub(super) fn loosen_attitude(&mut self) {
        (0..3).for_each(|k| self.p.add_variance(index::ATTITUDE + k, LOCKED_OUT_ATTITUDE.powi(2)));
    }
}
