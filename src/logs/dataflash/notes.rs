//! What the autopilot's own log says beside its sensors: firmware, vehicle, and its navigation filter.

use super::Entry;
use crate::logs::filter::{self, Channel};
use crate::logs::{TRUTH, VehicleClass};

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
            ("AHRS_EKF_TYPE", 1.0) => Some(1),
            ("AHRS_EKF_TYPE", 2.0) => Some(2),
            ("AHRS_EKF_TYPE", 3.0) => Some(3),
            _ => self.kind,
        };
    }

    /// Whether a message is of the core that flies, where it names its core.
    pub(super) fn flies(&self, entry: &Entry) -> bool {
        let family = entry.format.name.get(..3);
        let kind = match family {
            Some("NKF") => Some(2),
            Some("XKF") => Some(3),
            _ => None,
        };
        let own = self.kind.or(self.first);
        entry.number("C").is_none_or(|core| core == self.primary)
            && (kind.is_none() || own.is_none() || kind == own)
    }

    /// Innovations and test ratios of the core that flies; nothing of another message.
    pub(super) fn values(&mut self, entry: &Entry) -> Vec<(Channel, f64)> {
        let Some((kind, core, innovations)) = message(entry) else { return Vec::new() };
        if self.kind.unwrap_or(*self.first.get_or_insert(kind)) != kind {
            return Vec::new();
        }
        self.primary = entry.number("PI").filter(|pi| *pi >= 0.0).unwrap_or(self.primary);
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
                (
                    Channel::HeadingRatio,
                    of("SM").or_else(|| ["SMX", "SMY", "SMZ"].into_iter().filter_map(of).reduce(f64::max)),
                ),
            ]),
        }
    }
}

/// Filter, core, and whether a message holds innovations (otherwise test ratios); nothing of another message.
fn message(entry: &Entry) -> Option<(u8, f64, bool)> {
    let (kind, number) = match entry.format.name.split_at_checked(3)? {
        ("NKF", number) => (2, number),
        ("XKF", number) => (3, number),
        // The first EKF, to 3.3.
        ("EKF", number @ ("3" | "4")) => (1, number),
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
pub(super) fn class_of_firmware(message: &str) -> Option<VehicleClass> {
    [
        ("ArduPlane", VehicleClass::FixedWing),
        ("ArduCopter", VehicleClass::Multirotor),
        ("APM:Copter", VehicleClass::Multirotor),
        ("APM:Plane", VehicleClass::FixedWing),
        ("ArduRover", VehicleClass::Rover),
        ("APM:Rover", VehicleClass::Rover),
        ("Rover V", VehicleClass::Rover),
        ("ArduSub", VehicleClass::Submarine),
    ]
    .into_iter()
    .find_map(|(name, class)| message.starts_with(name).then_some(class))
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

/// The board and its serial number, three words of 32 bits: "Pixhawk6X 002F0029 31335116 32373533".
pub(super) fn board(message: &str) -> Option<String> {
    let words: Vec<&str> = message.split_whitespace().collect();
    let [name, serial @ ..] = words.as_slice() else { return None };
    let is_word = |w: &&str| w.len() == 8 && w.bytes().all(|b| b.is_ascii_hexdigit());
    let fits = serial.len() == 3 && serial.iter().all(is_word) && serial.iter().any(|w| *w != "00000000");
    fits.then(|| format!("{name} {}", serial.concat().to_ascii_lowercase()))
}

/// Only a copter has a class of frame (`FRAME_CLASS`, `FRAME` before 2017), of which 6 and 11 are helicopters; only a plane can be a
/// quadplane (`Q_ENABLE`), and is one where that is on.
pub(super) fn class_of_parameter(name: &str, value: f64) -> Option<VehicleClass> {
    match (name, value) {
        ("FRAME_CLASS", 6.0 | 11.0 | 13.0) => Some(VehicleClass::Helicopter),
        ("FRAME_CLASS", value) if value > 0.0 => Some(VehicleClass::Multirotor),
        ("FRAME", _) => Some(VehicleClass::Multirotor),
        ("Q_ENABLE", value) if value > 0.0 => Some(VehicleClass::Vtol),
        ("Q_ENABLE", _) => Some(VehicleClass::FixedWing),
        _ => None,
    }
}

/// Roll, pitch, yaw, rad.
pub(super) fn attitude(entry: &Entry) -> Option<[f64; 3]> {
    Some(entry.vector(["Roll", "Pitch", "Yaw"])?.map(f64::to_radians).into())
}

/// An attitude beside the one that flies: of every lane of the filters, of the filter that stands by, and of a simulation.
pub(super) fn other_attitude(entry: &Entry) -> Option<(String, [f64; 3])> {
    let core = entry.number("C").unwrap_or(0.0) as u8;
    let name = match entry.format.name.as_str() {
        "XKF1" => format!("EKF3 lane {core}"),
        "NKF1" => format!("EKF2 lane {core}"),
        // Before 4.1 the second core has a number of its own.
        "XKF6" if entry.number("C").is_none() => "EKF3 lane 1".to_owned(),
        "NKF6" if entry.number("C").is_none() => "EKF2 lane 1".to_owned(),
        "EKF1" => "EKF1".to_owned(),
        "AHR2" => "AHR2".to_owned(),
        "SIM" => TRUTH.to_owned(),
        _ => return None,
    };
    Some((name, attitude(entry)?))
}
