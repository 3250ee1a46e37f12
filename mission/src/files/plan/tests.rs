use super::*;
use crate::files::waypoints;
use proptest::prelude::*;

/// Hand-written after the published format: take-off, speed, loiter, a survey with its simple items, a jump back.
const SAMPLE: &str = r#"{
    "fileType": "Plan",
    "geoFence": {
        "circles": [{"circle": {"center": [47.397, 8.546], "radius": 500}, "inclusion": true, "version": 1}],
        "polygons": [{"inclusion": false, "polygon": [[47.39, 8.54], [47.391, 8.54], [47.391, 8.541]], "version": 1}],
        "version": 2
    },
    "groundStation": "QGroundControl",
    "mission": {
        "cruiseSpeed": 18, "firmwareType": 12, "globalPlanAltitudeMode": 1, "hoverSpeed": 5,
        "items": [
            {"AMSLAltAboveTerrain": null, "Altitude": 50, "AltitudeMode": 1, "autoContinue": true, "command": 22,
             "doJumpId": 1, "frame": 3, "params": [15, 0, 0, null, 47.3977418, 8.5455938, 50], "type": "SimpleItem"},
            {"autoContinue": true, "command": 178, "doJumpId": 2, "frame": 2,
             "params": [0, 21.5, -1, 0, 0, 0, 0], "type": "SimpleItem"},
            {"type": "ComplexItem", "complexItemType": "survey", "version": 5, "TransectStyleComplexItem": {
                "Items": [
                    {"autoContinue": true, "command": 16, "doJumpId": 3, "frame": 3,
                     "params": [0, 0, 0, null, 47.398, 8.546, 60], "type": "SimpleItem"},
                    {"autoContinue": true, "command": 16, "doJumpId": 4, "frame": 3,
                     "params": [0, 0, 0, null, 47.399, 8.547, 60], "type": "SimpleItem"}],
                "CameraShots": 0}},
            {"autoContinue": true, "command": 177, "doJumpId": 7, "frame": 2,
             "params": [3, 2, 0, 0, 0, 0, 0], "type": "SimpleItem"}
        ],
        "plannedHomePosition": [47.3977419, 8.5455939, 488.5], "vehicleType": 1, "version": 2
    },
    "rallyPoints": {"points": [[47.397, 8.545, 50]], "version": 2},
    "version": 1
}"#;

#[test]
fn reads_what_qgroundcontrol_writes_and_expands_surveys() {
    let plan = read(SAMPLE).expect("published format");
    let commands: Vec<u16> = plan.mission.items.iter().map(|i| i.command).collect();
    assert_eq!(commands, [22, 178, 16, 16, 177]);
    assert!(plan.mission.items[0].params[3].is_nan(), "null is NaN");
    assert_eq!(plan.mission.items[0].x, 473_977_418);
    assert_eq!(plan.mission.items[4].params[0], 3.0);
    assert_eq!(plan.mission.home.map(|h| h.alt_m), Some(488.5));
    assert_eq!((plan.fence.circles[0].radius_m, plan.fence.polygons[0].inclusion), (500.0, false));
    assert_eq!(plan.rally_points.len(), 1);
}

#[test]
fn a_complex_item_without_simple_ones_is_refused_with_a_remedy() {
    let text = SAMPLE.replace("TransectStyleComplexItem", "Other").replace("survey", "fwLandingPattern");
    let error = read(&text).expect_err("cannot be flown").to_string();
    assert_eq!(
        error,
        "mission item 3: the complex item \"fwLandingPattern\" holds no simple items; replace it by waypoints in \
         QGroundControl"
    );
}

#[test]
fn mistakes_are_named_with_their_place() {
    let cases = [
        (SAMPLE.replace("\"Plan\"", "\"Parameters\""), "fileType is \"Parameters\""),
        (SAMPLE.replace("\"version\": 1\n}", "\"version\": 3\n}"), "the file has version 3"),
        (
            SAMPLE.replace("[15, 0, 0, null, 47.3977418, 8.5455938, 50]", "[15, 0]"),
            "item 1: 7 params expected, found 2",
        ),
        (SAMPLE.replace("[3, 2, 0", "[9, 2, 0"), "item 4: it jumps to item 9"),
        (SAMPLE.replace("47.3977418", "147.3977418"), "item 1: 147.3977418 is no latitude"),
        (
            SAMPLE.replace("\"radius\": 500", "\"radius\": -5"),
            "geofence circle 1: the radius must be positive",
        ),
        (SAMPLE.replace("\"cruiseSpeed\": 18", "\"cruiseSpeed\": \"fast\""), "line 10, column"),
    ];
    for (text, message) in cases {
        let error = read(&text).expect_err(message).to_string();
        assert!(error.contains(message), "{error}");
    }
}

fn item() -> impl Strategy<Value = MissionItem> {
    let float = || prop_oneof![Just(f32::NAN), -1e4..1e4f32, Just(0.1f32)];
    let global = (
        prop_oneof![Just(16u16), Just(18), Just(31), Just(22)],
        prop_oneof![Just(0u8), Just(3), Just(10)],
        [float(), float(), float(), float()],
        -900_000_000..900_000_000i32,
        -1_800_000_000..1_800_000_000i32,
        -500.0..9000.0f32,
    );
    let action =
        (prop_oneof![Just(178u16), Just(115), Just(206)], [float(), float(), float(), float()], any::<i16>());
    prop_oneof![
        (global, any::<bool>()).prop_map(|((command, frame, params, x, y, z), autocontinue)| MissionItem {
            command,
            frame: Frame(frame),
            autocontinue,
            params,
            x,
            y,
            z
        }),
        action.prop_map(|(command, params, x)| MissionItem {
            x: x.into(),
            ..MissionItem::action(command, params)
        }),
    ]
}

fn mission() -> impl Strategy<Value = Mission> {
    let home = (-900_000_000..900_000_000i32, 1..1_800_000_000i32, -400.0..5000.0f32)
        .prop_map(|(lat_e7, lon_e7, alt_m)| Some(Home { lat_e7, lon_e7, alt_m }));
    (home, prop::collection::vec(item(), 0..20)).prop_map(|(home, items)| Mission { home, items })
}

/// 1e308 came out as infinity, or as the largest integer, and was written into a file that no program reads.
#[test]
fn numbers_that_no_item_holds_are_refused_by_name() {
    let place = LatLon { lat_deg: 47.0, lon_deg: 8.0 };
    let mission = Mission {
        home: Some(Home { lat_e7: 470_000_000, lon_e7: 80_000_000, alt_m: 321.0 }),
        items: vec![MissionItem::at(command::NAV_WAYPOINT, [77.0, 0.0, 0.0, 0.0], place, 123.0)],
    };
    let circles = vec![FenceCircle { inclusion: true, center: place, radius_m: 555.0 }];
    let fence = Fence { circles, polygons: Vec::new() };
    let text = write(&PlanFile::new(mission.clone(), fence, Autopilot::Px4, 1));
    let cases = [
        ("321", "plannedHome"),
        ("77", "parameter 1 is 1e308"),
        ("123", "parameter 7 is 1e308"),
        ("555", "circle 1"),
    ];
    for (number, message) in cases {
        assert!(text.contains(number), "{text}");
        for wild in ["1e308", "-1e308"] {
            let said = read(&text.replace(&format!("{number}.0"), wild)).expect_err(message).to_string();
            assert!(said.replace('-', "").contains(message), "{said}");
        }
    }
    let text = waypoints::write(&mission);
    for number in ["77", "123", "321"] {
        let said = waypoints::read(&text.replace(number, "1e308")).expect_err(number).to_string();
        assert!(said.contains("\"1e308\" is not"), "{said}");
    }
}

/// NaN is equal to nothing; its printed form is.
fn printed(mission: &Mission) -> String {
    format!("{mission:?}")
}

proptest! {
    #[test]
    fn plan_round_trip(mission in mission(), radius in 1.0..5e3f64, lat in -80.0..80.0f64, lon in -179.0..179.0f64) {
        let center = LatLon { lat_deg: lat, lon_deg: lon };
        let fence = Fence {
            circles: vec![FenceCircle { inclusion: true, center, radius_m: radius }],
            polygons: vec![FencePolygon { inclusion: false, corners: vec![center; 4] }],
        };
        let plan = PlanFile::new(mission, fence, Autopilot::Px4, 1);
        let back = read(&write(&plan)).expect("own output");
        prop_assert_eq!(printed(&back.mission), printed(&plan.mission));
        // The JSON reader may be wrong in the last of sixteen digits.
        let [a, b] = [&back.fence, &plan.fence].map(|f| (f.circles[0].center, f.polygons[0].corners[3]));
        prop_assert!((a.0.lat_deg - b.0.lat_deg).abs() < 1e-12 && (a.1.lon_deg - b.1.lon_deg).abs() < 1e-12);
        prop_assert!((back.fence.circles[0].radius_m - radius).abs() < 1e-9);
    }

    #[test]
    fn waypoints_round_trip(mission in mission()) {
        let back = waypoints::read(&waypoints::write(&mission)).expect("own output");
        prop_assert_eq!(printed(&back), printed(&mission));
    }

    #[test]
    fn no_text_brings_the_readers_down(text in ".{0,200}") {
        let _ = read(&text);
        let _ = waypoints::read(&format!("QGC WPL 110\n{text}"));
    }
}
