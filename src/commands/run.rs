//! `gaware run`: the daemon. Frames of all links go through converter and engine in one task, in the order in which they are
//! recorded, so that a replay of the recording repeats the run.

use super::{CommandError, demo, load_model, output, print};
use crate::engine::snapshot::{Phase, Snapshot};
use crate::link::address::Address;
use crate::link::endpoint::{LinkStatus, Links, ReceiveClock, Received};
use crate::link::frame::Frame;
use crate::link::heartbeat::HeartbeatSource;
use crate::link::rates::{RateAction, RateKeeper, needs};
use crate::link::timesync::Timesync;
use crate::mission_link::uploader::RawMessage;
use crate::pipeline::{Estimator, Pipeline};
use crate::sensors::{AUTOPILOT_COMPONENT, ConverterOptions, ImuSource, Notice, Severity};
use crate::sinks::events::Causes;
use crate::sinks::external_ahrs::Fresh;
use crate::sinks::recorder::{RecordItem, Recorder, RecorderStats, Setup};
use gaware_mission::item::Mission;
use gaware_nav::model::Model;
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::Sample;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use serde::Serialize;
use serde_json::{Map, Value};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, watch};
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;

mod args;
pub(crate) mod guard;
pub mod mission_watch;
mod outcome;

pub use args::RunArgs;
use guard::Guard;
use mission_watch::MissionWatch;
use outcome::{incomplete, received_anything, report_recording};

/// Period of heartbeat, rate and time requests.
const HOUSEKEEPING: Duration = Duration::from_millis(50);
/// Period of snapshots.
const SNAPSHOT: Duration = Duration::from_millis(200);
/// Seconds after the first sample from which a simulated flight is compared with its truth; as in `replay`.
const TRUTH_FROM_S: f64 = 150.0;
/// Id of `TIMESYNC`.
const TIMESYNC: u32 = 111;
/// Id of `COMMAND_ACK`.
const COMMAND_ACK: u32 = 77;
/// At the end each rate is given back up to so often, …
const GIVE_BACK_TRIES: u32 = 2;
/// … each time waiting so long for the answer.
const GIVE_BACK_PATIENCE: Duration = Duration::from_millis(400);

/// Everything a screen shows at one instant.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Live {
    /// The estimator.
    pub snapshot: Snapshot,
    /// System id of the vehicle that it listens to.
    pub vehicle: Option<u8>,
    /// The links.
    pub links: Vec<LinkStatus>,
    /// The recording.
    pub recorder: Option<RecorderStats>,
    /// The recording's file; empty where there is none.
    pub recording: String,
    /// Recent messages to the user, newest last.
    pub events: Vec<Event>,
    /// Round trip to the autopilot, ms.
    pub round_trip_ms: Option<f64>,
}

/// A message to the user.
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
    /// The mission that is planned, where there is one: what its items are.
    pub mission: Option<Mission>,
    /// Gets a copy of every frame that arrives, for protocols with the vehicle; slow readers lose their own.
    pub frames: tokio::sync::broadcast::Sender<Received>,
    /// Gets the state after every inertial sample, where an autopilot is to read it; a slow reader loses its own.
    pub navigation: Option<mpsc::Sender<Fresh>>,
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
    let heard = received_anything(&pipeline, &live.borrow().links);
    if args.json {
        output::json(&document)?;
    } else if heard.is_ok() {
        output::text(&print::summary(&pipeline.summary(), &document))?;
    }
    heard?;
    incomplete(&document)
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
    let guard = args.signing_key.as_deref().map(Guard::load).transpose()?;
    let recorder = start_recorder(args, &model, options, clock.now_us())?;
    // The engine gets the model as a replay will read it, to the last digit.
    let model = Model::from_toml(&model.to_toml()).unwrap_or(model);
    let mut hooks = hooks;
    let hooks_mission = hooks.mission.take();
    let mut pipeline = Pipeline::new(options, make(model), TRUTH_FROM_S);
    pipeline.decide_vehicle_kind(args.airframe.as_deref().map(airframe_kind).transpose()?);
    let mut session = Session {
        pipeline,
        // The links outlive a cancellation: the rates are given back over them.
        links: Links::start(&args.connect, clock, &CancellationToken::new()),
        clock,
        recorder,
        voice: HeartbeatSource::new(),
        rates: None,
        timesync: Timesync::new(),
        hooks,
        guard,
        events: Vec::new(),
        causes: Causes::default(),
        mission: MissionWatch::new(hooks_mission),
        systems_named: (0, 0),
        imu_hz: usable_rate(args),
        source: args.listen.source,
    };
    session.until(stop, args.duration).await;
    let mut document = session.pipeline.document();
    session.give_rates_back().await;
    if let Some(guard) = &mut session.guard {
        guard.close();
    }
    session.links.stop().await;
    if let Some(recorder) = session.recorder {
        let path = recorder.path().to_owned();
        // The writer may have seconds of work left.
        let stats = tokio::task::spawn_blocking(move || recorder.finish()).await.unwrap_or_default();
        tracing::info!(path = %path.display(), ?stats, "recording closed");
        report_recording(&path, stats, &mut document);
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
        vehicle: args.airframe.as_deref().map(airframe_kind).transpose()?,
    };
    let recorder = Recorder::start_in(&args.record, now_us, &setup, args.record_limit)?;
    tracing::info!(path = %recorder.path().display(), "recording");
    Ok(Some(recorder))
}

/// What flies by the airframe that the user names: a replay must speak of the same.
fn airframe_kind(name: &str) -> Result<VehicleKind, CommandError> {
    let wing = demo::load_airframe(name)?.is_fixed_wing();
    Ok(if wing { VehicleKind::FixedWing } else { VehicleKind::Multirotor })
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
    voice: HeartbeatSource,
    rates: Option<RateKeeper>,
    timesync: Timesync,
    hooks: Hooks,
    guard: Option<Guard>,
    events: Vec<Event>,
    causes: Causes,
    mission: MissionWatch,
    /// How many systems were named, and which of them as followed.
    systems_named: (usize, u8),
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

    /// Leaves the vehicle's message rates as they were found. What arrives meanwhile is no longer part of the run.
    async fn give_rates_back(&mut self) {
        let Some(rates) = self.rates.take() else { return };
        for message in rates.give_back() {
            if !self.links.handles().iter().any(|h| h.status().up) {
                return;
            }
            let mut answered = false;
            for _ in 0..GIVE_BACK_TRIES {
                self.say(&message);
                if tokio::time::timeout(GIVE_BACK_PATIENCE, self.acknowledged()).await.is_ok() {
                    answered = true;
                    break;
                }
            }
            if !answered {
                tracing::info!("the vehicle does not answer; its message rates stay as they are");
                return;
            }
        }
    }

    /// Waits for the vehicle to answer a request for a rate.
    async fn acknowledged(&mut self) {
        while let Some(received) = self.links.next().await {
            let from_vehicle = self.pipeline.converter().vehicle() == Some(received.frame.system_id);
            if from_vehicle
                && received.frame.message_id == COMMAND_ACK
                && let Ok(MavMessage::COMMAND_ACK(ack)) = received.frame.decode()
                && ack.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL
            {
                return;
            }
        }
    }

    fn take(&mut self, received: Received) {
        let t_us = received.t_us;
        // What is not accepted is not recorded either: the recording is what the converter saw.
        if let Some(refusal) = self.guard.as_mut().and_then(|g| g.refuse(&received.frame, t_us)) {
            if let Some(text) = refusal.first_of_its_kind {
                self.tell(t_us, Severity::Warning, text);
            }
            return;
        }
        let now_ns = self.clock.monotonic_ns();
        self.record(RecordItem::Frame(received.clone()));
        let (samples, notices) = self.pipeline.frame(t_us, &received.frame);
        let inertial = samples.iter().any(|s| matches!(s, Sample::Imu(_)));
        if let Some(recorder) = &self.recorder {
            for sample in samples {
                recorder.record(RecordItem::Sample(t_us, sample.clone()));
            }
        }
        for notice in notices {
            self.react(t_us, &notice);
        }
        if inertial {
            self.hand_on();
        }
        self.name_systems(t_us);
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
        if self.pipeline.converter().vehicle() == Some(received.frame.system_id) {
            self.mission.receive(t_us as f64 * 1e-6, &received.frame);
        }
        // No one may be listening.
        let _ = self.hooks.frames.send(received);
    }

    /// Hands the state after a sample on.
    fn hand_on(&mut self) {
        let Some(readers) = &self.hooks.navigation else { return };
        if let Some(navigation) = self.pipeline.navigation() {
            let fresh = Fresh { arrived: Instant::now(), navigation };
            // A reader that is behind takes the next one.
            let _ = readers.try_send(fresh);
        }
    }

    /// Names every system heard, once there are several.
    fn name_systems(&mut self, t_us: u64) {
        let converter = self.pipeline.converter();
        let systems = converter.systems();
        let Some(vehicle) = converter.vehicle() else { return };
        let now = (systems.len(), vehicle);
        if systems.len() < 2 || now == self.systems_named || !systems.is_proven(vehicle) {
            return;
        }
        self.systems_named = now;
        let text = format!(
            "several vehicles send on this link: {}; system {vehicle} is followed (--vehicle chooses another)",
            systems.words()
        );
        self.tell(t_us, Severity::Warning, text);
    }

    fn react(&mut self, t_us: u64, notice: &Notice) {
        let now_us = self.clock.now_us();
        match notice {
            Notice::Vehicle { system_id, autopilot } => {
                self.voice.belongs_to(*system_id);
                self.links.follow(*system_id);
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
        let Some(text) = self.causes.admit(t_us as f64 * 1e-6, &text) else { return };
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
        let Some(guard) = &mut self.guard else { return self.links.broadcast(&frame) };
        // Each link is a stream of signatures of its own.
        for (link, handle) in self.links.handles().iter().enumerate() {
            handle.send(guard.sign(&frame, u8::try_from(link).unwrap_or(u8::MAX), now_us));
        }
    }

    fn show(&mut self) {
        let now_us = self.clock.now_us();
        if let Some(report) = self.mission.take_report(now_us as f64 * 1e-6) {
            self.tell(now_us, Severity::Warning, report);
        }
        let mut snapshot = self.pipeline.snapshot();
        self.with_mission(now_us, &mut snapshot);
        self.with_systems(&mut snapshot);
        self.record(RecordItem::Snapshot(now_us, Box::new(snapshot.clone())));
        let live = Live {
            snapshot,
            vehicle: self.pipeline.converter().vehicle(),
            links: self.links.handles().iter().map(|h| h.status()).collect(),
            recorder: self.recorder.as_ref().map(Recorder::stats),
            recording: self.recorder.as_ref().map_or_else(String::new, |r| r.path().display().to_string()),
            events: self.events.clone(),
            round_trip_ms: self.timesync.round_trip_ns().map(|ns| ns as f64 * 1e-6),
        };
        self.hooks.live.send_replace(Arc::new(live));
    }

    /// Who waits for inertial data wants to know what it receives.
    fn with_systems(&self, snapshot: &mut Snapshot) {
        if snapshot.phase != Phase::WaitingForImu {
            return;
        }
        let converter = self.pipeline.converter();
        let heard = converter.systems().words();
        snapshot.waiting_for = match converter.vehicle() {
            Some(vehicle) if !heard.is_empty() => {
                format!("no inertial samples yet of vehicle {vehicle}; received from: {heard}")
            }
            _ => "no heartbeat of an autopilot yet: is it connected, and is this its port and baud rate?"
                .to_owned(),
        };
    }

    /// While the autopilot flies its mission no one is asked to fly anything else.
    fn with_mission(&self, now_us: u64, snapshot: &mut Snapshot) {
        snapshot.mission = self.mission.progress(now_us as f64 * 1e-6);
        if snapshot.mission.flying {
            let guidance = &mut snapshot.guidance;
            guidance.instruction.clear();
            guidance.progress = 0.0;
            guidance.reason = format!("the autopilot flies item {} of its mission", snapshot.mission.item);
        }
        if !snapshot.mission.stuck.is_empty() {
            snapshot.warnings.push(snapshot.mission.stuck.clone());
        }
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
