//! The writer's thread: takes items, brings them to the disk twice a second, and leaves a file that can no longer be written.

use super::held;
use super::output::Output;
use super::space::Space;
use super::{Counters, RETRY_PERIOD, RecordItem, SYNC_PERIOD, Setup, part_path};
use mcap::McapError;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Instant;

/// Owns the file; everything that waits for the disk happens here.
pub(super) struct Worker {
    pub(super) inbox: Receiver<RecordItem>,
    pub(super) counters: Arc<Counters>,
    pub(super) path: PathBuf,
    pub(super) setup: Setup,
    pub(super) output: Option<Output>,
    /// Items handed to the file since it was last forced to the disk: a failure loses them all.
    pub(super) pending: u64,
    /// Items that are on the disk in this file: a file that is deleted or truncated loses them.
    pub(super) settled: u64,
    /// Bytes of the files before this one.
    pub(super) earlier_bytes: u64,
    /// Number of the newest file of this run.
    pub(super) part: u32,
    pub(super) retry: Instant,
    /// The limit of all recordings together, where there is one.
    pub(super) space: Option<Space>,
}

impl Worker {
    pub(super) fn run(mut self) {
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
            if held::is_gone(&file) { Some("deleted") } else { truncated.then_some("truncated") }
        });
        if let Some(what) = spoiled {
            // What was in it is lost as well.
            self.counters.stats().written -= self.settled;
            self.pending += self.settled;
            self.give_up(&std::io::Error::other(format!("another process {what} the file")).into());
            // Nothing is wrong with the disk.
            self.retry = Instant::now();
            return;
        }
        match how(output).and_then(|()| Ok(output.file.metadata()?)) {
            Ok(file) => {
                self.settled += self.pending;
                let mut stats = self.counters.stats();
                stats.written += std::mem::take(&mut self.pending);
                stats.bytes = self.earlier_bytes + file.len();
            }
            Err(error) => self.give_up(&error),
        }
    }

    /// Ends a file that has reached its share of the limit, and begins the next one.
    fn rotate(&mut self) {
        let written = self.output.as_ref().map_or(0, |o| o.appended.load(Ordering::Relaxed));
        if self.space.as_ref().is_none_or(|s| written < s.part_bytes()) {
            return;
        }
        self.settle(Output::finish);
        if self.output.take().is_some() {
            self.earlier_bytes = self.counters.stats().bytes;
            self.settled = 0;
            self.begin_next();
        }
    }

    /// The next file of this run, with space for it.
    fn begin_next(&mut self) {
        // Numbers of this run only rise; those that an earlier run left are skipped.
        self.part += 1;
        while part_path(&self.path, self.part).exists() {
            self.part += 1;
        }
        let path = part_path(&self.path, self.part);
        if let Some(space) = &mut self.space {
            let removed = space.make_for(&path);
            self.counters.removed(removed);
        }
        match Output::create(&path, &self.setup) {
            Ok(output) => {
                self.output = Some(output);
                self.counters.stats().files += 1;
            }
            Err(error) => {
                tracing::warn!(%error, path = %path.display(), "the next recording could not be started");
            }
        }
    }

    fn write(&mut self, item: &RecordItem) {
        if let RecordItem::Setup(setup) = item {
            self.setup = (**setup).clone();
        }
        if self.output.is_none() && Instant::now() >= self.retry {
            self.retry = Instant::now() + RETRY_PERIOD;
            self.begin_next();
        }
        let Some(output) = &mut self.output else {
            self.counters.stats().failed += 1;
            return;
        };
        self.pending += 1;
        match output.write(item) {
            Ok(()) => self.rotate(),
            Err(error) => self.give_up(&error),
        }
    }

    /// Leaves a file that can no longer be written; what was on its way there is lost.
    fn give_up(&mut self, error: &McapError) {
        tracing::error!(%error, path = %self.path.display(), "recording failed, messages are lost");
        self.counters.stats().failed += std::mem::take(&mut self.pending);
        self.earlier_bytes = self.counters.stats().bytes;
        self.settled = 0;
        self.output = None;
        self.retry = Instant::now() + RETRY_PERIOD;
    }
}

impl Drop for Worker {
    /// A writer that dies loses what was not on the disk yet.
    fn drop(&mut self) {
        self.counters.stats().failed += self.pending;
    }
}
