//! The rules themselves; [`super::table`] says what they mean and where they are from.

use super::Firmware;
use super::table::{Altitude, AutoContinue, Frames, Kept, Row};
use crate::item::{MissionKind, command::*};
use Frames::{
    ArduPilotAny, ArduPilotFence, ArduPilotPlace, ArduPilotRally, Px4Either, Px4Fence, Px4Mission, Px4Place,
};
use Kept::{ByteRadius, Dropped, Exact, Flag, Heading, Radius, Sign, Signed, Turns, Whole};

const PLANE: &[Firmware] = &[Firmware::ArduPlane];
const COPTER: &[Firmware] = &[Firmware::ArduCopter];
const ARDUPILOT: &[Firmware] = &[Firmware::ArduPlane, Firmware::ArduCopter];
const PX4: &[Firmware] = &[Firmware::Px4];

const NONE: [bool; 4] = [false; 4];
const FOURTH: [bool; 4] = [false, false, false, true];
const ALL: [bool; 4] = [true; 4];
const PX4_ACTION: &str = "mavlink_mission.cpp, MAV_FRAME_MISSION";
const PX4_FENCE: &str = "mavlink_mission.cpp:325 (send_mission_item), handle_mission_item_both";
const ARDUPILOT_FENCE: &str = "MissionItemProtocol_Fence.cpp:61 (read back), :95 (stored)";

const fn taken(
    command: u16,
    firmware: &'static [Firmware],
    kept: [Kept; 4],
    nan: [bool; 4],
    frames: Frames,
    source: &'static str,
) -> Row {
    // ArduPilot has no such field and always answers 1.
    let (altitude, autocontinue) = match frames {
        ArduPilotPlace | ArduPilotAny => (Altitude::Centimetres, AutoContinue::Always(true)),
        ArduPilotFence => (Altitude::Dropped, AutoContinue::Always(false)),
        ArduPilotRally => (Altitude::Metres, AutoContinue::Always(false)),
        Px4Place | Px4Mission | Px4Either => (Altitude::Exact, AutoContinue::Exact),
        Px4Fence => (Altitude::Exact, AutoContinue::Always(false)),
    };
    let list = match command {
        NAV_FENCE_RETURN_POINT..=NAV_FENCE_CIRCLE_EXCLUSION => MissionKind::Fence,
        NAV_RALLY_POINT => MissionKind::Rally,
        _ => MissionKind::Mission,
    };
    let note = "";
    Row { command, list, firmware, taken: true, kept, nan, frames, altitude, autocontinue, source, note }
}

const D: Kept = Dropped;
const SECONDS: Kept = Whole(u16::MAX);
/// The number of corners: a byte on ArduPilot, a word on PX4.
const BYTE: [Kept; 4] = [Whole(255), D, D, D];
const WORD: [Kept; 4] = [Whole(u16::MAX), D, D, D];

/// One rule: command, firmware, what is kept of the four parameters and where NaN is taken (or that it is refused), frames, source, note.
macro_rules! row {
    ($command:ident $firmware:ident refused $frames:ident $source:tt) => {
        Row { taken: false, ..row!($command $firmware [D; 4] NONE $frames $source) }
    };
    ($command:ident $firmware:ident $kept:tt $nan:tt $frames:ident $source:tt $note:literal) => {
        Row { note: $note, ..row!($command $firmware $kept $nan $frames $source) }
    };
    ($command:ident $firmware:ident $kept:tt $nan:tt $frames:ident $source:tt) => {
        taken($command, $firmware, $kept, $nan, $frames, $source)
    };
}

macro_rules! rows {
    ($([$($row:tt)*])*) => { &[$(row!($($row)*)),*] };
}

/// All rules.
pub const ROWS: &[Row] = rows! {
    [NAV_WAYPOINT PLANE [D, Whole(255), Whole(255), D] FOURTH ArduPilotPlace "AP_Mission.cpp:1081"]
    [NAV_WAYPOINT COPTER [SECONDS, D, D, D] FOURTH ArduPilotPlace "AP_Mission.cpp:1099"]
    [NAV_WAYPOINT PX4 [Exact, Exact, D, Heading] FOURTH Px4Place "mavlink_mission.cpp, NAV_CMD_WAYPOINT"]
    [NAV_LOITER_UNLIM ARDUPILOT [D, D, Radius, D] NONE ArduPilotPlace "AP_Mission.cpp:1104" "4.7 takes NaN in parameter 4, earlier versions do not"]
    [NAV_LOITER_UNLIM PX4 [D, D, Exact, Heading] FOURTH Px4Place "mavlink_mission.cpp, NAV_CMD_LOITER_UNLIMITED"]
    [NAV_LOITER_TURNS ARDUPILOT [Turns, D, ByteRadius, Flag] NONE ArduPilotPlace "AP_Mission.cpp:1109"]
    [NAV_LOITER_TURNS PX4 refused Px4Place "mavlink_mission.cpp, parse_mavlink_mission_item: default"]
    [NAV_LOITER_TIME ARDUPILOT [SECONDS, D, Sign, Flag] NONE ArduPilotPlace "AP_Mission.cpp:1136" "flown with the vehicle's own radius"]
    [NAV_LOITER_TIME PX4 [Exact, Flag, Exact, Flag] FOURTH Px4Place "mavlink_mission.cpp, NAV_CMD_LOITER_TIME_LIMIT"]
    [NAV_RETURN_TO_LAUNCH ARDUPILOT [D; 4] NONE ArduPilotAny "AP_Mission.cpp:1142"]
    [NAV_RETURN_TO_LAUNCH PX4 [Exact; 4] ALL Px4Mission PX4_ACTION]
    [NAV_LAND ARDUPILOT [SECONDS, D, D, Sign] FOURTH ArduPilotPlace "AP_Mission.cpp:1145"]
    [NAV_LAND PX4 [D, Whole(u16::MAX), D, Heading] FOURTH Px4Place "mavlink_mission.cpp, NAV_CMD_LAND"]
    [NAV_TAKEOFF ARDUPILOT [SECONDS, D, D, D] FOURTH ArduPilotPlace "AP_Mission.cpp:1152"]
    [NAV_TAKEOFF PX4 [D, D, D, Heading] FOURTH Px4Place "mavlink_mission.cpp, NAV_CMD_TAKEOFF"]
    [NAV_CONTINUE_AND_CHANGE_ALT PLANE [SECONDS, D, D, D] NONE ArduPilotPlace "AP_Mission.cpp:1156"]
    [NAV_CONTINUE_AND_CHANGE_ALT COPTER [SECONDS, D, D, D] NONE ArduPilotPlace "AP_Mission.cpp:1156" "kept but skipped in flight (ModeAuto::start_command)"]
    [NAV_CONTINUE_AND_CHANGE_ALT PX4 refused Px4Place "mavlink_mission.cpp, parse_mavlink_mission_item: default"]
    [NAV_LOITER_TO_ALT ARDUPILOT [D, Radius, D, Flag] NONE ArduPilotPlace "AP_Mission.cpp:1163"]
    [NAV_LOITER_TO_ALT PX4 [Flag, Exact, D, Flag] FOURTH Px4Place "mavlink_mission.cpp, NAV_CMD_LOITER_TO_ALT"]
    [NAV_SPLINE_WAYPOINT PLANE refused ArduPilotPlace "AP_Mission.cpp:1169"]
    [NAV_SPLINE_WAYPOINT COPTER [SECONDS, D, D, D] NONE ArduPilotPlace "AP_Mission.cpp:1173"]
    [NAV_SPLINE_WAYPOINT PX4 refused Px4Place "mavlink_mission.cpp, parse_mavlink_mission_item: default"]
    [CONDITION_YAW PLANE [Exact, Exact, Signed(127), Whole(255)] NONE ArduPilotAny "AP_Mission.cpp:1196" "kept but skipped in flight (Plane::start_command)"]
    [CONDITION_YAW COPTER [Exact, Exact, Signed(127), Whole(255)] NONE ArduPilotAny "AP_Mission.cpp:1196"]
    [CONDITION_YAW PX4 refused Px4Mission "mavlink_mission.cpp, parse_mavlink_mission_item: default"]
    [CONDITION_DELAY ARDUPILOT [Exact, D, D, D] NONE ArduPilotAny "AP_Mission.cpp:1188"]
    [CONDITION_DISTANCE ARDUPILOT [Exact, D, D, D] NONE ArduPilotAny "AP_Mission.cpp:1192"]
    [DO_JUMP ARDUPILOT [SECONDS, Signed(u16::MAX / 2), D, D] NONE ArduPilotAny "AP_Mission.cpp:1203"]
    [DO_CHANGE_SPEED PLANE [Whole(255), Exact, Exact, D] NONE ArduPilotAny "AP_Mission.cpp:1213" "an airspeed outside AIRSPEED_MIN to AIRSPEED_MAX changes nothing (Plane::do_change_speed)"]
    [DO_CHANGE_SPEED COPTER [Whole(255), Exact, Exact, D] NONE ArduPilotAny "AP_Mission.cpp:1213"]
    [DO_CHANGE_SPEED PX4 [Exact; 4] ALL Px4Mission PX4_ACTION]
    [NAV_VTOL_TAKEOFF ARDUPILOT [D; 4] FOURTH ArduPilotPlace "AP_Mission.cpp, MAV_CMD_NAV_VTOL_TAKEOFF"]
    [NAV_VTOL_TAKEOFF PX4 [D, D, D, Heading] ALL Px4Place "mavlink_mission.cpp, MAV_CMD_NAV_VTOL_TAKEOFF"]
    [NAV_VTOL_LAND ARDUPILOT [D; 4] [false, false, true, true] ArduPilotPlace "AP_Mission.cpp, MAV_CMD_NAV_VTOL_LAND"]
    [NAV_VTOL_LAND PX4 [D, D, D, Heading] ALL Px4Place "mavlink_mission.cpp, MAV_CMD_NAV_VTOL_LAND"]
    [NAV_DELAY ARDUPILOT [Exact, Signed(127), Signed(127), Signed(127)] NONE ArduPilotAny "AP_Mission.cpp, MAV_CMD_NAV_DELAY"]
    [NAV_DELAY PX4 [Exact; 4] ALL Px4Mission PX4_ACTION]
    [CONDITION_DELAY PX4 [Exact; 4] ALL Px4Mission PX4_ACTION]
    [CONDITION_DISTANCE PX4 [Exact; 4] ALL Px4Mission PX4_ACTION]
    [DO_JUMP PX4 [Signed(u16::MAX / 2), SECONDS, Exact, Exact] ALL Px4Mission "mavlink_mission.cpp, NAV_CMD_DO_JUMP"]
    [DO_SET_HOME ARDUPILOT [SECONDS, D, D, D] NONE ArduPilotPlace "AP_Mission.cpp, MAV_CMD_DO_SET_HOME"]
    [DO_SET_HOME PX4 [Exact; 4] ALL Px4Mission PX4_ACTION]
    [DO_LAND_START ARDUPILOT [D; 4] NONE ArduPilotPlace "AP_Mission.cpp, MAV_CMD_DO_LAND_START"]
    [DO_LAND_START PX4 [Exact; 4] ALL Px4Mission PX4_ACTION]
    [DO_SET_ROI_LOCATION ARDUPILOT [D; 4] NONE ArduPilotPlace "AP_Mission.cpp, MAV_CMD_DO_SET_ROI_LOCATION"]
    [DO_SET_ROI_LOCATION PX4 [D; 4] ALL Px4Place "mavlink_mission.cpp, NAV_CMD_DO_SET_ROI_LOCATION"]
    [DO_SET_ROI ARDUPILOT [SECONDS, D, D, D] NONE ArduPilotPlace "AP_Mission.cpp, MAV_CMD_DO_SET_ROI"]
    [DO_SET_ROI PX4 [D; 4] ALL Px4Either "mavlink_mission.cpp, NAV_CMD_DO_SET_ROI"]
    [DO_SET_SERVO ARDUPILOT [Whole(255), SECONDS, D, D] NONE ArduPilotAny "AP_Mission.cpp, MAV_CMD_DO_SET_SERVO"]
    [DO_SET_CAM_TRIGG_DIST ARDUPILOT [Exact, D, Exact, D] NONE ArduPilotAny "AP_Mission.cpp, MAV_CMD_DO_SET_CAM_TRIGG_DIST"]
    [DO_SET_CAM_TRIGG_DIST PX4 [Exact; 4] ALL Px4Mission PX4_ACTION]
    [DO_FENCE_ENABLE ARDUPILOT [SECONDS, D, D, D] NONE ArduPilotAny "AP_Mission.cpp, MAV_CMD_DO_FENCE_ENABLE"]
    [NAV_FENCE_RETURN_POINT ARDUPILOT [D; 4] ALL ArduPilotFence ARDUPILOT_FENCE]
    [NAV_FENCE_RETURN_POINT PX4 [D; 4] ALL Px4Fence PX4_FENCE]
    [NAV_FENCE_POLYGON_VERTEX_INCLUSION ARDUPILOT BYTE ALL ArduPilotFence ARDUPILOT_FENCE]
    [NAV_FENCE_POLYGON_VERTEX_INCLUSION PX4 WORD ALL Px4Fence PX4_FENCE]
    [NAV_FENCE_POLYGON_VERTEX_EXCLUSION ARDUPILOT BYTE ALL ArduPilotFence ARDUPILOT_FENCE]
    [NAV_FENCE_POLYGON_VERTEX_EXCLUSION PX4 WORD ALL Px4Fence PX4_FENCE]
    [NAV_FENCE_CIRCLE_INCLUSION ARDUPILOT [Exact, D, D, D] ALL ArduPilotFence ARDUPILOT_FENCE]
    [NAV_FENCE_CIRCLE_INCLUSION ARDUPILOT [SECONDS, D, D, D] ALL ArduPilotFence "AC_PolyFence_loader.h, CIRCLE_INCLUSION_INT" "4.0 only"]
    [NAV_FENCE_CIRCLE_INCLUSION PX4 [Exact, D, D, D] ALL Px4Fence PX4_FENCE]
    [NAV_FENCE_CIRCLE_EXCLUSION ARDUPILOT [Exact, D, D, D] ALL ArduPilotFence ARDUPILOT_FENCE]
    [NAV_FENCE_CIRCLE_EXCLUSION ARDUPILOT [SECONDS, D, D, D] ALL ArduPilotFence "AC_PolyFence_loader.h, CIRCLE_EXCLUSION_INT" "4.0 only"]
    [NAV_FENCE_CIRCLE_EXCLUSION PX4 [Exact, D, D, D] ALL Px4Fence PX4_FENCE]
    [NAV_RALLY_POINT ARDUPILOT [D; 4] ALL ArduPilotRally "MissionItemProtocol_Rally.cpp:51 (stored), :86 (read back)"]
    [NAV_RALLY_POINT PX4 [D; 4] ALL Px4Place "mavlink_mission.cpp, MAV_CMD_NAV_RALLY_POINT" "a return goes there if it was sent in frame 0 or 3 (rtl.cpp:495)"]
};
