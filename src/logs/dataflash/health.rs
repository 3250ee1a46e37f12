//! How the vehicle was: modes, arming, receiver, vibration, faults, battery and texts of ArduPilot's log.
//!
//! Numbers of subsystems, codes and events: ArduPilot `AP_Logger/AP_Logger.h` (`LogErrorSubsystem`, `LogErrorCode`, `LogEvent`).

use super::Entry;
use crate::logs::{HealthNote, Level, VehicleClass};
use crate::sensors::modes;
use gaware_wire::heartbeat::{ARDUPILOT, Heartbeat};

/// Faults of `XKF4.FS` and `NKF4.FS` that end an estimate: the attitude or the velocity is no number (`nav_filter_status`).
const NO_NUMBER: u32 = 0b11;
/// Time-outs of `XKF4.TS`: position and velocity.
const NO_AIDING: u32 = 0b11;

/// A subsystem of `ERR`: its number, what failed, whether that ends an estimate or a flight.
const SUBSYSTEMS: [(u32, &str, bool); 25] = [
    (2, "radio", false),
    (3, "compass", false),
    (5, "radio failsafe", true),
    (6, "battery failsafe", true),
    (8, "ground station failsafe", true),
    (9, "fence breach", true),
    (10, "flight mode refused", false),
    (11, "GPS", false),
    (12, "crash check: crash detected", true),
    (13, "flip", false),
    (15, "parachute", true),
    (16, "EKF check: estimate bad", true),
    (17, "EKF failsafe", true),
    (18, "barometer", false),
    (19, "CPU load", false),
    (21, "terrain data", false),
    (22, "navigation", false),
    (23, "terrain failsafe", true),
    (24, "EKF lane switch", false),
    (25, "thrust loss", true),
    (26, "sensor failsafe", true),
    (27, "leak failsafe", true),
    (29, "vibration failsafe", true),
    (30, "internal error", true),
    (31, "dead reckoning failsafe", true),
];

/// What the receiver says of itself.
pub(super) fn gnss(entry: &Entry) -> Option<HealthNote> {
    Some(HealthNote::Gnss {
        fix_type: entry.number("Status")? as u8,
        satellites: entry.number("NSats"),
        hdop: entry.number("HDop"),
        jamming: None,
        interference: false,
    })
}

/// A text. The log has no severities.
pub(super) fn text(text: &str) -> HealthNote {
    HealthNote::Text(Level::of_words(text), text.trim().to_owned())
}

/// What the logger says of itself: entries that it could not write since the log began (`AP_Logger/LogStructure.h`: `DSF`), of `kept` that it has.
pub(super) fn logger(entry: &Entry, kept: u64) -> Option<HealthNote> {
    Some(HealthNote::Lost(entry.number("Dp")?, kept as f64))
}

/// The demand of an `ATT`; before 3.2 it is named otherwise.
pub(super) fn demanded(entry: &Entry) -> Option<HealthNote> {
    let of = |label, old| entry.number(label).or(entry.number(old)).map(f64::to_radians);
    Some(HealthNote::Demanded([of("DesRoll", "RollIn")?, of("DesPitch", "PitchIn")?]))
}

/// What another message says; `flies`: whether it is of the lane that flies.
pub(super) fn notes(entry: &Entry, class: Option<VehicleClass>, flies: bool) -> Vec<HealthNote> {
    let of = |label: &str| entry.number(label);
    let bits = |label: &str| of(label).map_or(0, |v| v.max(0.0) as u32);
    match entry.format.name.as_str() {
        "MODE" => mode(entry, class).into_iter().collect(),
        "ARM" => of("ArmState").map(|s| HealthNote::Armed(s != 0.0)).into_iter().collect(),
        "STAT" => {
            let air = of("isFlying").map(|v| HealthNote::InAir(v != 0.0));
            of("Armed").map(|v| HealthNote::Armed(v != 0.0)).into_iter().chain(air).collect()
        }
        "EV" => event(bits("Id")).into_iter().collect(),
        "ERR" => error(bits("Subsys"), bits("ECode")).into_iter().collect(),
        "VIBE" => vibration(entry),
        "BAT" | "CURR" => battery(entry).into_iter().collect(),
        "POWR" => {
            let volts = of("Vcc").map(|v| if v > 100.0 { v * 1e-3 } else { v });
            volts.filter(|v| *v > 1.0).map(HealthNote::Supply).into_iter().collect()
        }
        "UBX1" => {
            let jamming = of("jamInd");
            let note = HealthNote::Gnss {
                fix_type: u8::MAX,
                satellites: None,
                hdop: None,
                jamming,
                interference: false,
            };
            jamming.map(|_| note).into_iter().collect()
        }
        "XKF4" | "NKF4" | "EKF4" if flies => {
            let fault = |what, on, grave| HealthNote::Fault { what, on, grave };
            let lane = of("PI").filter(|pi| *pi >= 0.0).map(|pi| HealthNote::Lane(pi as u8));
            let faults = [
                fault("the EKF's states are no numbers", bits("FS") & NO_NUMBER != 0, true),
                fault(
                    "the EKF gets no position and velocity (time-out)",
                    bits("TS") & NO_AIDING == NO_AIDING,
                    false,
                ),
            ];
            faults.into_iter().chain(lane).collect()
        }
        _ => Vec::new(),
    }
}

fn mode(entry: &Entry, class: Option<VehicleClass>) -> Option<HealthNote> {
    let number = entry.number("ModeNum").or(entry.number("Mode"))?.max(0.0) as u32;
    Some(HealthNote::Mode(mode_name(class, number)))
}

/// The name of a mode, where the log says what flies.
pub(super) fn mode_name(class: Option<VehicleClass>, number: u32) -> String {
    let of = |mav_type| {
        let heartbeat =
            Heartbeat { custom_mode: number, mav_type, autopilot: ARDUPILOT, base_mode: 0, status: 0 };
        modes::of_heartbeat(&heartbeat).1
    };
    match class {
        Some(VehicleClass::Rover) => of(10),
        Some(VehicleClass::Submarine) => of(12),
        Some(VehicleClass::Multirotor | VehicleClass::Helicopter) => of(2),
        Some(VehicleClass::FixedWing | VehicleClass::Vtol) => of(1),
        None => format!("mode {number}"),
    }
}

fn event(id: u32) -> Option<HealthNote> {
    Some(match id {
        10 => HealthNote::Armed(true),
        11 => HealthNote::Armed(false),
        18 => HealthNote::InAir(false),
        28 => HealthNote::InAir(true),
        60 => HealthNote::Text(Level::Warning, "EKF: height reset".to_owned()),
        62 => HealthNote::Text(Level::Warning, "EKF: yaw reset".to_owned()),
        _ => return None,
    })
}

fn error(subsystem: u32, code: u32) -> Option<HealthNote> {
    let (_, what, grave) = SUBSYSTEMS.into_iter().find(|(number, ..)| *number == subsystem)?;
    // Code 0 settles it; the lane switch, refused modes and the crash check report events.
    Some(HealthNote::Fault { what, on: code != 0 || matches!(subsystem, 10 | 24), grave })
}

/// One unit a message since 4.0; before, the vibration of the first with the counts of three.
fn vibration(entry: &Entry) -> Vec<HealthNote> {
    let unit = entry.number("IMU").unwrap_or(0.0) as u8;
    let level = entry.vector(["VibeX", "VibeY", "VibeZ"]).map(|v| HealthNote::Vibration(unit, v.amax()));
    let counts = [("Clip", unit), ("Clip0", 0), ("Clip1", 1), ("Clip2", 2)];
    let clipped =
        counts.into_iter().filter_map(|(name, unit)| Some(HealthNote::Clipped(unit, entry.number(name)?)));
    level.into_iter().chain(clipped).collect()
}

fn battery(entry: &Entry) -> Option<HealthNote> {
    if entry.number("Inst").or(entry.number("Instance")).is_some_and(|i| i != 0.0) {
        return None;
    }
    // Firmware before 3.3 counts in integers of 10 mV.
    let whole = entry.bytes("Volt").is_some_and(|(kind, _)| matches!(kind, b'h' | b'H' | b'I'));
    let volts = entry.number("Volt")? * if whole { 0.01 } else { 1.0 };
    let remaining = entry.number("RemPct").filter(|p| *p <= 100.0).map(|p| 0.01 * p);
    Some(HealthNote::Battery { volts, cells: None, remaining })
}
