//! Wrong set-ups, each with the sentence that the pilot reads.

use super::*;
use gaware_mission::fence::{Fence, FenceCircle};
use gaware_mission::item::{Home, Mission, MissionItem, command};
use gaware_mission::params::{ParamType, ParamValue};
use gaware_mission::transfer::Address;
use gaware_mission::transfer::verified::VehicleState;

const FIELD: LatLon = LatLon { lat_deg: 47.397, lon_deg: 8.545 };
const ON_THE_GROUND: VehicleState =
    VehicleState { armed: false, mission_mode: false, flying_mission: false, in_flight: false };

fn vehicle(system: u8, autopilot: Autopilot, mav_type: u8) -> Vehicle {
    Vehicle {
        address: Address { system, component: 1 },
        mav_type,
        autopilot,
        state: ON_THE_GROUND,
        uid: None,
    }
}

fn facts(autopilot: Autopilot, mav_type: u8, parameters: &[(&str, f64)]) -> Facts {
    let stream = |name| StreamFact { name, works: true };
    let mut facts = Facts {
        position: Some(FIELD),
        firmware: Some(if autopilot == Autopilot::Px4 { [1, 15, 4] } else { [4, 6, 1] }),
        streams: ["RAW_IMU", "GPS_RAW_INT", "ATTITUDE"].map(stream).to_vec(),
        current_item: Some(0),
        ..Facts::new(vehicle(1, autopilot, mav_type))
    };
    set(&mut facts, parameters);
    facts
}

fn set(facts: &mut Facts, parameters: &[(&str, f64)]) {
    for (name, value) in parameters {
        let value = ParamValue { kind: ParamType::Real32, value: *value };
        facts.parameters.values.insert(name.parse().expect("a name"), value);
    }
}

fn plane() -> Facts {
    facts(
        Autopilot::ArduPilot,
        1,
        &[
            ("SCHED_LOOP_RATE", 200.0),
            ("ROLL_LIMIT_DEG", 55.0),
            ("AIRSPEED_MIN", 11.0),
            ("AIRSPEED_MAX", 25.0),
            ("AIRSPEED_CRUISE", 16.0),
            ("WP_RADIUS", 60.0),
            ("FENCE_ENABLE", 1.0),
            ("FENCE_ACTION", 1.0),
            ("FENCE_TYPE", 4.0),
        ],
    )
}

fn copter() -> Facts {
    let limits =
        [("ANGLE_MAX", 4500.0), ("WPNAV_SPEED", 1500.0), ("FENCE_ENABLE", 1.0), ("FENCE_ACTION", 1.0)];
    facts(Autopilot::ArduPilot, 2, &limits)
}

fn px4_plane() -> Facts {
    let limits =
        [("FW_R_LIM", 50.0), ("FW_AIRSPD_MIN", 17.0), ("FW_AIRSPD_MAX", 36.0), ("FW_AIRSPD_TRIM", 24.0)];
    let mut facts = facts(Autopilot::Px4, 1, &limits);
    set(&mut facts, &[("GF_ACTION", 3.0), ("MIS_TKO_LAND_REQ", 2.0), ("FW_LND_ANG", 5.0)]);
    facts
}

/// Take-off, a leg of 500 m at 120 m, a landing with a slope of 4°.
fn plan(autopilot: Autopilot, mav_type: u8) -> Contents {
    let north = |m: f64| LatLon { lat_deg: FIELD.lat_deg + m / 111_200.0, ..FIELD };
    let item = |number, metres, alt_m| MissionItem::at(number, [0.0; 4], north(metres), alt_m);
    let (lat_e7, lon_e7) = FIELD.to_e7();
    let circle = FenceCircle { inclusion: true, center: FIELD, radius_m: 1500.0 };
    Contents {
        mission: Mission {
            home: Some(Home { lat_e7, lon_e7, alt_m: 441.0 }),
            items: vec![
                item(command::NAV_TAKEOFF, 100.0, 60.0),
                item(command::NAV_WAYPOINT, 500.0, 120.0),
                item(command::NAV_WAYPOINT, 600.0, 40.0),
                item(command::NAV_LAND, 0.0, 0.0),
            ],
        },
        fence: Fence { polygons: Vec::new(), circles: vec![circle] },
        planned_for: Some(autopilot),
        mav_type: Some(mav_type),
        ..Contents::default()
    }
}

fn plane_plan() -> Contents {
    plan(Autopilot::ArduPilot, 1)
}

fn airframe(name: &str) -> Airframe {
    Airframe::example(name).expect("shipped")
}

fn table(facts: &Facts, plan: &Contents, airframe_name: &str) -> Vec<Row> {
    let airframe = airframe(airframe_name);
    check(facts, Against { plan: Some(plan), airframe: Some(&airframe) })
}

/// Lines that are not ok.
fn complaints(rows: &[Row]) -> String {
    rows.iter().filter(|r| r.verdict != Verdict::Ok).map(|r| format!("{r}\n")).collect()
}

#[test]
fn a_right_set_up_is_ready() {
    for (facts, plan, airframe) in [
        (plane(), plane_plan(), "small_fixed_wing"),
        (copter(), plan(Autopilot::ArduPilot, 2), "quadrotor"),
        (px4_plane(), plan(Autopilot::Px4, 1), "large_fixed_wing"),
    ] {
        assert_eq!(complaints(&table(&facts, &plan, airframe)), "", "{airframe}");
    }
}

/// Changes one thing and says which.
fn wrong(
    name: &str,
    mut facts: Facts,
    mut plan: Contents,
    airframe: &str,
    change: fn(&mut Facts, &mut Contents),
) -> String {
    change(&mut facts, &mut plan);
    let said = complaints(&table(&facts, &plan, airframe));
    assert!(!said.is_empty(), "{name}: nothing was said");
    format!("{name}:\n{said}")
}

#[test]
fn an_item_that_the_firmware_refuses_is_named_before_the_upload() {
    let mut plan = plane_plan();
    let place = plan.mission.items.iter().find_map(|i| i.place()).expect("a plan with places");
    let circle = MissionItem::at(command::NAV_LOITER_TURNS, [2.0, 0.0, 60.0, f32::NAN], place, 100.0);
    plan.mission.items.insert(1, circle);
    let said = complaints(&check(&plane(), Against { plan: Some(&plan), airframe: None }));
    assert!(said.starts_with("STOP"), "{said}");
    assert!(said.contains("(loiter turns, command 18): ArduPlane refuses NaN in parameter 4"), "{said}");
}

/// A place of which only one coordinate is written would be sent as one at the equator or in Greenwich.
#[test]
fn half_a_place_is_refused_and_none_at_all_is_where_the_vehicle_is() {
    for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
        let mut plan = plan(autopilot, 1);
        let facts = if autopilot == Autopilot::Px4 { px4_plane() } else { plane() };
        let said = |plan: &Contents| complaints(&check(&facts, Against { plan: Some(plan), airframe: None }));
        let k = plan.mission.items.iter().rposition(|i| i.place().is_some()).expect("a place");
        plan.mission.items[k].x = i32::MAX;
        let lost = said(&plan);
        assert!(lost.contains("STOP") && lost.contains("write a latitude, or no longitude either"), "{lost}");
        plan.mission.items[k].y = i32::MAX;
        assert!(!said(&plan).contains("write a l"), "{}", said(&plan));
    }
}

#[test]
fn heights_below_home_and_far_above_it_are_said() {
    use gaware_mission::item::Frame;
    let place = plane_plan().mission.items.iter().find_map(|i| i.place()).unwrap();
    let said = |change: &dyn Fn(&mut Vec<MissionItem>)| {
        let mut plan = plane_plan();
        let (lat_e7, lon_e7) = place.to_e7();
        plan.mission.home = Some(Home { lat_e7, lon_e7, alt_m: 440.0 });
        change(&mut plan.mission.items);
        let rows = check(&plane(), Against { plan: Some(&plan), airframe: None });
        complaints(&rows.into_iter().filter(|r| r.check == "heights").collect::<Vec<_>>())
    };
    assert_eq!(said(&|_| ()), "");
    let waypoint = |z| MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], place, z);
    let below = said(&|items| items.push(waypoint(-100.0)));
    assert!(below.starts_with("STOP") && below.contains("100 m below home"), "{below}");
    assert_eq!(said(&|items| items.push(MissionItem { command: command::NAV_LAND, ..waypoint(-20.0) })), "");
    let above = said(&|items| items.push(waypoint(5000.0)));
    assert!(above.starts_with("warn") && above.contains("5000 m above home"), "{above}");
    let sea_level = |items: &mut Vec<MissionItem>| {
        items.iter_mut().filter(|i| i.place().is_some()).for_each(|i| i.frame = Frame::GLOBAL);
    };
    let mistaken = said(&sea_level);
    assert!(mistaken.starts_with("STOP") && mistaken.contains("all items lie below home"), "{mistaken}");
    let one = said(&|items| items.push(MissionItem { frame: Frame::GLOBAL, ..waypoint(400.0) }));
    assert!(one.starts_with("warn") && one.contains("40 m below home"), "{one}");
}

#[test]
fn wrong_set_ups_of_a_plane() {
    let one = |name, change| wrong(name, plane(), plane_plan(), "small_fixed_wing", change);
    let all = [
        one("two vehicles on the link", |f, _| f.others = vec![vehicle(2, Autopilot::Px4, 2)]),
        one("not the vehicle on the screen", |f, _| f.on_screen = Some(7)),
        one("the plan is for a field 820 km away", |f, _| {
            f.position = Some(LatLon { lat_deg: 54.77, lon_deg: 8.545 });
        }),
        one("no position", |f, _| f.position = None),
        one("armed in AUTO", |f, _| {
            f.vehicle.state = VehicleState { armed: true, mission_mode: true, ..ON_THE_GROUND };
        }),
        one("the vehicle is a quadrotor", |f, _| f.vehicle.mav_type = 2),
        // Coaxial: carried by rotors as well.
        one("a plan of a coaxial copter", |_, p| p.mav_type = Some(3)),
        one("the plan is for PX4", |_, p| p.planned_for = Some(Autopilot::Px4)),
        one("an old firmware", |f, _| f.firmware = Some([3, 9, 8])),
        one("a firmware that does not tell its version", |f, _| f.firmware = None),
        one("a slow loop", |f, _| set(f, &[("SCHED_LOOP_RATE", 50.0)])),
        one("a bank limit of 35°, by its older name", |f, _| {
            f.parameters.values.retain(|n, _| n.as_str() != "ROLL_LIMIT_DEG");
            set(f, &[("LIM_ROLL_CD", 3500.0)]);
        }),
        one("a bank limit without reserve", |f, _| set(f, &[("ROLL_LIMIT_DEG", 48.0)])),
        one("a minimum airspeed above the plan's", |f, _| set(f, &[("AIRSPEED_MIN", 14.0)])),
        one("a maximum airspeed below the plan's", |f, _| set(f, &[("AIRSPEED_MAX", 20.0)])),
        one("large waypoints", |f, _| set(f, &[("WP_RADIUS", 200.0)])),
        one("a fence that is not enabled", |f, _| set(f, &[("FENCE_ENABLE", 0.0)])),
        one("a fence that only reports", |f, _| set(f, &[("FENCE_ACTION", 0.0)])),
        one("a ceiling below the plan", |f, _| set(f, &[("FENCE_TYPE", 5.0), ("FENCE_ALT_MAX", 100.0)])),
        one("a circle around home that is too small", |f, _| {
            set(f, &[("FENCE_TYPE", 6.0), ("FENCE_RADIUS", 300.0)])
        }),
        one("no inertial message", |f, _| f.streams[0].works = false),
        one("no fixes", |f, _| f.streams[1].works = false),
        one("no answer for any parameter", |f, _| {
            f.parameters = Parameters::default();
            f.parameters.unanswered = fence_parameters(Autopilot::ArduPilot);
        }),
    ];
    insta::assert_snapshot!(all.join("\n"));
}

/// Index 11 of yesterday's flight: armed, PX4 skips take-off and items 1 to 10 of today's plan.
#[test]
fn a_mission_that_would_begin_in_the_middle_is_stopped() {
    for (autopilot, mav_type, facts) in [(Autopilot::ArduPilot, 1, plane()), (Autopilot::Px4, 1, px4_plane())]
    {
        let plan = plan(autopilot, mav_type);
        let said = |current_item| {
            let facts = Facts { current_item, ..facts.clone() };
            complaints(&check(&facts, Against { plan: Some(&plan), airframe: None }))
        };
        assert!(said(Some(11)).contains("STOP  first item     the current item is 11"), "{}", said(Some(11)));
        assert!(said(None).starts_with("warn  first item"), "{}", said(None));
    }
    // Commands before the first item that is flown are done on the way; PX4 begins at the very first.
    let mut plan = plane_plan();
    plan.mission.items.insert(0, MissionItem::action(command::DO_CHANGE_SPEED, [0.0, 15.0, -1.0, 0.0]));
    assert_eq!([Autopilot::ArduPilot, Autopilot::Px4].map(|a| plan.mission.first_index(a)), [2, 0]);
}

#[test]
fn a_vehicle_outside_of_the_fence_and_a_fence_without_an_inside_are_stopped() {
    let one = |change| wrong("fence", plane(), plane_plan(), "small_fixed_wing", change);
    let outside = one(|_, p| p.fence.circles[0].center.lat_deg += 0.015);
    assert!(outside.contains("outside of what the plan's geofence allows"), "{outside}");
    // Inside now, and out of it later.
    let far = one(|_, p| {
        let mut item = *p.mission.items.iter().rfind(|i| i.command == command::NAV_WAYPOINT).unwrap();
        item.x += 300_000;
        p.mission.items.insert(2, item);
    });
    assert!(
        far.contains("item 3 lies") && far.contains("outside of what the plan's own geofence allows"),
        "{far}"
    );
    let across = one(|f, p| {
        let [from, to] =
            [1.0, 3.0].map(|k| LatLon { lat_deg: f.position.unwrap().lat_deg + k * 1e-3, lon_deg: 8.545 });
        p.mission.items =
            [from, to].map(|place| MissionItem::at(command::NAV_WAYPOINT, [0.0; 4], place, 60.0)).into();
        let center = LatLon { lat_deg: (from.lat_deg + to.lat_deg) / 2.0, lon_deg: 8.545 };
        p.fence.circles.push(FenceCircle { inclusion: false, center, radius_m: 30.0 });
    });
    assert!(across.contains("the way from item 1 to item 2 leaves"), "{across}");
    let none = one(|_, p| p.fence.circles[0].radius_m = 0.0);
    assert!(none.contains("STOP  fence          geofence circle 1"), "{none}");
}

#[test]
fn wrong_set_ups_of_a_quadrotor() {
    let one = |name, change| wrong(name, copter(), plan(Autopilot::ArduPilot, 2), "quadrotor", change);
    let all = [
        one("a tilt limit of 20°", |f, _| set(f, &[("ANGLE_MAX", 2000.0)])),
        one("a slow cruise", |f, _| set(f, &[("WPNAV_SPEED", 500.0)])),
        one("a slow yaw", |f, _| set(f, &[("ATC_SLEW_YAW", 3000.0)])),
    ];
    insta::assert_snapshot!(all.join("\n"));
}

#[test]
fn wrong_set_ups_of_a_plane_on_px4() {
    let one = |name, change| wrong(name, px4_plane(), plan(Autopilot::Px4, 1), "large_fixed_wing", change);
    let all = [
        one("no landing", |_, p| p.mission.items.truncate(3)),
        one("a steep landing", |_, p| p.mission.items[2].z = 60.0),
        one("a far first waypoint", |f, _| set(f, &[("MIS_DIST_1WP", 50.0)])),
        one("a bank limit of 30°", |f, _| set(f, &[("FW_R_LIM", 30.0)])),
        one("a fence without action", |f, _| set(f, &[("GF_ACTION", 0.0)])),
        one("a small cylinder", |f, _| set(f, &[("GF_MAX_HOR_DIST", 400.0)])),
        one("in the air, in AUTO.LOITER", |f, _| {
            f.vehicle.state = VehicleState { armed: true, in_flight: true, ..ON_THE_GROUND };
        }),
    ];
    insta::assert_snapshot!(all.join("\n"));
}

/// One with FW_AIRSPD_MAX 20 reached 14.6 m/s.
#[test]
fn a_limit_of_the_autopilot_is_no_speed_that_an_aircraft_reaches() {
    let wing = Airframe::example("small_fixed_wing").expect("shipped");
    let said = |airframe: &Airframe| {
        let rows = check(&plane(), Against { airframe: Some(airframe), ..Against::default() });
        let row = rows.into_iter().find(|r| r.check == "airframe").expect("a row");
        assert_eq!(row.verdict, Verdict::Ok, "{row}");
        row.text
    };
    assert!(said(&wing).contains("airframe fit LOG\" measures it"), "{}", said(&wing));
    let fitted = wing.fitted();
    assert!(fitted.name.ends_with(", fitted") && fitted.clone().fitted() == fitted);
    assert!(!said(&fitted).contains("airframe fit"), "{}", said(&fitted));
}
