//! What the conversion reports to the user, as values that screens and logs turn into words.

use super::source::{Autopilot, ImuSource};
use super::stuck::StuckSensor;
use serde::{Deserialize, Serialize};
use std::fmt;

/// One thing worth telling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "notice")]
pub enum Notice {
    /// The vehicle was found.
    Vehicle {
        /// System id.
        system_id: u8,
        /// Firmware.
        autopilot: Autopilot,
    },
    /// An inertial source was chosen, at the start or in place of another.
    SourceChosen {
        /// Message.
        source: ImuSource,
        /// Firmware it was chosen for.
        autopilot: Autopilot,
    },
    /// The message asked for by the user does not arrive.
    SourceAbsent {
        /// Message.
        source: ImuSource,
    },
    /// The autopilot started anew.
    Reboot,
    /// The time base jumped forward, or nothing arrived for long.
    ClockJump,
    /// The autopilot's clock went back, and it did not start anew.
    ClockSetBack,
    /// A sensor no longer measures; its samples are refused.
    SensorStuck {
        /// Which values do not change.
        sensor: StuckSensor,
    },
    /// A sensor is at the end of its range; samples there are refused.
    SensorClipped {
        /// Which.
        sensor: StuckSensor,
        /// Where, rad/s or m/s².
        limit: f64,
    },
    /// The sensor measures again.
    SensorMeasures,
    /// Many inertial stamps are out of place.
    StampsDisagree {
        /// Samples refused for it, …
        refused: u64,
        /// … of so many.
        of: u64,
    },
    /// Inertial stamps follow upon each other again.
    StampsAgree,
    /// The receiver has no three-dimensional fix.
    NoFix,
    /// The receiver has a fix (again).
    FixGained,
    /// Inertial samples arrive too slowly to follow a maneuver.
    RateTooLow {
        /// Measured, Hz.
        rate_hz: f64,
    },
    /// They arrive fast enough again.
    RateGood {
        /// Measured, Hz.
        rate_hz: f64,
    },
}

/// How much a notice matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// For the record.
    Info,
    /// The result suffers.
    Warning,
}

impl Notice {
    /// Whether this settles what an earlier notice warned of.
    pub fn settles(&self, earlier: &Self) -> bool {
        matches!(
            (self, earlier),
            (Self::FixGained, Self::NoFix)
                | (Self::RateGood { .. }, Self::RateTooLow { .. })
                | (Self::SensorMeasures, Self::SensorStuck { .. })
                | (Self::StampsAgree, Self::StampsDisagree { .. })
        )
    }

    /// How much it matters.
    pub fn severity(&self) -> Severity {
        match self {
            Self::Vehicle { .. }
            | Self::FixGained
            | Self::RateGood { .. }
            | Self::SensorMeasures
            | Self::StampsAgree => Severity::Info,
            Self::SourceChosen { source, autopilot } => match autopilot.consequence(*source) {
                Some(_) => Severity::Warning,
                None => Severity::Info,
            },
            _ => Severity::Warning,
        }
    }
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Vehicle { system_id, autopilot } => {
                write!(f, "vehicle {system_id} found, autopilot {autopilot}")
            }
            Self::SourceChosen { source, autopilot } => {
                write!(f, "inertial samples are taken from {source}")?;
                match autopilot.consequence(*source) {
                    Some(text) => write!(f, ": {text}"),
                    None => Ok(()),
                }
            }
            Self::SourceAbsent { source } => {
                write!(f, "{source} was asked for and does not arrive; choose another --source")
            }
            Self::Reboot => f.write_str("the autopilot rebooted; the motion state starts anew"),
            Self::ClockJump => {
                f.write_str("no inertial samples for more than 10 s; the motion state starts anew")
            }
            Self::ClockSetBack => {
                f.write_str("the autopilot's clock was set back; the motion state starts anew")
            }
            Self::SensorStuck { sensor } => write!(
                f,
                "{}: its values do not change in flight (frozen sensor or driver); samples are rejected until they do",
                sensor.words()
            ),
            Self::SensorClipped { sensor, limit } => write!(
                f,
                "{} ends at {}: its range is exceeded, samples at this limit are rejected",
                sensor.words(),
                sensor.value_words(*limit)
            ),
            Self::SensorMeasures => f.write_str("the inertial sensor measures again"),
            Self::StampsDisagree { refused, of } => write!(
                f,
                "{refused} time stamps of samples and fixes among {of} samples were out of place and rejected: another autopilot with the same system id, a damaged clock, or a link that delays frames by seconds"
            ),
            Self::StampsAgree => f.write_str("time stamps of samples and fixes are in order again"),
            Self::NoFix => f.write_str("the GNSS receiver has no 3-D fix"),
            Self::FixGained => f.write_str("the GNSS receiver has a 3-D fix"),
            Self::RateGood { rate_hz } => write!(f, "inertial samples arrive at {rate_hz:.0} Hz"),
            Self::RateTooLow { rate_hz } => write!(
                f,
                "inertial samples arrive at {rate_hz:.1} Hz; at least 50 Hz are needed to follow a maneuver"
            ),
        }
    }
}
