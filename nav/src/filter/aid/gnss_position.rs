//! GNSS position: three rows at the time of validity of the fix.
//!
//! A position that jumps while the velocity of the same fixes still agrees is inconsistent with velocity and inertial data: it is
//! not followed for [`HELD_OFF_S`], and then taken over as a correction of the position alone.

use super::{Linearised, SIGMA_FLOOR};
use crate::filter::Filter;
use crate::filter::group::Rows;
use crate::filter::layout::index;
use crate::rss;
use crate::sample::GnssFix;
use nalgebra::{Matrix3, Vector3};

/// A position that is inconsistent with velocity and inertial data is not followed for so long, s: multipath and spoofing of seconds
/// pass, a new reference frame or a receiver's correction stays.
pub(in crate::filter) const HELD_OFF_S: f64 = 30.0;

impl Filter {
    pub(in crate::filter) fn position_rows(&self, fix: &GnssFix, x: &Linearised) -> Rows {
        let mut rows = self.rows_of(0, fix, x);
        if let Some(w) = self.layout.gauss_markov() {
            (0..3).for_each(|k| rows.push(w + k, |i| if i == k { 1.0 } else { 0.0 }));
        }
        rows
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
        let Linearised { now, groups: [position, _], .. } = self.linearise(fix);
        let offset = position.residual - now.v_n * self.fix_ahead_s(fix);
        let before = self.estimate.nav.r_e;
        self.about.nav.r_e += self.about.nav.c_eb() * now.c_nb.transpose() * offset;
        self.x[index::POSITION..index::VELOCITY].fill(0.0);
        let sigma = Vector3::from(position.sigma).map(|s| s.max(SIGMA_FLOOR) * 2.0);
        (0..3).for_each(|k| self.p.reset(index::POSITION + k, 1.0));
        if let Some(w) = self.layout.gauss_markov() {
            // The correlated error of the new position is as unknown as that of any position.
            for k in 0..3 {
                self.p.reset(w + k, self.model.gnss.position_wander_sigma_m[k]);
            }
            self.x[w..w + 3].fill(0.0);
        }
        // Time stamp and latency move it along the path.
        let along = now.v_n * rss(self.delay_sigma_s(), self.model.gnss.time_sigma_s);
        let variances = Matrix3::from_diagonal(&sigma.map(|s| s * s)) + along * along.transpose();
        self.p.set_block3(index::POSITION, &(now.c_nb.transpose() * variances * now.c_nb));
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
