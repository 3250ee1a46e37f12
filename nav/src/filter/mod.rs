//! The error-state Kalman filter: a linear one about a trajectory that follows the samples.
//!
//! The filter carries the mean of the error, and its covariance, about that trajectory; between measurements both go through one
//! interval (`linear::interval`). The trajectory is moved to the estimate only where that has left the neighbourhood in
//! which the linear model holds. What nothing excites is then judged by one linearisation for as long as it stays so, and estimates that
//! change bring no information that nothing measured (first estimates: Huang, Mourikis & Roumeliotis 2010).
//!
//! Errors are left-invariant (body axes): C = Ĉ exp(ε), v = v̂ + Ĉ J(ε) δv, r = r̂ + Ĉ J(ε) δr (Barrau & Bonnabel 2017,
//! section V, applied to the ECEF mechanisation). The transition matrix then depends on the attitude estimate only through
//! Earth rate and gravity gradient, so large initial errors do not fake information. Which constant states there are
//! is decided by the [`Model`]: biases always, and every effect parameter with a prior sigma.

mod aid;
pub mod calibration;
pub mod covariance;
pub mod force_rate;
pub mod fusion;
mod group;
pub mod layout;
mod nav_map;
mod propagation;
mod regressor;
mod second_order;
mod unit;
pub(crate) mod unseen;
mod update;
mod window;

use crate::effects::{ActsOn, Antenna, BiasWalk, Kernel};
use crate::linear::interval::{Here, Sum};
use crate::math::{cos, sin, sin_cos};
use crate::mechanization::{Motion, NavState};
use crate::model::Model;
use crate::operating::{LagBank, Operating};
use crate::quantisation::ConstantError;
use crate::rss;
use crate::sample::{ImuSample, SampleKind};
use calibration::{Calibration, MotionJacobian};
use covariance::Covariance;
use force_rate::{ForceRates, Recent};
use layout::{Layout, index};
use nalgebra::{Matrix3, Vector3};
use regressor::Regressor;
use std::sync::Arc;

pub(crate) use aid::stationarity::detector::{Detector, SampleNoise};
pub use fusion::{Fusion, PassedOver};
pub(crate) use update::LOST_ATTITUDE;
pub use update::{FixEvent, FixOutcome, Group, gate};

/// What a filter starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct Initial {
    /// Time of validity, s.
    pub t_s: f64,
    /// Position, velocity and attitude.
    pub nav: NavState,
    /// 1-sigma of position north, east, down, m.
    pub position_sigma_m: [f64; 3],
    /// 1-sigma of velocity north, east, down, m/s.
    pub velocity_sigma_m_per_s: [f64; 3],
    /// 1-sigma of the rotation about north, east and down, rad.
    pub attitude_sigma_rad: [f64; 3],
}

/// A trajectory at one instant with the constants that belong to it.
#[derive(Debug, Clone)]
struct Point {
    nav: NavState,
    calibration: Calibration,
    /// The last sample as these constants compensate it.
    motion: Motion,
}

/// Filter state at one instant.
#[derive(Debug, Clone)]
pub struct Filter {
    model: Model,
    layout: Layout,
    kind: SampleKind,
    t_s: f64,
    /// What everything is linearised about.
    about: Point,
    /// Mean error about it, and the covariance of that.
    x: Vec<f64>,
    p: Covariance,
    /// The estimate: what is linearised about, moved by the mean error.
    estimate: Point,
    initial_sigmas: Vec<f64>,
    /// The last raw sample.
    last: Option<ImuSample>,
    /// The motion that the constants are judged by, as it is found …
    regressor: Regressor,
    /// … and as the Jacobian was found at.
    judged: Motion,
    jacobian: MotionJacobian,
    /// The sensors at the last two samples, and what they add up to since the last measurement.
    from: Here,
    to: Here,
    sum: Option<Box<Sum>>,
    /// When products of errors were last counted, s.
    products_s: f64,
    gates: aid::Gates,
    /// What is linearised about stays: a window is run again (see [`window`]).
    pinned: bool,
    /// Extra white noise of the samples, added to the model's: variances per hertz, (rad/s)²/Hz and (m/s²)²/Hz.
    extra_noise: (f64, f64),
    /// Variances of one sample as measured: rate, (rad/s)², and specific force, (m/s²)².
    scatter: (f64, f64),
    /// Variances of what rounding may keep from every sample, (rad/s)² and (m/s²)².
    rounding: [Vector3<f64>; 2],
    /// What it does to the mean of a vehicle that does not move.
    rounding_at_rest: ConstantError,
    /// Variances per axis of what is not known of the Earth's rate, (rad/s)², and of gravity, (m/s²)².
    reference_error: [f64; 2],
    /// Time of the last sample that a sensor took, s; the filter's own time may lie between two.
    sampled_s: f64,
    /// How strongly the values of the last samples bend; nothing where the motion between them is known.
    bend: Option<unseen::Bend>,
    /// The stationary period under way.
    hold: Option<Box<aid::stationarity::Hold>>,
    /// What the periods before say of what the vehicle rests on.
    supports: aid::stationarity::Supports,
    /// Time of the last fix that was used, s.
    aided_s: Option<f64>,
    /// Since when the filter follows the attitude alone because fixes have stayed away, s.
    coasting_since_s: Option<f64>,
    /// Whether its attitude was too uncertain to start anew from a fix.
    lost: bool,
    /// Whether state or covariance were found unsound.
    failed: bool,
    /// How fast the specific force changes around the fix that comes next.
    nearby: Option<Arc<ForceRates>>,
    /// Whether an effect of the model depends on the samples around the present one …
    needs_surroundings: bool,
    /// Whether an effect depends on more than motion, and what is reported of that.
    needs_conditions: bool,
    operating: Operating,
    lags: LagBank,
    /// … and what those so far show.
    recent: Recent,
    /// Whether an effect of the model lets biases walk.
    biases_walk: bool,
    /// Random walk of the biases beyond the model's.
    walk: BiasWalk,
    /// Log-likelihood of the mean rates of a stationary vehicle that nobody has taken yet.
    rest_evidence: f64,
    /// For how long the constants have not walked yet, s.
    unwalked_s: f64,
    /// When it began, s.
    began_s: f64,
    /// Height there, m.
    began_height_m: f64,
}

impl Filter {
    /// A filter with the states and priors of `model`.
    pub fn new(model: &Model, initial: &Initial) -> Self {
        let layout = Layout::new(model);
        let mut sigmas = vec![0.0; layout.len()];
        sigmas[index::GYRO_BIAS..index::ACCEL_BIAS].fill(model.imu.gyro_bias_sigma);
        sigmas[index::ACCEL_BIAS..index::EFFECTS].fill(model.imu.accel_bias_sigma);
        for slot in layout.slots() {
            sigmas[slot.state] = model.effects[slot.effect].sigmas[slot.parameter];
        }
        if let Some(w) = layout.gauss_markov() {
            sigmas[w..w + 3].copy_from_slice(&model.gnss.position_wander_sigma_m);
        }
        let mut p = Covariance::from_sigmas(&sigmas);
        if let Some(joint) = &model.joint {
            p.set_joint(joint, &layout);
        }
        let c_bn = initial.nav.c_nb().transpose();
        for (at, ned) in [
            (index::POSITION, &initial.position_sigma_m),
            (index::VELOCITY, &initial.velocity_sigma_m_per_s),
            (index::ATTITUDE, &initial.attitude_sigma_rad),
        ] {
            let variances = Matrix3::from_diagonal(&Vector3::from(*ned).map(|s| s * s));
            p.set_block3(at, &(c_bn * variances * c_bn.transpose()));
        }
        let initial_sigmas = (0..layout.len()).map(|i| p.sigma(i)).collect();
        let start =
            Point { nav: initial.nav, calibration: Calibration::new(model), motion: Motion::default() };
        Self {
            model: model.clone(),
            x: vec![0.0; layout.len()],
            layout,
            kind: SampleKind::Point,
            t_s: initial.t_s,
            about: start.clone(),
            p,
            estimate: start,
            initial_sigmas,
            last: None,
            regressor: Regressor::default(),
            judged: Motion { rate: Vector3::zeros(), force: Vector3::repeat(f64::NAN) },
            jacobian: MotionJacobian::default(),
            from: Here::default(),
            to: Here::default(),
            sum: None,
            products_s: initial.t_s,
            gates: aid::Gates::default(),
            pinned: false,
            extra_noise: (0.0, 0.0),
            scatter: (0.0, 0.0),
            rounding: [Vector3::zeros(); 2],
            rounding_at_rest: ConstantError::default(),
            reference_error: [0.0; 2],
            sampled_s: initial.t_s,
            bend: Some(unseen::Bend::default()),
            hold: None,
            supports: aid::stationarity::Supports::default(),
            aided_s: None,
            coasting_since_s: None,
            lost: false,
            failed: false,
            nearby: None,
            needs_surroundings: model.effects.iter().any(|s| s.effect.needs_surroundings()),
            needs_conditions: model.effects.iter().any(|s| s.effect.needs_conditions()),
            operating: Operating::default(),
            lags: LagBank::default(),
            recent: Recent::default(),
            biases_walk: model.effects.iter().any(|s| s.effect.acts_on(ActsOn::Biases)),
            walk: BiasWalk::default(),
            rest_evidence: 0.0,
            unwalked_s: 0.0,
            began_s: initial.t_s,
            began_height_m: initial.nav.geodetic().height_m,
        }
    }

    /// The same constants, with all that is known of them, and motion from a new start; the biases may have moved by this share of
    /// their prior sigma.
    #[must_use]
    pub fn restarted(&self, initial: &Initial, bias_share: f64) -> Self {
        let mut fresh = Self::new(&self.model, initial);
        fresh.about.calibration = self.estimate.calibration.clone();
        fresh.estimate.calibration = self.estimate.calibration.clone();
        fresh.regressor = self.regressor.clone();
        fresh.regressor.estimate_changed(&self.about.motion, &self.estimate.motion);
        // Value and covariance belong together.
        if let Some(w) = self.layout.gauss_markov() {
            fresh.x[w..].copy_from_slice(&self.x[w..]);
        }
        fresh.began_s = self.began_s;
        fresh.began_height_m = self.began_height_m;
        fresh.rounding = self.rounding;
        fresh.rounding_at_rest = self.rounding_at_rest;
        fresh.scatter = self.scatter;
        fresh.supports = self.supports;
        fresh.walk = self.walk;
        fresh.initial_sigmas[index::GYRO_BIAS..].copy_from_slice(&self.initial_sigmas[index::GYRO_BIAS..]);
        fresh.p.copy_tail(&self.p, index::GYRO_BIAS);
        for k in 0..3 {
            let imu = &self.model.imu;
            fresh.p.add_variance(index::GYRO_BIAS + k, (bias_share * imu.gyro_bias_sigma).powi(2));
            fresh.p.add_variance(index::ACCEL_BIAS + k, (bias_share * imu.accel_bias_sigma).powi(2));
        }
        fresh
    }

    /// The constants as they are known so much later, s, where nothing has been measured since; the motion stays where it was.
    #[must_use]
    pub fn aged(&self, by_s: f64) -> Self {
        let mut later = self.clone();
        later.walk_constants(by_s);
        later.decay_gauss_markov(by_s);
        later
    }

    /// Takes what the vehicle does beside moving, as last reported.
    pub fn set_operating(&mut self, operating: &Operating) {
        self.operating = *operating;
    }

    /// Lets the biases walk by so much beyond the model.
    pub fn set_walk(&mut self, walk: BiasWalk) {
        self.walk = walk;
    }

    /// The random walk of the biases beyond the model's.
    pub fn walk(&self) -> BiasWalk {
        self.walk
    }

    /// Random walk of the gyro biases by the model and beyond it, rad/s/√s.
    pub(super) fn gyro_walk_density(&self) -> f64 {
        rss(self.walk.gyro, self.model_gyro_walk_density())
    }

    /// Random walk of the accelerometer biases, m/s²/√s.
    pub(super) fn accel_walk_density(&self) -> f64 {
        let effects = self.model.effects.iter().zip(self.about.calibration.parameters());
        effects.map(|(s, p)| s.effect.bias_walk(p).accel).fold(self.walk.accel, rss)
    }

    /// Random walk of the gyro biases by the model alone, rad/s/√s.
    pub(super) fn model_gyro_walk_density(&self) -> f64 {
        let effects = self.model.effects.iter().zip(self.about.calibration.parameters());
        effects.map(|(s, p)| s.effect.bias_walk(p).gyro).fold(0.0, rss)
    }

    /// How much more likely the mean rates of a stationary vehicle since this was last taken are than without a walk beyond the model's, nats.
    pub fn take_rest_evidence(&mut self) -> f64 {
        std::mem::take(&mut self.rest_evidence)
    }

    /// Replaces position, velocity and attitude; the covariance stays.
    pub fn set_nav(&mut self, nav: NavState) {
        self.arrive();
        self.about.nav = nav;
        self.estimate.nav = nav;
        self.x[..index::GYRO_BIAS].fill(0.0);
    }

    /// Says how far single samples scatter, variances of rate, (rad/s)², and specific force, (m/s²)²: vibration is no excitation.
    pub fn set_scatter(&mut self, scatter: (f64, f64)) {
        self.scatter = scatter;
    }

    /// Says what is not known of the Earth's rate, (rad/s)² per axis, and of gravity, (m/s²)²: of a place or a heading that nobody knows.
    pub(crate) fn set_reference_error(&mut self, variances: [f64; 2]) {
        self.reference_error = variances;
    }

    /// The motion that comes in is known, also between its samples: that of a plan or of a simulation.
    pub(crate) fn know_what_lies_between(&mut self) {
        self.bend = None;
    }

    /// Says how samples came about and how much variance per hertz their rounding adds.
    pub fn set_stream(&mut self, kind: SampleKind, extra_noise: (f64, f64)) {
        self.kind = kind;
        self.extra_noise = extra_noise;
    }

    /// Whether fixes depend on samples around them that this filter has not got.
    pub(super) fn looks_around_fixes(&self) -> bool {
        self.model.effects.iter().any(|s| s.effect.needs_motion_around())
    }

    /// What the receiver smooths with, as far as it is known.
    pub(super) fn kernel(&self) -> Kernel {
        let effects = self.model.effects.iter().zip(self.about.calibration.parameters());
        Antenna::of(effects.map(|(s, p)| (s.effect, p.as_slice())), Default::default()).kernel
    }

    /// Whether state or covariance are not finite and positive: nothing follows from them any more.
    pub fn has_failed(&self) -> bool {
        self.failed
    }

    /// Whether fixes stayed away for so long that the attitude is too uncertain to go on from.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// Whether the constants and their covariance are finite and sound, so that another filter may start from them.
    pub fn has_sound_constants(&self) -> bool {
        let tail = index::GYRO_BIAS..self.layout.len();
        let values = tail.clone().all(|s| self.estimate.calibration.get(&self.layout, s).is_finite());
        values
            && tail.clone().all(|i| {
                let own = self.p.at(i, i);
                own.is_finite() && own > 0.0 && tail.clone().all(|j| self.p.at(i, j).is_finite())
            })
    }

    /// 1-sigma of the rotation about the vertical, rad: of the heading, whatever the pitch.
    pub fn heading_sigma(&self) -> f64 {
        let down = self.about.nav.down_b();
        down.dot(&(self.p.block3(index::ATTITUDE) * down)).max(0.0).sqrt()
    }

    /// Time of the state, s.
    pub fn t_s(&self) -> f64 {
        self.t_s
    }

    /// Position, velocity, attitude, as of the last measurement that was applied or [`Filter::arrive`].
    pub fn nav(&self) -> &NavState {
        &self.estimate.nav
    }

    /// Compensated motion at the last sample.
    pub fn motion(&self) -> &Motion {
        &self.estimate.motion
    }

    /// Biases and effect parameters.
    pub fn calibration(&self) -> &Calibration {
        &self.estimate.calibration
    }

    /// Mean error about the trajectory that the covariance is expressed about, and that trajectory.
    pub(crate) fn linearised(&self) -> (&[f64], &NavState, &Calibration) {
        (&self.x, &self.about.nav, &self.about.calibration)
    }

    /// The model whose states these are.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The order of the states.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Error covariance.
    pub fn covariance(&self) -> &Covariance {
        &self.p
    }

    /// 1-sigma of every state at the start.
    pub fn initial_sigmas(&self) -> &[f64] {
        &self.initial_sigmas
    }

    /// Whether the samples are points or means.
    pub fn kind(&self) -> SampleKind {
        self.kind
    }

    /// How the compensated rate depends on each constant state from the gyro bias on, where this specific force acts.
    pub fn rate_rows(&self, force: &Vector3<f64>) -> Vec<Vector3<f64>> {
        let at = self.last.unwrap_or(ImuSample {
            t_s: self.t_s,
            gyro: Vector3::zeros(),
            accel: Vector3::zeros(),
            temperature_degc: None,
        });
        let mut out = MotionJacobian::default();
        let motion = Motion { rate: Vector3::zeros(), force: *force };
        self.about.calibration.jacobian(&self.model, &self.layout, &at, &motion, &mut out);
        out.rate
    }

    /// 1-sigma of roll, pitch and yaw, rad.
    pub fn euler_sigma(&self) -> Vector3<f64> {
        let [roll, pitch, _] = self.about.nav.euler().into();
        let (sr, cr) = sin_cos(roll);
        // Away from the vertical; at it roll and yaw are not apart anyway.
        let (sp, cp) = (sin(pitch), cos(pitch).max(1e-3));
        // Euler rates from body rates (Groves 2013, eq. 2.58).
        let e = Matrix3::new(1.0, sr * sp / cp, cr * sp / cp, 0.0, cr, -sr, 0.0, sr / cp, cr / cp);
        let p = e * self.p.block3(index::ATTITUDE) * e.transpose();
        p.diagonal().map(|v| v.max(0.0).sqrt())
    }

    /// 1-sigma north, east, down of position (m) and velocity (m/s).
    pub fn ned_sigmas(&self) -> [Vector3<f64>; 2] {
        let c_nb = self.about.nav.c_nb();
        [index::POSITION, index::VELOCITY]
            .map(|at| (c_nb * self.p.block3(at) * c_nb.transpose()).diagonal().map(|v| v.max(0.0).sqrt()))
    }
}

#[cfg(test)]
mod tests;
