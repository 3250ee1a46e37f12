//! A run of the filter over a linearised flight: likelihood of the innovations, and how it depends on the watched parameters.
//!
//! Parameters are carried as in [`crate::filter::watch`]: δx = δx₀ + U θ with U ← Φ U + B and U ← U − K (H U + D).

use super::interval::{BIASES, DYNAMIC, Interval};
use super::kalman::{Kalman, State, Update, add_rows, add_scaled, vectorised};
use super::rows::Measured;
use super::{Epoch, Problem, STATES, index};
use crate::effects::BiasWalk;
use crate::identify::noise::Noise;
use crate::identify::pass::{Information, Options};
use pulp::{Simd, WithSimd};

/// Squared normalised innovations of a group count linearly beyond this (Huber's function of the norm).
pub(super) const HUBER: f64 = 25.0;

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

/// One fix as it happened: enough to go back over it.
#[derive(Debug, Clone)]
pub(super) struct Taped {
    /// Derivative of the robust square of each group: position, velocity.
    pub(super) weights: [f64; 2],
    /// Rows of the Gauss-Markov error of P after the transition, without its noise, and the Gauss-Markov error's mean then.
    pub(super) gauss_markov_rows: [State; 3],
    pub(super) gauss_markov: [f64; 3],
}

/// Means of some states before the updates of a fix, and their rows of the covariance.
pub(super) type Prior<const N: usize> = ([f64; N], [State; N]);

/// What a run keeps for the way back.
#[derive(Debug, Default)]
pub(super) struct Tape {
    /// Fix by fix; not for smoothing.
    pub(super) fixes: Vec<Taped>,
    /// Row by row of all fixes.
    pub(super) updates: Vec<Update>,
    /// Of position, velocity and attitude, fix by fix; only for smoothing.
    pub(super) priors: Vec<Prior<9>>,
    /// Of the biases in the middle of the flight; only for smoothing.
    pub(super) middle: Option<Box<Prior<BIASES>>>,
}

impl Tape {
    fn new(keep: Keep, problem: &Problem) -> Self {
        let fixes = problem.len();
        let rows = problem.epochs().map(|e| e.measured.rows.len());
        let (updates, priors) = (keep == Keep::Updates, keep == Keep::Priors);
        Self {
            fixes: Vec::with_capacity(if updates { fixes } else { 0 }),
            updates: Vec::with_capacity(if updates || priors { rows.sum() } else { 0 }),
            priors: Vec::with_capacity(if priors { fixes } else { 0 }),
            middle: None,
        }
    }
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
    /// Of each of these, negative: what whitens it.
    scales: Vec<f64>,
}

impl Sensitivity {
    fn new(m: usize) -> Self {
        Self { m, u: vec![0.0; STATES * m], scratch: vec![0.0; 9 * m], rows: Vec::new(), scales: Vec::new() }
    }

    #[inline(always)]
    fn predict(&mut self, interval: &Interval, decay: f64) {
        let m = self.m;
        if m == 0 {
            return;
        }
        for (i, out) in self.scratch.chunks_exact_mut(m).enumerate() {
            out.iter_mut().zip(&interval.driven).for_each(|(o, b)| *o = b[i]);
            let u = &self.u;
            add_rows(out, DYNAMIC, |j| (&u[j * m..(j + 1) * m], interval.transition[j][i]));
        }
        self.u[..9 * m].copy_from_slice(&self.scratch);
        let gauss_markov = index::GAUSS_MARKOV * m..index::STAMP * m;
        self.u[gauss_markov].iter_mut().for_each(|v| *v *= decay);
        self.u[index::STAMP * m..index::CLOCK * m].fill(0.0);
    }

    /// The whitened derivatives of the innovations of a fix, row by row.
    #[inline(always)]
    fn correct(&mut self, measured: &Measured, updates: &[Update]) {
        let m = self.m;
        self.rows.clear();
        if m == 0 {
            return;
        }
        self.scales.clear();
        self.rows.resize(updates.len() * m, 0.0);
        for (k, row) in measured.rows.iter().enumerate() {
            let (before, out) = self.rows.split_at_mut(k * m);
            let out = &mut out[..m];
            let direct = measured.direct_of(k);
            out[..direct.len()].copy_from_slice(direct);
            for (state, h) in row.entries() {
                add_scaled(out, &self.u[state * m..(state + 1) * m], h);
            }
            add_rows(out, k, |j| (&before[j * m..(j + 1) * m], -row.dot(&updates[j].g) / updates[j].s));
        }
        for (out, update) in self.rows.chunks_exact_mut(m).zip(updates) {
            let scale = update.s.sqrt().recip();
            out.iter_mut().for_each(|v| *v *= scale);
            self.scales.push(-scale);
        }
        let (rows, scales) = (&self.rows, &self.scales);
        for (i, u) in self.u.chunks_exact_mut(m).enumerate() {
            add_rows(u, updates.len(), |k| (&rows[k * m..(k + 1) * m], updates[k].g[i] * scales[k]));
        }
    }
}

/// A run of the filter.
struct Going<'a> {
    problem: &'a Problem,
    walk: BiasWalk,
    noise: &'a Noise,
    options: &'a Options,
    keep: Keep,
    columns: usize,
}

impl WithSimd for Going<'_> {
    type Output = (Run, Tape);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { problem, walk, noise, options, keep, columns } = self;
        let zeros = || Information::zeros(columns, 0);
        let mut run = Run::empty(columns);
        let mut tape = Tape::new(keep, problem);
        let mut begun_s = 0.0;
        let mut kalman = Kalman::new(problem, walk, noise);
        let mut sensitivity = Sensitivity::new(columns);
        let mut updates = Vec::new();
        for epoch in problem.epochs() {
            let interval = &epoch.interval;
            kalman.predict(interval);
            sensitivity.predict(interval, (-interval.dt / noise.correlation_s).exp());
            let before = (keep == Keep::Updates).then(|| kalman.gauss_markov());
            kalman.renew(interval.dt);
            if keep == Keep::Priors {
                if tape.priors.len() == problem.len() / 2 {
                    tape.middle = Some(Box::new(kalman.prior(index::GYRO_BIAS)));
                }
                tape.priors.push(kalman.prior(index::POSITION));
            }
            kalman.correct(&epoch.measured.rows, &mut updates);
            sensitivity.correct(&epoch.measured, &updates);
            let weights = run.count(problem.part(epoch, options), epoch, &updates, &sensitivity.rows);
            if let Keep::Blocks(block_s) = keep
                && epoch.elapsed_s - begun_s >= block_s
            {
                begun_s = epoch.elapsed_s;
                run.blocks.push(std::mem::replace(&mut run.information[0], zeros()));
            }
            if let Some((gauss_markov_rows, gauss_markov)) = before {
                tape.fixes.push(Taped { weights, gauss_markov_rows, gauss_markov });
            }
            if matches!(keep, Keep::Updates | Keep::Priors) {
                tape.updates.extend_from_slice(&updates);
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
    pub(super) fn run_keeping(&self, noise: &Noise, options: &Options, keep: Keep) -> (Run, Tape) {
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
    ) -> (Run, Tape) {
        vectorised(Going { problem: self, walk, noise, options, keep, columns })
    }
}

impl Run {
    /// Counts the rows of a fix, with their whitened derivatives one after the other, and says how much each group weighs.
    #[inline(always)]
    pub(super) fn count(
        &mut self,
        part: Option<usize>,
        epoch: &Epoch,
        updates: &[Update],
        sensitivities: &[f64],
    ) -> [f64; 2] {
        let mut nis = [0.0; 2];
        let group = |k: usize| usize::from(!epoch.measured.rows[k].is_position());
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
        if columns > 0 {
            let row = |k: usize| {
                let update = &updates[k];
                (
                    &sensitivities[k * columns..(k + 1) * columns],
                    update.y / update.s.sqrt(),
                    weights[group(k)],
                )
            };
            self.information[part].take_rows(updates.len(), row);
        }
        weights
    }
}
