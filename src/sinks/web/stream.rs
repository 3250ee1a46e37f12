//! `GET /api/v1/events`: server-sent events, one pump per browser.
//!
//! The pump takes the newest snapshot when the browser can take one, never more often than the server's rate. A
//! browser that stops reading makes its own pump wait, and what it misses is counted; no one else notices.

use super::Shared;
use super::door::{Place, Visitor};
use crate::engine::snapshot::Snapshot;
use crate::sinks::status::SinkCounters;
use axum::extract::{ConnectInfo, State};
use axum::http::StatusCode;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;
use tokio_stream::wrappers::ReceiverStream;

/// Events under way to a browser: little, so that what it shows is fresh.
const QUEUE: usize = 2;
/// A browser that took nothing for so long is given up.
const STALLED: Duration = Duration::from_secs(10);
/// For a browser to take the last events.
const FAREWELL: Duration = Duration::from_millis(500);
/// Between two looks at link, recorder and counters.
const SINKS_PERIOD: Duration = Duration::from_secs(1);

type Sender = mpsc::Sender<Result<Event, Infallible>>;

/// Opens a stream: `snapshot` events at the server's rate, `sinks` events once a second, and `end` where the program ends.
pub(super) async fn events(
    State(shared): State<Arc<Shared>>,
    ConnectInfo(Visitor(address)): ConnectInfo<Visitor>,
) -> Response {
    let Some(place) = shared.streams.take(address) else {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many pages are open\n").into_response();
    };
    let (tx, rx) = mpsc::channel(QUEUE);
    tokio::spawn(Pump::new(shared, tx, place).run());
    Sse::new(ReceiverStream::new(rx))
        .keep_alive(KeepAlive::new().interval(Duration::from_secs(5)))
        .into_response()
}

struct Pump {
    shared: Arc<Shared>,
    snapshots: watch::Receiver<Arc<Snapshot>>,
    counters: Arc<SinkCounters>,
    tx: Sender,
    period: Duration,
    _place: Place,
}

/// Why a pump ends.
struct Ended;

impl Pump {
    fn new(shared: Arc<Shared>, tx: Sender, place: Place) -> Self {
        let mut snapshots = shared.state.snapshots.clone();
        snapshots.mark_changed();
        Self {
            snapshots,
            counters: shared.state.status.sink("web"),
            tx,
            period: Duration::from_secs_f64(1.0 / shared.state.max_rate_hz),
            _place: place,
            shared,
        }
    }

    async fn run(mut self) {
        let shutdown = self.shared.shutdown.clone();
        tokio::select! {
            // It ends either way.
            () = shutdown.cancelled() => drop(tokio::time::timeout(FAREWELL, self.farewell()).await),
            Ended = self.pump() => {}
        }
    }

    /// The newest state once more, and that nothing will follow: an orderly end is no lost connection.
    async fn farewell(&self) -> Result<(), Ended> {
        let snapshot = Arc::clone(&self.snapshots.borrow());
        let end = Event::default().event("end").data("the program has ended");
        for event in [snapshot_event(&snapshot)?, self.sinks_event()?, end] {
            self.tx.send(Ok(event)).await.map_err(|_| Ended)?;
        }
        Ok(())
    }

    fn sinks_event(&self) -> Result<Event, Ended> {
        Event::default().event("sinks").json_data(self.shared.state.status.view()).map_err(|_| Ended)
    }

    async fn pump(&mut self) -> Ended {
        let mut sinks_due = Instant::now();
        let mut engine_lives = true;
        loop {
            if Instant::now() >= sinks_due {
                sinks_due = Instant::now() + SINKS_PERIOD;
                if let Err(ended) = self.send_sinks() {
                    return ended;
                }
            }
            if !engine_lives {
                // The last snapshot stays on the page, link and recorder go on.
                tokio::time::sleep_until(sinks_due).await;
                continue;
            }
            match tokio::time::timeout_at(sinks_due, self.snapshots.changed()).await {
                Err(_elapsed) => continue,
                Ok(Err(_)) => engine_lives = false,
                Ok(Ok(())) => {
                    let started = Instant::now();
                    if let Err(ended) = self.send_snapshot().await {
                        return ended;
                    }
                    tokio::time::sleep_until(started + self.period).await;
                }
            }
        }
    }

    /// Sends the view of the sinks, or skips it where the browser is slow: the next one says the same.
    fn send_sinks(&self) -> Result<(), Ended> {
        match self.tx.try_reserve() {
            Ok(permit) => {
                permit.send(Ok(self.sinks_event()?));
                Ok(())
            }
            Err(mpsc::error::TrySendError::Full(())) => Ok(()),
            Err(mpsc::error::TrySendError::Closed(())) => Err(Ended),
        }
    }

    /// Waits until the browser takes an event, counting the snapshots that pass by, and sends the newest.
    async fn send_snapshot(&mut self) -> Result<(), Ended> {
        let give_up = Instant::now() + STALLED;
        let mut seen = self.snapshots.borrow_and_update().sequence;
        let permit = loop {
            tokio::select! {
                biased;
                permit = self.tx.reserve() => break permit.map_err(|_| Ended)?,
                Ok(()) = self.snapshots.changed() => {
                    let now = self.snapshots.borrow_and_update().sequence;
                    self.counters.dropped(now.saturating_sub(seen).max(1));
                    seen = now;
                }
                () = tokio::time::sleep_until(give_up) => return Err(Ended),
            }
        };
        let snapshot = Arc::clone(&self.snapshots.borrow_and_update());
        permit.send(Ok(snapshot_event(&snapshot)?));
        self.counters.delivered(1);
        Ok(())
    }
}

fn snapshot_event(snapshot: &Snapshot) -> Result<Event, Ended> {
    Event::default()
        .event("snapshot")
        .id(snapshot.sequence.to_string())
        .json_data(snapshot)
        .map_err(|_| Ended)
}
