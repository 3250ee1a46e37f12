//! Recorded flights of every format as one stream of records.
//!
//! Formats that hold MAVLink frames give frames, which take the same way as those of a live link; formats that hold
//! the autopilot's own sensor messages give measurements. Readers decide nothing
//! about time. Damage is skipped and counted, never fatal while anything can be
//! read.

pub mod dataflash;
pub mod filter;
pub mod mcap;
mod note;
pub mod source;
pub mod table;
pub mod tlog;
pub mod ulog;
mod window;

use crate::inputs::Input;
use crate::link::frame::Frame;
use crate::timeline::Measurement;
use gaware_nav::observability::words::VehicleKind;
pub use note::{HealthNote, Level, LogNote, TRUTH, VehicleClass};
use schemars::JsonSchema;
use serde::Serialize;
use std::io::Read;
use std::path::{Path, PathBuf};

/// One entry of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// When it was received or logged, µs: Unix time in logs of links, boot time in logs of autopilots.
    pub t_us: u64,
    /// What.
    pub item: Item,
}

/// What an entry of a log is.
#[derive(Debug, Clone, PartialEq)]
pub enum Item {
    /// A MAVLink frame, still to be converted.
    Frame(Frame),
    /// A measurement with the autopilot's own stamp, still to be put in order.
    Measurement(Measurement),
    /// What the autopilot's own log says beside its sensors: no part of the pipeline.
    Note(LogNote),
}

/// How far a reader is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// Bytes consumed.
    pub read_bytes: u64,
    /// Bytes of the file.
    pub total_bytes: u64,
}

/// What a reader could not use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, JsonSchema)]
pub struct Damage {
    /// Bytes that belong to no entry.
    pub skipped_bytes: u64,
    /// Entries with a wrong checksum or content.
    pub bad_records: u64,
    /// Messages outside the dialect.
    pub unknown_messages: u64,
    /// Whether the file ends in the middle of an entry: most logs do, as logging ends with the power. Nothing is lost with it.
    pub truncated: bool,
}

impl Damage {
    /// Whether anything was lost (messages outside the dialect and an entry that the end of the file cuts are none).
    pub fn any(&self) -> bool {
        self.skipped_bytes > 0 || self.bad_records > 0
    }
}

/// A log being read.
pub trait LogReader: Iterator<Item = Result<Record, LogError>> + Send {
    /// How far.
    fn progress(&self) -> Progress;
    /// What could not be used so far.
    fn damage(&self) -> Damage;
    /// The autopilot, where the format itself reports it (formats with frames leave it to the heartbeat).
    fn autopilot(&self) -> Option<&'static str> {
        None
    }
    /// What flew, as far as the log has said so by now (formats with frames leave it to the heartbeat).
    fn vehicle_kind(&self) -> Option<VehicleKind> {
        None
    }
}

/// Why a log cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file cannot be opened.
    #[error("cannot open {path}: {source}")]
    Open {
        /// File.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Reading failed on the way.
    #[error("reading failed after {read_bytes} bytes: {source}")]
    Read {
        /// Bytes consumed before.
        read_bytes: u64,
        /// What the system said.
        source: std::io::Error,
    },
    /// Nothing in it.
    #[error("{0} is empty")]
    Empty(PathBuf),
    /// A table that is none.
    #[error("{path}, row {row}: {reason}")]
    Table {
        /// File.
        path: PathBuf,
        /// Row, counted from 1 without the header.
        row: usize,
        /// What is wrong.
        reason: String,
    },
    /// A table alone.
    #[error("there is no imu.csv beside {0}: a table of fixes is read together with the inertial samples")]
    NoImu(PathBuf),
    /// Another format.
    #[error(
        "{0}: unsupported format; gaware reads .tlog, .bin and its text (.log), .ulg, .mcap, a folder with imu.csv"
    )]
    UnknownFormat(PathBuf),
    /// The format was recognised, and not one entry could be read.
    #[error("no {format} entry could be read in {bytes} bytes: the file is damaged or of another format")]
    NothingReadable {
        /// Format that was tried.
        format: &'static str,
        /// Bytes looked at.
        bytes: u64,
    },
    /// Entries, and none that can be put in order.
    #[error(
        "it holds no sensor data with a time: a log without a flight, or of firmware before ArduPilot 3.1, which wrote no times"
    )]
    NoTimes,
    /// A sound recording of a run that received nothing.
    #[error(
        "there are no MAVLink frames in it: the recording of a run without a vehicle, or of another program"
    )]
    NoFrames,
}

/// The formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Tlog,
    Mcap,
    Dataflash,
    DataflashText,
    Ulog,
}

/// Opens a log of any known format. The content decides; the extension only where the content says nothing.
///
/// # Errors
/// No such file, an empty one, or one of another format.
pub fn open(log: impl Into<Input>) -> Result<Box<dyn LogReader>, LogError> {
    let log = log.into();
    let path = log.path();
    if log.is_file() && table::is_table(path) {
        return Ok(Box::new(table::TableReader::read(path)?));
    }
    let failed = |source| LogError::Open { path: path.to_owned(), source };
    let mut file = log.open().map_err(failed)?;
    let total = file.total_bytes().map_err(failed)?;
    let mut head = Vec::with_capacity(dataflash::text::HEAD);
    file.by_ref().take(dataflash::text::HEAD as u64).read_to_end(&mut head).map_err(failed)?;
    if head.is_empty() {
        return Err(LogError::Empty(path.to_owned()));
    }
    let again = || log.open().map_err(failed);
    let file = again()?;
    match format_of(&head, path) {
        Some(Format::Tlog) => Ok(Box::new(tlog::TlogReader::new(file, total))),
        Some(Format::Mcap) => Ok(Box::new(mcap::McapReader::new(file, total))),
        Some(Format::Dataflash) => dataflash(again()?, file, total),
        Some(Format::DataflashText) => {
            let binary = dataflash::text::Transcoder::new;
            dataflash(binary(again()?), binary(file), total)
        }
        Some(Format::Ulog) => {
            let best = ulog::UlogReader::new(again()?, total).survey()?.best();
            let best = best.unwrap_or(source::Choice::of(source::Source::COMBINED));
            Ok(Box::new(ulog::UlogReader::new(file, total).with_source(best)))
        }
        None => Err(LogError::UnknownFormat(path.to_owned())),
    }
}

/// A log of ArduPilot, read for its inertial sources first.
fn dataflash<R: Read + Send + 'static>(
    survey: R,
    source: R,
    total: u64,
) -> Result<Box<dyn LogReader>, LogError> {
    let best = dataflash::DataflashReader::new(survey, total).survey()?.best();
    let best = best.unwrap_or(source::Choice::of(source::Source::IMU));
    Ok(Box::new(dataflash::DataflashReader::new(source, total).with_source(best)))
}

fn format_of(head: &[u8], path: &Path) -> Option<Format> {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match head {
        head if head.starts_with(mcap::MAGIC) => Some(Format::Mcap),
        head if head.starts_with(ulog::MAGIC) => Some(Format::Ulog),
        head if head.starts_with(&dataflash::MAGIC) => Some(Format::Dataflash),
        [_, _, _, _, _, _, _, _, 0xFD | 0xFE, ..] => Some(Format::Tlog),
        head if dataflash::text::is_one(head) => Some(Format::DataflashText),
        _ => match extension.as_deref() {
            Some("tlog") => Some(Format::Tlog),
            _ => None,
        },
    }
}

#[cfg(test)]
mod tests;
