//! A vehicle that is only listened to: bytes of a link in, what screens show out, through the same line as a run. It asks the vehicle for nothing, so
//! it says what to set where too little comes. No sockets and no clock; times are Unix µs of whoever reads the link.

use super::history::History;
use super::link_meter::LinkMeter;
use super::mission_watch::MissionWatch;
use super::received::{complete, to_set};
use super::status::{RecorderState, RecorderView, StatusView, VehicleView};
use crate::engine::Engine;
use crate::engine::situation::{LOW_RATE_HZ, SILENT_S, SituationKind};
use crate::engine::snapshot::{Phase, Snapshot};
use crate::link::address::Address;
use crate::link::framer::{Framer, FramerStats};
use crate::link::status::LinkStatus;
use crate::logs::tlog::record_bytes;
use crate::pipeline::Pipeline;
use crate::pipeline::replay::TRUTH_FROM_S;
use crate::sensors::ConverterOptions;
use serde::Serialize;
use serde_json::{Map, Value};

/// What screens show at one instant.
#[derive(Debug, Clone, Serialize)]
pub struct View {
    /// The estimator.
    pub snapshot: Snapshot,
    /// Link, recording and who flies.
    pub sinks: StatusView,
    /// The events.
    pub history: History,
}

/// The link and its line.
#[derive(Debug)]
pub struct Listener {
    framer: Framer,
    pipeline: Pipeline<Engine>,
    link: LinkStatus,
    meter: LinkMeter,
    mission: MissionWatch,
    history: History,
    /// When the first frame of the vehicle came and the last one, µs.
    heard_us: Option<(u64, u64)>,
    /// When the first view was asked for, µs.
    began_us: Option<u64>,
    recorded: u64,
    most_recorded: u64,
}

impl Listener {
    /// A link that is not open yet. Beyond `most_recorded` bytes nothing more is recorded.
    pub fn new(address: Address, options: ConverterOptions, engine: Engine, most_recorded: u64) -> Self {
        let kind = engine.options().vehicle();
        let mut pipeline = Pipeline::new(options, engine, TRUTH_FROM_S);
        pipeline.decide_vehicle_kind(kind);
        let link = LinkStatus {
            address,
            up: false,
            problem: String::new(),
            openings: 0,
            received_bytes: 0,
            framer: FramerStats::default(),
            unsent: 0,
        };
        Self {
            framer: Framer::new(),
            pipeline,
            link,
            meter: LinkMeter::default(),
            mission: MissionWatch::default(),
            history: History::default(),
            heard_us: None,
            began_us: None,
            recorded: 0,
            most_recorded,
        }
    }

    /// The link was opened, at this baud rate.
    pub fn opened(&mut self, rate: u32) {
        self.framer.reset();
        if let Address::Serial { baud, .. } = &mut self.link.address {
            *baud = rate;
        }
        (self.link.up, self.link.problem) = (true, String::new());
        self.link.openings += 1;
    }

    /// The link is gone, and why.
    pub fn closed(&mut self, problem: &str) {
        (self.link.up, self.link.problem) = (false, problem.to_owned());
    }

    /// Takes bytes in the order in which they came; gives what is to be recorded of them, as entries of a `.tlog`.
    pub fn take(&mut self, t_us: u64, bytes: &[u8]) -> Vec<u8> {
        let mut records = Vec::new();
        self.link.received_bytes += bytes.len() as u64;
        self.framer.push(bytes);
        while let Some(frame) = self.framer.next_frame() {
            if self.recorded < self.most_recorded {
                let record = record_bytes(t_us, &frame);
                self.recorded += record.len() as u64;
                records.extend(record);
            }
            self.pipeline.frame(t_us, &frame);
            if self.pipeline.converter().vehicle() == Some(frame.system_id) {
                self.heard_us = Some((self.heard_us.map_or(t_us, |(first, _)| first), t_us));
                self.mission.receive(t_us as f64 * 1e-6, &frame);
            }
        }
        self.link.framer = self.framer.stats();
        records
    }

    /// What screens show now.
    pub fn view(&mut self, now_us: u64) -> View {
        let mut snapshot = self.pipeline.snapshot();
        self.mission.complete(now_us as f64 * 1e-6, &mut snapshot);
        let since_s = |t_us: u64| now_us.saturating_sub(t_us) as f64 * 1e-6;
        let silent_s = self.heard_us.map_or(0.0, |(_, last)| since_s(last));
        complete(&mut snapshot, std::slice::from_ref(&self.link), self.pipeline.converter(), silent_s);
        if self.heard_us.is_some_and(|(first, _)| since_s(first) > SILENT_S) && self.lacks(&snapshot) {
            let to_set = to_set(self.pipeline.converter().autopilot());
            snapshot.situation.detail = format!("This page asks the vehicle for nothing: {to_set}.");
        }
        self.history.feed(&snapshot);
        let began_us = *self.began_us.get_or_insert(now_us);
        let sinks = StatusView {
            schema: "gaware.sinks/1".to_owned(),
            link: self.meter.view(since_s(began_us), std::slice::from_ref(&self.link)),
            recorder: self.recorder(),
            vehicle: VehicleView::reported(&snapshot.situation, snapshot.mission.item, 0),
            ..StatusView::default()
        };
        View { snapshot, sinks, history: self.history.newest(Some(0)) }
    }

    /// Whether the vehicle sends too little on this link.
    fn lacks(&self, snapshot: &Snapshot) -> bool {
        match (snapshot.situation.kind, snapshot.phase) {
            (SituationKind::LowRate, _) => {
                snapshot.imu.rate_hz < LOW_RATE_HZ[0] || snapshot.gnss.rate_hz < LOW_RATE_HZ[1]
            }
            (SituationKind::Starting, Phase::WaitingForImu) => true,
            // A receiver without a fix sends all the same.
            (SituationKind::Starting, Phase::WaitingForGnss) => {
                snapshot.gnss.fixes == 0 && self.pipeline.converter().stats().no_fix == 0
            }
            _ => false,
        }
    }

    fn recorder(&self) -> RecorderView {
        let full = self.recorded >= self.most_recorded;
        RecorderView {
            state: if full { RecorderState::Failed } else { RecorderState::Recording },
            detail: if full {
                "no space for more: stop and save it"
            } else {
                "in this page: stop to save it"
            }
            .to_owned(),
            bytes: self.recorded,
            file: String::new(),
        }
    }

    /// The result so far, as of a replay of the recording.
    pub fn document(&self) -> Map<String, Value> {
        self.pipeline.document()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::EngineOptions;
    use crate::logs::{Item, Record};
    use crate::pipeline::replay::{ReplayRequest, replay};
    use gaware_nav::model::Model;
    use std::path::Path;

    fn listener() -> Listener {
        recording(u64::MAX)
    }

    fn recording(most: u64) -> Listener {
        let address = Address::Serial { path: "USB".to_owned(), baud: 57_600 };
        let engine = Engine::new(Model::standard().with_receiver(), EngineOptions::default());
        Listener::new(address, ConverterOptions::default(), engine, most)
    }

    fn flight() -> &'static Path {
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/small_gsens_typical_dither.tlog"))
    }

    /// Stamps and frames of the flight's first seconds.
    fn frames(seconds: f64) -> Vec<(u64, Vec<u8>)> {
        let all = crate::logs::open(flight()).unwrap().map(Result::unwrap);
        let mut frames = all.filter_map(|record| match record {
            Record { t_us, item: Item::Frame(frame) } => Some((t_us, frame.raw().to_vec())),
            _ => None,
        });
        let first = frames.next().unwrap();
        let until_us = first.0.saturating_add((seconds * 1e6) as u64);
        std::iter::once(first).chain(frames.take_while(|(t_us, _)| *t_us < until_us)).collect()
    }

    #[test]
    fn bytes_in_any_pieces_give_what_a_replay_gives_and_the_recording_is_the_flight() {
        let request = ReplayRequest {
            log: flight().into(),
            model: None,
            converter: ConverterOptions::default(),
            truth_from_s: TRUTH_FROM_S,
        };
        let make = |model| Engine::new(model, EngineOptions::default());
        let (_, replayed) = replay(&request, make, &|_, _| {}).unwrap();
        let mut listener = listener();
        listener.opened(57_600);
        let (mut recording, mut views) = (Vec::new(), 0);
        for (k, (t_us, frame)) in frames(f64::MAX).iter().enumerate() {
            // A view changes nothing.
            if k % 500 == 0 {
                listener.view(*t_us);
                views += 1;
            }
            let (head, tail) = frame.split_at(k % frame.len());
            recording.extend(listener.take(*t_us, head));
            recording.extend(listener.take(*t_us, tail));
        }
        assert!(views > 20);
        assert_eq!(Value::Object(listener.document()), Value::Object(replayed));
        assert_eq!(recording, std::fs::read(flight()).unwrap());
    }

    #[test]
    fn noise_silence_and_an_unplugged_port_are_named_and_what_follows_is_taken() {
        let frames = frames(120.0);
        let start_us = frames[0].0;
        let mut listener = listener();
        listener.opened(57_600);
        let at = |listener: &mut Listener, t_us: u64| listener.view(t_us);
        assert!(at(&mut listener, start_us).snapshot.situation.text.starts_with("nothing was received"));
        let noise: Vec<u8> = (0..5000_u32).map(|k| (k * k * 37 + 11) as u8).collect();
        listener.take(start_us, &noise);
        let text = at(&mut listener, start_us).snapshot.situation.text;
        assert!(text.contains("5000 bytes") && text.contains("baud rate"), "{text}");
        listener.closed("another baud rate");
        listener.opened(115_200);
        frames.iter().for_each(|(t_us, frame)| _ = listener.take(*t_us, frame));
        let end_us = frames.last().unwrap().0;
        let view = at(&mut listener, end_us);
        assert_eq!(view.snapshot.phase, Phase::Running);
        assert_eq!(view.snapshot.situation.kind, SituationKind::Mission);
        // This vehicle does not report which item.
        assert_eq!(view.sinks.vehicle.now, "its mission");
        assert!(view.sinks.link.detail.ends_with(":115200"), "{}", view.sinks.link.detail);
        listener.closed("unplugged");
        let view = at(&mut listener, end_us + 5_000_000);
        assert_eq!(view.snapshot.situation.kind, SituationKind::NoData);
        assert!(view.sinks.link.detail.contains("unplugged"));
        let history = serde_json::to_value(&view.history).unwrap();
        assert!(!history["events"].as_array().unwrap().is_empty());
    }

    #[test]
    fn a_recording_that_is_full_says_so_and_the_estimate_goes_on() {
        let mut listener = recording(10_000);
        listener.opened(57_600);
        let frames = frames(20.0);
        let recorded: usize = frames.iter().map(|(t_us, frame)| listener.take(*t_us, frame).len()).sum();
        let View { snapshot, sinks, .. } = listener.view(frames.last().unwrap().0);
        assert!((10_000..10_300).contains(&recorded), "{recorded}");
        assert_eq!((sinks.recorder.state, sinks.recorder.bytes), (RecorderState::Failed, recorded as u64));
        assert!(snapshot.imu.samples > 3000, "{}", snapshot.imu.samples);
    }

    #[test]
    fn what_to_set_is_said_where_too_little_comes() {
        let frames = frames(30.0);
        let mut listener = listener();
        listener.opened(57_600);
        // The first heartbeat, again and again: a vehicle of which nothing was asked.
        let heartbeat = frames.iter().find(|(_, raw)| raw[7..10] == [0, 0, 0]).unwrap();
        let mut view = None;
        for second in 0..6 {
            let t_us = heartbeat.0 + second * 1_000_000;
            listener.take(t_us, &heartbeat.1);
            view = Some(listener.view(t_us));
        }
        let situation = view.unwrap().snapshot.situation;
        assert!(situation.text.starts_with("no inertial data"), "{}", situation.text);
        assert!(situation.detail.contains("SR0_RAW_SENS"), "{}", situation.detail);
        frames.iter().for_each(|(t_us, frame)| _ = listener.take(*t_us, frame));
        let detail = listener.view(frames.last().unwrap().0).snapshot.situation.detail;
        assert!(!detail.contains("SR0_"), "{detail}");
    }
}
