//! A viewer of live data, as the server without a socket meets it: handshake and messages. No one gets in from another machine without the
//! token, and a viewer gets what it has subscribed to and nothing else.

use gaware::sensors::Severity;
use gaware::sinks::foxglove::{Feed, Server};
use gaware::sinks::messages::RecordItem;
use gaware::sinks::status::SinkStatus;
use gaware::sinks::web::access::Token;
use serde_json::Value;
use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;

const SECRET: &str = "correct-horse-battery";
/// Bytes under way in each direction at most.
const PIPE_BYTES: usize = 64 * 1024;
/// Until everything that was sent has been dealt with; virtual time.
const PAUSE: Duration = Duration::from_secs(1);
/// A connection ends within this time once the server stops.
const PATIENCE: Duration = Duration::from_secs(60);
/// The rest of a handshake that is not in the input.
const HANDSHAKE: &str = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n";
const OFFERS: [&str; 4] = ["serverInfo", "advertise", "unadvertise", "status"];

/// What a viewer sends, made of an input in lines. A first line that begins with `GET` begins a handshake, up to an empty line, otherwise the
/// handshake is a usual one on this machine. Each other line is a message: text, or by its first letter binary, ping, pong, close,
/// fragment, continuation, or raw bytes.
struct Visit {
    local: bool,
    handshake: Vec<u8>,
    messages: Vec<u8>,
    /// Its texts, in lines, to compare what it gets with what it has asked for; nothing where raw bytes may say anything.
    said: Option<Vec<u8>>,
}

impl Visit {
    fn new(data: &[u8]) -> Self {
        let mut lines = data.split(|b| *b == b'\n').peekable();
        let own = lines.peek().is_some_and(|l| l.starts_with(b"GET"));
        let mut handshake = Vec::new();
        if own {
            for line in lines.by_ref().map(<[u8]>::trim_ascii).take_while(|l| !l.is_empty()) {
                handshake.extend_from_slice(line);
                handshake.extend_from_slice(b"\r\n");
            }
        } else {
            handshake.extend_from_slice(b"GET / HTTP/1.1\r\nHost: localhost:8765\r\n");
            handshake.extend_from_slice(HANDSHAKE.as_bytes());
        }
        handshake.extend_from_slice(b"\r\n");
        let mut visit = Self { local: !own, handshake, messages: Vec::new(), said: Some(Vec::new()) };
        lines.filter(|l| !l.is_empty()).for_each(|line| visit.message(line));
        visit
    }

    fn message(&mut self, line: &[u8]) {
        const FINAL: u8 = 0x80;
        let rest = line.get(1..).unwrap_or_default();
        match line.first() {
            Some(b'b') => self.frame(FINAL | 2, rest),
            Some(b'p') => self.frame(FINAL | 9, rest),
            Some(b'o') => self.frame(FINAL | 10, rest),
            Some(b'c') => self.frame(FINAL | 8, rest),
            Some(b'f') => self.text(1, b"\n", rest),
            Some(b'k') => self.text(FINAL, b"", rest),
            Some(b'r') => {
                self.messages.extend_from_slice(rest);
                self.said = None;
            }
            _ => self.text(FINAL | 1, b"\n", line),
        }
    }

    fn text(&mut self, first: u8, between: &[u8], text: &[u8]) {
        self.frame(first, text);
        if let Some(said) = &mut self.said {
            said.extend_from_slice(between);
            said.extend_from_slice(text);
        }
    }

    /// Every number that it may have given a subscription.
    fn asked(&self) -> Option<BTreeSet<u64>> {
        let numbers = self.said.as_ref()?.split(|b| !b.is_ascii_digit());
        Some(numbers.filter_map(|n| str::from_utf8(n).ok()?.parse().ok()).collect())
    }

    /// A frame of the WebSocket protocol with a mask of zeros.
    fn frame(&mut self, first: u8, payload: &[u8]) {
        const MASKED: u8 = 0x80;
        self.messages.push(first);
        match (u8::try_from(payload.len()), u16::try_from(payload.len())) {
            (Ok(length @ 0..=125), _) => self.messages.push(MASKED | length),
            (_, Ok(length)) => {
                self.messages.push(MASKED | 126);
                self.messages.extend(length.to_be_bytes());
            }
            _ => {
                self.messages.push(MASKED | 127);
                self.messages.extend((payload.len() as u64).to_be_bytes());
            }
        }
        self.messages.extend([0; 4]);
        self.messages.extend_from_slice(payload);
    }

    /// Sends everything, lets the run go on for a moment, and ends it; returns what the server sent.
    async fn converse(&self, stream: DuplexStream, feed: Feed, stop: &CancellationToken) -> Vec<u8> {
        let (mut reading, mut writing) = tokio::io::split(stream);
        let speak = async {
            let _ = writing.write_all(&self.handshake).await;
            // A viewer waits for the answer: the library refuses a request with something behind it.
            sleep(PAUSE).await;
            // The server may close the connection before all of it was sent.
            let _ = writing.write_all(&self.messages).await;
            sleep(PAUSE).await;
            feed.offer(&RecordItem::Log(1, Severity::Info, "a line".to_owned()));
            feed.offer(&RecordItem::Snapshot(2, Box::default()));
            sleep(PAUSE).await;
            stop.cancel();
            sleep(PAUSE).await;
            let _ = writing.shutdown().await;
        };
        let mut heard = Vec::new();
        let listen = async {
            let _ = reading.read_to_end(&mut heard).await;
        };
        tokio::join!(speak, listen);
        heard
    }
}

/// Bytes as what a viewer sends (see `Visit`).
pub fn foxglove(data: &[u8]) -> bool {
    let visit = Visit::new(data);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
    let (Ok(runtime), Ok(token)) = (runtime, Token::new(SECRET)) else { return false };
    let status = SinkStatus::new();
    let heard = runtime.block_on(async {
        let stop = CancellationToken::new();
        let (server, feed) = Server::new(visit.local, Some(token), "run 1".to_owned(), &status, stop.clone());
        let (here, there) = tokio::io::duplex(PIPE_BYTES);
        let from = IpAddr::V4(Ipv4Addr::new(192, 168, 1, 9));
        let both = async { tokio::join!(server.connection(there, from), visit.converse(here, feed, &stop)) };
        match timeout(PATIENCE, both).await {
            Ok(((), heard)) => heard,
            Err(_) => panic!("the connection did not end"),
        }
    });
    let secret = SECRET.as_bytes();
    assert!(!contains(&heard, secret) || contains(data, secret), "the token is given away");
    if !heard.starts_with(b"HTTP/1.1 101 ") {
        return false;
    }
    assert!(visit.local || contains(&visit.handshake, secret), "a viewer without the token");
    let end = heard.windows(4).position(|w| w == b"\r\n\r\n");
    let Some(frames) = end.and_then(|at| heard.get(at + 4..)) else { panic!("half an answer") };
    check(frames, visit.asked().as_ref(), status.view().sinks.get("foxglove").map_or(0, |s| s.delivered));
    true
}

/// The server's frames are whole, come in order, and hold what was asked for.
fn check(mut frames: &[u8], asked: Option<&BTreeSet<u64>>, delivered: u64) {
    let (mut texts, mut messages, mut closed) = (0, 0, false);
    while !frames.is_empty() {
        assert!(!closed, "more after the end");
        let Some((first, payload, rest)) = frame(frames) else { panic!("half a frame") };
        frames = rest;
        match first {
            0x81 => {
                let text: Value = serde_json::from_slice(payload).unwrap_or_default();
                let op = text.get("op").and_then(Value::as_str).unwrap_or_default();
                assert!(OFFERS.contains(&op), "{text}");
                assert!(texts > 1 || OFFERS.get(texts) == Some(&op), "{text} at the beginning");
                texts += 1;
            }
            0x82 => {
                let Some((1, rest)) = payload.split_first() else { panic!("{payload:?}") };
                let id = rest.first_chunk().map(|id| u64::from(u32::from_le_bytes(*id)));
                assert!(
                    id.is_some_and(|id| asked.is_none_or(|asked| asked.contains(&id))),
                    "{id:?} was not asked for"
                );
                messages += 1;
            }
            0x88 => closed = true,
            0x89 | 0x8A => {}
            other => panic!("a frame that begins with {other:#x}"),
        }
    }
    assert_eq!(messages, delivered, "delivered and counted");
}

/// First byte and content of a frame without a mask, and what follows.
fn frame(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (first, rest) = bytes.split_first()?;
    let (length, rest) = match rest.split_first()? {
        (126, rest) => {
            rest.split_first_chunk().map(|(n, rest)| (usize::from(u16::from_be_bytes(*n)), rest))?
        }
        (127, rest) => {
            let (n, rest) = rest.split_first_chunk()?;
            (usize::try_from(u64::from_be_bytes(*n)).ok()?, rest)
        }
        (length, rest) => (usize::from(*length), rest),
    };
    let (payload, rest) = rest.split_at_checked(length)?;
    Some((*first, payload, rest))
}

fn contains(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len()).any(|w| w == word)
}

/// Conversations of viewers, and handshakes from this machine and others.
pub fn seeds() -> Vec<Vec<u8>> {
    let subscribe =
        r#"{"op": "subscribe", "subscriptions": [{"id": 7, "channelId": 1}, {"id": 8, "channelId": 8}]}"#;
    let unsubscribe = r#"{"op": "unsubscribe", "subscriptionIds": [7]}"#;
    let mut seeds = vec![
        format!("{subscribe}\n{unsubscribe}\n"),
        format!("{}\n{subscribe}\n", r#"{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 4}]}"#),
        format!("ping\n{subscribe}\nong\nbinary\n{subscribe}\n"),
        format!("f{}\nping\nk{}\n", subscribe.split_at(30).0, subscribe.split_at(30).1),
        format!("{subscribe}\nr\u{1}\0\0\0\0\n"),
        r#"{"op": "setParameters", "parameters": [{"name": "x", "value": 1}], "id": "1"}"#.to_owned(),
        r#"{"op": "subscribeConnectionGraph"}"#.to_owned(),
        r#"{"op": "fetchAsset", "uri": "file:///etc/passwd", "requestId": 1}"#.to_owned(),
    ];
    for (uri, header) in [
        (format!("/?token={SECRET}"), "Host: companion.local:8765\r\n"),
        ("/".to_owned(), "Host: 192.168.1.4:8765\r\n"),
        (
            "/?token=wrong-token-here".to_owned(),
            "Host: 192.168.1.4:8765\r\nOrigin: https://app.foxglove.dev\r\n",
        ),
        (format!("/?a=b&token={SECRET}"), "Host: 192.168.1.4:8765\r\nOrigin: https://example.com\r\n"),
    ] {
        seeds.push(format!("GET {uri} HTTP/1.1\r\n{header}{HANDSHAKE}\r\n{subscribe}\n"));
    }
    let mut seeds: Vec<Vec<u8>> = seeds.into_iter().map(String::into_bytes).collect();
    // Closed with the code of a normal end, 1000.
    seeds.push([subscribe.as_bytes(), b"\nc\x03\xE8ended\n", unsubscribe.as_bytes()].concat());
    seeds
}
