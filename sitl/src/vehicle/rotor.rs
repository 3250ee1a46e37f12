//! Kinematics of a multirotor: its acceleration follows the pilot as a damped oscillator; tilt follows from
//! acceleration and drag.

use super::wind::Wind;
use super::{Control, State, place};
use crate::trajectory::multirotor::rotor_motion;
use crate::trajectory::signal::Jet;
use crate::truth::{Motion, place_rate};
use nalgebra::Vector3;

const VELOCITY: usize = 3;
const ACCEL: usize = 6;
const JERK: usize = 9;
pub(super) const YAW: usize = 12;
const YAW_RATE: usize = 13;

/// Linear drag, 1/s.
const DRAG_PER_S: f64 = 0.3;
/// Natural frequencies of tilt and heading, rad/s; both critically damped.
const TILT_OMEGA: f64 = 6.0;
const YAW_OMEGA: f64 = 2.5;

fn vector(x: &State, at: usize) -> Vector3<f64> {
    Vector3::new(x[at], x[at + 1], x[at + 2])
}

pub(super) fn motion(wind: &Wind, t: f64, x: &State) -> Motion {
    let (v, a, jerk) = (vector(x, VELOCITY), vector(x, ACCEL), vector(x, JERK));
    let (blow, blow_rate) = wind.at(t, x[2], -v.z);
    // On the ground the landing gear takes the drag and the vehicle stands level.
    let (share, share_rate) = wind.airborne(x[2], -v.z);
    let drag = (v - blow) * (DRAG_PER_S * share);
    let drag_rate = ((a - blow_rate) * share + (v - blow) * share_rate) * DRAG_PER_S;
    let yaw = Jet { x: x[YAW], d1: x[YAW_RATE], d2: 0.0 };
    rotor_motion([v, a, jerk], [drag, drag_rate], &yaw)
}

pub(super) fn rates(x: &State, control: &Control) -> State {
    let (v, a, jerk) = (vector(x, VELOCITY), vector(x, ACCEL), vector(x, JERK));
    let snap = (control.accel - a) * (TILT_OMEGA * TILT_OMEGA) - jerk * (2.0 * TILT_OMEGA);
    let mut rates = [0.0; super::STATES];
    rates[..3].copy_from_slice(place_rate(&place(x), &v).as_slice());
    rates[VELOCITY..ACCEL].copy_from_slice(a.as_slice());
    rates[ACCEL..JERK].copy_from_slice(jerk.as_slice());
    rates[JERK..YAW].copy_from_slice(snap.as_slice());
    rates[YAW] = x[YAW_RATE];
    rates[YAW_RATE] = YAW_OMEGA * YAW_OMEGA * (control.yaw - x[YAW]) - 2.0 * YAW_OMEGA * x[YAW_RATE];
    rates
}
