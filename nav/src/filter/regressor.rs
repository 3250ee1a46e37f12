//! The motion that the constants are judged by: the measured one without what is no excitation.
//!
//! Two things make motion seem to change though nothing moves. Noise of the accelerometers, which the gyros do not feel: taken as
//! excitation it would make G known to a vehicle that stands (errors in variables, Fuller 1987, section 1.1). And the
//! estimates themselves: every new value of a bias shifts the compensated motion, and Jacobians found at ever new values bring
//! information that nothing measured (first-estimates Jacobian, Huang, Mourikis & Roumeliotis 2010). So noise is
//! averaged out, for as long as nothing but noise is seen, and a shift that came from an estimate is held back until real
//! motion is much larger.

use super::unseen::GAP_S;
use crate::mechanization::Motion;
use nalgebra::Vector3;

/// What differs from the last value by more than so many sigmas of the noise is motion …
pub(super) const BEYOND_NOISE: f64 = 5.0;
/// … and what does not is averaged over this time, s.
const STEADY_S: f64 = 0.5;
/// Motion counts for the range once it lasts about so long, s.
const LASTING_S: f64 = 1.0;
/// A channel is quiet when it has been steady for so long, s.
const QUIET_S: f64 = 1.0;
/// A vehicle counts as moving for about so long after motion, s: what it brought was brought by then, and estimates that change later
/// add nothing.
const RECENT_S: f64 = 60.0;
/// A shift is let through while the vehicle moves when it is less than this share of the widest range of motion: it then adds a
/// hundredth to what motion has shown already.
const NEGLIGIBLE: f64 = 0.1;

/// One channel, rad/s or m/s².
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Channel {
    value: f64,
    /// Mean of the value since it last changed by more than its own noise, and for how long that is, s.
    steady: f64,
    steady_s: f64,
    /// Shift by changed estimates that is not let through.
    held: f64,
    /// Low-passed value and the range it has covered lately.
    lasting: f64,
    low: f64,
    high: f64,
    /// The widest that this range has been.
    widest: f64,
    /// Whether the range lately is larger than what noise reaches in one sample.
    moved: bool,
}

impl Channel {
    fn take(&mut self, measured: f64, band: f64, dt: f64) {
        let shown = measured - self.held;
        // Where samples are missing it is not known that nothing happened.
        let far = dt > GAP_S || (shown - self.value).abs() >= band;
        self.value = if far { shown } else { self.value + (dt / STEADY_S).min(1.0) * (shown - self.value) };
        // The averaged value's own noise: a first-order low-pass keeps dt / 2T of the variance of white noise.
        let kept = (0.5 * dt / STEADY_S).min(1.0).sqrt();
        if far || (self.value - self.steady).abs() >= band * kept {
            (self.steady, self.steady_s) = (self.value, STEADY_S);
        } else {
            self.steady_s += dt;
            self.steady += dt / self.steady_s * (self.value - self.steady);
        }
        self.lasting += (dt / LASTING_S).min(1.0) * (self.value - self.lasting);
        let kept = 1.0 - (dt / RECENT_S).min(1.0);
        self.low = self.lasting + (self.low - self.lasting) * kept;
        self.high = self.lasting + (self.high - self.lasting) * kept;
        self.low = self.low.min(self.lasting);
        self.high = self.high.max(self.lasting);
        self.widest = self.widest.max(self.high - self.low);
        self.moved = self.high - self.low > band;
    }

    fn shift(&mut self, by: f64, moving: bool) {
        self.held += by;
        if moving && self.held.abs() < NEGLIGIBLE * self.widest {
            self.let_through();
        }
    }

    fn is_quiet(&self) -> bool {
        self.steady_s >= STEADY_S + QUIET_S
    }

    fn let_through(&mut self) {
        for x in [&mut self.value, &mut self.steady, &mut self.lasting, &mut self.low, &mut self.high] {
            *x += self.held;
        }
        self.held = 0.0;
    }
}

/// Rate and specific force, three axes each.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Regressor {
    channels: [Channel; 6],
    started: bool,
    /// Time since the stream began, s.
    age_s: f64,
    /// Mean acceleration in body axes, m/s², since all channels are quiet, and for how long that is, s.
    acceleration: Vector3<f64>,
    steady_s: f64,
}

impl Regressor {
    /// The motion as the constants see it.
    pub(super) fn motion(&self) -> Motion {
        self.of_channels(|c, _| c.steady, &Motion::default())
    }

    /// What this makes of every channel and its measured value.
    fn of_channels(&self, of: impl Fn(&Channel, f64) -> f64, measured: &Motion) -> Motion {
        Motion {
            rate: Vector3::from_fn(|k, _| of(&self.channels[k], measured.rate[k])),
            force: Vector3::from_fn(|k, _| of(&self.channels[3 + k], measured.force[k])),
        }
    }

    /// The motion that errors of attitude and time act on: as the trajectory has it that they are errors of, but for what is only noise. Where
    /// nothing moves, the specific force is that of the mean acceleration: how far the trajectory's own tilt drifts from where the
    /// accelerometers say (it is what the gyros' noise adds up to, and `gravity` in its body axes, m/s², goes with it) is no acceleration that
    /// fixes could tell the heading by.
    pub(super) fn lever(&self, measured: &Motion, gravity: impl FnOnce() -> Vector3<f64>) -> Motion {
        let mut lever = self.of_channels(|c, x| if c.is_quiet() { c.steady + c.held } else { x }, measured);
        if self.steady_s > 0.0 {
            lever.force = self.acceleration - gravity();
        }
        lever
    }

    /// Whether no channel moves.
    pub(super) fn is_quiet(&self) -> bool {
        self.channels.iter().all(Channel::is_quiet)
    }

    /// The acceleration in body axes, m/s², `dt` after the last one, where nothing moves; noise reaches so far in it. Farther goes a tilt
    /// that is found anew.
    pub(super) fn average(&mut self, acceleration: &Vector3<f64>, band: f64, dt: f64) {
        if (acceleration - self.acceleration).amax() >= band {
            self.steady_s = 0.0;
        }
        self.steady_s += dt;
        self.acceleration += (acceleration - self.acceleration) * (dt / self.steady_s);
    }

    /// The first sample of a stream: nothing to average with.
    pub(super) fn start(&mut self, measured: &Motion) {
        self.age_s = 0.0;
        let fresh = !std::mem::replace(&mut self.started, true);
        self.each(measured, |c, x| {
            c.value = x - c.held;
            (c.steady, c.steady_s) = (c.value, STEADY_S);
            c.lasting = c.value;
            if fresh {
                (c.low, c.high) = (c.value, c.value);
            }
        });
    }

    /// The next sample, `dt` after the last one; `band` is how far noise reaches in a rate and in a force.
    pub(super) fn take(&mut self, measured: &Motion, band: (f64, f64), dt: f64) {
        let mut k = 0;
        self.age_s += dt;
        self.each(measured, |c, x| {
            c.take(x, if k < 3 { band.0 } else { band.1 }, dt);
            k += 1;
        });
        if !self.is_quiet() {
            self.steady_s = 0.0;
        }
    }

    /// The same sample is compensated differently now.
    pub(super) fn estimate_changed(&mut self, before: &Motion, after: &Motion) {
        let by = Motion { rate: after.rate - before.rate, force: after.force - before.force };
        let moving = self.moving();
        self.each(&by, |c, by| c.shift(by, moving));
    }

    /// The estimates stay where they are from now on: what was held back comes through.
    pub(super) fn let_through(&mut self) {
        self.channels.iter_mut().for_each(Channel::let_through);
    }

    /// Whether there was motion beyond noise within some [`RECENT_S`].
    pub(super) fn moving(&self) -> bool {
        self.channels.iter().any(|c| c.moved)
    }

    /// The same, or nothing was known before that.
    pub(super) fn moved_lately(&self) -> bool {
        self.age_s < RECENT_S || self.moving()
    }

    fn each(&mut self, motion: &Motion, mut job: impl FnMut(&mut Channel, f64)) {
        let values = motion.rate.iter().chain(&motion.force);
        self.channels.iter_mut().zip(values).for_each(|(c, x)| job(c, *x));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sin;

    const DT: f64 = 0.01;

    fn force(x: f64) -> Motion {
        Motion { rate: Vector3::zeros(), force: Vector3::new(x, 0.0, 0.0) }
    }

    fn standing() -> Regressor {
        let mut r = Regressor::default();
        r.start(&force(0.0));
        for k in 0..2000 {
            r.take(&force(if k % 2 == 0 { 0.1 } else { -0.1 }), (1.0, 1.0), DT);
        }
        r
    }

    #[test]
    fn noise_is_averaged_and_motion_is_followed_at_once() {
        let mut r = standing();
        assert!(r.motion().force.x.abs() < 0.01, "{r:?}");
        r.take(&force(3.0), (1.0, 1.0), DT);
        assert_eq!(r.motion().force.x, 3.0);
    }

    #[test]
    fn a_new_estimate_is_no_motion_for_a_vehicle_that_stands() {
        let mut r = standing();
        let before = r.motion().force.x;
        r.estimate_changed(&force(0.0), &force(0.2));
        r.take(&force(0.2), (1.0, 1.0), DT);
        assert!((r.motion().force.x - before).abs() < 0.01, "{r:?}");
    }

    #[test]
    fn a_new_estimate_is_believed_once_motion_is_much_larger() {
        let mut r = standing();
        for _ in 0..1000 {
            r.take(&force(5.0), (1.0, 1.0), DT);
        }
        r.estimate_changed(&force(5.0), &force(5.2));
        assert!((r.motion().force.x - 5.2).abs() < 0.01, "{r:?}");
    }

    #[test]
    fn motion_of_minutes_ago_lets_no_estimate_through() {
        let mut r = standing();
        let take = |r: &mut Regressor, x: f64, steps: u32| {
            (0..steps).for_each(|_| r.take(&force(x), (1.0, 1.0), DT));
        };
        take(&mut r, 5.0, 1000);
        take(&mut r, 0.0, 60_000);
        assert!(!r.moved_lately());
        let before = r.motion().force.x;
        r.estimate_changed(&force(0.0), &force(0.2));
        take(&mut r, 0.2, 1000);
        assert!((r.motion().force.x - before).abs() < 0.01, "{r:?}");
        // The errors of a trajectory are driven by its own motion, the shift included.
        assert!((r.lever(&force(0.2), Vector3::zeros).force.x - before - 0.2).abs() < 0.01, "{r:?}");
        r.take(&force(3.2), (1.0, 1.0), DT);
        assert_eq!(r.lever(&force(3.2), Vector3::zeros).force.x, 3.2);
        take(&mut r, 5.2, 1000);
        r.estimate_changed(&force(5.2), &force(5.21));
        assert!((r.motion().force.x - 5.21).abs() < 0.01, "it moves again: {r:?}");
    }

    /// The trajectory's tilt drifts by what the gyros' noise adds up to while the vehicle keeps its attitude.
    #[test]
    fn a_tilt_that_drifts_is_no_acceleration() {
        let mut r = standing();
        let gravity = |tilt: f64| Vector3::new(9.8 * tilt, 0.0, 9.8);
        for k in 0..6000 {
            let motion = Motion { rate: Vector3::zeros(), force: -gravity(0.0) };
            let tilt = 1e-3 * sin(0.01 * f64::from(k));
            r.take(&motion, (1.0, 1.0), DT);
            if r.is_quiet() {
                r.average(&(motion.force + gravity(tilt)), 1.0, DT);
            }
        }
        let now = gravity(1e-3);
        let measured = Motion { rate: Vector3::zeros(), force: -gravity(0.0) };
        let acceleration = r.lever(&measured, || now).force + now;
        assert!(acceleration.norm() < 1e-3, "{acceleration}");
        // Once it moves its samples say how.
        r.take(&force(5.0), (1.0, 1.0), DT);
        assert_eq!(r.lever(&force(5.0), || now).force.x, 5.0);
    }
}
