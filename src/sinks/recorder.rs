//! The recording of a run: an MCAP file that holds everything needed to run it again, and that Foxglove opens.
//!
//! One writer thread owns the file; whoever records only hands items over and never waits. Twice a second the open
//! chunk is finished and forced to the disk, so that a power cut costs less than a second. A disk that is full costs
//! messages, which are counted, and a fresh file is tried now and then.
//!
//! Topics: `/mavlink/N` raw frames of link N in the order in which the converter saw them (no schema; the log time is
//! the time of reception), `/imu`, `/fix`, `/attitude_autopilot`, `/snapshot`, and `/position`, `/pose`, `/log` in
//! Foxglove's own schemas.

mod foxglove;
mod records;

use crate::engine::snapshot::Snapshot;
use crate::link::endpoint::Received;
use crate::sensors::{ConverterOptions, Severity};
use foxglove::{LocationFix, Log, PoseInFrame};
use gaware_nav::observability::words::VehicleKind;
use gaware_nav::sample::Sample;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, McapError, WriteOptions, Writer};
use records::{AttitudeRecord, FixRecord, ImuRecord};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Topic of the frames of a link is this and the link's number.
pub const FRAME_TOPIC: &str = "/mavlink/";
/// Name of the attachment with the model.
pub const MODEL_ATTACHMENT: &str = "model.toml";
/// Name of the metadata record with the set-up.
pub const SETUP_METADATA: &str = "gaware.setup";

/// Items that may wait for the writer. Frames are what a replay needs: they are dropped last.
const FRAMES_AHEAD: usize = 256 * 1024;
/// Everything else can be had again from the frames.
const DERIVED_AHEAD: usize = 8 * 1024;
/// Recordings that may begin in the same second in one folder.
const MAX_NAMES: u32 = 1000;
/// Half of the second that may be lost: the other half is for a disk that is slow to take it.
const SYNC_PERIOD: Duration = Duration::from_millis(500);
const RETRY_PERIOD: Duration = Duration::from_secs(10);

/// What a replay must know beside the frames.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Version of the program that recorded.
    pub version: String,
    /// Links, in the order of their numbers.
    pub links: Vec<String>,
    /// How frames were converted.
    pub converter: ConverterOptions,
    /// The model as a file.
    pub model_toml: String,
    /// What flies, where the user named an airframe.
    #[serde(default)]
    pub vehicle: Option<VehicleKind>,
}

/// One thing to record.
#[derive(Debug, Clone)]
pub enum RecordItem {
    /// A raw frame.
    Frame(Received),
    /// A sample that came of it; the time of reception in µs.
    Sample(u64, Sample),
    /// The state of the estimator.
    Snapshot(u64, Box<Snapshot>),
    /// A message to the user.
    Log(u64, Severity, String),
}

/// Why a recording cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// The file cannot be made.
    #[error("cannot record to {path}: {}", said(source))]
    Create {
        /// File.
        path: PathBuf,
        /// What was said.
        source: McapError,
    },
    /// The writer thread cannot be started.
    #[error("cannot start the recorder: {0}")]
    Thread(std::io::Error),
}

/// What the system said, rather than the library's words around it; a recording never overwrites an earlier one.
fn said(error: &McapError) -> String {
    match error {
        McapError::Io(source) if source.kind() == std::io::ErrorKind::AlreadyExists => {
            "the file exists already; name another one, or a folder".to_owned()
        }
        McapError::Io(source) => source.to_string(),
        other => other.to_string(),
    }
}

/// How the recording is doing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RecorderStats {
    /// Items that are on the disk.
    pub written: u64,
    /// Frames lost because the writer was behind.
    pub dropped: u64,
    /// Samples and snapshots left out because the writer was behind. A replay makes them again from the frames: nothing is lost.
    pub skipped: u64,
    /// Items lost because writing failed.
    pub failed: u64,
    /// Bytes on the disk.
    pub bytes: u64,
}

#[derive(Debug, Default)]
struct Counters {
    written: AtomicU64,
    dropped: AtomicU64,
    skipped: AtomicU64,
    failed: AtomicU64,
    bytes: AtomicU64,
    waiting: AtomicUsize,
}

/// The handle of a recording.
#[derive(Debug)]
pub struct Recorder {
    items: Option<Sender<RecordItem>>,
    counters: Arc<Counters>,
    thread: Option<JoinHandle<()>>,
    path: PathBuf,
}

impl Recorder {
    /// Starts to record into a new file.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub fn start(path: &Path, setup: &Setup) -> Result<Self, RecorderError> {
        let output = Output::create(path, setup)
            .map_err(|source| RecorderError::Create { path: path.to_owned(), source })?;
        Self::with(path, setup, output)
    }

    /// Starts to record into the file or the folder that is wanted. In a folder the name shows the time; where another start in the
    /// same second has taken it, as on a board without a clock, a number is added.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub fn start_in(wanted: &Path, unix_us: u64, setup: &Setup) -> Result<Self, RecorderError> {
        let first = recording_path(wanted, unix_us);
        let mut path = first.clone();
        for number in 2..=MAX_NAMES {
            match Self::start(&path, setup) {
                Err(RecorderError::Create { source: McapError::Io(e), .. })
                    if e.kind() == std::io::ErrorKind::AlreadyExists && first != wanted =>
                {
                    let stem = first.file_stem().and_then(|s| s.to_str()).unwrap_or("gaware");
                    path = first.with_file_name(format!("{stem}-{number}.mcap"));
                }
                result => return result,
            }
        }
        Self::start(&path, setup)
    }

    fn with(path: &Path, setup: &Setup, output: Output) -> Result<Self, RecorderError> {
        let (items, inbox) = channel();
        let counters = Arc::new(Counters::default());
        let worker = Worker {
            inbox,
            counters: Arc::clone(&counters),
            path: path.to_owned(),
            setup: setup.clone(),
            output: Some(output),
            pending: 0,
            settled: 0,
            earlier_bytes: 0,
            part: 1,
            retry: Instant::now(),
        };
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || worker.run())
            .map_err(RecorderError::Thread)?;
        Ok(Self { items: Some(items), counters, thread: Some(thread), path: path.to_owned() })
    }

    /// Hands an item over without waiting.
    pub fn record(&self, item: RecordItem) {
        let counters = &self.counters;
        let (room, lost) = match item {
            RecordItem::Frame(_) => (FRAMES_AHEAD, &counters.dropped),
            _ => (DERIVED_AHEAD, &counters.skipped),
        };
        let waiting = &counters.waiting;
        // Counted before it is sent: the writer takes it off again after it has taken it.
        if waiting.fetch_add(1, Ordering::Relaxed) >= room
            || self.items.as_ref().is_none_or(|items| items.send(item).is_err())
        {
            waiting.fetch_sub(1, Ordering::Relaxed);
            lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// How it is doing.
    pub fn stats(&self) -> RecorderStats {
        RecorderStats {
            written: self.counters.written.load(Ordering::Relaxed),
            dropped: self.counters.dropped.load(Ordering::Relaxed),
            skipped: self.counters.skipped.load(Ordering::Relaxed),
            failed: self.counters.failed.load(Ordering::Relaxed),
            bytes: self.counters.bytes.load(Ordering::Relaxed),
        }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes what is left and closes the file.
    pub fn finish(mut self) -> RecorderStats {
        self.close();
        self.stats()
    }

    fn close(&mut self) {
        self.items = None;
        if let Some(thread) = self.thread.take() {
            // A panicked writer has already told; what it wrote stays readable.
            let _ = thread.join();
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.close();
    }
}

struct Worker {
    inbox: Receiver<RecordItem>,
    counters: Arc<Counters>,
    path: PathBuf,
    setup: Setup,
    output: Option<Output>,
    /// Items handed to the file since it was last forced to the disk: a failure loses them all.
    pending: u64,
    /// Items that are on the disk in this file: a file that is deleted or truncated loses them.
    settled: u64,
    /// Bytes of the files before this one.
    earlier_bytes: u64,
    part: u32,
    retry: Instant,
}

impl Worker {
    fn run(mut self) {
        let mut sync = Instant::now() + SYNC_PERIOD;
        loop {
            match self.inbox.recv_timeout(sync.saturating_duration_since(Instant::now())) {
                Ok(item) => {
                    self.write(&item);
                    self.counters.waiting.fetch_sub(1, Ordering::Relaxed);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if Instant::now() >= sync {
                sync = Instant::now() + SYNC_PERIOD;
                self.settle(Output::sync);
            }
        }
        self.settle(Output::finish);
    }

    /// Brings what is pending to the disk, and counts it as written or as lost.
    fn settle(&mut self, how: fn(&mut Output) -> Result<(), McapError>) {
        let Some(output) = &mut self.output else { return };
        let spoiled = output.file.metadata().ok().and_then(|file| {
            let truncated = file.len() < output.appended.load(Ordering::Relaxed);
            if is_gone(&file) { Some("deleted") } else { truncated.then_some("truncated") }
        });
        if let Some(what) = spoiled {
            // What was in it is lost as well.
            self.counters.written.fetch_sub(self.settled, Ordering::Relaxed);
            self.pending += self.settled;
            self.give_up(&std::io::Error::other(format!("another process {what} the file")).into());
            // Nothing is wrong with the disk.
            self.retry = Instant::now();
            return;
        }
        match how(output).and_then(|()| Ok(output.file.metadata()?)) {
            Ok(file) => {
                self.settled += self.pending;
                self.counters.written.fetch_add(std::mem::take(&mut self.pending), Ordering::Relaxed);
                self.counters.bytes.store(self.earlier_bytes + file.len(), Ordering::Relaxed);
            }
            Err(error) => self.give_up(&error),
        }
    }

    fn write(&mut self, item: &RecordItem) {
        if self.output.is_none() && Instant::now() >= self.retry {
            self.part += 1;
            self.retry = Instant::now() + RETRY_PERIOD;
            self.output = Output::create(&part_path(&self.path, self.part), &self.setup).ok();
        }
        let Some(output) = &mut self.output else {
            self.counters.failed.fetch_add(1, Ordering::Relaxed);
            return;
        };
        self.pending += 1;
        if let Err(error) = output.write(item) {
            self.give_up(&error);
        }
    }

    /// Leaves a file that can no longer be written; what was on its way there is lost.
    fn give_up(&mut self, error: &McapError) {
        tracing::error!(%error, path = %self.path.display(), "recording failed, messages are lost");
        self.counters.failed.fetch_add(std::mem::take(&mut self.pending), Ordering::Relaxed);
        self.earlier_bytes = self.counters.bytes.load(Ordering::Relaxed);
        self.settled = 0;
        self.output = None;
        self.retry = Instant::now() + RETRY_PERIOD;
    }
}

/// Whether the open file has no name any more.
fn is_gone(file: &std::fs::Metadata) -> bool {
    #[cfg(unix)]
    return std::os::unix::fs::MetadataExt::nlink(file) == 0;
    #[cfg(not(unix))]
    return file.len() == 0;
}

fn part_path(path: &Path, part: u32) -> PathBuf {
    let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("gaware");
    path.with_file_name(format!("{stem}_{part}.mcap"))
}

/// Writes at the end of the file, wherever that is, and counts: after a truncation the file stays too short for good, where
/// writing at an offset would leave a hole that looks like data.
struct Appending {
    file: File,
    taken: Arc<AtomicU64>,
}

impl Write for Appending {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let taken = self.file.write(bytes)?;
        self.taken.fetch_add(taken as u64, Ordering::Relaxed);
        Ok(taken)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

/// The open file and its channels.
struct Output {
    file: File,
    /// Bytes that the file took. It only grows, so a shorter file was truncated by another process.
    appended: Arc<AtomicU64>,
    writer: Writer<NoSeek<BufWriter<Appending>>>,
    frames: BTreeMap<u16, u16>,
    channels: BTreeMap<&'static str, u16>,
    sequence: u32,
}

impl Output {
    fn create(path: &Path, setup: &Setup) -> Result<Self, McapError> {
        if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder)?;
        }
        let file = File::options().append(true).create_new(true).open(path)?;
        let appended = Arc::default();
        let sink = Appending { file: file.try_clone()?, taken: Arc::clone(&appended) };
        // The size of chunks is given by the regular flush.
        let options = WriteOptions::new().library(format!("gaware {}", setup.version)).disable_seeking(true);
        let mut writer = options.create(NoSeek::new(BufWriter::new(sink)))?;
        let json = serde_json::to_string(setup).unwrap_or_default();
        writer.write_metadata(&Metadata {
            name: SETUP_METADATA.to_owned(),
            metadata: BTreeMap::from([("json".to_owned(), json)]),
        })?;
        writer.attach(&Attachment {
            log_time: 0,
            create_time: 0,
            name: MODEL_ATTACHMENT.to_owned(),
            media_type: "application/toml".to_owned(),
            data: Cow::Borrowed(setup.model_toml.as_bytes()),
        })?;
        let mut output =
            Self { file, appended, writer, frames: BTreeMap::new(), channels: BTreeMap::new(), sequence: 0 };
        // All channels at once, in a chunk of their own: damage to later chunks cannot take them away.
        for (link, address) in setup.links.iter().enumerate() {
            output.frame_channel(link as u16, address)?;
        }
        output.channel::<ImuRecord>("/imu", "gaware.Imu")?;
        output.channel::<FixRecord>("/fix", "gaware.Fix")?;
        output.channel::<AttitudeRecord>("/attitude_autopilot", "gaware.Attitude")?;
        output.channel::<Snapshot>("/snapshot", "gaware.Snapshot")?;
        output.channel::<LocationFix>("/position", "foxglove.LocationFix")?;
        output.channel::<PoseInFrame>("/pose", "foxglove.PoseInFrame")?;
        output.channel::<Log>("/log", "foxglove.Log")?;
        output.sync()?;
        Ok(output)
    }

    fn frame_channel(&mut self, link: u16, address: &str) -> Result<u16, McapError> {
        let metadata = BTreeMap::from([("address".to_owned(), address.to_owned())]);
        let id = self.writer.add_channel(0, &format!("{FRAME_TOPIC}{link}"), "mavlink", &metadata)?;
        self.frames.insert(link, id);
        Ok(id)
    }

    fn channel<T: JsonSchema>(&mut self, topic: &'static str, name: &str) -> Result<(), McapError> {
        let schema = serde_json::to_vec(&schemars::schema_for!(T)).unwrap_or_default();
        let schema = self.writer.add_schema(name, "jsonschema", &schema)?;
        let id = self.writer.add_channel(schema, topic, "json", &BTreeMap::new())?;
        self.channels.insert(topic, id);
        Ok(())
    }

    fn write(&mut self, item: &RecordItem) -> Result<(), McapError> {
        match item {
            RecordItem::Frame(received) => {
                let id = match self.frames.get(&received.link) {
                    Some(id) => *id,
                    None => self.frame_channel(received.link, "")?,
                };
                self.put(id, received.t_us, received.frame.raw())
            }
            RecordItem::Sample(t_us, Sample::Imu(s)) => self.json("/imu", *t_us, &ImuRecord::from(s)),
            RecordItem::Sample(t_us, Sample::Fix(s)) => self.json("/fix", *t_us, &FixRecord::from(s)),
            RecordItem::Sample(t_us, Sample::Attitude(s)) => {
                self.json("/attitude_autopilot", *t_us, &AttitudeRecord::from(s))
            }
            // Both are told again by the frames and stand in the log.
            RecordItem::Sample(_, Sample::Stream(_) | Sample::Restart(_)) => Ok(()),
            RecordItem::Snapshot(t_us, s) => {
                self.json("/snapshot", *t_us, s)?;
                self.json("/position", *t_us, &LocationFix::new(*t_us, s))?;
                self.json("/pose", *t_us, &PoseInFrame::new(*t_us, s))
            }
            RecordItem::Log(t_us, severity, text) => {
                self.json("/log", *t_us, &Log::new(*t_us, *severity, text))
            }
        }
    }

    fn json<T: Serialize>(&mut self, topic: &'static str, t_us: u64, value: &T) -> Result<(), McapError> {
        let id = self.channels.get(topic).copied().unwrap_or_default();
        let bytes = serde_json::to_vec(value).unwrap_or_default();
        self.put(id, t_us, &bytes)
    }

    fn put(&mut self, channel_id: u16, t_us: u64, data: &[u8]) -> Result<(), McapError> {
        let t_ns = t_us.saturating_mul(1000);
        self.sequence = self.sequence.wrapping_add(1);
        let header =
            MessageHeader { channel_id, sequence: self.sequence, log_time: t_ns, publish_time: t_ns };
        self.writer.write_to_known_channel(&header, data)
    }

    fn sync(&mut self) -> Result<(), McapError> {
        self.writer.flush()?;
        Ok(self.file.sync_data()?)
    }

    fn finish(&mut self) -> Result<(), McapError> {
        self.writer.finish()?;
        Ok(self.file.sync_all()?)
    }
}

/// The file to record to: `wanted` itself when it names a file, a new name in it when it is a folder.
pub fn recording_path(wanted: &Path, unix_us: u64) -> PathBuf {
    if wanted.extension().is_some_and(|e| e == "mcap") {
        return wanted.to_owned();
    }
    wanted.join(format!("gaware-{}.mcap", utc(unix_us / 1_000_000)))
}

/// `20260102-030405` (days to civil date: Hinnant, "chrono-compatible low-level date algorithms").
fn utc(unix_s: u64) -> String {
    let (days, s) = (unix_s / 86_400 + 719_468, unix_s % 86_400);
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year:04}{month:02}{day:02}-{:02}{:02}{:02}", s / 3600, s / 60 % 60, s % 60)
}

#[cfg(test)]
mod tests;
