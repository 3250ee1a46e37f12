//! A run of the filter over a linearised flight: likelihood of the innovations, and how it depends on the watched parameters.
//!
//! Parameters are carried along (Friedland 1969, "Treatment of bias in recursive filtering"; Willsky & Jones 1976 for jumps): δx = δx₀ + U θ with U ← Φ U + B and U ← U − K (H U + D).

use super::imitation::Imitation;
use super::kalman::{GROUPS, Kalman, State, Update, add_rows, add_scaled, normalised_squares, vectorised};
use super::rows::{Measured, Row};
use super::{Epoch, Problem, STATES, index};
use crate::effects::BiasWalk;
use crate::identify::noise::Noise;
use crate::identify::pass::{Information, Options};
use crate::linear::interval::{BIASES, DYNAMIC, Interval};
use crate::math::ln;
use nalgebra::DVector;
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
        let zeros = || Information::zeros(columns);
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
    /// Derivative of the robust square of each group: position, velocity, rate.
    pub(super) weights: [f64; GROUPS],
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
pub(super) struct Sensitivity {
    m: usize,
    u: Vec<f64>,
    scratch: Vec<f64>,
    /// Whitened derivatives of the innovations of the present fix, row by row.
    pub(super) rows: Vec<f64>,
    /// Of each of these, negative: what whitens it.
    scales: Vec<f64>,
}

impl Sensitivity {
    pub(super) fn new(m: usize) -> Self {
        Self { m, u: vec![0.0; STATES * m], scratch: vec![0.0; 9 * m], rows: Vec::new(), scales: Vec::new() }
    }

    #[inline(always)]
    pub(super) fn predict<S: Simd>(&mut self, simd: S, interval: &Interval, decay: f64) {
        let m = self.m;
        if m == 0 {
            return;
        }
        for (i, out) in self.scratch.chunks_exact_mut(m).enumerate() {
            // What acts on a compass alone drives no motion.
            let (driven, rest) = out.split_at_mut(interval.driven.len().min(m));
            driven.iter_mut().zip(&interval.driven).for_each(|(o, b)| *o = b[i]);
            rest.fill(0.0);
            let u = &self.u;
            add_rows(simd, out, DYNAMIC, |j| (&u[j * m..(j + 1) * m], interval.transition[j][i]));
        }
        self.u[..9 * m].copy_from_slice(&self.scratch);
        let gauss_markov = index::GAUSS_MARKOV * m..index::STAMP * m;
        self.u[gauss_markov].iter_mut().for_each(|v| *v *= decay);
        self.u[index::STAMP * m..index::CLOCK * m].fill(0.0);
    }

    /// The whitened derivatives of the innovations of a fix, row by row.
    #[inline(always)]
    pub(super) fn correct<S: Simd>(&mut self, simd: S, measured: &Measured, updates: &[Update]) {
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
                add_scaled(simd, out, &self.u[state * m..(state + 1) * m], h);
            }
            add_rows(simd, out, k, |j| (&before[j * m..(j + 1) * m], -row.dot(&updates[j].g) / updates[j].s));
        }
        for (out, update) in self.rows.chunks_exact_mut(m).zip(updates) {
            let scale = update.s.sqrt().recip();
            out.iter_mut().for_each(|v| *v *= scale);
            self.scales.push(-scale);
        }
        let (rows, scales) = (&self.rows, &self.scales);
        for (i, u) in self.u.chunks_exact_mut(m).enumerate() {
            add_rows(simd, u, updates.len(), |k| (&rows[k * m..(k + 1) * m], updates[k].g[i] * scales[k]));
        }
    }
}

/// A run of the filter under way.
pub(super) struct Runner<'a> {
    problem: &'a Problem,
    options: &'a Options,
    noise: &'a Noise,
    keep: Keep,
    kalman: Kalman<'a>,
    sensitivity: Sensitivity,
    run: Run,
    tape: Tape,
    /// When the present block began, s.
    begun_s: f64,
    /// Those of the last correction.
    pub(super) updates: Vec<Update>,
}

impl<'a> Runner<'a> {
    /// Before the first fix; `columns` parameters are watched. Of `problem` what it starts from counts, and what is to be kept.
    pub(super) fn new(
        problem: &'a Problem,
        (noise, options): (&'a Noise, &'a Options),
        walk: BiasWalk,
        keep: Keep,
        columns: usize,
    ) -> Self {
        Self {
            problem,
            options,
            noise,
            keep,
            kalman: Kalman::new(problem, walk, noise),
            sensitivity: Sensitivity::new(columns),
            run: Run::empty(columns),
            tape: Tape::new(keep, problem),
            begun_s: 0.0,
            updates: Vec::new(),
        }
    }

    /// On over these fixes.
    pub(super) fn go(&mut self, epochs: &[Epoch]) {
        vectorised(Going { runner: self, epochs });
    }

    /// On over this fix, which counts in this part.
    #[inline(always)]
    pub(super) fn take<S: Simd>(&mut self, simd: S, epoch: &Epoch, part: Option<usize>) {
        let (interval, keep) = (&epoch.interval, self.keep);
        self.kalman.predict(simd, interval);
        self.sensitivity.predict(simd, interval, self.noise.decay(interval.dt));
        let before = (keep == Keep::Updates).then(|| self.kalman.gauss_markov());
        self.kalman.renew(interval.dt);
        if keep == Keep::Priors {
            if self.tape.priors.len() == self.problem.len() / 2 {
                self.tape.middle = Some(Box::new(self.kalman.prior(index::GYRO_BIAS)));
            }
            self.tape.priors.push(self.kalman.prior(index::POSITION));
        }
        let weights = self.correct(simd, &epoch.measured, part);
        if let Some((gauss_markov_rows, gauss_markov)) = before {
            self.tape.fixes.push(Taped { weights, gauss_markov_rows, gauss_markov });
        }
        if matches!(keep, Keep::Updates | Keep::Priors) {
            self.tape.updates.extend_from_slice(&self.updates);
        }
    }

    /// By what was measured, which counts in this part; returns how much each group weighs.
    #[inline(always)]
    pub(super) fn correct<S: Simd>(
        &mut self,
        simd: S,
        measured: &Measured,
        part: Option<usize>,
    ) -> [f64; GROUPS] {
        self.kalman.correct(simd, &measured.rows, &mut self.updates);
        self.sensitivity.correct(simd, measured, &self.updates);
        self.run.count(part, &measured.rows, &self.updates, &self.sensitivity.rows)
    }

    /// Ends a block of information that is long enough.
    #[inline(always)]
    pub(super) fn end_block(&mut self, elapsed_s: f64) {
        if let Keep::Blocks(block_s) = self.keep
            && elapsed_s - self.begun_s >= block_s
        {
            self.begun_s = elapsed_s;
            let none = Information::zeros(self.sensitivity.m);
            self.run.blocks.push(std::mem::replace(&mut self.run.information[0], none));
        }
    }

    /// What it says.
    pub(super) fn end(self) -> (Run, Tape) {
        let Self { mut run, tape, keep, .. } = self;
        if matches!(keep, Keep::Blocks(_)) {
            run.blocks.push(run.information[0].clone());
        }
        run.information.iter_mut().chain(&mut run.blocks).for_each(Information::finish);
        (run, tape)
    }
}

/// The next fixes of a run.
struct Going<'r, 'a> {
    runner: &'r mut Runner<'a>,
    epochs: &'r [Epoch],
}

impl WithSimd for Going<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // A closure is a function of its own, without the registers that this one is compiled for.
        for epoch in self.epochs {
            let part = self.runner.problem.part(epoch, self.runner.options);
            self.runner.take(simd, epoch, part);
            self.runner.end_block(epoch.elapsed_s);
        }
    }
}

impl Problem {
    /// Runs the filter with this noise.
    pub fn run(&self, noise: &Noise, options: &Options) -> Run {
        let mut run = self.go(self.walk, noise, options, Keep::Nothing, self.columns).0;
        let noisy = self.columns > 0 && self.epochs().any(|e| e.driven.is_known());
        let imitated = noisy.then(|| {
            let mut parts = Imitation::of_parts(self, noise, options, self.columns);
            parts.iter_mut().for_each(|part| self.epochs().for_each(|epoch| part.take(epoch, noise)));
            parts.map(Imitation::end)
        });
        run.imitated(imitated.as_ref());
        run
    }

    /// The same when the biases walk like this. Watched parameters are left out.
    pub fn run_walking(&self, walk: BiasWalk, noise: &Noise, options: &Options) -> Run {
        self.go(walk, noise, options, Keep::Nothing, 0).0
    }

    /// Log-likelihood of each block of one part by itself, in order of time. Watched parameters are left out.
    pub fn by_block(&self, noise: &Noise, options: &Options, part: usize) -> Vec<f64> {
        let mut runner = Runner::new(self, (noise, options), self.walk, Keep::Nothing, 0);
        let (mut blocks, mut last) = (Vec::new(), None);
        for epochs in
            self.pieces.iter().flat_map(|p| p.chunk_by(|a, b| options.same_block(a.elapsed_s, b.elapsed_s)))
        {
            let before = runner.run.log_likelihood[part];
            runner.go(epochs);
            let Some(epoch) = epochs.iter().find(|e| self.part(e, options) == Some(part)) else { continue };
            let gain = runner.run.log_likelihood[part] - before;
            match blocks.last_mut() {
                // A block may go on in the next stretch.
                Some(own) if last.is_some_and(|t| options.same_block(t, epoch.elapsed_s)) => *own += gain,
                _ => blocks.push(gain),
            }
            last = Some(epoch.elapsed_s);
        }
        blocks
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
        let mut runner = Runner::new(self, (noise, options), walk, keep, columns);
        self.pieces.iter().for_each(|epochs| runner.go(epochs));
        runner.end()
    }
}

impl Run {
    /// Takes in what noise of the samples can make of the scores of both parts.
    pub(super) fn imitated(&mut self, imitated: Option<&[DVector<f64>; 2]>) {
        for (information, imitated) in self.information.iter_mut().zip(imitated.into_iter().flatten()) {
            information.imitated.clone_from(imitated);
        }
    }

    /// Counts the rows of a fix, with their whitened derivatives one after the other, and says how much each group weighs.
    #[inline(always)]
    pub(super) fn count(
        &mut self,
        part: Option<usize>,
        rows: &[Row],
        updates: &[Update],
        sensitivities: &[f64],
    ) -> [f64; GROUPS] {
        let nis = normalised_squares(rows, updates);
        let group = |k: usize| rows[k].group();
        let robust = nis.map(robust);
        let weights = robust.map(|r| r.1);
        let Some(part) = part else { return weights };
        let ln_det: f64 = updates.iter().map(|u| ln(u.s)).sum();
        self.log_likelihood[part] -= 0.5 * (ln_det + robust.iter().map(|r| r.0).sum::<f64>());
        self.nis[part].0 += nis.iter().sum::<f64>();
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
