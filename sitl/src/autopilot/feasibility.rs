//! PX4's judgement of a mission after its upload was acknowledged: `FeasibilityChecker.cpp` in the order of its checks, reported by
//! EVENT (410) alone. Parameters have PX4's defaults.

use crate::scenario::Airframe;
use gaware_nav::earth::Geodetic;
use gaware_nav::math::{cos, hypot};
use mavlink::dialects::ardupilotmega::*;

/// `FW_LND_ANG`, deg, and what the check adds for rounding.
const LANDING_ANGLE_DEG: f32 = 5.0;
const ROUNDING_DEG: f32 = 0.1;
/// `NAV_ACC_RAD`, m.
const ACCEPTANCE_RADIUS_M: f32 = 10.0;
/// `MIS_DIST_1WP`, m.
const FIRST_ITEM_MAX_M: f64 = 10_000.0;
/// Component id of the events of PX4 itself, in the highest byte.
const PX4_EVENTS: u32 = 1 << 24;

/// A rejection: the event's name in PX4's source and its arguments.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct MissionEvent {
    name: &'static str,
    arguments: Vec<u8>,
}

impl MissionEvent {
    fn plain(name: &'static str) -> Self {
        Self { name, arguments: Vec::new() }
    }

    /// Identifier: FNV-1a of the name, 24 bits of it (PX4's `events::ID`).
    pub(super) fn id(&self) -> u32 {
        let hash =
            self.name.bytes().fold(0x811C_9DC5_u32, |h, b| (h ^ u32::from(b)).wrapping_mul(0x0100_0193));
        PX4_EVENTS | (hash & 0x00FF_FFFF)
    }

    pub(super) fn message(&self, boot_ms: u32, sequence: u16) -> MavMessage {
        let mut arguments = [0; 40];
        for (to, from) in arguments.iter_mut().zip(&self.arguments) {
            *to = *from;
        }
        // Error for the station, info for the log.
        let log_levels = 6 << 4 | 3;
        MavMessage::EVENT(EVENT_DATA {
            id: self.id(),
            event_time_boot_ms: boot_ms,
            sequence,
            log_levels,
            arguments,
            ..Default::default()
        })
    }
}

/// What PX4 finds wrong; empty: the mission can be flown.
pub(super) fn judge(
    items: &[MISSION_ITEM_INT_DATA],
    airframe: Airframe,
    home: &MISSION_ITEM_INT_DATA,
) -> Vec<MissionEvent> {
    let mut found = Vec::new();
    if items.is_empty() {
        return found;
    }
    if items[0].command == MavCmd::MAV_CMD_NAV_LAND {
        found.push(MissionEvent::plain("navigator_mis_starts_w_landing"));
    }
    let first = items.iter().find(|i| has_position(i));
    if first.is_some_and(|i| distance(i, home) >= FIRST_ITEM_MAX_M) {
        found.push(MissionEvent::plain("navigator_mis_first_wp_too_far"));
    }
    found.extend(take_off(items, home));
    if airframe == Airframe::Multirotor {
        return found;
    }
    for (k, item) in items.iter().enumerate().skip(1) {
        if item.command == MavCmd::MAV_CMD_NAV_LAND && has_position(&items[k - 1]) {
            found.extend(approach(&items[k - 1], item, home));
        }
    }
    // `MIS_TKO_LAND_REQ` is 2 on fixed wings.
    let lands = items.iter().skip(1).any(|i| i.command == MavCmd::MAV_CMD_NAV_LAND);
    if !lands {
        found.push(MissionEvent::plain("navigator_mis_land_missing"));
    }
    found
}

/// `checkTakeoff`.
fn take_off(items: &[MISSION_ITEM_INT_DATA], home: &MISSION_ITEM_INT_DATA) -> Option<MissionEvent> {
    let k = items.iter().position(|i| i.command == MavCmd::MAV_CMD_NAV_TAKEOFF)?;
    if height(&items[k], home) - 1.0 < ACCEPTANCE_RADIUS_M {
        let least = ACCEPTANCE_RADIUS_M + 1.0;
        let arguments = least.to_le_bytes().to_vec();
        return Some(MissionEvent { name: "navigator_mis_takeoff_too_low", arguments });
    }
    let late = items.iter().take(k).any(|i| i.frame != MavFrame::MAV_FRAME_MISSION);
    late.then(|| MissionEvent::plain("navigator_mis_takeoff_not_first"))
}

/// `checkFixedWindLandApproach`.
fn approach(
    from: &MISSION_ITEM_INT_DATA,
    land: &MISSION_ITEM_INT_DATA,
    home: &MISSION_ITEM_INT_DATA,
) -> Vec<MissionEvent> {
    let drop = height(from, home) - height(land, home);
    if drop < f32::EPSILON {
        return vec![MissionEvent::plain("navigator_mis_approach_wp_below_land")];
    }
    let between = distance(from, land) as f32;
    let run = match from.command {
        MavCmd::MAV_CMD_NAV_WAYPOINT => between,
        MavCmd::MAV_CMD_NAV_LOITER_TO_ALT if between <= from.param2.abs() => {
            return vec![MissionEvent::plain("navigator_mis_land_wp_inside_orbit_radius")];
        }
        MavCmd::MAV_CMD_NAV_LOITER_TO_ALT => (between * between - from.param2 * from.param2).sqrt(),
        _ => return vec![MissionEvent::plain("navigator_mis_unsupported_landing_approach_wp")],
    };
    let steepest = (LANDING_ANGLE_DEG + ROUNDING_DEG).to_radians().tan();
    if drop / run <= steepest {
        return Vec::new();
    }
    let (lower, longer) = ((steepest * run) as u32, (drop / steepest).ceil() as u32);
    vec![
        MissionEvent { name: "navigator_mis_glide_slope_too_steep", arguments: vec![5, 0] },
        MissionEvent {
            name: "navigator_mis_correct_glide_slope",
            arguments: [lower.to_le_bytes(), longer.to_le_bytes()].concat(),
        },
    ]
}

fn has_position(item: &MISSION_ITEM_INT_DATA) -> bool {
    item.frame != MavFrame::MAV_FRAME_MISSION
}

/// Above home, m.
fn height(item: &MISSION_ITEM_INT_DATA, home: &MISSION_ITEM_INT_DATA) -> f32 {
    #[allow(deprecated)]
    let above_sea = matches!(item.frame, MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT);
    if above_sea { item.z - home.z } else { item.z }
}

/// Over ground, m.
fn distance(a: &MISSION_ITEM_INT_DATA, b: &MISSION_ITEM_INT_DATA) -> f64 {
    let place = Geodetic::from_degrees(f64::from(a.x) * 1e-7, f64::from(a.y) * 1e-7, 0.0);
    let (r_n, r_e) = place.radii();
    let north = (f64::from(b.x) - f64::from(a.x)) * 1e-7_f64.to_radians() * r_n;
    let east = (f64::from(b.y) - f64::from(a.y)) * 1e-7_f64.to_radians() * r_e * cos(place.lat_rad);
    hypot(north, east)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The low 24 bits as PX4's own firmware sent them.
    #[test]
    fn events_have_px4s_identifiers() {
        for (name, id) in [
            ("navigator_mis_land_missing", 0x0181_1691),
            ("navigator_mis_glide_slope_too_steep", 0x0148_d925),
            ("navigator_mis_takeoff_missing", 0x0153_d6e2),
            ("navigator_mis_takeoff_too_low", 0x01ba_4a6d),
        ] {
            assert_eq!(MissionEvent::plain(name).id(), id, "{name}");
        }
    }

    fn item(command: MavCmd, north_m: f64, z: f32) -> MISSION_ITEM_INT_DATA {
        let frame = MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT;
        let (x, y) = (474_000_000 + (north_m * 89.95) as i32, 85_000_000);
        MISSION_ITEM_INT_DATA { command, frame, x, y, z, ..Default::default() }
    }

    fn said(items: &[MISSION_ITEM_INT_DATA], airframe: Airframe) -> Vec<&'static str> {
        let home = item(MavCmd::MAV_CMD_NAV_WAYPOINT, 0.0, 450.0);
        judge(items, airframe, &home).iter().map(|e| e.name).collect()
    }

    #[test]
    fn missions_are_judged_as_px4_does() {
        use Airframe::{FixedWing, Multirotor};
        use MavCmd::*;
        let up = item(MAV_CMD_NAV_TAKEOFF, 100.0, 50.0);
        let land = item(MAV_CMD_NAV_LAND, 0.0, 0.0);
        let gate = |north, z| item(MAV_CMD_NAV_WAYPOINT, north, z);
        let slope = ["navigator_mis_glide_slope_too_steep", "navigator_mis_correct_glide_slope"];
        let cases: Vec<(Vec<MISSION_ITEM_INT_DATA>, Airframe, Vec<&str>)> = vec![
            (vec![], FixedWing, vec![]),
            (vec![up.clone()], Multirotor, vec![]),
            (vec![up.clone()], FixedWing, vec!["navigator_mis_land_missing"]),
            (vec![up.clone(), gate(400.0, 40.0), land.clone()], FixedWing, slope.to_vec()),
            (vec![up.clone(), gate(460.0, 40.0), land.clone()], FixedWing, vec![]),
            (vec![up.clone(), gate(400.0, 40.0), land.clone()], Multirotor, vec![]),
            (vec![item(MAV_CMD_NAV_TAKEOFF, 0.0, 10.9)], Multirotor, vec!["navigator_mis_takeoff_too_low"]),
            (vec![gate(50.0, 40.0), up.clone()], Multirotor, vec!["navigator_mis_takeoff_not_first"]),
            (vec![gate(10_100.0, 40.0)], Multirotor, vec!["navigator_mis_first_wp_too_far"]),
            (
                vec![up.clone(), gate(460.0, -1.0), land.clone()],
                FixedWing,
                vec!["navigator_mis_approach_wp_below_land"],
            ),
            (
                vec![up.clone(), item(MAV_CMD_NAV_LOITER_UNLIM, 460.0, 40.0), land.clone()],
                FixedWing,
                vec!["navigator_mis_unsupported_landing_approach_wp"],
            ),
            (
                vec![
                    up,
                    MISSION_ITEM_INT_DATA { param2: -70.0, ..item(MAV_CMD_NAV_LOITER_TO_ALT, 60.0, 40.0) },
                    land,
                ],
                FixedWing,
                vec!["navigator_mis_land_wp_inside_orbit_radius"],
            ),
        ];
        for (items, airframe, expected) in cases {
            assert_eq!(said(&items, airframe), expected, "{items:?}");
        }
    }
}
