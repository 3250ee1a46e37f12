//! A companion and its vehicle in one process and virtual time: the simulated autopilot, the faults, and behind them the framer,
//! the converter, the engine and the rate keeper of `gaware run`.

use super::spoiler::Spoiler;
use gaware::engine::snapshot::{Phase, Snapshot};
use gaware::engine::{Engine, EngineOptions};
use gaware::link::address::Address;
use gaware::link::endpoint::{LinkStatus, Received};
use gaware::link::frame::Frame;
use gaware::link::framer::Framer;
use gaware::link::heartbeat::HeartbeatSource;
use gaware::link::rates::{RateAction, RateKeeper, needs};
use gaware::pipeline::Pipeline;
use gaware::sensors::{ConverterOptions, Notice, Severity};
use gaware::sinks::events::{Causes, phase_words};
use gaware::sinks::link_meter::LinkMeter;
use gaware::sinks::recorder::{RecordItem, Recorder};
use gaware::sinks::status::{LinkState, LinkView};
use gaware_nav::model::Model;
use gaware_sitl::autopilot::Autopilot;
use gaware_sitl::faults::{FaultyLink, LinkFaults};
use std::net::{Ipv4Addr, SocketAddr};

/// Virtual time of one turn, s.
pub(super) const TURN_S: f64 = 0.02;
/// Rate of inertial messages that is asked for, Hz.
const IMU_HZ: u16 = 50;
/// Unix time at which virtual time starts, µs.
pub(super) const EPOCH_US: u64 = 1_800_000_000_000_000;

/// What a pilot can read on the screens of a run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shown {
    /// The state of the link.
    pub(super) link: LinkState,
    /// The phase of the estimate.
    pub(super) phase: Phase,
    /// Everything beside figures: phase, what is waited for, warnings, messages since the last look.
    pub(super) sentences: Vec<String>,
}

/// The companion with the simulated vehicle at the other end of a function call.
pub(super) struct Station {
    /// With the virtual time at which each was switched on, s; the first one is the vehicle.
    autopilots: Vec<(f64, Autopilot)>,
    spoiler: Spoiler,
    /// From the vehicle, and to it.
    links: [FaultyLink; 2],
    framer: Framer,
    bytes: u64,
    pipeline: Pipeline<Engine>,
    voice: HeartbeatSource,
    rates: Option<RateKeeper>,
    causes: Causes,
    meter: LinkMeter,
    recorder: Option<Recorder>,
    now_s: f64,
    sent: u64,
    sentences: Vec<String>,
}

impl Station {
    /// A companion that assumes this model, and no vehicle yet.
    pub(super) fn new(model: Model, seed: u64, recorder: Option<Recorder>) -> Self {
        let engine = Engine::new(model, EngineOptions::default());
        Self {
            autopilots: Vec::new(),
            spoiler: Spoiler::new(super::spoiler::Spoil::None, 0.0..0.0),
            links: [0, 1].map(|direction| FaultyLink::new(LinkFaults::default(), seed, direction)),
            framer: Framer::new(),
            bytes: 0,
            pipeline: Pipeline::new(ConverterOptions::default(), engine, f64::INFINITY),
            voice: HeartbeatSource::new(),
            rates: None,
            causes: Causes::default(),
            meter: LinkMeter::default(),
            recorder,
            now_s: 0.0,
            sent: 0,
            sentences: Vec::new(),
        }
    }

    /// Switches this vehicle on instead of the one before.
    pub(super) fn connect(&mut self, autopilot: Autopilot, spoiler: Spoiler) {
        self.autopilots = vec![(self.now_s, autopilot)];
        self.spoiler = spoiler;
    }

    /// Another autopilot sends on the same link, without any fault of its own.
    pub(super) fn join(&mut self, autopilot: Autopilot) {
        self.autopilots.push((self.now_s, autopilot));
    }

    /// Those that joined are switched off.
    pub(super) fn part(&mut self) {
        self.autopilots.truncate(1);
    }

    /// What the link does to frames from now on, both ways.
    pub(super) fn set_link_faults(&mut self, faults: &LinkFaults) {
        self.links.iter_mut().for_each(|l| l.set_faults(faults.clone()));
    }

    /// The line from frames to snapshots.
    pub(super) fn pipeline(&self) -> &Pipeline<Engine> {
        &self.pipeline
    }

    /// The simulator's time of an instant of the estimate, s after power-on.
    pub(super) fn sim_time_of(&self, t_s: f64) -> Option<f64> {
        self.spoiler.sim_time_of(t_s)
    }

    /// Frames that the autopilots sent and that were found in what arrived.
    pub(super) fn frames(&self) -> (u64, u64) {
        (self.sent, self.framer.stats().frames)
    }

    /// The recording, at the end.
    pub(super) fn into_recorder(self) -> Option<Recorder> {
        self.recorder
    }

    /// The recording.
    pub(super) fn recorder(&self) -> Option<&Recorder> {
        self.recorder.as_ref()
    }

    /// One turn of [`TURN_S`].
    pub(super) fn turn(&mut self) {
        self.now_s += TURN_S;
        for bytes in self.links[1].pop(self.now_s) {
            self.autopilots.iter_mut().for_each(|(_, a)| a.receive(&bytes));
        }
        for (number, (on_s, autopilot)) in self.autopilots.iter_mut().enumerate() {
            autopilot.step(self.now_s - *on_s);
            for out in autopilot.take_output() {
                let Ok(frame) = Frame::parse(out.bytes.into()) else { continue };
                let sim_s = out.t_us as f64 * 1e-6;
                let frames = if number == 0 { self.spoiler.frames(sim_s, &frame) } else { vec![frame] };
                for frame in frames {
                    self.sent += 1;
                    self.links[0].push(*on_s + sim_s, frame.raw().to_vec());
                }
            }
        }
        for bytes in self.links[0].pop(self.now_s) {
            self.bytes += bytes.len() as u64;
            self.framer.push(&bytes);
            while let Some(frame) = self.framer.next_frame() {
                self.receive(&frame);
            }
        }
        self.keep_going();
    }

    fn now_us(&self) -> u64 {
        EPOCH_US + (self.now_s * 1e6) as u64
    }

    fn receive(&mut self, frame: &Frame) {
        let t_us = self.now_us();
        let (samples, notices) = self.pipeline.frame(t_us, frame);
        if let Some(recorder) = &self.recorder {
            recorder.record(RecordItem::Frame(Received { link: 0, peer: None, t_us, frame: frame.clone() }));
            for sample in samples {
                recorder.record(RecordItem::Sample(t_us, sample.clone()));
            }
        }
        for notice in notices {
            self.react(t_us, &notice);
        }
        let mut actions = Vec::new();
        if let Some(rates) = &mut self.rates {
            rates.receive(t_us, frame, &mut actions);
        }
        self.perform(actions);
    }

    fn react(&mut self, t_us: u64, notice: &Notice) {
        match notice {
            Notice::Vehicle { system_id, autopilot } => {
                self.voice.belongs_to(*system_id);
                let wanted = needs(*autopilot, IMU_HZ, None);
                self.rates = Some(RateKeeper::new(*system_id, *autopilot, wanted, t_us));
            }
            Notice::Reboot => {
                if let Some(rates) = &mut self.rates {
                    rates.restart(t_us);
                }
            }
            _ => {}
        }
        if notice.severity() == Severity::Warning {
            self.say(&notice.to_string());
        }
    }

    fn say(&mut self, text: &str) {
        self.sentences.extend(self.causes.admit(self.now_s, text));
    }

    fn perform(&mut self, actions: Vec<RateAction>) {
        for action in actions {
            match action {
                RateAction::Send(message) => {
                    let frame = self.voice.say(&message);
                    self.links[1].push(self.now_s, frame.raw().to_vec());
                }
                RateAction::Tell(notice) => self.say(&notice.to_string()),
            }
        }
    }

    fn keep_going(&mut self) {
        let now_us = self.now_us();
        let alive = self.pipeline.converter().source().is_some();
        if let Some(frame) = self.voice.poll(now_us, alive) {
            self.links[1].push(self.now_s, frame.raw().to_vec());
        }
        let mut actions = Vec::new();
        if let Some(rates) = &mut self.rates {
            rates.poll(now_us, &mut actions);
        }
        self.perform(actions);
    }

    /// The link as the screens show it.
    fn link(&mut self) -> LinkView {
        let status = LinkStatus {
            address: Address::UdpIn(SocketAddr::from((Ipv4Addr::UNSPECIFIED, 14_550))),
            up: true,
            problem: String::new(),
            openings: 1,
            received_bytes: self.bytes,
            framer: self.framer.stats(),
            unsent: 0,
        };
        self.meter.view(self.now_s, &[status])
    }

    /// What the pilot sees now; recorded too, where there is a recording.
    pub(super) fn show(&mut self) -> (Snapshot, Shown) {
        let link = self.link();
        let snapshot = self.pipeline.snapshot();
        if let Some(recorder) = &self.recorder {
            recorder.record(RecordItem::Snapshot(self.now_us(), Box::new(snapshot.clone())));
        }
        let mut sentences = std::mem::take(&mut self.sentences);
        if link.state != LinkState::Up {
            sentences.push(format!("link {}", link.state.word()));
        }
        if snapshot.phase != Phase::Running {
            sentences.push(phase_words(snapshot.phase).to_owned());
        }
        sentences.extend([snapshot.waiting_for.clone()].into_iter().filter(|s| !s.is_empty()));
        sentences.extend(snapshot.warnings.iter().cloned());
        let shown = Shown { link: link.state, phase: snapshot.phase, sentences };
        (snapshot, shown)
    }
}
