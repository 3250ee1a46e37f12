//! The verified upload over any link: sockets of its own, the links of a run, or virtual time.

use super::codec;
use super::vehicle::Vehicle;
use crate::link::frame::Frame;
use gaware_mission::identity::Identity;
use gaware_mission::item::{Mission, MissionKind};
use gaware_mission::transfer::verified::{Goal, Options, Outcome, Phase, VehicleState, VerifiedUpload};
use gaware_mission::transfer::{Action, Address, Download, Downloaded, Peers, TransferError};
use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// Downloads are tried this often.
const DOWNLOADS: u32 = 6;
/// Repetitions of a question about a list that not every vehicle has.
const RETRIES_OF_OTHER_LISTS: u32 = 2;

/// What the pre-flight check had to say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Checked {
    /// To be looked at.
    pub warnings: Vec<String>,
    /// What would have stopped the upload.
    pub overridden: Vec<String>,
}

/// What a change reports on its way.
#[derive(Debug, Clone, PartialEq)]
pub enum News<P = Phase> {
    /// A new phase began.
    Phase(P),
    /// The vehicle was looked at; nothing is changed yet.
    Checked(Checked),
    /// To be said to the user.
    Said(String),
    /// Items done, of all.
    Progress(usize, usize),
    /// It is not known what is on the vehicle; waiting for the link, or for the vehicle to disarm.
    Stranded(String),
}

/// What a wait ended with.
#[derive(Debug)]
pub enum Event {
    /// A frame came.
    Frame(Frame),
    /// Its time is over.
    Deadline,
    /// What was begun is not to go on, for this reason: the user wants to stop, or a second vehicle has the same ids.
    Stopped(String),
    /// Who answers is not certain any more: nothing is sent from now on.
    Abandoned(String),
}

/// A link to one vehicle.
pub trait Wire {
    /// The vehicle as its last heartbeat reports.
    fn vehicle(&self) -> Vehicle;
    /// Who that is, with its home where that is known.
    fn identity(&self) -> Identity {
        self.vehicle().identity()
    }
    /// Who talks to whom.
    fn peers(&self) -> Peers;
    /// Any monotonic time, s.
    fn now_s(&self) -> f64;
    /// Sends a message by its id and payload.
    fn send_payload(&mut self, id: u32, payload: Vec<u8>);
    /// Sends what is to be sent among these.
    fn send(&mut self, actions: &[Action]) {
        for action in actions {
            if let Action::Send(message) = action {
                let (id, payload) = codec::encode(self.vehicle().address, message);
                self.send_payload(id, payload);
            }
        }
    }
    /// The next frame, the deadline (or a short while without one), or the wish to stop. Keeps [`Self::vehicle`] up to date.
    fn next(&mut self, deadline_s: Option<f64>) -> impl Future<Output = Event> + Send;
}

/// Uploads, reads back, and restores on failure. `keep` gets the mission that was on board before anything is
/// changed; if it cannot keep it, nothing is. After a loss of the link the restoration goes on when the vehicle is
/// received from again within `patience_s`.
pub async fn upload(
    wire: &mut impl Wire,
    mission: Mission,
    options: Options,
    patience_s: f64,
    keep: impl FnMut(&Mission) -> Result<(), String>,
    tell: impl FnMut(News),
) -> Outcome {
    let vehicle = wire.vehicle();
    let begun = VerifiedUpload::start(
        wire.peers(),
        vehicle.autopilot,
        options,
        mission,
        Some(vehicle.state),
        wire.now_s(),
    );
    drive(wire, begun, patience_s, keep, tell).await
}

/// Reads one of the vehicle's lists.
///
/// # Errors
/// The vehicle does not answer, or refuses, several times; or a cancellation.
pub async fn download(wire: &mut impl Wire, kind: MissionKind) -> Result<Mission, TransferError> {
    let mut left = DOWNLOADS;
    loop {
        left -= 1;
        match download_once(wire, kind).await {
            // A vehicle that does not know this list may also be silent about it.
            Err(TransferError::NoReply) if kind != MissionKind::Mission => {
                return Err(TransferError::NoReply);
            }
            Err(e) if left > 0 && e.is_transient() => {}
            result => return result,
        }
    }
}

async fn download_once(wire: &mut impl Wire, kind: MissionKind) -> Result<Mission, TransferError> {
    let mut peers = wire.peers().about(kind);
    if kind != MissionKind::Mission {
        peers.timing.retries = RETRIES_OF_OTHER_LISTS;
    }
    let (mut download, actions) = Download::start(peers, wire.now_s());
    wire.send(&actions);
    loop {
        if let Some(result) = download.result() {
            let autopilot = wire.vehicle().autopilot;
            let read = |got: &Downloaded| Mission::from_wire_list(kind, autopilot, &got.items);
            return result.map(read).map_err(Clone::clone);
        }
        let actions = match wire.next(download.deadline()).await {
            Event::Frame(frame) => match codec::decode(&frame) {
                Some(envelope) => download.receive(wire.now_s(), &envelope),
                None => Vec::new(),
            },
            Event::Deadline => download.tick(wire.now_s()),
            Event::Stopped(why) | Event::Abandoned(why) => {
                let last = download.cancel();
                wire.send(&last);
                return Err(TransferError::Stopped(why));
            }
        };
        wire.send(&actions);
    }
}

/// A list that is to be replaced, with what was read of it just before.
#[derive(Debug, Clone)]
pub struct Change {
    /// Which list.
    pub kind: MissionKind,
    /// To be on the vehicle.
    pub new: Mission,
    /// Is on it.
    pub previous: Mission,
}

/// Uploads over what was backed up, reads back, and restores on failure; like [`upload`] otherwise.
pub async fn replace(
    wire: &mut impl Wire,
    change: Change,
    options: Options,
    patience_s: f64,
    tell: impl FnMut(News),
) -> Outcome {
    let (vehicle, peers, now) = (wire.vehicle(), wire.peers().about(change.kind), wire.now_s());
    let begun = VerifiedUpload::start_with_backup(
        peers,
        vehicle.autopilot,
        options,
        change.new,
        change.previous,
        Some(vehicle.state),
        now,
    );
    drive(wire, begun, patience_s, |_| Ok(()), tell).await
}

/// Takes up an upload that was interrupted: brings the mission that is wanted. Both were kept, so nothing is kept anew.
pub async fn resume(
    wire: &mut impl Wire,
    change: Change,
    goal: Goal,
    options: Options,
    patience_s: f64,
    tell: impl FnMut(News),
) -> Outcome {
    let Change { kind, new, previous } = change;
    let (peers, vehicle, now) = (wire.peers().about(kind), wire.vehicle(), wire.now_s());
    let (state, both) = (Some(vehicle.state), (new, previous));
    let begun = VerifiedUpload::resume(peers, vehicle.autopilot, options, both, goal, state, now);
    drive(wire, begun, patience_s, |_| Ok(()), tell).await
}

/// A verified change under way: of a mission, a fence, rally points or parameters.
pub(super) trait VerifiedChange {
    /// What it is doing.
    type Phase: Copy + PartialEq;
    /// What is on the vehicle.
    type Outcome: Clone + std::fmt::Display;
    /// What was on board before.
    type Backup: ?Sized;
    /// What it asks its caller to do.
    type Action;

    fn phase(&self) -> Self::Phase;
    fn outcome(&self) -> Option<&Self::Outcome>;
    /// Whether this outcome may be settled when the link or the state of the vehicle changes.
    fn is_open(outcome: &Self::Outcome) -> bool;
    /// Nothing was changed.
    fn untouched(why: String) -> Self::Outcome;
    fn backup(&self) -> Option<&Self::Backup>;
    fn deadline(&self) -> Option<f64>;
    /// The vehicle's heartbeat.
    fn heartbeat(&mut self, now_s: f64, state: VehicleState) -> Vec<Self::Action>;
    fn frame(&mut self, now_s: f64, vehicle: &Vehicle, frame: &Frame) -> Vec<Self::Action>;
    fn tick(&mut self, now_s: f64) -> Vec<Self::Action>;
    fn cancel(&mut self, now_s: f64, why: &str) -> Vec<Self::Action>;
    fn abandon(&mut self, why: &str);
    /// The message of an action, or its progress.
    fn message(action: &Self::Action, to: Address) -> Result<(u32, Vec<u8>), (usize, usize)>;
}

/// Drives a change to its end. `keep` gets what was on board before anything is sent that changes it; if it cannot keep that, nothing is sent.
/// After a loss of the link it goes on when the vehicle is received from again within `patience_s`.
pub(super) async fn drive<C: VerifiedChange>(
    wire: &mut impl Wire,
    (mut change, mut actions): (C, Vec<C::Action>),
    patience_s: f64,
    mut keep: impl FnMut(&C::Backup) -> Result<(), String>,
    mut tell: impl FnMut(News<C::Phase>),
) -> C::Outcome {
    let (mut kept, mut phase, mut stranded_since, mut stopping) = (false, None, None, false);
    loop {
        if let Some(backup) = change.backup().filter(|_| !kept) {
            if let Err(why) = keep(backup) {
                return C::untouched(format!("the backup could not be kept: {why}"));
            }
            kept = true;
        }
        for action in &actions {
            match C::message(action, wire.vehicle().address) {
                Ok((id, payload)) => wire.send_payload(id, payload),
                Err((done, total)) => tell(News::Progress(done, total)),
            }
        }
        if phase != Some(change.phase()) {
            phase = Some(change.phase());
            tell(News::Phase(change.phase()));
        }
        match change.outcome() {
            Some(outcome) if C::is_open(outcome) => {
                if stranded_since.is_none() {
                    tell(News::Stranded(outcome.to_string()));
                }
                let since: f64 = *stranded_since.get_or_insert(wire.now_s());
                // Who gave up does not wait for a link that is gone: the journal keeps both.
                if stopping || wire.now_s() >= since + patience_s {
                    return outcome.clone();
                }
            }
            Some(outcome) => return outcome.clone(),
            None => {}
        }
        // A change that waits for its link has no deadline but the end of the patience.
        let deadline_s = change.deadline().or(stranded_since.map(|since| since + patience_s));
        let now = wire.now_s();
        actions = match wire.next(deadline_s).await {
            Event::Frame(frame) => match heartbeat_of(wire.vehicle(), &frame) {
                Some(vehicle) => change.heartbeat(wire.now_s(), vehicle.state),
                None => change.frame(wire.now_s(), &wire.vehicle(), &frame),
            },
            Event::Deadline => change.tick(wire.now_s().max(now)),
            Event::Stopped(why) => {
                stopping = true;
                change.cancel(wire.now_s(), &why)
            }
            Event::Abandoned(why) => {
                stopping = true;
                change.abandon(&why);
                Vec::new()
            }
        };
    }
}

impl VerifiedChange for VerifiedUpload {
    type Phase = Phase;
    type Outcome = Outcome;
    type Backup = Mission;
    type Action = Action;

    fn phase(&self) -> Phase {
        self.phase()
    }

    fn outcome(&self) -> Option<&Outcome> {
        self.outcome()
    }

    fn is_open(outcome: &Outcome) -> bool {
        matches!(outcome, Outcome::Unknown { .. })
    }

    fn untouched(why: String) -> Outcome {
        Outcome::RestoredPrevious { why }
    }

    fn backup(&self) -> Option<&Mission> {
        self.backup()
    }

    fn deadline(&self) -> Option<f64> {
        self.deadline()
    }

    fn heartbeat(&mut self, now_s: f64, state: VehicleState) -> Vec<Action> {
        let mut actions = self.vehicle_state(now_s, state);
        actions.extend(self.link_restored(now_s));
        actions
    }

    fn frame(&mut self, now_s: f64, _: &Vehicle, frame: &Frame) -> Vec<Action> {
        codec::decode(frame).map_or_else(Vec::new, |envelope| self.receive(now_s, &envelope))
    }

    fn tick(&mut self, now_s: f64) -> Vec<Action> {
        self.tick(now_s)
    }

    fn cancel(&mut self, now_s: f64, why: &str) -> Vec<Action> {
        self.cancel(now_s, why)
    }

    fn abandon(&mut self, why: &str) {
        self.abandon(why);
    }

    fn message(action: &Action, to: Address) -> Result<(u32, Vec<u8>), (usize, usize)> {
        match action {
            Action::Send(message) => Ok(codec::encode(to, message)),
            Action::Progress { done, total } => Err((*done, *total)),
        }
    }
}

/// What a heartbeat of this vehicle says; other frames say nothing.
pub fn heartbeat_of(vehicle: Vehicle, frame: &Frame) -> Option<Vehicle> {
    let seen = Vehicle::from_heartbeat(frame).filter(|v| v.address == vehicle.address)?;
    Some(Vehicle { uid: vehicle.uid, ..seen })
}

/// Runs a transfer over a wire in virtual time: its future never waits for anything outside.
pub fn at_once<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
    }
}
