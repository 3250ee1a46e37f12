//! Reference vehicles: the mission protocol as ArduPilot and PX4 speak it (FIELD_NOTES), faults included.

use super::*;
use crate::item::MissionKind;

/// A command that no vehicle here knows.
pub const UNKNOWN_COMMAND: u16 = 31_999;

struct Receiving {
    count: u16,
    next: u16,
    asked_at: f64,
    heard_at: f64,
    staging: Vec<MissionItem>,
}

pub struct Vehicle {
    autopilot: Autopilot,
    stored: Vec<MissionItem>,
    receiving: Option<Receiving>,
    /// PX4: the item a download may ask for next.
    sending: Option<u16>,
    last_completed: Option<u16>,
    pub counts_received: u32,
    /// PX4: what its navigator says of a mission after it was accepted, and how much later, s.
    pub verdict: Option<(f64, MissionMessage)>,
    /// Asks for item 0 for ever.
    pub stuck: bool,
    verdict_at: Option<f64>,
    /// The index of the current item; it stays across an upload.
    pub current: u16,
    /// Takes no other index.
    pub stubborn: bool,
    /// The list it talks about.
    kind: MissionKind,
}

fn rounded(mut item: MissionItem) -> MissionItem {
    if item.command == command::NAV_LOITER_TURNS {
        let radius = item.params[2];
        item.params[0] = item.params[0].trunc().min(255.0);
        item.params[2] = if radius.abs() > 255.0 { (radius / 10.0).trunc() * 10.0 } else { radius.trunc() };
    }
    if item.command == command::NAV_WAYPOINT {
        item.params[3] = 0.0;
    }
    item.frame = if item.frame.is_global() { crate::item::Frame(3) } else { crate::item::Frame(0) };
    item.z = (item.z * 100.0).trunc() / 100.0;
    item
}

/// The parameter that ArduPilot refuses (AP_Mission.cpp, `sanity_check_params`): NaN only in parameter 4 of a waypoint, a take-off or a landing,
/// no infinities.
fn refused_parameter(item: &MissionItem) -> Option<u8> {
    let may_be_nan = [command::NAV_WAYPOINT, command::NAV_TAKEOFF, command::NAV_LAND].contains(&item.command);
    let refused = |k: usize, p: f32| p.is_infinite() || (p.is_nan() && !(k == 3 && may_be_nan));
    item.params.iter().enumerate().find(|(k, p)| refused(*k, **p)).map(|(k, _)| k as u8)
}

fn of_kind(kind: MissionKind, result: MissionResult) -> MissionMessage {
    MissionMessage::Ack { result, mission_type: kind.number(), opaque_id: 0 }
}

impl Vehicle {
    pub fn new(autopilot: Autopilot, mut stored: Vec<MissionItem>) -> Self {
        if autopilot == Autopilot::ArduPilot {
            stored = stored.into_iter().map(rounded).collect();
            // Its own home, whatever was uploaded.
            stored[0].x = 470_000_000;
        }
        Self {
            autopilot,
            stored,
            receiving: None,
            sending: None,
            last_completed: None,
            counts_received: 0,
            verdict: None,
            stuck: false,
            verdict_at: None,
            current: 11,
            stubborn: false,
            kind: MissionKind::Mission,
        }
    }

    /// One that is asked about its fence.
    pub fn with_fence(autopilot: Autopilot, stored: Vec<MissionItem>) -> Self {
        Self {
            kind: MissionKind::Fence,
            stored,
            ..Self::new(autopilot, vec![MissionItem::action(0, [0.0; 4])])
        }
    }

    pub fn stored(&self) -> &[MissionItem] {
        &self.stored
    }

    /// Another station's mission.
    pub fn replace_stored(&mut self, stored: Vec<MissionItem>) {
        self.stored = Self::new(self.autopilot, stored).stored;
    }

    fn re_ask_s(&self) -> f64 {
        if self.autopilot == Autopilot::ArduPilot { 1.0 } else { 0.25 }
    }

    fn give_up_s(&self) -> f64 {
        if self.autopilot == Autopilot::ArduPilot { 8.0 } else { 5.0 }
    }

    pub fn deadline(&self) -> f64 {
        self.receiving
            .as_ref()
            .map_or(f64::INFINITY, |r| (r.asked_at + self.re_ask_s()).min(r.heard_at + self.give_up_s()))
            .min(self.verdict_at.unwrap_or(f64::INFINITY))
    }

    pub fn tick(&mut self, now: f64) -> Vec<MissionMessage> {
        let (re_ask, give_up) = (self.re_ask_s(), self.give_up_s());
        if self.verdict_at.is_some_and(|t| now >= t) {
            self.verdict_at = None;
            // Said once: the mission that is put back passes.
            return self.verdict.take().map(|(_, event)| event).into_iter().collect();
        }
        let Some(r) = &mut self.receiving else { return Vec::new() };
        if now >= r.heard_at + give_up {
            self.receiving = None;
            return match self.autopilot {
                Autopilot::ArduPilot => vec![of_kind(self.kind, MissionResult::OPERATION_CANCELLED)],
                Autopilot::Px4 => Vec::new(),
            };
        }
        if now >= r.asked_at + re_ask { vec![self.ask(now)] } else { Vec::new() }
    }

    fn ask(&mut self, now: f64) -> MissionMessage {
        let seq = self.receiving.as_mut().map_or(0, |r| {
            r.asked_at = now;
            r.next
        });
        match self.autopilot {
            Autopilot::ArduPilot => MissionMessage::Request { seq, mission_type: self.kind.number() },
            Autopilot::Px4 => MissionMessage::RequestInt { seq, mission_type: self.kind.number() },
        }
    }

    pub fn receive(&mut self, now: f64, message: &MissionMessage) -> Vec<MissionMessage> {
        match message {
            MissionMessage::Count { count, .. } => self.count(now, *count),
            MissionMessage::ItemInt { seq, item, .. } => self.item(now, *seq, item),
            MissionMessage::RequestList { .. } if self.receiving.is_some() => {
                vec![of_kind(self.kind, MissionResult::DENIED)]
            }
            MissionMessage::RequestList { .. } => {
                self.sending = Some(0);
                vec![MissionMessage::Count {
                    count: self.stored.len() as u16,
                    mission_type: self.kind.number(),
                    opaque_id: 7,
                }]
            }
            MissionMessage::RequestInt { seq, .. } => self.requested(*seq),
            MissionMessage::ClearAll { .. } => {
                let has_home = self.autopilot == Autopilot::ArduPilot && self.kind == MissionKind::Mission;
                let keep = usize::from(has_home);
                self.stored.truncate(keep);
                self.receiving = None;
                vec![of_kind(self.kind, MissionResult::ACCEPTED)]
            }
            MissionMessage::SetCurrent { seq } if self.receiving.is_none() => {
                if !self.stubborn {
                    self.current = *seq;
                }
                vec![MissionMessage::Current { seq: self.current, total: 0, state: 0, mission_id: 0 }]
            }
            MissionMessage::Ack { result, .. } if *result == MissionResult::OPERATION_CANCELLED => {
                self.receiving = None;
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    fn count(&mut self, now: f64, count: u16) -> Vec<MissionMessage> {
        self.counts_received += 1;
        if self.autopilot == Autopilot::Px4
            && let Some(r) = &self.receiving
        {
            return if r.next == 0 {
                vec![self.ask(now)]
            } else {
                vec![of_kind(self.kind, MissionResult::ERROR)]
            };
        }
        if self.autopilot == Autopilot::ArduPilot {
            self.stored.truncate(usize::from(count));
        }
        self.sending = None;
        self.receiving =
            Some(Receiving { count, next: 0, asked_at: now, heard_at: now, staging: Vec::new() });
        vec![self.ask(now)]
    }

    fn item(&mut self, now: f64, seq: u16, item: &MissionItem) -> Vec<MissionMessage> {
        let autopilot = self.autopilot;
        let Some(r) = &mut self.receiving else {
            return match autopilot {
                Autopilot::ArduPilot => vec![of_kind(self.kind, MissionResult::ERROR)],
                // The last ack was lost: again.
                Autopilot::Px4 if self.last_completed == Some(seq) => {
                    vec![of_kind(self.kind, MissionResult::ACCEPTED)]
                }
                Autopilot::Px4 => Vec::new(),
            };
        };
        if seq != r.next {
            return match autopilot {
                Autopilot::ArduPilot => vec![of_kind(self.kind, MissionResult::INVALID_SEQUENCE)],
                Autopilot::Px4 => Vec::new(),
            };
        }
        r.heard_at = now;
        if self.stuck {
            return vec![self.ask(now)];
        }
        if item.command == UNKNOWN_COMMAND {
            self.receiving = None;
            return vec![of_kind(self.kind, MissionResult::UNSUPPORTED)];
        }
        if autopilot == Autopilot::ArduPilot
            && let Some(parameter) = refused_parameter(item)
        {
            self.receiving = None;
            return vec![of_kind(self.kind, MissionResult(MissionResult::INVALID_PARAM1.0 + parameter))];
        }
        r.next += 1;
        let complete = r.next == r.count;
        match autopilot {
            // In place, item by item; home is its own.
            Autopilot::ArduPilot => match self.stored.get_mut(usize::from(seq)) {
                Some(_) if seq == 0 && self.kind == MissionKind::Mission => {}
                Some(slot) => *slot = rounded(*item),
                None => self.stored.push(rounded(*item)),
            },
            Autopilot::Px4 => r.staging.push(*item),
        }
        if !complete {
            return vec![self.ask(now)];
        }
        if autopilot == Autopilot::Px4 {
            self.stored = std::mem::take(&mut r.staging);
        }
        self.receiving = None;
        self.verdict_at = self.verdict.as_ref().map(|(after, _)| now + after);
        self.last_completed = Some(seq);
        vec![of_kind(self.kind, MissionResult::ACCEPTED)]
    }

    fn requested(&mut self, seq: u16) -> Vec<MissionMessage> {
        let Some(item) = self.stored.get(usize::from(seq)).copied() else {
            return vec![of_kind(self.kind, MissionResult::INVALID_SEQUENCE)];
        };
        if self.autopilot == Autopilot::Px4 {
            // Only the next item or the one before it: anything else ends the transfer.
            match self.sending {
                Some(next) if seq == next => self.sending = Some(next + 1),
                Some(next) if seq + 1 == next => {}
                Some(_) => {
                    self.sending = None;
                    return vec![of_kind(self.kind, MissionResult::ERROR)];
                }
                None => return Vec::new(),
            }
        }
        vec![MissionMessage::ItemInt { seq, current: false, item, mission_type: self.kind.number() }]
    }
}
