//! Barometers and airspeed in PX4's log: `vehicle_air_data` (5 Hz by default), else `sensor_baro` per instance (1 Hz by default); `airspeed` per instance,
//! else `differential_pressure`. All of them come before the corrections of the estimator and of `ASPD_SCALE_n`.

use super::fields::Fields;
use crate::sensors::air::equivalent_airspeed;
use gaware_nav::sample::{AirKind, AirSample};

/// Pressures below this are in hPa (PX4 before 1.14).
const HPA: f64 = 2000.0;

/// What a topic reports; nothing for one of another kind, or where another topic (`has`) says it better.
pub(super) fn of(fields: &Fields, has: impl Fn(&str) -> bool) -> Option<AirSample> {
    let number = |name: &str| fields.number(name);
    let sample = |kind, value, temperature_degc| {
        Some(AirSample { t_s: 0.0, kind, sensor: fields.topic.instance, value, temperature_degc })
    };
    match fields.topic.name.as_str() {
        "sensor_baro" if !has("vehicle_air_data") => {
            let pressure = number("pressure")?;
            let pa = if pressure < HPA { 100.0 * pressure } else { pressure };
            sample(AirKind::Barometer, pa, number("temperature"))
        }
        "vehicle_air_data" => {
            let degc = number("baro_temp_celcius").or(number("ambient_temperature"));
            sample(AirKind::Barometer, number("baro_pressure_pa")?, degc)
        }
        "airspeed" => sample(AirKind::Airspeed, number("indicated_airspeed_m_s").filter(|v| *v > 0.0)?, None),
        "differential_pressure" if !has("airspeed") => {
            let pa = number("differential_pressure_pa").or(number("differential_pressure_filtered_pa"))?;
            sample(AirKind::Airspeed, equivalent_airspeed(pa), None)
        }
        _ => None,
    }
}
