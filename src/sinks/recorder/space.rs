//! Space for recordings: a limit for all of them together, kept by removing the oldest.
//!
//! Only what this program recorded is ever removed: a file must carry the name of a recording (or be one of this run) and begin
//! as one. A recording that is still written, here or by another process, is held and stays.

use super::held;
use serde::Serialize;
use std::fmt;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::SystemTime;

/// A recording becomes so many files within the limit.
const PARTS: u64 = 8;
/// The least limit, bytes: below it the heads of the files would be most of them.
const LEAST: u64 = 1_000_000;
/// In the head of every recording of this program.
const LIBRARY: &[u8] = b"gaware ";
/// Bytes in which the library's name must stand.
const HEAD: u64 = 64;

/// What all recordings together may take, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct RecordLimit(u64);

impl RecordLimit {
    /// Bytes.
    pub fn bytes(self) -> u64 {
        self.0
    }
}

impl fmt::Display for RecordLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&crate::sinks::words::bytes(self.0))
    }
}

/// Not a size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("write a size such as 500MB or 2GB, at least 1MB")]
pub struct RecordLimitError;

impl FromStr for RecordLimit {
    type Err = RecordLimitError;

    fn from_str(text: &str) -> Result<Self, RecordLimitError> {
        let text = text.trim();
        let end = text.find(|c: char| c.is_ascii_alphabetic()).ok_or(RecordLimitError)?;
        let (number, unit) = text.split_at(end);
        let unit = match unit.to_ascii_uppercase().as_str() {
            "MB" | "M" => 1e6,
            "GB" | "G" => 1e9,
            "TB" | "T" => 1e12,
            _ => return Err(RecordLimitError),
        };
        let number: f64 = number.trim().parse().map_err(|_| RecordLimitError)?;
        let bytes = number * unit;
        if bytes.is_finite() && bytes >= LEAST as f64 && bytes < 1e18 {
            Ok(Self(bytes as u64))
        } else {
            Err(RecordLimitError)
        }
    }
}

/// What was removed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Removed {
    /// Files.
    pub(super) files: u64,
    /// Their bytes.
    pub(super) bytes: u64,
}

/// The limit, and which recordings count against it.
#[derive(Debug, Clone)]
pub(super) struct Space {
    limit: RecordLimit,
    /// Whether the recordings of earlier runs count: the user named a folder, and names are given by us.
    of_folder: bool,
    /// The files of this run, oldest first.
    own: Vec<PathBuf>,
}

/// A recording that may be removed.
struct Candidate {
    path: PathBuf,
    bytes: u64,
    modified: SystemTime,
}

impl Space {
    pub(super) fn new(limit: RecordLimit, of_folder: bool) -> Self {
        Self { limit, of_folder, own: Vec::new() }
    }

    /// A file that has grown to this is followed by another one.
    pub(super) fn part_bytes(&self) -> u64 {
        self.limit.0 / PARTS
    }

    /// Removes the oldest recordings until a new file at `path` can grow to its size: with what is written between two looks at
    /// that size the limit still holds.
    pub(super) fn make_for(&mut self, path: &Path) -> Removed {
        let own = |c: &Candidate| self.own.contains(&c.path);
        let mut candidates: Vec<Candidate> = recordings(path)
            .into_iter()
            .filter(|c| c.path != path && (own(c) || self.of_folder && has_given_name(&c.path)))
            .collect();
        // Without a clock times may be equal; the names then count.
        candidates.sort_by(|a, b| {
            a.modified.cmp(&b.modified).then_with(|| length_and_name(&a.path).cmp(&length_and_name(&b.path)))
        });
        let mut total: u64 = candidates.iter().map(|c| c.bytes).sum();
        let most = self.limit.0.saturating_sub(2 * self.part_bytes());
        let mut removed = Removed::default();
        for candidate in candidates {
            if total <= most {
                break;
            }
            if remove(&candidate.path) {
                total -= candidate.bytes;
                removed.files += 1;
                removed.bytes += candidate.bytes;
                self.own.retain(|p| *p != candidate.path);
            }
        }
        self.own.push(path.to_owned());
        removed
    }
}

/// Numbers without leading zeros sort by their length first.
fn length_and_name(path: &Path) -> (usize, &Path) {
    (path.as_os_str().len(), path)
}

/// Regular files beside `path` that end in `.mcap`.
fn recordings(path: &Path) -> Vec<Candidate> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let candidate = |entry: std::fs::DirEntry| {
        // Of the entry itself: a link to elsewhere is no recording of ours.
        let about = entry.metadata().ok().filter(|m| m.is_file())?;
        let path = path.with_file_name(entry.file_name());
        let modified = about.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        let named = path.extension().is_some_and(|e| e == "mcap");
        named.then_some(Candidate { path, bytes: about.len(), modified })
    };
    entries.filter_map(Result::ok).filter_map(candidate).collect()
}

/// Whether this is a name that [`super::recording_path`] gives, with the numbers that may follow: `gaware-20260102-030405-2_3.mcap`.
fn has_given_name(path: &Path) -> bool {
    let Some(rest) = path.file_stem().and_then(|s| s.to_str()).and_then(|s| s.strip_prefix("gaware-")) else {
        return false;
    };
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let (rest, part) = rest.split_once('_').map_or((rest, None), |(rest, part)| (rest, Some(part)));
    let mut groups = rest.split('-');
    let dated = groups.next().is_some_and(|d| d.len() == 8 && digits(d))
        && groups.next().is_some_and(|t| t.len() == 6 && digits(t));
    dated && groups.next().is_none_or(digits) && groups.next().is_none() && part.is_none_or(digits)
}

/// Removes a recording of this program that no one writes any more.
fn remove(path: &Path) -> bool {
    let Some(file) = held::open_unless_held(path) else { return false };
    let mut head = Vec::new();
    if (&file).take(HEAD).read_to_end(&mut head).is_err()
        || !head.windows(LIBRARY.len()).any(|w| w == LIBRARY)
    {
        return false;
    }
    match std::fs::remove_file(path) {
        Ok(()) => {
            tracing::warn!(path = %path.display(), "the oldest recording was removed to keep within --record-limit");
            true
        }
        Err(error) => {
            tracing::warn!(%error, path = %path.display(), "an old recording cannot be removed; --record-limit is exceeded");
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_people_write_them() {
        let read = |text: &str| text.parse::<RecordLimit>().map(RecordLimit::bytes);
        assert_eq!(read("2GB"), Ok(2_000_000_000));
        assert_eq!(read("1.5 gb"), Ok(1_500_000_000));
        assert_eq!(read("500M"), Ok(500_000_000));
        for wrong in ["", "2", "GB", "-1GB", "10kB", "0.1MB", "nanGB", "1e30TB", "2GiB"] {
            assert_eq!(read(wrong), Err(RecordLimitError), "{wrong}");
        }
    }

    #[test]
    fn only_names_that_the_program_gives_count_as_recordings_of_earlier_runs() {
        for ours in [
            "gaware-20260102-030405.mcap",
            "gaware-20260102-030405-2.mcap",
            "gaware-20260102-030405-2_13.mcap",
        ] {
            assert!(has_given_name(Path::new(ours)), "{ours}");
        }
        for foreign in [
            "gaware.mcap",
            "gaware-20260102.mcap",
            "gaware-20260102-030405-best.mcap",
            "gaware-20260102-030405_.mcap",
            "gaware-20260102-030405-2-3.mcap",
            "flight-20260102-030405.mcap",
            "gaware-2026010x-030405.mcap",
        ] {
            assert!(!has_given_name(Path::new(foreign)), "{foreign}");
        }
    }
}
