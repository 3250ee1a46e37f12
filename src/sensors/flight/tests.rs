use super::*;
use crate::engine::situation::Control;
use crate::link::frame::Sender;
use crate::sensors::ConverterOptions;
use mavlink::dialects::ardupilotmega::{
    EXTENDED_SYS_STATE_DATA, GPS_RAW_INT_DATA, GpsFixType, HEARTBEAT_DATA, MISSION_CURRENT_DATA,
    MavAutopilot, MavLandedState, MavMessage, MavModeFlag, MavSeverity, MavState, MavType, RAW_IMU_DATA,
    STATUSTEXT_DATA,
};

/// A watch with its converter, fed with frames of system 1.
#[derive(Default)]
struct Bench {
    converter: Option<Converter>,
    watch: FlightWatch,
    sequence: u8,
}

impl Bench {
    fn take(&mut self, t_us: u64, message: &MavMessage) -> FlightReport {
        self.take_of(1, t_us, message)
    }

    fn take_of(&mut self, system_id: u8, t_us: u64, message: &MavMessage) -> FlightReport {
        let converter = self.converter.get_or_insert_with(|| Converter::new(ConverterOptions::default()));
        let frame = Frame::encode(Sender { system_id, component_id: 1 }, self.sequence, message);
        self.sequence = self.sequence.wrapping_add(1);
        converter.feed(t_us, &frame, &mut Vec::new());
        self.watch.feed(t_us, &frame, converter);
        self.watch.report().clone()
    }
}

fn heartbeat(kind: MavType, mode: u32, state: MavState, armed: bool) -> MavMessage {
    let base_mode = if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: mode,
        mavtype: kind,
        autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        base_mode,
        system_status: state,
        ..Default::default()
    })
}

fn plane(mode: u32, state: MavState) -> MavMessage {
    heartbeat(MavType::MAV_TYPE_FIXED_WING, mode, state, true)
}

fn landed(landed_state: MavLandedState) -> MavMessage {
    MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA { landed_state, ..Default::default() })
}

fn imu(time_usec: u64) -> MavMessage {
    MavMessage::RAW_IMU(RAW_IMU_DATA {
        time_usec,
        zacc: -1000,
        xgyro: (time_usec / 20_000 % 7) as i16,
        ..Default::default()
    })
}

/// ArduPlane 4.7: the mission ends, the aircraft rolls out and disarms in AUTO.
#[test]
fn a_vehicle_that_flew_has_flown_until_it_is_armed_again() {
    let mut bench = Bench::default();
    let beat = |state, armed| heartbeat(MavType::MAV_TYPE_FIXED_WING, 10, state, armed);
    let stands_by = MavState::MAV_STATE_STANDBY;
    let day = [
        (beat(stands_by, false), false),
        (beat(stands_by, true), false),
        (beat(MavState::MAV_STATE_ACTIVE, true), true),
        (beat(stands_by, true), true),
        (beat(stands_by, false), true),
        (beat(stands_by, true), false),
        (landed(MavLandedState::MAV_LANDED_STATE_IN_AIR), true),
        (beat(MavState::MAV_STATE_ACTIVE, false), true),
    ];
    for (k, (message, flown)) in day.into_iter().enumerate() {
        assert_eq!(bench.take(k as u64, &message).flown, flown, "{k}");
    }
}

#[test]
fn who_flies_follows_heartbeat_and_landed_state_of_the_vehicle_alone() {
    let mut bench = Bench::default();
    assert_eq!(FlightReport::default().control(), Control::Unknown);
    let now = bench.take(0, &heartbeat(MavType::MAV_TYPE_FIXED_WING, 10, MavState::MAV_STATE_STANDBY, false));
    assert_eq!(now.control(), Control::Ground);
    // ArduPilot stands by, armed, until it flies.
    assert_eq!(bench.take(1, &plane(10, MavState::MAV_STATE_STANDBY)).control(), Control::Ground);
    let now = bench.take(2, &plane(10, MavState::MAV_STATE_ACTIVE));
    assert_eq!(
        (now.control(), now.mode, now.mode_name.as_str()),
        (Control::Autopilot, FlightMode::Mission, "AUTO")
    );
    assert_eq!(bench.take(3, &plane(5, MavState::MAV_STATE_ACTIVE)).control(), Control::Pilot);
    assert_eq!(bench.take_of(2, 4, &plane(11, MavState::MAV_STATE_ACTIVE)).mode, FlightMode::Pilot);
    bench.take(5, &plane(10, MavState::MAV_STATE_ACTIVE));
    assert_eq!(bench.take(6, &landed(MavLandedState::MAV_LANDED_STATE_LANDING)).mode, FlightMode::Landing);
    let now = bench.take(7, &landed(MavLandedState::MAV_LANDED_STATE_ON_GROUND));
    assert_eq!(now.control(), Control::Ground);
    let current = MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA { seq: 12, ..Default::default() });
    assert_eq!(bench.take(8, &current).item, Some(12));
}

#[test]
fn failsafes_and_severe_texts_are_reported_and_texts_pass() {
    let mut bench = Bench::default();
    assert!(!bench.take(0, &plane(5, MavState::MAV_STATE_ACTIVE)).failsafe);
    assert!(bench.take(1, &plane(11, MavState::MAV_STATE_CRITICAL)).failsafe);
    let text = |severity, text: &str| {
        MavMessage::STATUSTEXT(STATUSTEXT_DATA { severity, text: text.into(), ..Default::default() })
    };
    let info = text(MavSeverity::MAV_SEVERITY_WARNING, "Mission: 3 WP");
    assert_eq!(bench.take(2, &info).alarm, "");
    let lane = text(MavSeverity::MAV_SEVERITY_CRITICAL, "EKF3 lane switch 1");
    assert_eq!(bench.take(3, &lane).alarm, "EKF3 lane switch 1");
    assert_eq!(bench.take(ALARM_US - 1, &plane(5, MavState::MAV_STATE_ACTIVE)).alarm, "EKF3 lane switch 1");
    assert_eq!(bench.take(ALARM_US + 4, &plane(5, MavState::MAV_STATE_ACTIVE)).alarm, "");
}

#[test]
fn a_second_vehicle_is_named_and_one_stray_heartbeat_is_none() {
    let mut bench = Bench::default();
    let copter = heartbeat(MavType::MAV_TYPE_QUADROTOR, 5, MavState::MAV_STATE_ACTIVE, true);
    let mut several = String::new();
    for second in 0..4 {
        bench.take(second * 1_000_000, &plane(5, MavState::MAV_STATE_ACTIVE));
        several = bench.take_of(2, second * 1_000_000 + 1, &copter).several;
        assert_eq!(several.is_empty(), second < 2, "{second}: {several}");
    }
    assert!(several.contains("system 1") && several.contains("system 2"), "{several}");
}

#[test]
fn lost_samples_are_a_share_of_the_last_seconds_and_missing_ones_have_an_age() {
    let mut bench = Bench::default();
    bench.take(0, &plane(5, MavState::MAV_STATE_ACTIVE));
    let mut losses = Vec::new();
    for k in 1..2000_u64 {
        let t_us = 20_000 * k;
        // Six of eleven frames between 10 and 20 s, in no even order.
        if (500..1000).contains(&k) && (k * k * 7 + k * 3) % 11 % 3 == 0 {
            bench.sequence = bench.sequence.wrapping_add(1);
            continue;
        }
        losses.push((k, bench.take(t_us, &imu(1_000_000 + t_us)).loss));
    }
    let at = |k: u64| losses.iter().find(|(n, _)| *n >= k).map_or(f64::NAN, |(_, loss)| *loss);
    assert!(
        at(490) == 0.0 && (at(900) - 6.0 / 11.0).abs() < 0.02 && at(1400) == 0.0,
        "{} {} {}",
        at(490),
        at(900),
        at(1400)
    );
    let now = bench.take(44_000_000, &plane(5, MavState::MAV_STATE_ACTIVE));
    assert!((now.samples_age_s - 4.0).abs() < 0.1, "{}", now.samples_age_s);
    let no_fix = GPS_RAW_INT_DATA { fix_type: GpsFixType::GPS_FIX_TYPE_NO_FIX, ..Default::default() };
    assert!(bench.take(44_000_001, &MavMessage::GPS_RAW_INT(no_fix)).no_fix);
}
