//! Static pressure and airspeed out of MAVLink messages.
//!
//! Both autopilots send the pressure of a barometer before any correction for the flow (ArduPilot, `GCS_Common.cpp`: `send_scaled_pressure_instance`,
//! `barometer.get_pressure`; PX4, `streams/SCALED_PRESSURE.hpp`: `sensor_baro`). `AIRSPEED` is of a sensor; the airspeed of `VFR_HUD` may be an estimate of the
//! autopilot's own, and is left out.

use crate::timeline::Stamp;
use gaware_nav::effects::SEA_LEVEL_DENSITY;
use gaware_nav::sample::{AirKind, AirSample};
use mavlink::dialects::ardupilotmega::{HighresImuUpdatedFlags, MavMessage};

/// Pa per hPa.
const PA: f64 = 100.0;
/// The same value again within this is the same sample, µs.
const REPEATED_US: u64 = 300_000;
/// `HIGHRES_IMU.fields_updated`: absolute and differential pressure (`common.xml`).
const UPDATED: [u16; 2] = [0x200, 0x400];

/// What a differential pressure says of the airspeed, m/s.
pub fn equivalent_airspeed(pressure_pa: f64) -> f64 {
    (2.0 * pressure_pa.max(0.0) / SEA_LEVEL_DENSITY).sqrt()
}

/// Which message the first barometer is taken from, and the last value of each.
#[derive(Debug, Clone, Copy, Default)]
pub struct AirMessages {
    fine: bool,
    last: [[Option<(u64, f64)>; 4]; 2],
}

impl AirMessages {
    /// What a message has; `HIGHRES_IMU` is finer and comes before `SCALED_PRESSURE`.
    pub fn readings(&mut self, message: &MavMessage) -> Vec<(Option<Stamp>, AirSample)> {
        let pressure = |sensor, hpa: f32, celsius: Option<f64>| {
            let value = f64::from(hpa) * PA;
            AirSample { t_s: 0.0, kind: AirKind::Barometer, sensor, value, temperature_degc: celsius }
        };
        let degc = |hundredths: i16| (hundredths != 0).then(|| 0.01 * f64::from(hundredths));
        let speed = |sensor, value| AirSample {
            t_s: 0.0,
            kind: AirKind::Airspeed,
            sensor,
            value,
            temperature_degc: None,
        };
        let found = match message {
            MavMessage::SCALED_PRESSURE(m) if !self.fine => {
                vec![(Some(Stamp::BootMs(m.time_boot_ms)), pressure(0, m.press_abs, degc(m.temperature)))]
            }
            MavMessage::SCALED_PRESSURE2(m) => {
                vec![(Some(Stamp::BootMs(m.time_boot_ms)), pressure(1, m.press_abs, degc(m.temperature)))]
            }
            MavMessage::SCALED_PRESSURE3(m) => {
                vec![(Some(Stamp::BootMs(m.time_boot_ms)), pressure(2, m.press_abs, degc(m.temperature)))]
            }
            MavMessage::AIRSPEED(m) => vec![(None, speed(m.id, f64::from(m.airspeed)))],
            MavMessage::HIGHRES_IMU(m) if m.id == 0 => {
                let has =
                    |flag: u16| m.fields_updated.contains(HighresImuUpdatedFlags::from_bits_truncate(flag));
                let stamp = Some(Stamp::Usec(m.time_usec));
                let degc = Some(f64::from(m.temperature)).filter(|t| *t != 0.0);
                let own = has(UPDATED[0]).then(|| (stamp, pressure(0, m.abs_pressure, degc)));
                self.fine |= own.is_some_and(|o| o.1.is_plausible());
                let dynamic = f64::from(m.diff_pressure) * PA;
                let flown = (has(UPDATED[1]) && dynamic > 0.0)
                    .then(|| (stamp, speed(0, equivalent_airspeed(dynamic))));
                own.into_iter().chain(flown).collect()
            }
            _ => return Vec::new(),
        };
        found.into_iter().filter(|(stamp, sample)| self.is_new(*stamp, sample)).collect()
    }

    fn is_new(&mut self, stamp: Option<Stamp>, sample: &AirSample) -> bool {
        let Some(last) = self.last[sample.kind as usize].get_mut(usize::from(sample.sensor)) else {
            return false;
        };
        let Some(t_us) = stamp.map(Stamp::raw_us) else { return true };
        let is_new = last.is_none_or(|(at, old)| old != sample.value || t_us.abs_diff(at) >= REPEATED_US);
        if is_new {
            *last = Some((t_us, sample.value));
        }
        is_new
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::{
        AIRSPEED_DATA, HIGHRES_IMU_DATA, SCALED_PRESSURE_DATA, SCALED_PRESSURE2_DATA,
    };

    #[test]
    fn every_sensor_of_the_air_comes_from_its_best_message_once() {
        let mut air = AirMessages::default();
        let coarse = |time_boot_ms, press_abs| {
            let own =
                SCALED_PRESSURE_DATA { time_boot_ms, press_abs, temperature: 2150, ..Default::default() };
            MavMessage::SCALED_PRESSURE(own)
        };
        let found = air.readings(&coarse(1000, 950.5));
        assert_eq!(found[0].1.sensor, 0);
        assert!(
            (found[0].1.value - 95_050.0).abs() < 1e-6 && found[0].1.temperature_degc == Some(21.5),
            "{found:?}"
        );
        assert!(air.readings(&coarse(1100, 950.5)).is_empty(), "the same sample again");
        let second = SCALED_PRESSURE2_DATA { time_boot_ms: 1000, press_abs: 951.0, ..Default::default() };
        assert_eq!(air.readings(&MavMessage::SCALED_PRESSURE2(second))[0].1.sensor, 1);
        let fields_updated = HighresImuUpdatedFlags::from_bits_truncate(0x600);
        let fine = HIGHRES_IMU_DATA {
            time_usec: 2_000_000,
            fields_updated,
            abs_pressure: 950.0,
            diff_pressure: 2.45,
            ..Default::default()
        };
        let found = air.readings(&MavMessage::HIGHRES_IMU(fine));
        assert_eq!((found[0].1.kind, found[1].1.kind), (AirKind::Barometer, AirKind::Airspeed));
        assert!((found[1].1.value - 20.0).abs() < 1e-3, "245 Pa are 20 m/s: {found:?}");
        assert!(air.readings(&coarse(3000, 949.0)).is_empty(), "the coarse message after the fine one");
        let pitot = AIRSPEED_DATA { id: 1, airspeed: 17.0, ..Default::default() };
        let found = air.readings(&MavMessage::AIRSPEED(pitot));
        assert_eq!((found[0].1.sensor, found[0].1.value), (1, 17.0));
    }
}
