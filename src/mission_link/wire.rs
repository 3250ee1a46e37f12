//! The verified upload over any link: sockets of its own, the links of a run, or virtual time.

use super::codec;
use super::vehicle::Vehicle;
use crate::link::frame::Frame;
use gaware_mission::item::{Mission, MissionKind};
use gaware_mission::transfer::verified::{Goal, Options, Outcome, Phase, VerifiedUpload};
use gaware_mission::transfer::{Action, Download, Downloaded, Peers, TransferError};
use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// Downloads are tried this often.
const DOWNLOADS: u32 = 6;
/// Repetitions of a question about a list that not every vehicle has.
const RETRIES_OF_OTHER_LISTS: u32 = 2;

/// What an upload reports on its way.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// A new phase began.
    Phase(Phase),
    /// Items done, of all.
    Progress(usize, usize),
    /// It is not known what is on the vehicle; waiting for the link.
    Stranded(String),
}

/// What a wait ended with.
#[derive(Debug)]
pub enum Event {
    /// A frame came.
    Frame(Frame),
    /// Its time is over.
    Deadline,
    /// The user wants to stop; reported once.
    Stopped,
}

/// A link to one vehicle.
pub trait Wire {
    /// The vehicle as its last heartbeat reports.
    fn vehicle(&self) -> Vehicle;
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
    let (upload, actions) = VerifiedUpload::start(
        wire.peers(),
        vehicle.autopilot,
        options,
        mission,
        Some(vehicle.state),
        wire.now_s(),
    );
    wire.send(&actions);
    drive(wire, upload, patience_s, keep, tell).await
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
            Event::Stopped => {
                let last = download.cancel();
                wire.send(&last);
                return Err(TransferError::Cancelled);
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
    let (upload, actions) = VerifiedUpload::start_with_backup(
        peers,
        vehicle.autopilot,
        options,
        change.new,
        change.previous,
        Some(vehicle.state),
        now,
    );
    wire.send(&actions);
    drive(wire, upload, patience_s, |_| Ok(()), tell).await
}

/// Takes up an upload that was interrupted: brings the mission that is wanted. Both were kept, so nothing is kept anew.
pub async fn resume(
    wire: &mut impl Wire,
    cut_off: CutOff,
    options: Options,
    patience_s: f64,
    tell: impl FnMut(News),
) -> Outcome {
    let CutOff { kind, new, previous, goal } = cut_off;
    let (peers, autopilot, now) = (wire.peers().about(kind), wire.vehicle().autopilot, wire.now_s());
    let (upload, actions) = VerifiedUpload::resume(peers, autopilot, options, new, previous, goal, now);
    wire.send(&actions);
    drive(wire, upload, patience_s, |_| Ok(()), tell).await
}

/// An upload that was interrupted, and what is wanted of it.
#[derive(Debug, Clone)]
pub struct CutOff {
    /// Which list.
    pub kind: MissionKind,
    /// Was to be on the vehicle.
    pub new: Mission,
    /// Was on it.
    pub previous: Mission,
    /// Which of them.
    pub goal: Goal,
}

async fn drive(
    wire: &mut impl Wire,
    mut upload: VerifiedUpload,
    patience_s: f64,
    mut keep: impl FnMut(&Mission) -> Result<(), String>,
    mut tell: impl FnMut(News),
) -> Outcome {
    let (mut kept, mut phase, mut stranded_since, mut stopping) = (false, None, None, false);
    loop {
        if phase != Some(upload.phase()) {
            phase = Some(upload.phase());
            tell(News::Phase(upload.phase()));
        }
        match upload.outcome() {
            Some(outcome @ Outcome::Unknown { .. }) => {
                if stranded_since.is_none() {
                    tell(News::Stranded(outcome.to_string()));
                }
                let since: f64 = *stranded_since.get_or_insert(wire.now_s());
                // Who gave up does not wait for a link that is gone: the journal keeps both missions.
                if stopping || wire.now_s() >= since + patience_s {
                    return outcome.clone();
                }
            }
            Some(outcome) => return outcome.clone(),
            None => {}
        }
        // A transfer that waits for its link has no deadline but the end of the patience.
        let deadline_s = upload.deadline().or(stranded_since.map(|since| since + patience_s));
        let actions = match wire.next(deadline_s).await {
            Event::Frame(frame) => take(wire, &mut upload, &frame),
            Event::Deadline => upload.tick(wire.now_s()),
            Event::Stopped => {
                stopping = true;
                upload.cancel(wire.now_s())
            }
        };
        if let Some(backup) = upload.backup().filter(|_| !kept) {
            if let Err(why) = keep(backup) {
                let why = format!("the backup could not be kept: {why}");
                return Outcome::RestoredPrevious { why };
            }
            kept = true;
        }
        for action in &actions {
            if let Action::Progress { done, total } = action {
                tell(News::Progress(*done, *total));
            }
        }
        wire.send(&actions);
    }
}

fn take(wire: &impl Wire, upload: &mut VerifiedUpload, frame: &Frame) -> Vec<Action> {
    let now = wire.now_s();
    if let Some(vehicle) = heartbeat_of(wire.vehicle(), frame) {
        upload.vehicle_state(vehicle.state);
        return upload.link_restored(now);
    }
    codec::decode(frame).map_or_else(Vec::new, |envelope| upload.receive(now, &envelope))
}

/// What a heartbeat of this vehicle says; other frames say nothing.
pub fn heartbeat_of(vehicle: Vehicle, frame: &Frame) -> Option<Vehicle> {
    Vehicle::from_heartbeat(frame).filter(|v| v.address == vehicle.address)
}

/// Runs a transfer over a wire in virtual time: its future never waits for anything outside.
pub(crate) fn at_once<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
    }
}
