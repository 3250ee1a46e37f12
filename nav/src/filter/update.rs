//! The measurement update: what the aids say is tested, applied, and where a test cannot be right, started anew from.
//!
//! Each aid is tested and applied as one group. A group that fails its test is left out, but not for long: innovation
//! tests must not lock the filter out.

use super::aid::Rejections;
use super::aid::gnss_position::HELD_OFF_S;
use super::force_rate::ForceRates;
use super::group::{Prepared, Rows};
use super::layout::index;
use super::{Filter, Point};
use crate::displacement::Displacement;
use crate::sample::GnssFix;
use nalgebra::Vector3;
use std::sync::Arc;

pub use super::aid::gate;

/// Fixes are assumed to be no older than this, s.
const LONGEST_DELAY_S: f64 = 1.0;
/// Likelihood of a fix that a filter cannot even test, nats: worse than any that it can.
const UNTESTABLE: f64 = -1e3;
/// The linear model holds about a mean error of the tilt up to this, rad: what it leaves out of the specific force, ½ ε² g, is 4.5 µg then …
const NEAR_TILT: f64 = 3e-3;
/// … and of the heading, which gravity knows nothing of, up to this, rad: it leaves out 0.02 deg/h of the Earth's rate …
const NEAR_HEADING: f64 = 0.05;
/// … and no constant is off by more than this share of what was not known of it at the start: products of two such errors are a
/// hundredth of those that the prior allows.
const NEAR_SHARE: f64 = 0.1;
/// With attitude less certain than this a filter is aligned anew instead of being started from a fix, rad.
pub(crate) const LOST_ATTITUDE: f64 = 0.35;

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
    /// Variances of what the measurement and its time stamp have of their own in that.
    pub noise: [f64; 3],
    /// Logarithm of the likelihood of the innovations.
    pub log_likelihood: f64,
    /// Whether it was applied.
    pub used: bool,
    /// Whether the filter started anew from it after nothing but rejections.
    pub recovered: bool,
}

/// What a fix did to the filter beyond an update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FixEvent {
    /// The position is inconsistent with velocity and inertial data by so much, m; it is not followed.
    PositionJump {
        /// Horizontal and vertical distance, m.
        offset_m: f64,
    },
    /// The position stayed there and was taken over as a correction of the position alone.
    PositionAccepted {
        /// How far the position moved, m.
        offset_m: f64,
    },
    /// GNSS is back: position and velocity started anew.
    Reacquired {
        /// After so long without, s.
        after_s: f64,
    },
}

/// What became of one fix.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FixOutcome {
    /// Time of validity, s.
    pub t_s: f64,
    /// What the fix is stamped with, s.
    pub stamp_s: f64,
    /// Position.
    pub position: Group,
    /// Velocity.
    pub velocity: Group,
    /// Heading of two antennas.
    pub yaw: Group,
    /// What else it did.
    pub event: Option<FixEvent>,
}

impl FixOutcome {
    /// Whether any of it was used.
    pub fn used(&self) -> bool {
        self.position.used || self.velocity.used || self.yaw.used
    }
}

/// Which clock of rejections a group has.
type Clock = fn(&mut Filter) -> &mut Rejections;

impl Filter {
    /// Delay of a fix with this stamp as presently estimated, s, as far as it is possible.
    pub fn fix_delay_s(&self, stamp_s: f64) -> f64 {
        self.estimated_delay_s(stamp_s).clamp(0.0, LONGEST_DELAY_S)
    }

    fn estimated_delay_s(&self, stamp_s: f64) -> f64 {
        let elapsed_s = stamp_s - self.began_s;
        self.model
            .effects
            .iter()
            .zip(self.about.calibration.parameters())
            .map(|(s, p)| s.effect.fix_delay_s(p, elapsed_s))
            .sum()
    }

    /// The same where the motion around it is known.
    pub(super) fn update_among(&mut self, fix: &GnssFix, nearby: Option<Arc<ForceRates>>) -> FixOutcome {
        self.nearby = nearby;
        let outcome = self.update(fix);
        self.nearby = None;
        outcome
    }

    /// Applies a fix to the present state, which must be that of the fix's time of validity.
    pub fn update(&mut self, fix: &GnssFix) -> FixOutcome {
        if !fix.is_plausible() {
            return FixOutcome { t_s: self.t_s, stamp_s: fix.t_s, ..FixOutcome::default() };
        }
        self.arrive();
        let outcome = if self.hold.is_some() {
            self.with_base(|f| f.apply_at_rest(fix))
        } else if let Some(event) = self.end_coasting(fix) {
            self.started_anew(event)
        } else {
            self.apply_fix(fix)
        };
        if outcome.used() {
            self.aided_s = Some(self.t_s);
        }
        self.find_estimate();
        self.failed |= !self.is_sound();
        FixOutcome { stamp_s: fix.t_s, ..outcome }
    }

    fn started_anew(&self, event: FixEvent) -> FixOutcome {
        let group = Group { used: true, recovered: true, ..Group::default() };
        FixOutcome { t_s: self.t_s, position: group, event: Some(event), ..FixOutcome::default() }
    }

    /// All groups of a fix are linearised once, about the state that it finds, and applied one after the other: the gates see
    /// each by itself, the result is that of one update with all rows.
    fn apply_fix(&mut self, fix: &GnssFix) -> FixOutcome {
        let x = self.linearise(fix);
        let position = self.position_rows(fix, &x);
        let velocity = self.velocity_rows(fix, &x);
        let yaw = self.yaw_rows(fix);
        let mut outcome = FixOutcome { t_s: self.t_s, ..FixOutcome::default() };
        let withheld = velocity.dof > 0 && self.gates.velocity.lasts();
        if withheld {
            // The same receiver is wrong about the velocity, or the filter is: its position can be attributed to neither.
            outcome.position = self.withhold(position, |f| &mut f.gates.position);
        } else {
            outcome.position = self.apply(position, |f| &mut f.gates.position);
        }
        outcome.velocity = self.apply(velocity, |f| &mut f.gates.velocity);
        if withheld && outcome.velocity.used {
            self.gates.position.accept();
        }
        self.apply_yaw(yaw, &mut outcome);
        if !self.pinned {
            self.follow();
            self.walk_by_products();
        }
        self.settle_rejections(fix, &mut outcome);
        outcome
    }

    /// A stationary vehicle: its velocity is known, its position and heading are not.
    fn apply_at_rest(&mut self, fix: &GnssFix) -> FixOutcome {
        let mut outcome = FixOutcome { t_s: self.t_s, ..FixOutcome::default() };
        let x = self.linearise(fix);
        outcome.position = self.apply(self.position_rows(fix, &x), |f| &mut f.gates.position);
        self.apply_yaw(self.yaw_rows(fix), &mut outcome);
        self.settle_position(fix, &mut outcome);
        outcome
    }

    fn apply_yaw(&mut self, rows: Rows, outcome: &mut FixOutcome) {
        outcome.yaw = self.apply(rows, |f| &mut f.gates.yaw);
        if outcome.yaw.dof > 0 && !outcome.yaw.used && self.gates.yaw.locked_out(self.t_s) {
            outcome.yaw.recovered = true;
            self.gates.yaw.accept();
            self.reset_yaw(outcome.yaw.innovation[0]);
        }
    }

    /// What follows from rejections that last.
    fn settle_rejections(&mut self, fix: &GnssFix, outcome: &mut FixOutcome) {
        let rejected = |g: &Group| g.dof > 0 && !g.used;
        let t_s = self.t_s;
        if rejected(&outcome.velocity) && self.gates.velocity.locked_out(t_s) {
            outcome.velocity.recovered = true;
            self.gates.velocity.accept();
            self.find_estimate();
            self.reset_velocity(fix);
            self.loosen_attitude();
            if rejected(&outcome.position) {
                outcome.position.recovered = true;
                self.gates.position.accept();
                self.reset_position(fix);
            }
            return;
        }
        if outcome.velocity.used {
            self.settle_position(fix, outcome);
        } else if rejected(&outcome.position)
            && outcome.velocity.dof == 0
            && self.gates.position.locked_out(t_s)
        {
            // Nothing but the position says how the vehicle moves.
            outcome.position.recovered = true;
            self.gates.position.accept();
            self.reset_position(fix);
            self.loosen_attitude();
        }
    }

    /// A position that fails its test beside a velocity that passes: a jump of the position.
    fn settle_position(&mut self, fix: &GnssFix, outcome: &mut FixOutcome) {
        if outcome.position.dof == 0 || outcome.position.used {
            return;
        }
        let offset_m = Vector3::from(outcome.position.innovation).norm();
        if self.gates.position.for_at_least(self.t_s, HELD_OFF_S) {
            self.gates.position.accept();
            outcome.position.recovered = true;
            let offset_m = self.reset_position(fix);
            outcome.event = Some(FixEvent::PositionAccepted { offset_m });
        } else if self.gates.position.has_begun_to_last() {
            outcome.event = Some(FixEvent::PositionJump { offset_m });
        }
    }

    /// Position and velocity from the first fix after a long time without; `None` where the filter has not coasted or its
    /// attitude is lost too.
    fn end_coasting(&mut self, fix: &GnssFix) -> Option<FixEvent> {
        let after_s = self.t_s - self.coasting_since_s? + super::propagation::COAST_AFTER_S;
        self.coasting_since_s = None;
        self.lost = self.attitude_sigma() > LOST_ATTITUDE;
        self.reset_position(fix);
        self.reset_velocity(fix);
        self.gates = super::aid::Gates::default();
        Some(FixEvent::Reacquired { after_s })
    }

    /// 1-sigma of the worst axis of the attitude, rad.
    pub fn attitude_sigma(&self) -> f64 {
        (0..3).map(|k| self.p.sigma(index::ATTITUDE + k)).fold(0.0, f64::max)
    }

    /// 1-sigma of the tilt, both axes together, rad: of the direction of the vertical, whatever the heading.
    pub fn tilt_sigma(&self) -> f64 {
        let trace: f64 = (0..3).map(|k| self.p.sigma(index::ATTITUDE + k).powi(2)).sum();
        (trace - self.heading_sigma().powi(2)).max(0.0).sqrt()
    }

    /// Whether state and covariance are finite and every variance positive.
    fn is_sound(&self) -> bool {
        let Point { nav, calibration, .. } = &self.estimate;
        let nav = nav.r_e.iter().chain(&nav.v_e).chain(nav.q_eb.coords.iter());
        let constants = calibration.gyro_bias.iter().chain(&calibration.accel_bias);
        let parameters = calibration.parameters().iter().flatten();
        nav.chain(constants).chain(parameters).all(|x| x.is_finite())
            && (0..self.layout.len()).all(|i| {
                let variance = self.p.at(i, i);
                variance.is_finite() && variance > 0.0
            })
    }

    /// Applies a fix to the covariance alone, as if its innovation were zero: for information bounds and predictions.
    pub fn update_covariance(&mut self, fix: &GnssFix) {
        self.arrive();
        let x = self.linearise(fix);
        for rows in [self.position_rows(fix, &x), self.velocity_rows(fix, &x)] {
            if let Some(prepared) = Prepared::new(&rows, &self.p) {
                prepared.absorb(&mut self.p, &mut []);
            }
        }
    }

    /// A vehicle at rest does not turn: ties b_g + G f to the mean rate shown, rad/s, within `sigma`.
    pub fn observe_stationary(&mut self, sigma: f64) {
        self.arrive();
        let rate = self.about.motion.rate;
        let mut rows =
            Rows { dof: 3, residual: (-rate).into(), variance: [sigma * sigma; 3], ..Rows::default() };
        for (k, column) in self.jacobian.rate.iter().enumerate() {
            rows.push(index::GYRO_BIAS + k, |axis| column[axis]);
        }
        if let Ok(prepared) = self.tested(rows).1 {
            self.absorb(prepared);
            self.follow();
            self.find_estimate();
        }
    }

    /// A group about the carried mean, and what its test uses; without an innovation covariance the group itself.
    pub(super) fn tested(&self, rows: Rows) -> (Rows, Result<Prepared, Group>) {
        let rows = rows.less(&self.x);
        let untestable = || match rows.dof {
            0 => Group::default(),
            dof => Group { dof, log_likelihood: UNTESTABLE, ..Group::default() },
        };
        let prepared = Prepared::new(&rows, &self.p).ok_or_else(untestable);
        (rows, prepared)
    }

    fn apply(&mut self, rows: Rows, clock: Clock) -> Group {
        let t_s = self.t_s;
        let (rows, tested) = self.tested(rows);
        let prepared = match tested {
            Ok(prepared) if prepared.group.nis <= gate(prepared.group.dof) => prepared,
            other => {
                if rows.dof > 0 {
                    clock(self).reject(t_s);
                }
                return other.map_or_else(|group| group, |prepared| prepared.group);
            }
        };
        clock(self).accept();
        Group { used: true, ..self.absorb(prepared) }
    }

    /// Tests a group and leaves it out whatever the result.
    fn withhold(&mut self, rows: Rows, clock: Clock) -> Group {
        let t_s = self.t_s;
        let (rows, tested) = self.tested(rows);
        if rows.dof > 0 {
            clock(self).reject(t_s);
        }
        tested.map_or_else(|group| group, |prepared| prepared.group)
    }

    pub(super) fn absorb(&mut self, prepared: Prepared) -> Group {
        let mut dx = vec![0.0; self.layout.len()];
        let group = prepared.absorb(&mut self.p, &mut dx);
        self.x.iter_mut().zip(&dx).for_each(|(x, d)| *x += d);
        group
    }

    /// The estimate from what is linearised about and the mean error.
    pub(super) fn find_estimate(&mut self) {
        let Self { about, estimate, x, model, layout, .. } = self;
        estimate.nav = about.nav.displaced(&Displacement::of(x));
        if self.hold.is_some() {
            estimate.nav.v_e = Vector3::zeros();
        }
        estimate.calibration.clone_from(&about.calibration);
        estimate.calibration.correct(model, layout, x);
        estimate.motion = match &self.last {
            Some(last) => estimate.calibration.motion(model, last),
            None => about.motion,
        };
    }

    /// Moves what is linearised about to the estimate, which is to be found after it: position and velocity at once, attitude and constants
    /// where they have left the neighbourhood in which the linear model holds.
    fn follow(&mut self) {
        self.recentre_place();
        if self.has_strayed() {
            self.recentre();
        }
    }

    /// Whether what the linear model leaves out about the mean error counts.
    fn has_strayed(&self) -> bool {
        let [heading, tilt] = self.about.nav.heading_and_tilt(&Displacement::of(&self.x).attitude);
        let mut constants = index::GYRO_BIAS..index::GYRO_BIAS + self.layout.names().len();
        tilt.norm() > NEAR_TILT
            || heading.norm() > NEAR_HEADING
            || constants.any(|s| self.x[s].abs() > NEAR_SHARE * self.initial_sigmas[s])
    }

    /// Position and velocity alone. Fixes say in axes of the Earth where and how fast the vehicle is, whatever its heading: the covariance
    /// stays. Turned with a heading that is not known, each correction would seem to measure it (the curvature that a Gauss-Newton step
    /// leaves out of a prior that is alike in all directions): 15 min of cruise then ended with a yaw sigma of 1.2° and a NEES of 6.7.
    pub(super) fn recentre_place(&mut self) {
        let moved = self.about.nav.displaced(&Displacement::of(&self.x));
        (self.about.nav.r_e, self.about.nav.v_e) = (moved.r_e, moved.v_e);
        self.x[..index::ATTITUDE].fill(0.0);
    }

    /// All of it, and re-expresses the covariance about that.
    pub(super) fn recentre(&mut self) {
        self.recentre_place();
        let constants = self.layout.gauss_markov().unwrap_or(self.layout.len());
        let x = &self.x;
        if x[..constants].iter().all(|x| *x == 0.0) {
            return;
        }
        let by = Displacement::of(x);
        let turn = self.about.nav.recentring(&by);
        self.about.nav = self.about.nav.displaced(&by);
        self.about.calibration.correct(&self.model, &self.layout, x);
        self.x[..constants].fill(0.0);
        // Below this the change of coordinates is under the noise of the covariance itself.
        if by.attitude.norm_squared() > 1e-16 {
            self.p.transform(&turn);
        }
        self.refresh_motion();
    }

    /// How much later than the present state a fix is valid, s: the state comes at the time that an earlier estimate of the delay gave
    /// the fix, and a delay that is not possible is not applied to the time.
    pub(super) fn fix_ahead_s(&self, fix: &GnssFix) -> f64 {
        fix.t_s - self.estimated_delay_s(fix.t_s) - self.t_s
    }
}
