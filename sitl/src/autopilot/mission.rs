//! The vehicle's side of the mission protocol, with the habits and faults of ArduPilot and PX4 (FIELD_NOTES, "Mission
//! protocol"): three lists by mission type (mission, fence, rally points). No clock: time is a parameter; the mission's own
//! items belong to the vehicle.
//!
//! ArduPilot: `libraries/GCS_MAVLink/MissionItemProtocol.cpp` and its `_Waypoints`, `_Fence`, `_Rally`; PX4:
//! `src/modules/mavlink/mavlink_mission.cpp`.

mod ardupilot;
mod px4;
mod storage;
mod wire;

use super::Flavour;
use crate::scenario::Airframe;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::*;
use std::collections::BTreeMap;
use storage::Storage;
use wire::{ack, addressed, ask, checksum, from_float, to_float};

/// ArduPilot asks again after this, s, and gives up after that.
const ARDUPILOT_ASK_S: f64 = 1.0;
const ARDUPILOT_GIVE_UP_S: f64 = 8.0;
/// The same for PX4.
const PX4_ASK_S: f64 = 0.25;
const PX4_GIVE_UP_S: f64 = 5.0;

type Item = MISSION_ITEM_INT_DATA;
/// System and component of a station.
type Peer = (u8, u8);

/// What is transferred: the numbers of `MAV_MISSION_TYPE`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum List {
    Mission,
    Fence,
    Rally,
}

impl List {
    const ALL: [Self; 3] = [Self::Mission, Self::Fence, Self::Rally];

    fn of(mission_type: MavMissionType) -> Option<Self> {
        Self::ALL.into_iter().find(|l| l.mission_type() == mission_type)
    }

    fn mission_type(self) -> MavMissionType {
        match self {
            Self::Mission => MavMissionType::MAV_MISSION_TYPE_MISSION,
            Self::Fence => MavMissionType::MAV_MISSION_TYPE_FENCE,
            Self::Rally => MavMissionType::MAV_MISSION_TYPE_RALLY,
        }
    }
}

#[derive(Debug, Clone)]
struct Upload {
    list: List,
    peer: Peer,
    count: u16,
    next: u16,
    asked_s: f64,
    heard_s: f64,
    /// What is taken over at the end: everything on PX4, ArduPilot's fence. ArduPilot's missions and rally points are written
    /// item by item.
    staged: Vec<Item>,
    /// The item that was marked as the current one.
    current: Option<u16>,
    /// Whether it holds a rally point to which PX4 cannot return.
    lost: bool,
}

/// What an upload or a clearing does to the index of the current item.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cursor {
    /// It goes to this item.
    At(u16),
    /// It stays, cut to the last item (`MissionBase::updateMavlinkMission`).
    Stays,
}

/// The server.
#[derive(Debug, Clone)]
pub struct MissionServer {
    firmware: Storage,
    home: Item,
    /// At most one per list on ArduPilot, at most one on PX4.
    uploads: Vec<Upload>,
    /// PX4: who downloads what, and the item it may ask for next.
    download: Option<(Peer, List, u16)>,
    /// The last complete upload and its number of items.
    finished: Option<(Peer, List, u16)>,
    /// Fence and rally points.
    others: BTreeMap<List, Vec<Item>>,
    /// What is said besides: to be taken by [`Self::take_texts`].
    texts: Vec<&'static str>,
    /// Whether the mission changed since [`Self::take_changed`].
    changed: bool,
    /// What is to become of the current item, to be taken by [`Self::take_cursor`].
    cursor: Option<Cursor>,
}

impl MissionServer {
    /// A server that writes `home` into sequence 0 where the autopilot keeps it there.
    pub fn new(flavour: Flavour, airframe: Airframe, home: Item) -> Self {
        Self {
            firmware: Storage { flavour, airframe },
            home,
            uploads: Vec::new(),
            download: None,
            finished: None,
            others: BTreeMap::new(),
            texts: Vec::new(),
            changed: false,
            cursor: None,
        }
    }

    /// Whether an upload is going on.
    pub fn is_uploading(&self) -> bool {
        !self.uploads.is_empty()
    }

    /// Home, as an item.
    pub fn home(&self) -> &Item {
        &self.home
    }

    /// The geofence on board: polygon corners and circles as items.
    pub fn fence(&self) -> &[Item] {
        self.others.get(&List::Fence).map_or(&[], Vec::as_slice)
    }

    /// The rally points on board.
    pub fn rally_points(&self) -> &[Item] {
        self.others.get(&List::Rally).map_or(&[], Vec::as_slice)
    }

    /// ArduPilot's parameter `FENCE_TOTAL`: corners and circles plus 2, or 0 where they are fewer than three
    /// (`AC_PolyFence_loader::write_fence`).
    pub fn fence_total(&self) -> usize {
        let points = self.fence().iter().filter(|i| i.command != MavCmd::MAV_CMD_NAV_FENCE_RETURN_POINT);
        match points.count() {
            0..=2 => 0,
            many => many + 2,
        }
    }

    /// Texts for the station since the last call.
    pub fn take_texts(&mut self) -> Vec<&'static str> {
        std::mem::take(&mut self.texts)
    }

    /// Whether the mission was replaced or cleared since the last call: PX4 judges it then.
    pub fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// What the last message did to the index of the current item; ArduPilot leaves it alone.
    pub fn take_cursor(&mut self) -> Option<Cursor> {
        self.cursor.take()
    }

    /// Whether PX4 is too busy to change the current item: any transfer of this link.
    pub fn is_busy(&self) -> bool {
        self.is_uploading() || self.download.is_some()
    }

    /// Forgets an unfinished transfer, as a restart does; the lists are stored for good.
    pub fn restart(&mut self) {
        self.uploads.clear();
        self.download = None;
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
        let Some(mission_type) = mission_type_of(message) else { return Vec::new() };
        let Some(list) = List::of(mission_type) else {
            return self.handle_unknown_type(items, peer, message, mission_type);
        };
        let mut stored = match list {
            List::Mission => std::mem::take(items),
            _ => self.others.remove(&list).unwrap_or_default(),
        };
        let answers = self.answer(&mut stored, list, peer, message, now_s);
        match list {
            List::Mission => *items = stored,
            _ => _ = self.others.insert(list, stored),
        }
        answers
    }

    fn answer(
        &mut self,
        stored: &mut Vec<Item>,
        list: List,
        peer: Peer,
        message: &MavMessage,
        now_s: f64,
    ) -> Vec<MavMessage> {
        match message {
            MavMessage::MISSION_COUNT(c) => self.begin(stored, list, peer, c.count, now_s),
            MavMessage::MISSION_ITEM_INT(i) => self.receive(stored, list, peer, i.clone(), now_s),
            MavMessage::MISSION_ITEM(i) => self.receive(stored, list, peer, from_float(i), now_s),
            MavMessage::MISSION_REQUEST_LIST(_) => self.count(stored, list, peer),
            MavMessage::MISSION_REQUEST_INT(r) => self.send(stored, list, peer, r.seq, true),
            MavMessage::MISSION_REQUEST(r) => self.send(stored, list, peer, r.seq, false),
            MavMessage::MISSION_CLEAR_ALL(_) => self.clear(stored, list, peer),
            // The station cancels, or confirms a download.
            MavMessage::MISSION_ACK(a) => {
                self.download = self.download.filter(|(p, ..)| *p != peer);
                if a.mavtype != MavMissionResult::MAV_MISSION_ACCEPTED {
                    self.uploads.retain(|u| u.peer != peer || u.list != list);
                }
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    /// A type beyond the three lists: `MAV_MISSION_TYPE_ALL` clears everything on PX4 and is unsupported on ArduPilot, whose table of
    /// lists has three places (`GCS::get_prot_for_mission_type`).
    fn handle_unknown_type(
        &mut self,
        items: &mut Vec<Item>,
        peer: Peer,
        message: &MavMessage,
        mission_type: MavMissionType,
    ) -> Vec<MavMessage> {
        let result = match (self.firmware.flavour, message) {
            (Flavour::Px4, MavMessage::MISSION_CLEAR_ALL(_)) => {
                items.clear();
                self.changed = true;
                self.cursor = Some(Cursor::At(0));
                self.others.clear();
                MavMissionResult::MAV_MISSION_ACCEPTED
            }
            (Flavour::Px4, MavMessage::MISSION_COUNT(_)) => MavMissionResult::MAV_MISSION_INVALID,
            (
                Flavour::ArduPilot,
                MavMessage::MISSION_CLEAR_ALL(_)
                | MavMessage::MISSION_COUNT(_)
                | MavMessage::MISSION_REQUEST_LIST(_),
            ) => MavMissionResult::MAV_MISSION_UNSUPPORTED,
            _ => return Vec::new(),
        };
        vec![MavMessage::MISSION_ACK(MISSION_ACK_DATA {
            target_system: peer.0,
            target_component: peer.1,
            mavtype: result,
            mission_type,
            opaque_id: 0,
        })]
    }

    /// Asks again for what did not come, or gives up.
    pub fn tick(&mut self, now_s: f64) -> Vec<MavMessage> {
        let flavour = self.firmware.flavour;
        let (ask_s, give_up_s) = match flavour {
            Flavour::ArduPilot => (ARDUPILOT_ASK_S, ARDUPILOT_GIVE_UP_S),
            Flavour::Px4 => (PX4_ASK_S, PX4_GIVE_UP_S),
        };
        let mut said = Vec::new();
        let mut texts = Vec::new();
        self.uploads.retain_mut(|upload| {
            if now_s - upload.heard_s >= give_up_s {
                // PX4 gives up without an answer (`MavlinkMissionManager::send`).
                if flavour == Flavour::ArduPilot {
                    let cancelled = MavMissionResult::MAV_MISSION_OPERATION_CANCELLED;
                    said.push(ack(upload.peer, upload.list, cancelled, 0));
                    texts.push(match upload.list {
                        List::Mission => "Mission upload timeout",
                        List::Fence => "Fence upload timeout",
                        List::Rally => "Rally upload timeout",
                    });
                }
                return false;
            }
            if now_s - upload.asked_s >= ask_s {
                upload.asked_s = now_s;
                said.push(ask(flavour, upload.peer, upload.list, upload.next));
            }
            true
        });
        self.texts.extend(texts);
        said
    }

    /// PX4's checksum of a list; ArduPilot has none.
    pub fn opaque_id(&self, items: &[Item]) -> u32 {
        match self.firmware.flavour {
            Flavour::ArduPilot => 0,
            Flavour::Px4 => checksum(items),
        }
    }

    fn begin(
        &mut self,
        stored: &mut Vec<Item>,
        list: List,
        peer: Peer,
        count: u16,
        now_s: f64,
    ) -> Vec<MavMessage> {
        let flavour = self.firmware.flavour;
        if let Some(answer) = self.busy(list, peer) {
            return vec![answer];
        }
        if count > self.firmware.capacity(list) {
            return vec![ack(peer, list, MavMissionResult::MAV_MISSION_NO_SPACE, 0)];
        }
        if flavour == Flavour::ArduPilot && list != List::Fence {
            // Not atomic: from here on the old list is damaged.
            stored.truncate(usize::from(count));
        }
        if count == 0 {
            stored.clear();
            self.mission_changed(list, Cursor::At(0));
            return vec![ack(peer, list, MavMissionResult::MAV_MISSION_ACCEPTED, self.opaque_id(stored))];
        }
        self.finished = None;
        self.download = None;
        let staged = Vec::new();
        let (asked_s, heard_s) = (now_s, now_s);
        self.uploads.push(Upload {
            list,
            peer,
            count,
            next: 0,
            asked_s,
            heard_s,
            staged,
            current: None,
            lost: false,
        });
        vec![ask(flavour, peer, list, 0)]
    }

    /// What stands against a new upload. ArduPilot lets the same station start again and denies it to another; PX4 repeats its first
    /// request and refuses anything later.
    fn busy(&mut self, list: List, peer: Peer) -> Option<MavMessage> {
        match self.firmware.flavour {
            Flavour::ArduPilot => {
                let other = self.uploads.iter().any(|u| u.list == list && u.peer != peer);
                self.uploads.retain(|u| u.list != list || other);
                other.then(|| ack(peer, list, MavMissionResult::MAV_MISSION_DENIED, 0))
            }
            Flavour::Px4 => self.uploads.first().map(|u| {
                if u.peer == peer && u.next == 0 {
                    ask(Flavour::Px4, peer, u.list, 0)
                } else {
                    ack(peer, u.list, MavMissionResult::MAV_MISSION_ERROR, 0)
                }
            }),
        }
    }

    fn receive(
        &mut self,
        stored: &mut Vec<Item>,
        list: List,
        peer: Peer,
        item: Item,
        now_s: f64,
    ) -> Vec<MavMessage> {
        let firmware = self.firmware;
        let Some(k) = self.uploads.iter().position(|u| u.list == list) else {
            return self.receive_idle(stored, list, peer, item.seq);
        };
        let upload = &mut self.uploads[k];
        if item.seq != upload.next {
            return match firmware.flavour {
                // In passing: the transfer goes on.
                Flavour::ArduPilot => {
                    vec![ack(peer, list, MavMissionResult::MAV_MISSION_INVALID_SEQUENCE, 0)]
                }
                Flavour::Px4 => Vec::new(),
            };
        }
        if upload.peer != peer {
            return match firmware.flavour {
                Flavour::ArduPilot => vec![ack(peer, list, MavMissionResult::MAV_MISSION_DENIED, 0)],
                Flavour::Px4 => Vec::new(),
            };
        }
        let seq = usize::from(item.seq);
        let last = upload.count - 1;
        if item.current != 0 {
            upload.current = Some(item.seq);
        }
        upload.lost |= list == List::Rally && !storage::px4_returns_to(&item);
        let kept = match firmware.keep(list, item) {
            // `MissionItemProtocol_Waypoints::append_item`.
            Ok(kept) if firmware.flavour == Flavour::ArduPilot && ardupilot::jumps_outside(&kept, last) => {
                self.uploads.remove(k);
                return vec![ack(peer, list, MavMissionResult::MAV_MISSION_ERROR, 0)];
            }
            Ok(kept) => kept,
            Err(refused) => {
                self.uploads.remove(k);
                return vec![ack(peer, list, refused, 0)];
            }
        };
        upload.heard_s = now_s;
        upload.asked_s = now_s;
        upload.next += 1;
        if firmware.stages(list) {
            upload.staged.push(kept);
        } else {
            let kept = if seq == 0 && list == List::Mission { self.home.clone() } else { kept };
            match stored.get_mut(seq) {
                Some(slot) => *slot = kept,
                None => stored.push(kept),
            }
        }
        if upload.next < upload.count {
            return vec![ask(firmware.flavour, peer, list, upload.next)];
        }
        let upload = self.uploads.remove(k);
        self.complete(stored, upload)
    }

    /// The last item is there.
    fn complete(&mut self, stored: &mut Vec<Item>, upload: Upload) -> Vec<MavMessage> {
        let Upload { list, peer, count, staged, current, lost, .. } = upload;
        if self.firmware.flavour == Flavour::ArduPilot
            && list == List::Fence
            && let Err(why) = storage::validate_fence(&staged)
        {
            self.texts.extend([why, "Fence validation failed"]);
            return vec![ack(peer, list, MavMissionResult::MAV_MISSION_ERROR, 0)];
        }
        if self.firmware.stages(list) {
            // A mission that PX4 has already is not taken again, nor is its current item.
            if checksum(stored) != checksum(&staged) {
                self.mission_changed(list, current.map_or(Cursor::Stays, Cursor::At));
            }
            *stored = staged;
        }
        if self.firmware.flavour == Flavour::ArduPilot && list == List::Mission {
            self.texts.push("Flight plan received");
        }
        if self.firmware.flavour == Flavour::Px4 && lost {
            self.texts.push("RTL: unsupported MAV_FRAME");
        }
        self.changed |= list == List::Mission;
        self.finished = Some((peer, list, count));
        vec![ack(peer, list, MavMissionResult::MAV_MISSION_ACCEPTED, self.opaque_id(stored))]
    }

    /// An item without a transfer: PX4 takes the last one again for a lost ack, everything else is an error.
    fn receive_idle(&self, stored: &[Item], list: List, peer: Peer, seq: u16) -> Vec<MavMessage> {
        if self.firmware.flavour == Flavour::Px4 {
            if let Some(other) = self.uploads.first() {
                // The list that is transferred is another one.
                return vec![ack(peer, other.list, MavMissionResult::MAV_MISSION_ERROR, 0)];
            }
            let again = self.finished.is_some_and(|(p, l, count)| p == peer && l == list && seq + 1 == count);
            if again {
                return vec![ack(peer, list, MavMissionResult::MAV_MISSION_ACCEPTED, self.opaque_id(stored))];
            }
        }
        vec![ack(peer, list, MavMissionResult::MAV_MISSION_ERROR, 0)]
    }

    fn count(&mut self, stored: &[Item], list: List, peer: Peer) -> Vec<MavMessage> {
        match self.firmware.flavour {
            Flavour::ArduPilot if self.uploads.iter().any(|u| u.list == list) => {
                return vec![ack(peer, list, MavMissionResult::MAV_MISSION_DENIED, 0)];
            }
            // Busy: not answered.
            Flavour::Px4 if !self.uploads.is_empty() => return Vec::new(),
            Flavour::Px4 => self.download = Some((peer, list, 0)),
            Flavour::ArduPilot => {}
        }
        vec![wire::count(peer, list, stored.len(), self.opaque_id(stored))]
    }

    fn send(&mut self, stored: &[Item], list: List, peer: Peer, seq: u16, int: bool) -> Vec<MavMessage> {
        match self.firmware.flavour {
            // Of the two ways to ask, only the newer one is denied.
            Flavour::ArduPilot if int && self.uploads.iter().any(|u| u.list == list) => {
                return vec![ack(peer, list, MavMissionResult::MAV_MISSION_DENIED, 0)];
            }
            Flavour::ArduPilot => {}
            Flavour::Px4 => {
                let Some((_, _, next)) = self.download.filter(|(p, l, _)| *p == peer && *l == list) else {
                    return Vec::new();
                };
                if seq != next && seq + 1 != next || usize::from(seq) >= stored.len() {
                    self.download = None;
                    return vec![ack(peer, list, MavMissionResult::MAV_MISSION_ERROR, 0)];
                }
                self.download = Some((peer, list, seq + 1));
            }
        }
        let Some(item) = stored.get(usize::from(seq)) else {
            // The station learns how long the list really is.
            let mut answers = vec![ack(peer, list, MavMissionResult::MAV_MISSION_INVALID_SEQUENCE, 0)];
            if int {
                answers.insert(0, wire::count(peer, list, stored.len(), 0));
            }
            return answers;
        };
        let item = addressed(item, list, seq, peer);
        vec![if int { MavMessage::MISSION_ITEM_INT(item) } else { MavMessage::MISSION_ITEM(to_float(&item)) }]
    }

    fn clear(&mut self, stored: &mut Vec<Item>, list: List, peer: Peer) -> Vec<MavMessage> {
        match self.firmware.flavour {
            Flavour::ArduPilot => {
                if let Some(denied) = self.busy(list, peer) {
                    return vec![denied];
                }
            }
            // Busy: not answered.
            Flavour::Px4 if !self.uploads.is_empty() => return Vec::new(),
            Flavour::Px4 => {}
        }
        stored.clear();
        self.mission_changed(list, Cursor::At(0));
        vec![ack(peer, list, MavMissionResult::MAV_MISSION_ACCEPTED, 0)]
    }

    fn mission_changed(&mut self, list: List, cursor: Cursor) {
        if list == List::Mission {
            self.changed = true;
            self.cursor = Some(cursor);
        }
    }
}

fn mission_type_of(message: &MavMessage) -> Option<MavMissionType> {
    Some(match message {
        MavMessage::MISSION_COUNT(m) => m.mission_type,
        MavMessage::MISSION_ITEM_INT(m) => m.mission_type,
        MavMessage::MISSION_ITEM(m) => m.mission_type,
        MavMessage::MISSION_REQUEST_LIST(m) => m.mission_type,
        MavMessage::MISSION_REQUEST_INT(m) => m.mission_type,
        MavMessage::MISSION_REQUEST(m) => m.mission_type,
        MavMessage::MISSION_CLEAR_ALL(m) => m.mission_type,
        MavMessage::MISSION_ACK(m) => m.mission_type,
        _ => return None,
    })
}

#[cfg(test)]
mod tests;
