//! What a run over a flight counts: which part a fix belongs to, its innovation, score and information of the watched parameters.

use crate::filter::Group;
use nalgebra::{DMatrix, DVector};

/// How to run and what to count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// The first seconds after the start do not count, s.
    pub settle_s: f64,
    /// The flight is cut into blocks of this length, s …
    pub block_s: f64,
    /// … of which every so many-th is held out; 0 = none.
    pub held_out_every: u32,
    /// Which of them: 0 … `held_out_every` − 1.
    pub phase: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self { settle_s: 15.0, block_s: 5.0, held_out_every: 6, phase: 0 }
    }
}

impl Options {
    /// Everything counts.
    pub fn all(self) -> Self {
        Self { held_out_every: 0, ..self }
    }

    /// 0: for choosing and fitting, 1: held out, `None`: too early.
    pub fn part(&self, elapsed_s: f64) -> Option<usize> {
        if elapsed_s < self.settle_s {
            return None;
        }
        if self.held_out_every == 0 {
            return Some(0);
        }
        let block = self.block(elapsed_s);
        Some(usize::from((block + self.phase) % self.held_out_every == self.held_out_every - 1))
    }

    fn block(&self, elapsed_s: f64) -> u32 {
        (elapsed_s / self.block_s) as u32
    }

    /// Whether two times are in the same block.
    pub(super) fn same_block(&self, a_s: f64, b_s: f64) -> bool {
        self.block(a_s) == self.block(b_s)
    }
}

/// What one fix said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Time of validity, s.
    pub t_s: f64,
    /// Seconds since the start.
    pub elapsed_s: f64,
    /// 0: fit, 1: held out; `None` while settling.
    pub part: Option<usize>,
    /// Position.
    pub position: Group,
    /// Velocity.
    pub velocity: Group,
}

/// The channels of a fix, in the order of the innovations.
pub const CHANNELS: [&str; 6] =
    ["position_north", "position_east", "position_down", "velocity_north", "velocity_east", "velocity_down"];

impl Innovation {
    /// Normalised innovation of a channel, if the fix has it.
    pub fn channel(&self, channel: usize) -> Option<f64> {
        let group = if channel < 3 { &self.position } else { &self.velocity };
        (channel % 3 < group.dof).then(|| group.normalised[channel % 3])
    }
}

/// Score and information of the watched parameters of one part.
#[derive(Debug, Clone, PartialEq)]
pub struct Information {
    /// Σ sᵀ r of effects and terms.
    pub score: DVector<f64>,
    /// Σ sᵀ s.
    pub matrix: DMatrix<f64>,
    /// Variance that each score has beside the information: what noise of the samples can make of it.
    pub imitated: DVector<f64>,
}

impl Information {
    /// None yet.
    pub fn zeros(columns: usize) -> Self {
        Self {
            score: DVector::zeros(columns),
            matrix: DMatrix::zeros(columns, columns),
            imitated: DVector::zeros(columns),
        }
    }

    /// Adds that of another part or flight.
    pub fn add(&mut self, other: &Self) {
        self.score += &other.score;
        self.matrix += &other.matrix;
        self.imitated += &other.imitated;
    }

    /// Column `i` of the upper triangle, which is filled alone; `finish` mirrors it. As a slice: the iterator over a column counts strides.
    #[inline(always)]
    fn upper(&mut self, i: usize) -> &mut [f64] {
        let first = i * self.score.len();
        &mut self.matrix.as_mut_slice()[first..=first + i]
    }

    /// Adds a whitened innovation with its derivative by every parameter.
    #[inline(always)]
    pub(super) fn take(&mut self, s: &[f64], residual: f64, weight: f64) {
        let n = self.score.len();
        for i in 0..n {
            let w = weight * s[i];
            if w != 0.0 {
                self.score[i] += w * residual;
                for (m, x) in self.upper(i).iter_mut().zip(s) {
                    *m += w * x;
                }
            }
        }
    }

    /// The same for several of them: derivatives, innovation and weight of each. Three at a time, so that the matrix is
    /// written once for them.
    #[inline(always)]
    pub(super) fn take_rows<'r>(&mut self, count: usize, row: impl Fn(usize) -> (&'r [f64], f64, f64)) {
        let n = self.score.len();
        let mut k = 0;
        while k + 3 <= count {
            let ((a, p, v), (b, q, w), (c, r, x)) = (row(k), row(k + 1), row(k + 2));
            for i in 0..n {
                let (v, w, x) = (v * a[i], w * b[i], x * c[i]);
                if v != 0.0 || w != 0.0 || x != 0.0 {
                    self.score[i] += v * p + w * q + x * r;
                    for (((m, a), b), c) in self.upper(i).iter_mut().zip(a).zip(b).zip(c) {
                        *m += v * a + w * b + x * c;
                    }
                }
            }
            k += 3;
        }
        while k < count {
            let (s, residual, weight) = row(k);
            self.take(s, residual, weight);
            k += 1;
        }
    }

    /// Fills what [`Self::upper`] leaves out by symmetry.
    pub(super) fn finish(&mut self) {
        self.matrix.fill_lower_triangle_with_upper_triangle();
    }
}
