//! The current item of a new mission: neither firmware begins a new mission at its first item by itself (docs/firmware-rules.md).

use super::Outcome;
use crate::transfer::{Action, Envelope, MissionMessage, Peers};

/// Wait for `MISSION_CURRENT`, s: PX4 sends it once a second, ArduPilot answers at once.
const ANSWER_S: f64 = 1.5;
/// Attempts, as many as of any opening message.
const TRIES: u32 = 6;

/// The wish for the first item, and what the vehicle says of it.
#[derive(Debug)]
pub(super) struct FirstItem {
    /// The highest index that is the first item.
    first: u16,
    /// The last one that was reported.
    reported: Option<u16>,
    until: f64,
    tries_left: u32,
}

impl FirstItem {
    pub(super) fn start(first: u16, now: f64) -> (Self, Vec<Action>) {
        let mut wish = Self { first, reported: None, until: now, tries_left: TRIES };
        let actions = wish.tick(now);
        (wish, actions)
    }

    pub(super) fn deadline(&self) -> f64 {
        self.until
    }

    pub(super) fn receive(&mut self, peers: &Peers, envelope: &Envelope) {
        if let MissionMessage::Current { seq, .. } = envelope.message
            && peers.concerns(envelope)
        {
            self.reported = Some(seq);
        }
    }

    pub(super) fn tick(&mut self, now: f64) -> Vec<Action> {
        if now < self.until || self.tries_left == 0 {
            return Vec::new();
        }
        self.tries_left -= 1;
        self.until = now + ANSWER_S;
        vec![Action::Send(MissionMessage::SetCurrent { seq: 0 })]
    }

    /// How the upload of so many items ended, once that is known.
    pub(super) fn outcome(&self, items: usize) -> Option<Outcome> {
        if self.reported.is_some_and(|seq| seq <= self.first) {
            return Some(Outcome::Verified { items });
        }
        if self.tries_left > 0 {
            return None;
        }
        let current = match self.reported {
            Some(seq) => format!("its current item stays {seq} (MISSION_CURRENT)"),
            None => "it does not report its current item (MISSION_CURRENT)".to_owned(),
        };
        Some(Outcome::Unknown {
            on_vehicle: format!(
                "UNKNOWN START OF THE MISSION: the new one of {items} items is on the vehicle, read back and compared, but {current}, so that it may skip all items before"
            ),
            what_to_do: "Do not arm in or switch to the mission mode. Set the current item to the first one with a ground \
                         station, or upload again"
                .to_owned(),
        })
    }
}
