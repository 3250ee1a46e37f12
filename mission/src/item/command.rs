//! Numbers of `MAV_CMD` used here.

/// Fly to a position.
pub const NAV_WAYPOINT: u16 = 16;
/// Circle (or hover) until commanded otherwise.
pub const NAV_LOITER_UNLIM: u16 = 17;
/// Fly a number of circles; param3 radius in m, negative is counter-clockwise.
pub const NAV_LOITER_TURNS: u16 = 18;
/// Circle for a time in s.
pub const NAV_LOITER_TIME: u16 = 19;
/// Return to launch.
pub const NAV_RETURN_TO_LAUNCH: u16 = 20;
/// Land.
pub const NAV_LAND: u16 = 21;
/// Take off.
pub const NAV_TAKEOFF: u16 = 22;
/// Keep the course and change altitude.
pub const NAV_CONTINUE_AND_CHANGE_ALT: u16 = 30;
/// Circle until an altitude is reached; param2 radius in m, its sign the direction.
pub const NAV_LOITER_TO_ALT: u16 = 31;
/// Fly through a position on a smooth curve.
pub const NAV_SPLINE_WAYPOINT: u16 = 82;
/// Take off as a multirotor (VTOL).
pub const NAV_VTOL_TAKEOFF: u16 = 84;
/// Land as a multirotor (VTOL).
pub const NAV_VTOL_LAND: u16 = 85;
/// Wait.
pub const NAV_DELAY: u16 = 93;
/// Last command with a position of the `NAV_` kind; marker, not a command.
pub const NAV_LAST: u16 = 95;
/// Wait a time before the next `DO_` command.
pub const CONDITION_DELAY: u16 = 112;
/// Wait until the next waypoint is this near, m.
pub const CONDITION_DISTANCE: u16 = 114;
/// Turn the nose: param1 angle in deg, param2 rate in deg/s, param3 direction, param4 1 = relative.
pub const CONDITION_YAW: u16 = 115;
/// Go on at another item.
pub const DO_JUMP: u16 = 177;
/// Change speed: param1 type (0 airspeed, 1 ground speed), param2 m/s, param3 throttle in % (−1: no change).
pub const DO_CHANGE_SPEED: u16 = 178;
/// Set home.
pub const DO_SET_HOME: u16 = 179;
/// Set a servo output.
pub const DO_SET_SERVO: u16 = 183;
/// Start of a landing sequence.
pub const DO_LAND_START: u16 = 189;
/// Point at a place.
pub const DO_SET_ROI_LOCATION: u16 = 195;
/// Point at a place (older).
pub const DO_SET_ROI: u16 = 201;
/// Trigger a camera by distance.
pub const DO_SET_CAM_TRIGG_DIST: u16 = 206;
/// Switch the geofence.
pub const DO_FENCE_ENABLE: u16 = 207;
/// Where a vehicle that broke its fence returns to (old ArduPlane).
pub const NAV_FENCE_RETURN_POINT: u16 = 5000;
/// Corner of a polygon to stay in; param1 the number of its corners.
pub const NAV_FENCE_POLYGON_VERTEX_INCLUSION: u16 = 5001;
/// Corner of a polygon to stay out of; param1 the number of its corners.
pub const NAV_FENCE_POLYGON_VERTEX_EXCLUSION: u16 = 5002;
/// Circle to stay in; param1 radius in m.
pub const NAV_FENCE_CIRCLE_INCLUSION: u16 = 5003;
/// Circle to stay out of; param1 radius in m.
pub const NAV_FENCE_CIRCLE_EXCLUSION: u16 = 5004;
/// Rally point.
pub const NAV_RALLY_POINT: u16 = 5100;

/// Whether x, y and z of this command are a place. Every navigation command but the last few, and the `DO_`
/// commands that name one.
pub fn has_position(command: u16) -> bool {
    match command {
        NAV_RETURN_TO_LAUNCH | NAV_CONTINUE_AND_CHANGE_ALT | NAV_DELAY => false,
        0..=NAV_LAST => true,
        DO_SET_HOME | DO_LAND_START | DO_SET_ROI_LOCATION | DO_SET_ROI => true,
        _ => number_of_fence(command) || command == NAV_RALLY_POINT,
    }
}

fn number_of_fence(command: u16) -> bool {
    (NAV_FENCE_RETURN_POINT..=NAV_FENCE_CIRCLE_EXCLUSION).contains(&command)
}

/// Whether the altitude of this command means anything.
pub fn has_altitude(command: u16) -> bool {
    (has_position(command) && !number_of_fence(command)) || command == NAV_CONTINUE_AND_CHANGE_ALT
}

/// The command in a pilot's words.
pub fn describe(command: u16) -> String {
    let name = match command {
        NAV_WAYPOINT => "waypoint",
        NAV_LOITER_UNLIM => "loiter",
        NAV_LOITER_TURNS => "loiter turns",
        NAV_LOITER_TIME => "loiter time",
        NAV_RETURN_TO_LAUNCH => "return to launch",
        NAV_LAND => "land",
        NAV_TAKEOFF => "take-off",
        NAV_CONTINUE_AND_CHANGE_ALT => "continue and change altitude",
        NAV_LOITER_TO_ALT => "loiter to altitude",
        CONDITION_YAW => "yaw",
        CONDITION_DELAY => "delay",
        DO_JUMP => "jump",
        DO_CHANGE_SPEED => "change speed",
        NAV_SPLINE_WAYPOINT => "spline waypoint",
        NAV_VTOL_TAKEOFF => "VTOL take-off",
        NAV_VTOL_LAND => "VTOL land",
        NAV_DELAY => "wait",
        CONDITION_DISTANCE => "distance",
        DO_SET_HOME => "set home",
        DO_LAND_START => "start of the landing",
        DO_SET_ROI_LOCATION => "point at a place",
        DO_SET_ROI => "point at",
        NAV_FENCE_RETURN_POINT => "fence return point",
        NAV_FENCE_POLYGON_VERTEX_INCLUSION => "corner of an area to stay in",
        NAV_FENCE_POLYGON_VERTEX_EXCLUSION => "corner of an area to stay out of",
        NAV_FENCE_CIRCLE_INCLUSION => "circle to stay in",
        NAV_FENCE_CIRCLE_EXCLUSION => "circle to stay out of",
        NAV_RALLY_POINT => "rally point",
        _ => return format!("command {command}"),
    };
    name.to_owned()
}
