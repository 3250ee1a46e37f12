use super::*;
use crate::fence::FenceCircle;
use crate::item::{Frame, LatLon};
use nalgebra::UnitQuaternion;

const CENTER: LatLon = LatLon { lat_deg: 47.4, lon_deg: 8.5 };

fn limits(wind: f64) -> Limits {
    let circle = FenceCircle { inclusion: true, center: CENTER, radius_m: 400.0 };
    Limits {
        fence: Fence { polygons: Vec::new(), circles: vec![circle] },
        floor_m: 50.0,
        ceiling_m: 150.0,
        wind_ned_m_per_s: [wind, 0.0, 0.0],
    }
}

fn said(item: MissionItem) -> String {
    let airframe = Airframe::example("small_fixed_wing").expect("shipped");
    let limits = limits(5.0);
    let checker = Checker::new(&airframe, &limits, LocalFrame::new(CENTER)).expect("flyable limits");
    checker.items(&[item]).map_or_else(|e| e.to_string(), |()| "fine".to_owned())
}

fn at(number: u16, params: [f32; 4], north: f64, height: f32) -> MissionItem {
    let frame = LocalFrame::new(CENTER);
    MissionItem::at(number, params, frame.to_place(Vector2::new(north, 0.0)), height)
}

#[test]
fn items_are_checked_one_by_one() {
    let speed = |kind, v| MissionItem::action(command::DO_CHANGE_SPEED, [kind, v, -1.0, 0.0]);
    let msl = MissionItem { frame: Frame::GLOBAL_INT, ..at(16, [0.0; 4], 0.0, 100.0) };
    let cases = [
        (at(16, [0.0; 4], 300.0, 100.0), "fine"),
        (at(16, [0.0; 4], 390.0, 100.0), "item 1 is 12 m too close to the fence"),
        (at(16, [0.0; 4], 500.0, 100.0), "outside it"),
        (at(16, [0.0; 4], 0.0, 49.0), "not between the floor of 50 m"),
        (msl, "MeanSeaLevel"),
        (at(18, [1.0, 0.0, -100.0, 0.0], 0.0, 100.0), "fine"),
        (at(18, [1.0, 0.0, 30.0, 0.0], 0.0, 100.0), "circle of 30 m cannot be held"),
        (at(18, [1.0, 0.0, 100.0, 0.0], 300.0, 100.0), "too close to the fence"),
        (speed(0.0, 20.0), "fine"),
        (speed(0.0, 30.0), "30 m/s is not between 12 and 24 m/s"),
        (speed(1.0, 20.0), "minimum ground speed"),
    ];
    for (item, message) in cases {
        let said = said(item);
        assert!(said.contains(message), "{said}");
    }
}

#[test]
fn limits_that_leave_nothing_are_refused() {
    let airframe = Airframe::example("small_fixed_wing").expect("shipped");
    let refusal = |limits: &Limits| {
        Checker::new(&airframe, limits, LocalFrame::new(CENTER)).map(|_| ()).map_err(|e| e.to_string())
    };
    assert!(refusal(&limits(9.0)).is_ok());
    assert!(refusal(&limits(12.0)).is_err_and(|e| e.contains("wind of 12.0 m/s is more than 9.6")));
    let flat = Limits { floor_m: 100.0, ceiling_m: 103.0, ..limits(0.0) };
    assert!(refusal(&flat).is_err_and(|e| e.contains("no height to fly in")));
}

#[test]
fn a_mission_must_end_in_a_hold() {
    let airframe = Airframe::example("quadrotor").expect("shipped");
    let limits = limits(0.0);
    let checker = Checker::new(&airframe, &limits, LocalFrame::new(CENTER)).expect("flyable limits");
    assert_eq!(checker.end(&[]), Err(Refusal::Empty));
    assert_eq!(checker.end(&[at(16, [0.0; 4], 0.0, 100.0)]), Err(Refusal::NoSafeEnd));
    assert_eq!(checker.end(&[at(17, [0.0; 4], 0.0, 100.0)]), Ok(()));
}

/// Level flight with a roll from one bank to the other after 5 s, within this many seconds.
fn rolled(from_deg: f64, to_deg: f64, within_s: f64) -> Vec<Kinematics> {
    let sample = |k: u32| {
        let t_s = f64::from(k) * 0.05;
        let share = ((t_s - 5.0) / within_s).clamp(0.0, 1.0);
        let bank = (from_deg + share * (to_deg - from_deg)).to_radians();
        Kinematics {
            t_s,
            position_ned_m: Vector3::new(0.0, 0.0, -100.0),
            velocity_ned_m_per_s: Vector3::new(16.0, 0.0, 0.0),
            attitude: UnitQuaternion::from_euler_angles(bank, 0.0, 0.0),
            rate: Vector3::zeros(),
            force: Vector3::zeros(),
        }
    };
    (0..300).map(sample).collect()
}

#[test]
fn a_reversal_of_a_steep_turn_is_refused_where_its_load_is_too_much() {
    let mut airframe = Airframe::example("small_fixed_wing").expect("shipped");
    let limits = limits(0.0);
    let frame = LocalFrame::new(CENTER);
    let said = |airframe: &Airframe, samples: &[Kinematics]| {
        let checker = Checker::new(airframe, &limits, frame).expect("flyable limits");
        checker.path(samples).map_or_else(|e| e.to_string(), |()| "fine".to_owned())
    };
    // 1.41 g at 45 degrees, half of it more when rolling in, as much again from the other side: 2.83 g against 2.5.
    let reversal = rolled(45.0, -45.0, 1.5);
    assert!(said(&airframe, &reversal).contains("from 45° to -"), "{}", said(&airframe, &reversal));
    assert_eq!(said(&airframe, &rolled(0.0, 45.0, 1.0)), "fine");
    assert_eq!(said(&airframe, &rolled(45.0, -45.0, 8.0)), "fine", "level for a while between");
    airframe.load_overshoot = 1.1;
    assert_eq!(said(&airframe, &reversal), "fine", "an autopilot that rolls without overshoot");
}
