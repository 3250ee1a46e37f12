//! Prediction of what a flight makes known: the covariance recursion of the filter along kinematics.
//!
//! Planner and guidance know only the trait [`Predictor`]; [`BoundPredictor`] is the one on the information bound of
//! `gaware-nav`. Sigmas are predictions in the sense of the bound: no filter does better.

pub mod sensors;

use crate::airframe::Airframe;
use crate::fence::LocalFrame;
use crate::item::Home;
use crate::kinematics::Kinematics;
use crate::maneuver::Maneuver;
use gaware_nav::bound::InformationBound;
use gaware_nav::earth::{Geodetic, rotation_rate};
use gaware_nav::filter::layout::{StateName, index};
use gaware_nav::filter::{Filter, Initial};
use gaware_nav::mechanization::{Motion, NavState};
use gaware_nav::model::Model;
use gaware_nav::sample::FixVelocity;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// What is planned for is what later decides whether a state is called observable.
pub use gaware_nav::observability::covariance::Targets;

/// The sigma of one state with its target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NamedSigma {
    /// `bg_x`, `g11`, `latency`, …
    pub name: Cow<'static, str>,
    /// 1-sigma in `unit`.
    pub sigma: f64,
    /// Sigma below which the state counts as known, in `unit`.
    pub target: f64,
    /// Unit of screens.
    pub unit: Cow<'static, str>,
}

impl NamedSigma {
    /// Sigma over target: at most 1 where the state is known.
    pub fn ratio(&self) -> f64 {
        self.sigma / self.target.max(f64::MIN_POSITIVE)
    }
}

/// Something that knows how flights change sigmas.
pub trait Predictor: Clone {
    /// Flies along these samples, which follow on those before, with a fix every `fix_interval_s` seconds.
    fn fly(&mut self, kinematics: &[Kinematics], fix_interval_s: f64);

    /// The sigmas now, of the states that a flight is planned for: without tolerances of the sensors.
    fn sigmas(&self) -> Vec<NamedSigma>;

    /// Whether a sigma that stays short of its target is worth flying for.
    fn is_short_of_use(&self) -> bool {
        true
    }

    /// What an autopilot can fly that may change them.
    fn maneuvers(&self, airframe: &Airframe) -> Vec<Maneuver> {
        Maneuver::automatic(airframe)
    }
}

/// A sample of a predicted flight as the information bound takes it: it does not depend on what is known there, so that one track serves every
/// prediction of the same flight.
#[derive(Debug, Clone)]
pub struct TrackStep {
    /// Time since the sample before, s.
    dt_s: f64,
    /// Specific force, m/s², and rotation rate relative to inertial space, rad/s, in body axes.
    motion: Motion,
    /// State there.
    nav: NavState,
}

/// The information bound along predicted kinematics.
#[derive(Debug, Clone)]
pub struct BoundPredictor {
    bound: InformationBound,
    frame: LocalFrame,
    home_height_m: f64,
    velocity: FixVelocity,
    targets: Targets,
    since_fix_s: f64,
}

impl BoundPredictor {
    /// Goes on from the present covariance of a filter.
    pub fn from_filter(filter: &Filter, frame: LocalFrame, home: Home, targets: Targets) -> Self {
        Self {
            bound: InformationBound::from_filter(filter),
            frame,
            home_height_m: f64::from(home.alt_m),
            // What GPS_RAW_INT has: no vertical velocity (FIELD_NOTES, "GNSS").
            velocity: FixVelocity::Horizontal([0.0; 2]),
            targets,
            since_fix_s: 0.0,
        }
    }

    /// From the priors of a model, as after levelling on the ground: tilt known to 2°, heading by a compass to 8°.
    pub fn from_priors(
        model: &Model,
        start: &Kinematics,
        frame: LocalFrame,
        home: Home,
        targets: Targets,
    ) -> Self {
        let nav = nav_state(&frame, f64::from(home.alt_m), start);
        let [tilt, heading] = [2.0_f64, 8.0].map(f64::to_radians);
        let initial = Initial {
            t_s: 0.0,
            nav,
            position_sigma_m: model.gnss.position_sigma_m,
            velocity_sigma_m_per_s: model.gnss.velocity_sigma_m_per_s,
            attitude_sigma_rad: [tilt, tilt, heading],
        };
        Self::from_filter(&Filter::new(model, &initial), frame, home, targets)
    }

    /// 1-sigma of roll, pitch and yaw now, rad.
    pub fn attitude_sigma_rad(&self) -> [f64; 3] {
        self.bound.filter().euler_sigma().into()
    }

    /// The sigmas now of all states, tolerances of the sensors included.
    pub fn all_sigmas(&self) -> Vec<NamedSigma> {
        self.sigmas_of(|_| true)
    }

    fn sigmas_of(&self, wanted: impl Fn(&StateName) -> bool) -> Vec<NamedSigma> {
        let filter = self.bound.filter();
        let covariance = filter.covariance();
        let states = filter.layout().names().iter().enumerate();
        states
            .filter(|(_, state)| wanted(state))
            .map(|(k, state)| {
                let i = index::GYRO_BIAS + k;
                let start = filter.initial_sigmas().get(i).copied().unwrap_or(f64::INFINITY);
                let start = filter.model().unmeasured_sigma(state.name, start);
                let target = self.targets.of(state, start) / state.unit.si;
                NamedSigma {
                    name: Cow::Borrowed(state.name),
                    sigma: covariance.sigma(i) / state.unit.si,
                    target,
                    unit: Cow::Borrowed(state.unit.symbol),
                }
            })
            .collect()
    }

    /// These samples as motions from where the predictor is at home, to be followed by it or by its copies.
    pub fn track(&self, kinematics: &[Kinematics]) -> Vec<TrackStep> {
        let mut last_t_s = None;
        kinematics
            .iter()
            .map(|k| {
                let dt_s = last_t_s.replace(k.t_s).map_or(0.0, |t| k.t_s - t).max(0.0);
                let nav = nav_state(&self.frame, self.home_height_m, k);
                let earth = nav.q_eb.inverse() * rotation_rate();
                TrackStep { dt_s, motion: Motion { rate: k.rate + earth, force: k.force }, nav }
            })
            .collect()
    }

    /// Flies along a track, with a fix every `fix_interval_s` seconds.
    pub fn follow(&mut self, track: &[TrackStep], fix_interval_s: f64) {
        for step in track {
            // A flight that begins anew has its own time; the filter's goes on.
            let t_s = self.bound.filter().t_s() + step.dt_s;
            self.bound.advance(t_s, &step.motion, None);
            self.bound.set_nav(step.nav);
            self.since_fix_s += step.dt_s;
            if self.since_fix_s >= fix_interval_s {
                self.since_fix_s = 0.0;
                self.bound.fix(self.velocity, None);
            }
        }
    }

    /// Fixes with another kind of velocity.
    #[must_use]
    pub fn with_velocity(mut self, velocity: FixVelocity) -> Self {
        self.velocity = velocity;
        self
    }
}

fn nav_state(frame: &LocalFrame, home_height_m: f64, k: &Kinematics) -> NavState {
    let place = frame.to_place(k.north_east_m());
    let place = Geodetic::from_degrees(place.lat_deg, place.lon_deg, home_height_m + k.height_m());
    NavState::from_ned(place, &k.velocity_ned_m_per_s, k.attitude.to_rotation_matrix().matrix())
}

impl Predictor for BoundPredictor {
    fn fly(&mut self, kinematics: &[Kinematics], fix_interval_s: f64) {
        self.follow(&self.track(kinematics), fix_interval_s);
    }

    fn sigmas(&self) -> Vec<NamedSigma> {
        self.sigmas_of(|state| !state.is_tolerance)
    }
}
