//! Analytic flights: velocity and attitude are smooth functions of time, position is integrated finely.

pub mod bench;
pub mod dragged;
pub mod fixed_wing;
pub mod hand;
pub mod multirotor;
pub mod paper;
pub mod signal;

use crate::truth::{Motion, Trajectory, Truth, place_rate};
use gaware_nav::earth::Geodetic;
use nalgebra::{Matrix3, Vector3};
use signal::Signal;
use std::sync::Arc;

/// A flight as a function of time.
///
/// Coordinated flight prescribes the bank and gets its course by integration; such a profile returns the rate of
/// course, and is given the course so far.
pub trait Profile: Send + Sync {
    /// How long it lasts, s.
    fn duration_s(&self) -> f64;

    /// Where it starts.
    fn start(&self) -> Geodetic;

    /// Course at the start, rad.
    fn start_course_rad(&self) -> f64 {
        0.0
    }

    /// Motion at a time with the course so far, and the rate of course, rad/s.
    fn motion_at(&self, t_s: f64, course_rad: f64) -> (Motion, f64);
}

/// A flight that four signals over time make.
pub trait Scripted: Sized {
    /// The signals, and how long they last, s.
    fn parts(&mut self) -> ([&mut Signal; 4], &mut f64);

    /// The same flight, interrupted at `at_s`: for `for_s` everything stays as it is then.
    #[must_use]
    fn paused(mut self, at_s: f64, for_s: f64) -> Self {
        let (signals, duration_s) = self.parts();
        signals.into_iter().for_each(|s| *s = std::mem::take(s).paused(at_s, for_s));
        *duration_s += for_s;
        self
    }

    /// The same flight so many times in a row; it must end at rest.
    #[must_use]
    fn repeated(mut self, times: u32) -> Self {
        let (signals, duration_s) = self.parts();
        signals.into_iter().for_each(|s| *s = std::mem::take(s).repeated(times, *duration_s));
        *duration_s *= f64::from(times);
        self
    }
}

/// Spacing of the integration, s. The positions of all flights differ from those in steps of .25 ms by 6 µm at most, with this as with 1 ms: that
/// is the rounding of the angles (2026-11-30). Samples at 200 Hz are on its nodes.
const STEP_S: f64 = 5e-3;

/// What is integrated.
#[derive(Debug, Clone, Copy)]
struct Node {
    place: Geodetic,
    course_rad: f64,
}

impl Node {
    fn moved(&self, rate: &(Vector3<f64>, f64), dt: f64) -> Self {
        Self {
            place: Geodetic {
                lat_rad: self.place.lat_rad + rate.0.x * dt,
                lon_rad: self.place.lon_rad + rate.0.y * dt,
                height_m: self.place.height_m + rate.0.z * dt,
            },
            course_rad: self.course_rad + rate.1 * dt,
        }
    }
}

/// A [`Profile`] with its integrated path; clones share the path, so a Monte Carlo study integrates once.
#[derive(Clone)]
pub struct Flown {
    profile: Arc<dyn Profile>,
    path: Arc<[Node]>,
    step_s: f64,
}

impl std::fmt::Debug for Flown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Flown").field("duration_s", &self.profile.duration_s()).finish_non_exhaustive()
    }
}

impl Flown {
    /// Integrates the path of a profile (classical Runge-Kutta, 5 ms).
    pub fn new(profile: impl Profile + 'static) -> Self {
        Self::with_step(profile, STEP_S)
    }

    /// The same in steps of this length, s: for hours of smooth flight.
    pub fn with_step(profile: impl Profile + 'static, step_s: f64) -> Self {
        let steps = (profile.duration_s() / step_s).ceil() as usize + 1;
        let mut node = Node { place: profile.start(), course_rad: profile.start_course_rad() };
        let mut path = Vec::with_capacity(steps + 1);
        path.push(node);
        for k in 0..steps {
            node = advance(&profile, k as f64 * step_s, node, step_s);
            path.push(node);
        }
        Self { profile: Arc::new(profile), path: path.into(), step_s }
    }
}

/// One Runge-Kutta step.
fn advance(profile: &dyn Profile, t: f64, node: Node, dt: f64) -> Node {
    let rate = |t: f64, n: &Node| {
        let (motion, course_rate) = profile.motion_at(t, n.course_rad);
        (place_rate(&n.place, &motion.v_n), course_rate)
    };
    let k1 = rate(t, &node);
    let k2 = rate(t + 0.5 * dt, &node.moved(&k1, 0.5 * dt));
    let k3 = rate(t + 0.5 * dt, &node.moved(&k2, 0.5 * dt));
    let k4 = rate(t + dt, &node.moved(&k3, dt));
    let mean = ((k1.0 + (k2.0 + k3.0) * 2.0 + k4.0) / 6.0, (k1.1 + 2.0 * (k2.1 + k3.1) + k4.1) / 6.0);
    node.moved(&mean, dt)
}

impl Trajectory for Flown {
    fn duration_s(&self) -> f64 {
        self.profile.duration_s()
    }

    fn truth_at(&mut self, t_s: f64) -> Truth {
        let t = t_s.clamp(0.0, self.profile.duration_s());
        let k = (t / self.step_s + 1e-9).floor();
        let start = self.path[(k as usize).min(self.path.len() - 1)];
        let rest = t - k * self.step_s;
        // Below a nanosecond it is the node itself; the vehicle moves less than a micrometre.
        let node =
            if rest.abs() < 1e-9 { start } else { advance(&*self.profile, k * self.step_s, start, rest) };
        Truth::of(t, node.place, &self.profile.motion_at(t, node.course_rad).0)
    }
}

/// A rotation built up from elementary ones about the current axes, with its rate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chain {
    c: Matrix3<f64>,
    rate: Vector3<f64>,
}

impl Chain {
    pub(crate) fn new() -> Self {
        Self { c: Matrix3::identity(), rate: Vector3::zeros() }
    }

    /// Turns about axis 0, 1 or 2 by `angle`, which itself changes at `rate`.
    pub(crate) fn about(self, axis: usize, angle: f64, rate: f64) -> Self {
        let unit = match axis {
            0 => Vector3::x_axis(),
            1 => Vector3::y_axis(),
            _ => Vector3::z_axis(),
        };
        let turn = nalgebra::Rotation3::from_axis_angle(&unit, angle).into_inner();
        Self { c: self.c * turn, rate: turn.transpose() * self.rate + unit.into_inner() * rate }
    }

    /// Matrix from the last axes to the first.
    pub(crate) fn matrix(&self) -> Matrix3<f64> {
        self.c
    }

    /// Rate of the last axes relative to the first, in the last.
    pub(crate) fn rate(&self) -> Vector3<f64> {
        self.rate
    }
}

#[cfg(test)]
mod tests;
