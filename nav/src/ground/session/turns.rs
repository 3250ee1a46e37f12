//! Quarter turns between sides: which have been made, and which comes next.

use super::Side;
use nalgebra::Vector3;
use std::f64::consts::FRAC_PI_2;

/// Once around an axis: a second circle of all three takes three minutes more for a fifth less of sigma.
const CIRCLE: u32 = 4;
/// Of a turn about one axis the others have at most this share.
const ASIDE: f64 = 0.5;
/// Axes in the order in which they are turned about: pitch, roll, and yaw on the vehicle's side.
const ORDER: [usize; 3] = [1, 0, 2];

/// What was turned, rad, and from where.
#[derive(Debug, Clone, Default)]
pub(super) struct Turns {
    turned: [f64; 3],
    /// Since the last side, and that side.
    since: Vector3<f64>,
    from: Option<Side>,
    quarters: [u32; 3],
    last: Option<usize>,
}

impl Side {
    /// Where a quarter turn about an axis leads, if to another side: gravity turns the other way, and measures its angle.
    fn turned(self, axis: usize, backward: bool) -> Option<Self> {
        let axis = Vector3::ith(axis, if backward { 1.0 } else { -1.0 });
        let force = axis.cross(&self.force());
        Self::ALL.into_iter().find(|s| s.force() == force)
    }
}

impl Turns {
    /// How far about each axis in all, rad.
    pub(super) fn turned(&self) -> [f64; 3] {
        self.turned
    }

    /// Takes a part of a turn, rad.
    pub(super) fn turn(&mut self, by: &Vector3<f64>) {
        self.since += by;
        self.turned.iter_mut().zip(by.iter()).for_each(|(turned, by)| *turned += by.abs());
    }

    /// It stands on a side.
    pub(super) fn arrive(&mut self, side: Side) {
        let angles = self.since.abs();
        let axis = angles.imax();
        let alone = (0..3).all(|k| k == axis || angles[k] < ASIDE * angles[axis]);
        if alone && self.from.is_some_and(|from| from.turned(axis, false).is_some()) {
            let quarters = (angles[axis] / FRAC_PI_2).round() as u32;
            self.quarters[axis] = self.quarters[axis].saturating_add(quarters);
            self.last = (quarters > 0).then_some(axis).or(self.last);
        }
        (self.since, self.from) = (Vector3::zeros(), Some(side));
    }

    /// Whether turns about this axis are still asked for, where they are wanted and some side can be turned so.
    pub(super) fn asks(&self, axis: usize, can: &dyn Fn(Side) -> bool) -> bool {
        self.quarters[axis] < CIRCLE
            && Side::ALL.into_iter().any(|s| can(s) && Self::to(s, axis, can).is_some())
    }

    /// Where a quarter turn about an axis goes from a side: forward, or back where it cannot stand there.
    fn to(side: Side, axis: usize, can: &dyn Fn(Side) -> bool) -> Option<Side> {
        let both = [false, true].map(|backward| side.turned(axis, backward));
        both.into_iter().flatten().find(|s| can(*s))
    }

    /// The next quarter turn from a side about one of the axes that are wanted: the one under way as long as its circle is open, or the one turned about
    /// least.
    pub(super) fn next(
        &self,
        side: Side,
        wanted: [bool; 3],
        can: &dyn Fn(Side) -> bool,
    ) -> Option<(usize, Side)> {
        let from_here = |axis: &usize| wanted[*axis] && Self::to(side, *axis, can).is_some();
        let open = |axis: &usize| from_here(axis) && self.quarters[*axis] > 0;
        let least = || ORDER.into_iter().filter(from_here).min_by_key(|axis| self.quarters[*axis]);
        let axis = self.last.filter(open).or_else(least)?;
        Some((axis, Self::to(side, axis, can)?))
    }

    /// A side from which an axis that is wanted can be turned about.
    pub(super) fn side_for(&self, wanted: [bool; 3], can: &dyn Fn(Side) -> bool) -> Option<Side> {
        let axis = ORDER.into_iter().find(|axis| wanted[*axis])?;
        Side::ALL.into_iter().find(|s| can(*s) && Self::to(*s, axis, can).is_some())
    }
}
