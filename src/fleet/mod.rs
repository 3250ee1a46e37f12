//! Many flights at once: every log replayed and explained once, its result kept under the address of its content, and tables of all.
//!
//! [`flight`] is the unit of work: one log in, one [`flight::FlightEntry`] out, the same for the program's worker processes and for the Python
//! package's. [`store`] keeps entries under the hash of the log's bytes, of the program's sources, of the model and of the options: what
//! is there is never done twice, and a changed log, program or model is done again. [`tables`] makes rows of entries, [`family`] finds what
//! the flights of each inertial unit have in common. No processes and no clocks here: `commands::fleet` has them.

pub mod family;
#[cfg(not(target_family = "wasm"))]
pub mod find;
pub mod flight;
pub mod log;
#[cfg(not(target_family = "wasm"))]
pub mod store;
#[cfg(not(target_family = "wasm"))]
pub mod tables;

use crate::outputs::OutputError;
use std::path::PathBuf;

/// Why a fleet cannot be worked on.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// A pattern or folder with nothing in it.
    #[error("no log at {0}: gaware reads .tlog, .bin, .log, .ulg, .mcap and folders with imu.csv")]
    NoLog(String),
    /// A pattern that is none.
    #[error("invalid pattern {pattern}: {reason}")]
    Pattern {
        /// As written.
        pattern: String,
        /// What is wrong.
        reason: String,
    },
    /// A rule for names that is none.
    #[error(
        "invalid name rule {0}: it needs {{unit}}, may have {{firmware}} and *, and no two of these side by side"
    )]
    Rule(String),
    /// A file or folder cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// File or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file or folder is not written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A list of results that is not as it was written.
    #[error(
        "{path} was edited since gaware wrote it, or belongs to another version: run \"gaware fleet\" again, which takes what is in {results}",
        path = path.display(), results = path.with_file_name("results").display()
    )]
    Edited {
        /// The list.
        path: PathBuf,
    },
    /// A folder that holds no fleet.
    #[error("{0} holds no result of gaware fleet: run \"gaware fleet LOGS --out {0}\" first")]
    NoFleet(PathBuf),
    /// Not one flight could be analysed.
    #[error("none of {count} logs could be analysed; the first: {first}")]
    AllFailed {
        /// Logs.
        count: usize,
        /// Log and reason.
        first: String,
    },
    /// A log that is still being written.
    #[error("{0} changed while it was read; the next run tries again")]
    Changed(PathBuf),
    /// A unit that no flight has.
    #[error("no flight of unit {unit}; units of this fleet: {known}")]
    NoUnit {
        /// As written.
        unit: String,
        /// Comma separated.
        known: String,
    },
    /// A log that takes more than it may.
    #[error("{log}: ended at its limit of {limit}; give it more with {option}", log = log.display())]
    Limit {
        /// Log.
        log: PathBuf,
        /// What it took, in words.
        limit: String,
        /// The option that sets the limit.
        option: &'static str,
    },
    /// A worker that left no result: killed, out of memory, or a defect.
    #[error("{log}: its process ended without a result ({reason}); the next run tries again")]
    Worker {
        /// Log.
        log: PathBuf,
        /// How it ended.
        reason: String,
    },
}
