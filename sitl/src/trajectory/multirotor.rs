//! A multirotor: it tilts its thrust to accelerate and leans against its drag, so that forward and right specific force come
//! from the drag alone. Velocity and heading are prescribed; the tilt follows.

use super::Scripted;
use super::signal::{Jet, Signal};
use super::{Chain, Profile};
use crate::noise::Noise;
use crate::truth::Motion;
use gaware_nav::earth::{Geodetic, STANDARD_GRAVITY};
use gaware_nav::math::{asin, atan2, cos, sin};
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};

/// Linear drag, 1/s: rotor drag of a mid-size quadrotor, 3 m/s² at 10 m/s.
const DRAG_PER_S: f64 = 0.3;

/// The profile.
#[derive(Debug, Clone)]
pub struct Multirotor {
    north: Signal,
    east: Signal,
    down: Signal,
    yaw: Signal,
    duration_s: f64,
}

impl Default for Multirotor {
    fn default() -> Self {
        Self::new()
    }
}

/// Accelerates to `speed` within `ramp_s`, keeps it, and stops again.
fn dash(signal: Signal, from_s: f64, to_s: f64, ramp_s: f64, speed: f64) -> Signal {
    signal.pulse(from_s, to_s - ramp_s, ramp_s, speed)
}

impl Multirotor {
    /// The flight of 240 s: hover, dashes and crab legs in all directions, yaw, climbs and drops.
    pub fn new() -> Self {
        let mut north = Signal::constant(0.0);
        let mut east = Signal::constant(0.0);
        let mut down = Signal::constant(0.0).pulse(12.0, 22.0, 2.0, -2.5);
        // Dashes with the nose fixed: forward, back, right, left and the diagonals.
        let legs = [
            (30.0, 12.0, 0.0),
            (44.0, -12.0, 0.0),
            (58.0, 0.0, 11.0),
            (72.0, 0.0, -11.0),
            (86.0, 8.5, 8.5),
            (100.0, -8.5, -8.5),
            (114.0, 8.5, -8.5),
            (128.0, -8.5, 8.5),
        ];
        for (from_s, n, e) in legs {
            north = dash(north, from_s, from_s + 12.0, 3.0, n);
            east = dash(east, from_s, from_s + 12.0, 3.0, e);
        }
        // Up and down bursts, then a wobbling circle while yawing.
        for (from_s, d) in [(144.0, -4.0), (152.0, 3.0), (160.0, -5.0), (168.0, 4.0)] {
            down = dash(down, from_s, from_s + 6.0, 1.2, d);
        }
        north = north.wave(178.0, 228.0, 8.0, 0.1, 4.0).wave(196.0, 228.0, 2.5, 0.23, 4.0);
        east = east.wave_with_phase(178.0, 228.0, 8.0, 0.1, 4.0, 1.57).wave(190.0, 228.0, 2.0, 0.31, 4.0);
        down = down.wave(196.0, 228.0, 1.2, 0.4, 4.0);
        let yaw = Signal::constant(0.5)
            .step(176.0, 6.0, 2.0)
            .ramp(190.0, 2.0, 0.5)
            .ramp(204.0, 3.0, -1.1)
            .ramp(216.0, 3.0, 0.6)
            .step(230.0, 4.0, -1.5);
        Self { north, east, down, yaw, duration_s: 240.0 }
    }

    /// Another flight as long: dashes in directions and at speeds that are drawn, climbs between them, turns in yaw.
    pub fn drawn(draw: &mut Noise) -> Self {
        let constant = || Signal::constant(0.0);
        let mut down = constant().pulse(12.0, 22.0, 2.0, -2.0 - draw.uniform());
        let (mut north, mut east, mut yaw) = (constant(), constant(), Signal::constant(TAU * draw.uniform()));
        let (mut t_s, mut last) = (30.0, None);
        while t_s < 215.0 {
            // Every second dash leads back.
            let (speed, toward) = match last.take() {
                Some((speed, toward)) => (speed, toward + PI),
                None => *last.insert((6.0 + 7.0 * draw.uniform(), TAU * draw.uniform())),
            };
            let for_s = 8.0 + 6.0 * draw.uniform();
            north = dash(north, t_s, t_s + for_s, 2.0 + 2.0 * draw.uniform(), speed * cos(toward));
            east = dash(east, t_s, t_s + for_s, 2.0 + 2.0 * draw.uniform(), speed * sin(toward));
            if draw.uniform() < 0.4 {
                let climb = if draw.uniform() < 0.5 { -3.0 } else { 2.5 };
                down = dash(down, t_s, t_s + 7.0, 1.5, climb);
            }
            if draw.uniform() < 0.5 {
                yaw = yaw.step(t_s + 2.0, 3.0, 2.0 * draw.uniform() - 1.0);
            }
            t_s += for_s + 3.0;
        }
        Self { north, east, down, yaw, duration_s: 240.0 }
    }
}

impl Scripted for Multirotor {
    fn parts(&mut self) -> ([&mut Signal; 4], &mut f64) {
        ([&mut self.north, &mut self.east, &mut self.down, &mut self.yaw], &mut self.duration_s)
    }
}

impl Profile for Multirotor {
    fn duration_s(&self) -> f64 {
        self.duration_s
    }

    fn start(&self) -> Geodetic {
        Geodetic::from_degrees(47.397_7, 8.545_6, 488.0)
    }

    fn motion_at(&self, t_s: f64, _course_rad: f64) -> (Motion, f64) {
        let jets = [self.north.at(t_s), self.east.at(t_s), self.down.at(t_s)];
        let by = |f: fn(&Jet) -> f64| Vector3::new(f(&jets[0]), f(&jets[1]), f(&jets[2]));
        let (v_n, a_n, jerk) = (by(|j| j.x), by(|j| j.d1), by(|j| j.d2));
        let drag = [v_n * DRAG_PER_S, a_n * DRAG_PER_S];
        (rotor_motion([v_n, a_n, jerk], drag, &self.yaw.at(t_s)), 0.0)
    }
}

/// Motion of a multirotor from its velocity with two derivatives, the drag per mass against its motion with its derivative,
/// and its heading.
pub(crate) fn rotor_motion(
    [v_n, a_n, jerk]: [Vector3<f64>; 3],
    [drag, drag_rate]: [Vector3<f64>; 2],
    yaw: &Jet,
) -> Motion {
    // Thrust per mass points against body z: T = a − g + drag.
    let thrust = a_n - Vector3::new(0.0, 0.0, STANDARD_GRAVITY) + drag;
    let thrust_rate = jerk + drag_rate;
    let size = thrust.norm();
    let axis = -thrust / size;
    let axis_rate = -(thrust_rate - axis * axis.dot(&thrust_rate)) / size;

    let heading = Chain::new().about(2, yaw.x, yaw.d1);
    let z = heading.matrix().transpose() * axis;
    let z_rate = heading.matrix().transpose() * axis_rate - Vector3::new(0.0, 0.0, yaw.d1).cross(&z);
    // z = (sin θ cos φ, −sin φ, cos θ cos φ).
    let roll = -asin(z.y);
    let roll_rate = -z_rate.y / (1.0 - z.y * z.y).sqrt();
    let pitch = atan2(z.x, z.z);
    let pitch_rate = (z_rate.x * z.z - z.x * z_rate.z) / (z.x * z.x + z.z * z.z);
    let body = heading.about(1, pitch, pitch_rate).about(0, roll, roll_rate);
    Motion { v_n, a_n, c_nb: body.matrix(), rate_nb: body.rate() }
}
