//! The trajectory that a flight is linearised about.
//!
//! A first pass goes from fix to fix and puts every correction into the state at once (an extended Kalman filter with
//! one update per fix); then the flight is linearised about that and smoothed. What is left of the attitude error
//! is below a degree all along, also where the filter did not know it yet.

use super::super::flight::Flight;
use super::kalman::{GROUPS, Kalman, normalised_squares, vectorised};
use super::track::Track;
use super::{Problem, STATES, index, measured, moved};
use crate::filter::calibration::Calibration;
use crate::identify::noise::Noise;
use crate::identify::watched::Watched;
use crate::identify::{Serial, Workers};
use crate::linear::interval::{self, NavCovariance};
use crate::mechanization::NavState;
use crate::model::Model;
use crate::sample::GnssFix;
use nalgebra::{Matrix3, Vector3};
use pulp::{Simd, WithSimd};

/// After a gap the first guess of the attitude is kept until the fixes make it known to this, rad.
const SURE: f64 = 0.05;

/// A point of the trajectory: at the time of validity of a fix.
#[derive(Debug, Clone)]
pub struct Knot {
    /// Time, s.
    pub t_s: f64,
    /// Which fix of the flight.
    pub fix: usize,
    /// Position, velocity, attitude.
    pub nav: NavState,
}

/// A trajectory with the constants that belong to it.
#[derive(Debug, Clone)]
pub struct Reference {
    /// At the start of the flight.
    pub start: NavState,
    /// At every fix.
    pub knots: Vec<Knot>,
    /// Biases, and the model's parameters.
    pub calibration: Calibration,
    /// Delays of the fixes that the times are those of, at the beginning and at the end of the flight, s.
    pub delays_s: [f64; 2],
}

/// A state that was reached across a gap, with this share of what leads from it to the knot after it: the trajectory turns where no
/// sample shows it.
fn toward(track: &mut Track<'_>, t_s: f64, reached: &NavState, knot: &Knot, share: f64) -> NavState {
    let mut nav = *reached;
    for _ in 0..2 {
        track.seek(t_s);
        let Some((interval, ahead)) = track.interval_to(&nav, knot.t_s) else { break };
        let transition = NavCovariance::from_fn(|i, j| interval.transition[j][i]);
        let Some(back) = transition.try_inverse() else { break };
        nav = moved(&nav, (back * interval::error(&ahead, &knot.nav)).as_slice());
    }
    moved(reached, (interval::error(reached, &nav) * share).as_slice())
}

/// Delay that a model says of a fix whose stamp is so long after the start, s.
pub fn delay_s(model: &Model, elapsed_s: f64) -> f64 {
    model.effects.iter().map(|s| s.effect.fix_delay_s(&s.values, elapsed_s)).sum()
}

/// The same at the beginning and at the end of a flight; in between it is on the straight line.
fn delays_s(flight: &Flight, model: &Model) -> [f64; 2] {
    [0.0, flight.duration_s()].map(|elapsed_s| delay_s(model, elapsed_s))
}

/// The time of validity of each fix that comes after the start, s, with the number of the fix.
fn valid_times<'a>(flight: &'a Flight, model: &'a Model) -> impl Iterator<Item = (usize, f64)> + 'a {
    let start_s = flight.initial().t_s;
    let valid_s = move |fix: &GnssFix| fix.t_s - delay_s(model, fix.t_s - start_s);
    flight.fixes().iter().map(valid_s).enumerate().filter(move |f| f.1 > start_s)
}

impl Reference {
    /// Finds the trajectory with this model and noise.
    pub fn find(flight: &Flight, model: &Model, noise: &Noise, workers: &dyn Workers) -> Self {
        let filtered = Self::filtered(flight, model, noise);
        let problem = Problem::new(flight, model, &filtered, &Watched::default(), workers);
        filtered.smoothed(&problem, noise)
    }

    /// The same trajectory for another model. Where that says that the fixes belong to other times, the motion at these.
    #[must_use]
    pub fn with(&self, flight: &Flight, model: &Model) -> Self {
        let mut same = self.clone();
        same.calibration = same.calibration.with_effects_of(model);
        let moved = delays_s(flight, model).iter().zip(&self.delays_s).any(|(a, b)| (a - b).abs() > 1e-9);
        if moved { same.at_other_times(flight, model) } else { same }
    }

    fn at_other_times(self, flight: &Flight, model: &Model) -> Self {
        let (samples, watched) = (flight.samples_of(model), Watched::default());
        let mut track = Track::new(flight, model, &samples, &self.calibration, &watched);
        let start_s = flight.initial().t_s;
        let mut knots = Vec::with_capacity(flight.fixes().len());
        for (fix, t_s) in valid_times(flight, model) {
            let next = self.knots.partition_point(|k| k.t_s <= t_s);
            let (from_s, nav) =
                next.checked_sub(1).map_or((start_s, self.start), |k| (self.knots[k].t_s, self.knots[k].nav));
            track.seek(from_s);
            let Some((_, mut nav)) = track.interval_to(&nav, t_s) else { break };
            if let Some(next) = self.knots.get(next).filter(|_| flight.unseen().hides(from_s, t_s)) {
                let missed = |to_s: f64| flight.unseen().attitude_sigma(from_s, to_s);
                let share = (missed(t_s) / missed(next.t_s).max(f64::MIN_POSITIVE)).powi(2);
                nav = toward(&mut track, t_s, &nav, next, share);
            }
            knots.push(Knot { t_s, fix, nav });
        }
        Self { knots, delays_s: delays_s(flight, model), ..self }
    }

    /// The trajectory of the first pass, by what came before each fix alone.
    pub fn filtered(flight: &Flight, model: &Model, noise: &Noise) -> Self {
        Self::first_pass(flight, model, noise).0
    }

    /// The trajectory of the first pass, with the squared normalised innovations of position, velocity and rate at each of its knots.
    pub(in crate::identify) fn first_pass(
        flight: &Flight,
        model: &Model,
        noise: &Noise,
    ) -> (Self, Vec<[f64; GROUPS]>) {
        vectorised(FirstPass { flight, model, noise })
    }

    fn correct(&mut self, biases: &[f64]) {
        for k in 0..3 {
            self.calibration.gyro_bias[k] += biases[k];
            self.calibration.accel_bias[k] += biases[3 + k];
        }
    }

    /// The largest angle between this trajectory and another one of the same fixes, rad.
    pub fn bend(&self, other: &Self) -> f64 {
        let angle = |(a, b): (&Knot, &Knot)| a.nav.q_eb.angle_to(&b.nav.q_eb);
        let later = self.knots.iter().zip(&other.knots).map(angle).fold(0.0, f64::max);
        later.max(self.start.q_eb.angle_to(&other.start.q_eb))
    }

    /// The smoothed trajectory of the flight as it was linearised about this one.
    #[must_use]
    pub fn smoothed(&self, problem: &Problem, noise: &Noise) -> Self {
        let smoothed = problem.smoothed(noise);
        let mut better = self.clone();
        better.start = moved(&self.start, &smoothed.start);
        for (knot, x) in better.knots.iter_mut().zip(&smoothed.fixes) {
            knot.nav = moved(&knot.nav, x);
        }
        if let Some(biases) = smoothed.biases {
            better.correct(&biases);
        }
        better
    }

    /// Mean and covariance of the states at the start, seen from this trajectory.
    pub(super) fn prior(&self, flight: &Flight, model: &Model) -> ([f64; STATES], [[f64; STATES]; STATES]) {
        let initial = flight.initial();
        let mut mean = [0.0; STATES];
        mean[..9].copy_from_slice(interval::error(&self.start, &initial.nav).as_slice());
        let mut p = [[0.0; STATES]; STATES];
        let c_bn = self.start.c_nb().transpose();
        for (at, ned) in [
            (index::POSITION, &initial.position_sigma_m),
            (index::VELOCITY, &initial.velocity_sigma_m_per_s),
            (index::ATTITUDE, &initial.attitude_sigma_rad),
        ] {
            let variances = Matrix3::from_diagonal(&Vector3::from(*ned).map(|s| s * s));
            let block = c_bn * variances * c_bn.transpose();
            (0..3).for_each(|i| (0..3).for_each(|j| p[at + i][at + j] = block[(i, j)]));
        }
        for k in 0..3 {
            let imu = &model.imu;
            mean[index::GYRO_BIAS + k] = imu.gyro_bias[k] - self.calibration.gyro_bias[k];
            mean[index::ACCEL_BIAS + k] = imu.accel_bias[k] - self.calibration.accel_bias[k];
            p[index::GYRO_BIAS + k][index::GYRO_BIAS + k] = imu.gyro_bias_sigma.powi(2);
            p[index::ACCEL_BIAS + k][index::ACCEL_BIAS + k] = imu.accel_bias_sigma.powi(2);
        }
        p[index::CLOCK][index::CLOCK] = flight.clock_sigma_s(model).powi(2);
        (mean, p)
    }
}

/// The first pass over a flight.
struct FirstPass<'a> {
    flight: &'a Flight,
    model: &'a Model,
    noise: &'a Noise,
}

impl WithSimd for FirstPass<'_> {
    type Output = (Reference, Vec<[f64; GROUPS]>);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { flight, model, noise } = self;
        let watched = Watched::default();
        let mut reference = Reference {
            start: flight.initial().nav,
            knots: Vec::with_capacity(flight.fixes().len()),
            calibration: Calibration::new(model),
            delays_s: delays_s(flight, model),
        };
        let samples = flight.samples_of(model);
        let mut track = Track::new(flight, model, &samples, &reference.calibration, &watched);
        let rounding = flight.rounding(model);
        // A problem without fixes holds what the filter starts from.
        let empty = Problem::new(flight, model, &reference, &watched, &Serial);
        let mut kalman = Kalman::new(&empty, empty.walk, noise);
        let (mut updates, mut nis) = (Vec::new(), Vec::with_capacity(flight.fixes().len()));
        let (mut nav, mut since_s, mut guessed) = (flight.initial().nav, flight.initial().t_s, false);
        let mut stamp_s = since_s;
        for (k, t_s) in valid_times(flight, model) {
            let Some((mut interval, predicted)) = track.interval_to(&nav, t_s) else { break };
            interval.rounding = rounding.at(t_s - 0.5 * interval.dt);
            let guess = flight.guessed(since_s, t_s, &predicted);
            let (fix, seen) = (&flight.fixes()[k], track.seen(guess.as_ref().unwrap_or(&predicted)));
            let rows = measured(&track, fix, (&nav, stamp_s), &mut interval, &seen).rows;
            stamp_s = fix.t_s;
            kalman.predict(simd, &interval);
            kalman.renew(interval.dt);
            since_s = t_s;
            guessed |= guess.is_some();
            let about = guess.unwrap_or(predicted);
            let known = interval::error(&about, &predicted);
            kalman.x.iter_mut().zip(known.iter()).for_each(|(x, by)| *x += by);
            kalman.correct(simd, &rows, &mut updates);
            nis.push(normalised_squares(&rows, &updates));
            guessed &= kalman.attitude_sigma() > SURE;
            if guessed {
                // Corrections stay linear about the guess until the fixes say better.
                nav = about;
                reference.knots.push(Knot { t_s, fix: k, nav });
                continue;
            }
            nav = moved(&about, &kalman.x);
            reference.correct(&kalman.x[index::GYRO_BIAS..]);
            track.set_calibration(&reference.calibration);
            kalman.x[..index::GAUSS_MARKOV].fill(0.0);
            reference.knots.push(Knot { t_s, fix: k, nav });
        }
        (reference, nis)
    }
}
