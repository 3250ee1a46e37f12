//! The rules, a row per command and firmware.
//!
//! ArduPilot: `libraries/AP_Mission/AP_Mission.cpp` of 4.7-dev (line numbers of October 2025): `sanity_check_params` (1012) refuses NaN and
//! infinity, `mavlink_int_to_mission_cmd` (1060) stores, `mission_cmd_to_mavlink_int` (1600) reads back. Earlier versions (up to
//! 4.6) refuse NaN in parameter 4 of `NAV_LOITER_UNLIM` too, so the table does. PX4:
//! `src/modules/mavlink/mavlink_mission.cpp` of 1.16, `parse_mavlink_mission_item` stores, `format_mavlink_mission_item` reads back.

use super::Firmware;
use crate::item::{Frame, command::*};

/// What becomes of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// Not kept; read back as 0.
    Dropped,
    /// As sent.
    Exact,
    /// Cut to a whole number from 0 to this.
    Whole(u16),
    /// Cut to a whole number from −128 to 127, or to one from −32768 to 32767.
    Signed(u16),
    /// Cut to whole units with its sign.
    Radius,
    /// Cut to whole metres up to 255, to tens of metres up to 2550 beyond, with its sign.
    ByteRadius,
    /// Cut to a whole number up to 255; below 1 to 256ths.
    Turns,
    /// Its sign alone: −1 or 1.
    Sign,
    /// 1 if positive, else 0.
    Flag,
    /// A direction in degrees, from 0 to 360; NaN stays.
    Heading,
}

impl Kept {
    /// The value as it is read back.
    pub fn keep(self, value: f32) -> f32 {
        let cut = |v: f32, most: f32| v.trunc().clamp(0.0, most);
        match self {
            Self::Dropped => 0.0,
            Self::Exact => value,
            // NaN is cut to 0.
            Self::Whole(most) => f32::from(value.clamp(0.0, f32::from(most)) as u16),
            Self::Signed(127) => f32::from(value as i8),
            Self::Signed(_) => f32::from(value as i16),
            Self::Radius => cut(value.abs(), 65_535.0).copysign(value),
            Self::ByteRadius if value.abs() <= 255.0 => value.trunc(),
            Self::ByteRadius => cut(value.abs() * 0.1, 255.0).copysign(value) * 10.0,
            Self::Turns if value > 0.0 && value < 1.0 => (value * 256.0).trunc() / 256.0,
            Self::Turns => cut(value, 255.0),
            Self::Sign if value < 0.0 => -1.0,
            Self::Sign => 1.0,
            Self::Flag => f32::from(u8::from(value > 0.0)),
            Self::Heading => value.rem_euclid(360.0),
        }
    }

    /// For the table of the documentation.
    pub fn describe(self) -> String {
        match self {
            Self::Dropped => "→ 0".to_owned(),
            Self::Exact => "exact".to_owned(),
            Self::Whole(most) => format!("whole, 0…{most}"),
            Self::Signed(most) => format!("whole, ±{most}"),
            Self::Radius => "whole m, signed".to_owned(),
            Self::ByteRadius => "whole m; over 255 tens of m".to_owned(),
            Self::Turns => "whole, 0…255; below 1 in 1/256".to_owned(),
            Self::Sign => "→ −1 or 1".to_owned(),
            Self::Flag => "→ 0 or 1".to_owned(),
            Self::Heading => "0…360°, NaN stays".to_owned(),
        }
    }
}

/// Which frames a command may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frames {
    /// ArduPilot, a command with a place: every global frame, and `MISSION` as above sea level. Read back without `_INT`.
    ArduPilotPlace,
    /// ArduPilot, a command without one: any; read back as 0.
    ArduPilotAny,
    /// PX4, a command with a place: above sea level or home. Read back with `_INT`.
    Px4Place,
    /// PX4, a command without one: `MISSION` alone.
    Px4Mission,
}

impl Frames {
    /// Whether x, y and z are a place.
    pub fn has_place(self) -> bool {
        matches!(self, Self::ArduPilotPlace | Self::Px4Place)
    }

    /// Whether this frame is taken.
    pub fn take(self, frame: Frame) -> bool {
        match self {
            Self::ArduPilotPlace => matches!(frame.0, 0 | 2 | 3 | 5 | 6 | 10 | 11),
            Self::ArduPilotAny => true,
            Self::Px4Place => matches!(frame.0, 0 | 3 | 5 | 6),
            Self::Px4Mission => frame == Frame::MISSION,
        }
    }

    /// The frame to write.
    pub fn usual(self) -> Frame {
        if self.has_place() { Frame::GLOBAL_RELATIVE_ALT } else { Frame::MISSION }
    }

    /// The frame as it is read back.
    pub fn read_back(self, frame: Frame) -> Frame {
        match self {
            Self::ArduPilotPlace if frame == Frame::MISSION => Frame::GLOBAL,
            Self::ArduPilotPlace => frame.in_files(),
            Self::ArduPilotAny => Frame::GLOBAL,
            Self::Px4Place => frame.on_wire(),
            Self::Px4Mission => frame,
        }
    }
}

/// The rule for a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// `MAV_CMD`.
    pub command: u16,
    /// For whom.
    pub firmware: &'static [Firmware],
    /// Whether it is taken at all.
    pub taken: bool,
    /// What becomes of parameters 1 to 4.
    pub kept: [Kept; 4],
    /// Which of them may be NaN.
    pub nan: [bool; 4],
    /// Frames.
    pub frames: Frames,
    /// Where the firmware says so.
    pub source: &'static str,
    /// What else a planner must know.
    pub note: &'static str,
}

/// The row for this command and firmware, if there is one.
pub fn row(number: u16, firmware: Firmware) -> Option<&'static Row> {
    ROWS.iter().find(|r| r.command == number && r.firmware.contains(&firmware))
}

const PLANE: &[Firmware] = &[Firmware::ArduPlane];
const COPTER: &[Firmware] = &[Firmware::ArduCopter];
const ARDUPILOT: &[Firmware] = &[Firmware::ArduPlane, Firmware::ArduCopter];
const PX4: &[Firmware] = &[Firmware::Px4];

const NONE: [bool; 4] = [false; 4];
const FOURTH: [bool; 4] = [false, false, false, true];
use Frames::{ArduPilotAny, ArduPilotPlace, Px4Mission, Px4Place};
use Kept::{ByteRadius, Dropped, Exact, Flag, Heading, Radius, Sign, Signed, Turns, Whole};

const fn taken(
    command: u16,
    firmware: &'static [Firmware],
    kept: [Kept; 4],
    nan: [bool; 4],
    frames: Frames,
    source: &'static str,
) -> Row {
    Row { command, firmware, taken: true, kept, nan, frames, source, note: "" }
}

const fn refused(command: u16, firmware: &'static [Firmware], frames: Frames, source: &'static str) -> Row {
    Row { command, firmware, taken: false, kept: [Dropped; 4], nan: NONE, frames, source, note: "" }
}

const fn noted(row: Row, note: &'static str) -> Row {
    Row { note, ..row }
}

const D: Kept = Dropped;
const SECONDS: Kept = Whole(u16::MAX);

/// All rules.
pub const ROWS: &[Row] = &[
    taken(NAV_WAYPOINT, PLANE, [D, Whole(255), Whole(255), D], FOURTH, ArduPilotPlace, "AP_Mission.cpp:1081"),
    taken(NAV_WAYPOINT, COPTER, [SECONDS, D, D, D], FOURTH, ArduPilotPlace, "AP_Mission.cpp:1099"),
    taken(
        NAV_WAYPOINT,
        PX4,
        [Exact, Exact, D, Heading],
        FOURTH,
        Px4Place,
        "mavlink_mission.cpp, NAV_CMD_WAYPOINT",
    ),
    noted(
        taken(NAV_LOITER_UNLIM, ARDUPILOT, [D, D, Radius, D], NONE, ArduPilotPlace, "AP_Mission.cpp:1104"),
        "4.7 takes NaN in parameter 4, earlier versions do not",
    ),
    taken(
        NAV_LOITER_UNLIM,
        PX4,
        [D, D, Exact, Heading],
        FOURTH,
        Px4Place,
        "mavlink_mission.cpp, NAV_CMD_LOITER_UNLIMITED",
    ),
    taken(
        NAV_LOITER_TURNS,
        ARDUPILOT,
        [Turns, D, ByteRadius, Flag],
        NONE,
        ArduPilotPlace,
        "AP_Mission.cpp:1109",
    ),
    refused(NAV_LOITER_TURNS, PX4, Px4Place, "mavlink_mission.cpp, parse_mavlink_mission_item: default"),
    noted(
        taken(
            NAV_LOITER_TIME,
            ARDUPILOT,
            [SECONDS, D, Sign, Flag],
            NONE,
            ArduPilotPlace,
            "AP_Mission.cpp:1136",
        ),
        "flown with the vehicle's own radius",
    ),
    taken(
        NAV_LOITER_TIME,
        PX4,
        [Exact, Flag, Exact, Flag],
        FOURTH,
        Px4Place,
        "mavlink_mission.cpp, NAV_CMD_LOITER_TIME_LIMIT",
    ),
    taken(NAV_RETURN_TO_LAUNCH, ARDUPILOT, [D; 4], NONE, ArduPilotAny, "AP_Mission.cpp:1142"),
    taken(
        NAV_RETURN_TO_LAUNCH,
        PX4,
        [Exact; 4],
        [true; 4],
        Px4Mission,
        "mavlink_mission.cpp, MAV_FRAME_MISSION",
    ),
    taken(NAV_LAND, ARDUPILOT, [SECONDS, D, D, Sign], FOURTH, ArduPilotPlace, "AP_Mission.cpp:1145"),
    taken(
        NAV_LAND,
        PX4,
        [D, Whole(u16::MAX), D, Heading],
        FOURTH,
        Px4Place,
        "mavlink_mission.cpp, NAV_CMD_LAND",
    ),
    taken(NAV_TAKEOFF, ARDUPILOT, [SECONDS, D, D, D], FOURTH, ArduPilotPlace, "AP_Mission.cpp:1152"),
    taken(NAV_TAKEOFF, PX4, [D, D, D, Heading], FOURTH, Px4Place, "mavlink_mission.cpp, NAV_CMD_TAKEOFF"),
    taken(
        NAV_CONTINUE_AND_CHANGE_ALT,
        PLANE,
        [SECONDS, D, D, D],
        NONE,
        ArduPilotPlace,
        "AP_Mission.cpp:1156",
    ),
    noted(
        taken(
            NAV_CONTINUE_AND_CHANGE_ALT,
            COPTER,
            [SECONDS, D, D, D],
            NONE,
            ArduPilotPlace,
            "AP_Mission.cpp:1156",
        ),
        "kept but skipped in flight (ModeAuto::start_command)",
    ),
    refused(
        NAV_CONTINUE_AND_CHANGE_ALT,
        PX4,
        Px4Place,
        "mavlink_mission.cpp, parse_mavlink_mission_item: default",
    ),
    taken(NAV_LOITER_TO_ALT, ARDUPILOT, [D, Radius, D, Flag], NONE, ArduPilotPlace, "AP_Mission.cpp:1163"),
    taken(
        NAV_LOITER_TO_ALT,
        PX4,
        [Flag, Exact, D, Flag],
        FOURTH,
        Px4Place,
        "mavlink_mission.cpp, NAV_CMD_LOITER_TO_ALT",
    ),
    refused(NAV_SPLINE_WAYPOINT, PLANE, ArduPilotPlace, "AP_Mission.cpp:1169"),
    taken(NAV_SPLINE_WAYPOINT, COPTER, [SECONDS, D, D, D], NONE, ArduPilotPlace, "AP_Mission.cpp:1173"),
    refused(NAV_SPLINE_WAYPOINT, PX4, Px4Place, "mavlink_mission.cpp, parse_mavlink_mission_item: default"),
    noted(
        taken(
            CONDITION_YAW,
            PLANE,
            [Exact, Exact, Signed(127), Whole(255)],
            NONE,
            ArduPilotAny,
            "AP_Mission.cpp:1196",
        ),
        "kept but skipped in flight (Plane::start_command)",
    ),
    taken(
        CONDITION_YAW,
        COPTER,
        [Exact, Exact, Signed(127), Whole(255)],
        NONE,
        ArduPilotAny,
        "AP_Mission.cpp:1196",
    ),
    refused(CONDITION_YAW, PX4, Px4Mission, "mavlink_mission.cpp, parse_mavlink_mission_item: default"),
    taken(CONDITION_DELAY, ARDUPILOT, [Exact, D, D, D], NONE, ArduPilotAny, "AP_Mission.cpp:1188"),
    taken(CONDITION_DISTANCE, ARDUPILOT, [Exact, D, D, D], NONE, ArduPilotAny, "AP_Mission.cpp:1192"),
    taken(
        DO_JUMP,
        ARDUPILOT,
        [SECONDS, Signed(u16::MAX / 2), D, D],
        NONE,
        ArduPilotAny,
        "AP_Mission.cpp:1203",
    ),
    noted(
        taken(
            DO_CHANGE_SPEED,
            PLANE,
            [Whole(255), Exact, Exact, D],
            NONE,
            ArduPilotAny,
            "AP_Mission.cpp:1213",
        ),
        "an airspeed outside AIRSPEED_MIN to AIRSPEED_MAX changes nothing (Plane::do_change_speed)",
    ),
    taken(DO_CHANGE_SPEED, COPTER, [Whole(255), Exact, Exact, D], NONE, ArduPilotAny, "AP_Mission.cpp:1213"),
    taken(DO_CHANGE_SPEED, PX4, [Exact; 4], [true; 4], Px4Mission, "mavlink_mission.cpp, MAV_FRAME_MISSION"),
];
