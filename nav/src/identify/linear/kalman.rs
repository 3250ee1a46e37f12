//! The Kalman filter of the linear model.
//!
//! Measurements are taken one scalar at a time (Bierman 1977, section II.6): rows of a fix are independent once the
//! error of its stamp is a state. The covariance is written once per fix: until then the gains of a row come from the covariance
//! before the fix and the gains of the rows before it.

use super::rows::{Kind, Row};
use super::{Problem, STATES, index, variances};
use crate::effects::BiasWalk;
use crate::identify::noise::{HEIGHT_GAUSS_MARKOV, Noise};
use crate::linear::interval::Interval;
use crate::math::exp;
use pulp::{Arch, Scalar, Simd, WithSimd};

/// No fix is assumed to be better than this, m and m/s.
pub(super) const SIGMA_FLOOR: f64 = 0.01;

/// Rows of a fix: position, velocity, and at rest the rate.
pub(super) const MOST_ROWS: usize = 9;
/// Groups of them.
pub(super) const GROUPS: usize = 3;

/// A symmetric matrix over the states.
pub(super) type Square = [[f64; STATES]; STATES];
/// A vector over the states.
pub(super) type State = [f64; STATES];

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

/// The filter at one instant.
pub(super) struct Kalman<'a> {
    pub(super) x: State,
    pub(super) p: Square,
    noise: &'a Noise,
    walk: BiasWalk,
}

/// Squared normalised innovations of a fix: position, velocity, rate. The rows of a group are taken one after the other, so that what they
/// have in common counts once.
#[inline(always)]
pub(super) fn normalised_squares(rows: &[Row], updates: &[Update]) -> [f64; GROUPS] {
    let mut nis = [0.0; GROUPS];
    for (row, update) in rows.iter().zip(updates) {
        nis[row.group()] += update.y * update.y / update.s;
    }
    nis
}

/// Variance of the Gauss-Markov error per axis.
pub(super) fn gauss_markov_variance(noise: &Noise) -> [f64; 3] {
    let v = noise.gauss_markov_m * noise.gauss_markov_m;
    [v, v, v * HEIGHT_GAUSS_MARKOV * HEIGHT_GAUSS_MARKOV]
}

/// Variance of a row.
pub(super) fn row_variance(row: &Row, noise: &Noise) -> f64 {
    let scale = match row.kind {
        Kind::Horizontal => noise.position_scale,
        Kind::Height => noise.height_scale,
        Kind::Velocity => noise.velocity_scale,
        Kind::Place => 1.0,
        Kind::Rate => return (row.sigma * noise.gyro).powi(2) + row.least,
        Kind::Field => return row.sigma * row.sigma,
    };
    (row.sigma * scale).max(SIGMA_FLOOR).powi(2)
}

/// Runs with vector registers of the machine. Four numbers wide where there are wider ones too: that divides [`STATES`]. Nothing is
/// reordered or fused, so that the result is the same with any. What is to use them is a loop and not a closure: the compiler may make a
/// function of a closure, and that has no such registers.
pub(super) fn vectorised<O: WithSimd>(operation: O) -> O::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(four_wide) = pulp::x86::V3::try_new() {
        return Simd::vectorize(four_wide, operation);
    }
    Arch::new().dispatch(operation)
}

/// out ← out + scale × row.
#[inline(always)]
pub(super) fn add_scaled<S: Simd>(simd: S, out: &mut [f64], row: &[f64], scale: f64) {
    let ((out, out_end), (row, row_end)) = (S::as_mut_simd_f64s(out), S::as_simd_f64s(row));
    let by = simd.splat_f64s(scale);
    for (o, x) in out.iter_mut().zip(row) {
        *o = simd.add_f64s(*o, simd.mul_f64s(by, *x));
    }
    for (o, x) in out_end.iter_mut().zip(row_end) {
        *o += scale * x;
    }
}

/// Adds `scale(k) × row k` for all of these rows, three at a time.
#[inline(always)]
pub(super) fn add_rows<'r, S: Simd>(
    simd: S,
    out: &mut [f64],
    count: usize,
    row: impl Fn(usize) -> (&'r [f64], f64),
) {
    let mut k = 0;
    while k + 3 <= count {
        let ((a, p), (b, q), (c, r)) = (row(k), row(k + 1), row(k + 2));
        let (by_a, by_b, by_c) = (simd.splat_f64s(p), simd.splat_f64s(q), simd.splat_f64s(r));
        let ((a, a_end), (b, b_end), (c, c_end)) =
            (S::as_simd_f64s(a), S::as_simd_f64s(b), S::as_simd_f64s(c));
        let (wide, end) = S::as_mut_simd_f64s(out);
        for (((o, a), b), c) in wide.iter_mut().zip(a).zip(b).zip(c) {
            let sum = simd.add_f64s(*o, simd.mul_f64s(by_a, *a));
            *o = simd.add_f64s(simd.add_f64s(sum, simd.mul_f64s(by_b, *b)), simd.mul_f64s(by_c, *c));
        }
        for (((o, a), b), c) in end.iter_mut().zip(a_end).zip(b_end).zip(c_end) {
            *o = *o + p * a + q * b + r * c;
        }
        k += 3;
    }
    for k in k..count {
        let (row, scale) = row(k);
        add_scaled(simd, out, row, scale);
    }
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
    pub(super) fn gauss_markov(&self) -> ([State; 3], [f64; 3]) {
        let at = |k: usize| index::GAUSS_MARKOV + k;
        (std::array::from_fn(|k| self.p[at(k)]), std::array::from_fn(|k| self.x[at(k)]))
    }

    /// Means and rows of the covariance of some states.
    #[inline(always)]
    pub(super) fn prior<const N: usize>(&self, first: usize) -> ([f64; N], [State; N]) {
        (std::array::from_fn(|k| self.x[first + k]), std::array::from_fn(|k| self.p[first + k]))
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
    pub(super) fn predict<S: Simd>(&mut self, simd: S, interval: &Interval) {
        let decay = self.noise.decay(interval.dt);
        self.add_walk(interval.dt);
        let transition = &interval.transition;
        let mut half = [[0.0; STATES]; 9];
        for (i, half) in half.iter_mut().enumerate() {
            for (column, p) in transition.iter().zip(&self.p) {
                add_scaled(simd, half, p, column[i]);
            }
        }
        let mut x: [f64; 9] = interval.offset.into();
        for (column, own) in transition.iter().zip(&self.x) {
            add_scaled(simd, &mut x, column.as_slice(), *own);
        }
        let (gyro, accel) = variances(self.noise, interval);
        let q = interval.noise(gyro, accel);
        for (i, half) in half.iter().enumerate() {
            let mut row: [f64; 9] = q.column(i).into();
            for (column, h) in transition.iter().zip(half) {
                add_scaled(simd, &mut row, column.as_slice(), *h);
            }
            self.p[i][..9].copy_from_slice(&row);
            self.p[i][9..].copy_from_slice(&half[9..]);
        }
        for (k, row) in self.p.iter_mut().enumerate().skip(9) {
            (0..9).for_each(|i| row[i] = half[i][k]);
        }
        self.x[..9].copy_from_slice(&x);
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
        let lost = 1.0 - exp(-2.0 * dt / self.noise.correlation_s);
        for (k, v) in gauss_markov_variance(self.noise).into_iter().enumerate() {
            self.p[index::GAUSS_MARKOV + k][index::GAUSS_MARKOV + k] += v * lost;
        }
        self.p[index::STAMP] = [0.0; STATES];
        self.p.iter_mut().for_each(|row| row[index::STAMP] = 0.0);
        self.p[index::STAMP][index::STAMP] = self.noise.stamp_s.powi(2);
        self.x[index::STAMP] = 0.0;
    }

    /// Innovation of a scalar measurement and its variance.
    pub(super) fn innovation(&self, row: &Row) -> (f64, f64) {
        let r = row_variance(row, self.noise);
        (row.residual - row.dot(&self.x), r + row.dot(&row.times(Scalar, &self.p)))
    }

    /// All measurements of a fix; `updates` are then these.
    #[inline(always)]
    pub(super) fn correct<S: Simd>(&mut self, simd: S, rows: &[Row], updates: &mut Vec<Update>) {
        updates.clear();
        let mut less = [0.0; MOST_ROWS];
        for (row, less) in rows.iter().zip(&mut less) {
            let mut g = row.times(simd, &self.p);
            for u in updates.iter() {
                add_scaled(simd, &mut g, &u.g, -row.dot(&u.g) / u.s);
            }
            let y = row.residual - row.dot(&self.x);
            let r = row_variance(row, self.noise);
            let s = r + row.dot(&g);
            *less = -s.recip();
            add_scaled(simd, &mut self.x, &g, y / s);
            updates.push(Update { g, y, s, r });
        }
        for (i, p) in self.p.iter_mut().enumerate() {
            add_rows(simd, p, updates.len(), |k| (&updates[k].g, updates[k].g[i] * less[k]));
        }
    }
}
