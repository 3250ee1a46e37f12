//! `BARO` and `ARSP` per instance (`BAR2`, `ASP2` before 4.1): static pressure before any correction for the flow (`AP_Baro/AP_Baro_Logging.cpp`: `get_pressure`), and
//! the equivalent airspeed with the ratio of the autopilot (`AP_Airspeed/AP_Airspeed.cpp`: `get_raw_airspeed`).

use super::Entry;
use gaware_nav::sample::{AirKind, AirSample};

/// A sample lies in the autopilot for less than this, µs.
const LONGEST_US: u64 = 500_000;

/// The sample of a message with the time at which it was taken, µs; nothing of another message, or where the sensor is not healthy.
pub(super) fn sample(entry: &Entry) -> Option<(u64, AirSample)> {
    let name = entry.format.name.as_str();
    let (kind, number) = match name {
        "BARO" => (AirKind::Barometer, 0),
        "BAR2" | "BAR3" => (AirKind::Barometer, u8::from(name == "BAR3") + 1),
        "ARSP" => (AirKind::Airspeed, 0),
        "ASP2" => (AirKind::Airspeed, 1),
        _ => return None,
    };
    let t_us = entry.stamp_us()?;
    let sensor = entry.number("I").map_or(number, |i| i as u8);
    let value = entry.number(if kind == AirKind::Barometer { "Press" } else { "Airspeed" })?;
    let is_well = |label: &str| entry.number(label) != Some(0.0);
    if !is_well("Health") || !is_well("H") || kind == AirKind::Airspeed && value == 0.0 {
        return None;
    }
    let taken = entry.number("SMS").map(|ms| (ms * 1e3) as u64);
    let taken = taken.filter(|at| *at <= t_us && t_us - at < LONGEST_US).unwrap_or(t_us);
    let temperature_degc = entry.number("Temp").filter(|t| t.is_finite());
    Some((taken, AirSample { t_s: 0.0, kind, sensor, value, temperature_degc }))
}
