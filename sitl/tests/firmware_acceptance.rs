//! Plans of every shipped airframe for both autopilots, over the wire: judged by the table of firmware rules, uploaded to a simulated
//! autopilot as strict as the firmware, read back, flown and landed.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic, as tests do")]
#![allow(deprecated, reason = "vehicles speak what the dialect calls superseded")]

mod support;

use gaware_mission::airframe::{Airframe, EXAMPLES};
use gaware_mission::compare::differences;
use gaware_mission::fence::{Fence, FenceCircle};
use gaware_mission::item::{Autopilot, Frame, Home, Mission, MissionItem, command};
use gaware_mission::planner::{Plan, Request, climb_out, plan};
use gaware_mission::rules::{self, Firmware, feasibility::Infeasible};
use gaware_mission::safety::Limits;
use gaware_nav::earth::Geodetic;
use gaware_sitl::autopilot::{self, AutopilotConfig, Flavour};
use gaware_sitl::scenario::scenario;
use gaware_sitl::vehicle::VehicleConfig;
use gaware_wire::frame::encode;
use gaware_wire::framer::Framer;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::*;
use nalgebra::Vector3;
use support::Spread;

const HOME: Home = Home { lat_e7: 474_000_000, lon_e7: 85_000_000, alt_m: 450.0 };
const WIND: [f64; 3] = [3.0, -2.0, 0.0];
const GEOID_M: f64 = 47.0;

fn airframe(name: &str, autopilot: Autopilot) -> Airframe {
    Airframe::example(name).unwrap().flown_by(autopilot)
}

fn made(airframe: &Airframe, radius_m: f64) -> Plan {
    let circle = FenceCircle { inclusion: true, center: HOME.place(), radius_m };
    let fence = Fence { polygons: Vec::new(), circles: vec![circle] };
    let height = 90.0;
    let request = Request {
        start: climb_out(airframe, HOME, 0.0, height, &Vector3::from(WIND)),
        airframe: airframe.clone(),
        home: HOME,
        take_off: true,
        landing: true,
        start_height_m: height,
        start_heading_deg: 0.0,
        limits: Limits { fence, floor_m: 45.0, ceiling_m: 150.0, wind_ned_m_per_s: WIND },
        budget_s: 200.0,
        within_reach_only: false,
        fix_interval_s: 0.2,
        beam: 1,
    };
    plan(&request, Spread([0.0; 3])).unwrap()
}

fn vehicle(a: &Airframe) -> VehicleConfig {
    let base = if a.is_fixed_wing() { VehicleConfig::fixed_wing() } else { VehicleConfig::multirotor() };
    let height = f64::from(HOME.alt_m) + GEOID_M;
    VehicleConfig {
        start: Geodetic::from_degrees(HOME.place().lat_deg, HOME.place().lon_deg, height),
        heading_rad: 0.0,
        // Not the speed of the plan: a multirotor's mission must set it.
        cruise_m_per_s: if a.is_fixed_wing() { a.speed_cruise_m_per_s } else { 0.4 * a.speed_cruise_m_per_s },
        min_m_per_s: a.speed_min_m_per_s,
        max_m_per_s: a.speed_max_m_per_s,
        max_bank_rad: a.bank_max_deg.to_radians(),
        climb_m_per_s: a.climb_max_m_per_s,
        sink_m_per_s: a.descent_max_m_per_s,
        accel_m_per_s2: a.acceleration_m_per_s2,
        loiter_radius_m: a.turn_radius_min_m,
        wind_n_e_m_per_s: [WIND[0], WIND[1]],
        ..base
    }
}

/// A station on the wire of one simulated autopilot.
struct Station {
    autopilot: autopilot::Autopilot,
    framer: Framer,
    sequence: u8,
}

impl Station {
    fn new(airframe: &Airframe) -> Self {
        let name = if airframe.is_fixed_wing() { "mission_fixed_wing" } else { "mission_multirotor" };
        let scenario = scenario(name).unwrap();
        let flavour = match airframe.autopilot {
            Autopilot::ArduPilot => Flavour::ArduPilot,
            Autopilot::Px4 => Flavour::Px4,
        };
        let config = AutopilotConfig {
            flavour,
            geoid_height_m: GEOID_M,
            loop_rate_hz: 50.0,
            ..AutopilotConfig::default()
        };
        let autopilot = autopilot::Autopilot::flying(
            config,
            vehicle(airframe),
            &scenario.model,
            scenario.sensors.clone(),
        );
        Self { autopilot, framer: Framer::new(), sequence: 0 }
    }

    fn send(&mut self, message: &MavMessage) {
        let header = MavHeader { system_id: 255, component_id: 190, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        self.autopilot.receive(&encode(header, message));
    }

    fn command(&mut self, command: MavCmd, params: [f32; 3]) -> Vec<MavMessage> {
        let [param1, param2, param3] = params;
        let message = COMMAND_LONG_DATA {
            command,
            param1,
            param2,
            param3,
            target_system: 1,
            target_component: 1,
            ..Default::default()
        };
        self.send(&MavMessage::COMMAND_LONG(message));
        self.run(0.05)
    }

    fn run(&mut self, for_s: f64) -> Vec<MavMessage> {
        self.autopilot.step(self.autopilot.now_s() + for_s);
        for out in self.autopilot.take_output() {
            self.framer.push(&out.bytes);
        }
        std::iter::from_fn(|| self.framer.next_message()).map(|(_, message)| message).collect()
    }

    fn upload(&mut self, items: &[MissionItem]) -> MavMissionResult {
        let count = MISSION_COUNT_DATA { count: items.len() as u16, target_system: 1, ..Default::default() };
        self.send(&MavMessage::MISSION_COUNT(count));
        for _ in 0..10 * items.len() {
            for message in self.run(0.02) {
                match message {
                    MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA { seq, .. })
                    | MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA { seq, .. }) => {
                        self.send(&MavMessage::MISSION_ITEM_INT(wire(&items[usize::from(seq)], seq)));
                    }
                    MavMessage::MISSION_ACK(ack) => return ack.mavtype,
                    _ => {}
                }
            }
        }
        panic!("the upload does not end")
    }

    fn download(&mut self) -> Vec<MissionItem> {
        let list = MISSION_REQUEST_LIST_DATA { target_system: 1, ..Default::default() };
        self.send(&MavMessage::MISSION_REQUEST_LIST(list));
        let mut items = Vec::new();
        let mut count = None;
        while count.is_none_or(|c| items.len() < c) {
            for message in self.run(0.02) {
                match message {
                    MavMessage::MISSION_COUNT(c) => count = Some(usize::from(c.count)),
                    MavMessage::MISSION_ITEM_INT(i) => items.push(read(&i)),
                    _ => {}
                }
            }
            let seq = items.len() as u16;
            let request = MISSION_REQUEST_INT_DATA { seq, target_system: 1, ..Default::default() };
            if count.is_some_and(|c| items.len() < c) {
                self.send(&MavMessage::MISSION_REQUEST_INT(request));
            }
        }
        self.send(&MavMessage::MISSION_ACK(MISSION_ACK_DATA { target_system: 1, ..Default::default() }));
        items
    }
}

fn wire(item: &MissionItem, seq: u16) -> MISSION_ITEM_INT_DATA {
    let [param1, param2, param3, param4] = item.params;
    let frame = match item.frame.on_wire() {
        Frame::MISSION => MavFrame::MAV_FRAME_MISSION,
        Frame::GLOBAL_INT => MavFrame::MAV_FRAME_GLOBAL_INT,
        _ => MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    };
    let command = match item.command {
        command::NAV_WAYPOINT => MavCmd::MAV_CMD_NAV_WAYPOINT,
        command::NAV_LOITER_UNLIM => MavCmd::MAV_CMD_NAV_LOITER_UNLIM,
        command::NAV_LOITER_TURNS => MavCmd::MAV_CMD_NAV_LOITER_TURNS,
        command::NAV_LOITER_TIME => MavCmd::MAV_CMD_NAV_LOITER_TIME,
        command::NAV_LAND => MavCmd::MAV_CMD_NAV_LAND,
        command::NAV_TAKEOFF => MavCmd::MAV_CMD_NAV_TAKEOFF,
        command::NAV_LOITER_TO_ALT => MavCmd::MAV_CMD_NAV_LOITER_TO_ALT,
        command::CONDITION_YAW => MavCmd::MAV_CMD_CONDITION_YAW,
        command::DO_CHANGE_SPEED => MavCmd::MAV_CMD_DO_CHANGE_SPEED,
        other => panic!("the planner uses command {other}"),
    };
    let (x, y, z) = (item.x, item.y, item.z);
    let ends = MISSION_ITEM_INT_DATA { seq, target_system: 1, autocontinue: 1, ..Default::default() };
    MISSION_ITEM_INT_DATA { command, frame, param1, param2, param3, param4, x, y, z, ..ends }
}

fn read(i: &MISSION_ITEM_INT_DATA) -> MissionItem {
    MissionItem {
        command: i.command as u32 as u16,
        frame: Frame(i.frame as u32 as u8),
        autocontinue: i.autocontinue != 0,
        params: [i.param1, i.param2, i.param3, i.param4],
        x: i.x,
        y: i.y,
        z: i.z,
    }
}

/// As two NaN are, and angles after a trip through radians.
fn same(a: f32, b: f32) -> bool {
    a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-4 * a.abs().max(1.0)
}

/// Flies the mission on board; the items reached and whether it stands again.
fn fly(station: &mut Station, items: usize, airframe: &Airframe) -> (u16, bool) {
    let (px4, lands) = (airframe.autopilot == Autopilot::Px4, airframe.is_fixed_wing());
    station.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0]);
    let auto = match (px4, lands) {
        (true, _) => [1.0, 4.0, 4.0],
        (false, true) => [1.0, 10.0, 0.0],
        (false, false) => [1.0, 3.0, 0.0],
    };
    station.command(MavCmd::MAV_CMD_DO_SET_MODE, auto);
    let mut reached = 0;
    let last = (items - usize::from(px4)) as u16;
    for _ in 0..900 {
        for message in station.run(1.0) {
            if let MavMessage::MISSION_ITEM_REACHED(r) = message {
                reached = reached.max(r.seq);
            }
        }
        if !lands && station.autopilot.vehicle().is_some_and(|v| v.current() == usize::from(last)) {
            // A multirotor holds at the end until it is told to land.
            let land = if px4 { [1.0, 4.0, 6.0] } else { [1.0, 9.0, 0.0] };
            station.command(MavCmd::MAV_CMD_DO_SET_MODE, land);
        }
        if station.autopilot.has_landed() {
            break;
        }
    }
    (reached, station.autopilot.has_landed())
}

#[test]
fn every_plan_is_taken_read_back_flown_and_landed_by_both_autopilots() {
    for (name, _) in EXAMPLES {
        for autopilot in [Autopilot::ArduPilot, Autopilot::Px4] {
            let airframe = airframe(name, autopilot);
            let made = made(&airframe, 2000.0);
            let items = made.mission.items.len();
            let told = format!("{name}, {autopilot:?}, {items} items");
            let judged = rules::check(&made.mission, Some(autopilot), autopilot, airframe.kind);
            assert!(judged.is_ok(), "{told}: {judged:?}");

            let mut station = Station::new(&airframe);
            station.run(1.0);
            let sent = made.mission.wire_items(autopilot);
            assert_eq!(station.upload(&sent), MavMissionResult::MAV_MISSION_ACCEPTED, "{told}");
            let after = station.run(2.0);
            assert!(after.iter().all(|m| !matches!(m, MavMessage::EVENT(_))), "{told}: {after:?}");

            let got = station.download();
            let firmware = Firmware::of(autopilot, airframe.kind);
            for (k, (sent, got)) in sent.iter().zip(&got).enumerate().skip(sent.len() - items) {
                let stored = rules::stored_item(sent, firmware);
                let params = stored.params.iter().zip(got.params).all(|(a, b)| same(*a, b));
                let place = (stored.x, stored.y, stored.frame) == (got.x, got.y, got.frame);
                assert!(params && place && same(stored.z, got.z), "{told}, {k}: {stored:?} {got:?}");
            }
            let got = Mission::from_wire_items(autopilot, &got);
            assert_eq!(differences(autopilot, &made.mission, &got), vec![], "{told}");

            let (reached, landed) = fly(&mut station, items, &airframe);
            assert!(landed, "{told}: at item {reached} when time was over");
        }
    }
}

/// What PX4's own firmware said of a plan without a landing: accepted, then rejected by EVENT alone, and not to be armed.
#[test]
fn px4_takes_a_mission_without_a_landing_and_rejects_it_afterwards() {
    let airframe = airframe("large_fixed_wing", Autopilot::Px4);
    let mut mission = made(&airframe, 2000.0).mission;
    mission.items.retain(|i| i.command != command::NAV_LAND);
    let refused = rules::check(&mission, None, Autopilot::Px4, airframe.kind);
    assert_eq!(refused, Err(Infeasible::LandingMissing.into()));

    let mut station = Station::new(&airframe);
    station.run(1.0);
    assert_eq!(station.upload(&mission.wire_items(Autopilot::Px4)), MavMissionResult::MAV_MISSION_ACCEPTED);
    let events: Vec<u32> = station
        .run(2.0)
        .iter()
        .filter_map(|m| if let MavMessage::EVENT(e) = m { Some(e.id & 0xff_ffff) } else { None })
        .collect();
    assert_eq!(events, [0x81_1691]);
    let answers = station.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0]);
    let armed = answers
        .iter()
        .any(|m| matches!(m, MavMessage::COMMAND_ACK(a) if a.result == MavResult::MAV_RESULT_ACCEPTED));
    assert!(!armed, "{answers:?}");
    // A mission that is all right takes the rejection back.
    let fine = made(&airframe, 2000.0).mission;
    station.upload(&fine.wire_items(Autopilot::Px4));
    station.run(2.0);
    let answers = station.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0]);
    let armed = answers
        .iter()
        .any(|m| matches!(m, MavMessage::COMMAND_ACK(a) if a.result == MavResult::MAV_RESULT_ACCEPTED));
    assert!(armed);
}

/// The plan that no real ArduPilot took: `null` in parameter 4 of its circles.
#[test]
fn a_circle_with_nan_is_refused_by_the_table_and_by_the_vehicle() {
    let airframe = airframe("small_fixed_wing", Autopilot::ArduPilot);
    let mut mission = made(&airframe, 2000.0).mission;
    let circle = mission.items.iter().position(|i| i.command == command::NAV_LOITER_TURNS).unwrap();
    mission.items[circle].params[3] = f32::NAN;
    let refused = rules::check(&mission, None, Autopilot::ArduPilot, airframe.kind);
    let words =
        format!("item {} (loiter turns, command 18): ArduPlane refuses NaN in parameter 4", circle + 1);
    assert!(refused.is_err_and(|e| e.to_string().starts_with(&words)));
    let mut station = Station::new(&airframe);
    station.run(1.0);
    let answer = station.upload(&mission.wire_items(Autopilot::ArduPilot));
    assert_eq!(answer, MavMissionResult::MAV_MISSION_INVALID_PARAM4);
}
