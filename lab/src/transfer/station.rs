//! Another ground station, which uploads a mission of its own.

use gaware::link::frame::{Frame, Sender};
use gaware::mission_link::codec;
use gaware_mission::item::MissionItem;
use gaware_mission::transfer::{Action, Address, Peers, Upload};

/// Its ids: those of a usual ground station.
const ME: Address = Address { system: 255, component: 190 };
/// Between two attempts, s.
const AGAIN_S: f64 = 3.0;

/// The station.
pub(super) struct Station {
    peers: Peers,
    items: Vec<MissionItem>,
    begins_s: f64,
    upload: Option<Upload>,
    sequence: u8,
    /// When its first item was taken.
    pub(super) first_s: Option<f64>,
    /// When all of it was.
    pub(super) done_s: Option<f64>,
}

impl Station {
    pub(super) fn new(vehicle: Address, items: Vec<MissionItem>, begins_s: f64) -> Self {
        let peers = Peers::new(ME, vehicle);
        Self { peers, items, begins_s, upload: None, sequence: 0, first_s: None, done_s: None }
    }

    /// A moment passes; what it sends.
    pub(super) fn step<'a>(&mut self, now_s: f64, heard: impl Iterator<Item = &'a Frame>) -> Vec<Vec<u8>> {
        if self.done_s.is_some() || now_s < self.begins_s {
            return Vec::new();
        }
        let mut actions = Vec::new();
        let upload = match &mut self.upload {
            Some(upload) => upload,
            none => {
                let (upload, first) = Upload::start(self.peers, self.items.clone(), now_s);
                actions.extend(first);
                none.insert(upload)
            }
        };
        for envelope in heard.filter_map(codec::decode) {
            actions.extend(upload.receive(now_s, &envelope));
        }
        if upload.deadline().is_some_and(|t| now_s >= t) {
            actions.extend(upload.tick(now_s));
        }
        if actions.iter().any(|a| matches!(a, Action::Progress { .. })) {
            self.first_s.get_or_insert(now_s);
        }
        match upload.result() {
            Some(Ok(_)) => self.done_s = Some(now_s),
            Some(Err(_)) => {
                self.upload = None;
                self.begins_s = now_s + AGAIN_S;
            }
            None => {}
        }
        actions.iter().filter_map(|a| self.framed(a)).collect()
    }

    fn framed(&mut self, action: &Action) -> Option<Vec<u8>> {
        let Action::Send(message) = action else { return None };
        let (id, payload) = codec::encode(self.peers.vehicle, message);
        let sender = Sender { system_id: ME.system, component_id: ME.component };
        self.sequence = self.sequence.wrapping_add(1);
        Some(Frame::of_payload(sender, self.sequence, id, &payload).ok()?.raw().to_vec())
    }
}
