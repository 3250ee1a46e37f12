//! GNSS velocity: two or three rows at the time of validity of the fix.

use super::{Added, AtFix, rows_of};
use crate::filter::Filter;
use crate::filter::group::Rows;
use crate::filter::layout::index;
use crate::sample::{FixVelocity, GnssFix};
use nalgebra::{Matrix3, Vector3};

/// 1-sigma of velocity after it started anew from a fix, at least, m/s.
const RESET_SIGMA: f64 = 1.0;
/// 1-sigma of the vertical velocity of a vehicle of which nothing vertical is measured, m/s.
const VERTICAL_SIGMA: f64 = 3.0;

impl Filter {
    pub(in crate::filter) fn velocity_rows(&self, fix: &GnssFix, x: &AtFix, added: &Added) -> Rows {
        let (measured, rows) = match fix.velocity {
            FixVelocity::None => return Rows::default(),
            FixVelocity::Horizontal([n, e]) => (Vector3::new(n, e, 0.0), 2),
            FixVelocity::Full(v) => (Vector3::from(v), 3),
        };
        let sigma = fix.velocity_sigma_m_per_s.unwrap_or(self.model.gnss.velocity_sigma_m_per_s);
        let z = measured - x.now.v_n - added.sum - x.now.a_n * self.fix_ahead_s(fix);
        let shared = x.excited.a_n * self.model.gnss.time_sigma_s;
        rows_of(index::VELOCITY, &z.as_slice()[..rows], &x.now.c_nb, added, &sigma, &shared)
    }

    /// The velocity anew from this fix, lever arm taken off; a fix without vertical velocity leaves that as it is.
    pub(in crate::filter) fn reset_velocity(&mut self, fix: &GnssFix) {
        let x = self.at_fix();
        let [_, added] = self.fix_effects(&x);
        let (mut v_n, old_vertical) = (self.estimate.nav.v_n(), self.ned_sigmas()[1].z);
        let given = fix.velocity_sigma_m_per_s.unwrap_or(self.model.gnss.velocity_sigma_m_per_s);
        let mut sigma = Vector3::from(given).map(|s| (2.0 * s).max(RESET_SIGMA));
        match fix.velocity {
            FixVelocity::None => return,
            FixVelocity::Horizontal([n, e]) => {
                (v_n.x, v_n.y) = (n - added.sum.x, e - added.sum.y);
                sigma.z = old_vertical;
                if old_vertical > VERTICAL_SIGMA {
                    (v_n.z, sigma.z) = (0.0, VERTICAL_SIGMA);
                }
            }
            FixVelocity::Full(v) => v_n = Vector3::from(v) - added.sum,
        }
        self.about.nav.v_e = x.c_ne.transpose() * v_n;
        self.x[index::VELOCITY..index::ATTITUDE].fill(0.0);
        (0..3).for_each(|k| self.p.reset(index::VELOCITY + k, 1.0));
        let variances = Matrix3::from_diagonal(&sigma.map(|s| s * s));
        self.p.set_block3(index::VELOCITY, &(x.now.c_nb.transpose() * variances * x.now.c_nb));
    }
}
