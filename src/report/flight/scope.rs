//! What a log can and cannot answer, in one sentence before any number, and what the next flight should record.

use super::motion::Fitted;
use crate::engine::snapshot::{Phase, Status, Summary};
use crate::health::logger::{LOG_LESS, LOSSY};
use crate::logs::VehicleClass;
use crate::pipeline::Beside;
use gaware_mission::item::Autopilot;

/// From this rate on every question may be answered; between the two motion is smoothed away in turns of a copter, and below attitude is not to
/// be used: at 9 Hz of PX4's samples the tilt came out 22.6° off (esc_status.ulg), at 25 Hz as the autopilot's within 2° (quiver_088.bin).
const GOOD_HZ: f64 = 50.0;
/// See [`GOOD_HZ`].
pub const LEAST_HZ: f64 = 20.0;
/// `LOG_BITMASK`: fast inertial samples of ArduCopter, raw samples of all vehicles (`Copter/Parameters.cpp`, `ArduPlane/Parameters.cpp`).
const IMU_FAST: u32 = 1 << 18;
const IMU_RAW: u32 = 1 << 19;
/// `SDLOG_PROFILE`: default set, estimator replay (`logger/params.yaml`): all inertial samples.
const DEFAULT_AND_REPLAY: u32 = 0b11;

/// The sentence, and what to set for the next flight; both end with a full stop.
///
/// `settled`: whether the attitude became known.
pub fn words(s: &Summary, beside: &Beside, fitted: &[Fitted], settled: bool) -> (String, String) {
    let (mut can, mut cannot): (Vec<&str>, Vec<String>) = (Vec::new(), Vec::new());
    let rate = s.imu.rate_hz;
    if !beside.health.is_empty() {
        can.push("how healthy the vehicle and the autopilot's estimator were");
    }
    if fitted.len() > 1 {
        can.push("whose attitude fits the motion");
    }
    let usable = s.phase == Phase::Running && rate >= LEAST_HZ;
    if usable {
        can.push(if settled { "attitude and accelerometer bias" } else { "roll and pitch" });
    }
    let g: Vec<Status> =
        s.observability.states.iter().filter(|x| super::lessons::is_g(&x.name)).map(|x| x.status).collect();
    let observable = g.iter().filter(|status| **status == Status::Observable).count();
    if usable && observable > 0 {
        can.push("g-sensitivity, in part or in full");
    } else {
        cannot.push(if g.is_empty() || !usable {
            "g-sensitivity".to_owned()
        } else {
            "g-sensitivity (no element of it became observable)".to_owned()
        });
    }
    if s.imu.samples == 0 {
        cannot.push("anything about attitude (no inertial samples)".to_owned());
    } else if rate < LEAST_HZ {
        cannot.push(format!("attitude: inertial samples at {rate:.0} Hz miss the motion between them"));
    }
    if has_no_fix(s, beside) {
        cannot.push("whose attitude is right (no GNSS)".to_owned());
    }
    let list = |parts: &[String]| parts.join(", ");
    let can: Vec<String> = can.into_iter().map(str::to_owned).collect();
    let answer = match (can.is_empty(), cannot.is_empty()) {
        (true, _) => format!("This log cannot answer {}.", list(&cannot)),
        (false, true) => format!("This log can answer {}.", list(&can)),
        (false, false) => format!("This log can answer {}. It cannot answer {}.", list(&can), list(&cannot)),
    };
    (answer, next(s, beside))
}

/// What stands before every answer of a log that lost more than values can bear; ends with a full stop.
pub fn warning(beside: &Beside) -> Option<String> {
    let lost = beside.health.losses().filter(|lost| lost.share > LOSSY)?;
    Some(format!(
        "Rests on a part of the flight: {}. Values on this page may be off by several of their sigmas.",
        lost.words()
    ))
}

/// Without inertial samples fixes are not used, whether there are any or not.
fn has_no_fix(s: &Summary, beside: &Beside) -> bool {
    s.gnss.fixes == 0 && !beside.health.has_fix()
}

/// Parameters for the next flight.
fn next(s: &Summary, beside: &Beside) -> String {
    let on_board = &beside.on_board;
    let now = |name: &str| on_board.get(name).filter(|v| *v >= 0.0).map(|v| v as u32);
    let mut parts = Vec::new();
    let lossy = warning(beside).is_some();
    if lossy {
        parts.push(LOG_LESS.to_owned());
    }
    if s.imu.rate_hz < 0.95 * GOOD_HZ && !lossy {
        let is_log = on_board.system_id.is_none();
        parts.push(match on_board.autopilot {
            Some(Autopilot::ArduPilot) if is_log => {
                let copter = on_board.class.is_some_and(VehicleClass::is_carried_by_rotors);
                let bit = if copter { IMU_FAST } else { IMU_RAW };
                let what = if copter { "fast IMU" } else { "raw IMU" };
                match now("LOG_BITMASK") {
                    Some(mask) if mask & bit == 0 => {
                        format!("LOG_BITMASK {} ({mask} with {what})", mask | bit)
                    }
                    Some(mask) => format!("LOG_BITMASK {mask} has {what} already: a faster card or LOG_FILE_BUFSIZE"),
                    None => format!("LOG_BITMASK with {what} ({bit})"),
                }
            }
            Some(Autopilot::Px4) if is_log => {
                let mask = now("SDLOG_PROFILE").unwrap_or(0);
                format!("SDLOG_PROFILE {} (default set and estimator replay: all inertial samples)", mask | DEFAULT_AND_REPLAY)
            }
            Some(Autopilot::Px4) => "record with gaware run, which asks for HIGHRES_IMU at 50 Hz or more".to_owned(),
            _ => "record with gaware run, or SR0_RAW_SENS 50 (the log's link), or send the autopilot's own .bin".to_owned(),
        });
    }
    if has_no_fix(s, beside) {
        parts.push("fly with a 3-D GNSS fix".to_owned());
    }
    if parts.is_empty() { String::new() } else { format!("For the next flight: {}.", parts.join("; ")) }
}
