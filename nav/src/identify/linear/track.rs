//! Along the samples of a flight: the sensors at each of them, and the way from one fix to the next.

use super::super::flight::Flight;
use super::imitation::{self, Driven};
use super::rows::{Row, Seen};
use super::unseen::Unseen;
use crate::earth;
use crate::effects::{Conditions, Instant};
use crate::filter::calibration::Calibration;
use crate::filter::force_rate::ForceRates;
use crate::filter::unseen::GAP_S;
use crate::identify::watched::Watched;
use crate::linear::fix::AtFix;
use crate::linear::interval::{Here, Interval, Sum};
use crate::mechanization::{Motion, NavState};
use crate::model::Model;
use crate::sample::{ImuSample, SampleKind};
use nalgebra::{Matrix3, Vector3};

/// What a unit turns with that does not move, in its axes, rad/s.
fn earths_rate(nav: &NavState) -> Vector3<f64> {
    nav.q_eb.inverse() * earth::rotation_rate()
}

/// Goes along the samples of a flight.
pub(super) struct Track<'a> {
    samples: &'a [ImuSample],
    force_rates: &'a ForceRates,
    pub(super) flight: &'a Flight,
    unseen: &'a Unseen,
    next: usize,
    kind: SampleKind,
    model: &'a Model,
    watched: &'a Watched,
    calibration: Calibration,
    last: ImuSample,
    start_s: f64,
    /// Whether an effect depends on more than single samples.
    needs_surroundings: bool,
    /// Whether an effect or a term depends on more than motion.
    needs_conditions: bool,
    from: Here,
    to: Here,
}

impl<'a> Track<'a> {
    /// At the start of the flight.
    pub(super) fn new(
        flight: &'a Flight,
        model: &'a Model,
        samples: &'a [ImuSample],
        calibration: &Calibration,
        watched: &'a Watched,
    ) -> Self {
        let start_s = flight.initial().t_s;
        let still = ImuSample {
            t_s: start_s,
            gyro: Vector3::zeros(),
            accel: Vector3::zeros(),
            temperature_degc: None,
        };
        let mut track = Self {
            samples,
            force_rates: flight.force_rates(),
            flight,
            unseen: flight.unseen(),
            next: 0,
            kind: flight.stream().kind,
            model,
            watched,
            calibration: calibration.clone(),
            last: still,
            start_s,
            needs_surroundings: model
                .effects
                .iter()
                .chain(&watched.effects)
                .any(|s| s.effect.needs_surroundings()),
            needs_conditions: model
                .effects
                .iter()
                .chain(&watched.effects)
                .any(|s| s.effect.needs_conditions()),
            from: Here::default(),
            to: Here::default(),
        };
        track.seek(start_s);
        track
    }

    /// To this instant, as if all samples before it had been gone through.
    pub(super) fn seek(&mut self, t_s: f64) {
        self.next = self.samples.partition_point(|s| s.t_s <= t_s);
        let before = self.next.checked_sub(1).and_then(|k| self.samples.get(k));
        self.last = match (before, self.samples.get(self.next)) {
            (Some(before), Some(next)) => {
                self.last = *before;
                self.last.between(next, self.kind, t_s)
            }
            (one, other) => ImuSample { t_s, ..*one.or(other).unwrap_or(&self.last) },
        };
        self.see(&self.last.clone(), None);
    }

    /// Biases and parameters from here on.
    pub(super) fn set_calibration(&mut self, calibration: &Calibration) {
        self.calibration.clone_from(calibration);
        self.see(&self.last.clone(), None);
    }

    /// The vehicle at the end of the last interval, on this trajectory.
    pub(super) fn seen<'s>(&'s self, nav: &'s NavState) -> Seen<'s> {
        let at = AtFix {
            nav,
            motion: &self.to.motion,
            shown: self.last.accel,
            model: self.model,
            calibration: &self.calibration,
            rates: Some(self.force_rates),
            t_s: self.to.t_s,
            elapsed_s: self.to.t_s - self.start_s,
        };
        // Noise of the samples moves no fix of a unit that rests: with a velocity that is 0.18 s old it was 4.5 nats against the truth.
        let rests = self.flight.by_hand().rests(self.to.t_s, self.to.t_s).is_some();
        let x = if rests { at.instant().at_rest() } else { at.instant() };
        Seen { x, at, watched: self.watched }
    }

    /// What the gyros of a unit at rest would show between two times less what they showed, rad: both as the sensor has it, so that no model changes their noise.
    pub(super) fn less_than_at_rest(&self, nav: &NavState, [from_s, to_s]: [f64; 2]) -> Vector3<f64> {
        let mut calibration = self.calibration.clone();
        calibration.around = calibration.around.at_rest();
        let motion = Motion { rate: earths_rate(nav), force: self.to.motion.force };
        let shown = calibration.measure(self.model, &self.last, &motion).rate;
        shown * (to_s - from_s) - self.shown_between(from_s, to_s)
    }

    /// What the gyros showed between two times, rad.
    fn shown_between(&self, from_s: f64, to_s: f64) -> Vector3<f64> {
        let first = self.samples.partition_point(|s| s.t_s <= from_s).max(1);
        let mut turned = Vector3::zeros();
        for pair in self.samples[first - 1..].windows(2) {
            let [last, next] = pair else { break };
            let [from, to] = [from_s, to_s].map(|t| t.clamp(last.t_s, next.t_s));
            turned += last.between(next, self.kind, 0.5 * (from + to)).gyro * (to - from);
            if next.t_s >= to_s {
                break;
            }
        }
        turned
    }

    /// By how much noise of the samples moves each column over the last interval and at the fix at its end, which has these rows.
    pub(super) fn driven(&self, seen: &Seen<'_>, rows: &[Row]) -> Driven {
        imitation::driven(self.watched, &self.instant(&self.last), &seen.x, (rows, self.flight.sample_s()))
    }

    /// What the samples around an instant show, where an effect asks for it.
    fn look_around(&mut self, t_s: f64) {
        if self.needs_surroundings {
            let lag_s = self.calibration.rate_lag_s(self.model);
            self.calibration.around = self.force_rates.around(t_s, lag_s);
        }
    }

    /// What the vehicle does beside moving, where something asks for it.
    fn conditions(&self, t_s: f64, nav: Option<&NavState>) -> Conditions {
        if !self.needs_conditions {
            return Conditions::default();
        }
        let mut conditions = self.flight.conditions(t_s);
        if let Some(nav) = nav {
            conditions.speed = nav.v_e.norm();
            conditions.height_m = nav.geodetic().height_m - self.flight.initial().nav.geodetic().height_m;
            conditions.heading_rad = nav.euler().z;
        }
        conditions
    }

    /// What effects and terms depend on at the end of the last step, which came to this sample.
    fn instant(&self, sample: &ImuSample) -> Instant {
        Instant {
            t_s: sample.t_s,
            rate: self.to.motion.rate,
            force: self.to.motion.force,
            temperature_above_25_degc: sample.temperature_degc.map_or(0.0, |t| t - 25.0),
            around: self.calibration.around,
            conditions: self.calibration.conditions,
        }
    }

    /// Motion and columns at a sample become those of the end of a step.
    fn see(&mut self, sample: &ImuSample, nav: Option<&NavState>) {
        std::mem::swap(&mut self.from, &mut self.to);
        // A mean is one of the middle of its interval.
        let dt = sample.t_s - self.from.t_s;
        let is_mean = self.kind != SampleKind::Point && dt > 0.0 && dt < GAP_S;
        self.look_around(sample.t_s - if is_mean { 0.5 * dt } else { 0.0 });
        self.calibration.conditions = self.conditions(sample.t_s, nav);
        let motion = self.calibration.motion(self.model, sample);
        (self.to.t_s, self.to.motion, self.to.lever) = (sample.t_s, motion, motion);
        let mut x = self.instant(sample);
        if self.flight.by_hand().rests(sample.t_s, sample.t_s).is_some() {
            // Of a unit that rests the rate is known better than the samples show it, and their noise is not in the columns: a scale factor that
            // shrinks it would be likelier for that alone.
            x.rate = nav.map_or_else(Vector3::zeros, earths_rate);
            x.around = x.around.at_rest();
        }
        let here = &mut self.to;
        (here.by_force, here.by_rate) = (Matrix3::zeros(), Matrix3::zeros());
        for (setting, p) in self.model.effects.iter().zip(self.calibration.parameters()) {
            here.by_force += setting.effect.gyro_by_force(p, &x).unwrap_or_default();
            here.by_rate += setting.effect.accel_by_rate(p, &x).unwrap_or_default();
        }
        here.columns.clear();
        self.watched.columns(&x, &mut here.columns);
        // An accelerometer error passes through the g-sensitivity that the model knows of.
        for [rate, force] in &mut here.columns {
            *rate -= here.by_force * *force;
        }
    }

    /// The samples up to a time as one interval, and where the mechanisation gets to. `None` where the samples end before.
    pub(super) fn interval_to(&mut self, nav: &NavState, t_s: f64) -> Option<(Interval, NavState)> {
        let mut sum = Sum::new(nav, self.to.columns.len());
        loop {
            let next = self.samples.get(self.next).copied()?;
            let arrived = next.t_s > t_s;
            let sample = if arrived { self.last.between(&next, self.kind, t_s) } else { next };
            if !arrived {
                self.next += 1;
            }
            let dt = sample.t_s - self.to.t_s;
            if dt > 0.0 {
                self.see(&sample, Some(sum.nav()));
                sum.add(&self.from, &self.to, self.kind, dt);
                if let Some(missed) = self.unseen.within(self.from.t_s, self.to.t_s) {
                    sum.add_gap(&missed);
                }
                self.last = sample;
            }
            if arrived {
                return Some(sum.end());
            }
        }
    }
}
