//! What a fix measures, linearised at its time of validity.

use super::kalman::{Square, State, add_scaled};
use super::track::Track;
use super::{STATES, index};
use crate::effects::FixInstant;
use crate::identify::watched::Watched;
use crate::linear::fix::{self, AtFix};
use crate::linear::interval::{Interval, Nav};
use crate::mechanization::NavState;
use crate::rotation::{log, skew};
use crate::sample::GnssFix;
use nalgebra::{Matrix3, Vector3};
use pulp::Simd;

/// Which figure of the noise scales a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Horizontal,
    Height,
    Velocity,
    /// The velocity of a place, which no receiver's noise scales.
    Place,
    /// The mean rate of a rest, scaled by the noise of the gyros.
    Rate,
    /// Of a compass.
    Field,
}

/// One scalar measurement. Of its derivatives by the states only those are kept that are not zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) kind: Kind,
    /// North, east or down; x, y or z of a rate.
    pub(super) axis: usize,
    /// What was measured less what the trajectory says.
    pub(super) residual: f64,
    /// 1-sigma before scaling.
    pub(super) sigma: f64,
    /// Variance that no figure scales.
    pub(super) least: f64,
    /// Derivative by the error of what it measures: position, velocity, or gyro bias.
    pub(super) own: [f64; 3],
    /// Derivative by the attitude error.
    pub(super) attitude: [f64; 3],
    /// Derivative of a rate by the accelerometer bias, through the g-sensitivity that the model knows of.
    pub(super) by_accel: [f64; 3],
    /// Derivative by an error of the stamp, and by what all stamps are off by: the vehicle moves by this much per second.
    pub(super) drift: f64,
}

impl Row {
    /// Whether it belongs to the position.
    #[inline(always)]
    pub(super) fn is_position(&self) -> bool {
        matches!(self.kind, Kind::Horizontal | Kind::Height)
    }

    /// North, east or down of a position, as the number of its Gauss-Markov error.
    #[inline(always)]
    pub(super) fn position_axis(&self) -> Option<usize> {
        self.is_position().then_some(self.axis)
    }

    /// Position, velocity, rate: rows of one group are tested together.
    #[inline(always)]
    pub(super) fn group(&self) -> usize {
        match self.kind {
            Kind::Horizontal | Kind::Height => 0,
            Kind::Velocity | Kind::Place | Kind::Field => 1,
            Kind::Rate => 2,
        }
    }

    #[inline(always)]
    fn is_rate(&self) -> bool {
        self.kind == Kind::Rate
    }

    /// First of the states that it measures.
    #[inline(always)]
    fn measures(&self) -> usize {
        [index::POSITION, index::VELOCITY, index::GYRO_BIAS][self.group()]
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
        if self.is_rate() {
            (0..3).for_each(|k| sum += self.by_accel[k] * v[index::ACCEL_BIAS + k]);
        }
        sum + self.drift * (v[index::STAMP] + v[index::CLOCK])
    }

    /// h M.
    #[inline(always)]
    pub(super) fn times<S: Simd>(&self, simd: S, m: &Square) -> State {
        let at = self.measures();
        let mut out = [0.0; STATES];
        for k in 0..3 {
            add_scaled(simd, &mut out, &m[at + k], self.own[k]);
        }
        if self.turns() {
            for k in 0..3 {
                add_scaled(simd, &mut out, &m[index::ATTITUDE + k], self.attitude[k]);
            }
        }
        if self.is_position() {
            add_scaled(simd, &mut out, &m[index::GAUSS_MARKOV + self.axis], 1.0);
        }
        if self.is_rate() {
            for k in 0..3 {
                add_scaled(simd, &mut out, &m[index::ACCEL_BIAS + k], self.by_accel[k]);
            }
        }
        add_scaled(simd, &mut out, &m[index::STAMP], self.drift);
        add_scaled(simd, &mut out, &m[index::CLOCK], self.drift);
        out
    }

    /// h itself.
    #[inline(always)]
    pub(super) fn dense(&self) -> State {
        let mut h = [0.0; STATES];
        let at = self.measures();
        h[at..at + 3].copy_from_slice(self.own.as_slice());
        h[index::ATTITUDE..index::ATTITUDE + 3].copy_from_slice(self.attitude.as_slice());
        if self.is_position() {
            h[index::GAUSS_MARKOV + self.axis] = 1.0;
        }
        if self.is_rate() {
            h[index::ACCEL_BIAS..index::ACCEL_BIAS + 3].copy_from_slice(self.by_accel.as_slice());
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
        let accel = three(index::ACCEL_BIAS, own.by_accel).take(if own.is_rate() { 3 } else { 0 });
        let stamps = [(index::STAMP, own.drift), (index::CLOCK, own.drift)];
        three(at, own.own).chain(attitude).chain(gauss_markov).chain(accel).chain(stamps)
    }
}

/// What a fix measures.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    /// Rows of the position, then of the velocity.
    pub(super) rows: Vec<Row>,
    /// Row after row: its own derivative by each watched parameter of an effect; terms have one at rest alone.
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

/// The vehicle on a trajectory at the time of validity of a fix.
pub(super) struct Seen<'a> {
    pub(super) at: AtFix<'a>,
    /// What effects on the fix depend on.
    pub(super) x: FixInstant,
    /// The parameters that are watched.
    pub(super) watched: &'a Watched,
}

/// The rows of a fix.
pub(super) fn of(fix: &GnssFix, seen: &Seen<'_>) -> Measured {
    let Seen { at, x, watched } = seen;
    let groups = at.measured(fix, x);
    let row = |group: usize, i: usize| {
        let m = &groups[group];
        Row {
            kind: match (group, i) {
                (0, 2) => Kind::Height,
                (0, _) => Kind::Horizontal,
                _ => Kind::Velocity,
            },
            axis: i,
            residual: m.residual[i],
            sigma: m.sigma[i],
            least: 0.0,
            by_accel: [0.0; 3],
            own: std::array::from_fn(|j| m.own[(i, j)]),
            attitude: std::array::from_fn(|j| m.attitude[(i, j)]),
            drift: m.drift[i],
        }
    };
    let mut direct = [Vec::new(), Vec::new()];
    for setting in &watched.effects {
        let columns = fix::columns(setting, &setting.values, x);
        for k in setting.states() {
            direct.iter_mut().zip(&columns).for_each(|(out, c)| out.push(c[k]));
        }
    }
    let rows = [groups[0].rows, groups[1].rows];
    let places = || (0..2).flat_map(move |group| (0..rows[group]).map(move |i| (group, i)));
    Measured {
        rows: places().map(|(group, i)| row(group, i)).collect(),
        direct: places().flat_map(|(group, i)| direct[group].iter().map(move |c| c[i])).collect(),
    }
}

/// What the place says of the velocity: nothing of a receiver is in it.
pub(super) fn of_place(fix: &GnssFix, seen: &Seen<'_>) -> Measured {
    let Seen { at, x, watched } = seen;
    let (c_nb, velocity) = (at.nav.c_nb(), at.nav.v_n());
    let [_, measured] = at.measured(fix, x);
    let row = |i: usize| Row {
        kind: Kind::Place,
        axis: i,
        residual: -velocity[i],
        sigma: measured.sigma[i],
        least: 0.0,
        own: std::array::from_fn(|j| c_nb[(i, j)]),
        attitude: [0.0; 3],
        by_accel: [0.0; 3],
        drift: 0.0,
    };
    let each: usize = watched.effects.iter().map(|s| s.states().count()).sum();
    Measured { rows: (0..3).map(row).collect(), direct: vec![0.0; 3 * each] }
}

/// A rest over an interval, between these states of the trajectory: the unit does not turn but with the Earth, so what the gyros showed over
/// it is a measurement, and the attitude goes on as it was. Nothing is counted twice: the same noise of the gyros is no process noise then.
///
/// They are compared in what the gyros show, whose noise is the same whatever the model makes of it: that of the corrected rate is less by 4 % with a scale
/// factor of 4 %, and over minutes of rest that alone was worth 125 nats (two formulas and 4 % on two axes of a recording made by others). And they are what
/// the gyros showed between the stamps of two fixes, whatever delays are tried: means over other samples are other data (a delay of -20 ms for 89 nats), and rates
/// that a lag of 1 ms interpolates have 1 % less noise (24 nats for it beside a delay).
pub(super) fn rest(
    interval: &mut Interval,
    [from, to]: [&NavState; 2],
    (track, stamps_s): (&Track<'_>, [f64; 2]),
    measured: &mut Measured,
) {
    // ε at the end is r + A ε, by which it keeps the attitude; the gyros say Φ ε + B θ.
    let r = log(&(to.q_eb.inverse() * from.q_eb));
    let keeps = Matrix3::identity() + skew(&r) * 0.5;
    let back = Matrix3::identity() - skew(&r) * 0.5;
    let three = |c: &Nav| Vector3::new(c[index::ATTITUDE], c[index::ATTITUDE + 1], c[index::ATTITUDE + 2]);
    let block = |at: usize| Matrix3::from_columns(&[0, 1, 2].map(|k| three(&interval.transition[at + k])));
    let by_attitude = (block(index::ATTITUDE) - keeps) * back;
    let (residual, lasted_s) = (track.less_than_at_rest(to, stamps_s), stamps_s[1] - stamps_s[0]);
    let (by_gyro, by_accel) = (block(index::GYRO_BIAS), block(index::ACCEL_BIAS));
    // Rows of the fix have no derivative by terms.
    let (columns, rows) = (interval.driven.len(), measured.rows.len());
    let each = measured.direct.len() / rows.max(1);
    let mut direct = vec![0.0; columns * (rows + 3)];
    for (row, out) in direct.chunks_exact_mut(columns.max(1)).enumerate() {
        if row < rows {
            out[..each].copy_from_slice(&measured.direct[row * each..(row + 1) * each]);
        } else {
            out.iter_mut().zip(&interval.driven).for_each(|(o, d)| *o = d[index::ATTITUDE + row - rows]);
        }
    }
    measured.direct = direct;
    measured.rows.extend((0..3).map(|i| Row {
        kind: Kind::Rate,
        axis: i,
        residual: residual[i],
        sigma: lasted_s.sqrt(),
        least: interval.rounding.0 * lasted_s,
        own: std::array::from_fn(|j| by_gyro[(i, j)]),
        attitude: std::array::from_fn(|j| by_attitude[(i, j)]),
        by_accel: std::array::from_fn(|j| by_accel[(i, j)]),
        drift: 0.0,
    }));
    interval.keep_attitude(&keeps, &r);
}
