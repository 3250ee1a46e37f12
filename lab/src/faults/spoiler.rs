//! Faults of sensors and clocks, put into the messages of a simulated autopilot after it made them: an independent place, so that
//! simulator and estimator share no idea of what a fault looks like.

use gaware::link::frame::{Frame, Sender};
use gaware_nav::math::{atan2, cos, hypot, sin};
use mavlink::dialects::ardupilotmega::{GPS_RAW_INT_DATA, MavMessage};
use std::collections::VecDeque;
use std::ops::Range;

/// Metres per 1e-7 degree of latitude.
const METRES_PER_E7: f64 = 0.011_132;
/// Ids of `RAW_IMU`, `SCALED_IMU`, `HIGHRES_IMU` and `GPS_RAW_INT`.
const INERTIAL: [u32; 3] = [27, 26, 105];
const GPS_RAW_INT: u32 = 24;
/// A turn of a 32-bit counter.
const TURN: u64 = 1 << 32;
/// Stamps that are kept, s.
const KEPT_S: f64 = 60.0;

/// What happens to the messages while the fault lasts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Spoil {
    /// Nothing.
    None,
    /// The autopilot's clock is ahead by this (behind where negative), s.
    Clock(f64),
    /// The autopilot has been up for so long that its counter of 32 bits wraps at this time, s.
    Wrap {
        /// Of microseconds after 71.6 min, otherwise of milliseconds after 49.7 days.
        of_us: bool,
        /// s.
        at_s: f64,
    },
    /// Every fifth fix is stamped this much ahead (behind where negative), s.
    FixStamps(f64),
    /// Every fifth inertial message is stamped this much ahead (behind where negative), s.
    InertialStamps(f64),
    /// Positions lie this far north.
    Jump(f64),
    /// Positions drift north at this speed, m/s, …
    Drift {
        /// m/s.
        speed: f64,
        /// … and the velocity of the fixes agrees.
        with_velocity: bool,
    },
    /// The inertial values stay as they were.
    Frozen,
    /// Gyro x stays as it was.
    StuckGyro,
    /// Accelerometer y stays as it was.
    StuckAccel,
    /// Values end at these limits: rad/s and m/s².
    Clipped {
        /// rad/s.
        rate: f64,
        /// m/s².
        force: f64,
    },
    /// Of the inertial messages only every n-th arrives.
    Decimated(u64),
    /// This message is no longer sent.
    Absent(u32),
    /// Each frame comes so often, from other components of the vehicle.
    Flood(u8),
}

/// Where an inertial stamp belongs: the stamp on the time base of the estimator, and the simulator's time, s.
#[derive(Debug, Clone, Copy)]
struct Place {
    stamp_s: f64,
    sim_s: f64,
}

/// Spoils the messages of one autopilot while its fault lasts.
#[derive(Debug, Clone)]
pub(super) struct Spoiler {
    spoil: Spoil,
    span_s: Range<f64>,
    inertial: u64,
    fixes: u64,
    frozen: Option<[f64; 6]>,
    places: VecDeque<Place>,
}

impl Spoiler {
    /// For this fault from and to these times, s.
    pub(super) fn new(spoil: Spoil, span_s: Range<f64>) -> Self {
        Self { spoil, span_s, inertial: 0, fixes: 0, frozen: None, places: VecDeque::new() }
    }

    /// The frames that leave the autopilot instead of this one.
    pub(super) fn frames(&mut self, sim_s: f64, frame: &Frame) -> Vec<Frame> {
        let id = frame.message_id;
        let timed = INERTIAL.contains(&id) || id == GPS_RAW_INT || matches!(id, 2 | 30);
        let Some(mut message) = frame.decode().ok().filter(|_| timed) else {
            return self.repeated(sim_s, frame);
        };
        let active = self.span_s.contains(&sim_s);
        let inertial = INERTIAL.contains(&id);
        self.inertial += u64::from(inertial);
        self.fixes += u64::from(id == GPS_RAW_INT);
        let mut shift_s = 0.0;
        match self.spoil {
            Spoil::Clock(by_s) if active => shift_s = by_s,
            Spoil::FixStamps(by_s) if active && id == GPS_RAW_INT && self.fixes.is_multiple_of(5) => {
                shift_s = by_s;
            }
            Spoil::InertialStamps(by_s) if active && inertial && self.inertial.is_multiple_of(5) => {
                shift_s = by_s;
            }
            Spoil::Decimated(n) if active && inertial && !self.inertial.is_multiple_of(n) => {
                return Vec::new();
            }
            Spoil::Absent(absent) if active && id == absent => return Vec::new(),
            Spoil::Wrap { of_us, at_s } => {
                shift_s = TURN as f64 * if of_us { 1e-6 } else { 1e-3 } - at_s;
            }
            _ => {}
        }
        let stamp_us = shift(&mut message, shift_s, matches!(self.spoil, Spoil::Wrap { of_us: true, .. }));
        let out_of_place = matches!(self.spoil, Spoil::InertialStamps(_)) && shift_s != 0.0;
        if let Some(stamp_us) = stamp_us.filter(|_| inertial && !out_of_place) {
            self.places.push_back(Place { stamp_s: stamp_us as f64 * 1e-6, sim_s });
            while self.places.front().is_some_and(|p| p.sim_s < sim_s - KEPT_S) {
                self.places.pop_front();
            }
        }
        if active {
            match &mut message {
                MavMessage::GPS_RAW_INT(fix) => self.fix(sim_s, fix),
                other if inertial => self.values(other),
                _ => {}
            }
        } else {
            self.frozen = None;
        }
        let sender = Sender { system_id: frame.system_id, component_id: frame.component_id };
        self.repeated(sim_s, &Frame::encode(sender, frame.sequence, &message))
    }

    /// The frame, and in a flood as many of others.
    fn repeated(&self, sim_s: f64, frame: &Frame) -> Vec<Frame> {
        let mut out = vec![frame.clone()];
        if let (Spoil::Flood(times), true) = (self.spoil, self.span_s.contains(&sim_s))
            && let Ok(message) = frame.decode()
        {
            let others = (1..times).map(|component| {
                let component_id = 20 + component;
                let sender = Sender { system_id: frame.system_id, component_id };
                Frame::encode(sender, frame.sequence, &message)
            });
            out.extend(others);
        }
        out
    }

    fn fix(&self, sim_s: f64, fix: &mut GPS_RAW_INT_DATA) {
        let (north_m, speed) = match self.spoil {
            Spoil::Jump(north_m) => (north_m, 0.0),
            Spoil::Drift { speed, with_velocity } => {
                (speed * (sim_s - self.span_s.start), if with_velocity { speed } else { 0.0 })
            }
            _ => return,
        };
        fix.lat += (north_m / METRES_PER_E7) as i32;
        if speed != 0.0 {
            let course = (f64::from(fix.cog) * 0.01).to_radians();
            let ground = f64::from(fix.vel) * 0.01;
            let (north, east) = (ground * cos(course) + speed, ground * sin(course));
            fix.vel = (hypot(north, east) * 100.0).round() as u16;
            fix.cog = ((atan2(east, north).to_degrees().rem_euclid(360.0) * 100.0).round() as u16) % 36000;
        }
    }

    /// Inertial values as the fault leaves them.
    fn values(&mut self, message: &mut MavMessage) {
        let Some(now) = read(message) else { return };
        let kept = match self.spoil {
            Spoil::Frozen | Spoil::StuckGyro | Spoil::StuckAccel => *self.frozen.get_or_insert(now),
            _ => now,
        };
        let [x, y, z, fx, fy, fz] = now;
        let limit = |v: f64, most: f64| v.clamp(-most, most);
        let values = match self.spoil {
            Spoil::Frozen => kept,
            Spoil::StuckGyro => [kept[0], y, z, fx, fy, fz],
            Spoil::StuckAccel => [x, y, z, fx, kept[4], fz],
            Spoil::Clipped { rate, force } => {
                let [x, y, z] = [x, y, z].map(|v| limit(v, rate));
                let [fx, fy, fz] = [fx, fy, fz].map(|v| limit(v, force));
                [x, y, z, fx, fy, fz]
            }
            _ => now,
        };
        write(message, values);
    }

    /// The simulator's time of an instant on the estimator's time base, s; nothing where no inertial stamp is near.
    pub(super) fn sim_time_of(&self, t_s: f64) -> Option<f64> {
        let near = self.places.iter().rev().find(|p| (p.stamp_s - t_s).abs() < 1.0)?;
        // Of those that follow upon each other the nearest one.
        let nearest = self
            .places
            .iter()
            .rev()
            .filter(|p| (p.sim_s - near.sim_s).abs() < 3.0)
            .min_by(|a, b| (a.stamp_s - t_s).abs().total_cmp(&(b.stamp_s - t_s).abs()))?;
        Some(nearest.sim_s + (t_s - nearest.stamp_s))
    }
}

/// Moves the stamp; gives it back unwrapped, µs. `short`: microseconds have 32 bits.
fn shift(message: &mut MavMessage, by_s: f64, short: bool) -> Option<u64> {
    let by_us = (by_s * 1e6).round() as i64;
    let (us, ms): (&mut u64, &mut u32) = match message {
        MavMessage::RAW_IMU(m) => (&mut m.time_usec, &mut 0),
        MavMessage::HIGHRES_IMU(m) => (&mut m.time_usec, &mut 0),
        MavMessage::GPS_RAW_INT(m) => (&mut m.time_usec, &mut 0),
        MavMessage::SCALED_IMU(m) => (&mut 0, &mut m.time_boot_ms),
        MavMessage::ATTITUDE(m) => (&mut 0, &mut m.time_boot_ms),
        MavMessage::SYSTEM_TIME(m) => (&mut 0, &mut m.time_boot_ms),
        _ => return None,
    };
    let base = (*us + u64::from(*ms) * 1000).saturating_add_signed(by_us);
    *us = if short { base % TURN } else { base };
    *ms = ((base / 1000) % TURN) as u32;
    Some(base)
}

/// Rates, rad/s, and specific forces, m/s², in whatever units the message has them.
fn read(message: &MavMessage) -> Option<[f64; 6]> {
    let integers = |gyro: [i16; 3], accel: [i16; 3]| {
        let (gyro, accel) = (gyro.map(|v| f64::from(v) * 1e-3), accel.map(|v| f64::from(v) * 9.806_65e-3));
        [gyro[0], gyro[1], gyro[2], accel[0], accel[1], accel[2]]
    };
    match message {
        MavMessage::RAW_IMU(m) => Some(integers([m.xgyro, m.ygyro, m.zgyro], [m.xacc, m.yacc, m.zacc])),
        MavMessage::SCALED_IMU(m) => Some(integers([m.xgyro, m.ygyro, m.zgyro], [m.xacc, m.yacc, m.zacc])),
        MavMessage::HIGHRES_IMU(m) => {
            Some([m.xgyro, m.ygyro, m.zgyro, m.xacc, m.yacc, m.zacc].map(f64::from))
        }
        _ => None,
    }
}

fn write(message: &mut MavMessage, [x, y, z, fx, fy, fz]: [f64; 6]) {
    // Back to the same counts: the values came from whole ones.
    let (rate, force) = (|v: f64| (v * 1e3).round() as i16, |v: f64| (v / 9.806_65e-3).round() as i16);
    match message {
        MavMessage::RAW_IMU(m) => {
            (m.xgyro, m.ygyro, m.zgyro) = (rate(x), rate(y), rate(z));
            (m.xacc, m.yacc, m.zacc) = (force(fx), force(fy), force(fz));
        }
        MavMessage::SCALED_IMU(m) => {
            (m.xgyro, m.ygyro, m.zgyro) = (rate(x), rate(y), rate(z));
            (m.xacc, m.yacc, m.zacc) = (force(fx), force(fy), force(fz));
        }
        MavMessage::HIGHRES_IMU(m) => {
            (m.xgyro, m.ygyro, m.zgyro) = (x as f32, y as f32, z as f32);
            (m.xacc, m.yacc, m.zacc) = (fx as f32, fy as f32, fz as f32);
        }
        _ => {}
    }
}
