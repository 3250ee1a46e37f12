//! What the flight modes of both firmwares mean: who flies, and what the autopilot is about to do.
//!
//! Numbers and names: ArduPilot `mode.h` of `ArduPlane`, `ArduCopter`, `ArduSub` and `Rover`; PX4 `src/modules/commander/px4_custom_mode.h`.

use crate::engine::situation::FlightMode::{self, Hold, Landing, Mission, Pilot, Return, TakeOff, Unknown};
use crate::logs::VehicleClass;
use gaware_mission::identity::Carrier;
use gaware_wire::heartbeat::{ARDUPILOT, Heartbeat, PX4};

/// `MAV_MODE_FLAG_AUTO_ENABLED`.
const AUTO: u8 = 4;

type Row = (u32, &'static str, FlightMode);

const PLANE: [Row; 27] = [
    (0, "MANUAL", Pilot),
    (1, "CIRCLE", Hold),
    (2, "STABILIZE", Pilot),
    (3, "TRAINING", Pilot),
    (4, "ACRO", Pilot),
    (5, "FBWA", Pilot),
    (6, "FBWB", Pilot),
    (7, "CRUISE", Pilot),
    (8, "AUTOTUNE", Pilot),
    (10, "AUTO", Mission),
    (11, "RTL", Return),
    (12, "LOITER", Hold),
    (13, "TAKEOFF", TakeOff),
    (14, "AVOID_ADSB", Hold),
    (15, "GUIDED", Hold),
    (16, "INITIALISING", Unknown),
    (17, "QSTABILIZE", Pilot),
    (18, "QHOVER", Pilot),
    (19, "QLOITER", Pilot),
    (20, "QLAND", Landing),
    (21, "QRTL", Return),
    (22, "QAUTOTUNE", Pilot),
    (23, "QACRO", Pilot),
    (24, "THERMAL", Hold),
    (25, "LOITER_ALT_QLAND", Landing),
    (26, "AUTOLAND", Landing),
    (30, "external control", Hold),
];

const COPTER: [Row; 26] = [
    (0, "STABILIZE", Pilot),
    (1, "ACRO", Pilot),
    (2, "ALT_HOLD", Pilot),
    (3, "AUTO", Mission),
    (4, "GUIDED", Hold),
    (5, "LOITER", Pilot),
    (6, "RTL", Return),
    (7, "CIRCLE", Hold),
    (9, "LAND", Landing),
    (11, "DRIFT", Pilot),
    (13, "SPORT", Pilot),
    (14, "FLIP", Hold),
    (15, "AUTOTUNE", Hold),
    (16, "POSHOLD", Pilot),
    (17, "BRAKE", Hold),
    (18, "THROW", TakeOff),
    (19, "AVOID_ADSB", Hold),
    (20, "GUIDED_NOGPS", Hold),
    (21, "SMART_RTL", Return),
    (22, "FLOWHOLD", Pilot),
    (23, "FOLLOW", Hold),
    (24, "ZIGZAG", Hold),
    (25, "SYSTEMID", Hold),
    (26, "AUTOROTATE", Landing),
    (27, "AUTO_RTL", Return),
    (28, "TURTLE", Hold),
];

const SUB: [Row; 11] = [
    (0, "STABILIZE", Pilot),
    (1, "ACRO", Pilot),
    (2, "ALT_HOLD", Pilot),
    (3, "AUTO", Mission),
    (4, "GUIDED", Hold),
    (7, "CIRCLE", Hold),
    (9, "SURFACE", Landing),
    (16, "POSHOLD", Pilot),
    (19, "MANUAL", Pilot),
    (20, "MOTOR_DETECT", Hold),
    (21, "SURFTRAK", Pilot),
];

const ROVER: [Row; 14] = [
    (0, "MANUAL", Pilot),
    (1, "ACRO", Pilot),
    (3, "STEERING", Pilot),
    (4, "HOLD", Hold),
    (5, "LOITER", Hold),
    (6, "FOLLOW", Hold),
    (7, "SIMPLE", Pilot),
    (8, "DOCK", Hold),
    (9, "CIRCLE", Hold),
    (10, "AUTO", Mission),
    (11, "RTL", Return),
    (12, "SMART_RTL", Return),
    (15, "GUIDED", Hold),
    (16, "INITIALISING", Unknown),
];

/// Main mode and sub mode; a sub mode of 255 stands for all others.
const PX4_MODES: [(u8, u8, &str, FlightMode); 19] = [
    (1, 255, "Manual", Pilot),
    (2, 255, "Altitude", Pilot),
    (3, 1, "Orbit", Hold),
    (3, 255, "Position", Pilot),
    (4, 2, "Takeoff", TakeOff),
    (4, 3, "Hold", Hold),
    (4, 4, "Mission", Mission),
    (4, 5, "Return", Return),
    (4, 6, "Land", Landing),
    (4, 8, "Follow Me", Hold),
    (4, 9, "Precision Land", Landing),
    (4, 10, "Takeoff", TakeOff),
    (4, 255, "Auto", Hold),
    (5, 255, "Acro", Pilot),
    (6, 255, "Offboard", Hold),
    (7, 255, "Stabilized", Pilot),
    (8, 255, "Rattitude", Pilot),
    (9, 255, "Simple", Pilot),
    (10, 255, "Termination", Landing),
];

/// Whether an ArduPlane in this mode is carried by its rotors.
pub fn is_of_rotors(custom_mode: u32) -> bool {
    PLANE.iter().any(|(number, name, _)| *number == custom_mode && name.starts_with('Q'))
}

/// The mode of a heartbeat: what it means and its name. Other firmware says no more than a flag.
pub fn of_heartbeat(heartbeat: &Heartbeat) -> (FlightMode, String) {
    let Heartbeat { custom_mode, mav_type: kind, .. } = *heartbeat;
    let unknown = || (Unknown, format!("mode {custom_mode}"));
    match heartbeat.autopilot {
        ARDUPILOT => {
            // Vehicles that rotors carry run ArduCopter.
            let table: &[Row] = match VehicleClass::of_mav_type(kind) {
                Some(VehicleClass::Submarine) => &SUB,
                Some(VehicleClass::Rover) => &ROVER,
                _ if Carrier::of(kind) == Some(Carrier::Rotors) => &COPTER,
                _ => &PLANE,
            };
            let row = table.iter().find(|(number, ..)| *number == custom_mode);
            row.map_or_else(unknown, |(_, name, mode)| (*mode, (*name).to_owned()))
        }
        PX4 => {
            let [_, _, main, sub] = custom_mode.to_le_bytes();
            let row = PX4_MODES.iter().find(|(m, s, ..)| *m == main && (*s == sub || *s == 255));
            row.map_or_else(unknown, |(.., name, mode)| (*mode, (*name).to_owned()))
        }
        _ if heartbeat.base_mode & AUTO != 0 => (Mission, "auto".to_owned()),
        _ => (Pilot, "manual".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_of_both_firmwares_mean_what_their_sources_say() {
        let px4 = |main: u32, sub: u32| main << 16 | sub << 24;
        let of = |autopilot, mav_type, base_mode, custom_mode| {
            of_heartbeat(&Heartbeat { custom_mode, mav_type, autopilot, base_mode, status: 0 })
        };
        for (firmware, kind, custom, mode, name) in [
            (3, 1, 10, Mission, "AUTO"),
            (3, 1, 5, Pilot, "FBWA"),
            (3, 1, 11, Return, "RTL"),
            (3, 1, 12, Hold, "LOITER"),
            (3, 2, 5, Pilot, "LOITER"),
            (3, 2, 3, Mission, "AUTO"),
            (3, 13, 9, Landing, "LAND"),
            (3, 1, 99, Unknown, "mode 99"),
            (3, 12, 19, Pilot, "MANUAL"),
            (3, 10, 0, Pilot, "MANUAL"),
            (3, 11, 12, Return, "SMART_RTL"),
            (12, 2, px4(4, 4), Mission, "Mission"),
            (12, 2, px4(4, 5), Return, "Return"),
            (12, 2, px4(4, 77), Hold, "Auto"),
            (12, 2, px4(3, 0), Pilot, "Position"),
            (12, 2, px4(3, 1), Hold, "Orbit"),
        ] {
            assert_eq!(of(firmware, kind, 0, custom), (mode, name.to_owned()), "{firmware} {custom}");
        }
        assert_eq!(of(0, 1, AUTO, 7).0, Mission);
        assert_eq!(of(0, 1, 0, 7).0, Pilot);
    }
}
