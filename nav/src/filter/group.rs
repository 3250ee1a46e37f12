//! A group of up to three scalar measurements taken together: rows, innovation covariance, whitening.

use super::covariance::{Covariance, GROUP, Tall};
use super::update::{Group, gate};
use crate::math::ln;

/// Up to three measurements: residuals, sparse rows, variances of their own and loading of the noise that they share.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    /// How many there are; what stands behind is zero.
    pub(super) dof: usize,
    pub(super) residual: [f64; GROUP],
    /// State by state, its coefficient in each row.
    pub(super) h: Vec<(usize, [f64; GROUP])>,
    pub(super) variance: [f64; GROUP],
    pub(super) shared: [f64; GROUP],
}

impl Rows {
    /// Adds a state to the rows there are.
    pub(super) fn push(&mut self, state: usize, by: impl Fn(usize) -> f64) {
        let by = std::array::from_fn(|i| if i < self.dof { by(i) } else { 0.0 });
        if by != [0.0; GROUP] {
            self.h.push((state, by));
        }
    }

    /// Variances of what the rows measure, by this covariance alone.
    pub(super) fn variances_by(&self, p: &Covariance) -> [f64; GROUP] {
        let ph = p.times(&self.h);
        let mut out = [0.0; GROUP];
        for (state, by) in &self.h {
            let column = ph.at(*state);
            out.iter_mut().zip(by.iter().zip(&column)).for_each(|(s, (c, p))| *s += c * p);
        }
        out
    }

    /// The residuals less what an error of the state explains of them.
    pub(super) fn less(mut self, x: &[f64]) -> Self {
        for (state, by) in &self.h {
            self.residual.iter_mut().zip(by).for_each(|(r, c)| *r -= c * x[*state]);
        }
        self
    }
}

/// What a covariance says of a group.
#[derive(Debug, Clone)]
pub(super) struct Prepared {
    /// P Hᵀ.
    ph: Tall,
    /// Lower triangle of S = L Lᵀ; the identity where there is no row.
    pub(super) l: [[f64; GROUP]; GROUP],
    /// L⁻¹ z.
    white: [f64; GROUP],
    pub(super) group: Group,
}

impl Prepared {
    /// `None` where there are no rows, or they or the covariance are not sound.
    pub(super) fn new(rows: &Rows, p: &Covariance) -> Option<Self> {
        if rows.dof == 0 || rows.residual.iter().any(|r| !r.is_finite()) {
            return None;
        }
        let ph = p.times(&rows.h);
        let mut s = [[0.0; GROUP]; GROUP];
        for (state, by) in &rows.h {
            let column = ph.at(*state);
            for (s, c) in s.iter_mut().zip(by) {
                s.iter_mut().zip(&column).for_each(|(s, p)| *s += c * p);
            }
        }
        for (i, row) in s.iter_mut().enumerate() {
            row.iter_mut().zip(&rows.shared).for_each(|(s, other)| *s += rows.shared[i] * other);
            row[i] += if i < rows.dof { rows.variance[i] } else { 1.0 };
        }
        let l = cholesky(&s)?;
        let white = forward(&l, &rows.residual);
        let nis = white.iter().map(|v| v * v).sum::<f64>();
        let ln_det = 2.0 * (0..GROUP).map(|i| ln(l[i][i])).sum::<f64>();
        let log_likelihood =
            -0.5 * (nis.min(gate(rows.dof)) + ln_det + rows.dof as f64 * ln(std::f64::consts::TAU));
        let group = Group {
            dof: rows.dof,
            nis,
            innovation: rows.residual,
            normalised: std::array::from_fn(|i| rows.residual[i] / s[i][i].sqrt()),
            noise: std::array::from_fn(|i| rows.variance[i] + rows.shared[i].powi(2)),
            log_likelihood,
            used: false,
            recovered: false,
        };
        Some(Self { ph, l, white, group })
    }

    /// Lets the group shrink the covariance, P ← P − P Hᵀ S⁻¹ H P as outer products so that it stays symmetric, and
    /// gives what it says of the error: `dx` = P Hᵀ S⁻¹ z.
    pub(super) fn absorb(self, p: &mut Covariance, dx: &mut [f64]) -> Group {
        let w = self.ph.whitened(&self.l);
        p.subtract_outer(&w);
        w.combined(self.white, dx);
        self.group
    }
}

/// L of S = L Lᵀ (Golub & Van Loan 2013, section 4.2.5).
fn cholesky(s: &[[f64; GROUP]; GROUP]) -> Option<[[f64; GROUP]; GROUP]> {
    let mut l = [[0.0; GROUP]; GROUP];
    for i in 0..GROUP {
        for j in 0..=i {
            let rest = s[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i > j {
                l[i][j] = rest / l[j][j];
            } else if rest > 0.0 {
                l[i][i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(l)
}

/// L⁻¹ v.
fn forward(l: &[[f64; GROUP]; GROUP], v: &[f64; GROUP]) -> [f64; GROUP] {
    let mut out = *v;
    for i in 0..GROUP {
        let rest = out[i] - (0..i).map(|k| l[i][k] * out[k]).sum::<f64>();
        out[i] = rest / l[i][i];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    fn covariance() -> Covariance {
        let mut p = Covariance::from_sigmas(&[2.0; 15]);
        let three = Matrix3::new(4.0, 1.0, 0.5, 1.0, 4.0, -0.3, 0.5, -0.3, 4.0);
        p.set_block3(3, &three);
        p
    }

    fn rows(dof: usize) -> Rows {
        let mut rows = Rows { dof, ..Rows::default() };
        for i in 0..dof {
            rows.residual[i] = 1.0 - 0.3 * i as f64;
            rows.variance[i] = 0.5;
            rows.shared[i] = 0.2;
        }
        (0..3).for_each(|k| rows.push(3 + k, |i| if i == k { 1.0 } else { 0.1 }));
        rows
    }

    /// The textbook's formulas on dense matrices give the same gain, likelihood and correction.
    #[test]
    fn whitening_gives_what_the_textbook_gives() {
        for dof in [2, 3] {
            let (p, rows) = (covariance(), rows(dof));
            let dense = p.block(&(0..15).collect::<Vec<_>>());
            let mut h = nalgebra::DMatrix::zeros(dof, 15);
            rows.h.iter().for_each(|(state, by)| (0..dof).for_each(|i| h[(i, *state)] = by[i]));
            let r = nalgebra::DMatrix::from_fn(dof, dof, |i, j| 0.04 + if i == j { 0.5 } else { 0.0 });
            let s = &h * &dense * h.transpose() + r;
            let inverse = s.clone().try_inverse().unwrap();
            let gain = &dense * h.transpose() * &inverse;
            let z = nalgebra::DVector::from_row_slice(&rows.residual[..dof]);
            let prepared = Prepared::new(&rows, &p).unwrap();
            let nis = (z.transpose() * inverse * &z)[0];
            assert!((prepared.group.nis - nis).abs() < 1e-12);
            let expected = -0.5 * (nis + ln(s.determinant()) + dof as f64 * ln(std::f64::consts::TAU));
            assert!((prepared.group.log_likelihood - expected).abs() < 1e-12);
            let (mut after, mut dx) = (p.clone(), vec![0.0; 15]);
            prepared.absorb(&mut after, &mut dx);
            let exact = &dense - &gain * &h * &dense;
            assert!((after.block(&(0..15).collect::<Vec<_>>()) - exact).norm() < 1e-12);
            assert!((nalgebra::DVector::from(dx) - gain * z).norm() < 1e-12);
        }
    }

    #[test]
    fn what_is_not_finite_is_refused() {
        let p = covariance();
        assert!(Prepared::new(&Rows::default(), &p).is_none());
        let mut bad = rows(2);
        bad.residual[1] = f64::NAN;
        assert!(Prepared::new(&bad, &p).is_none());
        let mut bad = rows(2);
        bad.variance[0] = -10.0;
        assert!(Prepared::new(&bad, &p).is_none());
    }
}
