//! What a fix measures, linearised at its time of validity.

use super::index;
use super::kalman::{Square, State, add_scaled};
use super::track::Track;
use crate::effects::{Antenna, FixInstant, MAX_PARAMETERS, Older};
use crate::filter::calibration::Calibration;
use crate::identify::watched::Watched;
use crate::mechanization::{self, NavState};
use crate::model::Model;
use crate::sample::{FixVelocity, GnssFix};
use nalgebra::{Matrix3, Vector3};

/// Which figure of the noise scales a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Horizontal,
    Height,
    Velocity,
}

/// One scalar measurement. Of its derivatives by the states only those are kept that are not zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) kind: Kind,
    /// North, east or down.
    axis: usize,
    /// What was measured less what the trajectory says.
    pub(super) residual: f64,
    /// 1-sigma before scaling.
    pub(super) sigma: f64,
    /// Derivative by the position error, or by the velocity error where it measures that.
    own: [f64; 3],
    /// Derivative by the attitude error.
    attitude: [f64; 3],
    /// Derivative by an error of the stamp, and by what all stamps are off by: the vehicle moves by this much per second.
    drift: f64,
}

impl Row {
    /// Whether it belongs to the position.
    #[inline(always)]
    pub(super) fn is_position(&self) -> bool {
        self.kind != Kind::Velocity
    }

    /// North, east or down of a position, as the number of its Gauss-Markov error.
    #[inline(always)]
    pub(super) fn position_axis(&self) -> Option<usize> {
        self.is_position().then_some(self.axis)
    }

    /// North, east, down of the position, then of the velocity.
    #[inline(always)]
    pub(super) fn channel(&self) -> usize {
        if self.is_position() { self.axis } else { 3 + self.axis }
    }

    /// First of the states that it measures.
    #[inline(always)]
    fn measures(&self) -> usize {
        if self.is_position() { index::POSITION } else { index::VELOCITY }
    }

    /// Whether the attitude counts.
    #[inline(always)]
    fn turns(&self) -> bool {
        self.attitude != [0.0; 3]
    }

    /// h v, where h are the derivatives by the states.
    #[inline(always)]
    pub(super) fn dot(&self, v: &State) -> f64 {
        let at = self.measures();
        let mut sum = 0.0;
        for k in 0..3 {
            sum += self.own[k] * v[at + k] + self.attitude[k] * v[index::ATTITUDE + k];
        }
        if self.is_position() {
            sum += v[index::GAUSS_MARKOV + self.axis];
        }
        sum + self.drift * (v[index::STAMP] + v[index::CLOCK])
    }

    /// h M.
    #[inline(always)]
    pub(super) fn times(&self, m: &Square) -> State {
        let at = self.measures();
        let mut out = m[at].map(|v| v * self.own[0]);
        add_scaled(&mut out, &m[at + 1], self.own[1]);
        add_scaled(&mut out, &m[at + 2], self.own[2]);
        if self.turns() {
            (0..3).for_each(|k| add_scaled(&mut out, &m[index::ATTITUDE + k], self.attitude[k]));
        }
        if self.is_position() {
            add_scaled(&mut out, &m[index::GAUSS_MARKOV + self.axis], 1.0);
        }
        add_scaled(&mut out, &m[index::STAMP], self.drift);
        add_scaled(&mut out, &m[index::CLOCK], self.drift);
        out
    }

    /// h itself.
    #[inline(always)]
    pub(super) fn dense(&self) -> State {
        let mut h = [0.0; super::STATES];
        let at = self.measures();
        h[at..at + 3].copy_from_slice(self.own.as_slice());
        h[index::ATTITUDE..index::ATTITUDE + 3].copy_from_slice(self.attitude.as_slice());
        if self.is_position() {
            h[index::GAUSS_MARKOV + self.axis] = 1.0;
        }
        h[index::STAMP] = self.drift;
        h[index::CLOCK] = self.drift;
        h
    }

    /// Its derivatives by the states one by one: number, value.
    #[inline(always)]
    pub(super) fn entries(&self) -> impl Iterator<Item = (usize, f64)> {
        let (own, at) = (*self, self.measures());
        let three = |first: usize, v: [f64; 3]| (0..3).map(move |k| (first + k, v[k]));
        let attitude = three(index::ATTITUDE, own.attitude).take(if own.turns() { 3 } else { 0 });
        let gauss_markov = own.position_axis().map(|axis| (index::GAUSS_MARKOV + axis, 1.0));
        let stamps = [(index::STAMP, own.drift), (index::CLOCK, own.drift)];
        three(at, own.own).chain(attitude).chain(gauss_markov).chain(stamps)
    }
}

/// What a fix measures.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    /// Rows of the position, then of the velocity.
    pub(super) rows: Vec<Row>,
    /// Row after row: its own derivative by each watched parameter of an effect; terms have none.
    pub(super) direct: Vec<f64>,
}

impl Measured {
    /// How many of the watched parameters have a derivative here.
    #[inline(always)]
    fn each(&self) -> usize {
        self.direct.len() / self.rows.len().max(1)
    }

    /// Derivatives of a row by the watched parameters.
    #[inline(always)]
    pub(super) fn direct_of(&self, row: usize) -> &[f64] {
        let each = self.each();
        &self.direct[row * each..(row + 1) * each]
    }

    /// The watched parameters moved by so much.
    pub(super) fn move_by(&mut self, step: &[f64]) {
        let each = self.each().max(1);
        for (row, direct) in self.rows.iter_mut().zip(self.direct.chunks_exact(each)) {
            row.residual -= direct.iter().zip(step).map(|(d, by)| d * by).sum::<f64>();
        }
    }
}

/// What effects add to a fix: position and velocity, and their derivatives by the attitude.
#[derive(Default)]
struct Added {
    sum: [Vector3<f64>; 2],
    by_attitude: [Matrix3<f64>; 2],
}

impl Added {
    fn new(model: &Model, calibration: &Calibration, x: &FixInstant) -> Self {
        let mut out = Self::default();
        for (setting, p) in model.effects.iter().zip(calibration.parameters()) {
            let sum = setting.effect.fix(p, x);
            let turned = setting.effect.fix_by_attitude(p, x).unwrap_or_default();
            for kind in 0..2 {
                out.sum[kind] += sum[kind];
                out.by_attitude[kind] += turned[kind];
            }
        }
        out
    }
}

/// Derivatives by the watched parameters: position, velocity.
fn direct(watched: &Watched, x: &FixInstant) -> [Vec<Vector3<f64>>; 2] {
    let mut out = [Vec::new(), Vec::new()];
    for setting in &watched.effects {
        let n = setting.effect.len();
        let mut columns = [[Vector3::zeros(); MAX_PARAMETERS]; 2];
        let [p, v] = &mut columns;
        setting.effect.fix_jacobian(&setting.values, x, &mut p[..n], &mut v[..n]);
        for k in setting.states() {
            out.iter_mut().zip(&columns).for_each(|(o, c)| o.push(c[k]));
        }
    }
    out
}

/// The rows of a fix about `nav`, with the sensors as they are there: the track must have come to its time of validity.
pub(super) fn of(fix: &GnssFix, nav: &NavState, track: &Track<'_>) -> Measured {
    let (here, model, watched) = (track.here(), track.model(), track.watched());
    let c_ne = nav.geodetic().c_en().transpose();
    let x = FixInstant {
        t_s: here.t_s,
        v_n: c_ne * nav.v_e,
        a_n: c_ne * mechanization::acceleration(nav, &here.motion.force),
        c_nb: c_ne * nav.c_eb(),
        rate_eb: here.motion.rate - nav.q_eb.inverse() * crate::earth::rotation_rate(),
        force_rate: track.force_rate(),
        antenna: Antenna::of(
            model
                .effects
                .iter()
                .map(|s| s.effect)
                .zip(track.calibration().parameters().iter().map(Vec::as_slice)),
            track.rate_derivatives(),
        ),
        older: Older::default(),
        elapsed_s: track.elapsed_s(),
    };
    let x = FixInstant { older: track.older(&x), ..x };
    let added = Added::new(model, track.calibration(), &x);
    let direct = direct(watched, &x);
    let (velocity, velocity_rows) = match fix.velocity {
        FixVelocity::None => (Vector3::zeros(), 0),
        FixVelocity::Horizontal([n, e]) => (Vector3::new(n, e, 0.0), 2),
        FixVelocity::Full(v) => (Vector3::from(v), 3),
    };
    let residuals =
        [c_ne * (fix.position.to_ecef() - nav.r_e) - added.sum[0], velocity - x.v_n - added.sum[1]];
    let sigmas = [
        fix.position_sigma_m.unwrap_or(model.gnss.position_sigma_m),
        fix.velocity_sigma_m_per_s.unwrap_or(model.gnss.velocity_sigma_m_per_s),
    ];
    // The vehicle moves while a stamp is wrong: by this much per second.
    let drift = [x.v_n, x.a_n];
    let row = |group: usize, i: usize| {
        let by_attitude = &added.by_attitude[group];
        Row {
            kind: match (group, i) {
                (0, 2) => Kind::Height,
                (0, _) => Kind::Horizontal,
                _ => Kind::Velocity,
            },
            axis: i,
            residual: residuals[group][i],
            sigma: sigmas[group][i],
            own: std::array::from_fn(|j| x.c_nb[(i, j)]),
            attitude: std::array::from_fn(|j| by_attitude[(i, j)]),
            drift: drift[group][i],
        }
    };
    let places = (0..3).map(|i| (0, i)).chain((0..velocity_rows).map(|i| (1, i)));
    Measured {
        rows: places.clone().map(|(group, i)| row(group, i)).collect(),
        direct: places.flat_map(|(group, i)| direct[group].iter().map(move |c| c[i])).collect(),
    }
}
