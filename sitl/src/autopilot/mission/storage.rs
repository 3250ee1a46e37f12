//! What the firmware makes of an item: taken, cut or refused.

use super::{Flavour, Item, List, ardupilot, px4};
use crate::scenario::Airframe;
use mavlink::dialects::ardupilotmega::*;

/// Items of the mission that fit on board.
const MISSION_CAPACITY: u16 = 700;
/// Corners and circles that fit on board: ArduPilot's storage on a Pixhawk (`AC_PolyFence_loader::max_items`), PX4's
/// `DM_KEY_FENCE_POINTS_MAX`.
const FENCE_CAPACITY: [u16; 2] = [84, 64];
/// The same for rally points: ArduPilot's `AP_Rally::get_rally_max`, PX4's `DM_KEY_SAFE_POINTS_MAX`.
const RALLY_CAPACITY: [u16; 2] = [20, 32];

pub(super) const CORNERS: [MavCmd; 2] =
    [MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION];
pub(super) const CIRCLES: [MavCmd; 2] =
    [MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION];

/// Whose storage.
#[derive(Debug, Clone, Copy)]
pub(super) struct Storage {
    pub flavour: Flavour,
    pub airframe: Airframe,
}

impl Storage {
    pub(super) fn capacity(self, list: List) -> u16 {
        let px4 = usize::from(self.flavour == Flavour::Px4);
        match list {
            List::Mission => MISSION_CAPACITY,
            List::Fence => FENCE_CAPACITY[px4],
            List::Rally => RALLY_CAPACITY[px4],
        }
    }

    /// Whether a list is taken over as a whole, or item by item.
    pub(super) fn stages(self, list: List) -> bool {
        self.flavour == Flavour::Px4 || list == List::Fence
    }

    /// The item as it is kept and read back.
    pub(super) fn keep(self, list: List, item: Item) -> Result<Item, MavMissionResult> {
        match (self.flavour, list) {
            (Flavour::ArduPilot, List::Mission) => {
                ardupilot::keep(item, self.airframe == Airframe::FixedWing)
            }
            (Flavour::Px4, List::Mission) => px4::keep(item),
            (Flavour::ArduPilot, List::Fence) => ardupilot_fence(item),
            (Flavour::Px4, List::Fence) => px4_fence(item),
            (Flavour::ArduPilot, List::Rally) => ardupilot_rally(item),
            (Flavour::Px4, List::Rally) => px4_rally(item),
        }
    }
}

/// `MissionItemProtocol_Fence::convert_MISSION_ITEM_INT_to_AC_PolyFenceItem`, read back by `get_item_as_mission_item`: command, first
/// parameter and place are all that is kept.
fn ardupilot_fence(item: Item) -> Result<Item, MavMissionResult> {
    if !is_global(item.frame) && !is_terrain(item.frame) {
        return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME);
    }
    let param1 = if CORNERS.contains(&item.command) {
        if item.param1 > 255.0 {
            return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
        }
        // A `uint8_t`; a cast of a float saturates.
        f32::from(item.param1 as u8)
    } else if CIRCLES.contains(&item.command) {
        item.param1
    } else if item.command == MavCmd::MAV_CMD_NAV_FENCE_RETURN_POINT {
        0.0
    } else {
        return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED);
    };
    let (seq, command, x, y) = (item.seq, item.command, item.x, item.y);
    Ok(Item { seq, command, param1, x, y, ..Item::default() })
}

/// `AC_PolyFence_loader::validate_fence`, and what it reports to the station.
pub(super) fn validate_fence(items: &[Item]) -> Result<(), &'static str> {
    let mut corners_left = 0;
    let mut polygon = (MavCmd::MAV_CMD_NAV_FENCE_RETURN_POINT, 0.0);
    let mut return_points = 0;
    for item in items {
        if CORNERS.contains(&item.command) {
            if item.param1 < 3.0 {
                return Err("Invalid vertex count");
            }
            if corners_left == 0 {
                polygon = (item.command, item.param1);
                corners_left = item.param1 as u32;
            } else if polygon != (item.command, item.param1) {
                return Err("Unexpected vertex count");
            }
            corners_left -= 1;
        } else if corners_left > 0 {
            return Err("Received incorrect type");
        } else if CIRCLES.contains(&item.command) && (item.param1.is_nan() || item.param1 <= 0.0) {
            return Err("Non-positive circle radius");
        } else if item.command == MavCmd::MAV_CMD_NAV_FENCE_RETURN_POINT {
            return_points += 1;
            if return_points > 1 {
                return Err("Multiple return points");
            }
        }
        if !on_earth(item) {
            return Err("Bad lat or lon");
        }
    }
    if corners_left > 0 { Err("Incorrect item count") } else { Ok(()) }
}

/// PX4's fence point: `handle_mission_item_both`, `send_mission_item` (mavlink_mission.cpp:325), `format_mavlink_mission_item`.
/// `mission_fence_point_s` holds neither autocontinue nor what the altitude counts from. A polygon of fewer than three corners is an
/// error at once; the number of corners is rounded.
fn px4_fence(item: Item) -> Result<Item, MavMissionResult> {
    let known = CORNERS.contains(&item.command)
        || CIRCLES.contains(&item.command)
        || item.command == MavCmd::MAV_CMD_NAV_FENCE_RETURN_POINT;
    let placed = px4_place(item, known)?;
    let mut kept = Item { autocontinue: 0, frame: MavFrame::MAV_FRAME_GLOBAL_INT, ..placed };
    if CORNERS.contains(&kept.command) {
        kept.param1 = f32::from((kept.param1 + 0.5) as u16);
        if kept.param1 < 3.0 {
            return Err(MavMissionResult::MAV_MISSION_ERROR);
        }
    } else if kept.command == MavCmd::MAV_CMD_NAV_FENCE_RETURN_POINT {
        kept.param1 = 0.0;
    }
    Ok(kept)
}

/// `MissionItemProtocol_Rally::convert_MISSION_ITEM_INT_to_RallyLocation`: whole metres in an `int16_t`.
fn ardupilot_rally(item: Item) -> Result<Item, MavMissionResult> {
    if item.command != MavCmd::MAV_CMD_NAV_RALLY_POINT {
        return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED);
    }
    if item.x.unsigned_abs() > 900_000_000 {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM5_X);
    }
    if item.y.unsigned_abs() > 1_800_000_000 {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM6_Y);
    }
    if item.z < f32::from(i16::MIN) || item.z > f32::from(i16::MAX) {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM7);
    }
    let frame = without_int(item.frame).ok_or(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME)?;
    let (seq, command, x, y) = (item.seq, item.command, item.x, item.y);
    Ok(Item { seq, command, frame, x, y, z: f32::from(item.z as i16), ..Item::default() })
}

fn px4_rally(item: Item) -> Result<Item, MavMissionResult> {
    let known = item.command == MavCmd::MAV_CMD_NAV_RALLY_POINT;
    Ok(Item { param1: 0.0, ..px4_place(item, known)? })
}

/// `RTL::setSafepointAsDestination` (rtl.cpp:495) looks at the frame as it was sent, and knows 0 and 3. With any other it leaves latitude and longitude
/// unset: the firmware flew away, from home and from the point.
pub(super) fn px4_returns_to(point: &Item) -> bool {
    matches!(point.frame, MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT)
}

/// What PX4 keeps of any item with a place: global frames only, which it reads back as the `_INT` ones.
fn px4_place(item: Item, known: bool) -> Result<Item, MavMissionResult> {
    let frame = with_int(item.frame).ok_or(match item.frame {
        MavFrame::MAV_FRAME_MISSION => MavMissionResult::MAV_MISSION_UNSUPPORTED,
        _ => MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME,
    })?;
    if !known {
        return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED);
    }
    Ok(Item { frame, param2: 0.0, param3: 0.0, param4: 0.0, ..item })
}

pub(super) fn on_earth(item: &Item) -> bool {
    item.x.unsigned_abs() <= 900_000_000 && item.y.unsigned_abs() <= 1_800_000_000
}

fn is_global(frame: MavFrame) -> bool {
    with_int(frame).is_some()
}

fn is_terrain(frame: MavFrame) -> bool {
    matches!(frame, MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT | MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)
}

/// A frame above sea level or home in its `_INT` form.
pub(super) fn with_int(frame: MavFrame) -> Option<MavFrame> {
    use MavFrame::*;
    match frame {
        MAV_FRAME_GLOBAL | MAV_FRAME_GLOBAL_INT => Some(MAV_FRAME_GLOBAL_INT),
        MAV_FRAME_GLOBAL_RELATIVE_ALT | MAV_FRAME_GLOBAL_RELATIVE_ALT_INT => {
            Some(MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
        }
        _ => None,
    }
}

/// A frame as ArduPilot reads it back: without `_INT`.
pub(super) fn without_int(frame: MavFrame) -> Option<MavFrame> {
    use MavFrame::*;
    match with_int(frame) {
        Some(MAV_FRAME_GLOBAL_INT) => Some(MAV_FRAME_GLOBAL),
        Some(_) => Some(MAV_FRAME_GLOBAL_RELATIVE_ALT),
        None if is_terrain(frame) => Some(MAV_FRAME_GLOBAL_TERRAIN_ALT),
        None => None,
    }
}
