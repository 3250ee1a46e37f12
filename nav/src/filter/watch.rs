//! How the innovations of a filter would change with parameters that it does not estimate.
//!
//! The error of the filter splits into δx = δx₀ + U θ, where θ are the parameters of effects that the model lacks (or
//! holds at a wrong value). U obeys the filter's own recursion: U ← Φ U + B between fixes and U ← U − K (H U + D) at a
//! fix, whose innovations are r = r₀ + (H U + D) θ (Friedland 1969, "Treatment of bias in recursive filtering";
//! Willsky & Jones 1976 for jumps). So one run of the filter gives the score and the information of every effect of
//! the catalogue at once. It knows nothing of likelihoods or of choosing.

use super::calibration::Calibration;
use super::covariance::NAV;
use super::group::Rows;
use super::layout::{Layout, index};
use crate::effects::{FixInstant, Instant, MAX_PARAMETERS};
use crate::mechanization::{Increment, Motion};
use crate::model::{EffectSetting, Model};
use crate::rotation::{exp, skew};
use crate::sample::{ImuSample, SampleKind};
use nalgebra::{Matrix3, Vector3};

/// A term of the sparse regression: a disturbance of one sensor axis in proportion to a product of motion.
#[derive(Debug, Clone, Copy)]
pub struct Term {
    /// 0 … 2: gyro x, y, z; 3 … 5: accelerometer x, y, z.
    pub channel: usize,
    /// What it is proportional to.
    pub regressor: fn(&Regressors) -> f64,
}

/// What a term may depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Regressors {
    /// Specific force, m/s².
    pub force: Vector3<f64>,
    /// Angular rate, rad/s.
    pub rate: Vector3<f64>,
    /// Above 25 °C.
    pub temperature_above_25_degc: f64,
    /// Speed over ground, m/s.
    pub speed: f64,
    /// Time since the start of the filter, s.
    pub elapsed_s: f64,
}

/// What is watched.
#[derive(Debug, Clone, Default)]
pub struct Watched {
    /// Effects with the values about which they are linearised; every parameter that can be a state is watched.
    pub effects: Vec<EffectSetting>,
    /// Terms outside the catalogue.
    pub terms: Vec<Term>,
    /// Times of jumps of the gyro biases, ascending, s.
    pub gyro_jumps_s: Vec<f64>,
    /// Times of jumps of the fixes' position, ascending, s.
    pub fix_jumps_s: Vec<f64>,
}

impl Watched {
    /// Effect and parameter of each of the first columns.
    pub fn slots(&self) -> Vec<(usize, usize)> {
        let mut slots = Vec::new();
        for (e, setting) in self.effects.iter().enumerate() {
            slots.extend(setting.states().map(|p| (e, p)));
        }
        slots
    }

    /// What each watched parameter of the effects does to the rate and the force that are read off the samples, appended to
    /// `columns`.
    pub(crate) fn imu_columns(&self, x: &Instant, columns: &mut Vec<[Vector3<f64>; 2]>) {
        for setting in &self.effects {
            let n = setting.effect.len();
            let (mut gyro, mut accel) =
                ([Vector3::zeros(); MAX_PARAMETERS], [Vector3::zeros(); MAX_PARAMETERS]);
            setting.effect.imu_jacobian(&setting.values, x, &mut gyro[..n], &mut accel[..n]);
            columns.extend(setting.states().map(|k| [-gyro[k], -accel[k]]));
        }
    }
}

/// One innovation, whitened: residual and what each watched parameter adds to it, in sigmas.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WatchedRow {
    /// Whitened innovation.
    pub residual: f64,
    /// Its derivative by each column: effects, terms, three per gyro jump, three per fix jump.
    pub sensitivity: Vec<f64>,
}

/// The recursion.
#[derive(Debug, Clone)]
pub struct Watch {
    watched: Watched,
    slots: Vec<(usize, usize)>,
    start_s: Option<f64>,
    columns: usize,
    driven: usize,
    /// n × columns, row by row.
    u: Vec<f64>,
    /// Since the last fix: 9 × n and 9 × driven.
    phi: Vec<f64>,
    drive: Vec<f64>,
    decay: f64,
    /// Effect of each driven column on rate and force at both ends of the step.
    start: Vec<[Vector3<f64>; 2]>,
    end: Vec<[Vector3<f64>; 2]>,
    scratch: Vec<f64>,
    gyro_jumps_begun: usize,
    rows: Vec<WatchedRow>,
}

impl Watch {
    /// For a filter of this layout.
    pub fn new(watched: Watched, layout: &Layout) -> Self {
        let slots = watched.slots();
        let driven = slots.len() + watched.terms.len();
        let columns = driven + 3 * (watched.gyro_jumps_s.len() + watched.fix_jumps_s.len());
        let mut watch = Self {
            u: vec![0.0; layout.len() * columns],
            phi: vec![0.0; NAV * layout.len()],
            drive: vec![0.0; NAV * driven],
            decay: 1.0,
            start: Vec::new(),
            end: vec![[Vector3::zeros(); 2]; driven],
            scratch: Vec::new(),
            gyro_jumps_begun: 0,
            rows: Vec::new(),
            start_s: None,
            slots,
            columns,
            driven,
            watched,
        };
        watch.begin_interval(layout.len());
        watch
    }

    /// The whitened innovations since the last call, in the order of the filter's rows.
    pub fn take_rows(&mut self) -> Vec<WatchedRow> {
        std::mem::take(&mut self.rows)
    }

    fn begin_interval(&mut self, n: usize) {
        self.phi.fill(0.0);
        (0..NAV).for_each(|i| self.phi[i * n + i] = 1.0);
        self.drive.fill(0.0);
        self.decay = 1.0;
    }

    /// ∂motion/∂θ at a sample: what the effect adds to the sensors is missing in the motion.
    pub(super) fn sample(
        &mut self,
        sample: &ImuSample,
        motion: &Motion,
        speed: f64,
        calibration: &Calibration,
        model: &Model,
    ) {
        std::mem::swap(&mut self.start, &mut self.end);
        self.end.clear();
        let temperature = sample.temperature_degc.map_or(0.0, |t| t - 25.0);
        let x = Instant {
            t_s: sample.t_s,
            rate: motion.rate,
            force: motion.force,
            temperature_above_25_degc: temperature,
            around: calibration.around,
        };
        self.watched.imu_columns(&x, &mut self.end);
        let begun = *self.start_s.get_or_insert(sample.t_s);
        let regressors = Regressors {
            force: motion.force,
            rate: motion.rate,
            temperature_above_25_degc: temperature,
            speed,
            elapsed_s: sample.t_s - begun,
        };
        for term in &self.watched.terms {
            let mut column = [Vector3::zeros(); 2];
            column[term.channel / 3 % 2][term.channel % 3] = -(term.regressor)(&regressors);
            self.end.push(column);
        }
        // An accelerometer error passes through the g-sensitivity that the model knows of.
        let mut by_force = Matrix3::zeros();
        for (setting, p) in model.effects.iter().zip(calibration.parameters()) {
            by_force += setting.effect.gyro_by_force(p, &x).unwrap_or_default();
        }
        if by_force != Matrix3::zeros() {
            self.end.iter_mut().for_each(|[rate, force]| *rate -= by_force * *force);
        }
        if self.start.len() != self.end.len() {
            self.start.clone_from(&self.end);
        }
    }

    /// One step of the filter with its nine rows of Φ.
    pub(super) fn propagate(&mut self, phi: &[f64], inc: &Increment, kind: SampleKind, decay: f64) {
        let n = phi.len() / NAV;
        let (d, dt) = (self.driven, inc.dt);
        let mut next = std::mem::take(&mut self.scratch);
        next.clear();
        next.resize(NAV * (n + d), 0.0);
        let (next_phi, next_drive) = next.split_at_mut(NAV * n);
        for i in 0..NAV {
            let row = &phi[i * n..(i + 1) * n];
            let (out, drive) = (&mut next_phi[i * n..(i + 1) * n], &mut next_drive[i * d..(i + 1) * d]);
            for (k, c) in row.iter().enumerate().take(NAV).filter(|(_, c)| **c != 0.0) {
                add_scaled(out, &self.phi[k * n..(k + 1) * n], *c);
                add_scaled(drive, &self.drive[k * d..(k + 1) * d], *c);
            }
            out[NAV..].iter_mut().zip(&row[NAV..]).for_each(|(o, c)| *o += c);
        }
        self.phi.copy_from_slice(next_phi);
        self.drive.copy_from_slice(next_drive);
        self.scratch = next;
        self.decay *= decay;
        // The same integrals as those of the filter's own constants.
        let to_end = exp(&-inc.dtheta).to_rotation_matrix().into_inner();
        let half_turn = Matrix3::identity() + skew(&inc.dtheta) * 0.5;
        for (k, end) in self.end.iter().enumerate() {
            let start = if kind == SampleKind::Point { &self.start[k] } else { end };
            let (rate, force) = ((start[0] + end[0]) * 0.5, (start[1] + end[1]) * 0.5);
            if rate == Vector3::zeros() && force == Vector3::zeros() {
                continue;
            }
            let dtheta = half_turn * rate * dt;
            let dvel = half_turn * force * dt - inc.dv.cross(&dtheta) * 0.5;
            let dpos = force * (0.5 * dt * dt) - inc.dp.cross(&dtheta) / 3.0;
            for (row, v) in [(index::POSITION, dpos), (index::VELOCITY, dvel), (index::ATTITUDE, dtheta)] {
                let turned = to_end * v;
                for i in 0..3 {
                    self.drive[(row + i) * d + k] += turned[i];
                }
            }
        }
    }

    /// Brings U to the time of a fix.
    pub(super) fn reach_fix(&mut self, t_s: f64, layout: &Layout) {
        let (n, m, d) = (layout.len(), self.columns, self.driven);
        let mut nav = std::mem::take(&mut self.scratch);
        nav.clear();
        nav.resize(NAV * m, 0.0);
        for (i, out) in nav.chunks_exact_mut(m.max(1)).enumerate().take(NAV) {
            for (k, c) in self.phi[i * n..(i + 1) * n].iter().enumerate().filter(|(_, c)| **c != 0.0) {
                add_scaled(out, &self.u[k * m..(k + 1) * m], *c);
            }
            add_scaled(&mut out[..d], &self.drive[i * d..(i + 1) * d], 1.0);
        }
        self.u[..NAV * m].copy_from_slice(&nav);
        self.scratch = nav;
        if let Some(w) = layout.gauss_markov() {
            self.u[w * m..(w + 3) * m].iter_mut().for_each(|v| *v *= self.decay);
        }
        self.begin_interval(n);
        // A jump of a bias is an impulse on the bias error.
        let jumps = &self.watched.gyro_jumps_s;
        while jumps.get(self.gyro_jumps_begun).is_some_and(|t| *t <= t_s) {
            let column = d + 3 * self.gyro_jumps_begun;
            (0..3).for_each(|k| self.u[(index::GYRO_BIAS + k) * m + column + k] = 1.0);
            self.gyro_jumps_begun += 1;
        }
    }

    /// ∂row/∂θ of a group of rows at the filter's present state: H U + D.
    pub(super) fn sensitivity(&self, rows: &Rows, position: bool, x: &FixInstant) -> Vec<Vec<f64>> {
        let m = self.columns;
        let mut direct = vec![Vector3::zeros(); self.slots.len()];
        let mut at = 0;
        for (e, setting) in self.watched.effects.iter().enumerate() {
            let n = setting.effect.len();
            let mut columns = [[Vector3::zeros(); MAX_PARAMETERS]; 2];
            let [p, v] = &mut columns;
            setting.effect.fix_jacobian(&setting.values, x, &mut p[..n], &mut v[..n]);
            while let Some((_, parameter)) = self.slots.get(at).filter(|s| s.0 == e) {
                direct[at] = if position { p[*parameter] } else { v[*parameter] };
                at += 1;
            }
        }
        let first_fix_jump = self.driven + 3 * self.watched.gyro_jumps_s.len();
        (0..rows.dof)
            .map(|i| {
                let mut out = vec![0.0; m];
                for (k, by) in &rows.h {
                    add_scaled(&mut out, &self.u[k * m..(k + 1) * m], by[i]);
                }
                out.iter_mut().zip(&direct).for_each(|(o, column)| *o += column[i]);
                if position {
                    for (j, _) in self.watched.fix_jumps_s.iter().enumerate().filter(|(_, t)| **t <= x.t_s) {
                        out[first_fix_jump + 3 * j + i] += 1.0;
                    }
                }
                out
            })
            .collect()
    }

    /// U ← U − K s, and the whitened rows for whoever asks; `gain` is K by rows of the group.
    pub(super) fn absorb(
        &mut self,
        sensitivity: &[Vec<f64>],
        residual: &[f64],
        gain: &[Vec<f64>],
        l: &[[f64; 3]; 3],
    ) {
        let m = self.columns;
        for (row, k) in sensitivity.iter().zip(gain) {
            for (out, g) in self.u.chunks_exact_mut(m.max(1)).zip(k).filter(|(_, g)| **g != 0.0) {
                add_scaled(out, row, -g);
            }
        }
        let first = self.rows.len();
        for (i, (row, r)) in sensitivity.iter().zip(residual).enumerate() {
            let mut white = WatchedRow { residual: *r, sensitivity: row.clone() };
            for (j, c) in l[i].iter().enumerate().take(i) {
                white.residual -= c * self.rows[first + j].residual;
                add_scaled(&mut white.sensitivity, &self.rows[first + j].sensitivity, -*c);
            }
            let scale = 1.0 / l[i][i];
            white.residual *= scale;
            white.sensitivity.iter_mut().for_each(|s| *s *= scale);
            self.rows.push(white);
        }
    }

    /// The change of coordinates of a correction.
    pub(super) fn transform_nav(&mut self, by: &[[f64; NAV]; NAV]) {
        let m = self.columns;
        let mut nav = vec![0.0; NAV * m];
        for (i, out) in nav.chunks_exact_mut(m.max(1)).enumerate().take(NAV) {
            for (k, c) in by[i].iter().enumerate().filter(|(_, c)| **c != 0.0) {
                add_scaled(out, &self.u[k * m..(k + 1) * m], *c);
            }
        }
        self.u[..NAV * m].copy_from_slice(&nav);
    }
}

fn add_scaled(out: &mut [f64], row: &[f64], scale: f64) {
    out.iter_mut().zip(row).for_each(|(o, x)| *o += scale * x);
}
