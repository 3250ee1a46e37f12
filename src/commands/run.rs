//! `gaware run`: the daemon. Frames of all links go through converter and engine in one task, in the order in which they are
//! recorded, so that a replay of the recording repeats the run.

use super::band::BandArgs;
use super::pipeline::{Estimator, Pipeline};
use super::{CommandError, ListenArgs, load_model, output, print};
use crate::engine::snapshot::Snapshot;
use crate::link::address::Address;
use crate::link::endpoint::{LinkStatus, Links, ReceiveClock, Received};
use crate::link::frame::Frame;
use crate::link::heartbeat::Voice;
use crate::link::rates::{RateAction, RateKeeper, needs};
use crate::link::timesync::Timesync;
use crate::mission_link::uploader::RawMessage;
use crate::sensors::{AUTOPILOT_COMPONENT, ConverterOptions, ImuSource, Notice, Severity};
use crate::sinks::recorder::{RecordItem, Recorder, RecorderStats, Setup, recording_path};
use gaware_nav::model::Model;
use mavlink::dialects::ardupilotmega::MavMessage;
use serde::Serialize;
use serde_json::{Map, Value};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;

mod guard;

use guard::Guard;

/// Period of heartbeat, rate and time requests.
const HOUSEKEEPING: Duration = Duration::from_millis(50);
/// Period of snapshots.
const SNAPSHOT: Duration = Duration::from_millis(200);
/// Seconds after the first sample from which a simulated flight is compared with its truth; as in `replay`.
const TRUTH_FROM_S: f64 = 150.0;
/// Id of `TIMESYNC`.
const TIMESYNC: u32 = 111;

/// Arguments of `run`.
#[derive(Debug, Clone, clap::Args)]
pub struct RunArgs {
    /// Link to the vehicle: serial:/dev/ttyAMA0:921600, udpin:0.0.0.0:14550, udpout:HOST:PORT or tcpout:HOST:PORT; may
    /// be given several times.
    #[arg(long, value_name = "ADDR", required = true)]
    pub connect: Vec<Address>,
    /// Model of the sensors (default: g-sensitivity and GNSS latency are estimated).
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Where to record: a folder, or a file that ends in .mcap.
    #[arg(long, value_name = "PATH", default_value = "recordings", conflicts_with = "no_record")]
    pub record: PathBuf,
    /// Do not record.
    #[arg(long)]
    pub no_record: bool,
    /// Do not draw on the terminal.
    #[arg(long)]
    pub headless: bool,
    /// Rate of inertial messages to ask for, Hz.
    #[arg(long, value_name = "HZ", default_value_t = 200, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub rate: u16,
    /// What flies, for guidance: small_fixed_wing, large_fixed_wing, quadrotor, or a file that describes it. Without it no
    /// maneuver is proposed.
    #[arg(long, value_name = "NAME|FILE")]
    pub airframe: Option<String>,
    /// Heights that proposed maneuvers keep to.
    #[command(flatten)]
    pub band: BandArgs,
    /// Whom to listen to.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Sign with this key (32 bytes or 64 hexadecimal digits) and believe only frames signed with it. The last time used
    /// is kept beside it.
    #[arg(long, value_name = "FILE")]
    pub signing_key: Option<PathBuf>,
    /// Serve the web page on this address.
    #[arg(long, value_name = "ADDR")]
    pub web: Option<SocketAddr>,
    /// Token that the web page asks for; without one, a page on any other than this machine's own address makes one up.
    #[arg(long, value_name = "TOKEN", env = "GAWARE_WEB_TOKEN", hide_env_values = true)]
    pub web_token: Option<String>,
    /// A planned mission (.plan or .waypoints, see `gaware plan`) that may be uploaded from the page or the terminal; nothing is
    /// uploaded before somebody asks for it there and confirms. The mission before is kept in a file beside it.
    #[arg(long, value_name = "FILE")]
    pub mission: Option<PathBuf>,
    /// Print the result as one JSON document.
    #[arg(long)]
    pub json: bool,
    /// Stop after this many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub duration: Option<Duration>,
}

/// Seconds that make sense as the length of a run.
fn seconds(text: &str) -> Result<Duration, String> {
    let number = text.parse::<f64>().ok().filter(|s| (0.0..=1e9).contains(s));
    number.map(Duration::from_secs_f64).ok_or_else(|| "write a number of seconds from 0 to 1e9".to_owned())
}

/// Everything a screen shows at one instant.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Live {
    /// The estimator.
    pub snapshot: Snapshot,
    /// The links.
    pub links: Vec<LinkStatus>,
    /// The recording.
    pub recorder: Option<RecorderStats>,
    /// What the user was told lately, newest last.
    pub events: Vec<Event>,
    /// Round trip to the autopilot, ms.
    pub round_trip_ms: Option<f64>,
}

/// Something the user was told.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Event {
    /// When, Unix µs.
    pub t_us: u64,
    /// How much it matters.
    pub severity: Severity,
    /// Text.
    pub text: String,
}

/// Events that stay on the screen.
const EVENTS_KEPT: usize = 50;

/// How other tasks take part in a run.
#[derive(Debug)]
pub struct Hooks {
    /// Gets the newest state a few times a second.
    pub live: watch::Sender<Arc<Live>>,
    /// Messages for the vehicle and the ground station (telemetry, mission transfer); sent under our identity.
    pub outbox: mpsc::Receiver<MavMessage>,
    /// Messages by id and payload, for the mission transfer; sent in the same way.
    pub raw_outbox: mpsc::Receiver<RawMessage>,
    /// Gets a copy of every frame that arrives, for protocols with the vehicle; slow readers lose their own.
    pub frames: tokio::sync::broadcast::Sender<Received>,
}

/// Runs the command until `stop` or its duration ends it, and prints the result.
///
/// # Errors
/// When the model cannot be read or the recording cannot be started. A link that does not open is tried again until the
/// end, and only an error when by then none ever did.
pub async fn run<E: Estimator>(
    args: &RunArgs,
    hooks: Hooks,
    stop: CancellationToken,
    make: impl FnOnce(Model) -> E,
) -> Result<(), CommandError> {
    let live = hooks.live.subscribe();
    let (pipeline, document) = serve(args, hooks, stop, make).await?;
    if args.json {
        output::json(&document)?;
    } else {
        output::text(&print::summary(&pipeline.summary(), &document))?;
    }
    never_open(&live.borrow().links)
}

/// An error when not one link could ever be opened.
fn never_open(links: &[LinkStatus]) -> Result<(), CommandError> {
    if links.iter().any(|l| l.openings > 0) {
        return Ok(());
    }
    let problems = links.iter().map(|l| format!("{}: {}", l.address, l.problem));
    Err(CommandError::NoLink { problems: problems.collect::<Vec<_>>().join("; ") })
}

/// Runs until `stop` or the duration, and gives the pipeline at the end with the result.
///
/// # Errors
/// When the model cannot be read or the recording cannot be started.
pub async fn serve<E: Estimator>(
    args: &RunArgs,
    hooks: Hooks,
    stop: CancellationToken,
    make: impl FnOnce(Model) -> E,
) -> Result<(Pipeline<E>, Map<String, Value>), CommandError> {
    let model = args.model.as_deref().map_or_else(|| Ok(Model::standard()), load_model)?;
    let clock = ReceiveClock::start();
    let options = args.listen.options();
    let guard = args.signing_key.as_deref().map(|path| Guard::load(path, clock.now_us())).transpose()?;
    let recorder = start_recorder(args, &model, options, clock.now_us())?;
    // The engine gets the model as a replay will read it, to the last digit.
    let model = Model::from_toml(&model.to_toml()).unwrap_or(model);
    let mut session = Session {
        pipeline: Pipeline::new(options, make(model), TRUTH_FROM_S),
        links: Links::start(&args.connect, clock, &stop),
        clock,
        recorder,
        voice: Voice::new(),
        rates: None,
        timesync: Timesync::new(),
        hooks,
        guard,
        events: Vec::new(),
        imu_hz: usable_rate(args),
        source: args.listen.source,
    };
    session.until(stop, args.duration).await;
    let document = session.pipeline.document();
    session.links.stop().await;
    if let Some(recorder) = session.recorder {
        let path = recorder.path().to_owned();
        // The writer may have seconds of work left.
        let stats = tokio::task::spawn_blocking(move || recorder.finish()).await.unwrap_or_default();
        tracing::info!(path = %path.display(), ?stats, "recording closed");
    }
    Ok((session.pipeline, document))
}

fn start_recorder(
    args: &RunArgs,
    model: &Model,
    converter: ConverterOptions,
    now_us: u64,
) -> Result<Option<Recorder>, CommandError> {
    if args.no_record {
        return Ok(None);
    }
    let setup = Setup {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        links: args.connect.iter().map(Address::to_string).collect(),
        converter,
        model_toml: model.to_toml(),
    };
    let path = recording_path(&args.record, now_us);
    let recorder = Recorder::start(&path, &setup)?;
    tracing::info!(path = %path.display(), "recording");
    Ok(Some(recorder))
}

/// The rate asked for, lowered to what a serial line can carry: `RAW_IMU` alone takes 41 bytes of 10 bits, and a third
/// is left to others (FIELD_NOTES: 140 Hz at 57600 baud is the ceiling).
fn usable_rate(args: &RunArgs) -> u16 {
    let slowest = args.connect.iter().filter_map(|a| match a {
        Address::Serial { baud, .. } => Some(baud / 10 / 41 * 2 / 3),
        _ => None,
    });
    slowest.min().map_or(args.rate, |hz| args.rate.min(u16::try_from(hz).unwrap_or(u16::MAX)).max(1))
}

struct Session<E> {
    pipeline: Pipeline<E>,
    links: Links,
    clock: ReceiveClock,
    recorder: Option<Recorder>,
    voice: Voice,
    rates: Option<RateKeeper>,
    timesync: Timesync,
    hooks: Hooks,
    guard: Option<Guard>,
    events: Vec<Event>,
    imu_hz: u16,
    source: Option<ImuSource>,
}

impl<E: Estimator> Session<E> {
    async fn until(&mut self, stop: CancellationToken, end: Option<Duration>) {
        let end = async move {
            match end {
                Some(after) => tokio::time::sleep(after).await,
                None => std::future::pending().await,
            }
        };
        tokio::pin!(end);
        let mut housekeeping = tokio::time::interval(HOUSEKEEPING);
        housekeeping.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut snapshots = tokio::time::interval(SNAPSHOT);
        snapshots.set_missed_tick_behavior(MissedTickBehavior::Skip);
        loop {
            tokio::select! {
                () = stop.cancelled() => break,
                () = &mut end => break,
                _ = housekeeping.tick() => self.keep_house(),
                _ = snapshots.tick() => self.show(),
                Some(message) = self.hooks.outbox.recv() => self.say(&message),
                Some(message) = self.hooks.raw_outbox.recv() => self.say_raw(&message),
                received = self.links.next() => match received {
                    Some(received) => self.take(received),
                    None => break,
                },
            }
        }
        self.show();
    }

    fn take(&mut self, received: Received) {
        let t_us = received.t_us;
        // What is not believed is not recorded either: the recording is what the converter saw.
        if let Some(refusal) = self.guard.as_mut().and_then(|g| g.refuse(&received.frame)) {
            if let Some(text) = refusal.first_of_its_kind {
                self.tell(t_us, Severity::Warning, text);
            }
            return;
        }
        let now_ns = self.clock.monotonic_ns();
        self.record(RecordItem::Frame(received.clone()));
        let (samples, notices) = self.pipeline.frame(t_us, &received.frame);
        if let Some(recorder) = &self.recorder {
            for sample in samples {
                recorder.record(RecordItem::Sample(t_us, sample.clone()));
            }
        }
        for notice in notices {
            self.react(t_us, &notice);
        }
        if let Some(rates) = &mut self.rates {
            let mut actions = Vec::new();
            rates.receive(self.clock.now_us(), &received.frame, &mut actions);
            self.perform(actions);
        }
        let from_vehicle = self.pipeline.converter().vehicle() == Some(received.frame.system_id)
            && received.frame.component_id == AUTOPILOT_COMPONENT;
        if received.frame.message_id == TIMESYNC
            && from_vehicle
            && let Ok(MavMessage::TIMESYNC(m)) = received.frame.decode()
            && let Some(answer) = self.timesync.receive(now_ns, &m)
        {
            self.say(&answer);
        }
        // Nobody may be listening.
        let _ = self.hooks.frames.send(received);
    }

    fn react(&mut self, t_us: u64, notice: &Notice) {
        let now_us = self.clock.now_us();
        match notice {
            Notice::Vehicle { system_id, autopilot } => {
                self.voice.belongs_to(*system_id);
                let wanted = needs(*autopilot, self.imu_hz, self.source);
                self.rates = Some(RateKeeper::new(*system_id, *autopilot, wanted, now_us));
            }
            Notice::Reboot => {
                self.timesync.restart();
                if let Some(rates) = &mut self.rates {
                    rates.restart(now_us);
                }
            }
            _ => {}
        }
        self.tell(t_us, notice.severity(), notice.to_string());
    }

    fn perform(&mut self, actions: Vec<RateAction>) {
        for action in actions {
            match action {
                RateAction::Send(message) => self.say(&message),
                RateAction::Tell(notice) => {
                    self.tell(self.clock.now_us(), Severity::Warning, notice.to_string());
                }
            }
        }
    }

    fn tell(&mut self, t_us: u64, severity: Severity, text: String) {
        match severity {
            Severity::Info => tracing::info!("{text}"),
            Severity::Warning => tracing::warn!("{text}"),
        }
        self.record(RecordItem::Log(t_us, severity, text.clone()));
        if self.events.len() >= EVENTS_KEPT {
            self.events.remove(0);
        }
        self.events.push(Event { t_us, severity, text });
    }

    fn keep_house(&mut self) {
        let now_us = self.clock.now_us();
        let alive = self.pipeline.converter().source().is_some();
        if let Some(frame) = self.voice.poll(now_us, alive) {
            self.send(frame);
        }
        if let Some(rates) = &mut self.rates {
            let mut actions = Vec::new();
            rates.poll(now_us, &mut actions);
            self.perform(actions);
        }
        if self.pipeline.converter().vehicle().is_some()
            && let Some(request) = self.timesync.poll(self.clock.monotonic_ns())
        {
            self.say(&request);
        }
    }

    fn say(&mut self, message: &MavMessage) {
        let frame = self.voice.say(message);
        self.send(frame);
    }

    fn say_raw(&mut self, message: &RawMessage) {
        match self.voice.say_payload(message.id, &message.payload) {
            Ok(frame) => self.send(frame),
            Err(error) => tracing::error!(%error, "a mission message could not be made"),
        }
    }

    fn send(&mut self, frame: Frame) {
        let now_us = self.clock.now_us();
        let frame = self.guard.as_mut().map_or_else(|| frame.clone(), |g| g.sign(&frame, now_us));
        self.links.broadcast(&frame);
    }

    fn show(&mut self) {
        let snapshot = self.pipeline.snapshot();
        self.record(RecordItem::Snapshot(self.clock.now_us(), Box::new(snapshot.clone())));
        let live = Live {
            snapshot,
            links: self.links.handles().iter().map(|h| h.status()).collect(),
            recorder: self.recorder.as_ref().map(Recorder::stats),
            events: self.events.clone(),
            round_trip_ms: self.timesync.round_trip_ns().map(|ns| ns as f64 * 1e-6),
        };
        self.hooks.live.send_replace(Arc::new(live));
    }

    fn record(&self, item: RecordItem) {
        if let Some(recorder) = &self.recorder {
            recorder.record(item);
        }
    }
}

/// Ctrl-C, or SIGTERM from a service manager.
pub(super) async fn wait_for_signal() {
    let interrupt = tokio::signal::ctrl_c();
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        match signal(SignalKind::terminate()) {
            Ok(mut terminate) => tokio::select! {
                _ = interrupt => {}
                _ = terminate.recv() => {}
            },
            Err(_) => drop(interrupt.await),
        }
    }
    #[cfg(not(unix))]
    drop(interrupt.await);
}

#[cfg(test)]
mod tests;
