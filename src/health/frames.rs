//! The same states and events from MAVLink frames of one vehicle.

use crate::link::frame::Frame;
use crate::logs::{HealthNote, Level};
use crate::sensors::gnss::{Receiver, has_fix};
use crate::sensors::{AUTOPILOT_COMPONENT, modes, operating};
use gaware_nav::operating::Operating;
use gaware_nav::sample::GnssFix;
use gaware_wire::heartbeat::{ARDUPILOT, Heartbeat};
use mavlink::dialects::ardupilotmega::{MavMessage, STATUSTEXT_DATA};
use nalgebra::{Quaternion, UnitQuaternion};

/// `ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE`.
const NO_ATTITUDE: u8 = 128;
/// A time since boot that goes back by so much is that of another start, ms: links deliver late by less.
const BACK_MS: u32 = 5000;
/// What another start is called.
const RESTARTED: &str = "the autopilot restarted";
/// The lowest severity of ArduPilot before 3.4 (`SEVERITY_LOW`), that of an alert since …
const OLD_LOW: u8 = 1;
/// … and texts that are no alert.
const BANNERS: [&str; 5] = ["Ardu", "APM", "Frame: ", "GROUND START", "Reached Command"];
/// Bits of `EKF_STATUS_REPORT.flags`: attitude, horizontal velocity.
const EKF_ATTITUDE: u16 = 1;
const EKF_VELOCITY: u16 = 2;

fn fault(what: &'static str, on: bool, grave: bool) -> HealthNote {
    HealthNote::Fault { what, on, grave }
}

/// Follows the first autopilot.
#[derive(Debug, Clone, Default)]
pub(super) struct Frames {
    system: Option<u8>,
    receiver: Receiver,
    ardupilot: bool,
    /// The newest time since boot, ms.
    boot_ms: u32,
    old_severities: bool,
}

/// What a frame says.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// It is of the autopilot that is followed.
    pub(super) ours: bool,
    /// It holds inertial samples.
    pub(super) inertial: bool,
    pub(super) notes: Vec<HealthNote>,
    /// A fix and its stamp, µs.
    pub(super) fix: Option<(Option<u64>, GnssFix)>,
    /// Roll and pitch, rad.
    pub(super) lean: Option<[f64; 2]>,
    /// Outputs.
    pub(super) outputs: Option<Operating>,
    /// This text shows that severities are those of firmware before MAVLink had any: all texts so far were misread.
    pub(super) old_severities: bool,
}

impl Frames {
    pub(super) fn take(&mut self, frame: &Frame) -> Found {
        let mut found = Found::default();
        if frame.component_id != AUTOPILOT_COMPONENT || self.system.is_some_and(|id| id != frame.system_id) {
            return found;
        }
        found.inertial = matches!(frame.message_id, 26 | 27 | 105);
        found.ours = self.system == Some(frame.system_id);
        // HEARTBEAT, SYS_STATUS, GPS_RAW_INT, ATTITUDE, SERVO_OUTPUT_RAW, NAV_CONTROLLER_OUTPUT, ATTITUDE_TARGET, POWER_STATUS, BATTERY_STATUS,
        // EKF_STATUS_REPORT, ESTIMATOR_STATUS, VIBRATION, EXTENDED_SYS_STATE, STATUSTEXT.
        if !matches!(
            frame.message_id,
            0 | 1 | 24 | 30 | 36 | 62 | 83 | 125 | 147 | 193 | 230 | 241 | 245 | 253
        ) {
            return found;
        }
        if let Some(heartbeat) = Heartbeat::of(frame).filter(Heartbeat::is_of_vehicle) {
            self.system = Some(frame.system_id);
            self.ardupilot = heartbeat.autopilot == ARDUPILOT;
            found.notes.push(HealthNote::Mode(modes::of_heartbeat(&heartbeat).1));
            found.notes.push(HealthNote::Armed(heartbeat.is_armed()));
            found.notes.push(fault("failsafe", heartbeat.is_failsafe(), true));
        } else if self.system.is_some()
            && let Ok(message) = frame.decode()
        {
            self.message(&message, &mut found);
        }
        found
    }

    fn text(&mut self, m: &STATUSTEXT_DATA, found: &mut Found) {
        let text = m.text.to_str().map(str::trim).unwrap_or_default().to_owned();
        if !self.old_severities && m.severity as u8 == OLD_LOW && BANNERS.iter().any(|b| text.starts_with(b))
        {
            self.old_severities = true;
            found.old_severities = true;
        }
        let level =
            if self.old_severities { Level::of_words(&text) } else { Level::of_severity(m.severity as u8) };
        found.notes.push(HealthNote::Text(level, text));
    }

    fn message(&mut self, message: &MavMessage, found: &mut Found) {
        match message {
            MavMessage::SYS_STATUS(m) if m.voltage_battery != u16::MAX && m.voltage_battery > 0 => {
                let remaining = u8::try_from(m.battery_remaining).ok().map(|p| 0.01 * f64::from(p));
                let volts = 1e-3 * f64::from(m.voltage_battery);
                found.notes.push(HealthNote::Battery { volts, cells: None, remaining });
            }
            MavMessage::POWER_STATUS(m) if m.Vcc > 1000 => {
                found.notes.push(HealthNote::Supply(1e-3 * f64::from(m.Vcc)));
            }
            MavMessage::GPS_RAW_INT(m) => {
                let known = |v: u16| (v != u16::MAX).then(|| 1e-2 * f64::from(v));
                // Zero and zero is no place that a receiver finds.
                let placed = m.lat != 0 || m.lon != 0;
                found.notes.push(HealthNote::Gnss {
                    fix_type: if placed { m.fix_type as u8 } else { (m.fix_type as u8).min(1) },
                    satellites: (m.satellites_visible != u8::MAX).then(|| f64::from(m.satellites_visible)),
                    hdop: known(m.eph),
                    jamming: None,
                    interference: false,
                });
                let measured_us = (m.time_usec > 0).then_some(m.time_usec);
                found.fix = has_fix(m).then(|| (measured_us, self.receiver.fix(m, 0.0)));
            }
            MavMessage::EKF_STATUS_REPORT(m) => {
                let lacks = |bit: u16| m.flags.bits() & bit == 0;
                found.notes.push(fault("EKF: attitude estimate not good", lacks(EKF_ATTITUDE), true));
                found.notes.push(fault("EKF: velocity estimate not good", lacks(EKF_VELOCITY), true));
            }
            MavMessage::VIBRATION(m) => {
                let level = m.vibration_x.max(m.vibration_y).max(m.vibration_z);
                found.notes.push(HealthNote::Vibration(0, f64::from(level)));
                for (unit, count) in [(0, m.clipping_0), (1, m.clipping_1), (2, m.clipping_2)] {
                    found.notes.push(HealthNote::Clipped(unit, f64::from(count)));
                }
            }
            MavMessage::EXTENDED_SYS_STATE(m) if m.landed_state as u8 != 0 => {
                found.notes.push(HealthNote::InAir(m.landed_state as u8 != 1));
            }
            MavMessage::ATTITUDE(m) => {
                found.lean = Some([m.roll, m.pitch].map(f64::from));
                let again = m.time_boot_ms.saturating_add(BACK_MS) < self.boot_ms;
                self.boot_ms = m.time_boot_ms;
                found.notes.push(fault(RESTARTED, again, true));
            }
            MavMessage::NAV_CONTROLLER_OUTPUT(m) if self.ardupilot => {
                let lean = [m.nav_roll, m.nav_pitch].map(|v| f64::from(v).to_radians());
                found.notes.push(HealthNote::Demanded(lean));
            }
            MavMessage::ATTITUDE_TARGET(m) if m.type_mask.bits() & NO_ATTITUDE == 0 => {
                let [w, x, y, z] = m.q.map(f64::from);
                let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5);
                let lean = rotation.map(|q| q.euler_angles()).map(|(roll, pitch, _)| [roll, pitch]);
                found.notes.extend(lean.map(HealthNote::Demanded));
            }
            MavMessage::SERVO_OUTPUT_RAW(_) => found.outputs = operating::of_message(message),
            MavMessage::STATUSTEXT(m) => self.text(m, found),
            _ => {}
        }
    }
}
