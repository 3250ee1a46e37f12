//! What a log says beside sensors and fixes: parameters, who the vehicle is, the date, and how it was.

use super::filter::Channel;
use gaware_nav::observability::words::VehicleKind;

/// Whose attitude a simulated autopilot's log has beside others: that of the vehicle itself.
pub const TRUTH: &str = "simulation truth";

/// What an autopilot's own log says of itself (formats with frames say it in frames).
#[derive(Debug, Clone, PartialEq)]
pub enum LogNote {
    /// A parameter of the vehicle.
    Parameter {
        /// Name.
        name: String,
        /// Value.
        value: f64,
    },
    /// Major and minor version of the firmware.
    Version(u8, u8),
    /// Device id of the accelerometer that the samples are of.
    Accelerometer(u32),
    /// Innovations and test ratios of its navigation filter.
    Filter(Vec<(Channel, f64)>),
    /// Serial number of the board.
    Board(String),
    /// What kind of vehicle it is.
    Vehicle(VehicleClass),
    /// Unix time of this entry, s, by the receiver.
    Utc(f64),
    /// Another attitude beside the one that flies: whose, and roll, pitch, yaw, rad.
    Attitude(String, [f64; 3]),
    /// How the vehicle was.
    Health(HealthNote),
}

/// Kinds of vehicles, finer than what their maneuvers depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum VehicleClass {
    /// An aircraft with fixed wings.
    FixedWing,
    /// A multirotor.
    Multirotor,
    /// A helicopter.
    Helicopter,
    /// Wings and rotors.
    Vtol,
    /// A ground vehicle or boat.
    Rover,
    /// A submarine.
    Submarine,
}

impl VehicleClass {
    /// Whether wings carry it, at least in cruise.
    pub fn has_wings(self) -> bool {
        matches!(self, Self::FixedWing | Self::Vtol)
    }

    /// Whether rotors alone carry it.
    pub fn is_carried_by_rotors(self) -> bool {
        matches!(self, Self::Multirotor | Self::Helicopter)
    }

    /// What its maneuvers depend on; a VTOL flies turns on its wings.
    pub fn kind(self) -> Option<VehicleKind> {
        let wings = self.has_wings().then_some(VehicleKind::FixedWing);
        wings.or(self.is_carried_by_rotors().then_some(VehicleKind::Multirotor))
    }

    /// In documents.
    pub fn key(self) -> &'static str {
        match self {
            Self::FixedWing => "fixed_wing",
            Self::Multirotor => "multirotor",
            Self::Helicopter => "helicopter",
            Self::Vtol => "vtol",
            Self::Rover => "rover",
            Self::Submarine => "submarine",
        }
    }

    /// On screens.
    pub fn words(self) -> &'static str {
        match self {
            Self::FixedWing => "fixed wing",
            Self::Vtol => "VTOL",
            Self::Rover => "rover or boat",
            other => other.key(),
        }
    }

    /// Of `MAV_TYPE` (`minimal.xml`).
    pub fn of_mav_type(kind: u8) -> Option<Self> {
        Some(match kind {
            1 | 16 | 28 => Self::FixedWing,
            2 | 3 | 13..=15 | 29 | 35 => Self::Multirotor,
            4 => Self::Helicopter,
            10 | 11 => Self::Rover,
            12 => Self::Submarine,
            19..=25 => Self::Vtol,
            _ => return None,
        })
    }
}

/// How much a text of the autopilot matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// For the record, or not reported.
    Info,
    /// Something may go wrong.
    Warning,
    /// Something went wrong.
    Error,
}

impl Level {
    /// Of a `MAV_SEVERITY`.
    pub fn of_severity(severity: u8) -> Self {
        match severity {
            0..=3 => Self::Error,
            4 => Self::Warning,
            _ => Self::Info,
        }
    }

    /// Of a text of ArduPilot without a severity: what warns is known by its words.
    pub fn of_words(text: &str) -> Self {
        let lower = text.to_ascii_lowercase();
        let has = |words: &[&str]| words.iter().any(|word| lower.contains(word));
        if lower.starts_with("prearm") || lower.starts_with("arm:") {
            Self::Warning
        } else if has(&[
            "crash",
            "failsafe",
            "ekf variance",
            "lost",
            "unhealthy",
            "error",
            "bad ",
            "potential thrust",
        ]) {
            Self::Error
        } else if has(&[
            "fail",
            "low batt",
            "glitch",
            "inconsistent",
            "reset",
            "lane switch",
            "stopped aiding",
            "clipping",
        ]) {
            Self::Warning
        } else {
            Self::Info
        }
    }
}

/// A state or event of the vehicle.
#[derive(Debug, Clone, PartialEq)]
pub enum HealthNote {
    /// Flight mode.
    Mode(String),
    /// Armed or disarmed.
    Armed(bool),
    /// Off the ground or on it, as the autopilot sees it.
    InAir(bool),
    /// A receiver's own figures.
    Gnss {
        /// 0 no receiver to 6 RTK fixed; 3 is a 3-D fix.
        fix_type: u8,
        /// Satellites used.
        satellites: Option<f64>,
        /// Horizontal dilution of precision.
        hdop: Option<f64>,
        /// `jamming_indicator` of a u-blox receiver, 0 to 255.
        jamming: Option<f64>,
        /// Jamming or spoofing that the receiver itself reports as critical.
        interference: bool,
    },
    /// Vibration of an inertial unit as its autopilot measures it, m/s².
    Vibration(u8, f64),
    /// Samples of an inertial unit at the end of its range so far.
    Clipped(u8, f64),
    /// A counter of resets of the autopilot's filter: of what, and its value.
    Resets(&'static str, f64),
    /// A state of the autopilot's filter or of the vehicle begins or ends.
    Fault {
        /// Which.
        what: &'static str,
        /// Whether it is there.
        on: bool,
        /// Whether it ends an estimate or a flight.
        grave: bool,
    },
    /// The lane (core, instance) of the autopilot's filter that flies.
    Lane(u8),
    /// Battery: V, and what is left of it from 0 to 1.
    Battery {
        /// V.
        volts: f64,
        /// Cells in series, where reported.
        cells: Option<f64>,
        /// 0 to 1.
        remaining: Option<f64>,
    },
    /// Supply of the board, V.
    Supply(f64),
    /// Roll and pitch that are demanded, rad.
    Demanded([f64; 2]),
    /// Largest command to a motor: 0 where all are zero.
    Motors(f64),
    /// Entries that the logger has lost and those that it has written, so far.
    Lost(f64, f64),
    /// The logger could not write for so long, s; 0 at the begin of a log whose logger reports that.
    Pause(f64),
    /// A text of the autopilot.
    Text(Level, String),
}
