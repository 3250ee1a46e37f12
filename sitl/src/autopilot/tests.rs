use super::upset::GIMBAL_COMPONENT;
use super::*;
use crate::scenario::scenario;
use mavlink::Message;

/// A station on a perfect wire.
struct Station {
    autopilot: Autopilot,
    framer: Framer,
    sequence: u8,
}

impl Station {
    fn new(config: AutopilotConfig, name: &str) -> Self {
        let autopilot = Autopilot::playing(config, &scenario(name).unwrap());
        Self { autopilot, framer: Framer::new(), sequence: 0 }
    }

    fn send(&mut self, message: MavMessage) {
        let header = MavHeader { system_id: 255, component_id: 190, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        self.autopilot.receive(&encode(header, &message));
    }

    fn command(&mut self, command: MavCmd, params: &[f32]) {
        let p = |k: usize| params.get(k).copied().unwrap_or(0.0);
        self.send(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command,
            param1: p(0),
            param2: p(1),
            param3: p(2),
            target_system: 1,
            target_component: 1,
            ..Default::default()
        }));
    }

    fn set_interval(&mut self, id: u32, interval_us: f32) {
        self.command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, &[id as f32, interval_us]);
    }

    fn run(&mut self, until_s: f64) -> Vec<(MavHeader, MavMessage)> {
        self.autopilot.step(until_s);
        for frame in self.autopilot.take_output() {
            self.framer.push(&frame.bytes);
        }
        std::iter::from_fn(|| self.framer.next_message()).collect()
    }
}

fn ardupilot() -> AutopilotConfig {
    AutopilotConfig::default()
}

fn px4() -> AutopilotConfig {
    AutopilotConfig { flavour: Flavour::Px4, loop_rate_hz: 250.0, ..AutopilotConfig::default() }
}

fn fixes(messages: &[(MavHeader, MavMessage)]) -> Vec<GPS_RAW_INT_DATA> {
    messages
        .iter()
        .filter_map(|(_, m)| if let MavMessage::GPS_RAW_INT(g) = m { Some(g.clone()) } else { None })
        .collect()
}

fn raw_imus(messages: &[(MavHeader, MavMessage)]) -> Vec<RAW_IMU_DATA> {
    messages
        .iter()
        .filter(|(h, _)| h.component_id == 1)
        .filter_map(|(_, m)| if let MavMessage::RAW_IMU(r) = m { Some(r.clone()) } else { None })
        .collect()
}

#[test]
fn a_flight_waits_for_a_station_and_then_begins() {
    let mut station = Station::new(ardupilot(), "fixed_wing");
    station.run(30.0);
    assert!(station.autopilot.is_waiting());
    assert_eq!(station.autopilot.truth().v_n, Vector3::zeros());
    station.set_interval(RAW_IMU_DATA::ID, 5000.0);
    let messages = station.run(60.0);
    assert!(station.autopilot.truth().v_n.norm() > 15.0);
    assert!(messages.iter().any(|(_, m)| matches!(m, MavMessage::COMMAND_ACK(a)
        if a.result == MavResult::MAV_RESULT_ACCEPTED && a.target_system == 255)));
    assert!((5900..=6002).contains(&raw_imus(&messages).len()));
    station.run(340.0);
    assert!(station.autopilot.is_over());
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let bytes = |seed| {
        let mut station = Station::new(AutopilotConfig { seed, ..ardupilot() }, "multirotor");
        station.set_interval(HIGHRES_IMU_DATA::ID, 10_000.0);
        station.autopilot.step(20.0);
        station.autopilot.take_output()
    };
    assert_eq!(bytes(4), bytes(4));
    assert_ne!(bytes(4), bytes(5));
}

#[test]
fn ardupilot_stamps_when_it_sends_and_repeats_fixes() {
    let mut station = Station::new(ardupilot(), "fixed_wing");
    station.set_interval(RAW_IMU_DATA::ID, 5000.0);
    station.set_interval(GPS_RAW_INT_DATA::ID, 100_000.0);
    let messages = station.run(20.0);
    let late: Vec<f64> = raw_imus(&messages).iter().map(|r| (r.time_usec % 2500) as f64).collect();
    assert!(late.iter().any(|l| *l > 2000.0) && late.iter().any(|l| *l < 500.0));
    let stamps: Vec<u64> = fixes(&messages).iter().skip(10).map(|f| f.time_usec).collect();
    assert!(stamps.iter().all(|t| t % 1000 == 0));
    let repeated = stamps.windows(2).filter(|w| w[0] == w[1]).count();
    assert!((repeated * 2).abs_diff(stamps.len()) <= 2, "{repeated} of {}", stamps.len());
}

#[test]
fn fixes_say_what_the_receiver_knows() {
    let mut station = Station::new(ardupilot(), "fixed_wing");
    station.set_interval(GPS_RAW_INT_DATA::ID, 200_000.0);
    let messages = station.run(60.0);
    let last = fixes(&messages).pop().unwrap();
    let truth = station.autopilot.truth();
    assert!((f64::from(last.lat) * 1e-7 - truth.place.lat_rad.to_degrees()).abs() < 2e-4);
    assert_eq!(last.alt_ellipsoid - last.alt, 47_000);
    assert_eq!((last.h_acc, last.v_acc, last.vel_acc, last.yaw), (500, 800, 100, 0));
    assert!((f64::from(last.vel) / 100.0 - truth.v_n.xy().norm()).abs() < 1.0);
}

#[test]
fn px4_takes_its_bias_estimate_off_and_fills_in_without_a_fix() {
    let faults = vec![Fault::GnssLoss { from_s: 0.0, to_s: 100.0 }];
    let mut station = Station::new(AutopilotConfig { faults, wait_for_station: false, ..px4() }, "bench");
    station.set_interval(HIGHRES_IMU_DATA::ID, 20_000.0);
    station.set_interval(SCALED_IMU_DATA::ID, 20_000.0);
    station.set_interval(GPS_RAW_INT_DATA::ID, 200_000.0);
    let messages = station.run(95.0);
    let mean = |f: &dyn Fn(&MavMessage) -> Option<f64>| {
        let values: Vec<f64> = messages.iter().skip(messages.len() / 2).filter_map(|(_, m)| f(m)).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    let fine = mean(&|m| if let MavMessage::HIGHRES_IMU(h) = m { Some(f64::from(h.ygyro)) } else { None });
    let rough =
        mean(&|m| if let MavMessage::SCALED_IMU(s) = m { Some(f64::from(s.ygyro) * 1e-3) } else { None });
    let bias = station.autopilot.model().imu.gyro_bias[1];
    assert!((rough - fine - bias).abs() < 0.35 * bias.abs(), "{rough} {fine} {bias}");
    let fillers = fixes(&messages);
    assert!((94..=96).contains(&fillers.len()), "{}", fillers.len());
    assert!(fillers.iter().all(|f| f.fix_type == GpsFixType::GPS_FIX_TYPE_NO_GPS && f.vel == u16::MAX));
    assert!(raw_imus(&messages).is_empty());
}

#[test]
fn a_reboot_starts_the_clock_anew_and_forgets_the_rates() {
    let config = AutopilotConfig { faults: vec![Fault::Reboot { at_s: 10.0 }], ..ardupilot() };
    let mut station = Station::new(config, "fixed_wing");
    station.set_interval(RAW_IMU_DATA::ID, 10_000.0);
    let before = raw_imus(&station.run(10.0));
    assert!(before.last().unwrap().time_usec > 9_900_000);
    assert!(station.run(11.9).is_empty());
    let messages = station.run(20.0);
    let known = |f: &&GPS_RAW_INT_DATA| f.fix_type == GpsFixType::GPS_FIX_TYPE_3D_FIX;
    assert!(fixes(&messages).iter().filter(known).all(|f| (1..=8_000_000).contains(&f.time_usec)));
    let after = raw_imus(&messages);
    assert!(after[0].time_usec < 600_000);
    assert!(after.len() < 20, "{}", after.len());
}

#[test]
fn a_clock_jump_moves_the_stamps_only() {
    let config = AutopilotConfig { faults: vec![Fault::ClockJump { at_s: 5.0, by_s: 10.0 }], ..ardupilot() };
    let mut station = Station::new(config, "bench");
    station.set_interval(RAW_IMU_DATA::ID, 10_000.0);
    let imus = raw_imus(&station.run(10.0));
    let largest = imus.windows(2).map(|w| w[1].time_usec - w[0].time_usec).max().unwrap();
    assert!((10_000_000..10_020_000).contains(&largest), "{largest}");
}

#[test]
fn a_gimbal_talks_with_its_own_component_and_sequence() {
    let config = AutopilotConfig { faults: vec![Fault::Gimbal], ..ardupilot() };
    let mut station = Station::new(config, "bench");
    let messages = station.run(10.0);
    let sequences = |component| {
        let of = messages.iter().filter(move |(h, _)| h.component_id == component);
        of.map(|(h, _)| h.sequence).collect::<Vec<_>>()
    };
    for component in [1, GIMBAL_COMPONENT] {
        let s = sequences(component);
        assert!(s.len() > 10 && s.windows(2).all(|w| w[1] == w[0].wrapping_add(1)));
    }
}

#[test]
fn questions_are_answered() {
    let mut station = Station::new(ardupilot(), "bench");
    station.run(1.0);
    station.command(MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL, &[RAW_IMU_DATA::ID as f32]);
    station.command(MavCmd::MAV_CMD_REQUEST_MESSAGE, &[AUTOPILOT_VERSION_DATA::ID as f32]);
    station.command(MavCmd::MAV_CMD_DO_JUMP, &[]);
    station.send(MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: 12345, ..Default::default() }));
    let messages: Vec<MavMessage> = station.run(1.01).into_iter().map(|(_, m)| m).collect();
    let has = |f: &dyn Fn(&MavMessage) -> bool| messages.iter().any(f);
    assert!(has(&|m| matches!(m, MavMessage::MESSAGE_INTERVAL(i) if i.interval_us == 500_000)));
    assert!(has(&|m| matches!(m, MavMessage::AUTOPILOT_VERSION(_))));
    assert!(has(
        &|m| matches!(m, MavMessage::COMMAND_ACK(a) if a.result == MavResult::MAV_RESULT_UNSUPPORTED)
    ));
    assert!(has(&|m| matches!(m, MavMessage::TIMESYNC(t) if t.ts1 == 12345 && t.tc1 > 999_000_000)));
}

#[test]
fn commands_for_another_vehicle_are_left_alone() {
    let mut station = Station::new(ardupilot(), "bench");
    let other = COMMAND_LONG_DATA { target_system: 7, ..Default::default() };
    station.send(MavMessage::COMMAND_LONG(other));
    assert!(station.run(0.0).iter().all(|(_, m)| m.message_id() != COMMAND_ACK_DATA::ID));
}

#[test]
fn sim_state_is_the_truth() {
    let mut station = Station::new(ardupilot(), "fixed_wing");
    station.set_interval(SIM_STATE_DATA::ID, 20_000.0);
    let messages = station.run(80.0);
    let last = messages
        .iter()
        .rev()
        .find_map(|(_, m)| if let MavMessage::SIM_STATE(s) = m { Some(s.clone()) } else { None });
    let truth = station.autopilot.truth();
    let state = last.unwrap();
    assert!((f64::from(state.zacc) - truth.force.z).abs() < 1e-5);
    assert!((f64::from(state.vn) - truth.v_n.x).abs() < 1e-5);
    assert_eq!(state.lat_int, messages::degrees_e7(truth.place.lat_rad));
}

fn waypoint(seq: u16, command: MavCmd, north_m: f64, z: f32) -> MISSION_ITEM_INT_DATA {
    MISSION_ITEM_INT_DATA {
        seq,
        command,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        param4: f32::NAN,
        x: 473_977_000 + (north_m * 89.93) as i32,
        y: 85_456_000,
        z,
        target_system: 1,
        ..Default::default()
    }
}

/// Uploads over the wire, answering what is asked; returns what the autopilot said at the end.
fn upload(station: &mut Station, items: &[MISSION_ITEM_INT_DATA]) -> MISSION_ACK_DATA {
    let count = MISSION_COUNT_DATA { count: items.len() as u16, target_system: 1, ..Default::default() };
    station.send(MavMessage::MISSION_COUNT(count));
    for _ in 0..1000 {
        let now = station.autopilot.now_s();
        for (_, message) in station.run(now + 0.05) {
            match message {
                MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA { seq, .. })
                | MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA { seq, .. }) => {
                    station.send(MavMessage::MISSION_ITEM_INT(items[usize::from(seq)].clone()));
                }
                MavMessage::MISSION_ACK(ack) => return ack,
                _ => {}
            }
        }
    }
    panic!("the upload does not end")
}

/// A loiter to altitude ends at its height: an aircraft that cannot climb in the circle stays at that item, at full throttle and
/// without a word.
#[test]
fn a_loiter_to_altitude_never_ends_where_the_aircraft_cannot_climb() {
    for (faults, passed) in [(vec![], true), (vec!["no-climb-in-circles".parse().unwrap()], false)] {
        let config = AutopilotConfig { faults, loop_rate_hz: 50.0, ..ardupilot() };
        let mut station = Station::new(config, "mission_fixed_wing");
        station.run(1.0);
        let circle = MISSION_ITEM_INT_DATA {
            param2: 80.0,
            param4: 0.0,
            ..waypoint(2, MavCmd::MAV_CMD_NAV_LOITER_TO_ALT, 500.0, 300.0)
        };
        let items = [
            waypoint(0, MavCmd::MAV_CMD_NAV_WAYPOINT, 0.0, 0.0),
            waypoint(1, MavCmd::MAV_CMD_NAV_TAKEOFF, 300.0, 50.0),
            circle,
            waypoint(3, MavCmd::MAV_CMD_NAV_WAYPOINT, 1500.0, 300.0),
        ];
        assert_eq!(upload(&mut station, &items).mavtype, MavMissionResult::MAV_MISSION_ACCEPTED);
        station.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
        station.command(MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 10.0]);
        let messages = station.run(240.0);
        let reached =
            messages.iter().any(|(_, m)| matches!(m, MavMessage::MISSION_ITEM_REACHED(r) if r.seq == 2));
        assert_eq!(reached, passed);
        assert!(station.autopilot.vehicle().is_some_and(|v| v.is_armed()));
    }
}

fn last_ack(messages: &[(MavHeader, MavMessage)]) -> Option<MavResult> {
    messages
        .iter()
        .rev()
        .find_map(|(_, m)| if let MavMessage::COMMAND_ACK(a) = m { Some(a.result) } else { None })
}

#[test]
fn an_uploaded_mission_is_flown_only_when_commanded() {
    for (config, auto) in [(ardupilot(), [3.0, 0.0]), (px4(), [4.0, 4.0])] {
        let first = u16::from(config.flavour == Flavour::ArduPilot);
        let mut station = Station::new(config, "mission_multirotor");
        station.run(3.0);
        let mut items = vec![
            waypoint(first, MavCmd::MAV_CMD_NAV_TAKEOFF, 0.0, 15.0),
            waypoint(first + 1, MavCmd::MAV_CMD_NAV_WAYPOINT, 60.0, 15.0),
            waypoint(first + 2, MavCmd::MAV_CMD_NAV_LAND, 60.0, 0.0),
        ];
        if first == 1 {
            items.insert(0, waypoint(0, MavCmd::MAV_CMD_NAV_WAYPOINT, 0.0, 0.0));
        }
        assert_eq!(upload(&mut station, &items).mavtype, MavMissionResult::MAV_MISSION_ACCEPTED);
        station.run(20.0);
        assert_eq!(station.autopilot.truth().v_n, Vector3::zeros());

        station.command(MavCmd::MAV_CMD_MISSION_START, &[]);
        assert_eq!(last_ack(&station.run(20.1)), Some(MavResult::MAV_RESULT_FAILED), "not armed");
        station.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
        station.command(MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, auto[0], auto[1]]);
        let messages = station.run(120.0);
        let mut reached: Vec<u16> = messages
            .iter()
            .filter_map(|(_, m)| if let MavMessage::MISSION_ITEM_REACHED(r) = m { Some(r.seq) } else { None })
            .collect();
        reached.dedup();
        assert_eq!(reached[..2], [first, first + 1]);
        let armed_auto = messages.iter().any(|(_, m)| {
            matches!(m, MavMessage::HEARTBEAT(h)
            if h.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED) && h.custom_mode != 0)
        });
        assert!(armed_auto && station.autopilot.has_landed());
    }
}

#[test]
fn streams_slow_down_while_ardupilot_takes_a_mission() {
    let mut station = Station::new(ardupilot(), "mission_fixed_wing");
    station.set_interval(RAW_IMU_DATA::ID, 5000.0);
    station.run(2.0);
    station.send(MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
        count: 3,
        target_system: 1,
        ..Default::default()
    }));
    let slow = raw_imus(&station.run(4.0)).len();
    assert!((95..=110).contains(&slow), "{slow}");
}
