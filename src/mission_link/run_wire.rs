//! The links of a run as a change of the vehicle sees them: frames from a broadcast, messages into the outbox of the run.

use super::pinned::{RawEvent, RawWire};
use crate::link::endpoint::{Origin, Received};
use crate::link::heartbeat::COMPONENT;
use gaware_mission::transfer::Address;
use std::time::Duration;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, mpsc};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;

/// Shortest wait, the resolution of timers: a deadline that is closer must not be asked for again and again.
const TICK: Duration = Duration::from_millis(1);
/// Longest wait, s: longer than any deadline that is meant.
const LONGEST_S: f64 = 3600.0;

/// A message for the vehicle by its id and payload: a backup may hold what the dialect's types refuse.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawMessage {
    /// To the vehicle there, and to no other.
    pub to: Origin,
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
    /// System id of the vehicle, which is ours too.
    pub(super) system: u8,
    started: Instant,
    pub(super) stop: CancellationToken,
    stopping: bool,
}

impl RunWire {
    pub(super) fn new(frames: broadcast::Receiver<Received>, outbox: mpsc::Sender<RawMessage>) -> Self {
        let (started, stop) = (Instant::now(), CancellationToken::new());
        Self { frames, outbox, system: 0, started, stop, stopping: false }
    }
}

impl RawWire for RunWire {
    fn now_s(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn me(&self) -> Address {
        Address { system: self.system, component: COMPONENT }
    }

    fn send_to(&mut self, to: Origin, id: u32, payload: Vec<u8>) {
        // A full queue is a lost message; the protocols ask again.
        let _ = self.outbox.try_send(RawMessage { to, id, payload });
    }

    async fn next_of_all(&mut self, deadline_s: f64) -> RawEvent {
        let left = Duration::from_secs_f64((deadline_s - self.now_s()).clamp(0.0, LONGEST_S));
        let until = Instant::now() + left.max(TICK);
        let mut closed = false;
        loop {
            tokio::select! {
                biased;
                () = self.stop.cancelled(), if !self.stopping => {
                    self.stopping = true;
                    return RawEvent::Stopped;
                }
                received = self.frames.recv(), if !closed => match received {
                    Ok(received) => return RawEvent::Frame(received.origin(), received.frame),
                    Err(RecvError::Lagged(_)) => {}
                    // Nothing will ever be received again: only time passes.
                    Err(RecvError::Closed) => closed = true,
                },
                () = sleep_until(until) => return RawEvent::Deadline,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wire whose links never say anything, or are gone.
    fn silent(gone: bool) -> (RunWire, Option<broadcast::Sender<Received>>) {
        let (frames, received) = broadcast::channel(4);
        let (outbox, _) = mpsc::channel(4);
        (RunWire::new(received, outbox), (!gone).then_some(frames))
    }

    #[tokio::test(start_paused = true)]
    async fn a_stop_is_heard_at_once_and_once_however_late_the_deadline() {
        for gone in [false, true] {
            let (mut wire, _frames) = silent(gone);
            let stop = wire.stop.clone();
            let stopped = async {
                tokio::time::sleep(Duration::from_millis(1234)).await;
                stop.cancel();
            };
            let began = Instant::now();
            let (event, ()) = tokio::join!(wire.next_of_all(600.0), stopped);
            assert!(matches!(event, RawEvent::Stopped), "{event:?}");
            assert_eq!(began.elapsed(), Duration::from_millis(1234));
            assert!(matches!(wire.next_of_all(600.0).await, RawEvent::Deadline));
            assert_eq!(began.elapsed(), Duration::from_secs(600));
        }
    }
}
