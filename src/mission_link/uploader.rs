//! Changes of the vehicle while `run` goes on, the upload of a planned mission and the setting of parameters: over its links, under its
//! identity, only when someone asked for them and confirmed.

use super::delivery::{DeliveryError, Order, deliver};
use super::files::{self, Contents};
use super::journal;
use super::param_delivery::ParamOrder;
use super::pin;
use super::pinned::Pinned;
use super::run_wire::RunWire;
use super::vehicle::Vehicle;
use super::wire::{self, News, Wire};
use crate::figures::counted;
use crate::link::endpoint::{Origin, Received};
use crate::sinks::live::Live;
use crate::sinks::status::{MissionState, MissionView, SinkStatus};
use crate::sinks::{Change, Request};
use gaware_mission::airframe::Airframe;
use gaware_mission::change::Phase;
use gaware_mission::compare::differences;
use gaware_mission::item::MissionKind;
use gaware_mission::transfer::TransferError;
use gaware_mission::transfer::verified::{Options, Outcome};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

pub use super::run_wire::RawMessage;

mod parameters;

/// A vehicle that has sent nothing for longer is not there, s.
const HEARD_S: f64 = 5.0;
/// After a loss of the link the restoration is kept ready for so long, s.
const PATIENCE_S: f64 = 600.0;

/// The mission that may be uploaded.
#[derive(Debug, Clone)]
pub struct Planned {
    path: PathBuf,
    contents: Contents,
}

impl Planned {
    /// From a mission file.
    ///
    /// # Errors
    /// The file cannot be read or holds no mission.
    pub fn load(path: &Path) -> Result<Self, files::FileError> {
        let contents = files::read_contents(path)?;
        if contents.mission.items.is_empty() {
            let reason = "the mission is empty".to_owned();
            return Err(files::FileError::Content { path: path.to_owned(), reason });
        }
        Ok(Self { path: path.to_owned(), contents })
    }

    fn name(&self) -> String {
        self.path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
    }

    fn ready(&self) -> String {
        let items = self.contents.mission.items.len();
        let are = if items == 1 { "is" } else { "are" };
        format!("{} of {} {are} ready to be uploaded before take-off", counted(items, "item"), self.name())
    }

    /// Compares what the vehicle holds with this mission and its fence; where they differ, how many items its mission has.
    async fn other_on_board(&self, wire: &mut Pinned<RunWire>) -> Result<Option<usize>, TransferError> {
        let mission = wire::download(wire, MissionKind::Mission).await?;
        let autopilot = wire.vehicle().autopilot;
        let mut is_same = differences(autopilot, &self.contents.mission, &mission).is_empty();
        if is_same && !self.contents.fence.is_empty() {
            let fence = wire::download(wire, MissionKind::Fence).await?;
            is_same = differences(autopilot, &journal::list(&self.contents.fence), &fence).is_empty();
        }
        Ok((!is_same).then_some(mission.items.len()))
    }

    /// Where the mission before is kept: beside the file.
    fn backup_path(&self) -> PathBuf {
        self.path.with_file_name(format!("mission-backup-{}.plan", stamp()))
    }
}

/// Part of the name of a backup: no two are made in the same millisecond.
fn stamp() -> u128 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_millis()
}

/// What may be changed, each where the user has named a file for it.
#[derive(Debug, Clone, Default)]
pub struct Offer {
    /// The mission.
    pub mission: Option<Planned>,
    /// The parameters.
    pub parameters: Option<ParamOrder>,
    /// The airframe of the run, where one was named.
    pub airframe: Option<Airframe>,
}

/// A reading that failed is tried again with a later heartbeat, so often in all.
const LOOKS: u8 = 3;
/// A few periods of snapshots.
const NEXT_SNAPSHOT: Duration = Duration::from_secs(1);

/// The task.
#[derive(Debug)]
pub struct Uploader {
    offer: Offer,
    wire: Pinned<RunWire>,
    wanted: Option<u8>,
    /// The vehicles on the links, where they are, and when they last sent something.
    heard: Vec<(Vehicle, Origin, Instant)>,
    live: watch::Receiver<Arc<Live>>,
    status: Arc<SinkStatus>,
    /// So often may still be read what is on board, to learn whether the planned mission is there already.
    looks: u8,
}

impl Uploader {
    /// For the vehicle that the engine listens to, which is the one on the screens.
    pub fn new(
        offer: Offer,
        wanted: Option<u8>,
        frames: broadcast::Receiver<Received>,
        outbox: mpsc::Sender<RawMessage>,
        live: watch::Receiver<Arc<Live>>,
        status: Arc<SinkStatus>,
    ) -> Self {
        let wire = Pinned::new(RunWire::new(frames, outbox), Vehicle::UNKNOWN, Origin::default());
        if let Some(planned) = &offer.mission {
            show(&status, planned, MissionState::Ready, planned.ready());
        }
        if let Some(order) = &offer.parameters {
            parameters::show(&status, order, MissionState::Ready, parameters::ready(order));
        }
        let looks = if offer.mission.is_some() { LOOKS } else { 0 };
        Self { offer, wire, wanted, heard: Vec::new(), live, status, looks }
    }

    /// Serves requests until `stop`; a change under way then is cancelled, and what was there before put back first.
    pub async fn run(mut self, mut requests: mpsc::Receiver<Request>, stop: CancellationToken) {
        self.wire.raw.stop = stop.clone();
        loop {
            tokio::select! {
                () = stop.cancelled() => return,
                request = requests.recv() => match request {
                    Some(Request { change, reply }) => {
                        let result = self.serve(change, &mut requests).await;
                        // Who asked may have gone; the status is for everyone.
                        let _ = reply.send(result);
                    }
                    None => return,
                },
                frame = self.wire.raw.frames.recv() => match frame {
                    Ok(received) => if self.notice(&received) { self.look_on_board().await },
                    Err(RecvError::Lagged(_)) => {}
                    Err(RecvError::Closed) => return,
                },
            }
        }
    }

    /// Takes a frame; whether it is a heartbeat of the vehicle that the engine listens to.
    fn notice(&mut self, received: &Received) -> bool {
        let Some(seen) = Vehicle::from_heartbeat(&received.frame) else { return false };
        let origin = received.origin();
        self.heard.retain(|(v, from, _)| (v.address, *from) != (seen.address, origin));
        self.heard.push((seen, origin, Instant::now()));
        self.followed().is_some_and(|(vehicle, _)| vehicle.address == seen.address)
    }

    /// Reads what is on board of a vehicle that stands: a mission that was uploaded before the run need not be uploaded again.
    async fn look_on_board(&mut self) {
        let stands = self.followed().is_some_and(|(vehicle, _)| vehicle.state.objection().is_none());
        if self.looks == 0 || !stands || self.pin().await.is_err() {
            return;
        }
        self.looks -= 1;
        let Some(planned) = &self.offer.mission else { return };
        let (state, text) = match planned.other_on_board(&mut self.wire).await {
            Ok(None) => {
                (MissionState::OnVehicle, format!("{} is on the vehicle: read and compared", planned.name()))
            }
            Ok(Some(0)) => (MissionState::Ready, format!("{}; the vehicle has no mission", planned.ready())),
            Ok(Some(items)) => {
                let other = format!(
                    "{}; on the vehicle is another mission of {}",
                    planned.ready(),
                    counted(items, "item")
                );
                (MissionState::Ready, other)
            }
            Err(error) => {
                tracing::debug!(%error, "what is on board could not be read");
                return;
            }
        };
        self.looks = 0;
        show(&self.status, planned, state, text);
    }

    /// The vehicles that sent something lately.
    fn here(&self) -> impl DoubleEndedIterator<Item = (Vehicle, Origin)> {
        let lately = self.heard.iter().filter(|(_, _, t)| t.elapsed().as_secs_f64() <= HEARD_S);
        lately.map(|(vehicle, origin, _)| (*vehicle, *origin))
    }

    /// The vehicle that the engine listens to, where it sent something lately.
    fn followed(&self) -> Option<(Vehicle, Origin)> {
        let followed = self.live.borrow().vehicle?;
        self.here().rev().find(|(v, _)| v.address.system == followed)
    }

    /// Vehicles that may be meant as well, where the user has not chosen one.
    fn rivals(&self, chosen: &Vehicle) -> Vec<Vehicle> {
        let others = self.here().map(|(v, _)| v).filter(|v| v.address != chosen.address);
        if self.wanted.is_some() { Vec::new() } else { others.collect() }
    }

    /// Pins the change to the vehicle on the screen.
    ///
    /// # Errors
    /// It is not there, or its id is that of two vehicles.
    async fn pin(&mut self) -> Result<Vehicle, String> {
        let missing = || "the vehicle is not heard; check the link".to_owned();
        let (vehicle, origin) = self.followed().ok_or_else(missing)?;
        let twin = self.here().find(|(v, from)| v.address == vehicle.address && *from != origin);
        if let Some((_, other)) = twin {
            return Err(pin::two_places(vehicle.address, origin, other));
        }
        self.wire.raw.system = vehicle.address.system;
        self.wire.pin_to(vehicle, origin);
        self.wire.identify().await?;
        Ok(self.wire.vehicle())
    }

    /// Makes the change; others who ask meanwhile are informed.
    async fn serve(
        &mut self,
        change: Change,
        requests: &mut mpsc::Receiver<Request>,
    ) -> Result<String, String> {
        // Screens and this task learn of a vehicle with the next snapshot of the run.
        let known = self.live.wait_for(|live| live.vehicle.is_some());
        let _ = tokio::time::timeout(NEXT_SNAPSHOT, known).await;
        // What waits in the queue is older than the request: heartbeats among it.
        while let Ok(received) = self.wire.raw.frames.try_recv() {
            self.notice(&received);
        }
        let chosen = match self.pin().await {
            Ok(vehicle) => vehicle,
            Err(why) => {
                self.refused(change, &why);
                return Err(why);
            }
        };
        let others = self.rivals(&chosen);
        let outcome = {
            let upload = carry_out(change, &self.offer, &mut self.wire, others, &self.status);
            tokio::pin!(upload);
            loop {
                tokio::select! {
                    outcome = &mut upload => break outcome,
                    Some(Request { reply, .. }) = requests.recv() => {
                        let _ = reply.send(Err("a change of the vehicle is under way".to_owned()));
                    }
                }
            }
        };
        // The upload took the heartbeats.
        let (address, origin) = (chosen.address, self.wire.origin());
        let taken = |(v, from, _): &&mut (Vehicle, Origin, Instant)| (v.address, *from) == (address, origin);
        self.heard.iter_mut().filter(taken).for_each(|(_, _, t)| *t = Instant::now());
        outcome
    }

    fn refused(&self, change: Change, why: &str) {
        match (change, &self.offer) {
            (Change::Mission, Offer { mission: Some(planned), .. }) => {
                show(&self.status, planned, MissionState::Ready, format!("not uploaded: {why}"));
            }
            (Change::Parameters, Offer { parameters: Some(order), .. }) => {
                parameters::show(&self.status, order, MissionState::Ready, format!("not set: {why}"));
            }
            _ => {}
        }
    }
}

async fn carry_out(
    change: Change,
    offer: &Offer,
    wire: &mut Pinned<RunWire>,
    others: Vec<Vehicle>,
    status: &SinkStatus,
) -> Result<String, String> {
    match (change, &offer.mission, &offer.parameters) {
        (Change::Mission, Some(planned), _) => {
            let airframe = offer.airframe.clone();
            transfer(planned, airframe, wire, others, status).await
        }
        (Change::Parameters, _, Some(order)) => parameters::set(order, wire, &others, status).await,
        (Change::Mission, None, _) => Err("this run was given no mission (--mission FILE)".to_owned()),
        (Change::Parameters, _, None) => Err("this run was given no parameters (--params FILE)".to_owned()),
    }
}

fn show(status: &SinkStatus, planned: &Planned, state: MissionState, text: String) {
    let items = planned.contents.mission.items.len() as u64;
    status.set_mission(MissionView { state, name: planned.name(), items, text });
}

async fn transfer(
    planned: &Planned,
    airframe: Option<Airframe>,
    wire: &mut Pinned<RunWire>,
    others: Vec<Vehicle>,
    status: &SinkStatus,
) -> Result<String, String> {
    let refuse = |why: String| {
        show(status, planned, MissionState::Ready, format!("not uploaded: {why}"));
        Err(why)
    };
    let order = Order {
        contents: planned.contents.clone(),
        with_fence: !planned.contents.fence.is_empty(),
        options: Options { planned_for: planned.contents.planned_for, ..Options::default() },
        patience_s: PATIENCE_S,
        backup: planned.backup_path(),
        airframe,
        others,
        force: false,
    };
    show(status, planned, MissionState::Uploading, "looking at the vehicle".to_owned());
    if let Some(why) = wire.vehicle().state.objection() {
        return refuse(why.to_owned());
    }
    let mut words = String::new();
    let tell = |news| {
        let (state, text) = match news {
            News::Phase(Phase::Finished) | News::Checked(_) | News::Said(_) => return,
            News::Phase(phase) => {
                words = phase_words(phase).to_owned();
                (MissionState::Uploading, words.clone())
            }
            News::Progress(done, total) => (MissionState::Uploading, format!("{words}, {done} of {total}")),
            News::Stranded(text) => (MissionState::Unknown, text),
        };
        show(status, planned, state, text);
    };
    let delivered = match deliver(wire, &order, tell).await {
        Ok(delivered) => delivered,
        Err(DeliveryError::Refused(why) | DeliveryError::Preflight(why)) => return refuse(why),
        Err(e) => {
            show(status, planned, MissionState::Unknown, e.to_string());
            return Err(e.to_string());
        }
    };
    let state = match delivered.outcome {
        _ if delivered.journal.is_some() => MissionState::Unknown,
        Outcome::Verified { .. } => MissionState::OnVehicle,
        Outcome::RestoredPrevious { .. } => MissionState::NotOnVehicle,
        Outcome::Foreign { .. } | Outcome::Unknown { .. } => MissionState::Unknown,
    };
    let warnings = delivered.checked.warnings.iter().map(|w| format!("; warning: {w}"));
    let text = delivered.text + &warnings.collect::<String>();
    show(status, planned, state, text.clone());
    if state == MissionState::OnVehicle { Ok(text) } else { Err(text) }
}

/// A phase in words.
pub fn phase_words(phase: Phase) -> &'static str {
    match phase {
        Phase::BackingUp => "reading the mission that is on board",
        Phase::Sending => "uploading",
        Phase::ReadingBack => "reading back",
        Phase::Restoring => "putting the previous mission back",
        Phase::Finished => "the transfer is over",
    }
}
