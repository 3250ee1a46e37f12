//! The way back over a run: slopes of the likelihood by every figure of the noise, and the smoothed trajectory.
//!
//! The slopes are those of the very numbers that the filter computed, found by the chain rule from the last fix to
//! the first (reverse-mode differentiation; for the Gaussian likelihood of all data it is the disturbance smoother of
//! Koopman & Shephard 1992).

use super::forward::{Keep, Prior, Tape, Taped};
use super::kalman::{
    GROUPS, MOST_ROWS, SIGMA_FLOOR, Square, State, Update, add_rows, add_scaled, gauss_markov_variance,
    vectorised,
};
use super::rows::{Kind, Row};
use super::{Epoch, Problem, STATES, index};
use crate::identify::noise::{FIGURES, Noise, figure};
use crate::identify::pass::Options;
use crate::linear::interval::{BIASES, DYNAMIC, Interval, Isotropic, NavCovariance};
use pulp::{Simd, WithSimd};

/// Likelihood of the fit part and its slopes.
#[derive(Debug, Clone, PartialEq)]
pub struct Slope {
    /// Logarithm of the likelihood.
    pub log_likelihood: f64,
    /// By the logarithm of each figure of the noise.
    pub by_figure: [f64; FIGURES],
    /// By the variance per second of the random walk of the gyro and of the accelerometer biases.
    pub by_walk: [f64; 2],
}

/// Slopes by mean and covariance.
struct Adjoint {
    x: State,
    p: Square,
}

impl Adjoint {
    /// Back over a fix. `counted`: whether it counts; `weights` are those of the squared innovations of each group.
    #[inline(always)]
    fn correct<S: Simd>(
        &mut self,
        simd: S,
        fix: &Fix<'_>,
        weights: &[f64; GROUPS],
        counted: bool,
        noise: &Noise,
        slope: &mut Slope,
    ) {
        let one = f64::from(u8::from(counted));
        // What each row adds to the slope by the covariance, h wᵀ + w hᵀ; it is written once for all.
        let (mut h, mut w) = ([[0.0; STATES]; MOST_ROWS], [[0.0; STATES]; MOST_ROWS]);
        let count = fix.updates.len().min(MOST_ROWS);
        for (k, (row, u)) in fix.rows.iter().zip(fix.updates).enumerate().take(count).rev() {
            let (y, g, s) = (u.y, &u.g, u.s.recip());
            let weight = weights[row.group()];
            let mut pg = product(simd, &self.p, g);
            for j in k + 1..count {
                add_scaled(simd, &mut pg, &h[j], dot(&w[j], g));
                add_scaled(simd, &mut pg, &w[j], dot(&h[j], g));
            }
            let along = dot(&self.x, g);
            let by_y = (along - one * weight * y) * s;
            let by_s = one * 0.5 * (weight * y * y * s - 1.0) * s - along * y * s * s + dot(&pg, g) * s * s;
            h[k] = row.dense();
            // by_s h hᵀ + (h by_gᵀ + by_g hᵀ)/2 with by_g = (x y − 2 P g)/s.
            for i in 0..STATES {
                w[k][i] = 0.5 * (by_s * h[k][i] + (self.x[i] * y - 2.0 * pg[i]) * s);
            }
            add_scaled(simd, &mut self.x, &h[k], -by_y);
            slope.row(row, u, by_s, noise);
        }
        for (i, p) in self.p.iter_mut().enumerate() {
            add_rows(simd, p, count, |k| (&h[k], w[k][i]));
            for k in (0..count).filter(|k| h[*k][i] != 0.0) {
                add_scaled(simd, p, &w[k], h[k][i]);
            }
        }
    }
}

/// a b, with several sums at once.
#[inline(always)]
fn dot(a: &State, b: &State) -> f64 {
    let mut sums = [0.0; 4];
    for (a, b) in a.chunks_exact(4).zip(b.chunks_exact(4)) {
        sums.iter_mut().zip(a).zip(b).for_each(|((sum, a), b)| *sum += a * b);
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// M v for a symmetric M.
#[inline(always)]
fn product<S: Simd>(simd: S, m: &Square, v: &State) -> State {
    let mut out = [0.0; STATES];
    for (row, v) in m.iter().zip(v) {
        add_scaled(simd, &mut out, row, *v);
    }
    out
}

/// Φᵀ v.
#[inline(always)]
fn transposed<const N: usize>(interval: &Interval, v: &[f64; N]) -> [f64; N] {
    let mut out = *v;
    for (j, column) in interval.transition.iter().enumerate() {
        let sum: f64 = (0..9).map(|i| column[i] * v[i]).sum();
        out[j] = if j < 9 { sum } else { v[j] + sum };
    }
    out
}

/// Φᵀ M Φ for a symmetric M.
#[inline(always)]
fn congruence<const N: usize, S: Simd>(simd: S, interval: &Interval, m: &[[f64; N]; N]) -> [[f64; N]; N] {
    // Φ row by row: the constants keep their own row.
    let by_row: [[f64; N]; 9] =
        std::array::from_fn(|i| std::array::from_fn(|j| interval.transition.get(j).map_or(0.0, |c| c[i])));
    let mut half = *m;
    for (j, half) in half.iter_mut().enumerate().take(DYNAMIC) {
        if j < 9 {
            half.fill(0.0);
        }
        for (m, phi) in m.iter().zip(&by_row) {
            add_scaled(simd, half, m, phi[j]);
        }
    }
    for row in &mut half {
        let mut out = *row;
        out[..9].fill(0.0);
        for (phi, v) in by_row.iter().zip(row.iter()) {
            add_scaled(simd, &mut out, phi, *v);
        }
        *row = out;
    }
    half
}

/// Back over the way between two fixes, over which the Gauss-Markov error decays by this much: v ← Φᵀ v and M ← Φᵀ M Φ. The error of
/// a stamp is one of its own fix.
#[inline(always)]
pub(super) fn back_over<const N: usize, S: Simd>(
    simd: S,
    interval: &Interval,
    decay: f64,
    v: &mut [f64; N],
    m: &mut [[f64; N]; N],
) {
    v[index::STAMP] = 0.0;
    m[index::STAMP] = [0.0; N];
    m.iter_mut().for_each(|row| row[index::STAMP] = 0.0);
    for w in index::GAUSS_MARKOV..index::STAMP {
        v[w] *= decay;
        m[w].iter_mut().for_each(|v| *v *= decay);
        m.iter_mut().for_each(|row| row[w] *= decay);
    }
    *v = transposed(interval, v);
    *m = congruence(simd, interval, m);
}

#[inline(always)]
fn inner(a: &Square, q: &NavCovariance) -> f64 {
    (0..9).map(|i| (0..9).map(|j| a[i][j] * q[(i, j)]).sum::<f64>()).sum()
}

#[inline(always)]
fn inner_isotropic(a: &Square, q: &Isotropic) -> f64 {
    let of =
        |(p, v): (usize, usize)| a[p][p] * q.position + (a[p][v] + a[v][p]) * q.both + a[v][v] * q.velocity;
    (0..3).map(|k| of((index::POSITION + k, index::VELOCITY + k))).sum()
}

impl Slope {
    #[inline(always)]
    fn row(&mut self, row: &Row, u: &Update, by_r: f64, noise: &Noise) {
        if row.kind == Kind::Rate {
            self.by_figure[figure::GYRO] += 2.0 * (row.sigma * noise.gyro).powi(2) * by_r;
        } else if u.r > SIGMA_FLOOR * SIGMA_FLOOR {
            let k = match row.kind {
                Kind::Horizontal => figure::POSITION,
                Kind::Height => figure::HEIGHT,
                Kind::Velocity => figure::VELOCITY,
                Kind::Place | Kind::Rate | Kind::Field => return,
            };
            self.by_figure[k] += 2.0 * u.r * by_r;
        }
    }

    /// Half an interval's random walk of the biases.
    #[inline(always)]
    fn walks(&mut self, p: &Square, dt: f64) {
        for (by, at) in self.by_walk.iter_mut().zip([index::GYRO_BIAS, index::ACCEL_BIAS]) {
            *by += 0.5 * dt * (0..3).map(|k| p[at + k][at + k]).sum::<f64>();
        }
    }

    /// The noise of the Gauss-Markov error and of the stamp, and the Gauss-Markov error's decay.
    #[inline(always)]
    fn renewal(&mut self, adjoint: &Adjoint, taped: &Taped, noise: &Noise, dt: f64) {
        let decay = noise.decay(dt);
        self.by_figure[figure::STAMP] += 2.0 * noise.stamp_s.powi(2) * adjoint.p[index::STAMP][index::STAMP];
        let mut by_decay = 0.0;
        for (k, v) in gauss_markov_variance(noise).into_iter().enumerate() {
            let w = index::GAUSS_MARKOV + k;
            let by_variance = adjoint.p[w][w];
            self.by_figure[figure::GAUSS_MARKOV] += 2.0 * v * (1.0 - decay * decay) * by_variance;
            by_decay -= 2.0 * decay * v * by_variance;
            by_decay += adjoint.x[w] * taped.gauss_markov[k] / decay;
            // Rows and columns of the Gauss-Markov error both carry the decay.
            let others = (0..STATES).filter(|j| *j != index::STAMP);
            let both: f64 = others.map(|j| adjoint.p[w][j] * taped.gauss_markov_rows[k][j]).sum();
            by_decay += 2.0 * both / decay;
        }
        self.by_figure[figure::CORRELATION] += by_decay * decay * dt / noise.correlation_s;
    }
}

/// The way back over a run that finds its slopes, with vector registers as wide as the machine has them.
struct Return<'a> {
    problem: &'a Problem,
    tape: &'a Tape,
    noise: &'a Noise,
    options: &'a Options,
    slope: Slope,
}

impl WithSimd for Return<'_> {
    type Output = Slope;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Slope {
        let Self { problem, tape, noise, options, mut slope } = self;
        let mut adjoint = Adjoint { x: [0.0; STATES], p: [[0.0; STATES]; STATES] };
        let (mut by_gyro, mut by_accel) = (0.0, 0.0);
        for (fix, taped) in problem.taken_back(tape).zip(tape.fixes.iter().rev()) {
            let epoch = fix.epoch;
            let counted = problem.part(epoch, options) == Some(0);
            let interval = &epoch.interval;
            adjoint.correct(simd, &fix, &taped.weights, counted, noise, &mut slope);
            slope.renewal(&adjoint, taped, noise, interval.dt);
            by_gyro += inner(&adjoint.p, &interval.by_gyro);
            by_accel += inner_isotropic(&adjoint.p, &interval.by_accel);
            slope.walks(&adjoint.p, interval.dt);
            back_over(simd, interval, noise.decay(interval.dt), &mut adjoint.x, &mut adjoint.p);
            slope.walks(&adjoint.p, interval.dt);
        }
        slope.by_figure[figure::GYRO] += 2.0 * by_gyro * noise.gyro * noise.gyro;
        slope.by_figure[figure::ACCEL] = 2.0 * by_accel * noise.accel * noise.accel;
        for (k, v) in gauss_markov_variance(noise).into_iter().enumerate() {
            slope.by_figure[figure::GAUSS_MARKOV] +=
                2.0 * v * adjoint.p[index::GAUSS_MARKOV + k][index::GAUSS_MARKOV + k];
        }
        slope
    }
}

/// A fix on the way back.
pub(super) struct Fix<'t> {
    pub(super) epoch: &'t Epoch,
    pub(super) rows: &'t [Row],
    pub(super) updates: &'t [Update],
}

impl Problem {
    /// From the last fix to the first, each with its updates.
    #[inline(always)]
    pub(super) fn taken_back<'t>(&'t self, tape: &'t Tape) -> impl Iterator<Item = Fix<'t>> {
        let mut rest = tape.updates.as_slice();
        self.epochs().rev().map(move |epoch| {
            let rows = &epoch.measured.rows;
            let (before, updates) = rest.split_at(rest.len().saturating_sub(rows.len()));
            rest = before;
            Fix { epoch, rows, updates }
        })
    }

    /// Likelihood of the fit part with its slopes: two runs' worth of work.
    pub fn slope(&self, noise: &Noise, options: &Options) -> Slope {
        let (run, tape) = self.run_keeping(noise, options, Keep::Updates);
        let slope =
            Slope { log_likelihood: run.log_likelihood[0], by_figure: [0.0; FIGURES], by_walk: [0.0; 2] };
        vectorised(Return { problem: self, tape: &tape, noise, options, slope })
    }

    /// What all fixes together say of the states.
    pub(super) fn smoothed(&self, noise: &Noise) -> Smoothed {
        let (_, tape) = self.run_keeping(noise, &Options::default(), Keep::Priors);
        vectorised(Smoothing { problem: self, tape: &tape, noise })
    }
}

/// Smoothed means.
pub(super) struct Smoothed {
    /// Of all states at the start.
    pub(super) start: State,
    /// Of position, velocity and attitude at every fix.
    pub(super) fixes: Vec<[f64; 9]>,
    /// Of the biases in the middle of the flight.
    pub(super) biases: Option<[f64; BIASES]>,
}

/// The way back over a run that smooths.
struct Smoothing<'a> {
    problem: &'a Problem,
    tape: &'a Tape,
    noise: &'a Noise,
}

impl WithSimd for Smoothing<'_> {
    type Output = Smoothed;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Smoothed {
        let Self { problem, tape, noise } = self;
        let mut r = [0.0; STATES];
        let (mut fixes, mut biases) = (Vec::with_capacity(problem.len()), None);
        for (fix, (mean, rows)) in problem.taken_back(tape).zip(tape.priors.iter().rev()) {
            for (row, u) in fix.rows.iter().zip(fix.updates).rev() {
                let by_y = u.y / u.s - dot(&r, &u.g) / u.s;
                row.entries().for_each(|(k, h)| r[k] += h * by_y);
            }
            fixes.push(std::array::from_fn(|i| mean[i] + dot(&rows[i], &r)));
            if fixes.len() == problem.len() - problem.len() / 2 {
                let own = |(mean, rows): &Prior<BIASES>| std::array::from_fn(|i| mean[i] + dot(&rows[i], &r));
                biases = tape.middle.as_deref().map(own);
            }
            r[index::STAMP] = 0.0;
            let interval = &fix.epoch.interval;
            let decay = noise.decay(interval.dt);
            (index::GAUSS_MARKOV..index::STAMP).for_each(|w| r[w] *= decay);
            r = transposed(interval, &r);
        }
        fixes.reverse();
        let start = std::array::from_fn(|i| problem.start[i] + dot(&problem.start_covariance[i], &r));
        Smoothed { start, fixes, biases }
    }
}
