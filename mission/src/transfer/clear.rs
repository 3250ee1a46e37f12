//! Clear: the way to an empty mission on board.

use super::{Action, Envelope, MissionMessage, MissionResult, Opening, Peers, TransferError};

/// One request to clear the mission.
#[derive(Debug, Clone)]
pub struct Clear {
    peers: Peers,
    opening: Opening,
    suspected: Option<MissionResult>,
    finished: Option<Result<(), TransferError>>,
}

impl Clear {
    /// Starts; send what is returned.
    pub fn start(peers: Peers, now: f64) -> (Self, Vec<Action>) {
        let clear =
            Self { opening: Opening::new(now, &peers.timing), suspected: None, finished: None, peers };
        (clear, vec![Action::Send(MissionMessage::ClearAll { mission_type: peers.mission_type() })])
    }

    /// When [`Self::tick`] wants to be called, s.
    pub fn deadline(&self) -> Option<f64> {
        self.finished.is_none().then_some(self.opening.deadline)
    }

    /// The result once there is one.
    pub fn result(&self) -> Option<&Result<(), TransferError>> {
        self.finished.as_ref()
    }

    /// A message from anyone.
    pub fn receive(&mut self, _now: f64, envelope: &Envelope) -> Vec<Action> {
        if self.finished.is_none()
            && self.peers.concerns(envelope)
            && let MissionMessage::Ack { result, .. } = envelope.message
        {
            match result {
                MissionResult::ACCEPTED => self.finished = Some(Ok(())),
                // May be about something earlier: it counts if nothing better follows.
                result => self.suspected = Some(result),
            }
        }
        Vec::new()
    }

    /// Time passed.
    pub fn tick(&mut self, now: f64) -> Vec<Action> {
        if self.finished.is_some() || now < self.opening.deadline {
            return Vec::new();
        }
        if self.opening.again(now) {
            return vec![Action::Send(MissionMessage::ClearAll { mission_type: self.peers.mission_type() })];
        }
        let error = self
            .suspected
            .map_or(TransferError::NoReply, |result| TransferError::Refused { result, seq: None });
        self.finished = Some(Err(error));
        Vec::new()
    }
}
