//! What a linearised flight shows of a model, for the reader: the innovation of every fix, and how far the simulation drifts away
//! without fixes. Both are those of the likelihood that chose the model.

use super::forward::Run;
use super::kalman::{Kalman, normalised_squares};
use super::reference::Reference;
use super::track::Track;
use super::{Epoch, Problem, index, moved, rows};
use crate::filter::Group;
use crate::identify::flight::Flight;
use crate::identify::noise::Noise;
use crate::identify::pass::{Innovation, Options};
use crate::identify::watched::Watched;
use crate::model::Model;
use pulp::Scalar;

/// Position errors without fixes are measured after these times, s.
pub const DRIFT_S: [f64; 3] = [5.0, 10.0, 30.0];
/// A drift starts this often, s.
const DRIFT_EVERY_S: f64 = 10.0;

/// Innovations of a flight with their likelihood.
#[derive(Debug, Clone)]
pub struct Innovations {
    /// Fix by fix.
    pub fixes: Vec<Innovation>,
    /// Logarithm of the (robust) likelihood: fit part, held-out part.
    pub log_likelihood: [f64; 2],
    /// Normalised innovations squared and their number, by part.
    pub nis: [(f64, usize); 2],
}

/// Sums of squared horizontal errors after the times of [`DRIFT_S`] without fixes, m², with their number.
pub type Drift = [(f64, usize); 3];

impl Problem {
    /// The innovation of every fix with this noise.
    pub fn innovations(&self, noise: &Noise, options: &Options) -> Innovations {
        let mut run = Run::empty(0);
        let mut kalman = Kalman::new(self, self.walk, noise);
        let mut fixes = Vec::with_capacity(self.epochs().count());
        let mut updates = Vec::new();
        for epoch in self.epochs() {
            kalman.predict(Scalar, &epoch.interval);
            kalman.renew(epoch.interval.dt);
            let part = self.part(epoch, options);
            let [mut position, mut velocity] = groups(&kalman, epoch);
            kalman.correct(Scalar, &epoch.measured.rows, &mut updates);
            [position.nis, velocity.nis, _] = normalised_squares(&epoch.measured.rows, &updates);
            run.count(part, &epoch.measured.rows, &updates, &[]);
            fixes.push(Innovation { t_s: epoch.t_s, elapsed_s: epoch.elapsed_s, part, position, velocity });
        }
        Innovations { fixes, log_likelihood: run.log_likelihood, nis: run.nis }
    }
}

/// Position and velocity of a fix before either is applied, row by row.
fn groups(kalman: &Kalman<'_>, epoch: &Epoch) -> [Group; 2] {
    let mut groups = [Group::default(); 2];
    for row in epoch.measured.rows.iter().filter(|r| r.group() < 2) {
        let (innovation, variance) = kalman.innovation(row);
        let group = &mut groups[row.group()];
        let normalised = innovation / variance.sqrt();
        if let (Some(i), Some(n)) = (group.innovation.get_mut(group.dof), group.normalised.get_mut(group.dof))
        {
            (*i, *n) = (innovation, normalised);
            group.dof += 1;
        }
    }
    groups
}

impl Reference {
    /// How far the simulation of `model` drifts away from the fixes when it gets none. It starts from what the fixes before have shown, and no
    /// drift goes over a gap between samples.
    pub fn drift(
        &self,
        flight: &Flight,
        model: &Model,
        problem: &Problem,
        noise: &Noise,
        options: &Options,
    ) -> Drift {
        let (samples, watched) = (flight.samples_of(model), Watched::default());
        let mut track = Track::new(flight, model, &samples, &self.calibration, &watched);
        let mut kalman = Kalman::new(problem, problem.walk, noise);
        let mut next_s = options.settle_s;
        let mut sums = [(0.0, 0); 3];
        let mut updates = Vec::new();
        for (k, epoch) in problem.epochs().enumerate() {
            kalman.predict(Scalar, &epoch.interval);
            kalman.renew(epoch.interval.dt);
            kalman.correct(Scalar, &epoch.measured.rows, &mut updates);
            if epoch.elapsed_s < next_s {
                continue;
            }
            next_s = epoch.elapsed_s + DRIFT_EVERY_S;
            let mut calibration = self.calibration.clone();
            for i in 0..3 {
                calibration.gyro_bias[i] += kalman.x[index::GYRO_BIAS + i];
                calibration.accel_bias[i] += kalman.x[index::ACCEL_BIAS + i];
            }
            track.set_calibration(&calibration);
            self.free(flight, &mut track, k, &kalman.x, &mut sums);
        }
        sums
    }

    /// From knot number `first`, corrected by `x`, on without fixes.
    fn free(
        &self,
        flight: &Flight,
        track: &mut Track<'_>,
        first: usize,
        x: &[f64],
        sums: &mut Drift,
    ) -> Option<()> {
        let start = self.knots.get(first)?;
        let mut nav = moved(&start.nav, x);
        track.seek(start.t_s);
        for (sum, after_s) in sums.iter_mut().zip(DRIFT_S) {
            let end = self.knots.partition_point(|k| k.t_s < start.t_s + after_s);
            let knot = self.knots.get(end)?;
            if flight.unseen().hides(start.t_s, knot.t_s) {
                return None;
            }
            (_, nav) = track.interval_to(&nav, knot.t_s)?;
            let fix = flight.fixes().get(knot.fix).filter(|f| !flight.by_hand().gave(f))?;
            sum.0 += rows::of(fix, &track.seen(&nav))
                .rows
                .iter()
                .take(2)
                .map(|row| row.residual.powi(2))
                .sum::<f64>();
            sum.1 += 1;
        }
        Some(())
    }
}
