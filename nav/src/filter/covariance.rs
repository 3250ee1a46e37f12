//! A covariance matrix and the two things a filter does to it, with the structure of the problem used.
//!
//! Only the nine navigation states have dynamics; everything behind them is constant or a first-order Gauss-Markov
//! process. So a time step touches nine rows and columns. Storage is a full symmetric matrix, row by row; every
//! operation keeps it symmetric by construction.

use nalgebra::Matrix3;

/// Number of navigation states: position, velocity and attitude errors.
pub const NAV: usize = 9;

/// A symmetric, positive matrix of any size.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    n: usize,
    data: Vec<f64>,
    scratch: Vec<f64>,
}

impl Covariance {
    /// A diagonal covariance from 1-sigmas.
    pub fn from_sigmas(sigmas: &[f64]) -> Self {
        let n = sigmas.len();
        let mut data = vec![0.0; n * n];
        for (i, s) in sigmas.iter().enumerate() {
            data[i * n + i] = s * s;
        }
        Self { n, data, scratch: Vec::new() }
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
        self.data[i * self.n + j]
    }

    /// One row.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.data[i * self.n..(i + 1) * self.n]
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
                self.data[(at + i) * self.n + at + j] = 0.5 * (block[(i, j)] + block[(j, i)]);
            }
        }
    }

    /// Takes over all entries of another covariance of the same size from state `from` on.
    pub fn copy_tail(&mut self, other: &Self, from: usize) {
        for i in from..self.n.min(other.n) {
            let range = i * self.n + from..(i + 1) * self.n;
            self.data[range.clone()].copy_from_slice(&other.data[range]);
        }
    }

    /// Adds variance to a state.
    pub fn add_variance(&mut self, i: usize, variance: f64) {
        self.data[i * self.n + i] += variance;
    }

    /// Forgets all correlations of a state and gives it a new sigma.
    pub fn reset(&mut self, i: usize, sigma: f64) {
        for j in 0..self.n {
            self.data[i * self.n + j] = 0.0;
            self.data[j * self.n + i] = 0.0;
        }
        self.data[i * self.n + i] = sigma * sigma;
    }

    /// Scales a state by a factor: P ← D P D.
    pub fn scale(&mut self, i: usize, factor: f64) {
        for j in 0..self.n {
            self.data[i * self.n + j] *= factor;
            self.data[j * self.n + i] *= factor;
        }
    }

    /// P ← Φ P Φᵀ, where Φ is the identity except for its first nine rows.
    ///
    /// `phi` holds these rows, 9 × n, row by row.
    pub fn propagate(&mut self, phi: &[f64]) {
        let n = self.n;
        debug_assert_eq!(phi.len(), NAV * n);
        let mut t = std::mem::take(&mut self.scratch);
        t.clear();
        t.resize(NAV * n, 0.0);
        for (row, out) in phi.chunks_exact(n).zip(t.chunks_exact_mut(n)) {
            for (coefficient, p) in row.iter().zip(self.data.chunks_exact(n)) {
                if *coefficient != 0.0 {
                    for (o, x) in out.iter_mut().zip(p) {
                        *o += coefficient * x;
                    }
                }
            }
        }
        for i in 0..NAV {
            let ti = &t[i * n..(i + 1) * n];
            for j in i..NAV {
                let pj = &phi[j * n..(j + 1) * n];
                let v: f64 = ti.iter().zip(pj).map(|(a, b)| a * b).sum();
                self.data[i * n + j] = v;
                self.data[j * n + i] = v;
            }
            for (j, v) in ti.iter().enumerate().skip(NAV) {
                self.data[i * n + j] = *v;
                self.data[j * n + i] = *v;
            }
        }
        self.scratch = t;
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

    /// P ← P − w wᵀ.
    pub fn subtract_outer(&mut self, w: &[f64]) {
        for (wi, row) in w.iter().zip(self.data.chunks_exact_mut(self.n)) {
            for (p, wj) in row.iter_mut().zip(w) {
                *p -= wi * wj;
            }
        }
    }

    /// P ← M P Mᵀ for a change of coordinates of the navigation states; `m` is 9 × 9, row by row.
    pub fn transform_nav(&mut self, m: &[[f64; NAV]; NAV]) {
        let n = self.n;
        let mut phi = vec![0.0; NAV * n];
        for (i, row) in m.iter().enumerate() {
            phi[i * n..i * n + NAV].copy_from_slice(row);
        }
        self.propagate(&phi);
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

#[cfg(test)]
mod tests {
    use super::*;
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
                c.data[i * n + j] = p[(i, j)];
            }
        }
        c
    }

    proptest! {
        #[test]
        fn structured_products_equal_dense_ones(
            values in proptest::collection::vec(-1.0..1.0f64, 23),
            phi in proptest::collection::vec(-1.0..1.0f64, NAV * 14),
        ) {
            let n = 14;
            let mut c = some_covariance(n, &values);
            let mut full = DMatrix::<f64>::identity(n, n);
            for i in 0..NAV { for j in 0..n { full[(i, j)] = phi[i * n + j]; } }
            let expected = &full * dense(&c) * full.transpose();
            c.propagate(&phi);
            prop_assert!((dense(&c) - expected).norm() < 1e-9);
        }

        #[test]
        fn a_measurement_update_keeps_it_sound(values in proptest::collection::vec(-1.0..1.0f64, 23), r in 1e-6..1.0f64) {
            let mut c = some_covariance(14, &values);
            let ph = c.times(&[(0, 1.0), (12, -0.5)]);
            let s = ph[0] - 0.5 * ph[12] + r;
            let w: Vec<f64> = ph.iter().map(|x| x / s.sqrt()).collect();
            c.subtract_outer(&w);
            prop_assert!(c.is_sound());
        }
    }
}
