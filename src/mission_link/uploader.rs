//! The upload of a planned mission while `run` goes on: over its links, under its identity, only when somebody asked for it
//! and confirmed.

use super::codec;
use super::files;
use super::journal::Journal;
use super::vehicle::Vehicle;
use super::wire::{self, Event, News, Wire};
use crate::link::endpoint::Received;
use crate::link::heartbeat::COMPONENT;
use crate::sinks::Request;
use crate::sinks::status::{MissionState, MissionView, SinkStatus};
use gaware_mission::fence::Fence;
use gaware_mission::item::Mission;
use gaware_mission::transfer::verified::{Options, Outcome, Phase};
use gaware_mission::transfer::{Action, Address, Peers};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, mpsc};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// Longest wait without a look around.
const BREATH: Duration = Duration::from_millis(100);
/// A vehicle that was not heard for longer is not there, s.
const HEARD_S: f64 = 5.0;
/// After a loss of the link the restoration is kept ready for so long, s.
const PATIENCE_S: f64 = 600.0;

/// A message for the vehicle by its id and payload: a backup may hold what the dialect's types refuse.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawMessage {
    /// Message id.
    pub id: u32,
    /// Payload, MAVLink 2.
    pub payload: Vec<u8>,
}

/// The mission that may be uploaded.
#[derive(Debug, Clone)]
pub struct Planned {
    path: PathBuf,
    mission: Mission,
}

impl Planned {
    /// From a mission file.
    ///
    /// # Errors
    /// The file cannot be read or holds no mission.
    pub fn load(path: &Path) -> Result<Self, files::FileError> {
        let (mission, _) = files::read(path)?;
        if mission.items.is_empty() {
            let reason = "the mission is empty".to_owned();
            return Err(files::FileError::Content { path: path.to_owned(), reason });
        }
        Ok(Self { path: path.to_owned(), mission })
    }

    fn name(&self) -> String {
        self.path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
    }

    /// Where the mission before is kept: beside the file.
    fn backup_path(&self) -> PathBuf {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        self.path.with_file_name(format!("mission-backup-{}.plan", since.as_millis()))
    }
}

/// The task.
#[derive(Debug)]
pub struct Uploader {
    planned: Planned,
    wire: RunWire,
    heard: Option<Instant>,
    wanted: Option<u8>,
    status: Arc<SinkStatus>,
}

impl Uploader {
    /// For the vehicle with this system id, or the first autopilot heard.
    pub fn new(
        planned: Planned,
        wanted: Option<u8>,
        frames: broadcast::Receiver<Received>,
        outbox: mpsc::Sender<RawMessage>,
        status: Arc<SinkStatus>,
    ) -> Self {
        let wire = RunWire {
            frames,
            outbox,
            vehicle: None,
            started: Instant::now(),
            stop: CancellationToken::new(),
            stopping: false,
        };
        let uploader = Self { planned, wire, heard: None, wanted, status };
        let (items, name) = (uploader.planned.mission.items.len(), uploader.planned.name());
        let text = format!("{items} items of {name} are ready to be uploaded before take-off");
        uploader.show(MissionState::Ready, text);
        uploader
    }

    /// Serves requests until `stop`; an upload under way then is cancelled and the previous mission put back first.
    pub async fn run(mut self, mut requests: mpsc::Receiver<Request>, stop: CancellationToken) {
        self.wire.stop = stop.clone();
        loop {
            tokio::select! {
                () = stop.cancelled() => return,
                request = requests.recv() => match request {
                    Some(Request::UploadMission { reply }) => {
                        let result = self.serve(&mut requests).await;
                        // Who asked may have gone; the status tells everybody.
                        let _ = reply.send(result);
                    }
                    None => return,
                },
                frame = self.wire.frames.recv() => match frame {
                    Ok(received) => self.notice(&received),
                    Err(RecvError::Lagged(_)) => {}
                    Err(RecvError::Closed) => return,
                },
            }
        }
    }

    fn notice(&mut self, received: &Received) {
        let Some(seen) = Vehicle::from_heartbeat(&received.frame) else { return };
        let known = self.wire.vehicle.map(|v| v.address.system).or(self.wanted);
        if known.is_none_or(|id| id == seen.address.system) {
            self.wire.vehicle = Some(seen);
            self.heard = Some(Instant::now());
        }
    }

    /// Uploads; others who ask meanwhile are told so.
    async fn serve(&mut self, requests: &mut mpsc::Receiver<Request>) -> Result<String, String> {
        // What waits in the queue is older than the request: heartbeats among it.
        while let Ok(received) = self.wire.frames.try_recv() {
            self.notice(&received);
        }
        if self.wire.vehicle.is_none() || self.heard.is_none_or(|t| t.elapsed().as_secs_f64() > HEARD_S) {
            let why = "the vehicle is not heard; check the link";
            self.show(MissionState::Ready, format!("not uploaded: {why}"));
            return Err(why.to_owned());
        }
        let upload = transfer(&self.planned, &mut self.wire, &self.status);
        tokio::pin!(upload);
        let outcome = loop {
            tokio::select! {
                outcome = &mut upload => break outcome,
                Some(Request::UploadMission { reply }) = requests.recv() => {
                    let _ = reply.send(Err("an upload is under way".to_owned()));
                }
            }
        };
        self.heard = Some(Instant::now());
        outcome
    }

    fn show(&self, state: MissionState, text: String) {
        show(&self.status, &self.planned, state, text);
    }
}

fn show(status: &SinkStatus, planned: &Planned, state: MissionState, text: String) {
    let items = planned.mission.items.len() as u64;
    status.set_mission(MissionView { state, name: planned.name(), items, text });
}

async fn transfer(planned: &Planned, wire: &mut RunWire, status: &SinkStatus) -> Result<String, String> {
    let vehicle = wire.vehicle();
    let backup_path = planned.backup_path();
    let folder = Journal::folder_of(&backup_path);
    if let Err(e) = Journal::check(folder, &vehicle) {
        show(status, planned, MissionState::Unknown, e.to_string());
        return Err(e.to_string());
    }
    let (mut kept, mut journal) = (String::new(), None);
    let keep = |backup: &Mission| {
        let text =
            files::text_of(&backup_path, backup, &Fence::default(), vehicle.autopilot, vehicle.mav_type);
        text.and_then(|text| files::write_new(&backup_path, &text)).map_err(|e| e.to_string())?;
        journal =
            Some(Journal::begin(folder, &vehicle, backup, &planned.mission).map_err(|e| e.to_string())?);
        kept = format!("; the mission before is in {}", backup_path.display());
        Ok(())
    };
    let mut words = String::new();
    let tell = |news| {
        let (state, text) = match news {
            News::Phase(Phase::Finished) => return,
            News::Phase(phase) => {
                words = phase_words(phase).to_owned();
                (MissionState::Uploading, words.clone())
            }
            News::Progress(done, total) => (MissionState::Uploading, format!("{words}, {done} of {total}")),
            News::Stranded(text) => (MissionState::Unknown, text),
        };
        show(status, planned, state, text);
    };
    let options = Options::default();
    let outcome = wire::upload(wire, planned.mission.clone(), options, PATIENCE_S, keep, tell).await;
    let mut text = format!("{outcome}{kept}");
    text.push_str(&journal.map(|j| j.settle(&outcome)).unwrap_or_default());
    let state = match outcome {
        Outcome::Verified { .. } => MissionState::OnVehicle,
        Outcome::RestoredPrevious { .. } => MissionState::NotOnVehicle,
        Outcome::Unknown { .. } => MissionState::Unknown,
    };
    show(status, planned, state, text.clone());
    if state == MissionState::OnVehicle { Ok(text) } else { Err(text) }
}

/// A phase in words.
pub fn phase_words(phase: Phase) -> &'static str {
    match phase {
        Phase::BackingUp => "reading the mission that is on board",
        Phase::Uploading => "uploading",
        Phase::ReadingBack => "reading back",
        Phase::Restoring => "putting the previous mission back",
        Phase::Finished => "the transfer is over",
    }
}

/// The links of a run, as an upload sees them.
#[derive(Debug)]
struct RunWire {
    frames: broadcast::Receiver<Received>,
    outbox: mpsc::Sender<RawMessage>,
    vehicle: Option<Vehicle>,
    started: Instant,
    stop: CancellationToken,
    stopping: bool,
}

impl Wire for RunWire {
    fn vehicle(&self) -> Vehicle {
        self.vehicle.unwrap_or(Vehicle::NOBODY)
    }

    fn peers(&self) -> Peers {
        let vehicle = self.vehicle().address;
        Peers::new(Address { system: vehicle.system, component: COMPONENT }, vehicle)
    }

    fn now_s(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn send(&mut self, actions: &[Action]) {
        for action in actions {
            if let Action::Send(message) = action {
                let (id, payload) = codec::encode(self.vehicle().address, message);
                // A full queue is a lost message; the protocol asks again.
                let _ = self.outbox.try_send(RawMessage { id, payload });
            }
        }
    }

    async fn next(&mut self, deadline_s: Option<f64>) -> Event {
        loop {
            if self.stop.is_cancelled() && !self.stopping {
                self.stopping = true;
                return Event::Stopped;
            }
            let left = deadline_s.map_or(BREATH, |t| {
                Duration::from_secs_f64((t - self.now_s()).clamp(0.0, BREATH.as_secs_f64()))
            });
            match tokio::time::timeout(left, self.frames.recv()).await {
                Ok(Ok(received)) => {
                    if let Some(vehicle) = wire::heard(self.vehicle(), &received.frame) {
                        self.vehicle = Some(vehicle);
                    }
                    return Event::Frame(received.frame);
                }
                Ok(Err(RecvError::Lagged(_))) => {}
                // Nobody will ever be heard again: only time passes.
                Ok(Err(RecvError::Closed)) => tokio::time::sleep(left).await,
                Err(_) => {}
            }
            if deadline_s.is_none_or(|t| self.now_s() >= t) {
                return Event::Deadline;
            }
        }
    }
}
