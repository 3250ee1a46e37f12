//! The fixed wing.

use super::{GRAVITY, Kinematics};
use crate::airframe::Airframe;
use gaware_nav::earth::STANDARD_GRAVITY;
use gaware_nav::math::{asin, cos, sin, sin_cos};
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, SQRT_2};

/// Angle of attack in level flight at cruise speed, rad: a lift coefficient of about 0.45.
const CRUISE_ATTACK: f64 = 0.07;
/// Side acceleration per sideslip at cruise speed, in g per rad: 0.19 g at 12°, light aircraft with a fuselage.
const SIDE_FORCE_G_PER_RAD: f64 = 0.9;
/// Lag of the slip that a turn or a roll brings about, s: a quarter of a Dutch roll.
const SLIP_LAG_S: f64 = 0.3;
/// Largest slip by itself, rad.
const SLIP_MAX_RAD: f64 = 0.35;
/// Lags of throttle, ailerons, elevator and rudder, s.
const THROTTLE_LAG_S: f64 = 0.6;
const ROLL_LAG_S: f64 = 0.2;
const PITCH_LAG_S: f64 = 0.4;
const RUDDER_LAG_S: f64 = 0.5;
/// Time constants of the loops around them, s.
const SPEED_LOOP_S: f64 = 1.5;
const BANK_LOOP_S: f64 = 0.5;
const PATH_LOOP_S: f64 = 1.0;

/// What pilot or autopilot want.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WingCommand {
    /// Airspeed, m/s.
    pub airspeed_m_per_s: f64,
    /// Bank, rad, right positive.
    pub bank_rad: f64,
    /// Climb angle, rad.
    pub climb_rad: f64,
    /// Sideslip, rad; the wind comes from the right where positive.
    pub sideslip_rad: f64,
}

/// A fixed wing in flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WingState {
    /// Time, s.
    pub t_s: f64,
    /// North, east, down, m.
    pub position_ned_m: Vector3<f64>,
    /// Airspeed, m/s.
    pub airspeed_m_per_s: f64,
    /// Direction of the air velocity, rad.
    pub heading_rad: f64,
    /// Climb angle, rad.
    pub climb_rad: f64,
    /// Bank about the air velocity, rad.
    pub bank_rad: f64,
    /// Sideslip by the rudder, rad.
    pub sideslip_rad: f64,
    /// Sideslip by itself in turns and while rolling, rad.
    own_slip_rad: f64,
    acceleration: f64,
    roll_rate: f64,
    climb_rate: f64,
}

impl WingState {
    /// Straight and level.
    pub fn level(position_ned_m: Vector3<f64>, airspeed_m_per_s: f64, heading_rad: f64) -> Self {
        Self {
            t_s: 0.0,
            position_ned_m,
            airspeed_m_per_s,
            heading_rad,
            climb_rad: 0.0,
            bank_rad: 0.0,
            sideslip_rad: 0.0,
            own_slip_rad: 0.0,
            acceleration: 0.0,
            roll_rate: 0.0,
            climb_rate: 0.0,
        }
    }

    /// Velocity through the air, north, east, down, m/s.
    pub fn air_velocity(&self) -> Vector3<f64> {
        let (sg, cg) = sin_cos(self.climb_rad);
        let (sh, ch) = sin_cos(self.heading_rad);
        self.airspeed_m_per_s * Vector3::new(cg * ch, cg * sh, -sg)
    }

    /// Of all causes, rad.
    fn slip(&self) -> f64 {
        self.sideslip_rad + self.own_slip_rad
    }

    fn side_acceleration(&self, airframe: &Airframe) -> f64 {
        let q = (self.airspeed_m_per_s / airframe.speed_cruise_m_per_s).powi(2);
        -SIDE_FORCE_G_PER_RAD * STANDARD_GRAVITY * q * self.slip()
    }

    /// Slip of an aircraft whose rudder does not coordinate, rad: its side force goes with the sine of the bank, for yaw damping
    /// and weathercock stability balance at a slip in proportion to yaw rate over speed (Stevens, Lewis & Johnson 2016, section
    /// 2.3), and with the roll rate by adverse yaw. Recorded flights of ArduPilot's simulated plane follow this within 0.02 g.
    fn uncoordinated(&self, airframe: &Airframe) -> f64 {
        let speed = (self.airspeed_m_per_s / airframe.speed_cruise_m_per_s).max(0.1);
        let turn = airframe.side_force_g * SQRT_2 * sin(self.bank_rad) * cos(self.climb_rad);
        let roll = airframe.roll_side_force_g * speed * self.roll_rate / FRAC_PI_2;
        let slip = (turn - roll) / (SIDE_FORCE_G_PER_RAD * speed * speed);
        slip.clamp(-SLIP_MAX_RAD, SLIP_MAX_RAD)
    }

    /// Lift acceleration that holds the climb rate of change at this bank, m/s².
    fn lift(&self, airframe: &Airframe) -> f64 {
        let vertical = STANDARD_GRAVITY * cos(self.climb_rad) + self.airspeed_m_per_s * self.climb_rate;
        let side = self.side_acceleration(airframe) * sin(self.bank_rad);
        (vertical + side) / cos(self.bank_rad).max(0.2)
    }

    /// Rate of change of heading, rad/s.
    fn turn_rate(&self, airframe: &Airframe) -> f64 {
        let sideways =
            self.lift(airframe) * sin(self.bank_rad) + self.side_acceleration(airframe) * cos(self.bank_rad);
        sideways / (self.airspeed_m_per_s.max(1.0) * cos(self.climb_rad).max(0.2))
    }

    /// One step of `dt` seconds toward a command.
    pub fn step(&mut self, airframe: &Airframe, wind_ned: &Vector3<f64>, command: &WingCommand, dt: f64) {
        let speed = command.airspeed_m_per_s.clamp(airframe.speed_min_m_per_s, airframe.speed_max_m_per_s);
        let wanted = ((speed - self.airspeed_m_per_s) / SPEED_LOOP_S)
            .clamp(-airframe.braking_m_per_s2, airframe.acceleration_m_per_s2);
        // The mean of old and new rates moves the state: what is felt then adds up to how it moves.
        let before = *self;
        self.acceleration += (wanted - self.acceleration) * dt / THROTTLE_LAG_S;

        let limit = airframe.bank_max_deg.to_radians();
        let roll_limit = airframe.roll_rate_max_deg_per_s.to_radians();
        let wanted = ((command.bank_rad.clamp(-limit, limit) - self.bank_rad) / BANK_LOOP_S)
            .clamp(-roll_limit, roll_limit);
        self.roll_rate += (wanted - self.roll_rate) * dt / ROLL_LAG_S;

        let limit = airframe.pitch_max_deg.to_radians();
        // What the load factor leaves for pulling; pushing goes to a third of a g.
        let v = self.airspeed_m_per_s.max(1.0);
        let pull = ((airframe.load_factor_max * cos(self.bank_rad) - 1.0).max(0.1)) * STANDARD_GRAVITY / v;
        let push = 0.65 * STANDARD_GRAVITY / v;
        let wanted =
            ((command.climb_rad.clamp(-limit, limit) - self.climb_rad) / PATH_LOOP_S).clamp(-push, pull);
        self.climb_rate += (wanted - self.climb_rate) * dt / PITCH_LAG_S;

        self.sideslip_rad += (command.sideslip_rad - self.sideslip_rad) * dt / RUDDER_LAG_S;
        self.own_slip_rad += (before.uncoordinated(airframe) - self.own_slip_rad) * dt / SLIP_LAG_S;
        self.airspeed_m_per_s += (before.acceleration + self.acceleration) / 2.0 * dt;
        self.bank_rad += (before.roll_rate + self.roll_rate) / 2.0 * dt;
        self.climb_rad += (before.climb_rate + self.climb_rate) / 2.0 * dt;
        self.heading_rad += (before.turn_rate(airframe) + self.turn_rate(airframe)) / 2.0 * dt;
        let through_air = (before.air_velocity() + self.air_velocity()) / 2.0;
        self.position_ned_m += (through_air + wind_ned) * dt;
        self.t_s += dt;
    }

    /// What the inertial unit feels now; the rate is filled in from neighbours.
    pub fn kinematics(&self, airframe: &Airframe, wind_ned: &Vector3<f64>) -> Kinematics {
        let v = self.airspeed_m_per_s;
        let (sg, cg) = sin_cos(self.climb_rad);
        let (sh, ch) = sin_cos(self.heading_rad);
        let along = Vector3::new(cg * ch, cg * sh, -sg);
        let acceleration = along * self.acceleration
            + Vector3::new(-sg * ch, -sg * sh, -cg) * (v * self.climb_rate)
            + Vector3::new(-cg * sh, cg * ch, 0.0) * (v * self.turn_rate(airframe));
        let load = self.lift(airframe) / STANDARD_GRAVITY;
        let attack = CRUISE_ATTACK * load * (airframe.speed_cruise_m_per_s / v.max(1.0)).powi(2);
        let attitude = UnitQuaternion::from_euler_angles(self.bank_rad, self.climb_rad, self.heading_rad)
            * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -self.slip())
            * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), attack);
        Kinematics {
            t_s: self.t_s,
            position_ned_m: self.position_ned_m,
            velocity_ned_m_per_s: self.air_velocity() + wind_ned,
            attitude,
            rate: Vector3::zeros(),
            force: attitude.inverse() * (acceleration - GRAVITY),
        }
    }

    /// Bank that keeps the heading with this sideslip at this speed, rad.
    pub fn bank_against_sideslip(airframe: &Airframe, airspeed_m_per_s: f64, sideslip_rad: f64) -> f64 {
        let q = (airspeed_m_per_s / airframe.speed_cruise_m_per_s).powi(2);
        // tan φ = −Y/g: in balance the side force is carried by lift.
        asin((SIDE_FORCE_G_PER_RAD * q * sideslip_rad).clamp(-0.5, 0.5))
    }
}
