//! One flight of the demonstration, turn by turn in virtual time: the same converter, engine, rate keeper and mission transfer
//! as on a real link, with the simulated autopilot at the other end of a function call.

mod upload;
mod view;

use super::Prepared;
use super::series::{Log, PERIOD_S};
use crate::engine::guidance::GuidanceOptions;
use crate::engine::snapshot::Snapshot;
use crate::engine::{Engine, EngineOptions};
use crate::link::frame::{Frame, Sender};
use crate::link::heartbeat::HeartbeatSource;
use crate::link::rates::{RateAction, RateKeeper, needs};
use crate::logs::{Item, Record};
use crate::mission_link::codec;
use crate::mission_link::vehicle::Vehicle;
use crate::pipeline::{Estimator, Pipeline};
use crate::sensors::{ConverterOptions, Notice};
use crate::sinks::foxglove::Feed;
use crate::sinks::messages::RecordItem;
use gaware_mission::change::{Exchange, VerifiedChange};
use gaware_mission::item::Autopilot as Firmware;
use gaware_mission::transfer::Action;
use gaware_mission::transfer::verified::{Outcome, VerifiedUpload};
use gaware_nav::model::Model;
use gaware_sitl::autopilot::Autopilot;
use gaware_sitl::sensors::draw_vehicle;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};

/// Virtual time of one turn, s.
pub const TURN_S: f64 = 0.02;
/// Rate of inertial samples that is asked for, Hz.
const IMU_HZ: u16 = 100;
/// The vehicle stands for so long before the upload, s: time to choose the inertial source and to level.
pub(super) const STAND_S: f64 = 12.0;
/// Between the upload and the take-off, s.
pub(super) const BEFORE_TAKE_OFF_S: f64 = 2.0;
/// Time in the hold at the end, s.
const HOLD_S: f64 = 20.0;
/// A flight takes no more than this share of its plan and this time beyond, s.
const PATIENCE: (f64, f64) = (1.5, 180.0);
/// Seconds after the first sample from which the attitude is compared with the truth.
const TRUTH_FROM_S: f64 = 60.0;
/// Screens show for so long a message, s.
const NEWS_S: f64 = 10.0;
/// The ground station of the simulated pilot.
const PILOT: Sender = Sender { system_id: 255, component_id: 190 };
const MISSION_ITEM_REACHED: u32 = 46;

/// What happens.
#[derive(Debug, Clone, PartialEq)]
pub enum Stage {
    /// Stationary, until there are samples.
    Standing,
    /// The mission is being uploaded.
    Uploading,
    /// On board, read back; the pilot takes off at this time, s.
    Ready(f64),
    /// The mission is being flown.
    Flying,
    /// The multirotor returns and lands.
    Landing,
    /// Over.
    Over(Ending),
}

/// How it ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Ending {
    /// The mission was flown to its hold.
    Holding,
    /// The mission was flown and the vehicle stands again.
    Landed,
    /// The upload failed; what is on the vehicle.
    NotUploaded(String),
    /// The flight did not come to its end in time.
    OutOfTime,
    /// Someone ended the demonstration before.
    Stopped,
}

/// The sigmas when a maneuver was done.
#[derive(Debug, Clone)]
pub struct Milestone {
    /// Index of the maneuver in the plan.
    pub maneuver: usize,
    /// Virtual time, s.
    pub t_s: f64,
    /// Name and sigma in the unit of screens, per state.
    pub sigmas: Vec<(String, f64)>,
}

/// The flight.
#[derive(Debug)]
pub struct Flight<E = Engine> {
    prepared: Prepared,
    truth: Model,
    autopilot: Autopilot,
    pipeline: Pipeline<E>,
    voice: HeartbeatSource,
    pilot_sequence: u8,
    rates: Option<RateKeeper>,
    vehicle: Option<Vehicle>,
    upload: Option<VerifiedUpload>,
    outcome: Option<Outcome>,
    stage: Stage,
    now_s: f64,
    took_off_s: f64,
    holding_since: Option<f64>,
    frames: u64,
    told: Vec<String>,
    /// When a message was shown last, and which: screens show it for a while.
    news: Option<(f64, String)>,
    milestones: Vec<Milestone>,
    log: Log,
    /// All frames of the vehicle, where they are kept.
    recording: Option<Vec<Record>>,
    /// Who watches the samples live.
    viewers: Option<Feed>,
}

impl Flight {
    /// A vehicle of this seed that stands at home.
    pub fn new(prepared: Prepared, seed: u64) -> Self {
        let settings = &prepared.settings;
        let truth = draw_vehicle(&settings.drawn, seed);
        let autopilot = prepared.autopilot(&truth, seed);
        let truth = relative_to_stamps(truth, autopilot.mean_stamp_delay_s());
        let mut guidance = GuidanceOptions::new(settings.airframe.clone(), false);
        guidance.band_m = settings.band_m;
        let options = EngineOptions { guidance: Some(guidance), ..EngineOptions::default() };
        let engine = Engine::new(settings.belief.clone(), options);
        Self::with(prepared, truth, autopilot, engine)
    }
}

impl<E: Estimator> Flight<E> {
    /// A vehicle that stands at home, with these sensors and this autopilot.
    pub fn with(prepared: Prepared, truth: Model, autopilot: Autopilot, engine: E) -> Self {
        Self {
            recording: None,
            viewers: None,
            pipeline: Pipeline::new(ConverterOptions::default(), engine, TRUTH_FROM_S),
            prepared,
            truth,
            autopilot,
            voice: HeartbeatSource::new(),
            pilot_sequence: 0,
            rates: None,
            vehicle: None,
            upload: None,
            outcome: None,
            stage: Stage::Standing,
            now_s: 0.0,
            took_off_s: 0.0,
            holding_since: None,
            frames: 0,
            told: Vec::new(),
            news: None,
            milestones: Vec::new(),
            log: Log::default(),
        }
    }

    /// Keeps all frames of the vehicle.
    #[must_use]
    pub fn recorded(self) -> Self {
        Self { recording: Some(Vec::new()), ..self }
    }

    /// Hands every sample to these viewers.
    #[must_use]
    pub fn watched(self, viewers: Feed) -> Self {
        Self { viewers: Some(viewers), ..self }
    }

    /// The frames that were kept, the line and the vehicle, for what comes after the flight.
    pub fn into_parts(self) -> (Vec<Record>, Pipeline<E>, Autopilot) {
        (self.recording.unwrap_or_default(), self.pipeline, self.autopilot)
    }

    /// Virtual time, s.
    pub fn now_s(&self) -> f64 {
        self.now_s
    }

    /// Virtual time, µs.
    pub fn now_us(&self) -> u64 {
        (self.now_s * 1e6) as u64
    }

    /// What happens.
    pub fn stage(&self) -> &Stage {
        &self.stage
    }

    /// How the upload ended, once it has.
    pub fn outcome(&self) -> Option<&Outcome> {
        self.outcome.as_ref()
    }

    /// Frames from the vehicle so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// The line from frames to snapshots.
    pub fn pipeline(&self) -> &Pipeline<E> {
        &self.pipeline
    }

    /// The state now, with what the demonstration has to report: the guidance is for pilots, and here no one follows it.
    pub fn snapshot(&self) -> Snapshot {
        let mut snapshot = self.pipeline.snapshot();
        let news = self.news.as_ref().filter(|(t_s, _)| self.now_s - t_s < NEWS_S);
        snapshot.news.extend(news.map(|(_, text)| text.clone()));
        snapshot
    }

    fn tell(&mut self, text: String) {
        self.news = Some((self.now_s, text.clone()));
        self.told.push(text);
    }

    /// What happened since the last call, for log lines.
    pub fn take_messages(&mut self) -> Vec<String> {
        std::mem::take(&mut self.told)
    }

    /// The plan that is flown.
    pub fn prepared(&self) -> &Prepared {
        &self.prepared
    }

    /// The ground truth about the sensors; the latency of fixes counts from the stamps of the inertial samples, as any
    /// estimate of it must.
    pub fn truth(&self) -> &Model {
        &self.truth
    }

    /// Sigmas at the end of each maneuver so far.
    pub fn milestones(&self) -> &[Milestone] {
        &self.milestones
    }

    /// Items reached and sigmas over time.
    pub fn log(&self) -> &Log {
        &self.log
    }

    /// The vehicle's true roll, pitch, yaw, deg, at the time of the newest estimate.
    pub fn true_attitude_deg(&mut self) -> [f64; 3] {
        let at = self.pipeline.attitude().map(|(t_s, _)| t_s);
        let truth = match at {
            Some(boot_s) => self.autopilot.truth_at_boot(boot_s),
            None => self.autopilot.truth(),
        };
        gaware_nav::rotation::euler_from_c_nb(&truth.c_nb).map(f64::to_degrees).into()
    }

    /// Flies to the end.
    pub fn run(&mut self) -> &Ending {
        loop {
            self.turn();
            if let Stage::Over(_) = self.stage {
                break;
            }
        }
        match &self.stage {
            Stage::Over(ending) => ending,
            _ => &Ending::OutOfTime,
        }
    }

    /// One turn of [`TURN_S`].
    pub fn turn(&mut self) {
        if matches!(self.stage, Stage::Over(_)) {
            return;
        }
        self.now_s += TURN_S;
        self.autopilot.step(self.now_s);
        for out in self.autopilot.take_output() {
            if let Ok(frame) = Frame::parse(out.bytes.into()) {
                self.receive(out.t_us, &frame);
            }
        }
        self.keep_house();
        self.go_on();
        self.write_down();
    }

    fn receive(&mut self, t_us: u64, frame: &Frame) {
        self.frames += 1;
        if let Some(recording) = &mut self.recording {
            recording.push(Record { t_us, item: Item::Frame(frame.clone()) });
        }
        let (samples, notices) = self.pipeline.frame(t_us, frame);
        if let Some(viewers) = &self.viewers {
            for sample in samples {
                viewers.offer(&RecordItem::Sample(t_us, sample.clone()));
            }
        }
        for notice in notices {
            if let Notice::Vehicle { system_id, autopilot } = notice {
                self.voice.belongs_to(system_id);
                let wanted = needs(autopilot, IMU_HZ, None);
                self.rates = Some(RateKeeper::new(system_id, autopilot, wanted, t_us));
            }
        }
        let mut actions = Vec::new();
        if let Some(rates) = &mut self.rates {
            rates.receive(t_us, frame, &mut actions);
        }
        self.perform(actions);
        if let Some(vehicle) = Vehicle::from_heartbeat(frame) {
            self.vehicle = Some(vehicle);
            if let Some(upload) = &mut self.upload {
                let actions = upload.vehicle_state(self.now_s, vehicle.state);
                self.transfer(actions);
            }
        }
        if let Some(upload) = &mut self.upload
            && let Some(envelope) = codec::decode(frame)
        {
            let actions = upload.receive(self.now_s, &envelope);
            self.transfer(actions);
        }
        if frame.message_id == MISSION_ITEM_REACHED
            && let Ok(MavMessage::MISSION_ITEM_REACHED(m)) = frame.decode()
        {
            self.reached(usize::from(m.seq));
        }
    }

    fn keep_house(&mut self) {
        let now_us = self.now_us();
        let alive = self.pipeline.converter().source().is_some();
        if let Some(frame) = self.voice.poll(now_us, alive) {
            self.autopilot.receive(frame.raw());
        }
        let mut actions = Vec::new();
        if let Some(rates) = &mut self.rates {
            rates.poll(now_us, &mut actions);
        }
        self.perform(actions);
        if let Some(upload) = &mut self.upload
            && upload.deadline().is_some_and(|t| t <= self.now_s)
        {
            let actions = upload.tick(self.now_s);
            self.transfer(actions);
        }
    }

    fn perform(&mut self, actions: Vec<RateAction>) {
        for action in actions {
            match action {
                RateAction::Send(message) => {
                    let frame = self.voice.say(&message);
                    self.autopilot.receive(frame.raw());
                }
                RateAction::Tell(notice) => self.tell(notice.to_string()),
            }
        }
    }

    fn transfer(&mut self, actions: Vec<Action>) {
        let Some(vehicle) = self.vehicle else { return };
        for action in actions {
            if let Action::Send(message) = action {
                let (id, payload) = codec::encode(vehicle.address, &message);
                if let Ok(frame) = self.voice.say_payload(id, &payload) {
                    self.autopilot.receive(frame.raw());
                }
            }
        }
    }

    /// The simulated pilot's station says something.
    fn pilot(&mut self, command: MavCmd, [param1, param2, param3]: [f32; 3]) {
        let system_id = self.vehicle.map_or(1, |v| v.address.system);
        let message = COMMAND_LONG_DATA {
            command,
            param1,
            param2,
            param3,
            target_system: system_id,
            target_component: 1,
            ..Default::default()
        };
        let frame = Frame::encode(PILOT, self.pilot_sequence, &MavMessage::COMMAND_LONG(message));
        self.pilot_sequence = self.pilot_sequence.wrapping_add(1);
        self.autopilot.receive(frame.raw());
    }

    fn go_on(&mut self) {
        let now = self.now_s;
        match self.stage {
            Stage::Standing if now >= STAND_S => self.begin_upload(),
            Stage::Uploading => self.follow_upload(),
            Stage::Ready(at) if now >= at => {
                self.tell("the demonstration's pilot arms and starts the mission".to_owned());
                self.pilot(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0]);
                self.pilot(MavCmd::MAV_CMD_MISSION_START, [0.0; 3]);
                self.took_off_s = now;
                self.stage = Stage::Flying;
            }
            Stage::Flying => self.follow_flight(),
            Stage::Landing if self.autopilot.has_landed() => self.end(Ending::Landed),
            _ => {}
        }
        let most = PATIENCE.0 * self.prepared.plan.duration_s + PATIENCE.1;
        if now > most && !matches!(self.stage, Stage::Over(_)) {
            self.end(Ending::OutOfTime);
        }
    }

    fn write_down(&mut self) {
        let in_flight = matches!(self.stage, Stage::Flying | Stage::Landing);
        let t_s = self.now_s - self.took_off_s;
        if !in_flight || self.log.sigmas.last().is_some_and(|(t, _)| t_s - t < PERIOD_S) {
            return;
        }
        let sigmas = self.sigmas();
        self.log.sigmas.push((t_s, sigmas));
    }

    /// Sigma by name.
    fn sigmas(&self) -> Vec<(String, f64)> {
        let states = self.pipeline.snapshot().observability.states;
        states.into_iter().map(|s| (s.name, s.sigma)).collect()
    }

    /// Sequence number of the hold at the end.
    fn last_item(&self) -> usize {
        self.autopilot.mission().len().saturating_sub(1)
    }

    fn follow_flight(&mut self) {
        if self.autopilot.has_landed() {
            self.end(Ending::Landed);
            return;
        }
        if self.prepared.lands() {
            return;
        }
        let holding = self.autopilot.vehicle().is_some_and(|v| v.current() >= self.last_item());
        if !holding {
            return;
        }
        let since = *self.holding_since.get_or_insert(self.now_s);
        if self.now_s - since < HOLD_S {
            return;
        }
        if self.prepared.settings.airframe.is_fixed_wing() {
            self.end(Ending::Holding);
        } else {
            self.tell("the demonstration's pilot returns and lands".to_owned());
            self.log.at_end = self.sigmas();
            let rtl = match self.prepared.settings.airframe.autopilot {
                Firmware::ArduPilot => [1.0, 6.0, 0.0],
                Firmware::Px4 => [1.0, 4.0, 5.0],
            };
            self.pilot(MavCmd::MAV_CMD_DO_SET_MODE, rtl);
            self.stage = Stage::Landing;
        }
    }

    fn end(&mut self, ending: Ending) {
        if self.log.at_end.is_empty() {
            self.log.at_end = self.sigmas();
        }
        self.stage = Stage::Over(ending);
    }
}

pub(super) fn relative_to_stamps(mut truth: Model, stamp_delay_s: f64) -> Model {
    for setting in truth.effects.iter_mut().filter(|s| s.effect.delays_fixes()) {
        setting.values.iter_mut().for_each(|v| *v -= stamp_delay_s);
    }
    truth
}
