//! A scalar measurement along a settled trajectory, whose error holds what walks: height of a barometer, speed of the air in a wind that changes.
//!
//! A Kalman filter of the walking states alone gives innovations and, by their derivatives, score and information about all parameters (Gupta &
//! Mehra 1974); how fast the states walk against the white noise is the ratio of the largest likelihood, in which the noise itself is found in closed form
//! (Harvey 1989, section 4.2.1).

use super::choose::is_held_out;
use crate::identify::pass::Information;
use nalgebra::{Matrix2, Vector2};

/// Ratios of walk (per √s) to white noise that are tried: from a metre in an hour to as much as the noise in a second.
const RATIOS: [f64; 8] = [0.003, 0.01, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0];
/// An innovation beyond this many sigmas counts as one that is no larger: a gust, a bump.
const LARGEST: f64 = 4.0;
/// The first seconds count for nothing: the states settle.
const SETTLE_S: f64 = 10.0;

/// States that walk; what has one only leaves the other at zero.
pub(in crate::identify) type States = Vector2<f64>;

/// One measurement.
#[derive(Debug, Clone)]
pub(in crate::identify) struct Row {
    /// Since the start, s.
    pub(in crate::identify) elapsed_s: f64,
    /// What was measured less what is expected.
    pub(in crate::identify) residual: f64,
    /// White noise as a multiple of that of the series.
    pub(in crate::identify) noise: f64,
    /// White noise that the series' own does not scale, 1-sigma.
    pub(in crate::identify) least: f64,
    /// By the walking states.
    pub(in crate::identify) by_state: States,
    /// By the parameters.
    pub(in crate::identify) columns: Vec<f64>,
}

/// Noise of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::identify) struct Noise {
    /// White, 1-sigma.
    pub(in crate::identify) sigma: f64,
    /// Walk of the states per √s.
    pub(in crate::identify) walk: f64,
    /// 1-sigma of the states at the start.
    pub(in crate::identify) start: f64,
}

/// What a pass says.
pub(in crate::identify) struct Pass {
    /// Score and information, block by block.
    pub(in crate::identify) blocks: Vec<Information>,
    /// Log-likelihood of the held-out blocks.
    pub(in crate::identify) held_out: f64,
    log_likelihood: f64,
    nis: f64,
    steps: Vec<Step>,
}

/// The states before and after a row.
struct Step {
    predicted: (States, Matrix2<f64>),
    filtered: (States, Matrix2<f64>),
}

/// Goes through rows in order of time.
pub(in crate::identify) fn pass(rows: &[Row], noise: &Noise, block_s: f64) -> Pass {
    let columns = rows.first().map_or(0, |r| r.columns.len());
    let (mut x, mut p) = (States::zeros(), Matrix2::identity() * noise.start.powi(2));
    let mut by = vec![States::zeros(); columns];
    let steps = Vec::with_capacity(rows.len());
    let mut out = Pass { blocks: vec![], held_out: 0.0, log_likelihood: 0.0, nis: 0.0, steps };
    let mut count = 0;
    let mut last_s = rows.first().map_or(0.0, |r| r.elapsed_s);
    let mut slope = vec![0.0; columns];
    for row in rows {
        p += Matrix2::identity() * (noise.walk.powi(2) * (row.elapsed_s - last_s).max(0.0));
        last_s = row.elapsed_s;
        let predicted = (x, p);
        let y = row.residual - row.by_state.dot(&x);
        let ph = p * row.by_state;
        let mut s = row.by_state.dot(&ph) + (noise.sigma * row.noise).powi(2) + row.least.powi(2);
        s *= (y * y / s / LARGEST.powi(2)).max(1.0);
        slope.iter_mut().zip(&row.columns).zip(&by).for_each(|((o, c), b)| *o = c + row.by_state.dot(b));
        let block = (row.elapsed_s / block_s) as usize;
        while out.blocks.len() <= block {
            out.blocks.push(Information::zeros(columns));
        }
        if row.elapsed_s >= SETTLE_S {
            out.blocks[block].take(&slope, y, 1.0 / s);
            let own = -0.5 * (s.ln() + y * y / s);
            out.log_likelihood += own;
            out.held_out += if is_held_out(block) { own } else { 0.0 };
            if row.noise > 0.0 {
                out.nis += y * y / s;
                count += 1;
            }
        }
        let gain = ph / s;
        x += gain * y;
        p -= gain * ph.transpose();
        by.iter_mut().zip(&slope).for_each(|(b, o)| *b -= gain * *o);
        out.steps.push(Step { predicted, filtered: (x, p) });
    }
    out.blocks.iter_mut().for_each(Information::finish);
    out.nis /= f64::from(count.max(1));
    out
}

impl Pass {
    /// The states at each row by all rows, and their covariance (Rauch, Tung & Striebel 1965, for states that walk).
    pub(in crate::identify) fn smoothed(&self) -> Vec<(States, Matrix2<f64>)> {
        let mut out: Vec<(States, Matrix2<f64>)> = self.steps.iter().map(|s| s.filtered).collect();
        for k in (0..self.steps.len().saturating_sub(1)).rev() {
            let (next, own) = (&self.steps[k + 1].predicted, &self.steps[k].filtered);
            let Some(inverse) = next.1.try_inverse() else { continue };
            let gain = own.1 * inverse;
            let later = out[k + 1];
            out[k] =
                (own.0 + gain * (later.0 - next.0), own.1 + gain * (later.1 - next.1) * gain.transpose());
        }
        out
    }
}

/// The noise by which these rows are most likely, their columns aside. `limits`: the least and the largest white noise; `start`: of the states.
pub(in crate::identify) fn noise_of(rows: &[Row], limits: (f64, f64), start: f64) -> Noise {
    let one = |ratio: f64| {
        let mut noise = Noise { sigma: limits.0.max(0.5 * limits.1), walk: 0.0, start };
        let mut found = f64::NEG_INFINITY;
        for _ in 0..3 {
            noise.walk = ratio * noise.sigma;
            let run = pass(rows, &noise, f64::INFINITY);
            found = run.log_likelihood;
            noise.sigma = (noise.sigma * run.nis.sqrt()).clamp(limits.0, limits.1);
        }
        noise.walk = ratio * noise.sigma;
        (found, noise)
    };
    let all = RATIOS.into_iter().map(one);
    all.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(Noise { sigma: limits.1, walk: limits.1, start }, |n| n.1)
}
