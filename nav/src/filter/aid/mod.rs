//! Aids: what corrects the inertial navigation, one file each (as in PX4's EKF2): which rows it gives at its time of
//! validity, its innovation test, and how the filter starts anew from it when the test cannot be right.

pub(super) mod gnss_position;
pub(super) mod gnss_velocity;
pub(super) mod gnss_yaw;
pub mod stationarity;

use super::force_rate;
use super::{Filter, Point};
use super::group::Rows;
use super::layout::index;
use super::regressor::BEYOND_NOISE;
use crate::earth;
use crate::effects::{Antenna, FixInstant, MAX_PARAMETERS, Older};
use crate::mechanization;
use nalgebra::{Matrix3, Vector3};

/// NIS beyond which a group of 1, 2, 3 rows is rejected: chance 6e-7, five sigma of one row.
const GATE: [f64; 4] = [f64::INFINITY, 25.0, 28.7, 31.8];
/// After so long without an accepted group the filter starts anew from the fixes, s.
const LOCKED_OUT_S: f64 = 3.0;
/// … and after at least so many rejections.
const LOCKED_OUT_COUNT: u32 = 4;
/// Attitude uncertainty that is added when position and velocity both started anew, rad.
const LOCKED_OUT_ATTITUDE: f64 = 0.05;
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
    /// Values are those of the trajectory that everything is linearised about; what the parameters of a fix multiply is taken from the
    /// estimate: a trajectory that is off by a mean error that is known has another velocity and acceleration than the vehicle.
    pub(super) fn at_fix(&self) -> AtFix {
        let Point { nav, calibration, motion } = &self.about;
        let c_ne = earth::c_en_at(&nav.r_e).transpose();
        let earth_b = nav.q_eb.inverse() * earth::rotation_rate();
        let rates = self.nearby.as_deref();
        let effects = || self.model.effects.iter().map(|s| s.effect).zip(calibration.parameters());
        let now = FixInstant {
            t_s: self.t_s,
            v_n: c_ne * nav.v_e,
            a_n: c_ne * mechanization::acceleration(nav, &motion.force),
            c_nb: c_ne * nav.c_eb(),
            rate_eb: motion.rate - earth_b,
            force_rate: rates.map_or(Vector3::zeros(), |f| f.at(self.t_s)),
            antenna: Antenna::of(
                effects().map(|(e, p)| (e, p.as_slice())),
                rates.map_or_else(Default::default, |f| f.of_rate_at(self.t_s)),
            ),
            older: Older::default(),
            elapsed_s: self.t_s - self.began_s,
        };
        let lag_s = effects().map(|(e, p)| e.velocity_delay_s(p)).sum();
        let older = rates
            .zip(self.last)
            .map_or_else(Older::default, |(f, last)| f.older(lag_s, &now, &last.accel, &motion.force));
        let now = FixInstant { older, ..now };
        let own = &self.estimate;
        let force = self.to.lever.force + own.motion.force - motion.force;
        let excited = FixInstant {
            v_n: c_ne * own.nav.v_e,
            a_n: c_ne * mechanization::acceleration(&own.nav, &force),
            rate_eb: self.to.lever.rate + own.motion.rate - motion.rate - earth_b,
            force_rate: self.beyond_noise(now.force_rate),
            ..now
        };
        AtFix { now, excited, c_ne }
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

    /// What the effects add to position and velocity of a fix.
    pub(super) fn fix_effects(&self, x: &AtFix) -> [Added; 2] {
        let mut out = [Added::default(), Added::default()];
        for (e, (setting, p)) in self.model.effects.iter().zip(self.about.calibration.parameters()).enumerate() {
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
