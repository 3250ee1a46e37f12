//! A scalar measurement along a settled trajectory, whose error holds what walks and what is bounded: height of a barometer, speed of the air in a wind
//! that changes and gusts.
//!
//! A Kalman filter of these states alone gives innovations and, by their derivatives, score and information about all parameters (Gupta &
//! Mehra 1974). What walks has no bound: the weather over an hour, the wind of the day. What is bounded is a Gauss-Markov process (Brown & Hwang
//! 2012, section 4.6): of the first order for gusts (the longitudinal spectrum of Dryden, MIL-F-8785C, is one) and a receiver's height, of the second for the
//! height of a trajectory, which inertial data keep smooth. Its figures are those of the largest marginal likelihood, with the parameters integrated out over
//! their priors (restricted likelihood: Patterson & Thompson 1971): where the noise is fitted to what is left of no effect at all, it takes every effect for its own.

use crate::identify::evidence::{self, Column};
use crate::identify::pass::Information;
use crate::math::{exp, ln};
use nalgebra::{SMatrix, SVector};

/// Factors by which the search goes, from the first to one that changes the likelihood of a flight by less than a tenth.
const STEPS: [f64; 3] = [3.0, 1.7, 1.25];
/// By which power of it each figure goes: one by one, and the bounded error with its correlation time so that it begins as fast.
const MOVES: [[i32; 4]; 5] = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 1, 2]];
/// A likelihood that grows by less grows no more, nats.
const ENOUGH: f64 = 0.1;
/// Steps of the search at most.
const MOST_STEPS: usize = 30;
/// The noise is fitted to so many rows at most, evenly spaced.
const FITTED_ROWS: usize = 1200;
/// An innovation beyond this many sigmas counts as one that is no larger: a gust, a bump.
const LARGEST: f64 = 4.0;
/// The first seconds count for nothing: the states settle.
const SETTLE_S: f64 = 10.0;

const STATES: usize = 5;
/// Two that walk, one that is bounded with its rate where that is smooth, else with another one like it, and one that is bounded as is given; what has fewer leaves others at zero.
pub(in crate::identify) type States = SVector<f64, STATES>;
type Square = SMatrix<f64, STATES, STATES>;
/// Which of them is bounded …
pub(in crate::identify) const BOUNDED: usize = 2;
/// … and which is its rate, or another one like it.
pub(in crate::identify) const RATE: usize = 3;
/// Which of them is bounded as is given.
pub(in crate::identify) const GIVEN: usize = 4;

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

/// Gauss-Markov error: 1-sigma and correlation time (the integral of the correlation), s.
pub(in crate::identify) type Bounded = (f64, f64);

/// Noise of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::identify) struct Noise {
    /// White, 1-sigma.
    pub(in crate::identify) sigma: f64,
    /// Walk of the states that do, per √s.
    pub(in crate::identify) walk: f64,
    /// Of the state that is bounded.
    pub(in crate::identify) bounded: Bounded,
    /// Whether that is of the second order.
    pub(in crate::identify) smooth: bool,
    /// Of the state that is bounded as is given.
    pub(in crate::identify) given: Bounded,
    /// 1-sigma of the states that walk, at the start.
    pub(in crate::identify) start: f64,
}

/// What is known of the noise of a kind of sensor: white noise, walk, bounded error and its correlation time.
#[derive(Debug, Clone, Copy)]
pub(in crate::identify) struct Figures {
    /// Median of each, and the factor of 1-sigma about it.
    pub(in crate::identify) usual: [(f64, f64); 4],
    /// Least and largest.
    pub(in crate::identify) limits: [(f64, f64); 4],
    /// Whether what is bounded may be smooth.
    pub(in crate::identify) smooth: &'static [bool],
}

impl Figures {
    /// The noise before there is a flight.
    pub(in crate::identify) fn before(&self, known: Known) -> Noise {
        let [sigma, walk, size, memory_s] = self.usual.map(|u| u.0);
        let Known { given, start } = known;
        Noise { sigma, walk, bounded: (size, memory_s), smooth: false, given, start }
    }
}

/// Prior sigmas of the parameters, and the values about which the rows are linearised.
#[derive(Debug, Clone, Copy)]
pub(in crate::identify) struct Prior<'p> {
    pub(in crate::identify) sigma: &'p [f64],
    pub(in crate::identify) values: &'p [f64],
}

/// What a pass says.
pub(in crate::identify) struct Pass {
    /// Score and information, block by block.
    pub(in crate::identify) blocks: Vec<Information>,
    log_likelihood: f64,
    steps: Vec<Step>,
}

/// The states before and after a row, and how they come from the row before.
pub(in crate::identify) struct Step {
    transition: Square,
    predicted: (States, Square),
    filtered: (States, Square),
}

/// A filter of the states.
#[derive(Debug, Clone)]
struct Walker {
    noise: Noise,
    last_s: f64,
    x: States,
    p: Square,
}

impl Walker {
    fn new(noise: Noise, start_s: f64) -> Self {
        let variances =
            noise.stationary() + States::from([noise.start, noise.start, 0.0, 0.0, 0.0]).map(|s| s * s);
        Self { noise, last_s: start_s, x: States::zeros(), p: Square::from_diagonal(&variances) }
    }

    /// To a later time; returns the transition.
    fn predict(&mut self, t_s: f64) -> Square {
        let since_s = (t_s - self.last_s).max(0.0);
        self.last_s = t_s;
        let (transition, grown) = self.noise.over(since_s);
        self.x = transition * self.x;
        self.p = transition * self.p * transition.transpose() + grown;
        transition
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

impl Noise {
    /// Decay of what is bounded, 1/s: of the second order the correlation is (1 + βt) e^(−βt), whose integral is 2/β.
    fn decay(&self) -> f64 {
        let memory_s = self.bounded.1.max(1e-3);
        if self.smooth { 2.0 / memory_s } else { 1.0 / memory_s }
    }

    /// Variances of what is bounded; of two alike where it is not smooth (gusts to the north and to the east). A state without an error of its own keeps
    /// an inverse of its covariance.
    fn stationary(&self) -> States {
        let own = |sigma: f64| sigma.powi(2).max(1e-9);
        let rate = if self.smooth { self.bounded.0 * self.decay() } else { self.bounded.0 };
        States::from([0.0, 0.0, own(self.bounded.0), own(rate), own(self.given.0)])
    }

    /// Transition over a time and the noise that it brings: what keeps the bounded states' variances as they are.
    fn over(&self, since_s: f64) -> (Square, Square) {
        let (b, mut transition) = (self.decay(), Square::identity());
        let left = exp(-b * since_s);
        let own = if self.smooth {
            [(1.0 + b * since_s) * left, since_s * left, -b * b * since_s * left, (1.0 - b * since_s) * left]
        } else {
            [left, 0.0, 0.0, left]
        };
        transition[(BOUNDED, BOUNDED)] = own[0];
        transition[(BOUNDED, RATE)] = own[1];
        transition[(RATE, BOUNDED)] = own[2];
        transition[(RATE, RATE)] = own[3];
        transition[(GIVEN, GIVEN)] = exp(-since_s / self.given.1.max(1e-3));
        let kept = Square::from_diagonal(&self.stationary());
        let mut grown = kept - transition * kept * transition.transpose();
        (0..BOUNDED).for_each(|k| grown[(k, k)] = self.walk.powi(2) * since_s);
        (transition, grown)
    }
}

/// Goes through rows in order of time.
pub(in crate::identify) fn pass(rows: &[Row], noise: &Noise, block_s: f64) -> Pass {
    gone_through(rows.iter(), noise, block_s, true)
}

fn gone_through<'r>(
    rows: impl Iterator<Item = &'r Row>,
    noise: &Noise,
    block_s: f64,
    with_steps: bool,
) -> Pass {
    let mut rows = rows.peekable();
    let (columns, start_s) = rows.peek().map_or((0, 0.0), |r| (r.columns.len(), r.elapsed_s));
    let mut running = Running::new(*noise, columns, start_s);
    let mut out = Pass { blocks: Vec::new(), log_likelihood: 0.0, steps: Vec::new() };
    for row in rows {
        let block = (row.elapsed_s / block_s) as usize;
        while out.blocks.len() <= block {
            out.blocks.push(Information::zeros(columns));
        }
        let (step, log_likelihood) = running.take(row, &mut out.blocks[block]);
        out.log_likelihood += log_likelihood;
        if with_steps {
            out.steps.push(step);
        }
    }
    out.blocks.iter_mut().for_each(Information::finish);
    out
}

/// A pass under way: the filter, and its states by the parameters.
#[derive(Debug, Clone)]
pub(in crate::identify) struct Running {
    walker: Walker,
    by: Vec<States>,
    slope: Vec<f64>,
}

impl Running {
    pub(in crate::identify) fn new(noise: Noise, columns: usize, start_s: f64) -> Self {
        let walker = Walker::new(noise, start_s);
        Self { walker, by: vec![States::zeros(); columns], slope: vec![0.0; columns] }
    }

    /// Adds what the next row says to the information, which is to be finished; returns the step and the logarithm of the row's likelihood.
    pub(in crate::identify) fn take(&mut self, row: &Row, into: &mut Information) -> (Step, f64) {
        let Self { walker, by, slope } = self;
        let transition = walker.predict(row.elapsed_s);
        by.iter_mut().for_each(|b| *b = transition * *b);
        let predicted = (walker.x, walker.p);
        let (y, s, gain) = walker.innovation(row);
        slope.iter_mut().zip(&row.columns).zip(&*by).for_each(|((o, c), b)| *o = c + row.by_state.dot(b));
        let mut log_likelihood = 0.0;
        if row.elapsed_s >= SETTLE_S {
            into.take(slope, y, 1.0 / s);
            log_likelihood = -0.5 * (ln(s) + y * y / s);
        }
        walker.update(y, s, &gain);
        by.iter_mut().zip(&*slope).for_each(|(b, o)| *b -= gain * *o);
        (Step { transition, predicted, filtered: (walker.x, walker.p) }, log_likelihood)
    }
}

impl Pass {
    /// The states at each row by all rows, and their covariance (Rauch, Tung & Striebel 1965).
    pub(in crate::identify) fn smoothed(&self) -> Vec<(States, Square)> {
        let steps = &self.steps;
        let mut out: Vec<(States, Square)> = steps.iter().map(|s| s.filtered).collect();
        for k in (0..steps.len().saturating_sub(1)).rev() {
            let (next, own) = (&steps[k + 1], &steps[k].filtered);
            let Some(inverse) = next.predicted.1.try_inverse() else { continue };
            let gain = own.1 * next.transition.transpose() * inverse;
            let later = out[k + 1];
            out[k] = (
                own.0 + gain * (later.0 - next.predicted.0),
                own.1 + gain * (later.1 - next.predicted.1) * gain.transpose(),
            );
        }
        out
    }
}

/// Logarithm of the marginal likelihood of rows: the parameters integrated out over their priors.
pub(in crate::identify) fn marginal(rows: &[Row], noise: &Noise, prior: Prior<'_>) -> f64 {
    let every = rows.len().div_ceil(FITTED_ROWS).max(1);
    // A wing has two rows for each instant, so that an odd number of rows leaves both.
    let run = gone_through(rows.iter().step_by(every | 1), noise, f64::INFINITY, false);
    let open = Column::open(prior.sigma.iter().zip(prior.values).map(|(sigma, value)| (*sigma, -value)));
    let fit = run.blocks.first().and_then(|of| evidence::fit(of, &open));
    fit.map_or(f64::NEG_INFINITY, |f| run.log_likelihood + f.evidence)
}

/// What is not fitted of a noise.
#[derive(Debug, Clone, Copy)]
pub(in crate::identify) struct Known {
    /// Of the state that is bounded as is given.
    pub(in crate::identify) given: Bounded,
    /// 1-sigma of the states that walk, at the start.
    pub(in crate::identify) start: f64,
}

/// A search for the likeliest noise.
struct Search<'s> {
    rows: &'s [Row],
    figures: &'s Figures,
    prior: Prior<'s>,
    known: Known,
}

impl Search<'_> {
    fn with(&self, at: &[f64; 4], smooth: bool) -> Noise {
        let Known { given, start } = self.known;
        Noise { sigma: at[0], walk: at[1], bounded: (at[2], at[3]), smooth, given, start }
    }

    /// Logarithm of the likelihood of a noise, with its own prior.
    fn one(&self, at: &[f64; 4], smooth: bool) -> f64 {
        let unusual =
            |(v, (median, factor)): (&f64, &(f64, f64))| 0.5 * (ln(v / median) / ln(*factor)).powi(2);
        let unlikely: f64 = at.iter().zip(&self.figures.usual).map(unusual).sum();
        marginal(self.rows, &self.with(at, smooth), self.prior) - unlikely
    }

    /// The best that moves of every size reach from here.
    fn from(&self, smooth: bool, start: [f64; 4]) -> (f64, Noise) {
        let (mut at, mut best) = (start, self.one(&start, smooth));
        let (mut which, mut count) = (0, 0);
        while let Some(factor) = STEPS.get(which).filter(|_| count < MOST_STEPS) {
            count += 1;
            let before = best;
            for (powers, by) in MOVES.iter().flat_map(|m| [(m, *factor), (m, 1.0 / factor)]) {
                let mut to = at;
                for (k, (least, most)) in self.figures.limits.iter().enumerate() {
                    to[k] = (to[k] * by.powi(powers[k])).clamp(*least, *most);
                }
                let found = self.one(&to, smooth);
                if found > best {
                    (best, at) = (found, to);
                }
            }
            if best < before + ENOUGH {
                which += 1;
            }
        }
        (best, self.with(&at, smooth))
    }
}

/// The noise by which these rows are most likely, whatever the parameters are, and the logarithm of that likelihood. `near`: where it was for values that
/// are not far from these.
pub(in crate::identify) fn noise_of(
    rows: &[Row],
    figures: &Figures,
    prior: Prior<'_>,
    known: Known,
    near: Option<&Noise>,
) -> (f64, Noise) {
    let search = Search { rows, figures, prior, known };
    let usual = figures.usual.map(|u| u.0);
    let start = |smooth: bool| match near {
        Some(n) if n.smooth == smooth => [n.sigma, n.walk, n.bounded.0, n.bounded.1],
        _ => usual,
    };
    let all = figures.smooth.iter().map(|smooth| search.from(*smooth, start(*smooth)));
    all.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_else(|| (f64::NEG_INFINITY, search.with(&usual, false)))
}
