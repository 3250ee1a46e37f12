//! The straight line from a frame to a snapshot, the same for a live link and for a log.
//!
//! Everything here follows from the frames (or samples) and their order alone, so that a replay of a recording gives
//! bit for bit what the run gave.

use super::truth_comparison::TruthComparison;
use crate::engine::snapshot::{Snapshot, Summary};
use crate::link::frame::Frame;
use crate::logs::{Item, Record};
use crate::sensors::truth::SimTruth;
use crate::sensors::{Converter, ConverterOptions, Notice, Severity};
use gaware_nav::sample::Sample;
use serde_json::{Map, Value, json};

/// What the line needs of the engine.
pub trait Estimator {
    /// Takes the next sample.
    fn feed(&mut self, sample: &Sample);
    /// The state now.
    fn snapshot(&self) -> Snapshot;
    /// The result so far.
    fn summary(&self) -> Summary;
    /// Roll, pitch, yaw, rad, and the time they are for, s; nothing while there is no estimate. Called often.
    fn attitude(&self) -> Option<(f64, [f64; 3])>;
}

/// Converter and engine in a row.
#[derive(Debug)]
pub struct Pipeline<E> {
    converter: Converter,
    engine: E,
    samples: Vec<Sample>,
    truth: TruthComparison,
    /// Warnings that nothing has settled.
    warnings: Vec<Notice>,
    /// The autopilot where the log itself tells.
    told_autopilot: Option<&'static str>,
}

impl<E: Estimator> Pipeline<E> {
    /// A line that has seen nothing. `truth_from_s`: seconds after the first sample from which the estimate is
    /// compared with the truth, where a simulated autopilot sends it.
    pub fn new(options: ConverterOptions, engine: E, truth_from_s: f64) -> Self {
        Self {
            converter: Converter::new(options),
            engine,
            samples: Vec::new(),
            truth: TruthComparison::new(truth_from_s),
            warnings: Vec::new(),
            told_autopilot: None,
        }
    }

    /// Names the autopilot of a log that holds samples.
    pub fn set_autopilot(&mut self, name: Option<&'static str>) {
        self.told_autopilot = name;
    }

    /// Takes a frame; gives the samples that came of it and what the user is to be told.
    pub fn frame(&mut self, t_us: u64, frame: &Frame) -> (&[Sample], Vec<Notice>) {
        self.samples.clear();
        self.converter.feed(t_us, frame, &mut self.samples);
        for sample in &self.samples {
            self.engine.feed(sample);
        }
        self.truth.begin(self.converter.now_s());
        if let Some(truth) = SimTruth::from_frame(frame, &self.converter) {
            self.truth.push(&truth, self.engine.attitude());
        }
        let notices = self.converter.take_notices();
        for notice in &notices {
            self.warnings.retain(|earlier| earlier != notice && !notice.settles(earlier));
            if notice.severity() == Severity::Warning {
                self.warnings.push(notice.clone());
            }
        }
        (&self.samples, notices)
    }

    /// Takes an entry of a log.
    pub fn record(&mut self, record: &Record) {
        match &record.item {
            Item::Frame(frame) => {
                self.frame(record.t_us, frame);
            }
            Item::Sample(sample) => self.engine.feed(sample),
        }
    }

    /// The converter.
    pub fn converter(&self) -> &Converter {
        &self.converter
    }

    /// The state now.
    pub fn snapshot(&self) -> Snapshot {
        let mut snapshot = self.engine.snapshot();
        snapshot.autopilot = self.autopilot().to_owned();
        snapshot.imu.dropped += self.converter.stats().imu_dropped();
        snapshot.warnings.splice(0..0, self.warnings.iter().map(Notice::to_string));
        snapshot
    }

    /// The result.
    pub fn summary(&self) -> Summary {
        let mut summary = self.engine.summary();
        summary.autopilot = self.autopilot().to_owned();
        summary.imu.dropped += self.converter.stats().imu_dropped();
        summary.warnings.splice(0..0, self.warnings.iter().map(Notice::to_string));
        summary
    }

    /// The result as a document: the summary, what was refused on the way, and the comparison with the truth where
    /// there is one.
    pub fn document(&self) -> Map<String, Value> {
        let Ok(Value::Object(mut document)) = serde_json::to_value(self.summary()) else { return Map::new() };
        if self.told_autopilot.is_none() {
            document.insert("converter".to_owned(), json!(self.converter.stats()));
        }
        if let Some(result) = self.truth.result() {
            document.insert("truth_comparison".to_owned(), json!(result));
        }
        document
    }

    fn autopilot(&self) -> &'static str {
        self.told_autopilot.unwrap_or(self.converter.autopilot().name())
    }
}
