//! Download: ask for the number of items, then for each of them in turn.

use super::{Action, Envelope, MissionMessage, MissionResult, Opening, Peers, TransferError};
use crate::change::Exchange;
use crate::item::{MissionItem, MissionKind};

/// What was read from a vehicle.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Downloaded {
    /// Items by sequence number.
    pub items: Vec<MissionItem>,
    /// PX4's checksum of the mission; 0 where unknown.
    pub opaque_id: u32,
}

#[derive(Debug, Clone)]
enum State {
    Opening(Opening),
    Item { deadline: f64, retries_left: u32 },
    Finished(Result<(), TransferError>),
}

/// One download.
#[derive(Debug, Clone)]
pub struct Download {
    peers: Peers,
    started: f64,
    /// A question was asked again, or has no answer.
    repeated: bool,
    item_s: f64,
    total: usize,
    got: Downloaded,
    suspected: Option<MissionResult>,
    state: State,
}

impl Exchange for Download {
    type Action = Action;
    type Message = Envelope;

    fn deadline(&self) -> Option<f64> {
        match &self.state {
            State::Opening(o) => Some(o.deadline),
            State::Item { deadline, .. } => Some(*deadline),
            State::Finished(_) => None,
        }
    }

    fn receive(&mut self, now: f64, envelope: &Envelope) -> Vec<Action> {
        if !self.peers.concerns(envelope) {
            return Vec::new();
        }
        match (&self.state, &envelope.message) {
            (State::Opening(_), MissionMessage::Count { count, opaque_id, .. }) => {
                if !self.repeated {
                    // The round trip is only known where it is clear which question was answered (Karn).
                    self.item_s =
                        self.item_s.max(2.0 * (now - self.started)).min(self.peers.timing.first_reply_s);
                }
                self.total = usize::from(*count);
                self.got.opaque_id = *opaque_id;
                self.suspected = None;
                self.next(now)
            }
            (State::Item { .. }, MissionMessage::ItemInt { seq, item, .. }) => {
                // Anything else is late or double.
                if usize::from(*seq) != self.got.items.len() {
                    return Vec::new();
                }
                self.got.items.push(*item);
                let mut actions = vec![Action::Progress { done: self.got.items.len(), total: self.total }];
                actions.extend(self.next(now));
                actions
            }
            (State::Opening(_) | State::Item { .. }, MissionMessage::Ack { result, .. })
                if *result != MissionResult::ACCEPTED =>
            {
                // Another transfer may be under way, or it is late: it counts if nothing else follows. Only a vehicle that does not
                // have this list says so by its kind.
                self.suspected = Some(*result);
                if self.peers.kind != MissionKind::Mission && result.is_final() {
                    self.give_up(TransferError::NoReply);
                }
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    fn tick(&mut self, now: f64) -> Vec<Action> {
        let mission_type = self.peers.mission_type();
        match &mut self.state {
            State::Opening(o) if now >= o.deadline => {
                if o.again(now) {
                    self.repeated = true;
                    return vec![Action::Send(MissionMessage::RequestList { mission_type })];
                }
                self.give_up(TransferError::NoReply);
            }
            State::Item { deadline, retries_left } if now >= *deadline => {
                if *retries_left > 0 {
                    *retries_left -= 1;
                    *deadline = now + self.item_s;
                    self.repeated = true;
                    return vec![Action::Send(self.ask())];
                }
                self.give_up(TransferError::Silent { done: self.got.items.len(), total: self.total });
            }
            _ => {}
        }
        Vec::new()
    }
}

impl Download {
    /// Starts; send what is returned.
    pub fn start(peers: Peers, now: f64) -> (Self, Vec<Action>) {
        let download = Self {
            started: now,
            repeated: false,
            item_s: peers.timing.item_s,
            total: 0,
            got: Downloaded::default(),
            suspected: None,
            state: State::Opening(Opening::new(now, &peers.timing)),
            peers,
        };
        let ask = MissionMessage::RequestList { mission_type: peers.mission_type() };
        (download, vec![Action::Send(ask)])
    }

    /// The result once there is one.
    pub fn result(&self) -> Option<Result<&Downloaded, &TransferError>> {
        match &self.state {
            State::Finished(Ok(())) => Some(Ok(&self.got)),
            State::Finished(Err(e)) => Some(Err(e)),
            _ => None,
        }
    }

    /// Whether more answers may come than were taken: something was asked twice, or not to its end; or the list is empty, so that its
    /// length is all there is to compare.
    pub fn may_be_answered_late(&self) -> bool {
        self.repeated || self.total == 0
    }

    /// Gives up; the vehicle is informed.
    pub fn cancel(&mut self) -> Vec<Action> {
        if matches!(self.state, State::Finished(_)) {
            return Vec::new();
        }
        self.repeated = true;
        self.state = State::Finished(Err(TransferError::Cancelled));
        vec![self.ack(MissionResult::OPERATION_CANCELLED)]
    }

    fn ask(&self) -> MissionMessage {
        let seq = u16::try_from(self.got.items.len()).unwrap_or(u16::MAX);
        MissionMessage::RequestInt { seq, mission_type: self.peers.mission_type() }
    }

    fn ack(&self, result: MissionResult) -> Action {
        let mission_type = self.peers.mission_type();
        Action::Send(MissionMessage::Ack { result, mission_type, opaque_id: self.got.opaque_id })
    }

    fn next(&mut self, now: f64) -> Vec<Action> {
        if self.got.items.len() == self.total {
            self.state = State::Finished(Ok(()));
            return vec![self.ack(MissionResult::ACCEPTED)];
        }
        self.state = State::Item { deadline: now + self.item_s, retries_left: self.peers.timing.retries };
        vec![Action::Send(self.ask())]
    }

    fn give_up(&mut self, why: TransferError) {
        self.repeated = true;
        let error = self.suspected.map_or(why, |result| TransferError::Refused { result, seq: None });
        self.state = State::Finished(Err(error));
    }
}
