//! The verified upload: back up what is on the vehicle, upload, read back and compare; on any failure put the backup back
//! and verify that. What was verified is read once more after a short quiet, since another station may have sent a mission meanwhile.
//! A vehicle that is armed, or put into its mission mode, on the way gets nothing more. It ends with a statement of what is on the vehicle, and after a link cut it takes up the
//! restoration where it was. It never arms, starts a mission or changes modes.

mod begin;
mod first_item;
mod judge;
mod outcome;
mod state;
mod watch;
mod words;

pub use crate::change::VehicleState;
pub use outcome::Outcome;
pub use state::{Goal, Options};

use super::{Action, Address, Clear, Download, Envelope, Peers, TransferError, Upload};
use crate::change::{Exchange, Phase, VerifiedChange};
use crate::item::{Autopilot, Mission, MissionItem, MissionKind};
use first_item::FirstItem;

/// So long after its acknowledgement PX4 may still reject a mission, s: its navigator checks it in the background.
const VERDICT_S: f64 = 3.0;
/// A link keeps an answer for so long at most, s: until then one to an earlier question may come, and speak of the list before.
const LATE_S: f64 = 2.0;
/// Silence of other stations after which what is on board is read for the last time, s: another upload repeats its opening every 1.5 s
/// ([`Timing::first_reply_s`](super::Timing)), so one that waited for the end of this one has begun by then.
const QUIET_S: f64 = 2.0;
/// Other stations are waited for so long at most, s.
const LONGEST_QUIET_S: f64 = 30.0;
/// Attempts of a download once the user has given up.
const DOWNLOADS_WHEN_CANCELLED: u32 = 2;

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
    /// Another station may be sending a mission.
    Quiet {
        until: f64,
        at_most: f64,
    },
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
    /// Whether the motors were armed when the first item went out.
    armed_before: bool,
    /// Another station to which the vehicle spoke of a mission since the upload began.
    others: Option<(Address, f64)>,
    /// Whether the vehicle was told to begin at the first item.
    begun_at_first: bool,
    /// How often what was verified was read again.
    confirmed: u32,
    /// It is not certain any more that this is the vehicle: nothing is ever sent again.
    abandoned: bool,
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
    /// How often it waits for other stations.
    quiets_left: u32,
    step: Step,
}

impl Exchange for VerifiedUpload {
    type Action = Action;
    type Message = Envelope;

    fn deadline(&self) -> Option<f64> {
        match &self.step {
            Step::BackUp(d) | Step::ReadBack(d) => d.deadline(),
            Step::Upload(u) | Step::Restore(u) => u.deadline(),
            Step::Clear { clear, .. } => clear.deadline(),
            Step::AwaitLate => Some(self.late_until),
            Step::AwaitVerdict { until } | Step::Quiet { until, .. } => Some(*until),
            Step::FirstItem(first) => Some(first.deadline()),
            Step::Finished(_) => None,
        }
    }

    fn receive(&mut self, now: f64, envelope: &Envelope) -> Vec<Action> {
        self.notice_state(envelope);
        self.notice_verdict(now, envelope);
        self.notice_others(now, envelope);
        let interrupted = self.interrupt(now);
        if !interrupted.is_empty() {
            return interrupted;
        }
        let actions = match &mut self.step {
            Step::BackUp(d) | Step::ReadBack(d) => d.receive(now, envelope),
            Step::Upload(u) | Step::Restore(u) => u.receive(now, envelope),
            Step::Clear { clear, .. } => clear.receive(now, envelope),
            Step::FirstItem(first) => {
                first.receive(&self.peers, envelope);
                Vec::new()
            }
            Step::AwaitLate | Step::AwaitVerdict { .. } | Step::Quiet { .. } => Vec::new(),
            Step::Finished(_) => return Vec::new(),
        };
        self.advance(now, actions)
    }

    fn tick(&mut self, now: f64) -> Vec<Action> {
        let actions = match &mut self.step {
            Step::BackUp(d) | Step::ReadBack(d) => d.tick(now),
            Step::Upload(u) | Step::Restore(u) => u.tick(now),
            Step::Clear { clear, .. } => clear.tick(now),
            Step::FirstItem(first) => first.tick(now),
            Step::AwaitLate | Step::AwaitVerdict { .. } | Step::Quiet { .. } => Vec::new(),
            Step::Finished(_) => return Vec::new(),
        };
        self.advance(now, actions)
    }
}

impl VerifiedChange for VerifiedUpload {
    type Outcome = Outcome;
    type Backup = Mission;

    fn is_open(outcome: &Outcome) -> bool {
        matches!(outcome, Outcome::Unknown { .. })
    }

    fn untouched(why: String) -> Outcome {
        Outcome::RestoredPrevious { why }
    }

    fn backup(&self) -> Option<&Mission> {
        self.backup.as_ref()
    }

    fn phase(&self) -> Phase {
        match &self.step {
            Step::BackUp(_) => Phase::BackingUp,
            Step::Upload(_) | Step::Clear { restoring: false, .. } => Phase::Sending,
            Step::AwaitLate
            | Step::ReadBack(_)
            | Step::AwaitVerdict { .. }
            | Step::FirstItem(_)
            | Step::Quiet { .. } => Phase::ReadingBack,
            Step::Restore(_) | Step::Clear { restoring: true, .. } => Phase::Restoring,
            Step::Finished(_) => Phase::Finished,
        }
    }

    fn outcome(&self) -> Option<&Outcome> {
        match &self.step {
            Step::Finished(outcome) => Some(outcome),
            _ => None,
        }
    }

    fn vehicle_state(&mut self, now: f64, state: VehicleState) -> Vec<Action> {
        self.vehicle = Some(state);
        self.interrupt(now)
    }

    fn cancel(&mut self, now: f64, why: &str) -> Vec<Action> {
        self.cancelled = true;
        self.why.get_or_insert_with(|| why.to_owned());
        let actions = match &mut self.step {
            Step::BackUp(d) => d.cancel(),
            Step::Upload(u) => u.cancel(),
            // Checking and restoring go on: the vehicle must not be left with half a mission.
            _ => Vec::new(),
        };
        self.downloads_left = self.downloads_left.min(DOWNLOADS_WHEN_CANCELLED);
        self.advance(now, actions)
    }

    fn abandon(&mut self, why: &str) {
        self.abandoned = true;
        match (&self.step, self.touched) {
            (Step::Finished(outcome), _) if !matches!(outcome, Outcome::Unknown { .. }) => {}
            (_, false) => self.finish_untouched(why.to_owned()),
            (_, true) => self.stranded(why, words::ABANDONED),
        }
    }

    fn link_restored(&mut self, now: f64) -> Vec<Action> {
        let open = matches!(self.step, Step::Finished(Outcome::Unknown { .. })) && self.backup.is_some();
        if !open || self.abandoned || !self.vehicle_allows() {
            return Vec::new();
        }
        self.restores_left = self.options.restore_attempts;
        self.check(now)
    }
}

impl VerifiedUpload {
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
            Step::FirstItem(first) => match first.outcome(self.mission.items.len()) {
                None => Vec::new(),
                Some(Outcome::Verified { .. }) => self.all_there(now),
                Some(other) => {
                    self.begun_at_first = false;
                    self.step = Step::Finished(other);
                    Vec::new()
                }
            },
            Step::Quiet { until, .. } if now >= *until || self.cancelled => self.check(now),
            Step::Quiet { .. } => Vec::new(),
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
            let why = self.why.clone().unwrap_or_default();
            self.finish_untouched(why);
            return Vec::new();
        }
        // The backup took a while: look again.
        if !self.touched
            && let Some(why) = self.objection()
        {
            self.finish_untouched(why);
            return Vec::new();
        }
        if !std::mem::replace(&mut self.touched, true) {
            self.armed_before = self.vehicle.is_some_and(|v| v.armed);
        }
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
        if self.confirmed > 0 {
            // It was read back whole before.
            self.step = Step::Finished(Outcome::Verified { items: self.mission.items.len() });
            return Vec::new();
        }
        self.stranded(&format!("it could not be read back: {e}"), words::LINK);
        Vec::new()
    }
}
