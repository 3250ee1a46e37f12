//! `HEARTBEAT` by its numbers (MAVLink `common.xml`). The dialect's own type has no value for a kind of vehicle, an autopilot or a state that came after it.

use crate::frame::Frame;

/// Id of the message.
pub const ID: u32 = 0;
/// `MAV_AUTOPILOT_GENERIC`.
pub const GENERIC: u8 = 0;
/// `MAV_AUTOPILOT_ARDUPILOTMEGA`.
pub const ARDUPILOT: u8 = 3;
/// `MAV_AUTOPILOT_INVALID`: no autopilot.
const NO_AUTOPILOT: u8 = 8;
/// `MAV_AUTOPILOT_PX4`.
pub const PX4: u8 = 12;
/// `MAV_TYPE_GCS`, `MAV_TYPE_ONBOARD_CONTROLLER` and `MAV_TYPE_GIMBAL`: no vehicles, whatever autopilot they name.
const NO_VEHICLES: [u8; 3] = [6, 18, 26];
/// `MAV_MODE_FLAG_SAFETY_ARMED`.
const ARMED: u8 = 128;

/// `MAV_STATE_CRITICAL`, `MAV_STATE_EMERGENCY` (a failsafe on both firmwares), `MAV_STATE_FLIGHT_TERMINATION`.
const FAILSAFE: [u8; 3] = [5, 6, 8];

/// What a heartbeat says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Heartbeat {
    /// Flight mode, by the autopilot's own numbers.
    pub custom_mode: u32,
    /// `MAV_TYPE`.
    pub mav_type: u8,
    /// `MAV_AUTOPILOT`.
    pub autopilot: u8,
    /// `MAV_MODE_FLAG`.
    pub base_mode: u8,
    /// `MAV_STATE`.
    pub status: u8,
}

impl Heartbeat {
    /// Of a frame; nothing for other messages.
    pub fn of(frame: &Frame) -> Option<Self> {
        // MAVLink 2 leaves zeros at the end out.
        let at = |k: usize| frame.payload().get(k).copied().unwrap_or(0);
        (frame.message_id == ID).then(|| Self {
            custom_mode: u32::from_le_bytes([at(0), at(1), at(2), at(3)]),
            mav_type: at(4),
            autopilot: at(5),
            base_mode: at(6),
            status: at(7),
        })
    }

    /// Whether a vehicle sends it: no ground station, companion or gimbal.
    pub fn is_of_vehicle(&self) -> bool {
        self.autopilot != NO_AUTOPILOT && !NO_VEHICLES.contains(&self.mav_type)
    }

    /// Whether the autopilot acts on a failure.
    pub fn is_failsafe(&self) -> bool {
        FAILSAFE.contains(&self.status)
    }

    /// Whether motors may turn.
    pub fn is_armed(&self) -> bool {
        self.base_mode & ARMED != 0
    }
}
