//! Logs made byte by byte, whole and damaged.

use super::*;
use crate::logs::source::Kind;
use crate::logs::{HealthNote, Item};
use crate::timeline::{Measurement, Stamp};
use gaware_nav::operating::{Channel, Operating};
use gaware_nav::sample::{AirKind, AirSample, SampleKind};
use proptest::prelude::*;

const SAMPLES: u64 = 400;

fn message(kind: u8, body: &[u8]) -> Vec<u8> {
    let mut out = (body.len() as u16).to_le_bytes().to_vec();
    out.push(kind);
    out.extend_from_slice(body);
    out
}

fn subscription(id: u16, name: &str) -> Vec<u8> {
    let mut body = vec![0];
    body.extend(id.to_le_bytes());
    body.extend(name.as_bytes());
    message(b'A', &body)
}

fn definitions() -> Vec<u8> {
    let mut out = b"ULog\x01\x12\x35\x01".to_vec();
    out.extend([0; 8]);
    out.extend(message(b'B', &[0; 40]));
    for format in [
        "sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;float[3] accelerometer_m_s2;uint8_t[4] _padding0;",
        "vehicle_gps_position:uint64_t timestamp;int32_t lat;int32_t lon;int32_t alt;uint8_t fix_type;uint8_t[3] _padding0;",
        "vehicle_status:uint64_t timestamp;uint8_t vehicle_type;",
        "inner:float a;float[2] b;",
        "outer:uint64_t timestamp;inner[2] x;uint8_t[8] _padding0;",
    ] {
        out.extend(message(b'F', format.as_bytes()));
    }
    let mut parameter = vec![21];
    parameter.extend(b"int32_t SYS_AUTOSTART");
    parameter.extend(4001_i32.to_le_bytes());
    out.extend(message(b'P', &parameter));
    for (id, name) in
        [(0, "sensor_combined"), (1, "vehicle_gps_position"), (2, "vehicle_status"), (3, "outer")]
    {
        out.extend(subscription(id, name));
    }
    out
}

fn imu_message(k: u64) -> Vec<u8> {
    let mut body = 0_u16.to_le_bytes().to_vec();
    body.extend((1_000_000 + 5_000 * k).to_le_bytes());
    for v in [0.01_f32, 0.02, 0.03] {
        body.extend(v.to_le_bytes());
    }
    body.extend(5000_u32.to_le_bytes());
    for v in [0.0_f32, 0.1, -9.8] {
        body.extend(v.to_le_bytes());
    }
    // Padding at the end is not logged.
    message(b'D', &body)
}

fn data() -> Vec<u8> {
    let mut out = Vec::new();
    for k in 0..SAMPLES {
        out.extend(imu_message(k));
        if k % 40 == 0 {
            let mut body = 1_u16.to_le_bytes().to_vec();
            body.extend((1_000_000 + 5_000 * k).to_le_bytes());
            for v in [473_977_420_i32, 85_455_940, 488_000] {
                body.extend(v.to_le_bytes());
            }
            body.push(3);
            out.extend(message(b'D', &body));
            let mut nested = 3_u16.to_le_bytes().to_vec();
            nested.extend([0; 8 + 24]);
            out.extend(message(b'D', &nested));
        }
    }
    out
}

struct Read {
    imu: u64,
    fixes: u64,
    damage: Damage,
    kind: Option<VehicleKind>,
}

fn read(bytes: &[u8]) -> Read {
    let mut reader = UlogReader::new(bytes, bytes.len() as u64);
    let (mut imu, mut fixes) = (0, 0);
    for record in reader.by_ref().flatten() {
        match record.item {
            Item::Measurement(Measurement::Imu(..)) => imu += 1,
            Item::Measurement(Measurement::Fix(..)) => fixes += 1,
            _ => {}
        }
    }
    assert_eq!(reader.progress().read_bytes, bytes.len() as u64);
    Read { imu, fixes, damage: reader.damage(), kind: reader.vehicle_kind() }
}

#[test]
fn a_whole_log_is_read_without_damage() {
    let read = read(&[definitions(), data()].concat());
    assert_eq!((read.imu, read.fixes, read.damage), (SAMPLES, 10, Damage::default()));
    assert_eq!(read.kind, Some(VehicleKind::Multirotor), "by its airframe number");
}

#[test]
fn the_status_of_the_vehicle_wins_over_the_number_of_its_airframe() {
    let mut body = 2_u16.to_le_bytes().to_vec();
    body.extend([0; 8]);
    body.push(2);
    let read = read(&[definitions(), message(b'D', &body), data()].concat());
    assert_eq!(read.kind, Some(VehicleKind::FixedWing));
}

#[test]
fn three_bytes_in_the_middle_cost_two_messages_and_are_reported() {
    // A length of 0 and the type of a subscription, where a header should be.
    let mut bytes = [definitions(), data()].concat();
    let at = definitions().len() + 41 * 100 + 200;
    let header = (at..).find(|k| bytes[*k..].starts_with(&imu_message(0)[..5])).unwrap();
    bytes[header..header + 3].copy_from_slice(&[0, 0, 0x41]);
    let read = read(&bytes);
    assert!(read.imu >= SAMPLES - 2, "{}", read.imu);
    assert!(read.damage.bad_records > 0 && !read.damage.truncated, "{:?}", read.damage);
}

#[test]
fn a_log_that_ends_in_a_message_says_so() {
    let bytes = [definitions(), data()].concat();
    let read = read(&bytes[..bytes.len() - 5]);
    assert_eq!(read.imu, SAMPLES - 1);
    assert!(read.damage.truncated && !read.damage.any(), "{:?}", read.damage);
}

/// `vehicle_imu` of two units at 200 Hz beside `sensor_combined` at 9 Hz.
#[test]
fn increments_at_the_full_rate_are_taken_before_means_with_gaps() {
    let mut log = definitions();
    let format = "vehicle_imu:uint64_t timestamp;uint64_t timestamp_sample;float[3] delta_angle;float[3] delta_velocity;uint16_t delta_angle_dt;uint16_t delta_velocity_dt;";
    log.extend(message(b'F', format.as_bytes()));
    for (id, unit) in [(10_u16, 0_u8), (11, 1)] {
        let mut body = vec![unit];
        body.extend(id.to_le_bytes());
        body.extend(b"vehicle_imu");
        log.extend(message(b'A', &body));
    }
    for k in 0..800_u64 {
        if k % 22 == 0 {
            log.extend(imu_message(k));
        }
        for id in [10_u16, 11] {
            let mut body = id.to_le_bytes().to_vec();
            body.extend((1_000_700 + 5_000 * k).to_le_bytes());
            body.extend((1_000_000 + 5_000 * k).to_le_bytes());
            for v in [0.001_f32, 0.0, 0.0, 0.0, 1e-6 * k as f32, -0.049] {
                body.extend(v.to_le_bytes());
            }
            body.extend(5000_u16.to_le_bytes());
            body.extend(5000_u16.to_le_bytes());
            log.extend(message(b'D', &body));
        }
    }
    let reader = || UlogReader::new(&log[..], log.len() as u64);
    let best = reader().survey().unwrap().best().unwrap();
    assert_eq!((best.source.kind, best.source.unit, best.continuous), (Kind::VehicleImu, 0, true));
    let records: Vec<Record> = reader().with_source(best).flatten().collect();
    let samples: Vec<_> = records
        .iter()
        .filter_map(|r| match &r.item {
            Item::Measurement(Measurement::Imu(stamp, sample)) => Some((stamp.raw_us(), *sample)),
            _ => None,
        })
        .collect();
    assert_eq!((samples.len(), samples[1].0), (800, 1_005_000), "the time at which it was measured");
    assert!((samples[0].1.gyro.x - 0.2).abs() < 1e-6 && (samples[0].1.accel.z + 9.8).abs() < 1e-5);
    assert!(matches!(&records.iter().find(|r| matches!(r.item, Item::Measurement(_))).unwrap().item,
        Item::Measurement(Measurement::Stream(s)) if s.kind == SampleKind::IntervalMean
            && s.message == "vehicle_imu[0] (of 2 sources, the usual one has no usable samples)"));
}

/// 4 ms of every 110: the mean of the interval is a point.
#[test]
fn means_with_gaps_between_them_are_points() {
    let log = [definitions(), (0..80).flat_map(|k| imu_message(22 * k)).collect()].concat();
    let best = UlogReader::new(&log[..], log.len() as u64).survey().unwrap().best();
    // These samples do not change: a sensor whose values do not change is no source.
    assert!(best.is_none_or(|b| !b.continuous));
}

#[test]
fn a_dropout_is_a_pause_of_the_logger() {
    let log = [definitions(), data(), message(b'O', &120_u16.to_le_bytes()), data()].concat();
    let pauses: Vec<f64> = UlogReader::new(&log[..], log.len() as u64)
        .flatten()
        .filter_map(|record| match record.item {
            Item::Note(LogNote::Health(HealthNote::Pause(s))) => Some(s),
            _ => None,
        })
        .collect();
    assert_eq!(pauses, [0.0, 0.12]);
}

#[test]
fn board_and_texts_are_read() {
    let mut information = vec![17];
    information.extend(b"char[36] sys_uuid");
    information.extend(b"000600000000373632303235111002f00220");
    let mut text = vec![b'3'];
    text.extend(7_000_000_u64.to_le_bytes());
    text.extend(b"Accel #0 fail:  TIMEOUT!\t");
    let log = [definitions(), message(b'I', &information), message(b'L', &text), data()].concat();
    let notes: Vec<LogNote> = UlogReader::new(&log[..], log.len() as u64)
        .flatten()
        .filter_map(|r| if let Item::Note(note) = r.item { Some(note) } else { None })
        .collect();
    assert!(notes.contains(&LogNote::Board("000600000000373632303235111002f00220".to_owned())), "{notes:?}");
    let error = HealthNote::Text(crate::logs::Level::Error, "Accel #0 fail:  TIMEOUT!".to_owned());
    assert!(notes.contains(&LogNote::Health(error)));
}

/// Two instances of the filter; the selector names the second one after the first round.
#[test]
fn the_innovations_of_the_instance_that_flies_are_taken() {
    use crate::logs::filter::Channel;
    let mut bytes = definitions();
    for format in [
        "estimator_innovation_test_ratios:uint64_t timestamp;float[2] gps_hvel;float gps_vvel;float[2] gps_hpos;",
        "estimator_selector_status:uint64_t timestamp;uint8_t primary_instance;",
    ] {
        bytes.extend(message(b'F', format.as_bytes()));
    }
    for (id, instance) in [(10_u16, 0), (11, 1)] {
        let body = [&[instance][..], &id.to_le_bytes(), b"estimator_innovation_test_ratios"].concat();
        bytes.extend(message(b'A', &body));
    }
    bytes.extend(subscription(12, "estimator_selector_status"));
    for round in 0..2_u8 {
        for (id, scale) in [(10_u16, 1.0_f32), (11, 10.0)] {
            let values = [0.1_f32, 0.2, 0.3, 0.4, 0.5].map(|v| (v * scale).to_le_bytes()).concat();
            let stamp = (1_000_000 * (1 + u64::from(round))).to_le_bytes();
            bytes.extend(message(b'D', &[&id.to_le_bytes()[..], &stamp, &values].concat()));
        }
        let status = [&12_u16.to_le_bytes()[..], &1_500_000_u64.to_le_bytes(), &[1]].concat();
        bytes.extend(message(b'D', &status));
    }
    let values = |record: Record| match record.item {
        Item::Note(LogNote::Filter(values)) => Some(values),
        _ => None,
    };
    let found: Vec<_> =
        UlogReader::new(&bytes[..], bytes.len() as u64).flatten().filter_map(values).collect();
    let pair = |velocity: f32, position: f32| {
        vec![(Channel::VelocityRatio, f64::from(velocity)), (Channel::PositionRatio, f64::from(position))]
    };
    assert_eq!(found, [pair(0.3, 0.5), pair(3.0, 5.0)]);
}

/// `sensor_combined` is of the unit that is selected.
#[test]
fn battery_thrust_and_motors_are_measurements_with_their_time() {
    let mut bytes = definitions();
    for (id, name, fields) in [
        (20, "battery_status", "uint64_t timestamp;float voltage_v;float current_a;"),
        (21, "vehicle_thrust_setpoint", "uint64_t timestamp;float[3] xyz;"),
        (22, "actuator_motors", "uint64_t timestamp;float[4] control;"),
    ] {
        bytes.extend(message(b'F', format!("{name}:{fields}").as_bytes()));
        bytes.extend(subscription(id, name));
    }
    let nan = f32::NAN;
    for (id, values) in
        [(20_u16, &[15.5_f32, 8.25][..]), (21, &[0.0, 0.0, -0.5]), (22, &[0.25, 0.75, nan, nan])]
    {
        let mut body = id.to_le_bytes().to_vec();
        body.extend(1_500_000_u64.to_le_bytes());
        values.iter().for_each(|v| body.extend(v.to_le_bytes()));
        bytes.extend(message(b'D', &body));
    }
    bytes.extend(data());
    let found: Vec<Operating> = UlogReader::new(&bytes[..], bytes.len() as u64)
        .flatten()
        .filter_map(|r| match r.item {
            Item::Measurement(Measurement::Operating(stamp, values)) => {
                assert!(r.t_us != 1_500_000 || stamp == Some(Stamp::Usec(1_500_000)));
                (r.t_us == 1_500_000).then_some(values)
            }
            _ => None,
        })
        .collect();
    let none = Operating::default();
    let wanted = [
        none.with(Channel::Voltage, 15.5).with(Channel::Current, 8.25),
        none.with(Channel::Throttle, 0.5),
        none.with(Channel::Motor(0), 0.25).with(Channel::Motor(1), 0.75),
    ];
    assert_eq!(found, wanted);
}

/// A log with these topics, each of one instance or more, and data `(topic, instance, sampled, floats)`; what is read of the air.
fn air_of(topics: &[(&str, &str)], data_of: &[(usize, u8, u64, &[f32])]) -> Vec<(u64, AirSample)> {
    let mut bytes = definitions();
    for (k, (name, fields)) in topics.iter().enumerate() {
        let format = format!("{name}:uint64_t timestamp;uint64_t timestamp_sample;{fields}");
        bytes.extend(message(b'F', format.as_bytes()));
        for instance in 0..2 {
            let mut body = vec![instance];
            body.extend((30 + 2 * k as u16 + u16::from(instance)).to_le_bytes());
            body.extend(name.as_bytes());
            bytes.extend(message(b'A', &body));
        }
    }
    for (topic, instance, sampled_us, floats) in data_of {
        let mut body = (30 + 2 * *topic as u16 + u16::from(*instance)).to_le_bytes().to_vec();
        body.extend(1_500_000_u64.to_le_bytes());
        body.extend(sampled_us.to_le_bytes());
        floats.iter().for_each(|v| body.extend(v.to_le_bytes()));
        bytes.extend(message(b'D', &body));
    }
    bytes.extend(data());
    let mut reader = UlogReader::new(&bytes[..], bytes.len() as u64);
    let of = |r: crate::logs::Record| match r.item {
        Item::Measurement(Measurement::Air(Some(Stamp::Usec(t_us)), sample)) => Some((t_us, sample)),
        _ => None,
    };
    let found = reader.by_ref().flatten().filter_map(of).collect();
    assert_eq!(reader.damage(), Damage::default());
    found
}

#[test]
fn pressures_and_airspeeds_are_read_by_instance_from_the_better_topic() {
    let sample =
        |kind, sensor, value, temperature_degc| AirSample { t_s: 0.0, kind, sensor, value, temperature_degc };
    let (baro, pitot) = (AirKind::Barometer, AirKind::Airspeed);
    let differential = ("differential_pressure", "float differential_pressure_pa;float temperature;");
    // 245 Pa are 20 m/s; a negative pressure is no speed.
    let found =
        air_of(&[differential], &[(0, 0, 1_490_000, &[245.0, 20.0]), (0, 1, 1_480_000, &[-3.0, 20.0])]);
    assert_eq!(found, [(1_490_000, sample(pitot, 0, 20.0, None)), (1_480_000, sample(pitot, 1, 0.0, None))]);
    let airspeed = ("airspeed", "float indicated_airspeed_m_s;float true_airspeed_m_s;");
    let data: [(usize, u8, u64, &[f32]); 4] = [
        (0, 0, 1_490_000, &[245.0, 20.0]),
        (1, 0, 1_490_000, &[19.5, 21.0]),
        (1, 1, 1_485_000, &[18.5, 20.0]),
        (1, 1, 1_485_000, &[-1.0, 20.0]),
    ];
    let found = air_of(&[differential, airspeed], &data);
    assert_eq!(found, [(1_490_000, sample(pitot, 0, 19.5, None)), (1_485_000, sample(pitot, 1, 18.5, None))]);
    let single = ("sensor_baro", "float pressure;float temperature;");
    let found = air_of(&[single], &[(0, 0, 1_490_000, &[95_000.0, 41.5]), (0, 1, 1_490_000, &[950.0, 40.5])]);
    assert_eq!(
        found,
        [
            (1_490_000, sample(baro, 0, 95_000.0, Some(41.5))),
            (1_490_000, sample(baro, 1, 95_000.0, Some(40.5)))
        ],
        "pascal, and hectopascal before 1.14"
    );
    let fused = ("vehicle_air_data", "float baro_alt_meter;float baro_temp_celcius;float baro_pressure_pa;");
    let data: [(usize, u8, u64, &[f32]); 2] =
        [(0, 0, 1_490_000, &[95_000.0, 41.5]), (1, 0, 1_470_000, &[540.0, 39.5, 94_990.0])];
    assert_eq!(air_of(&[single, fused], &data), [(1_470_000, sample(baro, 0, 94_990.0, Some(39.5)))]);
}

#[test]
fn the_selected_accelerometer_is_named() {
    let mut bytes = definitions();
    bytes.extend(message(
        b'F',
        b"sensor_selection:uint64_t timestamp;uint32_t accel_device_id;uint32_t gyro_device_id;",
    ));
    bytes.extend(subscription(20, "sensor_selection"));
    for id in [0_u32, 1_310_988] {
        let body = [&20_u16.to_le_bytes()[..], &9_u64.to_le_bytes(), &id.to_le_bytes(), &7_u32.to_le_bytes()]
            .concat();
        bytes.extend(message(b'D', &body));
    }
    bytes.extend(data());
    let of = |record: Record| match record.item {
        Item::Note(LogNote::Accelerometer(id)) => Some(id),
        _ => None,
    };
    let found: Vec<u32> = UlogReader::new(&bytes[..], bytes.len() as u64).flatten().filter_map(of).collect();
    assert_eq!(found, [1_310_988]);
}

proptest! {
    #[test]
    fn a_burst_costs_what_it_touches_and_is_reported(
        at in 0_usize..12_000, burst in proptest::collection::vec(any::<u8>(), 1..65),
    ) {
        let mut bytes = [definitions(), data()].concat();
        let at = definitions().len() + at % (data().len() - burst.len());
        let whole = bytes.clone();
        bytes[at..at + burst.len()].copy_from_slice(&burst);
        let read = read(&bytes);
        let lost = SAMPLES.saturating_sub(read.imu);
        prop_assert!(lost <= 5, "{lost} of {SAMPLES} lost at {at}");
        // The format has no checksums: a type or topic that becomes another possible one cannot be recognised.
        prop_assert!(lost <= 1 || read.damage.any(), "{lost} lost without a word");
        prop_assert!(bytes != whole || !read.damage.any());
    }

    #[test]
    fn rubbish_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..3000), behind in any::<bool>()) {
        let head = if behind { definitions() } else { b"ULog\x01\x12\x35\x01".to_vec() };
        let bytes = [head, bytes].concat();
        let _ = UlogReader::new(&bytes[..], bytes.len() as u64).count();
    }
}
