//! PX4's verdict on a mission that it has accepted: it checks the mission after the acknowledgement and says what is wrong in `EVENT` (410) alone.
//!
//! The low 24 bits of an event's id are the FNV-1a hash of its name (PX4, `src/lib/events`); the names and their arguments are those of
//! PX4's `src/modules/navigator/MissionFeasibility/FeasibilityChecker.cpp`, release 1.16.

/// Arguments of an event, as many bytes as the message holds.
pub const ARGUMENTS: usize = 40;
/// The bits of an id that name the event; the others name the component.
const NAME_BITS: u32 = 0xFF_FFFF;

/// The low 24 bits of an id (FNV-1a, 32 bits, truncated).
const fn id(name: &str) -> u32 {
    let bytes = name.as_bytes();
    let mut hash = 0x811C_9DC5_u32;
    let mut k = 0;
    while k < bytes.len() {
        hash = (hash ^ bytes[k] as u32).wrapping_mul(0x0100_0193);
        k += 1;
    }
    hash & NAME_BITS
}

/// A check that a mission has not passed; `{1u16}` in the words is the first argument, an integer of 16 bits.
const REJECTIONS: [(u32, &str); 26] = [
    (id("navigator_mis_land_missing"), "a landing is required (MIS_TKO_LAND_REQ)"),
    (
        id("navigator_mis_glide_slope_too_steep"),
        "the glide slope of the landing is steeper than {1u8}.{2u8} degrees (FW_LND_ANG)",
    ),
    (
        id("navigator_mis_correct_glide_slope"),
        "lower the entrance of the landing to {1u32} m, or lengthen the approach to {2u32} m",
    ),
    (id("navigator_mis_takeoff_missing"), "a take-off is required (MIS_TKO_LAND_REQ)"),
    (id("navigator_mis_takeoff_too_low"), "the take-off is too low; it must go to {1f32} m at least"),
    // Measured on PX4 1.16 in flight; the name is not known.
    (0x2B_5FF0, "a landing is required while the vehicle is in the air"),
    (id("navigator_mis_takeoff_or_land_missing"), "a take-off or a landing is missing (MIS_TKO_LAND_REQ)"),
    (id("navigator_mis_add_land_or_rm_to"), "it has a take-off and no landing (MIS_TKO_LAND_REQ)"),
    (id("navigator_mis_add_to_or_rm_land"), "it has a landing and no take-off (MIS_TKO_LAND_REQ)"),
    (id("navigator_mis_takeoff_not_first"), "the take-off is not the first waypoint"),
    (id("navigator_mis_unsup_cmd"), "item {1u16} has the command {2u16}, which is not supported"),
    (id("navigator_mis_act_index"), "actuator number {1u32} is out of bounds"),
    (id("navigator_mis_act_range"), "actuator value {1u32} is out of bounds"),
    (id("navigator_mis_starts_w_landing"), "it starts with a landing"),
    (id("navigator_mis_starts_w_landing2"), "it starts with a landing"),
    (id("navigator_mis_approach_wp_below_land"), "the waypoint before the landing is not above it"),
    (id("navigator_mis_land_wp_inside_orbit_radius"), "the landing lies inside the circle before it"),
    (
        id("navigator_mis_unsupported_landing_approach_wp"),
        "only a waypoint or a loiter to altitude may come before a landing",
    ),
    (id("navigator_mis_multiple_land"), "it has more than one start of a landing"),
    (id("navigator_mis_land_before_rtl"), "a start of a landing comes before a return to launch"),
    (id("navigator_mis_invalid_land"), "no landing follows the start of a landing"),
    (
        id("navigator_mis_first_wp_too_far"),
        "the first waypoint is {1u32} m from home, more than {2u32} m (MIS_DIST_1WP)",
    ),
    (
        id("navigator_mis_wp_dist_too_far"),
        "two waypoints are {1u32} m apart, more than {2u32} m (MIS_DIST_WPS)",
    ),
    (id("navigator_mis_wp_gate_too_close"), "a waypoint and a gate are at the same place"),
    (
        id("navigator_mis_no_home_rel_alt"),
        "the vehicle has no home position, and waypoint {1u16} has an altitude above home",
    ),
    (id("navigator_mis_geofence_violation"), "waypoint {1u16} lies outside of the geofence"),
];

/// Why the mission is rejected, if this event says that it is.
pub fn rejection(event_id: u32, arguments: &[u8; ARGUMENTS]) -> Option<String> {
    let (_, words) = REJECTIONS.iter().find(|(id, _)| *id == event_id & NAME_BITS)?;
    Some(filled(words, arguments))
}

/// The words with the arguments, which lie in the message one after the other, little-endian.
fn filled(words: &str, arguments: &[u8; ARGUMENTS]) -> String {
    let mut text = String::new();
    let mut bytes = arguments.iter().copied();
    let mut rest = words;
    while let Some((before, after)) = rest.split_once('{') {
        let Some((argument, after)) = after.split_once('}') else { break };
        text.push_str(before);
        let mut next = || bytes.next().unwrap_or(0);
        let value = match argument.trim_start_matches(|c: char| c.is_ascii_digit()) {
            "u8" => next().to_string(),
            "u16" => u16::from_le_bytes([next(), next()]).to_string(),
            "u32" => u32::from_le_bytes([next(), next(), next(), next()]).to_string(),
            _ => format!("{:.1}", f32::from_le_bytes([next(), next(), next(), next()])),
        };
        text.push_str(&value);
        rest = after;
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(event_id: u32, arguments: &[u8]) -> Option<String> {
        let mut all = [0; ARGUMENTS];
        all[..arguments.len()].copy_from_slice(arguments);
        rejection(event_id, &all)
    }

    /// Ids as they came from PX4's own firmware, with the component's byte before them.
    #[test]
    fn the_ids_measured_on_the_firmware_are_named() {
        for (event_id, words) in [
            (0x0181_1691, "a landing is required"),
            (0x0148_d925, "steeper than 5.0 degrees"),
            (0x0153_d6e2, "a take-off is required"),
            (0x01ba_4a6d, "the take-off is too low"),
            (0x012b_5ff0, "a landing is required while the vehicle is in the air"),
        ] {
            let text = said(event_id, &[5, 0, 0, 0]).expect("named");
            assert!(text.contains(words), "{text}");
        }
        assert_eq!(said(0x0100_1234, &[]), None);
    }

    #[test]
    fn arguments_follow_one_another() {
        let text = said(id("navigator_mis_unsup_cmd"), &[7, 0, 18, 0]);
        assert_eq!(text.as_deref(), Some("item 7 has the command 18, which is not supported"));
        let text = said(id("navigator_mis_takeoff_too_low"), &11.0_f32.to_le_bytes());
        assert_eq!(text.as_deref(), Some("the take-off is too low; it must go to 11.0 m at least"));
    }
}
