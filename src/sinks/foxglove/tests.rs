//! The server as viewers reach it, over real sockets, and who may come in.

use super::entry::Entry;
use super::*;
use crate::engine::snapshot::{ParameterEstimate, Snapshot};
use crate::sensors::Severity;
use axum::http::StatusCode;
use axum::http::header::{HOST, ORIGIN, SEC_WEBSOCKET_PROTOCOL};
use futures_util::{SinkExt, StreamExt};
use gaware_nav::sample::{ImuSample, Sample};
use nalgebra::Vector3;
use serde_json::{Value, json};
use std::net::SocketAddr;
use tokio::net::TcpStream;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::handshake::server::{Request, Response};
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;

struct Server {
    address: SocketAddr,
    feed: Feed,
    status: Arc<SinkStatus>,
    _stop: tokio_util::sync::DropGuard,
}

async fn server() -> Server {
    let listener = crate::sinks::web::door::bind(([127, 0, 0, 1], 0).into()).unwrap();
    let address = listener.local_addr().unwrap();
    let (status, stop) = (SinkStatus::new(), CancellationToken::new());
    let feed = serve(listener, None, "run 1".to_owned(), &status, stop.clone());
    Server { address, feed, status, _stop: stop.drop_guard() }
}

struct Client {
    socket: WebSocketStream<TcpStream>,
    protocol: String,
}

impl Client {
    async fn connect(address: SocketAddr, protocols: &str) -> Result<Self, u16> {
        let mut request = format!("ws://{address}/").into_client_request().unwrap();
        request.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, protocols.parse().unwrap());
        let stream = TcpStream::connect(address).await.unwrap();
        match tokio_tungstenite::client_async(request, stream).await {
            Ok((socket, answer)) => {
                let protocol = answer.headers()[SEC_WEBSOCKET_PROTOCOL].to_str().unwrap().to_owned();
                Ok(Self { socket, protocol })
            }
            Err(tokio_tungstenite::tungstenite::Error::Http(answer)) => Err(answer.status().as_u16()),
            Err(other) => panic!("{other}"),
        }
    }

    /// Connected, introduced, with the advertised channels by topic.
    async fn viewer(address: SocketAddr) -> (Self, BTreeMap<String, Value>) {
        let mut client = Self::connect(address, "foxglove.sdk.v1").await.unwrap();
        assert_eq!(client.text().await["op"], "serverInfo");
        let channels = by_topic(&client.text().await);
        (client, channels)
    }

    async fn next(&mut self) -> Message {
        loop {
            match self.socket.next().await.unwrap().unwrap() {
                Message::Ping(_) | Message::Pong(_) => {}
                other => return other,
            }
        }
    }

    async fn text(&mut self) -> Value {
        match self.next().await {
            Message::Text(text) => serde_json::from_str(&text).unwrap(),
            other => panic!("{other:?}"),
        }
    }

    /// The subscription, the time in ns, and the content of the next message.
    async fn data(&mut self) -> (u32, u64, Value) {
        match self.next().await {
            Message::Binary(bytes) => {
                assert_eq!(bytes[0], 1);
                let id = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                let t_ns = u64::from_le_bytes(bytes[5..13].try_into().unwrap());
                (id, t_ns, serde_json::from_slice(&bytes[13..]).unwrap())
            }
            other => panic!("{other:?}"),
        }
    }

    async fn say(&mut self, text: &str) {
        self.socket.send(Message::Text(text.into())).await.unwrap();
    }

    async fn subscribe(&mut self, id: u32, channel: &Value) {
        let subscriptions = json!([{"id": id, "channelId": channel["id"]}]);
        self.say(&json!({"op": "subscribe", "subscriptions": subscriptions}).to_string()).await;
        // A request that is answered: the one before has been carried out by then.
        self.say(r#"{"op": "getParameters"}"#).await;
        assert_eq!(self.text().await["op"], "status");
    }
}

fn by_topic(advertise: &Value) -> BTreeMap<String, Value> {
    assert_eq!(advertise["op"], "advertise");
    let channels = advertise["channels"].as_array().unwrap();
    channels.iter().map(|c| (c["topic"].as_str().unwrap().to_owned(), c.clone())).collect()
}

fn log(text: &str) -> RecordItem {
    RecordItem::Log(7, Severity::Info, text.to_owned())
}

#[tokio::test]
async fn a_viewer_gets_the_channels_and_the_messages_of_a_recording() {
    let server = server().await;
    let (mut client, channels) = Client::viewer(server.address).await;
    let encoder = TopicEncoder::new(&[]);
    assert_eq!(channels.len(), encoder.channels().len());
    for channel in encoder.channels() {
        let advertised = &channels[&channel.topic];
        assert_eq!(advertised["encoding"], "json");
        assert_eq!(advertised["schemaName"], channel.schema.as_ref().map_or("", |s| s.name));
        assert_eq!(advertised["schema"], channel.schema.as_ref().map_or("", |s| &s.text));
    }
    client.subscribe(42, &channels["/imu"]).await;
    let imu = ImuSample { t_s: 1.5, gyro: Vector3::x(), accel: Vector3::y(), temperature_degc: None };
    // A log line, which it has not asked for, is not sent.
    server.feed.offer(&log("a line"));
    server.feed.clone().counting_from(1_000_000).offer(&RecordItem::Sample(500, Sample::Imu(imu)));
    let (id, t_ns, content) = client.data().await;
    assert_eq!((id, t_ns), (42, 1_000_500_000));
    let expected = json!({"t_s": 1.5, "gyro_rad_per_s": [1.0, 0.0, 0.0], "accel_m_per_s2": [0.0, 1.0, 0.0]});
    assert_eq!(content, expected);
    client.say(r#"{"op": "unsubscribe", "subscriptionIds": [42, 43]}"#).await;
    assert_eq!(client.text().await["message"], "there is no subscription 43");
}

#[tokio::test]
async fn a_new_effect_makes_a_new_channel_of_the_states() {
    let server = server().await;
    let (mut client, channels) = Client::viewer(server.address).await;
    assert!(!channels.contains_key("/states"));
    let mut snapshot = Snapshot::default();
    server.feed.offer(&RecordItem::Snapshot(1, Box::new(snapshot.clone())));
    let first = by_topic(&client.text().await)["/states"].clone();
    let latency = ParameterEstimate { effect: "gps_latency".into(), ..Default::default() };
    snapshot.estimate.effects.push(latency);
    server.feed.offer(&RecordItem::Snapshot(2, Box::new(snapshot)));
    assert_eq!(client.text().await, json!({"op": "unadvertise", "channelIds": [first["id"]]}));
    let second = by_topic(&client.text().await)["/states"].clone();
    assert_ne!(first["id"], second["id"]);
    assert!(second["schema"].as_str().unwrap().contains("gps_latency"));
}

#[tokio::test]
async fn rubbish_ends_the_connection_of_whoever_sends_it_and_no_other() {
    let server = server().await;
    let (mut good, channels) = Client::viewer(server.address).await;
    good.subscribe(1, &channels["/log"]).await;
    let too_long = "x".repeat(1 << 20);
    let rubbish = [
        (Message::Text("{".into()), Some(CloseCode::Invalid)),
        (Message::Text(r#"{"op": 7}"#.into()), Some(CloseCode::Invalid)),
        (
            Message::Text(r#"{"op": "subscribe", "subscriptions": [{"id": -1}]}"#.into()),
            Some(CloseCode::Invalid),
        ),
        (Message::Binary(vec![1, 2, 3].into()), Some(CloseCode::Unsupported)),
        (Message::Text(too_long.into()), None),
    ];
    for (message, code) in rubbish {
        let (mut bad, _) = Client::viewer(server.address).await;
        // The server may have closed the connection before all of it was sent.
        let _ = bad.socket.send(message).await;
        loop {
            match (bad.socket.next().await, code) {
                (Some(Ok(Message::Ping(_))), _) => continue,
                (Some(Ok(Message::Close(Some(frame)))), Some(code)) => assert_eq!(frame.code, code),
                (Some(Err(_)) | None, None) => {}
                (other, code) => panic!("{other:?} where {code:?} was to come"),
            }
            break;
        }
        server.feed.offer(&log("still here"));
        assert_eq!(good.data().await.2["message"], "still here");
    }
}

#[tokio::test]
async fn requests_that_cannot_be_met_are_answered_with_a_warning() {
    let server = server().await;
    let (mut client, channels) = Client::viewer(server.address).await;
    client.subscribe(1, &channels["/log"]).await;
    let (log_id, imu_id) = (&channels["/log"]["id"], &channels["/imu"]["id"]);
    for (channel, id, reason) in [
        (json!(999), 5, "there is no channel 999".to_owned()),
        (log_id.clone(), 5, format!("channel {log_id} is subscribed to already")),
        (imu_id.clone(), 1, "subscription 1 exists already".to_owned()),
    ] {
        let subscriptions = json!([{"id": id, "channelId": channel}]);
        client.say(&json!({"op": "subscribe", "subscriptions": subscriptions}).to_string()).await;
        assert_eq!(client.text().await, json!({"op": "status", "level": 1, "message": reason}));
    }
    client.say(r#"{"op": "setParameters", "parameters": [{"name": "x", "value": 1}]}"#).await;
    assert!(client.text().await["message"].as_str().unwrap().contains("only sends"));
}

#[tokio::test]
async fn a_viewer_that_reads_nothing_misses_messages_that_are_counted_and_holds_up_nobody() {
    let server = server().await;
    let (mut good, channels) = Client::viewer(server.address).await;
    let (mut slow, _) = Client::viewer(server.address).await;
    good.subscribe(1, &channels["/log"]).await;
    slow.subscribe(2, &channels["/log"]).await;
    let long = log(&"x".repeat(2000));
    // More than the sockets and the queue hold together.
    for _ in 0..100 {
        for _ in 0..64 {
            server.feed.offer(&long);
        }
        // The other one gets every message meanwhile.
        for _ in 0..64 {
            assert_eq!(good.data().await.0, 1);
        }
    }
    let missed = || server.status.view().sinks["foxglove"].dropped;
    let mut came = 0;
    while missed() == 0 {
        match slow.socket.next().await {
            Some(Ok(Message::Binary(_))) => came += 1,
            Some(Ok(_)) => {}
            // Disconnected, as one that takes nothing for too long.
            _ => tokio::task::yield_now().await,
        }
    }
    assert!(came + missed() <= 6400, "{came} came, {} were missed", missed());
}

#[tokio::test]
async fn so_many_viewers_and_no_more() {
    let server = server().await;
    let mut viewers = Vec::new();
    for _ in 0..8 {
        viewers.push(Client::viewer(server.address).await);
    }
    assert_eq!(Client::connect(server.address, "foxglove.sdk.v1").await.err(), Some(503));
}

#[tokio::test]
async fn both_names_of_the_protocol_are_known_and_no_other() {
    let server = server().await;
    for (named, expected) in [
        ("foxglove.sdk.v1", Ok("foxglove.sdk.v1")),
        ("foxglove.websocket.v1", Ok("foxglove.websocket.v1")),
        ("foxglove.websocket.v1, foxglove.sdk.v1", Ok("foxglove.sdk.v1")),
        ("mqtt", Err(400)),
    ] {
        let client = Client::connect(server.address, named).await.map(|c| c.protocol);
        assert_eq!(client.as_deref().map_err(|code| *code), expected);
    }
}

/// Status with which a request is refused; 101 where it is not.
fn answer(entry: &Entry, uri: &str, headers: &[(axum::http::HeaderName, &str)]) -> StatusCode {
    let mut request = Request::new(());
    *request.uri_mut() = uri.parse().unwrap();
    request.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, "foxglove.sdk.v1".parse().unwrap());
    for (name, value) in headers {
        request.headers_mut().insert(name, value.parse().unwrap());
    }
    match entry.answer([10, 0, 0, 7].into(), &request, Response::new(())) {
        Ok(_) => StatusCode::SWITCHING_PROTOCOLS,
        Err(refusal) => refusal.status(),
    }
}

#[test]
fn a_page_of_another_site_needs_the_token_even_on_this_machine() {
    let own = (HOST, "127.0.0.1:8765");
    let entry = Entry::new(true, Some(Token::new("fly-the-steep-turn").unwrap()));
    let from = |origin: &str| answer(&entry, "/", &[own.clone(), (ORIGIN, origin)]);
    for origin in ["https://app.foxglove.dev", "file://"] {
        assert_eq!(from(origin), StatusCode::SWITCHING_PROTOCOLS, "{origin}");
    }
    for origin in [
        "https://example.com",
        "null",
        "https://foxglove.dev.example.com",
        "http://app.foxglove.dev",
        "http://localhost:8080",
    ] {
        assert_eq!(from(origin), StatusCode::FORBIDDEN, "{origin}");
    }
    let with_token =
        answer(&entry, "/?token=fly-the-steep-turn", &[own.clone(), (ORIGIN, "https://example.com")]);
    assert_eq!(with_token, StatusCode::SWITCHING_PROTOCOLS);
    assert_eq!(answer(&entry, "/", &[(HOST, "rebound.example.com")]), StatusCode::FORBIDDEN);
    assert_eq!(answer(&entry, "/metrics", &[own]), StatusCode::NOT_FOUND);
}

#[test]
fn beyond_this_machine_the_token_is_needed_and_guesses_are_limited() {
    let entry = Entry::new(false, Some(Token::new("fly-the-steep-turn").unwrap()));
    let host = (HOST, "192.168.1.7:8765");
    let ask = |uri: &str| answer(&entry, uri, std::slice::from_ref(&host));
    assert_eq!(ask("/"), StatusCode::UNAUTHORIZED);
    assert_eq!(ask("/healthz"), StatusCode::NOT_FOUND);
    assert_eq!(ask("/?token=fly-the-steep-turn"), StatusCode::SWITCHING_PROTOCOLS);
    for k in 0..10 {
        assert_eq!(ask(&format!("/?token=guess-number-{k}")), StatusCode::UNAUTHORIZED);
    }
    assert_eq!(ask("/?token=guess-number-10"), StatusCode::TOO_MANY_REQUESTS);
}

#[test]
fn guesses_in_a_header_are_limited_as_those_in_the_address_are() {
    let entry = Entry::new(false, Some(Token::new("fly-the-steep-turn").unwrap()));
    let ask = |token: &str| {
        let bearer = format!("Bearer {token}");
        answer(&entry, "/", &[(HOST, "192.168.1.7:8765"), (axum::http::header::AUTHORIZATION, &bearer)])
    };
    for k in 0..10 {
        assert_eq!(ask(&format!("guess-number-{k}")), StatusCode::UNAUTHORIZED, "{k}");
    }
    assert_eq!(ask("guess-number-10"), StatusCode::TOO_MANY_REQUESTS);
    assert_eq!(ask("fly-the-steep-turn"), StatusCode::TOO_MANY_REQUESTS);
}
