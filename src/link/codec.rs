//! Mission messages as MAVLink payloads and back.
//!
//! The payloads are read and written by their published layout rather than through the dialect's types, whose
//! enumerations refuse commands that they do not list: a backup must hold, and put back, items that this program has
//! does not know.

use crate::link::frame::Frame;
use gaware_mission::item::{self, MissionItem};
use gaware_mission::transfer::{Address, Envelope, MissionMessage, MissionResult};

const ITEM: u32 = 39;
const REQUEST: u32 = 40;
const SET_CURRENT: u32 = 41;
const CURRENT: u32 = 42;
const REQUEST_LIST: u32 = 43;
const COUNT: u32 = 44;
const CLEAR_ALL: u32 = 45;
const ACK: u32 = 47;
const REQUEST_INT: u32 = 51;
const ITEM_INT: u32 = 73;
const EVENT: u32 = 410;
/// Longest payload here.
const LONGEST: usize = 53;

/// The mission message in a frame, if it is one that the transfer knows.
pub fn decode(frame: &Frame) -> Option<Envelope> {
    let from = Address { system: frame.system_id, component: frame.component_id };
    let mut b = Reader::new(frame.payload());
    let (to, message) = match frame.message_id {
        REQUEST_LIST => {
            let to = b.address();
            (to, MissionMessage::RequestList { mission_type: b.u8() })
        }
        COUNT => {
            let (count, to, mission_type) = (b.u16(), b.address(), b.u8());
            (to, MissionMessage::Count { count, mission_type, opaque_id: b.u32() })
        }
        REQUEST_INT => {
            let (seq, to) = (b.u16(), b.address());
            (to, MissionMessage::RequestInt { seq, mission_type: b.u8() })
        }
        REQUEST => {
            let (seq, to) = (b.u16(), b.address());
            (to, MissionMessage::Request { seq, mission_type: b.u8() })
        }
        ITEM | ITEM_INT => item(&mut b, frame.message_id == ITEM),
        ACK => {
            let (to, result, mission_type) = (b.address(), MissionResult(b.u8()), b.u8());
            (to, MissionMessage::Ack { result, mission_type, opaque_id: b.u32() })
        }
        CLEAR_ALL => {
            let to = b.address();
            (to, MissionMessage::ClearAll { mission_type: b.u8() })
        }
        SET_CURRENT => {
            let seq = b.u16();
            (b.address(), MissionMessage::SetCurrent { seq })
        }
        CURRENT => {
            let (seq, total, state, _mode) = (b.u16(), b.u16(), b.u8(), b.u8());
            let everyone = Address { system: 0, component: 0 };
            (everyone, MissionMessage::Current { seq, total, state, mission_id: b.u32() })
        }
        EVENT => {
            let (id, _boot_ms, _sequence) = (b.u32(), b.u32(), b.u16());
            let (component, system, _levels) = (b.u8(), b.u8(), b.u8());
            let arguments = std::array::from_fn(|_| b.u8());
            (Address { system, component }, MissionMessage::Event { id, arguments })
        }
        _ => return None,
    };
    Some(Envelope { from, to, message })
}

/// `MISSION_ITEM_INT`, and the older `MISSION_ITEM` whose places are floats in degrees.
fn item(b: &mut Reader, floats: bool) -> (Address, MissionMessage) {
    let params = [b.f32(), b.f32(), b.f32(), b.f32()];
    let (x, y) = (b.u32(), b.u32());
    let (z, seq, command, to) = (b.f32(), b.u16(), b.u16(), b.address());
    let (frame, current, autocontinue) = (item::Frame(b.u8()), b.u8() != 0, b.u8() != 0);
    let [x, y] = [x, y].map(|bits| match floats {
        false => bits.cast_signed(),
        true if frame.is_global() => (f64::from(f32::from_bits(bits)) * 1e7).round() as i32,
        true => f32::from_bits(bits) as i32,
    });
    let item = MissionItem { command, frame, autocontinue, params, x, y, z };
    (to, MissionMessage::ItemInt { seq, current, item, mission_type: b.u8() })
}

/// Message id and payload of a message to the vehicle.
pub fn encode(to: Address, message: &MissionMessage) -> (u32, Vec<u8>) {
    let mut b = Vec::with_capacity(LONGEST);
    let address = [to.system, to.component];
    let id = match message {
        MissionMessage::RequestList { mission_type } => {
            b.extend([to.system, to.component, *mission_type]);
            REQUEST_LIST
        }
        MissionMessage::Count { count, mission_type, opaque_id } => {
            b.extend(count.to_le_bytes());
            b.extend([to.system, to.component, *mission_type]);
            b.extend(opaque_id.to_le_bytes());
            COUNT
        }
        MissionMessage::RequestInt { seq, mission_type } | MissionMessage::Request { seq, mission_type } => {
            b.extend(seq.to_le_bytes());
            b.extend([to.system, to.component, *mission_type]);
            if matches!(message, MissionMessage::Request { .. }) { REQUEST } else { REQUEST_INT }
        }
        MissionMessage::ItemInt { seq, current, item, mission_type } => {
            item.params.iter().for_each(|p| b.extend(p.to_le_bytes()));
            b.extend(item.x.to_le_bytes());
            b.extend(item.y.to_le_bytes());
            b.extend(item.z.to_le_bytes());
            b.extend(seq.to_le_bytes());
            b.extend(item.command.to_le_bytes());
            b.extend(address);
            b.extend([item.frame.0, u8::from(*current), u8::from(item.autocontinue), *mission_type]);
            ITEM_INT
        }
        MissionMessage::Ack { result, mission_type, opaque_id } => {
            b.extend([to.system, to.component, result.0, *mission_type]);
            b.extend(opaque_id.to_le_bytes());
            ACK
        }
        MissionMessage::ClearAll { mission_type } => {
            b.extend([to.system, to.component, *mission_type]);
            CLEAR_ALL
        }
        MissionMessage::SetCurrent { seq } => {
            b.extend(seq.to_le_bytes());
            b.extend(address);
            SET_CURRENT
        }
        MissionMessage::Current { seq, total, state, mission_id } => {
            b.extend(seq.to_le_bytes());
            b.extend(total.to_le_bytes());
            b.extend([*state, 0]);
            b.extend(mission_id.to_le_bytes());
            CURRENT
        }
        MissionMessage::Event { id, arguments } => {
            b.extend(id.to_le_bytes());
            // Time, sequence number and levels, which this program does not use.
            b.extend([0; 6]);
            b.extend([to.component, to.system, 0]);
            b.extend(arguments);
            EVENT
        }
    };
    (id, b)
}

/// Little-endian fields in order; beyond the end there are zeros, which MAVLink 2 does not send.
pub(super) struct Reader<'a>(std::slice::Iter<'a, u8>);

impl<'a> Reader<'a> {
    pub(super) fn new(payload: &'a [u8]) -> Self {
        Self(payload.iter())
    }

    pub(super) fn u8(&mut self) -> u8 {
        self.0.next().copied().unwrap_or(0)
    }

    pub(super) fn u16(&mut self) -> u16 {
        u16::from_le_bytes([self.u8(), self.u8()])
    }

    pub(super) fn u32(&mut self) -> u32 {
        u32::from_le_bytes([self.u8(), self.u8(), self.u8(), self.u8()])
    }

    pub(super) fn f32(&mut self) -> f32 {
        f32::from_bits(self.u32())
    }

    fn address(&mut self) -> Address {
        Address { system: self.u8(), component: self.u8() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::frame::Sender;
    use mavlink::dialects::ardupilotmega::MavMessage;
    use proptest::prelude::*;

    const ME: Sender = Sender { system_id: 1, component_id: 191 };
    const VEHICLE: Address = Address { system: 1, component: 1 };

    fn framed(message: &MissionMessage) -> Frame {
        let (id, payload) = encode(VEHICLE, message);
        Frame::of_payload(ME, 7, id, &payload).unwrap()
    }

    #[test]
    fn the_dialect_reads_what_is_written() {
        let item = MissionItem {
            command: 16,
            frame: item::Frame::GLOBAL_RELATIVE_ALT_INT,
            autocontinue: true,
            params: [1.0, 2.0, 3.0, 4.0],
            x: 473_977_418,
            y: -85_455_938,
            z: 55.5,
        };
        let message = MissionMessage::ItemInt { seq: 3, current: false, item, mission_type: 0 };
        let MavMessage::MISSION_ITEM_INT(m) = framed(&message).decode().unwrap() else { panic!("no item") };
        assert_eq!((m.seq, m.command as u32, m.frame as u32), (3, 16, 6));
        assert_eq!((m.param1, m.param4, m.x, m.y, m.z), (1.0, 4.0, item.x, item.y, 55.5));
        assert_eq!((m.target_system, m.target_component, m.autocontinue, m.current), (1, 1, 1, 0));
        let count = MissionMessage::Count { count: 300, mission_type: 2, opaque_id: 0xDEAD_BEEF };
        let MavMessage::MISSION_COUNT(m) = framed(&count).decode().unwrap() else { panic!("no count") };
        assert_eq!((m.count, m.mission_type as u32, m.opaque_id), (300, 2, 0xDEAD_BEEF));
        let ack = MissionMessage::Ack { result: MissionResult(13), mission_type: 0, opaque_id: 5 };
        let MavMessage::MISSION_ACK(m) = framed(&ack).decode().unwrap() else { panic!("no ack") };
        assert_eq!((m.mavtype as u32, m.opaque_id), (13, 5));
        // The dialect calls it superseded.
        let wish = framed(&MissionMessage::SetCurrent { seq: 5 });
        assert_eq!(
            (wish.message_id, decode(&wish).unwrap().message),
            (41, MissionMessage::SetCurrent { seq: 5 })
        );
        let current = MissionMessage::Current { seq: 2, total: 9, state: 3, mission_id: 77 };
        let MavMessage::MISSION_CURRENT(m) = framed(&current).decode().unwrap() else { panic!("no current") };
        assert_eq!((m.seq, m.total, m.mission_state as u32, m.mission_id), (2, 9, 3, 77));
    }

    #[test]
    fn the_dialect_reads_an_event_as_px4_sends_it() {
        use mavlink::dialects::ardupilotmega::EVENT_DATA;
        let arguments = std::array::from_fn(|k| k as u8 + 1);
        let data = EVENT_DATA {
            id: 0x0181_1691,
            event_time_boot_ms: 12_345,
            sequence: 7,
            destination_component: 190,
            destination_system: 255,
            log_levels: 0x33,
            arguments,
        };
        let sender = Sender { system_id: 1, component_id: 1 };
        let got = decode(&Frame::encode(sender, 0, &MavMessage::EVENT(data))).unwrap();
        assert_eq!(got.to, Address { system: 255, component: 190 });
        assert_eq!(got.message, MissionMessage::Event { id: 0x0181_1691, arguments });
        assert_eq!(decode(&framed(&got.message)).unwrap().message, got.message);
    }

    #[test]
    fn other_messages_are_none() {
        let heartbeat = Frame::encode(ME, 0, &crate::link::heartbeat::heartbeat(true));
        assert_eq!(decode(&heartbeat), None);
    }

    proptest! {
        /// Also commands and frames that the dialect does not list.
        #[test]
        fn items_survive_the_wire(
            command: u16, frame: u8, params: [f32; 4], x: i32, y: i32, z: f32, seq: u16, mission_type: u8,
        ) {
            prop_assume!(params.iter().chain([&z]).all(|v| !v.is_nan()));
            let item =
                MissionItem { command, frame: item::Frame(frame), autocontinue: true, params, x, y, z };
            let message = MissionMessage::ItemInt { seq, current: false, item, mission_type };
            let got = decode(&framed(&message)).unwrap();
            prop_assert_eq!(got.message, message);
            prop_assert_eq!((got.from.component, got.to), (191, VEHICLE));
        }
    }
}
