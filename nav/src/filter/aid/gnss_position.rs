//! GNSS position: three rows at the time of validity of the fix.
//!
//! A position that jumps while the velocity of the same fixes still agrees is inconsistent with velocity and inertial data: it is
//! not followed for [`HELD_OFF_S`], and then taken over as a correction of the position alone.

use super::{Added, AtFix, SIGMA_FLOOR, rows_of};
use crate::filter::Filter;
use crate::filter::group::Rows;
use crate::filter::layout::index;
use crate::sample::GnssFix;
use nalgebra::{Matrix3, Vector3};

/// A position that is inconsistent with velocity and inertial data is not followed for so long, s: multipath and spoofing of seconds
/// pass, a new reference frame or a receiver's correction stays.
pub(in crate::filter) const HELD_OFF_S: f64 = 30.0;

impl Filter {
    pub(in crate::filter) fn position_rows(&self, fix: &GnssFix, x: &AtFix, added: &Added) -> Rows {
        let z = self.position_offset(fix, x, added) - x.now.v_n * self.fix_ahead_s(fix);
        let sigma = self.position_sigma(fix);
        let shared = x.excited.v_n * self.model.gnss.time_sigma_s;
        let mut rows = rows_of(index::POSITION, &z.as_slice()[..3], &x.now.c_nb, added, &sigma, &shared);
        if let Some(w) = self.layout.gauss_markov() {
            (0..3).for_each(|k| rows.push(w + k, |i| if i == k { 1.0 } else { 0.0 }));
        }
        rows
    }

    fn position_sigma(&self, fix: &GnssFix) -> [f64; 3] {
        fix.position_sigma_m.unwrap_or(self.model.gnss.position_sigma_m)
    }

    /// Where the fix puts the inertial unit, relative to the estimate, north-east-down, m.
    fn position_offset(&self, fix: &GnssFix, x: &AtFix, added: &Added) -> Vector3<f64> {
        x.c_ne * (fix.position.to_ecef() - self.about.nav.r_e) - added.sum
    }

    /// The position came from a fix and carries that fix's correlated error: what is known of the Gauss-Markov error is taken off, and what
    /// is not known of it is missing from the position. Taken for independent of each other, the two would halve it.
    pub(crate) fn place_by_fix(&mut self) {
        let Some(w) = self.layout.gauss_markov() else { return };
        let c_bn = self.about.nav.c_nb().transpose();
        let mean = Vector3::from_fn(|k, _| self.x[w + k]);
        self.about.nav.r_e -= self.about.nav.c_eb() * (c_bn * mean);
        let own = self.p.block3(index::POSITION) + c_bn * self.p.block3(w) * c_bn.transpose();
        self.p.set_block3(index::POSITION, &own);
        for state in index::GYRO_BIAS..self.layout.len() {
            let with_wander = Vector3::from_fn(|k, _| self.p.at(w + k, state));
            self.p.set_cross3(index::POSITION, state, &(-c_bn * with_wander));
        }
    }

    /// The position anew from this fix, lever arm taken off; nothing else changes. Returns how far it moved, m.
    pub(in crate::filter) fn reset_position(&mut self, fix: &GnssFix) -> f64 {
        let x = self.at_fix();
        let [added, _] = self.fix_effects(&x);
        let offset = self.position_offset(fix, &x, &added) - x.now.v_n * self.fix_ahead_s(fix);
        let before = self.estimate.nav.r_e;
        self.about.nav.r_e += x.c_ne.transpose() * offset;
        self.x[index::POSITION..index::VELOCITY].fill(0.0);
        let sigma = Vector3::from(self.position_sigma(fix)).map(|s| s.max(SIGMA_FLOOR) * 2.0);
        (0..3).for_each(|k| self.p.reset(index::POSITION + k, 1.0));
        if let Some(w) = self.layout.gauss_markov() {
            // The correlated error of the new position is as unknown as that of any position.
            for k in 0..3 {
                self.p.reset(w + k, self.model.gnss.position_wander_sigma_m[k]);
            }
            self.x[w..w + 3].fill(0.0);
        }
        // Time stamp and latency move it along the path.
        let along = x.now.v_n * self.delay_sigma_s().hypot(self.model.gnss.time_sigma_s);
        let variances = Matrix3::from_diagonal(&sigma.map(|s| s * s)) + along * along.transpose();
        self.p.set_block3(index::POSITION, &(x.now.c_nb.transpose() * variances * x.now.c_nb));
        self.place_by_fix();
        (self.about.nav.r_e - before).norm()
    }

    /// 1-sigma of the delay of the fixes, s.
    fn delay_sigma_s(&self) -> f64 {
        let delays = |effect: usize, parameter: usize| {
            let setting = &self.model.effects[effect];
            let mut one = vec![0.0; setting.values.len()];
            one[parameter] = 1.0;
            setting.effect.fix_delay_s(&one, self.t_s - self.began_s)
        };
        let variance =
            |s: &crate::filter::layout::Slot| (delays(s.effect, s.parameter) * self.p.sigma(s.state)).powi(2);
        self.layout.slots().iter().map(variance).sum::<f64>().sqrt()
    }
}
