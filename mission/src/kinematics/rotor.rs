//! The multirotor.

use super::{GRAVITY, Kinematics};
use crate::airframe::Airframe;
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::{cos, sin, tan};
use gaware_nav::rotation::wrap_pi;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Time constant of the velocity loop, s.
const VELOCITY_LOOP_S: f64 = 0.7;
/// Lags of tilt and of tilt rate, s.
const TILT_LAG_S: f64 = 0.25;
const TILT_RATE_LAG_S: f64 = 0.12;
/// Time constant and lag of yaw, s.
const YAW_LOOP_S: f64 = 0.7;
const YAW_LAG_S: f64 = 0.2;

/// What pilot or autopilot want.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotorCommand {
    /// Velocity over ground, north, east, down, m/s.
    pub velocity_ned_m_per_s: Vector3<f64>,
    /// Heading of the nose, rad.
    pub yaw_rad: f64,
}

/// A multirotor in flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotorState {
    /// Time, s.
    pub t_s: f64,
    /// North, east, down, m.
    pub position_ned_m: Vector3<f64>,
    /// Over ground, north, east, down, m/s.
    pub velocity_ned_m_per_s: Vector3<f64>,
    /// Heading of the nose, rad.
    pub yaw_rad: f64,
    acceleration: Vector3<f64>,
    jerk: Vector3<f64>,
    yaw_rate: f64,
}

impl RotorState {
    /// Hovering, or moving steadily.
    pub fn steady(position_ned_m: Vector3<f64>, velocity_ned_m_per_s: Vector3<f64>, yaw_rad: f64) -> Self {
        Self {
            t_s: 0.0,
            position_ned_m,
            velocity_ned_m_per_s,
            yaw_rad,
            acceleration: Vector3::zeros(),
            jerk: Vector3::zeros(),
            yaw_rate: 0.0,
        }
    }

    /// One step of `dt` seconds toward a command.
    pub fn step(&mut self, airframe: &Airframe, wind_ned: &Vector3<f64>, command: &RotorCommand, dt: f64) {
        let mut wanted = (command.velocity_ned_m_per_s - self.velocity_ned_m_per_s) / VELOCITY_LOOP_S;
        // The tilt that drag takes is not there for acceleration.
        let drag = airframe.drag_per_s * (self.velocity_ned_m_per_s - wind_ned).xy().norm();
        let tilt = STANDARD_GRAVITY * tan(airframe.bank_max_deg.to_radians());
        let limit = airframe.acceleration_m_per_s2.min((tilt - drag).max(0.5));
        let horizontal = wanted.xy().norm();
        if horizontal > limit {
            wanted.x *= limit / horizontal;
            wanted.y *= limit / horizontal;
        }
        let up = 0.7 * (airframe.load_factor_max - 1.0) * STANDARD_GRAVITY;
        wanted.z = wanted.z.clamp(-up, up.min(0.5 * STANDARD_GRAVITY));
        let before = *self;
        let mut jerk = (wanted - self.acceleration) / TILT_LAG_S;
        let level = jerk.xy().norm();
        if airframe.jerk_max_m_per_s3 > 0.0 && level > airframe.jerk_max_m_per_s3 {
            jerk.x *= airframe.jerk_max_m_per_s3 / level;
            jerk.y *= airframe.jerk_max_m_per_s3 / level;
        }
        self.jerk += (jerk - self.jerk) * (dt / TILT_RATE_LAG_S);
        self.acceleration += (before.jerk + self.jerk) * (dt / 2.0);
        let limit = airframe.yaw_rate_max_deg_per_s.to_radians();
        let turn = (wrap_pi(command.yaw_rad - self.yaw_rad) / YAW_LOOP_S).clamp(-limit, limit);
        self.yaw_rate += (turn - self.yaw_rate) * dt / YAW_LAG_S;
        // The mean of old and new rates moves the state: what is felt then adds up to how it moves.
        self.velocity_ned_m_per_s += (before.acceleration + self.acceleration) * (dt / 2.0);
        self.position_ned_m += (before.velocity_ned_m_per_s + self.velocity_ned_m_per_s) * (dt / 2.0);
        self.yaw_rad += (before.yaw_rate + self.yaw_rate) / 2.0 * dt;
        self.t_s += dt;
    }

    /// What the inertial unit feels now; the rate is filled in from neighbours.
    pub fn kinematics(&self, airframe: &Airframe, wind_ned: &Vector3<f64>) -> Kinematics {
        let drag = (self.velocity_ned_m_per_s - wind_ned) * airframe.drag_per_s;
        let thrust = self.acceleration - GRAVITY + Vector3::new(drag.x, drag.y, 0.0);
        let down = -thrust.normalize();
        let nose = Vector3::new(cos(self.yaw_rad), sin(self.yaw_rad), 0.0);
        let right = down.cross(&nose).normalize();
        let forward = right.cross(&down);
        let c_nb = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[forward, right, down]));
        let attitude = UnitQuaternion::from_rotation_matrix(&c_nb);
        Kinematics {
            t_s: self.t_s,
            position_ned_m: self.position_ned_m,
            velocity_ned_m_per_s: self.velocity_ned_m_per_s,
            attitude,
            rate: Vector3::zeros(),
            force: attitude.inverse() * (self.acceleration - GRAVITY),
        }
    }
}
