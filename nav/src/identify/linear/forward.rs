//! The Kalman filter of the linear model: likelihood of the innovations, and how it depends on the watched parameters.
//!
//! Measurements are taken one scalar at a time (Bierman 1977, section II.6): rows of a fix are independent once the
//! error of its stamp is a state. Parameters are carried as in [`crate::filter::watch`]: δx = δx₀ + U θ with
//! U ← Φ U + B and U ← U − K (H U + D).

use super::interval::{DYNAMIC, Interval};
use super::rows::Kind;
use super::{Problem, STATES, index, variances};
use crate::effects::BiasWalk;
use crate::identify::noise::{HEIGHT_GAUSS_MARKOV, Noise};
use crate::identify::pass::{Information, Options};
use pulp::{Arch, Simd, WithSimd};

/// Squared normalised innovations of a group count linearly beyond this (Huber's function of the norm).
pub(super) const HUBER: f64 = 25.0;
/// No fix is assumed to be better than this, m and m/s.
pub(super) const SIGMA_FLOOR: f64 = 0.01;

/// A symmetric matrix over the states.
pub(super) type Square = [[f64; STATES]; STATES];
/// A vector over the states.
pub(super) type State = [f64; STATES];

/// What one run says.
#[derive(Debug, Clone)]
pub struct Run {
    /// Logarithm of the (robust) likelihood: fit part, held-out part.
    pub log_likelihood: [f64; 2],
    /// Squared normalised innovations and their number, by part.
    pub nis: [(f64, usize); 2],
    /// Score and information of the watched parameters, by part.
    pub information: [Information; 2],
    /// Those of the fit part block by block, where blocks were asked for; `information` then holds the last of them.
    pub blocks: Vec<Information>,
}

impl Run {
    /// Before the first fix, with so many watched parameters.
    pub(super) fn empty(columns: usize) -> Self {
        let zeros = || Information::zeros(columns, 0);
        Self {
            log_likelihood: [0.0; 2],
            nis: [(0.0, 0); 2],
            information: [zeros(), zeros()],
            blocks: Vec::new(),
        }
    }

    /// Mean squared normalised innovation per degree of freedom of a part.
    pub fn nis_per_dof(&self, part: usize) -> f64 {
        self.nis[part].0 / self.nis[part].1.max(1) as f64
    }
}

/// One scalar update as it happened.
#[derive(Debug, Clone)]
pub(super) struct Update {
    /// P h before the update.
    pub(super) g: State,
    /// Innovation and its variance.
    pub(super) y: f64,
    pub(super) s: f64,
    /// Variance of the measurement itself.
    pub(super) r: f64,
}

/// One fix as it happened: enough to go back over it.
#[derive(Debug, Clone)]
pub(super) struct Tape {
    pub(super) updates: Vec<Update>,
    /// Derivative of the robust square of each group: position, velocity.
    pub(super) weights: [f64; 2],
    /// Rows of the Gauss-Markov error of P after the transition, without its noise, and the Gauss-Markov error's mean then.
    pub(super) gauss_markov_rows: [State; 3],
    pub(super) gauss_markov: [f64; 3],
    /// Mean and covariance before the updates; only for smoothing.
    pub(super) prior: Option<Box<(State, Square)>>,
}

/// What a run keeps for the way back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Keep {
    Nothing,
    /// Nothing, but information by blocks of this length, s.
    Blocks(f64),
    Updates,
    Priors,
}

/// The filter at one instant.
pub(super) struct Kalman<'a> {
    pub(super) x: State,
    pub(super) p: Square,
    noise: &'a Noise,
    walk: BiasWalk,
}

/// Variance of the Gauss-Markov error per axis.
pub(super) fn gauss_markov_variance(noise: &Noise) -> [f64; 3] {
    let v = noise.gauss_markov_m * noise.gauss_markov_m;
    [v, v, v * HEIGHT_GAUSS_MARKOV * HEIGHT_GAUSS_MARKOV]
}

/// Variance of a row.
pub(super) fn row_variance(kind: Kind, sigma: f64, noise: &Noise) -> f64 {
    let scale = match kind {
        Kind::Horizontal => noise.position_scale,
        Kind::Height => noise.height_scale,
        Kind::Velocity => noise.velocity_scale,
    };
    (sigma * scale).max(SIGMA_FLOOR).powi(2)
}

impl<'a> Kalman<'a> {
    pub(super) fn new(problem: &Problem, walk: BiasWalk, noise: &'a Noise) -> Self {
        let mut p = *problem.start_covariance;
        for (k, v) in gauss_markov_variance(noise).into_iter().enumerate() {
            p[index::GAUSS_MARKOV + k][index::GAUSS_MARKOV + k] = v;
        }
        Self { x: problem.start, p, noise, walk }
    }

    /// Rows of the covariance and means of the Gauss-Markov error.
    #[inline(always)]
    fn gauss_markov(&self) -> ([State; 3], [f64; 3]) {
        let at = |k: usize| index::GAUSS_MARKOV + k;
        (std::array::from_fn(|k| self.p[at(k)]), std::array::from_fn(|k| self.x[at(k)]))
    }

    /// 1-sigma of the attitude, rad: of its least known axis.
    pub(super) fn attitude_sigma(&self) -> f64 {
        (0..3).map(|k| self.p[index::ATTITUDE + k][index::ATTITUDE + k]).fold(0.0, f64::max).sqrt()
    }

    #[inline(always)]
    fn add_walk(&mut self, dt: f64) {
        for k in 0..3 {
            self.p[index::GYRO_BIAS + k][index::GYRO_BIAS + k] += 0.5 * self.walk.gyro.powi(2) * dt;
            self.p[index::ACCEL_BIAS + k][index::ACCEL_BIAS + k] += 0.5 * self.walk.accel.powi(2) * dt;
        }
    }

    /// To the next fix, but for the Gauss-Markov error's noise.
    #[inline(always)]
    pub(super) fn predict(&mut self, interval: &Interval) {
        let decay = (-interval.dt / self.noise.correlation_s).exp();
        self.add_walk(interval.dt);
        let mut half = [[0.0; STATES]; 9];
        let mut x = interval.offset;
        for (i, half) in half.iter_mut().enumerate() {
            for (j, column) in interval.columns.iter().take(DYNAMIC).enumerate() {
                x[i] += column[i] * self.x[j];
                add_scaled(half, &self.p[j], column[i]);
            }
        }
        let (gyro, accel) = variances(self.noise, interval);
        let mut q = interval.by_gyro * gyro;
        interval.by_accel.entries().for_each(|(i, j, v)| q[(i, j)] += v * accel);
        for i in 0..9 {
            let mut row = [0.0; 9];
            for (j, column) in interval.columns.iter().take(DYNAMIC).enumerate() {
                for k in 0..9 {
                    row[k] += half[i][j] * column[k];
                }
            }
            for k in 0..9 {
                self.p[i][k] = row[k] + q[(i, k)] + interval.gaps.as_ref().map_or(0.0, |g| g[(i, k)]);
            }
            for (k, value) in half[i].iter().enumerate().skip(9) {
                self.p[i][k] = *value;
                self.p[k][i] = *value;
            }
            self.x[i] = x[i];
        }
        for w in index::GAUSS_MARKOV..index::STAMP {
            self.x[w] *= decay;
            self.p[w].iter_mut().for_each(|v| *v *= decay);
            self.p.iter_mut().for_each(|row| row[w] *= decay);
        }
        self.add_walk(interval.dt);
    }

    /// The Gauss-Markov error's noise and a new error of the stamp.
    #[inline(always)]
    pub(super) fn renew(&mut self, dt: f64) {
        let lost = 1.0 - (-2.0 * dt / self.noise.correlation_s).exp();
        for (k, v) in gauss_markov_variance(self.noise).into_iter().enumerate() {
            self.p[index::GAUSS_MARKOV + k][index::GAUSS_MARKOV + k] += v * lost;
        }
        self.p[index::STAMP] = [0.0; STATES];
        self.p.iter_mut().for_each(|row| row[index::STAMP] = 0.0);
        self.p[index::STAMP][index::STAMP] = self.noise.stamp_s.powi(2);
        self.x[index::STAMP] = 0.0;
    }

    /// Innovation of a scalar measurement and its variance.
    pub(super) fn innovation(&self, row: &super::Row) -> (f64, f64) {
        let mut y = row.residual;
        let mut s = row_variance(row.kind, row.sigma, self.noise);
        for (i, a) in row.h.iter().enumerate().filter(|(_, a)| **a != 0.0) {
            y -= a * self.x[i];
            s += row.h.iter().zip(&self.p[i]).map(|(b, p)| a * b * p).sum::<f64>();
        }
        (y, s)
    }

    /// One scalar measurement.
    #[inline(always)]
    pub(super) fn update(&mut self, row: &super::Row) -> Update {
        let mut g = [0.0; STATES];
        let mut y = row.residual;
        for (k, c) in row.h.iter().enumerate().filter(|(_, c)| **c != 0.0) {
            add_scaled(&mut g, &self.p[k], *c);
            y -= c * self.x[k];
        }
        let r = row_variance(row.kind, row.sigma, self.noise);
        let s = r + row.h.iter().zip(&g).map(|(h, g)| h * g).sum::<f64>();
        for i in 0..STATES {
            add_scaled(&mut self.p[i], &g, -g[i] / s);
            self.x[i] += g[i] * y / s;
        }
        Update { g, y, s, r }
    }
}

#[inline(always)]
pub(super) fn add_scaled(out: &mut [f64], row: &[f64], scale: f64) {
    out.iter_mut().zip(row).for_each(|(o, x)| *o += scale * x);
}

/// Robust square of a group's normalised innovations, and its derivative.
fn robust(nis: f64) -> (f64, f64) {
    if nis <= HUBER {
        return (nis, 1.0);
    }
    let distance = (nis / HUBER).sqrt();
    (HUBER * (2.0 * distance - 1.0), 1.0 / distance)
}

/// How the filter's error depends on the watched parameters: as many rows of `m` as states.
struct Sensitivity {
    m: usize,
    u: Vec<f64>,
    scratch: Vec<f64>,
    /// Whitened derivatives of the innovations of the present fix, row by row.
    rows: Vec<f64>,
}

impl Sensitivity {
    fn new(m: usize) -> Self {
        Self { m, u: vec![0.0; STATES * m], scratch: vec![0.0; 9 * m], rows: Vec::new() }
    }

    #[inline(always)]
    fn predict(&mut self, interval: &Interval, decay: f64) {
        let m = self.m;
        self.rows.clear();
        if m == 0 {
            return;
        }
        self.scratch.fill(0.0);
        for (i, out) in self.scratch.chunks_exact_mut(m).enumerate() {
            for (j, column) in interval.columns.iter().take(DYNAMIC).enumerate() {
                add_scaled(out, &self.u[j * m..(j + 1) * m], column[i]);
            }
            out.iter_mut().zip(&interval.columns[DYNAMIC..]).for_each(|(o, b)| *o += b[i]);
        }
        self.u[..9 * m].copy_from_slice(&self.scratch);
        let gauss_markov = index::GAUSS_MARKOV * m..index::STAMP * m;
        self.u[gauss_markov].iter_mut().for_each(|v| *v *= decay);
        self.u[index::STAMP * m..index::CLOCK * m].fill(0.0);
    }

    /// Adds the whitened derivative of the innovation of a row.
    #[inline(always)]
    fn update(&mut self, row: &super::Row, update: &Update) {
        let m = self.m;
        if m == 0 {
            return;
        }
        let begun = self.rows.len();
        self.rows.extend_from_slice(&row.direct);
        self.rows.resize(begun + m, 0.0);
        let out = &mut self.rows[begun..];
        for (k, c) in row.h.iter().enumerate().filter(|(_, c)| **c != 0.0) {
            add_scaled(out, &self.u[k * m..(k + 1) * m], *c);
        }
        for (u, g) in self.u.chunks_exact_mut(m).zip(&update.g) {
            add_scaled(u, out, -g / update.s);
        }
        let scale = update.s.sqrt().recip();
        out.iter_mut().for_each(|v| *v *= scale);
    }
}

/// A run with vector registers as wide as the machine has them; nothing is reordered or fused, so that the result is the same with any.
struct Going<'a> {
    problem: &'a Problem,
    walk: BiasWalk,
    noise: &'a Noise,
    options: &'a Options,
    keep: Keep,
    columns: usize,
}

impl WithSimd for Going<'_> {
    type Output = (Run, Vec<Tape>);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { problem, walk, noise, options, keep, columns } = self;
        let zeros = || Information::zeros(columns, 0);
        let mut run = Run::empty(columns);
        let taped = matches!(keep, Keep::Updates | Keep::Priors);
        let mut tape = Vec::with_capacity(if taped { problem.epochs.len() } else { 0 });
        let mut begun_s = 0.0;
        let mut kalman = Kalman::new(problem, walk, noise);
        let mut sensitivity = Sensitivity::new(columns);
        let mut updates = Vec::new();
        for epoch in &problem.epochs {
            let interval = &epoch.interval;
            kalman.predict(interval);
            sensitivity.predict(interval, (-interval.dt / noise.correlation_s).exp());
            let before = taped.then(|| kalman.gauss_markov());
            kalman.renew(interval.dt);
            let prior = (keep == Keep::Priors).then(|| Box::new((kalman.x, kalman.p)));
            updates.clear();
            for row in &epoch.rows {
                let update = kalman.update(row);
                sensitivity.update(row, &update);
                updates.push(update);
            }
            let weights = run.count(problem.part(epoch, options), epoch, &updates, &sensitivity.rows);
            if let Keep::Blocks(block_s) = keep
                && epoch.elapsed_s - begun_s >= block_s
            {
                begun_s = epoch.elapsed_s;
                run.blocks.push(std::mem::replace(&mut run.information[0], zeros()));
            }
            if let Some((gauss_markov_rows, gauss_markov)) = before {
                let updates = updates.clone();
                tape.push(Tape { updates, weights, gauss_markov_rows, gauss_markov, prior });
            }
        }
        if matches!(keep, Keep::Blocks(_)) {
            run.blocks.push(run.information[0].clone());
        }
        run.information.iter_mut().chain(&mut run.blocks).for_each(Information::finish);
        (run, tape)
    }
}

impl Problem {
    /// Runs the filter with this noise.
    pub fn run(&self, noise: &Noise, options: &Options) -> Run {
        self.go(self.walk, noise, options, Keep::Nothing, self.columns).0
    }

    /// The same with score and information of each block of the flight by itself.
    pub fn run_blocks(&self, noise: &Noise, options: &Options, block_s: f64) -> Run {
        self.go(self.walk, noise, options, Keep::Blocks(block_s), self.columns).0
    }

    /// The same when the biases walk like this. Watched parameters are left out.
    pub fn run_walking(&self, walk: BiasWalk, noise: &Noise, options: &Options) -> Run {
        self.go(walk, noise, options, Keep::Nothing, 0).0
    }

    /// The same, and what the way back needs; without watched parameters.
    pub(super) fn run_keeping(&self, noise: &Noise, options: &Options, keep: Keep) -> (Run, Vec<Tape>) {
        self.go(self.walk, noise, options, keep, 0)
    }

    /// Watches `columns` parameters: all or none.
    fn go(
        &self,
        walk: BiasWalk,
        noise: &Noise,
        options: &Options,
        keep: Keep,
        columns: usize,
    ) -> (Run, Vec<Tape>) {
        Arch::new().dispatch(Going { problem: self, walk, noise, options, keep, columns })
    }
}

impl Run {
    /// Counts the rows of a fix, with their whitened derivatives one after the other, and says how much each group weighs.
    #[inline(always)]
    pub(super) fn count(
        &mut self,
        part: Option<usize>,
        epoch: &super::Epoch,
        updates: &[Update],
        sensitivities: &[f64],
    ) -> [f64; 2] {
        let mut nis = [0.0; 2];
        let group = |k: usize| usize::from(!epoch.rows[k].is_position());
        for (k, update) in updates.iter().enumerate() {
            nis[group(k)] += update.y * update.y / update.s;
        }
        let robust = nis.map(robust);
        let weights = robust.map(|r| r.1);
        let Some(part) = part else { return weights };
        let ln_det: f64 = updates.iter().map(|u| u.s.ln()).sum();
        self.log_likelihood[part] -= 0.5 * (ln_det + robust[0].0 + robust[1].0);
        self.nis[part].0 += nis[0] + nis[1];
        self.nis[part].1 += updates.len();
        let columns = sensitivities.len() / updates.len().max(1);
        for (k, (update, s)) in updates.iter().zip(sensitivities.chunks_exact(columns.max(1))).enumerate() {
            self.information[part].take(s, update.y / update.s.sqrt(), weights[group(k)]);
        }
        weights
    }
}
