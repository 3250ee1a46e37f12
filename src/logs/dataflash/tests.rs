//! Logs made byte by byte, whole and damaged.

use super::notes::{board, class_of_firmware, class_of_parameter};
use super::*;
use crate::engine::{Engine, EngineOptions};
use crate::inputs::Input;
use crate::logs::filter::Channel as FilterChannel;
use crate::logs::{HealthNote, Item, LogNote, VehicleClass};
use crate::pipeline::Beside;
use crate::pipeline::replay::{ReplayRequest, replay_watched};
use crate::sensors::ConverterOptions;
use crate::timeline::{Measurement, Stamp};
use gaware_nav::operating::{Channel, Operating};
use gaware_nav::sample::{AirKind, FixVelocity, GnssFix};
use proptest::prelude::*;

mod inertial;

const SAMPLES: u64 = 400;

fn message(kind: u8, body: &[u8]) -> Vec<u8> {
    [&MAGIC[..], &[kind], body].concat()
}

fn fmt(described: u8, len: u8, name: &str, types: &str, labels: &str) -> Vec<u8> {
    let padded = |text: &str, n: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(n, 0);
        bytes
    };
    let body = [vec![described, len], padded(name, 4), padded(types, 16), padded(labels, 64)].concat();
    message(FMT, &body)
}

fn definitions() -> Vec<u8> {
    let mut firmware = 0_u64.to_le_bytes().to_vec();
    firmware.extend(b"ArduCopter V4.5.7 (2a3dc4b7)");
    firmware.resize(8 + 64, 0);
    [
        fmt(FMT, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        fmt(1, 3 + 8 + 1 + 24, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        fmt(2, 3 + 8 + 1 + 1 + 16, "GPS", "QBBLLef", "TimeUS,I,Status,Lat,Lng,Alt,Spd"),
        fmt(3, 3 + 8 + 64, "MSG", "QZ", "TimeUS,Message"),
        message(3, &firmware),
    ]
    .concat()
}

fn data() -> Vec<u8> {
    let mut out = Vec::new();
    for k in 0..SAMPLES {
        let t = (1_000_000 + 5_000 * k).to_le_bytes();
        let mut body = t.to_vec();
        body.push(0);
        for v in [0.01_f32, 0.02, 0.03, 0.0, 0.1, -9.8] {
            body.extend(v.to_le_bytes());
        }
        out.extend(message(1, &body));
        if k % 40 == 0 {
            let mut body = t.to_vec();
            body.extend([0, 3]);
            for v in [473_977_420_i32, 85_455_940, 48_800] {
                body.extend(v.to_le_bytes());
            }
            body.extend(12.5_f32.to_le_bytes());
            out.extend(message(2, &body));
        }
    }
    out
}

struct Read {
    imu: u64,
    fixes: Vec<GnssFix>,
    damage: Damage,
    kind: Option<VehicleKind>,
}

fn read(bytes: &[u8]) -> Read {
    let mut reader = DataflashReader::new(bytes, bytes.len() as u64);
    let (mut imu, mut fixes) = (0, Vec::new());
    for record in reader.by_ref().flatten() {
        match record.item {
            Item::Measurement(Measurement::Imu(..)) => imu += 1,
            Item::Measurement(Measurement::Fix(_, fix)) => fixes.push(fix),
            _ => {}
        }
    }
    assert_eq!(reader.progress().read_bytes, bytes.len() as u64);
    Read { imu, fixes, damage: reader.damage(), kind: reader.vehicle_kind() }
}

#[test]
fn a_whole_log_is_read_without_damage() {
    let read = read(&[definitions(), data()].concat());
    assert_eq!((read.imu, read.fixes.len(), read.damage), (SAMPLES, 10, Damage::default()));
    assert_eq!(read.kind, Some(VehicleKind::Multirotor));
    assert_eq!(read.fixes[0].position.height_m, 488.0);
    assert!((read.fixes[0].position.lat_rad.to_degrees() - 47.397_742).abs() < 1e-9);
}

#[test]
fn a_format_of_length_zero_is_damage_and_no_crash() {
    let nothing = fmt(7, 0, "BAD", "", "");
    let wrong = fmt(1, 200, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ");
    let read = read(&[definitions(), nothing, wrong, data()].concat());
    assert_eq!((read.imu, read.damage.bad_records), (SAMPLES, 2));
}

#[test]
fn a_log_that_ends_in_a_message_says_so() {
    let bytes = [definitions(), data()].concat();
    let read = read(&bytes[..bytes.len() - 5]);
    assert_eq!(read.imu, SAMPLES - 1);
    assert!(read.damage.truncated && !read.damage.any(), "{:?}", read.damage);
}

#[test]
fn the_parameters_tell_a_copter_from_a_plane() {
    assert_eq!(class_of_firmware("ArduPlane V4.6.0"), Some(VehicleClass::FixedWing));
    assert_eq!(class_of_firmware("ArduSub V4.1"), Some(VehicleClass::Submarine));
    assert_eq!(class_of_parameter("FRAME_CLASS", 1.0), Some(VehicleClass::Multirotor));
    assert_eq!(class_of_parameter("FRAME_CLASS", 0.0), None);
    assert_eq!(class_of_parameter("Q_ENABLE", 0.0), Some(VehicleClass::FixedWing));
}

fn notes(bytes: &[u8]) -> Vec<LogNote> {
    let reader = DataflashReader::new(bytes, bytes.len() as u64);
    let note = |record: Record| if let Item::Note(note) = record.item { Some(note) } else { None };
    reader.flatten().filter_map(note).collect()
}

fn text_message(text: &str) -> Vec<u8> {
    let mut body = 0_u64.to_le_bytes().to_vec();
    body.extend(text.as_bytes());
    body.resize(8 + 64, 0);
    message(3, &body)
}

#[test]
fn a_plane_with_rotors_is_a_vtol_and_flies_turns_on_its_wings() {
    let parameter = |name: &str, value: f32| {
        let mut body = name.as_bytes().to_vec();
        body.resize(16, 0);
        body.extend(value.to_le_bytes());
        message(5, &body)
    };
    let formats = [definitions(), fmt(5, 3 + 16 + 4, "PARM", "Nf", "Name,Value")].concat();
    let log = [formats, text_message("ArduPlane V4.5.7 (0a)"), parameter("Q_ENABLE", 1.0), data()].concat();
    assert!(notes(&log).contains(&LogNote::Vehicle(VehicleClass::Vtol)));
    assert_eq!(read(&log).kind, Some(VehicleKind::FixedWing));
}

/// What a replay says beside its samples holds the kind of vehicle too, without which a wing's sideslip would be left open.
#[test]
fn a_replay_knows_that_a_plane_has_wings() {
    let request = ReplayRequest {
        log: Input::in_memory(
            "plane.bin",
            [definitions(), text_message("ArduPlane V4.5.7 (0a)"), data()].concat(),
        ),
        model: None,
        converter: ConverterOptions::default(),
        truth_from_s: 0.0,
    };
    let make = |model| Engine::new(model, EngineOptions::default());
    let mut beside = Beside::default();
    replay_watched(&request, make, &|_, _| {}, Some(&mut beside)).unwrap();
    assert_eq!(beside.on_board.fixed_wing, Some(true));
}

#[test]
fn battery_outputs_throttle_and_mode_are_measurements_with_their_time() {
    let floats = |t_us: u64, values: &[f32]| {
        let mut body = t_us.to_le_bytes().to_vec();
        values.iter().for_each(|v| body.extend(v.to_le_bytes()));
        body
    };
    let mut outputs = 1_020_000_u64.to_le_bytes().to_vec();
    [1500_u16, 0, 1900].iter().for_each(|v| outputs.extend(v.to_le_bytes()));
    let bytes = [
        definitions(),
        fmt(10, 3 + 8 + 8, "BAT", "Qff", "TimeUS,Volt,Curr"),
        fmt(11, 3 + 8 + 6, "RCOU", "QHHH", "TimeUS,C1,C2,C3"),
        fmt(12, 3 + 8 + 4, "CTUN", "Qf", "TimeUS,ThO"),
        fmt(13, 3 + 8 + 2, "MODE", "QMB", "TimeUS,Mode,ModeNum"),
        message(10, &floats(1_010_000, &[15.5, 12.25])),
        message(11, &outputs),
        message(12, &floats(1_030_000, &[0.375])),
        message(13, &[&1_040_000_u64.to_le_bytes()[..], &[5, 5]].concat()),
        data(),
    ]
    .concat();
    let mut reader = DataflashReader::new(&bytes[..], bytes.len() as u64);
    let found: Vec<(Option<Stamp>, Operating)> = reader
        .by_ref()
        .flatten()
        .filter_map(|r| match r.item {
            Item::Measurement(Measurement::Operating(stamp, values)) => Some((stamp, values)),
            _ => None,
        })
        .collect();
    let none = Operating::default();
    let at = |t_us| Some(Stamp::Usec(t_us));
    let wanted = [
        (at(1_010_000), none.with(Channel::Voltage, 15.5).with(Channel::Current, 12.25)),
        (at(1_020_000), none.with(Channel::Motor(0), 0.5).with(Channel::Motor(2), 0.9)),
        (at(1_030_000), none.with(Channel::Throttle, 0.375)),
        (at(1_040_000), none.with(Channel::Mode, 5.0)),
    ];
    assert_eq!(found, wanted);
    assert_eq!(reader.damage(), Damage::default());
}

#[test]
fn barometers_and_airspeeds_are_read_by_instance_in_new_and_old_logs() {
    let taken = 1_100_000_u64;
    let body = |t_us: u64, instance: Option<u8>, floats: &[f32], centidegrees: i16, rest: &[u8]| {
        let mut body = t_us.to_le_bytes().to_vec();
        body.extend(instance);
        floats.iter().for_each(|v| body.extend(v.to_le_bytes()));
        body.extend(centidegrees.to_le_bytes());
        body.extend(rest);
        body
    };
    // Raw pressure, offset, used, healthy, probability, test ratio, primary.
    let pitot = |healthy: u8| [&[0; 8][..], &[1, healthy], &[0; 9]].concat();
    // Climb rate, time of the sample, ms, offset, ground temperature, health.
    let barometer =
        |sample_ms: u32, healthy: u8| [&[0; 4][..], &sample_ms.to_le_bytes(), &[0; 8], &[healthy]].concat();
    let bytes = [
        definitions(),
        fmt(20, 41, "ARSP", "QBffcffBBffB", "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,Offset,U,H,Hp,TR,Pri"),
        fmt(21, 40, "ASP2", "QffcffBBffB", "TimeUS,Airspeed,DiffPress,Temp,RawPress,Offset,U,H,Hp,TR,Pri"),
        fmt(22, 39, "BARO", "QBffcfIffB", "TimeUS,I,Alt,Press,Temp,CRt,SMS,Offset,GndTemp,Health"),
        fmt(23, 38, "BAR2", "QffcfIffB", "TimeUS,Alt,Press,Temp,CRt,SMS,Offset,GndTemp,Health"),
        message(20, &body(taken, Some(0), &[17.5, 190.0], 2150, &pitot(1))),
        message(20, &body(taken, Some(1), &[18.25, 200.0], -150, &pitot(1))),
        message(20, &body(taken, Some(1), &[99.0, 200.0], 2150, &pitot(0))),
        message(20, &body(taken, Some(0), &[0.0, -3.0], 2150, &pitot(1))),
        message(21, &body(taken, None, &[19.0, 220.0], 2150, &pitot(1))),
        message(22, &body(taken, Some(2), &[30.0, 95_000.0], 3525, &barometer(1_060, 1))),
        message(22, &body(taken, Some(0), &[30.0, 95_000.0], 3525, &barometer(1_060, 0))),
        message(23, &body(taken, None, &[30.0, 95_100.0], 3525, &barometer(0, 1))),
        data(),
    ]
    .concat();
    let mut reader = DataflashReader::new(&bytes[..], bytes.len() as u64);
    let found: Vec<_> = reader
        .by_ref()
        .flatten()
        .filter_map(|r| match r.item {
            Item::Measurement(Measurement::Air(stamp, s)) => {
                Some((stamp, s.kind, s.sensor, s.value, s.temperature_degc))
            }
            _ => None,
        })
        .collect();
    let at = |t_us| Some(Stamp::Usec(t_us));
    let wanted = [
        (at(taken), AirKind::Airspeed, 0, 17.5, Some(21.5)),
        (at(taken), AirKind::Airspeed, 1, 18.25, Some(-1.5)),
        (at(taken), AirKind::Airspeed, 1, 19.0, Some(21.5)),
        // The barometer's own time of the sample; none where it lies too far back.
        (at(1_060_000), AirKind::Barometer, 2, 95_000.0, Some(35.25)),
        (at(taken), AirKind::Barometer, 1, 95_100.0, Some(35.25)),
    ];
    assert_eq!(found, wanted);
    assert_eq!(reader.damage(), Damage::default());
}

#[test]
fn the_board_is_known_by_its_serial_number() {
    assert_eq!(
        board("Pixhawk6X 002F0029 31335116 32373533").as_deref(),
        Some("Pixhawk6X 002f00293133511632373533")
    );
    for other in ["ChibiOS: 6a85082c", "Frame: QUAD/X", "x 00000000 00000000 00000000", ""] {
        assert_eq!(board(other), None, "{other}");
    }
    let log = [definitions(), text_message("PX4v2 001F0027 33345103 33323836"), data()].concat();
    assert!(notes(&log).contains(&LogNote::Board("PX4v2 001f00273334510333323836".to_owned())));
}

#[test]
fn what_the_logger_lost_stands_beside_what_it_wrote() {
    let mut log = definitions();
    log.extend(fmt(9, 3 + 8 + 4, "DSF", "QI", "TimeUS,Dp"));
    log.extend(message(9, &[&1_000_000_u64.to_le_bytes()[..], &7_u32.to_le_bytes()].concat()));
    log.extend(data());
    log.extend(message(9, &[&4_000_000_u64.to_le_bytes()[..], &60_007_u32.to_le_bytes()].concat()));
    let lost = |note: LogNote| match note {
        LogNote::Health(HealthNote::Lost(lost, kept)) => Some((lost, kept)),
        _ => None,
    };
    let found: Vec<(f64, f64)> = notes(&log).into_iter().filter_map(lost).collect();
    assert_eq!(found.len(), 2, "{found:?}");
    // One of the definitions is a message of its own.
    assert_eq!((found[0], found[1].0), ((7.0, 2.0), 60_007.0));
    assert!(found[1].1 > SAMPLES as f64, "{found:?}");
}

/// Week 1811, Thursday 00:03:05 GPS time: 2014-09-25.
#[test]
fn the_date_comes_from_the_week_of_the_receiver() {
    let mut log = definitions();
    log.extend(fmt(
        8,
        3 + 8 + 1 + 1 + 4 + 2 + 1 + 2 + 12 + 4,
        "GPS",
        "QBBIHBcLLef",
        "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd",
    ));
    let mut body = 2_000_000_u64.to_le_bytes().to_vec();
    body.extend([0, 3]);
    body.extend(345_785_000_u32.to_le_bytes());
    body.extend(1811_u16.to_le_bytes());
    body.push(9);
    body.extend(120_u16.to_le_bytes());
    [473_977_420_i32, 85_455_940, 48_800].iter().for_each(|v| body.extend(v.to_le_bytes()));
    body.extend(1.0_f32.to_le_bytes());
    log.extend(message(8, &body));
    log.extend(data());
    let found = notes(&log);
    let utc = found.iter().find_map(|n| if let LogNote::Utc(t) = n { Some(*t) } else { None });
    assert_eq!(crate::figures::day(utc.unwrap()), "2014-09-25");
    assert!(
        found.iter().any(|n| matches!(n, LogNote::Health(HealthNote::Gnss { satellites: Some(9.0), .. })))
    );
}

/// Stamps of the fixes of a log, and the fixes.
fn fixes(bytes: &[u8]) -> Vec<(u64, GnssFix)> {
    let reader = DataflashReader::new(bytes, bytes.len() as u64);
    let fix = |record: Record| match record.item {
        Item::Measurement(Measurement::Fix(Some(Stamp::Usec(t_us)), fix)) => Some((t_us, fix)),
        _ => None,
    };
    reader.flatten().filter_map(fix).collect()
}

/// ArduPlane 3.1.2: `TimeMS` of a fix is the receiver's time of week.
#[test]
fn a_fix_of_old_firmware_has_the_time_since_boot() {
    let labels = "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T";
    let mut log =
        [fmt(2, 45, "GPS", "BIHBcLLeeEefI", labels), fmt(4, 19, "IMU", "Ifff", "TimeMS,GyrX,GyrY,T")]
            .concat();
    for (week_ms, boot_ms) in [(470_249_200_u32, 21_168_u32), (470_249_400, 21_368)] {
        let mut body = vec![3];
        body.extend(week_ms.to_le_bytes());
        body.extend(1821_u16.to_le_bytes());
        body.extend([6, 0x9F, 0x01]);
        for v in [428_538_982_i32, -26_449_584, 36, 51_488, 76, 17_183] {
            body.extend(v.to_le_bytes());
        }
        body.extend((-0.05_f32).to_le_bytes());
        body.extend(boot_ms.to_le_bytes());
        log.extend(message(2, &body));
    }
    let stamps: Vec<u64> = fixes(&log).into_iter().map(|(t_us, _)| t_us).collect();
    assert_eq!(stamps, [21_168_000, 21_368_000]);
}

/// Fixes as ArduPlane 4.6 logs them: time, speed and course; the time of arrival, ms.
fn modern(rows: &[(u64, f32, f32, u32)]) -> Vec<u8> {
    let mut log = [
        fmt(2, 36, "GPS", "QBLLefff", "TimeUS,Status,Lat,Lng,Alt,Spd,GCrs,VZ"),
        fmt(5, 17, "GPA", "QCI", "TimeUS,SAcc,SMS"),
    ]
    .concat();
    for (t_us, speed, course, sms) in rows {
        let mut body = t_us.to_le_bytes().to_vec();
        body.push(3);
        for v in [428_538_982_i32, -26_449_584, 51_488] {
            body.extend(v.to_le_bytes());
        }
        for v in [*speed, *course, -0.05] {
            body.extend(v.to_le_bytes());
        }
        log.extend(message(2, &body));
        let body = [&t_us.to_le_bytes()[..], &30_u16.to_le_bytes(), &sms.to_le_bytes()].concat();
        log.extend(message(5, &body));
    }
    log
}

/// The simulation of `sitl_gsens_typical_dither_cut.BIN` logs each fix 21.5 to 22.3 ms after it arrived.
#[test]
fn a_fix_is_dated_by_its_arrival_as_on_the_link() {
    let wrapped = (1_u64 << 32) * 1000;
    let log = modern(&[
        (120_047_795, 20.0, 90.0, 120_026),
        (120_247_715, 20.0, 91.0, 120_226),
        // An arrival that cannot be, and one beside the wrap of its 32 bits.
        (120_447_635, 20.0, 92.0, 0),
        (wrapped + 15_100, 20.0, 93.0, u32::MAX - 5),
    ]);
    let stamps: Vec<u64> = fixes(&log).into_iter().map(|(t_us, _)| t_us).collect();
    assert_eq!(stamps, [120_026_000, 120_226_000, 120_447_635, wrapped - 6000]);
}

#[test]
fn a_frozen_course_is_no_direction_in_a_log_either() {
    let log = modern(&[(1_000_000, 0.4, 90.0, 0), (1_200_000, 0.4, 90.0, 0), (1_400_000, 0.4, 91.0, 0)]);
    let found: Vec<([f64; 3], [f64; 3])> = fixes(&log)
        .into_iter()
        .filter_map(|(_, fix)| match fix.velocity {
            FixVelocity::Full(v) => Some((v, fix.velocity_sigma_m_per_s?)),
            _ => None,
        })
        .collect();
    let east: Vec<f64> = found.iter().map(|(v, _)| (v[1] * 100.0).round()).collect();
    assert_eq!(east, [40.0, 0.0, 40.0]);
    let sigmas: Vec<[f64; 3]> = found.iter().map(|(_, s)| s.map(|s| (s * 100.0).round())).collect();
    assert_eq!(sigmas, [[30.0; 3], [40.0, 40.0, 30.0], [30.0; 3]]);
}

/// Innovations of two cores, of which the second flies from the second round on; firmware before 4.1 and since.
fn rounds(family: &str, with_core: bool) -> Vec<u8> {
    let (types, labels, head) =
        if with_core { ("QBccB", "TimeUS,C,IVN,SV,PI", 1) } else { ("QccB", "TimeUS,IVN,SV,PI", 0) };
    let len = 3 + 8 + head + 5;
    let numbers = if with_core { ["3", "4", "3", "4"] } else { ["3", "4", "8", "9"] };
    let mut out = Vec::new();
    for (k, number) in numbers.iter().enumerate() {
        out.extend(fmt(40 + k as u8, len, &format!("{family}{number}"), types, labels));
    }
    for round in 0..2_u8 {
        for (k, core) in [0_u8, 0, 1, 1].into_iter().enumerate() {
            let mut body = (1_000_000_u64 + 100_000 * u64::from(round)).to_le_bytes().to_vec();
            if with_core {
                body.push(core);
            }
            body.extend((100 * i16::from(core) + 10 * i16::from(round)).to_le_bytes());
            body.extend((100 * i16::from(core) + 10 * i16::from(round) + 1).to_le_bytes());
            body.push(round);
            out.extend(message(40 + k as u8, &body));
        }
    }
    out
}

fn filter_notes(bytes: &[u8]) -> Vec<Vec<(FilterChannel, f64)>> {
    let reader = DataflashReader::new(bytes, bytes.len() as u64);
    let values = |record: Record| match record.item {
        Item::Note(LogNote::Filter(values)) => Some(values),
        _ => None,
    };
    reader.flatten().filter_map(values).collect()
}

#[test]
fn the_innovations_of_the_core_that_flies_are_taken_in_old_and_new_logs() {
    for (family, with_core) in [("NKF", false), ("XKF", false), ("NKF", true), ("XKF", true)] {
        let (v, r) = (FilterChannel::VelocityNorth, FilterChannel::VelocityRatio);
        let expected = [(v, 0.0), (r, 0.01), (v, 1.1), (r, 1.11)].map(|(channel, value)| {
            let both = [(FilterChannel::VelocityNorth, value), (FilterChannel::VelocityRatio, value)];
            both.into_iter().filter(|(c, _)| *c == channel).collect::<Vec<_>>()
        });
        assert_eq!(
            filter_notes(&[definitions(), rounds(family, with_core)].concat()),
            expected,
            "{family} {with_core}"
        );
    }
}

#[test]
fn of_two_filters_the_one_that_the_parameter_names_is_taken() {
    let mut parameter = 1_u64.to_le_bytes().to_vec();
    parameter.extend(b"AHRS_EKF_TYPE\0\0\0");
    parameter.extend(3.0_f32.to_le_bytes());
    let parameter =
        [fmt(9, 3 + 8 + 16 + 4, "PARM", "QNf", "TimeUS,Name,Value"), message(9, &parameter)].concat();
    let both = [rounds("NKF", false), rounds("XKF", true)].concat();
    let (first, named) = (filter_notes(&both), filter_notes(&[parameter, both.clone()].concat()));
    assert_eq!((first.len(), named.len()), (4, 4));
    assert_eq!(named, filter_notes(&rounds("XKF", true)));
}

proptest! {
    #[test]
    fn a_burst_costs_what_it_touches_and_is_reported(
        at in 0_usize..12_000, burst in proptest::collection::vec(any::<u8>(), 1..65),
    ) {
        let mut bytes = [definitions(), data()].concat();
        let at = definitions().len() + at % (data().len() - burst.len());
        bytes[at..at + burst.len()].copy_from_slice(&burst);
        let read = read(&bytes);
        let lost = SAMPLES.saturating_sub(read.imu);
        prop_assert!(lost <= 5, "{lost} of {SAMPLES} lost at {at}");
        // A byte of instance that is no longer 0 makes it another unit's sample.
        prop_assert!(lost <= 2 || read.damage.any(), "{lost} lost without a word");
    }

    #[test]
    fn rubbish_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..3000), behind in any::<bool>()) {
        let head = if behind { definitions() } else { MAGIC.to_vec() };
        let bytes = [head, bytes].concat();
        let _ = DataflashReader::new(&bytes[..], bytes.len() as u64).count();
    }
}
