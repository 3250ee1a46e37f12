//! Live data for Foxglove and every other viewer that speaks its WebSocket protocol (`foxglove.sdk.v1`, with the older name
//! `foxglove.websocket.v1`; <https://github.com/foxglove/ws-protocol>, docs/foxglove.md).
//!
//! The messages are those of a recording, by the same [`TopicEncoder`]; raw frames, which no viewer decodes, are left out. One task
//! encodes, and one task for each viewer sends. A viewer that is slow misses messages, which are counted, and one that takes nothing is
//! disconnected: the engine never waits. Nothing that a viewer sends reaches the vehicle.

mod entry;
mod protocol;
#[cfg(test)]
mod tests;
mod viewer;

use super::messages::{FRAME_ENCODING, RecordItem, TopicChannel, TopicEncoder};
use super::status::{SinkCounters, SinkStatus};
use super::web::access::Token;
use super::web::door::Door;
use axum::serve::Listener;
use bytes::Bytes;
use entry::Entry;
use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::Arc;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::sync::{broadcast, mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Items that may wait to be encoded.
const ITEMS_AHEAD: usize = 1024;
/// Messages that a viewer may fall behind; at the rates of vehicles some seconds.
const MESSAGES_BEHIND: usize = 1024;

/// Where a run hands over what viewers see.
#[derive(Debug, Clone)]
pub struct Feed {
    items: mpsc::Sender<RecordItem>,
    counters: Arc<SinkCounters>,
    /// What times of items count from, Unix µs.
    origin_us: u64,
}

impl Feed {
    /// The same feed for a run whose times count from this instant, Unix µs.
    #[must_use]
    pub fn counting_from(self, origin_us: u64) -> Self {
        Self { origin_us, ..self }
    }

    /// Hands an item over without waiting.
    pub fn offer(&self, item: &RecordItem) {
        let at = |t_us: &u64| t_us.saturating_add(self.origin_us);
        let item = match item {
            RecordItem::Frame(_) | RecordItem::Setup(_) => return,
            RecordItem::Sample(t_us, sample) => RecordItem::Sample(at(t_us), sample.clone()),
            RecordItem::Snapshot(t_us, snapshot) => RecordItem::Snapshot(at(t_us), snapshot.clone()),
            RecordItem::Log(t_us, severity, text) => RecordItem::Log(at(t_us), *severity, text.clone()),
        };
        if self.items.try_send(item).is_err() {
            self.counters.dropped(1);
        }
    }
}

/// A message on its way to all viewers.
#[derive(Debug)]
struct LiveMessage {
    channel: u32,
    t_ns: u64,
    data: Bytes,
}

/// What viewers can subscribe to, by number.
type Offered = Arc<BTreeMap<u32, TopicChannel>>;

/// What all viewers share.
#[derive(Debug)]
struct Hub {
    offered: watch::Sender<Offered>,
    messages: broadcast::Sender<Arc<LiveMessage>>,
    counters: Arc<SinkCounters>,
    entry: Entry,
    /// Shows a viewer that connects again whether it is the same run.
    session: String,
    stop: CancellationToken,
}

/// The server without its sockets.
#[derive(Debug, Clone)]
pub struct Server {
    hub: Arc<Hub>,
}

impl Server {
    /// A server until `stop`, and its feed. `local` says that only this machine reaches it; viewers from elsewhere need the token.
    /// `session` is new for each run.
    pub fn new(
        local: bool,
        token: Option<Token>,
        session: String,
        status: &SinkStatus,
        stop: CancellationToken,
    ) -> (Self, Feed) {
        let counters = status.sink("foxglove");
        let (items, inbox) = mpsc::channel(ITEMS_AHEAD);
        let encoder = TopicEncoder::new(&[]);
        let hub = Arc::new(Hub {
            offered: watch::Sender::new(offered(&encoder)),
            messages: broadcast::Sender::new(MESSAGES_BEHIND),
            counters: Arc::clone(&counters),
            entry: Entry::new(local, token),
            session,
            stop,
        });
        tokio::spawn(encode(inbox, encoder, Arc::clone(&hub)));
        (Self { hub }, Feed { items, counters, origin_us: 0 })
    }

    /// Serves one connection from handshake to end.
    pub async fn connection(&self, stream: impl AsyncRead + AsyncWrite + Unpin, from: IpAddr) {
        viewer::serve(stream, from, Arc::clone(&self.hub)).await;
    }
}

/// Serves viewers on a socket until `stop`. Where others can reach the listener they need the token. `session` is new for each run.
pub fn serve(
    listener: TcpListener,
    token: Option<Token>,
    session: String,
    status: &SinkStatus,
    stop: CancellationToken,
) -> Feed {
    let local = listener.local_addr().is_ok_and(|a| a.ip().is_loopback());
    let (server, feed) = Server::new(local, token, session, status, stop);
    tokio::spawn(admit(Door::new(listener), server));
    feed
}

/// A task for each viewer.
async fn admit(mut door: Door, server: Server) {
    loop {
        tokio::select! {
            () = server.hub.stop.cancelled() => return,
            (stream, address) = door.accept() => {
                tokio::spawn(viewer::serve(stream, address.ip(), Arc::clone(&server.hub)));
            }
        }
    }
}

/// Makes messages of items until the run or `stop` ends.
async fn encode(mut items: mpsc::Receiver<RecordItem>, mut encoder: TopicEncoder, hub: Arc<Hub>) {
    let mut channels = encoder.channels().len();
    loop {
        let item = tokio::select! {
            () = hub.stop.cancelled() => return,
            item = items.recv() => match item {
                Some(item) => item,
                None => return,
            },
        };
        // Without viewers only what decides about channels counts.
        if hub.messages.receiver_count() == 0 && !matches!(item, RecordItem::Snapshot(..)) {
            continue;
        }
        let messages = encoder.encode(&item);
        if encoder.channels().len() != channels {
            channels = encoder.channels().len();
            hub.offered.send_replace(offered(&encoder));
        }
        for message in messages {
            let Some(channel) = number(message.channel) else { continue };
            let t_ns = message.t_us.saturating_mul(1000);
            let data = Bytes::from(message.data.into_owned());
            // No one may be there.
            let _ = hub.messages.send(Arc::new(LiveMessage { channel, t_ns, data }));
        }
    }
}

/// The number of a channel in the protocol.
fn number(index: usize) -> Option<u32> {
    u32::try_from(index).ok()?.checked_add(1)
}

/// What viewers can decode, the newest channel of each topic.
fn offered(encoder: &TopicEncoder) -> Offered {
    let mut newest = BTreeMap::new();
    for (index, channel) in encoder.channels().iter().enumerate() {
        if channel.encoding != FRAME_ENCODING {
            newest.insert(channel.topic.as_str(), (index, channel));
        }
    }
    let numbered = newest.into_values().filter_map(|(index, c)| Some((number(index)?, c.clone())));
    Arc::new(numbered.collect())
}
