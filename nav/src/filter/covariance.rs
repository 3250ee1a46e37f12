//! A covariance matrix and the two things a filter does to it, with the structure of the problem used.
//!
//! Only the nine navigation states have dynamics; everything behind them is constant or a first-order Gauss-Markov
//! process. So a time step touches nine rows and columns. Storage is a full symmetric matrix, row by row, each row
//! padded with zeros to whole vector registers; every operation keeps it symmetric by construction.

use super::nav_map::{Columns, NavMap};
use nalgebra::Matrix3;
use pulp::{Arch, Simd, WithSimd};

/// Number of navigation states: position, velocity and attitude errors.
pub const NAV: usize = 9;
/// Numbers in the widest vector register.
const LANES: usize = 8;

/// A symmetric, positive matrix of any size.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    n: usize,
    /// Length of a row with its padding.
    stride: usize,
    data: Vec<f64>,
    scratch: Vec<f64>,
}

impl Covariance {
    /// A diagonal covariance from 1-sigmas.
    pub fn from_sigmas(sigmas: &[f64]) -> Self {
        let n = sigmas.len();
        let stride = n.next_multiple_of(LANES);
        let mut data = vec![0.0; n * stride];
        for (i, s) in sigmas.iter().enumerate() {
            data[i * stride + i] = s * s;
        }
        Self { n, stride, data, scratch: vec![0.0; NAV * stride] }
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
        self.data[i * self.stride + j]
    }

    /// One row.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.data[i * self.stride..i * self.stride + self.n]
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
                self.data[(at + i) * self.stride + at + j] = 0.5 * (block[(i, j)] + block[(j, i)]);
            }
        }
    }

    /// Takes over all entries of another covariance of the same size from state `from` on.
    pub fn copy_tail(&mut self, other: &Self, from: usize) {
        for i in from..self.n.min(other.n) {
            let range = i * self.stride + from..(i + 1) * self.stride;
            self.data[range.clone()].copy_from_slice(&other.data[range]);
        }
    }

    /// Adds variance to a state.
    pub fn add_variance(&mut self, i: usize, variance: f64) {
        self.data[i * self.stride + i] += variance;
    }

    /// Forgets all correlations of a state and gives it a new sigma.
    pub fn reset(&mut self, i: usize, sigma: f64) {
        for j in 0..self.n {
            self.data[i * self.stride + j] = 0.0;
            self.data[j * self.stride + i] = 0.0;
        }
        self.data[i * self.stride + i] = sigma * sigma;
    }

    /// Scales three states that follow each other by a factor: P ← D P D.
    pub fn scale3(&mut self, first: usize, factor: f64) {
        let range = first..first + 3;
        for (i, row) in self.data.chunks_exact_mut(self.stride).enumerate() {
            if range.contains(&i) {
                row.iter_mut().for_each(|v| *v *= factor);
            }
            row[range.clone()].iter_mut().for_each(|v| *v *= factor);
        }
    }

    /// P ← M P Mᵀ.
    pub(super) fn transform(&mut self, map: &impl NavMap) {
        let Self { n, stride, data, scratch } = self;
        Arch::new().dispatch(Congruence { map, n: *n, stride: *stride, data, scratch });
    }

    /// P h for a sparse row h, given as (state, coefficient) pairs.
    pub fn times(&self, h: &[(usize, f64)]) -> Vec<f64> {
        let mut out = vec![0.0; self.n];
        for (k, c) in h {
            for (o, x) in out.iter_mut().zip(self.row(*k)) {
                *o += c * x;
            }
        }
        out
    }

    /// P ← P − Σ w wᵀ for rows `w` of n numbers each.
    pub fn subtract_outer(&mut self, w: &[&[f64]]) {
        let padded = self.stride;
        self.scratch.resize((NAV * padded).max(w.len() * padded), 0.0);
        for (row, out) in w.iter().zip(self.scratch.chunks_exact_mut(padded)) {
            out[..self.n].copy_from_slice(row);
            out[self.n..].fill(0.0);
        }
        let Self { stride, data, scratch, .. } = self;
        Arch::new().dispatch(Downdate { stride: *stride, data, w: &scratch[..w.len() * padded] });
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

/// P ← M P Mᵀ as M (M P)ᵀ.
struct Congruence<'a, M> {
    map: &'a M,
    n: usize,
    stride: usize,
    data: &'a mut [f64],
    scratch: &'a mut [f64],
}

impl<M: NavMap> WithSimd for Congruence<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { map, n, stride, data, scratch } = self;
        rows_times(simd, map, data, scratch, stride, stride);
        for (k, row) in data.chunks_exact_mut(stride).enumerate() {
            for (i, out) in row.iter_mut().enumerate().take(NAV) {
                *out = scratch[i * stride + k];
            }
        }
        for i in 0..NAV {
            let range = i * stride + NAV..i * stride + n;
            data[range.clone()].copy_from_slice(&scratch[range]);
        }
        rows_times(simd, map, data, scratch, stride, NAV);
        for i in 0..NAV {
            for j in i..NAV {
                let v = scratch[i * stride + j];
                data[i * stride + j] = v;
                data[j * stride + i] = v;
            }
        }
    }
}

/// The nine rows of M X into `out` for at least the first `columns` columns of X.
#[inline(always)]
fn rows_times<S: Simd>(
    simd: S,
    map: &impl NavMap,
    x: &[f64],
    out: &mut [f64],
    stride: usize,
    columns: usize,
) {
    let (x, _) = S::as_simd_f64s(x);
    let (out, _) = S::as_mut_simd_f64s(out);
    let stride = stride / S::F64_LANES;
    for at in 0..columns.div_ceil(S::F64_LANES) {
        let rows = map.rows(simd, Columns::new(x, stride, at));
        for (row, out) in rows.as_flattened().iter().zip(out.chunks_exact_mut(stride)) {
            out[at] = *row;
        }
    }
}

/// P ← P − Σ w wᵀ.
struct Downdate<'a> {
    stride: usize,
    data: &'a mut [f64],
    w: &'a [f64],
}

impl WithSimd for Downdate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for w in self.w.chunks_exact(self.stride) {
            let (lanes, _) = S::as_simd_f64s(w);
            for (row, wi) in self.data.chunks_exact_mut(self.stride).zip(w) {
                let wi = simd.splat_f64s(*wi);
                let (row, _) = S::as_mut_simd_f64s(row);
                for (p, wj) in row.iter_mut().zip(lanes) {
                    *p = simd.sub_f64s(*p, simd.mul_f64s(wi, *wj));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::nav_map::{Transition, dense_rows};
    use nalgebra::{DMatrix, Matrix3xX, Vector3};
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
                c.data[i * c.stride + j] = p[(i, j)];
            }
        }
        c
    }

    /// A transition with every part at work, on `n` states.
    fn some_transition(n: usize, values: &[f64]) -> Transition {
        let value = |k: usize| values[k % values.len()];
        let triple = |k: usize| [value(k), value(k + 1), value(k + 2)];
        let matrix = |k: usize| [triple(k), triple(k + 3), triple(k + 6)];
        let mut phi = Transition {
            dt: 0.3 + value(3).abs(),
            to_end: matrix(0),
            earth: triple(5),
            gradient: matrix(11),
            dv: triple(7),
            dp: triple(13),
            half_turn_dt: matrix(2),
            ..Transition::default()
        };
        let columns = |from: usize| -> Vec<Vector3<f64>> {
            (0..n - NAV)
                .map(
                    |k| if (k + from).is_multiple_of(3) { Vector3::zeros() } else { triple(from + k).into() },
                )
                .collect()
        };
        phi.rate.set_mean(NAV, &columns(1), &columns(4));
        phi.force.set_mean(NAV, &columns(8), &columns(5));
        phi
    }

    /// The same, from the blocks that its factors stand for.
    fn dense_transition(
        phi: &Transition,
        n: usize,
        rate: &Matrix3xX<f64>,
        force: &Matrix3xX<f64>,
    ) -> DMatrix<f64> {
        let matrix = |m: &[[f64; 3]; 3]| Matrix3::from(*m).transpose();
        let cross = |v: &[f64; 3]| crate::rotation::skew(&Vector3::from(*v));
        let (turn, one) = (matrix(&phi.to_end), Matrix3::identity());
        let (mean, dv, dp) = (matrix(&phi.half_turn_dt), cross(&phi.dv), cross(&phi.dp));
        let mut full = DMatrix::<f64>::identity(n, n);
        let mut put = |row: usize, column: usize, m: Matrix3xX<f64>| {
            full.view_mut((row, column), (3, m.ncols())).copy_from(&m)
        };
        let three = |m: Matrix3<f64>| Matrix3xX::from_fn(3, |i, j| m[(i, j)]);
        put(0, 0, three(turn * (one + cross(&phi.earth))));
        put(0, 3, three(turn * phi.dt));
        put(0, 6, three(-turn * dp));
        put(3, 0, three(turn * matrix(&phi.gradient)));
        put(3, 3, three(turn * (one - cross(&phi.earth))));
        put(3, 6, three(-turn * dv));
        put(6, 6, three(turn));
        put(0, 9, turn * (force * (0.5 * phi.dt * phi.dt) - dp * mean * rate / 3.0));
        put(3, 9, turn * (mean * force - dv * mean * rate * 0.5));
        put(6, 9, turn * mean * rate);
        full
    }

    fn columns_of(rows: impl Fn(usize) -> f64, n: usize) -> Matrix3xX<f64> {
        Matrix3xX::from_fn(n - NAV, |i, k| rows(i * n + NAV + k))
    }

    proptest! {
        #[test]
        fn a_step_equals_the_dense_product(
            values in proptest::collection::vec(-1.0..1.0f64, 23),
            n in prop_oneof![Just(15_usize), Just(18), Just(24), Just(29)],
        ) {
            let mut c = some_covariance(n, &values);
            let phi = some_transition(n, &values);
            let rate = phi.rate.dense(n);
            let force = phi.force.dense(n);
            let full = dense_transition(&phi, n, &columns_of(|k| rate[k], n), &columns_of(|k| force[k], n));
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
            let Covariance { n, stride, mut data, mut scratch } = wide.clone();
            Congruence { map: &phi, n, stride, data: &mut data, scratch: &mut scratch }.with_simd(pulp::Scalar);
            wide.transform(&phi);
            prop_assert_eq!(wide.data, data);
        }

        #[test]
        fn a_measurement_update_keeps_it_sound(values in proptest::collection::vec(-1.0..1.0f64, 23), r in 1e-6..1.0f64) {
            let mut c = some_covariance(14, &values);
            let ph = c.times(&[(0, 1.0), (12, -0.5)]);
            let s = ph[0] - 0.5 * ph[12] + r;
            let w: Vec<f64> = ph.iter().map(|x| x / s.sqrt()).collect();
            let expected = dense(&c) - DMatrix::from_fn(14, 14, |i, j| w[i] * w[j]);
            c.subtract_outer(&[&w]);
            prop_assert!(c.is_sound());
            prop_assert!((dense(&c) - expected).norm() < 1e-12);
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
