//! What the autopilot's own log says beside its sensors: firmware, vehicle, and its navigation filter.

use super::Entry;
use crate::logs::filter::{self, Channel};
use gaware_nav::observability::words::VehicleKind;

/// Which of the autopilot's navigation filters flies: ArduPilot may run two of them, each on several inertial units.
///
/// The messages of EKF2 begin with `NKF`, those of EKF3 with `XKF`. Since 4.1 a message names its core (`C`); before, the second core had
/// numbers of its own, 8 for 3 and 9 for 4 (`AP_NavEKF2/LogStructure.h`, `AP_NavEKF3/LogStructure.h`; 3.6: `AP_Logger/LogStructure.h`).
#[derive(Debug, Default)]
pub(super) struct Filter {
    /// `AHRS_EKF_TYPE`: 2 or 3.
    kind: Option<u8>,
    /// The filter whose messages came first, where no parameter says.
    first: Option<u8>,
    /// The core that flies (`PI`).
    primary: f64,
}

impl Filter {
    /// Takes a parameter of the vehicle.
    pub(super) fn parameter(&mut self, name: &str, value: f64) {
        self.kind = match (name, value) {
            ("AHRS_EKF_TYPE", 2.0) => Some(2),
            ("AHRS_EKF_TYPE", 3.0) => Some(3),
            _ => self.kind,
        };
    }

    /// Innovations and test ratios of the core that flies; nothing of another message.
    pub(super) fn values(&mut self, entry: &Entry) -> Vec<(Channel, f64)> {
        let Some((kind, core, innovations)) = message(entry) else { return Vec::new() };
        if self.kind.unwrap_or(*self.first.get_or_insert(kind)) != kind {
            return Vec::new();
        }
        self.primary = entry.number("PI").unwrap_or(self.primary);
        let of = |label| entry.number(label);
        match innovations {
            _ if core != self.primary => Vec::new(),
            true => filter::finite([
                (Channel::VelocityNorth, of("IVN")),
                (Channel::VelocityEast, of("IVE")),
                (Channel::VelocityDown, of("IVD")),
                (Channel::PositionNorth, of("IPN")),
                (Channel::PositionEast, of("IPE")),
                (Channel::PositionDown, of("IPD")),
                (Channel::Heading, of("IYAW")),
            ]),
            false => filter::finite([
                (Channel::VelocityRatio, of("SV")),
                (Channel::PositionRatio, of("SP")),
                (Channel::HeightRatio, of("SH")),
                (Channel::HeadingRatio, of("SM")),
            ]),
        }
    }
}

/// Filter, core, and whether a message holds innovations (otherwise test ratios); nothing of another message.
fn message(entry: &Entry) -> Option<(u8, f64, bool)> {
    let (kind, number) = match entry.format.name.split_at_checked(3)? {
        ("NKF", number) => (2, number),
        ("XKF", number) => (3, number),
        _ => return None,
    };
    let named = entry.number("C");
    match number {
        "3" => Some((kind, named.unwrap_or(0.0), true)),
        "4" => Some((kind, named.unwrap_or(0.0), false)),
        "8" if named.is_none() => Some((kind, 1.0, true)),
        "9" if named.is_none() => Some((kind, 1.0, false)),
        _ => None,
    }
}

/// The firmware names itself at the start of a log: "ArduPlane V4.5.7 (…)".
pub(super) fn kind_of_firmware(message: &str) -> Option<VehicleKind> {
    [
        ("ArduPlane", VehicleKind::FixedWing),
        ("ArduCopter", VehicleKind::Multirotor),
        ("APM:Copter", VehicleKind::Multirotor),
        ("APM:Plane", VehicleKind::FixedWing),
    ]
    .into_iter()
    .find_map(|(name, kind)| message.starts_with(name).then_some(kind))
}

/// Major and minor version in the same words.
pub(super) fn version(message: &str) -> Option<(u8, u8)> {
    let (name, rest) = message.split_once(" V")?;
    if !name.starts_with("Ardu") && !name.starts_with("APM:") {
        return None;
    }
    let mut parts = rest.split(|c: char| !c.is_ascii_digit());
    Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?))
}

/// Only a copter has a class of frame (`FRAME_CLASS`, `FRAME` before 2017); only a plane can be a quadplane (`Q_ENABLE`).
pub(super) fn kind_of_parameter(name: &str, value: f64) -> Option<VehicleKind> {
    match name {
        "FRAME_CLASS" if value > 0.0 => Some(VehicleKind::Multirotor),
        "FRAME" => Some(VehicleKind::Multirotor),
        "Q_ENABLE" => Some(VehicleKind::FixedWing),
        _ => None,
    }
}
