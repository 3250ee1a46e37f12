//! Messages of the mission protocol, made and taken apart.

use super::{Flavour, Item, List, Peer};
use mavlink::dialects::ardupilotmega::*;

/// ArduPilot asks with `MISSION_REQUEST`, whatever the station can do.
pub(super) fn ask(flavour: Flavour, peer: Peer, list: List, seq: u16) -> MavMessage {
    let (target_system, target_component) = peer;
    let mission_type = list.mission_type();
    match flavour {
        Flavour::ArduPilot => MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA {
            seq,
            target_system,
            target_component,
            mission_type,
        }),
        Flavour::Px4 => MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
            seq,
            target_system,
            target_component,
            mission_type,
        }),
    }
}

pub(super) fn ack(peer: Peer, list: List, result: MavMissionResult, opaque_id: u32) -> MavMessage {
    MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system: peer.0,
        target_component: peer.1,
        mavtype: result,
        mission_type: list.mission_type(),
        opaque_id,
    })
}

pub(super) fn count(peer: Peer, list: List, count: usize, opaque_id: u32) -> MavMessage {
    MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
        count: u16::try_from(count).unwrap_or(u16::MAX),
        target_system: peer.0,
        target_component: peer.1,
        mission_type: list.mission_type(),
        opaque_id,
    })
}

pub(super) fn addressed(item: &Item, list: List, seq: u16, peer: Peer) -> Item {
    Item {
        seq,
        target_system: peer.0,
        target_component: peer.1,
        current: 0,
        mission_type: list.mission_type(),
        ..item.clone()
    }
}

/// Whether x, y, z of the command are a place.
pub(super) fn has_place(command: MavCmd) -> bool {
    !matches!(command as u32, 20 | 93 | 112 | 114 | 115 | 177 | 178 | 206)
}

/// An item in the other of the two messages, which differ in the type of their place alone.
macro_rules! recast {
    ($item:expr, $kind:ident, $x:expr, $y:expr) => {
        $kind {
            param1: $item.param1,
            param2: $item.param2,
            param3: $item.param3,
            param4: $item.param4,
            x: $x,
            y: $y,
            z: $item.z,
            seq: $item.seq,
            command: $item.command,
            target_system: $item.target_system,
            target_component: $item.target_component,
            frame: $item.frame,
            current: $item.current,
            autocontinue: $item.autocontinue,
            mission_type: $item.mission_type,
        }
    };
}

pub(super) fn from_float(i: &MISSION_ITEM_DATA) -> Item {
    let e7 = |v: f32| (f64::from(v) * 1e7).round() as i32;
    let (x, y) = if has_place(i.command) { (e7(i.x), e7(i.y)) } else { (i.x as i32, i.y as i32) };
    recast!(i, MISSION_ITEM_INT_DATA, x, y)
}

pub(super) fn to_float(i: &Item) -> MISSION_ITEM_DATA {
    let degrees = |v: i32| (f64::from(v) * 1e-7) as f32;
    let (x, y) = if has_place(i.command) { (degrees(i.x), degrees(i.y)) } else { (i.x as f32, i.y as f32) };
    recast!(i, MISSION_ITEM_DATA, x, y)
}

/// CRC-32 (IEEE 802.3) over the content of the items.
pub(super) fn checksum(items: &[Item]) -> u32 {
    let mut crc = u32::MAX;
    let mut feed = |bytes: &[u8]| {
        for b in bytes {
            crc ^= u32::from(*b);
            for _ in 0..8 {
                crc = if crc & 1 == 1 { (crc >> 1) ^ 0xEDB8_8320 } else { crc >> 1 };
            }
        }
    };
    for i in items {
        feed(&[i.frame as u8, i.autocontinue]);
        feed(&(i.command as u32).to_le_bytes());
        for p in [i.param1, i.param2, i.param3, i.param4, i.z] {
            feed(&p.to_le_bytes());
        }
        feed(&i.x.to_le_bytes());
        feed(&i.y.to_le_bytes());
    }
    !crc
}
