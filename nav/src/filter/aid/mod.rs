//! Aids: what corrects the inertial navigation, one file each (as in PX4's EKF2): which rows it gives at its time of
//! validity, its innovation test, and how the filter starts anew from it when the test cannot be right.

pub(super) mod gnss_position;
pub(super) mod gnss_velocity;
pub(super) mod gnss_yaw;
pub mod stationarity;

use super::Filter;
use super::force_rate;
use super::group::Rows;
use super::layout::index;
use super::regressor::BEYOND_NOISE;
use super::second_order::{ERRORS, FORCE};
use crate::earth;
use crate::effects::{Antenna, FixInstant, MAX_PARAMETERS, Older};
use crate::mechanization;
use crate::rotation::skew;
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

/// What the effects add to position or velocity of a fix, and how that depends on the states.
#[derive(Debug, Clone, Default)]
pub(super) struct Added {
    pub(super) sum: Vector3<f64>,
    by_attitude: Matrix3<f64>,
    by_state: Vec<(usize, Vector3<f64>)>,
}

/// The vehicle at the time of validity of a fix.
pub(super) struct AtFix {
    pub(super) now: FixInstant,
    /// The same with the motion that constants are judged by: noise of the estimate is no excitation.
    pub(super) excited: FixInstant,
    pub(super) c_ne: Matrix3<f64>,
}

impl Filter {
    pub(super) fn at_fix(&self) -> AtFix {
        let c_ne = earth::c_en_at(&self.nav.r_e).transpose();
        let c_nb = c_ne * self.nav.c_eb();
        let earth_b = self.nav.q_eb.inverse() * earth::rotation_rate();
        let rates = self.nearby.as_deref();
        let a_n = |force: &Vector3<f64>| c_ne * mechanization::acceleration(&self.nav, force);
        let now = FixInstant {
            t_s: self.t_s,
            v_n: c_ne * self.nav.v_e,
            a_n: a_n(&self.motion.force),
            c_nb,
            rate_eb: self.motion.rate - earth_b,
            force_rate: rates.map_or(Vector3::zeros(), |f| f.at(self.t_s)),
            antenna: Antenna::of(
                self.model
                    .effects
                    .iter()
                    .map(|s| s.effect)
                    .zip(self.calibration.parameters().iter().map(Vec::as_slice)),
                rates.map_or_else(Default::default, |f| f.of_rate_at(self.t_s)),
            ),
            older: Older::default(),
            elapsed_s: self.t_s - self.began_s,
        };
        let effects = self.model.effects.iter().zip(self.calibration.parameters());
        let lag_s = effects.map(|(s, p)| s.effect.velocity_delay_s(p)).sum();
        let older = rates
            .zip(self.last)
            .map_or_else(Older::default, |(f, last)| f.older(lag_s, &now, &last.accel, &self.motion.force));
        let now = FixInstant { older, ..now };
        let (seen, a_seen) = if self.course.is_straight() && !self.regressor.moving() {
            let present = self.regressor.present(&self.motion);
            (present, self.beyond_error(a_n(&present.force), &present.force, &c_nb))
        } else {
            (self.lever, a_n(&self.lever.force))
        };
        let excited = FixInstant {
            v_n: self.seen_velocity.unwrap_or(now.v_n),
            a_n: a_seen,
            rate_eb: seen.rate - earth_b,
            force_rate: self.beyond_noise(now.force_rate),
            ..now
        };
        AtFix { now, excited, c_ne }
    }

    /// A rate of change of the specific force without what may be noise of the samples.
    fn beyond_noise(&self, force_rate: Vector3<f64>) -> Vector3<f64> {
        let density = self.model.imu.accel_noise.powi(2) + self.extra_noise.1;
        let band = BEYOND_NOISE * force_rate::noise(density);
        force_rate.map(|r| if r.abs() < band { 0.0 } else { r })
    }

    /// The acceleration, north-east-down, of a vehicle that goes straight and has long done nothing else, without what errors of
    /// attitude and calibration make of none: fix after fix would take the same error for a change of velocity.
    fn beyond_error(&self, a_n: Vector3<f64>, force: &Vector3<f64>, c_nb: &Matrix3<f64>) -> Vector3<f64> {
        // δa = C (δf − f × ε) (Groves 2013, section 14.2.2).
        let mut h = SMatrix::<f64, 3, ERRORS>::zeros();
        h.fixed_columns_mut::<3>(0).copy_from(&(-c_nb * skew(force)));
        h.fixed_columns_mut::<3>(FORCE).copy_from(c_nb);
        let variance = (h * self.covariance_of_errors() * h.transpose()).diagonal();
        a_n.zip_map(&variance, |a, v| if a * a < (ERROR_SIGMAS * ERROR_SIGMAS) * v { 0.0 } else { a })
    }

    /// Takes over the velocity that constants are judged by where it has changed beyond its own uncertainty.
    pub(super) fn see_velocity(&mut self) {
        let v_n = self.nav.v_n();
        let sigma = self.ned_sigmas()[1];
        let seen = self.seen_velocity.get_or_insert(v_n);
        for k in 0..3 {
            if (v_n[k] - seen[k]).abs() > ERROR_SIGMAS * sigma[k] {
                seen[k] = v_n[k];
            }
        }
    }

    /// What the effects add to position and velocity of a fix.
    pub(super) fn fix_effects(&self, x: &AtFix) -> [Added; 2] {
        let mut out = [Added::default(), Added::default()];
        for (e, (setting, p)) in self.model.effects.iter().zip(self.calibration.parameters()).enumerate() {
            let Some(effect) = setting.effect.on_fixes() else { continue };
            let added = effect.fix(p, &x.now);
            let turned = effect.fix_by_attitude(p, &x.now);
            let n = p.len();
            let mut columns = [[Vector3::zeros(); MAX_PARAMETERS]; 2];
            let [position, velocity] = &mut columns;
            effect.fix_jacobian(p, &x.excited, &mut position[..n], &mut velocity[..n]);
            let slots = self.layout.slots();
            let first = slots.partition_point(|s| s.effect < e);
            let slots = slots[first..].iter().take_while(|s| s.effect == e);
            for (kind, out) in out.iter_mut().enumerate() {
                out.sum += added[kind];
                if let Some(by_attitude) = turned {
                    out.by_attitude += by_attitude[kind];
                }
                out.by_state.extend(slots.clone().map(|s| (s.state, columns[kind][s.parameter])));
            }
        }
        out
    }

    /// Adds to the attitude what a filter that was wrong does not know of its error.
    pub(super) fn loosen_attitude(&mut self) {
        (0..3).for_each(|k| self.p.add_variance(index::ATTITUDE + k, LOCKED_OUT_ATTITUDE.powi(2)));
    }
}

/// Rows of the first `z.len()` of north, east, down for the error block at `block`; an error of the time stamp moves all
/// of them together, by `shared` per sigma.
fn rows_of(
    block: usize,
    z: &[f64],
    c_nb: &Matrix3<f64>,
    added: &Added,
    sigma: &[f64; 3],
    shared: &Vector3<f64>,
) -> Rows {
    let mut rows = Rows { dof: z.len(), ..Rows::default() };
    rows.h.reserve(9 + added.by_state.len());
    for (i, residual) in z.iter().enumerate() {
        rows.residual[i] = *residual;
        rows.variance[i] = sigma[i].max(SIGMA_FLOOR).powi(2);
        rows.shared[i] = shared[i];
    }
    (0..3).for_each(|j| rows.push(block + j, |i| c_nb[(i, j)]));
    (0..3).for_each(|j| rows.push(index::ATTITUDE + j, |i| added.by_attitude[(i, j)]));
    added.by_state.iter().for_each(|(state, column)| rows.push(*state, |i| column[i]));
    rows
}
