//! The place as an aid: when it may be used, and what it says.

use crate::earth::{Geodetic, ROTATION_RATE};
use crate::filter::{Detector, SampleNoise};
use crate::rss;
use crate::sample::{FixVelocity, GnssFix, ImuSample};
use nalgebra::Vector3;
use std::collections::VecDeque;

/// The place is counted once in so long, s: hands go to and fro within it.
const EVERY_S: f64 = 1.0;
/// 1-sigma of the velocity of what hands hold, m/s.
const HAND_SPEED: f64 = 1.0;
/// While it turns, lever arms move it and the gyros alone do well for seconds: beyond this rate, rad/s, the place is not counted …
const TURNING: f64 = 0.2;
/// … for at most so long, s.
const TURNING_AT_MOST_S: f64 = 8.0;
/// 1-sigma of the position, m: it says nothing, so that no constant of a receiver is learnt from it.
const POSITION_SIGMA_M: f64 = 100.0;
/// After so long without rest the vehicle is carried or driven, s.
const HANDS_S: f64 = 60.0;
/// A fix that is younger than this says more, s.
const FIX_AGE_S: f64 = 2.0;
/// A fix that is faster than this comes from no vehicle in people's hands, m/s.
const FAST: f64 = 3.0;
/// A fix that is further than this from where the vehicle stood, m and in its own sigmas together, was taken somewhere else: receivers wander by metres.
const ELSEWHERE: (f64, f64) = (8.0, 4.0);
/// Rest at the time of a fast fix was a smooth flight, s.
const REST_AGE_S: f64 = 3.0;
/// A vehicle that has left its place, or reports to be armed, must have stood for so long, s.
const STOOD_S: f64 = 10.0;
/// So many refusals in a row of what the place says, and the vehicle has left it.
const REFUSED: u32 = 2;
/// Fixes of its own whose result is awaited.
const MOST_WAITING: usize = 64;

/// Variances of what an unknown place or heading leaves of the Earth's rate, per axis, (rad/s)², and of gravity, (m/s²)²: 15 deg/h in all, and
/// half of the 0.052 m/s² between equator and pole.
pub(crate) const REFERENCE_ERROR: [f64; 2] = [ROTATION_RATE * ROTATION_RATE / 3.0, 0.026 * 0.026];

/// What a real fix means for what the place has begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Contact {
    /// The fix is one like any other.
    GoesOn,
    /// The first one: position and heading begin anew from it, the constants go on.
    Known,
    /// The vehicle was never at rest: nothing of it holds.
    NeverStood,
}

/// The aid.
#[derive(Debug, Clone, Default)]
pub(crate) struct PlaceAid {
    detector: Detector,
    /// Where the vehicle is, as people or fixes have said.
    place: Option<Geodetic>,
    /// Whether the vehicle reports that it flies, and that it is armed.
    flying: bool,
    armed: bool,
    /// Whether it has left its place, by what contradicts the place, …
    left: bool,
    /// … and by fixes: then only a fix can say that it is back. A smooth cruise looks like rest to samples.
    away: bool,
    /// Where fixes were while it stood.
    stood_at: Option<Vector3<f64>>,
    refused: u32,
    stands_since_s: Option<f64>,
    stood_s: Option<f64>,
    fix_s: Option<f64>,
    given_s: Option<f64>,
    said: Option<GnssFix>,
    given: VecDeque<f64>,
    /// Whether the filter began by it, and no fix has come since.
    alone: bool,
    heading_known: bool,
}

impl PlaceAid {
    /// Says where the vehicle is.
    pub(crate) fn set_place(&mut self, place: Geodetic) {
        self.place = Some(place);
    }

    /// Takes the home position that the vehicle reports: its place while no fix has said better.
    pub(crate) fn set_home(&mut self, home: Geodetic) {
        if self.fix_s.is_none() {
            self.place = Some(home);
        }
    }

    /// Takes what the vehicle reports of itself.
    pub(crate) fn set_flight(&mut self, flying: bool, armed: bool) {
        (self.flying, self.armed) = (flying, armed);
    }

    /// Whether the vehicle reports that it flies or is armed.
    pub(crate) fn goes_to_fly(&self) -> bool {
        self.flying || self.armed
    }

    /// Whether it aids the filter at present.
    pub(crate) fn aids(&self, now_s: f64) -> bool {
        self.alone || self.given_s.is_some_and(|t| now_s - t < 2.0 * TURNING_AT_MOST_S)
    }

    /// Whether people may have it in their hands: it stood not long ago, and nothing says that it has left its place.
    pub(crate) fn is_handled(&self, now_s: f64) -> bool {
        let by_hand = self.stood_s.is_some_and(|stood| now_s - stood < HANDS_S);
        by_hand && !self.flying && !self.left && !self.away
    }

    /// Whether the vehicle stands, by its samples alone.
    pub(crate) fn stands(&self) -> bool {
        self.detector.is_stationary()
    }

    /// Whether place and heading are known where the filter began by the place.
    pub(crate) fn reference_known(&self) -> bool {
        !self.alone || (self.place.is_some() && self.heading_known)
    }

    /// Whether the vehicle has left the place by which alone the filter began: its motion is not known any more. Says so once.
    pub(crate) fn lost(&mut self) -> bool {
        let lost = self.alone && (self.left || self.flying);
        self.alone &= !lost;
        lost
    }

    /// Whether this fix is one of its own.
    pub(crate) fn gave(&self, fix: &GnssFix) -> bool {
        self.given.contains(&fix.t_s)
    }

    /// What it said last.
    pub(crate) fn said(&self) -> Option<GnssFix> {
        self.said
    }

    /// The filter begins by the place.
    pub(crate) fn begin(&mut self, heading_known: bool) {
        (self.alone, self.heading_known) = (true, heading_known);
    }

    /// The stream starts anew.
    pub(crate) fn restart(&mut self) {
        let Self { place, flying, armed, left, away, .. } = *self;
        *self = Self { place, flying, armed, left, away, ..Self::default() };
    }

    /// Takes a sample; gives a fix where the place has something to say.
    pub(crate) fn take(&mut self, sample: &ImuSample, noise: &SampleNoise) -> Option<GnssFix> {
        let t_s = sample.t_s;
        let place = self.place.unwrap_or(Geodetic::from_degrees(45.0, 0.0, 0.0));
        let fix = GnssFix {
            t_s,
            position: place,
            velocity: FixVelocity::Full([0.0; 3]),
            position_sigma_m: Some([POSITION_SIGMA_M; 3]),
            velocity_sigma_m_per_s: Some([HAND_SPEED; 3]),
            yaw_rad: None,
        };
        self.detector.push_fix(&fix, [HAND_SPEED; 3]);
        self.detector.push_imu(sample, noise);
        if self.stands() {
            self.stood_s = Some(t_s);
            self.stands_since_s.get_or_insert(t_s);
        } else {
            self.stands_since_s = None;
        }
        let long = self.stands_since_s.is_some_and(|since| t_s - since >= STOOD_S);
        self.left &= !long || self.armed;
        let turning = sample.gyro.norm() > TURNING;
        let since_s = self.given_s.map_or(f64::INFINITY, |given| t_s - given);
        let due = since_s >= if turning { TURNING_AT_MOST_S } else { EVERY_S };
        let fixed = self.fix_s.is_some_and(|fix| t_s - fix < FIX_AGE_S);
        let begun = long || !self.armed || self.given_s.is_some();
        if !self.is_handled(t_s) || fixed || !begun || !due {
            return None;
        }
        (self.given_s, self.said) = (Some(t_s), Some(fix));
        if self.given.len() == MOST_WAITING {
            self.given.pop_front();
        }
        self.given.push_back(t_s);
        Some(fix)
    }

    /// Whether a result is that of the place, which is then noted.
    pub(crate) fn settle(&mut self, stamp_s: f64, refused: bool) -> bool {
        let Some(k) = self.given.iter().position(|t| *t == stamp_s) else { return false };
        self.given.drain(..=k);
        self.refused = if refused { self.refused + 1 } else { 0 };
        if self.refused >= REFUSED && !self.stands() {
            self.left = true;
            self.given.clear();
        }
        true
    }

    /// Whether a fix is further from where the vehicle stood than receivers wander; where it stands now is its place.
    fn is_elsewhere(&self, fix: &GnssFix) -> bool {
        let sigma = fix.position_sigma_m.map_or(0.0, |s| s.iter().copied().fold(0.0, f64::max));
        let far = |at: Vector3<f64>| (fix.position.to_ecef() - at).norm() > ELSEWHERE.0 + ELSEWHERE.1 * sigma;
        !self.stands() && self.stood_at.is_some_and(far)
    }

    /// Takes a fix of a receiver, which came at this time.
    pub(crate) fn take_fix(&mut self, fix: &GnssFix, now_s: f64) -> Contact {
        self.fix_s = Some(now_s);
        let [n, e, d] = fix.velocity.components();
        let speed = rss(rss(n, e), d);
        let fast = speed > FAST.max(5.0 * fix.velocity_sigma_m_per_s.map_or(0.0, |s| s[0]));
        let alone = std::mem::take(&mut self.alone);
        if self.is_elsewhere(fix) {
            self.away = true;
        } else if !fast && self.stands() {
            (self.away, self.left) = (false, false);
            self.stood_at = Some(fix.position.to_ecef());
        }
        if fast {
            self.away = true;
            let rested = self.stood_s.is_some_and(|stood| now_s - stood < REST_AGE_S);
            if alone && rested {
                return Contact::NeverStood;
            }
        } else {
            self.place = Some(fix.position);
        }
        if alone { Contact::Known } else { Contact::GoesOn }
    }
}

#[cfg(test)]
mod tests;
