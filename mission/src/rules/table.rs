//! What a rule is: a row per command and firmware, read from the firmware's sources.
//!
//! ArduPilot: `libraries/AP_Mission/AP_Mission.cpp` of 4.7-dev (line numbers of October 2025): `sanity_check_params` (1012) refuses NaN and
//! infinity, `mavlink_int_to_mission_cmd` (1060) stores, `mission_cmd_to_mavlink_int` (1600) reads back. Earlier versions (up to
//! 4.6) refuse NaN in parameter 4 of `NAV_LOITER_UNLIM` too, so the table does. PX4:
//! `src/modules/mavlink/mavlink_mission.cpp` of 1.16, `parse_mavlink_mission_item` stores, `format_mavlink_mission_item` reads back.
//! The comparison after an upload ([`crate::compare`]) tolerates what stands here and nothing else.

use super::Firmware;
use crate::item::{Autopilot, Frame, MissionItem, MissionKind};

pub use super::rows::ROWS;

/// What becomes of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// Not kept; read back as 0.
    Dropped,
    /// As sent.
    Exact,
    /// Cut to a whole number from 0 to this.
    Whole(u16),
    /// Cut to a whole number from −128 to 127, or to one from −32768 to 32767.
    Signed(u16),
    /// Cut to whole units with its sign.
    Radius,
    /// Cut to whole metres up to 255, to tens of metres up to 2550 beyond, with its sign.
    ByteRadius,
    /// Cut to a whole number up to 255; below 1 to 256ths.
    Turns,
    /// Its sign alone: −1 or 1.
    Sign,
    /// 1 if positive, else 0.
    Flag,
    /// A direction in degrees, from 0 to 360; NaN stays.
    Heading,
}

impl Kept {
    /// The value as it is read back.
    pub fn keep(self, value: f32) -> f32 {
        let cut = |v: f32, most: f32| v.trunc().clamp(0.0, most);
        match self {
            Self::Dropped => 0.0,
            Self::Exact => value,
            // NaN is cut to 0.
            Self::Whole(most) => f32::from(value.clamp(0.0, f32::from(most)) as u16),
            Self::Signed(127) => f32::from(value as i8),
            Self::Signed(_) => f32::from(value as i16),
            Self::Radius => cut(value.abs(), 65_535.0).copysign(value),
            Self::ByteRadius if value.abs() <= 255.0 => value.trunc(),
            Self::ByteRadius => cut(value.abs() * 0.1, 255.0).copysign(value) * 10.0,
            Self::Turns if value > 0.0 && value < 1.0 => (value * 256.0).trunc() / 256.0,
            Self::Turns => cut(value, 255.0),
            Self::Sign if value < 0.0 => -1.0,
            Self::Sign => 1.0,
            Self::Flag => f32::from(u8::from(value > 0.0)),
            Self::Heading => value.rem_euclid(360.0),
        }
    }

    /// For the table of the documentation.
    pub fn describe(self) -> String {
        match self {
            Self::Dropped => "→ 0".to_owned(),
            Self::Exact => "exact".to_owned(),
            Self::Whole(most) => format!("whole, 0…{most}"),
            Self::Signed(most) => format!("whole, ±{most}"),
            Self::Radius => "whole m, signed".to_owned(),
            Self::ByteRadius => "whole m; over 255 tens of m".to_owned(),
            Self::Turns => "whole, 0…255; below 1 in 1/256".to_owned(),
            Self::Sign => "→ −1 or 1".to_owned(),
            Self::Flag => "→ 0 or 1".to_owned(),
            Self::Heading => "0…360°, NaN stays".to_owned(),
        }
    }
}

/// Which frames a command may have, and how its place is read back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frames {
    /// ArduPilot, a command with a place: every global frame, and `MISSION` as above sea level. Read back without `_INT`.
    ArduPilotPlace,
    /// ArduPilot, a command without one: any; frame and place are read back as 0.
    ArduPilotAny,
    /// ArduPilot's fence points: every global frame, read back as 0.
    ArduPilotFence,
    /// ArduPilot's rally points: every global frame, read back without `_INT`.
    ArduPilotRally,
    /// PX4, a command with a place: above sea level or home. Read back with `_INT`.
    Px4Place,
    /// PX4, a command without one: `MISSION` alone. x and y are kept as floats.
    Px4Mission,
    /// PX4, a command that may have either.
    Px4Either,
    /// PX4's fence points: as places, but the reference of the altitude is not kept.
    Px4Fence,
}

impl Frames {
    /// Whether x, y and z are a place.
    pub fn has_place(self) -> bool {
        !matches!(self, Self::ArduPilotAny | Self::Px4Mission)
    }

    /// Whether this frame is taken.
    pub fn take(self, frame: Frame) -> bool {
        match self {
            Self::ArduPilotPlace => matches!(frame.0, 0 | 2 | 3 | 5 | 6 | 10 | 11),
            Self::ArduPilotFence | Self::ArduPilotRally => matches!(frame.0, 0 | 3 | 5 | 6 | 10 | 11),
            Self::ArduPilotAny => true,
            Self::Px4Place | Self::Px4Fence => matches!(frame.0, 0 | 3 | 5 | 6),
            Self::Px4Either => matches!(frame.0, 0 | 2 | 3 | 5 | 6),
            Self::Px4Mission => frame == Frame::MISSION,
        }
    }

    /// The frame to write.
    pub fn usual(self) -> Frame {
        if self.has_place() { Frame::GLOBAL_RELATIVE_ALT } else { Frame::MISSION }
    }

    /// The frame as it is read back.
    pub fn read_back(self, frame: Frame) -> Frame {
        match self {
            Self::ArduPilotPlace if frame == Frame::MISSION => Frame::GLOBAL,
            Self::ArduPilotPlace | Self::ArduPilotRally => frame.in_files(),
            Self::ArduPilotAny | Self::ArduPilotFence => Frame::GLOBAL,
            Self::Px4Place | Self::Px4Either => frame.on_wire(),
            Self::Px4Fence => Frame::GLOBAL_INT,
            Self::Px4Mission => frame,
        }
    }

    /// For the table of the documentation.
    pub fn describe(self) -> String {
        let taken: Vec<String> = (0..12).filter(|f| self.take(Frame(*f))).map(|f| f.to_string()).collect();
        match self {
            Self::ArduPilotAny => "any → 0".to_owned(),
            Self::ArduPilotFence => format!("{} → 0", taken.join(" ")),
            Self::Px4Fence => format!("{} → 5", taken.join(" ")),
            _ => taken.join(" "),
        }
    }
}

/// What becomes of the altitude of a command with a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Altitude {
    /// As sent.
    Exact,
    /// Cut to centimetres.
    Centimetres,
    /// Cut to whole metres.
    Metres,
    /// Not kept; read back as 0.
    Dropped,
}

impl Altitude {
    fn keep(self, z_m: f32) -> f32 {
        match self {
            Self::Exact => z_m,
            Self::Centimetres => super::centimetres(z_m),
            // `int16_t`; a cast of a float cuts toward zero and saturates.
            Self::Metres => f32::from(z_m as i16),
            Self::Dropped => 0.0,
        }
    }

    /// For the table of the documentation.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Centimetres => "cm",
            Self::Metres => "whole m",
            Self::Dropped => "→ 0",
        }
    }
}

/// What becomes of `autocontinue`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AutoContinue {
    /// As sent.
    Exact,
    /// Not kept; always read back as this.
    Always(bool),
}

impl AutoContinue {
    /// The habit of an autopilot with the items of a mission.
    pub(crate) fn of(autopilot: Autopilot) -> Self {
        match autopilot {
            Autopilot::ArduPilot => Self::Always(true),
            Autopilot::Px4 => Self::Exact,
        }
    }

    /// As it is read back.
    pub fn keep(self, sent: bool) -> bool {
        match self {
            Self::Exact => sent,
            Self::Always(value) => value,
        }
    }

    /// For the table of the documentation.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Always(false) => "→ 0",
            Self::Always(true) => "→ 1",
        }
    }
}

/// The rule for a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// `MAV_CMD`.
    pub command: u16,
    /// In which of a vehicle's lists.
    pub list: MissionKind,
    /// For whom.
    pub firmware: &'static [Firmware],
    /// Whether it is taken at all.
    pub taken: bool,
    /// What becomes of parameters 1 to 4.
    pub kept: [Kept; 4],
    /// Which of them may be NaN.
    pub nan: [bool; 4],
    /// Frames.
    pub frames: Frames,
    /// Altitude.
    pub altitude: Altitude,
    /// `autocontinue`.
    pub autocontinue: AutoContinue,
    /// Where the firmware says so.
    pub source: &'static str,
    /// What else a planner must know.
    pub note: &'static str,
}

impl Row {
    /// The item as it is kept and read back.
    pub fn keep(&self, item: &MissionItem) -> MissionItem {
        let mut kept = *item;
        if self.frames != Frames::Px4Either || item.frame != Frame::MISSION {
            for (value, rule) in kept.params.iter_mut().zip(self.kept) {
                *value = rule.keep(*value);
            }
        }
        kept.frame = self.frames.read_back(item.frame);
        kept.autocontinue = self.autocontinue.keep(item.autocontinue);
        match self.frames {
            Frames::ArduPilotAny => (kept.x, kept.y, kept.z) = (0, 0, 0.0),
            // `float params[7]` of `mission_item_s`.
            _ if item.frame == Frame::MISSION && self.autocontinue == AutoContinue::Exact => {
                (kept.x, kept.y) = (item.x as f32 as i32, item.y as f32 as i32);
            }
            _ => kept.z = self.altitude.keep(item.z),
        }
        kept
    }
}

/// The row for this command and firmware, if there is one: that of its newest version.
pub fn row(number: u16, firmware: Firmware) -> Option<&'static Row> {
    ROWS.iter().find(|r| r.command == number && r.firmware.contains(&firmware))
}

/// What the versions of an autopilot's firmware may make of a command that they take.
pub fn rows_of(number: u16, autopilot: Autopilot) -> impl Iterator<Item = &'static Row> {
    let of = move |r: &&Row| r.firmware.iter().any(|f| f.autopilot() == autopilot);
    ROWS.iter().filter(move |r| r.command == number && r.taken).filter(of)
}
