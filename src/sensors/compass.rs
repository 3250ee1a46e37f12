//! The field of every compass out of the inertial messages.
//!
//! ArduPilot sends that of compass 1 in `RAW_IMU`, `SCALED_IMU` and `HIGHRES_IMU`, of 2 and 3 in `SCALED_IMU2` and `SCALED_IMU3`, corrected and in body axes
//! (`GCS_MAVLink/GCS_Common.cpp`: `send_raw_imu`, `send_scaled_imu`, `compass.get_field`). PX4 sends the one in use, corrected, in `HIGHRES_IMU`; its `SCALED_IMU*` hold
//! the sensor's own values before calibration and rotation (`mavlink/streams/SCALED_IMU.hpp`: `sensor_mag`), and are left out.

use super::source::Autopilot;
use crate::timeline::{MOST_COMPASSES, Stamp};
use gaware_nav::sample::FieldSample;
use mavlink::dialects::ardupilotmega::{HIGHRES_IMU_DATA, HighresImuUpdatedFlags, MavMessage};
use nalgebra::Vector3;

/// T per mG and per G.
const TESLA: (f64, f64) = (1e-7, 1e-4);
/// ArduPilot fills `HIGHRES_IMU`, whose unit is G, with mG times 1000 (`GCS_Common.cpp`: `send_highres_imu`): no field of the Earth has so many G.
const NO_GAUSS: f64 = 50.0;
/// The same values again within this are the same sample: messages come more often than compasses are read, µs.
const REPEATED_US: u64 = 300_000;

/// Which message each compass is taken from, and its last values.
#[derive(Debug, Clone, Copy, Default)]
pub struct Compasses([Source; MOST_COMPASSES]);

#[derive(Debug, Clone, Copy, Default)]
struct Source {
    /// How good the best message so far is.
    rank: u8,
    last: Option<(u64, Vector3<f64>)>,
}

impl Compasses {
    /// A new sample of a compass, where a message has one.
    pub fn reading(&mut self, message: &MavMessage, autopilot: Autopilot) -> Option<(Stamp, FieldSample)> {
        let (compass, rank, stamp, field) = field(message, autopilot)?;
        let source = self.0.get_mut(usize::from(compass))?;
        if field == Vector3::zeros() || rank < source.rank {
            return None;
        }
        source.rank = rank;
        let t_us = stamp.raw_us();
        if source.last.is_some_and(|(at, old)| old == field && t_us.abs_diff(at) < REPEATED_US) {
            return None;
        }
        source.last = Some((t_us, field));
        Some((stamp, FieldSample { t_s: 0.0, compass, field }))
    }
}

/// Compass, how good the message is, stamp and field, T.
fn field(message: &MavMessage, autopilot: Autopilot) -> Option<(u8, u8, Stamp, Vector3<f64>)> {
    let integers = |compass, rank, stamp, xyz: [i16; 3]| {
        let own = autopilot != Autopilot::Px4;
        own.then(|| (compass, rank, stamp, Vector3::from(xyz.map(f64::from)) * TESLA.0))
    };
    match message {
        MavMessage::RAW_IMU(m) if m.id == 0 => {
            integers(0, 2, Stamp::Usec(m.time_usec), [m.xmag, m.ymag, m.zmag])
        }
        MavMessage::SCALED_IMU(m) => integers(0, 1, Stamp::BootMs(m.time_boot_ms), [m.xmag, m.ymag, m.zmag]),
        MavMessage::SCALED_IMU2(m) => integers(1, 1, Stamp::BootMs(m.time_boot_ms), [m.xmag, m.ymag, m.zmag]),
        MavMessage::SCALED_IMU3(m) => integers(2, 1, Stamp::BootMs(m.time_boot_ms), [m.xmag, m.ymag, m.zmag]),
        MavMessage::HIGHRES_IMU(m) if m.id == 0 => Some((0, 3, Stamp::Usec(m.time_usec), floats(m)?)),
        _ => None,
    }
}

fn floats(m: &HIGHRES_IMU_DATA) -> Option<Vector3<f64>> {
    if !m.fields_updated.contains(HighresImuUpdatedFlags::from_bits_truncate(0x1C0)) {
        return None;
    }
    let field = Vector3::new(m.xmag, m.ymag, m.zmag).map(f64::from);
    Some(field * if field.amax() > NO_GAUSS { 1e-3 * TESLA.0 } else { TESLA.1 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::{RAW_IMU_DATA, SCALED_IMU2_DATA};

    #[test]
    fn every_compass_comes_from_its_best_message_once() {
        let mut compasses = Compasses::default();
        let raw = |time_usec, xmag| {
            MavMessage::RAW_IMU(RAW_IMU_DATA { time_usec, xmag, ymag: -20, zmag: 400, ..Default::default() })
        };
        let mut read = |m: &MavMessage| compasses.reading(m, Autopilot::Ardupilot);
        let (_, first) = read(&raw(1_000_000, 200)).unwrap();
        assert_eq!(first.compass, 0);
        assert!((first.field - Vector3::new(2e-5, -2e-6, 4e-5)).norm() < 1e-12);
        assert!(read(&raw(1_020_000, 200)).is_none(), "the same sample again");
        assert!(read(&raw(1_400_000, 200)).is_some(), "a stationary compass measures");
        assert!(read(&raw(1_500_000, 0)).is_some());
        let second = SCALED_IMU2_DATA { time_boot_ms: 1500, xmag: 210, ..Default::default() };
        assert_eq!(read(&MavMessage::SCALED_IMU2(second.clone())).unwrap().1.compass, 1);
        let none = RAW_IMU_DATA { time_usec: 1_600_000, ..Default::default() };
        assert!(read(&MavMessage::RAW_IMU(none)).is_none(), "no compass");
        let flags = HighresImuUpdatedFlags::from_bits_truncate(0x1C0);
        let fine = HIGHRES_IMU_DATA { fields_updated: flags, xmag: 0.2, zmag: 0.4, ..Default::default() };
        let (_, fine) = read(&MavMessage::HIGHRES_IMU(fine)).unwrap();
        assert!((fine.field - Vector3::new(2e-5, 0.0, 4e-5)).norm() < 1e-11);
        assert!(read(&raw(1_700_000, 230)).is_none(), "the coarse message after the fine one");
        let odd = HIGHRES_IMU_DATA { fields_updated: flags, xmag: 2e5, zmag: 4e5, ..Default::default() };
        let (_, odd) = read(&MavMessage::HIGHRES_IMU(odd)).unwrap();
        assert!((odd.field - Vector3::new(2e-5, 0.0, 4e-5)).norm() < 1e-11);
        assert!(compasses.reading(&MavMessage::SCALED_IMU2(second), Autopilot::Px4).is_none());
    }
}
