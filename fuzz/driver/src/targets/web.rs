//! The web server as a service without a socket. No request without the token reaches the vehicle, and every answer keeps the page
//! locked down.

use axum::body::{Body, to_bytes};
use axum::http::{Request as HttpRequest, StatusCode, header};
use gaware::engine::snapshot::Snapshot;
use gaware::sinks::Request;
use gaware::sinks::status::SinkStatus;
use gaware::sinks::web::access::Token;
use gaware::sinks::web::{self as server, WebState};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

const SECRET: &str = "correct-horse-battery";
/// An answer begins within this time; an upload is given up after two minutes.
const PATIENCE: Duration = Duration::from_secs(200);
/// Longest body that is read: the event stream has no end.
const BODY: usize = 4 * 1024 * 1024;

/// Bytes as a request: method and address in the first line, headers until an empty one, the rest is the body. The first byte decides
/// whether the server listens on a loopback address only.
pub fn web(data: &[u8]) -> bool {
    let Some((&how, rest)) = data.split_first() else { return false };
    let Some(request) = request(rest) else { return false };
    let has_token = contains(rest, SECRET.as_bytes());
    let is_stream = request.uri().path() == "/api/v1/events";
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
    let Ok(runtime) = runtime else { return false };
    runtime.block_on(async {
        let (_snapshots, rx) = watch::channel(Arc::new(Snapshot::default()));
        let (commands, mut asked) = mpsc::channel(1);
        let state = WebState::new(rx, SinkStatus::new()).with_commands(commands);
        let Ok(token) = Token::new(SECRET) else { return false };
        let visitor = IpAddr::V4(Ipv4Addr::new(192, 168, 1, 9));
        let app = server::service(
            state.with_token(token),
            how.is_multiple_of(2),
            visitor,
            CancellationToken::new(),
        );
        let answers = async {
            let Some(Request { reply, .. }) = asked.recv().await else { return false };
            let _ = reply.send(Ok("done".to_owned()));
            true
        };
        tokio::pin!(answers);
        let response = timeout(PATIENCE, async {
            let answer = app.oneshot(request);
            tokio::pin!(answer);
            let mut uploads = false;
            loop {
                tokio::select! {
                    biased;
                    asked = &mut answers, if !uploads => uploads = asked,
                    response = &mut answer => break (response, uploads),
                }
            }
        });
        let Ok((Ok(response), uploads)) = response.await else { panic!("no answer") };
        assert!(has_token || !uploads, "an upload without the token");
        let status = response.status();
        let expected = !status.is_server_error() || status == StatusCode::SERVICE_UNAVAILABLE;
        assert!(expected, "{status}");
        let headers = response.headers();
        assert!(headers.contains_key(header::CONTENT_SECURITY_POLICY), "{headers:?}");
        let shown = has_token || !headers.contains_key(header::SET_COOKIE);
        assert!(shown, "the token is given away");
        if !is_stream {
            let body = timeout(PATIENCE, to_bytes(response.into_body(), BODY)).await;
            let Ok(Ok(body)) = body else { panic!("no body") };
            assert!(has_token || !contains(&body, SECRET.as_bytes()), "the token is given away");
        }
        status.is_success()
    })
}

fn contains(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len()).any(|w| w == word)
}

/// A request as hyper would give it; nothing where there is none.
fn request(data: &[u8]) -> Option<HttpRequest<Body>> {
    let mut lines = data.split_inclusive(|b| *b == b'\n');
    let first = lines.next()?;
    let mut words = first.trim_ascii().split(|b| *b == b' ');
    let (method, uri) = (words.next()?, words.next()?);
    let mut request = HttpRequest::builder().method(method).uri(uri);
    let mut used = first.len();
    for line in lines {
        used += line.len();
        let line = line.trim_ascii();
        let Some(at) = line.iter().position(|b| *b == b':') else { break };
        let (name, value) = line.split_at(at);
        request = request.header(name, value.get(1..).unwrap_or_default().trim_ascii());
    }
    request.body(Body::from(data.get(used..).unwrap_or_default().to_vec())).ok()
}

/// Requests as pages and tools make them.
pub fn seeds() -> Vec<Vec<u8>> {
    let bearer = format!("Authorization: Bearer {SECRET}\n");
    let cookie = format!("Cookie: a=b; gaware_token={SECRET}\n");
    let mut seeds = Vec::new();
    for path in [
        "/",
        "/assets/style.css",
        "/assets/../secret",
        "/favicon.ico",
        "/healthz",
        "/metrics",
        "/api/v1/status",
        "/api/v1/sinks",
        "/api/v1/route",
        "/api/v1/history?points=10",
        "/api/v1/schema",
        "/api/v1/capabilities",
        "/api/v1/events",
        "/?token=wrong-token-here",
    ] {
        seeds.push(format!("0GET {path} HTTP/1.1\nHost: localhost:8080\nIf-None-Match: \"x\"\n\n"));
        seeds.push(format!("1GET {path} HTTP/1.1\nHost: 192.168.1.4:8080\n{bearer}\n"));
    }
    seeds.push(format!("1GET /?a=b&token={SECRET} HTTP/1.1\nHost: companion.local\n\n"));
    let post = "POST /api/v1/mission/upload HTTP/1.1\nContent-Type: application/json\n";
    let body = "\n{\"confirm\": true}";
    seeds.push(format!("0{post}Host: localhost:8080\nOrigin: http://localhost:8080\n{bearer}{body}"));
    seeds.push(format!("1{post}Host: 192.168.1.4:8080\n{cookie}{body}"));
    seeds.push(format!("1{post}Host: 192.168.1.4:8080\nCookie: gaware_token=wrong\n{body}"));
    seeds.push(format!("0{post}Host: localhost:8080\n{body}"));
    seeds.into_iter().map(String::into_bytes).collect()
}
