//! How the vehicle was: modes, arming, receiver, vibration, faults, battery and texts of PX4's log.
//!
//! Numbers and names of flags: PX4 `msg/VehicleStatus.msg`, `EstimatorStatus.msg`, `EstimatorStatusFlags.msg`, `FailsafeFlags.msg`.

use super::{Definitions, Fields};
use crate::logs::{HealthNote, Level};

/// `nav_state`.
const MODES: [(u8, &str); 20] = [
    (0, "Manual"),
    (1, "Altitude"),
    (2, "Position"),
    (3, "Mission"),
    (4, "Hold"),
    (5, "Return"),
    (6, "Position slow"),
    (10, "Acro"),
    (12, "Descend"),
    (13, "Termination"),
    (14, "Offboard"),
    (15, "Stabilized"),
    (16, "Rattitude"),
    (17, "Takeoff"),
    (18, "Land"),
    (19, "Follow Me"),
    (20, "Precision Land"),
    (21, "Orbit"),
    (22, "VTOL Takeoff"),
    (23, "External"),
];
/// `arming_state`.
const ARMED: f64 = 2.0;
/// `failure_detector_status`: roll, pitch, altitude, external, ESC, battery, propeller, motor.
const DETECTED: [(u32, &str); 8] = [
    (1, "failure detector: roll"),
    (2, "failure detector: pitch"),
    (4, "failure detector: altitude"),
    (8, "failure detector: external"),
    (16, "failure detector: ESC"),
    (32, "failure detector: battery"),
    (64, "failure detector: propeller out of balance"),
    (128, "failure detector: motor"),
];
/// Flags of topics: name, words, whether it ends an estimate or a flight.
type Flags = [(&'static str, &'static str, bool)];
const STATUS_FLAGS: &Flags = &[
    ("cs_inertial_dead_reckoning", "EKF: dead reckoning, no position or velocity is fused", true),
    ("fs_bad_acc_vertical", "EKF: vertical accelerometer disagrees with height (vibration)", true),
    ("fs_bad_acc_clipping", "EKF: accelerometer clips", true),
    ("fs_bad_hdg", "EKF: heading fusion failed numerically", true),
    ("cs_mag_field_disturbed", "EKF: magnetic field disturbed", false),
    ("cs_mag_fault", "EKF: magnetometer declared faulty", false),
    ("cs_gnss_yaw_fault", "EKF: GNSS yaw declared faulty", false),
];
const FAILSAFE_FLAGS: &Flags = &[
    ("attitude_invalid", "attitude estimate invalid", true),
    ("angular_velocity_invalid", "rate estimate invalid", true),
    ("local_velocity_invalid", "velocity estimate invalid", true),
    ("local_altitude_invalid", "height estimate invalid", true),
    ("global_position_invalid", "global position invalid", false),
    ("manual_control_signal_lost", "RC signal lost", false),
    ("gcs_connection_lost", "ground station lost", false),
    ("battery_unhealthy", "battery unhealthy", true),
    ("geofence_breached", "geofence breached", true),
    ("fd_critical_failure", "failure detector: critical failure", true),
    ("fd_motor_failure", "failure detector: motor", true),
];

fn flags(fields: &Fields, rows: &Flags) -> Vec<HealthNote> {
    let fault = |(name, what, grave): &(&str, &'static str, bool)| {
        let on = fields.number(name)? != 0.0;
        Some(HealthNote::Fault { what, on, grave: *grave })
    };
    rows.iter().filter_map(fault).collect()
}

/// A text with its time, µs.
pub(super) fn text(body: &[u8]) -> Option<(u64, HealthNote)> {
    let (&level, rest) = body.split_first()?;
    let (stamp, text) = rest.split_first_chunk()?;
    let level = Level::of_severity(level.saturating_sub(b'0'));
    let text = String::from_utf8_lossy(text).trim().to_owned();
    Some((u64::from_le_bytes(*stamp), HealthNote::Text(level, text)))
}

/// Vibration and samples at the end of the range of a unit.
pub(super) fn unit(fields: &Fields, unit: u8) -> Vec<HealthNote> {
    let vibration = fields.number("accel_vibration_metric").map(|v| HealthNote::Vibration(unit, v));
    let clipped = fields.vector("accel_clipping").map(|v| HealthNote::Clipped(unit, v.sum()));
    vibration.into_iter().chain(clipped).collect()
}

/// What the receiver says of itself.
pub(super) fn gnss(fields: &Fields) -> Option<HealthNote> {
    let critical = |name: &str| fields.number(name).is_some_and(|state| state >= 3.0);
    Some(HealthNote::Gnss {
        fix_type: fields.number("fix_type")? as u8,
        satellites: fields.number("satellites_used"),
        hdop: fields.number("hdop"),
        jamming: fields.number("jamming_indicator"),
        interference: critical("jamming_state") || critical("spoofing_state"),
    })
}

/// What another topic says.
pub(super) fn notes(topic: &str, fields: &Fields, definitions: &Definitions) -> Vec<HealthNote> {
    let fault = |what, on, grave| HealthNote::Fault { what, on, grave };
    match topic {
        "vehicle_status" => status(fields),
        "vehicle_land_detected" => {
            fields.number("landed").map(|v| HealthNote::InAir(v == 0.0)).into_iter().collect()
        }
        "estimator_status" => {
            let resets = [
                ("horizontal velocity", "reset_count_vel_ne"),
                ("vertical velocity", "reset_count_vel_d"),
                ("horizontal position", "reset_count_pos_ne"),
                ("height", "reset_count_pod_d"),
                ("attitude", "reset_count_quat"),
            ];
            let counted =
                |(what, name): (&'static str, &str)| Some(HealthNote::Resets(what, fields.number(name)?));
            let numeric = fields.number("filter_fault_flags").map(|v| v != 0.0);
            let numeric = numeric.filter(|_| !definitions.has_topic("estimator_status_flags"));
            let numeric = numeric.map(|on| fault("EKF: numerical fault", on, true));
            resets.into_iter().filter_map(counted).chain(numeric).collect()
        }
        "estimator_status_flags" => flags(fields, STATUS_FLAGS),
        "failsafe_flags" => flags(fields, FAILSAFE_FLAGS),
        "battery_status" => {
            // A monitor that finds no battery says so by its voltage.
            let volts = fields.number("voltage_filtered_v").or(fields.number("voltage_v"));
            let note = volts.map(|volts| HealthNote::Battery {
                volts,
                cells: fields.number("cell_count").filter(|n| *n > 0.0),
                remaining: fields.number("remaining").filter(|r| (0.0..=1.0).contains(r)),
            });
            note.into_iter().collect()
        }
        "system_power" => {
            let volts = fields.number("voltage5v_v").filter(|v| *v > 1.0);
            let brownout = fields.number("brick_valid").map(|_| fields.flag("brownout"));
            let low = brownout.map(|on| fault("supply: brownout", on, true));
            volts.map(HealthNote::Supply).into_iter().chain(low).collect()
        }
        "vehicle_attitude_setpoint" => demanded(fields).map(HealthNote::Demanded).into_iter().collect(),
        "actuator_outputs" => motors(fields).into_iter().collect(),
        _ => Vec::new(),
    }
}

fn status(fields: &Fields) -> Vec<HealthNote> {
    let mode = fields.number("nav_state").map(|number| {
        let name = MODES.iter().find(|(n, _)| f64::from(*n) == number);
        HealthNote::Mode(name.map_or_else(|| format!("mode {number}"), |(_, name)| (*name).to_owned()))
    });
    let armed = fields.number("arming_state").map(|s| HealthNote::Armed(s == ARMED));
    let failsafe =
        fields.number("failsafe").map(|v| HealthNote::Fault { what: "failsafe", on: v != 0.0, grave: true });
    let detected = fields.number("failure_detector_status").map_or(0, |v| v as u32);
    let detected =
        DETECTED.iter().map(|(bit, what)| HealthNote::Fault { what, on: detected & bit != 0, grave: true });
    armed.into_iter().chain(mode).chain(failsafe).chain(detected).collect()
}

/// Roll and pitch that are demanded, rad: as a rotation, before 1.10 also as angles.
fn demanded(fields: &Fields) -> Option<[f64; 2]> {
    let rotation = super::fields::rotation(fields, "q_d").map(|[roll, pitch, _]| [roll, pitch]);
    rotation.or_else(|| Some([fields.number("roll_body")?, fields.number("pitch_body")?]))
}

/// Whether any output is above zero.
fn motors(fields: &Fields) -> Option<HealthNote> {
    let used = fields.number("noutputs").map_or(8, |n| n.clamp(0.0, 16.0) as usize);
    let largest = (0..used.min(8)).filter_map(|k| fields.element("output", k)).reduce(f64::max)?;
    // PWM, or what an ESC on a bus counts in: nothing but zero is the same in all of them.
    Some(HealthNote::Motors(if largest > 0.0 { 1.0 } else { 0.0 }))
}
