//! A covariance matrix and the two things a filter does to it, with the structure of the problem used.
//!
//! Only the nine navigation states have dynamics; everything behind them is constant or a first-order Gauss-Markov
//! process. So a time step touches nine rows and columns. The matrix is stored in full, in panels of eight columns, so
//! that a vector register takes neighbours of one row; every operation keeps it symmetric by construction.

use super::layout::Layout;
use super::nav_map::{Columns, NavMap};
use crate::linear::interval::NavCovariance;
use crate::model::JointPrior;
use nalgebra::{Matrix3, Vector3};
use pulp::{Arch, Simd, WithSimd};

/// Number of navigation states: position, velocity and attitude errors.
pub const NAV: usize = 9;
/// Columns of a panel: numbers in the widest vector register.
pub(super) const PANEL: usize = 8;
/// Rows of the largest group of measurements.
pub(super) const GROUP: usize = 3;

/// A symmetric, positive matrix of any size.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    n: usize,
    /// Panel by panel, each with n rows; columns from n on are zero.
    data: Vec<[f64; PANEL]>,
}

impl Covariance {
    /// A diagonal covariance from 1-sigmas of at least the nine navigation states.
    pub fn from_sigmas(sigmas: &[f64]) -> Self {
        let n = sigmas.len();
        let mut p = Self { n, data: vec![[0.0; PANEL]; n * n.div_ceil(PANEL)] };
        for (i, s) in sigmas.iter().enumerate() {
            *p.at_mut(i, i) = s * s;
        }
        p
    }

    /// Number of states.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Whether there are no states.
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// One element.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.data[j / PANEL * self.n + i][j % PANEL]
    }

    fn at_mut(&mut self, i: usize, j: usize) -> &mut f64 {
        &mut self.data[j / PANEL * self.n + i][j % PANEL]
    }

    /// 1-sigma of a state.
    pub fn sigma(&self, i: usize) -> f64 {
        self.at(i, i).max(0.0).sqrt()
    }

    /// The block of these rows and columns as a dense matrix.
    pub fn block(&self, states: &[usize]) -> nalgebra::DMatrix<f64> {
        nalgebra::DMatrix::from_fn(states.len(), states.len(), |i, j| self.at(states[i], states[j]))
    }

    /// The 3 × 3 diagonal block that starts at `at`.
    pub fn block3(&self, at: usize) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| self.at(at + i, at + j))
    }

    /// Sets the 3 × 3 diagonal block that starts at `at`; correlations with other states stay.
    pub fn set_block3(&mut self, at: usize, block: &Matrix3<f64>) {
        for i in 0..3 {
            for j in 0..3 {
                *self.at_mut(at + i, at + j) = 0.5 * (block[(i, j)] + block[(j, i)]);
            }
        }
    }

    /// Sets the covariance of the three states from `at` on with another one.
    pub fn set_cross3(&mut self, at: usize, with: usize, column: &Vector3<f64>) {
        for (i, value) in column.iter().enumerate() {
            *self.at_mut(at + i, with) = *value;
            *self.at_mut(with, at + i) = *value;
        }
    }

    /// Takes over all entries of another covariance of the same size from state `from` on.
    pub fn copy_tail(&mut self, other: &Self, from: usize) {
        for i in from..self.n.min(other.n) {
            for j in from..self.n.min(other.n) {
                *self.at_mut(i, j) = other.at(i, j);
            }
        }
    }

    /// Sets what is known of several states together.
    pub(super) fn set_joint(&mut self, joint: &JointPrior, layout: &Layout) {
        let states: Vec<_> = joint.names.iter().map(|name| layout.find(name)).collect();
        for (i, row) in states.iter().zip(&joint.covariance_si) {
            for (j, value) in states.iter().zip(row) {
                if let (Some(i), Some(j)) = (i, j) {
                    *self.at_mut(*i, *j) = *value;
                }
            }
        }
    }

    /// Adds variance to a state.
    pub fn add_variance(&mut self, i: usize, variance: f64) {
        *self.at_mut(i, i) += variance;
    }

    /// Adds a covariance of the navigation states.
    pub(super) fn add_nav(&mut self, q: &NavCovariance) {
        for i in 0..NAV {
            for j in 0..NAV {
                *self.at_mut(i, j) += 0.5 * (q[(i, j)] + q[(j, i)]);
            }
        }
    }

    /// Forgets all correlations of a state and gives it a new sigma.
    pub fn reset(&mut self, i: usize, sigma: f64) {
        for j in 0..self.n {
            *self.at_mut(i, j) = 0.0;
            *self.at_mut(j, i) = 0.0;
        }
        *self.at_mut(i, i) = sigma * sigma;
    }

    /// Scales three states that follow each other by a factor: P ← D P D.
    pub fn scale3(&mut self, first: usize, factor: f64) {
        for panel in self.data.chunks_exact_mut(self.n) {
            panel.iter_mut().skip(first).take(3).flatten().for_each(|v| *v *= factor);
        }
        for k in first..first + 3 {
            let column = self.data.iter_mut().skip(k / PANEL * self.n).take(self.n);
            column.for_each(|row| row[k % PANEL] *= factor);
        }
    }

    /// P ← M P Mᵀ.
    pub(super) fn transform(&mut self, map: &impl NavMap) {
        Arch::new().dispatch(Congruence { map, n: self.n, data: &mut self.data });
    }

    /// P h for up to three sparse rows h, given as states with a coefficient per row.
    pub(super) fn times(&self, h: &[(usize, [f64; GROUP])]) -> Tall {
        let mut out = Tall::new(self.n);
        Arch::new().dispatch(Product { n: self.n, data: self.data.as_flattened(), h, out: &mut out.panels });
        out
    }

    /// P ← P − Σ w wᵀ.
    pub(super) fn subtract_outer(&mut self, w: &Tall) {
        Arch::new().dispatch(Downdate { n: self.n, data: self.data.as_flattened_mut(), w: &w.panels });
    }

    /// Whether every variance is positive and finite, and no correlation exceeds one.
    pub fn is_sound(&self) -> bool {
        (0..self.n).all(|i| {
            let d = self.at(i, i);
            d.is_finite()
                && d >= 0.0
                && (0..i).all(|j| {
                    let c = self.at(i, j);
                    c.is_finite() && c * c <= d * self.at(j, j) * (1.0 + 1e-9) + f64::MIN_POSITIVE
                })
        })
    }
}

/// Up to three vectors as long as the state, padded as the covariance is.
#[derive(Debug, Clone)]
pub(super) struct Tall {
    panels: Vec<[[f64; PANEL]; GROUP]>,
}

impl Tall {
    fn new(n: usize) -> Self {
        Self { panels: vec![[[0.0; PANEL]; GROUP]; n.div_ceil(PANEL)] }
    }

    /// One number of each vector.
    pub(super) fn at(&self, state: usize) -> [f64; GROUP] {
        self.panels[state / PANEL].map(|v| v[state % PANEL])
    }

    /// Σ c·v over the vectors, for the first states of `out`.
    pub(super) fn combined(&self, c: [f64; GROUP], out: &mut [f64]) {
        for (out, panel) in out.chunks_mut(PANEL).zip(&self.panels) {
            for (k, out) in out.iter_mut().enumerate() {
                *out = c[0] * panel[0][k] + c[1] * panel[1][k] + c[2] * panel[2][k];
            }
        }
    }

    /// W with L W = V: the vectors whitened by a lower triangle.
    pub(super) fn whitened(mut self, l: &[[f64; GROUP]; GROUP]) -> Self {
        let scale = [1.0 / l[0][0], 1.0 / l[1][1], 1.0 / l[2][2]];
        for [a, b, c] in &mut self.panels {
            for k in 0..PANEL {
                a[k] *= scale[0];
                b[k] = (b[k] - l[1][0] * a[k]) * scale[1];
                c[k] = (c[k] - l[2][0] * a[k] - l[2][1] * b[k]) * scale[2];
            }
        }
        self
    }
}

/// P ← M P Mᵀ as M (M P)ᵀ.
struct Congruence<'a, M> {
    map: &'a M,
    n: usize,
    data: &'a mut [[f64; PANEL]],
}

impl<M: NavMap> WithSimd for Congruence<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { map, n, data } = self;
        // In place: each column of M P depends on the same column of P alone.
        for panel in data.chunks_exact_mut(n) {
            let (panel, _) = S::as_mut_simd_f64s(panel.as_flattened_mut());
            for at in 0..PANEL / S::F64_LANES {
                let rows = map.rows(simd, Columns::new(panel, at));
                for (row, out) in rows.as_flattened().iter().zip(panel.chunks_exact_mut(PANEL / S::F64_LANES))
                {
                    out[at] = *row;
                }
            }
        }
        transpose_nav(n, data);
        let mut square = [[0.0; 2 * PANEL]; NAV];
        for (p, panel) in data.chunks_exact(n).enumerate().take(2) {
            let (panel, _) = S::as_simd_f64s(panel.as_flattened());
            let parts = (NAV - p * PANEL).min(PANEL).div_ceil(S::F64_LANES);
            for at in 0..parts {
                let rows = map.rows(simd, Columns::new(panel, at));
                for (row, out) in rows.as_flattened().iter().zip(&mut square) {
                    let (out, _) = S::as_mut_simd_f64s(&mut out[p * PANEL..]);
                    out[at] = *row;
                }
            }
        }
        set_nav(n, data, &square);
    }
}

/// Puts the transpose of the first nine rows into the first nine columns. What the rows hold behind their ninth number
/// stays.
#[inline(always)]
fn transpose_nav(n: usize, data: &mut [[f64; PANEL]]) {
    let (first, others) = data.split_at_mut(n);
    let (second, others) = others.split_at_mut(n);
    let (Some((square, first)), Some((right, second))) =
        (first.split_first_chunk_mut::<NAV>(), second.split_first_chunk_mut::<NAV>())
    else {
        return;
    };
    for i in 0..PANEL {
        let (upper, lower) = square.split_at_mut(i + 1);
        for (row, right) in lower.iter_mut().zip(&mut upper[i][i + 1..]) {
            std::mem::swap(&mut row[i], right);
        }
        // The row of the ninth state went with the square; its column is the first of the second panel.
        std::mem::swap(&mut lower[PANEL - 1 - i][i], &mut right[i][0]);
    }
    let others = others.chunks_exact(n).filter_map(<[_]>::first_chunk);
    // The second panel begins with the ninth state, which belongs to the square.
    let (near, far) = first.split_at_mut(first.len().min(PANEL - 1));
    let (near_end, far_end) = second.split_at_mut(near.len());
    for (l, (out, end)) in near.iter_mut().zip(near_end).enumerate() {
        flip(right, l + 1, out, end);
    }
    for ((block, out), end) in others.zip(far.chunks_mut(PANEL)).zip(far_end.chunks_mut(PANEL)) {
        if let (Ok(out), Ok(end)) =
            (<&mut [_; PANEL]>::try_from(&mut *out), <&mut [_; PANEL]>::try_from(&mut *end))
        {
            for l in 0..PANEL {
                flip(block, l, &mut out[l], &mut end[l]);
            }
        } else {
            out.iter_mut().zip(end).enumerate().for_each(|(l, (out, end))| flip(block, l, out, end));
        }
    }
}

/// Column `l` of a block as a row: eight numbers in the first panel, the ninth in the second.
#[inline(always)]
fn flip(block: &[[f64; PANEL]; NAV], l: usize, out: &mut [f64; PANEL], end: &mut [f64; PANEL]) {
    for i in 0..PANEL {
        out[i] = block[i][l];
    }
    end[0] = block[PANEL][l];
}

/// Sets the square of nine from its upper triangle.
#[inline(always)]
fn set_nav(n: usize, data: &mut [[f64; PANEL]], upper: &[[f64; 2 * PANEL]; NAV]) {
    let (first, second) = data.split_at_mut(n);
    for (i, (first, second)) in first.iter_mut().zip(second).take(NAV).enumerate() {
        for (j, out) in first.iter_mut().enumerate() {
            *out = upper[i.min(j)][i.max(j)];
        }
        second[0] = upper[i][PANEL];
    }
}

/// P h.
struct Product<'a> {
    n: usize,
    data: &'a [f64],
    h: &'a [(usize, [f64; GROUP])],
    out: &'a mut [[[f64; PANEL]; GROUP]],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let parts = PANEL / S::F64_LANES;
        for (panel, out) in self.data.chunks_exact(self.n * PANEL).zip(self.out) {
            let (panel, _) = S::as_simd_f64s(panel);
            let [a, b, c] = out;
            let (a, b, c) = (S::as_mut_simd_f64s(a).0, S::as_mut_simd_f64s(b).0, S::as_mut_simd_f64s(c).0);
            for at in 0..parts {
                let mut sum = [simd.splat_f64s(0.0); GROUP];
                for (state, by) in self.h {
                    let x = panel[state * parts + at];
                    sum[0] = simd.add_f64s(sum[0], simd.mul_f64s(simd.splat_f64s(by[0]), x));
                    sum[1] = simd.add_f64s(sum[1], simd.mul_f64s(simd.splat_f64s(by[1]), x));
                    sum[2] = simd.add_f64s(sum[2], simd.mul_f64s(simd.splat_f64s(by[2]), x));
                }
                (a[at], b[at], c[at]) = (sum[0], sum[1], sum[2]);
            }
        }
    }
}

/// P ← P − Σ w wᵀ.
struct Downdate<'a> {
    n: usize,
    data: &'a mut [f64],
    w: &'a [[[f64; PANEL]; GROUP]],
}

impl WithSimd for Downdate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (panel, columns) in self.data.chunks_exact_mut(self.n * PANEL).zip(self.w) {
            let [a, b, c] = columns;
            let (a, b, c) = (S::as_simd_f64s(a).0, S::as_simd_f64s(b).0, S::as_simd_f64s(c).0);
            for (block, rows) in panel.chunks_mut(PANEL * PANEL).zip(self.w) {
                for (i, row) in block.chunks_exact_mut(PANEL).enumerate() {
                    let by = [rows[0][i], rows[1][i], rows[2][i]];
                    let by = [simd.splat_f64s(by[0]), simd.splat_f64s(by[1]), simd.splat_f64s(by[2])];
                    let (row, _) = S::as_mut_simd_f64s(row);
                    for (((p, a), b), c) in row.iter_mut().zip(a).zip(b).zip(c) {
                        let less = simd.sub_f64s(*p, simd.mul_f64s(by[0], *a));
                        let less = simd.sub_f64s(less, simd.mul_f64s(by[1], *b));
                        *p = simd.sub_f64s(less, simd.mul_f64s(by[2], *c));
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::nav_map::{Dense, dense_rows};
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    fn dense(c: &Covariance) -> DMatrix<f64> {
        DMatrix::from_fn(c.len(), c.len(), |i, j| c.at(i, j))
    }

    fn some_covariance(n: usize, values: &[f64]) -> Covariance {
        let a = DMatrix::from_fn(n, n, |i, j| values[(i * 7 + j * 3) % values.len()]);
        let p = &a * a.transpose() + DMatrix::identity(n, n);
        let mut c = Covariance::from_sigmas(&vec![0.0; n]);
        for i in 0..n {
            for j in 0..n {
                *c.at_mut(i, j) = p[(i, j)];
            }
        }
        c
    }

    /// A map with every column at work but some, on `n` states.
    fn some_transition(n: usize, values: &[f64]) -> Dense {
        let value = |k: usize| values[k % values.len()];
        let used = (0..n).filter(|k| *k < NAV || !k.is_multiple_of(4));
        Dense(used.map(|k| (k, std::array::from_fn(|i| value(k * 5 + i * 3 + 1)))).collect())
    }

    proptest! {
        #[test]
        fn a_step_equals_the_dense_product(
            values in proptest::collection::vec(-1.0..1.0f64, 23),
            n in prop_oneof![Just(15_usize), Just(18), Just(24), Just(29)],
        ) {
            let mut c = some_covariance(n, &values);
            let phi = some_transition(n, &values);
            let mut full = DMatrix::<f64>::identity(n, n);
            full.rows_mut(0, NAV).fill(0.0);
            for (state, column) in &phi.0 {
                (0..NAV).for_each(|i| full[(i, *state)] = column[i]);
            }
            let rows = dense_rows(&phi, n);
            for i in 0..NAV {
                for j in 0..n {
                    prop_assert!((rows[i * n + j] - full[(i, j)]).abs() < 1e-12);
                }
            }
            let expected = &full * dense(&c) * full.transpose();
            c.transform(&phi);
            prop_assert!((dense(&c) - &expected).norm() < 1e-12 * expected.norm());
            prop_assert_eq!(dense(&c), dense(&c).transpose());
        }

        #[test]
        fn the_width_of_the_registers_changes_nothing(values in proptest::collection::vec(-1.0..1.0f64, 23)) {
            let phi = some_transition(24, &values);
            let mut wide = some_covariance(24, &values);
            let mut narrow = wide.clone();
            Congruence { map: &phi, n: 24, data: &mut narrow.data }.with_simd(pulp::Scalar);
            wide.transform(&phi);
            prop_assert_eq!(wide, narrow);
        }

        #[test]
        fn a_measurement_update_keeps_it_sound(values in proptest::collection::vec(-1.0..1.0f64, 23), r in 1e-6..1.0f64) {
            let mut c = some_covariance(14, &values);
            let h = [(0, [1.0, 0.0, 0.0]), (12, [-0.5, 0.0, 0.3])];
            let ph = c.times(&h);
            let before = dense(&c);
            let rows = DMatrix::from_fn(3, 14, |i, j| h.iter().find(|(k, _)| *k == j).map_or(0.0, |(_, v)| v[i]));
            let exact = &before * rows.transpose();
            for k in 0..14 {
                prop_assert!((0..3).all(|i| (ph.at(k)[i] - exact[(k, i)]).abs() < 1e-12));
            }
            let s = &rows * exact + DMatrix::identity(3, 3) * r;
            let gained = &before * rows.transpose() * s.clone().try_inverse().unwrap_or_default() * &rows * &before;
            let Some(l) = s.cholesky().map(|c| c.l()) else { return Ok(()) };
            let w = ph.whitened(&std::array::from_fn(|i| std::array::from_fn(|j| l[(i, j)])));
            c.subtract_outer(&w);
            prop_assert!(c.is_sound());
            prop_assert!((dense(&c) - (before - gained)).norm() < 1e-9);
        }
    }

    #[test]
    fn scaling_keeps_correlations() {
        let mut c = some_covariance(14, &[0.3, -0.2, 0.9, 0.5, -0.7]);
        let before = dense(&c);
        c.scale3(11, 0.5);
        assert_eq!(c.at(3, 4), before[(3, 4)]);
        assert_eq!(c.at(3, 12), 0.5 * before[(3, 12)]);
        assert_eq!(c.at(12, 3), 0.5 * before[(3, 12)]);
        assert_eq!(c.at(12, 13), 0.25 * before[(12, 13)]);
    }
}
