//! The web server over real sockets: what it answers, whom it refuses, and that nobody waits for a slow browser.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic, as tests do")]

use gaware::engine::snapshot::Snapshot;
use gaware::sinks::Request;
use gaware::sinks::status::{SinkStatus, StatusView};
use gaware::sinks::web::access::Token;
use gaware::sinks::web::{self, WebError, WebState};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

/// Longer than anything here takes, shorter than a test runner's patience.
const PATIENCE: Duration = Duration::from_secs(20);
const SECRET: &str = "correct-horse-battery";

struct Server {
    address: SocketAddr,
    snapshots: watch::Sender<Arc<Snapshot>>,
    status: Arc<SinkStatus>,
    shutdown: CancellationToken,
    task: JoinHandle<Result<(), WebError>>,
}

async fn serve(with: impl FnOnce(WebState) -> WebState) -> Server {
    serve_on("127.0.0.1:0", with).await
}

async fn serve_on(bind: &str, with: impl FnOnce(WebState) -> WebState) -> Server {
    let listener = web::door::bind(bind.parse().unwrap()).unwrap();
    let port = listener.local_addr().unwrap().port();
    let (snapshots, rx) = watch::channel(Arc::new(snapshot(1)));
    let status = SinkStatus::new();
    let shutdown = CancellationToken::new();
    let state = with(WebState::new(rx, Arc::clone(&status)));
    let task = tokio::spawn(web::serve(listener, state, shutdown.clone()));
    Server { address: SocketAddr::from(([127, 0, 0, 1], port)), snapshots, status, shutdown, task }
}

fn token() -> Token {
    Token::new(SECRET).unwrap()
}

fn snapshot(sequence: u64) -> Snapshot {
    let mut s = Snapshot { sequence, ..Snapshot::default() };
    s.guidance.instruction = format!("maneuver {sequence}");
    s
}

struct Answer {
    status: u16,
    head: String,
    body: String,
}

/// One request on a connection of its own, with the headers given and nothing else.
async fn ask(address: SocketAddr, request: &str, headers: &[&str], body: &str) -> Answer {
    let host = format!("Host: 127.0.0.1:{}", address.port());
    let host = if headers.iter().any(|h| h.starts_with("Host:")) { String::new() } else { host + "\r\n" };
    let rest: String = headers.iter().map(|h| format!("{h}\r\n")).collect();
    let length = body.len();
    let text = format!(
        "{request} HTTP/1.1\r\n{host}{rest}Content-Length: {length}\r\nConnection: close\r\n\r\n{body}"
    );
    let exchange = async {
        let mut stream = TcpStream::connect(address).await.unwrap();
        stream.write_all(text.as_bytes()).await.unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).await.unwrap();
        answer
    };
    let answer = timeout(PATIENCE, exchange).await.unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    Answer { status, head: head.to_ascii_lowercase(), body: body.to_owned() }
}

async fn get(server: &Server, path: &str, headers: &[&str]) -> Answer {
    ask(server.address, &format!("GET {path}"), headers, "").await
}

async fn upload(server: &Server, headers: &[&str], body: &str) -> Answer {
    let headers = [&["Content-Type: application/json"], headers].concat();
    ask(server.address, "POST /api/v1/mission/upload", &headers, body).await
}

/// An open event stream.
struct Browser {
    lines: tokio::io::Lines<BufReader<TcpStream>>,
}

impl Browser {
    async fn open(address: SocketAddr) -> Self {
        let mut stream = TcpStream::connect(address).await.unwrap();
        let request = format!("GET /api/v1/events HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", address.port());
        stream.write_all(request.as_bytes()).await.unwrap();
        Self { lines: BufReader::new(stream).lines() }
    }

    /// Data of the next event of that kind; `None` at the end of the stream.
    async fn next(&mut self, kind: &str) -> Option<String> {
        let wanted = format!("event: {kind}");
        let mut matches = false;
        loop {
            let line = timeout(PATIENCE, self.lines.next_line()).await.unwrap().ok()??;
            if line.starts_with("event: ") {
                matches = line == wanted;
            } else if let Some(data) = line.strip_prefix("data: ").filter(|_| matches) {
                return Some(data.to_owned());
            }
        }
    }

    async fn snapshot(&mut self) -> Snapshot {
        serde_json::from_str(&self.next("snapshot").await.unwrap()).unwrap()
    }
}

#[tokio::test]
async fn status_is_the_snapshot_and_every_answer_is_locked_down() {
    let server = serve(|s| s).await;
    server.snapshots.send_replace(Arc::new(snapshot(5)));
    let answer = get(&server, "/api/v1/status", &[]).await;
    assert_eq!(serde_json::from_str::<Snapshot>(&answer.body).unwrap(), snapshot(5));
    let sinks = get(&server, "/api/v1/sinks", &[]).await;
    assert_eq!(serde_json::from_str::<StatusView>(&sinks.body).unwrap().schema, "gaware.sinks/1");
    for path in
        ["/", "/assets/app.js", "/api/v1/status", "/api/v1/schema", "/metrics", "/healthz", "/nowhere"]
    {
        let answer = get(&server, path, &[]).await;
        assert_eq!(answer.status, if path == "/nowhere" { 404 } else { 200 }, "{path}");
        for header in [
            "content-security-policy: default-src 'none'; script-src 'self'",
            "x-content-type-options: nosniff",
            "referrer-policy: no-referrer",
            "cache-control: no-",
        ] {
            assert!(answer.head.contains(header), "{path} lacks {header}");
        }
    }
    assert!(get(&server, "/metrics", &[]).await.body.contains("gaware_snapshots_total 5\n"));
}

#[tokio::test]
async fn assets_are_sent_once_and_the_page_asks_nobody_else() {
    let server = serve(|s| s).await;
    for path in ["/", "/assets/app.js", "/assets/view.js", "/assets/style.css", "/favicon.ico"] {
        let first = get(&server, path, &[]).await;
        // The name of a vocabulary is no address that a browser would ask.
        let text = first.body.replace("http://www.w3.org/2000/svg", "");
        assert!(!text.contains("http://") && !text.contains("https://") && !text.contains("//cdn"), "{path}");
        let tag = first.head.lines().find_map(|l| l.strip_prefix("etag: ")).unwrap().to_owned();
        let again = get(&server, path, &[&format!("If-None-Match: {tag}")]).await;
        assert_eq!((again.status, again.body.len()), (304, 0), "{path}");
    }
    for path in ["/assets/../mod.rs", "/assets/%2e%2e/mod.rs", "/assets//etc/passwd"] {
        assert_eq!(get(&server, path, &[]).await.status, 404, "{path}");
    }
}

#[tokio::test]
async fn a_name_that_points_here_from_elsewhere_is_refused() {
    let server = serve(|s| s).await;
    assert_eq!(get(&server, "/api/v1/status", &["Host: evil.example"]).await.status, 403);
    assert_eq!(get(&server, "/api/v1/status", &["Host: localhost:1"]).await.status, 200);
}

#[tokio::test]
async fn others_need_the_token_and_a_server_without_one_does_not_open_to_them() {
    let bare = serve_on("0.0.0.0:0", |s| s).await;
    assert!(matches!(bare.task.await.unwrap(), Err(WebError::TokenRequired(_))));
    let server = serve_on("0.0.0.0:0", |s| s.with_token(token())).await;
    for path in ["/", "/api/v1/status", "/api/v1/events", "/api/v1/history", "/metrics", "/assets/app.js"] {
        let answer = get(&server, path, &[]).await;
        assert_eq!(answer.status, 401, "{path}");
        assert!(!answer.body.contains("maneuver"));
    }
    let bearer = format!("Authorization: Bearer {SECRET}");
    assert_eq!(get(&server, "/api/v1/status", &[&bearer]).await.status, 200);
    let once = get(&server, &format!("/?token={SECRET}"), &[]).await;
    assert_eq!(once.status, 303);
    assert!(once.head.contains("location: /\r\n"));
    let cookie = format!("gaware_token_{}={SECRET}", server.address.port());
    assert!(once.head.contains(&format!("{cookie}; path=/; httponly; samesite=strict")), "{}", once.head);
    assert_eq!(get(&server, "/", &[&format!("Cookie: {cookie}")]).await.status, 200);
}

#[tokio::test]
async fn an_upload_needs_token_confirmation_and_somebody_who_does_it() {
    let bearer = format!("Authorization: Bearer {SECRET}");
    let yes = r#"{"confirm": true}"#;
    let tokenless = serve(|s| s).await;
    assert_eq!(upload(&tokenless, &[], yes).await.status, 403);
    let idle = serve(|s| s.with_token(token())).await;
    assert_eq!(upload(&idle, &[&bearer], yes).await.status, 503);

    let (commands, mut handler) = mpsc::channel(1);
    let server = serve(|s| s.with_token(token()).with_commands(commands)).await;
    assert_eq!(upload(&server, &[], yes).await.status, 401);
    for body in ["", "{}", r#"{"confirm": false}"#, r#"{"confirm": true, "x": 1}"#, "confirm=true"] {
        assert_eq!(upload(&server, &[&bearer], body).await.status, 400, "{body}");
    }
    assert!(handler.try_recv().is_err(), "nothing may be uploaded before all was right");
    tokio::spawn(async move {
        for answer in [Ok("12 items".to_owned()), Err("the autopilot refused".to_owned())] {
            let Some(Request { reply, .. }) = handler.recv().await else { return };
            reply.send(answer).unwrap();
        }
    });
    let done = upload(&server, &[&bearer], yes).await;
    assert_eq!((done.status, done.body.as_str()), (200, r#"{"message":"12 items"}"#));
    assert_eq!(upload(&server, &[&bearer], yes).await.status, 409);
}

#[tokio::test]
async fn a_browser_sees_the_newest_snapshot_and_the_end() {
    let server = serve(|s| s.with_max_rate_hz(1000.0)).await;
    let mut browser = Browser::open(server.address).await;
    assert_eq!(browser.snapshot().await.sequence, 1);
    server.snapshots.send_replace(Arc::new(snapshot(2)));
    assert_eq!(browser.snapshot().await.guidance.instruction, "maneuver 2");
    server.snapshots.send_replace(Arc::new(snapshot(3)));
    server.shutdown.cancel();
    assert_eq!(browser.snapshot().await.sequence, 3);
    assert!(browser.next("end").await.is_some());
    assert!(browser.next("snapshot").await.is_none());
    timeout(PATIENCE, server.task).await.unwrap().unwrap().unwrap();
}

#[tokio::test]
async fn a_page_opened_late_gets_the_past() {
    let server = serve(|s| s).await;
    for second in 0..5u32 {
        let s = Snapshot { elapsed_s: f64::from(second), ..snapshot(u64::from(second) + 2) };
        server.snapshots.send_replace(Arc::new(s));
        // Each must reach the history before the next replaces it.
        let seen = async {
            while !get(&server, "/api/v1/history", &[]).await.body.contains(&format!("[[{second}.0,"))
                && !get(&server, "/api/v1/history", &[]).await.body.contains(&format!(",[{second}.0,"))
            {
                tokio::task::yield_now().await;
            }
        };
        timeout(PATIENCE, seen).await.unwrap();
    }
    let all: serde_json::Value =
        serde_json::from_str(&get(&server, "/api/v1/history", &[]).await.body).unwrap();
    assert_eq!(all["points"].as_array().unwrap().len(), 5);
    let none: serde_json::Value =
        serde_json::from_str(&get(&server, "/api/v1/history?points=0", &[]).await.body).unwrap();
    assert_eq!(none["points"].as_array().unwrap().len(), 0);
    assert_eq!(none["events"], all["events"]);
}

#[tokio::test]
async fn a_browser_that_stops_reading_costs_only_its_own_snapshots() {
    let server = serve(|s| s.with_max_rate_hz(1000.0)).await;
    let mut good = Browser::open(server.address).await;
    assert_eq!(good.snapshot().await.sequence, 1);
    // Asks for the stream and then never reads.
    let stuck = Browser::open(server.address).await;
    let web = server.status.sink("web");
    let padding = "x".repeat(200_000);
    let mut sequence = 1;
    let flood = async {
        while web.view().dropped < 3 {
            sequence += 1;
            let s = Snapshot { warnings: vec![padding.clone()], ..snapshot(sequence) };
            // Replacing never waits, whatever the browsers do.
            server.snapshots.send_replace(Arc::new(s));
            // The other browser still sees what is new.
            while good.snapshot().await.sequence < sequence {}
        }
    };
    timeout(PATIENCE, flood).await.unwrap();
    assert!(server.status.view().dropped() >= 3);
    let page = get(&server, "/metrics", &[]).await.body;
    assert!(
        page.lines().any(|l| l.starts_with("gaware_sink_dropped_total{sink=\"web\"} ") && !l.ends_with(" 0"))
    );
    // Nor does it hold up the end.
    server.shutdown.cancel();
    timeout(PATIENCE, server.task).await.unwrap().unwrap().unwrap();
    drop(stuck);
}

#[tokio::test]
async fn too_many_pages_are_told_so() {
    let server = serve(|s| s).await;
    let mut open = Vec::new();
    for _ in 0..8 {
        let mut browser = Browser::open(server.address).await;
        browser.snapshot().await;
        open.push(browser);
    }
    assert_eq!(get(&server, "/api/v1/events", &[]).await.status, 503);
    assert_eq!(get(&server, "/api/v1/status", &[]).await.status, 200);
}

#[tokio::test(start_paused = true)]
async fn half_a_request_is_given_up_and_others_are_served_meanwhile() {
    let server = serve(|s| s).await;
    let mut silent = Vec::new();
    // More than one address may hold; those beyond are closed at once.
    for k in 0..100 {
        let mut stream = TcpStream::connect(server.address).await.unwrap();
        if k % 2 == 0 {
            // The server may have closed it already.
            let _ = stream.write_all(b"GET / HTTP/1.1\r\nHost: 127.").await;
        }
        silent.push(stream);
    }
    for mut stream in silent {
        // Time stands still until nobody has anything to do: the patience of the server passes at once.
        let _ = stream.read_to_end(&mut Vec::new()).await;
    }
    assert_eq!(get(&server, "/api/v1/status", &[]).await.status, 200);
}

#[tokio::test(start_paused = true)]
async fn streams_that_never_read_make_room_for_others() {
    let server = serve(|s| s.with_max_rate_hz(1000.0)).await;
    let mut stuck = Vec::new();
    for _ in 0..8 {
        stuck.push(Browser::open(server.address).await);
    }
    let padding = "x".repeat(200_000);
    let mut sequence = 1;
    let mut waited_s = 0.0;
    // Tried again as a browser does.
    while get_head(server.address, "/api/v1/events").await != 200 {
        for _ in 0..10 {
            sequence += 1;
            server
                .snapshots
                .send_replace(Arc::new(Snapshot { warnings: vec![padding.clone()], ..snapshot(sequence) }));
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        waited_s += 1.0;
        assert!(waited_s < 40.0, "still no place after {waited_s} s");
    }
    drop(stuck);
}

/// The status of a request whose answer need not end.
async fn get_head(address: SocketAddr, path: &str) -> u16 {
    let mut stream = TcpStream::connect(address).await.unwrap();
    let request = format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", address.port());
    stream.write_all(request.as_bytes()).await.unwrap();
    let line = BufReader::new(stream).lines().next_line().await.unwrap().unwrap();
    line.split(' ').nth(1).unwrap().parse().unwrap()
}

/// Images on a page of another site: a browser asks with whatever token their address has, without naming where they stand.
#[tokio::test]
async fn no_page_of_another_site_locks_the_pilot_out() {
    let server = serve_on("0.0.0.0:0", |s| s.with_token(token())).await;
    for k in 0..12 {
        get(&server, &format!("/favicon.ico?token=image-number-{k}"), &[]).await;
    }
    let right = format!("Authorization: Bearer {SECRET}");
    assert_eq!(get(&server, "/api/v1/status", &[&right]).await.status, 200, "the pilot's page goes on");
    assert_eq!(get(&server, &format!("/?token={SECRET}"), &[]).await.status, 429);
    // Where the browser says so they lock their own way alone, and a token that was made up cannot be guessed.
    for token in [token(), Token::random().unwrap()] {
        let secret = token.reveal().to_owned();
        let site: &[&str] = if secret == SECRET { &["Sec-Fetch-Site: cross-site"] } else { &[] };
        let server = serve_on("0.0.0.0:0", |s| s.with_token(token)).await;
        for k in 0..12 {
            get(&server, &format!("/favicon.ico?token=image-number-{k}"), site).await;
        }
        assert_eq!(get(&server, &format!("/?token={secret}"), &[]).await.status, 303);
        // Whoever sends that header guesses no more for it.
        let right = get(&server, &format!("/?token={secret}"), &["Sec-Fetch-Site: cross-site"]).await;
        assert_eq!(right.status, if secret == SECRET { 429 } else { 303 });
    }
}

#[tokio::test]
async fn tokens_cannot_be_guessed_and_a_wrong_one_is_told_so() {
    let server = serve_on("0.0.0.0:0", |s| s.with_token(token())).await;
    let first = get(&server, "/?token=not-this-one-0", &[]).await;
    assert_eq!(first.status, 401);
    assert!(first.body.contains("This token is not the one"), "{}", first.body);
    // A browser that comes back with the cookie of an earlier run does not guess.
    let earlier = format!("Cookie: gaware_token_{}=of-an-earlier-run", server.address.port());
    for _ in 0..30 {
        assert_eq!(get(&server, "/api/v1/status", &[&earlier]).await.status, 401);
    }
    let statuses = async {
        let mut all = Vec::new();
        for k in 0..20 {
            let guess = format!("Authorization: Bearer not-this-one-{k}");
            all.push(get(&server, "/api/v1/status", &[&guess]).await.status);
        }
        all
    };
    let statuses = statuses.await;
    assert_eq!(statuses.last(), Some(&429), "{statuses:?}");
    let right = format!("Authorization: Bearer {SECRET}");
    assert_eq!(
        get(&server, "/api/v1/status", &[&right]).await.status,
        429,
        "nor does the right one tell itself"
    );
    assert_eq!(get(&server, "/healthz", &[]).await.status, 200);
}
