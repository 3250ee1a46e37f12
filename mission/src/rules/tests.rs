//! Expectations are literals from the firmware's source, not from the table.

use super::*;
use crate::item::{Frame, Home, LatLon};
use Autopilot::{ArduPilot, Px4};
use Kind::{FixedWing, Multirotor};

const PLACE: LatLon = LatLon { lat_deg: 47.4, lon_deg: 8.55 };
const HOME: Home = Home { lat_e7: 474_000_000, lon_e7: 85_500_000, alt_m: 450.0 };
const NAN: f32 = f32::NAN;

fn at(number: u16, params: [f32; 4]) -> MissionItem {
    MissionItem::at(number, params, PLACE, 50.0)
}

fn judged(items: Vec<MissionItem>, autopilot: Autopilot, kind: Kind) -> Result<Vec<Rewrite>, String> {
    let mission = Mission { home: Some(HOME), items };
    check(&mission, None, autopilot, kind).map_err(|e| e.to_string())
}

/// `AP_Mission::sanity_check_params`.
#[test]
fn ardupilot_takes_nan_in_few_places_and_infinity_nowhere() {
    for number in [16, 17, 18, 19, 21, 22, 30, 31, 112, 115, 178, 206] {
        for k in 0..4 {
            for value in [NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let mut params = [1.0, 20.0, 0.0, 0.0];
                params[k] = value;
                let refused = judged(vec![at(number, params)], ArduPilot, FixedWing);
                let may = value.is_nan() && k == 3 && [16, 21, 22].contains(&number);
                assert_eq!(refused.is_ok(), may, "command {number}, parameter {}: {refused:?}", k + 1);
                if let Err(text) = refused {
                    assert!(text.contains(&format!("command {number}")), "{text}");
                    assert!(text.contains(&format!("{value} in parameter {}", k + 1)), "{text}");
                }
            }
        }
    }
}

#[test]
fn a_refusal_names_item_command_parameter_value_and_remedy() {
    let items = vec![at(22, [10.0, 0.0, 0.0, 0.0]), at(31, [0.0, 60.0, 0.0, NAN])];
    assert_eq!(
        judged(items, ArduPilot, FixedWing),
        Err("item 2 (loiter to altitude, command 31): ArduPlane refuses NaN in parameter 4: write a number; 0 is the vehicle's default".to_owned())
    );
    let low = MissionItem { z: NAN, ..at(16, [0.0; 4]) };
    let refused = judged(vec![low], ArduPilot, Multirotor);
    assert!(refused.is_err_and(|e| e.contains("ArduCopter refuses NaN in parameter 7")));
    let local = MissionItem { frame: Frame(1), ..at(16, [0.0; 4]) };
    let refused = judged(vec![local], ArduPilot, FixedWing);
    assert_eq!(
        refused,
        Err("item 1 (waypoint, command 16): ArduPlane refuses frame 1; write it in frame 3".to_owned())
    );
    let jump = MissionItem::action(177, [5.0, 1.0, 0.0, 0.0]);
    assert!(judged(vec![jump], ArduPilot, FixedWing).is_err_and(|e| e.contains("jump goes to an item")));
}

#[test]
fn a_plan_for_the_other_autopilot_is_refused_by_name() {
    let circle = vec![at(22, [0.0; 4]), at(18, [1.0, 0.0, 60.0, 0.0])];
    let refused = judged(circle.clone(), Px4, FixedWing);
    assert_eq!(
        refused,
        Err("item 2 (loiter turns, command 18): PX4 does not take this command in missions; the plan seems to be for ArduPilot: make it again for PX4".to_owned())
    );
    let mission = Mission { home: Some(HOME), items: circle };
    for (made_for, vehicle, words) in [
        (ArduPilot, Px4, "this plan is for ArduPilot, the vehicle runs PX4"),
        (Px4, ArduPilot, "this plan is for PX4, the vehicle runs ArduPilot"),
    ] {
        let refused = check(&mission, Some(made_for), vehicle, FixedWing).map_err(|e| e.to_string());
        assert!(refused.is_err_and(|e| e.starts_with(words)));
    }
    assert!(check(&mission, Some(ArduPilot), ArduPilot, FixedWing).is_ok());
}

/// `mavlink_int_to_mission_cmd` and `mission_cmd_to_mavlink_int`; PX4: `parse_mavlink_mission_item` and
/// `format_mavlink_mission_item`, and FIELD_NOTES, "PX4's own firmware, measured".
#[test]
fn what_is_kept_is_what_the_firmware_reads_back() {
    use Firmware::{ArduCopter, ArduPlane, Px4};
    let cases: &[(Firmware, u16, [f32; 4], [f32; 4])] = &[
        (ArduPlane, 16, [3.0, 20.7, 300.0, NAN], [0.0, 20.0, 255.0, 0.0]),
        (ArduCopter, 16, [3.7, 20.7, 1.0, 90.0], [3.0, 0.0, 0.0, 0.0]),
        (Px4, 16, [3.5, 4.5, 9.0, -90.0], [3.5, 4.5, 0.0, 270.0]),
        (Px4, 16, [0.0, 0.0, 0.0, NAN], [0.0, 0.0, 0.0, NAN]),
        (ArduPlane, 17, [1.0, 2.0, -307.9, 0.0], [0.0, 0.0, -307.0, 0.0]),
        (Px4, 17, [1.0, 2.0, -307.9, NAN], [0.0, 0.0, -307.9, NAN]),
        (ArduPlane, 18, [300.0, 0.0, -307.9, 1.0], [255.0, 0.0, -300.0, 1.0]),
        (ArduPlane, 18, [2.9, 0.0, 255.0, 0.0], [2.0, 0.0, 255.0, 0.0]),
        (ArduPlane, 18, [0.5, 0.0, 80.9, 0.0], [0.5, 0.0, 80.0, 0.0]),
        (ArduPlane, 18, [1.0, 0.0, 9999.0, 0.0], [1.0, 0.0, 2550.0, 0.0]),
        (ArduPlane, 19, [30.9, 1.0, -80.0, 0.5], [30.0, 0.0, -1.0, 1.0]),
        (ArduPlane, 19, [30.0, 0.0, 0.0, 0.0], [30.0, 0.0, 1.0, 0.0]),
        (Px4, 19, [30.5, 1.0, -80.5, NAN], [30.5, 1.0, -80.5, 0.0]),
        (ArduPlane, 21, [30.0, 1.0, 1.0, NAN], [30.0, 0.0, 0.0, 1.0]),
        (Px4, 21, [30.0, 2.0, 1.0, NAN], [0.0, 2.0, 0.0, NAN]),
        (ArduPlane, 22, [12.9, 1.0, 1.0, NAN], [12.0, 0.0, 0.0, 0.0]),
        (Px4, 22, [12.0, 1.0, 1.0, NAN], [0.0, 0.0, 0.0, NAN]),
        (ArduPlane, 31, [1.0, -307.9, 0.0, 2.0], [0.0, -307.0, 0.0, 1.0]),
        (Px4, 31, [0.0, -307.9, 5.0, NAN], [0.0, -307.9, 0.0, 0.0]),
        (ArduCopter, 115, [90.5, 30.5, -1.0, 1.0], [90.5, 30.5, -1.0, 1.0]),
        (ArduPlane, 178, [0.0, 21.5, -1.0, 7.0], [0.0, 21.5, -1.0, 0.0]),
        (Px4, 178, [0.0, 21.5, -1.0, 7.0], [0.0, 21.5, -1.0, 7.0]),
    ];
    for (firmware, number, sent, kept) in cases {
        let stored = stored_item(&at(*number, *sent), *firmware).params;
        let same = stored.iter().zip(kept).all(|(a, b)| a == b || a.is_nan() && b.is_nan());
        assert!(same, "{firmware:?} {number} {sent:?}: {stored:?}, not {kept:?}");
    }
}

#[test]
fn frames_and_altitudes_are_read_back_as_the_firmware_keeps_them() {
    let speed = MissionItem { x: 7, z: 5.0, ..MissionItem::action(178, [0.0, 20.0, -1.0, 0.0]) };
    let kept = stored_item(&speed, Firmware::ArduPlane);
    assert_eq!((kept.frame, kept.x, kept.z), (Frame(0), 0, 0.0));
    let kept = stored_item(&speed, Firmware::Px4);
    assert_eq!((kept.frame, kept.x, kept.z), (Frame(2), 7, 5.0));
    let place = MissionItem { frame: Frame(3), z: 50.126, ..at(16, [0.0; 4]) };
    let kept = stored_item(&place, Firmware::ArduPlane);
    assert_eq!(kept.frame, Frame(3));
    assert!((kept.z - 50.12).abs() < 1e-5);
    assert_eq!(stored_item(&place, Firmware::Px4).frame, Frame(6));
    assert_eq!(stored_item(&place, Firmware::Px4).z, 50.126);
}

/// A backup restored a hundred times stays what it was; without care some altitudes lose 1 cm each time.
#[test]
fn altitudes_survive_any_number_of_trips() {
    for cm in (-10_000..200_000).step_by(7) {
        let first = surviving_altitude((f64::from(cm) / 100.0) as f32);
        let once = centimetres(first);
        let mut again = once;
        for _ in 0..3 {
            again = centimetres(surviving_altitude(again));
        }
        assert_eq!(((f64::from(once) * 100.0).round(), again), (f64::from(cm), once), "{cm} cm");
    }
    // The defect that this is about.
    assert!(centimetres(16.05) < 16.045);
}

#[test]
fn rewrites_are_told() {
    let found = judged(vec![at(19, [30.0, 0.0, -80.0, 0.0])], ArduPilot, FixedWing);
    let texts: Vec<String> = found.unwrap_or_default().iter().map(ToString::to_string).collect();
    assert_eq!(texts, ["item 1 (loiter time): parameter 3 is kept as -1 instead of -80"]);
}

fn climb() -> MissionItem {
    at(22, [0.0, 0.0, 0.0, NAN])
}

fn approach(distance_m: f64, height_m: f32) -> Vec<MissionItem> {
    let lat_deg = PLACE.lat_deg + distance_m / 111_180.0;
    let gate = MissionItem::at(16, [0.0, 0.0, 0.0, NAN], LatLon { lat_deg, ..PLACE }, height_m);
    vec![climb(), gate, MissionItem { z: 0.0, ..at(21, [0.0, 0.0, 0.0, NAN]) }]
}

/// `FeasibilityChecker.cpp`; 0.1 was the slope that PX4's own firmware rejected.
#[test]
fn px4_judges_a_mission_after_it_has_taken_it() {
    let refused = |items, kind| judged(items, Px4, kind).expect_err("refused");
    assert!(refused(vec![climb()], FixedWing).contains("needs a landing"));
    assert_eq!(judged(vec![climb()], Px4, Multirotor), Ok(vec![]));
    assert!(refused(approach(400.0, 40.0), FixedWing).contains("at 5.7°, FW_LND_ANG allows 5.0°"));
    assert!(judged(approach(500.0, 40.0), Px4, FixedWing).is_ok());
    let low = MissionItem { z: 10.9, ..climb() };
    assert!(refused(vec![low], Multirotor).contains("NAV_ACC_RAD asks for 11.0 m"));
    assert!(refused(vec![at(16, [0.0; 4]), climb()], Multirotor).contains("before every other place"));
    assert!(refused(vec![at(21, [0.0; 4])], Multirotor).contains("begins with its landing"));
    let mut held = approach(500.0, 40.0);
    held[1].command = command::NAV_LOITER_UNLIM;
    assert!(refused(held, FixedWing).contains("must follow a waypoint"));
    let far = MissionItem { x: PLACE.to_e7().0 + 1_000_000, ..climb() };
    assert!(refused(vec![far], Multirotor).contains("MIS_DIST_1WP"));
}

#[test]
fn every_command_that_a_plan_can_have_is_in_the_table_for_everybody() {
    for number in document::PLANNED {
        for firmware in Firmware::ALL {
            assert!(table::row(number, firmware).is_some(), "{number} {firmware:?}");
        }
    }
}

#[test]
fn the_documentation_shows_the_table() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/firmware-rules.md");
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, document::page()).expect("docs can be written");
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(written == document::page(), "UPDATE_DOCS=1 cargo test -p gaware-mission --lib rules");
}
