//! Comparison of a mission with what was read back from a vehicle, by what its firmware keeps ([`crate::rules::table`]): a field is right as
//! it was sent or as the firmware stores it. Everything else is a difference.

use crate::item::{Autopilot, Mission, MissionItem, command};
use crate::rules::table::{self, AutoContinue, Kept, Row};
use gaware_nav::rotation::wrap_180;

/// Floats that are stored as floats, and centimetres that become metres again: a few steps of a float.
const FLOAT_TOLERANCE: f32 = 1e-6;
/// PX4 keeps headings as radians in a float, deg.
const HEADING_TOLERANCE_DEG: f64 = 1e-3;

/// One difference, in words.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// Item, counted from 1 without home; `None` where it is about the mission.
    pub item: Option<usize>,
    /// What differs.
    pub text: String,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.item {
            Some(n) => write!(f, "item {n}: {}", self.text),
            None => f.write_str(&self.text),
        }
    }
}

fn same_number(a: f32, b: f32) -> bool {
    a.is_nan() && b.is_nan() || (a - b).abs() <= FLOAT_TOLERANCE * a.abs().max(1.0)
}

fn same_parameter(rule: Option<Kept>, want: f32, got: f32) -> bool {
    match rule {
        Some(Kept::Heading) if want.is_nan() || got.is_nan() => want.is_nan() && got.is_nan(),
        Some(Kept::Heading) => wrap_180(f64::from(want) - f64::from(got)).abs() < HEADING_TOLERANCE_DEG,
        // "The vehicle's default" is stored as zero by most commands.
        _ if want.is_nan() && got == 0.0 => true,
        Some(rule) => same_number(want, got) || same_number(rule.keep(want), got),
        None => same_number(want, got),
    }
}

/// Whether this autopilot stores both items alike.
pub fn same_item(autopilot: Autopilot, want: &MissionItem, got: &MissionItem) -> bool {
    compare_items(autopilot, want, got).is_empty()
}

fn compare_items(autopilot: Autopilot, want: &MissionItem, got: &MissionItem) -> Vec<String> {
    if want.command != got.command {
        return vec![format!(
            "{} expected, the vehicle has {}",
            command::describe(want.command),
            command::describe(got.command)
        )];
    }
    // Plane and copter, and some versions, keep different parameters.
    let by_row =
        table::rows_of(want.command, autopilot).map(|row| compare_by(Some(row), autopilot, want, got));
    by_row.min_by_key(Vec::len).unwrap_or_else(|| compare_by(None, autopilot, want, got))
}

/// What differs by one version's rules; without rules everything has to be as it was sent.
fn compare_by(row: Option<&Row>, autopilot: Autopilot, want: &MissionItem, got: &MissionItem) -> Vec<String> {
    let sent = want.sent_to(autopilot);
    let kept = row.map_or(sent, |r| r.keep(&sent));
    let right = [want, &sent, &kept];
    let name = command::describe(want.command);
    let mut found = Vec::new();
    for (k, (want, got)) in want.params.into_iter().zip(got.params).enumerate() {
        if !same_parameter(row.and_then(|r| r.kept.get(k).copied()), want, got) {
            found.push(format!("{name}, parameter {}: {want} expected, the vehicle has {got}", k + 1));
        }
    }
    if command::has_position(want.command) && !right.iter().any(|i| (i.x, i.y) == (got.x, got.y)) {
        let degrees = |v: i32| f64::from(v) * 1e-7;
        found.push(format!(
            "{name}, position: {:.7} {:.7} expected, the vehicle has {:.7} {:.7}",
            degrees(want.x),
            degrees(want.y),
            degrees(got.x),
            degrees(got.y)
        ));
    }
    if command::has_altitude(want.command) {
        let unset = want.z.is_nan() && got.z == 0.0;
        if !unset && !right.iter().any(|i| same_number(i.z, got.z)) {
            found.push(format!("{name}, altitude: {} m expected, the vehicle has {} m", want.z, got.z));
        }
        let has = got.frame.altitude_reference();
        let counted = right.iter().any(|i| i.frame.altitude_reference() == has);
        if command::has_position(want.command) && !counted {
            let wanted = want.frame.altitude_reference();
            found.push(format!("{name}: altitude above {wanted:?} expected, the vehicle has {has:?}"));
        }
    }
    // Of a command that is not in the table nothing but ArduPilot's habit is known.
    let rule = row.map_or(AutoContinue::of(autopilot), |r| r.autocontinue);
    if got.autocontinue != want.autocontinue && got.autocontinue != rule.keep(want.autocontinue) {
        found.push(format!("{name}: autocontinue differs"));
    }
    found
}

/// What differs between the mission wanted and the one read back; empty: the vehicle has it.
///
/// Home is left out: ArduPilot writes its own there.
pub fn differences(autopilot: Autopilot, want: &Mission, got: &Mission) -> Vec<Difference> {
    let mut found = Vec::new();
    if want.items.len() != got.items.len() {
        found.push(Difference {
            item: None,
            text: format!("{} items expected, the vehicle has {}", want.items.len(), got.items.len()),
        });
    }
    for (k, (w, g)) in want.items.iter().zip(&got.items).enumerate() {
        found.extend(
            compare_items(autopilot, w, g).into_iter().map(|text| Difference { item: Some(k + 1), text }),
        );
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::item::{Frame, LatLon};

    const PLACE: LatLon = LatLon { lat_deg: 47.4, lon_deg: 8.55 };

    fn one(item: MissionItem) -> Mission {
        Mission { home: None, items: vec![item] }
    }

    fn loiter(turns: f32, radius: f32) -> MissionItem {
        MissionItem::at(command::NAV_LOITER_TURNS, [turns, 0.0, radius, f32::NAN], PLACE, 100.0)
    }

    #[test]
    fn rounding_of_ardupilot_is_no_difference() {
        for (want, got) in
            [((2.0, 257.0), (2.0, 250.0)), ((3.0, -80.4), (3.0, -80.0)), ((0.5, 60.0), (0.5, 60.0))]
        {
            let mut stored = loiter(got.0, got.1);
            stored.params[3] = 0.0;
            stored.frame = Frame::GLOBAL_RELATIVE_ALT;
            stored.autocontinue = true;
            let found = differences(Autopilot::ArduPilot, &one(loiter(want.0, want.1)), &one(stored));
            assert_eq!(found, vec![]);
        }
    }

    #[test]
    fn px4_keeps_radii_exactly() {
        let found = differences(Autopilot::Px4, &one(loiter(2.0, 257.0)), &one(loiter(2.0, 250.0)));
        assert_eq!(
            found[0].to_string(),
            "item 1: loiter turns, parameter 3: 257 expected, the vehicle has 250"
        );
    }

    #[test]
    fn px4_wraps_headings_and_forgets_the_pitch_of_a_take_off() {
        let at = |number, params| one(MissionItem::at(number, params, PLACE, 50.0));
        let pairs = [
            (
                at(command::NAV_WAYPOINT, [0.0, 0.0, 0.0, -90.0]),
                at(command::NAV_WAYPOINT, [0.0, 0.0, 0.0, 270.0]),
            ),
            (
                at(command::NAV_TAKEOFF, [15.0, 0.0, 0.0, f32::NAN]),
                at(command::NAV_TAKEOFF, [0.0, 0.0, 0.0, f32::NAN]),
            ),
        ];
        for (want, got) in pairs {
            assert_eq!(differences(Autopilot::Px4, &want, &got), vec![]);
        }
        let turned = at(command::NAV_WAYPOINT, [0.0, 0.0, 0.0, 90.0]);
        let straight = at(command::NAV_WAYPOINT, [0.0; 4]);
        assert_eq!(differences(Autopilot::Px4, &turned, &straight).len(), 1);
    }

    #[test]
    fn real_differences_are_named() {
        let cases: [(MissionItem, &str); 5] = [
            (loiter(2.0, -100.0), "parameter 3"),
            (loiter(4.0, 100.0), "parameter 1"),
            (MissionItem { x: loiter(2.0, 100.0).x + 50, ..loiter(2.0, 100.0) }, "position"),
            (MissionItem { z: 101.0, ..loiter(2.0, 100.0) }, "altitude"),
            (
                MissionItem { command: command::NAV_WAYPOINT, ..loiter(2.0, 100.0) },
                "the vehicle has waypoint",
            ),
        ];
        for (got, word) in cases {
            let found = differences(Autopilot::ArduPilot, &one(loiter(2.0, 100.0)), &one(got));
            assert!(found.iter().any(|d| d.to_string().contains(word)), "{word}: {found:?}");
        }
    }

    /// PX4 reads fence points back without autocontinue, as above sea level (mavlink_mission.cpp:325); no plan with a fence could be uploaded.
    #[test]
    fn a_fence_is_compared_by_what_each_firmware_keeps() {
        let sent = MissionItem::at(command::NAV_FENCE_CIRCLE_INCLUSION, [60.5, 0.0, 0.0, 0.0], PLACE, 0.0);
        for (autopilot, frame) in [(Autopilot::Px4, Frame::GLOBAL_INT), (Autopilot::ArduPilot, Frame::GLOBAL)]
        {
            let stored = MissionItem { autocontinue: false, frame, ..sent };
            assert_eq!(differences(autopilot, &one(sent), &one(stored)), vec![], "{autopilot}");
            let smaller = MissionItem { params: [59.0, 0.0, 0.0, 0.0], ..stored };
            assert_eq!(differences(autopilot, &one(sent), &one(smaller)).len(), 1, "{autopilot}");
        }
        // A mission's items keep it on PX4.
        let sent = MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], PLACE, 50.0);
        let halts = MissionItem { autocontinue: false, ..sent };
        let found = differences(Autopilot::Px4, &one(sent), &one(halts));
        assert_eq!(found[0].to_string(), "item 1: waypoint: autocontinue differs");
    }

    /// A journal compares a mission with itself, which no vehicle has cut.
    #[test]
    fn a_mission_is_like_itself() {
        let item = MissionItem { x: i32::MAX, z: 25.3716, ..loiter(0.3, 257.3) };
        for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
            assert_eq!(differences(autopilot, &one(item), &one(item)), vec![]);
        }
    }

    #[test]
    fn a_missing_item_is_named() {
        let found = differences(Autopilot::Px4, &one(loiter(1.0, 50.0)), &Mission::default());
        assert_eq!(found[0].to_string(), "1 items expected, the vehicle has 0");
    }
}
