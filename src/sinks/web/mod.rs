//! The web page of the pilot and the HTTP interface: an axum server with embedded assets.
//!
//! It reads snapshots from a `watch` channel and nothing else; what it may change goes out as typed
//! [`Request`]s. Who may ask for what is decided in [`access`], before any handler runs.

pub mod access;
pub mod analysis;
mod api;
mod assets;
pub mod door;
pub(in crate::sinks) mod guesses;
mod stream;

use super::Request;
use super::status::SinkStatus;
use crate::engine::snapshot::Snapshot;
use crate::view::history::History;
use access::{Policy, Token};
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::extract::connect_info::MockConnectInfo;
use axum::middleware;
use axum::routing::{get, post};
use door::{Door, Places, Visitor};
use guesses::Guesses;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Event streams that browsers may hold at the same time, in all and from one address.
const MAX_STREAMS: (usize, usize) = (16, 8);
/// Bytes of a request's body at most: a confirmation is all that is ever posted.
const MAX_BODY_BYTES: usize = 4096;
/// How long open requests may take after the shutdown began; a browser that stopped reading never ends by itself.
const GRACE: Duration = Duration::from_secs(1);

/// Why the server does not run.
#[derive(Debug, thiserror::Error)]
pub enum WebError {
    /// Bound to an address that others can reach, without a token.
    #[error(
        "the web page on {0} could be reached by others: give it a token (--web-token), or bind it to 127.0.0.1"
    )]
    TokenRequired(SocketAddr),
    /// The token is too short or has characters that an address line would change.
    #[error("a web token needs at least {min} characters, letters, digits, '-', '.', '_' or '~' only", min = Token::MIN_CHARS)]
    BadToken,
    /// No randomness for a token.
    #[error("the system gave no randomness for a web token: {0}")]
    Randomness(String),
    /// The socket failed.
    #[error("the web server's socket failed: {0}")]
    Io(#[from] std::io::Error),
}

/// What the server is started with.
#[derive(Debug, Clone)]
pub struct WebState {
    snapshots: watch::Receiver<Arc<Snapshot>>,
    status: Arc<SinkStatus>,
    token: Option<Token>,
    commands: Option<mpsc::Sender<Request>>,
    max_rate_hz: f64,
}

impl WebState {
    /// Read-only, without a token, at most 10 snapshots a second to each browser.
    pub fn new(snapshots: watch::Receiver<Arc<Snapshot>>, status: Arc<SinkStatus>) -> Self {
        Self { snapshots, status, token: None, commands: None, max_rate_hz: 10.0 }
    }

    /// Demands this token: for everything where others can reach the page, for changes everywhere.
    #[must_use]
    pub fn with_token(self, token: Token) -> Self {
        Self { token: Some(token), ..self }
    }

    /// Attaches the task that carries out commands; without one they are answered 503.
    #[must_use]
    pub fn with_commands(self, commands: mpsc::Sender<Request>) -> Self {
        Self { commands: Some(commands), ..self }
    }

    /// Snapshots per second to each browser at most, Hz; kept between 0.1 and 1000.
    #[must_use]
    pub fn with_max_rate_hz(self, max_rate_hz: f64) -> Self {
        Self { max_rate_hz: max_rate_hz.clamp(0.1, 1000.0), ..self }
    }
}

/// What every handler shares.
struct Shared {
    state: WebState,
    policy: Policy,
    history: Mutex<History>,
    streams: Arc<Places>,
    guesses: Guesses,
    shutdown: CancellationToken,
}

impl Shared {
    fn new(state: WebState, local: bool, shutdown: CancellationToken) -> Arc<Self> {
        Arc::new(Self {
            policy: Policy::new(local, state.token.clone()),
            state,
            history: Mutex::default(),
            streams: Places::new(MAX_STREAMS.0, MAX_STREAMS.1),
            guesses: Guesses::default(),
            shutdown,
        })
    }
}

/// The server without its socket, as a visitor from one address reaches it: for tests of what it answers. `local` is whether it listens on a
/// loopback address only; the history stays empty.
pub fn service(state: WebState, local: bool, visitor: IpAddr, shutdown: CancellationToken) -> Router {
    router(Shared::new(state, local, shutdown)).layer(MockConnectInfo(Visitor(visitor)))
}

/// Serves until `shutdown`, then ends open streams and returns.
///
/// # Errors
/// [`WebError::TokenRequired`] where the listener is not on a loopback address and the state has no token,
/// [`WebError::Io`] when the socket fails.
pub async fn serve(
    listener: TcpListener,
    state: WebState,
    shutdown: CancellationToken,
) -> Result<(), WebError> {
    let address = listener.local_addr()?;
    let local = address.ip().is_loopback();
    if !local && state.token.is_none() {
        return Err(WebError::TokenRequired(address));
    }
    // Ends the streams and the history with the server, also when the server ended by itself.
    let stop = shutdown.child_token();
    let _ends_with_us = stop.clone().drop_guard();
    let shared = Shared::new(state, local, stop.clone());
    tokio::spawn(keep_history(Arc::clone(&shared)));
    serve_until(listener, router(shared), &stop).await
}

/// Serves until `stop`, and after that for no longer than open requests may take.
async fn serve_until(listener: TcpListener, app: Router, stop: &CancellationToken) -> Result<(), WebError> {
    let app = app.into_make_service_with_connect_info::<Visitor>();
    let server = axum::serve(Door::new(listener), app).with_graceful_shutdown(stop.clone().cancelled_owned());
    let overtime = async {
        stop.cancelled().await;
        tokio::time::sleep(GRACE).await;
    };
    tokio::select! {
        result = server => result.map_err(WebError::Io),
        () = overtime => Ok(()),
    }
}

/// Feeds the history until the server or the engine ends.
async fn keep_history(shared: Arc<Shared>) {
    let mut snapshots = shared.state.snapshots.clone();
    snapshots.mark_changed();
    loop {
        tokio::select! {
            () = shared.shutdown.cancelled() => return,
            changed = snapshots.changed() => if changed.is_err() { return },
        }
        let snapshot = Arc::clone(&snapshots.borrow_and_update());
        shared.history.lock().unwrap_or_else(PoisonError::into_inner).feed(&snapshot);
    }
}

fn router(shared: Arc<Shared>) -> Router {
    Router::new()
        .route("/", get(assets::index))
        .route("/assets/{*path}", get(assets::asset))
        .route("/favicon.ico", get(assets::icon))
        .route("/healthz", get(api::health))
        .route("/metrics", get(api::metrics))
        .route("/api/v1/status", get(api::status))
        .route("/api/v1/sinks", get(api::sinks))
        .route("/api/v1/route", get(api::route))
        .route("/api/v1/history", get(api::history))
        .route("/api/v1/schema", get(api::schema))
        .route("/api/v1/capabilities", get(api::capabilities))
        .route("/api/v1/events", get(stream::events))
        .route("/api/v1/mission/upload", post(api::upload_mission))
        .route("/api/v1/parameters/apply", post(api::apply_parameters))
        .layer(DefaultBodyLimit::max(MAX_BODY_BYTES))
        .layer(middleware::from_fn_with_state(Arc::clone(&shared), access::guard))
        .layer(middleware::map_response(access::security_headers))
        .with_state(shared)
}
