//! The straight line from a frame to a snapshot, the same for a live link and for a log.
//!
//! Everything here follows from the frames (or measurements) and their order alone, so that a replay of a recording gives
//! bit for bit what the run gave.

mod beside;
mod quality;
mod recorded;
pub mod replay;
pub mod truth_comparison;
mod window;

use crate::advice::start::Started;
use crate::engine::Engine;
use crate::engine::situation::FlightReport;
use crate::engine::snapshot::{GnssStatus, ImuStatus, Snapshot, Summary};
use crate::link::frame::Frame;
use crate::logs::filter::{self, Channel, Origin};
use crate::logs::{Damage, Item, LogNote, Record, TRUTH};
use crate::sensors::flight::FlightWatch;
use crate::sensors::truth::SimTruth;
use crate::sensors::{Converter, ConverterOptions, ConverterStats, Notice, Severity};
use crate::timeline::{Gaps, Stamp};
pub use beside::Beside;
use gaware_nav::earth::Geodetic;
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::Sample;
pub use quality::{Quality, ReceiverQuality};
pub use recorded::{Recorded, samples, samples_of};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value};
pub use truth_comparison::{TruthComparison, TruthResult};
pub use window::{Excerpt, LogPart, most_motion};

/// What takes the samples.
pub trait Consumer {
    /// Takes the next sample.
    fn feed(&mut self, sample: &Sample);
    /// The engine inside, which takes and answers what follows; nothing does where there is none.
    fn engine(&mut self) -> Option<&mut Engine> {
        None
    }
    // Written with the type: of an `&mut Engine` the method of this trait comes before one of its own that takes `&self`, and would ask itself.
    /// Takes what flies.
    fn set_vehicle(&mut self, kind: VehicleKind) {
        self.engine().into_iter().for_each(|engine| Engine::set_vehicle(engine, kind));
    }
    /// Takes what the vehicle reports of its flight.
    fn set_flight(&mut self, report: &FlightReport) {
        self.engine().into_iter().for_each(|engine| Engine::set_flight(engine, report));
    }
    /// Takes where the vehicle is for as long as no fix says so.
    fn set_place(&mut self, place: Geodetic) {
        self.engine().into_iter().for_each(|engine| Engine::set_place(engine, place));
    }
    /// Roll, pitch, yaw, rad, and the time they are for, s; nothing while there is no estimate. Called often.
    fn attitude(&mut self) -> Option<(f64, [f64; 3])> {
        Engine::attitude(self.engine()?)
    }
    /// 1-sigma of that roll, pitch and yaw, rad.
    fn attitude_sigmas(&mut self) -> Option<[f64; 3]> {
        Engine::attitude_sigmas(self.engine()?)
    }
    /// Takes what the autopilot's own filter reports of itself.
    fn filter_report(&mut self, _origin: Origin, _values: &[(Channel, f64)]) {}
    /// Takes an attitude that stands beside the one that flies: whose, and for which time, s.
    fn attitude_report(&mut self, _name: &str, _t_s: f64, _roll_pitch_yaw: [f64; 3]) {}
}

/// What the line needs of the engine.
pub trait Estimator: Consumer {
    /// The state now.
    fn snapshot(&self) -> Snapshot;
    /// The result so far.
    fn summary(&self) -> Summary;
}

/// The result as a document (`gaware.summary/1`): the summary with what an engine cannot know.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct ReplayDocument {
    /// The engine's summary.
    #[serde(flatten)]
    pub summary: Summary,
    /// What flew, where the vehicle or the user reports it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub vehicle_kind: Option<VehicleKind>,
    /// What came of the messages.
    pub converter: ConverterStats,
    /// Comparison with the truth that a simulated vehicle sends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth_comparison: Option<TruthResult>,
    /// What of the log could not be read; absent for a good log.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log_damage: Option<Damage>,
    /// First values that come from the autopilot's parameters; absent where there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(default)]
    pub started: Vec<Started>,
}

/// What the engine got.
#[derive(Debug, Clone)]
enum Given {
    Vehicle(VehicleKind),
    Flight(Box<FlightReport>),
    Sample(Box<Sample>),
}

/// Converter and engine in a row.
#[derive(Debug, Clone)]
pub struct Pipeline<E> {
    /// All that the engine got, as long as another may have to take its place.
    held: Option<Vec<Given>>,
    converter: Converter,
    flight: FlightWatch,
    engine: E,
    samples: Vec<Sample>,
    truth: TruthComparison,
    /// Warnings that nothing has settled.
    warnings: Vec<Notice>,
    /// The autopilot where the log itself says.
    log_autopilot: Option<&'static str>,
    /// What flies, and whether someone has decided that.
    kind: Option<VehicleKind>,
    kind_decided: bool,
}

impl<E: Consumer> Pipeline<E> {
    /// A line that has seen nothing. `truth_from_s`: seconds after the first sample from which the estimate is
    /// compared with the truth, where a simulated autopilot sends it.
    pub fn new(options: ConverterOptions, engine: E, truth_from_s: f64) -> Self {
        Self {
            held: None,
            converter: Converter::new(options),
            flight: FlightWatch::default(),
            engine,
            samples: Vec::new(),
            truth: TruthComparison::new(truth_from_s),
            warnings: Vec::new(),
            log_autopilot: None,
            kind: None,
            kind_decided: false,
        }
    }

    /// Names the autopilot of a log that holds measurements.
    pub fn set_autopilot(&mut self, name: Option<&'static str>) {
        self.log_autopilot = name;
    }

    /// Keeps all that the engine gets from now on, for [`Self::begin_anew`].
    pub fn hold(&mut self) {
        self.held = Some(Vec::new());
    }

    /// Keeps it no longer.
    pub fn let_go(&mut self) {
        self.held = None;
    }

    /// Another engine in the place of this one: it gets all that this one got, as if it had been there from the beginning.
    pub fn begin_anew(&mut self, engine: E) {
        self.engine = engine;
        for given in self.held.take().unwrap_or_default() {
            match given {
                Given::Vehicle(kind) => self.engine.set_vehicle(kind),
                Given::Flight(report) => self.engine.set_flight(&report),
                Given::Sample(sample) => self.engine.feed(&sample),
            }
        }
    }

    fn keep(&mut self, given: Given) {
        let Some(held) = &mut self.held else { return };
        if let (Given::Flight(_), Some(last @ Given::Flight(_))) = (&given, held.last_mut()) {
            // Nothing was measured under the one before.
            *last = given;
        } else {
            held.push(given);
        }
    }

    /// Decides what flies, whatever the vehicle itself reports.
    pub fn decide_vehicle_kind(&mut self, kind: Option<VehicleKind>) {
        self.kind_decided = false;
        self.learn_vehicle_kind(kind);
        self.kind_decided = kind.is_some();
    }

    /// Takes what the vehicle reports of its kind.
    fn learn_vehicle_kind(&mut self, kind: Option<VehicleKind>) {
        if kind.is_some() && kind != self.kind && !self.kind_decided {
            self.kind = kind;
            kind.into_iter().for_each(|kind| {
                self.keep(Given::Vehicle(kind));
                self.engine.set_vehicle(kind);
            });
        }
    }

    /// What flies: as the airframe of the run said, as the vehicle reports (heartbeat, messages and parameters of its log), or
    /// nothing where neither does.
    pub fn vehicle_kind(&self) -> Option<VehicleKind> {
        self.kind
    }

    /// Takes a frame; gives the samples that came of it and what is to be reported to the user.
    pub fn frame(&mut self, t_us: u64, frame: &Frame) -> (&[Sample], Vec<Notice>) {
        self.samples.clear();
        self.converter.feed(t_us, frame, &mut self.samples);
        self.learn_vehicle_kind(self.converter.vehicle_kind());
        self.flight.feed(t_us, frame, &self.converter);
        if self.held.is_some() {
            self.keep(Given::Flight(Box::new(self.flight.report().clone())));
        }
        self.engine.set_flight(self.flight.report());
        let notices = self.pass_on();
        if self.converter.vehicle() == Some(frame.system_id) {
            self.filter_report(Origin::Link, &filter::of_frame(frame));
        }
        if let Some(truth) = SimTruth::from_frame(frame, &self.converter) {
            self.truth(truth.t_s, truth.roll_pitch_yaw);
        }
        (&self.samples, notices)
    }

    /// Takes the true roll, pitch, yaw, rad, of a simulated vehicle.
    fn truth(&mut self, t_s: f64, roll_pitch_yaw: [f64; 3]) {
        let estimate = if self.truth.wants(t_s) { self.engine.attitude() } else { None };
        let sigmas = estimate.and_then(|_| self.engine.attitude_sigmas());
        self.truth.push(t_s, roll_pitch_yaw, estimate.map(|(at_s, estimate)| (at_s, estimate, sigmas)));
    }

    /// Takes an entry of a log.
    pub fn record(&mut self, record: &Record) {
        match &record.item {
            Item::Frame(frame) => {
                self.frame(record.t_us, frame);
            }
            Item::Measurement(measurement) => {
                self.samples.clear();
                self.converter.take(measurement, &mut self.samples);
                self.pass_on();
            }
            Item::Note(LogNote::Filter(values)) => self.filter_report(Origin::Log, values),
            Item::Note(LogNote::Attitude(name, roll_pitch_yaw)) => {
                if let Some(t_s) = self.converter.time().place_s(Stamp::Usec(record.t_us)) {
                    if name == TRUTH {
                        self.truth(t_s, *roll_pitch_yaw);
                    }
                    self.engine.attitude_report(name, t_s, *roll_pitch_yaw);
                }
            }
            Item::Note(_) => {}
        }
    }

    fn filter_report(&mut self, origin: Origin, values: &[(Channel, f64)]) {
        if !values.is_empty() {
            self.engine.filter_report(origin, values);
        }
    }

    /// Hands the new samples to the engine, and collects the notices.
    fn pass_on(&mut self) -> Vec<Notice> {
        for sample in &self.samples {
            self.engine.feed(sample);
        }
        if let Some(held) = &mut self.held {
            held.extend(self.samples.iter().cloned().map(|s| Given::Sample(Box::new(s))));
        }
        self.truth.begin(self.converter.time().now_s());
        let notices = self.converter.take_notices();
        for notice in &notices {
            // The newest of a kind counts: the inertial source of before a reboot is no longer in use.
            let kind = std::mem::discriminant(notice);
            self.warnings
                .retain(|earlier| std::mem::discriminant(earlier) != kind && !notice.settles(earlier));
            if notice.severity() == Severity::Warning {
                self.warnings.push(notice.clone());
            }
        }
        notices
    }

    /// The engine.
    pub fn engine(&self) -> &E {
        &self.engine
    }

    /// Roll, pitch, yaw, rad, and the time they are for, s; nothing while there is no estimate.
    pub fn attitude(&mut self) -> Option<(f64, [f64; 3])> {
        self.engine.attitude()
    }

    /// The engine, at the end.
    pub fn into_engine(self) -> E {
        self.engine
    }

    /// The converter.
    pub fn converter(&self) -> &Converter {
        &self.converter
    }

    /// The autopilot, as the log or its heartbeat names it.
    pub fn autopilot(&self) -> &'static str {
        self.log_autopilot.unwrap_or(self.converter.autopilot().name())
    }

    /// What the engine cannot know: what was lost or refused before it.
    fn complete(&self, imu: &mut ImuStatus, gnss: &mut GnssStatus, warnings: &mut Vec<String>) {
        let time = self.converter.time();
        imu.loss = self.flight.report().loss;
        imu.dropped += self.converter.stats().imu_dropped() + time.imu_lost();
        (imu.gaps, gnss.gaps) = (time.imu_gaps(), time.fix_gaps());
        warnings.splice(0..0, self.warnings.iter().map(Notice::to_string));
    }

    /// Gaps and refusals in words.
    fn losses(&self) -> Vec<String> {
        let (time, counts) = (self.converter.time(), self.converter.stats().time);
        let mut lost = Vec::new();
        let Gaps { count, seconds, longest_s } = time.imu_gaps();
        if count > 0 {
            lost.push(format!(
                "inertial samples have gaps: {count}, {seconds:.1} s in all, the longest {longest_s:.1} s"
            ));
        }
        for (n, what) in [
            (counts.imu_unconfirmed, "inertial samples with a time stamp out of place"),
            (counts.imu_implausible + counts.imu_invalid, "inertial samples with impossible values"),
            (counts.fix_implausible, "fixes with impossible values"),
            (counts.fix_misplaced, "fixes with a time stamp out of place"),
        ] {
            if n > 0 {
                lost.push(format!("{what} were rejected: {n}"));
            }
        }
        lost
    }
}

impl<E: Estimator> Pipeline<E> {
    /// The state now.
    pub fn snapshot(&self) -> Snapshot {
        let mut s = self.engine.snapshot();
        s.autopilot = self.autopilot().to_owned();
        self.complete(&mut s.imu, &mut s.gnss, &mut s.warnings);
        s
    }

    /// The result.
    pub fn summary(&self) -> Summary {
        let mut s = self.engine.summary();
        s.autopilot = self.autopilot().to_owned();
        self.complete(&mut s.imu, &mut s.gnss, &mut s.warnings);
        s.warnings.extend(self.losses());
        s.warnings.extend(self.other_vehicles());
        s
    }

    /// A recording of several vehicles says so, as a run does before it takes one of them.
    fn other_vehicles(&self) -> Option<String> {
        let (all, used) = (self.converter.several_vehicles(), self.converter.vehicle()?);
        (!all.is_empty()).then(|| {
            format!(
                "several vehicles are in the recording: {all}; this is of system {used}, which was heard first (--vehicle chooses another)"
            )
        })
    }

    /// The result as a document: the summary, what flew, what was refused on the way, and the comparison with the truth
    /// where there is one.
    pub fn document(&self) -> Map<String, Value> {
        let document = ReplayDocument {
            summary: self.summary(),
            vehicle_kind: self.vehicle_kind(),
            converter: self.converter.stats(),
            truth_comparison: self.truth.result(),
            log_damage: None,
            started: Vec::new(),
        };
        let Ok(Value::Object(document)) = serde_json::to_value(document) else { return Map::new() };
        document
    }
}

impl Consumer for Engine {
    fn feed(&mut self, sample: &Sample) {
        Self::feed(self, sample);
    }

    fn engine(&mut self) -> Option<&mut Engine> {
        Some(self)
    }
}

impl Estimator for Engine {
    fn snapshot(&self) -> Snapshot {
        Self::snapshot(self)
    }

    fn summary(&self) -> Summary {
        Self::summary(self)
    }
}

#[cfg(test)]
mod tests;
