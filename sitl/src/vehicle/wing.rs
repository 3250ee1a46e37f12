//! Kinematics of a fixed wing: airspeed, climb angle and bank follow the pilot as damped oscillators, sideslip follows turn and
//! roll, the course follows from the balance of forces.

use super::slip::{Slip, Turn};
use super::wind::Wind;
use super::{Control, State, VehicleConfig, place};
use crate::trajectory::fixed_wing::wing_motion;
use crate::trajectory::signal::Jet;
use crate::truth::{Motion, place_rate};
use gaware_nav::math::cos;

pub(super) const SPEED: usize = 3;
const CLIMB: usize = 4;
pub(super) const COURSE: usize = 5;
const ACCEL: usize = 6;
const CLIMB_RATE: usize = 7;
const BANK: usize = 8;
const BANK_RATE: usize = 9;
const SLIP: usize = 10;
const SLIP_RATE: usize = 11;

/// Natural frequency (rad/s) and damping of the bank and climb loops.
const BANK_LOOP: (f64, f64) = (2.5, 0.9);
const CLIMB_LOOP: (f64, f64) = (1.4, 0.9);
/// Time constants of the speed loop and of the engine, s.
const SPEED_S: f64 = 1.5;
const ENGINE_S: f64 = 0.5;

fn second_order((omega, damping): (f64, f64), wanted: f64, x: f64, rate: f64) -> f64 {
    omega * omega * (wanted - x) - 2.0 * damping * omega * rate
}

fn air_motion(x: &State, control: &Control) -> (Motion, f64) {
    let climb_accel = second_order(CLIMB_LOOP, control.climb, x[CLIMB], x[CLIMB_RATE]);
    let speed = Jet { x: x[SPEED], d1: x[ACCEL], d2: 0.0 };
    let climb = Jet { x: x[CLIMB], d1: x[CLIMB_RATE], d2: climb_accel };
    let bank = Jet { x: x[BANK], d1: x[BANK_RATE], d2: 0.0 };
    let slip = Jet { x: x[SLIP], d1: x[SLIP_RATE], d2: 0.0 };
    wing_motion(x[COURSE], &speed, &climb, &bank, &slip)
}

pub(super) fn motion(wind: &Wind, t: f64, x: &State, control: &Control) -> Motion {
    let (mut motion, _) = air_motion(x, control);
    let (blow, blow_rate) = wind.carrying(t, x[2], -motion.v_n.z);
    motion.v_n += blow;
    motion.a_n += blow_rate;
    motion
}

pub(super) fn rates(
    config: &VehicleConfig,
    wind: &Wind,
    slip: &Slip,
    t: f64,
    x: &State,
    control: &Control,
) -> State {
    let (air, course_rate) = air_motion(x, control);
    let (blow, _) = wind.carrying(t, x[2], -air.v_n.z);
    let moving = place_rate(&place(x), &(air.v_n + blow));
    let wanted = ((control.speed - x[SPEED]) / SPEED_S).clamp(-config.accel_m_per_s2, config.accel_m_per_s2);
    let mut rates = [0.0; super::STATES];
    rates[..3].copy_from_slice(moving.as_slice());
    rates[SPEED] = x[ACCEL];
    rates[ACCEL] = (wanted - x[ACCEL]) / ENGINE_S;
    rates[CLIMB] = x[CLIMB_RATE];
    rates[CLIMB_RATE] = second_order(CLIMB_LOOP, control.climb, x[CLIMB], x[CLIMB_RATE]);
    rates[COURSE] = course_rate;
    rates[BANK] = x[BANK_RATE];
    rates[BANK_RATE] = second_order(BANK_LOOP, control.bank, x[BANK], x[BANK_RATE]);
    let turn = Turn {
        speed: x[SPEED],
        yaw_rate: course_rate * cos(x[CLIMB]) * cos(x[BANK]),
        roll_rate: x[BANK_RATE],
        airborne: wind.airborne(x[2], -air.v_n.z).0,
    };
    rates[SLIP] = x[SLIP_RATE];
    rates[SLIP_RATE] = second_order(slip.dutch_roll, slip.steady(t, &turn), x[SLIP], x[SLIP_RATE]);
    rates
}
