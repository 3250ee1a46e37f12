//! Linear maps of the error state that change nothing but the nine navigation states, applied to many columns at once.
//!
//! A time step and a change of coordinates after a correction are such maps. They are made of 3 × 3 blocks, most of
//! them diagonal or cross products; applied block by block they cost half of what nine dense rows do. Each lane of a
//! vector register takes one column and only multiplies and adds, never fused: the result does not depend on the width
//! of the registers, bit for bit.

use super::covariance::{NAV, PANEL};
use super::layout::index;
use crate::displacement::Displacement;
use crate::mechanization::NavState;
use crate::rotation::left_jacobian;
use nalgebra::Vector3;
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

#[inline(always)]
fn add<S: Simd>(simd: S, a: Triple<S>, b: Triple<S>) -> Triple<S> {
    [simd.add_f64s(a[0], b[0]), simd.add_f64s(a[1], b[1]), simd.add_f64s(a[2], b[2])]
}

#[inline(always)]
fn sub<S: Simd>(simd: S, a: Triple<S>, b: Triple<S>) -> Triple<S> {
    [simd.sub_f64s(a[0], b[0]), simd.sub_f64s(a[1], b[1]), simd.sub_f64s(a[2], b[2])]
}

#[inline(always)]
fn scaled<S: Simd>(simd: S, by: f64, x: Triple<S>) -> Triple<S> {
    let by = simd.splat_f64s(by);
    [simd.mul_f64s(by, x[0]), simd.mul_f64s(by, x[1]), simd.mul_f64s(by, x[2])]
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

/// p q − r s.
#[inline(always)]
fn minor<S: Simd>(simd: S, p: S::f64s, q: S::f64s, r: S::f64s, s: S::f64s) -> S::f64s {
    simd.sub_f64s(simd.mul_f64s(p, q), simd.mul_f64s(r, s))
}

/// v × x.
#[inline(always)]
fn cross<S: Simd>(simd: S, v: &[f64; 3], x: Triple<S>) -> Triple<S> {
    let (a, b, c) = (simd.splat_f64s(v[0]), simd.splat_f64s(v[1]), simd.splat_f64s(v[2]));
    [minor(simd, b, x[2], c, x[1]), minor(simd, c, x[0], a, x[2]), minor(simd, a, x[1], b, x[0])]
}

/// How much one constant state changes one axis of rate or force.
#[derive(Debug, Clone, Copy, Default)]
struct Entry {
    state: usize,
    by: f64,
}

/// A sparse 3 × n matrix.
#[derive(Debug, Clone, Default)]
pub(super) struct Sparse {
    /// Each as long as the matrix is wide, for whatever it may hold; the first `len` count.
    axes: [Vec<Entry>; 3],
    len: [usize; 3],
}

impl Sparse {
    /// The mean of two dense matrices, given by their columns; the first column belongs to state `first`.
    pub(super) fn set_mean(&mut self, first: usize, a: &[Vector3<f64>], b: &[Vector3<f64>]) {
        self.axes.iter_mut().for_each(|axis| axis.resize(a.len(), Entry::default()));
        let mut len = [0; 3];
        for (k, (a, b)) in a.iter().zip(b).enumerate() {
            let mean = (a + b) * 0.5;
            for ((axis, len), by) in self.axes.iter_mut().zip(&mut len).zip(&mean) {
                if *by != 0.0 {
                    axis[*len] = Entry { state: first + k, by: *by };
                    *len += 1;
                }
            }
        }
        self.len = len;
    }

    #[inline(always)]
    fn axis(&self, i: usize) -> &[Entry] {
        &self.axes[i][..self.len[i]]
    }

    /// As dense rows over `n` states.
    #[cfg(test)]
    pub(super) fn dense(&self, n: usize) -> Vec<f64> {
        let mut out = vec![0.0; 3 * n];
        for i in 0..3 {
            self.axis(i).iter().for_each(|e| out[i * n + e.state] = e.by);
        }
        out
    }

    #[inline(always)]
    fn times<S: Simd>(&self, simd: S, x: Columns<'_, S>) -> Triple<S> {
        [row_times(simd, self.axis(0), x), row_times(simd, self.axis(1), x), row_times(simd, self.axis(2), x)]
    }
}

#[inline(always)]
fn row_times<S: Simd>(simd: S, row: &[Entry], x: Columns<'_, S>) -> S::f64s {
    let mut sum = simd.splat_f64s(0.0);
    for entry in row {
        sum = simd.add_f64s(sum, simd.mul_f64s(simd.splat_f64s(entry.by), x.row(entry.state)));
    }
    sum
}

/// Φ over one interval, in the factors it is made of.
///
/// In the axes of the start attitude, with Δv = ∫Cf: ε' = ε + δθ, δv' = δv − Δv×ε − ω_ie×δv + Γ δr + ∫Cδf,
/// δr' = δr + δv dt + …; then everything turns into the axes of the end attitude. (Barrau & Bonnabel 2017 for the
/// structure; Earth terms from the paper's eqs. (7) and (15).)
#[derive(Debug, Clone, Default)]
pub(super) struct Transition {
    /// Length of the interval, s.
    pub(super) dt: f64,
    /// C from the start axes to the end axes.
    pub(super) to_end: [[f64; 3]; 3],
    /// Earth's rotation over the interval, start axes, rad.
    pub(super) earth: [f64; 3],
    /// Gravity gradient times dt, start axes, 1/s.
    pub(super) gradient: [[f64; 3]; 3],
    /// ∫ C f dt, m/s.
    pub(super) dv: [f64; 3],
    /// ∬ C f dt², m.
    pub(super) dp: [f64; 3],
    /// The mean of the rotation over the interval times dt: (I + ½ δθ×) dt.
    pub(super) half_turn_dt: [[f64; 3]; 3],
    /// Mean of ∂ω/∂x over the interval.
    pub(super) rate: Sparse,
    /// Mean of ∂f/∂x over the interval.
    pub(super) force: Sparse,
}

impl Transition {
    /// Position and velocity neither follow the attitude nor each other.
    pub(super) fn without_acceleration(&mut self) {
        (self.dv, self.dp, self.earth) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        (self.gradient, self.dt) = ([[0.0; 3]; 3], 0.0);
        self.force.len = [0; 3];
    }
}

impl NavMap for Transition {
    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, x: Columns<'_, S>) -> [Triple<S>; 3] {
        let (rate, force) = (self.rate.times(simd, x), self.force.times(simd, x));
        let (dr, dv, eps) = (x.triple(index::POSITION), x.triple(index::VELOCITY), x.triple(index::ATTITUDE));
        let dtheta = times(simd, &self.half_turn_dt, rate);
        let tilt = add(simd, eps, scaled(simd, 0.5, dtheta));
        let moved = add(simd, dv, times(simd, &self.half_turn_dt, force));
        let moved = sub(simd, moved, cross(simd, &self.earth, dv));
        let moved = add(simd, moved, times(simd, &self.gradient, dr));
        let velocity = sub(simd, moved, cross(simd, &self.dv, tilt));
        let tilt = add(simd, eps, scaled(simd, 1.0 / 3.0, dtheta));
        let moved = add(simd, dr, cross(simd, &self.earth, dr));
        let moved = add(simd, moved, scaled(simd, self.dt, dv));
        let moved = add(simd, moved, scaled(simd, 0.5 * self.dt * self.dt, force));
        let position = sub(simd, moved, cross(simd, &self.dp, tilt));
        let attitude = add(simd, eps, dtheta);
        [
            times(simd, &self.to_end, position),
            times(simd, &self.to_end, velocity),
            times(simd, &self.to_end, attitude),
        ]
    }
}

/// How an error about the old estimate reads about the new one: the right Jacobian of SE₂(3) to first order in the
/// position and velocity parts (Barfoot 2017, section 7.1.5), for [δr δv ε]. A heading that is corrected changes nothing:
/// what is known in body axes stays so (see [`crate::displacement`]).
#[derive(Debug, Clone)]
pub(super) struct Recentring {
    /// J(−a), with a the tilt.
    pub(super) turn: [[f64; 3]; 3],
    /// −½ δr.
    pub(super) half_dr: [f64; 3],
    /// −½ δv.
    pub(super) half_dv: [f64; 3],
}

impl Recentring {
    /// As a dense matrix.
    pub(super) fn dense(&self) -> [[f64; NAV]; NAV] {
        let rows = dense_rows(self, NAV);
        std::array::from_fn(|i| std::array::from_fn(|j| rows[i * NAV + j]))
    }
}

impl NavState {
    /// The change of coordinates that a correction of this state brings.
    pub(super) fn recentring(&self, by: &Displacement) -> Recentring {
        let [_, tilt] = self.heading_and_tilt(&by.attitude);
        Recentring {
            turn: left_jacobian(&-tilt).transpose().into(),
            half_dr: (by.position * -0.5).into(),
            half_dv: (by.velocity * -0.5).into(),
        }
    }
}

impl NavMap for Recentring {
    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, x: Columns<'_, S>) -> [Triple<S>; 3] {
        let eps = x.triple(index::ATTITUDE);
        let position = times(simd, &self.turn, x.triple(index::POSITION));
        let velocity = times(simd, &self.turn, x.triple(index::VELOCITY));
        [
            add(simd, position, cross(simd, &self.half_dr, eps)),
            add(simd, velocity, cross(simd, &self.half_dv, eps)),
            times(simd, &self.turn, eps),
        ]
    }
}

/// Nine dense rows over the navigation states, for what happens seldom.
#[derive(Debug, Clone)]
pub(super) struct Dense(pub(super) [[f64; NAV]; NAV]);

impl NavMap for Dense {
    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, x: Columns<'_, S>) -> [Triple<S>; 3] {
        let mut out = [[simd.splat_f64s(0.0); 3]; NAV / 3];
        for (row, out) in self.0.iter().zip(out.as_flattened_mut()) {
            for (k, by) in row.iter().enumerate() {
                *out = simd.add_f64s(*out, simd.mul_f64s(simd.splat_f64s(*by), x.row(k)));
            }
        }
        out
    }
}

/// The nine rows of M x for a single x.
pub(super) fn moved(map: &impl NavMap, x: &[f64]) -> [f64; NAV] {
    let mut panel = vec![0.0; x.len() * PANEL];
    panel.iter_mut().step_by(PANEL).zip(x).for_each(|(p, x)| *p = *x);
    let rows = map.rows(pulp::Scalar, Columns::new(&panel, 0));
    std::array::from_fn(|i| rows[i / 3][i % 3])
}

/// The nine rows of a map as a dense matrix over `n` states, row by row.
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
