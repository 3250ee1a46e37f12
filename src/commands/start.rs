//! Starting `run`: the engine with its sinks (terminal or log lines, web page, telemetry) on one runtime.

use super::CommandError;
use super::run::{self, Hooks, Live, RunArgs};
use crate::engine::snapshot::Snapshot;
use crate::engine::{Engine, EngineOptions};
use crate::link::framer::FramerStats;
use crate::sinks::recorder::RecorderStats;
use crate::sinks::status::{LinkState, LinkView, RecorderState, RecorderView, SinkStatus};
use crate::sinks::telemetry::{Telemetry, TelemetryConfig};
use crate::sinks::terminal::{self, Sources, headless};
use crate::sinks::web::{self, WebState, access::Token};
use mavlink::dialects::ardupilotmega::MavMessage;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Messages for the vehicle that may wait.
const OUTBOX: usize = 64;
/// Copies of frames that a slow protocol may fall behind.
const FRAMES: usize = 4096;
/// A link without a frame for this long is called silent.
const SILENT: Duration = Duration::from_secs(3);

/// The runtime of the commands that talk to the network.
///
/// # Errors
/// When the system gives no threads.
pub fn runtime() -> Result<tokio::runtime::Runtime, CommandError> {
    tracing_to_stderr();
    Ok(tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?)
}

/// Log lines go to stderr; `RUST_LOG` chooses them, warnings by default.
fn tracing_to_stderr() {
    use std::io::IsTerminal;
    use tracing_subscriber::EnvFilter;
    let colour = std::env::var_os("NO_COLOR").is_none() && std::io::stderr().is_terminal();
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    // A second command in the same process (tests) keeps the first one's log.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(colour)
        .with_writer(std::io::stderr)
        .try_init();
}

/// Cancels at Ctrl-C or SIGTERM.
pub fn cancel_on_signal(stop: &CancellationToken) {
    let stop = stop.clone();
    tokio::spawn(async move {
        run::wait_for_signal().await;
        stop.cancel();
    });
}

/// Runs `gaware run` to its end.
///
/// # Errors
/// As [`run::run`]; also when the web page cannot be served where it was asked for.
pub fn run(args: RunArgs) -> Result<(), CommandError> {
    let runtime = runtime()?;
    let result = runtime.block_on(with_sinks(&args));
    runtime.shutdown_timeout(Duration::from_secs(2));
    result
}

async fn with_sinks(args: &RunArgs) -> Result<(), CommandError> {
    let options = match &args.airframe {
        Some(name) => EngineOptions::for_airframe(super::demo::load_airframe(name)?, true),
        None => EngineOptions::default(),
    };
    let stop = CancellationToken::new();
    let status = SinkStatus::new();
    let (live, live_rx) = watch::channel(Arc::new(Live::default()));
    let (outbox, outbox_rx) = mpsc::channel(OUTBOX);
    let (frames, _) = broadcast::channel(FRAMES);
    let (snapshots, snapshots_rx) = watch::channel(Arc::new(Snapshot::default()));
    let sources = || Sources { snapshots: snapshots_rx.clone(), status: status.clone() };
    if let Some(address) = args.web {
        serve_web(address, args.web_token.as_deref(), sources(), &stop).await?;
    }
    if args.headless || args.json || show_terminal(sources(), &stop).is_err() {
        tokio::spawn(headless::run(sources(), headless::PERIOD, tokio::io::stderr(), stop.clone()));
    }
    tokio::spawn(relay(live_rx, snapshots, outbox, status, stop.clone()));
    let hooks = Hooks { live, outbox: outbox_rx, frames };
    run::run(args, hooks, stop, |model| Engine::new(model, options)).await
}

fn show_terminal(sources: Sources, stop: &CancellationToken) -> Result<(), terminal::TerminalError> {
    let options = terminal::Options::from_env(|name| std::env::var(name).ok());
    terminal::spawn(sources, options, stop.clone()).map(drop)
}

/// Serves the page; on any address but this machine's own it takes a token, and makes one up where none was given.
///
/// # Errors
/// When the address is taken or the token is no good.
pub async fn serve_web(
    address: SocketAddr,
    token: Option<&str>,
    sources: Sources,
    stop: &CancellationToken,
) -> Result<SocketAddr, CommandError> {
    let fail = |source: std::io::Error| CommandError::Web { address, reason: source.to_string() };
    let listener = tokio::net::TcpListener::bind(address).await.map_err(fail)?;
    let bound = listener.local_addr().map_err(fail)?;
    let mut state = WebState::new(sources.snapshots, sources.status);
    let refuse = |e: web::WebError| CommandError::Web { address, reason: e.to_string() };
    match token {
        Some(text) => state = state.with_token(Token::new(text).map_err(refuse)?),
        None if !bound.ip().is_loopback() => {
            let token = Token::random().map_err(refuse)?;
            eprintln!("web page: http://{bound}/?token={}", token.reveal());
            state = state.with_token(token);
        }
        None => eprintln!("web page: http://{bound}/"),
    }
    let stop = stop.clone();
    tokio::spawn(async move {
        if let Err(error) = web::serve(listener, state, stop).await {
            tracing::error!(%error, "the web page stopped");
        }
    });
    Ok(bound)
}

/// Hands the live state on: snapshots to the screens, telemetry to the links, figures to the status registry.
async fn relay(
    mut live: watch::Receiver<Arc<Live>>,
    snapshots: watch::Sender<Arc<Snapshot>>,
    outbox: mpsc::Sender<MavMessage>,
    status: Arc<SinkStatus>,
    stop: CancellationToken,
) {
    let mut telemetry = Telemetry::new(TelemetryConfig::default());
    let counters = status.sink("telemetry");
    let recorded = status.sink("recorder");
    let mut before = RecorderStats::default();
    let started = Instant::now();
    let mut meter = LinkMeter { frames: 0, since: started, heard: started, rate_hz: 0.0 };
    let mut texts_dropped = 0;
    loop {
        tokio::select! {
            () = stop.cancelled() => return,
            changed = live.changed() => if changed.is_err() { return },
        }
        let now = live.borrow_and_update().clone();
        status.set_link(meter.view(&now));
        status.set_recorder(recorder_view(&now));
        if let Some(stats) = now.recorder {
            recorded.delivered(stats.written.saturating_sub(before.written));
            recorded.dropped((stats.failed + stats.dropped).saturating_sub(before.failed + before.dropped));
            before = stats;
        }
        for message in telemetry.feed(started.elapsed().as_secs_f64(), &now.snapshot) {
            match outbox.try_send(message) {
                Ok(()) => counters.delivered(1),
                Err(_) => counters.dropped(1),
            }
        }
        counters.dropped(telemetry.dropped_texts() - texts_dropped);
        texts_dropped = telemetry.dropped_texts();
        snapshots.send_replace(Arc::new(now.snapshot.clone()));
    }
}

fn recorder_view(live: &Live) -> RecorderView {
    let Some(stats) = live.recorder else { return RecorderView::default() };
    let failed = stats.failed > 0;
    RecorderView {
        state: if failed { RecorderState::Failed } else { RecorderState::Recording },
        detail: match (stats.failed, stats.dropped) {
            (0, 0) => format!("{} items", stats.written),
            (0, lost) => format!("{} items, {lost} lost", stats.written),
            (failed, lost) => format!("{} items, {failed} not written, {lost} lost", stats.written),
        },
        bytes: stats.bytes,
    }
}

/// Rate and silence of all links together.
struct LinkMeter {
    frames: u64,
    since: Instant,
    heard: Instant,
    rate_hz: f64,
}

impl LinkMeter {
    fn view(&mut self, live: &Live) -> LinkView {
        let sum = |f: fn(&FramerStats) -> u64| live.links.iter().map(|l| f(&l.framer)).sum::<u64>();
        let frames = sum(|l| l.frames);
        let now = Instant::now();
        let elapsed = now.duration_since(self.since).as_secs_f64();
        if elapsed >= 1.0 {
            self.rate_hz = (frames.saturating_sub(self.frames)) as f64 / elapsed;
            if frames > self.frames {
                self.heard = now;
            }
            (self.frames, self.since) = (frames, now);
        }
        let up = live.links.iter().any(|l| l.up);
        let state = match (up, frames) {
            (false, 0) => LinkState::Connecting,
            (false, _) => LinkState::Down,
            (true, 0) => LinkState::Connecting,
            (true, _) if now.duration_since(self.heard) > SILENT => LinkState::Silent,
            (true, _) => LinkState::Up,
        };
        let words = live.links.iter().map(|l| match l.problem.as_str() {
            "" => l.address.to_string(),
            problem => format!("{}: {problem}", l.address),
        });
        LinkView {
            state,
            detail: words.collect::<Vec<_>>().join("; "),
            frames,
            bytes: live.links.iter().map(|l| l.received_bytes).sum(),
            lost: sum(|l| l.lost),
            bad_crc: sum(|l| l.bad_checksum),
            rate_hz: self.rate_hz,
        }
    }
}
