//! Guidance of a fixed wing: course fields toward lines and circles (Beard & McLain 2012, section 10.1 and 10.2).

use super::Task;
use crate::airframe::Airframe;
use crate::kinematics::{WingCommand, WingState};
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::{asin, atan, atan2, cos};
use gaware_nav::rotation::wrap_pi;
use nalgebra::{Vector2, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Course error to turn rate, 1/s.
const COURSE_GAIN: f64 = 0.7;
/// Height error to climb rate, 1/s.
const HEIGHT_GAIN: f64 = 0.4;

pub(super) fn steer(
    s: &WingState,
    airframe: &Airframe,
    wind: &Vector3<f64>,
    task: &Task,
    speed: f64,
    height: f64,
) -> WingCommand {
    let p = s.position_ned_m.xy();
    let v = (s.air_velocity() + wind).xy();
    let ground = v.norm().max(1.0);
    let course = atan2(v.y, v.x);
    let (wanted, curve) = match task {
        Task::Line { from, to, .. } | Task::Glide { from, to, .. } => line(p, *from, *to, ground, airframe),
        Task::Circle { center, radius, side, .. } => circle(p, *center, *radius, side.sign(), ground),
        Task::Hover { at, .. } | Task::Stay { at, .. } | Task::Touchdown { at } => {
            circle(p, *at, airframe.turn_radius_min_m, 1.0, ground)
        }
    };
    let turn = curve + COURSE_GAIN * wrap_pi(wanted - course);
    // The lateral acceleration is across the air velocity; with a crab angle less of it turns the course.
    let crab = cos(wrap_pi(course - s.heading_rad)).max(0.3);
    let bank = atan(ground * turn / (STANDARD_GRAVITY * crab));
    let climb = (HEIGHT_GAIN * (height + s.position_ned_m.z))
        .clamp(-airframe.descent_max_m_per_s, airframe.climb_max_m_per_s);
    WingCommand {
        airspeed_m_per_s: speed,
        bank_rad: bank,
        climb_rad: asin((climb / s.airspeed_m_per_s.max(1.0)).clamp(-0.8, 0.8)),
        sideslip_rad: 0.0,
    }
}

/// Course toward a line, rad, and its own curvature times speed, rad/s.
fn line(
    p: Vector2<f64>,
    from: Vector2<f64>,
    to: Vector2<f64>,
    ground: f64,
    airframe: &Airframe,
) -> (f64, f64) {
    let along = to - from;
    if along.norm() < 1.0 {
        let d = to - p;
        return (atan2(d.y, d.x), 0.0);
    }
    let direction = atan2(along.y, along.x);
    let d = p - from;
    let cross = along.normalize().perp(&d);
    let reach = airframe.turn_radius_m(ground, 0.5 * airframe.bank_max_deg.to_radians()).max(1.0);
    (direction - atan(cross / reach).clamp(-FRAC_PI_2, FRAC_PI_2), 0.0)
}

/// Course toward a circle, rad, and the turn rate on it, rad/s.
fn circle(p: Vector2<f64>, center: Vector2<f64>, radius: f64, side: f64, ground: f64) -> (f64, f64) {
    let out = p - center;
    let distance = out.norm();
    let bearing = if distance > 0.1 { atan2(out.y, out.x) } else { 0.0 };
    let off = (distance - radius) / radius;
    let wanted = bearing + side * (FRAC_PI_2 + atan(2.0 * off));
    // On the circle the course turns by itself; far from it the way in is straight.
    let on = (1.0 - off.abs()).clamp(0.0, 1.0);
    (wanted, side * on * ground / distance.max(0.5 * radius))
}
