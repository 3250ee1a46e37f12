//! The verified upload over any link: sockets of its own, the links of a run, or virtual time.

use super::codec;
use super::vehicle::Vehicle;
use crate::link::frame::Frame;
use gaware_mission::change::{Exchange, Phase, VerifiedChange};
use gaware_mission::identity::Identity;
use gaware_mission::item::{Mission, MissionKind};
use gaware_mission::transfer::verified::{Goal, Options, Outcome, VerifiedUpload};
use gaware_mission::transfer::{Action, Address, Download, Envelope, Peers, TransferError};
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
pub enum News {
    /// A new phase began.
    Phase(Phase),
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
    let begun = Download::start(peers, wire.now_s());
    let over = |download: &Download| {
        let result = download.result()?;
        Some(result.map(|got| got.items.clone()).map_err(Clone::clone))
    };
    match read_out(wire, begun, over).await {
        Ok(items) => Ok(Mission::from_wire_list(kind, wire.vehicle().autopilot, &items?)),
        Err((mut download, why)) => {
            send(wire, &download.cancel(), |_, _| ());
            Err(TransferError::Stopped(why))
        }
    }
}

/// A list that is to be replaced, with what was read of it just before.
#[derive(Debug, Clone)]
pub struct ListChange {
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
    change: ListChange,
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
    change: ListChange,
    goal: Goal,
    options: Options,
    patience_s: f64,
    tell: impl FnMut(News),
) -> Outcome {
    let ListChange { kind, new, previous } = change;
    let (peers, vehicle, now) = (wire.peers().about(kind), wire.vehicle(), wire.now_s());
    let (state, both) = (Some(vehicle.state), (new, previous));
    let begun = VerifiedUpload::resume(peers, vehicle.autopilot, options, both, goal, state, now);
    drive(wire, begun, patience_s, |_| Ok(()), tell).await
}

/// What a machine takes from the vehicle.
pub(super) trait Incoming: Sized {
    /// What a frame says, if it is one of these.
    fn read(vehicle: Address, frame: &Frame) -> Option<Self>;
}

/// What a machine asks its caller to do.
pub(super) trait Outgoing {
    /// The message to the vehicle, or the progress.
    fn message(&self, to: Address) -> Result<(u32, Vec<u8>), (usize, usize)>;
}

impl Incoming for Envelope {
    fn read(_: Address, frame: &Frame) -> Option<Self> {
        codec::decode(frame)
    }
}

impl Outgoing for Action {
    fn message(&self, to: Address) -> Result<(u32, Vec<u8>), (usize, usize)> {
        match self {
            Self::Send(message) => Ok(codec::encode(to, message)),
            Self::Progress { done, total } => Err((*done, *total)),
        }
    }
}

fn send(wire: &mut impl Wire, actions: &[impl Outgoing], mut progress: impl FnMut(usize, usize)) {
    let to = wire.vehicle().address;
    for action in actions {
        match action.message(to) {
            Ok((id, payload)) => wire.send_payload(id, payload),
            Err((done, total)) => progress(done, total),
        }
    }
}

fn received<M: Exchange<Message: Incoming>>(
    wire: &impl Wire,
    machine: &mut M,
    frame: &Frame,
) -> Vec<M::Action> {
    let message = M::Message::read(wire.vehicle().address, frame);
    message.map_or_else(Vec::new, |message| machine.receive(wire.now_s(), &message))
}

/// Drives a reading to its result; or it is not to go on, for this reason.
pub(super) async fn read_out<M: Exchange<Message: Incoming, Action: Outgoing>, T>(
    wire: &mut impl Wire,
    (mut machine, mut actions): (M, Vec<M::Action>),
    mut result: impl FnMut(&M) -> Option<T>,
) -> Result<T, (M, String)> {
    loop {
        send(wire, &actions, |_, _| ());
        if let Some(result) = result(&machine) {
            return Ok(result);
        }
        actions = match wire.next(machine.deadline()).await {
            Event::Frame(frame) => received(wire, &mut machine, &frame),
            Event::Deadline => machine.tick(wire.now_s()),
            Event::Stopped(why) | Event::Abandoned(why) => return Err((machine, why)),
        };
    }
}

/// Drives a change to its end. `keep` gets what was on board before anything is sent that changes it; if it cannot keep that, nothing is sent.
/// After a loss of the link it goes on when the vehicle is received from again within `patience_s`.
pub(super) async fn drive<C: VerifiedChange<Message: Incoming, Action: Outgoing>>(
    wire: &mut impl Wire,
    (mut change, mut actions): (C, Vec<C::Action>),
    patience_s: f64,
    mut keep: impl FnMut(&C::Backup) -> Result<(), String>,
    mut tell: impl FnMut(News),
) -> C::Outcome {
    let (mut kept, mut phase, mut stranded_since, mut stopping) = (false, None, None, false);
    loop {
        if let Some(backup) = change.backup().filter(|_| !kept) {
            if let Err(why) = keep(backup) {
                return C::untouched(format!("the backup could not be kept: {why}"));
            }
            kept = true;
        }
        send(wire, &actions, |done, total| tell(News::Progress(done, total)));
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
                Some(vehicle) => {
                    let now = wire.now_s();
                    let mut actions = change.vehicle_state(now, vehicle.state);
                    actions.extend(change.link_restored(now));
                    actions
                }
                None => received(wire, &mut change, &frame),
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
