//! Guidance of a multirotor: straight to the point with braking in time, around circles at a speed that they allow.

use super::Task;
use crate::airframe::Airframe;
use crate::kinematics::{RotorCommand, RotorState};
use gaware_nav::math::atan2;
use nalgebra::{Vector2, Vector3};

/// Share of the limits that autopilots use for position control.
const SHARE: f64 = 0.5;

pub(super) fn steer(
    s: &RotorState,
    airframe: &Airframe,
    task: &Task,
    speed: f64,
    height: f64,
    yaw: Option<f64>,
) -> RotorCommand {
    let p = s.position_ned_m.xy();
    let (horizontal, nose) = match task {
        Task::Line { to, .. } | Task::Glide { to, .. } => toward(p, *to, airframe, speed),
        Task::Hover { at, .. } | Task::Stay { at, .. } | Task::Touchdown { at } => {
            toward(p, *at, airframe, speed)
        }
        Task::Circle { center, radius, side, .. } => {
            around(p, *center, *radius, side.sign(), airframe, speed)
        }
    };
    let up = (height + s.position_ned_m.z).clamp(-airframe.descent_max_m_per_s, airframe.climb_max_m_per_s);
    RotorCommand {
        velocity_ned_m_per_s: Vector3::new(horizontal.x, horizontal.y, -up),
        yaw_rad: yaw.or(nose).unwrap_or(s.yaw_rad),
    }
}

fn toward(p: Vector2<f64>, to: Vector2<f64>, airframe: &Airframe, speed: f64) -> (Vector2<f64>, Option<f64>) {
    let d = to - p;
    let distance = d.norm();
    if distance < 0.1 {
        return (Vector2::zeros(), None);
    }
    let braking = stopping_speed(SHARE * airframe.braking_m_per_s2, airframe.jerk_max_m_per_s3, distance);
    let nose = (distance > 5.0).then(|| atan2(d.y, d.x));
    (d / distance * speed.min(braking).min(0.8 * distance), nose)
}

/// The speed from which a vehicle stops within this distance, m/s: d = v²/2a + v a/2j, where the deceleration a builds up with
/// the jerk j; a jerk of 0 means no limit.
fn stopping_speed(braking: f64, jerk: f64, distance: f64) -> f64 {
    let lost = if jerk > 0.0 { braking * braking / (2.0 * jerk) } else { 0.0 };
    (lost * lost + 2.0 * braking * distance).sqrt() - lost
}

fn around(
    p: Vector2<f64>,
    center: Vector2<f64>,
    radius: f64,
    side: f64,
    airframe: &Airframe,
    speed: f64,
) -> (Vector2<f64>, Option<f64>) {
    let out = p - center;
    let distance = out.norm();
    if distance < 0.5 {
        return (Vector2::new(1.0, 0.0) * speed.min(2.0), None);
    }
    let radial = out / distance;
    let speed = speed.min((SHARE * airframe.acceleration_m_per_s2 * radius).sqrt());
    let inward = (0.6 * (distance - radius)).clamp(-speed, speed);
    let tangent = Vector2::new(-radial.y, radial.x) * side;
    let along = (speed * speed - inward * inward).max(0.0).sqrt();
    (tangent * along - radial * inward, Some(atan2(-radial.y, -radial.x)))
}
