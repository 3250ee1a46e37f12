//! Smooth signals of time with their derivatives: what analytic profiles are made of.
//!
//! All pieces are twice continuously differentiable, so a speed made of them has a smooth acceleration and an angle
//! a smooth rate.

use gaware_nav::math::sin_cos;
use std::ops::{Add, Mul};

/// A value with its first two derivatives by time.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Jet {
    /// Value.
    pub x: f64,
    /// First derivative.
    pub d1: f64,
    /// Second derivative.
    pub d2: f64,
}

impl Add for Jet {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { x: self.x + o.x, d1: self.d1 + o.d1, d2: self.d2 + o.d2 }
    }
}

impl Mul for Jet {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self {
            x: self.x * o.x,
            d1: self.d1 * o.x + self.x * o.d1,
            d2: self.d2 * o.x + 2.0 * self.d1 * o.d1 + self.x * o.d2,
        }
    }
}

#[derive(Debug, Clone, Copy)]
enum Term {
    Step { from_s: f64, for_s: f64, size: f64 },
    Ramp { from_s: f64, for_s: f64, rate: f64 },
    Wave { from_s: f64, to_s: f64, amplitude: f64, omega: f64, phase: f64, fade_s: f64 },
}

/// The quintic 6u⁵ − 15u⁴ + 10u³: from 0 to 1 with two derivatives zero at both ends.
fn smooth_step(t: f64, from_s: f64, for_s: f64) -> Jet {
    let u = (t - from_s) / for_s;
    if u <= 0.0 {
        return Jet::default();
    }
    if u >= 1.0 {
        return Jet { x: 1.0, d1: 0.0, d2: 0.0 };
    }
    let u2 = u * u;
    Jet {
        x: u2 * u * (10.0 + u * (6.0 * u - 15.0)),
        d1: 30.0 * u2 * (1.0 - u) * (1.0 - u) / for_s,
        d2: 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (for_s * for_s),
    }
}

impl Term {
    fn at(&self, t: f64) -> Jet {
        match *self {
            Self::Step { from_s, for_s, size } => {
                let s = smooth_step(t, from_s, for_s);
                Jet { x: size * s.x, d1: size * s.d1, d2: size * s.d2 }
            }
            Self::Ramp { from_s, for_s, rate } => {
                let u = (t - from_s) / for_s;
                let s = smooth_step(t, from_s, for_s);
                let integral = if u <= 0.0 {
                    0.0
                } else if u >= 1.0 {
                    u - 0.5
                } else {
                    u.powi(4) * (2.5 + u * (u - 3.0))
                };
                Jet { x: rate * for_s * integral, d1: rate * s.x, d2: rate * s.d1 }
            }
            Self::Wave { from_s, to_s, amplitude, omega, phase, fade_s } => {
                if t <= from_s || t >= to_s {
                    return Jet::default();
                }
                let (s, c) = sin_cos(omega * (t - from_s) + phase);
                let sine =
                    Jet { x: amplitude * s, d1: amplitude * omega * c, d2: -amplitude * omega * omega * s };
                let fall = smooth_step(t, to_s - fade_s, fade_s);
                let window =
                    smooth_step(t, from_s, fade_s) * Jet { x: 1.0 - fall.x, d1: -fall.d1, d2: -fall.d2 };
                window * sine
            }
        }
    }
}

/// What becomes of the signal so far.
#[derive(Debug, Clone, Copy)]
enum Change {
    Pause {
        at_s: f64,
        for_s: f64,
    },
    /// So many times more, each so much later.
    Again {
        more: u32,
        by_s: f64,
    },
}

/// A sum of smooth pieces.
#[derive(Debug, Clone, Default)]
pub struct Signal {
    start: f64,
    terms: Vec<Term>,
    /// In the order in which they were asked for: the last sees a flight that the ones before have made.
    changes: Vec<Change>,
}

impl Signal {
    /// A constant.
    pub fn constant(start: f64) -> Self {
        Self { start, ..Self::default() }
    }

    /// From `from_s` on, changes by `size` within `for_s`.
    #[must_use]
    pub fn step(mut self, from_s: f64, for_s: f64, size: f64) -> Self {
        self.terms.push(Term::Step { from_s, for_s, size });
        self
    }

    /// Changes by `size` and back: away within `for_s` from `from_s`, back within `for_s` from `back_s`.
    #[must_use]
    pub fn pulse(self, from_s: f64, back_s: f64, for_s: f64, size: f64) -> Self {
        self.step(from_s, for_s, size).step(back_s, for_s, -size)
    }

    /// From `from_s` on, the *rate* changes by `rate` within `for_s`.
    #[must_use]
    pub fn ramp(mut self, from_s: f64, for_s: f64, rate: f64) -> Self {
        self.terms.push(Term::Ramp { from_s, for_s, rate });
        self
    }

    /// A sine that fades in and out within `fade_s`.
    #[must_use]
    pub fn wave(self, from_s: f64, to_s: f64, amplitude: f64, frequency_hz: f64, fade_s: f64) -> Self {
        self.wave_with_phase(from_s, to_s, amplitude, frequency_hz, fade_s, 0.0)
    }

    /// The same with a phase at `from_s`, rad.
    #[must_use]
    pub fn wave_with_phase(
        mut self,
        from_s: f64,
        to_s: f64,
        amplitude: f64,
        frequency_hz: f64,
        fade_s: f64,
        phase: f64,
    ) -> Self {
        let omega = std::f64::consts::TAU * frequency_hz;
        self.terms.push(Term::Wave { from_s, to_s, amplitude, omega, phase, fade_s });
        self
    }

    /// The same held for `for_s` where nothing changes at `at_s`.
    #[must_use]
    pub fn paused(mut self, at_s: f64, for_s: f64) -> Self {
        self.changes.push(Change::Pause { at_s, for_s });
        self
    }

    /// So many times all changes, each time `by_s` later and from where they led before: all of them are over by then.
    #[must_use]
    pub fn repeated(mut self, times: u32, by_s: f64) -> Self {
        self.changes.push(Change::Again { more: times.saturating_sub(1), by_s });
        self
    }

    /// Value and derivatives at a time.
    pub fn at(&self, t_s: f64) -> Jet {
        self.changed(&self.changes, t_s)
    }

    /// The same with these changes alone.
    fn changed(&self, changes: &[Change], t_s: f64) -> Jet {
        match changes.split_last() {
            None => self.once(t_s),
            Some((Change::Pause { at_s, for_s }, first)) => {
                self.changed(first, t_s.min(*at_s).max(t_s - for_s))
            }
            Some((Change::Again { more, by_s }, first)) => {
                let before = (t_s / by_s).floor().clamp(0.0, f64::from(*more));
                let mut jet = self.changed(first, t_s - before * by_s);
                if before > 0.0 {
                    jet.x += before * (self.changed(first, *by_s).x - self.start);
                }
                jet
            }
        }
    }

    fn once(&self, t_s: f64) -> Jet {
        let start = Jet { x: self.start, d1: 0.0, d2: 0.0 };
        self.terms.iter().fold(start, |sum, term| sum + term.at(t_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn example() -> Signal {
        Signal::constant(2.0).step(1.0, 2.0, 3.0).ramp(0.5, 1.5, -0.7).wave(1.0, 6.0, 0.8, 0.9, 1.2)
    }

    proptest! {
        #[test]
        fn derivatives_match_finite_differences(t in 0.0..8.0f64) {
            let h = 1e-4;
            let (before, here, after) = (example().at(t - h), example().at(t), example().at(t + h));
            prop_assert!(((after.x - before.x) / (2.0 * h) - here.d1).abs() < 1e-5);
            // The second derivative has corners, so its own difference is only as good as h times the third.
            prop_assert!(((after.d1 - before.d1) / (2.0 * h) - here.d2).abs() < 0.03);
        }
    }

    /// Two that begin where the one before ended, with a pause between them.
    #[test]
    fn what_is_repeated_goes_on_from_where_it_led() {
        let once = Signal::constant(1.0).step(1.0, 2.0, 3.0).pulse(4.0, 6.0, 1.0, -2.0);
        let twice = once.clone().repeated(2, 8.0).paused(8.0, 5.0);
        for t in [0.0, 1.75, 4.5, 7.0, 8.0] {
            let (first, again) = (once.at(t), twice.at(13.0 + t));
            assert_eq!(twice.at(t), first, "{t}");
            assert!((again.x - first.x - 3.0).abs() < 1e-12, "{t}: {again:?} {first:?}");
            assert_eq!((again.d1, again.d2), (first.d1, first.d2), "{t}");
        }
        assert_eq!(twice.at(10.0), Jet { x: 4.0, d1: 0.0, d2: 0.0 });
        assert_eq!(twice.at(99.0).x, 7.0);
    }

    /// Of two pauses the second sees a flight that has the first: a cruise of hours became a minute of it when the second took its place.
    #[test]
    fn pauses_add_up() {
        let s = Signal::constant(0.0).step(1.0, 1.0, 1.0).step(4.0, 1.0, 2.0);
        let paused = s.clone().paused(3.0, 100.0).paused(0.5, 10.0).repeated(2, 120.0);
        for (t, once) in [(0.4, 0.4), (8.0, 0.5), (11.5, 1.5), (13.0, 3.0), (112.0, 3.0), (114.5, 4.5)] {
            assert_eq!(paused.at(t).x, s.at(once).x, "{t}");
            assert_eq!(paused.at(120.0 + t).x, 3.0 + s.at(once).x, "{t}");
        }
    }

    #[test]
    fn a_ramp_moves_on_at_its_rate() {
        let s = Signal::constant(1.0).ramp(2.0, 4.0, 3.0);
        assert!((s.at(6.0).x - 7.0).abs() < 1e-12);
        assert!((s.at(10.0).x - 19.0).abs() < 1e-12);
        assert_eq!(s.at(10.0).d1, 3.0);
    }
}
