//! What a heartbeat says about the vehicle that a mission is meant for.

use crate::engine::situation::FlightMode;
use crate::link::frame::Frame;
use crate::sensors::{AUTOPILOT_COMPONENT, modes};
use gaware_mission::identity::{Carrier, Identity, Uid};
use gaware_mission::item::Autopilot;
use gaware_mission::transfer::Address;
use gaware_mission::transfer::verified::VehicleState;
use gaware_wire::heartbeat::{ARDUPILOT, GENERIC, Heartbeat, PX4};

/// `MAV_STATE_ACTIVE`; CRITICAL and EMERGENCY come after it.
const ACTIVE: u8 = 4;

/// A vehicle as its last heartbeat reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vehicle {
    /// Where missions are sent.
    pub address: Address,
    /// `MAV_TYPE`.
    pub mav_type: u8,
    /// Its habits.
    pub autopilot: Autopilot,
    /// Whether it may be changed.
    pub state: VehicleState,
    /// Its hardware, where it has been asked and gives an id.
    pub uid: Option<Uid>,
}

impl Vehicle {
    /// Before any heartbeat: addresses no one.
    #[cfg(not(target_family = "wasm"))]
    pub(crate) const UNKNOWN: Self = Self {
        address: Address { system: 0, component: 0 },
        mav_type: 0,
        autopilot: Autopilot::ArduPilot,
        state: VehicleState { armed: true, mission_mode: true, flying_mission: true, in_flight: true },
        uid: None,
    };

    /// Whether this autopilot sent a frame.
    pub fn sent(&self, frame: &Frame) -> bool {
        self.address == Address { system: frame.system_id, component: frame.component_id }
    }

    /// From a heartbeat of an autopilot that flies missions; other frames say nothing.
    pub fn from_heartbeat(frame: &Frame) -> Option<Self> {
        if frame.component_id != AUTOPILOT_COMPONENT {
            return None;
        }
        let heartbeat = Heartbeat::of(frame).filter(Heartbeat::is_of_vehicle)?;
        let firmware = heartbeat.autopilot;
        let autopilot = match firmware {
            ARDUPILOT => Autopilot::ArduPilot,
            // A generic one speaks the mission protocol as MAVLink describes it, as PX4 does.
            PX4 | GENERIC => Autopilot::Px4,
            _ => return None,
        };
        let mission_mode = modes::of_heartbeat(&heartbeat).0 == FlightMode::Mission;
        let armed = heartbeat.is_armed();
        Some(Self {
            address: Address { system: frame.system_id, component: frame.component_id },
            mav_type: heartbeat.mav_type,
            autopilot,
            state: VehicleState {
                armed,
                mission_mode,
                flying_mission: armed && mission_mode,
                in_flight: firmware == PX4 && armed && heartbeat.status >= ACTIVE,
            },
            uid: None,
        })
    }
}

impl Vehicle {
    /// Whether wings carry it (`MAV_TYPE_FIXED_WING`); `None` for types that are neither plane nor multirotor.
    pub fn is_fixed_wing(&self) -> Option<bool> {
        Carrier::of(self.mav_type)?.is_fixed_wing()
    }

    /// Who it is.
    pub fn identity(&self) -> Identity {
        let Self { address, mav_type, autopilot, uid, .. } = *self;
        let (system_id, component_id) = (address.system, address.component);
        Identity { uid, autopilot, mav_type, system_id, component_id, home: None }
    }

    /// Its type in words.
    pub fn type_words(&self) -> String {
        type_words(self.mav_type)
    }
}

impl std::fmt::Display for Vehicle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&identity_words(&self.identity()))
    }
}

/// "system 1 (ArduPilot, quadrotor), hardware id 0a1b…".
pub fn identity_words(who: &Identity) -> String {
    let kind = match who.mav_type {
        0 => String::new(),
        mav_type => format!(", {}", type_words(mav_type)),
    };
    let uid = who.uid.map_or_else(String::new, |uid| format!(", hardware id {uid}"));
    format!("system {} ({}{kind}){uid}", who.system_id, who.autopilot)
}

/// `MAV_TYPE` in words.
pub fn type_words(mav_type: u8) -> String {
    let words = match mav_type {
        1 => "fixed wing",
        2 => "quadrotor",
        3 => "coaxial helicopter",
        4 => "helicopter",
        10 => "rover",
        12 => "submarine",
        13 => "hexarotor",
        14 => "octorotor",
        15 => "tricopter",
        19..=25 => "VTOL",
        n => return format!("type {n}"),
    };
    words.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::frame::Sender;
    use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavType};

    fn vehicle(kind: MavType, autopilot: MavAutopilot, custom_mode: u32, armed: bool) -> Option<Vehicle> {
        let base_mode = if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        let data = HEARTBEAT_DATA { custom_mode, mavtype: kind, autopilot, base_mode, ..Default::default() };
        let sender = Sender { system_id: 9, component_id: 1 };
        Vehicle::from_heartbeat(&Frame::encode(sender, 0, &MavMessage::HEARTBEAT(data)))
    }

    #[test]
    fn the_mission_mode_is_known_by_type_and_firmware() {
        use MavAutopilot::*;
        use MavType::*;
        let px4_mission = 4 << 16 | 4 << 24;
        for (kind, firmware, mode, expected) in [
            (MAV_TYPE_FIXED_WING, MAV_AUTOPILOT_ARDUPILOTMEGA, 10, true),
            (MAV_TYPE_FIXED_WING, MAV_AUTOPILOT_ARDUPILOTMEGA, 3, false),
            (MAV_TYPE_QUADROTOR, MAV_AUTOPILOT_ARDUPILOTMEGA, 3, true),
            (MAV_TYPE_QUADROTOR, MAV_AUTOPILOT_PX4, px4_mission, true),
            (MAV_TYPE_QUADROTOR, MAV_AUTOPILOT_PX4, 3, false),
        ] {
            let seen = vehicle(kind, firmware, mode, true).unwrap();
            assert_eq!((seen.state.mission_mode, seen.state.armed), (expected, true), "{kind:?} {mode}");
            assert_eq!(seen.address.system, 9);
        }
        assert!(!vehicle(MAV_TYPE_QUADROTOR, MAV_AUTOPILOT_PX4, px4_mission, false).unwrap().state.armed);
    }

    #[test]
    fn an_autopilot_of_no_known_make_may_fly_a_mission_when_it_says_auto() {
        let heard = |base_mode| {
            let data = HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_FIXED_WING,
                autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC,
                base_mode,
                ..Default::default()
            };
            let sender = Sender { system_id: 9, component_id: 1 };
            Vehicle::from_heartbeat(&Frame::encode(sender, 0, &MavMessage::HEARTBEAT(data))).unwrap()
        };
        let armed = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        assert_eq!(heard(armed).autopilot, Autopilot::Px4);
        assert!(!heard(armed).state.flying_mission);
        assert!(heard(armed | MavModeFlag::MAV_MODE_FLAG_AUTO_ENABLED).state.flying_mission);
    }

    #[test]
    fn a_gimbal_is_no_vehicle() {
        assert_eq!(vehicle(MavType::MAV_TYPE_GIMBAL, MavAutopilot::MAV_AUTOPILOT_INVALID, 0, false), None);
    }

    /// The converter feeds the engine: what it follows is what is on the screen.
    #[test]
    fn whom_the_engine_does_not_follow_gets_no_mission() {
        use crate::sensors::{Converter, ConverterOptions};
        use MavAutopilot::*;
        use MavType::*;
        for kind in [
            MAV_TYPE_GENERIC,
            MAV_TYPE_FIXED_WING,
            MAV_TYPE_QUADROTOR,
            MAV_TYPE_GCS,
            MAV_TYPE_ONBOARD_CONTROLLER,
            MAV_TYPE_GIMBAL,
        ] {
            for firmware in
                [MAV_AUTOPILOT_GENERIC, MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_AUTOPILOT_PX4, MAV_AUTOPILOT_INVALID]
            {
                for component_id in [1, 190, 191] {
                    let data =
                        HEARTBEAT_DATA { mavtype: kind, autopilot: firmware, ..HEARTBEAT_DATA::default() };
                    let sender = Sender { system_id: 255, component_id };
                    let frame = Frame::encode(sender, 0, &MavMessage::HEARTBEAT(data));
                    let mut converter = Converter::new(ConverterOptions::default());
                    converter.feed(0, &frame, &mut Vec::new());
                    let chosen = Vehicle::from_heartbeat(&frame).map(|v| v.address.system);
                    assert_eq!(chosen, converter.vehicle(), "{kind:?} {firmware:?} {component_id}");
                }
            }
        }
    }

    #[test]
    fn px4_in_the_air_is_told_from_px4_on_the_bench() {
        use mavlink::dialects::ardupilotmega::MavState;
        let loiter = 4 << 16 | 3 << 24;
        for (armed, status, in_flight) in [
            (true, MavState::MAV_STATE_ACTIVE, true),
            (true, MavState::MAV_STATE_CRITICAL, true),
            (false, MavState::MAV_STATE_STANDBY, false),
        ] {
            let mut base_mode = MavModeFlag::empty();
            base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, armed);
            let data = HEARTBEAT_DATA {
                custom_mode: loiter,
                mavtype: MavType::MAV_TYPE_QUADROTOR,
                autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
                base_mode,
                system_status: status,
                ..Default::default()
            };
            let sender = Sender { system_id: 9, component_id: 1 };
            let seen =
                Vehicle::from_heartbeat(&Frame::encode(sender, 0, &MavMessage::HEARTBEAT(data))).unwrap();
            assert_eq!((seen.state.in_flight, seen.state.objection().is_some()), (in_flight, in_flight));
        }
    }
}
