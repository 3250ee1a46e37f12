//! The flight of the paper (Fan et al. 2014, section 4): stationary, straight with varying acceleration, a right turn
//! while climbing at about 80 g to the right, a deceleration with three independent accelerations, an ascent.
//!
//! Path and attitude are prescribed apart from each other: on the straight parts the accelerations along all three
//! axes come from the path while the attitude is constant, which is what the paper's conditions ask for.

use super::signal::Signal;
use super::{Chain, Profile};
use crate::truth::Motion;
use gaware_nav::earth::{Geodetic, STANDARD_GRAVITY};
use nalgebra::Vector3;

/// The profile.
#[derive(Debug, Clone)]
pub struct Paper {
    /// Along the path axis, m/s.
    forward: Signal,
    /// To its right, m/s.
    right: Signal,
    /// Below it, m/s.
    down: Signal,
    course: Signal,
    climb: Signal,
    roll: Signal,
}

impl Default for Paper {
    fn default() -> Self {
        Self::new()
    }
}

impl Paper {
    /// The one flight there is.
    pub fn new() -> Self {
        const G: f64 = STANDARD_GRAVITY;
        // 80 g to the right at the 1137 m/s that are reached after 35 s.
        const TURN_RATE: f64 = 0.69;
        Self {
            forward: Signal::constant(0.0)
                .ramp(10.0, 2.0, 2.0 * G)
                .ramp(14.0, 2.0, 4.0 * G)
                .ramp(18.0, 2.0, 3.0 * G)
                .ramp(22.0, 2.0, -6.0 * G)
                .ramp(26.0, 2.0, 5.0 * G)
                .ramp(30.0, 3.0, -8.0 * G)
                .ramp(45.0, 1.5, -6.0 * G)
                .ramp(48.0, 1.5, 3.0 * G)
                .ramp(51.0, 1.0, -5.0 * G)
                .ramp(53.0, 1.5, 8.0 * G)
                .ramp(58.0, 1.5, 12.0 * G)
                .ramp(61.0, 1.5, -21.0 * G)
                .ramp(64.5, 1.5, 9.0 * G),
            right: Signal::constant(0.0).wave(45.0, 55.0, 31.0, 0.3, 1.5).wave(57.0, 70.0, 80.0, 0.25, 2.0),
            down: Signal::constant(0.0).wave(45.0, 55.0, 45.0, 0.45, 1.5).wave(57.0, 70.0, 25.0, 0.35, 2.0),
            course: Signal::constant(40f64.to_radians())
                .ramp(35.0, 2.0, TURN_RATE)
                .ramp(43.0, 2.0, -TURN_RATE),
            climb: Signal::constant(0.0).step(35.0, 4.0, 8f64.to_radians()).step(
                55.0,
                5.0,
                17f64.to_radians(),
            ),
            roll: Signal::constant(0.0)
                .pulse(35.0, 42.0, 3.0, 4f64.to_radians())
                .pulse(51.0, 53.0, 2.0, 15f64.to_radians())
                .pulse(62.0, 66.0, 2.0, -10f64.to_radians()),
        }
    }
}

impl Profile for Paper {
    fn duration_s(&self) -> f64 {
        70.0
    }

    fn start(&self) -> Geodetic {
        Geodetic::from_degrees(28.2, 112.99, 80.0)
    }

    fn motion_at(&self, t_s: f64, _course_rad: f64) -> (Motion, f64) {
        let (u, v, w) = (self.forward.at(t_s), self.right.at(t_s), self.down.at(t_s));
        let (course, climb, roll) = (self.course.at(t_s), self.climb.at(t_s), self.roll.at(t_s));
        let path = Chain::new().about(2, course.x, course.d1).about(1, climb.x, climb.d1);
        let body = path.about(0, roll.x, roll.d1);
        let velocity = Vector3::new(u.x, v.x, w.x);
        let acceleration = Vector3::new(u.d1, v.d1, w.d1) + path.rate().cross(&velocity);
        let motion = Motion {
            v_n: path.matrix() * velocity,
            a_n: path.matrix() * acceleration,
            c_nb: body.matrix(),
            rate_nb: body.rate(),
        };
        (motion, 0.0)
    }
}
