//! The part of a file that a reader looks at: filled on demand, consumed from the front.

use super::{LogError, Progress};
use std::io::Read;

const CHUNK: usize = 64 * 1024;

/// A window that moves over a file.
#[derive(Debug)]
pub struct Window<R> {
    source: R,
    buffer: Vec<u8>,
    start: usize,
    at_end: bool,
    progress: Progress,
}

impl<R: Read> Window<R> {
    /// At the first byte of `source`, which has `total_bytes`.
    pub fn new(source: R, total_bytes: u64) -> Self {
        let progress = Progress { read_bytes: 0, total_bytes };
        Self { source, buffer: Vec::new(), start: 0, at_end: false, progress }
    }

    /// Makes sure that so many bytes are in the window, as far as the file has them.
    ///
    /// # Errors
    /// When reading fails.
    pub fn fill(&mut self, wanted: usize) -> Result<(), LogError> {
        while !self.at_end && self.buffer.len() - self.start < wanted {
            self.buffer.drain(..self.start);
            self.start = 0;
            let old = self.buffer.len();
            self.buffer.resize(old + CHUNK.max(wanted), 0);
            let read = loop {
                match self.source.read(self.buffer.get_mut(old..).unwrap_or_default()) {
                    Ok(n) => break n,
                    Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                    Err(source) => {
                        self.buffer.truncate(old);
                        return Err(LogError::Read { read_bytes: self.progress.read_bytes, source });
                    }
                }
            };
            self.buffer.truncate(old + read);
            self.at_end = read == 0;
        }
        Ok(())
    }

    /// What is in the window.
    pub fn bytes(&self) -> &[u8] {
        self.buffer.get(self.start..).unwrap_or_default()
    }

    /// Whether the file has nothing behind the window.
    pub fn at_end(&self) -> bool {
        self.at_end
    }

    /// Moves on by so many bytes, as far as the window has them.
    pub fn consume(&mut self, n: usize) {
        let n = n.min(self.buffer.len() - self.start);
        self.start += n;
        self.progress.read_bytes += n as u64;
    }

    /// How far it is.
    pub fn progress(&self) -> Progress {
        self.progress
    }
}
