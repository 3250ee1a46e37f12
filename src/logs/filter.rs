//! What an autopilot's own navigation filter says of itself: innovations and test ratios, from every format.
//!
//! A test ratio is the innovation over the largest one that its filter accepts: ArduPilot gives the ratio (`XKF4`, `EKF_STATUS_REPORT`;
//! `AP_NavEKF3/AP_NavEKF3_Outputs.cpp:493`), PX4 its square (`estimator_innovation_test_ratios`) or a low-pass of it (`estimator_status`).
//! Two flights compare only within one autopilot and one kind of source.

use crate::link::frame::Frame;
use mavlink::dialects::ardupilotmega::MavMessage;
use schemars::JsonSchema;
use serde::Serialize;

const ESTIMATOR_STATUS: u32 = 230;
const EKF_STATUS_REPORT: u32 = 193;

/// Where a value comes from: PX4 low-passes the test ratios that it sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// A message of the link.
    Link,
    /// The autopilot's own log.
    Log,
}

/// What a value is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Innovation, m/s.
    VelocityNorth,
    /// Innovation, m/s.
    VelocityEast,
    /// Innovation, m/s.
    VelocityDown,
    /// Innovation, m.
    PositionNorth,
    /// Innovation, m.
    PositionEast,
    /// Innovation of the height, m.
    PositionDown,
    /// Innovation, deg.
    Heading,
    /// Test ratio.
    VelocityRatio,
    /// Test ratio of the horizontal position.
    PositionRatio,
    /// Test ratio.
    HeightRatio,
    /// Test ratio of magnetometer or heading.
    HeadingRatio,
}

impl Channel {
    /// All, innovations first.
    pub const ALL: [Self; 11] = [
        Self::VelocityNorth,
        Self::VelocityEast,
        Self::VelocityDown,
        Self::PositionNorth,
        Self::PositionEast,
        Self::PositionDown,
        Self::Heading,
        Self::VelocityRatio,
        Self::PositionRatio,
        Self::HeightRatio,
        Self::HeadingRatio,
    ];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::VelocityNorth => "velocity north",
            Self::VelocityEast => "velocity east",
            Self::VelocityDown => "velocity down",
            Self::PositionNorth => "position north",
            Self::PositionEast => "position east",
            Self::PositionDown => "height",
            Self::Heading => "heading",
            Self::VelocityRatio => "velocity test ratio",
            Self::PositionRatio => "position test ratio",
            Self::HeightRatio => "height test ratio",
            Self::HeadingRatio => "heading test ratio",
        }
    }

    /// Unit; empty for ratios.
    pub fn unit(self) -> &'static str {
        match self {
            Self::VelocityNorth | Self::VelocityEast | Self::VelocityDown => "m/s",
            Self::PositionNorth | Self::PositionEast | Self::PositionDown => "m",
            Self::Heading => "deg",
            _ => "",
        }
    }
}

/// What a frame of the autopilot says of its filter.
pub fn of_frame(frame: &Frame) -> Vec<(Channel, f64)> {
    if !matches!(frame.message_id, ESTIMATOR_STATUS | EKF_STATUS_REPORT) {
        return Vec::new();
    }
    use Channel::{HeadingRatio, HeightRatio, PositionRatio, VelocityRatio};
    let values = match frame.decode() {
        Ok(MavMessage::EKF_STATUS_REPORT(m)) => [
            (VelocityRatio, m.velocity_variance),
            (PositionRatio, m.pos_horiz_variance),
            (HeightRatio, m.pos_vert_variance),
            (HeadingRatio, m.compass_variance),
        ],
        Ok(MavMessage::ESTIMATOR_STATUS(m)) => [
            (VelocityRatio, m.vel_ratio),
            (PositionRatio, m.pos_horiz_ratio),
            (HeightRatio, m.pos_vert_ratio),
            (HeadingRatio, m.mag_ratio),
        ],
        _ => return Vec::new(),
    };
    finite(values.map(|(channel, value)| (channel, Some(f64::from(value)))))
}

/// The values that there are.
pub fn finite<const N: usize>(values: [(Channel, Option<f64>); N]) -> Vec<(Channel, f64)> {
    let kept = |(channel, value): (Channel, Option<f64>)| Some((channel, value.filter(|v| v.is_finite())?));
    values.into_iter().filter_map(kept).collect()
}
