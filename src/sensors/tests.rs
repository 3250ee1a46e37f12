//! The converter on made-up frames, then on recorded flights.

use super::*;
use crate::link::frame::Sender;
use crate::logs::{self, Item};
use gaware_nav::math::{cos, sin};
use mavlink::dialects::ardupilotmega::{
    ATTITUDE_DATA, GpsFixType, HEARTBEAT_DATA, MavAutopilot, MavModeFlag, MavType, RAW_IMU_DATA,
    SCALED_IMU_DATA,
};
use proptest::prelude::*;
use std::path::PathBuf;

const VEHICLE: Sender = Sender { system_id: 1, component_id: 1 };

struct Bench {
    converter: Converter,
    out: Vec<Sample>,
}

impl Bench {
    fn new() -> Self {
        Self { converter: Converter::new(ConverterOptions::default()), out: Vec::new() }
    }

    fn send_as(&mut self, from: Sender, message: MavMessage) {
        self.converter.feed(0, &Frame::encode(from, 0, &message), &mut self.out);
    }

    fn heartbeat(&mut self, from: Sender, autopilot: MavAutopilot, mavtype: MavType) {
        self.send_as(
            from,
            MavMessage::HEARTBEAT(HEARTBEAT_DATA { autopilot, mavtype, ..Default::default() }),
        );
    }

    fn ardupilot() -> Self {
        let mut bench = Self::new();
        bench.heartbeat(VEHICLE, MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, MavType::MAV_TYPE_FIXED_WING);
        bench
    }

    /// `RAW_IMU` every 20 ms over this span.
    fn raw_imu(&mut self, span_ms: std::ops::Range<u64>) {
        for ms in span_ms.step_by(20) {
            let m = RAW_IMU_DATA { time_usec: ms * 1000, zacc: -1000, ..Default::default() };
            self.send_as(VEHICLE, MavMessage::RAW_IMU(m));
        }
    }

    fn gps(&mut self, ms: u64, fix_type: GpsFixType) {
        let m = GPS_RAW_INT_DATA {
            time_usec: ms * 1000,
            lat: 473_977_420,
            lon: 85_455_940,
            fix_type,
            ..Default::default()
        };
        self.send_as(VEHICLE, MavMessage::GPS_RAW_INT(m));
    }

    fn restarts(&self) -> Vec<RestartReason> {
        self.out.iter().filter_map(|s| if let Sample::Restart(r) = s { Some(*r) } else { None }).collect()
    }
}

const FIX: GpsFixType = GpsFixType::GPS_FIX_TYPE_3D_FIX;

/// Pressures and airspeed reach the samples, each sensor with its own number.
#[test]
fn what_a_link_says_of_the_air_becomes_samples() {
    use mavlink::dialects::ardupilotmega::{
        AIRSPEED_DATA, SCALED_PRESSURE_DATA, SCALED_PRESSURE2_DATA, SCALED_PRESSURE3_DATA,
    };
    let mut bench = Bench::ardupilot();
    // The source of the inertial samples is chosen first: there is no time base before.
    bench.raw_imu(1000..6000);
    let (time_boot_ms, press_abs) = (5990, 950.0);
    let first = SCALED_PRESSURE_DATA { time_boot_ms, press_abs, ..Default::default() };
    let second = SCALED_PRESSURE2_DATA { time_boot_ms, press_abs, ..Default::default() };
    let third = SCALED_PRESSURE3_DATA { time_boot_ms, press_abs, ..Default::default() };
    let pitot = AIRSPEED_DATA { airspeed: 17.0, ..Default::default() };
    for message in [
        MavMessage::SCALED_PRESSURE(first),
        MavMessage::SCALED_PRESSURE2(second),
        MavMessage::SCALED_PRESSURE3(third),
        MavMessage::AIRSPEED(pitot),
    ] {
        bench.send_as(VEHICLE, message);
    }
    let air = bench.out.iter().filter_map(|s| match s {
        Sample::Air(a) => Some((a.kind, a.sensor, a.value)),
        _ => None,
    });
    use gaware_nav::sample::AirKind::{Airspeed, Barometer};
    let expected =
        [(Barometer, 0, 95_000.0), (Barometer, 1, 95_000.0), (Barometer, 2, 95_000.0), (Airspeed, 0, 17.0)];
    assert_eq!(air.collect::<Vec<_>>(), expected);
}

#[test]
fn the_stream_is_announced_before_its_first_sample() {
    let mut bench = Bench::ardupilot();
    bench.raw_imu(5000..8000);
    assert_eq!(bench.out[0], Sample::Stream(ImuSource::RawImu.stream()));
    let imu = bench.out.iter().filter(|s| matches!(s, Sample::Imu(_))).count();
    assert_eq!(imu, 100, "the first second serves the choice");
    assert!(bench.restarts().is_empty());
    assert!(bench.converter.take_notices().iter().any(|n| n.to_string().contains("RAW_IMU")));
}

/// A heartbeat of the vehicle, armed or not.
fn armed(bench: &mut Bench, autopilot: MavAutopilot, armed: bool) {
    let base_mode = if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
    let mavtype = MavType::MAV_TYPE_FIXED_WING;
    bench.send_as(
        VEHICLE,
        MavMessage::HEARTBEAT(HEARTBEAT_DATA { autopilot, mavtype, base_mode, ..Default::default() }),
    );
}

#[test]
fn px4_changes_its_calibration_when_it_is_disarmed() {
    let changes = |autopilot: MavAutopilot| {
        let mut bench = Bench::new();
        let states = [false, false, true, true, false, false, true, false];
        states.into_iter().for_each(|is_armed| armed(&mut bench, autopilot, is_armed));
        bench.out.iter().filter(|s| **s == Sample::Recalibrated).count()
    };
    assert_eq!(changes(MavAutopilot::MAV_AUTOPILOT_PX4), 2);
    assert_eq!(changes(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA), 0);
}

#[test]
fn others_on_the_link_are_ignored() {
    let mut bench = Bench::new();
    let station = Sender { system_id: 255, component_id: 190 };
    let gimbal = Sender { system_id: 1, component_id: 154 };
    let other = Sender { system_id: 2, component_id: 1 };
    bench.heartbeat(station, MavAutopilot::MAV_AUTOPILOT_INVALID, MavType::MAV_TYPE_GCS);
    bench.heartbeat(gimbal, MavAutopilot::MAV_AUTOPILOT_INVALID, MavType::MAV_TYPE_GIMBAL);
    bench.heartbeat(VEHICLE, MavAutopilot::MAV_AUTOPILOT_PX4, MavType::MAV_TYPE_QUADROTOR);
    bench.heartbeat(other, MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, MavType::MAV_TYPE_FIXED_WING);
    // Whoever sends inertial data and was followed is followed on.
    for ms in 0..5 {
        let m = SCALED_IMU_DATA { time_boot_ms: ms, ..Default::default() };
        bench.send_as(VEHICLE, MavMessage::SCALED_IMU(m));
    }
    for ms in (0..3000).step_by(10) {
        for from in [gimbal, other] {
            let m = RAW_IMU_DATA { time_usec: ms * 1000, ..Default::default() };
            bench.send_as(from, MavMessage::RAW_IMU(m));
        }
    }
    assert!(bench.out.is_empty());
    assert_eq!(bench.converter.vehicle(), Some(1));
    assert_eq!(bench.converter.autopilot(), Autopilot::Px4);
    assert_eq!(bench.converter.stats().foreign, 2 + 1 + 600);
}

#[test]
fn a_kind_of_vehicle_that_the_dialect_does_not_have_is_one_still() {
    let mut bench = Bench::new();
    // Mode 3, MAV_TYPE 200 and MAV_STATE 77, armed.
    let frame = Frame::of_payload(VEHICLE, 0, 0, &[3, 0, 0, 0, 200, 3, 128, 77, 3]).unwrap();
    bench.converter.feed(0, &frame, &mut bench.out);
    assert_eq!((bench.converter.vehicle(), bench.converter.autopilot()), (Some(1), Autopilot::Ardupilot));
    assert_eq!(bench.converter.stats().undecodable, 0);
}

#[test]
fn a_vehicle_without_a_heartbeat_is_taken_after_a_while() {
    let mut bench = Bench::new();
    bench.raw_imu(0..6000);
    assert_eq!(bench.converter.vehicle(), Some(1));
    assert!(bench.converter.stats().time.imu_samples > 50);
}

#[test]
fn a_reboot_is_one_restart_and_fixes_go_on() {
    let mut bench = Bench::ardupilot();
    bench.raw_imu(60_000..63_000);
    bench.gps(62_900, FIX);
    // The first fix after the reboot comes before inertial samples prove it, and has no place.
    bench.gps(1_900, FIX);
    bench.raw_imu(2_000..5_000);
    bench.gps(4_900, FIX);
    assert_eq!(bench.restarts(), vec![RestartReason::Reboot]);
    let stats = bench.converter.stats();
    assert_eq!((stats.time.fixes, stats.time.fix_misplaced, stats.time.imu_unconfirmed), (2, 1, 0));
    let Some(Sample::Fix(last)) = bench.out.last() else { panic!("no fix") };
    assert!((last.t_s - 4.9).abs() < 1e-9);
}

/// `.bin` and `.ulg` hold measurements, not frames.
#[test]
fn a_sensor_that_no_longer_measures_is_found_in_logs_without_frames_too() {
    let mut bench = Bench::new();
    let mut take = |measurement| bench.converter.take(&measurement, &mut bench.out);
    take(Measurement::Stream(gaware_nav::sample::ImuStream::default()));
    for k in 0..1500_u32 {
        let t_s = 10.0 + f64::from(k) * 0.02;
        // Alive for 20 s, then frozen.
        let alive = if k < 1000 { t_s } else { 30.0 };
        let gyro = nalgebra::Vector3::new(0.5 * sin(alive), 0.3 * cos(1.3 * alive), 0.1 * sin(0.7 * alive));
        let accel = nalgebra::Vector3::new(sin(alive), 0.5 * cos(alive), -9.8 + 2.0 * sin(0.9 * alive));
        let sample = ImuSample { t_s, gyro, accel, temperature_degc: None };
        take(Measurement::Imu(Stamp::Usec((t_s * 1e6) as u64), sample));
    }
    let stats = bench.converter.stats();
    assert!((400..=460).contains(&stats.imu_stuck), "{stats:?}");
    assert_eq!(bench.restarts(), vec![RestartReason::SensorFault]);
    let stuck = |n: &Notice| matches!(n, Notice::SensorStuck { .. });
    assert!(bench.converter.take_notices().iter().any(stuck));
}

#[test]
fn repeated_fixes_and_missing_fixes_are_counted() {
    let mut bench = Bench::ardupilot();
    bench.raw_imu(0..3000);
    bench.gps(2800, FIX);
    bench.gps(2800, FIX);
    bench.gps(2900, GpsFixType::GPS_FIX_TYPE_2D_FIX);
    let stats = bench.converter.stats();
    assert_eq!((stats.time.fixes, stats.time.fix_duplicates, stats.no_fix), (1, 1, 1));
    let notices = bench.converter.take_notices();
    assert_eq!(notices[notices.len() - 2..], [Notice::FixGained, Notice::NoFix]);
}

#[test]
fn a_source_that_falls_silent_is_replaced() {
    let mut bench = Bench::ardupilot();
    bench.raw_imu(0..3000);
    for ms in (3000..10_000_u32).step_by(20) {
        bench.send_as(
            VEHICLE,
            MavMessage::SCALED_IMU(SCALED_IMU_DATA { time_boot_ms: ms, zacc: -1000, ..Default::default() }),
        );
    }
    assert_eq!(bench.restarts(), vec![RestartReason::SourceChange]);
    let at = bench.out.iter().position(|s| matches!(s, Sample::Restart(_))).unwrap();
    assert_eq!(bench.out[at + 1], Sample::Stream(ImuSource::ScaledImu.stream()));
    assert!(matches!(bench.out[at + 2], Sample::Imu(_)));
}

#[test]
fn a_low_rate_is_told_and_settled() {
    let mut bench = Bench::ardupilot();
    for second in 0..10 {
        let m = RAW_IMU_DATA { time_usec: second * 1_000_000, ..Default::default() };
        bench.send_as(VEHICLE, MavMessage::RAW_IMU(m));
    }
    bench.raw_imu(10_000..14_000);
    let notices = bench.converter.take_notices();
    let low = notices.iter().find(|n| matches!(n, Notice::RateTooLow { .. })).unwrap();
    let good = notices.last().unwrap();
    assert!(good.settles(low), "{notices:?}");
}

#[test]
fn attitude_is_a_hint_on_the_same_base() {
    let mut bench = Bench::ardupilot();
    bench.raw_imu(0..2000);
    let m = ATTITUDE_DATA { time_boot_ms: 1990, roll: 0.5, ..Default::default() };
    bench.send_as(VEHICLE, MavMessage::ATTITUDE(m));
    let Some(Sample::Attitude(hint)) = bench.out.last() else { panic!("no hint") };
    assert_eq!((hint.t_s, hint.roll_pitch_yaw), (1.99, [0.5, 0.0, 0.0]));
}

proptest! {
    /// Any payload in any relevant message: no panic, and inertial time only goes back across a restart.
    #[test]
    fn any_payload_is_survived(
        messages in proptest::collection::vec(
            (prop::sample::select(vec![0_u8, 2, 24, 26, 27, 30, 105, 116, 129]),
             proptest::collection::vec(any::<u8>(), 0..64)), 1..200),
    ) {
        let mut bench = Bench::ardupilot();
        bench.raw_imu(0..1100);
        for (id, payload) in messages {
            let mut raw = vec![0xFD, payload.len() as u8, 0, 0, 0, 1, 1, id, 0, 0];
            raw.extend(payload);
            let extra = <MavMessage as mavlink::Message>::extra_crc(u32::from(id));
            let crc = mavlink::calculate_crc(&raw[1..], extra);
            raw.extend(crc.to_le_bytes());
            bench.converter.feed(0, &Frame::parse(raw.into()).unwrap(), &mut bench.out);
        }
        let mut last = f64::NEG_INFINITY;
        for sample in &bench.out {
            match sample {
                Sample::Imu(s) => {
                    prop_assert!(s.t_s > last && s.gyro.iter().all(|v| v.is_finite()));
                    last = s.t_s;
                }
                Sample::Restart(_) => last = f64::NEG_INFINITY,
                _ => {}
            }
        }
    }
}

/// Samples, stats and notices of a recorded flight.
fn recorded(name: &str) -> (Vec<Sample>, Converter, Vec<truth::SimTruth>) {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let path = [root.join("tests/data").join(name), crate::testing::flights().join(name)]
        .into_iter()
        .find(|p| p.exists())
        .unwrap_or_else(|| panic!("no recorded flight {name}"));
    let mut converter = Converter::new(ConverterOptions::default());
    let (mut out, mut truths) = (Vec::new(), Vec::new());
    for record in logs::open(&path).unwrap() {
        let record = record.unwrap();
        let Item::Frame(frame) = record.item else { panic!("a tlog holds frames") };
        converter.feed(record.t_us, &frame, &mut out);
        truths.extend(truth::SimTruth::from_frame(&frame, &converter));
    }
    (out, converter, truths)
}

#[test]
fn a_flight_of_the_real_firmware_becomes_samples() {
    let (out, converter, truths) = recorded("small_clean_dither.tlog");
    let stats = converter.stats();
    assert_eq!(converter.autopilot(), Autopilot::Ardupilot);
    assert!((29_600..=30_000).contains(&stats.time.imu_samples), "{stats:?}");
    assert!((740..=750).contains(&stats.time.fixes), "{stats:?}");
    assert_eq!(
        stats.imu_dropped() + stats.time.fix_misplaced + stats.undecodable + stats.time.restarts,
        0,
        "{stats:?}"
    );
    assert!(truths.len() > 1480);
    // In the air the specific force stays near 1 g upward on average.
    let imu: Vec<_> =
        out.iter().filter_map(|s| if let Sample::Imu(i) = s { Some(i) } else { None }).collect();
    let mean = imu.iter().map(|s| s.accel.z).sum::<f64>() / imu.len() as f64;
    assert!((-14.0..-9.0).contains(&mean), "{mean}");
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn the_probe_flight_reboots_once() {
    let (out, converter, _) = recorded("sitl_probe_udp_reboot_gpsloss.tlog");
    let restarts = out.iter().filter(|s| matches!(s, Sample::Restart(RestartReason::Reboot))).count();
    assert_eq!(restarts, 1, "{:?}", converter.stats());
    assert!(converter.stats().no_fix > 0);
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn repeated_fixes_of_the_stock_streams_are_dropped() {
    let (_, converter, _) = recorded("sitl_stock_streams.tlog");
    let stats = converter.stats();
    assert!((3200..3400).contains(&stats.time.fixes) && stats.time.fix_duplicates > 3000, "{stats:?}");
}

#[test]
#[ignore = "needs the recorded flights: GAWARE_FLIGHTS"]
fn a_bench_with_three_components_gives_slow_samples_and_no_fix() {
    let (_, mut converter, _) = recorded("real_ardusub_bench.tlog");
    let stats = converter.stats();
    assert!(stats.time.fixes == 0 && stats.no_fix > 400 && stats.foreign > 400, "{stats:?}");
    assert!(converter.take_notices().iter().any(|n| matches!(n, Notice::RateTooLow { .. })));
}
