//! The links of a run as a change of the vehicle sees them: frames from a broadcast, messages into the outbox of the run.

use super::vehicle::Vehicle;
use super::wire::{self, Event, Wire};
use crate::link::endpoint::Received;
use crate::link::heartbeat::COMPONENT;
use gaware_mission::transfer::{Address, Peers};
use std::time::Duration;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, mpsc};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// Longest wait without a look around.
const BREATH: Duration = Duration::from_millis(100);
/// Shortest wait, the resolution of timers: a deadline that is closer must not be asked for again and again.
const TICK: Duration = Duration::from_millis(1);

/// A message for the vehicle by its id and payload: a backup may hold what the dialect's types refuse.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawMessage {
    /// Message id.
    pub id: u32,
    /// Payload, MAVLink 2.
    pub payload: Vec<u8>,
}

/// The links.
#[derive(Debug)]
pub(super) struct RunWire {
    pub(super) frames: broadcast::Receiver<Received>,
    outbox: mpsc::Sender<RawMessage>,
    pub(super) vehicle: Option<Vehicle>,
    started: Instant,
    pub(super) stop: CancellationToken,
    stopping: bool,
}

impl RunWire {
    pub(super) fn new(frames: broadcast::Receiver<Received>, outbox: mpsc::Sender<RawMessage>) -> Self {
        let (started, stop) = (Instant::now(), CancellationToken::new());
        Self { frames, outbox, vehicle: None, started, stop, stopping: false }
    }
}

impl Wire for RunWire {
    fn vehicle(&self) -> Vehicle {
        self.vehicle.unwrap_or(Vehicle::UNKNOWN)
    }

    fn peers(&self) -> Peers {
        let vehicle = self.vehicle().address;
        Peers::new(Address { system: vehicle.system, component: COMPONENT }, vehicle)
    }

    fn now_s(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn send_payload(&mut self, id: u32, payload: Vec<u8>) {
        // A full queue is a lost message; the protocols ask again.
        let _ = self.outbox.try_send(RawMessage { id, payload });
    }

    async fn next(&mut self, deadline_s: Option<f64>) -> Event {
        loop {
            if self.stop.is_cancelled() && !self.stopping {
                self.stopping = true;
                return Event::Stopped;
            }
            let left = deadline_s.map_or(BREATH, |t| {
                Duration::from_secs_f64((t - self.now_s()).clamp(TICK.as_secs_f64(), BREATH.as_secs_f64()))
            });
            match tokio::time::timeout(left, self.frames.recv()).await {
                Ok(Ok(received)) => {
                    if let Some(vehicle) = wire::heartbeat_of(self.vehicle(), &received.frame) {
                        self.vehicle = Some(vehicle);
                    }
                    return Event::Frame(received.frame);
                }
                Ok(Err(RecvError::Lagged(_))) => {}
                // No one will ever be heard again: only time passes.
                Ok(Err(RecvError::Closed)) => tokio::time::sleep(left).await,
                Err(_) => {}
            }
            if deadline_s.is_none_or(|t| self.now_s() >= t) {
                return Event::Deadline;
            }
        }
    }
}
