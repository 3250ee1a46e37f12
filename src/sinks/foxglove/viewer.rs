//! One viewer from handshake to end. On a socket its connection has the deadlines of the web server's: who does not finish the
//! handshake, or takes nothing for ten seconds, is disconnected.

use super::protocol::{self, Ask, Subscriptions};
use super::{Hub, LiveMessage, Offered};
use futures_util::{SinkExt, StreamExt};
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::broadcast::Receiver;
use tokio::sync::broadcast::error::RecvError;
use tokio::time::{Instant, MissedTickBehavior};
use tokio_tungstenite::tungstenite::Error;
use tokio_tungstenite::tungstenite::handshake::server::{Request, Response};
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::protocol::{CloseFrame, Message, WebSocketConfig};
use tokio_tungstenite::{WebSocketStream, accept_hdr_async_with_config};

/// Bytes of a viewer's request at most: subscriptions to all channels take a thousand.
const MAX_REQUEST_BYTES: usize = 64 * 1024;
/// A viewer that has subscribed to nothing still has to be there.
const PING: Duration = Duration::from_secs(5);
/// For the answer to a closing message.
const FAREWELL: Duration = Duration::from_secs(1);

/// Serves one connection to its end.
pub(super) async fn serve(stream: impl AsyncRead + AsyncWrite + Unpin, from: IpAddr, hub: Arc<Hub>) {
    let config = WebSocketConfig::default()
        .max_message_size(Some(MAX_REQUEST_BYTES))
        .max_frame_size(Some(MAX_REQUEST_BYTES));
    let mut place = None;
    #[expect(clippy::result_large_err, reason = "the library's own type of an answer")]
    let answer = |request: &Request, response: Response| {
        let (response, taken) = hub.entry.answer(from, request, response)?;
        place = Some(taken);
        Ok(response)
    };
    // A handshake that fails, or was refused, has been answered.
    let Ok(socket) = accept_hdr_async_with_config(stream, answer, Some(config)).await else { return };
    let _place = place;
    let mut viewer =
        Viewer { socket, hub, offered: Offered::default(), subscriptions: Subscriptions::default() };
    let mut messages = viewer.hub.messages.subscribe();
    // However it ends, only this viewer is concerned.
    match viewer.run(&mut messages).await {
        Ok(Some((code, reason))) => viewer.close(code, reason).await,
        Ok(None) => {}
        // It took nothing for too long, or its link broke: what was to come is lost to it.
        Err(_) => viewer.hub.counters.dropped(messages.len() as u64),
    }
}

struct Viewer<S> {
    socket: WebSocketStream<S>,
    hub: Arc<Hub>,
    /// What it knows.
    offered: Offered,
    subscriptions: Subscriptions,
}

/// Why the server ends a connection: the protocol's code and words. Nothing where the viewer ended it.
type Ending = Option<(CloseCode, &'static str)>;

impl<S: AsyncRead + AsyncWrite + Unpin> Viewer<S> {
    async fn run(&mut self, messages: &mut Receiver<Arc<LiveMessage>>) -> Result<Ending, Error> {
        let hub = Arc::clone(&self.hub);
        let mut offered = hub.offered.subscribe();
        let mut ping = tokio::time::interval_at(Instant::now() + PING, PING);
        ping.set_missed_tick_behavior(MissedTickBehavior::Delay);
        self.say(protocol::server_info(&hub.session)).await?;
        offered.mark_changed();
        loop {
            tokio::select! {
                biased;
                () = hub.stop.cancelled() => return Ok(Some((CloseCode::Away, "the run has ended"))),
                Ok(()) = offered.changed() => {
                    let now = Arc::clone(&offered.borrow_and_update());
                    self.offer(now).await?;
                }
                request = self.socket.next() => match request {
                    Some(request) => {
                        let ending = self.receive(request?).await?;
                        if ending.is_some() {
                            return Ok(ending);
                        }
                    }
                    None => return Ok(None),
                },
                message = messages.recv() => match message {
                    Ok(message) => self.pass_on(&message).await?,
                    Err(RecvError::Lagged(missed)) => hub.counters.dropped(missed),
                    Err(RecvError::Closed) => return Ok(Some((CloseCode::Away, "the run has ended"))),
                },
                _ = ping.tick() => self.socket.send(Message::Ping(bytes::Bytes::new())).await?,
            }
        }
    }

    /// Reports to it which channels have gone and come.
    async fn offer(&mut self, now: Offered) -> Result<(), Error> {
        let before = std::mem::replace(&mut self.offered, Arc::clone(&now));
        let gone: Vec<u32> = before.keys().filter(|id| !now.contains_key(id)).copied().collect();
        if !gone.is_empty() {
            gone.iter().for_each(|id| self.subscriptions.forget(*id));
            self.say(protocol::unadvertise(&gone)).await?;
        }
        let new = now.iter().filter(|(id, _)| !before.contains_key(id));
        self.say(protocol::advertise(new)).await
    }

    async fn receive(&mut self, request: Message) -> Result<Ending, Error> {
        let text = match request {
            Message::Text(text) => text,
            Message::Binary(_) => {
                return Ok(Some((CloseCode::Unsupported, "binary messages are not taken")));
            }
            // The library answers them.
            Message::Ping(_) | Message::Pong(_) | Message::Close(_) | Message::Frame(_) => return Ok(None),
        };
        let Ok(ask) = serde_json::from_str::<Ask>(&text) else {
            return Ok(Some((CloseCode::Invalid, "this is no request of the protocol")));
        };
        let offered = Arc::clone(&self.offered);
        for text in self.subscriptions.ask(ask, |id| offered.contains_key(&id)) {
            self.say(protocol::warning(&text)).await?;
        }
        Ok(None)
    }

    async fn pass_on(&mut self, message: &LiveMessage) -> Result<(), Error> {
        if let Some(subscription) = self.subscriptions.of(message.channel) {
            let data = protocol::message_data(subscription, message);
            self.socket.send(Message::Binary(data.into())).await?;
            self.hub.counters.delivered(1);
        }
        Ok(())
    }

    async fn say(&mut self, text: String) -> Result<(), Error> {
        self.socket.send(Message::Text(text.into())).await
    }

    /// Says why, and waits a moment for the viewer to have received it.
    async fn close(&mut self, code: CloseCode, reason: &'static str) {
        let farewell = async {
            self.socket.close(Some(CloseFrame { code, reason: reason.into() })).await?;
            while let Some(Ok(_)) = self.socket.next().await {}
            Ok::<(), Error>(())
        };
        // It ends either way.
        let _ = tokio::time::timeout(FAREWELL, farewell).await;
    }
}
