//! `MAG`, `MAG2`, `MAG3`: the field of every compass in body axes, with the corrections of the autopilot (`AP_Compass/AP_Compass.cpp`: `get_field`), mG.

use super::Entry;
use gaware_nav::sample::FieldSample;

/// T per mG.
const TESLA_PER_MGAUSS: f64 = 1e-7;
/// A sample lies in the autopilot for less than this, µs.
const LONGEST_US: u32 = 500_000;

/// The compass of a message, from 0; nothing of another message. Firmware before 4.1 counts them in the name.
pub(super) fn compass(entry: &Entry) -> Option<u8> {
    match entry.format.name.strip_prefix("MAG")? {
        "" => Some(entry.number("I").unwrap_or(0.0) as u8),
        number => number.parse::<u8>().ok()?.checked_sub(1),
    }
}

/// Its sample with the time at which it was taken, µs; an inner nothing where it is not healthy, nothing at all where its content is wrong.
pub(super) fn sample(entry: &Entry, compass: u8) -> Option<Option<(u64, FieldSample)>> {
    let t_us = entry.stamp_us()?;
    let field = entry.vector(["MagX", "MagY", "MagZ"])? * TESLA_PER_MGAUSS;
    if entry.number("Health") == Some(0.0) {
        return Some(None);
    }
    let late_us = entry.number("S").map(|s| (t_us as u32).wrapping_sub(s as u32)).filter(|l| *l < LONGEST_US);
    let taken_us = t_us.saturating_sub(u64::from(late_us.unwrap_or(0)));
    Some(Some((taken_us, FieldSample { t_s: 0.0, compass, field })))
}
