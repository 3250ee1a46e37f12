//! A run under way: frames through converter and engine, requests to the vehicle, snapshots for the screens.

use super::Hooks;
use super::introduction::Introduction;
use crate::advice::on_board::OnBoard;
use crate::engine::snapshot::Snapshot;
use crate::link::endpoint::{Links, ReceiveClock, Received};
use crate::link::frame::Frame;
use crate::link::guard::Guard;
use crate::link::heartbeat::HeartbeatSource;
use crate::link::rates::{RateAction, RateKeeper, needs};
use crate::link::status::LinkStatus;
use crate::link::timesync::Timesync;
use crate::mission_link::inventory::Inventory;
use crate::mission_link::uploader::RawMessage;
use crate::mission_link::vehicle::Vehicle;
use crate::pipeline::{Estimator, Pipeline};
use crate::sensors::{AUTOPILOT_COMPONENT, ImuSource, Notice, Severity};
use crate::sinks::events::Causes;
use crate::sinks::foxglove::Feed;
use crate::sinks::live::{Event, Live};
use crate::sinks::recorder::{RecordItem, Recorder};
use crate::view::mission_watch::MissionWatch;
use crate::view::received;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;

/// Period of heartbeat, rate and time requests.
const HOUSEKEEPING: Duration = Duration::from_millis(50);
/// Period of snapshots.
const SNAPSHOT: Duration = Duration::from_millis(200);
/// Id of `TIMESYNC`.
const TIMESYNC: u32 = 111;
/// Id of `COMMAND_ACK`.
const COMMAND_ACK: u32 = 77;
/// At the end each rate is given back up to so often, …
const GIVE_BACK_TRIES: u32 = 2;
/// … each time waiting so long for the answer.
const GIVE_BACK_PATIENCE: Duration = Duration::from_millis(400);
/// What is news on the screens is so for so long, µs.
const NEWS_US: u64 = 20_000_000;
/// Events that stay on the screen.
const EVENTS_KEPT: usize = 50;

/// Everything that takes part in a run.
pub(super) struct Session<E> {
    pub(super) pipeline: Pipeline<E>,
    pub(super) links: Links,
    pub(super) clock: ReceiveClock,
    pub(super) recorder: Option<Recorder>,
    pub(super) voice: HeartbeatSource,
    pub(super) rates: Option<RateKeeper>,
    /// What the vehicle says of itself.
    pub(super) on_board: OnBoard,
    /// What is known of its unit.
    pub(super) introduction: Introduction<E>,
    /// What was said of that, and when, µs.
    pub(super) unit_said: Option<(u64, String)>,
    /// Reads version and parameters for the recording.
    pub(super) inventory: Option<Inventory>,
    pub(super) timesync: Timesync,
    pub(super) hooks: Hooks,
    pub(super) guard: Option<Guard>,
    pub(super) events: Vec<Event>,
    pub(super) causes: Causes,
    pub(super) mission: MissionWatch,
    /// How many systems were named, and which of them as followed.
    pub(super) systems_named: (usize, u8),
    /// When the last frame of the vehicle came, µs.
    pub(super) received_us: Option<u64>,
    pub(super) imu_hz: u16,
    pub(super) source: Option<ImuSource>,
}

impl<E: Estimator> Session<E> {
    /// Serves links, timers and other tasks until `stop` or for so long.
    pub(super) async fn until(&mut self, stop: CancellationToken, end: Option<Duration>) {
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
                Some(message) = self.hooks.raw_outbox.recv() => self.pass_on(&message),
                received = self.links.next() => match received {
                    Some(received) => self.take(received),
                    None => break,
                },
            }
        }
        self.show();
    }

    /// Leaves the vehicle's message rates as they were found. What arrives meanwhile is no longer part of the run.
    pub(super) async fn give_rates_back(&mut self) {
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
        if let Some(text) = self.guard.as_mut().and_then(Guard::take_warning) {
            self.tell(t_us, Severity::Warning, text);
        }
        let now_ns = self.clock.monotonic_ns();
        self.record(RecordItem::Frame(received.clone()));
        let (samples, notices) = self.pipeline.frame(t_us, &received.frame);
        let sampled = !samples.is_empty();
        let keepers = (&self.recorder, &self.hooks.foxglove);
        if keepers.0.is_some() || keepers.1.is_some() {
            for sample in samples {
                keep(keepers, RecordItem::Sample(t_us, sample.clone()));
            }
        }
        if sampled {
            self.introduction.sampled(t_us, &mut self.pipeline);
        }
        for notice in notices {
            self.react(t_us, &notice);
        }
        self.name_systems(t_us);
        if let Some(rates) = &mut self.rates {
            let mut actions = Vec::new();
            rates.receive(self.clock.now_us(), &received.frame, &mut actions);
            self.perform(actions);
        }
        self.take_stock(&received);
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
            self.received_us = Some(t_us);
            self.mission.receive(t_us as f64 * 1e-6, &received.frame);
        }
        // No one may be listening.
        let _ = self.hooks.frames.send(received);
    }

    /// Names every system received, once there are several.
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
                self.inventory = None;
            }
            Notice::Reboot => {
                self.timesync.restart();
                if let Some(rates) = &mut self.rates {
                    rates.restart(now_us);
                }
                if let Some(inventory) = &mut self.inventory {
                    inventory.look_again();
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
        if let Some(inventory) = &mut self.inventory {
            let messages = inventory.poll(self.clock.monotonic_ns() as f64 * 1e-9);
            let report = inventory.take_report();
            messages.iter().for_each(|message| self.say_raw(message));
            if let Some(report) = report {
                self.tell(now_us, Severity::Info, report);
            }
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
            Ok(frame) => {
                let (now_us, to) = (self.clock.now_us(), message.to);
                let Some(handle) = self.links.handles().get(usize::from(to.link)) else { return };
                let signed = match &mut self.guard {
                    Some(guard) => guard.sign(&frame, u8::try_from(to.link).unwrap_or(u8::MAX), now_us),
                    None => frame,
                };
                handle.send_to(signed, to.peer);
            }
            Err(error) => tracing::error!(%error, "a mission message could not be made"),
        }
    }

    /// A message of a transfer of this run; the parameters for the recording wait.
    fn pass_on(&mut self, message: &RawMessage) {
        let now_s = self.clock.monotonic_ns() as f64 * 1e-9;
        if let Some(inventory) = &mut self.inventory {
            inventory.give_way(now_s);
        }
        self.say_raw(message);
    }

    /// Version and parameters of the vehicle that is followed, as far as they are recorded.
    fn take_stock(&mut self, received: &Received) {
        let frame = &received.frame;
        self.on_board.frame(frame, self.pipeline.converter().vehicle());
        if let Some(id) = &self.on_board.board
            && let Some((severity, text, setup)) = self.introduction.named(id, &mut self.pipeline)
        {
            if let Some((recorder, setup)) = self.recorder.as_ref().zip(setup) {
                recorder.record(RecordItem::Setup(Box::new(setup)));
            }
            if !text.is_empty() {
                if severity == Severity::Info {
                    // A screen that has the terminal keeps it back, and shows it as news.
                    crate::sinks::log::line(&text);
                }
                self.unit_said = Some((self.clock.now_us(), text.clone()));
                self.tell(received.t_us, severity, text);
            }
        }
        let now_s = self.clock.monotonic_ns() as f64 * 1e-9;
        if self.inventory.is_none()
            && (self.recorder.is_some() || self.introduction.asks())
            && let Some(vehicle) = Vehicle::from_heartbeat(frame)
            && self.pipeline.converter().vehicle() == Some(vehicle.address.system)
        {
            let inventory = Inventory::new(vehicle, received.origin(), now_s);
            let all = self.recorder.is_some();
            self.inventory = Some(if all { inventory } else { inventory.of_version_alone() });
        }
        if let Some(inventory) = &mut self.inventory {
            inventory.receive(now_s, frame);
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
        self.mission.complete(now_us as f64 * 1e-6, &mut snapshot);
        let links: Vec<_> = self.links.handles().iter().map(|h| h.status()).collect();
        self.with_link(now_us, &links, &mut snapshot);
        let unit_said =
            self.unit_said.iter().filter(|(said_us, _)| now_us.saturating_sub(*said_us) < NEWS_US);
        snapshot.news.extend(unit_said.map(|(_, text)| text.clone()));
        self.record(RecordItem::Snapshot(now_us, Box::new(snapshot.clone())));
        let live = Live {
            snapshot,
            vehicle: self.pipeline.converter().vehicle(),
            links,
            recorder: self.recorder.as_ref().map(Recorder::stats),
            recording: self.recorder.as_ref().map_or_else(String::new, |r| r.path().display().to_string()),
            events: self.events.clone(),
            round_trip_ms: self.timesync.round_trip_ns().map(|ns| ns as f64 * 1e-6),
        };
        self.hooks.live.send_replace(Arc::new(live));
    }

    /// What only this side of the link knows: which rate was asked for, what was received, and that nothing arrives any more.
    fn with_link(&self, now_us: u64, links: &[LinkStatus], snapshot: &mut Snapshot) {
        let converter = self.pipeline.converter();
        let asked = self.rates.as_ref().zip(converter.source());
        snapshot.imu.asked_hz = asked.map_or(0.0, |(r, source)| r.asked_hz(source.message_id()));
        let silent_s = self.received_us.map_or(0.0, |t| now_us.saturating_sub(t) as f64 * 1e-6);
        received::complete(snapshot, links, converter, silent_s);
    }

    fn record(&self, item: RecordItem) {
        keep((&self.recorder, &self.hooks.foxglove), item);
    }
}

/// Hands an item to the live viewers and to the recording; neither is waited for.
fn keep((recorder, viewers): (&Option<Recorder>, &Option<Feed>), item: RecordItem) {
    if let Some(viewers) = viewers {
        viewers.offer(&item);
    }
    if let Some(recorder) = recorder {
        recorder.record(item);
    }
}
