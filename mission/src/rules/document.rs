//! The table as a page of the documentation, `docs/firmware-rules.md`; a test keeps the two equal.

use super::Firmware;
use super::table::{ROWS, Row};
use crate::item::command;
use std::fmt::Write as _;

/// Commands that `gaware plan` can write.
pub const PLANNED: [u16; 9] = [
    command::NAV_WAYPOINT,
    command::NAV_LOITER_UNLIM,
    command::NAV_LOITER_TURNS,
    command::NAV_LOITER_TIME,
    command::NAV_LAND,
    command::NAV_TAKEOFF,
    command::NAV_LOITER_TO_ALT,
    command::CONDITION_YAW,
    command::DO_CHANGE_SPEED,
];

const HEAD: &str = "# What autopilots take in missions

Generated from `mission/src/rules/table.rs`; `UPDATE_DOCS=1 cargo test -p gaware-mission --lib rules` writes it again.

Before an upload, `gaware` judges every item by this table. *NaN* names the parameters in which `null` (NaN) is taken; infinity is
never accepted. ArduPilot has home as item 0 and reads every frame of a command without a place back as 0. PX4 reads
frames 0 and 3 back as 5 and 6; a fence point always as 5. After an upload, what is read back is compared by this table: a field is right as it
was sent or as the table keeps it, and nothing else is tolerated. Commands from 5000 belong to the geofence, 5100 to the rally points. Commands marked with * are those that `gaware plan` can write.

| command | firmware | verdict | parameter 1 | 2 | 3 | 4 | altitude | autocontinue | NaN | frames | source |
|---|---|---|---|---|---|---|---|---|---|---|---|
";

const TAIL: &str = "
## The current item

Neither firmware begins a new mission at its first item by itself. `gaware` marks the first item of an upload as the current one, sends
MISSION_SET_CURRENT 0 after the read-back, and waits until MISSION_CURRENT says so.

| firmware | after an upload | flag `current` of an item | MISSION_SET_CURRENT 0 | source |
|---|---|---|---|---|
| ArduPlane, ArduCopter | the index stays | not used | the first item that is flown; MISSION_CURRENT answers at once | AP_Mission.cpp, resume, set_current_cmd |
| PX4 | the index stays, cut to the last item | taken if the checksum of the mission differs | item 0, unless a transfer is going on | mission_base.cpp:100, mavlink_mission.cpp, handle_mission_item_both, handle_mission_set_current |

## PX4's second check

PX4 acknowledges a mission first and judges it afterwards (`FeasibilityChecker.cpp`); what it rejects cannot be started, and only EVENT (410) says
why.

| rule | parameter | event, low 24 bits |
|---|---|---|
| a fixed wing's mission has a landing | `MIS_TKO_LAND_REQ` 2 | 0x811691; in the air 0x2b5ff0 |
| the glide slope is at most 5.0 deg (0.1 deg of slack) | `FW_LND_ANG` | 0x48d925 |
| a required take-off is there | `MIS_TKO_LAND_REQ` 1, 3 | 0x53d6e2 |
| the take-off climbs 1 m above the acceptance radius | `NAV_ACC_RAD` | 0xba4a6d |

## Messages, rates and calibrations

What else a simulated autopilot does as the firmware does.

| firmware | what it does | source | in the simulation |
|---|---|---|---|
| PX4 | denies a message of which nothing is new (REQUEST_MESSAGE), and a rate likewise; an arriving message is the only proof | mavlink_receiver.cpp, handle_request_message_command; MavlinkStream::request_message | the first request of each message; five seconds after a restart of the MAVLink instance |
| PX4 | knows no REQUEST_DATA_STREAM | mavlink_receiver.cpp, handle_message | no answer |
| PX4 | a MAVLink instance that is stopped and started has its default rates again: HIGHRES_IMU 50 Hz, no SCALED_IMU | mavlink_main.cpp, configure_streams_to_default | `--fault instance-restart@S-S` |
| PX4 | counts an interval from the last sending, at the samples' own 4 ms: 125 or 250 Hz, nothing between | mavlink_stream.cpp, MavlinkStream::update | the same |
| PX4 | a UDP port answers the place that it heard first | mavlink_receiver.cpp, set_client_source_initialized | not simulated; `udpout` comes from the same local port in every run |
| PX4 | SCALED_IMU, SCALED_IMU2, SCALED_IMU3 are vehicle_imu 0, 1, 2; HIGHRES_IMU is the unit in use, less the filter's bias estimates | streams/SCALED_IMU.hpp, streams/HIGHRES_IMU.hpp | CAL_ACC1_ID is set, as on every board |
| PX4 | adds what its filter learnt of the accelerometers to CAL_ACC*_OFF when it is disarmed, from 0.05 m/s² on | VehicleIMU.cpp, SensorCalibrationSaveAccel (SENS_IMU_AUTOCAL, on by default) | commits nothing, and says so: SENS_IMU_AUTOCAL 0 |
| PX4 | keeps the frame of a rally point as it was sent and returns to frames 0 and 3 only; to another it flies off, from home and from the point, with \"RTL: unsupported MAV_FRAME\". It reads `_INT` back whatever was sent | rtl.cpp:495, setSafepointAsDestination; mavlink_mission.cpp, parse_mavlink_mission_item | says so at the upload; `gaware` sends rally points in frame 3 |
| PX4 | stamps SCALED_IMU when vehicle_imu is published, not when it was measured: 3.8 ms later on average in its own simulator, which makes the latency from a link that much shorter than from a `.ulg` | VehicleIMU.cpp, Publish; streams/SCALED_IMU.hpp | not simulated |
| PX4 | without its gimbal module prints \"param 65535 invalid\" at each request of AUTOPILOT_VERSION, and means nothing by it | mavlink_main.cpp:1086, MNT_MODE_IN | not simulated |
| ArduPilot | answers a request for a parameter that it does not have with PARAM_ERROR from 4.7 on, and not at all before | GCS_Param.cpp, param_io_timer | 4.6: no answer |
| both | integers of RAW_IMU and SCALED_IMU are truncated toward zero; in calm air they repeat for seconds | GCS_Common.cpp:2215, streams/SCALED_IMU.hpp | the same; repeated values are judged by their probability |
| both | speed and course of GPS_RAW_INT are truncated to whole cm/s and hundredths of a degree: 5 mm/s too slow on average | AP_GPS.cpp, send_mavlink_gps_raw; streams/GPS_RAW_INT.hpp | the same; half a count is added when it is read |
";

/// The page.
pub fn page() -> String {
    let mut page = HEAD.to_owned();
    let mut rows: Vec<&Row> = ROWS.iter().collect();
    rows.sort_by_key(|r| r.command);
    for row in rows {
        let names: Vec<&str> = row.firmware.iter().map(|f| Firmware::name(*f)).collect();
        let mark = if PLANNED.contains(&row.command) { "\\*" } else { "" };
        let _ = write!(
            page,
            "| {} {}{mark} | {} | {} |",
            row.command,
            command::describe(row.command),
            names.join(", "),
            verdict(row)
        );
        for kept in row.kept {
            let _ = write!(page, " {} |", if row.taken { kept.describe() } else { String::new() });
        }
        let nan: Vec<String> =
            (1..=4).zip(row.nan).filter(|(_, may)| *may).map(|(n, _)| n.to_string()).collect();
        let note = if row.note.is_empty() { String::new() } else { format!("; {}", row.note) };
        let (altitude, autocontinue) = match row.taken {
            false => ("", ""),
            true if !row.frames.has_place() => ("", row.autocontinue.describe()),
            true => (row.altitude.describe(), row.autocontinue.describe()),
        };
        let (nan, frames, source) = (nan.join(" "), row.frames.describe(), row.source);
        let _ = writeln!(page, " {altitude} | {autocontinue} | {nan} | {frames} | {source}{note} |");
    }
    page + TAIL
}

fn verdict(row: &Row) -> &'static str {
    use super::table::{AutoContinue, Kept::Exact};
    match row.taken {
        false => "refused",
        true if row.kept == [Exact; 4] && row.autocontinue == AutoContinue::Exact => "accepted",
        true => "rewritten",
    }
}
