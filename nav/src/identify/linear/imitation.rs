//! What noise of the samples alone can make of a score.
//!
//! A column of a watched parameter is driven by samples, and so by their noise; the same noise is in the trajectory, so that the two are
//! correlated: errors in variables (Carroll, Ruppert, Stefanski & Crainiceanu 2006, "Measurement error in nonlinear models", chapter 3). A closed
//! loop correlates them over time, too: the vehicle answers to what its gyros show. With L = ∫ Bᵀ Φᵀ Λ Φ B dt, Λ the information that
//! the fixes after an instant have on an error there (de Jong & Penzer 1998), and J the derivative of the column by the samples, the noise
//! of a sensor with the variance q per hertz has the share W = q tr L of the innovations and E = q tr(L J Jᵀ) of the column's information.
//! By the Cauchy-Schwarz inequality it moves the score by no more than √(E W), whatever the correlation. Where gyros and accelerometers do so by
//! themselves, that is the sum of both squares: a variance that the score has beside its information.

use super::rows::{Kind, Row};
use super::{Epoch, Problem, variances};
use crate::effects::{ActsOn, FixInstant, Instant};
use crate::filter::force_rate::{self, RATE_CHANGE_DENSITY};
use crate::identify::noise::Noise;
use crate::identify::pass::Options;
use crate::identify::watched::Watched;
use crate::linear::fix;
use nalgebra::{DVector, Matrix6, SMatrix, Vector3};

/// Angular rate, specific force, and how fast the rate changes.
const INPUTS: usize = 9;

/// How noise of the samples drives the columns of the watched parameters over an interval and at the fix after it.
#[derive(Debug, Clone, Default)]
pub(super) struct Driven {
    /// Derivative of what each does to rate and force by what drives it.
    samples: Vec<SMatrix<f64, 6, INPUTS>>,
    /// What noise of the rate and of how fast the specific force changes make of each row of the fix, row after row: squares, per
    /// variance per hertz of gyros and accelerometers.
    fix: Vec<[f64; 2]>,
}

impl Driven {
    /// Whether noise was asked for.
    pub(super) fn is_known(&self) -> bool {
        !self.samples.is_empty()
    }
}

/// Samples are asked where both gyros and accelerometers show more noise than this, rad/s/√Hz and m/s²/√Hz. PX4's simulator has .0058 to .0061 and .080
/// to .085: its noise alone put the scores of scale factors and of products of forces 6 to 10 sigma off. What vibrates shows as much in the accelerometers, but fast,
/// and no name was wrong: a recorded copter .0038 and .064, an airplane .0029 and .026, a simulated one .0008 and .064. There the bound would hide effects that are there.
const STRONG: [f64; 2] = [5e-3, 0.05];
/// Steps of the derivatives: exact for products of two, rad/s, m/s², rad/s².
const STEPS: [f64; 3] = [0.01, 0.1, 0.1];

/// Whether noise with these variances per hertz (gyros, accelerometers) is strong enough to be asked.
pub(in crate::identify) fn is_strong((gyro, accel): (f64, f64)) -> bool {
    gyro > STRONG[0] * STRONG[0] && accel > STRONG[1] * STRONG[1]
}

/// By how much noise of the samples, which come every `sample_s`, moves each column: at the end of an interval and at a fix with these rows.
pub(super) fn driven(
    watched: &Watched,
    x: &Instant,
    fix: &FixInstant,
    (rows, sample_s): (&[Row], f64),
) -> Driven {
    let per_hertz = [sample_s.recip(), force_rate::noise(1.0).powi(2)];
    let squares = [0, 1].map(|input| by_fix(watched, fix, rows, input));
    let [by_rate, by_force_rate] = squares;
    let fix = by_rate.iter().zip(&by_force_rate).map(|(r, f)| [r * per_hertz[0], f * per_hertz[1]]).collect();
    Driven { samples: by_samples(watched, x), fix }
}

/// Squared derivative of each row by the rate (0) or by how fast the specific force changes (1), row after row. The acceleration itself is
/// not asked: the unknown offset of all stamps does what its noise does.
fn by_fix(watched: &Watched, x: &FixInstant, rows: &[Row], input: usize) -> Vec<f64> {
    let moved = |axis: usize, by: f64| {
        let mut moved = *x;
        if input == 0 {
            moved.rate_eb[axis] += by
        } else {
            moved.force_rate[axis] += by
        }
        moved
    };
    let each: usize = watched.effects.iter().map(|s| s.states().count()).sum();
    let mut squares = vec![0.0; rows.len() * each];
    for axis in 0..3 {
        // Steps of ± 1/2: the columns are quadratic at most.
        let (more, less) = (moved(axis, 0.5), moved(axis, -0.5));
        let mut first = 0;
        for s in &watched.effects {
            if s.effect.acts_on(ActsOn::Fixes) {
                let (up, down) = (fix::columns(s, &s.values, &more), fix::columns(s, &s.values, &less));
                for (row, squares) in rows.iter().zip(squares.chunks_exact_mut(each.max(1))) {
                    // Places and rates of a unit that rests have no derivative by what drives a fix.
                    if !row.is_position() && row.kind != Kind::Velocity {
                        continue;
                    }
                    let (up, down) = (&up[row.group()], &down[row.group()]);
                    for (p, square) in s.states().zip(&mut squares[first..]) {
                        *square += (up[p][row.axis] - down[p][row.axis]).powi(2);
                    }
                }
            }
            first += s.states().count();
        }
    }
    squares
}

fn by_samples(watched: &Watched, x: &Instant) -> Vec<SMatrix<f64, 6, INPUTS>> {
    let mut out = Vec::new();
    let [mut up, mut down] = [const { Vec::<[Vector3<f64>; 2]>::new() }; 2];
    for input in 0..INPUTS {
        let (axis, step) = (input % 3, STEPS[input / 3]);
        for (by, columns) in [(step, &mut up), (-step, &mut down)] {
            let mut moved = *x;
            match input / 3 {
                0 => moved.rate[axis] += by,
                1 => moved.force[axis] += by,
                _ => moved.around.rate_derivatives[0][axis] += by,
            }
            columns.clear();
            watched.columns(&moved, columns);
        }
        out.resize(up.len(), SMatrix::zeros());
        for ((by, up), down) in out.iter_mut().zip(&up).zip(&down) {
            for channel in 0..6 {
                by[(channel, input)] =
                    (up[channel / 3][channel % 3] - down[channel / 3][channel % 3]) / (2.0 * step);
            }
        }
    }
    out
}

/// What the fixes of one part tell of an interval and the fix at its end.
#[derive(Debug, Clone)]
pub(super) struct Weight {
    /// L: of errors of gyros and accelerometers.
    pub(super) samples: Matrix6<f64>,
    /// Of an error of each row of the fix.
    pub(super) rows: Vec<f64>,
}

/// What it comes to over a flight, for one part of its fixes.
pub(super) struct Imitation {
    /// Fix by fix: what the flight tells of errors of gyros and accelerometers before it, and of its rows.
    weights: Vec<Weight>,
    next: usize,
    /// E of each column, by noise of the gyros and by that of the accelerometers.
    columns: [DVector<f64>; 2],
    /// W of either.
    innovations: [f64; 2],
}

impl Imitation {
    /// Of both parts, before the first fix. `problem` is the whole flight; what it watches does not count.
    pub(super) fn of_parts(problem: &Problem, noise: &Noise, options: &Options, columns: usize) -> [Self; 2] {
        problem.noise_weights(noise, options).map(|weights| Self {
            weights,
            next: 0,
            columns: [0, 1].map(|_| DVector::zeros(columns)),
            innovations: [0.0; 2],
        })
    }

    /// On over these fixes.
    pub(super) fn take(&mut self, epoch: &Epoch, noise: &Noise) {
        let Some(weight) = self.weights.get(self.next) else { return };
        self.next += 1;
        let (gyro, accel) = variances(noise, &epoch.interval);
        let Weight { samples: weight, rows } = weight;
        let own = |first: usize| (first..first + 3).map(|k| weight[(k, k)]).sum::<f64>();
        self.innovations[0] += gyro * own(0);
        self.innovations[1] += accel * own(3);
        let variance = |input: usize| [gyro, accel, gyro * RATE_CHANGE_DENSITY][input / 3];
        for (k, by) in epoch.driven.samples.iter().enumerate() {
            for (input, column) in by.column_iter().enumerate().filter(|(_, c)| c.iter().any(|v| *v != 0.0)) {
                self.columns[(input / 3) % 2][k] += variance(input) * column.dot(&(weight * column));
            }
        }
        let each = epoch.driven.fix.len() / epoch.measured.rows.len().max(1);
        for (weight, squares) in rows.iter().zip(epoch.driven.fix.chunks_exact(each.max(1))) {
            for (k, [by_gyro, by_accel]) in squares.iter().enumerate() {
                self.columns[0][k] += weight * gyro * by_gyro;
                self.columns[1][k] += weight * accel * by_accel;
            }
        }
    }

    /// The variance that each score has beside its information.
    pub(super) fn end(self) -> DVector<f64> {
        let [gyro, accel] = self.innovations;
        let [by_gyro, by_accel] = self.columns;
        by_gyro * gyro + by_accel * accel
    }
}
