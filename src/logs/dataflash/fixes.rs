//! `GPS` and `GPA`: fixes with their accuracies, their time of arrival and the date.

use super::Entry;
use crate::sensors::gnss::Course;
use gaware_nav::earth::Geodetic;
use gaware_nav::sample::{FixVelocity, GnssFix};

/// A fix lies in the receiver's driver for less than this, ms.
const LONGEST_IN_DRIVER_MS: u32 = 500;

pub(super) fn fix(entry: &Entry, t_us: u64, course: &mut Course) -> Option<GnssFix> {
    let (lat, lon) = (entry.number("Lat")? * 1e-7, entry.number("Lng")? * 1e-7);
    if entry.number("Status")? < 3.0 || (lat, lon) == (0.0, 0.0) || lat.abs() > 90.0 || lon.abs() > 180.0 {
        return None;
    }
    let position = Geodetic::from_degrees(lat, lon, entry.number("Alt")?);
    let place = (t_us, entry.number("Lat")? as i32, entry.number("Lng")? as i32);
    let speed_and_course = entry.number("Spd").zip(entry.number("GCrs"));
    let horizontal = speed_and_course.map(|(speed, degrees)| course.velocity(place, speed, degrees));
    let velocity = match (horizontal, entry.number("VZ")) {
        (Some(([n, e], _)), Some(down)) => FixVelocity::Full([n, e, down]),
        (Some((velocity, _)), None) => FixVelocity::Horizontal(velocity),
        (None, _) => FixVelocity::None,
    };
    let velocity_sigma_m_per_s = horizontal.and_then(|(_, at_least)| at_least).map(|s| [s; 3]);
    let position_sigma_m = None;
    Some(GnssFix { t_s: 0.0, position, velocity, position_sigma_m, velocity_sigma_m_per_s, yaw_rad: None })
}

/// When the fix that was logged at this time, µs, arrived: the autopilot takes bytes from the receiver every 20 ms, dates the fix by the
/// arrival of its first byte (`SMS`; `GPS_RAW_INT` and EKF3 go by the same) and stamps the message when it writes it (ArduPilot
/// `AP_GPS/AP_GPS.cpp:update_instance`, `GPS_Backend.cpp:set_uart_timestamp`). `SMS` counts 32 bits of milliseconds.
pub(super) fn arrival_us(entry: &Entry, t_us: u64) -> u64 {
    let late_ms = entry.number("SMS").map(|sms| ((t_us / 1000) as u32).wrapping_sub(sms as u32));
    let late_us =
        late_ms.filter(|late| *late < LONGEST_IN_DRIVER_MS).map_or(0, |late| u64::from(late) * 1000);
    // The time of arrival has whole milliseconds.
    if late_us == 0 { t_us } else { (t_us - t_us % 1000).saturating_sub(late_us) }
}

/// Adds the accuracies; 0 is "unknown".
pub(super) fn accuracies(fix: &mut GnssFix, entry: &Entry) {
    let given = |name| entry.number(name).filter(|v| *v > 0.0);
    if let (Some(h), Some(v)) = (given("HAcc"), given("VAcc")) {
        fix.position_sigma_m = Some([h, h, v]);
    }
    if let Some(s) = given("SAcc") {
        // Without a direction the speed is not known better than this.
        let [n, e, _] = fix.velocity_sigma_m_per_s.unwrap_or_default();
        fix.velocity_sigma_m_per_s = Some([s.max(n), s.max(e), s]);
    }
}

/// Unix time of the start of GPS time, s.
const GPS_EPOCH_S: f64 = 315_964_800.0;
/// GPS time less UTC since 2017, s; in 2014 it was 16.
const LEAP_S: f64 = 18.0;
/// Weeks before 2011 are those of a receiver that does not know its date.
const FIRST_WEEK: f64 = 1620.0;

/// Unix time of a fix, s: `GWk` and `GMS`, before 2015 `Week` and `TimeMS`.
pub(super) fn utc_s(entry: &Entry) -> Option<f64> {
    let week = entry.number("GWk").or(entry.number("Week")).filter(|w| *w >= FIRST_WEEK)?;
    let ms = entry.number("GMS").or(entry.number("TimeMS"))?;
    Some(GPS_EPOCH_S + week * 604_800.0 + ms * 1e-3 - LEAP_S)
}
