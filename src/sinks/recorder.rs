//! The recording of a run: an MCAP file that holds everything needed to run it again, and that Foxglove opens.
//!
//! One writer thread owns the file; whoever records only hands items over and never waits. Twice a second the open
//! chunk is finished and forced to the disk, so that a power cut costs less than a second. A disk that is full costs
//! messages, which are counted, and a fresh file is tried now and then.
//!
//! What is in it, topic by topic, [`messages`](super::messages) says.

mod held;
mod output;
mod space;
mod worker;

pub use super::messages::RecordItem;
use crate::figures::civil;
pub use crate::logs::mcap::{SETUP_METADATA, Setup};
use mcap::McapError;
use output::Output;
pub use space::RecordLimit;
use space::{Removed, Space};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use worker::Worker;

/// Name of the attachment with the model.
pub const MODEL_ATTACHMENT: &str = "model.toml";

/// Items that may wait for the writer. Frames are what a replay needs: they are dropped last.
const FRAMES_AHEAD: usize = 256 * 1024;
/// Everything else can be had again from the frames. A disk on which others write was measured to take 11 s for one flush, and a flight that is played ten
/// times as fast as it was flown has 4600 items a second.
const DERIVED_AHEAD: usize = 64 * 1024;
/// Recordings that may begin in the same second in one folder.
const MAX_NAMES: u32 = 1000;
/// Bytes of a chunk; at the rates of vehicles the regular flush ends it before.
const CHUNK_BYTES: u64 = 64 * 1024;
/// Half of the second that may be lost: the other half is for a disk that is slow to take it.
const SYNC_PERIOD: Duration = Duration::from_millis(500);
const RETRY_PERIOD: Duration = Duration::from_secs(10);

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
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct RecorderStats {
    /// Items that are on the disk.
    pub written: u64,
    /// Frames lost because the writer was behind.
    pub dropped: u64,
    /// Samples and snapshots left out because the writer was behind. A replay makes them again from the frames: nothing is lost.
    pub skipped: u64,
    /// Items lost because writing failed.
    pub failed: u64,
    /// Bytes brought to the disk, those of removed files included.
    pub bytes: u64,
    /// Files of this run.
    pub files: u64,
    /// Older recordings removed for the sake of the limit.
    pub removed_files: u64,
    /// Their bytes.
    pub removed_bytes: u64,
}

#[derive(Debug, Default)]
struct Counters {
    /// Held for a few additions, never while the disk is busy.
    stats: Mutex<RecorderStats>,
    waiting: AtomicUsize,
}

impl Counters {
    fn stats(&self) -> MutexGuard<'_, RecorderStats> {
        self.stats.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn removed(&self, removed: Removed) {
        let mut stats = self.stats();
        stats.removed_files += removed.files;
        stats.removed_bytes += removed.bytes;
    }
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
        Self::with(path, setup, None)
    }

    /// Starts to record into the file or the folder that is wanted. In a folder the name shows the time; where another start in the
    /// same second has taken it, as on a board without a clock, a number is added. With a limit the recording becomes several files,
    /// and the oldest ones are removed: in a folder those of earlier runs too, otherwise those of this run alone.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub fn start_in(
        wanted: &Path,
        unix_us: u64,
        setup: &Setup,
        limit: Option<RecordLimit>,
    ) -> Result<Self, RecorderError> {
        let first = recording_path(wanted, unix_us);
        let space = limit.map(|limit| Space::new(limit, first != wanted));
        let mut path = first.clone();
        for number in 2..=MAX_NAMES {
            match Self::with(&path, setup, space.clone()) {
                Err(RecorderError::Create { source: McapError::Io(e), .. })
                    if e.kind() == std::io::ErrorKind::AlreadyExists && first != wanted =>
                {
                    let stem = first.file_stem().and_then(|s| s.to_str()).unwrap_or("gaware");
                    path = first.with_file_name(format!("{stem}-{number}.mcap"));
                }
                result => return result,
            }
        }
        Self::with(&path, setup, space)
    }

    fn with(path: &Path, setup: &Setup, mut space: Option<Space>) -> Result<Self, RecorderError> {
        let output = Output::create(path, setup)
            .map_err(|source| RecorderError::Create { path: path.to_owned(), source })?;
        let (items, inbox) = channel();
        let counters = Arc::new(Counters::default());
        counters.stats().files = 1;
        if let Some(space) = &mut space {
            counters.removed(space.make_for(path));
        }
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
            space,
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
        let is_frame = matches!(item, RecordItem::Frame(_) | RecordItem::Setup(_));
        let room = if is_frame { FRAMES_AHEAD } else { DERIVED_AHEAD };
        let waiting = &counters.waiting;
        // Counted before it is sent: the writer takes it off again after it has taken it.
        if waiting.fetch_add(1, Ordering::Relaxed) >= room
            || self.items.as_ref().is_none_or(|items| items.send(item).is_err())
        {
            waiting.fetch_sub(1, Ordering::Relaxed);
            let mut stats = counters.stats();
            let lost = if is_frame { &mut stats.dropped } else { &mut stats.skipped };
            *lost += 1;
        }
    }

    /// How it is doing.
    pub fn stats(&self) -> RecorderStats {
        *self.counters.stats()
    }

    /// Items that wait for the writer: who records faster than any vehicle can wait for it.
    pub fn waiting(&self) -> usize {
        self.counters.waiting.load(Ordering::Relaxed)
    }

    /// The first file.
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
            // A panicked writer has already reported it; what it wrote stays readable.
            let _ = thread.join();
            // What it did not come to is lost.
            let left = self.counters.waiting.swap(0, Ordering::Relaxed);
            self.counters.stats().failed += left as u64;
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.close();
    }
}

fn part_path(path: &Path, part: u32) -> PathBuf {
    let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("gaware");
    path.with_file_name(format!("{stem}_{part}.mcap"))
}

/// The file to record to: `wanted` itself when it names a file, a new name in it when it is a folder.
pub fn recording_path(wanted: &Path, unix_us: u64) -> PathBuf {
    if wanted.extension().is_some_and(|e| e == "mcap") {
        return wanted.to_owned();
    }
    wanted.join(format!("gaware-{}.mcap", utc(unix_us / 1_000_000)))
}

/// `20260102-030405`.
fn utc(unix_s: u64) -> String {
    let ((year, month, day), s) = (civil((unix_s / 86_400) as i64), unix_s % 86_400);
    format!("{year:04}{month:02}{day:02}-{:02}{:02}{:02}", s / 3600, s / 60 % 60, s % 60)
}

#[cfg(test)]
mod flat_tests;
#[cfg(test)]
mod tests;
