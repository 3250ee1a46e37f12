//! Flights as point masses: what the inertial unit would feel on a predicted path.
//!
//! A fixed wing flies coordinated unless commanded to slip: lift and side force turn the air velocity, the wind carries it
//! (Beard & McLain 2012, section 9.3). A multirotor tilts its thrust to accelerate and against linear drag (Mahony 2012, eq. 7
//! with lumped drag). Commands are followed with first-order lags inside the airframe's limits, so that everything is
//! smooth. Sensors, filters and missions are unknown here.

mod rotor;
mod wing;

use gaware_nav::math::sin_cos;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

pub use rotor::{RotorCommand, RotorState};
pub use wing::{WingCommand, WingState};

/// Spacing of predicted samples, s.
pub const STEP_S: f64 = 0.05;

/// Gravity of predictions, m/s²; the difference to the place is no matter for planning.
pub(crate) const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, gaware_nav::earth::STANDARD_GRAVITY);

/// The vehicle at one instant of a predicted flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kinematics {
    /// Time since the start of the prediction, s.
    pub t_s: f64,
    /// Position north, east, down from the local origin at home's altitude, m.
    pub position_ned_m: Vector3<f64>,
    /// Velocity over ground v_n, north, east, down, m/s.
    pub velocity_ned_m_per_s: Vector3<f64>,
    /// C_b^n as a quaternion.
    pub attitude: UnitQuaternion<f64>,
    /// Angular rate ω_nb^b, rad/s; the rotation of the Earth is left out.
    pub rate: Vector3<f64>,
    /// Specific force f^b, m/s².
    pub force: Vector3<f64>,
}

impl Kinematics {
    /// Height above home, m.
    pub fn height_m(&self) -> f64 {
        -self.position_ned_m.z
    }

    /// North and east, m.
    pub fn north_east_m(&self) -> Vector2<f64> {
        self.position_ned_m.xy()
    }
}

/// Rates of a sampled attitude by central differences of the rotation between neighbours.
pub(crate) fn fill_rates(samples: &mut [Kinematics]) {
    let last = samples.len().saturating_sub(1);
    let rates: Vec<Vector3<f64>> = (0..samples.len())
        .map(|k| {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(last));
            match (samples.get(a), samples.get(b)) {
                (Some(a), Some(b)) if b.t_s > a.t_s => {
                    (a.attitude.inverse() * b.attitude).scaled_axis() / (b.t_s - a.t_s)
                }
                _ => Vector3::zeros(),
            }
        })
        .collect();
    for (sample, rate) in samples.iter_mut().zip(rates) {
        sample.rate = rate;
    }
}

/// How far a flight reaches from where it began, m.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Extent {
    /// Along the initial course.
    pub ahead_m: f64,
    /// Against it.
    pub behind_m: f64,
    /// To the right of it.
    pub right_m: f64,
    /// To the left of it.
    pub left_m: f64,
    /// Above the start.
    pub up_m: f64,
    /// Below the start.
    pub down_m: f64,
}

impl Extent {
    /// Of these samples, relative to a heading in rad.
    pub fn of(samples: &[Kinematics], heading_rad: f64) -> Self {
        let mut extent = Self::default();
        let Some(first) = samples.first() else { return extent };
        let (s, c) = sin_cos(heading_rad);
        for k in samples {
            let d = k.position_ned_m - first.position_ned_m;
            let (ahead, right) = (d.x * c + d.y * s, d.y * c - d.x * s);
            extent.ahead_m = extent.ahead_m.max(ahead);
            extent.behind_m = extent.behind_m.max(-ahead);
            extent.right_m = extent.right_m.max(right);
            extent.left_m = extent.left_m.max(-right);
            extent.up_m = extent.up_m.max(-d.z);
            extent.down_m = extent.down_m.max(d.z);
        }
        extent
    }
}

#[cfg(test)]
mod tests;
