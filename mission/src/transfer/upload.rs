//! Upload: announce the number of items, then answer what the vehicle asks for. The vehicle drives: items are never
//! sent on a timer of our own, and an ack in passing ends nothing.

use super::{Action, Envelope, MissionMessage, MissionResult, Opening, Peers, TransferError};
use crate::item::{MissionItem, MissionKind};

#[derive(Debug, Clone)]
enum State {
    /// The count is out, nothing has been asked for yet.
    Opening(Opening),
    /// The vehicle asks; over at this time if it stays silent.
    Serving {
        until: f64,
    },
    Finished(Result<u32, TransferError>),
}

/// One upload of items by their wire sequence. At least one item: an empty mission is [`super::Clear`]'s work.
#[derive(Debug, Clone)]
pub struct Upload {
    peers: Peers,
    items: Vec<MissionItem>,
    asked: Vec<bool>,
    last_asked: Option<u16>,
    /// A refusal that may be about an earlier message; it counts if nothing else follows.
    suspected: Option<MissionResult>,
    /// No new item was asked for until this time: give up.
    stuck_at: f64,
    state: State,
}

impl Upload {
    /// Starts; send what is returned.
    pub fn start(peers: Peers, items: Vec<MissionItem>, now: f64) -> (Self, Vec<Action>) {
        let asked = vec![false; items.len()];
        let state = State::Opening(Opening::new(now, &peers.timing));
        let stuck_at = f64::INFINITY;
        let mut upload = Self { peers, items, asked, last_asked: None, suspected: None, stuck_at, state };
        let Ok(_) = u16::try_from(upload.items.len()) else {
            upload.state = State::Finished(Err(TransferError::TooLong(upload.items.len())));
            return (upload, Vec::new());
        };
        let count = upload.count();
        (upload, vec![Action::Send(count)])
    }

    /// When [`Self::tick`] wants to be called, s.
    pub fn deadline(&self) -> Option<f64> {
        match &self.state {
            State::Opening(o) => Some(o.deadline),
            State::Serving { until } => Some(until.min(self.stuck_at)),
            State::Finished(_) => None,
        }
    }

    /// The result once there is one: the vehicle's opaque id (0: none), or why not.
    pub fn result(&self) -> Option<&Result<u32, TransferError>> {
        match &self.state {
            State::Finished(r) => Some(r),
            _ => None,
        }
    }

    /// A message from anyone.
    pub fn receive(&mut self, now: f64, envelope: &Envelope) -> Vec<Action> {
        if self.result().is_some() || !self.peers.concerns(envelope) {
            return Vec::new();
        }
        match envelope.message {
            MissionMessage::RequestInt { seq, .. } | MissionMessage::Request { seq, .. } => {
                self.serve(now, seq)
            }
            MissionMessage::Ack { result, opaque_id, .. } => {
                self.acknowledged(now, result, opaque_id);
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    /// Time passed.
    pub fn tick(&mut self, now: f64) -> Vec<Action> {
        let count = self.count();
        match &mut self.state {
            State::Opening(o) if now >= o.deadline => {
                if o.again(now) {
                    return vec![Action::Send(count)];
                }
                self.give_up(TransferError::NoReply);
            }
            State::Serving { .. } if now >= self.stuck_at => {
                self.give_up(TransferError::NoProgress { done: self.done(), total: self.items.len() });
            }
            State::Serving { until } if now >= *until => {
                self.give_up(TransferError::Silent { done: self.done(), total: self.items.len() });
            }
            _ => {}
        }
        Vec::new()
    }

    /// Items asked for, and all of them.
    pub(crate) fn progress(&self) -> (usize, usize) {
        (self.done(), self.items.len())
    }

    /// Whether every item has been asked for: what the vehicle says from here on is about the whole mission.
    pub fn all_served(&self) -> bool {
        self.done() == self.items.len()
    }

    /// Gives up; the vehicle is informed.
    pub fn cancel(&mut self) -> Vec<Action> {
        if self.result().is_some() {
            return Vec::new();
        }
        self.state = State::Finished(Err(TransferError::Cancelled));
        vec![Action::Send(MissionMessage::Ack {
            result: MissionResult::OPERATION_CANCELLED,
            mission_type: self.peers.mission_type(),
            opaque_id: 0,
        })]
    }

    fn count(&self) -> MissionMessage {
        let count = u16::try_from(self.items.len()).unwrap_or(u16::MAX);
        MissionMessage::Count { count, mission_type: self.peers.mission_type(), opaque_id: 0 }
    }

    fn done(&self) -> usize {
        self.asked.iter().filter(|a| **a).count()
    }

    fn serve(&mut self, now: f64, seq: u16) -> Vec<Action> {
        // A number beyond the end belongs to another transfer.
        let index = usize::from(seq);
        let (Some(item), Some(asked)) = (self.items.get(index), self.asked.get_mut(index)) else {
            return Vec::new();
        };
        if !std::mem::replace(asked, true) {
            self.stuck_at = now + self.peers.timing.progress_s;
        }
        self.suspected = None;
        self.last_asked = Some(seq);
        self.state = State::Serving { until: now + self.peers.timing.silence_s };
        let mut item = *item;
        // PX4 returns to a rally point in frame 0 or 3 only, and flies off where it is `_INT` (rtl.cpp:495); ArduPilot takes every frame.
        item.frame = match self.peers.kind {
            MissionKind::Rally => item.frame.in_files(),
            MissionKind::Mission | MissionKind::Fence => item.frame.on_wire(),
        };
        // PX4 keeps the index of the mission before where no item is marked; ArduPilot does not read the mark.
        let current = seq == 0 && self.peers.kind == MissionKind::Mission;
        let message = MissionMessage::ItemInt { seq, current, item, mission_type: self.peers.mission_type() };
        vec![Action::Send(message), Action::Progress { done: self.done(), total: self.items.len() }]
    }

    fn acknowledged(&mut self, now: f64, result: MissionResult, opaque_id: u32) {
        let serving = matches!(self.state, State::Serving { .. });
        match result {
            // Before the last item was asked for, it is the late ack of something else.
            MissionResult::ACCEPTED if self.done() == self.items.len() => {
                self.state = State::Finished(Ok(opaque_id));
            }
            // The vehicle goes on asking for what it wants.
            MissionResult::ACCEPTED | MissionResult::INVALID_SEQUENCE => {}
            result if result.is_final() && serving => {
                self.state = State::Finished(Err(TransferError::Refused { result, seq: self.last_asked }));
            }
            // Busy, or about a duplicate: it counts if the vehicle asks no more.
            result => {
                self.suspected = Some(result);
                if let State::Serving { until } = &mut self.state {
                    // ArduPilot asks again after 1 s: two of those.
                    *until = until.min(now + 2.5);
                }
            }
        }
    }

    fn give_up(&mut self, why: TransferError) {
        let error = match self.suspected {
            Some(result) => TransferError::Refused { result, seq: self.last_asked },
            None => why,
        };
        self.state = State::Finished(Err(error));
    }
}
