//! The way back over a run: slopes of the likelihood by every figure of the noise, jumps at every instant, and the smoothed
//! trajectory.
//!
//! The slopes are those of the very numbers that the filter computed, found by the chain rule from the last fix to
//! the first (reverse-mode differentiation; for the Gaussian likelihood of all data it is the disturbance smoother of
//! Koopman & Shephard 1992). A jump of a state at some instant has the score r and the information N of the same
//! recursion (de Jong & Penzer 1998, "Diagnosing shocks in time series").

use super::forward::{Keep, Prior, Tape, Taped};
use super::imitation::Weight;
use super::kalman::{
    GROUPS, MOST_ROWS, SIGMA_FLOOR, Square, State, Update, add_rows, add_scaled, gauss_markov_variance,
    vectorised,
};
use super::rows::{Kind, Row};
use super::{Epoch, Problem, STATES, index, variances};
use crate::identify::noise::{FIGURES, Noise, figure};
use crate::identify::pass::Options;
use crate::identify::residual::Residual;
use crate::linear::interval::{BIASES, DYNAMIC, Interval, NavCovariance};
use nalgebra::{Matrix3, Matrix6, Vector3};
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

/// Score and information of a jump at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shock {
    /// Time of validity of the fix, s.
    pub t_s: f64,
    /// A jump of the gyro biases right after it.
    pub gyro: (Vector3<f64>, Matrix3<f64>),
    /// A jump of the fixes' position from it on.
    pub fix: (Vector3<f64>, Matrix3<f64>),
}

/// Slopes by mean and covariance.
struct Adjoint {
    x: State,
    p: Square,
}

impl Adjoint {
    /// Back over a fix. `counted`: whether it counts; `weights` are those of the squared innovations of each group.
    #[inline(always)]
    fn correct(
        &mut self,
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
            let mut pg = product(&self.p, g);
            for j in k + 1..count {
                add_scaled(&mut pg, &h[j], dot(&w[j], g));
                add_scaled(&mut pg, &w[j], dot(&h[j], g));
            }
            let along = dot(&self.x, g);
            let by_y = (along - one * weight * y) * s;
            let by_s = one * 0.5 * (weight * y * y * s - 1.0) * s - along * y * s * s + dot(&pg, g) * s * s;
            h[k] = row.dense();
            // by_s h hᵀ + (h by_gᵀ + by_g hᵀ)/2 with by_g = (x y − 2 P g)/s.
            w[k] = std::array::from_fn(|i| 0.5 * (by_s * h[k][i] + (self.x[i] * y - 2.0 * pg[i]) * s));
            add_scaled(&mut self.x, &h[k], -by_y);
            slope.row(row, u, by_s, noise);
        }
        for (i, p) in self.p.iter_mut().enumerate() {
            add_rows(p, count, |k| (&h[k], w[k][i]));
            for k in (0..count).filter(|k| h[*k][i] != 0.0) {
                add_scaled(p, &w[k], h[k][i]);
            }
        }
    }

    /// Back over the way between two fixes.
    #[inline(always)]
    fn predict(&mut self, interval: &Interval, decay: f64) {
        for w in index::GAUSS_MARKOV..index::STAMP {
            self.x[w] *= decay;
            self.p[w].iter_mut().for_each(|v| *v *= decay);
            self.p.iter_mut().for_each(|row| row[w] *= decay);
        }
        self.p = congruence(interval, &self.p);
        self.x = transposed(interval, &self.x);
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
fn product(m: &Square, v: &State) -> State {
    let mut out = [0.0; STATES];
    m.iter().zip(v).for_each(|(row, v)| add_scaled(&mut out, row, *v));
    out
}

/// Φᵀ v.
#[inline(always)]
fn transposed(interval: &Interval, v: &State) -> State {
    let mut out = *v;
    for (j, column) in interval.transition.iter().enumerate() {
        let sum: f64 = (0..9).map(|i| column[i] * v[i]).sum();
        out[j] = if j < 9 { sum } else { v[j] + sum };
    }
    out
}

/// Φᵀ M Φ for a symmetric M.
#[inline(always)]
fn congruence(interval: &Interval, m: &Square) -> Square {
    // Φ row by row: the constants keep their own row.
    let by_row: [State; 9] =
        std::array::from_fn(|i| std::array::from_fn(|j| interval.transition.get(j).map_or(0.0, |c| c[i])));
    let mut half: Square = *m;
    for (j, half) in half.iter_mut().enumerate().take(DYNAMIC) {
        if j < 9 {
            half.fill(0.0);
        }
        m.iter().zip(&by_row).for_each(|(m, phi)| add_scaled(half, m, phi[j]));
    }
    for row in &mut half {
        let mut out = *row;
        out[..9].fill(0.0);
        by_row.iter().zip(row.iter()).for_each(|(phi, v)| add_scaled(&mut out, phi, *v));
        *row = out;
    }
    half
}

#[inline(always)]
fn inner(a: &Square, q: &NavCovariance) -> f64 {
    (0..9).map(|i| (0..9).map(|j| a[i][j] * q[(i, j)]).sum::<f64>()).sum()
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
        let decay = (-dt / noise.correlation_s).exp();
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
    fn with_simd<S: Simd>(self, _: S) -> Slope {
        let Self { problem, tape, noise, options, mut slope } = self;
        let mut adjoint = Adjoint { x: [0.0; STATES], p: [[0.0; STATES]; STATES] };
        let (mut by_gyro, mut by_accel) = (0.0, 0.0);
        for (fix, taped) in problem.taken_back(tape).zip(tape.fixes.iter().rev()) {
            let epoch = fix.epoch;
            let counted = problem.part(epoch, options) == Some(0);
            let interval = &epoch.interval;
            adjoint.correct(&fix, &taped.weights, counted, noise, &mut slope);
            slope.renewal(&adjoint, taped, noise, interval.dt);
            adjoint.x[index::STAMP] = 0.0;
            adjoint.p[index::STAMP] = [0.0; STATES];
            adjoint.p.iter_mut().for_each(|row| row[index::STAMP] = 0.0);
            by_gyro += inner(&adjoint.p, &interval.by_gyro);
            by_accel += interval.by_accel.entries().map(|(i, j, q)| adjoint.p[i][j] * q).sum::<f64>();
            slope.walks(&adjoint.p, interval.dt);
            adjoint.predict(interval, (-interval.dt / noise.correlation_s).exp());
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
struct Fix<'t> {
    epoch: &'t Epoch,
    rows: &'t [Row],
    updates: &'t [Update],
}

impl Problem {
    /// From the last fix to the first, each with its updates.
    #[inline(always)]
    fn taken_back<'t>(&'t self, tape: &'t Tape) -> impl Iterator<Item = Fix<'t>> {
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

    /// Score and information of a jump between any two fixes, of the gyro biases and of the fixes' position.
    pub fn shocks(&self, noise: &Noise, options: &Options) -> Vec<Shock> {
        let (_, tape) = self.run_keeping(noise, options, Keep::Updates);
        let mut back = Shocks::default();
        let mut out: Vec<Shock> = Vec::with_capacity(self.len());
        for (fix, taped) in self.taken_back(&tape).zip(tape.fixes.iter().rev()) {
            let epoch = fix.epoch;
            let gyro = back.block(index::GYRO_BIAS);
            back.fix(&fix, taped, self.part(epoch, options) == Some(0));
            out.push(Shock { t_s: epoch.t_s, gyro, fix: back.block(STATES) });
            back.predict(&epoch.interval, (-epoch.interval.dt / noise.correlation_s).exp());
        }
        out.reverse();
        out
    }

    /// What the fixes of either part tell of noise, interval by interval: of the samples ∫ Bᵀ Φᵀ Λ Φ B dt by the trapezoidal rule, with Λ = N of
    /// the fixes that come after; of the rows of a fix 1/s + Kᵀ N K.
    pub(super) fn noise_weights(&self, noise: &Noise, options: &Options) -> [Vec<Weight>; 2] {
        let (_, tape) = self.run_keeping(noise, options, Keep::Updates);
        let at = |k: usize| if k < 3 { index::ATTITUDE + k } else { index::VELOCITY + k - 3 };
        let of_samples = |back: &Shocks| Matrix6::from_fn(|i, j| back.n[at(i)][at(j)]);
        [0, 1].map(|part| {
            let mut back = Shocks::default();
            let mut out = Vec::with_capacity(self.len());
            for (fix, taped) in self.taken_back(&tape).zip(tape.fixes.iter().rev()) {
                let interval = &fix.epoch.interval;
                let rows = back.fix(&fix, taped, self.part(fix.epoch, options) == Some(part));
                let end = of_samples(&back);
                back.predict(interval, (-interval.dt / noise.correlation_s).exp());
                out.push(Weight { samples: (of_samples(&back) + end) * (0.5 * interval.dt), rows });
            }
            out.reverse();
            out
        })
    }

    /// The disturbances and measurement errors that the whole flight speaks for, fix by fix: means of what the sensors measured since
    /// the fix before less what the smoothed trajectory says, and the rows of the fix less the same; by the channels of
    /// [`crate::identify::residual::CHANNELS`]. Under a right model they have the variance that stands beside them (de Jong & Penzer 1998,
    /// "Diagnosing shocks in time series").
    pub fn disturbances(&self, noise: &Noise) -> Vec<[Option<Residual>; 12]> {
        let (_, tape) = self.run_keeping(noise, &Options::default(), Keep::Updates);
        let mut back = Shocks::default();
        let mut out = Vec::with_capacity(self.len());
        for fix in self.taken_back(&tape) {
            let interval = &fix.epoch.interval;
            let (mut residuals, mut rates) = ([None; 12], [None; 3]);
            for (row, update) in fix.rows.iter().zip(fix.updates).rev() {
                let (u, spread) = back.update(row, row.position_axis(), update, 1.0);
                let (value, variance) = (update.r * u, update.r * update.r * spread);
                let dt = if row.kind == Kind::Rate { interval.dt } else { 1.0 };
                let residual = Residual { value: value / dt, variance: variance.max(0.0) / (dt * dt) };
                match row.group() {
                    2 => rates[row.axis] = Some(residual),
                    group => residuals[6 + 3 * group + row.axis] = Some(residual),
                }
            }
            let (gyro, accel) = variances(noise, interval);
            for (first, at, density) in [(0, index::ATTITUDE, gyro), (3, index::VELOCITY, accel)] {
                let (r, n) = back.block(at);
                for k in 0..3 {
                    let variance = density * density * n[(k, k)].max(0.0);
                    residuals[first + k] = Some(Residual { value: density * r[k], variance });
                }
            }
            residuals.iter_mut().zip(rates).for_each(|(r, rate)| *r = rate.or(*r));
            out.push(residuals);
            back.predict(interval, (-interval.dt / noise.correlation_s).exp());
        }
        out.reverse();
        out
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
            let decay = (-interval.dt / noise.correlation_s).exp();
            (index::GAUSS_MARKOV..index::STAMP).for_each(|w| r[w] *= decay);
            r = transposed(interval, &r);
        }
        fixes.reverse();
        let start = std::array::from_fn(|i| problem.start[i] + dot(&problem.start_covariance[i], &r));
        Smoothed { start, fixes, biases }
    }
}

/// States and a constant offset of the fixes: where a jump may happen.
const JUMPING: usize = STATES + 3;

/// Score and information of a jump of every state at the present instant.
struct Shocks {
    r: [f64; JUMPING],
    n: [[f64; JUMPING]; JUMPING],
}

impl Default for Shocks {
    fn default() -> Self {
        Self { r: [0.0; JUMPING], n: [[0.0; JUMPING]; JUMPING] }
    }
}

impl Shocks {
    /// Back over one scalar update; `axis` is that of a position row. With L = I − K h: r ← hᵀ y w/s + Lᵀ r,
    /// N ← hᵀ h w/s + Lᵀ N L. Returns what the whole flight says of this measurement's error over its variance, y w/s − Kᵀ r, with
    /// the variance of that, w/s + Kᵀ N K.
    fn update(&mut self, row: &Row, axis: Option<usize>, u: &Update, weight: f64) -> (f64, f64) {
        let mut h = [0.0; JUMPING];
        h[..STATES].copy_from_slice(&row.dense());
        if let Some(axis) = axis {
            h[STATES + axis] = 1.0;
        }
        let along: f64 = self.r.iter().zip(&u.g).map(|(r, g)| r * g).sum::<f64>() / u.s;
        let ng: [f64; JUMPING] =
            std::array::from_fn(|i| self.n[i].iter().zip(&u.g).map(|(n, g)| n * g).sum::<f64>() / u.s);
        let gng: f64 = ng.iter().zip(&u.g).map(|(n, g)| n * g).sum::<f64>() / u.s;
        add_scaled(&mut self.r, &h, weight * u.y / u.s - along);
        for i in 0..JUMPING {
            if h[i] != 0.0 {
                add_scaled(&mut self.n[i], &h, h[i] * (weight / u.s + gng));
                add_scaled(&mut self.n[i], &ng, -h[i]);
            }
            add_scaled(&mut self.n[i], &h, -ng[i]);
        }
        (weight * u.y / u.s - along, weight / u.s + gng)
    }

    /// Back over a fix as it was weighted, with what the flight tells of an error of each of its rows.
    fn fix(&mut self, fix: &Fix<'_>, taped: &Taped, counted: bool) -> Vec<f64> {
        let one = |(row, update): (&Row, &Update)| {
            let weight = if counted { taped.weights[row.group()] } else { 0.0 };
            self.update(row, row.position_axis(), update, weight).1
        };
        let mut spreads: Vec<f64> = fix.rows.iter().zip(fix.updates).rev().map(one).collect();
        spreads.reverse();
        spreads
    }

    fn predict(&mut self, interval: &Interval, decay: f64) {
        let scale: [f64; JUMPING] = std::array::from_fn(|i| match i {
            index::GAUSS_MARKOV..index::STAMP => decay,
            index::STAMP => 0.0,
            _ => 1.0,
        });
        let back = |v: &mut [f64; JUMPING]| {
            v.iter_mut().zip(&scale).for_each(|(v, s)| *v *= s);
            let mut states = [0.0; STATES];
            states.copy_from_slice(&v[..STATES]);
            v[..STATES].copy_from_slice(&transposed(interval, &states));
        };
        back(&mut self.r);
        self.n.iter_mut().for_each(back);
        for j in 0..JUMPING {
            let mut column: [f64; JUMPING] = std::array::from_fn(|i| self.n[i][j]);
            back(&mut column);
            (0..JUMPING).for_each(|i| self.n[i][j] = column[i]);
        }
    }

    fn block(&self, at: usize) -> (Vector3<f64>, Matrix3<f64>) {
        (Vector3::from_fn(|i, _| self.r[at + i]), Matrix3::from_fn(|i, j| self.n[at + i][at + j]))
    }
}
