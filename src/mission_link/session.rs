//! Mission transfers over real links: finds the vehicle, keeps the heartbeat, and gives messages and times to the state
//! machines of `gaware-mission`.

use super::codec;
use super::vehicle::Vehicle;
use super::wire::{self, CutOff, Event, News, Wire};
use crate::link::address::Address;
use crate::link::endpoint::{Links, ReceiveClock};
use crate::link::heartbeat::Voice;
use gaware_mission::item::Mission;
use gaware_mission::transfer::verified::{Options, Outcome};
use gaware_mission::transfer::{self, Action, Download, Downloaded, Peers, TransferError};
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Longest wait without a look at heartbeat and cancellation.
const BREATH: Duration = Duration::from_millis(100);
/// Downloads are tried this often.
const DOWNLOADS: u32 = 6;

/// Why there is no session.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SessionError {
    /// Nobody there.
    #[error("no heartbeat of an autopilot within {0} s; check the link, its address and the system id")]
    NoVehicle(u64),
    /// Ctrl-C.
    #[error("cancelled")]
    Cancelled,
}

/// A link to a vehicle.
#[derive(Debug)]
pub struct Session {
    links: Links,
    clock: ReceiveClock,
    voice: Voice,
    vehicle: Vehicle,
    stop: CancellationToken,
    stopping: bool,
}

impl Session {
    /// Opens the links and waits for the heartbeat of an autopilot, or of the one with this system id.
    ///
    /// # Errors
    /// None came in time, or `stop` did.
    pub async fn open(
        addresses: &[Address],
        wanted: Option<u8>,
        patience: Duration,
        stop: &CancellationToken,
    ) -> Result<Self, SessionError> {
        let clock = ReceiveClock::start();
        // The links outlive a cancellation: what was begun has to be put back.
        let mut links = Links::start(addresses, clock, &CancellationToken::new());
        let mut voice = Voice::new();
        let end = tokio::time::Instant::now() + patience;
        loop {
            if let Some(hello) = voice.poll(clock.now_us(), true) {
                links.broadcast(&hello);
            }
            if stop.is_cancelled() {
                links.stop().await;
                return Err(SessionError::Cancelled);
            }
            if tokio::time::Instant::now() >= end {
                links.stop().await;
                return Err(SessionError::NoVehicle(patience.as_secs()));
            }
            let Ok(Some(received)) = tokio::time::timeout(BREATH, links.next()).await else { continue };
            let seen = Vehicle::from_heartbeat(&received.frame);
            let Some(vehicle) = seen.filter(|v| wanted.is_none_or(|id| id == v.address.system)) else {
                continue;
            };
            voice.belongs_to(vehicle.address.system);
            return Ok(Self { links, clock, voice, vehicle, stop: stop.clone(), stopping: false });
        }
    }

    /// Closes the links.
    pub async fn close(self) {
        self.links.stop().await;
    }

    /// Reads the mission on board.
    ///
    /// # Errors
    /// The vehicle does not answer, or refuses, several times; or a cancellation.
    pub async fn download(&mut self) -> Result<Mission, TransferError> {
        let mut left = DOWNLOADS;
        loop {
            left -= 1;
            match self.download_once().await {
                Err(e) if left > 0 && e.is_transient() => {}
                result => return result,
            }
        }
    }

    async fn download_once(&mut self) -> Result<Mission, TransferError> {
        let (mut download, actions) = Download::start(self.peers(), self.now_s());
        self.send(&actions);
        loop {
            if let Some(result) = download.result() {
                let autopilot = self.vehicle.autopilot;
                let read = |got: &Downloaded| Mission::from_wire_items(autopilot, &got.items);
                return result.map(read).map_err(Clone::clone);
            }
            let actions = match self.next(download.deadline()).await {
                Event::Frame(frame) => match codec::decode(&frame) {
                    Some(envelope) => download.receive(self.now_s(), &envelope),
                    None => Vec::new(),
                },
                Event::Deadline => download.tick(self.now_s()),
                Event::Stopped => return Err(TransferError::Cancelled),
            };
            self.send(&actions);
        }
    }

    /// [`wire::upload`] over these links.
    pub async fn upload(
        &mut self,
        mission: Mission,
        options: Options,
        patience: Duration,
        keep: impl FnMut(&Mission) -> Result<(), String>,
        tell: impl FnMut(News),
    ) -> Outcome {
        wire::upload(self, mission, options, patience.as_secs_f64(), keep, tell).await
    }
}

impl Session {
    /// [`wire::resume`] over these links.
    pub async fn resume(
        &mut self,
        cut_off: CutOff,
        options: Options,
        patience: Duration,
        tell: impl FnMut(News),
    ) -> Outcome {
        wire::resume(self, cut_off, options, patience.as_secs_f64(), tell).await
    }
}

impl Wire for Session {
    fn vehicle(&self) -> Vehicle {
        self.vehicle
    }

    async fn next(&mut self, deadline_s: Option<f64>) -> Event {
        loop {
            if let Some(hello) = self.voice.poll(self.clock.now_us(), true) {
                self.links.broadcast(&hello);
            }
            if self.stop.is_cancelled() && !self.stopping {
                self.stopping = true;
                return Event::Stopped;
            }
            let left = deadline_s.map_or(BREATH, |t| {
                Duration::from_secs_f64((t - self.now_s()).clamp(0.0, BREATH.as_secs_f64()))
            });
            match tokio::time::timeout(left, self.links.next()).await {
                Ok(Some(received)) => {
                    if let Some(vehicle) = wire::heard(self.vehicle, &received.frame) {
                        self.vehicle = vehicle;
                    }
                    return Event::Frame(received.frame);
                }
                // Also ends the wait for a link that has come back to nobody.
                _ if deadline_s.is_none_or(|t| self.now_s() >= t) => return Event::Deadline,
                _ => {}
            }
        }
    }

    fn peers(&self) -> Peers {
        let sender = self.voice.sender();
        let me = transfer::Address { system: sender.system_id, component: sender.component_id };
        Peers::new(me, self.vehicle.address)
    }

    fn now_s(&self) -> f64 {
        self.clock.monotonic_ns() as f64 * 1e-9
    }

    fn send(&mut self, actions: &[Action]) {
        for action in actions {
            if let Action::Send(message) = action {
                let (id, payload) = codec::encode(self.vehicle.address, message);
                match self.voice.say_payload(id, &payload) {
                    Ok(frame) => self.links.broadcast(&frame),
                    Err(error) => tracing::error!(%error, "a mission message could not be made"),
                }
            }
        }
    }
}
