//! Logs made byte by byte, whole and damaged.

use super::*;
use crate::logs::filter::Channel;
use proptest::prelude::*;

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
    assert!(read.damage.truncated, "{:?}", read.damage);
}

#[test]
fn the_parameters_tell_a_copter_from_a_plane() {
    assert_eq!(kind_of_firmware("ArduPlane V4.6.0"), Some(VehicleKind::FixedWing));
    assert_eq!(kind_of_firmware("ArduSub V4.1"), None);
    assert_eq!(kind_of_parameter("FRAME_CLASS", 1.0), Some(VehicleKind::Multirotor));
    assert_eq!(kind_of_parameter("FRAME_CLASS", 0.0), None);
    assert_eq!(kind_of_parameter("Q_ENABLE", 0.0), Some(VehicleKind::FixedWing));
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

fn filter_notes(bytes: &[u8]) -> Vec<Vec<(Channel, f64)>> {
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
        let (v, r) = (Channel::VelocityNorth, Channel::VelocityRatio);
        let expected = [(v, 0.0), (r, 0.01), (v, 1.1), (r, 1.11)].map(|(channel, value)| {
            let both = [(Channel::VelocityNorth, value), (Channel::VelocityRatio, value)];
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
