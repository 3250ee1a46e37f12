//! ArduPilot's storage of a mission item, fifteen bytes each: `libraries/AP_Mission/AP_Mission.cpp`, `sanity_check_params`,
//! `mavlink_int_to_mission_cmd`, `mission_cmd_to_mavlink_int` (4.6; 4.7 also takes NaN in parameter 4 of `NAV_LOITER_UNLIM`).

use super::Item;
use super::storage::without_int;
use mavlink::dialects::ardupilotmega::*;

/// Largest altitude of a `Location`, m (`LOCATION_ALT_MAX_M`).
const ALTITUDE_MAX_M: f32 = 83_000.0;

/// The item as it is kept and read back.
pub(super) fn keep(item: Item, wing: bool) -> Result<Item, MavMissionResult> {
    sanity_check(&item)?;
    let [param1, param2, param3, param4] = params(&item, wing)?;
    let (seq, command) = (item.seq, item.command);
    let kept = Item { seq, command, autocontinue: 1, param1, param2, param3, param4, ..Item::default() };
    if !stored_in_location(command) {
        // Place and frame are not kept: read back as zeros, whatever frame was sent.
        return Ok(Item { frame: MavFrame::MAV_FRAME_GLOBAL, ..kept });
    }
    if item.x.unsigned_abs() > 900_000_000 {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM5_X);
    }
    if item.y.unsigned_abs() > 1_800_000_000 {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM6_Y);
    }
    if item.z.is_nan() || item.z.abs() >= ALTITUDE_MAX_M {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM7);
    }
    let frame = match item.frame {
        MavFrame::MAV_FRAME_MISSION => MavFrame::MAV_FRAME_GLOBAL,
        frame => without_int(frame).ok_or(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME)?,
    };
    // `int32_t alt`, in cm; a cast of a float cuts toward zero.
    let z = (item.z * 100.0) as i32 as f32 * 0.01;
    Ok(Item { frame, x: item.x, y: item.y, z, ..kept })
}

/// NaN and infinity by parameter.
fn sanity_check(item: &Item) -> Result<(), MavMissionResult> {
    use MavMissionResult::*;
    let may_be_nan = match item.command as u32 {
        16 | 21 | 22 | 84 => [false, false, false, true],
        85 => [false, false, true, true],
        _ => [false; 4],
    };
    let results = [
        MAV_MISSION_INVALID_PARAM1,
        MAV_MISSION_INVALID_PARAM2,
        MAV_MISSION_INVALID_PARAM3,
        MAV_MISSION_INVALID_PARAM4,
    ];
    let params = [item.param1, item.param2, item.param3, item.param4];
    for ((value, may), refused) in params.into_iter().zip(may_be_nan).zip(results) {
        if value.is_infinite() || value.is_nan() && !may {
            return Err(refused);
        }
    }
    Ok(())
}

/// Parameters 1 to 4 as they are read back.
fn params(item: &Item, wing: bool) -> Result<[f32; 4], MavMissionResult> {
    let Item { param1, param2, param3, param4, .. } = *item;
    // Casts of floats cut toward zero and saturate.
    let word = |v: f32| f32::from(v as u16);
    let byte = |v: f32| f32::from(v as u8);
    let radius = |v: f32| if v < 0.0 { -word(v.abs()) } else { word(v.abs()) };
    let flag = f32::from(u8::from(param4 > 0.0));
    let side = |v: f32| if v < 0.0 { -1.0 } else { 1.0 };
    Ok(match item.command as u32 {
        16 if wing => [0.0, byte(param2), byte(param3), 0.0],
        16 => [word(param1), 0.0, 0.0, 0.0],
        17 => [0.0, 0.0, radius(param3), 0.0],
        18 => {
            let turns =
                if param1 > 0.0 && param1 < 1.0 { byte(param1 * 256.0) / 256.0 } else { byte(param1) };
            let most = param3.abs();
            let size = if most <= 255.0 { byte(most) } else { byte(most * 0.1) * 10.0 };
            [turns, 0.0, if param3 < 0.0 { -size } else { size }, flag]
        }
        19 => [word(param1), 0.0, side(param3), flag],
        20 | 84 | 85 | 189 | 195 => [0.0; 4],
        21 => [word(param1), 0.0, 0.0, side(param4)],
        82 if wing => return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED),
        22 | 30 | 82 | 179 | 201 | 207 => [word(param1), 0.0, 0.0, 0.0],
        31 => [0.0, radius(param2), 0.0, flag],
        93 => [param1, f32::from(param2 as i8), f32::from(param3 as i8), f32::from(param4 as i8)],
        112 | 114 => [param1, 0.0, 0.0, 0.0],
        115 => [param1, param2, f32::from(param3 as i8), byte(param4)],
        177 => [word(param1), f32::from(param2 as i16), 0.0, 0.0],
        178 => [byte(param1), param2, param3, 0.0],
        183 => [byte(param1), word(param2), 0.0, 0.0],
        206 => [param1, 0.0, param3, 0.0],
        _ => return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED),
    })
}

/// `AP_Mission::stored_in_location`, of the commands above.
fn stored_in_location(command: MavCmd) -> bool {
    matches!(command as u32, 16..=19 | 21 | 22 | 30 | 31 | 82 | 84 | 85 | 179 | 189 | 195 | 201)
}

/// Whether this is a jump to home or beyond the last item.
pub(super) fn jumps_outside(item: &Item, last: u16) -> bool {
    item.command == MavCmd::MAV_CMD_DO_JUMP && (item.param1 < 1.0 || item.param1 > f32::from(last))
}
