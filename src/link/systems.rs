//! Which vehicles a link carries, and which of them is followed.
//!
//! A heartbeat alone proves little: a stray one may come from a simulator next door, a second autopilot or a bridge. What
//! proves a vehicle is inertial data. The same rule holds for the estimator and for whoever sends something to "the vehicle".

use super::frame::Frame;
use crate::sensors::{AUTOPILOT_COMPONENT, ImuSource};
use gaware_wire::heartbeat::Heartbeat;
use std::collections::BTreeMap;

/// So many inertial messages prove a vehicle.
const PROOF: u64 = 5;
/// A vehicle without inertial data gives way to one of which so many more heartbeats were received.
const HEARTBEATS_AHEAD: u64 = 2;

/// What was received of the autopilot of one system.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ReceivedMessages {
    /// Heartbeats.
    pub heartbeats: u64,
    /// Inertial messages.
    pub inertial: u64,
    /// `MAV_AUTOPILOT` of the last heartbeat.
    pub autopilot: u8,
    /// `MAV_TYPE` of the last heartbeat.
    pub mav_type: u8,
}

/// The autopilots received so far, by system id.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Systems {
    heard: BTreeMap<u8, ReceivedMessages>,
}

impl Systems {
    /// Takes a frame; true where it is the first of a system.
    pub fn record(&mut self, frame: &Frame) -> bool {
        if frame.component_id != AUTOPILOT_COMPONENT {
            return false;
        }
        let heartbeat = Heartbeat::of(frame);
        let proves = match heartbeat {
            Some(heartbeat) => heartbeat.is_of_vehicle(),
            None => ImuSource::ALL.iter().any(|s| s.message_id() == frame.message_id),
        };
        if !proves {
            return false;
        }
        let first = !self.heard.contains_key(&frame.system_id);
        let heard = self.heard.entry(frame.system_id).or_default();
        if let Some(Heartbeat { autopilot, mav_type, .. }) = heartbeat {
            heard.heartbeats += 1;
            (heard.autopilot, heard.mav_type) = (autopilot, mav_type);
        } else {
            heard.inertial += 1;
        }
        first
    }

    /// The vehicle to follow: the one that is followed as long as it sends inertial data or no one else does and its heartbeats come as often as
    /// others; otherwise the one that sends inertial data, or the one received most often.
    pub fn followed(&self, current: Option<u8>) -> Option<u8> {
        let now = current.and_then(|id| self.heard.get(&id)).copied().unwrap_or_default();
        if current.is_some() && now.inertial >= PROOF {
            return current;
        }
        let proven = self.heard.iter().filter(|(_, h)| h.heartbeats > 0 && h.inertial >= PROOF);
        if let Some((id, _)) = proven.max_by_key(|(_, h)| h.inertial) {
            return Some(*id);
        }
        let most = self.heard.iter().filter(|(_, h)| h.heartbeats > 0).max_by_key(|(_, h)| h.heartbeats);
        match (current, most) {
            (Some(_), Some((id, h))) if h.heartbeats >= now.heartbeats + HEARTBEATS_AHEAD => Some(*id),
            (None, Some((id, _))) => Some(*id),
            _ => current,
        }
    }

    /// What was received of a system.
    pub fn of(&self, system_id: u8) -> Option<&ReceivedMessages> {
        self.heard.get(&system_id)
    }

    /// Whether this system sends inertial data.
    pub fn is_proven(&self, system_id: u8) -> bool {
        self.heard.get(&system_id).is_some_and(|h| h.inertial >= PROOF)
    }

    /// How many of them are vehicles for certain: one stray heartbeat is none.
    pub fn vehicles(&self) -> usize {
        let certain = |h: &&ReceivedMessages| h.inertial >= PROOF || h.heartbeats > HEARTBEATS_AHEAD;
        self.heard.values().filter(certain).count()
    }

    /// How many were received.
    pub fn len(&self) -> usize {
        self.heard.len()
    }

    /// Whether none was.
    pub fn is_empty(&self) -> bool {
        self.heard.is_empty()
    }

    /// All of them in words: "system 1 (ArduPilot, inertial data), system 42 (PX4, no inertial data)".
    pub fn words(&self) -> String {
        let one = |(id, h): (&u8, &ReceivedMessages)| {
            let autopilot = match (h.heartbeats, h.autopilot) {
                (0, _) => "no heartbeat",
                (_, 3) => "ArduPilot",
                (_, 12) => "PX4",
                _ => "another autopilot",
            };
            let inertial = if h.inertial > 0 { "inertial data" } else { "no inertial data" };
            format!("system {id} ({autopilot}, {inertial})")
        };
        self.heard.iter().map(one).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::Sender;
    use super::*;
    use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType, RAW_IMU_DATA};

    fn heartbeat(system_id: u8, mavtype: MavType) -> Frame {
        let autopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA { autopilot, mavtype, ..Default::default() });
        Frame::encode(Sender { system_id, component_id: 1 }, 0, &message)
    }

    fn imu(system_id: u8) -> Frame {
        let message = MavMessage::RAW_IMU(RAW_IMU_DATA { time_usec: 1, ..Default::default() });
        Frame::encode(Sender { system_id, component_id: 1 }, 0, &message)
    }

    #[test]
    fn who_sends_inertial_data_is_followed_and_stays_so() {
        let mut systems = Systems::default();
        let plane = MavType::MAV_TYPE_FIXED_WING;
        assert_eq!(systems.followed(None), None);
        assert!(systems.record(&heartbeat(42, plane)));
        assert_eq!(systems.followed(None), Some(42), "nobody else is there");
        systems.record(&heartbeat(1, plane));
        assert_eq!(systems.followed(Some(42)), Some(42), "one heartbeat each");
        (0..5).for_each(|_| _ = systems.record(&imu(1)));
        assert_eq!(systems.followed(Some(42)), Some(1));
        (0..500).for_each(|_| _ = systems.record(&imu(42)));
        assert_eq!(systems.followed(Some(1)), Some(1), "no change in flight");
        assert_eq!(
            systems.words(),
            "system 1 (ArduPilot, inertial data), system 42 (ArduPilot, inertial data)"
        );
    }

    #[test]
    fn a_stray_heartbeat_gives_way_to_a_vehicle_that_is_still_to_be_asked_for_data() {
        let mut systems = Systems::default();
        systems.record(&heartbeat(42, MavType::MAV_TYPE_FIXED_WING));
        for _ in 0..3 {
            systems.record(&heartbeat(1, MavType::MAV_TYPE_QUADROTOR));
        }
        assert_eq!(systems.followed(Some(42)), Some(1));
        assert!(!systems.record(&heartbeat(255, MavType::MAV_TYPE_GCS)));
        assert_eq!(systems.of(255), None);
    }
}
