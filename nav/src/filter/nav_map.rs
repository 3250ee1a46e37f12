//! Linear maps of the error state that change nothing but the nine navigation states, applied to many columns at once.
//!
//! The transition of an interval and a change of coordinates after a correction are such maps. Each lane of a
//! vector register takes one column and only multiplies and adds, never fused: the result does not depend on the width
//! of the registers, bit for bit.

use super::covariance::{NAV, PANEL};
use super::layout::index;
use crate::displacement::{Displacement, LARGE_TILT};
use crate::linear::interval::Interval;
use crate::mechanization::NavState;
use crate::rotation::{exp, left_jacobian};
use nalgebra::{Matrix3, Vector3};
use pulp::Simd;

/// Three values per column.
pub(super) type Triple<S> = [<S as Simd>::f64s; 3];

/// The columns of a panel that one vector register covers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Columns<'a, S: Simd> {
    /// From the first row on; rows follow each other at [`Columns::STRIDE`].
    data: &'a [S::f64s],
}

impl<'a, S: Simd> Columns<'a, S> {
    /// Registers per row of a panel.
    const STRIDE: usize = PANEL / S::F64_LANES;

    /// Register `at` of each row of a panel.
    #[inline(always)]
    pub(super) fn new(panel: &'a [S::f64s], at: usize) -> Self {
        Self { data: &panel[at..] }
    }

    #[inline(always)]
    fn row(self, k: usize) -> S::f64s {
        self.data[k * Self::STRIDE]
    }

    #[inline(always)]
    fn triple(self, first: usize) -> Triple<S> {
        [self.row(first), self.row(first + 1), self.row(first + 2)]
    }
}

/// A map x ↦ M x, where M is the identity except for its first nine rows.
pub(super) trait NavMap {
    /// The nine rows of M X for some columns of X.
    fn rows<S: Simd>(&self, simd: S, x: Columns<'_, S>) -> [Triple<S>; NAV / 3];
}

// No closures in what follows: one that the compiler does not inline would lose the wide registers.

/// a·x for one row of three.
#[inline(always)]
fn dot<S: Simd>(simd: S, a: &[f64; 3], x: Triple<S>) -> S::f64s {
    let first = simd.mul_f64s(simd.splat_f64s(a[0]), x[0]);
    let sum = simd.add_f64s(first, simd.mul_f64s(simd.splat_f64s(a[1]), x[1]));
    simd.add_f64s(sum, simd.mul_f64s(simd.splat_f64s(a[2]), x[2]))
}

#[inline(always)]
fn times<S: Simd>(simd: S, m: &[[f64; 3]; 3], x: Triple<S>) -> Triple<S> {
    [dot(simd, &m[0], x), dot(simd, &m[1], x), dot(simd, &m[2], x)]
}

/// How an error about the old estimate reads about the new one. With C = Ĉ exp(ψ u) exp(a) about a new Ĉ exp(a₀): exp(ψ u) exp(a₀ + a) =
/// exp(a₀) exp(ψ u') exp(J(−a₀) a), u' = exp(−a₀) u (the right Jacobian: Barfoot 2017, section 7.1.5): the heading turns with the vertical in body
/// axes, the tilt with J(−a₀), position and velocity too.
#[derive(Debug, Clone)]
pub(super) struct Recentring {
    /// Of position and velocity.
    turn: [[f64; 3]; 3],
    attitude: [[f64; 3]; 3],
}

impl Recentring {
    /// The way back.
    pub(super) fn inverse(&self) -> Option<Self> {
        let back = |m: &[[f64; 3]; 3]| Some(Matrix3::from(*m).try_inverse()?.into());
        Some(Self { turn: back(&self.turn)?, attitude: back(&self.attitude)? })
    }
}

impl NavState {
    /// The change of coordinates that a correction of this state brings.
    pub(super) fn recentring(&self, by: &Displacement) -> Recentring {
        let [_, tilt] = self.heading_and_tilt(&by.attitude);
        let turn = left_jacobian(&-tilt);
        // Where the whole error counts as tilt there is no heading of its own.
        let down = if tilt.norm() > LARGE_TILT { Vector3::zeros() } else { self.down_b() };
        let attitude = turn + (exp(&-tilt) * down - turn * down) * down.transpose();
        Recentring { turn: turn.transpose().into(), attitude: attitude.transpose().into() }
    }
}

impl NavMap for Recentring {
    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, x: Columns<'_, S>) -> [Triple<S>; 3] {
        [
            times(simd, &self.turn, x.triple(index::POSITION)),
            times(simd, &self.turn, x.triple(index::VELOCITY)),
            times(simd, &self.attitude, x.triple(index::ATTITUDE)),
        ]
    }
}

/// Nine dense rows, column by column: what a state of this number adds to the navigation states.
#[derive(Debug, Clone)]
pub(super) struct Dense(pub(super) Vec<(usize, [f64; NAV])>);

impl Dense {
    /// The transition of an interval; `driven` are the states of its driven columns.
    pub(super) fn of(interval: &Interval, driven: impl Iterator<Item = usize>) -> Self {
        let states = (0..interval.transition.len()).chain(driven);
        let columns = interval.transition.iter().chain(&interval.driven);
        let columns = states.zip(columns).filter(|(_, c)| c.iter().any(|v| *v != 0.0));
        Self(columns.map(|(state, c)| (state, (*c).into())).collect())
    }

    /// The nine rows of M x for a single x.
    pub(super) fn moved(&self, x: &[f64]) -> [f64; NAV] {
        let mut out = [0.0; NAV];
        for (state, column) in &self.0 {
            out.iter_mut().zip(column).for_each(|(o, c)| *o += c * x[*state]);
        }
        out
    }
}

impl NavMap for Dense {
    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, x: Columns<'_, S>) -> [Triple<S>; 3] {
        let mut out = [[simd.splat_f64s(0.0); 3]; NAV / 3];
        for (state, column) in &self.0 {
            let x = x.row(*state);
            for (by, out) in column.iter().zip(out.as_flattened_mut()) {
                *out = simd.add_f64s(*out, simd.mul_f64s(simd.splat_f64s(*by), x));
            }
        }
        out
    }
}

/// The nine rows of a map as a dense matrix over `n` states, row by row.
#[cfg(test)]
pub(super) fn dense_rows(map: &impl NavMap, n: usize) -> Vec<f64> {
    let mut out = vec![0.0; NAV * n];
    let mut unit = vec![0.0; n * PANEL];
    for column in 0..n {
        unit[column * PANEL] = 1.0;
        let rows = map.rows(pulp::Scalar, Columns::new(&unit, 0));
        unit[column * PANEL] = 0.0;
        rows.as_flattened().iter().enumerate().for_each(|(i, v)| out[i * n + column] = *v);
    }
    out
}
