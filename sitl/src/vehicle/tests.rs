use super::*;
use gaware_nav::earth::{STANDARD_GRAVITY, gravity, rotation_rate};
use gaware_nav::math::{cos, hypot, sin};
use gaware_nav::rotation::{euler_from_c_nb, exp, wrap_pi};
use mavlink::dialects::ardupilotmega::{MavCmd, MavFrame};
use nalgebra::UnitQuaternion;

fn item(command: MavCmd, params: [f32; 4], north_m: f64, east_m: f64, z: f32) -> MISSION_ITEM_INT_DATA {
    let start = VehicleConfig::fixed_wing().start;
    let (r_n, r_e) = start.radii();
    let lat = start.lat_rad + north_m / r_n;
    let lon = start.lon_rad + east_m / (r_e * cos(start.lat_rad));
    MISSION_ITEM_INT_DATA {
        command,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
        param1: params[0],
        param2: params[1],
        param3: params[2],
        param4: params[3],
        x: (lat.to_degrees() * 1e7).round() as i32,
        y: (lon.to_degrees() * 1e7).round() as i32,
        z,
        ..Default::default()
    }
}

fn do_item(command: MavCmd, params: [f32; 4]) -> MISSION_ITEM_INT_DATA {
    MISSION_ITEM_INT_DATA { x: 0, y: 0, ..item(command, params, 0.0, 0.0, 0.0) }
}

fn home() -> MISSION_ITEM_INT_DATA {
    item(MavCmd::MAV_CMD_NAV_WAYPOINT, [0.0; 4], 0.0, 0.0, 0.0)
}

fn launched(config: VehicleConfig, items: Vec<MISSION_ITEM_INT_DATA>) -> Vehicle {
    let mut vehicle = Vehicle::new(config);
    vehicle.items_mut().extend(items);
    vehicle.truth_at(5.0);
    assert!(vehicle.arm(true));
    assert!(vehicle.set_mode(Mode::Auto));
    vehicle
}

/// Flies until landed or the time is over; every truth at 10 Hz.
fn fly(vehicle: &mut Vehicle, until_s: f64) -> (Vec<Truth>, Vec<PilotEvent>) {
    let (mut path, mut events) = (Vec::new(), Vec::new());
    let mut t = 5.0;
    while t < until_s && !vehicle.has_landed() {
        t += 0.1;
        path.push(vehicle.truth_at(t));
        events.extend(vehicle.take_events());
    }
    (path, events)
}

fn wing_mission() -> Vec<MISSION_ITEM_INT_DATA> {
    vec![
        home(),
        item(MavCmd::MAV_CMD_NAV_TAKEOFF, [10.0, 0.0, 0.0, 0.0], 0.0, 0.0, 50.0),
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, [0.0; 4], 600.0, 300.0, 80.0),
        do_item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [0.0, 28.0, -1.0, 0.0]),
        item(MavCmd::MAV_CMD_NAV_LOITER_TURNS, [2.0, 0.0, 80.0, 0.0], 600.0, -200.0, 80.0),
        do_item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [0.0, 99.0, -1.0, 0.0]),
        item(MavCmd::MAV_CMD_NAV_LOITER_TURNS, [1.0, 0.0, -70.0, 0.0], 100.0, -300.0, 90.0),
        item(MavCmd::MAV_CMD_NAV_LOITER_TO_ALT, [0.0, 100.0, 0.0, 0.0], 0.0, 0.0, 60.0),
        do_item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [0.0, 18.0, -1.0, 0.0]),
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, [0.0; 4], -800.0, -400.0, 50.0),
        item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 4], 0.0, 0.0, 0.0),
    ]
}

fn rotor_mission() -> Vec<MISSION_ITEM_INT_DATA> {
    vec![
        home(),
        item(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0; 4], 0.0, 0.0, 20.0),
        do_item(MavCmd::MAV_CMD_CONDITION_YAW, [90.0, 30.0, 1.0, 0.0]),
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, [3.0, 0.0, 0.0, 0.0], 60.0, 0.0, 20.0),
        do_item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [1.0, 12.0, -1.0, 0.0]),
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, [0.0; 4], -60.0, 60.0, 30.0),
        item(MavCmd::MAV_CMD_NAV_LOITER_TURNS, [2.0, 0.0, 15.0, 0.0], 0.0, 0.0, 25.0),
        do_item(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, [0.0; 4]),
    ]
}

#[test]
fn a_vehicle_stands_until_it_is_told() {
    let mut vehicle = Vehicle::new(VehicleConfig::fixed_wing());
    assert!(!vehicle.set_mode(Mode::Auto), "there is no mission");
    vehicle.items_mut().extend(wing_mission());
    assert!(vehicle.set_mode(Mode::Auto));
    let truth = vehicle.truth_at(20.0);
    assert_eq!(truth.v_n, Vector3::zeros());
    assert_eq!(truth.place, vehicle.config().start);
    vehicle.arm(true);
    assert!(vehicle.truth_at(30.0).v_n.norm() > 5.0);
}

#[test]
fn a_wing_flies_its_mission_and_lands() {
    let mut vehicle = launched(VehicleConfig::fixed_wing(), wing_mission());
    let (path, events) = fly(&mut vehicle, 900.0);
    let reached: Vec<usize> =
        events.iter().filter_map(|e| if let PilotEvent::Reached(s) = e { Some(*s) } else { None }).collect();
    assert!(reached.starts_with(&[1, 2, 4, 6, 7, 9]), "{reached:?}");
    assert!(vehicle.has_landed() && !vehicle.is_armed());
    let end = path.last().unwrap();
    assert!((end.place.height_m - vehicle.config().start.height_m).abs() < 1.0);
    let flying: Vec<&Truth> = path.iter().filter(|t| t.place.height_m > 500.0).collect();
    // 99 m/s is outside the limits and was dropped silently.
    assert!(flying.iter().all(|t| t.v_n.norm() < 30.0));
    assert!(flying.iter().any(|t| t.v_n.norm() > 27.0));
    let banks: Vec<f64> = flying.iter().map(|t| euler_from_c_nb(&t.c_nb).x.to_degrees()).collect();
    assert!(banks.iter().any(|b| *b > 40.0) && banks.iter().any(|b| *b < -35.0));
    assert!(banks.iter().all(|b| b.abs() < 60.0));
    assert!(flying.iter().all(|t| t.force.y.abs() < 0.1 && t.force.norm() < 2.5 * STANDARD_GRAVITY));
}

#[test]
fn a_circle_has_its_radius_also_in_wind() {
    for wind in [[0.0, 0.0], [8.0, -6.0]] {
        let config = VehicleConfig { wind_n_e_m_per_s: wind, ..VehicleConfig::fixed_wing() };
        let centre = item(MavCmd::MAV_CMD_NAV_LOITER_TURNS, [20.0, 0.0, 120.0, 0.0], 300.0, 300.0, 80.0);
        let takeoff = item(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0; 4], 0.0, 0.0, 50.0);
        let mut vehicle = launched(config, vec![home(), takeoff, centre]);
        let (path, _) = fly(&mut vehicle, 200.0);
        let (r_n, r_e) = config_radii();
        for truth in path.iter().filter(|t| t.t_s > 120.0) {
            let n = (truth.place.lat_rad - config_start().lat_rad) * r_n - 300.0;
            let e = (truth.place.lon_rad - config_start().lon_rad) * r_e - 300.0;
            let radius = hypot(n, e);
            assert!((radius - 120.0).abs() < 15.0, "{wind:?} {} s: {radius}", truth.t_s);
            assert!((truth.place.height_m - 568.0).abs() < 4.0);
        }
    }
}

fn config_start() -> Geodetic {
    VehicleConfig::fixed_wing().start
}

fn config_radii() -> (f64, f64) {
    let (r_n, r_e) = config_start().radii();
    (r_n + 520.0, (r_e + 520.0) * cos(config_start().lat_rad))
}

#[test]
fn a_multirotor_crabs_circles_and_comes_home() {
    let config =
        VehicleConfig { wind_n_e_m_per_s: [3.0, 2.0], gust_m_per_s: 0.5, ..VehicleConfig::multirotor() };
    let mut vehicle = launched(config, rotor_mission());
    let (path, events) = fly(&mut vehicle, 400.0);
    assert!(events.contains(&PilotEvent::Reached(3)) && events.contains(&PilotEvent::Landed), "{events:?}");
    let end = path.last().unwrap();
    let start = vehicle.config().start;
    assert!((end.place.to_ecef() - start.to_ecef()).norm() < 3.0);
    // Northward with the nose to the east: it leans to its left, and drag shows on the right axis.
    let crab: Vec<&Truth> = path.iter().filter(|t| t.v_n.x > 5.0 && t.v_n.y.abs() < 0.5).collect();
    assert!(!crab.is_empty());
    assert!(
        crab.iter().any(|t| wrap_pi(euler_from_c_nb(&t.c_nb).z - std::f64::consts::FRAC_PI_2).abs() < 0.05
            && t.force.y > 0.5)
    );
}

fn slipping(seed: u64) -> VehicleConfig {
    VehicleConfig { side_force_g: 0.2, roll_side_force_g: 0.08, seed, ..VehicleConfig::fixed_wing() }
}

/// Every aircraft slips in its own way, about the mean that was asked for.
#[test]
fn a_wing_without_coordinated_rudder_feels_its_turns() {
    let felt = |seed: u64, side: f32| {
        let circle =
            item(MavCmd::MAV_CMD_NAV_LOITER_TURNS, [20.0, 0.0, side * 70.0, 0.0], 300.0, 300.0, 80.0);
        let takeoff = item(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0; 4], 0.0, 0.0, 50.0);
        let mut vehicle = launched(slipping(seed), vec![home(), takeoff, circle]);
        let (path, _) = fly(&mut vehicle, 150.0);
        let steady: Vec<&Truth> = path.iter().filter(|t| t.t_s > 100.0).collect();
        // Over the sine of the bank, that of 45° counts.
        let at_45 = |t: &&Truth| t.force.y / STANDARD_GRAVITY / sin(euler_from_c_nb(&t.c_nb).x).abs() * 0.707;
        steady.iter().map(at_45).sum::<f64>() / steady.len() as f64
    };
    let right: Vec<f64> = (1..=6).map(|seed| felt(seed, 1.0)).collect();
    let mean = right.iter().sum::<f64>() / right.len() as f64;
    assert!((mean + 0.2).abs() < 0.03, "{right:?}");
    assert!(right.iter().all(|y| (-0.27..-0.13).contains(y)), "{right:?}");
    assert!(right.iter().any(|y| (y - right[0]).abs() > 0.01), "all alike: {right:?}");
    assert!((felt(1, -1.0) + right[0]).abs() < 0.06, "the other side feels the opposite");
}

/// ArduCopter's position controller builds its acceleration up; a leg takes longer than without that limit.
#[test]
fn a_multirotor_with_limited_jerk_accelerates_smoothly_and_arrives() {
    let fly_with = |jerk: f64| {
        let config =
            VehicleConfig { accel_m_per_s2: 2.5, jerk_m_per_s3: jerk, ..VehicleConfig::multirotor() };
        let mut vehicle = launched(config, rotor_mission());
        let (path, events) = fly(&mut vehicle, 400.0);
        assert!(
            events.contains(&PilotEvent::Reached(5)) && events.contains(&PilotEvent::Landed),
            "{events:?}"
        );
        path.len()
    };
    let [free, limited] = [0.0, 2.0].map(fly_with);
    assert!(limited > free, "{limited} {free}");
}

/// Navigates with the vehicle's own specific force and rate and must come back to its path: the truth belongs together.
#[test]
fn what_a_vehicle_feels_leads_back_to_where_it_is() {
    const DT: f64 = 1e-3;
    let windy = |c: VehicleConfig| VehicleConfig { wind_n_e_m_per_s: [4.0, -3.0], gust_m_per_s: 0.8, ..c };
    for (config, items) in [
        (windy(VehicleConfig::fixed_wing()), wing_mission()),
        (windy(slipping(3)), wing_mission()),
        (windy(VehicleConfig::multirotor()), rotor_mission()),
    ] {
        let mut vehicle = launched(config, items);
        let mut a = vehicle.truth_at(5.0);
        let c_en = a.place.c_en();
        let turn = nalgebra::Rotation3::from_matrix_unchecked(c_en * a.c_nb);
        let (mut r, mut v, mut q) =
            (a.place.to_ecef(), c_en * a.v_n, UnitQuaternion::from_rotation_matrix(&turn));
        for k in 1..=60_000u32 {
            let b = vehicle.truth_at(5.0 + f64::from(k) * DT);
            let phi = (a.rate_ib + b.rate_ib) * (0.5 * DT) + a.rate_ib.cross(&b.rate_ib) * (DT * DT / 12.0);
            let next = exp(&(-rotation_rate() * DT)) * q * exp(&phi);
            let pull = gravity(&r) - rotation_rate().cross(&v) * 2.0;
            let dv = (q * a.force + next * b.force) * (0.5 * DT) + pull * DT;
            r += (v + dv * 0.5) * DT;
            v += dv;
            (q, a) = (next, b);
        }
        let drift = (r - a.place.to_ecef()).norm();
        let tilt = (q.to_rotation_matrix().matrix() - a.place.c_en() * a.c_nb).norm();
        // Trapezoids over control steps: micro-radians and centimetres a minute.
        assert!(drift < 0.5, "{drift} m");
        assert!((v - a.place.c_en() * a.v_n).norm() < 0.02);
        assert!(tilt < 1e-4, "{tilt}");
    }
}

#[test]
fn the_recent_past_can_be_asked_for() {
    let mut vehicle = launched(VehicleConfig::fixed_wing(), wing_mission());
    let then = vehicle.truth_at(20.1234);
    vehicle.truth_at(21.2);
    assert_eq!(vehicle.truth_at(20.1234), then);
}
