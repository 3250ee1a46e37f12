//! A flight linearised about one trajectory, once, so that everything after that costs milliseconds.
//!
//! Between two fixes the samples are gone through a single time: transition, effect of every watched parameter and
//! noise of the sensors are added up to one interval each. What is left is a linear Gaussian model with
//! 20 states and a few thousand scalar measurements. On it run a Kalman filter ([`forward`]: likelihood, score and
//! information of every parameter at once) and its adjoint ([`backward`]: the exact slope by every noise figure;
//! [`shocks`]: score and information of a jump at every instant). With the error in body axes (left-invariant, as in the ordinary
//! filter) the transition depends on the trajectory only through Earth's rate and gravity, so one good trajectory
//! serves every model; `reference` finds it.

pub mod backward;
pub(super) mod field;
pub mod forward;
mod imitation;
pub mod innovations;
mod kalman;
pub mod reference;
mod rough;
mod rows;
pub mod shocks;
mod touchdown;
mod track;
mod unseen;

use super::flight::Flight;
use super::noise::Noise;
use super::pass::Options;
use super::rounding::Rounding;
use super::{Workers, map};
use crate::effects::BiasWalk;
use crate::identify::watched::Watched;
use crate::linear::interval::{self, Interval};
use crate::mechanization::NavState;
use crate::model::Model;
use crate::sample::{GnssFix, ImuSample};
use forward::{Keep, Run, Runner};
use imitation::{Driven, Imitation};
use nalgebra::Vector3;
use reference::Reference;
use rows::{Measured, Seen};
use std::borrow::Cow;
use track::Track;

pub(super) use imitation::is_strong;
pub(super) use unseen::Unseen;

/// Number of states: position, velocity, attitude errors in body axes, gyro and accelerometer bias, Gauss-Markov error of the fixes
/// (north, east, down), the error of the present fix's time stamp, and the error that all stamps have in common.
pub const STATES: usize = 20;
/// First state of each block.
pub mod index {
    pub use crate::filter::layout::index::{ACCEL_BIAS, ATTITUDE, GYRO_BIAS, POSITION, VELOCITY};
    /// Gauss-Markov error of the fixes.
    pub const GAUSS_MARKOV: usize = 15;
    /// Error of the time stamp.
    pub const STAMP: usize = 18;
    /// What all time stamps are off by: jitter and filters of the samples delay them by a millisecond or so.
    pub const CLOCK: usize = 19;
}
/// Fixes closer to the end of the samples than this count for no model: with a delay they are there, without it they may not be.
const END_S: f64 = 1.0;
/// A flight is linearised in so many stretches at once …
const PIECES: usize = 4;
/// … each of so many fixes where nothing of it is kept.
const PASSING: usize = 128;

/// One fix: the way to it and what it measured.
#[derive(Debug, Clone)]
struct Epoch {
    interval: Interval,
    /// By how much noise of the samples moves each watched parameter's column, where that noise is strong.
    driven: Driven,
    /// Time of validity, s.
    t_s: f64,
    /// Of the stamp, after the start, s.
    elapsed_s: f64,
    /// Whether the vehicle turned far in a gap a moment ago: linear theory does not hold yet, and the fix counts for no model.
    unsettled: bool,
    measured: Measured,
}

/// A flight as a linear model.
#[derive(Debug, Clone)]
pub struct Problem {
    /// In the stretches that it was linearised in.
    pieces: Vec<Vec<Epoch>>,
    /// Number of watched parameters.
    columns: usize,
    /// Mean of the states at the start.
    start: [f64; STATES],
    /// Covariance of the states at the start, without the Gauss-Markov error's.
    start_covariance: Box<[[f64; STATES]; STATES]>,
    /// Random walk of the biases that the model says.
    walk: BiasWalk,
    /// From here on fixes count for no model, s after the start.
    end_s: f64,
}

impl Problem {
    /// Linearises a flight. Watched are the states of `watched.effects`; jumps need no columns.
    pub fn new(
        flight: &Flight,
        model: &Model,
        reference: &Reference,
        watched: &Watched,
        workers: &dyn Workers,
    ) -> Self {
        let about = About::new(flight, model, reference, watched);
        // With the trajectory known, no stretch of the flight waits for the one before.
        let length = reference.knots.len().div_ceil(PIECES).max(1);
        let pieces =
            map(workers, reference.knots.len().div_ceil(length), |k| about.linearised(k * length, length));
        Self { pieces, ..Self::without_fixes(&about) }
    }

    /// What the filter starts from.
    fn without_fixes(about: &About<'_>) -> Self {
        let About { flight, model, reference, watched, .. } = *about;
        let (start, start_covariance) = reference.prior(flight, model);
        Self {
            pieces: Vec::new(),
            columns: watched.slots().len(),
            start,
            start_covariance: Box::new(start_covariance),
            walk: walk(model),
            end_s: flight.duration_s() - END_S,
        }
    }

    /// Runs the filter over a flight while it is linearised, piece by piece: nothing of it is kept, however much is watched. With
    /// score and information of each block of `block_s` by itself where that is asked for, once for each random walk of the biases.
    pub fn run_through(
        about: &About<'_>,
        walks: &[BiasWalk],
        (noise, options): (&Noise, &Options),
        block_s: Option<f64>,
        workers: &dyn Workers,
    ) -> Vec<Run> {
        let problem = Self::without_fixes(about);
        let keep = block_s.map_or(Keep::Nothing, Keep::Blocks);
        let runner = |walk: &BiasWalk| Runner::new(&problem, (noise, options), *walk, keep, problem.columns);
        let mut runners: Vec<Runner<'_>> = walks.iter().map(runner).collect();
        let mut imitations = about.flight.is_noisy().then(|| {
            let whole = Self::new(about.flight, about.model, about.reference, &Watched::default(), workers);
            Imitation::of_parts(&whole, noise, options, problem.columns)
        });
        for first in (0..about.reference.knots.len()).step_by(PIECES * PASSING) {
            let pieces = map(workers, PIECES, |k| about.linearised(first + k * PASSING, PASSING));
            runners.iter_mut().for_each(|runner| pieces.iter().for_each(|epochs| runner.go(epochs)));
            for imitation in imitations.iter_mut().flatten() {
                pieces.iter().flatten().for_each(|epoch| imitation.take(epoch, noise));
            }
        }
        let imitated = imitations.map(|parts| parts.map(Imitation::end));
        let mut runs: Vec<Run> = runners.into_iter().map(|runner| runner.end().0).collect();
        runs.iter_mut().for_each(|run| run.imitated(imitated.as_ref()));
        runs
    }

    /// Times of validity of the fixes, s.
    pub fn times(&self) -> impl Iterator<Item = f64> + '_ {
        self.epochs().map(|e| e.t_s)
    }

    /// Fix by fix.
    fn epochs(&self) -> impl DoubleEndedIterator<Item = &Epoch> {
        self.pieces.iter().flatten()
    }

    /// Number of fixes.
    fn len(&self) -> usize {
        self.pieces.iter().map(Vec::len).sum()
    }

    /// The same flight with this random walk of the biases.
    pub fn set_walk(&mut self, walk: BiasWalk) {
        self.walk = walk;
    }

    /// The random walk of the biases.
    pub fn walk(&self) -> BiasWalk {
        self.walk
    }

    /// The same flight with the watched parameters moved by so much, as far as the linear model reaches.
    pub fn move_by(&mut self, step: &[f64]) {
        for epoch in self.pieces.iter_mut().flatten() {
            for (column, by) in epoch.interval.driven.iter().zip(step) {
                epoch.interval.offset += column * *by;
            }
            epoch.measured.move_by(step);
        }
    }

    fn part(&self, epoch: &Epoch, options: &Options) -> Option<usize> {
        options.part(epoch.elapsed_s).filter(|_| epoch.elapsed_s < self.end_s && !epoch.unsettled)
    }
}

/// What a flight is linearised about.
pub struct About<'a> {
    flight: &'a Flight,
    model: &'a Model,
    reference: &'a Reference,
    watched: &'a Watched,
    samples: Cow<'a, [ImuSample]>,
    rounding: Rounding,
}

impl<'a> About<'a> {
    /// Watched are the states of `watched.effects` and the terms; jumps need no columns.
    pub fn new(flight: &'a Flight, model: &'a Model, reference: &'a Reference, watched: &'a Watched) -> Self {
        let (samples, rounding) = (flight.samples_of(model), flight.rounding(model));
        Self { flight, model, reference, watched, samples, rounding }
    }

    /// The fixes from number `first` on, `length` of them or as many as the samples reach.
    fn linearised(&self, first: usize, length: usize) -> Vec<Epoch> {
        let Self { flight, reference, .. } = self;
        let knots = reference.knots.iter().skip(first).take(length);
        let mut epochs = Vec::with_capacity(knots.len());
        if knots.len() == 0 {
            return epochs;
        }
        let mut track = Track::new(flight, self.model, &self.samples, &reference.calibration, self.watched);
        let (mut nav, mut since_s) = (reference.start, flight.initial().t_s);
        if let Some(before) = first.checked_sub(1).and_then(|k| reference.knots.get(k)) {
            track.seek(before.t_s);
            (nav, since_s) = (before.nav, flight.fixes().get(before.fix).map_or(since_s, |f| f.t_s));
        }
        for knot in knots {
            let Some((mut interval, predicted)) = track.interval_to(&nav, knot.t_s) else { break };
            interval.set_offset(interval::error(&knot.nav, &predicted));
            interval.rounding = self.rounding.at(knot.t_s - 0.5 * interval.dt);
            let fix = &flight.fixes()[knot.fix];
            let seen = track.seen(&knot.nav);
            let measured = measured(&track, fix, (&nav, since_s), &mut interval, &seen);
            let driven =
                if flight.is_noisy() { track.driven(&seen, &measured.rows) } else { Driven::default() };
            since_s = fix.t_s;
            let elapsed_s = fix.t_s - flight.initial().t_s;
            let unsettled = flight.unseen().unsettles(fix.t_s);
            epochs.push(Epoch { interval, driven, t_s: knot.t_s, elapsed_s, unsettled, measured });
            nav = knot.nav;
        }
        epochs
    }
}

/// What a fix measures at the end of an interval from a state at the fix before, which had this stamp; with what rest adds and takes off. Whether the unit
/// rested is asked of the stamps: times of validity move with each delay that is tried, and models with other rows are not compared.
fn measured(
    track: &Track<'_>,
    fix: &GnssFix,
    (from, from_s): (&NavState, f64),
    interval: &mut Interval,
    seen: &Seen<'_>,
) -> Measured {
    let by_hand = track.flight.by_hand();
    let of = if by_hand.gave(fix) { rows::of_place } else { rows::of };
    let mut measured = of(fix, seen);
    if let Some(unknown) = by_hand.rests(from_s, fix.t_s).filter(|_| fix.t_s > from_s) {
        interval.rounding.0 += unknown[0];
        interval.rounding.1 += unknown[1];
        rows::rest(interval, [from, seen.at.nav], (track, [from_s, fix.t_s]), &mut measured);
    }
    measured
}

/// The random walk of the biases that a model says.
pub fn walk(model: &Model) -> BiasWalk {
    model.effects.iter().map(|s| s.effect.bias_walk(&s.values)).fold(BiasWalk::default(), BiasWalk::and)
}

/// Adds an error in body axes to a state.
fn moved(nav: &NavState, x: &[f64]) -> NavState {
    let part = |at: usize| Vector3::new(x[at], x[at + 1], x[at + 2]);
    let eps = part(index::ATTITUDE);
    let (j, c_eb) = (crate::rotation::left_jacobian(&eps), nav.c_eb());
    let mut q_eb = nav.q_eb * crate::rotation::exp(&eps);
    q_eb.renormalize();
    NavState {
        r_e: nav.r_e + c_eb * j * part(index::POSITION),
        v_e: nav.v_e + c_eb * j * part(index::VELOCITY),
        q_eb,
    }
}

/// Variances per hertz of gyros and accelerometers over an interval: their noise, and what rounding adds.
fn variances(noise: &Noise, interval: &Interval) -> (f64, f64) {
    (noise.gyro * noise.gyro + interval.rounding.0, noise.accel * noise.accel + interval.rounding.1)
}

#[cfg(test)]
mod tests;
