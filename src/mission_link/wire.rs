//! The verified upload over any link: sockets of its own, the links of a run, or virtual time.

use super::codec;
use super::vehicle::Vehicle;
use crate::link::frame::Frame;
use gaware_mission::item::Mission;
use gaware_mission::transfer::verified::{Goal, Options, Outcome, Phase, VerifiedUpload};
use gaware_mission::transfer::{Action, Peers};
use std::future::Future;

/// What an upload tells on its way.
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
    /// The user wants to stop; told once.
    Stopped,
}

/// A link to one vehicle.
pub trait Wire {
    /// The vehicle as its last heartbeat tells.
    fn vehicle(&self) -> Vehicle;
    /// Who talks to whom.
    fn peers(&self) -> Peers;
    /// Any monotonic time, s.
    fn now_s(&self) -> f64;
    /// Sends what is to be sent among these.
    fn send(&mut self, actions: &[Action]);
    /// The next frame, the deadline (or a short while without one), or the wish to stop. Keeps [`Self::vehicle`] up to date.
    fn next(&mut self, deadline_s: Option<f64>) -> impl Future<Output = Event> + Send;
}

/// Uploads, reads back, and restores on failure. `keep` gets the mission that was on board before anything is
/// changed; if it cannot keep it, nothing is. After a loss of the link the restoration goes on when the vehicle is
/// heard again within `patience_s`.
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

/// Takes up an upload that was cut off: brings the mission that is wanted. Both were kept, so nothing is kept anew.
pub async fn resume(
    wire: &mut impl Wire,
    cut_off: CutOff,
    options: Options,
    patience_s: f64,
    tell: impl FnMut(News),
) -> Outcome {
    let CutOff { new, previous, goal } = cut_off;
    let (peers, autopilot, now) = (wire.peers(), wire.vehicle().autopilot, wire.now_s());
    let (upload, actions) = VerifiedUpload::resume(peers, autopilot, options, new, previous, goal, now);
    wire.send(&actions);
    drive(wire, upload, patience_s, |_| Ok(()), tell).await
}

/// An upload that was cut off, and what is wanted of it.
#[derive(Debug, Clone)]
pub struct CutOff {
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
    let (mut kept, mut phase, mut stranded_since) = (false, None, None);
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
                if wire.now_s() - since > patience_s {
                    return outcome.clone();
                }
            }
            Some(outcome) => return outcome.clone(),
            None => {}
        }
        let actions = match wire.next(upload.deadline()).await {
            Event::Frame(frame) => take(wire, &mut upload, &frame),
            Event::Deadline => upload.tick(wire.now_s()),
            Event::Stopped => upload.cancel(wire.now_s()),
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
    if let Some(vehicle) = heard(wire.vehicle(), frame) {
        upload.vehicle_state(vehicle.state);
        return upload.link_restored(now);
    }
    codec::decode(frame).map_or_else(Vec::new, |envelope| upload.receive(now, &envelope))
}

/// What a heartbeat of this vehicle says; other frames say nothing.
pub fn heard(vehicle: Vehicle, frame: &Frame) -> Option<Vehicle> {
    Vehicle::from_heartbeat(frame).filter(|v| v.address == vehicle.address)
}
