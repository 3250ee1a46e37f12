//! A vehicle that keeps to the mission protocol as PX4 does: a mission replaces the one before only when it is whole.

use gaware::link::frame::{Frame, Sender};
use gaware::link::heartbeat::heartbeat;
use gaware::mission_link::codec;
use gaware_mission::item::MissionItem;
use gaware_mission::transfer::{Address, Envelope, MissionMessage, MissionResult};
use std::collections::{BTreeMap, VecDeque};
use std::sync::LazyLock;

/// Where it is.
pub const VEHICLE: Address = Address { system: 1, component: 1 };
/// Where the program is.
pub const ME: Address = Address { system: 1, component: 191 };
/// `MAV_TYPE_FIXED_WING` and `MAV_AUTOPILOT_PX4` in a heartbeat.
const TYPE_AND_AUTOPILOT: [u8; 2] = [1, 12];

/// A link keeps messages for so long, s; those that are later are lost. The protocol cannot tell an answer from one to an earlier question, so that
/// no transfer can be right over a link that keeps messages for longer than the program waits.
const LATEST_S: f64 = 2.0;

/// The vehicle.
#[derive(Debug, Clone, Default)]
pub struct HonestVehicle {
    /// What it has, by kind of list.
    pub stored: BTreeMap<u8, Vec<MissionItem>>,
    /// What it is receiving: kind, number of items, items so far.
    receiving: Option<(u8, usize, Vec<MissionItem>)>,
    /// What it has said and no one has received yet, with the time, s.
    said: VecDeque<(f64, MissionMessage)>,
    now_s: f64,
}

impl HonestVehicle {
    /// With a mission on board.
    pub fn new(mission: Vec<MissionItem>) -> Self {
        Self { stored: BTreeMap::from([(0, mission)]), ..Self::default() }
    }

    /// What it has said and is still on its way, with the next one taken from it.
    pub fn next_message(&mut self, now_s: f64) -> Option<MissionMessage> {
        while let Some((said_s, message)) = self.said.pop_front() {
            if now_s - said_s <= LATEST_S {
                return Some(message);
            }
        }
        None
    }

    /// Whether nothing is on its way.
    pub fn is_silent(&self) -> bool {
        self.said.is_empty()
    }

    /// The next message comes behind the others; `again` as well as where it is.
    pub fn delay(&mut self, again: bool) {
        let first = if again { self.said.front().cloned() } else { self.said.pop_front() };
        self.said.extend(first);
    }

    /// Takes a message of the program.
    pub fn receive(&mut self, now_s: f64, message: &MissionMessage) {
        self.now_s = now_s;
        match *message {
            MissionMessage::RequestList { mission_type } => {
                let count = self.stored.get(&mission_type).map_or(0, Vec::len) as u16;
                self.say(MissionMessage::Count { count, mission_type, opaque_id: 0 });
            }
            MissionMessage::RequestInt { seq, mission_type }
            | MissionMessage::Request { seq, mission_type } => {
                let item = self.stored.get(&mission_type).and_then(|s| s.get(usize::from(seq))).copied();
                self.say(match item {
                    Some(item) => MissionMessage::ItemInt { seq, current: false, item, mission_type },
                    None => ack(MissionResult::INVALID_SEQUENCE, mission_type),
                });
            }
            MissionMessage::Count { count: 0, mission_type, .. }
            | MissionMessage::ClearAll { mission_type } => {
                self.receiving = None;
                self.stored.insert(mission_type, Vec::new());
                self.say(ack(MissionResult::ACCEPTED, mission_type));
            }
            MissionMessage::Count { count, mission_type, .. } => {
                self.receiving = Some((mission_type, usize::from(count), Vec::new()));
                self.say(MissionMessage::RequestInt { seq: 0, mission_type });
            }
            MissionMessage::ItemInt { seq, item, mission_type, .. } => self.take(seq, item, mission_type),
            MissionMessage::SetCurrent { seq } => {
                self.say(MissionMessage::Current { seq, total: 0, state: 0, mission_id: 0 });
            }
            MissionMessage::Ack { .. } | MissionMessage::Current { .. } | MissionMessage::Event { .. } => {}
        }
    }

    fn say(&mut self, message: MissionMessage) {
        self.said.push_back((self.now_s, message));
    }

    fn take(&mut self, seq: u16, item: MissionItem, mission_type: u8) {
        let Some((kind, count, items)) = self.receiving.as_mut().filter(|r| r.0 == mission_type) else {
            // The last acknowledgement may have been lost.
            let last = self.stored.get(&mission_type).is_some_and(|s| s.len() == usize::from(seq) + 1);
            if last {
                self.say(ack(MissionResult::ACCEPTED, mission_type));
            }
            return;
        };
        if usize::from(seq) == items.len() {
            items.push(item);
        }
        if items.len() < *count {
            let seq = items.len() as u16;
            self.say(MissionMessage::RequestInt { seq, mission_type });
        } else {
            self.stored.insert(*kind, std::mem::take(items));
            self.receiving = None;
            self.say(ack(MissionResult::ACCEPTED, mission_type));
        }
    }
}

fn ack(result: MissionResult, mission_type: u8) -> MissionMessage {
    MissionMessage::Ack { result, mission_type, opaque_id: 0 }
}

/// A message of the vehicle to the program.
pub fn envelope(message: MissionMessage) -> Envelope {
    Envelope { from: VEHICLE, to: ME, message }
}

/// The same as a frame.
pub fn frame(message: &MissionMessage) -> Option<Frame> {
    let (id, payload) = codec::encode(ME, message);
    Frame::of_payload(Sender { system_id: VEHICLE.system, component_id: VEHICLE.component }, 0, id, &payload)
        .ok()
}

/// Its heartbeat: a fixed wing with PX4, disarmed.
pub fn heartbeat_frame() -> Option<Frame> {
    static HEARTBEAT: LazyLock<Option<Frame>> = LazyLock::new(make_heartbeat);
    HEARTBEAT.clone()
}

fn make_heartbeat() -> Option<Frame> {
    let from = Sender { system_id: VEHICLE.system, component_id: VEHICLE.component };
    let ours = Frame::encode(from, 0, &heartbeat(true));
    let mut payload = ours.payload().to_vec();
    payload.resize(9, 0);
    payload.get_mut(4..6)?.copy_from_slice(&TYPE_AND_AUTOPILOT);
    // Mode and state: disarmed, standing by.
    payload.get_mut(6..8)?.copy_from_slice(&[0, 3]);
    Frame::of_payload(from, 0, ours.message_id, &payload).ok()
}

/// One frame of every message of the protocol, and a heartbeat.
pub fn honest_frames() -> Vec<Frame> {
    let item = MissionItem::action(178, [0.0, 16.0, -1.0, 0.0]);
    let messages = [
        MissionMessage::RequestList { mission_type: 0 },
        MissionMessage::Count { count: 3, mission_type: 0, opaque_id: 7 },
        MissionMessage::RequestInt { seq: 1, mission_type: 0 },
        MissionMessage::Request { seq: 2, mission_type: 1 },
        MissionMessage::ItemInt { seq: 0, current: true, item, mission_type: 0 },
        MissionMessage::Ack { result: MissionResult::DENIED, mission_type: 0, opaque_id: 7 },
        MissionMessage::ClearAll { mission_type: 2 },
        MissionMessage::Current { seq: 1, total: 3, state: 3, mission_id: 7 },
        MissionMessage::Event { id: 0x0181_1691, arguments: [1; 40] },
    ];
    messages.iter().filter_map(frame).chain(heartbeat_frame()).collect()
}
