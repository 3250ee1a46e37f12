//! Who we are on the link: an onboard computer of the vehicle.

use super::frame::{Frame, FrameError, Sender};
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType,
};

/// `MAV_COMP_ID_ONBOARD_COMPUTER`.
pub const COMPONENT: u8 = 191;
const PERIOD_US: u64 = 1_000_000;

/// The heartbeat of a companion. `healthy` is whether the estimator runs.
pub fn heartbeat(healthy: bool) -> MavMessage {
    of_kind(MavType::MAV_TYPE_ONBOARD_CONTROLLER, healthy)
}

fn of_kind(mavtype: MavType, healthy: bool) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: if healthy { MavState::MAV_STATE_ACTIVE } else { MavState::MAV_STATE_STANDBY },
        mavlink_version: 3,
    })
}

/// Numbers our frames, and knows when the next heartbeat is due.
#[derive(Debug, Clone)]
pub struct HeartbeatSource {
    sender: Sender,
    sequence: u8,
    next_us: Option<u64>,
    kind: MavType,
}

impl HeartbeatSource {
    /// A companion of no vehicle yet: system 1 until one is known.
    pub fn new() -> Self {
        let sender = Sender { system_id: 1, component_id: COMPONENT };
        Self { sender, sequence: 0, next_us: None, kind: MavType::MAV_TYPE_ONBOARD_CONTROLLER }
    }

    /// One that is gone in a few seconds, as a short command is: it opens the link and nobody misses it. PX4 tells the pilot that the
    /// connection to the mission computer is lost when the heartbeats of an onboard controller end, and acts on those of a ground station
    /// (`handle_message_heartbeat` in `mavlink_receiver.cpp`); of a generic type it takes no notice.
    pub fn passing() -> Self {
        Self { kind: MavType::MAV_TYPE_GENERIC, ..Self::new() }
    }

    /// Takes the vehicle's system id.
    pub fn belongs_to(&mut self, system_id: u8) {
        self.sender.system_id = system_id;
    }

    /// Who we are.
    pub fn sender(&self) -> Sender {
        self.sender
    }

    /// The next frame with this message.
    pub fn say(&mut self, message: &MavMessage) -> Frame {
        let frame = Frame::encode(self.sender, self.sequence, message);
        self.sequence = self.sequence.wrapping_add(1);
        frame
    }

    /// The next frame with this payload.
    ///
    /// # Errors
    /// As [`Frame::of_payload`].
    pub fn say_payload(&mut self, message_id: u32, payload: &[u8]) -> Result<Frame, FrameError> {
        let frame = Frame::of_payload(self.sender, self.sequence, message_id, payload)?;
        self.sequence = self.sequence.wrapping_add(1);
        Ok(frame)
    }

    /// A heartbeat when one is due, once a second.
    pub fn poll(&mut self, now_us: u64, healthy: bool) -> Option<Frame> {
        if self.next_us.is_some_and(|t| now_us < t) {
            return None;
        }
        self.next_us = Some(now_us + PERIOD_US);
        Some(self.say(&of_kind(self.kind, healthy)))
    }
}

impl Default for HeartbeatSource {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_heartbeat_a_second_with_running_numbers() {
        let mut voice = HeartbeatSource::new();
        voice.belongs_to(7);
        let frames: Vec<_> = (0..50).filter_map(|k| voice.poll(k * 100_000, true)).collect();
        assert_eq!(frames.len(), 5);
        assert_eq!(frames.iter().map(|f| f.sequence).collect::<Vec<_>>(), vec![0, 1, 2, 3, 4]);
        assert!(frames.iter().all(|f| (f.system_id, f.component_id) == (7, 191)));
        let MavMessage::HEARTBEAT(m) = frames[0].decode().unwrap() else { panic!("no heartbeat") };
        assert_eq!((m.mavtype as u32, m.autopilot as u32), (18, 8));
    }

    #[test]
    fn nobody_misses_a_short_command() {
        let frame = HeartbeatSource::passing().poll(0, true).unwrap();
        let MavMessage::HEARTBEAT(m) = frame.decode().unwrap() else { panic!("no heartbeat") };
        assert_eq!((m.mavtype as u32, m.autopilot as u32), (0, 8));
    }
}
