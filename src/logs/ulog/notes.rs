//! What the autopilot's own log says beside its sensors: parameters, version, and its navigation filter.

use super::{Basic, Fields};
use crate::logs::filter::{self, Channel};
use crate::logs::{LogNote, VehicleClass};

/// The key of a message with a key, and the bytes of its value.
pub(super) fn keyed(body: &[u8]) -> Option<(&str, &[u8])> {
    let (&length, rest) = body.split_first()?;
    let (key, value) = rest.split_at_checked(usize::from(length))?;
    Some((std::str::from_utf8(key).ok()?, value))
}

/// A parameter of the vehicle: `int32_t` or `float`.
pub(super) fn parameter_note(body: &[u8]) -> Option<LogNote> {
    let (key, value) = keyed(body)?;
    let (kind, name) = key.split_once(' ')?;
    let value = match kind {
        "int32_t" | "float" => Basic::of(kind)?.read(value).filter(|v| v.is_finite())?,
        _ => return None,
    };
    Some(LogNote::Parameter { name: name.to_owned(), value })
}

/// `ver_sw_release`: major, minor, patch, type, from the highest byte.
pub(super) fn version_note(body: &[u8]) -> Option<LogNote> {
    let ("uint32_t ver_sw_release", value) = keyed(body)? else { return None };
    let [_, _, minor, major] = *value.first_chunk()?;
    Some(LogNote::Version(major, minor))
}

/// `sys_uuid`: the serial number of the board; zeros are none.
pub(super) fn board_note(body: &[u8]) -> Option<LogNote> {
    let (key, value) = keyed(body)?;
    let ("sys_uuid", text) = (key.split_once(' ')?.1, std::str::from_utf8(value).ok()?) else { return None };
    let known = text.bytes().all(|b| b.is_ascii_alphanumeric()) && text.bytes().any(|b| b != b'0');
    known.then(|| LogNote::Board(text.to_owned()))
}

/// What flies by the number of the airframe: `SYS_AUTOSTART` (PX4 user guide, "Airframes Reference"): 2000 and 3000 planes and flying wings,
/// 13000 VTOL, 4000 to 9000, 11000 and 12000 multirotors.
pub(super) fn airframe(body: &[u8]) -> Option<VehicleClass> {
    let ("int32_t SYS_AUTOSTART", value) = keyed(body)? else { return None };
    match i32::from_le_bytes(*value.first_chunk()?) {
        2000..=3999 => Some(VehicleClass::FixedWing),
        13_000..=13_999 => Some(VehicleClass::Vtol),
        4000..=9999 | 11_000..=12_999 => Some(VehicleClass::Multirotor),
        _ => None,
    }
}

/// Whether several instances of the navigation filter write this topic, one each.
pub(super) fn is_of_filter(topic: &str) -> bool {
    matches!(
        topic,
        "estimator_innovations"
            | "estimator_innovation_test_ratios"
            | "estimator_status"
            | "estimator_status_flags"
            | "estimator_event_flags"
    )
}

/// The largest of the components, as the filter itself judges and sends them (PX4, `EKF2.cpp`, `PublishStatus`).
fn largest(ratios: [Option<f64>; 3]) -> Option<f64> {
    ratios.into_iter().flatten().reduce(f64::max)
}

/// Innovations and test ratios of the navigation filter: of `estimator_innovations` and `estimator_innovation_test_ratios`, or, before
/// 1.11, `ekf2_innovations` and `estimator_status`.
pub(super) fn filter_values(topic: &str, fields: &Fields) -> Vec<(Channel, f64)> {
    use Channel::*;
    let at = |name: &str, k: usize| fields.element(name, k);
    match topic {
        "estimator_innovations" => filter::finite([
            (VelocityNorth, at("gps_hvel", 0)),
            (VelocityEast, at("gps_hvel", 1)),
            (VelocityDown, at("gps_vvel", 0)),
            (PositionNorth, at("gps_hpos", 0)),
            (PositionEast, at("gps_hpos", 1)),
            (PositionDown, at("gps_vpos", 0)),
            (Heading, at("heading", 0).map(f64::to_degrees)),
        ]),
        "estimator_innovation_test_ratios" => filter::finite([
            (VelocityRatio, largest([at("gps_hvel", 0), at("gps_hvel", 1), at("gps_vvel", 0)])),
            (PositionRatio, largest([at("gps_hpos", 0), at("gps_hpos", 1), None])),
            (HeightRatio, largest([at("gps_vpos", 0), at("baro_vpos", 0), None])),
            (HeadingRatio, at("heading", 0)),
        ]),
        "ekf2_innovations" => filter::finite([
            (VelocityNorth, at("vel_pos_innov", 0)),
            (VelocityEast, at("vel_pos_innov", 1)),
            (VelocityDown, at("vel_pos_innov", 2)),
            (PositionNorth, at("vel_pos_innov", 3)),
            (PositionEast, at("vel_pos_innov", 4)),
            (PositionDown, at("vel_pos_innov", 5)),
            (Heading, at("heading_innov", 0).map(f64::to_degrees)),
        ]),
        "estimator_status" => filter::finite([
            (VelocityRatio, at("vel_test_ratio", 0)),
            (PositionRatio, at("pos_test_ratio", 0)),
            (HeightRatio, at("hgt_test_ratio", 0)),
            (HeadingRatio, at("hdg_test_ratio", 0).or(at("mag_test_ratio", 0))),
        ]),
        _ => Vec::new(),
    }
}
