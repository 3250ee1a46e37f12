//! Real links: finds the vehicle and is pinned to it, keeps the heartbeat, signs.

use super::pin;
use super::pinned::{Pinned, RawEvent, RawWire};
use super::vehicle::Vehicle;
use crate::link::address::Address;
use crate::link::endpoint::{Links, Origin, ReceiveClock, Received};
use crate::link::frame::Frame;
use crate::link::guard::Guard;
use crate::link::heartbeat::HeartbeatSource;
use gaware_mission::transfer;
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
    /// One id is not one vehicle.
    #[error("nothing was changed: {0}")]
    Conflict(String),
    /// The key for signing.
    #[error("{0}")]
    Signing(String),
    /// Ctrl-C.
    #[error("cancelled")]
    Cancelled,
}

impl SessionError {
    /// Which of them is meant is not known.
    fn several(heard: &[(Vehicle, Origin)]) -> Self {
        let twice = heard.iter().enumerate().find_map(|(k, (v, origin))| {
            let (_, other) = heard.iter().skip(k + 1).find(|(w, _)| w.address == v.address)?;
            Some(Self::Conflict(pin::two_places(v.address, *origin, *other)))
        });
        twice.unwrap_or_else(|| {
            let names: Vec<String> = heard.iter().map(|(v, _)| v.to_string()).collect();
            Self::SeveralVehicles { count: heard.len(), names: names.join(" and ") }
        })
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

/// Links of a session's own.
pub struct Sockets {
    links: Links,
    clock: ReceiveClock,
    voice: HeartbeatSource,
    guard: Option<Guard>,
    stop: CancellationToken,
    stopping: bool,
}

/// A link to a vehicle.
pub type Session = Pinned<Sockets>;

impl Session {
    /// Opens the links and waits for the heartbeat of an autopilot, or of the one with this system id; asks it for its hardware id.
    ///
    /// # Errors
    /// None came in time, there are several to choose from or several with one id, the key cannot be used, or `stop` came.
    pub async fn open(to: &Opening<'_>, stop: &CancellationToken) -> Result<Self, SessionError> {
        let mut sockets = Sockets::open(to, stop)?;
        let (vehicle, origin) = match sockets.choose(to).await {
            Ok(chosen) => chosen,
            Err(error) => {
                sockets.close().await;
                return Err(error);
            }
        };
        sockets.voice.belongs_to(vehicle.address.system);
        sockets.links.follow(vehicle.address.system);
        let mut session = Self::new(sockets, vehicle, origin);
        match session.identify().await {
            Ok(()) => Ok(session),
            Err(words) => {
                let cancelled = session.raw.stopping;
                session.close().await;
                Err(if cancelled { SessionError::Cancelled } else { SessionError::Conflict(words) })
            }
        }
    }

    /// Closes the links.
    pub async fn close(self) {
        self.raw.close().await;
    }
}

impl Sockets {
    fn open(to: &Opening<'_>, stop: &CancellationToken) -> Result<Self, SessionError> {
        let clock = ReceiveClock::start();
        let guard = to.signing_key.map(Guard::load).transpose();
        let guard = guard.map_err(|e| SessionError::Signing(e.to_string()))?;
        // The links outlive a cancellation: what was begun has to be put back.
        let links = Links::start(to.addresses, clock, &CancellationToken::new());
        let voice = HeartbeatSource::passing();
        Ok(Self { links, clock, voice, guard, stop: stop.clone(), stopping: false })
    }

    /// The vehicle asked for, or the only one there is.
    async fn choose(&mut self, to: &Opening<'_>) -> Result<(Vehicle, Origin), SessionError> {
        let end = tokio::time::Instant::now() + to.patience;
        let mut heard: Vec<(Vehicle, Origin)> = Vec::new();
        let mut listened = None;
        loop {
            self.say_hello();
            if self.stop.is_cancelled() {
                return Err(SessionError::Cancelled);
            }
            let now = tokio::time::Instant::now();
            match heard.as_slice() {
                [] if now >= end => return Err(SessionError::NoVehicle(to.patience.as_secs())),
                [one] if listened.is_some_and(|until| now >= until) => return Ok(*one),
                [] | [_] => {}
                [..] => return Err(SessionError::several(&heard)),
            }
            let Some(received) = self.receive(BREATH).await else { continue };
            let seen = Vehicle::from_heartbeat(&received.frame);
            let Some(vehicle) = seen.filter(|v| to.vehicle.is_none_or(|id| id == v.address.system)) else {
                continue;
            };
            let origin = received.origin();
            if heard.iter().all(|(v, from)| (v.address, *from) != (vehicle.address, origin)) {
                heard.push((vehicle, origin));
                listened.get_or_insert(tokio::time::Instant::now() + OTHERS);
            }
        }
    }

    /// A heartbeat where one is due.
    fn say_hello(&mut self) {
        let Some(hello) = self.voice.poll(self.clock.now_us(), true) else { return };
        for link in 0..self.links.handles().len() {
            self.send(&hello, Origin { link: u16::try_from(link).unwrap_or(u16::MAX), peer: None });
        }
    }

    /// Each link is a stream of signatures of its own.
    fn send(&mut self, frame: &Frame, to: Origin) {
        let Some(handle) = self.links.handles().get(usize::from(to.link)) else { return };
        let signed = match &mut self.guard {
            Some(guard) => guard.sign(frame, u8::try_from(to.link).unwrap_or(u8::MAX), self.clock.now_us()),
            None => frame.clone(),
        };
        handle.send_to(signed, to.peer);
    }

    /// The next frame that is accepted, if one comes in this time.
    async fn receive(&mut self, wait: Duration) -> Option<Received> {
        let received = tokio::time::timeout(wait, self.links.next()).await.ok().flatten()?;
        match self.guard.as_mut().and_then(|g| g.refuse(&received.frame, received.t_us)) {
            None => Some(received),
            Some(refusal) => {
                if let Some(text) = refusal.first_of_its_kind {
                    tracing::warn!("{text}");
                }
                None
            }
        }
    }

    async fn close(mut self) {
        if let Some(guard) = &mut self.guard {
            guard.close();
        }
        self.links.stop().await;
    }
}

impl RawWire for Sockets {
    fn now_s(&self) -> f64 {
        self.clock.monotonic_ns() as f64 * 1e-9
    }

    fn me(&self) -> transfer::Address {
        let sender = self.voice.sender();
        transfer::Address { system: sender.system_id, component: sender.component_id }
    }

    fn send_to(&mut self, to: Origin, id: u32, payload: Vec<u8>) {
        match self.voice.say_payload(id, &payload) {
            Ok(frame) => self.send(&frame, to),
            Err(error) => tracing::error!(%error, "a message could not be made"),
        }
    }

    async fn next_of_all(&mut self, deadline_s: f64) -> RawEvent {
        loop {
            self.say_hello();
            if self.stop.is_cancelled() && !self.stopping {
                self.stopping = true;
                return RawEvent::Stopped;
            }
            let left = (deadline_s - self.now_s()).clamp(0.0, BREATH.as_secs_f64());
            if let Some(received) = self.receive(Duration::from_secs_f64(left)).await {
                return RawEvent::Frame(received.origin(), received.frame);
            }
            if self.now_s() >= deadline_s {
                return RawEvent::Deadline;
            }
        }
    }
}
