//! The verified upload: back up what is on the vehicle, upload, read back and compare; on any failure put the backup back
//! and verify that. It ends with a statement of what is on the vehicle, and after a link cut it takes up the
//! restoration where it was. It never arms, starts a mission or changes modes.

mod begin;
mod first_item;
mod outcome;
mod state;
mod words;

pub use outcome::Outcome;
pub use state::{Goal, Options, VehicleState};

use super::{Action, Clear, Download, Envelope, MissionMessage, Peers, TransferError, Upload, events};
use crate::compare::differences;
use crate::item::{Autopilot, Mission, MissionItem, MissionKind};
use first_item::FirstItem;
use words::summary;

/// Values of `MISSION_STATE`.
const MISSION_STATE_UNKNOWN: u8 = 0;
const MISSION_STATE_ACTIVE: u8 = 3;
/// So long after its acknowledgement PX4 may still reject a mission, s: its navigator checks it in the background.
const VERDICT_S: f64 = 3.0;
/// A link keeps an answer for so long at most, s: until then one to an earlier question may come, and speak of the list before.
const LATE_S: f64 = 2.0;
/// Attempts of a download once the user has given up.
const DOWNLOADS_WHEN_CANCELLED: u32 = 2;

/// What it is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reading what is on the vehicle.
    BackingUp,
    /// Sending the new mission.
    Uploading,
    /// Reading back after an upload or a failure.
    ReadingBack,
    /// Putting the backup back.
    Restoring,
    /// Over, or waiting for the link.
    Finished,
}

#[derive(Debug)]
enum Step {
    BackUp(Download),
    Upload(Upload),
    Clear {
        clear: Clear,
        restoring: bool,
    },
    /// Answers about the list before may still be on their way.
    AwaitLate,
    ReadBack(Download),
    /// The mission is there whole; PX4 may yet reject it.
    AwaitVerdict {
        until: f64,
    },
    /// The mission is there whole; its first item is to be the current one.
    FirstItem(FirstItem),
    Restore(Upload),
    Finished(Outcome),
}

/// The machine. Feed it with messages, times and the state of the vehicle; send what it returns.
#[derive(Debug)]
pub struct VerifiedUpload {
    peers: Peers,
    autopilot: Autopilot,
    options: Options,
    mission: Mission,
    backup: Option<Mission>,
    vehicle: Option<VehicleState>,
    /// Whether anything was sent that can change the mission on board.
    touched: bool,
    /// The new mission is not wanted any more.
    cancelled: bool,
    uploads_left: u32,
    restores_left: u32,
    downloads_left: u32,
    /// Why the new mission is not to be had; set with the first failure.
    why: Option<String>,
    /// Until when answers to questions of before the last change may come.
    late_until: f64,
    /// Until when PX4 may say that it rejects the mission it has accepted.
    verdict_until: f64,
    /// What it said.
    rejections: Vec<String>,
    step: Step,
}

impl VerifiedUpload {
    /// The mission that was on the vehicle before; write it to a file as soon as it is there.
    pub fn backup(&self) -> Option<&Mission> {
        self.backup.as_ref()
    }

    /// What it is doing.
    pub fn phase(&self) -> Phase {
        match &self.step {
            Step::BackUp(_) => Phase::BackingUp,
            Step::Upload(_) | Step::Clear { restoring: false, .. } => Phase::Uploading,
            Step::AwaitLate | Step::ReadBack(_) | Step::AwaitVerdict { .. } | Step::FirstItem(_) => {
                Phase::ReadingBack
            }
            Step::Restore(_) | Step::Clear { restoring: true, .. } => Phase::Restoring,
            Step::Finished(_) => Phase::Finished,
        }
    }

    /// What is on the vehicle, once that can be said.
    pub fn outcome(&self) -> Option<&Outcome> {
        match &self.step {
            Step::Finished(outcome) => Some(outcome),
            _ => None,
        }
    }

    /// When [`Self::tick`] wants to be called, s.
    pub fn deadline(&self) -> Option<f64> {
        match &self.step {
            Step::BackUp(d) | Step::ReadBack(d) => d.deadline(),
            Step::Upload(u) | Step::Restore(u) => u.deadline(),
            Step::Clear { clear, .. } => clear.deadline(),
            Step::AwaitLate => Some(self.late_until),
            Step::AwaitVerdict { until } => Some(*until),
            Step::FirstItem(first) => Some(first.deadline()),
            Step::Finished(_) => None,
        }
    }

    /// The vehicle's state changed.
    pub fn vehicle_state(&mut self, state: VehicleState) {
        self.vehicle = Some(state);
    }

    /// A message from anyone.
    pub fn receive(&mut self, now: f64, envelope: &Envelope) -> Vec<Action> {
        self.notice_state(envelope);
        self.notice_verdict(now, envelope);
        let actions = match &mut self.step {
            Step::BackUp(d) | Step::ReadBack(d) => d.receive(now, envelope),
            Step::Upload(u) | Step::Restore(u) => u.receive(now, envelope),
            Step::Clear { clear, .. } => clear.receive(now, envelope),
            Step::FirstItem(first) => {
                first.receive(&self.peers, envelope);
                Vec::new()
            }
            Step::AwaitLate | Step::AwaitVerdict { .. } => Vec::new(),
            Step::Finished(_) => return Vec::new(),
        };
        self.advance(now, actions)
    }

    /// Time passed.
    pub fn tick(&mut self, now: f64) -> Vec<Action> {
        let actions = match &mut self.step {
            Step::BackUp(d) | Step::ReadBack(d) => d.tick(now),
            Step::Upload(u) | Step::Restore(u) => u.tick(now),
            Step::Clear { clear, .. } => clear.tick(now),
            Step::FirstItem(first) => first.tick(now),
            Step::AwaitLate | Step::AwaitVerdict { .. } => Vec::new(),
            Step::Finished(_) => return Vec::new(),
        };
        self.advance(now, actions)
    }

    /// The user gives up: the previous mission is put back if anything was changed.
    pub fn cancel(&mut self, now: f64) -> Vec<Action> {
        self.cancelled = true;
        self.why.get_or_insert_with(|| "it was cancelled".to_owned());
        let actions = match &mut self.step {
            Step::BackUp(d) => d.cancel(),
            Step::Upload(u) => u.cancel(),
            // Checking and restoring go on: the vehicle must not be left with half a mission.
            _ => Vec::new(),
        };
        self.downloads_left = self.downloads_left.min(DOWNLOADS_WHEN_CANCELLED);
        self.advance(now, actions)
    }

    /// The link is back: an outcome of [`Outcome::Unknown`] is settled.
    pub fn link_restored(&mut self, now: f64) -> Vec<Action> {
        if !matches!(self.step, Step::Finished(Outcome::Unknown { .. })) || self.backup.is_none() {
            return Vec::new();
        }
        self.restores_left = self.options.restore_attempts;
        self.check(now)
    }

    /// `MISSION_CURRENT` says whether a mission is active, on autopilots that fill that field.
    fn notice_state(&mut self, envelope: &Envelope) {
        if let MissionMessage::Current { state, .. } = envelope.message
            && state != MISSION_STATE_UNKNOWN
            && self.peers.concerns(envelope)
            && let Some(vehicle) = &mut self.vehicle
        {
            vehicle.flying_mission = state == MISSION_STATE_ACTIVE;
        }
    }

    /// What PX4 says of the mission it has, or is about to have, accepted.
    fn notice_verdict(&mut self, now: f64, envelope: &Envelope) {
        let MissionMessage::Event { id, arguments } = &envelope.message else { return };
        let listening = match &self.step {
            Step::Upload(u) => u.all_served(),
            Step::AwaitLate | Step::ReadBack(_) | Step::AwaitVerdict { .. } => now < self.verdict_until,
            _ => false,
        };
        let about_mission = self.peers.kind == MissionKind::Mission;
        if listening
            && about_mission
            && self.peers.concerns(envelope)
            && let Some(words) = events::rejection(*id, arguments)
            && !self.rejections.contains(&words)
        {
            self.rejections.push(words);
        }
    }

    fn objection(&self) -> Option<String> {
        if self.options.even_while_flying {
            return None;
        }
        match self.vehicle {
            None => Some("nothing is known of the vehicle's mode yet (no heartbeat)".to_owned()),
            Some(state) => state.objection().map(str::to_owned),
        }
    }

    /// Goes on where a step has ended.
    fn advance(&mut self, now: f64, mut actions: Vec<Action>) -> Vec<Action> {
        if let Step::BackUp(d) | Step::ReadBack(d) = &self.step
            && d.result().is_some()
            && d.may_be_answered_late()
        {
            self.late_until = now + LATE_S;
        }
        let more = match &self.step {
            Step::BackUp(d) => match d.result() {
                None => Vec::new(),
                Some(Ok(got)) => {
                    self.backup = Some(self.read(&got.items));
                    self.begin_upload(now)
                }
                Some(Err(e)) => {
                    let e = e.clone();
                    self.back_up_failed(now, &e)
                }
            },
            Step::Upload(u) => match u.result().cloned() {
                None => Vec::new(),
                Some(result) => self.sent(now, result.map(drop)),
            },
            Step::Clear { clear, .. } => match clear.result().cloned() {
                None => Vec::new(),
                Some(result) => self.sent(now, result),
            },
            Step::Restore(u) => match u.result() {
                None => Vec::new(),
                // Whatever the vehicle says, what counts is what is on it.
                Some(_) => self.check(now),
            },
            Step::AwaitLate if now >= self.late_until => self.check(now),
            Step::AwaitLate => Vec::new(),
            Step::ReadBack(d) => match d.result() {
                None => Vec::new(),
                Some(Ok(got)) => {
                    let got = self.read(&got.items);
                    self.judge(now, &got)
                }
                Some(Err(e)) => {
                    let e = e.clone();
                    self.read_back_failed(now, &e)
                }
            },
            Step::AwaitVerdict { until } => {
                if now >= *until || !self.rejections.is_empty() || self.cancelled {
                    self.verdict_until = now;
                    // It was read back whole.
                    let got = self.mission.clone();
                    self.judge(now, &got)
                } else {
                    Vec::new()
                }
            }
            Step::FirstItem(_) if self.cancelled => {
                // It was read back whole.
                let got = self.mission.clone();
                self.judge(now, &got)
            }
            Step::FirstItem(first) => {
                if let Some(outcome) = first.outcome(self.mission.items.len()) {
                    self.step = Step::Finished(outcome);
                }
                Vec::new()
            }
            Step::Finished(_) => Vec::new(),
        };
        actions.extend(more);
        actions
    }

    fn read(&self, items: &[MissionItem]) -> Mission {
        Mission::from_wire_list(self.peers.kind, self.autopilot, items)
    }

    fn back_up_failed(&mut self, now: f64, e: &TransferError) -> Vec<Action> {
        self.downloads_left = self.downloads_left.saturating_sub(1);
        if self.downloads_left > 0 && e.is_transient() && !self.cancelled {
            let (download, actions) = Download::start(self.peers, now);
            self.step = Step::BackUp(download);
            return actions;
        }
        self.finish_untouched(format!("the {} on board could not be backed up first: {e}", self.peers.kind));
        Vec::new()
    }

    fn finish_untouched(&mut self, why: String) {
        self.step = Step::Finished(Outcome::RestoredPrevious { why });
    }

    fn begin_upload(&mut self, now: f64) -> Vec<Action> {
        if self.cancelled {
            self.finish_untouched("it was cancelled".to_owned());
            return Vec::new();
        }
        // The backup took a while: look again.
        if !self.touched
            && let Some(why) = self.objection()
        {
            self.finish_untouched(why);
            return Vec::new();
        }
        self.touched = true;
        self.uploads_left = self.uploads_left.saturating_sub(1);
        self.send(now, false)
    }

    /// Sends the new mission, or the backup.
    fn send(&mut self, now: f64, restoring: bool) -> Vec<Action> {
        let empty = Mission::default();
        let mission = if restoring { self.backup.as_ref().unwrap_or(&empty) } else { &self.mission };
        if mission.items.is_empty() {
            let (clear, actions) = Clear::start(self.peers, now);
            self.step = Step::Clear { clear, restoring };
            return actions;
        }
        let (upload, actions) =
            Upload::start(self.peers, mission.wire_list(self.peers.kind, self.autopilot), now);
        let refused_at_once = upload.result().is_some();
        self.step = if restoring { Step::Restore(upload) } else { Step::Upload(upload) };
        if refused_at_once { self.advance(now, actions) } else { actions }
    }

    /// The upload is over, well or not: see what is on board.
    fn sent(&mut self, now: f64, result: Result<(), TransferError>) -> Vec<Action> {
        match &result {
            Err(e) => {
                if !e.is_transient() {
                    self.uploads_left = 0;
                }
                let (kind, planned_for) = (self.peers.kind, self.options.planned_for);
                let why = words::failure(e, &self.mission, kind, self.autopilot, planned_for);
                self.why.get_or_insert(why);
            }
            Ok(()) if self.waits_for_verdict() => self.verdict_until = now + VERDICT_S,
            Ok(()) => {}
        }
        self.check(now)
    }

    /// ArduPilot says all it has to say of a mission with the acknowledgement, and an empty mission is not checked.
    fn waits_for_verdict(&self) -> bool {
        self.autopilot == Autopilot::Px4
            && self.peers.kind == MissionKind::Mission
            && !self.mission.items.is_empty()
            && !self.cancelled
    }

    /// Reads back what is on board, as soon as no answer can be one about the list before.
    fn check(&mut self, now: f64) -> Vec<Action> {
        if now < self.late_until {
            self.step = Step::AwaitLate;
            return Vec::new();
        }
        let all = self.options.download_attempts;
        self.downloads_left = if self.cancelled { all.min(DOWNLOADS_WHEN_CANCELLED) } else { all };
        self.read_back(now)
    }

    fn read_back(&mut self, now: f64) -> Vec<Action> {
        let (download, actions) = Download::start(self.peers, now);
        self.step = Step::ReadBack(download);
        actions
    }

    fn read_back_failed(&mut self, now: f64, e: &TransferError) -> Vec<Action> {
        self.downloads_left = self.downloads_left.saturating_sub(1);
        if self.downloads_left > 0 {
            return self.read_back(now);
        }
        self.stranded(&format!("it could not be read back: {e}"));
        Vec::new()
    }

    /// Compares what was read with both missions and decides.
    fn judge(&mut self, now: f64, got: &Mission) -> Vec<Action> {
        let backup = self.backup.clone().unwrap_or_default();
        let wrong = differences(self.autopilot, &self.mission, got);
        if !self.rejections.is_empty() {
            let said = self.rejections.join("; ");
            let why = format!("the vehicle accepted it and then rejected it: {said}");
            self.why.get_or_insert(why);
            self.uploads_left = 0;
        } else if wrong.is_empty() && !self.cancelled && now < self.verdict_until {
            self.step = Step::AwaitVerdict { until: self.verdict_until };
            return Vec::new();
        } else if wrong.is_empty() && !self.cancelled {
            return self.begin_at_first(now);
        }
        let previous = differences(self.autopilot, &backup, got).is_empty();
        let why = self
            .why
            .clone()
            .unwrap_or_else(|| format!("what was read back is not what was sent ({})", summary(&wrong)));
        self.why = Some(why.clone());
        if self.uploads_left > 0 && !self.cancelled && self.vehicle_allows() {
            return self.begin_upload(now);
        }
        if previous {
            self.finish_untouched(why);
            return Vec::new();
        }
        if self.restores_left == 0 {
            let on_board = format!(
                "{} items were read back that are neither mission ({})",
                got.items.len(),
                summary(&differences(self.autopilot, &backup, got))
            );
            self.stranded(&on_board);
            return Vec::new();
        }
        self.restores_left -= 1;
        self.send(now, true)
    }

    /// The mission is on board as it was sent. A vehicle that flies, or of which nothing is known, keeps the index that it has.
    fn begin_at_first(&mut self, now: f64) -> Vec<Action> {
        let free = self.vehicle.is_some_and(|v| v.objection().is_none());
        if self.peers.kind != MissionKind::Mission || self.mission.items.is_empty() || !free {
            self.step = Step::Finished(Outcome::Verified { items: self.mission.items.len() });
            return Vec::new();
        }
        let (first, actions) = FirstItem::start(self.mission.first_index(self.autopilot), now);
        self.step = Step::FirstItem(first);
        actions
    }

    /// A second attempt is held back when the vehicle has started to fly.
    fn vehicle_allows(&self) -> bool {
        self.objection().is_none()
    }

    fn stranded(&mut self, detail: &str) {
        let (new, old) = (self.mission.items.len(), self.backup.as_ref().map_or(0, |b| b.items.len()));
        let on_vehicle = format!(
            "UNKNOWN {} ON THE VEHICLE: it may hold the new one ({new} items), the previous one ({old} items) \
             or a mixture of both; {detail}",
            self.peers.kind.to_string().to_uppercase()
        );
        let what_to_do =
            "Do not arm in or switch to the mission mode. Restore the link: the previous state is then \
             put back by itself; or upload again and read it back before flying it"
                .to_owned();
        self.step = Step::Finished(Outcome::Unknown { on_vehicle, what_to_do });
    }
}
