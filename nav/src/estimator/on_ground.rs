//! What the estimation does on the ground: the place as an aid where no fix says more, and how it gives way to the first fix.

use super::{Estimator, EstimatorEvent, State};
use crate::earth::Geodetic;
use crate::filter::{FixOutcome, SampleNoise};
use crate::ground::Contact;
use crate::sample::GnssFix;
use nalgebra::Vector3;

impl Estimator {
    /// Nobody has said whether the vehicle is armed: it may be.
    pub(super) fn of_unknown_flight(mut self) -> Self {
        self.ground.set_flight(false, true);
        self
    }

    /// Says where the vehicle is, for as long as no fix does.
    pub fn set_place(&mut self, place: Geodetic) {
        self.ground.set_place(place);
    }

    /// Takes whether the vehicle reports that it flies, and that it is armed. It leaves with it what it rested on in people's hands.
    pub fn set_flight(&mut self, flying: bool, armed: bool) {
        if (flying || armed)
            && !self.ground.goes_to_fly()
            && let State::Running(bank) = &mut self.state
        {
            bank.for_each(|fusion| fusion.filter_mut().leave_support());
        }
        self.ground.set_flight(flying, armed);
    }

    /// Whether a place on the ground takes the part of the fixes, and if so whether place and heading are known.
    pub fn on_ground_without_fixes(&self) -> Option<bool> {
        let now_s = self.last.map(|s| s.t_s).filter(|t| self.ground.aids(*t));
        now_s.filter(|_| self.filter().is_some()).map(|_| self.ground.reference_known())
    }

    /// Whether people may have the vehicle in their hands.
    pub fn is_handled(&self) -> bool {
        self.last.is_some_and(|s| self.ground.is_handled(s.t_s))
    }

    /// Whether they have put it down, by its samples.
    pub(crate) fn rests_in_hands(&self) -> bool {
        self.is_handled() && self.ground.stands()
    }

    /// What the place said last.
    pub(crate) fn place_fix(&self) -> Option<GnssFix> {
        self.ground.said()
    }

    /// White noise of the gyros with rounding and vibration, (rad/s)²/Hz.
    pub fn gyro_noise(&self) -> f64 {
        self.model.imu.gyro_noise.powi(2) + self.extra_noise().0
    }

    /// What became of the fixes of a receiver alone.
    pub(super) fn of_receiver(&mut self, mut outcomes: Vec<FixOutcome>) -> Vec<FixOutcome> {
        outcomes.retain(|o| !self.ground.settle(o.stamp_s, o.velocity.dof > 0 && !o.velocity.used));
        outcomes.iter().for_each(|o| self.receiver.learn(o));
        outcomes
    }

    /// What white noise and rounding leave in one sample.
    pub(super) fn sample_noise(&self, extra: (f64, f64), rounding: [Vector3<f64>; 2]) -> SampleNoise {
        let dt = self.averager.interval_s(self.meter.interval_s()).max(1e-4);
        SampleNoise::of(&self.model.imu, extra, rounding, dt)
    }

    /// A fix of a receiver, which may be the first after a start by the place alone.
    pub(super) fn feed_receiver(&mut self, fix: &GnssFix) {
        if let Some(last) = self.last.filter(|_| fix.is_plausible()) {
            match self.ground.take_fix(fix, last.t_s) {
                Contact::GoesOn => {}
                Contact::Known => self.align_anew(EstimatorEvent::PlaceKnown { constants_kept: true }, true),
                Contact::NeverStood => {
                    self.align_anew(EstimatorEvent::PlaceKnown { constants_kept: false }, false);
                }
            }
        }
        let judged = self.receiver.judge(fix, &self.model.gnss);
        self.feed_fix(&judged);
    }
}
