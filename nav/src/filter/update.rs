//! The measurement update: position and velocity of a fix at its own time of validity.
//!
//! Position and velocity are tested and applied as two groups. A group that fails its test is left out, but not for
//! long: after [`LOCKED_OUT_S`] of nothing but failures the filter takes the fixes' word again, so gating cannot lock
//! it out.

use super::Filter;
use super::group::{Prepared, Rows};
use super::layout::index;
use super::nav_map::Recentring;
use crate::earth::Geodetic;
use crate::effects::{FixInstant, MAX_PARAMETERS};
use crate::mechanization;
use crate::rotation::{exp, left_jacobian};
use crate::sample::{FixVelocity, GnssFix};
use nalgebra::{Matrix3, Vector3};

/// Squared normalised innovation beyond which a group of 1, 2, 3 rows is refused: chance 6e-7, five sigma of one row.
const GATE: [f64; 4] = [f64::INFINITY, 25.0, 28.7, 31.8];
/// After so long without an accepted group the fixes are believed again, s.
const LOCKED_OUT_S: f64 = 3.0;
/// … and after at least so many refusals.
const LOCKED_OUT_COUNT: u32 = 4;
/// Attitude uncertainty that is added when the fixes had to be believed again, rad.
const LOCKED_OUT_ATTITUDE: f64 = 0.05;
/// No fix is believed to be better than this, m and m/s.
const SIGMA_FLOOR: f64 = 0.01;

/// Squared normalised innovation beyond which a group of so many rows is refused.
pub fn gate(dof: usize) -> f64 {
    GATE.get(dof).copied().unwrap_or(GATE[3])
}

/// What became of one group of rows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Group {
    /// Rows: 0 where the fix had nothing to say.
    pub dof: usize,
    /// Normalised innovation squared.
    pub nis: f64,
    /// Innovations north, east, down.
    pub innovation: [f64; 3],
    /// Innovations over their predicted sigmas.
    pub normalised: [f64; 3],
    /// Logarithm of the likelihood of the innovations.
    pub log_likelihood: f64,
    /// Whether it was applied.
    pub used: bool,
    /// Whether the fixes were believed again after a lock-out.
    pub recovered: bool,
}

/// What became of one fix.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FixOutcome {
    /// Time of validity, s.
    pub t_s: f64,
    /// Position.
    pub position: Group,
    /// Velocity.
    pub velocity: Group,
}

impl FixOutcome {
    /// Whether any of it was used.
    pub fn used(&self) -> bool {
        self.position.used || self.velocity.used
    }
}

/// Since when each group has been refused.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Gate {
    position: Refusals,
    velocity: Refusals,
}

#[derive(Debug, Clone, Copy, Default)]
struct Refusals {
    since_s: Option<f64>,
    count: u32,
}

impl Refusals {
    fn locked_out(&mut self, t_s: f64) -> bool {
        self.count += 1;
        let since = *self.since_s.get_or_insert(t_s);
        self.count >= LOCKED_OUT_COUNT && t_s - since >= LOCKED_OUT_S
    }
}

/// What the effects add to position or velocity of a fix, and how that depends on the states.
#[derive(Debug, Clone, Default)]
struct Added {
    sum: Vector3<f64>,
    by_attitude: Matrix3<f64>,
    by_state: Vec<(usize, Vector3<f64>)>,
}

impl Filter {
    /// Delay of the fixes as presently estimated, s.
    pub fn fix_delay_s(&self) -> f64 {
        self.model
            .effects
            .iter()
            .zip(&self.calibration.parameters)
            .map(|(s, p)| s.effect.fix_delay_s(p))
            .sum()
    }

    /// Applies a fix to the present state, which must be that of the fix's time of validity.
    pub fn update(&mut self, fix: &GnssFix) -> FixOutcome {
        let mut outcome = FixOutcome { t_s: self.t_s, ..FixOutcome::default() };
        if let Some(watch) = self.watch.as_deref_mut() {
            watch.reach_fix(self.t_s, &self.layout);
        }
        outcome.position = self.apply(|f| f.position_rows(fix), |f| &mut f.gate.position, true);
        if outcome.position.recovered {
            self.believe_position(fix);
        }
        outcome.velocity = self.apply(|f| f.velocity_rows(fix), |f| &mut f.gate.velocity, false);
        if outcome.velocity.recovered {
            self.believe_velocity(fix);
        }
        self.tape_fix();
        outcome
    }

    /// Applies a fix to the covariance alone, as if it had brought no news: for information bounds and predictions.
    pub fn update_covariance(&mut self, fix: &GnssFix) {
        for rows in [self.position_rows(fix), self.velocity_rows(fix)] {
            if let Some(prepared) = Prepared::new(&rows, &self.p) {
                prepared.absorb(&mut self.p, &mut []);
            }
        }
    }

    /// A standing vehicle does not turn: ties b_g + G f to the mean rate shown, rad/s, within `sigma`.
    pub fn observe_standing(&mut self, sigma: f64) {
        let rate = self.motion.rate;
        let mut rows =
            Rows { dof: 3, residual: (-rate).into(), variance: [sigma * sigma; 3], ..Rows::default() };
        for (k, column) in self.jacobian.rate.iter().enumerate() {
            rows.push(index::GYRO_BIAS + k, |axis| column[axis]);
        }
        if let Some(prepared) = Prepared::new(&rows, &self.p) {
            self.absorb(&rows, prepared);
        }
    }

    fn apply(
        &mut self,
        rows: impl Fn(&Self) -> Rows,
        gate: fn(&mut Self) -> &mut Refusals,
        position: bool,
    ) -> Group {
        let mut rows = rows(self);
        if let Some(x) = &self.carried {
            rows = rows.less(x);
        }
        let Some(mut prepared) = Prepared::new(&rows, &self.p) else { return Group::default() };
        let t_s = self.t_s;
        if self.gating && prepared.group.nis > GATE[prepared.group.dof] {
            prepared.group.recovered = gate(self).locked_out(t_s);
            if prepared.group.recovered {
                *gate(self) = Refusals::default();
            }
            return prepared.group;
        }
        *gate(self) = Refusals::default();
        self.watch_rows(&rows, &prepared, position);
        Group { used: true, ..self.absorb(&rows, prepared) }
    }

    fn watch_rows(&mut self, rows: &Rows, prepared: &Prepared, position: bool) {
        let Some(mut watch) = self.watch.take() else { return };
        let sensitivity = watch.sensitivity(rows, position, &self.fix_instant().0);
        let gain = prepared.gain(self.layout.len());
        watch.absorb(&sensitivity, &rows.residual[..rows.dof], &gain, &prepared.l);
        self.watch = Some(watch);
    }

    fn absorb(&mut self, rows: &Rows, prepared: Prepared) -> Group {
        if let Some(tape) = self.tape.as_deref_mut() {
            tape.update(prepared.on_tape(rows, self.layout.len()));
        }
        let mut dx = vec![0.0; self.layout.len()];
        let group = prepared.absorb(&mut self.p, &mut dx);
        match &mut self.carried {
            Some(x) => x.iter_mut().zip(&dx).for_each(|(x, d)| *x += d),
            None => self.correct(&dx),
        }
        group
    }

    /// Moves the estimate by an error and re-expresses the covariance about the new estimate.
    pub(super) fn correct(&mut self, dx: &[f64]) {
        let part = |at: usize| Vector3::new(dx[at], dx[at + 1], dx[at + 2]);
        let (dr, dv, eps) = (part(index::POSITION), part(index::VELOCITY), part(index::ATTITUDE));
        let j = left_jacobian(&eps);
        let c_eb = self.nav.c_eb();
        self.nav.r_e += c_eb * j * dr;
        self.nav.v_e += c_eb * j * dv;
        self.nav.q_eb *= exp(&eps);
        self.nav.q_eb.renormalize();
        self.calibration.correct(&self.layout, dx);
        if let Some(w) = self.layout.wander() {
            self.wander += part(w);
        }
        // Below this the change of coordinates is under the noise of the covariance itself.
        if eps.norm_squared() > 1e-16 {
            let turn = Recentring::new(&dr, &dv, &eps);
            self.p.transform(&turn);
            if let Some(watch) = self.watch.as_deref_mut() {
                watch.transform_nav(&turn.dense());
            }
            if let Some(tape) = self.tape.as_deref_mut() {
                tape.turn(&turn.dense());
            }
        }
        self.refresh_motion();
    }

    /// How much later than the present state a fix is valid, s. A step that is run again about another delay comes at the time
    /// that the old one gave it.
    fn fix_ahead_s(&self, fix: &GnssFix) -> f64 {
        if self.carried.is_some() { fix.t_s - self.fix_delay_s() - self.t_s } else { 0.0 }
    }

    fn fix_instant(&self) -> (FixInstant, Matrix3<f64>) {
        let c_ne = crate::earth::c_en_at(&self.nav.r_e).transpose();
        let c_nb = c_ne * self.nav.c_eb();
        let a_e = mechanization::acceleration(&self.nav, &self.motion.force);
        let earth_b = self.nav.q_eb.inverse() * crate::earth::rotation_rate();
        let instant = FixInstant {
            t_s: self.t_s,
            v_n: c_ne * self.nav.v_e,
            a_n: c_ne * a_e,
            c_nb,
            rate_eb: self.motion.rate - earth_b,
            force_rate: self.force_rates.as_ref().map_or(Vector3::zeros(), |f| f.at(self.t_s)),
        };
        (instant, c_ne)
    }

    /// What the effects add to position and velocity of a fix.
    fn fix_effects(&self, x: &FixInstant) -> [Added; 2] {
        let mut out = [Added::default(), Added::default()];
        for (e, (setting, p)) in self.model.effects.iter().zip(&self.calibration.parameters).enumerate() {
            let added = setting.effect.fix(p, x);
            let turned = setting.effect.fix_by_attitude(p, x);
            let n = setting.effect.len();
            let mut columns = [[Vector3::zeros(); MAX_PARAMETERS]; 2];
            let [position, velocity] = &mut columns;
            setting.effect.fix_jacobian(p, x, &mut position[..n], &mut velocity[..n]);
            for (kind, slot) in out.iter_mut().enumerate() {
                slot.sum += added[kind];
                if let Some(by_attitude) = turned {
                    slot.by_attitude += by_attitude[kind];
                }
                for s in self.layout.slots().iter().filter(|s| s.effect == e) {
                    let column = columns[kind][s.parameter];
                    if column != Vector3::zeros() {
                        slot.by_state.push((s.state, column));
                    }
                }
            }
        }
        out
    }

    fn position_rows(&self, fix: &GnssFix) -> Rows {
        let (x, c_ne) = self.fix_instant();
        let [added, _] = self.fix_effects(&x);
        let z = c_ne * (fix.position.to_ecef() - self.nav.r_e)
            - added.sum
            - self.wander
            - x.v_n * self.fix_ahead_s(fix);
        let sigma = fix.position_sigma_m.unwrap_or(self.model.gnss.position_sigma_m);
        let mut rows = rows_of(
            index::POSITION,
            &z.as_slice()[..3],
            &x.c_nb,
            &added,
            &sigma,
            &(x.v_n * self.model.gnss.time_sigma_s),
        );
        if let Some(w) = self.layout.wander() {
            (0..3).for_each(|k| rows.push(w + k, |i| if i == k { 1.0 } else { 0.0 }));
        }
        rows
    }

    fn velocity_rows(&self, fix: &GnssFix) -> Rows {
        let (measured, rows) = match fix.velocity {
            FixVelocity::None => return Rows::default(),
            FixVelocity::Horizontal([n, e]) => (Vector3::new(n, e, 0.0), 2),
            FixVelocity::Full(v) => (Vector3::from(v), 3),
        };
        let (x, _) = self.fix_instant();
        let [_, added] = self.fix_effects(&x);
        let sigma = fix.velocity_sigma_m_per_s.unwrap_or(self.model.gnss.velocity_sigma_m_per_s);
        let z = measured - x.v_n - added.sum - x.a_n * self.fix_ahead_s(fix);
        rows_of(
            index::VELOCITY,
            &z.as_slice()[..rows],
            &x.c_nb,
            &added,
            &sigma,
            &(x.a_n * self.model.gnss.time_sigma_s),
        )
    }

    fn believe_position(&mut self, fix: &GnssFix) {
        self.nav.r_e = fix.position.to_ecef();
        let sigma = fix.position_sigma_m.unwrap_or(self.model.gnss.position_sigma_m);
        let worst = sigma.iter().fold(SIGMA_FLOOR, |a, b| a.max(*b));
        (0..3).for_each(|k| self.p.reset(index::POSITION + k, worst * 2.0));
        self.loosen_attitude();
    }

    fn believe_velocity(&mut self, fix: &GnssFix) {
        let place: Geodetic = self.nav.geodetic();
        let mut v_n = self.nav.v_n();
        match fix.velocity {
            FixVelocity::None => return,
            FixVelocity::Horizontal([n, e]) => (v_n.x, v_n.y) = (n, e),
            FixVelocity::Full(v) => v_n = v.into(),
        }
        self.nav.v_e = place.c_en() * v_n;
        let sigma = fix.velocity_sigma_m_per_s.unwrap_or(self.model.gnss.velocity_sigma_m_per_s);
        let worst = sigma.iter().fold(0.5, |a: f64, b| a.max(*b));
        (0..3).for_each(|k| self.p.reset(index::VELOCITY + k, worst * 2.0));
        self.loosen_attitude();
    }

    fn loosen_attitude(&mut self) {
        (0..3).for_each(|k| self.p.add_variance(index::ATTITUDE + k, LOCKED_OUT_ATTITUDE.powi(2)));
    }
}

/// Rows of the first `z.len()` of north, east, down for the error block at `block`; an error of the time stamp moves all
/// of them together, by `shared` per sigma.
fn rows_of(
    block: usize,
    z: &[f64],
    c_nb: &Matrix3<f64>,
    added: &Added,
    sigma: &[f64; 3],
    shared: &Vector3<f64>,
) -> Rows {
    let mut rows = Rows { dof: z.len(), ..Rows::default() };
    rows.h.reserve(9 + added.by_state.len());
    for (i, residual) in z.iter().enumerate() {
        rows.residual[i] = *residual;
        rows.variance[i] = sigma[i].max(SIGMA_FLOOR).powi(2);
        rows.shared[i] = shared[i];
    }
    (0..3).for_each(|j| rows.push(block + j, |i| c_nb[(i, j)]));
    (0..3).for_each(|j| rows.push(index::ATTITUDE + j, |i| added.by_attitude[(i, j)]));
    added.by_state.iter().for_each(|(state, column)| rows.push(*state, |i| column[i]));
    rows
}
