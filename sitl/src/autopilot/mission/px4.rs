//! PX4's storage of a mission item: `src/modules/mavlink/mavlink_mission.cpp`, `parse_mavlink_mission_item` and
//! `format_mavlink_mission_item` (1.16).

use super::Item;
use super::storage::{CIRCLES, CORNERS, with_int};
use mavlink::dialects::ardupilotmega::*;

/// The item as it is kept and read back.
pub(super) fn keep(item: Item) -> Result<Item, MavMissionResult> {
    if item.frame == MavFrame::MAV_FRAME_MISSION {
        return keep_action(item);
    }
    let frame = with_int(item.frame).ok_or(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME)?;
    let Item { param1, param2, param3, .. } = item;
    let heading = heading(item.param4);
    let flag = |v: f32| f32::from(u8::from(v > 0.0));
    let [param1, param2, param3, param4] = match item.command as u32 {
        16 => [param1, param2, 0.0, heading],
        17 => [0.0, 0.0, param3, heading],
        19 => [param1, flag(param2), param3, flag(item.param4)],
        // `land_precision` is a `uint16_t`.
        21 => [0.0, f32::from(param2 as u16), 0.0, heading],
        22 | 84 | 85 => [0.0, 0.0, 0.0, heading],
        31 => [flag(param1), param2, 0.0, flag(item.param4)],
        195 => [0.0; 4],
        // `MAV_ROI_LOCATION` and `MAV_ROI_NONE`; the kind is kept and not read back.
        201 if matches!(param1 as i32, 0 | 3) => [0.0; 4],
        201 => return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1),
        // Known, but not in a mission.
        _ if CORNERS.contains(&item.command)
            || CIRCLES.contains(&item.command)
            || item.command == MavCmd::MAV_CMD_NAV_RALLY_POINT =>
        {
            return Err(MavMissionResult::MAV_MISSION_ERROR);
        }
        _ => return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED),
    };
    Ok(Item { frame, param1, param2, param3, param4, ..item })
}

/// `wrap_2pi(radians(param4))`, read back in degrees; NaN stays.
fn heading(degrees: f32) -> f32 {
    degrees.to_radians().rem_euclid(std::f32::consts::TAU).to_degrees()
}

/// A command without a place: everything is kept, in `float params[7]`.
fn keep_action(item: Item) -> Result<Item, MavMissionResult> {
    let float = |v: i32| v as f32 as i32;
    let item = Item { x: float(item.x), y: float(item.y), ..item };
    match item.command as u32 {
        177 => {
            Ok(Item { param1: f32::from(item.param1 as i16), param2: f32::from(item.param2 as u16), ..item })
        }
        // `MAV_ROI_NONE`, `MAV_ROI_WPNEXT`, `MAV_ROI_WPINDEX`.
        201 if !(0.0..3.0).contains(&item.param1) => Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1),
        20 | 93 | 112 | 114 | 178 | 179 | 189 | 197 | 201 | 203 | 206 | 211 | 214 => Ok(item),
        _ => Err(MavMissionResult::MAV_MISSION_UNSUPPORTED),
    }
}
