//! Wind: a mean with gusts, smooth in time, calm on the ground and full from a few metres up, and how it carries a wing.

use super::VehicleConfig;
use crate::noise::{Noise, Purpose};
use gaware_nav::math::{atan, cos, sin_cos};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Height at which the wind is full, m.
const FULL_AT_M: f64 = 8.0;
/// Gust frequencies, Hz: incommensurate, slower ones stronger, as in Dryden's spectrum.
const LINES: [(f64, f64); 5] = [(0.043, 1.0), (0.097, 0.8), (0.23, 0.6), (0.51, 0.4), (1.07, 0.25)];

/// A wing follows a gust with this time constant, s, and before that has it in its airspeed: an autopilot holds the airspeed by throttle and pitch (PX4's `FW_T_TAS_TC` and
/// ArduPilot's `TECS_TIME_CONST` are 5 s), and without one the drag brings it back in twice that.
const FOLLOWS_S: f64 = 5.0;

/// The wind.
#[derive(Debug, Clone)]
pub(super) struct Wind {
    mean: Vector3<f64>,
    gust: f64,
    ground_m: f64,
    phases: [[f64; LINES.len()]; 2],
}

impl Wind {
    pub(super) fn new(config: &VehicleConfig) -> Self {
        let mut noise = Noise::new(config.seed, Purpose::Wind);
        let power: f64 = LINES.iter().map(|(_, a)| a * a).sum::<f64>() / 2.0;
        Self {
            mean: Vector3::new(config.wind_n_e_m_per_s[0], config.wind_n_e_m_per_s[1], 0.0),
            gust: config.gust_m_per_s / power.sqrt(),
            ground_m: config.start.height_m,
            phases: std::array::from_fn(|_| std::array::from_fn(|_| TAU * noise.uniform())),
        }
    }

    /// Velocity of the air and its derivative, north-east-down, for a vehicle at this height with this climb rate.
    pub(super) fn at(&self, t_s: f64, height_m: f64, climb_m_per_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        self.followed(0.0, t_s, (height_m, climb_m_per_s))
    }

    /// By which velocity and acceleration a wing at this height with this climb rate is carried.
    pub(super) fn carrying(
        &self,
        t_s: f64,
        height_m: f64,
        climb_m_per_s: f64,
    ) -> (Vector3<f64>, Vector3<f64>) {
        self.followed(FOLLOWS_S, t_s, (height_m, climb_m_per_s))
    }

    /// Gusts behind a first-order lag, in steady state.
    fn followed(
        &self,
        lag_s: f64,
        t_s: f64,
        (height_m, climb_m_per_s): (f64, f64),
    ) -> (Vector3<f64>, Vector3<f64>) {
        let (mut full, mut rate) = (self.mean, Vector3::zeros());
        for axis in 0..2 {
            for ((f, a), phase) in LINES.iter().zip(&self.phases[axis]) {
                let omega = TAU * f;
                let behind = atan(omega * lag_s);
                let size = self.gust * a * cos(behind);
                let (s, c) = sin_cos(omega * t_s + phase - behind);
                full[axis] += size * s;
                rate[axis] += size * omega * c;
            }
        }
        let (share, slope) = above_ground((height_m - self.ground_m) / FULL_AT_M);
        (full * share, rate * share + full * (slope / FULL_AT_M * climb_m_per_s))
    }

    /// 0 on the ground, 1 in the air, with its derivative by time.
    pub(super) fn airborne(&self, height_m: f64, climb_m_per_s: f64) -> (f64, f64) {
        let (share, slope) = above_ground(height_m - self.ground_m);
        (share, slope * climb_m_per_s)
    }
}

/// Quintic step from 0 at 0 to 1 at 1, with its slope.
fn above_ground(u: f64) -> (f64, f64) {
    if u <= 0.0 {
        (0.0, 0.0)
    } else if u >= 1.0 {
        (1.0, 0.0)
    } else {
        (u * u * u * (10.0 + u * (6.0 * u - 15.0)), 30.0 * (u * (1.0 - u)).powi(2))
    }
}
