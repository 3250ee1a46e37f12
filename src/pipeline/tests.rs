//! Recorded flights through the line.

use super::*;
use crate::engine::{Engine, EngineOptions};
use crate::link::frame::Sender;
use crate::logs::tlog::record_bytes;
use crate::sensors::ImuSource;
use crate::timeline::{Measurement, Stamp, stretches};
use gaware_nav::model::Model;
use gaware_nav::sample::{ImuSample, Sample};
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, HIGHRES_IMU_DATA, HighresImuUpdatedFlags, MavAutopilot, MavMessage, MavType, RAW_IMU_DATA,
};
use nalgebra::Vector3;
use std::path::{Path, PathBuf};

const VEHICLE: Sender = Sender { system_id: 1, component_id: 1 };

/// A file that goes away again.
struct Temporary(PathBuf);

impl Temporary {
    fn new(name: &str, bytes: &[u8]) -> Self {
        let path = std::env::temp_dir().join(format!("gaware-line-{}-{name}", std::process::id()));
        std::fs::write(&path, bytes).unwrap();
        Self(path)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn heartbeat(mavtype: MavType) -> MavMessage {
    let autopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
    MavMessage::HEARTBEAT(HEARTBEAT_DATA { autopilot, mavtype, ..Default::default() })
}

fn raw_imu(ms: u64) -> MavMessage {
    MavMessage::RAW_IMU(RAW_IMU_DATA { time_usec: ms * 1000, zacc: -1000, ..Default::default() })
}

fn highres_imu(ms: u64) -> MavMessage {
    MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA {
        time_usec: ms * 1000,
        zacc: -9.8,
        fields_updated: HighresImuUpdatedFlags::from_bits_truncate(0x3F),
        ..Default::default()
    })
}

fn log(messages: impl IntoIterator<Item = MavMessage>) -> Vec<u8> {
    let frames = messages.into_iter().enumerate();
    frames.flat_map(|(k, m)| record_bytes(k as u64 * 1000, &Frame::encode(VEHICLE, k as u8, &m))).collect()
}

fn replayed(path: &Path) -> Pipeline<Engine> {
    let engine = Engine::new(Model::standard(), EngineOptions::default());
    Recorded::open(path, ConverterOptions::default()).unwrap().run(engine, 150.0, &|_| {}).unwrap().0
}

#[test]
fn gaps_of_a_recording_are_counted_in_its_summary() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/small_clean_dither.tlog");
    let (mut bytes, mut first) = (Vec::new(), None);
    for record in crate::logs::open(&path).unwrap().flatten() {
        let Item::Frame(frame) = record.item else { panic!("a tlog holds frames") };
        let since = record.t_us - *first.get_or_insert(record.t_us);
        let cut = |from: u64, to: u64| (from..to).contains(&since);
        if since > 60_000_000 {
            break;
        }
        if !cut(20_000_000, 21_400_000) && !cut(40_000_000, 42_000_000) {
            bytes.extend(record_bytes(record.t_us, &frame));
        }
    }
    let file = Temporary::new("gaps.tlog", &bytes);
    let summary = replayed(&file.0).summary();
    assert_eq!(summary.imu.gaps.count, 2, "{:?}", summary.imu);
    assert!((summary.imu.gaps.seconds - 3.4).abs() < 0.1, "{:?}", summary.imu);
    assert!((600..760).contains(&summary.imu.dropped), "{:?}", summary.imu);
    assert!(summary.warnings.iter().any(|w| w.contains("gaps: 2")), "{:?}", summary.warnings);
}

#[test]
fn what_flies_is_what_the_heartbeat_says_unless_the_run_knew_better() {
    for (mavtype, kind) in [
        (MavType::MAV_TYPE_QUADROTOR, Some(VehicleKind::Multirotor)),
        (MavType::MAV_TYPE_VTOL_TILTROTOR, Some(VehicleKind::FixedWing)),
        (MavType::MAV_TYPE_SUBMARINE, None),
    ] {
        let file = Temporary::new(
            "kind.tlog",
            &log(std::iter::once(heartbeat(mavtype)).chain((0..300).map(|k| raw_imu(20 * k)))),
        );
        let pipeline = replayed(&file.0);
        assert_eq!(pipeline.vehicle_kind(), kind);
        assert_eq!(pipeline.document().get("vehicle_kind").is_some(), kind.is_some());
    }
    let engine = Engine::new(Model::standard(), EngineOptions::default());
    let mut pipeline = Pipeline::new(ConverterOptions::default(), engine, 0.0);
    pipeline.decide_vehicle_kind(Some(VehicleKind::FixedWing));
    pipeline.frame(0, &Frame::encode(VEHICLE, 0, &heartbeat(MavType::MAV_TYPE_QUADROTOR)));
    assert_eq!(pipeline.vehicle_kind(), Some(VehicleKind::FixedWing));
}

#[test]
fn explain_sees_the_source_that_a_run_sees_and_each_source_apart() {
    let messages = std::iter::once(heartbeat(MavType::MAV_TYPE_FIXED_WING))
        .chain((0..250).map(|k| raw_imu(20 * k)))
        .chain((250..1000).flat_map(|k| [raw_imu(20 * k), highres_imu(20 * k)]));
    let file = Temporary::new("sources.tlog", &log(messages));
    let found = stretches(&samples(&file.0, ConverterOptions::default()).unwrap());
    let streams: Vec<&str> = found.iter().map(|s| s.stream.message.as_str()).collect();
    assert_eq!(streams, ["RAW_IMU", "HIGHRES_IMU"]);
    assert_eq!(found[1].stream, ImuSource::HighresImu.stream());
    let forced = ConverterOptions { source: Some(ImuSource::RawImu), vehicle: None };
    let found = stretches(&samples(&file.0, forced).unwrap());
    assert_eq!(found.len(), 1);
    assert!(found[0].samples.len() > 900);
    let other = ConverterOptions { source: None, vehicle: Some(7) };
    assert!(stretches(&samples(&file.0, other).unwrap()).is_empty());
}

/// An estimate that is level whatever happens, and says that it is right to 0.1 rad.
struct Level(Option<f64>);

impl Consumer for Level {
    fn feed(&mut self, sample: &Sample) {
        if let Sample::Imu(imu) = sample {
            self.0 = Some(imu.t_s);
        }
    }

    fn attitude(&mut self) -> Option<(f64, [f64; 3])> {
        self.0.map(|t_s| (t_s, [0.0; 3]))
    }

    fn attitude_sigmas(&mut self) -> Option<[f64; 3]> {
        Some([0.1; 3])
    }
}

/// The truth that a simulated autopilot's own log holds is compared as that of a stream is; other attitudes are none.
#[test]
fn the_truth_in_a_log_of_an_autopilot_is_compared() {
    let truth = |name: &str, roll_pitch_yaw| Item::Note(LogNote::Attitude(name.to_owned(), roll_pitch_yaw));
    let result = |name: &str| {
        let mut pipeline = Pipeline::new(ConverterOptions::default(), Level(None), 0.0);
        for k in 0..100_u64 {
            let t_us = 1_000_000 + k * 40_000;
            let sample = ImuSample {
                t_s: 0.0,
                gyro: Vector3::zeros(),
                accel: Vector3::new(0.0, 0.0, -9.8),
                temperature_degc: None,
            };
            let item = Item::Measurement(Measurement::Imu(Stamp::Usec(t_us), sample));
            pipeline.record(&Record { t_us, item });
            // Half of the time it rolls by more than the estimate allows.
            let roll = if k < 50 { 0.15 } else { 0.25 };
            pipeline.record(&Record { t_us, item: truth(name, [roll, 0.0, 0.0]) });
        }
        pipeline.truth.result()
    };
    assert_eq!(result("EKF3 lane 0"), None);
    let found = result(crate::logs::TRUTH).unwrap();
    assert!((found.attitude_rms_deg[0] - 0.206_f64.to_degrees()).abs() < 0.1, "{found:?}");
    let [roll, pitch, yaw] = found.within_2_sigma.unwrap();
    assert!((roll - 0.5).abs() < 0.02 && pitch == 1.0 && yaw == 1.0, "{found:?}");
}
