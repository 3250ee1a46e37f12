//! Steering laws: from a line, a circle or a point to bank, climb and speed (wing) or acceleration (multirotor).

use super::super::{Control, VehicleConfig};
use gaware_nav::earth::{Geodetic, STANDARD_GRAVITY};
use gaware_nav::math::{asin, atan, atan2, cos, sin};
use gaware_nav::rotation::wrap_pi;
use nalgebra::{Vector2, Vector3};

/// What the pilot sees.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight {
    pub t_s: f64,
    pub place: Geodetic,
    pub v_n: Vector3<f64>,
    pub airspeed: f64,
    pub yaw: f64,
}

impl Sight {
    /// North and east from here to there, m.
    pub(super) fn to(&self, there: &Geodetic) -> Vector2<f64> {
        offset(&self.place, there)
    }

    pub(super) fn course(&self) -> f64 {
        atan2(self.v_n.y, self.v_n.x)
    }

    pub(super) fn ground_speed(&self) -> f64 {
        self.v_n.xy().norm()
    }
}

/// North and east from one place to another, m.
pub(super) fn offset(from: &Geodetic, to: &Geodetic) -> Vector2<f64> {
    let (r_n, r_e) = from.radii();
    Vector2::new(
        (to.lat_rad - from.lat_rad) * (r_n + from.height_m),
        wrap_pi(to.lon_rad - from.lon_rad) * (r_e + from.height_m) * cos(from.lat_rad),
    )
}

/// Course loop of a wing, 1/s: how fast it turns per angle it is off.
const COURSE_GAIN: f64 = 0.7;
/// Height loop, 1/s.
const HEIGHT_GAIN: f64 = 0.4;
/// Steepest intercept of a line, rad.
const INTERCEPT_RAD: f64 = 1.0;
/// A wing heads for a line so many seconds ahead.
const LOOK_AHEAD_S: f64 = 4.0;
/// Position and velocity loops of a multirotor, 1/s.
const POSITION_GAIN: f64 = 0.8;
const VELOCITY_GAIN: f64 = 1.5;

/// Course over ground that leads onto the line through `to` with this direction, rad.
pub(super) fn line_course(sight: &Sight, to: &Geodetic, direction: f64) -> f64 {
    let d = sight.to(to);
    // Positive: the line lies to the right.
    let cross = d.y * cos(direction) - d.x * sin(direction);
    let reach = sight.ground_speed().max(8.0) * LOOK_AHEAD_S;
    direction + atan(cross / reach).clamp(-INTERCEPT_RAD, INTERCEPT_RAD)
}

/// Course over ground that leads onto the circle, rad (Beard & McLain 2012, eq. 10.13); `turn` +1 = clockwise.
pub(super) fn circle_course(sight: &Sight, centre: &Geodetic, radius: f64, turn: f64) -> f64 {
    let d = -sight.to(centre);
    let from_centre = atan2(d.y, d.x);
    from_centre + turn * (std::f64::consts::FRAC_PI_2 + atan(2.5 * (d.norm() - radius) / radius))
}

/// Bank for a course over ground; `turn_rate` is what the path itself turns at, rad/s.
pub(super) fn bank_for(config: &VehicleConfig, sight: &Sight, course: f64, turn_rate: f64) -> f64 {
    let rate = turn_rate + COURSE_GAIN * wrap_pi(course - sight.course());
    atan(sight.ground_speed() * rate / STANDARD_GRAVITY).clamp(-config.max_bank_rad, config.max_bank_rad)
}

/// Climb angle toward a height.
pub(super) fn climb_for(config: &VehicleConfig, sight: &Sight, height_m: f64) -> f64 {
    let up =
        (HEIGHT_GAIN * (height_m - sight.place.height_m)).clamp(-config.sink_m_per_s, config.climb_m_per_s);
    asin((up / sight.airspeed.max(8.0)).clamp(-0.5, 0.5))
}

/// Acceleration of a multirotor toward a velocity, within its limits.
pub(super) fn toward_velocity(
    config: &VehicleConfig,
    sight: &Sight,
    wanted: Vector3<f64>,
    path: Vector3<f64>,
) -> Vector3<f64> {
    let mut accel = (wanted - sight.v_n) * VELOCITY_GAIN + path;
    let level = accel.xy().norm();
    if level > config.accel_m_per_s2 {
        accel.x *= config.accel_m_per_s2 / level;
        accel.y *= config.accel_m_per_s2 / level;
    }
    accel.z = accel.z.clamp(-0.4 * STANDARD_GRAVITY, 0.4 * STANDARD_GRAVITY);
    accel
}

/// Vertical velocity (down) toward a height.
pub(super) fn down_for(config: &VehicleConfig, sight: &Sight, height_m: f64) -> f64 {
    -(POSITION_GAIN * (height_m - sight.place.height_m)).clamp(-config.sink_m_per_s, config.climb_m_per_s)
}

/// Velocity of a multirotor toward a point: fast on the way, slow enough to stop there.
pub(super) fn point_velocity(
    config: &VehicleConfig,
    sight: &Sight,
    to: &Geodetic,
    speed: f64,
) -> Vector3<f64> {
    let d = sight.to(to);
    let distance = d.norm();
    let braking = braking_speed(config, distance);
    let pace = speed.min(POSITION_GAIN * distance).min(braking);
    let level = if distance > 1e-6 { d * (pace / distance) } else { Vector2::zeros() };
    Vector3::new(level.x, level.y, down_for(config, sight, to.height_m))
}

/// Speed from which it can stop within this distance, m/s, at 0.4 of its acceleration, which builds up with the jerk.
fn braking_speed(config: &VehicleConfig, distance: f64) -> f64 {
    let a = 0.4 * config.accel_m_per_s2;
    let build_up = if config.jerk_m_per_s3 > 0.0 { a / config.jerk_m_per_s3 } else { 0.0 };
    ((0.5 * a * build_up).powi(2) + 2.0 * a * distance).sqrt() - 0.5 * a * build_up
}

/// Velocity and path acceleration of a multirotor on a circle.
pub(super) fn circle_velocity(
    config: &VehicleConfig,
    sight: &Sight,
    centre: &Geodetic,
    radius: f64,
    turn: f64,
    speed: f64,
) -> [Vector3<f64>; 2] {
    let d = -sight.to(centre);
    let distance = d.norm().max(0.1);
    let out = if d.norm() > 0.1 { d / d.norm() } else { Vector2::x() };
    let along = Vector2::new(-out.y, out.x) * turn;
    let pace = speed.min((0.7 * config.accel_m_per_s2 * radius).sqrt());
    let inward = (POSITION_GAIN * (distance - radius)).clamp(-speed, speed);
    // Far from the circle, first get there.
    let share = (1.0 - (distance - radius).abs() / radius.max(1.0)).clamp(0.0, 1.0);
    let v = along * (pace * share) - out * inward;
    let pull = -out * (pace * share).powi(2) / distance;
    [Vector3::new(v.x, v.y, down_for(config, sight, centre.height_m)), Vector3::new(pull.x, pull.y, 0.0)]
}

/// A control that changes nothing.
pub(super) fn stationary(yaw: f64) -> Control {
    Control { bank: 0.0, climb: 0.0, speed: 0.0, accel: Vector3::zeros(), yaw }
}
