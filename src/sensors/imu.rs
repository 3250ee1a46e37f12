//! Inertial messages into SI.

use super::source::ImuSource;
use crate::timeline::Stamp;
use gaware_nav::sample::{ImuSample, Steps};
use mavlink::dialects::ardupilotmega::{HIGHRES_IMU_DATA, HighresImuUpdatedFlags, MavMessage};
use nalgebra::Vector3;

/// One message's content, before its time is judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Message.
    pub source: ImuSource,
    /// Its time stamp.
    pub stamp: Stamp,
    /// Its values; the time line gives them their time.
    pub sample: ImuSample,
    /// Whether a value stands at the end of the integer range.
    pub clipped: bool,
}

/// Why a message of a candidate gives no reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unusable {
    /// It is about another instance than the first inertial unit.
    OtherInstance,
    /// Its flags say that gyro or accelerometer values are old.
    NotUpdated,
    /// Values that are no numbers.
    NotFinite,
}

/// Takes the reading out of an inertial message; nothing for any other.
pub fn reading(message: &MavMessage) -> Option<Result<Reading, Unusable>> {
    let scaled = |source, ms, gyro, accel, temperature| {
        Some(Ok(from_integers(source, Stamp::BootMs(ms), gyro, accel, temperature)))
    };
    match message {
        MavMessage::RAW_IMU(m) if m.id != 0 => Some(Err(Unusable::OtherInstance)),
        MavMessage::RAW_IMU(m) => Some(Ok(from_integers(
            ImuSource::RawImu,
            Stamp::Usec(m.time_usec),
            [m.xgyro, m.ygyro, m.zgyro],
            [m.xacc, m.yacc, m.zacc],
            m.temperature,
        ))),
        MavMessage::SCALED_IMU(m) => scaled(
            ImuSource::ScaledImu,
            m.time_boot_ms,
            [m.xgyro, m.ygyro, m.zgyro],
            [m.xacc, m.yacc, m.zacc],
            m.temperature,
        ),
        MavMessage::SCALED_IMU2(m) => scaled(
            ImuSource::ScaledImu2,
            m.time_boot_ms,
            [m.xgyro, m.ygyro, m.zgyro],
            [m.xacc, m.yacc, m.zacc],
            m.temperature,
        ),
        MavMessage::SCALED_IMU3(m) => scaled(
            ImuSource::ScaledImu3,
            m.time_boot_ms,
            [m.xgyro, m.ygyro, m.zgyro],
            [m.xacc, m.yacc, m.zacc],
            m.temperature,
        ),
        MavMessage::HIGHRES_IMU(m) => Some(from_floats(m)),
        _ => None,
    }
}

/// mrad/s and mG; the temperature extension counts centidegrees and says 0 for "none".
fn from_integers(
    source: ImuSource,
    stamp: Stamp,
    gyro: [i16; 3],
    accel: [i16; 3],
    centidegrees: i16,
) -> Reading {
    let clipped = gyro.iter().chain(&accel).any(|v| *v == i16::MAX || *v == i16::MIN);
    Reading {
        source,
        stamp,
        sample: ImuSample {
            t_s: 0.0,
            gyro: Vector3::from(gyro.map(f64::from)) * Steps::RAW_IMU.gyro,
            accel: Vector3::from(accel.map(f64::from)) * Steps::RAW_IMU.accel,
            temperature_degc: (centidegrees != 0).then(|| f64::from(centidegrees) * 0.01),
        },
        clipped,
    }
}

/// The temperature of this message is the barometer's or the air's, not the inertial unit's.
fn from_floats(m: &HIGHRES_IMU_DATA) -> Result<Reading, Unusable> {
    if m.id != 0 {
        return Err(Unusable::OtherInstance);
    }
    let needed = HighresImuUpdatedFlags::from_bits_truncate(0b11_1111);
    if !m.fields_updated.contains(needed) {
        return Err(Unusable::NotUpdated);
    }
    let gyro = Vector3::new(m.xgyro, m.ygyro, m.zgyro).map(f64::from);
    let accel = Vector3::new(m.xacc, m.yacc, m.zacc).map(f64::from);
    let sample = ImuSample { t_s: 0.0, gyro, accel, temperature_degc: None };
    if !sample.is_finite() {
        return Err(Unusable::NotFinite);
    }
    Ok(Reading { source: ImuSource::HighresImu, stamp: Stamp::Usec(m.time_usec), sample, clipped: false })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::RAW_IMU_DATA;

    #[test]
    fn integers_are_milli_units() {
        let m = RAW_IMU_DATA { zacc: -1000, xgyro: 250, temperature: 4512, ..Default::default() };
        let r = reading(&MavMessage::RAW_IMU(m)).unwrap().unwrap();
        assert!((r.sample.accel.z + 9.806_65).abs() < 1e-12);
        assert!((r.sample.gyro.x - 0.25).abs() < 1e-12);
        assert!((r.sample.temperature_degc.unwrap() - 45.12).abs() < 1e-9);
        assert!(!r.clipped);
    }

    #[test]
    fn the_end_of_the_range_is_noticed() {
        let m = RAW_IMU_DATA { yacc: i16::MIN, ..Default::default() };
        assert!(reading(&MavMessage::RAW_IMU(m)).unwrap().unwrap().clipped);
    }

    #[test]
    fn old_values_are_no_reading() {
        let fresh = HighresImuUpdatedFlags::from_bits_truncate(0x3F);
        let mut m = HIGHRES_IMU_DATA { fields_updated: fresh, zacc: -9.8, ..Default::default() };
        assert!(from_floats(&m).is_ok());
        m.fields_updated = HighresImuUpdatedFlags::from_bits_truncate(0x1C7);
        assert_eq!(from_floats(&m), Err(Unusable::NotUpdated));
        m.fields_updated = fresh;
        m.xgyro = f32::NAN;
        assert_eq!(from_floats(&m), Err(Unusable::NotFinite));
    }
}
