//! GNSS velocity: two or three rows at the time of validity of the fix.

use super::Linearised;
use crate::filter::Filter;
use crate::filter::group::Rows;
use crate::filter::layout::index;
use crate::sample::GnssFix;
use nalgebra::{Matrix3, Vector3};

/// 1-sigma of velocity after it started anew from a fix, at least, m/s.
const RESET_SIGMA: f64 = 1.0;
/// 1-sigma of the vertical velocity of a vehicle of which nothing vertical is measured, m/s.
const VERTICAL_SIGMA: f64 = 3.0;

impl Filter {
    pub(in crate::filter) fn velocity_rows(&self, fix: &GnssFix, x: &Linearised) -> Rows {
        self.rows_of(1, fix, x)
    }

    /// The velocity anew from this fix, lever arm taken off; a fix without vertical velocity leaves that as it is.
    pub(in crate::filter) fn reset_velocity(&mut self, fix: &GnssFix) {
        let Linearised { now, groups: [_, velocity], .. } = self.linearise(fix);
        let (mut v_n, old_vertical) = (now.v_n + velocity.residual, self.ned_sigmas()[1].z);
        let mut sigma = Vector3::from(velocity.sigma).map(|s| (2.0 * s).max(RESET_SIGMA));
        match velocity.rows {
            0 => return,
            3 => {}
            _ => {
                (v_n.z, sigma.z) = (self.estimate.nav.v_n().z, old_vertical);
                if old_vertical > VERTICAL_SIGMA {
                    (v_n.z, sigma.z) = (0.0, VERTICAL_SIGMA);
                }
            }
        }
        self.about.nav.v_e = self.about.nav.c_eb() * now.c_nb.transpose() * v_n;
        self.x[index::VELOCITY..index::ATTITUDE].fill(0.0);
        (0..3).for_each(|k| self.p.reset(index::VELOCITY + k, 1.0));
        let variances = Matrix3::from_diagonal(&sigma.map(|s| s * s));
        self.p.set_block3(index::VELOCITY, &(now.c_nb.transpose() * variances * now.c_nb));
    }
}
