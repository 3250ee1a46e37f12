//! The fixed-interval smoother: the best trajectory that all the data of a flight allow, and what the data say against the
//! model on the way.
//!
//! Backwards over the [recording](crate::filter::tape) of a filter by the adjoint recursion of Bryson & Frazier in
//! Bierman's form (Bierman 1973, "Fixed interval smoothing with discrete measurements"): no covariance is inverted, so constants
//! without process noise do no harm, and with the filter's own left-invariant errors the transitions are the filter's.
//! With the adjoint μ and its information Λ after a step, the smoothed error about the filter's state is P μ with covariance
//! P − P Λ P, and the disturbances and measurement errors that the whole flight speaks for follow from the same two (de Jong &
//! Penzer 1998, "Diagnosing shocks in time series"): under a right model they have the variance that stands beside them.

pub mod residual;
pub mod stretches;

use crate::displacement::Displacement;
use crate::filter::calibration::Calibration;
use crate::filter::covariance::NAV;
use crate::filter::layout::{Layout, index};
use crate::filter::tape::{Node, Update};
use crate::mechanization::NavState;
use crate::model::Model;

use nalgebra::Matrix3;

/// A value with the variance that it has under the model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residual {
    /// Value.
    pub value: f64,
    /// Its variance if the model is right.
    pub variance: f64,
}

impl Residual {
    /// Over its sigma; `None` where the data say nothing.
    pub fn normalised(&self) -> Option<f64> {
        (self.variance > 0.0).then(|| self.value / self.variance.sqrt()).filter(|z| z.is_finite())
    }
}

/// The best estimate at one time.
#[derive(Debug, Clone)]
pub struct Smoothed {
    /// Time, s.
    pub t_s: f64,
    /// Seconds since the last one.
    pub dt_s: f64,
    /// Position, velocity, attitude.
    pub nav: NavState,
    /// The same as the filter knew it then, without what came later.
    pub filtered: NavState,
    /// Biases and effect parameters.
    pub calibration: Calibration,
    /// 1-sigma of every state, in the filter's error coordinates.
    pub sigma: Vec<f64>,
    /// What the gyros measured since the last node less what this trajectory says, rad/s.
    pub gyro: [Residual; 3],
    /// The same of the accelerometers, m/s².
    pub accel: [Residual; 3],
    /// Rows of a fix at this time: measured less simulated on this trajectory, north, east, down, m.
    pub position: Vec<Residual>,
    /// The same of velocity, m/s.
    pub velocity: Vec<Residual>,
}

/// Adjoint and its information: a vector and a symmetric matrix, row by row.
#[derive(Debug, Clone)]
struct Adjoint {
    mu: Vec<f64>,
    lambda: Vec<f64>,
}

impl Adjoint {
    fn zeros(n: usize) -> Self {
        Self { mu: vec![0.0; n], lambda: vec![0.0; n * n] }
    }

    /// μ ← Aᵀ μ, Λ ← Aᵀ Λ A for A that is the identity but for its first nine rows, `top`, and the decay of the Gauss-Markov error.
    fn back(&mut self, top: &[f64], gauss_markov: Option<usize>, decay: f64) {
        let n = self.mu.len();
        self.mu = transposed(top, &self.mu, gauss_markov, decay);
        // Row by row A ᵀ Λ, then the same on its transpose: Λ is symmetric.
        for _ in 0..2 {
            let mut next = vec![0.0; n * n];
            for (row, out) in self.lambda.chunks_exact(n).zip(0..n) {
                for (k, v) in transposed(top, row, gauss_markov, decay).into_iter().enumerate() {
                    next[k * n + out] = v;
                }
            }
            self.lambda = next;
        }
    }

    /// Over an update: μ ← Hᵀ u + μ with u = S⁻¹ν − Kᵀμ, Λ ← Hᵀ S⁻¹ H + (I − KH)ᵀ Λ (I − KH). Returns u with its covariance.
    fn over(&mut self, update: &Update) -> (Vec<f64>, Matrix3<f64>) {
        let (n, d) = (self.mu.len(), update.residual.len());
        let gain: Vec<Vec<f64>> = (0..d)
            .map(|i| {
                let mut k = vec![0.0; n];
                for (j, column) in update.ph.iter().enumerate() {
                    add(&mut k, column, update.inverse[(j, i)]);
                }
                k
            })
            .collect();
        let lambda_k: Vec<Vec<f64>> =
            gain.iter().map(|k| self.lambda.chunks_exact(n).map(|row| dot(row, k)).collect()).collect();
        let mut u = vec![0.0; d];
        let mut spread = Matrix3::zeros();
        for i in 0..d {
            u[i] = (0..d).map(|j| update.inverse[(i, j)] * update.residual[j]).sum::<f64>()
                - dot(&gain[i], &self.mu);
            for j in 0..d {
                spread[(i, j)] = update.inverse[(i, j)] + dot(&gain[i], &lambda_k[j]);
            }
        }
        for (h, u) in update.h.iter().zip(&u) {
            h.iter().for_each(|(state, c)| self.mu[*state] += c * u);
        }
        // Λ + Hᵀ D H − Hᵀ (ΛK)ᵀ − (ΛK) H.
        for (i, h) in update.h.iter().enumerate() {
            for (state, c) in h {
                for (k, v) in lambda_k[i].iter().enumerate() {
                    self.lambda[state * n + k] -= c * v;
                    self.lambda[k * n + state] -= c * v;
                }
                for (j, other) in update.h.iter().enumerate() {
                    for (second, e) in other {
                        self.lambda[state * n + second] += c * e * spread[(i, j)];
                    }
                }
            }
        }
        self.symmetrise();
        (u, spread)
    }

    /// Rounding leaves an antisymmetric part, which the update above would let grow.
    fn symmetrise(&mut self) {
        let n = self.mu.len();
        for i in 0..n {
            for j in 0..i {
                let mean = 0.5 * (self.lambda[i * n + j] + self.lambda[j * n + i]);
                self.lambda[i * n + j] = mean;
                self.lambda[j * n + i] = mean;
            }
        }
    }
}

/// Aᵀ x.
fn transposed(top: &[f64], x: &[f64], gauss_markov: Option<usize>, decay: f64) -> Vec<f64> {
    let n = x.len();
    let mut out = x.to_vec();
    out[..NAV].fill(0.0);
    if let Some(w) = gauss_markov {
        out[w..w + 3].iter_mut().for_each(|v| *v *= decay);
    }
    for (row, v) in top.chunks_exact(n).zip(x).filter(|(_, v)| **v != 0.0) {
        add(&mut out, row, *v);
    }
    out
}

fn add(out: &mut [f64], row: &[f64], scale: f64) {
    out.iter_mut().zip(row).for_each(|(o, x)| *o += scale * x);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The lower triangle as a full matrix, row by row.
fn full(lower: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    let mut at = 0;
    for i in 0..n {
        for j in 0..=i {
            out[i * n + j] = lower[at];
            out[j * n + i] = lower[at];
            at += 1;
        }
    }
    out
}

/// Smoothed error of a node and its variances: P μ, diag(P − P Λ P).
fn smoothed(node: &Node, after: &Adjoint) -> (Vec<f64>, Vec<f64>) {
    let n = after.mu.len();
    let p = full(&node.p, n);
    let rows: Vec<&[f64]> = p.chunks_exact(n).collect();
    let dx = rows.iter().map(|row| dot(row, &after.mu)).collect();
    let sigma = (0..n)
        .map(|i| {
            let taken: f64 =
                after.lambda.chunks_exact(n).zip(rows[i]).map(|(l, p)| p * dot(l, rows[i])).sum();
            (p[i * n + i] - taken).max(0.0).sqrt()
        })
        .collect();
    (dx, sigma)
}

/// What white noise of this density would have to have been since the node before, as a mean over that time: Q μ / dt.
fn disturbance(before_step: &Adjoint, at: usize, density: f64) -> [Residual; 3] {
    let n = before_step.mu.len();
    std::array::from_fn(|k| {
        let state = at + k;
        Residual {
            value: density * before_step.mu[state],
            variance: density * density * before_step.lambda[state * n + state].max(0.0),
        }
    })
}

/// R u with the variance R D R of each row; R = S − H P Hᵀ.
fn measured(update: &Update, u: &[f64], spread: &Matrix3<f64>) -> Vec<Residual> {
    let d = u.len();
    let r = Matrix3::from_fn(|i, j| {
        if i >= d || j >= d {
            return 0.0;
        }
        update.s[(i, j)] - update.h[i].iter().map(|(k, c)| c * update.ph[j][*k]).sum::<f64>()
    });
    let of = r * spread * r.transpose();
    (0..d)
        .map(|i| Residual { value: (0..d).map(|j| r[(i, j)] * u[j]).sum(), variance: of[(i, i)].max(0.0) })
        .collect()
}

/// The way back over a recording, node by node from the last to the first.
#[derive(Debug)]
pub struct Back<'a> {
    model: &'a Model,
    layout: &'a Layout,
    after: Adjoint,
}

impl<'a> Back<'a> {
    /// Behind the last node.
    pub fn new(model: &'a Model, layout: &'a Layout) -> Self {
        Self { model, layout, after: Adjoint::zeros(layout.len()) }
    }

    /// Over the node before the last one.
    pub fn over(&mut self, node: Node) -> Smoothed {
        let Self { model, layout, after } = self;
        let (n, gauss_markov) = (layout.len(), layout.gauss_markov());
        let (dx, sigma) = smoothed(&node, after);
        let nav = node.nav.displaced(&Displacement::of(&dx));
        let mut calibration = node.calibration;
        calibration.correct(model, layout, &dx);
        let (mut position, mut velocity) = (Vec::new(), Vec::new());
        for update in node.updates.iter().rev() {
            if let Some(turn) = &update.turn {
                let mut top = vec![0.0; NAV * n];
                top.chunks_exact_mut(n).zip(turn.iter()).for_each(|(row, t)| row[..NAV].copy_from_slice(t));
                after.back(&top, gauss_markov, 1.0);
            }
            let (u, spread) = after.over(update);
            let rows = measured(update, &u, &spread);
            let of_position =
                update.h.first().is_some_and(|h| h.first().is_some_and(|(k, _)| *k < index::VELOCITY));
            if of_position {
                position = rows;
            } else {
                velocity = rows;
            }
        }
        let (gyro, accel) = (
            disturbance(after, index::ATTITUDE, node.noise.0),
            disturbance(after, index::VELOCITY, node.noise.1),
        );
        after.back(&node.phi, gauss_markov, node.decay);
        let (t_s, dt_s, filtered) = (node.t_s, node.dt_s, node.nav);
        Smoothed { t_s, dt_s, nav, filtered, calibration, sigma, gyro, accel, position, velocity }
    }
}

#[cfg(test)]
mod tests;
