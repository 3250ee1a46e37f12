//! One run of the ordinary filter over a flight: the likelihood of the innovations, the innovations themselves, and for watched
//! parameters score and information.

use super::flight::Flight;
use super::noise::Noise;
use crate::filter::watch::{Watched, WatchedRow};
use crate::filter::{Filter, Fusion, Group};
use crate::model::Model;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Squared normalised innovations of a group count linearly beyond this (Huber's function of the norm).
const HUBER: f64 = 25.0;

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

/// Score and information of the watched parameters of one part.
#[derive(Debug, Clone, PartialEq)]
pub struct Information {
    /// Σ sᵀ r of effects and terms.
    pub score: DVector<f64>,
    /// Σ sᵀ s.
    pub matrix: DMatrix<f64>,
    /// The same of each jump alone: gyro jumps first.
    pub jumps: Vec<(Vector3<f64>, Matrix3<f64>)>,
}

impl Information {
    /// None yet.
    pub fn zeros(columns: usize, jumps: usize) -> Self {
        Self {
            score: DVector::zeros(columns),
            matrix: DMatrix::zeros(columns, columns),
            jumps: vec![(Vector3::zeros(), Matrix3::zeros()); jumps],
        }
    }

    /// Adds that of another part or flight.
    pub fn add(&mut self, other: &Self) {
        self.score += &other.score;
        self.matrix += &other.matrix;
        for (a, b) in self.jumps.iter_mut().zip(&other.jumps) {
            a.0 += b.0;
            a.1 += b.1;
        }
    }

    /// Adds a whitened innovation with its derivative by every parameter.
    #[inline(always)]
    pub(super) fn take(&mut self, s: &[f64], residual: f64, weight: f64) {
        let n = self.score.len();
        for i in 0..n {
            let w = weight * s[i];
            if w != 0.0 {
                self.score[i] += w * residual;
                // The upper triangle, column by column, is filled; `finish` mirrors it.
                self.matrix.column_mut(i).iter_mut().zip(s).take(i + 1).for_each(|(m, x)| *m += w * x);
            }
        }
        for (jump, s) in self.jumps.iter_mut().zip(s[n..].chunks_exact(3)) {
            if s.iter().any(|v| *v != 0.0) {
                let v = Vector3::from_column_slice(s);
                jump.0 += v * (weight * residual);
                jump.1 += v * v.transpose() * weight;
            }
        }
    }

    /// The same for several of them without jumps: derivatives, innovation and weight of each. Three at a time, so that the matrix is
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
                    let column = self.matrix.column_mut(i);
                    for (((m, a), b), c) in column.into_iter().zip(a).zip(b).zip(c).take(i + 1) {
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

    /// Fills what [`Self::take`] left out by symmetry.
    pub(super) fn finish(&mut self) {
        self.matrix.fill_lower_triangle_with_upper_triangle();
    }
}

/// The result of a run.
#[derive(Debug, Clone)]
pub struct Pass {
    /// Logarithm of the (robust) likelihood: fit part, held-out part.
    pub log_likelihood: [f64; 2],
    /// Squared normalised innovations and their number of rows, by part and position/velocity.
    pub nis: [[(f64, usize); 2]; 2],
    /// Every fix.
    pub innovations: Vec<Innovation>,
    /// Watched parameters: fit part, held-out part.
    pub information: Option<[Information; 2]>,
    /// The filter at the end.
    pub filter: Filter,
}

impl Pass {
    /// Mean squared normalised innovation per degree of freedom of a part.
    pub fn nis_per_dof(&self, part: usize) -> f64 {
        let [(a, n), (b, m)] = self.nis[part];
        (a + b) / (n + m).max(1) as f64
    }
}

/// What is left of the likelihood of a group when far-off innovations count less, and the weight of its rows.
fn robust(group: &Group) -> (f64, f64) {
    if group.dof == 0 || !group.nis.is_finite() {
        return (0.0, 0.0);
    }
    // What the filter capped is put back.
    let ln_det = -2.0 * group.log_likelihood - capped(group);
    if group.nis <= HUBER {
        return (-0.5 * (group.nis + ln_det), 1.0);
    }
    let distance = (group.nis / HUBER).sqrt();
    (-0.5 * (HUBER * (2.0 * distance - 1.0) + ln_det), 1.0 / distance)
}

fn capped(group: &Group) -> f64 {
    group.nis.min(crate::filter::gate(group.dof))
}

/// The filter of `model` with this noise at the start of a flight, and how its samples are read.
pub(crate) fn at_start(flight: &Flight, model: &Model, noise: &Noise) -> Filter {
    let model = noise.of(model);
    let mut filter = Filter::new(&model, flight.initial());
    filter.set_stream(flight.stream().kind, flight.rounding(&model).at(flight.initial().t_s));
    filter.set_gating(false);
    filter.set_force_rates(flight.force_rates().clone());
    filter.set_stamp_sigma(noise.stamp_s);
    filter
}

/// Runs the filter of `model` with this noise. The same fixes count for every model.
pub fn run(
    flight: &Flight,
    model: &Model,
    noise: &Noise,
    options: &Options,
    watched: Option<&Watched>,
) -> Pass {
    let mut filter = at_start(flight, model, noise);
    let mut information = None;
    if let Some(w) = watched {
        let columns = w.slots().len() + w.terms.len();
        let jumps = w.gyro_jumps_s.len() + w.fix_jumps_s.len();
        information = Some([Information::zeros(columns, jumps), Information::zeros(columns, jumps)]);
        filter.watch(w.clone());
    }
    // Nothing is run again: likelihoods must be smooth in the model's parameters, and a watch takes each fix once.
    let mut fusion = Fusion::without_window(filter);
    let mut pass = Pass {
        log_likelihood: [0.0; 2],
        nis: [[(0.0, 0); 2]; 2],
        innovations: Vec::with_capacity(flight.fixes().len()),
        information,
        filter: fusion.filter().clone(),
    };
    let mut since_s = flight.initial().t_s;
    let mut fixes = flight.fixes().iter().peekable();
    let (start_s, kind, rounding) = (flight.initial().t_s, flight.stream().kind, flight.rounding(model));
    for sample in flight.samples_of(model).iter() {
        fusion.filter_mut().set_stream(kind, rounding.at(sample.t_s));
        while let Some(fix) = fixes.next_if(|f| f.t_s <= sample.t_s) {
            fusion.push_fix(scaled(fix, noise));
        }
        fusion.push_imu(*sample);
        while let Some(outcome) = fusion.poll() {
            let innovation = Innovation {
                t_s: outcome.t_s,
                elapsed_s: outcome.t_s - start_s,
                // By the stamp, so that a delay moves no fix to another part.
                part: options.part(outcome.stamp_s - start_s),
                position: outcome.position,
                velocity: outcome.velocity,
            };
            let rows = fusion.filter_mut().watch_mut().map(|w| w.take_rows());
            pass.count(&innovation, rows);
            if let Some(nav) = flight.guessed(since_s, outcome.t_s, fusion.filter().nav()) {
                fusion.filter_mut().set_nav(nav);
            }
            since_s = outcome.t_s;
        }
    }
    if let Some(parts) = &mut pass.information {
        parts.iter_mut().for_each(Information::finish);
    }
    pass.filter = fusion.filter().clone();
    pass
}

/// The fix with its own sigmas scaled as the noise says.
pub(crate) fn scaled(fix: &crate::sample::GnssFix, noise: &Noise) -> crate::sample::GnssFix {
    let mut fix = *fix;
    fix.position_sigma_m = fix
        .position_sigma_m
        .map(|[n, e, d]| [n * noise.position_scale, e * noise.position_scale, d * noise.height_scale]);
    fix.velocity_sigma_m_per_s = fix.velocity_sigma_m_per_s.map(|s| s.map(|v| v * noise.velocity_scale));
    fix
}

impl Pass {
    fn count(&mut self, innovation: &Innovation, rows: Option<Vec<WatchedRow>>) {
        self.innovations.push(*innovation);
        let Some(part) = innovation.part else { return };
        let groups = [innovation.position, innovation.velocity];
        let mut weights = Vec::with_capacity(6);
        for (kind, group) in groups.iter().enumerate() {
            let (value, weight) = robust(group);
            self.log_likelihood[part] += value;
            self.nis[part][kind].0 += group.nis;
            self.nis[part][kind].1 += group.dof;
            weights.extend(std::iter::repeat_n(weight, group.dof));
        }
        if let (Some(parts), Some(rows)) = (&mut self.information, rows) {
            for (row, weight) in rows.iter().zip(weights) {
                parts[part].take(&row.sensitivity, row.residual, weight);
            }
        }
    }
}
