//! The vehicle's side of the mission protocol, with the habits and faults of ArduPilot and PX4 (FIELD_NOTES, "Mission
//! protocol"). No clock: time is a parameter; no storage: the items belong to the vehicle.

use super::Flavour;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::*;

/// Items that fit on board.
const CAPACITY: u16 = 700;
/// ArduPilot asks again after this, s, and gives up after that.
const ARDUPILOT_ASK_S: f64 = 1.0;
const ARDUPILOT_GIVE_UP_S: f64 = 8.0;
/// The same for PX4.
const PX4_ASK_S: f64 = 0.25;
const PX4_GIVE_UP_S: f64 = 5.0;

type Item = MISSION_ITEM_INT_DATA;
/// System and component of a station.
type Peer = (u8, u8);

#[derive(Debug, Clone)]
struct Upload {
    peer: Peer,
    count: u16,
    next: u16,
    asked_s: f64,
    heard_s: f64,
    /// PX4 collects here; ArduPilot writes into the mission itself.
    staged: Vec<Item>,
}

/// The server.
#[derive(Debug, Clone)]
pub struct MissionServer {
    flavour: Flavour,
    home: Item,
    upload: Option<Upload>,
    /// The peer and number of items of the last complete upload.
    finished: Option<(Peer, u16)>,
}

impl MissionServer {
    /// A server that writes `home` into sequence 0 where the autopilot keeps it there.
    pub fn new(flavour: Flavour, home: Item) -> Self {
        Self { flavour, home, upload: None, finished: None }
    }

    /// Whether an upload is going on.
    pub fn is_uploading(&self) -> bool {
        self.upload.is_some()
    }

    /// Forgets an unfinished transfer, as a restart does.
    pub fn restart(&mut self) {
        self.upload = None;
        self.finished = None;
    }

    /// The answer to a message of the protocol; other messages have none.
    pub fn handle(
        &mut self,
        items: &mut Vec<Item>,
        from: &MavHeader,
        message: &MavMessage,
        now_s: f64,
    ) -> Vec<MavMessage> {
        let peer = (u8::try_from(from.system_id).unwrap_or(0), from.component_id);
        let mission = MavMissionType::MAV_MISSION_TYPE_MISSION;
        match message {
            MavMessage::MISSION_COUNT(c) if c.mission_type == mission => {
                self.begin(items, peer, c.count, now_s)
            }
            MavMessage::MISSION_COUNT(c) => {
                let ack = ack(peer, MavMissionResult::MAV_MISSION_UNSUPPORTED, 0);
                vec![of_type(ack, c.mission_type)]
            }
            MavMessage::MISSION_ITEM_INT(i) if i.mission_type == mission => {
                self.receive(items, peer, i.clone(), now_s)
            }
            MavMessage::MISSION_ITEM(i) if i.mission_type == mission => {
                self.receive(items, peer, from_float(i), now_s)
            }
            MavMessage::MISSION_REQUEST_LIST(r) => {
                let count = if r.mission_type == mission { items.len() as u16 } else { 0 };
                vec![MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                    count,
                    target_system: peer.0,
                    target_component: peer.1,
                    mission_type: r.mission_type,
                    opaque_id: self.opaque_id(items),
                })]
            }
            MavMessage::MISSION_REQUEST_INT(r) if r.mission_type == mission => {
                vec![match items.get(usize::from(r.seq)) {
                    Some(item) => MavMessage::MISSION_ITEM_INT(addressed(item, r.seq, peer)),
                    None => ack(peer, MavMissionResult::MAV_MISSION_INVALID_SEQUENCE, 0),
                }]
            }
            MavMessage::MISSION_REQUEST(r) if r.mission_type == mission => {
                vec![match items.get(usize::from(r.seq)) {
                    Some(item) => MavMessage::MISSION_ITEM(to_float(&addressed(item, r.seq, peer))),
                    None => ack(peer, MavMissionResult::MAV_MISSION_INVALID_SEQUENCE, 0),
                }]
            }
            MavMessage::MISSION_CLEAR_ALL(c) => {
                if c.mission_type == mission || c.mission_type == MavMissionType::MAV_MISSION_TYPE_ALL {
                    items.clear();
                }
                let done = ack(peer, MavMissionResult::MAV_MISSION_ACCEPTED, 0);
                vec![of_type(done, c.mission_type)]
            }
            // The station cancels, or confirms a download.
            MavMessage::MISSION_ACK(a) if a.mission_type == mission => {
                let cancelled = a.mavtype != MavMissionResult::MAV_MISSION_ACCEPTED;
                if cancelled && self.upload.as_ref().is_some_and(|u| u.peer == peer) {
                    self.upload = None;
                }
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    /// Asks again for what did not come, or gives up.
    pub fn tick(&mut self, now_s: f64) -> Vec<MavMessage> {
        let (ask_s, give_up_s) = match self.flavour {
            Flavour::ArduPilot => (ARDUPILOT_ASK_S, ARDUPILOT_GIVE_UP_S),
            Flavour::Px4 => (PX4_ASK_S, PX4_GIVE_UP_S),
        };
        let Some(upload) = &mut self.upload else { return Vec::new() };
        if now_s - upload.heard_s >= give_up_s {
            let peer = upload.peer;
            self.upload = None;
            return vec![ack(peer, MavMissionResult::MAV_MISSION_OPERATION_CANCELLED, 0)];
        }
        if now_s - upload.asked_s >= ask_s {
            upload.asked_s = now_s;
            return vec![ask(self.flavour, upload)];
        }
        Vec::new()
    }

    /// PX4's checksum of the mission; ArduPilot has none.
    pub fn opaque_id(&self, items: &[Item]) -> u32 {
        match self.flavour {
            Flavour::ArduPilot => 0,
            Flavour::Px4 => checksum(items),
        }
    }

    fn begin(&mut self, items: &mut Vec<Item>, peer: Peer, count: u16, now_s: f64) -> Vec<MavMessage> {
        if self.upload.as_ref().is_some_and(|u| u.peer != peer) {
            let busy = match self.flavour {
                Flavour::ArduPilot => MavMissionResult::MAV_MISSION_DENIED,
                Flavour::Px4 => MavMissionResult::MAV_MISSION_ERROR,
            };
            return vec![ack(peer, busy, 0)];
        }
        if count > CAPACITY {
            return vec![ack(peer, MavMissionResult::MAV_MISSION_NO_SPACE, 0)];
        }
        if self.flavour == Flavour::ArduPilot {
            // Not atomic: from here on the old mission is damaged.
            items.truncate(usize::from(count));
        }
        if count == 0 {
            items.clear();
            self.upload = None;
            return vec![ack(peer, MavMissionResult::MAV_MISSION_ACCEPTED, self.opaque_id(items))];
        }
        let upload = Upload { peer, count, next: 0, asked_s: now_s, heard_s: now_s, staged: Vec::new() };
        self.finished = None;
        let request = ask(self.flavour, &upload);
        self.upload = Some(upload);
        vec![request]
    }

    fn receive(&mut self, items: &mut Vec<Item>, peer: Peer, item: Item, now_s: f64) -> Vec<MavMessage> {
        let flavour = self.flavour;
        let Some(upload) = self.upload.as_mut().filter(|u| u.peer == peer) else {
            return self.receive_idle(items, peer, item.seq);
        };
        if item.seq != upload.next {
            return match flavour {
                // In passing: the transfer goes on.
                Flavour::ArduPilot => vec![ack(peer, MavMissionResult::MAV_MISSION_INVALID_SEQUENCE, 0)],
                Flavour::Px4 => Vec::new(),
            };
        }
        if let Some(refused) = refusal(flavour, &item) {
            self.upload = None;
            return vec![ack(peer, refused, 0)];
        }
        upload.heard_s = now_s;
        upload.asked_s = now_s;
        upload.next += 1;
        let seq = usize::from(item.seq);
        match flavour {
            Flavour::Px4 => upload.staged.push(item),
            Flavour::ArduPilot => {
                let kept = if seq == 0 { self.home.clone() } else { rounded(item) };
                match items.get_mut(seq) {
                    Some(slot) => *slot = kept,
                    None => items.push(kept),
                }
            }
        }
        if upload.next < upload.count {
            return vec![ask(flavour, upload)];
        }
        self.finished = Some((peer, upload.count));
        if flavour == Flavour::Px4 {
            *items = std::mem::take(&mut upload.staged);
        }
        self.upload = None;
        vec![ack(peer, MavMissionResult::MAV_MISSION_ACCEPTED, self.opaque_id(items))]
    }

    /// An item without a transfer: PX4 takes the last one again for a lost ack, everything else is an error.
    fn receive_idle(&self, items: &[Item], peer: Peer, seq: u16) -> Vec<MavMessage> {
        if self.upload.is_some() {
            return vec![ack(peer, MavMissionResult::MAV_MISSION_DENIED, 0)];
        }
        let again = self.finished.is_some_and(|(p, count)| p == peer && seq + 1 == count);
        if self.flavour == Flavour::Px4 && again {
            return vec![ack(peer, MavMissionResult::MAV_MISSION_ACCEPTED, self.opaque_id(items))];
        }
        vec![ack(peer, MavMissionResult::MAV_MISSION_ERROR, 0)]
    }
}

/// ArduPilot asks with `MISSION_REQUEST`, whatever the station can do.
fn ask(flavour: Flavour, upload: &Upload) -> MavMessage {
    let (target_system, target_component) = upload.peer;
    let (seq, mission_type) = (upload.next, MavMissionType::MAV_MISSION_TYPE_MISSION);
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

fn ack(peer: Peer, result: MavMissionResult, opaque_id: u32) -> MavMessage {
    MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system: peer.0,
        target_component: peer.1,
        mavtype: result,
        mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
        opaque_id,
    })
}

fn of_type(message: MavMessage, mission_type: MavMissionType) -> MavMessage {
    match message {
        MavMessage::MISSION_ACK(a) => MavMessage::MISSION_ACK(MISSION_ACK_DATA { mission_type, ..a }),
        other => other,
    }
}

fn addressed(item: &Item, seq: u16, peer: Peer) -> Item {
    Item {
        seq,
        target_system: peer.0,
        target_component: peer.1,
        current: 0,
        mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
        ..item.clone()
    }
}

/// Why an item cannot be taken, if so.
fn refusal(flavour: Flavour, item: &Item) -> Option<MavMissionResult> {
    use MavFrame::*;
    let known_frame = matches!(
        item.frame,
        MAV_FRAME_GLOBAL
            | MAV_FRAME_GLOBAL_INT
            | MAV_FRAME_GLOBAL_RELATIVE_ALT
            | MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
            | MAV_FRAME_MISSION
    );
    if !known_frame {
        return Some(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME);
    }
    const KNOWN: &[u32] =
        &[16, 17, 18, 19, 20, 21, 22, 30, 31, 82, 93, 112, 114, 115, 177, 178, 179, 189, 195, 201, 206];
    /// `NAV_LOITER_TURNS` and `CONDITION_YAW`.
    const NOT_PX4: &[u32] = &[18, 115];
    let command = item.command as u32;
    let known = KNOWN.contains(&command) && (flavour == Flavour::ArduPilot || !NOT_PX4.contains(&command));
    (!known).then_some(MavMissionResult::MAV_MISSION_UNSUPPORTED)
}

/// Whether x, y, z of the command are a place.
fn has_place(command: MavCmd) -> bool {
    !matches!(command as u32, 20 | 93 | 112 | 114 | 115 | 177 | 178 | 206)
}

/// What ArduPilot keeps of an item: heights in cm, small integers for most parameters, coarse radii above 255 m.
fn rounded(item: Item) -> Item {
    use MavFrame::*;
    let mut kept = item;
    let byte = |v: f32| if v.is_finite() { v.round().clamp(0.0, 255.0) } else { 0.0 };
    let radius = |v: f32| {
        let whole = v.round();
        if whole.abs() > 255.0 { (whole / 10.0).round() * 10.0 } else { whole }
    };
    for p in [&mut kept.param1, &mut kept.param2, &mut kept.param3, &mut kept.param4] {
        if !p.is_finite() {
            *p = 0.0;
        }
    }
    match kept.command {
        MavCmd::MAV_CMD_NAV_WAYPOINT => {
            kept.param1 = kept.param1.round().clamp(0.0, 65535.0);
            kept.param2 = byte(kept.param2);
            kept.param3 = byte(kept.param3);
            kept.param4 = 0.0;
        }
        MavCmd::MAV_CMD_NAV_LOITER_TURNS => {
            kept.param1 = byte(kept.param1);
            kept.param3 = radius(kept.param3);
        }
        MavCmd::MAV_CMD_NAV_LOITER_TO_ALT => kept.param2 = radius(kept.param2),
        MavCmd::MAV_CMD_NAV_TAKEOFF => kept.param1 = kept.param1.round(),
        _ => {}
    }
    kept.autocontinue = 1;
    if has_place(kept.command) {
        kept.z = if kept.z.is_finite() { (kept.z * 100.0).trunc() / 100.0 } else { 0.0 };
        kept.frame = match kept.frame {
            MAV_FRAME_GLOBAL_RELATIVE_ALT_INT => MAV_FRAME_GLOBAL_RELATIVE_ALT,
            MAV_FRAME_GLOBAL_INT => MAV_FRAME_GLOBAL,
            frame => frame,
        };
    } else {
        (kept.x, kept.y, kept.z, kept.frame) = (0, 0, 0.0, MAV_FRAME_GLOBAL);
    }
    kept
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

fn from_float(i: &MISSION_ITEM_DATA) -> Item {
    let e7 = |v: f32| (f64::from(v) * 1e7).round() as i32;
    let (x, y) = if has_place(i.command) { (e7(i.x), e7(i.y)) } else { (i.x as i32, i.y as i32) };
    recast!(i, MISSION_ITEM_INT_DATA, x, y)
}

fn to_float(i: &Item) -> MISSION_ITEM_DATA {
    let degrees = |v: i32| (f64::from(v) * 1e-7) as f32;
    let (x, y) = if has_place(i.command) { (degrees(i.x), degrees(i.y)) } else { (i.x as f32, i.y as f32) };
    recast!(i, MISSION_ITEM_DATA, x, y)
}

/// CRC-32 (IEEE 802.3) over the content of the items.
fn checksum(items: &[Item]) -> u32 {
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

#[cfg(test)]
mod tests;
