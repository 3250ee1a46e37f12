//! Reference vehicles: the mission protocol as ArduPilot and PX4 speak it (FIELD_NOTES), faults included.

use super::*;

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
}

fn rounded(mut item: MissionItem) -> MissionItem {
    if item.command == command::NAV_LOITER_TURNS {
        let radius = item.params[2];
        item.params[0] = item.params[0].trunc().min(255.0);
        item.params[2] = if radius.abs() > 255.0 { (radius / 10.0).trunc() * 10.0 } else { radius.trunc() };
    }
    item.params = item.params.map(|p| if p.is_nan() { 0.0 } else { p });
    item.frame = if item.frame.is_global() { crate::item::Frame(3) } else { crate::item::Frame(0) };
    item.z = (item.z * 100.0).trunc() / 100.0;
    item
}

fn ack(result: MissionResult) -> MissionMessage {
    MissionMessage::Ack { result, mission_type: 0, opaque_id: 0 }
}

impl Vehicle {
    pub fn new(autopilot: Autopilot, mut stored: Vec<MissionItem>) -> Self {
        if autopilot == Autopilot::ArduPilot {
            stored = stored.into_iter().map(rounded).collect();
            // Its own home, whatever was uploaded.
            stored[0].x = 470_000_000;
        }
        Self { autopilot, stored, receiving: None, sending: None, last_completed: None, counts_received: 0 }
    }

    pub fn stored(&self) -> &[MissionItem] {
        &self.stored
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
    }

    pub fn tick(&mut self, now: f64) -> Vec<MissionMessage> {
        let (re_ask, give_up) = (self.re_ask_s(), self.give_up_s());
        let Some(r) = &mut self.receiving else { return Vec::new() };
        if now >= r.heard_at + give_up {
            self.receiving = None;
            return match self.autopilot {
                Autopilot::ArduPilot => vec![ack(MissionResult::OPERATION_CANCELLED)],
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
            Autopilot::ArduPilot => MissionMessage::Request { seq, mission_type: 0 },
            Autopilot::Px4 => MissionMessage::RequestInt { seq, mission_type: 0 },
        }
    }

    pub fn receive(&mut self, now: f64, message: &MissionMessage) -> Vec<MissionMessage> {
        match message {
            MissionMessage::Count { count, .. } => self.count(now, *count),
            MissionMessage::ItemInt { seq, item, .. } => self.item(now, *seq, item),
            MissionMessage::RequestList { .. } if self.receiving.is_some() => {
                vec![ack(MissionResult::DENIED)]
            }
            MissionMessage::RequestList { .. } => {
                self.sending = Some(0);
                vec![MissionMessage::Count { count: self.stored.len() as u16, mission_type: 0, opaque_id: 7 }]
            }
            MissionMessage::RequestInt { seq, .. } => self.requested(*seq),
            MissionMessage::ClearAll { .. } => {
                let keep = usize::from(self.autopilot == Autopilot::ArduPilot);
                self.stored.truncate(keep);
                self.receiving = None;
                vec![ack(MissionResult::ACCEPTED)]
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
            return if r.next == 0 { vec![self.ask(now)] } else { vec![ack(MissionResult::ERROR)] };
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
                Autopilot::ArduPilot => vec![ack(MissionResult::ERROR)],
                // The last ack was lost: again.
                Autopilot::Px4 if self.last_completed == Some(seq) => vec![ack(MissionResult::ACCEPTED)],
                Autopilot::Px4 => Vec::new(),
            };
        };
        if seq != r.next {
            return match autopilot {
                Autopilot::ArduPilot => vec![ack(MissionResult::INVALID_SEQUENCE)],
                Autopilot::Px4 => Vec::new(),
            };
        }
        if item.command == UNKNOWN_COMMAND {
            self.receiving = None;
            return vec![ack(MissionResult::UNSUPPORTED)];
        }
        r.heard_at = now;
        r.next += 1;
        let complete = r.next == r.count;
        match autopilot {
            // In place, item by item; home is its own.
            Autopilot::ArduPilot => match self.stored.get_mut(usize::from(seq)) {
                Some(_) if seq == 0 => {}
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
        self.last_completed = Some(seq);
        vec![ack(MissionResult::ACCEPTED)]
    }

    fn requested(&mut self, seq: u16) -> Vec<MissionMessage> {
        let Some(item) = self.stored.get(usize::from(seq)).copied() else {
            return vec![ack(MissionResult::INVALID_SEQUENCE)];
        };
        if self.autopilot == Autopilot::Px4 {
            // Only the next item or the one before it: anything else ends the transfer.
            match self.sending {
                Some(next) if seq == next => self.sending = Some(next + 1),
                Some(next) if seq + 1 == next => {}
                Some(_) => {
                    self.sending = None;
                    return vec![ack(MissionResult::ERROR)];
                }
                None => return Vec::new(),
            }
        }
        vec![MissionMessage::ItemInt { seq, current: false, item, mission_type: 0 }]
    }
}
