//! Starting `run`: the engine with its sinks (terminal or log lines, web page, telemetry) on one runtime.

use super::CommandError;
use super::band::BandError;
use super::foxglove;
use super::mission::MissionError;
use super::params::ParamsError;
use super::run::{self, Hooks, RunArgs};
use super::signals;
use crate::engine::guidance::GuidanceOptions;
use crate::engine::situation::SituationKind;
use crate::engine::snapshot::Snapshot;
use crate::engine::{Engine, EngineOptions};
use crate::figures::counted;
use crate::mission_link::param_delivery::ParamOrder;
use crate::mission_link::uploader::{Offer, Planned, Uploader};
use crate::mission_link::{files, route};
use crate::sinks::link_meter::LinkMeter;
use crate::sinks::live::Live;
use crate::sinks::log;
use crate::sinks::recorder::RecorderStats;
use crate::sinks::status::{MissionState, MissionView, RecorderState, RecorderView, SinkStatus, VehicleView};
#[cfg(unix)]
use crate::sinks::supervisor::Supervisor;
use crate::sinks::telemetry::{Telemetry, TelemetryLevel};
use crate::sinks::terminal::{self, Sources, headless};
use crate::sinks::web::{self, WebState, access::Token};
use mavlink::dialects::ardupilotmega::MavMessage;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Messages for the vehicle that may wait.
const OUTBOX: usize = 64;
/// Copies of frames that a slow protocol may fall behind.
const FRAMES: usize = 4096;

/// The runtime of the commands that talk to the network.
///
/// # Errors
/// When the system gives no threads.
pub fn runtime() -> Result<tokio::runtime::Runtime, CommandError> {
    log::start()?;
    tracing_to_stderr();
    Ok(tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?)
}

/// Log lines go to stderr; `RUST_LOG` chooses them, warnings by default.
fn tracing_to_stderr() {
    use std::io::IsTerminal;
    use tracing_subscriber::EnvFilter;
    let colour = std::env::var_os("NO_COLOR").is_none() && std::io::stderr().is_terminal() && shows_colours();
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    // A second command in the same process (tests) keeps the first one's log.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(colour)
        .with_writer(log::Stderr::default)
        .try_init();
}

/// Whether a terminal of this system takes the orders for colours: consoles of Windows only once they are told to.
fn shows_colours() -> bool {
    #[cfg(windows)]
    return ratatui::crossterm::ansi_support::supports_ansi();
    #[cfg(not(windows))]
    true
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

/// What a run asks of the engine.
fn engine_options(args: &RunArgs) -> Result<EngineOptions, CommandError> {
    let options = match &args.airframe {
        Some(name) => {
            let mut guidance = GuidanceOptions::new(super::demo::load_airframe(name)?, true);
            guidance.band_m = args.band.or(guidance.band_m)?;
            EngineOptions { guidance: Some(guidance), ..EngineOptions::default() }
        }
        None if args.band.is_given() => return Err(BandError::NoAirframe.into()),
        None => EngineOptions::default(),
    };
    Ok(EngineOptions { place: args.known.place.home, limit_deg: args.known.limit, ..options })
}

/// Reads what a run reads before it opens a link, and begins none.
///
/// # Errors
/// What a run would end with at once.
pub fn check(args: &RunArgs) -> Result<(), CommandError> {
    engine_options(args)?;
    args.effects.load()?;
    args.model.as_deref().map(super::load_model).transpose()?;
    args.params.as_deref().map(ParamOrder::load).transpose().map_err(ParamsError::from)?;
    args.mission.as_deref().map(Planned::load).transpose().map_err(MissionError::from)?;
    Ok(())
}

/// Runs with all sinks. Signals, the terminal and the duration cancel `asked`; the run itself ends once an upload under way
/// has put the previous mission back.
async fn with_sinks(args: &RunArgs) -> Result<(), CommandError> {
    let options = engine_options(args)?;
    let (asked, stop) = (CancellationToken::new(), CancellationToken::new());
    signals::cancel_on_signal(&asked);
    let status = SinkStatus::new();
    let (live, live_rx) = watch::channel(Arc::new(Live::default()));
    let (outbox, outbox_rx) = mpsc::channel(OUTBOX);
    let (frames, _) = broadcast::channel(FRAMES);
    let (snapshots, snapshots_rx) = watch::channel(Arc::new(Snapshot::default()));
    let (raw, raw_outbox) = mpsc::channel(OUTBOX);
    let mut requests = None;
    let mut uploads = None;
    let mut mission = None;
    let airframe = options.guidance.as_ref().map(|g| g.airframe.clone());
    let mut offer = Offer { airframe, ..Offer::default() };
    if let Some(path) = &args.params {
        offer.parameters = Some(ParamOrder::load(path).map_err(ParamsError::from)?);
    }
    if let Some(path) = &args.mission {
        offer.mission = Some(Planned::load(path).map_err(MissionError::from)?);
        let (planned_mission, fence) = files::read(path).map_err(MissionError::from)?;
        status.set_route(route::route(&planned_mission, &fence));
        mission = Some(planned_mission);
    }
    if offer.mission.is_some() || offer.parameters.is_some() {
        let uploader = Uploader::new(
            offer,
            args.listen.vehicle,
            frames.subscribe(),
            raw,
            live_rx.clone(),
            status.clone(),
        );
        // One at a time; whoever comes second is answered so.
        let (sender, receiver) = mpsc::channel(1);
        requests = Some(sender);
        uploads = Some(tokio::spawn(uploader.run(receiver, asked.clone())));
    }
    let sources =
        || Sources { snapshots: snapshots_rx.clone(), status: status.clone(), requests: requests.clone() };
    if let Some(address) = args.web {
        serve_web(address, args.web_token.as_deref(), sources(), &stop).await?;
    }
    let foxglove = match args.foxglove {
        Some(address) => Some(foxglove::serve(address, args.web_token.as_deref(), &status, &stop)?),
        None => None,
    };
    if args.headless || args.json || show_terminal(sources(), &asked).is_err() {
        tokio::spawn(headless::run(sources(), headless::PERIOD, log::Stderr, stop.clone()));
    }
    #[cfg(unix)]
    if let Some(supervisor) = Supervisor::from_env(&|name| std::env::var(name).ok()) {
        tokio::spawn(supervisor.run(live_rx.clone(), stop.clone()));
    }
    tokio::spawn(relay(live_rx, snapshots, outbox, status, args.telemetry, stop.clone()));
    let hooks = Hooks { live, outbox: outbox_rx, raw_outbox, mission, frames, foxglove };
    let duration = args.duration;
    let ends = stop.clone();
    tokio::spawn(async move {
        let over = async {
            match duration {
                Some(after) => tokio::time::sleep(after).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            () = over => asked.cancel(),
            () = asked.cancelled() => {}
        }
        if let Some(uploads) = uploads {
            // Its end is all that matters.
            let _ = uploads.await;
        }
        ends.cancel();
    });
    let make = move |model| Engine::new(model, options.clone());
    run::run(&RunArgs { duration: None, ..args.clone() }, hooks, stop, make).await
}

fn show_terminal(sources: Sources, stop: &CancellationToken) -> Result<(), terminal::TerminalError> {
    let options = terminal::Options::from_env(|name| std::env::var(name).ok());
    terminal::spawn(sources, options, stop.clone()).map(drop)
}

/// Serves the page; on any address but this machine's own it takes a token, and makes one up where none was given. The task ends with `stop`.
///
/// # Errors
/// When the address is taken or the token is no good.
pub async fn serve_web(
    address: SocketAddr,
    token: Option<&str>,
    sources: Sources,
    stop: &CancellationToken,
) -> Result<JoinHandle<()>, CommandError> {
    let fail = |source: std::io::Error| CommandError::Web { address, reason: source.to_string() };
    let listener = web::door::bind(address).map_err(fail)?;
    let bound = listener.local_addr().map_err(fail)?;
    let shown = address_to_open(bound);
    let mut state = WebState::new(sources.snapshots, sources.status);
    if let Some(requests) = sources.requests.clone() {
        state = state.with_commands(requests);
    }
    let refuse = |e: web::WebError| CommandError::Web { address, reason: e.to_string() };
    match token {
        Some(text) => {
            state = state.with_token(Token::new(text).map_err(refuse)?);
            log::line(&format!("web page: http://{shown}/ (with the token given)"));
        }
        // An upload needs a token, also from this machine.
        None if !bound.ip().is_loopback() || sources.requests.is_some() => {
            let token = Token::random().map_err(refuse)?;
            log::line(&format!("web page: http://{shown}/?token={}", token.reveal()));
            state = state.with_token(token);
        }
        None => log::line(&format!("web page: http://{shown}/")),
    }
    let stop = stop.clone();
    Ok(tokio::spawn(async move {
        if let Err(error) = web::serve(listener, state, stop).await {
            tracing::error!(%error, "the web page stopped");
        }
    }))
}

/// The address that a browser opens: no one can open 0.0.0.0, so it is this machine's own towards the default route, where there is one.
pub(super) fn address_to_open(bound: SocketAddr) -> SocketAddr {
    if !bound.ip().is_unspecified() {
        return bound;
    }
    let (any, elsewhere): (SocketAddr, SocketAddr) = match bound {
        SocketAddr::V4(_) => (([0, 0, 0, 0], 0).into(), ([192, 0, 2, 1], 9).into()),
        SocketAddr::V6(_) => (([0_u16; 8], 0).into(), ([0x2001, 0xdb8, 0, 0, 0, 0, 0, 1], 9).into()),
    };
    // Connecting a UDP socket sends nothing; it only chooses the interface.
    let own = std::net::UdpSocket::bind(any).and_then(|s| {
        s.connect(elsewhere)?;
        s.local_addr()
    });
    let own = own.map(|a| a.ip()).ok().filter(|ip| !ip.is_unspecified());
    let loopback = match bound {
        SocketAddr::V4(_) => std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST),
        SocketAddr::V6(_) => std::net::IpAddr::V6(std::net::Ipv6Addr::LOCALHOST),
    };
    SocketAddr::new(own.unwrap_or(loopback), bound.port())
}

/// Hands the live state on: snapshots to the screens, telemetry to the links, figures to the status registry.
async fn relay(
    mut live: watch::Receiver<Arc<Live>>,
    snapshots: watch::Sender<Arc<Snapshot>>,
    outbox: mpsc::Sender<MavMessage>,
    status: Arc<SinkStatus>,
    level: TelemetryLevel,
    stop: CancellationToken,
) {
    let mut telemetry = level.config().map(Telemetry::new);
    let counters = status.sink("telemetry");
    let recorded = status.sink("recorder");
    let links = status.sink("links");
    let mut unsent = 0;
    let mut before = RecorderStats::default();
    let started = Instant::now();
    let mut meter = LinkMeter::default();
    let mut texts_dropped = 0;
    let mut mission = MissionState::None;
    loop {
        tokio::select! {
            () = stop.cancelled() => return,
            changed = live.changed() => if changed.is_err() { return },
        }
        let now = live.borrow_and_update().clone();
        status.set_link(meter.view(started.elapsed().as_secs_f64(), &now.links));
        status.set_recorder(recorder_view(&now));
        if let Some(stats) = now.recorder {
            recorded.delivered(stats.written.saturating_sub(before.written));
            recorded.dropped((stats.failed + stats.dropped).saturating_sub(before.failed + before.dropped));
            before = stats;
        }
        let unsent_now = now.links.iter().map(|l| l.unsent).sum::<u64>();
        links.dropped(unsent_now - std::mem::replace(&mut unsent, unsent_now));
        let planned = status.mission();
        if std::mem::replace(&mut mission, planned.state) != planned.state
            && let Some(telemetry) = &mut telemetry
        {
            telemetry.announce(started.elapsed().as_secs_f64(), &planned);
        }
        if let Some(telemetry) = &mut telemetry {
            for message in telemetry.feed(started.elapsed().as_secs_f64(), &now.snapshot) {
                match outbox.try_send(message) {
                    Ok(()) => counters.delivered(1),
                    Err(_) => counters.dropped(1),
                }
            }
            counters.dropped(telemetry.dropped_texts() - texts_dropped);
            texts_dropped = telemetry.dropped_texts();
        }
        let mut snapshot = now.snapshot.clone();
        let items = if planned.state == MissionState::OnVehicle { planned.items } else { 0 };
        status.set_vehicle(VehicleView::reported(&snapshot.situation, snapshot.mission.item, items));
        point_to_mission(&mut snapshot, &planned);
        snapshots.send_replace(Arc::new(snapshot));
    }
}

/// A vehicle that stands and has a planned mission at hand is not to be flown by hand first. Screens only: the engine, and
/// with it the recording, knows nothing of missions.
fn point_to_mission(snapshot: &mut Snapshot, planned: &MissionView) {
    let situation = &mut snapshot.situation;
    if situation.kind != SituationKind::Ground {
        return;
    }
    let next = match planned.state {
        MissionState::Ready | MissionState::NotOnVehicle => {
            format!(
                "Upload the planned mission, {}: key u, or the button on the page",
                counted(planned.items, "item")
            )
        }
        MissionState::OnVehicle => "Arm, and start the mission from your ground station".to_owned(),
        MissionState::None | MissionState::Uploading | MissionState::Unknown => return,
    };
    situation.text = next;
    if planned.state == MissionState::NotOnVehicle {
        situation.detail.clone_from(&planned.text);
    }
}

fn recorder_words(stats: RecorderStats) -> String {
    let mut words = match (stats.failed, stats.dropped) {
        (0, 0) => format!("{} items", stats.written),
        (0, lost) => format!("{} items, {lost} lost", stats.written),
        (failed, lost) => format!("{} items, {failed} not written, {lost} lost", stats.written),
    };
    if stats.removed_files > 0 {
        words += &format!(", {} older recordings removed", stats.removed_files);
    }
    words
}

fn recorder_view(live: &Live) -> RecorderView {
    let Some(stats) = live.recorder else { return RecorderView::default() };
    let failed = stats.failed > 0;
    RecorderView {
        state: if failed { RecorderState::Failed } else { RecorderState::Recording },
        detail: recorder_words(stats),
        bytes: stats.bytes,
        file: live.recording.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pointed(kind: SituationKind, state: MissionState) -> String {
        let mut s = Snapshot::default();
        (s.situation.kind, s.situation.text) = (kind, "as it is".into());
        point_to_mission(&mut s, &MissionView { state, items: 12, ..MissionView::default() });
        s.situation.text
    }

    #[test]
    fn who_stands_with_a_planned_mission_is_pointed_to_it() {
        use SituationKind::{Ground, Maneuver, NoGnss};
        assert!(pointed(Ground, MissionState::Ready).contains("Upload the planned mission, 12 items"));
        assert!(pointed(Ground, MissionState::NotOnVehicle).contains("Upload"));
        assert!(pointed(Ground, MissionState::OnVehicle).contains("start the mission"));
        for (kind, state) in [
            (Maneuver, MissionState::Ready),
            (NoGnss, MissionState::OnVehicle),
            (Ground, MissionState::None),
            (Ground, MissionState::Unknown),
        ] {
            assert_eq!(pointed(kind, state), "as it is");
        }
    }
}
