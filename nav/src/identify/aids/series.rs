//! A scalar measurement along a settled trajectory, whose error holds what walks and what wanders: height of a barometer, speed of the air in a wind
//! that changes and gusts.
//!
//! A Kalman filter of these states alone gives innovations and, by their derivatives, score and information about all parameters (Gupta &
//! Mehra 1974). What walks has no bound: the weather over an hour, the wind of the day. What wanders is bounded, a first-order Gauss-Markov process (Brown & Hwang
//! 2012, section 4.6): gusts (the longitudinal spectrum of Dryden, MIL-F-8785C, is one), the height of a receiver. A walk as fast as a gust at its beginning
//! would leave nothing of what stays the same for a minute. Ratios of both to the white noise are those of the largest likelihood, in
//! which the noise itself is found in closed form (Harvey 1989, section 4.2.1).

use crate::identify::pass::Information;
use nalgebra::{Matrix4, Vector4};

/// Ratios of walk (per √s) and of wandering to white noise, and correlation times of the latter, s, that the search starts from …
const GRID: [&[f64]; 3] = [&[0.01, 0.1], &[0.3, 1.0, 4.0], &[3.0, 15.0, 60.0]];
/// … and between which it stays. A walk from a metre in an hour to as much as the noise in a second.
const LIMITS: [(f64, f64); 3] = [(0.003, 1.0), (0.05, 50.0), (1.0, 120.0)];
/// Factors by which the search goes, from the first to one that changes the likelihood of a flight by less than a tenth.
const STEPS: [f64; 4] = [2.5, 1.6, 1.3, 1.15];
/// Steps of the search at most.
const MOST_STEPS: usize = 40;
/// An innovation beyond this many sigmas counts as one that is no larger: a gust, a bump.
const LARGEST: f64 = 4.0;
/// The first seconds count for nothing: the states settle.
const SETTLE_S: f64 = 10.0;

/// Two that walk, one that wanders, and one that wanders as is given; what has fewer leaves others at zero.
pub(in crate::identify) type States = Vector4<f64>;
/// Which of them wanders.
pub(in crate::identify) const WANDERS: usize = 2;
/// Which of them wanders as is given.
pub(in crate::identify) const GIVEN: usize = 3;

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
    /// By the states.
    pub(in crate::identify) by_state: States,
    /// By the parameters.
    pub(in crate::identify) columns: Vec<f64>,
}

/// First-order Gauss-Markov error: 1-sigma and correlation time, s.
pub(in crate::identify) type Wander = (f64, f64);

/// Noise of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::identify) struct Noise {
    /// White, 1-sigma.
    pub(in crate::identify) sigma: f64,
    /// Walk of the states that do, per √s.
    pub(in crate::identify) walk: f64,
    /// Of the state that wanders.
    pub(in crate::identify) wander: Wander,
    /// Of the state that wanders as is given.
    pub(in crate::identify) given: Wander,
    /// 1-sigma of the states that walk, at the start.
    pub(in crate::identify) start: f64,
}

/// What a pass says.
pub(in crate::identify) struct Pass {
    /// Score and information, block by block.
    pub(in crate::identify) blocks: Vec<Information>,
    steps: Vec<Step>,
}

/// The states before and after a row, and what is left of each between the row before and this one.
struct Step {
    kept: States,
    predicted: (States, Matrix4<f64>),
    filtered: (States, Matrix4<f64>),
}

/// A filter of the states.
struct Walker<'n> {
    noise: &'n Noise,
    last_s: f64,
    x: States,
    p: Matrix4<f64>,
}

impl<'n> Walker<'n> {
    fn new(noise: &'n Noise, start_s: f64) -> Self {
        // A state without an error of its own keeps an inverse of its covariance.
        let own = |sigma: f64| sigma.powi(2).max(1e-9);
        let variances = Vector4::new(noise.start, noise.start, noise.wander.0, noise.given.0).map(own);
        Self { noise, last_s: start_s, x: States::zeros(), p: Matrix4::from_diagonal(&variances) }
    }

    /// To a later time; returns what is left of each state.
    fn predict(&mut self, t_s: f64) -> States {
        let since_s = (t_s - self.last_s).max(0.0);
        self.last_s = t_s;
        let left = |(_, memory_s): Wander| (-since_s / memory_s.max(1e-3)).exp();
        let kept = States::new(1.0, 1.0, left(self.noise.wander), left(self.noise.given));
        self.x.component_mul_assign(&kept);
        self.p.component_mul_assign(&(kept * kept.transpose()));
        let walk = self.noise.walk.powi(2) * since_s;
        let grown = |(sigma, _): Wander, k: usize| sigma.powi(2).max(1e-9) * (1.0 - kept[k].powi(2));
        let grown = [walk, walk, grown(self.noise.wander, WANDERS), grown(self.noise.given, GIVEN)];
        grown.iter().enumerate().for_each(|(k, v)| self.p[(k, k)] += v);
        kept
    }

    /// Innovation, its variance and the gain of a row.
    fn innovation(&self, row: &Row) -> (f64, f64, States) {
        let y = row.residual - row.by_state.dot(&self.x);
        let ph = self.p * row.by_state;
        let s = row.by_state.dot(&ph) + (self.noise.sigma * row.noise).powi(2) + row.least.powi(2);
        let s = s * (y * y / s / LARGEST.powi(2)).max(1.0);
        (y, s, ph / s)
    }

    fn update(&mut self, y: f64, s: f64, gain: &States) {
        self.x += gain * y;
        self.p -= gain * gain.transpose() * s;
    }
}

/// Goes through rows in order of time.
pub(in crate::identify) fn pass(rows: &[Row], noise: &Noise, block_s: f64) -> Pass {
    let columns = rows.first().map_or(0, |r| r.columns.len());
    let mut walker = Walker::new(noise, rows.first().map_or(0.0, |r| r.elapsed_s));
    let mut by = vec![States::zeros(); columns];
    let (mut blocks, mut steps): (Vec<Information>, _) = (Vec::new(), Vec::with_capacity(rows.len()));
    let mut slope = vec![0.0; columns];
    for row in rows {
        let kept = walker.predict(row.elapsed_s);
        by.iter_mut().for_each(|b| b.component_mul_assign(&kept));
        let predicted = (walker.x, walker.p);
        let (y, s, gain) = walker.innovation(row);
        slope.iter_mut().zip(&row.columns).zip(&by).for_each(|((o, c), b)| *o = c + row.by_state.dot(b));
        let block = (row.elapsed_s / block_s) as usize;
        while blocks.len() <= block {
            blocks.push(Information::zeros(columns));
        }
        if row.elapsed_s >= SETTLE_S {
            blocks[block].take(&slope, y, 1.0 / s);
        }
        walker.update(y, s, &gain);
        by.iter_mut().zip(&slope).for_each(|(b, o)| *b -= gain * *o);
        steps.push(Step { kept, predicted, filtered: (walker.x, walker.p) });
    }
    blocks.iter_mut().for_each(Information::finish);
    Pass { blocks, steps }
}

impl Pass {
    /// The states at each row by all rows, and their covariance (Rauch, Tung & Striebel 1965).
    pub(in crate::identify) fn smoothed(&self) -> Vec<(States, Matrix4<f64>)> {
        let steps = &self.steps;
        let mut out: Vec<(States, Matrix4<f64>)> = steps.iter().map(|s| s.filtered).collect();
        for k in (0..steps.len().saturating_sub(1)).rev() {
            let (next, own) = (&steps[k + 1], &steps[k].filtered);
            let Some(inverse) = next.predicted.1.try_inverse() else { continue };
            let gain = own.1 * Matrix4::from_diagonal(&next.kept) * inverse;
            let later = out[k + 1];
            out[k] = (
                own.0 + gain * (later.0 - next.predicted.0),
                own.1 + gain * (later.1 - next.predicted.1) * gain.transpose(),
            );
        }
        out
    }
}

/// Log-likelihood of these rows, and the mean of their normalised innovations squared.
fn likelihood(rows: &[Row], noise: &Noise) -> (f64, f64) {
    let mut walker = Walker::new(noise, rows.first().map_or(0.0, |r| r.elapsed_s));
    let (mut sum, mut nis, mut count) = (0.0, 0.0, 0);
    for row in rows {
        walker.predict(row.elapsed_s);
        let (y, s, gain) = walker.innovation(row);
        if row.elapsed_s >= SETTLE_S {
            sum -= 0.5 * (s.ln() + y * y / s);
            if row.noise > 0.0 {
                nis += y * y / s;
                count += 1;
            }
        }
        walker.update(y, s, &gain);
    }
    (sum, nis / f64::from(count.max(1)))
}

/// The noise by which these rows are most likely. `limits`: the least and the largest white noise; `known`: what is not fitted; `near`: where it was
/// for values that are not far from these.
pub(in crate::identify) fn noise_of(
    rows: &[Row],
    limits: (f64, f64),
    known: &Noise,
    near: Option<&Noise>,
) -> Noise {
    let one = |[walk, wander, memory_s]: [f64; 3]| {
        let mut noise = near.copied().unwrap_or(Noise { sigma: limits.0.max(0.1 * limits.1), ..*known });
        let mut found = f64::NEG_INFINITY;
        for _ in 0..3 {
            (noise.walk, noise.wander) = (walk * noise.sigma, (wander * noise.sigma, memory_s));
            let (sum, nis) = likelihood(rows, &noise);
            found = sum;
            if (nis - 1.0).abs() < 0.02 {
                break;
            }
            noise.sigma = (noise.sigma * nis.sqrt()).clamp(limits.0, limits.1);
        }
        (found, noise)
    };
    let start: Vec<[f64; 3]> = match near {
        Some(n) => vec![[n.walk / n.sigma, n.wander.0 / n.sigma, n.wander.1]],
        None => {
            let [walks, wanders, memories] = GRID;
            let pairs = walks.iter().flat_map(|w| wanders.iter().map(move |g| (*w, *g)));
            pairs.flat_map(|(w, g)| memories.iter().map(move |m| [w, g, *m])).collect()
        }
    };
    let all = start.into_iter().map(|at| (one(at), at));
    let Some((mut best, mut at)) = all.max_by(|a, b| a.0.0.total_cmp(&b.0.0)) else { return *known };
    let (mut which, mut count) = (0, 0);
    while let Some(factor) = STEPS.get(which).filter(|_| count < MOST_STEPS) {
        count += 1;
        let tried = (0..6).map(|k| {
            let mut to = at;
            let by = if k % 2 == 0 { *factor } else { 1.0 / factor };
            to[k / 2] = (to[k / 2] * by).clamp(LIMITS[k / 2].0, LIMITS[k / 2].1);
            (one(to), to)
        });
        match tried.max_by(|a, b| a.0.0.total_cmp(&b.0.0)) {
            Some((found, to)) if found.0 > best.0 + 0.05 => (best, at) = (found, to),
            _ => which += 1,
        }
    }
    best.1
}
