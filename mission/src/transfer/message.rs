//! The messages of the mission protocol, apart from any MAVLink library.

use super::events::ARGUMENTS;
use crate::item::MissionItem;

/// System and component id.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Address {
    /// System id; 0 is everyone.
    pub system: u8,
    /// Component id; 0 is every component.
    pub component: u8,
}

/// A message with its sender and addressee.
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope {
    /// System and component id of the frame.
    pub from: Address,
    /// `target_system` and `target_component`; zeros where the message has none.
    pub to: Address,
    /// The message.
    pub message: MissionMessage,
}

/// `MAV_MISSION_RESULT`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct MissionResult(pub u8);

impl MissionResult {
    /// Done.
    pub const ACCEPTED: Self = Self(0);
    /// Failed without a reason.
    pub const ERROR: Self = Self(1);
    /// The frame is not supported.
    pub const UNSUPPORTED_FRAME: Self = Self(2);
    /// The command is not supported.
    pub const UNSUPPORTED: Self = Self(3);
    /// Too many items.
    pub const NO_SPACE: Self = Self(4);
    /// A parameter is invalid.
    pub const INVALID: Self = Self(5);
    /// Parameter 1 is invalid; 7 to 12 are parameters 2 to 7.
    pub const INVALID_PARAM1: Self = Self(6);
    /// An item out of turn; the transfer goes on.
    pub const INVALID_SEQUENCE: Self = Self(13);
    /// Not now, or not from here.
    pub const DENIED: Self = Self(14);
    /// The transfer was given up.
    pub const OPERATION_CANCELLED: Self = Self(15);

    /// In words.
    pub fn describe(self) -> String {
        match self.0 {
            0 => "accepted".into(),
            1 => "general error".into(),
            2 => "an item has a coordinate frame that it does not support".into(),
            3 => "an item has a command that it does not support".into(),
            4 => "the mission has more items than it can store".into(),
            5 => "an item has an invalid parameter".into(),
            n @ 6..=12 => format!("an item has an invalid parameter {}", n - 5),
            13 => "an item came out of turn".into(),
            14 => "denied; another station may be transferring a mission, or its mode forbids it".into(),
            15 => "it cancelled the transfer".into(),
            n => format!("result {n}"),
        }
    }

    /// Whether the mission itself is refused, so that trying again is of no use.
    pub fn is_final(self) -> bool {
        matches!(self.0, 2..=12)
    }
}

/// A message of the mission protocol; fields as in MAVLink.
#[derive(Debug, Clone, PartialEq)]
pub enum MissionMessage {
    /// `MISSION_REQUEST_LIST` (43): how many items?
    RequestList {
        /// Kind of mission.
        mission_type: u8,
    },
    /// `MISSION_COUNT` (44).
    Count {
        /// Items that follow, home included where the autopilot has it.
        count: u16,
        /// Kind of mission.
        mission_type: u8,
        /// PX4's checksum of the mission on board; 0 where unknown.
        opaque_id: u32,
    },
    /// `MISSION_REQUEST_INT` (51).
    RequestInt {
        /// Item wanted.
        seq: u16,
        /// Kind of mission.
        mission_type: u8,
    },
    /// `MISSION_REQUEST` (40), which ArduPilot still sends; answered with `ItemInt` all the same.
    Request {
        /// Item wanted.
        seq: u16,
        /// Kind of mission.
        mission_type: u8,
    },
    /// `MISSION_ITEM_INT` (73).
    ItemInt {
        /// Its number.
        seq: u16,
        /// Whether it is being flown.
        current: bool,
        /// The item.
        item: MissionItem,
        /// Kind of mission.
        mission_type: u8,
    },
    /// `MISSION_ACK` (47).
    Ack {
        /// Result.
        result: MissionResult,
        /// Kind of mission.
        mission_type: u8,
        /// PX4's checksum of the mission on board; 0 where unknown.
        opaque_id: u32,
    },
    /// `MISSION_CLEAR_ALL` (45).
    ClearAll {
        /// Kind of mission.
        mission_type: u8,
    },
    /// `MISSION_SET_CURRENT` (41).
    SetCurrent {
        /// Item to go on with; 0 is the first one on both autopilots, although ArduPilot has home there.
        seq: u16,
    },
    /// `MISSION_CURRENT` (42).
    Current {
        /// Item being flown.
        seq: u16,
        /// Items on board, home not counted; 0xFFFF where there are none, 0 where the vehicle does not say.
        total: u16,
        /// `MISSION_STATE`; 3 is active, 0 unknown.
        state: u8,
        /// PX4's checksum of the mission on board; 0 where unknown.
        mission_id: u32,
    },
    /// `EVENT` (410), by which PX4 says what it thinks of a mission.
    Event {
        /// Its id; the low 24 bits name it, see [`super::events`].
        id: u32,
        /// Its arguments.
        arguments: [u8; ARGUMENTS],
    },
}

impl MissionMessage {
    /// The kind of mission it is about, where it says so.
    pub fn mission_type(&self) -> Option<u8> {
        match self {
            Self::RequestList { mission_type }
            | Self::Count { mission_type, .. }
            | Self::RequestInt { mission_type, .. }
            | Self::Request { mission_type, .. }
            | Self::ItemInt { mission_type, .. }
            | Self::Ack { mission_type, .. }
            | Self::ClearAll { mission_type } => Some(*mission_type),
            Self::SetCurrent { .. } | Self::Current { .. } | Self::Event { .. } => None,
        }
    }
}
