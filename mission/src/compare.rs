//! Comparison of a mission with what was read back from a vehicle, with the tolerance that its storage needs.
//!
//! ArduPilot stores an item in fifteen bytes: integers for most parameters, radii above 255 m in steps of 10 m, altitude in
//! centimetres, parameters that a vehicle type does not use not at all (FIELD_NOTES, "Mission protocol"). PX4 keeps floats but
//! drops parameters that a command does not have. Everything else that differs is a difference.

use crate::item::{Autopilot, Mission, MissionItem, command};
use gaware_nav::rotation::wrap_180;

/// Latitude and longitude after a trip through `double` on PX4: 2e-7 deg is 2 cm.
const POSITION_TOLERANCE_E7: u32 = 2;
/// ArduPilot stores centimetres; PX4 keeps a float.
const ALTITUDE_TOLERANCE_M: f32 = 0.02;
/// ArduPilot stores rally points in whole metres (AP_Rally.h, `RallyLocation::alt`).
const RALLY_STEP_M: f32 = 1.0;
/// Floats that are stored as floats.
const FLOAT_TOLERANCE: f32 = 1e-3;

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

/// How a parameter survives storage.
#[derive(Debug, Clone, Copy)]
enum Stored {
    /// Not kept, or of no meaning.
    Ignored,
    /// As a float.
    Float,
    /// As an integer, cut or rounded.
    Integer,
    /// As an integer, or not at all, depending on the type of vehicle.
    IntegerOrDropped,
    /// As [`Self::IntegerOrDropped`], but only its presence and sign matter.
    SignOnly,
    /// A radius with sign: integer metres up to 255, then tens.
    Radius,
    /// A direction in degrees, wrapped as the vehicle likes.
    Angle,
    /// A count up to 255; below 1 in steps of 1/256.
    Turns,
}

/// The storage of parameters 1 to 4 of a command.
fn storage(autopilot: Autopilot, number: u16) -> [Stored; 4] {
    use Stored::{Angle, Float, Ignored, Integer, IntegerOrDropped, Radius, SignOnly, Turns};
    match (autopilot, number) {
        (_, command::DO_CHANGE_SPEED) => [Float, Float, Float, Ignored],
        (_, command::DO_JUMP) => [Integer, Integer, Ignored, Ignored],
        (_, command::CONDITION_YAW) => [Float; 4],
        (_, command::NAV_RETURN_TO_LAUNCH | command::NAV_RALLY_POINT) => [Ignored; 4],
        // Number of corners, or radius in whole metres on older firmware; the group is not kept.
        (_, command::NAV_FENCE_RETURN_POINT..=command::NAV_FENCE_CIRCLE_EXCLUSION) => {
            [Integer, Ignored, Ignored, Ignored]
        }
        (Autopilot::ArduPilot, command::NAV_WAYPOINT) => {
            [IntegerOrDropped, IntegerOrDropped, IntegerOrDropped, Ignored]
        }
        (Autopilot::ArduPilot, command::NAV_LOITER_TURNS) => [Turns, Ignored, Radius, Ignored],
        (Autopilot::ArduPilot, command::NAV_LOITER_TIME) => [Integer, Ignored, SignOnly, Ignored],
        (Autopilot::ArduPilot, command::NAV_LOITER_UNLIM) => [Ignored, Ignored, Radius, Ignored],
        (Autopilot::ArduPilot, command::NAV_LOITER_TO_ALT) => [Ignored, Radius, Ignored, Ignored],
        (Autopilot::ArduPilot, command::NAV_TAKEOFF | command::NAV_LAND) => {
            [IntegerOrDropped, Ignored, Ignored, Ignored]
        }
        (Autopilot::ArduPilot, command::NAV_CONTINUE_AND_CHANGE_ALT) => [Integer, Ignored, Ignored, Ignored],
        (Autopilot::Px4, command::NAV_WAYPOINT) => [Float, Float, Ignored, Angle],
        // The pitch of a take-off and the abort height of a landing are not handed back.
        (Autopilot::Px4, command::NAV_TAKEOFF) => [Ignored, Ignored, Ignored, Angle],
        (Autopilot::Px4, command::NAV_LAND) => [Ignored, Integer, Ignored, Angle],
        (Autopilot::Px4, command::NAV_LOITER_TURNS) => [Float, Ignored, Float, Ignored],
        (Autopilot::Px4, command::NAV_LOITER_TIME) => [Float, Ignored, Float, Ignored],
        (Autopilot::Px4, command::NAV_LOITER_UNLIM) => [Ignored, Ignored, Float, Ignored],
        (Autopilot::Px4, command::NAV_LOITER_TO_ALT) => [Ignored, Float, Ignored, Ignored],
        _ => [Float; 4],
    }
}

fn same_parameter(kind: Stored, want: f32, got: f32) -> bool {
    // "The vehicle's default" is stored as zero by most commands.
    let (want, got) = (if want.is_nan() { 0.0 } else { want }, if got.is_nan() { 0.0 } else { got });
    let near = |tolerance: f32| (want - got).abs() <= tolerance;
    let float = near(FLOAT_TOLERANCE * want.abs().max(1.0));
    let same_sign = want == 0.0 || got == 0.0 || (want < 0.0) == (got < 0.0);
    match kind {
        Stored::Ignored => true,
        Stored::Float => float,
        // Cutting loses less than one.
        Stored::Integer => near(0.999_9),
        Stored::IntegerOrDropped => got == 0.0 || near(0.999_9),
        Stored::SignOnly => same_sign,
        Stored::Radius if want.abs() <= 255.0 => same_sign && near(0.999_9),
        Stored::Radius => same_sign && got != 0.0 && near(9.999),
        Stored::Angle => wrap_180(f64::from(want) - f64::from(got)).abs() < 0.01,
        Stored::Turns if want > 0.0 && want < 1.0 => near(1.0 / 256.0),
        Stored::Turns => (want.clamp(0.0, 255.0) - got).abs() < 1.0,
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
    let mut found = Vec::new();
    let name = command::describe(want.command);
    for (k, kind) in storage(autopilot, want.command).into_iter().enumerate() {
        if !same_parameter(kind, want.params[k], got.params[k]) {
            found.push(format!(
                "{name}, parameter {}: {} expected, the vehicle has {}",
                k + 1,
                want.params[k],
                got.params[k]
            ));
        }
    }
    if command::has_position(want.command) {
        // Unset is stored as zero.
        let set = |v: i32| if v == i32::MAX { 0 } else { v };
        let off = set(want.x).abs_diff(set(got.x)).max(set(want.y).abs_diff(set(got.y)));
        if off > POSITION_TOLERANCE_E7 {
            found.push(format!(
                "{name}, position: {:.7} {:.7} expected, the vehicle has {:.7} {:.7}",
                f64::from(want.x) * 1e-7,
                f64::from(want.y) * 1e-7,
                f64::from(got.x) * 1e-7,
                f64::from(got.y) * 1e-7
            ));
        }
    }
    if command::has_altitude(want.command) {
        let step = match (autopilot, want.command) {
            (Autopilot::ArduPilot, command::NAV_RALLY_POINT) => RALLY_STEP_M,
            _ => ALTITUDE_TOLERANCE_M,
        };
        let tolerance = step.max(want.z.abs() * 1e-6);
        if want.z.is_nan() != got.z.is_nan() && got.z != 0.0 || (want.z - got.z).abs() > tolerance {
            found.push(format!("{name}, altitude: {} m expected, the vehicle has {} m", want.z, got.z));
        }
        let same_reference = want.frame.altitude_reference() == got.frame.altitude_reference();
        if command::has_position(want.command) && !same_reference {
            found.push(format!(
                "{name}: altitude above {:?} expected, the vehicle has {:?}",
                want.frame.altitude_reference(),
                got.frame.altitude_reference()
            ));
        }
    }
    // ArduPilot has no such field and always answers 1.
    if autopilot == Autopilot::Px4 && want.autocontinue != got.autocontinue {
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
            stored.z = 99.99;
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
            (at(command::NAV_TAKEOFF, [15.0, 0.0, 0.0, f32::NAN]), at(command::NAV_TAKEOFF, [0.0; 4])),
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

    #[test]
    fn a_missing_item_is_named() {
        let found = differences(Autopilot::Px4, &one(loiter(1.0, 50.0)), &Mission::default());
        assert_eq!(found[0].to_string(), "1 items expected, the vehicle has 0");
    }
}
