//! Maneuvers as a pilot flies them: commands over time.

use super::{Entry, Maneuver, Side};
use crate::airframe::Airframe;
use crate::kinematics::{Kinematics, RotorCommand, STEP_S, WingCommand, WingState, fill_rates};
use gaware_nav::math::{asin, cos, sin};
use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_4, TAU};

/// Half a period of a speed change, s.
const SPEED_HALF_S: f64 = 6.0;
/// Straight and level before the next thing, s.
const SETTLE_S: f64 = 2.0;
/// Half a period of pulling and pushing, s.
const PULL_HALF_S: f64 = 2.5;
/// A climb or descent with its ends, s.
const CLIMB_S: f64 = 12.0;
/// A leg of a crab pattern, s.
const CRAB_LEG_S: f64 = 4.0;
/// Rudder to one side, s.
const SLIP_S: f64 = 6.0;
/// Sideslip with full rudder, rad.
const SLIP_RAD: f64 = 0.2;

/// A full turn of the nose in hover, s.
const YAW_TURN_S: f64 = 20.0;
/// Straight up or down in hover, s.
const HOVER_STEP_S: f64 = 8.0;
/// Share of the steep bank in gentle circles.
const GENTLE: f64 = 0.6;

/// Slow and fast, m/s.
fn two_speeds(airframe: &Airframe) -> [f64; 2] {
    [airframe.planned_slow_m_per_s(), airframe.speed_max_m_per_s]
}

/// Time of a gentle circle at this speed, s.
fn gentle_circle_s(airframe: &Airframe, speed: f64) -> f64 {
    if airframe.is_fixed_wing() {
        TAU * airframe.turn_radius_m(speed, GENTLE * airframe.steep_bank_rad()) / speed + SETTLE_S
    } else {
        TAU * speed / rotor_turn_m_per_s2(airframe) + SETTLE_S
    }
}

/// Which of the gentle circles is flown at a time: side, speed, and time since its begin.
fn gentle_circle(airframe: &Airframe, t_s: f64) -> (Side, f64, f64) {
    let mut since_s = t_s;
    for speed in two_speeds(airframe) {
        let round_s = gentle_circle_s(airframe, speed);
        for side in [Side::Right, Side::Left] {
            if since_s < round_s {
                return (side, speed, since_s);
            }
            since_s -= round_s;
        }
    }
    (Side::Left, airframe.speed_max_m_per_s, since_s)
}

/// Time of one circle, s.
fn circle_s(airframe: &Airframe) -> f64 {
    if airframe.is_fixed_wing() {
        let radius = airframe.turn_radius_m(airframe.speed_cruise_m_per_s, airframe.steep_bank_rad());
        TAU * radius / airframe.speed_cruise_m_per_s + SETTLE_S
    } else {
        TAU * airframe.speed_cruise_m_per_s / rotor_turn_m_per_s2(airframe) + SETTLE_S
    }
}

/// Centripetal acceleration of a multirotor's circle, m/s².
fn rotor_turn_m_per_s2(airframe: &Airframe) -> f64 {
    0.5 * airframe.acceleration_m_per_s2
}

pub(super) fn duration_s(maneuver: Maneuver, airframe: &Airframe) -> f64 {
    match maneuver {
        Maneuver::VaryingSpeed => 4.0 * SPEED_HALF_S,
        Maneuver::SteadyTurn(_) => circle_s(airframe),
        Maneuver::Climb | Maneuver::Descent => CLIMB_S,
        Maneuver::PullUp => 6.0 * PULL_HALF_S,
        Maneuver::FigureEight | Maneuver::Spiral(_) => 2.0 * circle_s(airframe),
        // The paper, section 4, without the 10 s at rest: 25 s varying, 10 s turn, 10 s slowing, 15 s climb.
        Maneuver::PaperSequence => 60.0,
        Maneuver::CrabLegs => 8.0 * CRAB_LEG_S,
        Maneuver::Sideslip => 2.0 * SLIP_S + SETTLE_S,
        Maneuver::TwoSpeedCircles => {
            2.0 * two_speeds(airframe).map(|v| gentle_circle_s(airframe, v)).iter().sum::<f64>()
        }
        Maneuver::YawTurns => 2.0 * YAW_TURN_S,
        Maneuver::HoverSteps => 4.0 * HOVER_STEP_S,
    }
}

pub(super) fn fly(
    maneuver: Maneuver,
    airframe: &Airframe,
    entry: &Entry,
    wind_ned: &Vector3<f64>,
) -> Vec<Kinematics> {
    let steps = (duration_s(maneuver, airframe) / STEP_S).ceil() as usize;
    let mut samples = Vec::with_capacity(steps + 1);
    match entry {
        Entry::Wing(entry) => {
            let mut state = *entry;
            state.t_s = 0.0;
            for _ in 0..=steps {
                samples.push(state.kinematics(airframe, wind_ned));
                let command = wing_command(maneuver, airframe, state.t_s);
                state.step(airframe, wind_ned, &command, STEP_S);
            }
        }
        Entry::Rotor(entry) => {
            let mut state = *entry;
            state.t_s = 0.0;
            for _ in 0..=steps {
                samples.push(state.kinematics(airframe, wind_ned));
                let command = rotor_command(maneuver, airframe, entry.yaw_rad, state.t_s);
                state.step(airframe, wind_ned, &command, STEP_S);
            }
        }
    }
    fill_rates(&mut samples);
    samples
}

/// Whether the half period of this length that contains `t` is an even one.
fn even_half(t: f64, half_s: f64) -> bool {
    (t / half_s).rem_euclid(2.0) < 1.0
}

pub(super) fn wing_command(maneuver: Maneuver, airframe: &Airframe, t: f64) -> WingCommand {
    let (slow, fast) = (airframe.planned_min_m_per_s(), airframe.speed_max_m_per_s);
    let bank = airframe.steep_bank_rad();
    let turn = circle_s(airframe) - SETTLE_S;
    let steepest = airframe.pitch_max_deg.to_radians();
    let climb = asin((airframe.climb_max_m_per_s / airframe.speed_cruise_m_per_s).min(0.9)).min(steepest);
    let descent = asin((airframe.descent_max_m_per_s / airframe.speed_cruise_m_per_s).min(0.9)).min(steepest);
    let mut command = WingCommand {
        airspeed_m_per_s: airframe.speed_cruise_m_per_s,
        bank_rad: 0.0,
        climb_rad: 0.0,
        sideslip_rad: 0.0,
    };
    match maneuver {
        Maneuver::VaryingSpeed => {
            command.airspeed_m_per_s = if even_half(t, SPEED_HALF_S) { fast } else { slow };
        }
        Maneuver::SteadyTurn(side) if t < turn => command.bank_rad = side.sign() * bank,
        Maneuver::Climb if t < CLIMB_S - SETTLE_S => command.climb_rad = climb,
        Maneuver::Descent if t < CLIMB_S - SETTLE_S => command.climb_rad = -descent,
        Maneuver::PullUp => {
            command.climb_rad = if even_half(t, PULL_HALF_S) { steepest } else { -0.7 * steepest };
        }
        Maneuver::FigureEight => {
            let circle = circle_s(airframe);
            let (side, within) = if t < circle { (Side::Right, t) } else { (Side::Left, t - circle) };
            command.bank_rad = if within < turn { side.sign() * bank } else { 0.0 };
        }
        Maneuver::Spiral(side) if t < 2.0 * circle_s(airframe) - SETTLE_S => {
            command.bank_rad = side.sign() * bank;
            command.climb_rad = if t < circle_s(airframe) { climb } else { -descent };
        }
        Maneuver::PaperSequence => match t {
            t if t < 25.0 => {
                command.airspeed_m_per_s = if even_half(t, 5.0) { fast } else { slow };
            }
            t if t < 35.0 => command.bank_rad = 0.6 * bank,
            t if t < 45.0 => command.airspeed_m_per_s = slow,
            _ => command.climb_rad = climb,
        },
        Maneuver::TwoSpeedCircles => {
            let (side, speed, since_s) = gentle_circle(airframe, t);
            command.airspeed_m_per_s = speed;
            if since_s < gentle_circle_s(airframe, speed) - SETTLE_S {
                command.bank_rad = side.sign() * GENTLE * airframe.steep_bank_rad();
            }
        }
        Maneuver::Sideslip if t < 2.0 * SLIP_S => {
            let slip = if t < SLIP_S { SLIP_RAD } else { -SLIP_RAD };
            command.sideslip_rad = slip;
            command.bank_rad = WingState::bank_against_sideslip(airframe, command.airspeed_m_per_s, slip);
        }
        _ => {}
    }
    command
}

fn rotor_command(maneuver: Maneuver, airframe: &Airframe, yaw: f64, t: f64) -> RotorCommand {
    let (cruise, fast) = (airframe.speed_cruise_m_per_s, airframe.speed_max_m_per_s);
    let toward = |angle: f64, speed: f64| Vector3::new(cos(angle), sin(angle), 0.0) * speed;
    let vertical = |up: f64| Vector3::new(0.0, 0.0, -up);
    let (up, down) = (airframe.climb_max_m_per_s, airframe.descent_max_m_per_s);
    let rate = rotor_turn_m_per_s2(airframe) / cruise;
    let hold = |velocity_ned_m_per_s| RotorCommand { velocity_ned_m_per_s, yaw_rad: yaw };
    // The nose leads the path.
    let circle = |angle: f64| RotorCommand { velocity_ned_m_per_s: toward(angle, cruise), yaw_rad: angle };
    match maneuver {
        Maneuver::VaryingSpeed => hold(toward(yaw, if even_half(t, SPEED_HALF_S) { fast } else { -fast })),
        Maneuver::SteadyTurn(side) => circle(yaw + side.sign() * rate * t),
        Maneuver::Climb if t < CLIMB_S - SETTLE_S => hold(vertical(up)),
        Maneuver::Descent if t < CLIMB_S - SETTLE_S => hold(vertical(-down)),
        Maneuver::PullUp => hold(vertical(if even_half(t, PULL_HALF_S) { up } else { -down })),
        Maneuver::FigureEight => {
            let half = circle_s(airframe);
            circle(yaw + rate * if t < half { t } else { 2.0 * half - t })
        }
        Maneuver::PaperSequence => match t {
            t if t < 25.0 => hold(toward(yaw, if even_half(t, 5.0) { fast } else { 0.2 * fast })),
            t if t < 35.0 => circle(yaw + rate * (t - 25.0)),
            t if t < 45.0 => hold(Vector3::zeros()),
            _ => hold(vertical(up)),
        },
        Maneuver::TwoSpeedCircles => {
            let (side, speed, since_s) = gentle_circle(airframe, t);
            let angle = yaw + side.sign() * rotor_turn_m_per_s2(airframe) / speed * since_s;
            RotorCommand { velocity_ned_m_per_s: toward(angle, speed), yaw_rad: angle }
        }
        Maneuver::YawTurns => {
            let turned = if t < YAW_TURN_S { t } else { 2.0 * YAW_TURN_S - t };
            RotorCommand { yaw_rad: yaw + TAU * turned / YAW_TURN_S, ..hold(Vector3::zeros()) }
        }
        Maneuver::HoverSteps => hold(vertical(if even_half(t, HOVER_STEP_S) { up } else { -down })),
        Maneuver::CrabLegs => {
            // Out and back along 0, 90, 45 and 135 degrees from the nose.
            let leg = (t / CRAB_LEG_S) as usize;
            let axis = [0.0, 2.0, 1.0, 3.0][(leg / 2) % 4] * FRAC_PI_4;
            hold(toward(yaw + axis, if leg.is_multiple_of(2) { fast } else { -fast }))
        }
        _ => hold(Vector3::zeros()),
    }
}
