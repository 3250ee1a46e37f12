//! That a transfer stays with the vehicle that it was begun with: one hardware, one type, heard from one place. A pure machine; frames with
//! their origin in, doubts and contradictions out.

use super::vehicle::{Vehicle, type_words};
use crate::link::endpoint::Origin;
use crate::link::frame::Frame;
use gaware_mission::identity::Uid;
use gaware_mission::transfer::Address;

const AUTOPILOT_VERSION: u32 = 148;
/// A vehicle that was silent for longer, s, may have been exchanged: heartbeats come once a second.
const SILENCE_S: f64 = 5.0;
/// Between two requests for the hardware id, s.
const ASK_EVERY_S: f64 = 0.7;

/// Why a transfer must not go on as it was begun.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Conflict {
    /// In a sentence.
    pub words: String,
    /// Whether the vehicle that was meant can still be spoken to alone.
    pub separable: bool,
}

/// The vehicle of a transfer.
#[derive(Debug, Clone)]
pub struct Pin {
    vehicle: Vehicle,
    origin: Origin,
    heard_s: f64,
    /// It was silent, and has not given its hardware id since.
    in_doubt: bool,
    /// Another place that the same id was heard from.
    rival: Option<Origin>,
    ask_at_s: f64,
    conflict: Option<Conflict>,
    /// A conflict was found: no second one is reported.
    contradicted: bool,
    /// Who answers is not certain any more: nothing may be sent.
    lost: bool,
}

impl Pin {
    /// To the vehicle of this heartbeat, which came from there.
    pub fn new(vehicle: Vehicle, origin: Origin, now_s: f64) -> Self {
        Self {
            vehicle,
            origin,
            heard_s: now_s,
            in_doubt: false,
            rival: None,
            ask_at_s: now_s,
            conflict: None,
            contradicted: false,
            lost: false,
        }
    }

    /// As its last heartbeat reports.
    pub fn vehicle(&self) -> Vehicle {
        self.vehicle
    }

    /// Where it is spoken to.
    pub fn origin(&self) -> Origin {
        self.origin
    }

    /// Whether anything may be sent to it.
    pub fn may_send(&self) -> bool {
        !self.lost && !self.in_doubt
    }

    /// A contradiction that was found, once.
    pub fn take_conflict(&mut self) -> Option<Conflict> {
        self.conflict.take()
    }

    /// Where the hardware id is to be asked for now, if anywhere.
    pub fn ask(&mut self, now_s: f64) -> Option<Origin> {
        let silent = now_s - self.heard_s > SILENCE_S;
        let to = if self.in_doubt { Some(self.origin) } else { self.rival.filter(|_| silent) };
        if self.contradicted || now_s < self.ask_at_s {
            return None;
        }
        if to.is_some() {
            self.ask_at_s = now_s + ASK_EVERY_S;
        }
        to
    }

    /// Takes a frame; whether the transfer may see it.
    pub fn take(&mut self, now_s: f64, origin: Origin, frame: &Frame) -> bool {
        if !self.vehicle.sent(frame) {
            return true;
        }
        if origin != self.origin {
            return self.is_from_elsewhere(now_s, origin, frame);
        }
        if now_s - self.heard_s > SILENCE_S {
            self.in_doubt = self.vehicle.uid.is_some();
        }
        self.heard_s = now_s;
        if let Some(rival) = self.rival.take() {
            self.contradict(two_places(self.vehicle.address, self.origin, rival), true);
        }
        if frame.message_id == AUTOPILOT_VERSION {
            self.identified(Uid::from_version(frame.payload()));
        }
        if let Some(seen) = Vehicle::from_heartbeat(frame) {
            self.compare(seen);
        }
        self.may_send()
    }

    /// The same system id from another place: a second vehicle, or this one after its port has changed.
    fn is_from_elsewhere(&mut self, now_s: f64, origin: Origin, frame: &Frame) -> bool {
        self.rival = Some(origin);
        if now_s - self.heard_s <= SILENCE_S || frame.message_id != AUTOPILOT_VERSION {
            return false;
        }
        match (self.vehicle.uid, Uid::from_version(frame.payload())) {
            (Some(meant), Some(seen)) if meant == seen => {
                (self.origin, self.heard_s, self.rival) = (origin, now_s, None);
                self.in_doubt = false;
                return !self.lost;
            }
            (_, seen) => {
                let words = format!(
                    "another vehicle answers as system {} from {origin}{}; {} is silent",
                    self.vehicle.address.system,
                    with_id(seen),
                    self.vehicle
                );
                self.contradict(words, true);
            }
        }
        false
    }

    fn identified(&mut self, seen: Option<Uid>) {
        let system = self.vehicle.address.system;
        match (self.vehicle.uid, seen) {
            (Some(meant), Some(seen)) if meant != seen && self.in_doubt => {
                let words = format!(
                    "another vehicle is on the link now: system {system} has hardware id {seen} and had {meant}"
                );
                self.contradict(words, false);
            }
            (Some(meant), Some(seen)) if meant != seen => {
                let words = format!(
                    "two vehicles answer as system {system}, with hardware ids {meant} and {seen}; {ONE_ALONE}"
                );
                self.contradict(words, false);
            }
            (Some(meant), None) => {
                let words = format!("system {system} gives no hardware id now and had {meant}");
                self.contradict(words, false);
            }
            (_, seen) => {
                self.vehicle.uid = seen;
                self.in_doubt = false;
            }
        }
    }

    /// Its state changes, its firmware and its type do not.
    fn compare(&mut self, seen: Vehicle) {
        let was = self.vehicle;
        if (was.autopilot, was.mav_type) == (seen.autopilot, seen.mav_type) {
            self.vehicle.state = seen.state;
            return;
        }
        let words = format!(
            "system {} is a {} ({}) now and was a {} ({}): two vehicles have this id, or it was exchanged; {ONE_ALONE}",
            was.address.system,
            type_words(seen.mav_type),
            seen.autopilot,
            type_words(was.mav_type),
            was.autopilot
        );
        self.contradict(words, false);
    }

    fn contradict(&mut self, words: String, separable: bool) {
        let first = if separable { !self.contradicted } else { !self.lost };
        self.contradicted = true;
        self.lost |= !separable;
        if first {
            self.conflict = Some(Conflict { words, separable });
        }
    }
}

/// What to do about two vehicles of one id.
const ONE_ALONE: &str = "give them different ids, or connect to one of them alone";

fn with_id(uid: Option<Uid>) -> String {
    uid.map_or_else(|| " and gives no hardware id".to_owned(), |uid| format!(" with hardware id {uid}"))
}

/// That one id is heard from two places.
pub fn two_places(address: Address, one: Origin, other: Origin) -> String {
    format!(
        "system {} is heard from two places, {one} and {other}: two vehicles have the same system id; {ONE_ALONE}",
        address.system
    )
}

#[cfg(test)]
mod tests;
