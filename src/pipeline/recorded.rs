//! A recorded flight through the line: the same way for `replay`, `report` and `explain`.

use super::{Consumer, Pipeline};
use crate::inputs::Input;
use crate::logs::mcap::Setup;
use crate::logs::{self, Damage, LogError, LogReader, Record};
use crate::sensors::ConverterOptions;
use gaware_nav::sample::Sample;

/// Records between two looks at the progress.
const PROGRESS_EVERY: u64 = 4096;

/// A log that is open, with what a recording of gaware says of its own run.
pub struct Recorded {
    reader: Box<dyn LogReader>,
    setup: Option<Setup>,
    options: ConverterOptions,
}

impl Recorded {
    /// Opens a log of any known format. What the user asks for wins over what the recording was made with.
    ///
    /// # Errors
    /// No such file, an empty one, or one of another format.
    pub fn open(log: impl Into<Input>, asked: ConverterOptions) -> Result<Self, LogError> {
        let log = log.into();
        let reader = logs::open(&log)?;
        let setup = logs::mcap::recorded_setup(&log);
        let recorded = setup.as_ref().map(|s| s.converter).unwrap_or_default();
        let options = ConverterOptions {
            source: asked.source.or(recorded.source),
            vehicle: asked.vehicle.or(recorded.vehicle),
        };
        Ok(Self { reader, setup, options })
    }

    /// The set-up of the run, where the log is its recording.
    pub fn setup(&self) -> Option<&Setup> {
        self.setup.as_ref()
    }

    /// The autopilot, where it is its own log, with all its parameters.
    pub fn autopilot(&self) -> Option<&'static str> {
        self.reader.autopilot()
    }

    /// Size of the file.
    pub fn total_bytes(&self) -> u64 {
        self.reader.progress().total_bytes
    }

    /// Runs all of it through a new line in front of `consumer`; `progress` gets the bytes read so far.
    ///
    /// # Errors
    /// When nothing in it can be read.
    pub fn run<E: Consumer>(
        self,
        consumer: E,
        truth_from_s: f64,
        progress: &dyn Fn(u64),
    ) -> Result<(Pipeline<E>, Damage), LogError> {
        self.run_watched(consumer, truth_from_s, progress, &mut |_| {})
    }

    /// The same, with every record shown to `watch` on its way: a log is read once, however many want to know of it.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_watched<E: Consumer>(
        mut self,
        consumer: E,
        truth_from_s: f64,
        progress: &dyn Fn(u64),
        watch: &mut dyn FnMut(&Record),
    ) -> Result<(Pipeline<E>, Damage), LogError> {
        let mut consumer = consumer;
        self.setup.as_ref().and_then(|s| s.place).into_iter().for_each(|place| consumer.set_place(place));
        let mut pipeline = Pipeline::new(self.options, consumer, truth_from_s);
        pipeline.set_autopilot(self.reader.autopilot());
        pipeline.decide_vehicle_kind(self.setup.as_ref().and_then(|s| s.vehicle));
        let mut records = 0_u64;
        while let Some(record) = self.reader.next() {
            match record {
                Ok(record) => {
                    watch(&record);
                    pipeline.record(&record);
                }
                // What was read before a failing disk is still a result.
                Err(error @ LogError::Read { .. }) if records > 0 => {
                    tracing::warn!(%error, "the log is used up to here");
                    break;
                }
                Err(error) => return Err(error),
            }
            records += 1;
            if records.is_multiple_of(PROGRESS_EVERY) {
                progress(self.reader.progress().read_bytes);
            }
        }
        pipeline.learn_vehicle_kind(self.reader.vehicle_kind());
        Ok((pipeline, self.reader.damage()))
    }
}

/// Keeps what comes.
#[derive(Debug, Default)]
struct Kept(Vec<Sample>);

impl Consumer for Kept {
    fn feed(&mut self, sample: &Sample) {
        self.0.push(sample.clone());
    }
}

/// All samples of a log of any format, as a replay feeds them to the engine.
///
/// # Errors
/// A log that cannot be opened or read.
pub fn samples(log: impl Into<Input>, options: ConverterOptions) -> Result<Vec<Sample>, LogError> {
    let log = log.into();
    let recorded = Recorded::open(&log, options)?;
    let (pipeline, damage) = recorded.run(Kept::default(), f64::INFINITY, &|_| {})?;
    if damage.any() {
        tracing::warn!(?damage, path = %log.path().display(), "parts of the log could not be read");
    }
    Ok(pipeline.into_engine().0)
}

/// All samples of records that are in memory, likewise.
pub fn samples_of(records: &[Record], options: ConverterOptions) -> Vec<Sample> {
    let mut pipeline = Pipeline::new(options, Kept::default(), f64::INFINITY);
    records.iter().for_each(|record| pipeline.record(record));
    pipeline.into_engine().0
}
