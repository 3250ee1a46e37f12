//! Which inertial samples are taken, and what raw ones become.

use super::*;
use crate::logs::source::{Choice, Kind};
use gaware_nav::sample::SampleKind;

/// Samples of two units: the first one shakes ten times as much.
fn two_units() -> Vec<u8> {
    let mut out = definitions();
    for k in 0..SAMPLES {
        for unit in 0..2_u8 {
            let shake = if k % 2 == 0 { 1.0 } else { -1.0 } * if unit == 0 { 5.0 } else { 0.5 };
            let mut body = (1_000_000 + 5_000 * k).to_le_bytes().to_vec();
            body.push(unit);
            for v in [0.01_f32, 0.02, 0.03, 0.0, 0.001 * k as f32, -9.8 + shake] {
                body.extend(v.to_le_bytes());
            }
            out.extend(message(1, &body));
        }
    }
    out
}

#[test]
fn of_two_units_the_one_that_shakes_less_is_taken_and_named() {
    let log = two_units();
    let reader = || DataflashReader::new(&log[..], log.len() as u64);
    let best = reader().survey().unwrap().best().unwrap();
    assert_eq!((best.source.kind, best.source.unit, best.of), (Kind::Imu, 1, 2));
    let records: Vec<Record> = reader().with_source(best).flatten().collect();
    let largest = records.iter().filter_map(|r| match &r.item {
        Item::Measurement(Measurement::Imu(_, sample)) => Some((sample.accel.z + 9.8).abs()),
        _ => None,
    });
    assert_eq!(largest.clone().count() as u64, SAMPLES);
    assert!(largest.fold(0.0, f64::max) < 1.0);
    let named = records.iter().find_map(|r| match &r.item {
        Item::Measurement(Measurement::Stream(stream)) => Some(stream.message.as_str()),
        _ => None,
    });
    assert_eq!(named, Some("IMU[1] (of 2 sources, the least vibration)"));
}

/// Two seconds of raw samples at 1 kHz, those that are not lost, beside filtered ones at 25 Hz.
fn raw(lost: impl Fn(u64) -> bool) -> Vec<u8> {
    let mut log = definitions();
    let labels = |name: &str| format!("TimeUS,I,SampleUS,{name}X,{name}Y,{name}Z");
    log.extend(fmt(6, 3 + 8 + 1 + 8 + 12, "GYR", "QBQfff", &labels("Gyr")));
    log.extend(fmt(7, 3 + 8 + 1 + 8 + 12, "ACC", "QBQfff", &labels("Acc")));
    for k in (0..2000_u64).filter(|k| !lost(*k)) {
        let t = 1_000_000 + 1000 * k;
        if k % 40 == 0 {
            let mut body = t.to_le_bytes().to_vec();
            body.push(0);
            [0.0_f32, 0.0, 0.0, 0.0, 0.001 * k as f32, -9.8]
                .iter()
                .for_each(|v| body.extend(v.to_le_bytes()));
            log.extend(message(1, &body));
        }
        for (kind, values) in [(7, [0.0_f32, 0.001 * k as f32, -9.8]), (6, [0.001 * k as f32, 0.0, 0.0])] {
            let mut body = t.to_le_bytes().to_vec();
            body.push(0);
            body.extend(t.to_le_bytes());
            values.iter().for_each(|v| body.extend(v.to_le_bytes()));
            log.extend(message(kind, &body));
        }
    }
    log
}

/// The source, what its samples are, and time and rate of each, of a ramp of 1 rad/s².
fn raw_samples(log: &[u8]) -> (Choice, SampleKind, Vec<(u64, f64)>) {
    let reader = || DataflashReader::new(log, log.len() as u64);
    let best = reader().survey().unwrap().best().unwrap();
    let records: Vec<Record> = reader().with_source(best).flatten().collect();
    let samples = records.iter().filter_map(|r| match &r.item {
        Item::Measurement(Measurement::Imu(stamp, sample)) => Some((stamp.raw_us(), sample.gyro.x)),
        _ => None,
    });
    let kind = records.iter().find_map(|r| match &r.item {
        Item::Measurement(Measurement::Stream(s)) => Some(s.kind),
        _ => None,
    });
    (best, kind.unwrap(), samples.collect())
}

#[test]
fn raw_samples_become_means_of_four_milliseconds() {
    let (best, kind, samples) = raw_samples(&raw(|_| false));
    assert_eq!((best.source.kind, kind), (Kind::Raw, SampleKind::IntervalMean), "{best:?}");
    assert!((499..=500).contains(&samples.len()), "{}", samples.len());
    // The mean over the interval that ends at its stamp: of k−3 … k.
    let (t_us, gyro) = samples[100];
    assert!((gyro - 1e-3 * ((t_us - 1_000_000) as f64 * 1e-3 - 1.5)).abs() < 1e-6, "{t_us} {gyro}");
}

/// A mean that took the time of the lost samples for its own would be off by half of it: 0.02 rad/s of this ramp.
#[test]
fn the_mean_of_raw_samples_says_nothing_of_those_that_are_lost() {
    let (_, kind, samples) = raw_samples(&raw(|k| k > 100 && k % 100 < 40));
    assert_eq!(kind, SampleKind::Point);
    assert!(samples.len() > 250, "{}", samples.len());
    for (t_us, gyro) in samples {
        let ramp = (t_us as f64 - 1_000_000.0) * 1e-6;
        assert!((gyro - ramp).abs() < 0.001, "{t_us} {gyro} {ramp}");
    }
}

/// A damaged time is as far from the last one as can be.
#[test]
fn a_raw_sample_at_the_end_of_time_is_no_crash() {
    let mut log = raw(|_| false);
    for stamp in [u64::MAX, 0, u64::MAX, 5] {
        for kind in [7, 6] {
            let mut body = 4_000_000_u64.to_le_bytes().to_vec();
            body.push(0);
            body.extend(stamp.to_le_bytes());
            body.extend([0; 12]);
            log.extend(message(kind, &body));
        }
    }
    assert!(raw_samples(&log).2.len() >= 499);
}
