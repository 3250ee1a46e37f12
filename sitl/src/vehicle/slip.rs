//! Sideslip of a wing whose rudder does not coordinate: weathercock stability against yaw damping in the turn, adverse yaw while it
//! rolls, a rudder that is never trimmed exactly and air that is never quiet, as a Dutch roll (Etkin & Reid 1996, sections 3.9
//! and 6.8). Every seed is another aircraft.

use super::VehicleConfig;
use crate::noise::{Noise, Purpose};
use crate::trajectory::fixed_wing::SIDE_FORCE_PER_M;
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::sin;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, TAU};

/// Spread of the side force in turns and while rolling from one aircraft to the next, as shares: two recorded flights of one
/// aircraft agree within 0.02 of it.
const SPREAD: [f64; 2] = [0.07, 0.3];
/// Spread of the trim, rad.
const TRIM_RAD: f64 = 0.008;
/// Quiet slip in the air, rad RMS, and its frequencies, Hz.
const RESTLESS_RAD: f64 = 0.006;
const LINES_HZ: [f64; 3] = [0.071, 0.19, 0.47];
/// Natural frequency (rad/s) and damping of Dutch rolls: lowest and width.
const DUTCH_ROLL: [(f64, f64); 2] = [(3.0, 2.0), (0.4, 0.3)];
/// Slip is judged as at this speed where the wing is slower, m/s: on the ground it has none.
const SLOW: f64 = 6.0;
/// Largest slip, rad.
const MOST_RAD: f64 = 0.4;

/// What a wing does that makes it slip.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    /// Airspeed, m/s.
    pub speed: f64,
    /// About the axis down through the aircraft, rad/s.
    pub yaw_rate: f64,
    /// rad/s.
    pub roll_rate: f64,
    /// 0 on the ground, 1 in the air.
    pub airborne: f64,
}

/// How one aircraft slips.
#[derive(Debug, Clone)]
pub(super) struct Slip {
    /// Natural frequency, rad/s, and damping.
    pub dutch_roll: (f64, f64),
    /// Side acceleration over speed times yaw rate, and over speed times roll rate.
    per_yaw: f64,
    per_roll: f64,
    trim_rad: f64,
    restless_rad: f64,
    phases: [f64; LINES_HZ.len()],
}

impl Slip {
    pub(super) fn new(config: &VehicleConfig) -> Self {
        let mut noise = Noise::new(config.seed, Purpose::Slip);
        let [turn, roll] = SPREAD.map(|s| 1.0 + s * noise.normal().clamp(-2.0, 2.0));
        let side = config.side_force_g * turn;
        // V r = g sin φ − Y in a level turn with side force Y; the config counts Y at φ = 45°.
        let per_yaw = side / (FRAC_1_SQRT_2 - side).max(0.1);
        let rolling = config.roll_side_force_g * STANDARD_GRAVITY * roll;
        let slips = config.side_force_g > 0.0;
        let share = |value: f64| if slips { value } else { 0.0 };
        Self {
            dutch_roll: (
                DUTCH_ROLL[0].0 + DUTCH_ROLL[0].1 * noise.uniform(),
                DUTCH_ROLL[1].0 + DUTCH_ROLL[1].1 * noise.uniform(),
            ),
            per_yaw,
            per_roll: rolling / (FRAC_PI_2 * config.cruise_m_per_s.max(1.0)),
            trim_rad: share(TRIM_RAD * noise.normal()),
            restless_rad: share(RESTLESS_RAD),
            phases: std::array::from_fn(|_| TAU * noise.uniform()),
        }
    }

    /// The slip that this turn leads to, rad; positive with the wind from the right.
    pub(super) fn steady(&self, t_s: f64, turn: &Turn) -> f64 {
        let side = turn.speed * (self.per_yaw * turn.yaw_rate - self.per_roll * turn.roll_rate);
        let by_turn = side / (SIDE_FORCE_PER_M * turn.speed.max(SLOW).powi(2));
        let each = self.restless_rad * (2.0 / LINES_HZ.len() as f64).sqrt();
        let restless: f64 =
            LINES_HZ.iter().zip(&self.phases).map(|(f, phase)| each * sin(TAU * f * t_s + phase)).sum();
        (by_turn + self.trim_rad + restless).clamp(-MOST_RAD, MOST_RAD) * turn.airborne
    }
}
