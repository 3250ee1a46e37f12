//! Planned missions flown by the simulated vehicle: 100 random fences, height bands, airframes and winds up to 0.6 of the cruise
//! speed. What the planner accepts must stay inside when flown; what it refuses, it refuses with a reason.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]

mod support;

use gaware_mission::airframe::{Airframe, EXAMPLES};
use gaware_mission::fence::{Fence, FencePolygon, LocalFence, LocalFrame};
use gaware_mission::item::{Autopilot, Frame, Home, LatLon, MissionItem};
use gaware_mission::planner::{Plan, Request, climb_out, plan};
use gaware_mission::safety::Limits;
use gaware_nav::earth::Geodetic;
use gaware_nav::math::{cos, sin};
use gaware_sitl::truth::Trajectory;
use gaware_sitl::vehicle::{Mode, Vehicle, VehicleConfig};
use mavlink::dialects::ardupilotmega::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame};
use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use support::Spread;

const HOME: Home = Home { lat_e7: 474_000_000, lon_e7: 85_000_000, alt_m: 450.0 };
const SEEDS: u64 = 100;

fn request(seed: u64) -> Request {
    let mut r = ChaCha8Rng::seed_from_u64(seed);
    let frame = LocalFrame::new(HOME.place());
    let n = r.random_range(5..9);
    let corner = |k: i32| {
        let angle = f64::from(k) / f64::from(n) * TAU;
        frame.to_place(Vector2::new(cos(angle), sin(angle)) * r.random_range(300.0..1200.0))
    };
    let corners = (0..n).map(corner).collect();
    let fence = Fence { polygons: vec![FencePolygon { inclusion: true, corners }], circles: vec![] };
    let airframe = Airframe::from_toml(EXAMPLES[(seed % 3) as usize].1).unwrap();
    let share = r.random_range(0.0..0.6) * airframe.speed_cruise_m_per_s;
    let toward: f64 = r.random_range(0.0..TAU);
    let wind = [share * cos(toward), share * sin(toward), 0.0];
    let (floor_m, ceiling_m) = (r.random_range(30.0..60.0), r.random_range(90.0..180.0));
    let height = (floor_m + ceiling_m) / 2.0;
    Request {
        start: climb_out(&airframe, HOME, 0.0, height, &Vector3::from(wind)),
        airframe,
        home: HOME,
        take_off: true,
        landing: true,
        start_height_m: height,
        start_heading_deg: 0.0,
        limits: Limits { fence, floor_m, ceiling_m, wind_ned_m_per_s: wind },
        budget_s: 300.0,
        within_reach_only: false,
        fix_interval_s: 0.2,
        beam: 2,
    }
}

fn vehicle(request: &Request, seed: u64) -> Vehicle {
    let a = &request.airframe;
    let base = if a.is_fixed_wing() { VehicleConfig::fixed_wing() } else { VehicleConfig::multirotor() };
    let [n, e, _] = request.limits.wind_ned_m_per_s;
    Vehicle::new(VehicleConfig {
        start: Geodetic::from_degrees(HOME.place().lat_deg, HOME.place().lon_deg, f64::from(HOME.alt_m)),
        heading_rad: 0.0,
        cruise_m_per_s: a.speed_cruise_m_per_s,
        min_m_per_s: a.speed_min_m_per_s,
        max_m_per_s: a.speed_max_m_per_s,
        max_bank_rad: a.bank_max_deg.to_radians(),
        climb_m_per_s: a.climb_max_m_per_s,
        sink_m_per_s: a.descent_max_m_per_s,
        accel_m_per_s2: a.acceleration_m_per_s2,
        jerk_m_per_s3: a.jerk_max_m_per_s3,
        side_force_g: a.side_force_g,
        roll_side_force_g: a.roll_side_force_g,
        loiter_radius_m: a.turn_radius_min_m,
        wind_n_e_m_per_s: [n, e],
        gust_m_per_s: 0.5,
        seed,
        first_item: usize::from(a.autopilot == Autopilot::ArduPilot),
        ..base
    })
}

fn wire(item: &MissionItem) -> MISSION_ITEM_INT_DATA {
    let [param1, param2, param3, param4] = item.params;
    let frame = match item.frame {
        Frame::MISSION => MavFrame::MAV_FRAME_MISSION,
        Frame::GLOBAL => MavFrame::MAV_FRAME_GLOBAL,
        _ => MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
    };
    let command = match item.command {
        16 => MavCmd::MAV_CMD_NAV_WAYPOINT,
        17 => MavCmd::MAV_CMD_NAV_LOITER_UNLIM,
        18 => MavCmd::MAV_CMD_NAV_LOITER_TURNS,
        19 => MavCmd::MAV_CMD_NAV_LOITER_TIME,
        21 => MavCmd::MAV_CMD_NAV_LAND,
        22 => MavCmd::MAV_CMD_NAV_TAKEOFF,
        31 => MavCmd::MAV_CMD_NAV_LOITER_TO_ALT,
        115 => MavCmd::MAV_CMD_CONDITION_YAW,
        178 => MavCmd::MAV_CMD_DO_CHANGE_SPEED,
        other => panic!("the planner uses command {other}"),
    };
    let (x, y, z) = (item.x, item.y, item.z);
    MISSION_ITEM_INT_DATA { command, frame, param1, param2, param3, param4, x, y, z, ..Default::default() }
}

/// A multirotor comes down within the acceptance radius of the point above home, m (WPNAV_RADIUS and NAV_ACC_RAD are 2 to 10 m), and what a
/// gust adds.
const TOUCHED_M: f64 = 6.0;

/// Whether the plan ends in a landing.
fn lands(made: &Plan) -> bool {
    made.mission.items.last().is_some_and(|i| i.command == 21)
}

/// Flies the plan to a minute in its hold, or to its landing at home; what went wrong, if anything.
fn flown(request: &Request, made: &Plan, seed: u64) -> Result<(), String> {
    let autopilot = request.airframe.autopilot;
    let mut vehicle = vehicle(request, seed);
    vehicle.items_mut().extend(made.mission.wire_items(autopilot).iter().map(wire));
    let last = vehicle.items().len() - 1;
    // After the take-off item the floor counts.
    let first = if autopilot == Autopilot::ArduPilot { 2 } else { 1 };
    vehicle.truth_at(1.0);
    assert!(vehicle.arm(true) && vehicle.set_mode(Mode::Auto));
    let frame = LocalFrame::new(HOME.place());
    let fence = LocalFence::new(&request.limits.fence, &frame);
    let slow = request.airframe.speed_min_m_per_s;
    let roll_out = slow * slow / (2.0 * request.airframe.braking_m_per_s2) + 4.0 * slow;
    let (mut t, mut arrived) = (1.0, None);
    while t < 700.0 && arrived.is_none_or(|a: f64| t < a + 60.0) {
        t += 0.1;
        let place = vehicle.truth_at(t).place;
        let lat_lon = LatLon { lat_deg: place.lat_rad.to_degrees(), lon_deg: place.lon_rad.to_degrees() };
        let (item, height) = (vehicle.current(), place.height_m - f64::from(HOME.alt_m));
        let clearance = fence.clearance(frame.to_local(lat_lon));
        if clearance <= 0.0 {
            return Err(format!("{:.0} m outside the fence at {t:.0} s, item {item}", -clearance));
        }
        let low = item > first && height < request.limits.floor_m - 1.0;
        let landing = lands(made) && (item == last || vehicle.has_landed());
        if height > request.limits.ceiling_m + 1.0 || (low && !landing) {
            return Err(format!("{height:.0} m high at {t:.0} s, item {item}"));
        }
        if vehicle.has_landed() {
            let beside = frame.to_local(lat_lon).norm();
            return if lands(made) && beside < roll_out + TOUCHED_M {
                Ok(())
            } else {
                Err(format!("landed {beside:.0} m from home"))
            };
        }
        if item == last && !lands(made) {
            arrived.get_or_insert(t);
        }
    }
    arrived.map(drop).ok_or_else(|| format!("still at item {} after {t:.0} s", vehicle.current()))
}

#[test]
fn what_is_planned_stays_inside_when_flown() {
    let (mut fine, mut landed, mut wrong) = (0, 0, Vec::new());
    for seed in 0..SEEDS {
        let request = request(seed);
        match plan(&request, Spread([0.0; 3])) {
            Err(refusal) => assert!(refusal.to_string().len() > 20, "{seed}: {refusal}"),
            Ok(made) => match flown(&request, &made, seed) {
                Ok(()) => {
                    fine += 1;
                    landed += u64::from(lands(&made));
                }
                Err(why) => wrong.push(format!("{seed} {}: {why}", request.airframe.name)),
            },
        }
    }
    assert!(wrong.is_empty(), "{fine} fine, wrong: {wrong:#?}");
    assert!(fine > SEEDS / 4, "only {fine} of {SEEDS} could be planned");
    assert!(landed > fine / 8, "only {landed} of {fine} end in a landing");
}
