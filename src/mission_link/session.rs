//! Real links as a [`Wire`]: finds the vehicle, keeps the heartbeat, signs.

use super::vehicle::Vehicle;
use super::wire::{self, Event, Wire};
use crate::commands::run::guard::Guard;
use crate::link::address::Address;
use crate::link::endpoint::{Links, ReceiveClock};
use crate::link::frame::Frame;
use crate::link::heartbeat::HeartbeatSource;
use gaware_mission::transfer::{self, Peers};
use std::path::Path;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Longest wait without a look at heartbeat and cancellation.
const BREATH: Duration = Duration::from_millis(100);
/// After the first vehicle others may be received for so long: heartbeats come once a second.
const OTHERS: Duration = Duration::from_millis(1500);

/// Why there is no session.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SessionError {
    /// No one there.
    #[error("no heartbeat of an autopilot within {0} s; check the link, its address and the system id")]
    NoVehicle(u64),
    /// Which one is meant?
    #[error("there are {count} vehicles on the link: {names}; choose one with --vehicle")]
    SeveralVehicles {
        /// How many were received.
        count: usize,
        /// All of them.
        names: String,
    },
    /// The key for signing.
    #[error("{0}")]
    Signing(String),
    /// Ctrl-C.
    #[error("cancelled")]
    Cancelled,
}

impl SessionError {
    fn several(heard: &[Vehicle]) -> Self {
        let names: Vec<String> = heard.iter().map(ToString::to_string).collect();
        Self::SeveralVehicles { count: heard.len(), names: names.join(" and ") }
    }
}

/// Where the vehicle is to be found.
#[derive(Debug, Clone, Copy)]
pub struct Opening<'a> {
    /// Links.
    pub addresses: &'a [Address],
    /// Its system id, where the user has chosen.
    pub vehicle: Option<u8>,
    /// How long to wait for it.
    pub patience: Duration,
    /// File of the signing key.
    pub signing_key: Option<&'a Path>,
}

/// A link to a vehicle.
pub struct Session {
    links: Links,
    clock: ReceiveClock,
    voice: HeartbeatSource,
    vehicle: Vehicle,
    guard: Option<Guard>,
    stop: CancellationToken,
    stopping: bool,
}

impl Session {
    /// Opens the links and waits for the heartbeat of an autopilot, or of the one with this system id.
    ///
    /// # Errors
    /// None came in time, there are several to choose from, the key cannot be used, or `stop` came.
    pub async fn open(to: &Opening<'_>, stop: &CancellationToken) -> Result<Self, SessionError> {
        let clock = ReceiveClock::start();
        let guard = to.signing_key.map(Guard::load).transpose();
        let guard = guard.map_err(|e| SessionError::Signing(e.to_string()))?;
        // The links outlive a cancellation: what was begun has to be put back.
        let links = Links::start(to.addresses, clock, &CancellationToken::new());
        let mut session = Self {
            links,
            clock,
            voice: HeartbeatSource::new(),
            vehicle: Vehicle::UNKNOWN,
            guard,
            stop: stop.clone(),
            stopping: false,
        };
        match session.choose(to).await {
            Ok(vehicle) => {
                session.voice.belongs_to(vehicle.address.system);
                session.links.follow(vehicle.address.system);
                session.vehicle = vehicle;
                Ok(session)
            }
            Err(error) => {
                session.close().await;
                Err(error)
            }
        }
    }

    /// The vehicle asked for, or the only one there is.
    async fn choose(&mut self, to: &Opening<'_>) -> Result<Vehicle, SessionError> {
        let end = tokio::time::Instant::now() + to.patience;
        let mut heard: Vec<Vehicle> = Vec::new();
        let mut listened = None;
        loop {
            self.say_hello();
            if self.stop.is_cancelled() {
                return Err(SessionError::Cancelled);
            }
            let now = tokio::time::Instant::now();
            match heard.as_slice() {
                [] if now >= end => return Err(SessionError::NoVehicle(to.patience.as_secs())),
                [] => {}
                [one] if to.vehicle.is_some() => return Ok(*one),
                [one] if listened.is_some_and(|until| now >= until) => return Ok(*one),
                [_] => {}
                [..] => return Err(SessionError::several(&heard)),
            }
            let Some(frame) = self.receive(BREATH).await else { continue };
            let seen = Vehicle::from_heartbeat(&frame);
            let Some(vehicle) = seen.filter(|v| to.vehicle.is_none_or(|id| id == v.address.system)) else {
                continue;
            };
            if heard.iter().all(|v| v.address != vehicle.address) {
                heard.push(vehicle);
                listened.get_or_insert(tokio::time::Instant::now() + OTHERS);
            }
        }
    }

    /// A heartbeat where one is due.
    fn say_hello(&mut self) {
        if let Some(hello) = self.voice.poll(self.clock.now_us(), true) {
            self.broadcast(&hello);
        }
    }

    fn broadcast(&mut self, frame: &Frame) {
        match &mut self.guard {
            // Each link is a stream of signatures of its own.
            Some(guard) => {
                for (link, handle) in self.links.handles().iter().enumerate() {
                    let link = u8::try_from(link).unwrap_or(u8::MAX);
                    handle.send(guard.sign(frame, link, self.clock.now_us()));
                }
            }
            None => self.links.broadcast(frame),
        }
    }

    /// The next frame that is accepted, if one comes in this time.
    async fn receive(&mut self, wait: Duration) -> Option<Frame> {
        let received = tokio::time::timeout(wait, self.links.next()).await.ok().flatten()?;
        match self.guard.as_mut().and_then(|g| g.refuse(&received.frame, received.t_us)) {
            None => Some(received.frame),
            Some(refusal) => {
                if let Some(text) = refusal.first_of_its_kind {
                    tracing::warn!("{text}");
                }
                None
            }
        }
    }

    /// Closes the links.
    pub async fn close(mut self) {
        if let Some(guard) = &mut self.guard {
            guard.close();
        }
        self.links.stop().await;
    }
}

impl Wire for Session {
    fn vehicle(&self) -> Vehicle {
        self.vehicle
    }

    async fn next(&mut self, deadline_s: Option<f64>) -> Event {
        loop {
            self.say_hello();
            if self.stop.is_cancelled() && !self.stopping {
                self.stopping = true;
                return Event::Stopped;
            }
            let left = deadline_s.map_or(BREATH, |t| {
                Duration::from_secs_f64((t - self.now_s()).clamp(0.0, BREATH.as_secs_f64()))
            });
            if let Some(frame) = self.receive(left).await {
                if let Some(vehicle) = wire::heartbeat_of(self.vehicle, &frame) {
                    self.vehicle = vehicle;
                }
                return Event::Frame(frame);
            }
            // Also ends the wait for a link that has come back to no one.
            if deadline_s.is_none_or(|t| self.now_s() >= t) {
                return Event::Deadline;
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

    fn send_payload(&mut self, id: u32, payload: Vec<u8>) {
        match self.voice.say_payload(id, &payload) {
            Ok(frame) => self.broadcast(&frame),
            Err(error) => tracing::error!(%error, "a message could not be made"),
        }
    }
}
