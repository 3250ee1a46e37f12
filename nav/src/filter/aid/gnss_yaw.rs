//! GNSS yaw: the heading of a receiver with two antennas, one row.

use crate::filter::Filter;
use crate::filter::group::Rows;
use crate::filter::layout::index;
use crate::math::{cos, sin};
use crate::rotation::wrap_pi;
use crate::sample::GnssFix;

/// No heading is assumed to be better than this, rad.
const SIGMA_FLOOR: f64 = 1e-3;
/// With the nose nearer to the vertical than this (cosine of pitch) yaw is not a measurement.
const UPRIGHT: f64 = 0.3;

impl Filter {
    pub(in crate::filter) fn yaw_rows(&self, fix: &GnssFix) -> Rows {
        let Some((yaw, sigma)) = fix.yaw_rad else { return Rows::default() };
        let [roll, pitch, own] = self.about.nav.euler().into();
        if cos(pitch) < UPRIGHT {
            return Rows::default();
        }
        let mut rows = Rows { dof: 1, ..Rows::default() };
        rows.residual[0] = wrap_pi(yaw - own);
        rows.variance[0] = sigma.max(SIGMA_FLOOR).powi(2);
        // Yaw rate from body rates (Groves 2013, eq. 2.58).
        rows.push(index::ATTITUDE + 1, |_| sin(roll) / cos(pitch));
        rows.push(index::ATTITUDE + 2, |_| cos(roll) / cos(pitch));
        rows
    }

    /// Makes the yaw uncertain enough for a heading that is inconsistent with the estimate: its innovation as one more sigma about the vertical.
    pub(in crate::filter) fn reset_yaw(&mut self, innovation: f64) {
        let down = self.about.nav.down_b() * innovation;
        let block = self.p.block3(index::ATTITUDE) + down * down.transpose();
        self.p.set_block3(index::ATTITUDE, &block);
    }
}
