//! Jumps at every instant of a linearised flight, and what it says of the noise of samples and fixes, on the way back over a run: a jump of a
//! state has the score r and the information N of the recursion of the disturbance smoother (de Jong & Penzer 1998, "Diagnosing shocks in
//! time series").

use super::backward::{Fix, back_over};
use super::forward::{Keep, Taped};
use super::imitation::Weight;
use super::kalman::{GROUPS, Update, add_scaled, vectorised};
use super::rows::{Kind, Row};
use super::{Problem, STATES, index, variances};
use crate::identify::noise::Noise;
use crate::identify::pass::Options;
use crate::identify::residual::{Disturbance, Residual};
use crate::linear::interval::Interval;
use nalgebra::{Matrix3, Matrix6, Vector3};
use pulp::{Simd, WithSimd};

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

impl Problem {
    /// Score and information of a jump between any two fixes, of the gyro biases and of the fixes' position.
    pub fn shocks(&self, noise: &Noise, options: &Options) -> Vec<Shock> {
        let (_, tape) = self.run_keeping(noise, options, Keep::Updates);
        let mut back = Shocks::default();
        let mut out: Vec<Shock> = Vec::with_capacity(self.len());
        for (fix, taped) in self.taken_back(&tape).zip(tape.fixes.iter().rev()) {
            let epoch = fix.epoch;
            let gyro = back.block(index::GYRO_BIAS);
            back.fix(&fix, weights_where(self.part(epoch, options) == Some(0), taped));
            out.push(Shock { t_s: epoch.t_s, gyro, fix: back.block(STATES) });
            back.predict(&epoch.interval, noise.decay(epoch.interval.dt));
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
                let said = back.fix(&fix, weights_where(self.part(fix.epoch, options) == Some(part), taped));
                let rows = said.into_iter().map(|said| said.1).collect();
                let end = of_samples(&back);
                back.predict(interval, noise.decay(interval.dt));
                out.push(Weight { samples: (of_samples(&back) + end) * (0.5 * interval.dt), rows });
            }
            out.reverse();
            out
        })
    }

    /// The disturbances and measurement errors that the whole flight speaks for, fix by fix: means of what the sensors measured since
    /// the fix before less what the smoothed trajectory says, and the rows of the fix less the same; by the channels of
    /// [`crate::identify::residual::CHANNELS`]. Under a right model they have the variance that stands beside them (de Jong & Penzer 1998,
    /// "Diagnosing shocks in time series"). With them what the biases of gyros and accelerometers have walked since the fix before, by the
    /// smoothed means of their disturbances (Durbin & Koopman 2012, eq. 4.47).
    pub fn disturbances(&self, noise: &Noise) -> Vec<Disturbance> {
        let (_, tape) = self.run_keeping(noise, &Options::default(), Keep::Updates);
        let mut back = Shocks::default();
        let mut out = Vec::with_capacity(self.len());
        for fix in self.taken_back(&tape) {
            let interval = &fix.epoch.interval;
            let (mut residuals, mut rates) = ([None; 12], [None; 3]);
            let said = back.fix(&fix, [1.0; GROUPS]);
            for ((row, update), (u, spread)) in fix.rows.iter().zip(fix.updates).zip(said).rev() {
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
            let walked = [(self.walk.gyro, index::GYRO_BIAS), (self.walk.accel, index::ACCEL_BIAS)]
                .map(|(walk, at)| back.block(at).0 * (walk * walk * interval.dt));
            out.push(Disturbance { residuals, walked });
            back.predict(interval, noise.decay(interval.dt));
        }
        out.reverse();
        out
    }
}

/// The weights of a fix's groups where it counts.
fn weights_where(counts: bool, taped: &Taped) -> [f64; GROUPS] {
    if counts { taped.weights } else { [0.0; GROUPS] }
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
    /// Back over a fix as it was weighted, with what the whole flight says of each of its rows ([`BackOverFix::update`]).
    fn fix(&mut self, fix: &Fix<'_>, weights: [f64; GROUPS]) -> Vec<(f64, f64)> {
        vectorised(BackOverFix { shocks: self, fix, weights })
    }

    fn predict(&mut self, interval: &Interval, decay: f64) {
        vectorised(BackOverInterval { shocks: self, interval, decay });
    }

    fn block(&self, at: usize) -> (Vector3<f64>, Matrix3<f64>) {
        (Vector3::from_fn(|i, _| self.r[at + i]), Matrix3::from_fn(|i, j| self.n[at + i][at + j]))
    }
}

struct BackOverInterval<'a> {
    shocks: &'a mut Shocks,
    interval: &'a Interval,
    decay: f64,
}

impl WithSimd for BackOverInterval<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        back_over(simd, self.interval, self.decay, &mut self.shocks.r, &mut self.shocks.n);
    }
}

struct BackOverFix<'a, 't> {
    shocks: &'a mut Shocks,
    fix: &'a Fix<'t>,
    weights: [f64; GROUPS],
}

impl WithSimd for BackOverFix<'_, '_> {
    type Output = Vec<(f64, f64)>;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> Self::Output {
        let rows = self.fix.rows.iter().zip(self.fix.updates);
        let mut said = Vec::with_capacity(self.fix.rows.len());
        for (row, update) in rows.rev() {
            said.push(self.update(simd, row, update));
        }
        said.reverse();
        said
    }
}

impl BackOverFix<'_, '_> {
    /// Back over one scalar update. With L = I − K h: r ← hᵀ y w/s + Lᵀ r, N ← hᵀ h w/s + Lᵀ N L. Returns what the whole flight says
    /// of this measurement's error over its variance, y w/s − Kᵀ r, with the variance of that, w/s + Kᵀ N K.
    #[inline(always)]
    fn update<S: Simd>(&mut self, simd: S, row: &Row, u: &Update) -> (f64, f64) {
        let Shocks { r, n } = &mut *self.shocks;
        let weight = self.weights[row.group()];
        let mut h = [0.0; JUMPING];
        h[..STATES].copy_from_slice(&row.dense());
        if let Some(axis) = row.position_axis() {
            h[STATES + axis] = 1.0;
        }
        let mut gain = [0.0; JUMPING];
        gain[..STATES].copy_from_slice(&u.g);
        gain.iter_mut().for_each(|k| *k /= u.s);
        let along: f64 = r.iter().zip(&gain).map(|(r, k)| r * k).sum();
        let mut nk = [0.0; JUMPING];
        for (n, k) in n.iter().zip(&gain).take(STATES) {
            add_scaled(simd, &mut nk, n, *k);
        }
        let knk: f64 = nk.iter().zip(&gain).map(|(n, k)| n * k).sum();
        let (says, spread) = (weight * u.y / u.s - along, weight / u.s + knk);
        add_scaled(simd, r, &h, says);
        for (i, n) in n.iter_mut().enumerate() {
            if h[i] != 0.0 {
                add_scaled(simd, n, &h, h[i] * spread);
                add_scaled(simd, n, &nk, -h[i]);
            }
            add_scaled(simd, n, &h, -nk[i]);
        }
        (says, spread)
    }
}
